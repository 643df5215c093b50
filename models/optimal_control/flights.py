"""Monte Carlo flights of a plan's control with drawn data: the share of flights that keep each limit.

All flights are integrated together, as one system of differential equations. The result is sampled
evidence: it proves nothing about data that were not drawn, and limits are evaluated on a grid.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp
from scipy.stats import binomtest

from ...errors import InvalidData
from ..fields import Real, Whole, required, show
from .algebraic import solved_controls
from .definition import Definition, Phase, entry_names
from .plan import ControlPlan, PhasePlan
from .sampling import courses

__all__ = ["FlightLimit", "MonteCarlo", "monte_carlo"]

Floats = NDArray[np.float64]
Sampler = Callable[[np.random.Generator, int], Mapping[str, ArrayLike]]

#: Largest relative error of a step of any flight.
ERROR = 1e-7
#: Samples per interval of the plan.
SAMPLES = 17
#: Newton steps for initial states that equations determine; one is exact for linear equations.
NEWTON = 3


class FlightLimit(NamedTuple):
    """Share of flights that keep one limit.

    Parameters
    ----------
    name : str
        Limited state, path constraint, final value or boundary constraint, with the entry of a vector.
    side : str
        ``"lower"`` or ``"upper"``.
    limit : float
        Limit.
    kept : int
        Number of flights that keep it.
    share : float
        Share of these flights.
    low, high : float
        Wilson interval of the share at 95 % confidence.
    worst : float
        Value of the flight farthest towards or beyond the limit.
    time : float
        Instant of that value.
    flight : int
        Number of that flight, from 0.
    """

    name: str
    side: str
    limit: float
    kept: int
    share: float
    low: float
    high: float
    worst: float
    time: float
    flight: int


@dataclass(frozen=True, eq=False)
class MonteCarlo:
    """Flights with drawn data. They are evidence about the distribution, not a proof.

    Parameters
    ----------
    limits : tuple of FlightLimit
        One entry per limit.
    all_limits : FlightLimit
        Flights that keep every limit; its `worst` is the largest excess relative to what is accepted.
    objectives : ndarray, shape (draws,)
        Objective of each flight.
    data : mapping of str to ndarray, shape (draws, size)
        Drawn data.
    failed : int
        Number of flights without a finite motion; they keep no limit.
    seed : int
        Seed of the draws.
    """

    limits: tuple[FlightLimit, ...]
    all_limits: FlightLimit
    objectives: Floats
    data: Mapping[str, Floats]
    failed: int
    seed: int

    def __str__(self) -> str:
        count = self.objectives.size
        lines = [
            f"{count} flights (seed {self.seed}): sampled evidence, not a proof; {self.failed} failed",
            f"objective: mean {np.mean(self.objectives):.6g}, largest {np.max(self.objectives):.6g}",
        ]

        def kept(item: FlightLimit) -> str:
            low, high = 100 * item.low, 100 * item.high
            return f"kept by {item.kept} ({low:.1f} to {high:.1f} % with 95 % confidence)"

        lines += [
            f"{item.name} {item.side} {item.limit:.6g}: {kept(item)}, worst {item.worst:.6g} at "
            f"t = {item.time:.6g}"
            for item in self.limits
        ]
        return "\n".join([*lines, f"all limits: {kept(self.all_limits)}"])


def monte_carlo(
    problem: Any,
    plan: ControlPlan,
    data: Mapping[str, tuple[ArrayLike, ArrayLike]] | Sampler,
    *,
    draws: int = 1000,
    seed: int = 0,
    allowed: Mapping[str, float] | None = None,
    tolerance: float = 1e-6,
) -> MonteCarlo:
    """Return the share of flights with drawn data that keep each limit, with the worst values.

    The flights follow the plan's controls, times and optimised parameters. Initial states that boundary
    equations determine, such as ``initial=x0`` with drawn ``x0``, follow the data.

    Parameters
    ----------
    problem : OptimalControlProblem or Definition
        Problem with data declared by ``ocp.data(…)``.
    plan : ControlPlan
        Plan of the problem; :func:`.scenario_plan` returns one of a plan with scenarios.
    data : mapping or callable
        Range ``(lower, upper)`` per name, drawn uniformly, or a function ``(rng, draws)`` that returns
        arrays of shape (draws,) or (draws, size) per name. Other data have their declared values.
    draws : int
        Number of flights.
    seed : int
        Seed of the draws.
    allowed : mapping of str to float, optional
        Accepted excess by the name of a limit, in its unit, such as a miss distance: ``{"final x": 0.1}``.
    tolerance : float
        Accepted excess over the other limits, relative to the larger of the limit and the declared scale.

    Returns
    -------
    MonteCarlo
        Shares, Wilson intervals and worst values.

    Raises
    ------
    InvalidData
        A name or value is not allowed, or the plan does not fit the problem.

    Notes
    -----
    SciPy's DOP853 integrates all flights together, from knot to knot; the error of every single flight
    meets the tolerance. Stiff dynamics need many steps. Limits are evaluated at 17 instants per interval,
    so shorter violations may be missed. All flights share the controls. Bounds of
    controls and of algebraic variables, which follow the data, are not evaluated.
    """
    definition = required("problem", getattr(problem, "definition", problem), Definition)
    courses(definition, plan)  # raises if the plan does not fit
    if not isinstance(allowed, Mapping | None):
        raise InvalidData(
            f"allowed must be a mapping of names of limits, got {show(allowed)}", field="allowed"
        )
    count = Whole(1, 1_000_000).coerce("draws", draws, {})
    rng = np.random.default_rng(Whole(0).coerce("seed", seed, {}))
    drawn = _draw(definition, data, rng, count)
    p = [
        drawn[q.name].T if q.name in drawn
        else np.tile((q.lower if q.given else plan.parameters[q.name])[:, None], count)
        for q in definition.parameters
    ]  # fmt: skip
    slack = {
        name: Real(0.0).coerce(f"allowed[{name!r}]", x, {}) for name, x in (allowed or {}).items()
    }
    flights = _Flights(
        definition, plan, np.concatenate([*p, np.empty((0, count))]), slack,
        Real(0.0).coerce("tolerance", tolerance, {}),
    )  # fmt: skip
    with np.errstate(all="ignore"):
        return flights.fly(drawn, int(seed))


def _draw(
    definition: Definition, data: Any, rng: np.random.Generator, count: int
) -> dict[str, Floats]:
    """Return the drawn data by name, shape (draws, size)."""
    samples = data(rng, count) if callable(data) else data
    if not isinstance(samples, Mapping):
        raise InvalidData(f"data must be a mapping of names, got {show(samples)}", field="data")
    definition.given(dict.fromkeys(samples, 0.0))  # raises for unknown names
    drawn: dict[str, Floats] = {}
    for item in definition.parameters:
        if item.name not in samples:
            continue
        source, shape = samples[item.name], (count, item.size)
        try:
            if not callable(data):
                low, high = (np.asarray(edge, float) for edge in source)
                source = rng.uniform(low, high, shape)
            table = np.asarray(source, float).reshape(shape)
        except (TypeError, ValueError, OverflowError):
            table = np.array(np.nan)
        if not np.isfinite(table).all():
            raise InvalidData(
                f"data {item.name!r} must be a range (lower, upper) of finite numbers, or {count} "
                f"samples of size {item.size} from a function, got {show(samples[item.name])}",
                field=item.name,
            )
        drawn[item.name] = table
    return drawn


class _Flights:
    """Flights of all draws with parameters `p`, shape (entries, draws), and the limits that they keep."""

    def __init__(
        self, definition: Definition, plan: ControlPlan, p: Floats, allowed: dict[str, float],
        tolerance: float,
    ) -> None:  # fmt: skip
        self.definition, self.plan, self.p, self.count = definition, plan, p, p.shape[1]
        self.allowed, self.tolerance = allowed, tolerance
        #: Limit, accepted excess, and per flight the largest excess and its time.
        self.extremes: dict[tuple[str, str], tuple[float, float, Floats, Floats]] = {}
        self.ends: Floats = np.zeros((definition.endpoint.size1_in("e"), self.count))

    def fly(self, data: dict[str, Floats], seed: int) -> MonteCarlo:
        """Integrate all phases, and evaluate the limits along them and at the ends."""
        start = 0
        for phase, part in zip(self.definition.phases, self.plan.phases, strict=True):
            nx = len(phase.state_names)
            self.ends[start : start + 2] = [[part.start], [part.end]]
            initial = slice(start + 2, start + 2 + nx)
            self.ends[initial] = part.states(part.start)[:, None]
            self._solve_initial(initial)
            final = self._along(phase, part, self.ends[initial])
            start += phase.end_size
            self.ends[initial.stop : start] = final
            times = np.array([part.end])
            # A final bound that equals the bound at every instant is no other limit.
            low, high = (
                np.where(edge == bound, np.inf * sign, edge)
                for edge, bound, sign in zip(
                    phase.bounds("states", "final"), phase.bounds("states"), (-1, 1), strict=True
                )
            )
            names = tuple(f"final {name}" for name in phase.state_names)
            scale = phase.stacked("states", "scale")
            self._compare(names, part.name, final[:nx, :, None], times, low, high, scale)
        objective, boundary = (r.full() for r in self.definition.endpoint(self.ends, self.p))
        names = entry_names(self.definition.boundaries)
        table, times = boundary.reshape(len(names), self.count, 1), np.array([self.plan.end])
        low, high = self.definition.bounds("boundaries")
        scale = self.definition.stacked("boundaries", "scale")
        self._compare(names, "", table, times, low, high, scale)
        unknown = set(self.allowed) - {name for name, _ in self.extremes}
        if unknown:
            known = ", ".join(sorted({repr(name) for name, _ in self.extremes}))
            raise InvalidData(
                f"allowed must name limits, got {show(min(unknown))}; limits: {known}",
                field="allowed",
            )
        finite = np.isfinite(self.ends).all(axis=0) & np.isfinite(objective[0])
        ratio, when = np.where(finite, -np.inf, np.inf), np.full(self.count, self.plan.end)
        rows = []
        for (name, side), (limit, slack, excess, instants) in self.extremes.items():
            k = int(excess.argmax())
            worst = limit + (excess[k] if side == "upper" else -excess[k])
            rows.append(_row(name, side, limit, excess <= slack, worst, instants[k], k))
            relative = excess / max(slack, 1e-300)
            when, ratio = np.where(relative > ratio, instants, when), np.maximum(relative, ratio)
        k = int(ratio.argmax())
        total = _row("all limits", "upper", 1.0, ratio <= 1.0, ratio[k], when[k], k)
        return MonteCarlo(tuple(rows), total, objective[0], data, int((~finite).sum()), seed)

    def _solve_initial(self, places: slice) -> None:
        """Move initial states onto the equations that they and earlier values determine."""
        ends, size = self.definition.endpoint, places.stop - places.start
        row, column = map(np.array, ends.jac_sparsity(1, 0).get_triplet())
        low, high = self.definition.bounds("boundaries")
        here = row[(column >= places.start) & (column < places.stop)]
        rows = np.setdiff1d(
            np.intersect1d(np.flatnonzero(low == high), here), row[column >= places.stop]
        )
        if rows.size:
            names = ["boundary", "jac:boundary:e"]
            both = ends.factory("initial", ["e", "p"], names).map(self.count)
            for _ in range(NEWTON):
                values, slopes = (r.full() for r in both(self.ends, self.p))
                table = slopes.reshape(low.size, self.count, -1)[rows, :, places].transpose(1, 0, 2)
                miss = (low[rows][:, None] - values[rows]).T[:, :, None]
                self.ends[places] += (np.linalg.pinv(np.nan_to_num(table)) @ miss)[:, :size, 0].T

    def _along(self, phase: Phase, part: PhasePlan, initial: Floats) -> Floats:
        """Fly one phase, and return final states, integrals and states at instants, per draw."""
        nx, count, knots = len(phase.state_names), self.count, part.states.knots
        y = np.concatenate([initial, np.zeros((phase.integrals, count))])
        size = np.concatenate([phase.stacked("states", "scale"), np.ones(phase.integrals)])
        # SciPy bounds the root of the mean square error over all entries; each flight meets ERROR.
        error = ERROR / np.sqrt(y.size)
        absolute = (error * np.maximum(size[:, None], np.abs(y))).ravel()
        function = _flown(phase)
        rates, observed = function.map(count), function.map(count * SAMPLES)
        instants = part.start + np.array(phase.instants) * part.duration
        inner = np.full((instants.size, nx, count), np.nan)
        for k in range(knots.size - 1):
            times = np.linspace(knots[k], knots[k + 1], SAMPLES)

            def rate(t: float, y: Floats, k: int = k) -> Floats:
                u = part.controls.on(k, [2.0 * (t - knots[k]) / (knots[k + 1] - knots[k]) - 1.0])
                result = rates(
                    np.full((1, count), t), y.reshape(-1, count)[:nx], np.tile(u.T, count), self.p
                )
                return np.concatenate([result[0].full().ravel(), result[2].full().ravel()])

            table = np.full((*y.shape, SAMPLES), np.nan)
            if np.isfinite(y).all():
                here = np.flatnonzero((instants > knots[k]) & (instants <= knots[k + 1]))
                found = solve_ivp(
                    rate, times[[0, -1]], y.ravel(), "DOP853", times, here.size > 0, rtol=error,
                    atol=absolute,
                )  # fmt: skip
                if found.success:
                    table = found.y.reshape(table.shape)
                    for at in here:
                        inner[at] = found.sol(instants[at]).reshape(-1, count)[:nx]
            x, y = table[:nx], table[:, :, -1]
            scale = phase.stacked("states", "scale")
            self._compare(phase.state_names, part.name, x, times, *phase.bounds("states"), scale)
            if phase.paths:
                u = part.controls.on(k, np.linspace(-1.0, 1.0, SAMPLES)).T
                # CasADi orders the points flight by flight.
                path = observed(
                    np.tile(times, (1, count)), x.reshape(nx, -1), np.tile(u, count),
                    np.repeat(self.p, SAMPLES, axis=1),
                )[1].full().reshape(-1, count, SAMPLES)  # fmt: skip
                names, scale = entry_names(phase.paths), phase.stacked("paths", "scale")
                self._compare(names, part.name, path, times, *phase.bounds("paths"), scale)
        return np.concatenate([y, inner.reshape(-1, count)])

    def _compare(
        self, names: Sequence[str], phase: str, values: Floats, times: Floats, low: Floats,
        high: Floats, scale: Floats,
    ) -> None:  # fmt: skip
        """Update the extremes of limited values, shape (entries, draws, times)."""
        of = f" of {phase}" if phase and len(self.plan.phases) > 1 else ""
        for side, limits, sign in (("lower", low, -1.0), ("upper", high, 1.0)):
            for k in np.flatnonzero(np.isfinite(limits)):
                name, limit = names[int(k)] + of, float(limits[k])
                excess = np.nan_to_num(sign * (values[k] - limit), nan=np.inf)
                at = excess.argmax(axis=1)
                largest, instants = excess.max(axis=1), times[at]
                slack = self.allowed.get(name, self.tolerance * max(abs(limit), scale[k]))
                if (name, side) in self.extremes:
                    _, _, before, earlier = self.extremes[name, side]
                    instants = np.where(largest > before, instants, earlier)
                    largest = np.maximum(largest, before)
                self.extremes[name, side] = limit, slack, largest, instants


def _flown(phase: Phase) -> casadi.Function:
    """Return the function of a phase, with the algebraic variables that solve its equations."""
    solved = solved_controls(phase)
    if solved is None:
        return phase.function
    names = phase.function.name_in()
    t, x, u, p = (casadi.MX.sym(name, phase.function.size1_in(name)) for name in names)
    results = phase.function.call([t, x, solved(t, x, u, p), p])
    return casadi.Function("flown", [t, x, u, p], results, names, phase.function.name_out())


def _row(
    name: str, side: str, limit: float, keeps: NDArray[np.bool_], worst: float, time: float, flight: int
) -> FlightLimit:  # fmt: skip
    kept, count = int(keeps.sum()), keeps.size
    interval = binomtest(kept, count).proportion_ci(method="wilson")
    low, high = float(interval.low), float(interval.high)
    return FlightLimit(
        name, side, limit, kept, kept / count, low, high, float(worst), float(time), flight
    )
