"""How well a mesh resolves a plan, interval by interval.

The error of an interval is measured as Patterson, Hager and Rao do (Optimal Control Applications and
Methods 36, 2015): the rates along the plan are integrated on a finer grid and held against the plan's
states. Beside it stand what bounds and path constraints are violated by between the nodes, and the
quadrature of the integrals. Whether an interval is smooth is read from the decay of the Legendre
coefficients of its controls (Liu, Hager and Rao, Journal of the Franklin Institute 352, 2015).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from ..definition import Phase
from ..lagrange import interpolation
from ..plan import PhasePlan
from ..sampling import Course, Instants
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
    cuts : tuple of (float or None)
        Where a control switches from bound to bound within the interval, in [-1, 1].
    windows : tuple of tuple
        Where, in [-1, 1], some constraint begins or ceases to bind: pairs of neighbouring nodes.
    chatters : ndarray of bool, shape (intervals,)
        Where a control goes to and fro from node to node.
    places : ndarray, shape (intervals,)
        Where, in [-1, 1], the plan is furthest from its dynamics or constraints.
    """

    errors: Floats
    violations: Floats
    decays: Floats
    cuts: tuple[float | None, ...]
    windows: tuple[tuple[tuple[float, float], ...], ...]
    chatters: NDArray[np.bool_]
    places: Floats

    @property
    def worst(self) -> Floats:
        """The larger of error and violation, an interval each, in terms of the error."""
        found: Floats = np.maximum(self.errors, self.violations * (SHARE / ALLOWED))
        return found


def examine(phase: Phase, part: PhasePlan, parameters: Floats) -> Report:
    """Return the report on one phase of a plan."""
    count = part.states.intervals
    most = np.max([np.abs(v).max(axis=0) for v in part.states.values], axis=0)
    size = np.maximum(phase.least_scale("states"), most)
    errors, violations, places = np.zeros(count), np.zeros(count), np.zeros(count)
    decays, chatters = np.zeros(count), np.zeros(count, bool)
    cuts: list[float | None] = []
    windows: list[tuple[tuple[float, float], ...]] = []
    course = Course(phase, part, parameters)
    quadrature = _quadrature(course)
    whole = np.maximum(1.0, sum((size for _, size in quadrature), np.zeros(phase.integrals)))
    for k in range(count):
        degree = part.controls.nodes[k].size
        fine, onto = integration(max(part.states.nodes[k].size, degree) + FINER)
        half = 0.5 * (part.states.knots[k + 1] - part.states.knots[k])
        values = _look(course, k, fine)[1]
        begin = part.states.on(k, [-1.0])
        moved = begin + half * (onto @ values["rate"])
        there = part.states.on(k, np.append(fine, 1.0))
        off = (np.abs(moved - there) / size).max(axis=1)
        errors[k] = off.max()
        if quadrature:
            again = half * (gauss_points(fine.size)[1] @ values["integrand"])
            gap = np.abs(quadrature[k][0] - again)
            errors[k] = max(errors[k], float((gap / whole).max()))
        # The residual between two neighbours on the fine grid shows where the motion is wrong.
        steps = np.abs(np.diff(np.append(0.0, off[:-1])))
        places[k] = fine[int(steps.argmax())]
        violations[k], where = _violated(course, k)
        if violations[k] > errors[k]:
            places[k] = where
        decays[k] = _decay(part.controls.nodes[k], part.controls.values[k], phase)
        cuts.append(_switch(phase, part, k))
        windows.append(_windows(course, k))
        chatters[k] = _chatters(phase, part.controls.values[k])
    bad = ~np.isfinite(errors)
    errors[bad] = np.inf
    return Report(errors, violations, decays, tuple(cuts), tuple(windows), chatters, places)


def _look(course: Course, k: int, tau: Floats) -> tuple[Instants, dict[str, Floats]]:
    """Return states and controls, and the declared functions, at places of interval k."""
    at = course.at(np.full(len(tau), k), tau)
    return at, course.values(at)


def _quadrature(course: Course) -> list[tuple[Floats, Floats]]:
    """Return the integrals over each interval as its own nodes give them, and of the magnitudes."""
    if not course.phase.integrals:
        return []
    found = []
    for k, half in enumerate(0.5 * np.diff(course.plan.states.knots)):
        tau, weights = gauss_points(course.plan.controls.nodes[k].size)
        values = _look(course, k, tau)[1]["integrand"]
        found.append((half * (weights @ values), half * (weights @ np.abs(values))))
    return found


