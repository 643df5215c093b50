"""The paper's memetic algorithm, its variant without transformation, and a rival of its kind."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ..backend import Option, Request
from .rivals import Flight, Rival

__all__ = ["Memetic", "MemeticRelaxed", "MemeticUntransformed"]

_COMMON = {
    "generations": Option(20, "Generations.", int, lower=0),
    "population": Option(10, "Individuals for each vehicle (paper: NP / N).", int, lower=1),
    "mutation": Option(0.1, "Probability of each mutation (paper: p_m).", lower=0, upper=1),
    "period": Option(2, "Generations between local searches (paper: T_lp).", int, lower=1),
    "elite": Option(
        0.05, "Share of the population that local searches improve, one individual at least.",
        lower=0, upper=1,
    ),
    "gradient": Option(True, "Whether the local search along the gradient runs (GS).", bool),
    "step": Option(0.01, "First step of GS (paper: rho_l).", lower=1e-9),
    "sampling": Option(True, "Whether the local search by sampling runs (SS).", bool),
    "samples": Option(20, "Directions that SS tries for each vehicle (paper: N_s).", int, lower=1),
    "tolerance": Option(
        0.01, "Relative gain of a round below which a local search ends (paper: epsilon).", lower=0
    ),
    "interior": Option(
        False, "Whether a vehicle may be met inside its disc, not on the boundary only.", bool
    ),
    "restarts": Option(
        False, "Whether it starts again from fresh populations until the time limit.", bool
    ),
}  # fmt: skip


class Memetic(Rival):
    """MA, Algorithm 3 of the paper.

    From the paper: the encoding and its repair (:mod:`.decoding`), a population of 10 individuals a
    vehicle over 20 generations, order crossover, three mutations with probability 0.1 each, the
    transformation (:mod:`.transformation`) of every individual, and both local searches
    (:mod:`.local_search`) every second generation.

    Ours, where the paper is silent: first populations have random orders and directions, met at the
    first interception; parents win tournaments of two; a mutation of time multiplies an interval
    by a number between 0 and 2; the best of parents and children survive, twins last; and local
    searches improve the best twentieth of the population.
    """

    name = "memetic"
    options: ClassVar[Mapping[str, Option]] = {
        **_COMMON, "transformation": Option(True, "Whether Algorithm 4 is applied.", bool)
    }  # fmt: skip
    summary = "the paper's memetic algorithm (MA)"

    #: Whether intervals are genes.
    timed: ClassVar[bool] = True

    def search(self, flight: Flight, request: Request) -> Mapping[str, Any]:
        """Breed, until the generations or the time are used up."""
        runs = generations = 0
        while runs == 0 or (
            request.options["restarts"]
            and request.time_limit is not None
            and not request.control.stopped
        ):
            generations += self._breed(flight, request)
            runs += 1
        return {"runs": runs, "generations": generations}

    def _breed(self, flight: Flight, request: Request) -> int:
        """Run the algorithm once; return the number of generations."""
        from .memetic_kernels import Tour, evolve

        own, n = request.options, flight.problem.size
        size = own["population"] * n
        orders = np.empty((size, n), np.int64)
        genes, ends = np.empty((size, n, 3)), np.empty(size)
        samples = own["samples"] if own["sampling"] else 0
        elite = min(max(1, round(own["elite"] * size)), size)
        flight.poses[n, 3] = np.inf
        best = Tour(np.empty(n, np.int64), np.empty((n, 3)), flight.poses, flight.legs)
        for number in range(own["generations"] + 1):
            if number and request.control.stopped:
                return number - 1
            due = number % own["period"] == 0 and (own["gradient"] or samples > 0)
            end = evolve(
                number, orders, genes, ends, flight.fleet, flight.craft, own["mutation"],
                self.timed, own.get("transformation", False), own["interior"],
                elite if due else 0, own["gradient"], own["step"], samples, own["tolerance"],
                flight.rng, flight.flag, best,
            )  # fmt: skip
            flight.offer(best.order, end)
        return int(own["generations"])


class MemeticUntransformed(Memetic):
    """MA-T: the paper's memetic algorithm without Algorithm 4."""

    name = "memetic-untransformed"
    options: ClassVar[Mapping[str, Option]] = _COMMON
    summary = "the paper's memetic algorithm without its transformation (MA-T)"


class MemeticRelaxed(MemeticUntransformed):
    """MAR, as we take the paper's rival to be.

    The memetic algorithm with relaxed terminal heading of X. Zhang, J. Chen, B. Xin and Z. Peng,
    "A memetic algorithm for path planning of curvature-constrained UAVs performing surveillance of
    multiple ground targets", Chinese Journal of Aeronautics 27 (2014) 622-633, adapted to moving
    vehicles: there is no gene of time, every vehicle is met at its first interception.
    """

    name = "memetic-relaxed"
    summary = "a memetic algorithm with free end headings and no waiting (MAR)"
    timed = False
