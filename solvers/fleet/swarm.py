"""Particle swarm of PSO-AC (Algorithm 3): a particle is a set of cluster centres."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from ...models.fleet import FleetRouting

__all__ = ["Colonies", "SwarmResult", "energies", "swarm"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flag = NDArray[np.int8]

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

    `settings` holds ants, iterations, alpha, beta and evaporation of a colony. Particles are split into
    `threads` chunks, all but the first on the threads of `pool`. `flag` requests a stop.
    """

    model: FleetRouting
    settings: Floats
    threads: int
    pool: ThreadPoolExecutor | None
    flag: Flag

    def __post_init__(self) -> None:
        model = self.model
        # A power of two scales without rounding, so scaled problems have the same tours.
        self.exponent = int(np.frexp(float(model.distances.max()))[1])
        self.scaled = np.ascontiguousarray(np.ldexp(model.distances, -self.exponent))
        self._compiled: set[str] = set()

    def each(self, work: Callable[[int], None], count: int) -> None:
        """Call `work` with 0 … `count` - 1, in one chunk per thread."""
        first = 0
        if work.__name__ not in self._compiled:  # compile before threads run it
            self._compiled.add(work.__name__)
            work(0)
            first = 1

        def part(first: int, last: int) -> None:
            for entry in range(first, last):
                work(entry)

        parts = max(min(self.threads, count - first), 1)
        ends = np.linspace(first, count, parts + 1).astype(int).tolist()
        others = [] if self.pool is None else [
            self.pool.submit(part, *pair) for pair in itertools.pairwise(ends[1:])
        ]  # fmt: skip
        part(first, ends[1] if others else count)
        for entry in others:
            entry.result()

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
    from .clustering import move_centres, reclassify

    swarm_seed, *particle_seeds = seeds.spawn(1 + particles)
    rng = np.random.default_rng(swarm_seed)
    draws = [np.random.default_rng(seed) for seed in particle_seeds]
    n = len(points)
    place = np.stack([points[rng.choice(n, clusters, replace=False)] for _ in range(particles)])
    speed = rng.uniform(-STRIDE, STRIDE, place.shape)
    own, own_worth = place.copy(), np.full(particles, np.inf)
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
            speed = inertia * speed + pull[0] * (own - place) + pull[1] * (best - place)
            np.clip(speed, -STRIDE, STRIDE, out=speed)
            place = np.clip(place + speed, 0.0, 1.0)
        colonies.each(classify, particles)
        loads, routes, done = colonies.tours(labels, draws)
        worth = np.array([fitness(lengths) for lengths in loads])
        better = worth < own_worth
        own[better], own_worth[better] = place[better], worth[better]
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
