"""hp-refinement: where a mesh is too coarse, and whether degree or intervals should grow.

Where an interval errs too much and its controls are smooth, the degree grows; where they are not, it is
cut. A control that goes from one bound to the other within an interval is a switch: the integral of the
control tells when, and there the interval is cut. Where a constraint begins or ceases to bind between
two nodes, some derivative of the motion jumps, and the two nodes become the ends of an interval. A
control that goes to and fro from node to node lies on a singular arc, where a mesh gains by chattering
what the problem itself would not: there the controls are held to half the degree. Neighbours that one
polynomial fits are merged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..lagrange import interpolation
from ..plan import ControlPlan, PhasePlan
from .mesh import Mesh
from .report import SHARE, Report, examine
from .schemes import gauss_points

if TYPE_CHECKING:
    from ..model import OptimalControlProblem

__all__ = ["Rules", "next_meshes"]

Floats = NDArray[np.float64]

#: Share of the tolerance by which the objective may still change from mesh to mesh.
SETTLED = 0.1
#: Decades by which Legendre coefficients must fall a degree for an interval to count as smooth.
SMOOTH = 0.5
#: Share of what an interval may err below which it may be merged.
AMPLE = 0.05
#: How well two intervals' polynomials must agree with a joint one to be merged, in shares of what one
#: may err.
MERGED = 0.02
#: Nodes at least where controls are held calm.
CALM = 6
#: Shortest interval, as a share of the phase.
SHORTEST = 1e-9


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
        examine(phase, part, parameters)
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
        finer.append(_refine(mesh, report, part, rules, limit, merge=worst > SHARE * tolerance))
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


def _refine(
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
            inner, own = _decide(degree, report, k, rules, limit)
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
        return _merge(made, touched, part, limit)
    return made


def _decide(
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
            return [cut], [degree] * 2
        parts = int(np.clip(np.ceil(ratio ** (1.0 / rules.order)), 2, 5))
        return np.linspace(-1.0, 1.0, parts + 1)[1:-1].tolist(), [degree] * parts
    if not rules.split:
        more = max(2, int(np.ceil(0.25 * degree)))
        return [], [min(degree + more, rules.most_degree)]
    low = max(rules.least_degree, min(degree, 5))
    if cut is not None:
        return [cut], [low] * 2
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


def _merge(mesh: Mesh, touched: list[bool], part: PhasePlan, limit: float) -> Mesh:
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
