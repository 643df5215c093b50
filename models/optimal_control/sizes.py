"""How large the quantities of an optimal control problem are, in units of their own.

What is measured, held against a tolerance or handed to a solver is held against these sizes. They
scale with the units that a problem is stated in, so that metres, kilometres and hours give the same
answer. A size comes from what is declared, from bounds and ends, and from a plan or a guess; of what
nothing is known, from the dynamics: a control is as large as it must be to move the states by their
own size within the phase.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from ..programs.compiled import scalar_form
from .definition import Definition, Quantity, Restriction

__all__ = ["PhaseSizes", "Sizes", "along", "of_phase", "sizes_at"]

Floats = NDArray[np.float64]
#: A phase of a plan beside its declaration (:class:`~.sampling.Course`, which asks for sizes here).
Course = Any

#: How many times its course a size may be by what is declared, for quantities that hardly move.
WIDE = 10.0
#: Size of what stays 0 and of which 1 is declared or nothing: a share of it.
LEAST = 1e-3
#: Size of an integral, and of an objective, that vanish: shares of what they are where all is changed.
VANISHING, RESIDUAL = 1e-4, 1e-2
#: Instants of a phase at which functions are looked at, and changes drawn of each.
INSTANTS, DRAWS = 16, 4
#: Share of what an expression moves by from which its bound is its size.
NEAR = 0.1
#: The least size of all: what is smaller is rounding.
TINY = 1e-20
#: How often sizes are spread over the dynamics: first near the guess, then as far as they say.
PASSES = 2
#: How many times its mean a rate may be: that of a motion which starts and ends at rest is 2.
RISE = 2.0


@dataclass(frozen=True, eq=False)
class PhaseSizes:
    """Sizes of what one phase has: an entry each, all positive.

    Parameters
    ----------
    time : float
        Length of the phase.
    states, controls, paths, integrals : ndarray
        In the order of the declaration.
    """

    time: float
    states: Floats
    controls: Floats
    paths: Floats
    integrals: Floats


@dataclass(frozen=True, eq=False)
class Sizes:
    """Sizes of all that a problem has.

    Parameters
    ----------
    phases : tuple of PhaseSizes
        One a phase.
    parameters, boundaries : ndarray
        In the order of the declaration.
    objective : float
        Size of the objective: of its terms, where they cancel.
    variation : float
        By how much it changes where everything changes by up to its size.
    """

    phases: tuple[PhaseSizes, ...]
    parameters: Floats
    boundaries: Floats
    objective: float
    variation: float


def along(quantities: Iterable[Quantity], values: Floats) -> Floats:
    """Return the sizes of states or controls along a course, (points, entries).

    That is the largest magnitude. An entry that stays smaller than what is declared counts for more,
    but never for more than :data:`WIDE` times what it or another of its vector reaches.
    """
    found, begin = [], 0
    for one in quantities:
        most = np.abs(values[:, begin : begin + one.size]).max(axis=0, initial=0.0)
        begin += one.size
        whole = float(most.max(initial=0.0))
        wide = max(WIDE * whole, LEAST * float(one.scale.min(initial=1.0)))
        # A scale of 1 that nothing stands behind says little, unless all else is 0 too.
        room = np.where(_known(one) | (whole == 0.0), wide, whole)
        found.append(np.maximum(np.maximum(most, np.minimum(one.scale, room)), TINY))
    return np.concatenate([*found, np.empty(0)])


def sizes_at(
    definition: Definition, courses: Sequence[Course], ends: Floats, *, guessed: bool
) -> Sizes:
    """Return the sizes of a problem along a plan, or along a guess.

    Parameters
    ----------
    definition : Definition
        The problem.
    courses : sequence of Course
        The phases of the plan beside their declarations.
    ends : ndarray
        What objective and boundary constraints are functions of.
    guessed : bool
        Whether the plan is a guess, which says less than what is declared: sizes that are known from
        bounds and ends are kept, and what nothing is known of follows from the dynamics.
    """
    parameters = definition.stacked("parameters", "scale")
    if not guessed and courses[0].parameters.size:
        parameters = along(definition.parameters, courses[0].parameters[None])
    phases = tuple(of_phase(one, guessed=True) if guessed else one.sizes for one in courses)
    return _at_ends(definition, ends, courses[0].parameters, phases, parameters)


def _known(one: Quantity | Restriction) -> NDArray[np.bool_]:
    """Return which entries' scales come from a declaration: 1 where nothing else says so does not."""
    edges = [getattr(one, side) for side in _SIDES if hasattr(one, side)]
    table = np.abs(np.array(edges))
    bounded = (np.isfinite(table) & (table > 0)).any(axis=0)
    return np.asarray(bounded | (one.scale != 1.0), bool)


_SIDES = ("lower", "upper", "initial_lower", "initial_upper", "final_lower", "final_upper")


