"""Characteristic sizes of the quantities of an optimal control problem, in their own units.

Tolerances, errors and the scaling for solvers are relative to these sizes. The sizes change with the
units of a problem, so that metres, kilometres and hours give the same answer. A size is taken from
declarations, from bounds and ends, and from a plan or a guess. Sizes without such a source follow from
the dynamics: a control is as large as necessary to move the states by their own size within the phase.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from ..programs.compiled import scalar_form
from .definition import SIDES, Definition, Quantity, Restriction, entry_slices, stacked

__all__ = ["PhaseSizes", "Sizes", "along", "of_phase", "sizes_at"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
#: Phase of a plan with its declaration (:class:`~.sampling.Course`, which imports this module).
Course = Any

#: Largest ratio of a declared scale to the range of a quantity that is accepted as its size.
WIDE = 10.0
#: Size of a quantity that stays 0 and has no declared scale other than 1, as a share of that scale.
LEAST = 1e-3
#: Sizes of an integral and an objective that vanish, as shares of their values under perturbations.
VANISHING, RESIDUAL = 1e-4, 1e-2
#: Number of instants of a phase at which functions are sampled, and of perturbations per instant.
INSTANTS, DRAWS = 16, 4
#: Smallest ratio of a bound to the movement of an expression at which the bound is its size.
NEAR = 0.1
#: Smallest size; anything smaller is rounding.
TINY = 1e-20
#: Number of passes through the dynamics: first near the guess, then at the distance of the first result.
PASSES = 2
#: Ratio of the largest to the mean rate that is assumed: 2 for a motion from rest to rest.
RISE = 2.0


@dataclass(frozen=True, eq=False)
class PhaseSizes:
    """Sizes of the quantities of one phase, all positive, per entry; `time` is the duration."""

    time: float
    states: Floats
    controls: Floats
    paths: Floats
    integrals: Floats


@dataclass(frozen=True, eq=False)
class Sizes:
    """Sizes of all quantities of a problem.

    `objective` is the size of the objective, or of its terms if they cancel; `variation` is its change
    if everything changes by up to its size.
    """

    phases: tuple[PhaseSizes, ...]
    parameters: Floats
    boundaries: Floats
    objective: float
    variation: float


def along(quantities: Iterable[Quantity], values: Floats) -> Floats:
    """Return the sizes of states or controls along a course of shape (points, entries).

    The size is the largest magnitude. If an entry stays smaller than its declared scale, the scale
    is used, but at most :data:`WIDE` times the largest magnitude of its vector.
    """
    result = []
    for quantity, entries in entry_slices(quantities):
        magnitude = np.abs(values[:, entries]).max(axis=0, initial=0.0)
        largest = float(magnitude.max(initial=0.0))
        wide = max(WIDE * largest, LEAST * float(quantity.scale.min(initial=1.0)))
        # A default scale of 1 is ignored, unless the whole vector stays 0.
        room = np.where(_has_declared_scale(quantity) | (largest == 0.0), wide, largest)
        result.append(np.maximum(np.maximum(magnitude, np.minimum(quantity.scale, room)), TINY))
    return np.concatenate([*result, np.empty(0)])


def sizes_at(
    definition: Definition, courses: Sequence[Course], ends: Floats, *, guessed: bool
) -> Sizes:
    """Return the sizes of a problem along a plan with the endpoint vector `ends`.

    If the plan is `guessed`, sizes known from bounds and ends take precedence, and unknown sizes
    follow from the dynamics.
    """
    parameters = definition.stacked("parameters", "scale")
    if not guessed and courses[0].parameters.size:
        parameters = along(definition.parameters, courses[0].parameters[None])
    phases = tuple(
        of_phase(course, guessed=True) if guessed else course.sizes for course in courses
    )
    return _at_ends(definition, ends, courses[0].parameters, phases, parameters)


def _has_declared_scale(item: Quantity | Restriction) -> Bools:
    """Return which entries have a declared scale: a finite bound other than 0, or a scale other than 1."""
    edges = [getattr(item, side) for side in SIDES if hasattr(item, side)]
    table = np.abs(np.array(edges))
    bounded = (np.isfinite(table) & (table > 0)).any(axis=0)
    return np.asarray(bounded | (item.scale != 1.0), bool)


def _each(condition: Callable[[Any], Bools], items: Iterable[Quantity | Restriction]) -> Bools:
    """Return a condition for the entries of all items."""
    return np.concatenate([*map(condition, items), np.empty(0, bool)])


@lru_cache(maxsize=64)
def _slopes(function: casadi.Function) -> casadi.Function:
    """Return rates and the dense Jacobians of rates and paths by x and u, as a function of (t, x, u, p)."""
    arguments = [casadi.MX.sym(name, function.size1_in(name)) for name in function.name_in()]
    rate, path, _, _ = function.call(arguments)
    slopes = [casadi.densify(casadi.jacobian(f, by)) for by in arguments[1:3] for f in (rate, path)]
    return scalar_form(casadi.Function("slopes", arguments, [casadi.densify(rate), *slopes]))


def of_phase(course: Course, *, guessed: bool = False) -> PhaseSizes:
    """Return the sizes of one phase along a plan or a guess, see :func:`sizes_at`."""
    phase, plan = course.phase, course.plan
    time = plan.duration
    grid = course.dense
    rows = np.unique(np.linspace(0, grid.times.size - 1, INSTANTS).astype(int))
    t, x, u = grid.times[rows], grid.states[rows], grid.controls[rows]
    if guessed:
        states, controls = _sizes_of_guess(course, t, x, u, time)
    else:
        states = along(phase.states, grid.states)
        controls = along(phase.controls, grid.controls)
    draw = np.random.default_rng(0)
    near = []
    for values, sizes, what in ((x, states, "states"), (u, controls, "controls")):
        change = draw.choice([-1.0, 1.0], (DRAWS, *values.shape)) * sizes
        change = np.clip(values + change, *phase.bounds(what))
        near.append(change.reshape(DRAWS * rows.size, -1).T)
    results: Any = phase.function(np.tile(t, DRAWS)[None, :], *near, course.parameters)
    integrals = _mean(np.abs(results[2].full().T)) * time
    if not guessed:
        integrals = np.maximum(course.magnitudes, VANISHING * integrals)
    paths = _path_sizes(course, states, controls)
    return PhaseSizes(time, states, controls, paths, _positive_or_one(integrals))


def _path_sizes(course: Course, states: Floats, controls: Floats) -> Floats:
    """Return the sizes of the path constraints; undeclared ones are evaluated where the slack is smallest."""
    phase, grid = course.phase, course.dense
    declared: Floats = phase.stacked("paths", "scale")
    own_scale = _each(_has_own_scale, phase.paths)
    if own_scale.all():
        return declared
    low, high = phase.bounds("paths")
    values = course.dense_values["path"]
    slack = np.minimum(values - low, high - values)
    rows = np.where(np.isfinite(slack), slack, np.inf).argmin(axis=0)
    by_x, by_u = _slopes_at(
        phase.function, grid.times[rows], grid.states[rows], grid.controls[rows], course.parameters
    )[2::2]
    each = np.arange(rows.size)
    moved = np.abs(by_x[each, each]) @ states + np.abs(by_u[each, each]) @ controls
    return np.where(own_scale, declared, _nearest(phase.paths, declared, moved))


def _has_own_scale(item: Restriction) -> Bools:
    """Return which entries have a declared scale that differs from the size of the bounds."""
    table = np.abs(np.array([item.lower, item.upper]))
    largest = np.where(np.isfinite(table), table, 0.0).max(axis=0)
    return np.asarray(item.scale != np.where(largest > 0.0, largest, 1.0), bool)


def _nearest(restrictions: Sequence[Restriction], declared: Floats, moved: Floats) -> Floats:
    """Return the bounds as sizes, or the movements of expressions with zero or relatively small bounds."""
    known = _each(_has_declared_scale, restrictions)
    moved = np.where(np.isfinite(moved), moved, 0.0)
    return np.where((known & (declared >= NEAR * moved)) | (moved == 0.0), declared, moved)


def _positive_or_one(sizes: Any) -> Floats:
    """Return `sizes` with 1 in place of values that are not finite and positive."""
    return np.where(np.isfinite(sizes) & (sizes > 0.0), sizes, 1.0)


def _mean(table: Floats) -> Floats:
    """Return the mean of each column's finite entries; 0 without finite entries."""
    finite = np.isfinite(table)
    count = np.maximum(finite.sum(axis=0), 1)
    result: Floats = np.where(finite, table, 0.0).sum(axis=0) / count
    return result


