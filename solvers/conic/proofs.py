"""Proofs that a conic program has no solution, recomputed from its arrays.

A weakly infeasible program (rows and cones with distance 0 but no common point) has no proof, yet rays
that nearly cancel look like one. With ``x y >= 1`` and ``x = 0``, an error of e in the sum that must
cancel yields an excess of ``sqrt(e)``. Therefore a ray is first moved until its sum cancels up to
rounding, and then its excess must be far above the root of the remainder.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.programs.base import row_maxima
from ...models.programs.cones import ConeBlock, ConeKind, inside, order, triangle
from ...models.programs.conic import ConicProgram
from ...models.programs.linear import QuadraticProgram
from ..programs.attempts import Ending
from ..qp.proofs import Findings, least, receding, unit, without_bound

__all__ = ["examined", "excludes", "recedes"]

Vector = NDArray[np.float64]
Solve = Callable[[ConicProgram], Ending]

#: Relative remainder of a sum whose terms must cancel.
CANCELLED = 1e-12
#: Smallest excess of a proof, and smallest decrease along a direction, in their natural units: 14 times
#: the ``2 sqrt(2 CANCELLED)`` of the hyperbola above.
MARGIN = 4e-5
#: Coefficients below this, relative to their row or cone, are no rounding errors of larger ones.
NEGLIGIBLE = 1e-30
#: Small multipliers of a ray, relative to the largest one.
SMALL = 1e-6
#: Rounding errors of multipliers, relative to the largest one.
NOISE = 1e-15
#: Largest number of alternating projections. A few suffice if the intersection has an interior;
#: otherwise hundreds do not.
ROUNDS = 50


def excludes(program: ConicProgram, ray: Vector, center: Vector | None = None) -> bool:
    """Return True if the multipliers `ray` prove that no point satisfies rows, bounds and cones.

    The proof may also be `ray`, shape (rows + cone rows,), without its small entries, which an interior-point
    method leaves on rows and cones that the proof does not need. `center` is the origin of distances, such as
    the least infeasible point; 0 by default.
    """
    sizes = _shared(program, np.abs(unit(ray)))
    own = np.abs(unit(ray)) > SMALL
    candidates = ray, np.where(sizes > SMALL, ray, 0.0), np.where(own, ray, 0.0)
    return any(_contradicts(program, candidate, center) for candidate in candidates)


def _contradicts(program: ConicProgram, ray: Vector, center: Vector | None) -> bool:
    flat = _flat(program)
    y = _cancelled_ray(program, flat, ray)
    pull, terms = flat.matrix.T @ y, abs(flat.matrix).T @ np.abs(y)
    if not terms.max(initial=0.0) > 0:
        # Only constants remain, which may or may not lie outside of the cones.
        terms = np.full(1, np.abs(y).max(initial=0.0))
    unbounded = without_bound(flat, pull)
    if (np.abs(pull) > CANCELLED * terms)[unbounded].any():
        return False
    pull[unbounded] = 0.0
    origin = np.zeros(program.size) if center is None else center
    away = np.where(pull > 0, flat.column_upper, flat.column_lower) - origin
    available = pull * np.where(pull != 0, away, 0.0)
    bound = np.where(y > 0, flat.row_lower, flat.row_upper) - flat.matrix @ origin
    bound = np.where(y != 0, bound, 0.0)
    demanded = y * bound
    # Bounds in units of the columns: divided by the largest coefficient of the row, or of its cone.
    largest = row_maxima(flat.matrix)
    for block in program.cones:
        part = slice(program.row_count + block.start, program.row_count + block.start + block.size)
        largest[part] = np.repeat(block.of(largest[program.row_count :]).max(1), block.dimension)
    distance = np.abs(bound / np.where(largest > 0, largest, 1.0)).max(initial=0.0)
    noise = 1e-9 * float(np.abs(demanded).sum() + np.abs(available).sum())
    excess = float(demanded.sum() - available.sum())
    return excess > max(noise, MARGIN * float(terms.max()) * float(distance))


def recedes(program: ConicProgram, direction: Vector) -> bool:
    """Return True if the objective decreases without bound along `direction` from any feasible point."""
    d = unit(direction)
    parts = [program.hessian, program.matrix, sp.eye_array(program.size), program.cone_matrix]
    stack = sp.vstack(parts, format="csr")
    largest = _shared(program, row_maxima(stack))
    stack = sp.diags_array(1.0 / np.where(largest >= 1e-300, largest, 1.0)) @ stack
    noise = _shared(program, CANCELLED * abs(stack).sum(axis=1))
    for _ in range(ROUNDS):
        move = stack @ d
        off = move - _recession(program, move)
        if (np.abs(off) <= noise).all():
            break
        d = unit(d - least(stack, off))
    else:
        return False
    entries = sp.coo_array(stack)
    if (np.abs(entries.data[np.abs(d[entries.coords[1]]) > CANCELLED]) < NEGLIGIBLE).any():
        return False  # a bound far away, not a rounding error
    steepest = float(np.abs(program.cost).max(initial=0.0))
    return bool(program.cost @ d < -MARGIN * max(steepest, 1e-300))


def examined(
    program: ConicProgram,
    solve: Solve,
    *,
    ray: Vector | None = None,
    direction: Vector | None = None,
    point: Vector | None = None,
) -> Findings:
    """Prove what can be proven about a program for which a solver found no optimum.

    `solve` solves a conic program: an elastic one and a recession program. `ray` and `direction` are certificates
    of the solver, and `point` is a feasible point, if they are known.
    """
    if point is None and ray is not None and excludes(program, ray):
        return Findings(infeasible=True, source="the solver's ray")
    violation = None
    if point is None:
        elastic_ending = solve(elastic(program))
        if elastic_ending.point is not None and np.isfinite(elastic_ending.point).all():
            near = np.clip(elastic_ending.point[:-1], program.column_lower, program.column_upper)
            violation = float(elastic_ending.point[-1])
            if program.verify(near, tolerance=1e-7).ok:
                point = near
            for candidate in (_unfolded(program, elastic_ending.duals), ray):
                if point is None and candidate is not None and excludes(program, candidate, near):
                    return Findings(infeasible=True, source="a phase 1 of our own")
    if point is None:
        return Findings(violation=violation, examined=True)
    if direction is not None and recedes(program, direction):
        return Findings(unbounded=True, source="the solver's direction", point=point)
    if program.cost.any():
        steepest = solve(_receding(program)).point
        if steepest is not None and recedes(program, steepest):
            return Findings(unbounded=True, source="a recession program of our own", point=point)
    return Findings(point=point, violation=violation, examined=True)


def elastic(program: ConicProgram) -> ConicProgram:
    """Return the program of the smallest relaxation t of all rows and cones.

    Its last column is t. Its rows are those with lower bounds, then those with upper bounds.
    """
    low, high = np.isfinite(program.row_lower), np.isfinite(program.row_upper)
    below, above = program.matrix[np.flatnonzero(low)], program.matrix[np.flatnonzero(high)]
    slack = np.concatenate([np.ones(below.shape[0]), -np.ones(above.shape[0])])
    unit = np.concatenate([np.zeros(0), *(_interior(block) for block in program.cones)])
    size = program.size
    return ConicProgram(
        cost=np.append(np.zeros(size), 1.0),
        matrix=sp.hstack([sp.vstack([below, above]), slack[:, None]], format="csr"),
        row_lower=np.concatenate([program.row_lower[low], np.full(above.shape[0], -np.inf)]),
        row_upper=np.concatenate([np.full(below.shape[0], np.inf), program.row_upper[high]]),
        column_lower=np.append(program.column_lower, 0.0),
        column_upper=np.append(program.column_upper, np.inf),
        cone_matrix=sp.hstack([program.cone_matrix, unit[:, None]], format="csr"),
        cone_offset=program.cone_offset,
        cones=program.cones,
    )


def _unfolded(program: ConicProgram, duals: Vector | None) -> Vector | None:
    """Return the multipliers of `program` from those of its elastic program."""
    if duals is None:
        return None
    low = np.flatnonzero(np.isfinite(program.row_lower))
    high = np.flatnonzero(np.isfinite(program.row_upper))
    multipliers = np.zeros(program.row_count)
    multipliers[low] += duals[: low.size]
    multipliers[high] += duals[low.size : low.size + high.size]
    return np.concatenate([multipliers, duals[low.size + high.size :]])


def _receding(program: ConicProgram) -> ConicProgram:
    """Return the program of the steepest direction of recession within a box."""
    rows = sp.vstack([program.hessian, program.matrix], format="csr")
    flat = np.zeros(program.size)

    return ConicProgram(
        cost=program.cost / np.abs(program.cost).max(),
        matrix=rows,
        row_lower=np.concatenate([flat, receding(program.row_lower, -np.inf)]),
        row_upper=np.concatenate([flat, receding(program.row_upper, np.inf)]),
        column_lower=receding(program.column_lower, -1.0),
        column_upper=receding(program.column_upper, 1.0),
        cone_matrix=program.cone_matrix,
        cone_offset=np.zeros(program.cone_offset.size),
        cones=program.cones,
    )


def _interior(block: ConeBlock) -> Vector:
    """Return an interior point of each cone of `block`."""
    point = np.zeros(block.dimension)
    if block.kind is ConeKind.SECOND_ORDER:
        point[0] = 1.0
    elif block.kind is ConeKind.EXPONENTIAL:
        point[:] = -1.0, 1.0, 1.0
    else:
        point = triangle(np.eye(order(block.dimension))[None])[0]
    return np.tile(point, block.count)


def _flat(program: ConicProgram) -> QuadraticProgram:
    """Return a program with the rows of `program` and its cone rows, each of them equal to 0.

    With multipliers in the dual cones, this is the weaker demand: cone rows contribute at least 0.
    """
    quadratic = program.quadratic
    return replace(
        quadratic,
        matrix=sp.vstack([program.matrix, program.cone_matrix], format="csr"),
        row_lower=np.concatenate([program.row_lower, -program.cone_offset]),
        row_upper=np.concatenate([program.row_upper, -program.cone_offset]),
        rows=(),
    )


def _cancelled_ray(program: ConicProgram, flat: QuadraticProgram, ray: Vector) -> Vector:
    """Return `ray` moved into the dual cones such that it cancels on columns without bounds."""
    y = program.signed(unit(ray))
    for _ in range(ROUNDS):
        pull, terms = flat.matrix.T @ y, abs(flat.matrix).T @ np.abs(y)
        unbounded = without_bound(flat, pull)
        if not (np.abs(pull) > CANCELLED * terms)[unbounded].any():
            break
        block = flat.matrix[:, np.flatnonzero(unbounded)].T
        step = np.zeros(y.size)
        used = np.flatnonzero(y)
        step[used] = least(block[:, used], pull[unbounded])
        y = unit(y - step)
        # Alone in its column, even a rounding error does not cancel.
        y = program.signed(np.where(np.abs(y) > NOISE, y, 0.0))
    return y


def _shared(program: ConicProgram, sizes: Vector) -> Vector:
    """Return sizes of stacked rows with the largest one of each cone for all of its rows.

    Rows of constants have no size of their own.
    """
    result = sizes.copy()
    for block in program.cones:
        rows = block.of(result[result.size - program.cone_offset.size :])
        rows[:] = rows.max(axis=1, keepdims=True)
    return result


def _recession(program: ConicProgram, move: Vector) -> Vector:
    """Return the projection of `move` onto the recession cone, in terms of the stacked rows."""
    lower = np.concatenate([program.row_lower, program.column_lower])
    upper = np.concatenate([program.row_upper, program.column_upper])
    bounded, size = lower.size, program.size
    clipped = np.clip(
        move[size : size + bounded], receding(lower, -np.inf), receding(upper, np.inf)
    )
    cones = move[size + bounded :]
    projected = [inside(block.kind, block.of(cones)).ravel() for block in program.cones]
    return np.concatenate([np.zeros(size), clipped, *projected])