@lru_cache(maxsize=64)
def _slopes(function: casadi.Function) -> casadi.Function:
    """Return the function of (t, x, u, p) that gives rate, path, and their dense slopes by x and u."""
    arguments = [casadi.MX.sym(name, function.size1_in(name)) for name in function.name_in()]
    rate, path, _, _ = function.call(arguments)
    slopes = [casadi.densify(casadi.jacobian(f, by)) for by in arguments[1:3] for f in (rate, path)]
    return scalar_form(casadi.Function("slopes", arguments, [casadi.densify(rate), *slopes]))


def of_phase(course: Course, *, guessed: bool = False) -> PhaseSizes:
    """Return the sizes of one phase along a plan, or along a guess as :func:`sizes_at` says."""
    phase, plan = course.phase, course.plan
    time = plan.duration
    grid = course.dense
    rows = np.unique(np.linspace(0, grid.times.size - 1, INSTANTS).astype(int))
    t, x, u = grid.times[rows], grid.states[rows], grid.controls[rows]
    if guessed:
        states, controls = _guessed(course, t, x, u, time)
    else:
        states = along(phase.states, grid.states)
        controls = along(phase.controls, grid.controls)
    draw = np.random.default_rng(0)
    near = []
    for values, sizes, what in ((x, states, "states"), (u, controls, "controls")):
        change = draw.choice([-1.0, 1.0], (DRAWS, *values.shape)) * sizes
        low, high = phase.bounds(what)
        near.append(np.clip(values + change, low, high).reshape(DRAWS * rows.size, -1))
    own = _call(phase.function, np.tile(t, DRAWS), near[0], near[1], course.parameters)
    drawn = _mean(np.abs(own[2]))
    integrals = drawn * time
    if not guessed:
        integrals = np.maximum(course.magnitudes, VANISHING * integrals)
    paths = _of_paths(course, states, controls)
    return PhaseSizes(time, states, controls, paths, _or_one(integrals))


def _of_paths(course: Course, states: Floats, controls: Floats) -> Floats:
    """Return the sizes of the path constraints, undeclared ones where they are tightest."""
    phase, grid = course.phase, course.dense
    declared: Floats = phase.stacked("paths", "scale")
    told = np.concatenate([*(_told(one) for one in phase.paths), np.empty(0, bool)])
    if told.all():
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
    found: Floats = np.where(told, declared, _nearest(phase.paths, declared, moved))
    return found


def _told(one: Restriction) -> NDArray[np.bool_]:
    """Return which entries have a scale of their own, not that of a bound."""
    table = np.abs(np.array([one.lower, one.upper]))
    largest = np.where(np.isfinite(table), table, 0.0).max(axis=0)
    return np.asarray(one.scale != np.where(largest > 0.0, largest, 1.0), bool)


def _nearest(restrictions: Sequence[Restriction], declared: Floats, moved: Floats) -> Floats:
    """Return the bounds, or what expressions move by where bounds are 0 or little beside it."""
    known = np.concatenate([*(_known(one) for one in restrictions), np.empty(0, bool)])
    moved = np.where(np.isfinite(moved), moved, 0.0)
    return np.where((known & (declared >= NEAR * moved)) | (moved == 0.0), declared, moved)


def _or_one(sizes: Any) -> Floats:
    """Return `sizes`, 1 for what is none."""
    return np.where(np.isfinite(sizes) & (sizes > 0.0), sizes, 1.0)


def _mean(table: Floats) -> Floats:
    """Return the mean of each column's finite entries, 0 without any."""
    finite = np.isfinite(table)
    count = np.maximum(finite.sum(axis=0), 1)
    found: Floats = np.where(finite, table, 0.0).sum(axis=0) / count
    return found


def _call(function: casadi.Function, t: Floats, x: Floats, u: Floats, p: Floats) -> list[Floats]:
    with np.errstate(all="ignore"):
        found: Any = function(t[None, :], x.T, u.T, p)
    return [part.full().T for part in found]


