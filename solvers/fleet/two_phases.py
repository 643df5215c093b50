"""Clusters and tours: PSO-AC of the paper (Algorithm 3), and its rivals k-means-AC and TPHA."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.random import Generator, SeedSequence
from numpy.typing import NDArray

from ...models.fleet import FleetRouting
from ...models.fleet.checks import objective_of
from ..contract.backend import Feature, Option, Request
from .rivals import Best, FleetHeuristic
from .swarm import Colonies, assign_vehicles, energies, k_means, positions, swarm

__all__ = ["KMeansAntColony", "PsoAntColony", "PsoAntColonySerial", "TwoPhase", "TwoPhases"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_RESTARTS = Option(False, "Start again with new random numbers until the time limit.", bool)


def _colony(ants: int, iterations: int) -> dict[str, Option]:
    return {
        "ants": Option(ants, "Ants per cluster.", int, lower=1, upper=10_000),
        "ant_iterations": Option(iterations, "Tours of each ant.", int, lower=0),
        "alpha": Option(1.0, "Exponent of the pheromone (paper: 1).", lower=0, upper=10),
        "beta": Option(3.0, "Exponent of the reciprocal distance (paper: 3).", lower=0, upper=10),
        "evaporation": Option(
            0.1, "Share of the pheromone lost in an iteration.", lower=1e-3, upper=1
        ),
    }  # fmt: skip


@dataclass
class Stage:
    """Data of one run, shared by its phases."""

    best: Best
    points: Floats
    weights: Floats
    clusters: int
    colonies: Colonies
    counts: dict[str, int]

    @property
    def share(self) -> float:
        """Largest sum of the weights of a cluster, 1 / m of all."""
        return float(self.weights.sum()) / self.clusters

    def count(self, **more: int) -> None:
        """Add to the statistics of the run."""
        for name, number in more.items():
            name = name.replace("_", " ")
            self.counts[name] = self.counts.get(name, 0) + number


class TwoPhases(FleetHeuristic):
    """Base class of the algorithms that cluster the nodes and find a tour of each cluster.

    Clusters use the model's points, or an embedding of the distances (:func:`.swarm.positions`). Tour
    lengths use the true distances. Limits of the model are checked but do not guide the search.
    """

    features = FleetHeuristic.features | {Feature.THREADS}

    @abstractmethod
    def once(self, stage: Stage, seeds: SeedSequence) -> None:
        """Run the algorithm once and offer its plans to the incumbent."""

    def weights(self, model: FleetRouting) -> Floats:
        """Return the weights of the nodes, R_i of eq. 18."""
        return energies(model)

    def colonies(self, request: Request) -> type[Colonies]:
        """Return the implementation of the ant colonies."""
        return Colonies

    def search(self, best: Best, request: Request) -> Mapping[str, Any]:
        """Run the algorithm once, or until the time limit with the option ``restarts``."""
        model, options = best.problem, request.options
        points = positions(model)
        names = ("ants", "ant_iterations", "alpha", "beta", "evaporation")
        settings = np.array([float(options.get(name, 0)) for name in names])
        threads = 1 if self.single_threaded else request.available_threads
        counts = {"runs": 0}
        with ExitStack() as stack:
            pool = stack.enter_context(ThreadPoolExecutor(threads)) if threads > 1 else None
            kind = self.colonies(request)
            colonies = kind(model, settings, pool, request.control.flag)
            clusters = min(model.vehicles, len(points))
            stage = Stage(best, points, self.weights(model), clusters, colonies, counts)
            while True:
                self.once(stage, SeedSequence([request.seed or 0, counts["runs"]]))
                counts["runs"] += 1
                again = options["restarts"] and request.time_limit is not None
                if not again or request.control.stopped:
                    return counts


class PsoAntColony(TwoPhases):
    """GPSO-AC, the paper's algorithm: a swarm of cluster centres and an ant colony per cluster.

    Algorithm 3. A particle holds the centres of all clusters. In each iteration each centre in turn takes
    its nearest unassigned nodes while the sum of their energies R_i (eq. 18) is at most R / m
    (eq. 19, 20), the centres move to the means of their nodes (eq. 21), and an ant colony in each
    cluster finds a tour. The fitness is the objective of the model at the lengths of these tours:
    eq. 15 for "sum", eq. 15 plus q times eq. 16 for "sum-variance". Particles are evaluated in
    parallel on threads. Each has a separate generator, so the plan does not depend on the number of
    threads. With ``device="gpu"`` the colonies of all particles run as one batch of PyTorch array
    code, with different random numbers.

    From the paper: swarms of 32 to 256, 1.97 for both acceleration coefficients, α = 1 and β = 3. The
    text lacks eq. 20-22 and all other parameters. These are ours: the inertia falls from 0.9 to 0.4; the
    colony is an elitist ant system (M. Dorigo, V. Maniezzo and A. Colorni, "Ant system", 1996) that
    starts from the nearest-neighbour tour. The documentation page describes the choice.
    """

    name = "pso-ac"
    options: ClassVar[Mapping[str, Option]] = {
        "swarm": Option(32, "Particles (paper: 32 to 256).", int, lower=1, upper=100_000),
        "iterations": Option(50, "Moves of the swarm.", int, lower=0),
        "learning": Option(
            1.97, "Both acceleration coefficients (paper: 1.97).", lower=0, upper=10
        ),
        **_colony(10, 50),
        "restarts": _RESTARTS,
        "device": Option(
            "cpu", "Device of the ant colonies; 'gpu' needs the extra 'gpu' and CUDA.", str,
            ("cpu", "gpu"),
        ),
    }  # fmt: skip
    summary = "the paper's particle swarm and ant colony, evaluated in parallel (GPSO-AC)"

    def colonies(self, request: Request) -> type[Colonies]:
        """Return the compiled loops, or the array code for the option ``device="gpu"``."""
        if request.options.get("device", "cpu") == "cpu":
            return Colonies
        from .array_colonies import torch_colonies

        return torch_colonies()

    def once(self, stage: Stage, seeds: SeedSequence) -> None:
        """Run the swarm and offer the plan of each improving particle."""
        best, options = stage.best, stage.best.request.options
        result = swarm(
            stage.points, stage.clusters, options["swarm"], options["iterations"], options["learning"],
            stage.share, stage.weights, stage.colonies,
            lambda loads: objective_of(best.problem, loads), best.offer_filled, seeds,
        )  # fmt: skip
        for name in ("iterations", "evaluations", "ant_iterations"):
            stage.count(**{name: getattr(result, name)})


class PsoAntColonySerial(PsoAntColony):
    """PSO-AC of the paper: GPSO-AC on one thread, with the same plan at the same seed."""

    name = "pso-ac-serial"
    features = FleetHeuristic.features
    single_threaded = True
    options: ClassVar[Mapping[str, Option]] = {
        name: option for name, option in PsoAntColony.options.items() if name != "device"
    }
    summary = "the paper's particle swarm and ant colony, on one thread (PSO-AC)"


class ClusterFirst(TwoPhases):
    """Base class of the paper's competitors: bounded k-means, then one tour per cluster."""

    @abstractmethod
    def tours(
        self, stage: Stage, labels: Ints, rng: Generator
    ) -> tuple[list[list[int]], dict[str, int]]:
        """Return the routes through the clusters, and the statistics."""

    def once(self, stage: Stage, seeds: SeedSequence) -> None:
        """Cluster the nodes, find the tours and offer the plan."""
        rng, best = np.random.default_rng(seeds), stage.best
        rounds = best.request.options["rounds"]
        labels = k_means(stage.points, stage.clusters, stage.weights, stage.share, rounds, rng)
        routes, counts = self.tours(stage, assign_vehicles(best.problem, labels), rng)
        best.offer_filled(routes)
        stage.count(**counts)