def _violated(course: Course, k: int) -> tuple[float, float]:
    """Return the largest relative violation between the nodes of interval k, and where it lies."""
    count = 3 * course.plan.states.nodes[k].size + 8
    tau = -np.cos(np.pi * np.arange(count) / (count - 1))
    at, functions = _look(course, k, tau)
    phase = course.phase
    tables = [(at.states.T, *phase.bounds("states"), phase.least_scale("states"))]
    if phase.paths:
        paths = phase.stacked("paths", "scale")
        tables.append((functions["path"].T, *phase.bounds("paths"), paths))
    worst, where = 0.0, 0.0
    for values, low, high, least in tables:
        for edge, sign in ((low, -1.0), (high, 1.0)):
            known = np.isfinite(edge)
            if known.any():
                scale = np.maximum(least[known], np.abs(edge[known]))
                off = (sign * (values[known] - edge[known, None]) / scale[:, None]).max(axis=0)
                if np.isnan(off).any():
                    return np.inf, 0.0
                row = int(off.argmax())
                if off[row] > worst:
                    worst, where = float(off[row]), float(tau[row])
    return worst, where


def _decay(nodes: Floats, values: Floats, phase: Phase) -> float:
    """Return by how many decades a degree the Legendre coefficients of the controls fall."""
    if nodes.size < 4 or not values.shape[1]:
        return 1.0
    table = legendre.legvander(nodes, nodes.size - 1)
    coefficients = np.abs(np.linalg.solve(table, values))
    scale = np.maximum(phase.stacked("controls", "scale"), np.abs(values).max(axis=0))
    slowest = 2.0
    for own, size in zip(coefficients.T, scale, strict=True):
        if own[1:].max(initial=0.0) <= 1e-7 * size:
            continue  # as good as constant
        # The envelope from above: the largest coefficient from each degree on.
        envelope = np.maximum.accumulate(own[::-1])[::-1]
        logs = np.log10(np.maximum(envelope, 1e-9 * size))
        degree = np.arange(own.size)
        end = own.size
        floor = np.flatnonzero(envelope <= 1e-8 * size)
        if floor.size:
            end = max(int(floor[0]) + 1, 3)
        slope = -np.polyfit(degree[:end], logs[:end], 1)[0]
        slowest = min(slowest, float(slope))
    return slowest


def _windows(course: Course, k: int) -> tuple[tuple[float, float], ...]:
    """Return the pairs of neighbouring nodes between which a constraint begins or ceases to bind."""
    phase, tau = course.phase, course.plan.controls.nodes[k]
    at, functions = _look(course, k, tau)
    tables = [("states", at.states.T), ("controls", at.controls.T), ("paths", functions["path"].T)]
    changes = np.zeros(tau.size - 1, bool)
    for what, values in tables:
        scale = BINDING * phase.stacked(what, "scale")[:, None]
        for side in ("lower", "upper"):
            edge = phase.stacked(what, side)[:, None]
            with np.errstate(invalid="ignore"):
                binds = np.abs(values - edge) <= scale
            changes |= (binds[:, 1:] != binds[:, :-1]).any(axis=0)
    return tuple((float(tau[j]), float(tau[j + 1])) for j in np.flatnonzero(changes))


def _chatters(phase: Phase, values: Floats) -> bool:
    """Return whether a control goes to and fro from node to node."""
    low, high = phase.bounds("controls")
    for c in range(values.shape[1]):
        width = high[c] - low[c]
        if not np.isfinite(width) or width <= 0.0:
            continue
        steps = np.diff(values[:, c]) / width
        steps = steps[np.abs(steps) > STEP]
        if (steps[1:] * steps[:-1] < 0.0).sum() >= TURNS:
            return True
    return False


def _switch(phase: Phase, part: PhasePlan, k: int) -> float | None:
    """Return where within interval k a control goes from one bound to the other, None if nowhere."""
    low, high = phase.bounds("controls")
    count = part.controls.intervals
    for c in range(part.controls.size):
        width = high[c] - low[c]
        if not np.isfinite(width) or width <= 0.0:
            continue
        own = (part.controls.values[k][:, c] - low[c]) / width
        before, after = own[0], own[-1]
        if k > 0 and own.size < 3:
            before = (part.controls.values[k - 1][-1, c] - low[c]) / width
        if k + 1 < count and own.size < 3:
            after = (part.controls.values[k + 1][0, c] - low[c]) / width
        falls = before > 1.0 - SATURATED and after < SATURATED
        rises = before < SATURATED and after > 1.0 - SATURATED
        if not (falls or rises):
            continue
        nodes = part.controls.nodes[k]
        fine, weights = gauss_points(nodes.size + 2)
        mean = 0.5 * float(weights @ (interpolation(nodes, fine) @ own))
        share = mean if falls else 1.0 - mean
        return float(np.clip(2.0 * share - 1.0, -0.995, 0.995))
    return None
