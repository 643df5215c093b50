"""A phase of a plan at any instants: states, controls, the declared functions, integrals, extremes.

Nothing here knows a transcription: the plan is taken as functions of time, and the problem as the
functions that were declared.
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

__all__ = ["Course", "Extreme", "Instants", "courses", "endpoint"]

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]

#: Points of the dense grid in an interval, at least, and per node of the plan.
POINTS, POINTS_A_NODE = 24, 3
#: Maxima of the grid that are refined, rounds of refinement, and points in each round.
PEAKS, ROUNDS, SPREAD = 4, 6, 15
#: Nodes of the Gauss-Legendre rule of the quadrature, how often a panel may be halved, and the
#: share of the whole integral that a panel may change by when it is.
RULE, HALVINGS, QUADRATURE = 16, 48, 1e-14


class Instants(NamedTuple):
    """Instants of a phase, each in an interval: at a knot there are two, one from each side.

    Attributes
    ----------
    interval : ndarray of int, shape (points,)
        The interval of the plan.
    tau : ndarray, shape (points,)
        The place in it, from -1 to 1.
    times : ndarray, shape (points,)
        The time.
    states, controls : ndarray, shape (points, size)
        The plan's values.
    """

    interval: Whole
    tau: Floats
    times: Floats
    states: Floats
    controls: Floats


class Extreme(NamedTuple):
    """Where a measure is largest: its value, the entry that has it, and the time."""

    value: float
    entry: int
    time: float


@dataclass(frozen=True, eq=False)
class Course:
    """One phase of a plan beside its declaration.

    Parameters
    ----------
    phase : Phase
        What was declared.
    plan : PhasePlan
        What is measured; its names and sizes fit.
    parameters : ndarray
        Values of the problem's parameters.
    """

    phase: Phase
    plan: PhasePlan
    parameters: Floats

    def at(self, interval: Whole, tau: Floats) -> Instants:
        """Return the instants at places `tau` of intervals `interval`, any and in any order."""
        knots = self.plan.states.knots
        begin, end = knots[interval], knots[interval + 1]
        times = np.where(tau >= 1.0, end, begin + 0.5 * (tau + 1.0) * (end - begin))
        states = np.empty((tau.size, self.plan.states.size))
        controls = np.empty((tau.size, self.plan.controls.size))
        order = np.argsort(interval, kind="stable")
        for rows in np.split(order, np.flatnonzero(np.diff(interval[order])) + 1):
            k = int(interval[rows[0]])
            states[rows] = self.plan.states.on(k, tau[rows])
            if controls.shape[1]:
                controls[rows] = self.plan.controls.on(k, tau[rows])
        return Instants(interval, tau, times, states, controls)

    def spread(self, intervals: Whole, tau: Floats) -> Instants:
        """Return the instants at the same places `tau` of each of `intervals`, whose nodes are the same."""
        knots = self.plan.states.knots
        begin, end = knots[intervals, None], knots[intervals + 1, None]
        times = np.where(tau >= 1.0, end, begin + 0.5 * (tau + 1.0) * (end - begin))
        states, controls = (
            part.on_each(intervals, tau).reshape(times.size, part.size)
            for part in (self.plan.states, self.plan.controls)
        )
        places = np.repeat(intervals, tau.size), np.tile(tau, intervals.size)
        return Instants(*places, times.ravel(), states, controls)

    def values(self, at: Instants, states: Floats | None = None) -> dict[str, Floats]:
        """Return rate, path, integrand and invariant at `at`, each of shape (points, size).

        `states` may stand in for the plan's own.
        """
        x = at.states if states is None else states
        found: Any = self.phase.function(at.times[None, :], x.T, at.controls.T, self.parameters)
        names = self.phase.function.name_out()
        # What has no entries at all is 0 by 0 in CasADi, wherever it is evaluated.
        count = at.times.size
        return {
            name: part.full().T.reshape(count, -1) for name, part in zip(names, found, strict=True)
        }

    @cached_property
    def places(self) -> tuple[Floats, ...]:
        """The dense grid of each interval: nodes, and points crowded towards both ends."""
        known: dict[tuple[int, int], Floats] = {}
        found = []
        for x, u in zip(self.plan.states.nodes, self.plan.controls.nodes, strict=True):
            key = (id(x), id(u))
            if key not in known:
                count = max(POINTS, POINTS_A_NODE * max(x.size, u.size))
                crowded = -np.cos(np.linspace(0.0, np.pi, count))
                known[key] = np.unique(np.concatenate([crowded, x, u]))
            found.append(known[key])
        return tuple(found)

    @cached_property
    def dense(self) -> Instants:
        """The dense grid."""
        sizes = [one.size for one in self.places]
        return self.at(np.repeat(np.arange(len(sizes)), sizes), np.concatenate(self.places))

    @cached_property
    def dense_values(self) -> dict[str, Floats]:
        """The declared functions on the dense grid."""
        return self.values(self.dense)

    @cached_property
    def sizes(self) -> PhaseSizes:
        """How large states, controls, paths and integrals are along the plan."""
        return of_phase(self)

    @property
    def state_scale(self) -> Floats:
        """Size of each state along the plan."""
        return self.sizes.states

    @property
    def integrals(self) -> Floats:
        """The integrals of the integrands over the phase, shape (integrals,)."""
        return self._quadrature[0]

    @property
    def magnitudes(self) -> Floats:
        """The integrals of the integrands' magnitudes, roughly, shape (integrals,)."""
        return self._quadrature[1]

    @cached_property
    def _quadrature(self) -> tuple[Floats, Floats]:
        """The integrals, and those of the magnitudes on the first panels.

        Gauss-Legendre quadrature on panels that are halved until they no longer change, all
        panels at once; a panel never crosses a knot.
        """
        if not self.phase.integrals:
            return np.zeros(0), np.zeros(0)
        nodes, weights = np.polynomial.legendre.leggauss(RULE)
        lengths = np.diff(self.plan.states.knots)

        def panels(interval: Whole, low: Floats, high: Floats) -> tuple[Floats, Floats]:
            half = 0.5 * (high - low)
            tau = (0.5 * (high + low))[:, None] + half[:, None] * nodes
            at = self.at(np.repeat(interval, RULE), tau.ravel())
            table = self.values(at)["integrand"].reshape(interval.size, RULE, -1)
            share = weights * (half * 0.5 * lengths[interval])[:, None]
            with np.errstate(all="ignore"):
                found = np.einsum("kr,kri->ki", share, table)
                size = np.einsum("kr,kri->ki", share, np.abs(table))
            return found, size

        interval = np.arange(lengths.size)
        low, high = np.full(lengths.size, -1.0), np.ones(lengths.size)
        total: Floats = np.zeros(self.phase.integrals)
        whole, size = panels(interval, low, high)
        size = size.sum(axis=0)
        enough = QUADRATURE * size
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            interval = np.repeat(interval, 2)
            low = np.stack([low, middle], axis=1).ravel()
            high = np.stack([middle, high], axis=1).ravel()
            parts, _ = panels(interval, low, high)
            pairs = parts.reshape(-1, 2, parts.shape[1]).sum(axis=1)
            # What is not finite would never settle: it counts as it is, and makes the sum so.
            going = (np.abs(pairs - whole) > enough).any(axis=1)
            total += pairs[~going].sum(axis=0)
            if not going.any():
                return total, size
            kept = np.repeat(going, 2)
            interval, low, high, whole = interval[kept], low[kept], high[kept], parts[kept]
        total += whole.sum(axis=0)
        return total, size

    def largest(self, measure: Callable[[Instants], Floats], on_grid: Floats) -> Extreme:
        """Return where `measure` is largest over the phase.

        Parameters
        ----------
        measure : callable
            Turns instants into values, shape (points, entries).
        on_grid : ndarray
            Its values on the dense grid, where the search starts.

        Notes
        -----
        The highest maxima of the grid are searched again on finer and finer grids between their
        neighbours, so that a peak between the points is found as well.
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
            at = self.at(np.repeat(grid.interval[rows], SPREAD), tau.ravel())
            table = measure(at).reshape(rows.size, SPREAD, -1)[peaks, :, entries]
            if not np.isfinite(table).all():
                spot = int(np.flatnonzero(~np.isfinite(table.ravel()))[0])
                return Extreme(np.inf, int(entries[spot // SPREAD]), float(at.times[spot]))
            column = table.argmax(axis=1)
            top = int(table[peaks, column].argmax())
            if table[top, column[top]] > best.value:
                spot = top * SPREAD + int(column[top])
                best = Extreme(
                    float(table[top, column[top]]), int(entries[top]), float(at.times[spot])
                )
            low = tau[peaks, np.maximum(column - 1, 0)]
            high = tau[peaks, np.minimum(column + 1, SPREAD - 1)]
        return best._replace(time=float(best.time))


def courses(definition: Definition, plan: ControlPlan) -> tuple[Course, ...]:
    """Return the phases of `plan` beside their declarations.

    Raises
    ------
    InvalidData
        The plan's phases, names or parameters are not the problem's, or it is not finite.
    """
    required("problem", definition, Definition)
    if not isinstance(plan, ControlPlan):
        raise InvalidData(f"plan must be a ControlPlan, got {show(plan)}", field="plan")
    _same("phases", [one.name for one in definition.phases], [one.name for one in plan.phases])
    wanted = {one.name: one.size for one in definition.parameters}
    _same("parameters", sorted(wanted), sorted(plan.parameters))
    for name, size in wanted.items():
        value = plan.parameters[name]
        if value.shape != (size,) or not np.isfinite(value).all():
            raise InvalidData(
                f"parameter {name!r} must be {size} finite number{'s' * (size > 1)}, "
                f"got {show(value.tolist())}",
                field="parameters",
            )
    parameters = np.concatenate([*(plan.parameters[name] for name in wanted), np.empty(0)])
    found = []
    for phase, part in zip(definition.phases, plan.phases, strict=True):
        for what in ("state_names", "control_names"):
            label = f"{what} of phase {phase.name!r}"
            _same(label, list(getattr(phase, what)), list(getattr(part, what)))
        found.append(Course(phase, part, parameters))
    return tuple(found)


def _same(field: str, wanted: list[str], got: list[str]) -> None:
    if wanted != got:
        raise InvalidData(f"{field} of the plan must be {wanted}, got {got}", field=field)


def endpoint(
    phases: Sequence[Course], moved: Sequence[tuple[Floats, Floats]] | None = None
) -> Floats:
    """Return the vector of the ends that objective and boundary constraints are functions of.

    `moved` may give other final states and integrals than the plan's, a pair a phase.
    """
    parts: list[Floats] = []
    for k, one in enumerate(phases):
        states = one.dense.states
        final, integrals = moved[k] if moved else (states[-1], one.integrals)
        times = np.array([one.plan.start, one.plan.end])
        parts += [times, states[0], final, integrals]
    return np.concatenate(parts)
