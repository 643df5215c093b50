"""hp-refinement: where a mesh is too coarse, and whether degree or intervals should grow.

The error of an interval is measured as Patterson, Hager and Rao do (Optimal Control Applications and
Methods 36, 2015): the rates along the plan are integrated on a finer grid and held against the plan's
states. Beside it stand what bounds and path constraints are violated by between the nodes, and the
quadrature of the integrals. Whether an interval is smooth is read from the decay of the Legendre
coefficients of its controls (Liu, Hager and Rao, Journal of the Franklin Institute 352, 2015): where
they fall fast, the degree grows; where they do not, the interval is cut. A control that goes from one
bound to the other within an interval is a switch: the integral of the control tells when, and there
the interval is cut. One that goes to and fro from node to node lies on a singular arc, where a mesh
gains by chattering what the problem itself would not: there the controls are held to half the degree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from ..control_definition import Phase
from ..control_plan import ControlPlan, PhasePlan, interpolation
from .mesh import Mesh
from .schemes import gauss_points, integration

if TYPE_CHECKING:
    from ..optimal_control import OptimalControlProblem

__all__ = ["Report", "Rules", "examined", "next_meshes"]

Floats = NDArray[np.float64]

#: Share of the tolerance that one interval's error may use up: errors add up along the motion.
SHARE = 0.2
#: Share of it that a violation between the nodes may use up.
ALLOWED = 0.8
#: Share of the tolerance by which the objective may still change from mesh to mesh.
SETTLED = 0.1
#: Decades by which Legendre coefficients must fall a degree for an interval to count as smooth.
SMOOTH = 0.5
#: Nodes beyond an interval's own on which its error is measured.
FINER = 4
#: How near a bound, as a share of the range between both, a control counts as saturated.
SATURATED = 0.02
#: How near its bound, relative to its typical size, a constraint counts as binding at a node.
BINDING = 1e-4
#: Share of a control's range that a step from node to node must take to count as chatter, and how
#: often the steps must turn.
STEP, TURNS = 0.15, 2
#: Share of what an interval may err below which it may be merged.
AMPLE = 0.05
#: Nodes at least where controls are held calm.
CALM = 6
#: Shortest interval, as a share of the phase.
SHORTEST = 1e-9
#: How well two intervals' polynomials must agree with a joint one to be merged, in shares of what one may err.
MERGED = 0.02


@dataclass(frozen=True)
class Rules:
    """How meshes of a scheme are refined.

    Parameters
    ----------
    split : bool
        Whether intervals may be cut; else only the degree grows.
    fixed_degree : int, optional
        Nodes of every interval, for schemes whose degree cannot grow.
    order : int
        Order of such a scheme: its error falls as the length to this power.
    least_degree, most_degree : int
        Nodes of an interval at least and at most.
    """

    split: bool = True
    fixed_degree: int | None = None
    order: int = 4
    least_degree: int = 4
    most_degree: int = 16


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


def examined(phase: Phase, part: PhasePlan, parameters: Floats) -> Report:
    """Return the report on one phase of a plan."""
    count = part.states.intervals
    size = np.maximum(1.0, np.max([np.abs(v).max(axis=0) for v in part.states.values], axis=0))
    errors, violations, places = np.zeros(count), np.zeros(count), np.zeros(count)
    decays, chatters = np.zeros(count), np.zeros(count, bool)
    cuts: list[float | None] = []
    windows: list[tuple[tuple[float, float], ...]] = []
    whole = _integral_sizes(phase, part, parameters)
    for k in range(count):
        degree = part.controls.nodes[k].size
        fine, onto = integration(max(part.states.nodes[k].size, degree) + FINER)
        half = 0.5 * (part.states.knots[k + 1] - part.states.knots[k])
        t = part.states.knots[k] + half * (fine + 1.0)
        x, u = part.states.on(k, fine), part.controls.on(k, fine)
        rate, _, integrand = _evaluated(phase, t, x, u, parameters)
        begin = part.states.on(k, [-1.0])
        moved = begin + half * (onto @ rate.T)
        there = part.states.on(k, np.append(fine, 1.0))
        off = (np.abs(moved - there) / size).max(axis=1)
        errors[k] = off.max()
        if integrand.size:
            at, weights = gauss_points(degree)
            tt = part.states.knots[k] + half * (at + 1.0)
            _, _, coarse = _evaluated(
                phase, tt, part.states.on(k, at), part.controls.on(k, at), parameters
            )
            gap = np.abs(coarse @ weights - integrand @ gauss_points(fine.size)[1]) * half
            errors[k] = max(errors[k], float((gap / whole).max()))
        # The residual between two neighbours on the fine grid shows where the motion is wrong.
        steps = np.abs(np.diff(np.append(0.0, off[:-1])))
        places[k] = fine[int(steps.argmax())]
        violations[k], where = _violated(phase, part, parameters, k)
        if violations[k] > errors[k]:
            places[k] = where
        decays[k] = _decay(part.controls.nodes[k], part.controls.values[k], phase)
        cuts.append(_switch(phase, part, k))
        windows.append(_windows(phase, part, parameters, k))
        chatters[k] = _chatters(phase, part.controls.values[k])
    bad = ~np.isfinite(errors)
    errors[bad] = np.inf
    return Report(errors, violations, decays, tuple(cuts), tuple(windows), chatters, places)


def _evaluated(
    phase: Phase, t: Floats, x: Floats, u: Floats, p: Floats
) -> tuple[Floats, Floats, Floats]:
    count = t.size
    found = phase.function.map(count)(
        t[None, :], x.T, u.T.reshape(u.shape[1], count), np.repeat(p[:, None], count, axis=1)
    )
    rate, path, integrand = (np.array(part, float) for part in found[:3])
    return rate, path, integrand


def _integral_sizes(phase: Phase, part: PhasePlan, p: Floats) -> Floats:
    if not phase.integrals:
        return np.ones(0)
    total = np.zeros(phase.integrals)
    for k in range(part.states.intervals):
        at, weights = gauss_points(part.controls.nodes[k].size)
        half = 0.5 * (part.states.knots[k + 1] - part.states.knots[k])
        t = part.states.knots[k] + half * (at + 1.0)
        found = _evaluated(phase, t, part.states.on(k, at), part.controls.on(k, at), p)[2]
        total += half * np.abs(found) @ weights
    return np.maximum(1.0, total)


def _violated(phase: Phase, part: PhasePlan, p: Floats, k: int) -> tuple[float, float]:
    """Return the largest relative violation between the nodes of interval k, and where it lies."""
    count = 3 * part.states.nodes[k].size + 8
    tau = -np.cos(np.pi * np.arange(count) / (count - 1))
    half = 0.5 * (part.states.knots[k + 1] - part.states.knots[k])
    t = part.states.knots[k] + half * (tau + 1.0)
    x = part.states.on(k, tau)
    tables = [(x.T, phase.stacked("states", "lower"), phase.stacked("states", "upper"))]
    if phase.paths:
        path = _evaluated(phase, t, x, part.controls.on(k, tau), p)[1]
        tables.append((path, phase.stacked("paths", "lower"), phase.stacked("paths", "upper")))
    worst, where = 0.0, 0.0
    for values, low, high in tables:
        for edge, sign in ((low, -1.0), (high, 1.0)):
            known = np.isfinite(edge)
            if known.any():
                scale = np.maximum(1.0, np.abs(edge[known]))
                off = (sign * (values[known] - edge[known, None]) / scale[:, None]).max(axis=0)
                if np.isnan(off).any():
                    return np.inf, 0.0
                at = int(off.argmax())
                if off[at] > worst:
                    worst, where = float(off[at]), float(tau[at])
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


def _windows(phase: Phase, part: PhasePlan, p: Floats, k: int) -> tuple[tuple[float, float], ...]:
    """Return the pairs of neighbouring nodes between which a constraint begins or ceases to bind."""
    tau = part.controls.nodes[k]
    half = 0.5 * (part.states.knots[k + 1] - part.states.knots[k])
    t = part.states.knots[k] + half * (tau + 1.0)
    x, u = part.states.on(k, tau), part.controls.on(k, tau)
    tables = [("states", x.T), ("controls", u.T)]
    if phase.paths:
        tables.append(("paths", _evaluated(phase, t, x, u, p)[1]))
    changes = np.zeros(max(tau.size - 1, 0), bool)
    for what, values in tables:
        scale = BINDING * phase.stacked(what, "scale")[:, None]
        for side in ("lower", "upper"):
            edge = phase.stacked(what, side)[:, None]
            with np.errstate(invalid="ignore"):
                binds = np.abs(values - edge) <= scale
            if tau.size > 1:
                changes |= (binds[:, 1:] != binds[:, :-1]).any(axis=0)
    return tuple((float(tau[j]), float(tau[j + 1])) for j in np.flatnonzero(changes))


def _chatters(phase: Phase, values: Floats) -> bool:
    """Return whether a control goes to and fro from node to node."""
    low, high = phase.stacked("controls", "lower"), phase.stacked("controls", "upper")
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
    low, high = phase.stacked("controls", "lower"), phase.stacked("controls", "upper")
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
        return float(np.clip(2.0 * share - 1.0, -0.999, 0.999))
    return None


def next_meshes(
    model: OptimalControlProblem,
    plan: ControlPlan,
    meshes: Sequence[Mesh],
    rules: Rules,
    tolerance: float,
    change: float,
) -> tuple[Mesh, ...] | None:
    """Return finer meshes, None where the plan verifies and its objective has settled.

    Parameters
    ----------
    model : OptimalControlProblem
        Whose verification decides.
    plan : ControlPlan
        The plan on `meshes`.
    meshes : sequence of Mesh
        One a phase.
    rules : Rules
        What may be done.
    tolerance : float
        Largest violation accepted.
    change : float
        By how much the objective differs from the last mesh's, relative.
    """
    parameters = np.concatenate([*plan.parameters.values(), np.empty(0)])
    reports = [
        examined(phase, part, parameters)
        for phase, part in zip(model.definition.phases, plan.phases, strict=True)
    ]
    limit = SHARE * tolerance
    worst = max(float(report.worst.max()) for report in reports)
    if worst <= limit:
        verified = model.verify(plan, tolerance=tolerance).ok
        if verified and change <= SETTLED * tolerance:
            return None
        # Each interval is good enough by itself, yet not all together: ask more of the worst.
        limit = max(0.1 * worst, 1e-3 * limit) if not verified else max(1e-2 * limit, 1e-2 * worst)
    finer = []
    for mesh, report, part in zip(meshes, reports, plan.phases, strict=True):
        finer.append(_refined(mesh, report, part, rules, limit, merge=worst > SHARE * tolerance))
    if all(new.same(old) for new, old in zip(finer, meshes, strict=True)):
        return _denser(meshes, rules)
    return tuple(finer)


def _denser(meshes: Sequence[Mesh], rules: Rules) -> tuple[Mesh, ...] | None:
    """Return meshes with two more nodes an interval, or twice the intervals where none may be had."""
    finer = []
    for mesh in meshes:
        assert mesh.calm is not None
        if rules.fixed_degree is None and (mesh.degrees + 2 <= rules.most_degree).all():
            finer.append(Mesh(mesh.fractions, mesh.degrees + 2, mesh.calm))
        elif rules.split:
            middle = 0.5 * (mesh.fractions[1:] + mesh.fractions[:-1])
            fractions = np.sort(np.concatenate([mesh.fractions, middle]))
            finer.append(Mesh(fractions, np.repeat(mesh.degrees, 2), np.repeat(mesh.calm, 2)))
        else:
            return None
    return tuple(finer)


def _refined(
    mesh: Mesh, report: Report, part: PhasePlan, rules: Rules, limit: float, merge: bool
) -> Mesh:
    cuts: list[float] = [0.0]
    degrees: list[int] = []
    calm: list[bool] = []
    touched: list[bool] = []
    assert mesh.calm is not None
    for k in range(mesh.intervals):
        begin, end = mesh.fractions[k], mesh.fractions[k + 1]
        degree, quiet = int(mesh.degrees[k]), bool(mesh.calm[k])
        if (
            report.chatters[k]
            and not quiet
            and report.worst[k] > limit
            and rules.fixed_degree is None
        ):
            inner: list[float] = []
            own, quiet = [max(degree, CALM)], True
        else:
            inner, own = _decided(degree, report, k, rules, limit)
        places = begin + 0.5 * (np.array([*inner, 1.0]) + 1.0) * (end - begin)
        places[-1] = end
        if (np.diff(np.append(begin, places)) < SHORTEST).any():
            places, own = np.array([end]), [degree]
        cuts += places.tolist()
        degrees += own
        calm += [quiet] * len(own)
        changed = len(own) > 1 or own[0] != degree or quiet != mesh.calm[k]
        # Only what is plainly smooth, and better than need be, may be merged with its neighbour.
        ample = report.worst[k] <= AMPLE * limit and report.decays[k] >= SMOOTH
        touched += [bool(changed) or not ample or bool(report.windows[k])] * len(own)
    made = Mesh(np.array(cuts), np.array(degrees), np.array(calm))
    if merge and rules.split and not all(touched):
        return _merged(made, touched, part, limit)
    return made


def _decided(
    degree: int, report: Report, k: int, rules: Rules, limit: float
) -> tuple[list[float], list[int]]:
    """Return where interval k is cut, in [-1, 1], and the degrees of its parts."""
    worst = report.worst[k]
    if worst <= limit:
        return [], [degree]
    ratio = min(worst / limit, 1e12)
    cut = report.cuts[k]
    if rules.fixed_degree is not None:
        if cut is not None:
            return _around(cut), [degree] * (len(_around(cut)) + 1)
        parts = int(np.clip(np.ceil(ratio ** (1.0 / rules.order)), 2, 5))
        return np.linspace(-1.0, 1.0, parts + 1)[1:-1].tolist(), [degree] * parts
    if not rules.split:
        more = max(2, int(np.ceil(0.25 * degree)))
        return [], [min(degree + more, rules.most_degree)]
    if cut is not None:
        low = max(rules.least_degree, min(degree, 5))
        inner = _around(cut)
        return inner, [low] * (len(inner) + 1)
    low = max(rules.least_degree, min(degree, 5))
    windows = report.windows[k]
    if windows and (degree > rules.least_degree + 1 or report.decays[k] < SMOOTH):
        # Where a constraint begins or ceases to bind, some derivative of the motion jumps.
        edges = sorted({edge for window in windows for edge in window if abs(edge) < 0.99})
        if 0 < len(edges) <= 6:
            return edges, [low] * (len(edges) + 1)
    if report.decays[k] >= SMOOTH:
        # A decade more than needed: an interval that must be looked at once more costs another mesh.
        more = int(np.clip(np.ceil((np.log10(ratio) + 1.0) / report.decays[k]), 2, 6))
        if degree + more <= rules.most_degree:
            return [], [degree + more]
        half = max(rules.least_degree, int(np.ceil(0.7 * degree)))
        return [0.0], [half, half]
    # Not smooth, and no switch: enclose the place where it is worst, as closely as the nodes tell.
    place, gap = float(report.places[k]), min(0.5, 1.5 / degree)
    inner = [c for c in (place - gap, place + gap) if abs(c) < 1.0 - 0.5 * gap]
    inner = inner or [0.0]
    return inner, [low] * (len(inner) + 1)


def _around(cut: float) -> list[float]:
    """Return the cut at a switch, moved off the ends."""
    return [float(np.clip(cut, -0.995, 0.995))]


def _merged(mesh: Mesh, touched: list[bool], part: PhasePlan, limit: float) -> Mesh:
    """Join neighbours that were left alone and that one polynomial of their degree fits."""
    kept, own, calm = [0.0], [], []
    states, span = part.states, part.duration
    scale = np.maximum(1.0, np.max([np.abs(v).max(axis=0) for v in states.values], axis=0))
    assert mesh.calm is not None
    k = 0
    while k < mesh.intervals:
        degree, last = int(mesh.degrees[k]), k + 1
        if last < mesh.intervals and not touched[k] and not touched[last]:
            joint = max(degree, int(mesh.degrees[last]))
            low, high = (part.start + span * f for f in mesh.fractions[[k, k + 2]])
            nodes, _ = gauss_points(joint + 1)
            fine, _ = gauss_points(3 * joint + 4)
            matrix = interpolation(nodes, fine)
            t, tt = (low + 0.5 * (n + 1.0) * (high - low) for n in (nodes, fine))
            fits = (np.abs(matrix @ states(t) - states(tt)) / scale).max() <= MERGED * limit
            if fits and part.controls.size:
                values = part.controls(tt)
                wide = np.maximum(1.0, np.abs(values).max(axis=0))
                fits = (np.abs(matrix @ part.controls(t) - values) / wide).max() <= limit
            if fits:
                degree, last = joint, k + 2
        own.append(degree)
        calm.append(bool(mesh.calm[k:last].any()))
        kept.append(float(mesh.fractions[last]))
        k = last
    return Mesh(np.array(kept), np.array(own), np.array(calm))
