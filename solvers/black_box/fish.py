"""``afsa``, ``haafsa`` and ``iafsa``: minimisation by swarms of artificial fish.

Sources: see :mod:`.fish_swarms`, and Z.-H. Yao, Z.-H. Ren, X.-H. Zhu and S.-C. Li, "Path planning for coalmine
rescue robot based on hybrid adaptive artificial fish swarm algorithm", TELKOMNIKA Indonesian Journal of
Electrical Engineering 12(10), 2014, doi 10.11591/telkomnika.v12i8.5247.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from ..contract.option import Option
from .fish_swarms import AdaptiveSwarm, ImprovedSwarm, Swarm
from .native import BlackBoxBackend, Objective

__all__ = ["FishSwarm", "HybridFishSwarm", "ImprovedFishSwarm", "converged"]

_COMMON = {
    "fish": Option(100, "fish of the swarm; 100 in the paper", int, lower=1, upper=2000),
    "crowd": Option(
        0.6, "share of the swarm from which on its centre is crowded; 0.6 in the paper", lower=0, upper=1
    ),
    "visual": Option(
        0.3, "how far a fish sees, as a share of the ranges; 0.3 in the paper", lower=0, upper=1
    ),
    "step": Option(
        0.1, "largest move of a fish, as a share of the ranges; 0.1 in the paper", lower=0, upper=1
    ),
    "tries": Option(
        3, "tries of a fish that preys; not printed in the paper", int, lower=1, upper=1000
    ),
    "iterations": Option(
        0, "iterations T of the run; 0: until the evaluations are used up, with their share for t/T", int,
        lower=0, upper=10**6,
    ),
}  # fmt: skip
#: Part of the decrease of the best value after which a swarm has converged.
_CONVERGED = 0.99


class FishSwarm(BlackBoxBackend):
    """Standard artificial fish swarm algorithm (AFSA), see :class:`.fish_swarms.Swarm`."""

    name = "afsa"
    summary = "the paper's standard artificial fish swarm: fish prey, swarm, follow and leap"
    options: ClassVar[Mapping[str, Option]] = _COMMON
    #: State and iteration of the swarm.
    swarm: ClassVar[type[Swarm]] = Swarm

    def search(self, objective: Objective) -> Mapping[str, Any]:
        """Iterate until the iterations or the evaluations are used up."""
        swarm = self.swarm(objective, objective.generator, objective.options)
        swarm.begin(objective.start)
        iterations = objective.options["iterations"]
        while not iterations or len(swarm.bulletin) <= iterations:
            swarm.cycle()
        return {"iterations": iterations, "converged after": converged(swarm.bulletin)}


def converged(bulletin: Sequence[float]) -> int:
    """Return the first iteration after which 99 % of the decrease of the best values is done."""
    first = next((value for value in bulletin if math.isfinite(value)), bulletin[0])
    last = bulletin[-1]
    if first == last:
        return bulletin.index(first)
    bar = first - _CONVERGED * (first - last)
    return next(k for k, value in enumerate(bulletin) if value <= bar)


class HybridFishSwarm(FishSwarm):
    """Hybrid adaptive artificial fish swarm algorithm, see :class:`.fish_swarms.AdaptiveSwarm`."""

    name = "haafsa"
    summary = "artificial fish swarm with adaptive preying, and visual and step in segments"
    options: ClassVar[Mapping[str, Option]] = {
        **_COMMON,
        "finest": Option(
            0.01, "share of visual and step in the last segment; chosen by trial", lower=1e-15, upper=1
        ),
    }  # fmt: skip
    swarm = AdaptiveSwarm


class ImprovedFishSwarm(FishSwarm):
    """Improved artificial fish swarm algorithm (IAFSA), see :class:`.fish_swarms.ImprovedSwarm`."""

    name = "iafsa"
    summary = "the paper's swarm: opposition, attenuated visual, Gaussian step, inertia weight"
    options: ClassVar[Mapping[str, Option]] = {
        **_COMMON,
        "power": Option(3, "s of the attenuation of the visual (eq. 10); 3 in the paper", int, lower=1, upper=20),
        "sigma": Option(
            0.4, "σ of the step's Gaussian (eq. 12); not printed, 0.4 starts with the whole step", lower=0.01
        ),
        "least": Option(
            0.001, "smallest visual and step (eq. 11 and 13), as a share of the ranges; not printed", lower=0,
            upper=1,
        ),
    }  # fmt: skip
    swarm = ImprovedSwarm
