"""Proofs that a program with cones has no solution, recomputed from its arrays.

A weakly infeasible program (its rows and its cones do not meet, but come as near as one likes) has
no proof; yet rays that nearly cancel look like one. With ``x y >= 1`` and ``x = 0``, an error of e
in the sum that shall cancel buys an excess of ``sqrt(e)``. So a ray is first moved until its sum
cancels to the last digits, and then its excess must be far above the root of those.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.programs.cones import ConeBlock, ConeKind, inside, order, triangle
from ...models.programs.conic import ConicProgram
from ...models.programs.linear import QuadraticProgram
from ..attempts import Ending
from ..qp.proofs import Findings, least, receding, unit, without_bound

__all__ = ["examined", "excludes", "recedes"]

Vector = NDArray[np.float64]
Solve = Callable[[ConicProgram], Ending]

#: Share of the terms of a sum that may be left where they should cancel.
CANCELLED = 1e-12
#: Least excess of a proof, and least fall of a direction, in their natural units: 14 times the
#: ``2 sqrt(2 CANCELLED)`` that the hyperbola above gives.
MARGIN = 4e-5
#: Alternating projections at most. Where the intersection has an inside a few do; where it has
#: none, hundreds would not.
ROUNDS = 50


def excludes(program: ConicProgram, ray: Vector, center: Vector | None = None) -> bool:
    """Return whether the multipliers `ray` prove that no point satisfies rows, bounds and cones.

    Parameters
    ----------
    program : ConicProgram
        What is infeasible.
    ray : ndarray
        Multipliers of rows and cone rows.
    center : ndarray, optional
        A point from which distances are counted, such as the least infeasible one; else 0.
    """
    flat = _flat(program)
    y = _mended_ray(program, flat, ray)
    pull, terms = flat.matrix.T @ y, abs(flat.matrix).T @ np.abs(y)
    if not terms.max(initial=0.0) > 0:
        # No column enters: constants alone lie outside of the cones, or do not.
        terms = np.full(1, np.abs(y).max(initial=0.0))
    endless = without_bound(flat, pull)
    if (np.abs(pull) > CANCELLED * terms)[endless].any():
        return False
    pull[endless] = 0.0
    at = np.zeros(program.size) if center is None else center
    away = np.where(pull > 0, flat.column_upper, flat.column_lower) - at
    given = pull * np.where(pull != 0, away, 0.0)
    bound = np.where(y > 0, flat.row_lower, flat.row_upper) - flat.matrix @ at
    bound = np.where(y != 0, bound, 0.0)
    demanded = y * bound
    # Bounds in units of the columns: each over the largest coefficient of its row, or of its cone.
    largest = abs(flat.matrix).max(axis=1).toarray().ravel() if flat.matrix.nnz else 0.0 * y
    for block in program.cones:
        part = slice(program.row_count + block.start, program.row_count + block.start + block.size)
        largest[part] = np.repeat(block.of(largest[program.row_count :]).max(1), block.dimension)
    distance = np.abs(bound / np.where(largest > 0, largest, 1.0)).max(initial=0.0)
    noise = 1e-9 * float(np.abs(demanded).sum() + np.abs(given).sum())
    excess = float(demanded.sum() - given.sum())
    return excess > max(noise, MARGIN * float(terms.max()) * float(distance))


def recedes(program: ConicProgram, direction: Vector) -> bool:
    """Return whether the objective falls forever along `direction` from any feasible point."""
    d = unit(direction)
    parts = [program.hessian, program.matrix, sp.eye_array(program.size), program.cone_matrix]
    stack = sp.vstack(parts, format="csr")
    noise = CANCELLED * abs(stack).sum(axis=1)
    for block in program.cones:
        # A row of constants, which no direction moves, has none of its own.
        rows = block.of(noise[noise.size - program.cone_offset.size :])
        rows[:] = rows.max(axis=1, keepdims=True)
    for _ in range(ROUNDS):
        move = stack @ d
        off = move - _recession(program, move)
        if (np.abs(off) <= noise).all():
            break
        d = unit(d - least(stack, off))
    else:
        return False
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
    """Return what can be proven of `program`, which a solver found no optimum of.

    Parameters
    ----------
    program : ConicProgram
        What is examined.
    solve : callable
        Solves a conic program; an elastic one and a recession program of our own are tried.
    ray, direction : ndarray, optional
        What the solver offers as proof.
    point : ndarray, optional
        A point that is known to be feasible.
    """
    if point is None and ray is not None and excludes(program, ray):
        return Findings(infeasible=True, source="the solver's ray")
    violation = None
    if point is None:
        found = solve(elastic(program))
        if found.point is not None and np.isfinite(found.point).all():
            near = np.clip(found.point[:-1], program.column_lower, program.column_upper)
            violation = float(found.point[-1])
            if program.verify(near, tolerance=1e-7).ok:
                point = near
            for candidate in (_unfolded(program, found.duals), ray):
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
    """Return the program that finds the least t by which all rows and cones are relaxed.

    Its last column is t, its rows are those from below and then those from above.
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
    """Return the multipliers of `program` from those of its elastic one."""
    if duals is None:
        return None
    low = np.flatnonzero(np.isfinite(program.row_lower))
    high = np.flatnonzero(np.isfinite(program.row_upper))
    found = np.zeros(program.row_count)
    found[low] += duals[: low.size]
    found[high] += duals[low.size : low.size + high.size]
    return np.concatenate([found, duals[low.size + high.size :]])


