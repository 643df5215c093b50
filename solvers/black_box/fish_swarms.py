"""Swarms of artificial fish: the state of a run, and what all fish do in one cycle.

All fish act at once on the places of the cycle before, so a cycle asks for values in a few batches.

Equations are those of the paper that :mod:`.fish_moves` names, whose text could be read up to its
introduction only. What its equations are about is known, not how they are printed: (1)-(7) follow Li, Shao and
Qian (2002) and common usage, the numbers go by the order of the behaviours, and what is derived
here is marked so.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from .fish_moves import attenuation, centres, leaders, neighbours, segment, towards
from .native import Objective

__all__ = ["AdaptiveSwarm", "ImprovedSwarm", "Swarm"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

#: Cycles without a better point after which fish leap, and the share of them that does: derived.
_CALM, _LEAPING = 3, 0.1
#: Inertia β of eq. 14 at the beginning and at the end.
_INERTIA = (0.2, 0.9)


class Swarm:
    """The artificial fish swarm of Li, Shao and Qian.

    Parameters
    ----------
    objective : Objective
        Asked for values; raises ``Ended`` through :meth:`begin` and :meth:`cycle`.
    generator : numpy.random.Generator
    options : mapping
        ``fish``, ``crowd``, ``visual``, ``step`` and ``tries`` of the backend.

    Attributes
    ----------
    place, motion : ndarray, shape (n, d)
        Where each fish is in the unit cube, and its last move.
    value : ndarray, shape (n,)
        Values there, infinite where there is none.
    """

    def __init__(
        self, objective: Objective, generator: Generator, options: Mapping[str, Any]
    ) -> None:
        self.objective, self.generator, self.options = objective, generator, options
        self.place = self.motion = np.empty((0, objective.dimension))
        self.value = np.empty(0)
        self._best, self._calm = math.inf, 0

    def begin(self, start: Floats | None) -> None:
        """Place the fish; the first one at `start`, whose value is the best so far."""
        known = self.objective.best
        self.place, self.value = self.drawn(self.options["fish"] - (start is not None))
        if start is not None:
            self.place = np.vstack([start, self.place])
            self.value = np.append(known, self.value)
        self.motion = np.zeros_like(self.place)

    def drawn(self, count: int) -> tuple[Floats, Floats]:
        """Return `count` places, drawn uniformly, and their values."""
        place = self.generator.random((count, self.objective.dimension))
        return place, self.objective(place)

    def ranges(self) -> tuple[float, float]:
        """Return visual and step, shares of each variable's range."""
        return self.options["visual"], self.options["step"]

    def base(self, who: Ints) -> Floats:
        """Return from where the moves of some fish begin: their places."""
        return self.place[who]

    def lengths(self, count: int) -> Floats:
        """Return `count` lengths of moves in steps, Rand of eq. 2: uniform from 0 to 1."""
        return self.generator.random(count)

    def moved(self, who: Ints, target: Floats, step: float) -> Floats:
        """Return where fish come to that move towards targets (eq. 2, 5 and 6).

        X + Rand · Step · (X_v - X) / ‖X_v - X‖; the border of the cube stops a fish.
        """
        move = towards(self.place[who], target, step * self.lengths(len(who)))
        return np.clip(self.base(who) + move, 0.0, 1.0)

    def around(self, centre: Floats, reach: float) -> Floats:
        """Return X + Rand · reach with a Rand from -1 to 1 for each variable (eq. 1, 3 and 7)."""
        return np.clip(centre + reach * self.generator.uniform(-1.0, 1.0, centre.shape), 0.0, 1.0)

    def cycle(self) -> None:
        """Let every fish follow or swarm, whichever leads to a better value, or else prey; then leap.

        A place is crowded where a fish there sees at least the share `crowd` of the swarm. The papers
        compare values divided by numbers of fish instead, which a constant added to the
        function would change.
        """
        visual, step = self.ranges()
        near = neighbours(self.place, visual)
        free = near.sum(axis=1) < self.options["crowd"] * len(near)
        lead = leaders(self.value, near)
        followers = np.flatnonzero((self.value[lead] < self.value) & free[lead])
        ahead = self.moved(followers, self.place[lead[followers]], step)
        swarming = np.flatnonzero(near.any(axis=1) & free)
        centre = centres(self.place, near)[swarming]
        worth = self.objective(np.vstack([ahead, centre]))
        better = worth[len(followers) :] < self.value[swarming]
        swarming = swarming[better]
        inward = self.moved(swarming, centre[better], step)
        place, value = self.place.copy(), self.value.copy()
        for who, there, found in (
            (followers, ahead, worth[: len(followers)]),
            (swarming, inward, self.objective(inward)),
        ):
            good = found < value[who]
            place[who[good]], value[who[good]] = there[good], found[good]
        hungry = np.flatnonzero(~(value < self.value))
        place[hungry], value[hungry] = self.prey(hungry, visual, step)
        self.motion = place - self.place
        self.place, self.value = place, value
        self.leap(visual)

    def prey(self, who: Ints, visual: float, step: float) -> tuple[Floats, Floats]:
        """Return where fish come to that look for something better, and the values there.

        A fish moves towards the first better place that it sees (eq. 2), or, where all its tries fail, anywhere
        within its step (eq. 3), be it for the worse.
        """
        return self.hunted(who, visual, step)[2:]

    def hunted(
        self, who: Ints, visual: float, step: float
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Return the better places that fish see with their values, and where they come to with those."""
        seen, worth = self.sought(who, np.full(self.options["tries"], visual))
        lucky = (worth < self.value[who])[:, None]
        there = np.where(lucky, self.moved(who, seen, step), self.around(self.base(who), step))
        return seen, worth, there, self.objective(there)

    def sought(self, who: Ints, reaches: Floats) -> tuple[Floats, Floats]:
        """Return the first better place X_v that each fish sees (eq. 1), and its value.

        Parameters
        ----------
        who : ndarray of int, shape (m,)
        reaches : ndarray, shape (tries,)
            How far it sees in each try.

        Returns
        -------
        place : ndarray, shape (m, d)
            Its own where it sees none.
        value : ndarray, shape (m,)
        """
        seen, worth = self.place[who], self.value[who]
        left = np.arange(len(who))
        for reach in reaches:
            if not left.size:
                break
            look = self.around(self.place[who[left]], float(reach))
            found = self.objective(look)
            good = found < worth[left]
            seen[left[good]], worth[left[good]] = look[good], found[good]
            left = left[~good]
        return seen, worth

    def leap(self, visual: float) -> None:
        """Move some fish anywhere within their vision once no better point is found for a while (eq. 7)."""
        best = self.objective.best
        self._calm = 0 if best < self._best else self._calm + 1
        self._best = best
        if self._calm < _CALM:
            return
        self._calm = 0
        count = len(self.value)
        who = self.generator.choice(count, math.ceil(_LEAPING * count), replace=False)
        self.place[who] = self.around(self.base(who), visual)
        self.value[who] = self.objective(self.place[who])


class AdaptiveSwarm(Swarm):
    """The swarm with the two changes of Yao and Ren, whose formulas are derived.

    What is known of them is that preying is enhanced and adaptive, and that vision and step change
    in segments of the run. Here, a fish that preys sees half as far with every try that fails, goes right to
    the better place that it sees, and stays where it sees none; :func:`.fish_moves.segment` scales
    vision and step.
    """

    def ranges(self) -> tuple[float, float]:
        """Return visual and step of the segment."""
        share = segment(self.objective.progress, self.options["finest"])
        return self.options["visual"] * share, self.options["step"] * share

    def prey(self, who: Ints, visual: float, step: float) -> tuple[Floats, Floats]:
        """Return the better places that fish see, or their own, and the values there."""
        return self.sought(who, visual * 0.5 ** np.arange(self.options["tries"]))


class ImprovedSwarm(Swarm):
    """The paper's swarm, with (``shrink``) or without its pull to the origin.

    As printed, places are multiplied with the inertia β (eq. 15-18): X becomes β X plus the move, which pulls
    to where all variables are 0. Without the pull, a move keeps the share β of the fish's last
    move, as in a particle swarm, and a fish that preys goes on to what it sees where its move leads to nothing
    better; both are derived.

    Eq. 16 is reversed in print: what was taken is that every move leads towards the better place, and
    happens where the target is better. Of eq. 12 and 13 it is known that the step is Gaussian; derived
    is that a length is the absolute value of a standard normal number, in steps that fall as vision does.
    Of eq. 14 it is known that β goes from 0.2 to 0.9; derived is that it does so linearly.
    """

    def drawn(self, count: int) -> tuple[Floats, Floats]:
        """Return the better half of places drawn uniformly and their opposites, a + b - X (eq. 8 and 9)."""
        place = self.generator.random((count, self.objective.dimension))
        place = np.vstack([place, 1.0 - place])
        value = self.objective(place)
        best = np.argsort(value, kind="stable")[:count]
        return place[best], value[best]

    def ranges(self) -> tuple[float, float]:
        """Return visual and step, attenuated (eq. 10-12)."""
        share = attenuation(self.objective.progress, self.options["power"])
        return self.options["visual"] * share, self.options["step"] * share

    def base(self, who: Ints) -> Floats:
        """Return β X, or X and the share β of the last move; β rises with the evaluations (eq. 14)."""
        first, last = _INERTIA
        inertia = first + (last - first) * self.objective.progress
        place = self.place[who]
        if self.options["shrink"]:
            origin = self.objective.origin
            found: Floats = origin + inertia * (place - origin)
            return found
        return place + inertia * self.motion[who]

    def lengths(self, count: int) -> Floats:
        """Return `count` lengths of moves in steps (eq. 13)."""
        return np.abs(self.generator.standard_normal(count))

    def prey(self, who: Ints, visual: float, step: float) -> tuple[Floats, Floats]:
        """Return where fish come to that look for something better, and the values there."""
        seen, worth, there, found = self.hunted(who, visual, step)
        if not self.options["shrink"]:
            worse = ~(found < worth)
            there[worse], found[worse] = seen[worse], worth[worse]
        return there, found
