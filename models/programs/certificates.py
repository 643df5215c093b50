"""Proofs that do not depend on a solver's tolerance: bounds and violations in rational arithmetic.

:func:`.safe_bound` proves bounds in floating-point arithmetic.
"""

from __future__ import annotations

import itertools
import math
import sys
from dataclasses import replace
from enum import StrEnum
from fractions import Fraction

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..verification import TOLERANCE, Verification, check_tolerance
from .base import Program, row_maxima, row_sizes
from .conic import ConicProgram
from .linear import MixedIntegerProgram, QuadraticProgram
from .safe_bounds import safe_bound

__all__ = [
    "Proof",
    "exact_products",
    "exact_verification",
    "proven",
    "rational_bound",
    "rounded_down",
    "safe_bound",
    "simple_fractions",
    "symmetric_products",
    "tightened",
]

Vector = NDArray[np.float64]

#: Loss of a safe bound against a solver's bound that is accepted for its proof, relative to the larger of
#: the bound and the sum of the terms of the objective, which counts up to 1.
CLOSE = 1e-9
#: Distance of multipliers from the dual cones that is due to rounding, relative to the largest.
IN_CONE = 1e-9
#: Largest number of nonzeros for which a bound is always tried in rational arithmetic, in about 5 ms.
QUICK = 1000
#: Largest number of bits of a common denominator.
LONGEST = 4096


class Proof(StrEnum):
    """Kinds of evidence for a lower bound on the objective, from the strongest to the weakest."""

    #: Computed in rational arithmetic, without rounding.
    EXACT = "exact"
    #: Computed from multipliers in floating-point arithmetic with all rounding errors bounded.
    SAFE = "safe bound"
    #: Stated by a solver, and another exact solver agrees within the gap.
    CHECKED = "solver's bound, cross-checked"
    #: Stated by one solver; it holds up to that solver's tolerance.
    CLAIMED = "solver's bound"
    #: As `CLAIMED`, from multipliers of a conic program that were outside of the dual cones.
    MOVED = "solver's bound, multipliers moved into the dual cones"
    #: Only the termination of one solver states that a program is infeasible or unbounded.
    STATED = "solver's claim"


def rational_bound(
    program: MixedIntegerProgram | QuadraticProgram,
    duals: Vector,
    point: Vector | None = None,
    largest: int = 1 << 20,
) -> Fraction | None:
    """Return a bound in rational arithmetic, from multipliers rounded to simple fractions.

    Multipliers of programs with small integers are simple fractions, which floating-point multipliers
    approximate. The bound is that of the relaxation, and exact for the multipliers (as in :func:`.safe_bound`)
    and the `point` of the tangent, by default 0, rounded to denominators of at most `largest`. It is None if a
    Hessian is not proven to be positive semidefinite, if a reduced cost has a sign that an infinite bound does
    not allow, if the denominators are too different for fast arithmetic, or if the arrays have another shape or
    are not finite.
    """
    if isinstance(program, QuadraticProgram) and not (program._least_curvature >= 0).all():
        return None
    y = simple_fractions(duals, program.row_count, largest)
    p = simple_fractions(np.zeros(program.size) if point is None else point, program.size, largest)
    if y is None or p is None:
        return None
    cost = [Fraction(entry) for entry in program.cost.tolist()]
    constant = Fraction(program.offset)
    if isinstance(program, QuadraticProgram) and any(p):
        bent = symmetric_products(program.hessian, p)
        constant -= sum((x * v for x, v in zip(p, bent, strict=True) if x), Fraction(0)) / 2
        cost = [c + v for c, v in zip(cost, bent, strict=True)]
    pull = exact_products(sp.csr_array(program.matrix.T), y)
    reduced = [c - v for c, v in zip(cost, pull, strict=True)]
    lower = np.concatenate([program.row_lower, program.column_lower]).tolist()
    upper = np.concatenate([program.row_upper, program.column_upper]).tolist()
    for factor, low, high in zip([*y, *reduced], lower, upper, strict=True):
        side = low if factor > 0 else high
        if factor and not math.isfinite(side):
            return None
        constant += factor * Fraction(side) if factor else 0
    return constant


def simple_fractions(vector: Vector, size: int, largest: int = 1 << 20) -> list[Fraction] | None:
    """Return the nearest fractions of `size` numbers; None if their common denominator is long."""
    numbers = np.asarray(vector, float)
    if numbers.shape != (size,) or not np.isfinite(numbers).all():
        return None
    common, result = 1, []
    for entry in numbers.tolist():
        result.append(Fraction(entry).limit_denominator(largest))
        common = math.lcm(common, result[-1].denominator)
        if common.bit_length() > LONGEST:
            return None
    return result


def exact_products(matrix: sp.csr_array, values: list[Fraction]) -> list[Fraction]:
    """Return ``matrix @ values`` in rational arithmetic, for a matrix in compressed rows."""
    indptr, indices, data = matrix.indptr.tolist(), matrix.indices.tolist(), matrix.data.tolist()
    return [
        sum((Fraction(data[k]) * values[indices[k]] for k in range(start, end)), Fraction(0))
        for start, end in itertools.pairwise(indptr)
    ]