class KMeansAntColony(ClusterFirst):
    """k-means-AC, a competitor in the paper: k-means once, then an ant colony per cluster.

    The paper gives only the name. These are ours: PSO-AC's reclassification and the move of the
    centres repeat until no label changes, and the colony is that of PSO-AC.
    """

    name = "kmeans-ac"
    options: ClassVar[Mapping[str, Option]] = {
        "rounds": Option(100, "Largest number of rounds of k-means.", int, lower=1),
        **_colony(24, 80),
        "restarts": _RESTARTS,
    }  # fmt: skip
    summary = "k-means, and an ant colony for each cluster"

    def tours(
        self, stage: Stage, labels: Ints, rng: Generator
    ) -> tuple[list[list[int]], dict[str, int]]:
        """Return the tours of ant colonies."""
        _, routes, done = stage.colonies.tours(labels[None], [rng])
        return routes[0], {"ant_iterations": done}


class TwoPhase(ClusterFirst):
    """TPHA, a competitor in the paper: bounded k-means, then a genetic algorithm per cluster.

    The paper cites X. Xu, H. Yuan, M. Liptrott and M. Trovati, "Two phase heuristic algorithm for the
    multiple-travelling salesman problem", Soft Computing 22 (2018), doi 10.1007/s00500-017-2705-5, and
    prints no details. Ours: a cluster takes at most 1 / m of the nodes; parents win tournaments of
    two; order crossover; a mutation reverses a segment or, if the two directions differ in length,
    moves a node; the best tour survives, and 2-opt (only for symmetric distances) and Or-opt improve it.
    """

    name = "tpha"
    options: ClassVar[Mapping[str, Option]] = {
        "rounds": Option(100, "Largest number of rounds of k-means.", int, lower=1),
        "population": Option(60, "Tours per cluster.", int, lower=2, upper=10_000),
        "generations": Option(300, "Generations.", int, lower=0),
        "mutation": Option(0.3, "Probability that a child is changed.", lower=0, upper=1),
        "restarts": _RESTARTS,
    }
    summary = "balanced k-means, and a genetic algorithm for each cluster (TPHA)"

    def weights(self, model: FleetRouting) -> Floats:
        """Return 1 for each node."""
        return np.ones(len(model.customers))

    def tours(
        self, stage: Stage, labels: Ints, rng: Generator
    ) -> tuple[list[list[int]], dict[str, int]]:
        """Return tours by a genetic algorithm, with the clusters distributed over threads."""
        from .tour_kernels import breed

        model, request = stage.best.problem, stage.best.request
        options = request.options
        draws, routes = rng.spawn(model.vehicles), [list[int]()] * model.vehicles
        done = np.zeros(model.vehicles, np.int64)

        def find(k: int) -> None:
            nodes, d, order = stage.colonies.part(labels, k)
            done[k] = breed(
                d, model.symmetric, options["population"], options["generations"], options["mutation"],
                draws[k], request.control.flag, order,
            )[1]  # fmt: skip
            routes[k] = nodes[order].tolist()

        stage.colonies.each(find, model.vehicles)
        return routes, {"generations": int(done.sum())}
