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

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..hamiltonian import hamiltonian_gains
from ..lagrange import interpolation
from ..plan import ControlPlan, PhasePlan
from ..sizes import PhaseSizes
from .mesh import Mesh
from .report import SHARE, Report, examine
from .schemes import gauss_points

if TYPE_CHECKING:
    from ..model import OptimalControlProblem

__all__ = ["Finding", "History", "Rules", "denser", "next_meshes", "relative_change"]

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
#: Gain that the Hamiltonian must promise for a settled objective to be looked at again, and change of
#: the objective up to which it promised too much, in shares of the tolerance.
PROMISED, CONFIRMED = 3.0, 0.3
#: The same for a calm interval of a mesh that is still too coarse. On a singular arc, whose multipliers
#: are noise, 2 to 100 were measured; at jumps of a control, 400 to 2e5.
RELEASED = 300.0
#: Share of the most that an interval promises, below which it is left alone when optimality is checked.
PROMISING = 0.1
#: What is done to intervals, in words.
SWITCH, RAISED = "cut at a switch", "raised in degree"
#: Share of an interval's error that is left where refining it did not help, and share of a control's
#: size up to which its high degrees may be noise.
STAYS, NOISE = 0.3, 1e-2
#: Share of an interval that a cut may leave with its error.
MOST = 0.75


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
class History:
    """What earlier meshes gave.

    Parameters
    ----------
    plan : ControlPlan
        The plan of the last one.
    objective : float
        Its objective.
    meshes : tuple of Mesh
        The last meshes.
    errors : tuple of ndarray, shape (intervals,)
        What each interval erred, one a phase.
    accepted : float, optional
        The objective, where the plan was good enough but for what the Hamiltonian promises.
    """

    plan: ControlPlan
    objective: float
    meshes: tuple[Mesh, ...]
    errors: tuple[Floats, ...] = ()
    accepted: float | None = None