def _receding(program: ConicProgram) -> ConicProgram:
    """Return the program whose optimum is the steepest direction, within a box, that stays inside."""
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
    """Return a point well within each cone of `block`."""
    one = np.zeros(block.dimension)
    if block.kind is ConeKind.SECOND_ORDER:
        one[0] = 1.0
    elif block.kind is ConeKind.EXPONENTIAL:
        one[:] = -1.0, 1.0, 1.0
    else:
        one = triangle(np.eye(order(block.dimension))[None])[0]
    return np.tile(one, block.count)


def _flat(program: ConicProgram) -> QuadraticProgram:
    """Return the program whose rows are those of `program` and its cone rows, equal to 0.

    With multipliers in the dual cones, cone rows demand at least what they would if they were 0.
    """
    quadratic = program.quadratic
    return replace(
        quadratic,
        matrix=sp.vstack([program.matrix, program.cone_matrix], format="csr"),
        row_lower=np.concatenate([program.row_lower, -program.cone_offset]),
        row_upper=np.concatenate([program.row_upper, -program.cone_offset]),
        rows=(),
    )


def _mended_ray(program: ConicProgram, flat: QuadraticProgram, ray: Vector) -> Vector:
    """Return `ray` in the dual cones, and such that its sum cancels on columns without bounds."""
    y = program.signed(unit(ray))
    for _ in range(ROUNDS):
        pull, terms = flat.matrix.T @ y, abs(flat.matrix).T @ np.abs(y)
        endless = without_bound(flat, pull)
        if not (np.abs(pull) > CANCELLED * terms)[endless].any():
            break
        block = flat.matrix[:, np.flatnonzero(endless)].T
        y = program.signed(y - least(block, pull[endless]))
    return y


def _recession(program: ConicProgram, move: Vector) -> Vector:
    """Return what is nearest to `move`, in those rows, among what no constraint forbids forever."""
    lower = np.concatenate([program.row_lower, program.column_lower])
    upper = np.concatenate([program.row_upper, program.column_upper])
    bounded, size = lower.size, program.size
    held = np.clip(move[size : size + bounded], receding(lower, -np.inf), receding(upper, np.inf))
    cones = move[size + bounded :]
    moved = [inside(block.kind, block.of(cones)).ravel() for block in program.cones]
    return np.concatenate([np.zeros(size), held, *moved])
