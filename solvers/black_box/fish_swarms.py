"""Artificial fish swarms: the state of a run and one iteration of all fish.

Source: "The Robot Path Planning Based on Improved Artificial Fish Swarm Algorithm", Mathematical Problems in
Engineering 2016, article 3297585, called the paper below. Lengths are shares of the variables' ranges, so
the functions do not depend on units. Distances are Euclidean in the unit cube. They equal the paper's distances
if all variables have the same range, as in all its test functions. All fish, one per row, act at once on the positions
of the previous iteration, so an iteration evaluates few batches.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from .native import Objective

__all__ = [
    "AdaptiveSwarm", "ImprovedSwarm", "Swarm", "attenuation", "gaussian", "inertia", "leaders", "segment", "towards",
]  # fmt: skip

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
#: Points of the unit cube, shape (m, d), and the values there, shape (m,).
Points = tuple[Floats, Floats]


#: Inertia β of eq. 14 at the start and at the end of a run, as printed in section 4.
_INERTIA = (0.2, 0.9)


def leaders(place: Floats, value: Floats, visual: float) -> Ints:
    """Return the best fish within the visual of each fish (eq. 1), or the fish itself if it sees no better one."""
    near = cdist(place, place) < visual
    best = np.where(near, value, math.inf).argmin(axis=1)
    every = np.arange(len(value))
    # If no fish within the visual has a value, argmin returns a fish out of sight.
    seen = near[every, best] & (value[best] < value)
    return np.where(seen, best, every)


def towards(place: Floats, target: Floats, length: Floats) -> Floats:
    """Return the moves of given lengths towards the targets: the fractions of eq. 3, 5, 6, 17 and 18.

    A length is the step times a random number. A fish at its target does not move.
    """
    way = target - place
    norm = np.linalg.norm(way, axis=1)
    share = np.divide(length, norm, out=np.zeros(len(way)), where=norm > 0)
    move: Floats = way * share[:, None]
    return move


def attenuation(progress: float, power: int) -> float:
    """Return α = exp(-25 (t / T)^s), the factor of the visual (eq. 10)."""
    return math.exp(-25.0 * progress**power)


def gaussian(progress: float, sigma: float) -> float:
    """Return the normal density of t / T with mean 0, the factor of the step (eq. 12)."""
    return math.exp(-0.5 * (progress / sigma) ** 2) / (sigma * math.sqrt(2.0 * math.pi))


def inertia(progress: float) -> float:
    """Return the inertia weight β, linear from 0.2 at the start to 0.9 at the end (eq. 14)."""
    start, end = _INERTIA
    return start - (start - end) * progress


def segment(progress: float, last: float) -> float:
    """Return the factor of visual and step in the three segments of a run of the hybrid swarm.

    It is 1 in the first quarter, `last` in the last quarter, and falls geometrically between them.
    """
    share: float = last ** min(max(2.0 * progress - 0.5, 0.0), 1.0)
    return share


class Swarm:
    """The standard artificial fish swarm of section 2 (AFSA).

    A fish moves one step towards the centre of the swarm (eq. 5) and towards the best fish that it sees (eq. 6), if
    that point is better and the centre is not crowded; the better of both moves counts. Otherwise it preys
    (eq. 2 and 3), and leaps if all its tries fail (eq. 7). As printed, a fish may get worse: only the
    bulletin, here ``Objective.best``, keeps the best point.

    Attributes `place`, shape (n, d), and `value` are positions in the unit cube and objectives, infinite for no value;
    `bulletin` has the best value before the first iteration and after each one.
    """

    #: Whether a move towards another fish or the centre is undone if it leads to a worse point.
    greedy: ClassVar[bool] = False

    def __init__(
        self, objective: Objective, generator: Generator, options: Mapping[str, Any]
    ) -> None:
        self.objective, self.generator, self.options = objective, generator, options
        self.place = np.empty((0, objective.dimension))
        self.value = np.empty(0)
        self.bulletin: list[float] = []

    @property
    def progress(self) -> float:
        """Share t / T of the iterations, or of the evaluations if option ``iterations`` is 0."""
        total: int = self.options["iterations"]
        return len(self.bulletin) / total if total else self.objective.progress

    def begin(self, start: Floats | None) -> None:
        """Draw the positions uniformly; the first fish is at `start`, whose value is known."""
        known = self.objective.best
        self.place = self.generator.random(
            (self.options["fish"] - (start is not None), self.objective.dimension)
        )
        self.value = self.objective(self.place)
        if start is not None:
            self.place = np.vstack([start, self.place])
            self.value = np.append(known, self.value)
        self.bulletin = [self.objective.best]

    def cycle(self) -> None:
        """Do one iteration of all fish."""
        visual, step = self.ranges()
        place, value = self.place.copy(), self.value.copy()
        has_moved = np.zeros(len(value), bool)
        for fish, target in self.targets(visual):
            positions, result = self.move_towards(fish, target, step)
            bar = value if self.greedy else np.where(has_moved, value, np.inf)
            better = result < bar[fish]
            place[fish[better]], value[fish[better]] = positions[better], result[better]
            has_moved[fish[better]] = True
        hungry = np.flatnonzero(~has_moved)
        place[hungry], value[hungry] = self.prey(hungry, visual, step)
        self.place, self.value = place, value
        self.bulletin.append(self.objective.best)

    def ranges(self) -> tuple[float, float]:
        """Return visual and step, as shares of each variable's range."""
        return self.options["visual"], self.options["step"]

    def targets(self, visual: float) -> list[tuple[Ints, Floats]]:
        """Return the fish that swarm with their target X_c, and those that follow with their target X_j."""
        centre = self.place.mean(axis=0, keepdims=True)
        crowd = (np.linalg.norm(self.place - centre, axis=1) < visual).mean()
        if crowd >= self.options["crowd"]:
            return []
        swarming = np.flatnonzero(self.objective(centre) < self.value)
        lead = leaders(self.place, self.value, visual)
        following = np.flatnonzero(self.value[lead] < self.value)
        return [
            (swarming, np.repeat(centre, len(swarming), axis=0)),
            (following, self.place[lead[following]]),
        ]

    def move_towards(self, who: Ints, target: Floats, step: float) -> Points:
        """Return new positions and values of fish that move towards targets (eq. 3, 5 and 6)."""
        return self.evaluate(
            self.place[who]
            + towards(self.place[who], target, step * self.generator.random(len(who)))
        )

    def prey(self, who: Ints, visual: float, step: float) -> Points:
        """Return new positions and values of fish that look for a better point.

        A fish moves towards the first better point in its visual (eq. 2 and 3). It leaps if all tries fail (eq. 7).
        """
        seen, worth = self.search_better(
            who, self.place[who], np.full(self.options["tries"], visual)
        )
        lucky = worth < self.value[who]
        seen[lucky], worth[lucky] = self.move_towards(who[lucky], seen[lucky], step)
        seen[~lucky], worth[~lucky] = self.sample_around(seen[~lucky], visual)
        return seen, worth

    def search_better(self, who: Ints, middle: Floats, reaches: Floats) -> Points:
        """Return the first better point that each fish finds around `middle`, or its own position, and the values.

        `reaches` has the largest change of a variable in each try.
        """
        seen, worth = self.place[who], self.value[who]
        remaining = np.arange(len(who))
        for reach in reaches:
            look, result = self.sample_around(middle[remaining], float(reach))
            better = result < worth[remaining]
            seen[remaining[better]], worth[remaining[better]] = look[better], result[better]
            remaining = remaining[~better]
        return seen, worth

    def sample_around(self, middle: Floats, reach: float) -> Points:
        """Return X + reach · rand and the values there, one rand in [-1, 1] per variable (eq. 2, 7 and 15)."""
        return self.evaluate(middle + reach * self.generator.uniform(-1.0, 1.0, middle.shape))

    def evaluate(self, place: Floats) -> Points:
        """Return points moved into the unit cube, and the values there."""
        inside = np.clip(place, 0.0, 1.0)
        return inside, self.objective(inside)