def symmetric_products(matrix: sp.csr_array, values: list[Fraction]) -> list[Fraction]:
    """Return the products of the symmetric part of a matrix, which alone enters ``x @ matrix @ x``."""
    products = exact_products(matrix, values), exact_products(sp.csr_array(matrix.T), values)
    return [(left + right) / 2 for left, right in zip(*products, strict=True)]


def proven(
    program: Program, bound: float, duals: Vector | None, plan: Vector | None
) -> tuple[float, str]:
    """Return the safe bound of multipliers if it is as good as the solver's, else the latter, and its proof."""
    if duals is not None and isinstance(program, MixedIntegerProgram | QuadraticProgram):
        safe = safe_bound(program, duals, plan, quick=True)
        terms = 0.0 if plan is None else float(np.abs(program.cost) @ np.abs(plan))
        least = bound - CLOSE * max(abs(bound), min(terms, 1.0))
        if safe >= least:
            return safe, str(Proof.SAFE)
        exact = rational_bound(program, duals, plan) if program.matrix.nnz <= QUICK else None
        if exact is not None and exact >= least:
            return rounded_down(exact), str(Proof.EXACT)
    if duals is not None and isinstance(program, ConicProgram):
        moved = np.abs(program.signed(duals) - program.joined(duals)).max(initial=0.0)
        if not moved <= IN_CONE * max(1.0, np.abs(duals).max(initial=0.0)):
            return bound, str(Proof.MOVED)
    return bound, str(Proof.CLAIMED)


def tightened(program: MixedIntegerProgram, share: float = 1e-9) -> MixedIntegerProgram:
    """Return the relaxation with costs moved so that its multipliers give a finite safe bound."""
    # The cost of a column with one infinite bound is moved towards that bound by `share` of the largest
    # coefficient of the column. Reduced costs of the changed program are non-negative up to a solver's tolerance;
    # those of the original program are larger by the same amount, and so of the required sign.
    low, high = np.isfinite(program.column_lower), np.isfinite(program.column_upper)
    largest = row_maxima(sp.csr_array(program.matrix.T))
    size = share * np.maximum(np.maximum(np.abs(program.cost), largest), 1.0)
    moved = np.where(low & ~high, -size, np.where(high & ~low, size, 0.0))
    return replace(program.relaxed(), cost=program.cost + moved)


@np.errstate(all="ignore")  # sizes of terms may overflow
def exact_verification(
    program: MixedIntegerProgram | QuadraticProgram, plan: Vector, tolerance: float = TOLERANCE
) -> Verification:
    """Return the checks of :meth:`.RowProgram.verify` with violations in rational arithmetic.

    Violations and the objective are rounded once, violations away from 0: ``worst == 0`` holds exactly.
    """
    check_tolerance(tolerance)
    point = program._point(plan)
    values = [Fraction(entry) for entry in point.tolist()]
    matrix = program.matrix
    rows = exact_products(matrix, values)
    slopes = [Fraction(entry) for entry in program.cost.tolist()]
    if isinstance(program, QuadraticProgram):
        bent = exact_products(program.hessian, values)
        slopes = [c + v / 2 for c, v in zip(slopes, bent, strict=True)]
    terms = (c * v for c, v in zip(slopes, values, strict=True) if c)
    objective = sum(terms, Fraction(program.offset))
    columns = program._column_sizes
    checks = program._checks(
        point, np.array([_nearest(row) for row in rows]), row_sizes(matrix, point, columns), columns, tolerance,
        (
            _excesses(rows, program.row_lower, program.row_upper),
            _excesses(values, program.column_lower, program.column_upper),
        ),
    )  # fmt: skip
    scale = program._objective_size
    return Verification(_nearest(objective), checks, scale=scale, maximise=program.maximise)


def _excesses(numbers: list[Fraction], lower: Vector, upper: Vector) -> Vector:
    """Return the distances of numbers from intervals, rounded up."""
    result = []
    for number, low, high in zip(numbers, lower.tolist(), upper.tolist(), strict=True):
        below = Fraction(low) - number if math.isfinite(low) else Fraction(0)
        above = number - Fraction(high) if math.isfinite(high) else Fraction(0)
        result.append(0.0 - rounded_down(-max(below, above, Fraction(0))))
    return np.array(result, float)


def _nearest(number: Fraction) -> float:
    """Return the nearest float; an infinite one beyond all floats."""
    try:
        return float(number)
    except OverflowError:
        return math.inf if number > 0 else -math.inf


def rounded_down(number: Fraction) -> float:
    """Return the largest float that is at most `number`; -inf if it is below all floats."""
    result = _nearest(number)
    if math.isinf(result):
        return sys.float_info.max if number > 0 else -math.inf
    return result if Fraction(result) <= number else math.nextafter(result, -math.inf)
