"""Proofs of bounds, infeasibility and unboundedness of linear and quadratic programs.

Linear programs that SciPy's HiGHS solves yield multipliers, points and directions. Every proof is
recomputed from the arrays of the program, in rational arithmetic or with all rounding errors bounded.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation
from ...models.programs.certificates import (
    CLOSE,
    Proof,
    exact_products,
    exact_verification,
    rational_bound,
    rounded_down,
    safe_bound,
    simple_fractions,
    symmetric_products,
    tightened,
)
from ...models.programs.linear import MixedIntegerProgram, QuadraticProgram
from ...models.verification import Verification
from ..contract.enums import Termination
from ..qp.proofs import linear, phase_one, receding, steepest
from .conflicts import feasibility

__all__ = [
    "Certificate",
    "evidence",
    "prove_bound",
    "prove_infeasible",
    "prove_unbounded",
    "verify_exactly",
]

Vector = NDArray[np.float64]
LinearRows = MixedIntegerProgram | QuadraticProgram

#: Largest number of nonzeros for rational arithmetic without a time limit, and with any time limit.
LARGEST, SMALL = 200_000, 1000
#: Seconds of rational arithmetic per nonzero.
SECONDS_PER_ENTRY = 5e-6
#: Seconds of an automatic proof, in addition to those of the solver.
AUTOMATIC = 0.05
#: Relative gap between plan and bound above which a linear program is solved again for its multipliers.
GAP = 1e-6
#: Largest denominators of points and directions, in the order of the attempts.
DENOMINATORS = (1, 1 << 10, 1 << 20)


@dataclass(frozen=True, eq=False)
class Certificate:
    """Proof that a program is infeasible or unbounded.

    Parameters
    ----------
    termination : Termination
        ``INFEASIBLE`` or ``UNBOUNDED``.
    proof : str
        Kind of evidence: ``Proof.EXACT`` or ``Proof.SAFE``.
    vector : ndarray
        Farkas multipliers of the rows, with the signs of :func:`.safe_bound`, or a direction of the
        columns along which the objective decreases without bound.
    value : float
        Lower bound on the sum of the violations of the rows, weighted with the absolute multipliers, or
        change of the objective per unit of the direction.
    point : ndarray, optional
        Feasible point at the start of the direction.
    """

    termination: Termination
    proof: str
    vector: Vector
    value: float
    point: Vector | None = None


def prove_bound(
    program: LinearRows, duals: Vector, plan: Vector | None = None
) -> tuple[float, str] | None:
    """Return the best lower bound on the objective that can be proven from multipliers.

    The bound is computed in rational arithmetic and with bounded rounding errors. If both fail on a linear
    program, or leave a gap, the program is solved again with costs that were moved so that the multipliers
    prove a bound; see :func:`.tightened`.

    Parameters
    ----------
    program : MixedIntegerProgram or QuadraticProgram
        The program.
    duals : ndarray, shape (m,)
        Row multipliers, with the signs of :func:`.safe_bound`.
    plan : ndarray, shape (n,), optional
        Plan of the same run: the point of the tangent for a quadratic program.

    Returns
    -------
    tuple of float and str, or None
        The bound and a value of :class:`.Proof`; None if no bound is proven.
    """
    best = _best(program, duals, plan)
    if isinstance(program, MixedIntegerProgram) and program.continuous:
        least = -math.inf if plan is None else program.objective(plan)
        if best is None or best[0] < least - GAP * max(1.0, abs(least)):
            multipliers = _multipliers(tightened(program))
            other = None if multipliers is None else _best(program, multipliers, plan)
            if other is not None and (best is None or other[0] > best[0]):
                best = other
    return best


def verify_exactly(model: Any, plan: Any, duals: Vector | None, tolerance: float) -> Verification:
    """Return the verification of a plan in rational arithmetic, and the bound of its multipliers.

    Parameters
    ----------
    model : MixedIntegerProgram or QuadraticProgram
        The program.
    plan : ndarray, shape (n,)
        Column vector.
    duals : ndarray, shape (m,), optional
        Row multipliers of a solution.
    tolerance : float
        Largest accepted violation.

    Raises
    ------
    UnsupportedFormulation
        The model is of another type.
    """
    if not isinstance(model, LinearRows):
        raise UnsupportedFormulation(
            f"exact must be False for model {model.kind!r}: only mixed-integer and quadratic programs are "
            "verified in rational arithmetic; pass exact=False"
        )
    verification = exact_verification(model, plan, tolerance)
    result = None if duals is None else prove_bound(model, duals, plan)
    if result is None:
        return verification
    return replace(verification, bound=result[0], proof=result[1])


def _best(program: LinearRows, duals: Vector, plan: Vector | None) -> tuple[float, str] | None:
    """Return the rational bound if it is as good as the safe one, else the latter; None without any."""
    safe = safe_bound(program, duals, plan)
    exact = rational_bound(program, duals, plan) if program.matrix.nnz <= LARGEST else None
    if exact is not None:
        bound = rounded_down(exact)
        if bound >= safe - CLOSE * max(1.0, abs(safe)) or safe == -math.inf:
            return bound, str(Proof.EXACT)
    return None if safe == -math.inf else (safe, str(Proof.SAFE))


def _multipliers(program: MixedIntegerProgram) -> Vector | None:
    """Return the row multipliers of a linear program; None if it is not solved."""
    rows = program.row_count
    solved = linear(
        np.concatenate([program.cost, np.zeros(rows)]),
        sp.hstack([program.matrix, -sp.eye_array(rows)], format="csr"),
        np.zeros(rows),
        np.concatenate([program.column_lower, program.row_lower]),
        np.concatenate([program.column_upper, program.row_upper]),
        None,
    )
    return None if solved is None else solved[1]


def prove_infeasible(program: LinearRows, seconds: float | None = None) -> Certificate | None:
    """Prove that no point satisfies the rows and the bounds of a program.

    The multipliers of the program that minimises the sum of the violations are Farkas multipliers. They
    prove infeasibility if they give the objective 0 a bound above 0. Conditions of integers are ignored.

    Parameters
    ----------
    program : MixedIntegerProgram or QuadraticProgram
        The program.
    seconds : float, optional
        Time limit; None for no limit.

    Returns
    -------
    Certificate or None
        None if nothing is proven.
    """
    begin = time.perf_counter()
    flat = _quadratic(feasibility(program))
    crossed = (flat.row_lower > flat.row_upper).any() or (
        flat.column_lower > flat.column_upper
    ).any()
    if crossed:
        none = np.zeros(program.row_count)
        return Certificate(Termination.INFEASIBLE, str(Proof.EXACT), none, math.nan)
    ray = phase_one(flat, seconds)[1]
    if ray is None:
        return None
    exact = None
    if _affordable(program, seconds, begin):
        exact = rational_bound(flat, ray)
    if exact is not None and exact > 0:
        return Certificate(Termination.INFEASIBLE, str(Proof.EXACT), ray, rounded_down(exact))
    safe = safe_bound(flat, ray, quick=seconds is not None)
    if safe > 0:
        return Certificate(Termination.INFEASIBLE, str(Proof.SAFE), ray, safe)
    return None


def prove_unbounded(program: LinearRows, seconds: float | None = None) -> Certificate | None:
    """Prove in rational arithmetic that the objective of a program is unbounded below.

    Linear programs yield a feasible point and a direction. Both are rounded to simple fractions, and all
    rows and bounds are evaluated exactly.

    Parameters
    ----------
    program : MixedIntegerProgram or QuadraticProgram
        The program. With integer columns the point must be integral there.
    seconds : float, optional
        Time limit; None for no limit.

    Returns
    -------
    Certificate or None
        None if nothing is proven, for example because the coefficients of an equality row have no simple
        fractions as a solution.
    """
    begin = time.perf_counter()
    quadratic = _quadratic(program)
    point = phase_one(quadratic, seconds)[0]
    left = None if seconds is None else max(seconds - (time.perf_counter() - begin), 1e-3)
    direction = None if point is None else steepest(quadratic, left)
    if point is None or direction is None or not _affordable(program, seconds, begin):
        return None
    start = next((p for p in _roundings(point) if _is_feasible(program, p)), None)
    if start is None:
        return None
    for d in _roundings(direction):
        slope = sum(
            (Fraction(c) * v for c, v in zip(program.cost.tolist(), d, strict=True) if v),
            Fraction(0),
        )
        if slope < 0 and _recedes(quadratic, d):
            return Certificate(
                Termination.UNBOUNDED, str(Proof.EXACT), np.array(d, float), float(slope), np.array(start, float)
            )  # fmt: skip
    return None


def evidence(model: Any, termination: Termination, seconds: float) -> str:
    """Return the kind of evidence for a solver's claim that a program has no solution.

    A proof is attempted for at most the time that the solver took plus 50 ms.

    Parameters
    ----------
    model : Model
        The model; programs with linear rows are proven.
    termination : Termination
        ``INFEASIBLE`` or ``UNBOUNDED``.
    seconds : float
        Seconds that the solver took.

    Returns
    -------
    str
        A value of :class:`.Proof`.
    """
    certificate = None
    if isinstance(model, LinearRows):
        infeasible = termination is Termination.INFEASIBLE
        prove = prove_infeasible if infeasible else prove_unbounded
        certificate = prove(model, seconds + AUTOMATIC)
    return str(Proof.STATED) if certificate is None else certificate.proof


def _quadratic(program: LinearRows) -> QuadraticProgram:
    """Return the continuous relaxation as a quadratic program."""
    if isinstance(program, QuadraticProgram):
        return program.relaxed()
    empty = sp.csr_array((program.size, program.size))
    return QuadraticProgram(hessian=empty, **program.shared())


def _affordable(program: LinearRows, seconds: float | None, begin: float) -> bool:
    """Return True if rational arithmetic fits in the time limit."""
    entries = int(program.matrix.nnz) + program.size
    if seconds is None:
        return entries <= LARGEST
    left = max(seconds - (time.perf_counter() - begin), SMALL * SECONDS_PER_ENTRY)
    return entries * SECONDS_PER_ENTRY <= left


def _roundings(vector: Vector) -> list[list[Fraction]]:
    """Return `vector` rounded to simple fractions, the simplest first."""
    results = [simple_fractions(vector, vector.size, largest) for largest in DENOMINATORS]
    return [result for result in results if result is not None]


def _is_feasible(program: LinearRows, point: list[Fraction]) -> bool:
    """Return True if a point satisfies all rows, bounds and conditions of integers exactly."""
    integral = program.integral
    if integral is not None and any(
        value.denominator != 1
        for value, whole in zip(point, integral.tolist(), strict=True)
        if whole
    ):
        return False
    return _between(point, program.column_lower, program.column_upper) and _between(
        exact_products(program.matrix, point), program.row_lower, program.row_upper
    )


def _recedes(program: QuadraticProgram, direction: list[Fraction]) -> bool:
    """Return True if a direction satisfies all rows and bounds and has no curvature, exactly."""

    def within(values: list[Fraction], low: Vector, high: Vector) -> bool:
        return _between(values, receding(low, -math.inf), receding(high, math.inf))

    return (
        within(direction, program.column_lower, program.column_upper)
        and within(exact_products(program.matrix, direction), program.row_lower, program.row_upper)
        and not any(symmetric_products(program.hessian, direction))
    )


def _between(values: list[Fraction], low: Vector, high: Vector) -> bool:
    """Return True if all values are between their bounds, exactly."""
    return all(
        # Comparisons of fractions with floats are exact.
        lower <= value <= upper
        for value, lower, upper in zip(values, low.tolist(), high.tolist(), strict=True)
    )
