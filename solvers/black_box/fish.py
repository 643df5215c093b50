"""``afsa``, ``haafsa`` and ``iafsa``: minimisation by swarms of artificial fish.

Sources: see :mod:`.fish_moves`, and Z.-H. Yao, Z.-H. Ren, X.-H. Zhu and S.-C. Li, "Path planning for coalmine
rescue robot based on hybrid adaptive artificial fish swarm algorithm", TELKOMNIKA Indonesian Journal of
Electrical Engineering 12(10), 2014, doi 10.11591/telkomnika.v12i8.5247.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ..option import Option
from .fish_swarms import AdaptiveSwarm, ImprovedSwarm, Swarm
from .native import BlackBoxBackend, Objective

__all__ = ["FishSwarm", "HybridFishSwarm", "ImprovedFishSwarm"]

_COMMON = {
    "fish": Option(100, "fish of the swarm; 100 in the paper", int, lower=1, upper=2000),
    "crowd": Option(
        0.6, "share of the swarm from which on a place is crowded; 0.6 in the paper", lower=0, upper=1
    ),
    "visual": Option(
        0.3, "how far a fish sees, as a share of each range; 0.3 in the paper", lower=0, upper=1
    ),
    "step": Option(
        0.1, "how far a fish moves at once, as a share of the ranges; 0.1 in the paper", lower=0, upper=1
    ),
    "tries": Option(
        3, "places that a fish looks at when it preys; derived by trial", int, lower=1, upper=1000
    ),
}  # fmt: skip


class FishSwarm(BlackBoxBackend):
    """The artificial fish swarm algorithm (AFSA), see :class:`.fish_swarms.Swarm`."""

    name = "afsa"
    summary = "artificial fish swarm: fish prey, swarm, follow and leap"
    options: ClassVar[Mapping[str, Option]] = _COMMON
    #: What does the cycles.
    swarm: ClassVar[type[Swarm]] = Swarm

    def search(self, objective: Objective) -> Mapping[str, Any]:
        """Do one cycle after another until the run is ended."""
        swarm = self.swarm(objective, objective.generator, objective.options)
        swarm.begin(objective.start)
        while True:
            swarm.cycle()


class HybridFishSwarm(FishSwarm):
    """The hybrid adaptive artificial fish swarm algorithm, see :class:`.fish_swarms.AdaptiveSwarm`."""

    name = "haafsa"
    summary = "artificial fish swarm with adaptive preying, and vision and step in segments"
    options: ClassVar[Mapping[str, Option]] = {
        **_COMMON,
        "finest": Option(
            0.01, "share of vision and step in the last segment; derived by trial", lower=1e-15, upper=1
        ),
    }  # fmt: skip
    swarm = AdaptiveSwarm


class ImprovedFishSwarm(FishSwarm):
    """The paper's improved artificial fish swarm algorithm, see :class:`.fish_swarms.ImprovedSwarm`."""

    name = "iafsa"
    summary = "artificial fish swarm with attenuated vision, Gaussian steps and inertia"
    options: ClassVar[Mapping[str, Option]] = {
        **_COMMON,
        "power": Option(
            3, "s of the attenuation of vision and step (eq. 10); 3 in the paper", int, lower=1, upper=30
        ),
        "shrink": Option(
            False, "as printed: inertia multiplies places, which pulls all fish to the origin", bool
        ),
    }  # fmt: skip
    swarm = ImprovedSwarm
