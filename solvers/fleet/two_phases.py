"""Clusters first, tours second: PSO-AC of the paper, and its rivals k-means-AC and TPHA."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from ...models.fleet import FleetRouting, Objective
from ..backend import Feature, Option, Request
from .rivals import Best, FleetHeuristic, available_threads

__all__ = ["KMeansAntColony", "PsoAntColony", "PsoAntColonySerial", "TwoPhase", "TwoPhases"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_RESTARTS = Option(False, "Whether it starts again, drawing anew, until the time limit.", bool)
_SLACK = Option(
    None,
    "Nodes that the largest cluster may have more than the smallest; by default 1, and any number "
    "where the balance counts nothing.",
    int,
    lower=1,
)
_COLONY = {
    "ants": Option(24, "Ants of a cluster.", int, lower=1, upper=10_000),
    "ant_iterations": Option(80, "Times that they walk.", int, lower=0),
    "alpha": Option(1.0, "Exponent of the pheromone (paper: α).", lower=0, upper=10),
    "beta": Option(3.0, "Exponent of the reciprocal distance (paper: β).", lower=0, upper=10),
    "evaporation": Option(0.1, "Share of the pheromone lost each time.", lower=1e-3, upper=1),
}  # fmt: skip


@dataclass
class _Stage:
    """What both phases work with."""

    problem: FleetRouting
    request: Request
    points: Floats
    clusters: int
    slack: int
    balance: float
    threads: int
    pool: ThreadPoolExecutor | None


class TwoPhases(FleetHeuristic):
    """Base of the algorithms that share the nodes out by where they lie, and then find each tour.

    Nodes are points: those given, or the embedding of their distances (:func:`.clustering.positions`).
    Tours are measured by the true distances. Limits are held against the plan, and not sought.
    """

    features = FleetHeuristic.features | {Feature.THREADS}

    @abstractmethod
    def partition(self, stage: _Stage, rng: Generator, counts: dict[str, int]) -> Ints:
        """Return the cluster of each point, and count what was done."""

    @abstractmethod
    def tour(self, d: Floats, order: Ints, symmetric: bool, stage: _Stage, rng: Generator) -> int:
        """Improve `order` in place; return the iterations done."""

    def search(self, best: Best, request: Request) -> Mapping[str, Any]:
        """Share out and find tours, once or until the time is used up."""
        from .clustering import clustered, positions

        model = best.problem
        points = positions(model)
        balance = request.options.get("balance")
        if balance is None:
            balance = {Objective.SUM: 0.0, Objective.DEVIATION: model.q}.get(model.objective, 1.0)
        slack = request.options["slack"] or (1 if balance > 0 else len(points))
        threads = 1 if self.single_threaded else available_threads(request)
        counts = {"runs": 0}
        with ExitStack() as stack:
            pool = stack.enter_context(ThreadPoolExecutor(threads)) if threads > 1 else None
            stage = _Stage(
                model,
                request,
                points,
                min(model.vehicles, len(points)),
                slack,
                balance,
                threads,
                pool,
            )
            while True:
                seed = [request.seed or 0, counts["runs"]]
                own, *each = np.random.SeedSequence(seed).spawn(1 + model.vehicles)
                labels = self.partition(stage, np.random.default_rng(own), counts)
                parts = clustered(model, points, labels)
                routes = self._tours(stage, parts, each, counts)
                best.offer_filled(routes)
                counts["runs"] += 1
                again = request.options["restarts"] and request.time_limit is not None
                if not again or request.control.stopped:
                    return counts

    def _tours(
        self, stage: _Stage, parts: list[Ints], seeds: list[Any], counts: dict[str, int]
    ) -> list[list[int]]:
        """Return the route of each vehicle, found by as many threads as there are."""
        from .colony_kernels import nearest

        model = stage.problem

        def routed(k: int) -> tuple[list[int], int]:
            nodes = np.concatenate([model.homes[k : k + 1], model.customers[parts[k]]])
            d = model.distances[np.ix_(nodes, nodes)]
            # Scaled by a power of two, so that scaled problems have the same tours.
            d = np.ascontiguousarray(np.ldexp(d, -np.frexp(d.max())[1]))
            order = np.empty(len(nodes) - 1, np.int64)
            nearest(d, order)
            symmetric = bool(np.array_equal(d, d.T))
            done = self.tour(d, order, symmetric, stage, np.random.default_rng(seeds[k]))
            return nodes[order].tolist(), done

        # The first alone, for it may be compiled then.
        found = [routed(0)]
        rest = range(1, model.vehicles)
        found += map(routed, rest) if stage.pool is None else stage.pool.map(routed, rest)
        counts["tour iterations"] = counts.get("tour iterations", 0) + sum(one[1] for one in found)
        return [one[0] for one in found]


class AntColony(TwoPhases):
    """Base of those whose second phase is an ant colony.

    From the paper: α = 1 and β = 3. Ours, for the paper's text on it is not at hand: an elitist ant
    system (M. Dorigo, V. Maniezzo and A. Colorni, "Ant system", 1996), in which each ant leaves
    pheromone in proportion to the best length over its own, and the best tour as much as all ants can;
    the first tour goes to the nearest node each time. Ways there and back may differ.
    """

    def tour(self, d: Floats, order: Ints, symmetric: bool, stage: _Stage, rng: Generator) -> int:
        """Improve `order` in place; return the iterations done."""
        from .colony_kernels import colony

        own = stage.request.options
        return colony(
            d, symmetric, own["ants"], own["ant_iterations"], own["alpha"], own["beta"],
            own["evaporation"], rng, stage.request.control.flag, order,
        )[1]  # fmt: skip


class PsoAntColony(AntColony):
    """PSO-AC, the paper's algorithm: clusters by a particle swarm, a tour of each by an ant colony.

    From the paper: a particle is the centres of all clusters, and its fitness a weighted distance of
    the nodes to them; nodes of the largest cluster go to the smallest until they are balanced (eq.
    18-21); both acceleration coefficients are 1.97; the swarm is evaluated in parallel.

    Ours, for the paper's text on it is not at hand: the fitness is the sum of all distances to centres
    and `balance` times the standard deviation of the clusters' sums; clusters are balanced where their
    numbers of nodes differ by `slack` at most, and the node moved is the one for which the change of
    its distance is least; the inertia falls from 0.9 to 0.4, and a centre moves at most a fifth of the
    width of the plane. Particles are evaluated by compiled loops on threads, or as array code on a GPU;
    random numbers are drawn on the CPU, so all three see the same particles, but array code sums in
    another order and may rank nearly equal ones differently.
    """

    name = "pso-ac"
    options: ClassVar[Mapping[str, Option]] = {
        "swarm": Option(64, "Particles (paper: 32 to 256).", int, lower=1, upper=100_000),
        "iterations": Option(60, "Moves of the swarm.", int, lower=0),
        "learning": Option(1.97, "Both acceleration coefficients.", lower=0, upper=10),
        "balance": Option(
            None,
            "Weight of the deviation in the fitness; by default q for 'sum-deviation', 0 for 'sum', "
            "else 1.",
            lower=0,
        ),
        "slack": _SLACK,
        **_COLONY,
        "restarts": _RESTARTS,
        "device": Option(
            "cpu", "What evaluates the swarm; 'gpu' needs the extra 'gpu' and CUDA.", str,
            ("cpu", "gpu"),
        ),
    }  # fmt: skip
    summary = "the paper's particle swarm and ant colony, evaluated in parallel (GPSO-AC)"

    def partition(self, stage: _Stage, rng: Generator, counts: dict[str, int]) -> Ints:
        """Return the labels of the best particle."""
        from .swarm import swarm, threaded, torch_evaluation

        own, flag = stage.request.options, stage.request.control.flag
        if own.get("device") == "gpu":
            evaluate = torch_evaluation(stage.points, stage.slack, stage.balance)
        else:
            evaluate = threaded(
                stage.points, stage.slack, stage.balance, stage.threads, stage.pool, flag
            )
        labels, done, evaluations = swarm(
            stage.points, stage.clusters, own["swarm"], own["iterations"], own["learning"], evaluate,
            rng, flag,
        )  # fmt: skip
        counts["iterations"] = counts.get("iterations", 0) + done
        counts["evaluations"] = counts.get("evaluations", 0) + evaluations
        return labels


class PsoAntColonySerial(PsoAntColony):
    """PSO-AC on one thread, with the same plan at the same seed."""

    name = "pso-ac-serial"
    features = FleetHeuristic.features
    single_threaded = True
    options: ClassVar[Mapping[str, Option]] = {
        name: option for name, option in PsoAntColony.options.items() if name != "device"
    }
    summary = "the paper's particle swarm and ant colony, on one thread (PSO-AC)"


class KMeansAntColony(AntColony):
    """k-means-AC, the paper's rival: clusters by k-means, a tour of each by an ant colony.

    Ours: Lloyd's rounds begin with nodes that are drawn, and nothing is balanced.
    """

    name = "kmeans-ac"
    options: ClassVar[Mapping[str, Option]] = {
        "rounds": Option(100, "Rounds of k-means at most.", int, lower=1),
        "slack": Option(
            None, "Nodes that the largest cluster may have more than the smallest; any number by default.",
            int, lower=1,
        ),
        **_COLONY,
        "restarts": _RESTARTS,
    }  # fmt: skip
    summary = "k-means, and an ant colony for each cluster"

    def partition(self, stage: _Stage, rng: Generator, counts: dict[str, int]) -> Ints:
        """Return the labels by k-means."""
        from .clustering import k_means

        own = stage.request.options
        slack = own["slack"] or len(stage.points)
        return k_means(stage.points, stage.clusters, slack, own["rounds"], rng)


class TwoPhase(TwoPhases):
    """TPHA, the paper's rival: balanced k-means, and a genetic algorithm for the tour of each cluster.

    After X. Xu, H. Yuan, M. Liptrott and M. Trovati, "Two phase heuristic algorithm for the
    multiple-travelling salesman problem", Soft Computing 22 (2018), doi 10.1007/s00500-017-2705-5:
    k-means bounded by the number of nodes of a cluster, then a genetic algorithm.

    Ours: clusters are balanced in each round as those of PSO-AC; parents win tournaments of two; order
    crossover; a mutation turns a stretch around or, where the ways there and back differ, moves a node;
    the best tour survives, and 2-opt (only where both ways are equally long) and Or-opt improve it.
    """

    name = "tpha"
    options: ClassVar[Mapping[str, Option]] = {
        "rounds": Option(100, "Rounds of k-means at most.", int, lower=1),
        "slack": _SLACK,
        "population": Option(60, "Tours of a cluster.", int, lower=2, upper=10_000),
        "generations": Option(300, "Generations.", int, lower=0),
        "mutation": Option(0.3, "Probability that a child is changed.", lower=0, upper=1),
        "restarts": _RESTARTS,
    }
    summary = "balanced k-means, and a genetic algorithm for each cluster (TPHA)"

    def partition(self, stage: _Stage, rng: Generator, counts: dict[str, int]) -> Ints:
        """Return the labels by balanced k-means."""
        from .clustering import k_means

        return k_means(
            stage.points, stage.clusters, stage.slack, stage.request.options["rounds"], rng
        )

    def tour(self, d: Floats, order: Ints, symmetric: bool, stage: _Stage, rng: Generator) -> int:
        """Improve `order` in place; return the generations done."""
        from .breeding_kernels import breed

        own = stage.request.options
        return breed(
            d, symmetric, own["population"], own["generations"], own["mutation"], rng,
            stage.request.control.flag, order,
        )[1]  # fmt: skip
