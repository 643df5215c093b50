"""Switching structure of a plan: arcs of the controls, and arcs of active constraints.

The instants are estimated from the plan alone, without multipliers. A constraint is left as a power of the
time with an unknown exponent, so an end of an arc is extrapolated from the instants at which the distance
from the bound exceeds three thresholds in geometric progression (Aitken's method).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from ..fields import Real
from .algebraic import algebraic_entries
from .definition import Phase, entry_names, entry_slices
from .sampling import Course, courses

__all__ = ["Arc", "structure"]

Floats = NDArray[np.float64]
_Run = tuple[str, float, float, float]
_Entry = tuple[str, Floats, float, float, float]

#: Points per interval of the mesh, which cluster at its ends.
POINTS = 161
#: Ratio of the thresholds that an extrapolation uses.
RATIO = 4.0
#: Shortest arc of an active constraint, relative to the phase; a shorter one is a touch.
SHORT = 1e-2
#: Distance of a control that jumps from its bound, relative to the range: polynomials oscillate at jumps.
SATURATED = 1e-2


@dataclass(frozen=True)
class Arc:
    """Stretch of time with a control of one kind, or with an active constraint.

    Parameters
    ----------
    phase, name : str
        Name of the phase, and of the control, state or path constraint with the entry of a vector.
    kind : str
        Of a control: ``"lower"`` or ``"upper"`` at a bound; between the bounds, ``"singular"`` if dynamics
        and costs are affine in the control and no constraint determines it, ``"constrained"`` if they are
        and a constraint is active, otherwise ``"interior"``. Of a constraint: ``"active at lower"``,
        ``"active at upper"``, ``"touch at lower"`` or ``"touch at upper"``.
    start, end : float
        Instants.
    tolerance : float
        Heuristic estimate of the error of the instants, which can be too small: the distance between the
        measured and the extrapolated instant, or half the width of a jump. At a jump to or from a singular
        arc it is the length of the mesh's interval there, because the objective depends weakly on this
        instant. It is 0 at the ends of the phase.
    """

    phase: str
    name: str
    kind: str
    start: float
    end: float
    tolerance: float


def structure(problem: Any, plan: Any, *, tolerance: float = 1e-4) -> tuple[Arc, ...]:
    """Return the arcs of all controls and of the active constraints, in the order of names and times.

    A bound of an algebraic variable is a constraint.

    Parameters
    ----------
    problem : OptimalControlProblem or Definition
        Problem.
    plan : ControlPlan
        Plan of the problem.
    tolerance : float
        Distance from a bound that is treated as 0: relative to the range of a control with two bounds,
        otherwise to the larger of the bound and the size of the quantity along the plan.

    Returns
    -------
    tuple of Arc
        Arcs. Those of a control cover its phase. A bound on a state or path appears only while active.

    Raises
    ------
    InvalidData
        The plan does not fit the problem, or `tolerance` is not in (0, 0.01].
    """
    level = Real(0.0, 0.01, strict=True).coerce("tolerance", tolerance, {})
    definition = getattr(problem, "definition", problem)
    result: list[Arc] = []
    with np.errstate(all="ignore"):
        for course in courses(definition, plan):
            phase = _Stretches(course, level)
            constraints = list(phase.constraints())
            result += [*phase.controls(constraints), *constraints]
    return tuple(result)


def _affine(phase: Phase) -> NDArray[np.bool_]:
    """Return the controls that rates and integrands are affine in, each for fixed other ones.

    Algebraic variables follow a control, so their equations must be affine in both.
    """
    function = phase.function
    kind: Any = casadi.SX if function.is_a("SXFunction") else casadi.MX
    symbols = [kind.sym(name, function.size1_in(name)) for name in function.name_in()]
    u = symbols[function.index_in("u")]
    parts = function.call(symbols)
    following, equations = algebraic_entries(phase.controls), algebraic_entries(phase.paths)
    value = casadi.vertcat(parts[0], parts[1][equations.tolist()], parts[2])
    slopes = casadi.jacobian(value, u)
    result = np.zeros(u.numel(), dtype=bool)
    for k in range(u.numel()):
        places = sorted({k, *following.tolist()})
        result[k] = not casadi.depends_on(slopes[:, places], u[places])
    return result


class _Stretches:
    """Distances from the bounds along one phase, and the stretches on which they vanish."""

    def __init__(self, course: Course, tolerance: float) -> None:
        self.course, self.tolerance = course, tolerance
        tau = -np.cos(np.linspace(0.0, np.pi, POINTS))
        intervals = course.plan.states.intervals
        self.at = course.at(np.repeat(np.arange(intervals), POINTS), np.tile(tau, intervals))
        self.values = {
            **course.values(self.at), "states": self.at.states, "controls": self.at.controls,
        }  # fmt: skip
        self.times = self.at.times

    def _bounds(self, what: str) -> Iterator[tuple[_Entry, bool]]:
        """Yield name, values, bounds and size of each entry, and whether it is algebraic."""
        names = {"states": "states", "controls": "controls", "paths": "path"}
        sizes = getattr(self.course.sizes, what)
        for item, places in entry_slices(getattr(self.course.phase, what)):
            for k, name in enumerate(entry_names([item])):
                entry = places.start + k
                values = self.values[names[what]][:, entry]
                yield (name, values, item.lower[k], item.upper[k], sizes[entry]), item.algebraic

    def _runs(self, distance: Floats) -> Iterator[tuple[int, int, float, float, float]]:
        """Yield first and last grid point, start, end and error of the stretches with distance 0."""
        inside = distance <= self.tolerance
        edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]])))
        for first, after in edges.reshape(-1, 2):
            start, off = self._edge(distance, int(first), -1)
            end, off_end = self._edge(distance, int(after) - 1, 1)
            if end < start:
                start = end = 0.5 * (start + end)
            yield int(first), int(after) - 1, start, end, max(off, off_end)

    def _edge(self, distance: Floats, row: int, step: int) -> tuple[float, float]:
        """Return the end of a stretch in one direction from its last grid point, and its error."""
        instants = []
        for power in range(3):
            level, k = self.tolerance * RATIO**power, row
            while 0 <= k + step < distance.size and distance[k + step] <= level:
                k += step
            if not 0 <= k + step < distance.size:
                if not power:
                    return float(self.times[k]), 0.0
                break
            share = (level - distance[k]) / (distance[k + step] - distance[k])
            instants.append(self.times[k] + share * (self.times[k + step] - self.times[k]))
        if len(instants) < 3:
            return float(instants[0]), abs(float(instants[-1] - instants[0]))
        one, two, three = map(float, instants)
        bend = (three - two) - (two - one)
        # Instants that do not spread are those of a jump, or of a distance without a power law.
        limit = one - (two - one) ** 2 / bend if step * bend > 0.0 else one
        return limit, abs(limit - one)

    def constraints(self) -> Iterator[Arc]:
        """Yield the arcs and touches of bounds of states and of path constraints."""
        phase = self.course.plan
        for what in ("states", "paths", "controls"):
            for (name, values, low, high, size), algebraic in self._bounds(what):
                if low == high or (what == "controls" and not algebraic):
                    continue
                for side, bound, sign in (("lower", low, 1.0), ("upper", high, -1.0)):
                    if not np.isfinite(bound):
                        continue
                    distance = sign * (values - bound) / max(abs(bound), size)
                    for _, _, start, end, error in self._runs(distance):
                        # A fixed or free value at an end is no arc.
                        is_edge = start <= phase.start or end >= phase.end
                        if end - start > SHORT * phase.duration:
                            yield Arc(phase.name, name, f"active at {side}", start, end, error)
                        elif not is_edge:
                            middle = 0.5 * (start + end)
                            error = max(error, middle - start)
                            yield Arc(phase.name, name, f"touch at {side}", middle, middle, error)

    def controls(self, constraints: list[Arc]) -> Iterator[Arc]:
        """Yield the arcs of the controls, each from the start to the end of the phase."""
        phase = self.course.plan
        active = [arc for arc in constraints if arc.kind.startswith("active")]
        ends = [time for arc in active for time in (arc.start, arc.end)]
        affines = _affine(self.course.phase)
        for affine, (bounds, algebraic) in zip(affines, self._bounds("controls"), strict=True):
            if algebraic:
                continue
            for kind, start, end, error in self._jumps(*bounds) if affine else self._bends(*bounds):
                free = affine and not kind
                margin = max(error, SHORT * phase.duration)
                inner = [t for t in ends if free and start + margin < t < end - margin]
                cuts = sorted({start, end, *inner})
                for low, high in itertools.pairwise(map(float, cuts)):
                    middle = 0.5 * (low + high)
                    is_held = any(arc.start <= middle <= arc.end for arc in active)
                    between = "interior" if not affine else "constrained" if is_held else "singular"
                    yield Arc(phase.name, bounds[0], kind or between, low, high, float(error))

    @staticmethod
    def _distances(values: Floats, low: float, high: float, size: float) -> dict[str, Floats]:
        """Return the distances from the finite bounds, relative to the range or the larger size."""
        finite = [abs(bound) for bound in (low, high) if np.isfinite(bound)]
        scale = high - low if len(finite) == 2 else max([*finite, size])
        distances = {"lower": (values - low) / scale, "upper": (high - values) / scale}
        return {side: item for side, item in distances.items() if np.isfinite(item).all()}

    def _bends(self, name: str, values: Floats, *bounds: float) -> Iterator[_Run]:
        """Yield kind (empty between bounds), start, end and error of arcs of a continuous control."""
        phase = self.course.plan
        runs = [
            (start, end, error, side)
            for side, distance in self._distances(values, *bounds).items()
            for _, _, start, end, error in self._runs(distance)
            if end > start
        ]
        before, last = phase.start, 0.0
        for start, end, error, side in (*sorted(runs), (phase.end, phase.end, 0.0, "")):
            if start > before:
                yield "", before, start, max(error, last)
            if side:
                yield side, max(start, before), end, error
            before, last = max(before, end), error

    def _jumps(self, name: str, values: Floats, *bounds: float) -> Iterator[_Run]:
        """Yield kind, start, end and error of arcs of a control that jumps, as one that H is affine in.

        A polynomial resolves no jump: an arc is real if it contains an interval of the mesh, or half of
        one at an end of the phase. Between bounds it must have 1 % of the duration, too. The instant
        between two arcs keeps the integral of the control.
        """
        phase, lengths = self.course.plan, np.diff(self.course.plan.states.knots)
        state = np.full(values.size, "", dtype="<U5")
        for side, distance in self._distances(values, *bounds).items():
            state[distance <= max(self.tolerance, SATURATED)] = side
        cuts = np.flatnonzero(state[1:] != state[:-1]) + 1
        arcs = list(zip([0, *cuts], [*(cuts - 1), values.size - 1], strict=True))

        def is_real(first: int, last: int) -> bool:
            duration = self.times[last] - self.times[first]
            is_end = first == 0 or last == values.size - 1
            half = 0.5 * lengths[self.at.interval[first]]
            is_short = not is_end and not state[first] and duration < SHORT * phase.duration
            contains = (last + 1) // POINTS > -(-first // POINTS)
            return bool(contains and not is_short) or bool(is_end and duration >= half)

        real = [arc for arc in arcs if is_real(*arc)] or arcs
        merged = real[:1]
        for first, last in real[1:]:
            if state[first] == state[merged[-1][0]]:
                merged[-1] = merged[-1][0], last
            else:
                merged.append((first, last))
        start, error = phase.start, 0.0
        for k, (first, last) in enumerate(merged):
            end, after = phase.end, 0.0
            if k + 1 < len(merged):
                follow = merged[k + 1][0]
                t, u = (x[last : follow + 1] for x in (self.times, values))
                end, after, drop = t[-1], 0.5 * (t[-1] - t[0]), u[-1] - u[0]
                if drop and after:
                    area = float(np.trapezoid(u, t))
                    end = np.clip((u[-1] * t[-1] - u[0] * t[0] - area) / drop, t[0], t[-1])
                if not (state[first] and state[follow]):
                    after += lengths[self.at.interval[follow if state[first] else last]]
            yield str(state[first]), start, end, max(error, after)
            start, error = end, after
