"""Trajectories of minimum time through gates and polytopes within the limits of a vehicle.

:func:`fastest` is the function for other solvers. It takes arrays and returns arrays; see
:mod:`.minco_kernels` for the method and its sources.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...models.minimum_snap.formulations.hermite import hermite_basis
from .minco_descent import descend
from .minco_kernels import positions, spline
from .minco_limits import QUANTITIES, Multipliers, Task, measure
from .minco_task import Region, Rows, basis, limits_of, posed

__all__ = [
    "Fastest",
    "Region",
    "Rows",
    "Search",
    "coefficients_of",
    "fastest",
    "limits_of",
    "peak",
    "powers_between",
]

Floats = NDArray[np.float64]

#: Instants per segment with a multiplier for each limit, and instants of the final measurement.
INSTANTS, FINE = 16, 128
#: Factor of the penalties relative to the objective.
STIFF = 100.0
#: Shares of the effort in the objective, for minimum time. The last one keeps durations positive.
SHARES = (1e-3, 1e-5)
#: Most rounds of multipliers with the last share, evaluations of a descent, and the decrease of the
#: objective over PAST steps that ends it.
ROUNDS, LEAST, DECREASE, PAST = 16, 600, 2e-5, 5
#: First round that may be the last, and evaluations of a descent that repairs positions.
LEAST_ROUNDS, REPAIR = 2, 60
#: Share of the time by which the final stretching slows the motion without further descents.
SLOWER = 2e-3
#: Slack of the limits, relative to them, after the final stretching.
CLOSE = 1e-5
#: Length of an excess 1 of a polytope, relative to the mean segment.
SIZE = 0.05
#: Excess of the limits, relative to them, that ends the updates of multipliers.
KEPT = 2e-3


@dataclass(frozen=True)
class Fastest:
    """Result of :func:`fastest`.

    Parameters
    ----------
    durations : ndarray, shape (K,)
        Durations of the segments, s.
    coefficients : ndarray, shape (K, 2r, D)
        Ascending powers of the scaled time s of each segment, m, as in
        :class:`~crosstrack.models.Trajectory`.
    excess : float
        Largest relative excess of a limit or row at :data:`FINE` instants per segment, or of the last
        `exact` verification; at most 0 if all are kept.
    worst : str
        Limit with this excess.
    settled : bool
        Whether the total time changed by at most 1e-3 in the last round and the limits are kept.
    iterations, evaluations : int
        Work of all descents.
    """

    durations: Floats
    coefficients: Floats
    excess: float
    worst: str
    settled: bool
    iterations: int
    evaluations: int


class Search:
    """Descents with a sequence of weights and multipliers."""

    def __init__(self, task: Task, x: Floats, flag: NDArray[np.int8]) -> None:
        self.task, self.x, self.flag = task, x, flag
        self.segments = len(task.nodes)
        self.fine = task._replace(basis=basis(task.jets.shape[1], FINE + 1))
        self.iterations = self.evaluations = 0
        #: Unknowns of the last call of :meth:`jets`, and its result.
        self.last: tuple[Floats, tuple[Floats, float]] | None = None
        self.vehicle = np.zeros((self.segments, INSTANTS, 6))
        self.rows = np.zeros((len(task.offset), INSTANTS))
        #: Margins of the limits of each segment and of the rows, for peaks between instants.
        self.margins = np.zeros((self.segments, 6)), np.zeros(len(task.offset))

    @property
    def durations(self) -> Floats:
        """Durations of the segments, s."""
        durations: Floats = np.exp(self.x[: self.segments])
        return durations

    def jets(self) -> tuple[Floats, float]:
        """Return the derivatives at the nodes (NaN on failure) and the effort."""
        if self.last is not None and np.array_equal(self.last[0], self.x):
            return self.last[1]
        nodes, r, dimensions = self.task.jets.shape
        jets = np.zeros((nodes, r, dimensions))
        positions(self.task, self.x, jets)
        form, change = np.zeros((2, self.segments, 2 * r, 2 * r))
        band = np.zeros((dimensions, nodes * (r - 1), (self.task.width + 1) * (r - 1)))
        if not spline(self.task, self.durations, jets, form, change, band):
            jets[:] = np.nan
        local = jets[self.task.nodes].reshape(self.segments, 2 * r, dimensions)
        effort = float(np.einsum("kad,kab,kbd->", local, form, local))
        self.last = self.x.copy(), (jets, effort)
        return self.last[1]

    def excess(self, task: Task) -> tuple[Floats, Floats]:
        """Return the excesses of limits and rows at the instants of `task`; infinite on failure."""
        count = task.basis.shape[1]
        vehicle, rows = np.empty((self.segments, count, 6)), np.empty((len(task.offset), count))
        measure(task, self.durations, self.jets()[0], vehicle, rows)
        return np.nan_to_num(vehicle, nan=np.inf), np.nan_to_num(rows, nan=np.inf)

    def peaks(self) -> tuple[Floats, Floats]:
        """Return the largest excess of each limit, shape (K, 6), and row, shape (R,), between instants."""
        vehicle, rows = self.excess(self.fine)
        return peak(vehicle.swapaxes(1, 2)), peak(rows)

    def worst(self, positions: bool = True) -> tuple[float, str]:
        """Return the largest excess, relative to its limit, and its name."""
        vehicle, rows = self.peaks()
        if not positions:
            rows = rows[self.task.order > 0]
        # Only the tilt and the rows are not squares.
        sizes = np.append(
            vehicle.max(axis=0) * [0.5, 0.5, 0.5, 0.5, 1, 0.5], rows.max(initial=-1.0)
        )
        at = int(sizes.argmax())
        return float(sizes[at]), (*QUANTITIES, "rows")[at]

    def descend(self, time: float, effort: float, most: int, decrease: float) -> None:
        """Minimise with the current multipliers in at most `most` evaluations."""
        weight = STIFF * time * self.durations / INSTANTS
        held = Multipliers(self.vehicle, self.rows, weight, time, effort)
        _, iterations, evaluations = descend(
            self.task, held, self.x, self.flag, most, PAST, decrease
        )
        self.iterations += iterations
        self.evaluations += evaluations

    def update(self) -> None:
        """Update the multipliers from the excesses at the instants."""
        vehicle, rows = self.excess(self.task)
        self.vehicle = np.maximum(self.margins[0][:, None], self.vehicle + vehicle)
        self.rows = np.maximum(self.margins[1][:, None], self.rows + rows)

    def move_margins(self, *, loosen: bool, spare: float = 0.0) -> float:
        """Change the margins by the peaks between instants; return the largest peak of a position.

        A margin shifts the bound that the multipliers keep. Without `loosen` margins only grow. `spare`
        is the goal for the slack of the vehicle's limits.
        """
        peaks = self.peaks()
        share = (0.5, 0.5) if loosen else (1.0 if spare else 0.5, 1.5)
        least = -0.01 if loosen else 0.0
        moved = [
            np.maximum(0.0, margin + part * np.maximum(peak + slack, least))
            for margin, part, peak, slack in zip(
                self.margins, share, peaks, (spare, 0.25 * KEPT), strict=True
            )
        ]
        self.vehicle += (moved[0] - self.margins[0])[:, None]
        self.rows += (moved[1] - self.margins[1])[:, None]
        self.margins = moved[0], moved[1]
        return float(peaks[1][self.task.order == 0].max(initial=0.0))

    def stretch(self, factor: float) -> None:
        """Multiply all durations."""
        self.x[: self.segments] += np.log(factor)

    def stretch_to_limits(self) -> bool:
        """Stretch time by the smallest factor that keeps the limits; return whether there is one."""
        begin = self.x.copy()

        def excess(factor: float) -> float:
            self.x[:] = begin
            self.stretch(factor)
            return self.worst(positions=False)[0]

        low, above = 1.0, excess(1.0)
        if above <= 0.0:
            return True
        high = 1.0 + min(above, 1.0)
        below = excess(high)
        while below > 0.0:
            if high > 1e3:
                self.x[:] = begin
                return False
            low, above, high = high, below, 1.0 + 2.0 * (high - 1.0)
            below = excess(high)
        for _ in range(30):
            if below > -CLOSE or high - low <= 1e-9 * high:
                break
            # The secant moved by CLOSE towards the feasible side, and bisection if it does not progress.
            share = min(max((above + 0.5 * CLOSE) / (above - below), 0.05), 0.95)
            middle = low + share * (high - low)
            now = excess(middle)
            if now <= 0.0:
                high, below = middle, now
            else:
                low, above = middle, now
        self.x[:] = begin
        self.stretch(high)
        return True


def peak(values: Floats) -> Floats:
    """Return the largest value along the last axis, by parabolas through three instants."""
    if not values.size:
        return np.empty(values.shape[:-1])
    left, middle, right = values[..., :-2], values[..., 1:-1], values[..., 2:]
    bend = np.minimum(left - 2.0 * middle + right, 0.0)
    top = (middle >= left) & (middle >= right) & (bend < 0.0)
    rise = np.where(top, (right - left) ** 2 / (-8.0 * np.where(top, bend, -1.0)), 0.0)
    peak: Floats = np.maximum(values.max(axis=-1), (middle + rise).max(axis=-1))
    return peak


def fastest(
    points: Floats,
    limits: Floats,
    *,
    regions: Sequence[Region] | None = None,
    jets: Floats | None = None,
    rows: Rows | None = None,
    polytopes: Sequence[tuple[Floats, Floats]] = (),
    order: int = 3,
    weights: Floats | None = None,
    time_weight: float | None = None,
    periodic: bool = False,
    durations: Floats | None = None,
    exact: Callable[[Floats, Floats], float] | None = None,
    evaluations: int = 4000,
    flag: NDArray[np.int8] | None = None,
    seed: int = 0,
) -> Fastest:
    """Return a trajectory of locally minimum time through regions and polytopes within limits.

    Between the knots it is the spline of minimum effort ∫ Σ_j w_j |x^(j)|² dt, with 2r - 2 continuous
    derivatives at knots whose derivatives are free. Time is finally stretched to the limits.

    Parameters
    ----------
    points : ndarray, shape (K + 1, D)
        Start of the search for the positions of the knots, m. A point outside of its region is moved
        into it.
    limits : ndarray, shape (9,)
        Limits of the vehicle, from :func:`limits_of`.
    regions : sequence of Region, optional
        Region of each knot. By default the ends are fixed and inner knots are free: rows keep them
        in the polytopes of both segments.
    jets : ndarray, shape (K + 1, r, D), optional
        Derivatives 0 … r-1 at the knots in m/s^i; infinite entries are free, and order 0 is ignored.
        By default the ends are at rest and inner knots are free.
    rows : Rows, optional
        Linear bounds of positions and derivatives.
    polytopes : sequence of (normals, offsets), optional
        One polytope ``normals @ x <= offsets`` per segment, with unit normals, as other rows.
    order : int
        Order r of the effort: 3 jerk (default), 4 snap. At least 2.
    weights : ndarray, shape (r,), optional
        Weights of the orders 1 … r in the effort; by default only order r.
    time_weight : float, optional
        Minimise ``effort + time_weight ΣT``. By default the time alone, with a share of the effort
        that decreases to 1e-5.
    periodic : bool
        Whether the last knot is the first one, with all derivatives.
    durations : ndarray, shape (K,), optional
        Warm start, s.
    exact : callable, optional
        ``exact(durations, coefficients)`` returns the largest relative excess of a limit by an exact
        verification. Time is stretched until it is at most 0.
    evaluations : int
        Largest number of evaluations of the objective.
    flag : ndarray of int8, shape (1,), optional
        Stop flag polled by the kernel.
    seed : int
        A positive seed varies the first durations.

    Returns
    -------
    Fastest
        ``excess > 0`` if the search failed, which proves nothing.
    """
    count, dimensions = points.shape
    legs = np.linalg.norm(np.diff(points, axis=0), axis=1)
    length = float(legs.mean()) or 1.0
    if regions is None:
        inner = [Region("affine", np.zeros(dimensions), length * np.eye(dimensions))]
        regions = [Region.fixed(points[0]), *inner * (count - 2), Region.fixed(points[-1])]
    if jets is None:
        jets = np.full((count, order, dimensions), np.inf)
        jets[[0, -1], 1:] = 0.0
    none = np.empty((0, dimensions)), np.empty(0)
    more = Rows.of_polytopes(polytopes or [none], SIZE * length)
    parts = [more] if rows is None else [rows, more]
    rows = Rows(*(np.concatenate(part) for part in zip(*parts, strict=True)))
    if weights is None:
        weights = np.eye(order)[-1]
    task = posed(regions, jets, rows, np.asarray(limits, float), weights, periodic, INSTANTS)
    if durations is None:
        # The spline needs durations of similar size, also if knots coincide.
        durations = np.maximum(legs, 0.05 * length)
    start = [
        region.unknowns(point)
        for region, point in zip(regions[: len(task.kind)], points, strict=False)
    ]
    x = np.concatenate([np.log(durations), *start])
    if seed:
        x[: count - 1] += 0.3 * np.random.default_rng(seed).standard_normal(count - 1)
    search = Search(task, x, np.zeros(1, np.int8) if flag is None else flag)
    prices, settled = _optimise(search, time_weight, evaluations)
    return _finish(search, exact, prices, settled)


def _optimise(
    search: Search, time_weight: float | None, most: int
) -> tuple[tuple[float, float], bool]:
    """Descend with decreasing effort and updated multipliers.

    Return the last weights of time and effort, and whether the time converged within the limits.
    """
    if time_weight is not None:
        # Slower by s, the effort is smaller by about s^(1 - 2r). Both parts become equal.
        share = search.jets()[1] / max(time_weight * float(search.durations.sum()), 1e-300)
        search.stretch(float(np.clip(share, 1e-9, 1e9)) ** (0.5 / search.task.jets.shape[1]))
    slow = search.worst(positions=False)[0] <= 0.0
    for _ in range(0 if slow and time_weight is not None else 200):
        search.stretch(0.8 if slow else 1.25)
        if (search.worst(positions=False)[0] <= 0.0) != slow:
            break
    for share in SHARES if time_weight is None else (0.0,):
        total, effort = float(search.durations.sum()), search.jets()[1]
        if time_weight is None:
            time, weight = 1.0 / total, share / effort if effort > 0.0 else 0.0
        else:
            time, weight = (part / (time_weight * total + effort) for part in (time_weight, 1.0))
        last = share == SHARES[-1] or time_weight is not None
        former = total
        for number in range(ROUNDS if last else 1):
            left = most - search.evaluations
            if left <= 0 or search.flag[0]:
                return (time, weight), False
            search.descend(time, weight, min(left, LEAST), DECREASE)
            total = float(search.durations.sum())
            steady = abs(total - former) <= 1e-3 * total
            former = total
            if last and steady and number >= LEAST_ROUNDS:
                outside = search.move_margins(loosen=number < ROUNDS // 2)
                if outside <= 0.0 and (search.worst()[0] <= KEPT or number > ROUNDS // 2):
                    return (time, weight), True
            search.update()
    return (time, weight), False


def _finish(
    search: Search,
    exact: Callable[[Floats, Floats], float] | None,
    prices: tuple[float, float],
    settled: bool,
) -> Fastest:
    """Stretch time to the limits, and further until `exact` accepts."""
    spare, least, best = 0.0, np.inf, search.x
    for _ in range(ROUNDS):
        if search.flag[0]:
            break
        # Slower motions along the same path do not help a path that leaves its polytopes. With
        # a jerk along the thrust, they may turn faster: further descents need less slowing.
        if search.move_margins(loosen=False, spare=spare) <= 0.0:
            begin, total = search.x.copy(), float(search.durations.sum())
            if not search.stretch_to_limits():
                break
            after = float(search.durations.sum())
            value = prices[0] * after + prices[1] * search.jets()[1]
            if value < least:
                least, best = value, search.x.copy()
            if after <= (1.0 + SLOWER) * total:
                break
            search.x[:] = begin
            spare = 1.5 * KEPT
        search.descend(*prices, REPAIR, 0.0 if spare else DECREASE)
    search.x[:] = best
    kept = search.stretch_to_limits()
    factor, proven = 1.0, -np.inf
    for number in range(ROUNDS + 1):
        if exact is None:
            break
        proven = exact(search.durations, coefficients_of(search, search.jets()[0]))
        # Slower motions do not reduce an infinite excess.
        if proven <= 0.0 or not np.isfinite(proven) or number == ROUNDS:
            break
        factor *= 2.0
        search.stretch(1.0 + factor * min(proven, 0.1))
    excess, worst = max(search.worst(), (proven, "limits between the instants"))
    return Fastest(
        search.durations, coefficients_of(search, search.jets()[0]), excess, worst,
        settled and kept and proven <= 0.0, search.iterations, search.evaluations,
    )  # fmt: skip


def coefficients_of(search: Search, jets: Floats) -> Floats:
    """Return ascending powers of s, shape (K, 2r, D)."""
    return powers_between(search.durations, jets[search.task.nodes])


def powers_between(durations: Floats, ends: Floats) -> Floats:
    """Return ascending powers of s, shape (K, 2r, D), from derivatives at both ends, shape (K, 2, r, D)."""
    r = ends.shape[2]
    scale = durations[:, None] ** np.arange(float(r))
    local = ends * scale[:, None, :, None]
    start = local[:, :1, 0].copy()
    local[:, :, 0] -= start
    local = local.reshape(len(local), 2 * r, -1)
    powers: Floats = np.einsum("pa,kad->kpd", hermite_basis(r, 2 * r - 1), local)
    powers[:, 0] += start[:, 0]
    return powers
