"""How well a mesh resolves a plan, interval by interval.

The error of an interval is measured as Patterson, Hager and Rao do (Optimal Control Applications and
Methods 36, 2015): the rates along the plan are integrated on a finer grid and held against the plan's
states. Beside it stand what bounds and path constraints are violated by between the nodes, and the
quadrature of the integrals. Whether an interval is smooth is read from the decay of the Legendre
coefficients of its controls (Liu, Hager and Rao, Journal of the Franklin Institute 352, 2015).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from ..definition import Phase
from ..lagrange import interpolation
from ..plan import PhasePlan
from ..sampling import Course, Instants
from ..sizes import PhaseSizes
from .schemes import gauss_points, integration

__all__ = ["ALLOWED", "SHARE", "Report", "examine"]

Floats = NDArray[np.float64]

#: Share of the tolerance that one interval's error may use up: errors add up along the motion.
SHARE = 0.2
#: Share of it that a violation between the nodes may use up.
ALLOWED = 0.8
#: Nodes beyond an interval's own on which its error is measured.
FINER = 4
#: How near a bound, as a share of the range between both, a control counts as saturated.
SATURATED = 0.02
#: How near its bound, relative to its typical size, a constraint counts as binding at a node.
BINDING = 1e-4
#: Share of a control's range that a step from node to node must take to count as chatter, and how
#: often the steps must turn.
STEP, TURNS = 0.15, 2


@dataclass(frozen=True, eq=False)
class Report:
    """What an interval-by-interval look at one phase found.

    Parameters
    ----------
    errors : ndarray, shape (intervals,)
        Relative error of motion and integrals.
    violations : ndarray, shape (intervals,)
        Largest violation of state bounds and path constraints between the nodes, relative.
    decays : ndarray, shape (intervals,)
        Decades by which the controls' Legendre coefficients fall a degree.
    tails : ndarray, shape (intervals,)
        Largest coefficient of the upper half of the degrees, as a share of the control's size.
    cuts : tuple of (float or None)
        Where a control switches from bound to bound within the interval, in [-1, 1].
    windows : tuple of tuple
        Where, in [-1, 1], some constraint begins or ceases to bind: pairs of neighbouring nodes.
    chatters : ndarray of bool, shape (intervals,)
        Where a control goes to and fro from node to node.
    places : ndarray, shape (intervals,)
        Where, in [-1, 1], the plan is furthest from its dynamics or constraints.
    sizes : PhaseSizes
        The sizes of the phase along the plan.
    """

    errors: Floats
    violations: Floats
    decays: Floats
    tails: Floats
    cuts: tuple[float | None, ...]
    windows: tuple[tuple[tuple[float, float], ...], ...]
    chatters: NDArray[np.bool_]
    places: Floats
    sizes: PhaseSizes

    @cached_property
    def worst(self) -> Floats:
        """The larger of error and violation, an interval each, in terms of the error."""
        found: Floats = np.maximum(self.errors, self.violations * (SHARE / ALLOWED))
        return found


def examine(phase: Phase, part: PhasePlan, parameters: Floats) -> Report:
    """Return the report on one phase of a plan; intervals with the same nodes go together."""
    count = part.states.intervals
    errors, violations, places = np.zeros(count), np.zeros(count), np.zeros(count)
    decays, tails, chatters = np.zeros(count), np.zeros(count), np.zeros(count, bool)
    windows: list[tuple[tuple[float, float], ...]] = [()] * count
    with np.errstate(invalid="ignore", over="ignore"):
        course = Course(phase, part, parameters)
        sizes = course.sizes
        for one in _groups(course):
            rows = one.rows
            errors[rows], places[rows] = _errors(one, sizes.states, sizes.integrals)
            violations[rows], where = _violated(phase, one, sizes)
            places[rows] = np.where(violations[rows] > errors[rows], where, places[rows])
            decays[rows], tails[rows] = _decays(phase, one)
            chatters[rows] = _chatters(phase, one.controls)
            for k, found in zip(rows, _windows(phase, one), strict=True):
                windows[k] = found
    cuts = _switches(phase, part)
    return Report(errors, violations, decays, tails, cuts, tuple(windows), chatters, places, sizes)


class _Group(NamedTuple):
    """Intervals with the same nodes, and what the plan and its functions are at the same places of each.

    Attributes
    ----------
    rows : ndarray of int, shape (intervals,)
        Which intervals.
    half : ndarray, shape (intervals,)
        Half their lengths.
    nodes : ndarray
        Where the controls stand, in [-1, 1].
    controls : ndarray, shape (intervals, nodes, size)
        The controls there, as they stand.
    fine, between, own, quadrature : tuple of ndarray and dict
        The places in [-1, 1], and tables of shape (intervals, places, size): a finer grid with both
        ends; one that is crowded towards the ends; the controls' nodes; and the rule of these.
    """

    rows: NDArray[np.int64]
    half: Floats
    nodes: Floats
    controls: Floats
    fine: _Look
    between: _Look
    own: _Look
    quadrature: _Look


_Look = tuple[Floats, dict[str, Floats]]


def _groups(course: Course) -> list[_Group]:
    """Return the intervals by their nodes; the declared functions are called once for all."""
    states, controls = course.plan.states, course.plan.controls
    alike: dict[tuple[bytes, bytes], list[int]] = {}
    for k, (x, u) in enumerate(zip(states.nodes, controls.nodes, strict=True)):
        alike.setdefault((x.tobytes(), u.tobytes()), []).append(k)
    plans = []
    for rows in map(np.array, alike.values()):
        nodes, more = controls.nodes[rows[0]], states.nodes[rows[0]].size
        fine = gauss_points(max(more, nodes.size) + FINER)[0]
        crowded = -np.cos(np.linspace(0.0, np.pi, 3 * more + 8))
        rule = gauss_points(nodes.size)[0] if course.phase.integrals else np.zeros(0)
        places = [np.concatenate([[-1.0], fine, [1.0]]), crowded, nodes, rule]
        plans.append((rows, places, course.spread(rows, np.concatenate(places))))
    at = Instants(*map(np.concatenate, zip(*(one for _, _, one in plans), strict=True)))
    values = {"states": at.states, "controls": at.controls, **course.values(at)}
    groups, begin = [], 0
    for rows, places, own in plans:
        end = begin + own.tau.size
        tables = {
            name: table[begin:end].reshape(rows.size, sum(map(len, places)), table.shape[1])
            for name, table in values.items()
        }
        begin = end
        cuts = np.cumsum([0, *(one.size for one in places)])
        looks = (
            (tau, {name: table[:, low:high] for name, table in tables.items()})
            for tau, low, high in zip(places, cuts[:-1], cuts[1:], strict=True)
        )
        half = 0.5 * np.diff(states.knots)[rows]
        stacked = np.stack([controls.values[k] for k in rows])
        groups.append(_Group(rows, half, places[2], stacked, *looks))
    return groups


def _errors(one: _Group, size: Floats, whole: Floats) -> tuple[Floats, Floats]:
    """Return the errors of motion and integrals, and where the motion is most wrong."""
    tau, tables = one.fine
    fine, onto = integration(tau.size - 2)
    half = one.half[:, None, None]
    moved = tables["states"][:, :1] + half * (onto @ tables["rate"][:, 1:-1])
    off = (np.abs(moved - tables["states"][:, 1:]) / size).max(axis=2)
    errors = off.max(axis=1)
    own = one.quadrature[0].size
    if own:
        before = gauss_points(own)[1] @ one.quadrature[1]["integrand"]
        again = gauss_points(fine.size)[1] @ tables["integrand"][:, 1:-1]
        gap = one.half[:, None] * np.abs(again - before) / whole
        errors = np.maximum(errors, gap.max(axis=1))
    # The residual between two neighbours on the fine grid shows where the motion is wrong.
    steps = np.abs(np.diff(off[:, :-1], axis=1, prepend=0.0))
    return np.where(np.isfinite(errors), errors, np.inf), fine[steps.argmax(axis=1)]


def _violated(phase: Phase, one: _Group, sizes: PhaseSizes) -> tuple[Floats, Floats]:
    """Return the largest relative violation between the nodes of each interval, and where it lies."""
    tau, tables = one.between
    worst, where = np.zeros(one.rows.size), np.zeros(one.rows.size)
    asked = [("states", tables["states"], sizes.states)]
    if phase.paths:
        asked.append(("paths", tables["path"], sizes.paths))
    for what, values, least in asked:
        for edge, sign in zip(phase.bounds(what), (-1.0, 1.0), strict=True):
            known = np.isfinite(edge)
            if known.any():
                scale = np.maximum(least[known], np.abs(edge[known]))
                off = (sign * (values[:, :, known] - edge[known]) / scale).max(axis=2)
                off = np.where(np.isnan(off), np.inf, off)
                most = off.max(axis=1)
                where = np.where(most > worst, tau[off.argmax(axis=1)], where)
                worst = np.maximum(worst, most)
    return worst, where


def _decays(phase: Phase, one: _Group) -> tuple[Floats, Floats]:
    """Return by how many decades a degree the controls' Legendre coefficients fall, and their tail."""
    count, degrees, controls = one.controls.shape
    if degrees < 4 or not controls:
        return np.ones(count), np.ones(count)
    table = legendre.legvander(one.nodes, degrees - 1)
    own = np.abs(np.linalg.solve(table, one.controls))
    scale = np.maximum(phase.stacked("controls", "scale"), np.abs(one.controls).max(axis=1))
    constant = own[:, 1:].max(axis=1) <= 1e-7 * scale
    scale = scale[:, None]
    # The envelope from above: the largest coefficient from each degree on.
    envelope = np.maximum.accumulate(own[:, ::-1], axis=1)[:, ::-1]
    logs = np.log10(np.maximum(envelope, 1e-9 * scale))
    floor = envelope <= 1e-8 * scale
    end = np.where(floor.any(axis=1), np.maximum(floor.argmax(axis=1) + 1, 3), degrees)
    # The straight line of least squares through the degrees below the floor.
    degree = np.arange(degrees)[:, None]
    lever = np.where(degree < end[:, None], degree - 0.5 * (end[:, None] - 1), 0.0)
    slopes = -(lever * logs).sum(axis=1) / (lever**2).sum(axis=1)
    found: Floats = np.where(constant, 2.0, slopes).min(axis=1)
    tails: Floats = (envelope[:, (degrees + 1) // 2] / scale[:, 0]).max(axis=1)
    return np.minimum(found, 2.0), tails


def _windows(phase: Phase, one: _Group) -> Iterator[tuple[tuple[float, float], ...]]:
    """Yield the pairs of neighbouring nodes between which a constraint begins or ceases to bind."""
    tau, tables = one.own
    changes = np.zeros((one.rows.size, tau.size - 1), bool)
    for what, name in (("states", "states"), ("controls", "controls"), ("paths", "path")):
        scale = BINDING * phase.stacked(what, "scale")
        for side in ("lower", "upper"):
            binds = np.abs(tables[name] - phase.stacked(what, side)) <= scale
            changes |= (binds[:, 1:] != binds[:, :-1]).any(axis=2)
    for row in changes:
        yield tuple((float(tau[j]), float(tau[j + 1])) for j in np.flatnonzero(row))


def _chatters(phase: Phase, values: Floats) -> NDArray[np.bool_]:
    """Return in which intervals a control goes to and fro from node to node."""
    low, high = phase.bounds("controls")
    found = np.zeros(len(values), bool)
    for c in np.flatnonzero(np.isfinite(high - low) & (high > low)):
        for k, steps in enumerate(np.diff(values[:, :, c], axis=1) / (high[c] - low[c])):
            steps = steps[np.abs(steps) > STEP]
            found[k] |= (steps[1:] * steps[:-1] < 0.0).sum() >= TURNS
    return found


def _switches(phase: Phase, part: PhasePlan) -> tuple[float | None, ...]:
    """Return where within each interval a control goes from one bound to the other, None if nowhere."""
    low, high = phase.bounds("controls")
    controls = part.controls
    found: list[float | None] = [None] * controls.intervals
    sizes = np.array([at.size for at in controls.nodes])
    first, last = (np.array([v[end] for v in controls.values]) for end in (0, -1))
    for c in np.flatnonzero(np.isfinite(high - low) & (high > low)):
        before, after = ((v[:, c] - low[c]) / (high[c] - low[c]) for v in (first, last))
        # Two nodes tell too little: there the neighbours' ends count.
        before, after = (
            np.where(sizes < 3, np.append(before[0], after[:-1]), before),
            np.where(sizes < 3, np.append(before[1:], after[-1]), after),
        )
        falls = (before > 1.0 - SATURATED) & (after < SATURATED)
        rises = (before < SATURATED) & (after > 1.0 - SATURATED)
        for k in np.flatnonzero(falls | rises):
            if found[k] is None:
                fine, weights = gauss_points(int(sizes[k]) + 2)
                own = (controls.values[k][:, c] - low[c]) / (high[c] - low[c])
                mean = 0.5 * float(weights @ (interpolation(controls.nodes[k], fine) @ own))
                share = mean if falls[k] else 1.0 - mean
                found[k] = float(np.clip(2.0 * share - 1.0, -0.995, 0.995))
    return tuple(found)
