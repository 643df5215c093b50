"""The paper's memetic algorithm, and its variants without transformation and for rest."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from ..contract.backend import Option, Request
from .decoding import KAPPA
from .memetic_kernels import Rules, evolve
from .rivals import Flight, RandomRival

__all__ = ["Memetic", "MemeticRelaxed", "MemeticUntransformed"]


class Memetic(RandomRival):
    """MA: Algorithm 3 of the paper as printed, with the parameters of its Table II.

    Individuals may violate their constraints, with a penalty (eq. 8). If the best individual
    violates them by more than the margin, the run returns no plan.
    """

    name = "memetic"
    options: ClassVar[Mapping[str, Option]] = {
        **RandomRival.options,
        "generations": Option(20, "Generations (paper: maxGen).", int, lower=0),
        "population": Option(10, "Individuals per vehicle (paper: NP / N).", int, lower=1),
        "mutation": Option(0.1, "Probability of a mutation (paper: p_m).", lower=0, upper=1),
        "period": Option(2, "Generations between local searches (paper: T_lp).", int, lower=1),
        "step": Option(0.01, "Step size of the gradient search GS (paper: rho_l).", lower=1e-6),
        "samples": Option(20, "Angles of the sampling search SS (paper: N_s).", int, lower=1),
        "margin": Option(
            0.01, "Length (m) by which a leg of an individual may be too short (paper: epsilon).", lower=0
        ),
    }  # fmt: skip
    summary = "the paper's memetic algorithm (MA)"

    #: Whether intervals are genes, and whether Algorithm 4 is applied.
    timed: ClassVar[bool] = True
    transformed: ClassVar[bool] = True

    def search_once(self, flight: Flight, request: Request) -> float:
        """Evolve for the given number of generations; return the length of the best plan (m)."""
        options, n = request.options, flight.problem.size
        size = options["population"] * n
        orders, genes = np.zeros((size, n), np.int64), np.zeros((size, n, 2))
        costs, best, value = np.empty(size), np.inf, np.inf
        flight.task = flight.task._replace(margin=options.get("margin", 0.0))
        rules = Rules(
            self.timed, self.transformed, options["mutation"], options["period"], options["step"],
            options.get("samples", 0),
        )  # fmt: skip
        for number in range(options["generations"] + 1):
            if number and request.control.stopped:
                break
            k = evolve(number, orders, genes, costs, flight.task, rules, flight.rng)
            if costs[k] < value:
                value = costs[k]
                # The penalty of an infeasible individual exceeds the margin times κ.
                if value < KAPPA * options.get("margin", np.inf) or not self.timed:
                    best = min(best, flight.offer(orders[k], genes[k]))
        return float(best)


class MemeticUntransformed(Memetic):
    """MA-T: the paper's memetic algorithm without Algorithm 4."""

    name = "memetic-untransformed"
    summary = "the paper's memetic algorithm without its transformation (MA-T)"
    transformed = False


class MemeticRelaxed(Memetic):
    """MAR: memetic algorithm for vehicles at rest, with the shortest encounter paths.

    After X. Zhang, J. Chen, B. Xin and Z. Peng, "A memetic algorithm for path planning of
    curvature-constrained UAVs performing surveillance of multiple ground targets", Chinese Journal of
    Aeronautics 27 (2014) 622-633. Individuals have no intervals, and the local search is GS.
    """

    name = "memetic-relaxed"
    options: ClassVar[Mapping[str, Option]] = {
        name: option
        for name, option in Memetic.options.items()
        if name not in ("samples", "margin")
    }
    summary = "a memetic algorithm with the shortest encounter paths (MAR)"
    timed = False
    transformed = False