@dataclass(frozen=True)
class Finding:
    """What was found of a plan on its meshes, and what is done about it.

    Parameters
    ----------
    meshes : tuple of Mesh, optional
        Finer ones; None where the plan is good enough, or where nothing finer may be had.
    error : float
        Largest relative error or violation of an interval.
    words : str
        What is done, and why.
    change : float
        By how much the objective differs from the last meshes', relative; infinite without such.
    verified : bool, optional
        Whether the plan verifies; None where nobody looked.
    errors : tuple of ndarray, shape (intervals,)
        What each interval errs, one a phase.
    settled : bool
        Whether this plan, or the one accepted before, is good enough.
    accepted : float, optional
        Objective of a plan that verified and had settled, but for what the Hamiltonian promises.
    """

    meshes: tuple[Mesh, ...] | None
    error: float
    words: str
    change: float = np.inf
    verified: bool | None = None
    errors: tuple[Floats, ...] = ()
    settled: bool = False
    accepted: float | None = None

    def limited(self, rounds: int, most_rounds: int, most_nodes: int) -> Finding:
        """Return the finding without its meshes if they are one too many, or too large.

        Parameters
        ----------
        rounds : int
            Meshes solved so far.
        most_rounds, most_nodes : int
            Limits on the meshes, and on the collocated nodes of all phases.
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
    """Return by how much an objective differs from another, relative to its size."""
    return abs(new - old) / size


def next_meshes(
    model: OptimalControlProblem,
    plan: ControlPlan,
    meshes: Sequence[Mesh],
    rules: Rules,
    tolerance: float,
    objectives: tuple[float, float],
    former: History | None,
    strains: Sequence[Floats] | None = None,
) -> Finding:
    """Return finer meshes, or none where the plan verifies and its objective has settled.

    Parameters
    ----------
    model : OptimalControlProblem
        Whose verification decides.
    plan : ControlPlan
        The plan on `meshes`; its costates, where it has some, say whether it is an optimum.
    meshes : sequence of Mesh
        One a phase.
    rules : Rules
        What may be done.
    tolerance : float
        Largest violation accepted.
    objectives : tuple of float
        The objective, and its size.
    former : History, optional
        What the last meshes gave.
    strains : sequence of ndarray, shape (intervals,), optional
        Possible gain of the objective, per interval of each phase, without the rows that hold controls
        calm (:func:`~.calm.calm_strains`); 0 by default.
    """
    objective, size = objectives
    if strains is None:
        strains = [np.zeros(mesh.intervals) for mesh in meshes]
    parameters = np.concatenate([*plan.parameters.values(), np.empty(0)])
    reports = [
        examine(phase, part, parameters)
        for phase, part in zip(model.definition.phases, plan.phases, strict=True)
    ]
    limit = SHARE * tolerance
    worst = max(float(report.worst.max()) for report in reports)
    change = np.inf if former is None else relative_change(size, objective, former.objective)
    verified = model.verify(plan, tolerance=tolerance).ok if worst <= limit else None
    errors = tuple(report.worst for report in reports)
    here = Finding(None, worst, "verified and settled", change, verified, errors)
    accepted = None if former is None else former.accepted
    if accepted is not None:
        if relative_change(size, objective, accepted) <= CONFIRMED * tolerance:
            return replace(here, settled=True, words="the objective stays: settled")
        # There was something to gain.
        accepted = None
    why = ""
    if verified is not None:
        if verified and change <= SETTLED * tolerance:
            halved, told = _looked_again(
                model, plan, meshes, rules, objectives, tolerance, former, strains
            )
            if halved is None:
                return replace(here, settled=True)
            return replace(here, meshes=halved, words=told, accepted=objective)
        # Each interval is good enough by itself, yet not all together: ask more of the worst.
        limit = max(0.1 * worst, 1e-3 * limit) if not verified else max(1e-2 * limit, 1e-2 * worst)
        why = "the objective has not settled: " if verified else "the plan does not verify: "
    made, words = [], []
    for k, (mesh, report, part) in enumerate(zip(meshes, reports, plan.phases, strict=True)):
        noisy = np.zeros(mesh.intervals, bool)
        if former is not None:
            noisy = _noisy(mesh, report, former.meshes[k], former.errors[k])
        merge = worst > SHARE * tolerance
        strained = strains[k] > RELEASED * tolerance * size
        finer, done = _refine(mesh, report, part, rules, limit, noisy, strained, merge)
        made.append(finer)
        words.append(f"phase {part.name!r}: {done}" if done and len(meshes) > 1 else done)
    if all(new.same(old) for new, old in zip(made, meshes, strict=True)):
        refined = denser(meshes, rules)
        done = "no finer mesh is possible" if refined is None else "all intervals refined"
        return replace(here, meshes=refined, words=why + done)
    told = why + "; ".join(word for word in words if word)
    return replace(here, meshes=tuple(made), words=told)


def _looked_again(
    model: OptimalControlProblem,
    plan: ControlPlan,
    meshes: Sequence[Mesh],
    rules: Rules,
    objectives: tuple[float, float],
    tolerance: float,
    former: History | None,
    strains: Sequence[Floats],
) -> tuple[tuple[Mesh, ...] | None, str]:
    """Return meshes for another look at the optimum and why; None if nothing requests it.

    That the objective no longer changes says nothing of intervals that the last meshes left alone, nor
    of a restriction that all of them share. Intervals are halved where the Hamiltonian promises a gain
    although they were left alone, and where the rows that hold controls calm cost something; there the
    controls are released.
    """
    objective, size = objectives
    words = "verified and settled, but "
    strain = sum(float(one.sum()) for one in strains)
    if relative_change(size, objective, objective + strain) > PROMISED * tolerance:
        least = PROMISING * max(float(one.max()) for one in strains)
        chosen = [one >= least for one in strains]
        words += f"controls held calm may cost {strain:.2g}: released"
        if not rules.split:
            return tuple(replace(mesh, calm=None) for mesh in meshes), words
        return tuple(mesh.halved(one) for mesh, one in zip(meshes, chosen, strict=True)), words
    if not rules.split or former is None:
        return None, ""
    gains = [
        np.zeros(mesh.intervals) if gain is None else np.where(mesh.kept(old), gain, 0.0)
        for gain, mesh, old in zip(
            hamiltonian_gains(model, plan), meshes, former.meshes, strict=True
        )
    ]
    promised = sum(float(gain.sum()) for gain in gains)
    if not relative_change(size, objective, objective + promised) > PROMISED * tolerance:
        return None, ""
    least = PROMISING * max(float(gain.max()) for gain in gains)
    words += "the Hamiltonian is not constant: halved where it changes"
    return tuple(
        mesh.halved(gain >= least) for mesh, gain in zip(meshes, gains, strict=True)
    ), words


def denser(meshes: Sequence[Mesh], rules: Rules) -> tuple[Mesh, ...] | None:
    """Return meshes with two more nodes an interval, or twice the intervals where none may be had."""
    finer = []
    for mesh in meshes:
        if rules.fixed_degree is None and (mesh.degrees + 2 <= rules.most_degree).all():
            finer.append(Mesh(mesh.fractions, mesh.degrees + 2, mesh.calm))
        elif rules.split:
            finer.append(mesh.halved(np.ones(mesh.intervals, bool), mesh.calm))
        else:
            return None
    return tuple(finer)


def _noisy(mesh: Mesh, report: Report, old: Mesh, errors: Floats) -> NDArray[np.bool_]:
    """Return where a refined interval errs no less, for a control that is smooth but for noise.

    On a singular arc the program hardly feels its control, which is as noisy as the solver is inexact,
    and no cut makes it less so.
    """
    middle = 0.5 * (mesh.fractions[1:] + mesh.fractions[:-1])
    parent = errors[np.searchsorted(old.fractions, middle) - 1]
    stays = ~mesh.kept(old) & (report.worst >= STAYS * parent)
    stays &= [not windows for windows in report.windows]
    noisy: NDArray[np.bool_] = stays & (report.tails <= NOISE) & (report.decays < SMOOTH)
    return noisy


def _refine(
    mesh: Mesh,
    report: Report,
    part: PhasePlan,
    rules: Rules,
    limit: float,
    noisy: NDArray[np.bool_],
    strained: NDArray[np.bool_],
    merge: bool,
) -> tuple[Mesh, str]:
    """Return a finer mesh of one phase, and what was done."""
    done: Counter[str] = Counter()
    cuts: list[float] = [0.0]
    degrees: list[int] = []
    calm: list[bool] = []
    touched: list[bool] = []
    assert mesh.calm is not None
    for k in range(mesh.intervals):
        begin, end = mesh.fractions[k], mesh.fractions[k + 1]
        degree, quiet = int(mesh.degrees[k]), bool(mesh.calm[k])
        if quiet and strained[k]:
            inner = [0.0] if rules.split else []
            own, quiet, word = [degree] * (len(inner) + 1), False, "released"
        elif (
            (report.chatters[k] or noisy[k])
            and not quiet
            and report.worst[k] > limit
            and rules.fixed_degree is None
        ):
            inner = []
            own, quiet, word = [max(degree, CALM)], True, "held calm"
        else:
            inner, own, word = _decide(degree, report, k, rules, limit)
        places = begin + 0.5 * (np.array([*inner, 1.0]) + 1.0) * (end - begin)
        places[-1] = end
        if (np.diff(np.append(begin, places)) < SHORTEST).any():
            places, own, word = np.array([end]), [degree], ""
        done[word] += 1
        cuts += places.tolist()
        degrees += own
        calm += [quiet] * len(own)
        changed = len(own) > 1 or own[0] != degree or quiet != mesh.calm[k]
        # Only what is plainly smooth, and better than need be, may be merged with its neighbour.
        ample = report.worst[k] <= AMPLE * limit and report.decays[k] >= SMOOTH
        touched += [bool(changed) or not ample or bool(report.windows[k])] * len(own)
    made = Mesh(np.array(cuts), np.array(degrees), np.array(calm))
    if merge and rules.split and not all(touched):
        merged = _merge(made, touched, part, report.sizes, limit)
        done["merged away"], made = made.intervals - merged.intervals, merged
    words = [f"{count} {word}" for word, count in done.items() if word and count]
    return made, "intervals: " + ", ".join(words) if words else ""


def _decide(
    degree: int, report: Report, k: int, rules: Rules, limit: float
) -> tuple[list[float], list[int], str]:
    """Return where interval k is cut, in [-1, 1], the degrees of its parts, and what that is called."""
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
        more = max(2, int(np.ceil(0.25 * degree)))
        return [], [min(degree + more, rules.most_degree)], RAISED
    low = max(rules.least_degree, min(degree, 5))
    if cut is not None:
        return [cut], [low] * 2, SWITCH
    windows = report.windows[k]
    if windows and (degree > rules.least_degree + 1 or report.decays[k] < SMOOTH):
        # Where a constraint begins or ceases to bind, some derivative of the motion jumps.
        edges = sorted({edge for window in windows for edge in window if abs(edge) < 0.99})
        if 0 < len(edges) <= 6:
            edges = _parted(edges, float(report.places[k]))
            return edges, [low] * (len(edges) + 1), "cut where a bound begins or ceases to bind"
    if report.decays[k] >= SMOOTH:
        # A decade more than needed: an interval that must be looked at once more costs another mesh.
        more = int(np.clip(np.ceil((np.log10(ratio) + 1.0) / report.decays[k]), 2, 6))
        if degree + more <= rules.most_degree:
            return [], [degree + more], RAISED
        half = max(rules.least_degree, int(np.ceil(0.7 * degree)))
        return [0.0], [half, half], "halved at the highest degree"
    # Not smooth, and no switch: enclose the place where it is worst, as closely as the nodes tell.
    place, gap = float(report.places[k]), min(0.5, 1.5 / degree)
    inner = [c for c in (place - gap, place + gap) if abs(c) < 1.0 - 0.5 * gap]
    inner = _parted(inner or [0.0], place)
    return inner, [low] * (len(inner) + 1), "cut about where the error is largest"


def _parted(inner: list[float], place: float) -> list[float]:
    """Return cuts in [-1, 1] that leave the part around `place` no more than most of the interval."""
    edges = [-1.0, *inner, 1.0]
    at = int(np.clip(np.searchsorted(edges, place), 1, len(edges) - 1))
    low, high = edges[at - 1], edges[at]
    return sorted([*inner, 0.5 * (low + high)]) if high - low > 2.0 * MOST else inner


def _merge(
    mesh: Mesh, touched: list[bool], part: PhasePlan, sizes: PhaseSizes, limit: float
) -> Mesh:
    """Join neighbours that were left alone and that one polynomial of their degree fits."""
    kept, own, calm = [0.0], [], []
    states, span = part.states, part.duration
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
            fits = (np.abs(matrix @ states(t) - states(tt)) / sizes.states).max() <= MERGED * limit
            if fits and part.controls.size:
                apart = np.abs(matrix @ part.controls(t) - part.controls(tt))
                fits = (apart / sizes.controls).max() <= limit
            if fits:
                degree, last = joint, k + 2
        own.append(degree)
        calm.append(bool(mesh.calm[k:last].any()))
        kept.append(float(mesh.fractions[last]))
        k = last
    return Mesh(np.array(kept), np.array(own), np.array(calm))