def _slopes_at(
    function: casadi.Function, t: Floats, x: Floats, u: Floats, p: Floats
) -> tuple[Floats, ...]:
    """Return rates and the Jacobians of rates and paths by states, then by controls, at instants."""
    results = _slopes(function)(t[None, :], x.T, u.T, p)
    rate, count = results[0].full().T, t.size
    tables = (
        table.full().reshape(table.size1(), count, table.size2() // count).transpose(1, 0, 2)
        for table in results[1:]
    )
    return rate, *tables


def _sizes_of_guess(
    course: Course, t: Floats, x: Floats, u: Floats, time: float
) -> tuple[Floats, Floats]:
    """Return the sizes of states and controls if only a guess of the course is known."""
    phase = course.phase
    sizes, known = [], []
    for quantities, values in ((phase.states, x), (phase.controls, u)):
        largest = np.abs(values).max(axis=0, initial=0.0)
        is_known = _each(_has_declared_scale, quantities)
        declared = stacked(quantities, "scale")
        sizes.append(np.where(is_known | (largest == 0.0), declared, largest))
        known.append(is_known | (largest > 0.0))
    vector, marks = np.concatenate(sizes), np.concatenate(known)
    changed = np.where(marks, vector, 0.0)
    for _ in range(0 if marks.all() else PASSES):
        vector = _propagate(course, (t, x, u), (vector, marks, changed), time)
        changed = vector
    return vector[: sizes[0].size], vector[sizes[0].size :]


def _propagate(
    course: Course,
    instants: tuple[Floats, Floats, Floats],
    sizes: tuple[Floats, Bools, Floats],
    time: float,
) -> Floats:
    """Return the sizes of all states and controls: the known (marked) ones and those that follow.

    Jacobians are evaluated near the instants `at`, because everything may be at rest there. The
    third of `sizes` is the distance.
    """
    (t, x, u), (vector, marks, changed) = instants, sizes
    phase, nx = course.phase, x.shape[1]
    draw = np.random.default_rng(0)
    change = draw.uniform(-1.0, 1.0, (DRAWS, t.size, vector.size)) * changed
    bounds = [
        np.concatenate(b) for b in zip(*map(phase.bounds, ("states", "controls")), strict=True)
    ]
    near = np.clip(np.concatenate([x, u], axis=1) + change, *bounds).reshape(DRAWS * t.size, -1)
    rate, by_x, _, by_u, path_by_u = _slopes_at(
        phase.function, np.tile(t, DRAWS), near[:, :nx], near[:, nx:], course.parameters
    )
    slope = time * np.sqrt(_mean(np.concatenate([by_x, by_u], axis=2) ** 2))
    rise = time * _mean(np.abs(rate))
    # A control with a bounded path constraint is as large as the constraint allows.
    bounded = _each(_has_declared_scale, phase.paths)
    limits = np.full(vector.size, np.inf)
    limits[nx:] = _driving(
        np.sqrt(_mean(path_by_u**2))[bounded], phase.stacked("paths", "scale")[bounded]
    )
    candidates = ~marks & np.isfinite(limits)
    while True:
        vector, marks = np.where(candidates, limits, vector), marks | candidates
        # A quantity that drives a state of known size is as large as necessary for that size.
        limits = _driving(slope[marks[:nx]], RISE * vector[:nx][marks[:nx]])
        candidates = ~marks & np.isfinite(limits)
        if not candidates.any():
            # A state that is driven by known quantities is as large as they move it.
            limits[:nx] = np.maximum(rise, slope[:, marks] @ vector[marks])
            candidates[:nx] = ~marks[:nx] & (limits[:nx] > 0.0)
        if not candidates.any():
            return vector


def _driving(slopes: Floats, sizes: Floats) -> Floats:
    """Return the sizes of the columns of `slopes`, (rows, columns), that produce `sizes`; inf for zero slopes."""
    with np.errstate(all="ignore"):
        table = np.where(slopes > 0.0, sizes[:, None] / slopes, np.inf)
    result: Floats = table.min(axis=0, initial=np.inf)
    return result


def _at_ends(
    definition: Definition, ends: Floats, p: Floats, phases: tuple[PhaseSizes, ...],
    parameters: Floats,
) -> Sizes:  # fmt: skip
    """Return all sizes, with those of the boundary constraints and of the objective."""
    parts = []
    for item, phase in zip(phases, definition.phases, strict=True):
        parts += [[item.time] * 2, item.states, item.states, item.integrals]
        parts += [item.states] * len(phase.instants)
    movement = np.concatenate([*parts, parameters])
    point = np.concatenate([ends, p])
    value, slope = _end_slopes(definition.endpoint)(ends, p)
    values, slopes = value.full().ravel(), np.abs(slope.full())
    slopes = np.where(np.isfinite(slopes), slopes, 0.0)
    boundaries = definition.stacked("boundaries", "scale")
    own_scale = _each(_has_own_scale, definition.boundaries)
    moved = _nearest(definition.boundaries, boundaries, slopes[1:] @ movement)
    boundaries = np.where(own_scale, boundaries, moved)
    objective = variation = definition.objective_scale
    if not objective:
        draw = np.random.default_rng(0).uniform(-1.0, 1.0, (INSTANTS, movement.size))
        near = point + draw * movement
        changed = definition.endpoint(near[:, : ends.size].T, near[:, ends.size :].T)[0].full()
        changed = np.abs(changed - values[0])
        varied = changed[np.isfinite(changed)].max(initial=0.0)
        largest = max(abs(values[0]), slopes[0] @ np.abs(point), RESIDUAL * varied)
        objective = float(_positive_or_one(largest))
        variation = float(varied) or objective
    return Sizes(phases, parameters, boundaries, objective, variation)


@lru_cache(maxsize=64)
def _end_slopes(function: casadi.Function) -> casadi.Function:
    """Return objective and boundaries and their Jacobian, as a function of (e, p)."""
    arguments = [casadi.MX.sym(name, function.size1_in(name)) for name in function.name_in()]
    values = casadi.vertcat(*function(*arguments))
    slopes = [casadi.densify(casadi.jacobian(values, argument)) for argument in arguments]
    return casadi.Function("ends", arguments, [casadi.densify(values), casadi.horzcat(*slopes)])
