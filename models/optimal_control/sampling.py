"""Evaluation of a phase of a plan at any instants: states, controls, functions, integrals, extremes.

It is independent of transcriptions: the plan is evaluated as functions of time, and the problem by
the declared functions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import required, show
from .definition import Definition, Phase
from .plan import ControlPlan, PhasePlan
from .sizes import PhaseSizes, of_phase

__all__ = ["Course", "Extreme", "Instants", "course_of", "courses", "endpoint"]

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]

#: Smallest number of points of the dense grid per interval, and number per node of the plan.
POINTS, POINTS_A_NODE = 24, 3
#: Number of refined maxima of the grid, rounds of refinement, and points per round.
PEAKS, ROUNDS, SPREAD = 4, 6, 15
#: Nodes of the Gauss-Legendre rule of the quadrature, largest number of halvings of a panel, and
#: largest change by halving that is accepted, relative to the whole integral.
RULE, HALVINGS, QUADRATURE = 16, 48, 1e-14
#: Largest number of panels, at least 16 per interval. Halving does not reduce the rounding errors of an integrand that nearly vanishes.
PANELS = 1000


class Instants(NamedTuple):
    """Instants of a phase with the plan's values, shape (points, size).

    `tau` is the position in the plan's interval, from -1 to 1. A knot is two instants, one per side.
    """

    interval: Whole
    tau: Floats
    times: Floats
    states: Floats
    controls: Floats


class Extreme(NamedTuple):
    """Maximum of a measure: value, entry and time."""

    value: float
    entry: int
    time: float


@dataclass(frozen=True, eq=False)
class Course:
    """One phase of a plan with its declaration, and the values of the problem's parameters."""

    phase: Phase
    plan: PhasePlan
    parameters: Floats

    def at(self, interval: Whole, tau: Floats) -> Instants:
        """Return the instants at positions `tau` of intervals `interval`, in any order."""
        knots = self.plan.states.knots
        begin, end = knots[interval], knots[interval + 1]
        times = np.where(tau >= 1.0, end, begin + 0.5 * (tau + 1.0) * (end - begin))
        states, controls = (
            part.at(interval, tau) for part in (self.plan.states, self.plan.controls)
        )
        return Instants(interval, tau, times, states, controls)

    def values(self, at: Instants, states: Floats | None = None) -> dict[str, Floats]:
        """Return rate, path, integrand and invariant at `at`, each of shape (points, size).

        `states` replaces the plan's states if given.
        """
        x = at.states if states is None else states
        results: Any = self.phase.function(at.times[None, :], x.T, at.controls.T, self.parameters)
        names = self.phase.function.name_out()
        # CasADi returns a 0 by 0 matrix for a result without entries, at any number of points.
        count = at.times.size
        return {
            name: part.full().T.reshape(count, -1)
            for name, part in zip(names, results, strict=True)
        }

    @cached_property
    def places(self) -> tuple[Floats, ...]:
        """Dense grid of each interval: nodes, and points that cluster at both ends."""
        known: dict[tuple[int, int], Floats] = {}
        pairs = list(zip(self.plan.states.nodes, self.plan.controls.nodes, strict=True))
        for x, u in pairs:
            if (id(x), id(u)) not in known:
                count = max(POINTS, POINTS_A_NODE * max(x.size, u.size))
                crowded = -np.cos(np.linspace(0.0, np.pi, count))
                known[id(x), id(u)] = np.unique(np.concatenate([crowded, x, u]))
        result = [known[id(x), id(u)] for x, u in pairs]
        for interval, tau in zip(*self.instants, strict=True):
            result[interval] = np.unique(np.append(result[interval], tau))
        return tuple(result)

    @cached_property
    def instants(self) -> tuple[Whole, Floats]:
        """Interval of each interior instant of the declaration, and position in it."""
        knots = self.plan.states.knots
        times = self.plan.start + np.array(self.phase.instants, float) * self.plan.duration
        interval = np.searchsorted(knots[1:-1], times, side="right")
        low, high = knots[interval], knots[interval + 1]
        return interval, np.clip(2.0 * (times - low) / (high - low) - 1.0, -1.0, 1.0)

    def at_instants(self, states: Floats) -> Floats:
        """Return the rows of `states`, given on the dense grid, at the interior instants."""
        pairs = zip(*self.instants, strict=True)
        grid = self.dense
        rows = [np.flatnonzero((grid.interval == k) & (grid.tau == tau))[0] for k, tau in pairs]
        result: Floats = states[np.array(rows, int)]
        return result

    @cached_property
    def dense(self) -> Instants:
        """Dense grid of the phase."""
        sizes = [positions.size for positions in self.places]
        return self.at(np.repeat(np.arange(len(sizes)), sizes), np.concatenate(self.places))

    @cached_property
    def dense_values(self) -> dict[str, Floats]:
        """Declared functions on the dense grid."""
        return self.values(self.dense)

    @cached_property
    def sizes(self) -> PhaseSizes:
        """Sizes of states, controls, paths and integrals along the plan."""
        return of_phase(self)

    @property
    def magnitudes(self) -> Floats:
        """Approximate integrals of the integrands' magnitudes, shape (integrals,)."""
        result: Floats = self._coarse[1].sum(axis=0)
        return result

    @property
    def rough_integrals(self) -> Floats:
        """Integrals without refinement of the panels, shape (integrals,)."""
        result: Floats = self._coarse[0].sum(axis=0)
        return result

    @cached_property
    def _coarse(self) -> tuple[Floats, Floats]:
        """Integrals of the integrands and of their magnitudes by one panel per interval."""
        count = self.plan.states.intervals
        return self._panels(np.arange(count), np.full(count, -1.0), np.ones(count))

    def _panels(self, interval: Whole, low: Floats, high: Floats) -> tuple[Floats, Floats]:
        """Return the integrals over panels of intervals, and those of the magnitudes, (panels, integrals)."""
        if not self.phase.integrals:
            return (np.zeros((interval.size, 0)),) * 2
        nodes, weights = np.polynomial.legendre.leggauss(RULE)
        half = 0.5 * (high - low)
        tau = (0.5 * (high + low))[:, None] + half[:, None] * nodes
        instants = self.at(np.repeat(interval, RULE), tau.ravel())
        table = self.values(instants)["integrand"].reshape(interval.size, RULE, -1)
        share = weights * (half * 0.5 * np.diff(self.plan.states.knots)[interval])[:, None]
        with np.errstate(all="ignore"):
            sums = np.einsum("kr,kri->ki", share, table)
            size = np.einsum("kr,kri->ki", share, np.abs(table))
        return sums, size

    @cached_property
    def integrals(self) -> Floats:
        """Integrals of the integrands over the phase, shape (integrals,).

        Gauss-Legendre quadrature on panels that are halved until their integrals no longer change.
        All panels are evaluated together. A panel never crosses a knot.
        """
        total: Floats = np.zeros(self.phase.integrals)
        lengths = np.diff(self.plan.states.knots)
        interval, values = np.arange(lengths.size), self._coarse[0]
        low, high = np.full(lengths.size, -1.0), np.ones(lengths.size)
        limit = QUADRATURE * self.magnitudes
        for _ in range(HALVINGS if self.phase.integrals else 0):
            if interval.size > max(PANELS, 16 * lengths.size):
                break
            middle = 0.5 * (low + high)
            interval = np.repeat(interval, 2)
            low = np.stack([low, middle], axis=1).ravel()
            high = np.stack([middle, high], axis=1).ravel()
            parts, _ = self._panels(interval, low, high)
            pairs = parts.reshape(-1, 2, parts.shape[1]).sum(axis=1)
            # Non-finite values would never converge: they are accepted and make the sum non-finite.
            active = (np.abs(pairs - values) > limit).any(axis=1)
            total += pairs[~active].sum(axis=0)
            if not active.any():
                return total
            selected = np.repeat(active, 2)
            interval, values = interval[selected], parts[selected]
            low, high = low[selected], high[selected]
        total += values.sum(axis=0)
        return total

    def largest(self, measure: Callable[[Instants], Floats], on_grid: Floats) -> Extreme:
        """Return the maximum over the phase of `measure`, with values of shape (points, entries).

        The search starts from the values `on_grid` of the dense grid. Their highest maxima are refined
        on successively finer grids between their neighbours, so that peaks between the points are
        included.
        """
        grid = self.dense
        if not np.isfinite(on_grid).all():
            row, entry = (int(k) for k in np.argwhere(~np.isfinite(on_grid))[0])
            return Extreme(np.inf, entry, float(grid.times[row]))
        fresh = np.concatenate([[True], np.diff(grid.interval) > 0, [True]])
        edge = np.full((1, on_grid.shape[1]), -np.inf)
        before = np.where(fresh[:-1, None], -np.inf, np.concatenate([edge, on_grid[:-1]]))
        after = np.where(fresh[1:, None], -np.inf, np.concatenate([on_grid[1:], edge]))
        rows, entries = np.nonzero((on_grid >= before) & (on_grid >= after))
        first = np.argsort(-on_grid[rows, entries], kind="stable")[:PEAKS]
        rows, entries = rows[first], entries[first]
        best = Extreme(float(on_grid[rows[0], entries[0]]), int(entries[0]), grid.times[rows[0]])
        low = grid.tau[np.where(fresh[rows], rows, rows - 1)]
        high = grid.tau[np.where(fresh[rows + 1], rows, rows + 1)]
        peaks = np.arange(rows.size)
        for _ in range(ROUNDS):
            tau = np.clip(np.linspace(low, high, SPREAD, axis=1), -1.0, 1.0)
            instants = self.at(np.repeat(grid.interval[rows], SPREAD), tau.ravel())
            table = measure(instants).reshape(rows.size, SPREAD, -1)[peaks, :, entries]
            if not np.isfinite(table).all():
                spot = int(np.flatnonzero(~np.isfinite(table.ravel()))[0])
                return Extreme(np.inf, int(entries[spot // SPREAD]), float(instants.times[spot]))
            column = table.argmax(axis=1)
            top = int(table[peaks, column].argmax())
            highest = float(table[top, column[top]])
            if highest > best.value:
                spot = top * SPREAD + int(column[top])
                best = Extreme(highest, int(entries[top]), float(instants.times[spot]))
            low = tau[peaks, np.maximum(column - 1, 0)]
            high = tau[peaks, np.minimum(column + 1, SPREAD - 1)]
        return best._replace(time=float(best.time))


#: Recent courses, which keep the values on their grids.
RECENT = 4
_recent: dict[tuple[int, int, bytes], Course] = {}


def course_of(phase: Phase, plan: PhasePlan, parameters: Floats) -> Course:
    """Return the course of a phase; of the same phase and plan as a recent one, the same object."""
    key = id(phase), id(plan), parameters.tobytes()
    _recent[key] = course = _recent.pop(key, None) or Course(phase, plan, parameters)
    for oldest in list(_recent)[:-RECENT]:  # a copy, which other threads do not change
        _recent.pop(oldest, None)
    return course


def courses(definition: Definition, plan: ControlPlan) -> tuple[Course, ...]:
    """Return the phases of `plan` with their declarations; a plan of another problem raises ``InvalidData``."""
    required("problem", definition, Definition)
    if not isinstance(plan, ControlPlan):
        raise InvalidData(f"plan must be a ControlPlan, got {show(plan)}", field="plan")
    _same("phases", [item.name for item in definition.phases], [item.name for item in plan.phases])
    sizes = {item.name: item.size for item in definition.parameters}
    _same("parameters", sorted(sizes), sorted(plan.parameters))
    for name, size in sizes.items():
        value = plan.parameters[name]
        if value.shape != (size,) or not np.isfinite(value).all():
            raise InvalidData(
                f"parameter {name!r} must be {size} finite number{'s' * (size > 1)}, "
                f"got {show(value.tolist())}",
                field="parameters",
            )
    parameters = np.concatenate([*(plan.parameters[name] for name in sizes), np.empty(0)])
    result = []
    for phase, part in zip(definition.phases, plan.phases, strict=True):
        for what in ("state_names", "control_names"):
            label = f"{what} of phase {phase.name!r}"
            _same(label, list(getattr(phase, what)), list(getattr(part, what)))
        result.append(course_of(phase, part, parameters))
    return tuple(result)


def _same(field: str, expected: list[str], actual: list[str]) -> None:
    if expected != actual:
        raise InvalidData(f"{field} of the plan must be {expected}, got {actual}", field=field)


def endpoint(
    phases: Sequence[Course], moved: Sequence[tuple[Floats, Floats]] | None = None
) -> Floats:
    """Return the endpoint vector, on which the objective and boundary constraints depend.

    `moved` may give states on the dense grid and integrals other than the plan's, one pair per phase.
    """
    parts: list[Floats] = []
    for k, course in enumerate(phases):
        begin = course.dense.states[0]
        states, integrals = moved[k] if moved else (course.dense.states, course.integrals)
        times = np.array([course.plan.start, course.plan.end])
        parts += [times, begin, states[-1], integrals, course.at_instants(states).ravel()]
    return np.concatenate(parts)
