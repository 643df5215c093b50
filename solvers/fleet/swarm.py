"""Clusters of nodes and the particle swarm of PSO-AC (Algorithm 3).

Nodes are embedded as points, and a particle is a set of cluster centres.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from ...models.fleet import FleetRouting, Metric
from ...models.fleet.embedding import embed

__all__ = [
    "Colonies",
    "SwarmResult",
    "assign_vehicles",
    "energies",
    "k_means",
    "move_centres",
    "positions",
    "reclassify",
    "swarm",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flag = NDArray[np.int8]

#: Relative excess over the share due to rounding.
ROUNDING = 1e-12


def positions(model: FleetRouting) -> Floats:
    """Return the customers as points in the unit square, shape (customers, 2).

    Costs without points, and paths on a map, are embedded. Route lengths still use the true distances.
    """
    if model.points is not None and model.metric is not Metric.GRID:
        places = model.points[model.customers]
    else:
        places = embed(model.distances[np.ix_(model.customers, model.customers)])
    low, span = places.min(axis=0), np.ptp(places)
    scale = float(np.ptp(places, axis=0).max()) if span > 0 else 0.0
    return np.ascontiguousarray((places - low) / scale if scale > 0 else np.zeros_like(places))


def k_means(
    points: Floats, m: int, weights: Floats, share: float, rounds: int, rng: Generator
) -> Ints:
    """Return the cluster of each point by k-means with bounded clusters, shape (points,).

    The initial centres are `m` random points. Each round reclassifies the points and moves the centres to
    the means. It ends if no label changes.
    """
    n = len(points)
    centres = points[rng.choice(n, m, replace=False)].copy()
    labels, previous = np.empty(n, np.int64), np.full(n, -1)
    for _ in range(rounds):
        reclassify(points, centres, weights, share, labels)
        if np.array_equal(labels, previous):
            break
        previous = labels.copy()
        centres = move_centres(points, labels, centres)
    return labels


def reclassify(
    points: Floats, centres: Floats, weights: Floats, share: float, labels: Ints
) -> None:
    """Fill `labels` with the cluster of each sample (Algorithm 3, lines 6-10; eq. 20).

    Each centre in turn takes the nearest unassigned samples while the sum of their `weights` (R_i of eq.
    18) is at most `share` (R / m). The last centre takes the rest. If there are enough samples, a centre
    takes at least one and leaves one for each later centre. Points have shape (n, dims), centres (m, dims).
    """
    free = np.arange(len(points))
    for k, centre in enumerate(centres):
        later = len(centres) - 1 - k
        gaps = ((points[free] - centre) ** 2).sum(axis=1)
        order = free[np.argsort(gaps, kind="stable")]
        sums = np.cumsum(weights[order])
        within = (
            np.searchsorted(sums, share * (1.0 + ROUNDING), side="right") if later else free.size
        )
        count = max(min(int(within), free.size - later), 1)
        labels[order[:count]] = k
        free = np.sort(order[count:])


def move_centres(points: Floats, labels: Ints, centres: Floats) -> Floats:
    """Return the mean of each cluster (eq. 21); the centre of an empty cluster is unchanged."""
    m = len(centres)
    counts = np.bincount(labels, minlength=m)[:, None]
    sums = np.column_stack([np.bincount(labels, x, minlength=m) for x in points.T])
    return np.where(counts > 0, sums / np.maximum(counts, 1), centres)


def assign_vehicles(model: FleetRouting, labels: Ints) -> Ints:
    """Return the vehicle of each customer, one cluster per vehicle, shape (customers,).

    The assignment minimises the excess over capacities first and the total distance between depots
    and clusters second. Vehicles of one depot without capacities take the clusters in order.
    """
    if model.depots.size == 1 and model.capacity is None:
        return labels
    from scipy.optimize import linear_sum_assignment

    m, d, nodes = model.vehicles, model.distances, model.customers
    ways = np.zeros((m, m))
    for k in range(m):
        part = nodes[labels == k]
        if part.size:
            ways[k] = (d[model.homes][:, part] + d[part][:, model.homes].T).min(axis=1)
            if model.capacity is not None and model.demands is not None:
                excess = np.maximum(model.demands[part].sum() - model.capacity, 0.0)
                scale = float(model.demands.sum()) or 1.0
                ways[k] += 1e6 * float(d.max()) * excess / scale
    return np.asarray(linear_sum_assignment(ways)[1][labels], np.int64)


#: Stops of each vehicle.
Routes = list[list[int]]

#: Inertia of the first and of the last iteration: Y. Shi and R. Eberhart, "A modified particle swarm
#: optimizer", 1998. The paper's text has no value.
INERTIA = (0.9, 0.4)
#: Longest step of a centre along one axis: the side of the square that holds the samples. With 0.5 the
#: swarm settles earlier: the mean sum of berlin52 over 4 seeds is 8,603 instead of 8,545.
STRIDE = 1.0


def energies(model: FleetRouting) -> Floats:
    """Return R_i, the energy from each customer to all other nodes (eq. 18), shape (customers,)."""
    return np.asarray(model.distances[model.customers].sum(axis=1))


@dataclass
class Colonies:
    """Ant colonies that find a tour for each cluster (Algorithm 3, lines 12-22).

    `settings` holds ants, iterations, alpha, beta and evaporation of a colony. `flag` requests a stop.
    """

    model: FleetRouting
    settings: Floats
    pool: ThreadPoolExecutor | None
    flag: Flag

    def __post_init__(self) -> None:
        model = self.model
        # A power of two scales without rounding, so scaled problems have the same tours.
        self.exponent = int(np.frexp(float(model.distances.max()))[1])
        self.scaled = np.ascontiguousarray(np.ldexp(model.distances, -self.exponent))
        self._compiled: set[str] = set()

    def each(self, work: Callable[[int], None], count: int) -> None:
        """Call `work` with 0 … `count` - 1, on the threads of the pool if there is one."""
        first = 0
        if work.__name__ not in self._compiled:  # compile before threads run it
            self._compiled.add(work.__name__)
            work(0)
            first = 1
        for _ in (map if self.pool is None else self.pool.map)(work, range(first, count)):
            pass

    def tours(self, labels: Ints, draws: list[Generator]) -> tuple[Floats, list[Routes], int]:
        """Return lengths and routes of each particle by ant colonies, and the number of iterations.

        `labels`, shape (particles, n), is the cluster of each customer, and `draws` holds a generator per
        particle. The lengths have shape (particles, vehicles).
        """
        from .tour_kernels import colony

        ants, iterations, alpha, beta, evaporation = self.settings.tolist()
        loads = np.zeros((len(labels), self.model.vehicles))
        routes: list[Routes] = [[] for _ in labels]
        done = np.zeros(len(labels), np.int64)

        def find(p: int) -> None:
            for k in range(self.model.vehicles):
                nodes, d, order = self.part(labels[p], k)
                loads[p, k], steps = colony(
                    d, self.model.symmetric, int(ants), int(iterations), alpha, beta, evaporation,
                    draws[p], self.flag, order,
                )  # fmt: skip
                routes[p].append(nodes[order].tolist())
                done[p] += steps

        self.each(find, len(labels))
        return np.ldexp(loads, self.exponent), routes, int(done.sum())

    def part(self, labels: Ints, k: int) -> tuple[Ints, Floats, Ints]:
        """Return depot and nodes of cluster `k`, their distances, and a nearest-neighbour tour."""
        from .tour_kernels import nearest

        model = self.model
        nodes = np.concatenate([model.homes[k : k + 1], model.customers[labels == k]])
        d = np.ascontiguousarray(self.scaled[np.ix_(nodes, nodes)])
        order = np.empty(len(nodes) - 1, np.int64)
        nearest(d, order)
        return nodes, d, order


@dataclass
class SwarmResult:
    """Best plan of a swarm, and the counts of iterations and evaluations."""

    fitness: float
    routes: Routes
    iterations: int
    evaluations: int
    ant_iterations: int


def swarm(
    points: Floats, clusters: int, particles: int, iterations: int, learning: float, share: float,
    weights: Floats, colonies: Colonies, fitness: Callable[[Floats], float],
    offer: Callable[[Routes], Any], seeds: np.random.SeedSequence,
) -> SwarmResult:  # fmt: skip
    """Optimise cluster centres by a particle swarm and return the best plan (Algorithm 3).

    A particle starts at random samples. In each iteration it moves, its centres take their samples (lines
    5-11), the centres move to the means of these (eq. 21), and an ant colony per cluster finds the tours
    that determine the fitness (lines 12-23). Each particle has a separate generator, so the plan does not
    depend on the number of threads.

    The samples `points`, shape (n, dims), are in the unit square; a cluster has at most the sum `share` of
    their `weights`, except the last. `learning` is the value of both acceleration coefficients. `fitness`
    maps the lengths of all routes to a number, and `offer` is called with the routes of each new best
    particle.
    """
    swarm_seed, *particle_seeds = seeds.spawn(1 + particles)
    rng = np.random.default_rng(swarm_seed)
    draws = [np.random.default_rng(seed) for seed in particle_seeds]
    n = len(points)
    place = np.stack([points[rng.choice(n, clusters, replace=False)] for _ in range(particles)])
    speed = rng.uniform(-STRIDE, STRIDE, place.shape)
    personal, personal_worth = place.copy(), np.full(particles, np.inf)
    labels = np.zeros((particles, n), np.int64)
    best, result = place[0].copy(), SwarmResult(np.inf, [], 0, 0, 0)

    def classify(p: int) -> None:
        reclassify(points, place[p], weights, share, labels[p])
        place[p] = move_centres(points, labels[p], place[p])

    for step in range(iterations + 1):
        if step:
            if colonies.flag[0]:
                break
            inertia = INERTIA[0] + (INERTIA[1] - INERTIA[0]) * (step - 1) / max(iterations - 1, 1)
            pull = learning * rng.random((2, *place.shape))
            speed = inertia * speed + pull[0] * (personal - place) + pull[1] * (best - place)
            np.clip(speed, -STRIDE, STRIDE, out=speed)
            place = np.clip(place + speed, 0.0, 1.0)
        colonies.each(classify, particles)
        loads, routes, done = colonies.tours(labels, draws)
        worth = np.array([fitness(lengths) for lengths in loads])
        better = worth < personal_worth
        personal[better], personal_worth[better] = place[better], worth[better]
        lead = int(worth.argmin())
        if worth[lead] < result.fitness or not result.routes:
            best, result.fitness, result.routes = (
                place[lead].copy(),
                float(worth[lead]),
                routes[lead],
            )
            offer(result.routes)
        result.iterations, result.evaluations = step, result.evaluations + particles
        result.ant_iterations += done
    return result