class AdaptiveSwarm(Swarm):
    """The hybrid adaptive swarm (HAAFSA) that the paper compares with; it does not print the formulas.

    Of Yao and Ren's method the paper states that preying is enhanced and adaptive, and that visual and step
    change in segments. Here a fish that preys sees half as far with each failed try, goes right to the better point that
    it sees, and stays if it sees none. Moves for the worse are undone. :func:`segment` scales visual
    and step.
    """

    greedy = True

    def ranges(self) -> tuple[float, float]:
        """Return visual and step of the segment."""
        share = segment(self.progress, self.options["finest"])
        return self.options["visual"] * share, self.options["step"] * share

    def prey(self, who: Ints, visual: float, step: float) -> Points:
        """Return the better points that fish see, or their own positions, and the values there."""
        return self.search_better(
            who, self.place[who], visual * 0.5 ** np.arange(self.options["tries"])
        )


class ImprovedSwarm(Swarm):
    """The improved artificial fish swarm of section 3 (IAFSA), as printed.

    Step 2 is part of each iteration: a fish moves to its opposite point if that is better. Visual is attenuated
    and the step follows a Gaussian. Each move starts at (1 - β) X instead of X, which pulls all fish towards the origin of the
    variables. A fish moves towards the centre and towards the best fish of the swarm; moves for the worse are
    undone. Otherwise it preys, and leaps if all its tries fail.
    """

    greedy = True

    def cycle(self) -> None:
        """Replace each fish by its opposite a + b - X if that is better (eq. 8 and 9), then do one iteration."""
        opposite, result = self.evaluate(1.0 - self.place)
        better = result < self.value
        self.place = np.where(better[:, None], opposite, self.place)
        self.value = np.where(better, result, self.value)
        super().cycle()

    def ranges(self) -> tuple[float, float]:
        """Return visual (eq. 10 and 11) and step (eq. 12 and 13)."""
        options, least = self.options, self.options["least"]
        visual = options["visual"] * attenuation(self.progress, options["power"]) + least
        return visual, options["step"] * gaussian(self.progress, options["sigma"]) + least

    def targets(self, visual: float) -> list[tuple[Ints, Floats]]:
        """Return all fish with the centre X_C of the swarm (eq. 17), and with its best fish X_best (eq. 18)."""
        every = np.arange(len(self.value))
        middles = self.place.mean(axis=0), self.place[self.value.argmin()]
        return [(every, np.repeat(middle[None], len(every), axis=0)) for middle in middles]

    def shrink(self, who: Ints) -> Floats:
        """Return (1 - β) X in the unit cube: the start of the moves of eq. 15, 17 and 18."""
        origin = self.objective.origin
        start: Floats = origin + (1.0 - inertia(self.progress)) * (self.place[who] - origin)
        return start

    def move_towards(self, who: Ints, target: Floats, step: float) -> Points:
        """Return new positions and values of fish that move towards targets (eq. 17 and 18)."""
        length = inertia(self.progress) * step * self.generator.random(len(who))
        return self.evaluate(self.shrink(who) + towards(self.place[who], target, length))

    def prey(self, who: Ints, visual: float, step: float) -> Points:
        """Return new positions and values: a better point (eq. 15 and 16), or else a leap (eq. 7)."""
        reach = inertia(self.progress) * step
        seen, worth = self.search_better(
            who, self.shrink(who), np.full(self.options["tries"], reach)
        )
        lost = ~(worth < self.value[who])
        seen[lost], worth[lost] = self.sample_around(seen[lost], visual)
        return seen, worth