def _slopes_at(
    function: casadi.Function, t: Floats, x: Floats, u: Floats, p: Floats
) -> tuple[Floats, ...]:
    """Return rates and the slopes of rates and paths by states, then by controls, at instants."""
    found = _slopes(function)(t[None, :], x.T, u.T, p)
    rate, count = found[0].full().T, t.size
    shapes = [(one.size1(), one.size2() // count) for one in found[1:]]
    tables = [
        one.full().reshape(rows, count, columns).transpose(1, 0, 2)
        for one, (rows, columns) in zip(found[1:], shapes, strict=True)
    ]
    return rate, tables[0], tables[1], tables[2], tables[3]


def _guessed(course: Course, t: Floats, x: Floats, u: Floats, time: float) -> tuple[Floats, Floats]:
    """Return the sizes of states and controls where only a guess of the course is known."""
    phase = course.phase
    sizes, known = [], []
    for quantities, values in ((phase.states, x), (phase.controls, u)):
        most = np.abs(values).max(axis=0, initial=0.0)
        mark = np.concatenate([*(_known(one) for one in quantities), np.empty(0, bool)])
        declared = np.concatenate([*(one.scale for one in quantities), np.empty(0)])
        sizes.append(np.where(mark | (most == 0.0), declared, most))
        known.append(mark | (most > 0.0))
    whole, marks = np.concatenate(sizes), np.concatenate(known)
    changed = np.where(marks, whole, 0.0)
    for _ in range(0 if marks.all() else PASSES):
        whole = _spread(course, (t, x, u), (whole, marks, changed), time)
        changed = whole
    return whole[: sizes[0].size], whole[sizes[0].size :]


def _spread(
    course: Course,
    at: tuple[Floats, Floats, Floats],
    sizes: tuple[Floats, NDArray[np.bool_], Floats],
    time: float,
) -> Floats:
    """Return sizes of all states and controls: those known, which are marked, and what follows.

    Slopes are taken near the instants `at`, where everything may rest: as far away as the third of
    `sizes` says.
    """
    (t, x, u), (whole, marks, changed) = at, sizes
    phase, nx = course.phase, x.shape[1]
    draw = np.random.default_rng(0)
    change = draw.uniform(-1.0, 1.0, (DRAWS, t.size, whole.size)) * changed
    bounds = [
        np.concatenate(b) for b in zip(*map(phase.bounds, ("states", "controls")), strict=True)
    ]
    near = np.clip(np.concatenate([x, u], axis=1) + change, *bounds).reshape(DRAWS * t.size, -1)
    rate, by_x, _, by_u, path_by_u = _slopes_at(
        phase.function, np.tile(t, DRAWS), near[:, :nx], near[:, nx:], course.parameters
    )
    slope = time * np.sqrt(_mean(np.concatenate([by_x, by_u], axis=2) ** 2))
    rise = time * _mean(np.abs(rate))
    # A control that a path constraint bounds is as large as that allows.
    bounded = np.concatenate([*(_known(one) for one in phase.paths), np.empty(0, bool)])
    limits = np.full(whole.size, np.inf)
    limits[nx:] = _driving(
        np.sqrt(_mean(path_by_u**2))[bounded], phase.stacked("paths", "scale")[bounded]
    )
    found = ~marks & np.isfinite(limits)
    while True:
        whole, marks = np.where(found, limits, whole), marks | found
        # What drives a state of known size is as large as moves it by that size.
        limits = _driving(slope[marks[:nx]], RISE * whole[:nx][marks[:nx]])
        found = ~marks & np.isfinite(limits)
        if not found.any():
            # What is driven by what is known is as large as that moves it.
            limits[:nx] = np.maximum(rise, slope[:, marks] @ whole[marks])
            found[:nx] = ~marks[:nx] & (limits[:nx] > 0.0)
        if not found.any():
            return whole


def _driving(slopes: Floats, sizes: Floats) -> Floats:
    """Return how large what has `slopes`, (rows, columns), must be to give `sizes`; inf without any."""
    with np.errstate(all="ignore"):
        table = np.where(slopes > 0.0, sizes[:, None] / slopes, np.inf)
    found: Floats = table.min(axis=0, initial=np.inf)
    return found


def _at_ends(
    definition: Definition,
    ends: Floats,
    p: Floats,
    phases: tuple[PhaseSizes, ...],
    parameters: Floats,
) -> Sizes:
    """Return the sizes with those of the boundary constraints and of the objective."""
    parts = []
    for one in phases:
        parts += [[one.time] * 2, one.states, one.states, one.integrals]
    moves = np.concatenate([*parts, parameters])
    here = np.concatenate([ends, p])
    value, slope = _end_slopes(definition.endpoint)(ends, p)
    values, slopes = value.full().ravel(), np.abs(slope.full())
    slopes = np.where(np.isfinite(slopes), slopes, 0.0)
    boundaries = definition.stacked("boundaries", "scale")
    told = np.concatenate([*(_told(one) for one in definition.boundaries), np.empty(0, bool)])
    moved = _nearest(definition.boundaries, boundaries, slopes[1:] @ moves)
    boundaries = np.where(told, boundaries, moved)
    objective = variation = definition.objective_scale
    if not objective:
        draw = np.random.default_rng(0).uniform(-1.0, 1.0, (INSTANTS, moves.size))
        near = here + draw * moves
        changed = definition.endpoint(near[:, : ends.size].T, near[:, ends.size :].T)[0].full()
        changed = np.abs(changed - values[0])
        varied = changed[np.isfinite(changed)].max(initial=0.0)
        most = max(abs(values[0]), slopes[0] @ np.abs(here), RESIDUAL * varied)
        objective = float(_or_one(most))
        variation = float(varied) or objective
    return Sizes(phases, parameters, boundaries, objective, variation)


@lru_cache(maxsize=64)
def _end_slopes(function: casadi.Function) -> casadi.Function:
    """Return the function of (e, p) that gives objective and boundaries, and their slopes by both."""
    arguments = [casadi.MX.sym(name, function.size1_in(name)) for name in function.name_in()]
    values = casadi.vertcat(*function(*arguments))
    slopes = [casadi.densify(casadi.jacobian(values, one)) for one in arguments]
    return casadi.Function("ends", arguments, [casadi.densify(values), casadi.horzcat(*slopes)])
