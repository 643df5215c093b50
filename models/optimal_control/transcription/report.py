"""Resolution of a plan by its mesh, interval by interval.

The error of an interval is measured as by Patterson, Hager and Rao (Optimal Control Applications and
Methods 36, 2015): the rates along the plan are integrated on a finer grid and compared with the plan's
states. It is complemented by violations of bounds and path constraints between the nodes, and by the
quadrature error of the integrals. The smoothness of an interval is estimated from the decay of the
Legendre coefficients of its controls (Liu, Hager and Rao, Journal of the Franklin Institute 352, 2015).
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
from ..sampling import Course, course_of
from ..sizes import PhaseSizes
from .schemes import gauss_points, integration

__all__ = ["ALLOWED", "BINDING", "SHARE", "Report", "examine"]

Floats = NDArray[np.float64]

#: Share of the tolerance allowed for one interval's error, because errors accumulate along the motion.
SHARE = 0.2
#: Share of the tolerance allowed for a violation between the nodes.
ALLOWED = 0.8
#: Number of nodes, beyond those of an interval, on which its error is measured.
FINER = 4
#: Largest distance of a saturated control from its bound, relative to the range between both bounds.
SATURATED = 0.02
#: Smallest excess of a control over its bound, relative to its size, whose saturation is an error.
CLIPPED = 1e-7
#: Number of points at which saturation is integrated, in multiples of the points that show it.
DENSER = 8
#: Largest distance of an active constraint from its bound at a node, relative to its typical size.
BINDING = 1e-4
#: Smallest step between nodes of a chattering control, relative to a control's range, and smallest
#: number of changes of its direction.
STEP, TURNS = 0.15, 2


@dataclass(frozen=True, eq=False)
class Report:
    """Assessment of one phase by intervals; places are in [-1, 1]."""

    errors: Floats  # relative, of motion and integrals
    violations: Floats  # relative ones of states and paths between nodes
    decays: Floats  # of the controls' Legendre coefficients, in decades per degree
    tails: Floats  # largest coefficients of the upper half of the degrees, relative to the control
    cuts: tuple[float | None, ...]  # at which a control switches between its bounds
    windows: tuple[tuple[tuple[float, float], ...], ...]  # pairs of nodes: see `_windows`
    chatters: NDArray[np.bool_]  # whether a control alternates from node to node
    places: Floats  # of the largest violation of the dynamics or constraints
    sizes: PhaseSizes  # along the plan

    @cached_property
    def worst(self) -> Floats:
        """The larger of error and violation per interval, on the scale of the error."""
        return np.maximum(self.errors, self.violations * (SHARE / ALLOWED))

    def is_within(self, tolerance: float) -> bool:
        """Return whether neither an error nor a violation of an interval exceeds the tolerance."""
        return max(float(self.errors.max()), float(self.violations.max())) <= tolerance


def examine(phase: Phase, part: PhasePlan, parameters: Floats) -> Report:
    """Return the report on one phase of a plan; intervals with equal nodes are evaluated together."""
    count = part.states.intervals
    errors, violations, places = np.zeros(count), np.zeros(count), np.zeros(count)
    decays, tails, chatters = np.zeros(count), np.zeros(count), np.zeros(count, bool)
    windows: list[tuple[tuple[float, float], ...]] = [()] * count
    with np.errstate(invalid="ignore", over="ignore"):
        course = course_of(phase, part, parameters)
        sizes = course.sizes
        for group in _groups(course):
            rows = group.rows
            errors[rows], places[rows] = _errors(group, sizes.states, sizes.integrals)
            clipped, positions = _clipped(course, group, sizes)
            places[rows] = np.where(clipped > errors[rows], positions, places[rows])
            errors[rows] = np.maximum(errors[rows], clipped)
            violations[rows], positions = _violations(phase, group, sizes)
            places[rows] = np.where(violations[rows] > errors[rows], positions, places[rows])
            decays[rows], tails[rows] = _decays(phase, group)
            chatters[rows] = _chatters(phase, group.controls)
            for k, pairs in zip(rows, _windows(phase, group), strict=True):
                windows[k] = pairs
    cuts = _switches(phase, part)
    return Report(errors, violations, decays, tails, cuts, tuple(windows), chatters, places, sizes)


class _Group(NamedTuple):
    """Intervals with equal nodes, with the values of the plan and its functions at the same positions.

    `rows` are the indices of the intervals, `half` half their lengths, and `nodes` the positions of the
    controls in [-1, 1]. `controls` are the values there without saturation, shape (intervals, nodes,
    size). The last four are positions with tables of shape (intervals, positions, size): a finer grid
    with both ends, a grid that clusters towards the ends, the controls' nodes, and a quadrature rule with
    as many nodes.
    """

    rows: NDArray[np.int64]
    half: Floats
    nodes: Floats
    controls: Floats
    fine: _Look
    between: _Look
    at_nodes: _Look
    quadrature: _Look


_Look = tuple[Floats, dict[str, Floats]]


def _groups(course: Course) -> Iterator[_Group]:
    """Yield the intervals grouped by their nodes."""
    states, controls = course.plan.states, course.plan.controls
    alike: dict[tuple[bytes, bytes], list[int]] = {}
    for k, (x, u) in enumerate(zip(states.nodes, controls.nodes, strict=True)):
        alike.setdefault((x.tobytes(), u.tobytes()), []).append(k)
    for rows in map(np.array, alike.values()):
        nodes, count = controls.nodes[rows[0]], states.nodes[rows[0]].size
        fine = gauss_points(max(count, nodes.size) + FINER)[0]
        crowded = -np.cos(np.linspace(0.0, np.pi, 3 * count + 8))
        rule = gauss_points(nodes.size)[0] if course.phase.integrals else np.zeros(0)
        places = [np.concatenate([[-1.0], fine, [1.0]]), crowded, nodes, rule]
        # One call of the declared functions for all places.
        tau = np.concatenate(places)
        at = course.at(np.repeat(rows, tau.size), np.tile(tau, rows.size))
        values = {"states": at.states, "controls": at.controls, **course.values(at)}
        tables = {
            name: table.reshape(rows.size, tau.size, table.shape[1])
            for name, table in values.items()
        }
        cuts = np.cumsum([0, *(item.size for item in places)])
        views = (
            (item, {name: table[:, low:high] for name, table in tables.items()})
            for item, low, high in zip(places, cuts[:-1], cuts[1:], strict=True)
        )
        half = 0.5 * np.diff(states.knots)[rows]
        stacked = np.stack([controls.values[k] for k in rows])
        yield _Group(rows, half, nodes, stacked, *views)


def _errors(group: _Group, size: Floats, integral_sizes: Floats) -> tuple[Floats, Floats]:
    """Return the errors of motion and integrals, and the place of the largest residual."""
    tau, tables = group.fine
    fine, onto = integration(tau.size - 2)
    half = group.half[:, None, None]
    integrated = tables["states"][:, :1] + half * (onto @ tables["rate"][:, 1:-1])
    residual = (np.abs(integrated - tables["states"][:, 1:]) / size).max(axis=2)
    errors = residual.max(axis=1)
    count = group.quadrature[0].size
    if count:
        coarse = gauss_points(count)[1] @ group.quadrature[1]["integrand"]
        finer_value = gauss_points(fine.size)[1] @ tables["integrand"][:, 1:-1]
        difference = group.half[:, None] * np.abs(finer_value - coarse) / integral_sizes
        errors = np.maximum(errors, difference.max(axis=1))
    # The residual between neighbours on the fine grid locates the error of the motion.
    steps = np.abs(np.diff(residual[:, :-1], axis=1, prepend=0.0))
    return np.where(np.isfinite(errors), errors, np.inf), fine[steps.argmax(axis=1)]


def _clipped(course: Course, group: _Group, sizes: PhaseSizes) -> tuple[Floats, Floats]:
    """Return the error of the motion by the saturation of controls between the nodes, and its place.

    The polynomial of a control may exceed its bounds between the nodes, and the plan saturates it there. A
    touched bound does so between the points of the quadrature, so that they do not show the error.
    """
    tau, phase = group.between[0], course.phase
    errors, places = np.zeros(group.rows.size), np.zeros(group.rows.size)
    raw = interpolation(group.nodes, tau) @ group.controls
    excess = np.zeros(group.rows.size)
    for edge, sign in zip(phase.bounds("controls"), (-1.0, 1.0), strict=True):
        known = np.isfinite(edge)
        if known.any():
            above = _peaks(tau, sign * (raw[:, :, known] - edge[known])) / sizes.controls[known]
            excess = np.maximum(excess, above.max(axis=(1, 2)))
    rows = np.flatnonzero(excess > CLIPPED)
    if not rows.size:
        return errors, places
    # A touched bound is exceeded on a small part of an interval.
    tau = -np.cos(np.linspace(0.0, np.pi, DENSER * tau.size))
    raw = interpolation(group.nodes, tau) @ group.controls[rows]
    at = course.at(np.repeat(group.rows[rows], tau.size), np.tile(tau, rows.size))
    both = (at, at._replace(controls=raw.reshape(at.times.size, -1)))
    saturated, rates = (course.values(item)["rate"] for item in both)
    difference = (np.abs(rates - saturated) / sizes.states).reshape(rows.size, tau.size, -1)
    errors[rows] = group.half[rows] * np.trapezoid(difference, tau, axis=1).max(axis=1)
    places[rows] = tau[difference.max(axis=2).argmax(axis=1)]
    return np.where(np.isfinite(errors), errors, 0.0), places


def _peaks(tau: Floats, values: Floats) -> Floats:
    """Return `values`, shape (intervals, positions, entries), with local maxima raised to those of parabolas.

    A constraint that touches its bound is violated on a small part of an interval, between the points.
    """
    before, at, after = values[:, :-2], values[:, 1:-1], values[:, 2:]
    steps = np.diff(tau)[None, :, None]
    left, right = (at - before) / steps[:, :-1], (after - at) / steps[:, 1:]
    span = steps[:, :-1] + steps[:, 1:]
    slope = (left * steps[:, 1:] + right * steps[:, :-1]) / span
    bend = (left - right) / span
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = np.where((left >= 0) & (right <= 0) & (bend > 0), slope**2 / (4.0 * bend), 0.0)
    result = values.copy()
    result[:, 1:-1] += np.where(np.isfinite(gain), gain, 0.0)
    return result


def _violations(phase: Phase, group: _Group, sizes: PhaseSizes) -> tuple[Floats, Floats]:
    """Return the largest relative violation between the nodes of each interval, and its place."""
    tau, tables = group.between
    worst, where = np.zeros(group.rows.size), np.zeros(group.rows.size)
    checks = [("states", tables["states"], sizes.states)]
    if phase.paths:
        checks.append(("paths", tables["path"], sizes.paths))
    for what, values, smallest in checks:
        for edge, sign in zip(phase.bounds(what), (-1.0, 1.0), strict=True):
            known = np.isfinite(edge)
            if known.any():
                scale = np.maximum(smallest[known], np.abs(edge[known]))
                excess = _peaks(tau, sign * (values[:, :, known] - edge[known]) / scale).max(axis=2)
                excess = np.where(np.isnan(excess), np.inf, excess)
                largest = excess.max(axis=1)
                where = np.where(largest > worst, tau[excess.argmax(axis=1)], where)
                worst = np.maximum(worst, largest)
    return worst, where


def _decays(phase: Phase, group: _Group) -> tuple[Floats, Floats]:
    """Return the decay of the controls' Legendre coefficients in decades per degree, and their tail."""
    count, degrees, controls = group.controls.shape
    if degrees < 4 or not controls:
        return np.ones(count), np.ones(count)
    table = legendre.legvander(group.nodes, degrees - 1)
    coefficients = np.abs(np.linalg.solve(table, group.controls))
    scale = np.maximum(phase.stacked("controls", "scale"), np.abs(group.controls).max(axis=1))
    constant = coefficients[:, 1:].max(axis=1) <= 1e-7 * scale
    scale = scale[:, None]
    # Upper envelope: the largest coefficient from each degree on.
    envelope = np.maximum.accumulate(coefficients[:, ::-1], axis=1)[:, ::-1]
    logs = np.log10(np.maximum(envelope, 1e-9 * scale))
    floor = envelope <= 1e-8 * scale
    end = np.where(floor.any(axis=1), np.maximum(floor.argmax(axis=1) + 1, 3), degrees)
    # Least-squares line through the degrees below the floor.
    degree = np.arange(degrees)[:, None]
    lever = np.where(degree < end[:, None], degree - 0.5 * (end[:, None] - 1), 0.0)
    slopes = -(lever * logs).sum(axis=1) / (lever**2).sum(axis=1)
    result: Floats = np.where(constant, 2.0, slopes).min(axis=1)
    tails: Floats = (envelope[:, (degrees + 1) // 2] / scale[:, 0]).max(axis=1)
    return np.minimum(result, 2.0), tails


def _windows(phase: Phase, group: _Group) -> Iterator[tuple[tuple[float, float], ...]]:
    """Yield the pairs of neighbouring nodes between which a constraint becomes active or inactive."""
    tau, tables = group.at_nodes
    changes = np.zeros((group.rows.size, tau.size - 1), bool)
    for what, name in (("states", "states"), ("controls", "controls"), ("paths", "path")):
        scale = BINDING * phase.stacked(what, "scale")
        for side in ("lower", "upper"):
            binds = np.abs(tables[name] - phase.stacked(what, side)) <= scale
            changes |= (binds[:, 1:] != binds[:, :-1]).any(axis=2)
    for row in changes:
        yield tuple((float(tau[j]), float(tau[j + 1])) for j in np.flatnonzero(row))


def _chatters(phase: Phase, values: Floats) -> NDArray[np.bool_]:
    """Return the intervals with a control that alternates from node to node."""
    low, high = phase.bounds("controls")
    result = np.zeros(len(values), bool)
    for c in np.flatnonzero(np.isfinite(high - low) & (high > low)):
        for k, steps in enumerate(np.diff(values[:, :, c], axis=1) / (high[c] - low[c])):
            steps = steps[np.abs(steps) > STEP]
            result[k] |= (steps[1:] * steps[:-1] < 0.0).sum() >= TURNS
    return result


def _switches(phase: Phase, part: PhasePlan) -> tuple[float | None, ...]:
    """Return the place in each interval at which a control moves from one bound to the other, or None."""
    low, high = phase.bounds("controls")
    controls = part.controls
    result: list[float | None] = [None] * controls.intervals
    sizes = np.array([nodes.size for nodes in controls.nodes])
    first, last = (np.array([v[end] for v in controls.values]) for end in (0, -1))
    for c in np.flatnonzero(np.isfinite(high - low) & (high > low)):
        before, after = ((v[:, c] - low[c]) / (high[c] - low[c]) for v in (first, last))
        # Two nodes are too few: use the ends of the neighbours.
        before, after = (
            np.where(sizes < 3, np.append(before[0], after[:-1]), before),
            np.where(sizes < 3, np.append(before[1:], after[-1]), after),
        )
        falls = (before > 1.0 - SATURATED) & (after < SATURATED)
        rises = (before < SATURATED) & (after > 1.0 - SATURATED)
        for k in np.flatnonzero(falls | rises):
            if result[k] is None:
                fine, weights = gauss_points(int(sizes[k]) + 2)
                share_of_range = (controls.values[k][:, c] - low[c]) / (high[c] - low[c])
                mean = 0.5 * float(
                    weights @ (interpolation(controls.nodes[k], fine) @ share_of_range)
                )
                share = mean if falls[k] else 1.0 - mean
                result[k] = float(np.clip(2.0 * share - 1.0, -0.995, 0.995))
    return tuple(result)
