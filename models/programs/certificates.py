"""Proofs that do not depend on a solver's tolerance: safe dual bounds and exact violations.

A bound of floating-point multipliers is made rigorous after Neumaier and Shcherbina, "Safe bounds in
linear and mixed-integer linear programming" (Mathematical Programming 99, 2004). Instead of switching
the rounding mode, every sum is widened by its a-priori error bound (Higham, "Accuracy and Stability of
Numerical Algorithms", 2002, section 3.1), and every product is rounded down.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum
from fractions import Fraction
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..verification import TOLERANCE, Check, Verification, check_tolerance
from .base import Program, RowProgram, row_sizes
from .linear import MixedIntegerProgram, QuadraticProgram

__all__ = ["Proof", "exact_verification", "proven", "rational_bound", "safe_bound", "tightened"]

Vector = NDArray[np.float64]

#: Unit roundoff, and a term for underflow.
ROUNDOFF, TINY = np.finfo(float).eps / 2.0, 1e-300
#: Loss of a safe bound against a solver's bound that is accepted for its proof, relative.
CLOSE = 1e-9
#: Largest number of free columns whose multipliers are corrected with a dense inverse.
LARGEST_CORRECTION = 1500


class Proof(StrEnum):
    """Kinds of evidence for a lower bound on the objective, from the strongest to the weakest."""

    #: Computed in rational arithmetic: no rounding at all.
    EXACT = "exact"
    #: Computed from multipliers in floating-point arithmetic with all rounding errors bounded.
    SAFE = "safe bound"
    #: Stated by a solver, and another exact solver agrees within the gap.
    CHECKED = "solver's bound, cross-checked"
    #: Stated by one solver; it holds up to that solver's tolerance.
    CLAIMED = "solver's bound"


class Interval(NamedTuple):
    """Vector of intervals.

    Parameters
    ----------
    low, high : ndarray, shape (n,)
        Ends of the intervals.
    """

    low: Vector
    high: Vector


def safe_bound(
    program: MixedIntegerProgram | QuadraticProgram,
    duals: Vector,
    point: Vector | None = None,
) -> float:
    """Return a lower bound on the objective that holds in spite of all rounding errors.

    The bound is that of the continuous relaxation. It is as good as the multipliers: those of an
    optimal solution give the optimum up to rounding. Columns without bounds need multipliers that make
    their reduced costs exactly 0: the multipliers of as many rows are corrected, and enclosed in
    intervals that contain the correction. For a quadratic program the objective is first replaced by
    its tangent at `point`, which is below the objective because the Hessian is positive semidefinite
    (an assumption on the program).

    Parameters
    ----------
    program : MixedIntegerProgram or QuadraticProgram
        The program.
    duals : ndarray, shape (m,)
        Row multipliers: ``duals[i] >= 0`` belongs to the lower bound of row i, ``<= 0`` to the
        upper bound. Any vector gives a valid bound.
    point : ndarray, shape (n,), optional
        Point of the tangent, for a quadratic program: its solution. By default 0.

    Returns
    -------
    float
        The bound; -inf if a reduced cost cannot be shown to have the sign that an infinite bound
        requires.
    """
    y = np.array(duals, float)
    if y.shape != (program.row_count,) or not np.isfinite(y).all():
        return -math.inf
    # A multiplier of a bound that does not exist is 0; the choice of multipliers is free.
    y[(y > 0) & ~np.isfinite(program.row_lower)] = 0.0
    y[(y < 0) & ~np.isfinite(program.row_upper)] = 0.0
    with np.errstate(all="ignore"):
        cost, constant = _tangent(program, point)
        bound = _bound(program, cost, constant, Interval(y, y.copy()), exact=())
        free = np.flatnonzero(
            ~np.isfinite(program.column_lower) & ~np.isfinite(program.column_upper)
        )
        if bound == -math.inf and free.size:
            corrected = _corrected(program, cost, y, free)
            if corrected is not None:
                bound = _bound(program, cost, constant, corrected, exact=free)
    return bound


def _bound(
    program: RowProgram,
    cost: Interval,
    constant: float,
    multipliers: Interval,
    exact: Sequence[int] | NDArray[np.intp],
) -> float:
    """Return the bound for intervals of multipliers; the reduced costs of the columns `exact` are 0."""
    reduced = _reduced(program, cost, multipliers)
    chosen = np.asarray(exact, np.intp)
    reduced.low[chosen] = reduced.high[chosen] = 0.0
    values = np.concatenate(
        [
            _smallest(multipliers, Interval(program.row_lower, program.row_upper)),
            _smallest(reduced, Interval(program.column_lower, program.column_upper)),
        ]
    )
    if not np.isfinite(values).all() or not math.isfinite(constant):
        return -math.inf
    terms = [*values.tolist(), constant]
    total = math.fsum(terms)
    exact_sum = math.fsum([*terms, -total]) == 0.0  # fsum rounds once
    return total if exact_sum else math.nextafter(total, -math.inf)


def rational_bound(
    program: MixedIntegerProgram, duals: Vector, largest: int = 1 << 20
) -> Fraction | None:
    """Return a bound in rational arithmetic, from multipliers rounded to simple fractions.

    Multipliers of programs with small integers are simple fractions, which floating-point multipliers
    approximate. The bound is exact for the rounded multipliers, whatever the rounding was.

    Parameters
    ----------
    program : MixedIntegerProgram
        The program; the bound is that of its relaxation.
    duals : ndarray, shape (m,)
        Row multipliers as in :func:`safe_bound`.
    largest : int
        Largest denominator of a rounded multiplier.

    Returns
    -------
    Fraction or None
        The bound; None if a reduced cost has a sign that an infinite bound does not allow.
    """
    by_column = sp.csc_array(program.matrix)
    y = [Fraction(entry).limit_denominator(largest) for entry in np.asarray(duals, float).tolist()]
    reduced = [
        Fraction(cost)
        - sum(
            (Fraction(by_column.data[k]) * y[by_column.indices[k]] for k in range(start, end)), Fraction(0)
        )
        for cost, start, end in zip(
            program.cost.tolist(), by_column.indptr[:-1], by_column.indptr[1:], strict=True
        )
    ]  # fmt: skip
    total = Fraction(program.offset)
    for factors, lower, upper in (
        (y, program.row_lower, program.row_upper),
        (reduced, program.column_lower, program.column_upper),
    ):
        for factor, low, high in zip(factors, lower.tolist(), upper.tolist(), strict=True):
            side = low if factor > 0 else high
            if factor and not math.isfinite(side):
                return None
            total += factor * Fraction(side) if factor else 0
    return total


def proven(
    program: Program, bound: float, duals: Vector | None, plan: Vector | None
) -> tuple[float, str]:
    """Return the safe bound of multipliers if it is as good as a solver's bound, else the latter.

    Parameters
    ----------
    program : Program
        The program.
    bound : float
        Bound that a solver states.
    duals : ndarray, shape (m,), optional
        Row multipliers.
    plan : ndarray, shape (n,), optional
        Column vector of the same run.

    Returns
    -------
    float, str
        The bound and a value of :class:`Proof`.
    """
    if duals is not None and isinstance(program, MixedIntegerProgram | QuadraticProgram):
        safe = safe_bound(program, duals, plan)
        if safe >= bound - CLOSE * max(1.0, abs(bound)):
            return safe, str(Proof.SAFE)
    return bound, str(Proof.CLAIMED)


def _tangent(
    program: MixedIntegerProgram | QuadraticProgram, point: Vector | None
) -> tuple[Interval, float]:
    """Return intervals of the linear costs and a lower bound on the constant of the objective.

    For a quadratic program they describe the tangent at `point`: ``H p + c`` and ``offset - p H p / 2``.
    """
    cost = program.cost
    if isinstance(program, MixedIntegerProgram) or point is None:
        return Interval(cost.copy(), cost.copy()), program.offset
    p = np.asarray(point, float)
    gradient, width = _product(program.hessian, p)
    gradient, width = gradient + cost, width + ROUNDOFF * (np.abs(gradient + cost)) + TINY
    curved, error = _product(program.hessian, p)
    half = 0.5 * float(np.abs(p) @ error) * (1.0 + 1e-9)
    products = 0.5 * p * curved
    spread = half + 2 * ROUNDOFF * math.fsum(np.abs(products).tolist()) * (1.0 + 1e-9)
    constant = math.fsum([program.offset, *(-products).tolist(), -spread])
    return Interval(
        gradient - width * (1.0 + 1e-9), gradient + width * (1.0 + 1e-9)
    ), math.nextafter(constant, -math.inf)


def _product(matrix: sp.csr_array, vector: Vector) -> tuple[Vector, Vector]:
    """Return ``matrix @ vector`` and a bound on the rounding error of each entry; 0 if all terms are 0."""
    value: Vector = matrix @ vector
    counts = np.diff(matrix.indptr)
    size: Vector = abs(matrix) @ np.abs(vector)
    # The factor covers the rounding of `size` itself.
    error = (counts + 2) * ROUNDOFF * size * (1.0 + 1e-9) + counts * TINY
    present = sp.csr_array(
        ((vector[matrix.indices] != 0).astype(float), matrix.indices, matrix.indptr),
        shape=matrix.shape,
    )
    return value, np.where(present.sum(axis=1) > 0, error, 0.0)


def _reduced(program: RowProgram, cost: Interval, multipliers: Interval) -> Interval:
    """Return intervals of the reduced costs ``cost - matrix.T @ multipliers``."""
    middle = 0.5 * (multipliers.low + multipliers.high)
    radius = np.maximum(multipliers.high - middle, middle - multipliers.low)
    by_column = sp.csr_array(program.matrix.T)
    value, error = _product(by_column, middle)
    if radius.any():
        error = error + abs(by_column) @ (radius * (1.0 + 1e-9)) * (1.0 + 1e-9)
    low, high = cost.low - value, cost.high - value
    # The subtraction of 0 is exact.
    error = np.where(
        error > 0, error + ROUNDOFF * np.maximum(np.abs(low), np.abs(high)) * 1.001, 0.0
    )
    return Interval(
        np.where(error > 0, np.nextafter(low - error, -np.inf), low),
        np.where(error > 0, np.nextafter(high + error, np.inf), high),
    )


def _smallest(factor: Interval, values: Interval) -> Vector:
    """Return lower bounds on the products of numbers in two vectors of intervals."""
    products = np.stack([_rounded_down(f, v) for f in factor for v in values])
    result: Vector = products.min(axis=0)
    return result


def _rounded_down(left: Vector, right: Vector) -> Vector:
    product = np.where((left == 0) | (right == 0), 0.0, left * right)
    return np.where(
        (product == 0) & ((left == 0) | (right == 0)), 0.0, np.nextafter(product, -np.inf)
    )


def _corrected(
    program: RowProgram, cost: Interval, y: Vector, free: NDArray[np.intp]
) -> Interval | None:
    """Return intervals with multipliers whose reduced costs on the columns `free` are exactly 0.

    As many rows as columns are chosen, by their multipliers and the size of their pivots. The correction
    of their multipliers solves a linear system, which an approximate inverse R encloses: its norm is at
    most ``|R r| + |I - R M| |R r| / (1 - |I - R M|)``. None if the system is singular or too large, or if
    the sign of a multiplier is lost.
    """
    from scipy.linalg import qr

    count = free.size
    if count > min(LARGEST_CORRECTION, program.row_count):
        return None
    equal = program.row_lower == program.row_upper
    usable = np.flatnonzero(equal | (y != 0))
    columns = sp.csc_array(program.matrix)[:, free]
    block = columns[usable].toarray()
    weights = np.where(equal[usable], 1.0, np.minimum(np.abs(y[usable]), 1.0))
    if block.shape[0] < count:
        return None
    _, triangle, order = qr((block * weights[:, None]).T, mode="economic", pivoting=True)
    if count and abs(triangle[count - 1, count - 1]) <= 1e-12 * abs(triangle[0, 0]):
        return None
    rows = usable[order[:count]]
    system = block[order[:count]].T  # system @ correction = residual
    middle = y.copy()
    try:
        inverse = np.linalg.inv(system)
    except np.linalg.LinAlgError:
        return None
    part = Interval(cost.low, cost.high)
    for _ in range(2):  # one step of refinement
        reduced = _reduced(program, part, Interval(middle, middle))
        middle[rows] += inverse @ (0.5 * (reduced.low[free] + reduced.high[free]))
    reduced = _reduced(program, part, Interval(middle, middle))
    residual = np.maximum(np.abs(reduced.low[free]), np.abs(reduced.high[free]))
    # |I - R M| with its rounding errors, in the largest row sum.
    gap = np.abs(np.eye(count) - inverse @ system).sum(axis=1).max(initial=0.0)
    gap += (
        (count + 2)
        * ROUNDOFF
        * (np.abs(inverse) @ np.abs(system)).sum(axis=1).max(initial=0.0)
        * 2.0
    )
    if not gap < 0.5:
        return None
    first = np.abs(inverse) @ residual * (1.0 + (count + 2) * 4 * ROUNDOFF)
    radius = first + gap / (1.0 - gap) * first.max(initial=0.0) * (1.0 + 1e-9) + TINY
    low, high = middle.copy(), middle.copy()
    low[rows] = np.nextafter(middle[rows] - radius, -np.inf)
    high[rows] = np.nextafter(middle[rows] + radius, np.inf)
    needs_positive = np.isfinite(program.row_lower) & ~np.isfinite(program.row_upper)
    needs_negative = ~np.isfinite(program.row_lower) & np.isfinite(program.row_upper)
    if (needs_positive & (low < 0)).any() or (needs_negative & (high > 0)).any():
        return None
    return Interval(low, high)


def tightened(program: MixedIntegerProgram, share: float = 1e-9) -> MixedIntegerProgram:
    """Return the relaxation with costs moved so that its multipliers give a finite safe bound.

    The cost of a column with one infinite bound is moved by `share` of its size towards that bound. The
    reduced costs of the changed program are non-negative up to a solver's tolerance; those of the
    original program are then larger by the same amount, and so of the required sign.

    Parameters
    ----------
    program : MixedIntegerProgram
        The program.
    share : float
        Change relative to the largest coefficient of the column, at least that of the costs.
    """
    low, high = np.isfinite(program.column_lower), np.isfinite(program.column_upper)
    largest = np.zeros(program.size)
    if program.matrix.nnz:
        largest = abs(program.matrix).max(axis=0).toarray().ravel()
    size = share * np.maximum(np.maximum(np.abs(program.cost), largest), 1.0)
    moved = np.where(low & ~high, -size, np.where(high & ~low, size, 0.0))
    return replace(program.relaxed(), cost=program.cost + moved)


def exact_verification(
    program: MixedIntegerProgram | QuadraticProgram, plan: Vector, tolerance: float = TOLERANCE
) -> Verification:
    """Return the verification of a plan in rational arithmetic.

    All numbers of the program and of the plan are taken as the rational numbers that they are in binary.
    Violations and the objective are exact; each is rounded once, violations away from 0.

    Parameters
    ----------
    program : MixedIntegerProgram or QuadraticProgram
        The program.
    plan : ndarray, shape (n,)
        Column vector.
    tolerance : float
        Largest accepted violation, as in :meth:`.RowProgram.verify`.

    Returns
    -------
    Verification
        The checks of :meth:`.RowProgram.verify` with exact violations. A check with ``worst == 0`` holds
        exactly.
    """
    check_tolerance(tolerance)
    point = program._point(plan)
    values = [Fraction(entry) for entry in point.tolist()]
    matrix = program.matrix
    indptr, indices, data = matrix.indptr.tolist(), matrix.indices.tolist(), matrix.data.tolist()
    rows = [
        sum(
            (Fraction(data[k]) * values[indices[k]] for k in range(indptr[row], indptr[row + 1])),
            Fraction(0),
        )
        for row in range(program.row_count)
    ]
    objective = sum(
        (Fraction(c) * v for c, v in zip(program.cost.tolist(), values, strict=True) if c),
        Fraction(program.offset),
    )
    if isinstance(program, QuadraticProgram):
        hessian = sp.coo_array(program.hessian)
        objective += (
            sum(
                (
                    Fraction(h) * values[i] * values[j]
                    for i, j, h in zip(
                        hessian.row.tolist(),
                        hessian.col.tolist(),
                        hessian.data.tolist(),
                        strict=True,
                    )
                ),
                Fraction(0),
            )
            / 2
        )
    sides = (
        (rows, program.row_lower, program.row_upper),
        (values, program.column_lower, program.column_upper),
    )
    violations = [
        np.array(
            [_excess(*entry) for entry in zip(numbers, low.tolist(), high.tolist(), strict=True)]
        )
        for numbers, low, high in sides
    ]
    columns = program._column_sizes
    checks = program._checks(
        point, np.array(rows, float), row_sizes(matrix, point, columns), columns, tolerance,
        (violations[0].astype(float), violations[1].astype(float)),
    )  # fmt: skip
    if program.integral is not None and program.integral.any():
        apart = np.array([_up(abs(value - round(value))) for value in values])
        apart = np.where(program.integral, apart, 0.0)
        whole = Check.largest("integrality", apart, 1.0, "", program.column_name, tolerance)
        checks = (*checks, whole)
    return Verification(float(objective), checks, maximise=program.maximise)


def _excess(number: Fraction, low: float, high: float) -> float:
    """Return the distance of a number from an interval, rounded up."""
    below = Fraction(low) - number if math.isfinite(low) else Fraction(0)
    above = number - Fraction(high) if math.isfinite(high) else Fraction(0)
    return _up(max(below, above, Fraction(0)))


def _up(number: Fraction) -> float:
    """Return the smallest float that is at least `number` (>= 0)."""
    result = float(number)
    return result if Fraction(result) >= number else math.nextafter(result, math.inf)
