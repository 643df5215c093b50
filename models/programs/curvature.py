"""Lower bounds on the curvature of quadratic objectives that hold in spite of all rounding errors."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .intervals import ROUNDOFF, SLACK, TINY, difference, sums

__all__ = ["CURVATURE", "LARGEST_DENSE", "least_curvature"]

Vector = NDArray[np.float64]

#: Negative curvature, relative to the largest entry of the Hessian, that is due to rounding.
CURVATURE = 1e-9
#: Largest order of a Hessian whose dense matrix is factorised.
LARGEST_DENSE = 2000
#: Largest order of a factorisation in rational arithmetic, in about 20 ms.
LARGEST_RATIONAL = 16
#: Largest number of operations of the product of sparse factors, in about 0.2 s.
LARGEST_PRODUCT = 5e7


@np.errstate(all="ignore")  # overflow gives no bound
def least_curvature(hessian: sp.csr_array) -> Vector:
    """Return a vector d, shape (n,), such that ``x @ hessian @ x >= d @ x**2`` for every x.

    A matrix with a dominant diagonal is at least the diagonal matrix of its excesses. Any other matrix is scaled
    to a diagonal near 1 and shifted until a factorisation succeeds. The error bound of the factorisation (Rump,
    "Verification of positive definiteness", BIT 46, 2006) then gives the least eigenvalue. The vector is
    non-negative if the matrix, or the symmetric part of one that is not symmetric, is proven to be positive
    semidefinite, and -inf if it has a clearly negative eigenvalue or is too large.
    """
    size = hessian.shape[0]
    diagonal = hessian.diagonal()
    filled = np.diff(hessian.indptr) > 0
    if (diagonal[filled] <= 0).any():
        return np.full(size, -np.inf)
    if not (hessian != hessian.T).nnz:
        excess = difference(2.0 * diagonal, *sums(abs(hessian), np.ones(size))).low
        excess = np.where(np.diff(hessian.indptr) <= 1, diagonal, excess)
        if (excess >= 0).all():
            return excess
    result = np.zeros(size)
    used = np.flatnonzero(filled)
    part = hessian[used][:, used]
    # Powers of 2 scale without rounding.
    exponents = np.frexp(diagonal[used])[1] // 2
    scaling = sp.diags_array(np.ldexp(1.0, -exponents))
    scaled = scaling @ part @ scaling
    deficit = _deficit(sp.csr_array(0.5 * (scaled + scaled.T)))
    if deficit > 0 and used.size <= LARGEST_RATIONAL and _is_semidefinite(part):
        deficit = 0.0
    result[used] = -np.nextafter(np.ldexp(deficit, 2 * exponents), np.inf) if deficit else 0.0
    return result


def _deficit(matrix: sp.csr_array) -> float:
    """Return s >= 0 such that ``matrix + s * I``, of entries rounded once, is semidefinite; inf without one."""
    size = matrix.shape[0]
    if not np.isfinite(matrix.data).all():
        return np.inf
    rounding = SLACK * ROUNDOFF * float(abs(matrix).sum(axis=1).max()) + size * TINY
    for shift in (-CURVATURE, 8.0 * ROUNDOFF * size, CURVATURE):
        shifted = matrix + shift * sp.eye_array(size)
        error = _factor_error(sp.csr_array(shifted))
        if error is None:
            break
        # Adding the shift rounds the diagonal once more.
        error += rounding + 2.0 * ROUNDOFF * float(np.abs(shifted.diagonal()).max())
        if error < np.inf:
            least = shift + SLACK * error
            return float(max(0.0, least + ROUNDOFF * abs(least)))
    return np.inf


def _factor_error(matrix: sp.csr_array) -> float | None:
    """Return e such that ``matrix + e * I`` is semidefinite; inf if it fails, None if it is too large."""
    from scipy.sparse.linalg import splu

    size = matrix.shape[0]
    if size <= LARGEST_DENSE and (size <= 100 or matrix.nnz > 0.1 * size**2):
        try:
            np.linalg.cholesky(matrix.toarray())
        except np.linalg.LinAlgError:
            return np.inf
        # Rump 2006, theorem 2.3, with the trace of the matrix.
        share = (size + 2) * ROUNDOFF
        error = SLACK * share / (1.0 - 2.0 * share) * float(matrix.trace()) + size * size * TINY
        return float(error)
    try:
        factors = splu(
            sp.csc_array(matrix), "MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )  # fmt: skip
    except RuntimeError:  # exactly singular
        return np.inf
    order, pivots = factors.perm_r, factors.U.diagonal()
    lower = sp.csc_array(factors.L)
    lengths = np.diff(lower.indptr).astype(float)
    if not (order == factors.perm_c).all() or not (pivots > 0).all():
        return np.inf
    if lengths @ lengths > LARGEST_PRODUCT:
        return None
    # The matrix differs from the semidefinite L D L' by a matrix whose row sums bound its norm.
    lower = sp.csr_array(lower)[order]
    middle = sp.diags_array(pivots)
    apart = abs(matrix - lower @ middle @ lower.T).sum(axis=1)
    terms = abs(lower) @ (pivots * (abs(lower.T) @ np.ones(size)))
    longest = float(np.diff(lower.indptr).max())
    noise = (longest + 5.0) * ROUNDOFF * (terms + abs(matrix).sum(axis=1)) + size * longest * TINY
    error = SLACK * float((apart + noise).max())
    return error if np.isfinite(error) else np.inf


def _is_semidefinite(matrix: sp.csr_array) -> bool:
    """Return True if the symmetric part is positive semidefinite, by elimination in rational arithmetic."""
    rows = [[Fraction(entry) for entry in row] for row in matrix.toarray().tolist()]
    size = len(rows)
    rows = [[(rows[i][j] + rows[j][i]) / 2 for j in range(size)] for i in range(size)]
    for k, pivot_row in enumerate(rows):
        pivot = pivot_row[k]
        if pivot < 0 or (pivot == 0 and any(pivot_row[k:])):
            return False
        for row in rows[k + 1 :] if pivot else ():
            if row[k]:
                factor = row[k] / pivot
                row[k:] = [a - factor * b for a, b in zip(row[k:], pivot_row[k:], strict=True)]
    return True
