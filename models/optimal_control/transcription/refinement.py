"""hp-refinement: choice of intervals to refine, and of a higher degree or a cut.

An interval with a large error grows in degree if its controls are smooth, and is cut otherwise. A control that moves
from one bound to the other within an interval is a switch. The integral of the control gives the switching time, and the
interval is cut there. If a constraint becomes active or inactive between two nodes, a derivative of the motion jumps, and
the two nodes become ends of an interval. A control that alternates from node to node is on a singular arc. There a mesh
gains by chattering what the problem itself does not allow. The controls are then restricted to half the degree.
Neighbours that one polynomial fits are merged.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..hamiltonian import hamiltonian_gains, misplaced_switches
from ..lagrange import interpolation
from ..plan import ControlPlan, PhasePlan
from ..sizes import PhaseSizes
from .mesh import Mesh
from .report import ALLOWED, SHARE, Report, examine
from .schemes import gauss_points

if TYPE_CHECKING:
    from ..model import OptimalControlProblem

__all__ = ["Finding", "History", "Rules", "denser", "next_meshes", "relative_change"]

Floats = NDArray[np.float64]
#: Meshes that examine the optimality of a plan, and the reason.
Examination = tuple[tuple[Mesh, ...], str]

#: Largest change of a converged objective from mesh to mesh, as a share of the tolerance.
SETTLED = 0.1
#: Share of the tolerance within which a plan must verify to make up for an interval that is less accurate. With
#: the whole tolerance the thrust of the moon lander was 2.9986 instead of 3.
WHOLE = 0.2
#: Smallest and largest degree of the states on intervals with linear controls.
LEAST_LINEAR, MOST_LINEAR = 4, 12
#: Smallest decay of Legendre coefficients of a smooth interval, in decades per degree.
SMOOTH = 0.5
#: Share of the allowed error below which an interval may be merged.
AMPLE = 0.05
#: Largest difference between the polynomials of two intervals and a joint one for merging, as a share
#: of the allowed error.
MERGED = 0.02
#: Smallest number of nodes of intervals with calm controls.
CALM = 6
#: Shortest interval, relative to the phase.
SHORTEST = 1e-9
#: Gain predicted by the Hamiltonian above which a converged objective is examined again, and change of
#: the objective up to which the prediction was wrong, in multiples of the tolerance.
PROMISED, CONFIRMED = 3.0, 0.3
#: Predicted gain that releases a calm interval on a mesh that is still too coarse, same unit. On singular
#: arcs, whose multipliers are noise, 2 to 100 were measured; at jumps of a control, 400 to 2e5.
RELEASED = 300.0
#: Share of the largest predicted gain below which an interval stays unchanged in this examination.
PROMISING = 0.1
#: Descriptions of actions on intervals.
SWITCH, RAISED = "cut at a switch", "raised in degree"
#: Share of an interval's error that remains if refinement did not help, and share of a control's size
#: up to which its high degrees may be noise.
STAYS, NOISE = 0.3, 1e-2
#: Largest share of an interval that a cut may leave in the part with its error.
MOST = 0.75


@dataclass(frozen=True)
class Rules:
    """Rules for the refinement of meshes of a scheme.

    Without `split`, intervals are not cut, and only the degree grows. The degree is the number of nodes
    per interval. The error of a scheme of fixed degree is proportional to the length to the power
    `order`.
    """

    split: bool = True
    fixed_degree: int | None = None
    order: int = 4
    least_degree: int = 4
    most_degree: int = 16


@dataclass(frozen=True, eq=False)
class History:
    """Plan of the previous meshes, its objective, and the errors of its intervals per phase.

    `accepted` is the objective, if the plan was acceptable except for a gain predicted by the
    Hamiltonian. `further` are the examinations that follow if the prediction was wrong. `verified` states whether
    the plan verified: it is good enough if a finer mesh has the same objective.
    """

    plan: ControlPlan
    objective: float
    meshes: tuple[Mesh, ...]
    errors: tuple[Floats, ...] = ()
    accepted: float | None = None
    further: tuple[Examination, ...] = ()
    verified: bool = False


@dataclass(frozen=True)
class Finding:
    """Assessment of a plan on its meshes, and the resulting action.

    `meshes` is None if the plan is good enough, or no finer mesh is possible. `error` is the largest relative
    error or violation of an interval, and `change` the relative difference of the objective from that of the last
    meshes, infinite for the first ones. `verified` is None if the verification was skipped. `settled` states
    whether this plan, or the one accepted before, is good enough.
    """

    meshes: tuple[Mesh, ...] | None
    error: float
    words: str
    change: float = np.inf
    verified: bool | None = None
    errors: tuple[Floats, ...] = ()
    settled: bool = False
    accepted: float | None = None
    further: tuple[Examination, ...] = ()

    def limited(self, rounds: int, most_rounds: int, most_nodes: int) -> Finding:
        """Return the finding without its meshes if they exceed a limit.

        `rounds` meshes were solved so far; `most_nodes` limits the collocation nodes of all phases.
        """
        if self.meshes is None:
            return self
        if rounds >= most_rounds:
            return replace(self, meshes=None, words=f"given up after {rounds} meshes")
        nodes = sum(mesh.nodes for mesh in self.meshes)
        if nodes > most_nodes:
            words = f"given up: {nodes} nodes are needed, {most_nodes} are allowed"
            return replace(self, meshes=None, words=words)
        return self


def relative_change(size: float, new: float, old: float) -> float:
    """Return the absolute difference of two objectives relative to `size`."""
    return abs(new - old) / size


def next_meshes(
    model: OptimalControlProblem,
    plan: ControlPlan,
    meshes: Sequence[Mesh],
    rules: Rules,
    tolerance: float,
    objectives: tuple[float, float],
    former: History | None,
    strains: Sequence[Floats],
    verifies: Callable[[ControlPlan, float], bool],
) -> Finding:
    """Return finer meshes, or none if the plan verifies and its objective has converged.

    The share of an interval in the tolerance estimates the accumulation of errors. Once the objective has
    converged, a plan without an error above the tolerance is verified in any case, within a share of it.
    `verifies` decides, for a plan and a tolerance. Costates of the plan, if available, indicate whether it is
    optimal. `objectives` are the objective and its size, and `strains` the possible gains per interval of each
    phase without the rows that keep controls calm (:meth:`~.layout.Layout.strains`).
    """
    objective, size = objectives
    parameters = np.concatenate([*plan.parameters.values(), np.empty(0)])
    reports = [
        examine(phase, part, parameters)
        for phase, part in zip(model.definition.phases, plan.phases, strict=True)
    ]
    limit = SHARE * tolerance
    worst = max(float(report.worst.max()) for report in reports)
    change = np.inf if former is None else relative_change(size, objective, former.objective)
    is_accurate, converged = worst <= limit, change <= SETTLED * tolerance
    verified = verifies(plan, tolerance) if is_accurate else None
    if verified is None and converged and all(report.is_within(tolerance) for report in reports):
        verified = verifies(plan, WHOLE * tolerance) or None
    errors = tuple(report.worst for report in reports)
    finding = Finding(None, worst, "verified and settled", change, verified, errors)
    if meshes[0].linear:
        if plan.phases[0].costates is None:  # without multipliers: the cost is unknown
            strains = [np.full(mesh.intervals, np.inf) for mesh in meshes]
        strain = sum(float(strain_of.sum()) for strain_of in strains)
        if verified and min(change, strain / size) <= SETTLED * tolerance:
            return replace(finding, settled=True)
        limit *= 0.1 if verified is False else 1.0
        gainful = strain > SETTLED * tolerance * size
        linear = [
            _refine_linear(mesh, report, gain * gainful, limit)
            for mesh, report, gain in zip(meshes, reports, strains, strict=True)
        ]
        text = f"linear controls may cost {strain:.2g}: the intervals with the largest share halved"
        return replace(finding, meshes=tuple(linear), words=text)
    accepted = None if former is None else former.accepted
    if accepted is not None:
        if relative_change(size, objective, accepted) <= CONFIRMED * tolerance:
            assert former is not None
            return _examined(finding, "the objective stays", accepted, former.further)
        # The examination did find a gain.
    why = ""
    is_settled = converged and (verified or (former is not None and former.verified))
    if is_settled:
        which = "verified" if verified else "the plan of the mesh before verified"
        further = _examinations(model, plan, meshes, rules, tolerance * size, former, strains)
        return _examined(finding, f"{which} and settled", objective, further)
    if verified is not None:
        # Each interval is good enough, but not all together: refine the worst further.
        limit = max(0.1 * worst, 1e-3 * limit) if not verified else max(1e-2 * limit, 1e-2 * worst)
        why = "the objective has not settled: " if verified else "the plan does not verify: "
    finer_meshes, words = [], []
    for k, (mesh, report, part) in enumerate(zip(meshes, reports, plan.phases, strict=True)):
        restless, stays = report.chatters, np.zeros(mesh.intervals, bool)
        if former is not None:
            # Finer intervals that are as inaccurate as before: cutting does not help against noise of controls on a
            # singular arc, and a degree does not help against a violation at an end, which is no node.
            stays = _unimproved(mesh, report, former.meshes[k], former.errors[k])
            restless = restless | (stays & (report.tails <= NOISE) & (report.decays < SMOOTH))
            stays &= report.worst > report.errors
        if rules.fixed_degree is not None:
            restless = np.zeros_like(restless)
        released = mesh.calm & (strains[k] > RELEASED * tolerance * size)
        merge = worst > SHARE * tolerance
        finer, done = _refine(mesh, report, part, rules, limit, restless, released, stays, merge)
        finer_meshes.append(finer)
        words.append(f"phase {part.name!r}: {done}" if done and len(meshes) > 1 else done)
    if all(new.same(old) for new, old in zip(finer_meshes, meshes, strict=True)):
        refined = denser(meshes, rules)
        done = "no finer mesh is possible" if refined is None else "all intervals refined"
        return replace(finding, meshes=refined, words=why + done)
    text = why + "; ".join(word for word in words if word)
    return replace(finding, meshes=tuple(finer_meshes), words=text)


def _examined(
    finding: Finding, words: str, accepted: float, further: tuple[Examination, ...]
) -> Finding:
    """Return the finding with the next examination of the `accepted` objective, settled if none is left."""
    if not further:
        return replace(finding, settled=True, words=words)
    (meshes, reason), *others = further
    words = f"{words}, but {reason}"
    return replace(finding, meshes=meshes, words=words, accepted=accepted, further=tuple(others))


def _examinations(
    model: OptimalControlProblem,
    plan: ControlPlan,
    meshes: Sequence[Mesh],
    rules: Rules,
    accuracy: float,
    former: History | None,
    strains: Sequence[Floats],
) -> tuple[Examination, ...]:
    """Return the examinations of a plan's optimality; one follows if the one before found no gain.

    A converged objective covers neither intervals that the last meshes left unchanged nor a restriction that all
    meshes share. Intervals are cut where switching functions vanish if switches at other knots cost more than the
    `accuracy` of the objective. Calm controls are released if their rows restrict the objective, and unchanged
    intervals halved if the Hamiltonian predicts a gain there.
    """
    result, chosen = list[Examination](), _promising(strains, accuracy)
    switches = misplaced_switches(model, plan) if rules.split else ()
    gains = [gain for of_phase in switches for *_, gain in of_phase]
    if sum(gains) > accuracy:
        least = PROMISING * max(gains)
        cut = tuple(
            _cut_switches(mesh, [item[:2] for item in of_phase if item[2] >= least], rules)
            for mesh, of_phase in zip(meshes, switches, strict=True)
        )
        result.append((cut, f"switches at other instants may gain {sum(gains):.2g}: cut there"))
    words = "the Hamiltonian is not constant: halved where it changes"
    if chosen is not None:
        strain = sum(float(strain_of.sum()) for strain_of in strains)
        words = f"controls held calm may cost {strain:.2g}: released"
        if not rules.split:
            released = tuple(Mesh(mesh.fractions, mesh.degrees) for mesh in meshes)
            return (*result, (released, words))
    elif rules.split and former is not None:
        parts = zip(hamiltonian_gains(model, plan), meshes, former.meshes, strict=True)
        changes = [
            np.zeros(mesh.intervals) if gain is None else np.where(mesh.unchanged(old), gain, 0.0)
            for gain, mesh, old in parts
        ]
        chosen = _promising(changes, accuracy)
    if chosen is not None:
        pairs = zip(meshes, chosen, strict=True)
        result.append((tuple(mesh.halved(rows) for mesh, rows in pairs), words))
    return tuple(result)


def _cut_switches(mesh: Mesh, switches: Sequence[tuple[int, float]], rules: Rules) -> Mesh:
    """Return the mesh with its intervals also cut at the given places."""
    cuts, degrees, calm = [0.0], list[int](), list[bool]()
    for k, degree in enumerate(mesh.degrees.tolist()):
        begin, end = mesh.fractions[k : k + 2].tolist()
        inside = {begin + 0.5 * (place + 1.0) * (end - begin) for j, place in switches if j == k}
        places = sorted({*inside, end})
        if min(np.diff([begin, *places])) < SHORTEST:
            places = [end]
        is_cut = len(places) > 1
        low = rules.fixed_degree or max(rules.least_degree, min(degree, 5))
        cuts += places
        degrees += [low if is_cut else degree] * len(places)
        calm += [bool(mesh.calm[k]) and not is_cut] * len(places)
    return Mesh(np.array(cuts), np.array(degrees), np.array(calm))


def _refine_linear(mesh: Mesh, report: Report, gains: Floats, limit: float) -> Mesh:
    """Return a finer mesh with linear controls: halved at the largest gains, of higher degree at errors."""
    ratio = np.clip(report.errors / limit, 1.0, 1e12)
    # One degree more than a decade per degree needs, because another examination costs a mesh.
    extra = np.minimum(np.ceil(np.log10(ratio)) + (ratio > 1.0), 5).astype(int)
    degrees = mesh.degrees + extra
    halved = (gains > 0) & (gains >= PROMISING * gains.max())
    # Of a line, no degree of the states keeps a constraint between the nodes.
    halved |= (degrees > MOST_LINEAR) | (report.violations * (SHARE / ALLOWED) > limit)
    least = np.maximum(7 * degrees // 10, LEAST_LINEAR)
    degrees = np.where(halved & (extra == 0), least, np.minimum(degrees, MOST_LINEAR))
    return Mesh(mesh.fractions, degrees, mesh.calm, True).halved(halved, mesh.calm)


def _promising(gains: Sequence[Floats], accuracy: float) -> list[NDArray[np.bool_]] | None:
    """Return the intervals with the largest gains; None if all gains together are too small."""
    if not sum(float(gain.sum()) for gain in gains) > PROMISED * accuracy:
        return None
    smallest = PROMISING * max(float(gain.max()) for gain in gains)
    return [gain >= smallest for gain in gains]


def denser(meshes: Sequence[Mesh], rules: Rules) -> tuple[Mesh, ...] | None:
    """Return meshes with two more nodes per interval, or twice the intervals if that is not allowed."""
    finer = []
    for mesh in meshes:
        grows = rules.fixed_degree is None and not mesh.linear
        if grows and (mesh.degrees + 2 <= rules.most_degree).all():
            finer.append(Mesh(mesh.fractions, mesh.degrees + 2, mesh.calm))
        elif rules.split:
            finer.append(mesh.halved(np.ones(mesh.intervals, bool), mesh.calm))
        else:
            return None
    return tuple(finer)


def _unimproved(mesh: Mesh, report: Report, old: Mesh, errors: Floats) -> NDArray[np.bool_]:
    """Return the intervals without a window whose refinement left most of the error of the interval before."""
    middle = 0.5 * (mesh.fractions[1:] + mesh.fractions[:-1])
    parent = errors[np.searchsorted(old.fractions, middle) - 1]
    stays = ~mesh.unchanged(old) & (report.worst >= STAYS * parent)
    return stays & [not windows for windows in report.windows]


def _refine(
    mesh: Mesh,
    report: Report,
    part: PhasePlan,
    rules: Rules,
    limit: float,
    restless: NDArray[np.bool_],
    released: NDArray[np.bool_],
    stays: NDArray[np.bool_],
    merge: bool,
) -> tuple[Mesh, str]:
    """Return a finer mesh of one phase, and a description of the action.

    Controls are held calm in `restless` intervals with a large error, until they are `released`. The degree does
    not rise if a violation `stays`.
    """
    done: Counter[str] = Counter()
    cuts: list[float] = [0.0]
    degrees: list[int] = []
    calm: list[bool] = []
    touched: list[bool] = []
    for k in range(mesh.intervals):
        begin, end = mesh.fractions[k], mesh.fractions[k + 1]
        degree, quiet = int(mesh.degrees[k]), bool(mesh.calm[k])
        if released[k]:
            inside = [0.0] if rules.split else []
            parts, quiet, word = [degree] * (len(inside) + 1), False, "released"
        elif restless[k] and not quiet and report.worst[k] > limit:
            inside, parts, quiet, word = [], [max(degree, CALM)], True, "held calm"
        else:
            inside, parts, word = _decide(degree, report, k, rules, limit, bool(stays[k]))
        places = begin + 0.5 * (np.array([*inside, 1.0]) + 1.0) * (end - begin)
        places[-1] = end
        if (np.diff(np.append(begin, places)) < SHORTEST).any():
            places, parts, word = np.array([end]), [degree], ""
        done[word] += 1
        cuts += places.tolist()
        degrees += parts
        calm += [quiet] * len(parts)
        changed = len(parts) > 1 or parts[0] != degree or quiet != mesh.calm[k]
        # Only intervals that are clearly smooth and better than needed may be merged.
        ample = report.worst[k] <= AMPLE * limit and report.decays[k] >= SMOOTH
        touched += [bool(changed) or not ample or bool(report.windows[k])] * len(parts)
    finer = Mesh(np.array(cuts), np.array(degrees), np.array(calm))
    if merge and rules.split and not all(touched):
        merged = _merge(finer, touched, part, report.sizes, limit)
        done["merged away"], finer = finer.intervals - merged.intervals, merged
    words = [f"{count} {word}" for word, count in done.items() if word and count]
    return finer, "intervals: " + ", ".join(words) if words else ""


def _decide(
    degree: int, report: Report, k: int, rules: Rules, limit: float, stays: bool
) -> tuple[list[float], list[int], str]:
    """Return the cuts of interval k in [-1, 1], the degrees of its parts, and the name of the action."""
    worst = report.worst[k]
    if worst <= limit:
        return [], [degree], ""
    ratio = min(worst / limit, 1e12)
    cut = report.cuts[k]
    if rules.fixed_degree is not None:
        if cut is not None:
            return [cut], [degree] * 2, SWITCH
        parts = int(np.clip(np.ceil(ratio ** (1.0 / rules.order)), 2, 5))
        return np.linspace(-1.0, 1.0, parts + 1)[1:-1].tolist(), [degree] * parts, "cut evenly"
    if not rules.split:
        extra = max(2, int(np.ceil(0.25 * degree)))
        return [], [min(degree + extra, rules.most_degree)], RAISED
    low = max(rules.least_degree, min(degree, 5))
    if cut is not None:
        return [cut], [low] * 2, SWITCH
    windows = report.windows[k]
    if windows and (degree > rules.least_degree + 1 or report.decays[k] < SMOOTH):
        # A derivative of the motion jumps where a constraint becomes active or inactive.
        edges = sorted({edge for window in windows for edge in window if abs(edge) < 0.99})
        if 0 < len(edges) <= 6:
            edges = _limit_part(edges, float(report.places[k]))
            return edges, [low] * (len(edges) + 1), "cut where a bound begins or ceases to bind"
    if report.decays[k] >= SMOOTH and not stays:
        # One decade more than needed, because another examination of the interval costs a mesh.
        extra = int(np.clip(np.ceil((np.log10(ratio) + 1.0) / report.decays[k]), 2, 6))
        if degree + extra <= rules.most_degree:
            return [], [degree + extra], RAISED
        half = max(rules.least_degree, int(np.ceil(0.7 * degree)))
        return [0.0], [half, half], "halved at the highest degree"
    # Not smooth and no switch: enclose the place of the largest error as closely as the nodes allow.
    place, gap = float(report.places[k]), min(0.5, 1.5 / degree)
    inner = [c for c in (place - gap, place + gap) if abs(c) < 1.0 - 0.5 * gap]
    inner = _limit_part(inner or [0.0], place)
    return inner, [low] * (len(inner) + 1), "cut about where the error is largest"


def _limit_part(inner: list[float], place: float) -> list[float]:
    """Return cuts in [-1, 1] that limit the part around `place` to a share :data:`MOST` of the interval."""
    edges = [-1.0, *inner, 1.0]
    index = int(np.clip(np.searchsorted(edges, place), 1, len(edges) - 1))
    low, high = edges[index - 1], edges[index]
    return sorted([*inner, 0.5 * (low + high)]) if high - low > 2.0 * MOST else inner


def _merge(
    mesh: Mesh, touched: list[bool], part: PhasePlan, sizes: PhaseSizes, limit: float
) -> Mesh:
    """Merge unchanged neighbours that one polynomial of their degree fits."""
    ends, joint_degrees, calm = [0.0], [], []
    states, span = part.states, part.duration
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
            fits = (np.abs(matrix @ states(t) - states(tt)) / sizes.states).max() <= MERGED * limit
            if fits and part.controls.size:
                apart = np.abs(matrix @ part.controls(t) - part.controls(tt))
                fits = (apart / sizes.controls).max() <= limit
            if fits:
                degree, last = joint, k + 2
        joint_degrees.append(degree)
        calm.append(bool(mesh.calm[k:last].any()))
        ends.append(float(mesh.fractions[last]))
        k = last
    return Mesh(np.array(ends), np.array(joint_degrees), np.array(calm))
