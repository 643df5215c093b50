"""Make a tour as short as its order allows: lengths by an interior-point method, turns by multipliers."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.messenger.checks import integrated
from ...models.messenger.model import MessengerTour
from ...models.messenger.motion import tour
from ...models.messenger.plan import SIGNS, TourPlan
from ...models.verification import ROUNDING
from ..backend import Request
from .newton import improve

__all__ = ["polish"]

Floats = NDArray[np.float64]

#: Steps of the interior-point method, and its barrier parameter at first.
STEPS, MU = 100, 1e-2
#: Share of a leg's length, or of the turning radius, that a primitive has at least at the start.
LEAST = 1e-1
#: Share of both in a second search, which stays nearer to its begin.
NEAR = 1e-1
#: Share up to which a primitive counts as none, and gain per length that makes another turn worth it.
NONE, WORTH = 1e-6, 1e-6
#: How often turns are changed, and the relative gain that makes another round worth it.
ROUNDS, GAIN = 8, 1e-9
#: Share of a position's tolerance by which the end of a leg may be off.
EXACT = 1e-10
#: Radius, as a share of a leg's length, below which vehicles are met at first without a radius.
FINE = 1e-2


class _Point(NamedTuple):
    """A tour as the method sees it, m and rad, from the start of the plan that it stems from.

    Parameters
    ----------
    states : ndarray, shape (k + 1, 4)
        x, y, heading, length flown at the start and at the end of each leg.
    signs, lengths : ndarray, shape (k, 3)
        Of the curvature of each primitive, and its length.
    costs : ndarray, shape (k, 3, 3), optional
        What :func:`_costs` says of a local optimum.
    """

    states: Floats
    signs: Floats
    lengths: Floats
    costs: Floats | None = None

    @property
    def length(self) -> float:
        """The length of the tour, m."""
        return float(self.states[-1, 3])


def polish(
    problem: MessengerTour, plan: TourPlan, request: Request, *, seconds: float | None = None
) -> TourPlan:
    """Return a tour of the same order that is verified and no longer than `plan`.

    Lengths and encounters move to a local optimum of the words that the legs have, of three primitives
    each; then primitives of length 0 become what the multipliers say would shorten the tour, and turns
    of more than half a circle turn the other way, as long as that helps.

    Parameters
    ----------
    problem : MessengerTour
        The problem.
    plan : TourPlan
        A verified tour. A leg of more than three primitives, where neighbours that turn alike count as
        one, or a turning radius of 0 leaves the whole to Ipopt, for the words as they are.
    request : Request
        The run of which this is a part: its clock and stop flag.
    seconds : float, optional
        Time for it; never more than what the run has left.
    """
    words = _three(problem, plan) if problem.turning_radius > 0 else None
    if words is None:
        return _by_program(problem, plan, request, seconds)
    limits = [one for one in (request.left(), seconds) if one is not None]
    end = time.perf_counter() + min(limits, default=math.inf)
    field = _Field(problem, plan)
    point = field.point(words)
    found = field.solved(point) or field.solved(point, near=True)
    if found is None:
        return plan
    better = [found]
    while len(better) <= ROUNDS:
        for point in _other(better[-1], problem.turning_radius):
            if time.perf_counter() > end or request.control.stopped:
                return field.best(better)
            found = field.solved(point)
            if found is not None and found.length < better[-1].length * (1.0 - GAIN):
                better.append(found)
                break
        else:
            break
    return field.best(better)


def _three(problem: MessengerTour, plan: TourPlan) -> Floats | None:
    """Return signs of three primitives a leg that can fly `plan`, shape (k, 3); None where none can.

    What is missing in a word is filled up so that a turn goes on beyond the encounter.
    """
    words: list[list[float]] = [[] for _ in range(problem.size + problem.closed)]
    for one in plan.primitives:
        if one.length > 0.0 and (not words[one.leg] or words[one.leg][-1] != SIGNS[one.turn]):
            words[one.leg].append(SIGNS[one.turn])
    if max(map(len, words)) > 3:
        return None
    full = np.zeros((len(words), 3))
    last = 1.0
    for leg, word in enumerate(words):
        after = next((sign for rest in words[leg + 1 :] for sign in rest[:1] if sign), last)
        if len(word) == 3:
            full[leg] = word
        elif not word or word == [0.0]:
            full[leg] = last, 0.0, after
        elif len(word) == 1:
            full[leg] = word[0], 0.0, after
        elif word[0] == 0.0:
            full[leg] = last, 0.0, word[1]
        else:
            full[leg] = word[0], word[1], after if word[1] == 0.0 else 0.0
        last = next((sign for sign in full[leg][::-1] if sign), last)
    return full


def _embedded(plan: TourPlan, signs: Floats) -> Floats:
    """Return the lengths of `plan` as those of the primitives with `signs`, shape (k, 3)."""
    lengths, at, leg = np.zeros(signs.shape), 0, -1
    for one in plan.primitives:
        if one.leg != leg:
            leg, at = one.leg, 0
        same = np.flatnonzero(signs[leg, at:] == SIGNS[one.turn])
        if one.length > 0.0 and same.size:
            at += int(same[0])
            lengths[leg, at] += one.length
    return lengths


class _Field:
    """What stays the same while the tours of one order are improved, in a leg's typical length."""

    def __init__(self, problem: MessengerTour, plan: TourPlan) -> None:
        n, met, start = problem.size, list(plan.order), plan.start[:2]
        legs = n + problem.closed
        self.problem, self.plan = problem, plan
        self.unit = max(plan.length / legs, problem.extent / n, float(problem.radius.max())) or 1.0
        self.radius = problem.radius[met] / self.unit
        self.place = np.ascontiguousarray((problem.positions[met] - start) / self.unit)
        self.drift = np.ascontiguousarray(problem.velocities[met] / problem.speed)
        where, facing = float(problem.start is None), float(problem.heading is None)
        self.free = np.array([where, where, facing])
        self.heading = float(plan.start[2]) if problem.heading is None else problem.heading
        room = np.where(self.radius > 0.0, self.radius, problem.extent / n / self.unit)
        self.exact = max(EXACT * float(room.min()), 1e-13)
        # Steps within small discs are short: first all lengths settle, with vehicles met at their
        # centres.
        self.stages = [(self.radius, MU, LEAST)]
        fine = float(self.radius.min(where=self.radius > 0.0, initial=1.0))
        if fine < FINE:
            wide = np.where(self.radius < FINE, 0.0, self.radius)
            near = NEAR * MU
            self.stages = [(wide, near, near), (self.radius, near * fine, near * fine)]

    def point(self, signs: Floats) -> _Point:
        """Return the plan with `signs`, which its primitives must have."""
        plan = self.plan
        poses = integrated(plan, self.problem.turning_radius)
        tags = [one.leg for one in plan.primitives]
        ends = np.searchsorted(tags, np.arange(-1, len(signs)), side="right")
        flown = np.concatenate([[0.0], np.cumsum([one.length for one in plan.primitives])])
        places = poses[ends, :2] - plan.start[:2]
        states = np.column_stack([places, np.zeros(len(ends)), flown[ends]])
        return _Point(states, signs, _embedded(plan, signs))

    def solved(self, point: _Point, *, near: bool = False) -> _Point | None:
        """Return the local optimum near `point`, sought with patience if `near`; None if none is found."""
        r, unit, signs = self.problem.turning_radius, self.unit, point.signs
        # Headings follow from the lengths: where a turn goes the other way round, all later ones
        # differ by a full circle.
        states = point.states / [unit, unit, 1.0, unit]
        turns = (signs * point.lengths).sum(axis=1) / r
        states[:, 2] = self.heading + np.append(0.0, np.cumsum(turns))
        turn = 0.0
        if self.problem.closed:
            turn = 2.0 * math.pi * round(float(turns.sum()) / (2.0 * math.pi))
        bend, lengths = signs * (unit / r), point.lengths / unit
        small = np.where(signs == 0.0, 1.0, min(r / unit, 1.0))
        costates = np.zeros(states.shape)
        steps = -1
        share, most = (NEAR, 3 * STEPS) if near else (1.0, STEPS)
        for discs, mu, least in self.stages:
            lengths = np.maximum(lengths, share * least * small)
            steps = improve(
                states, lengths, bend, self.place, self.drift, discs, turn, self.free, costates,
                share * mu, most, self.exact,
            )  # fmt: skip
        if steps < 0:
            return None
        costs = _costs(states, lengths, bend, costates, unit / r)
        return _Point(states * [unit, unit, 1.0, unit], signs, lengths * unit, costs)

    def best(self, points: list[_Point]) -> TourPlan:
        """Return the last of `points` that verifies and is no longer than the plan, else the plan."""
        for point in reversed(points):
            start = np.array([*(self.plan.start[:2] + point.states[0, :2]), point.states[0, 2]])
            words = ["".join("RSL"[int(sign) + 1] for sign in row) for row in point.signs]
            made = tour(self.problem, self.plan.order, words, start, point.lengths.ravel())
            if made.length <= self.plan.length and self.problem.verify(made, tolerance=ROUNDING).ok:
                return made
        return self.plan


def _costs(states: Floats, lengths: Floats, bend: Floats, costates: Floats, tight: float) -> Floats:
    """Return what the tour gains, per length, where a primitive were R, S or L: shape (k, 3, 3).

    The tour gets longer by λ · (e + κ J (D - D_k)) + λ_h κ + λ_s with a primitive of curvature κ that
    begins in the direction e, with what the leg still does to the position, D - D_k.
    """
    half = 0.5 * bend * lengths
    ahead = states[:-1, 2:3] + np.cumsum(2.0 * half, axis=1)
    chord = lengths * np.sinc(half / np.pi)
    steps = chord[..., None] * np.stack([np.cos(ahead - half), np.sin(ahead - half)], axis=-1)
    left = steps.sum(axis=1, keepdims=True) - np.cumsum(steps, axis=1)
    x, y, h, s = (costates[1:, i, None] for i in range(4))
    even = x * np.cos(ahead) + y * np.sin(ahead) + s
    odd = tight * (h + y * left[..., 0] - x * left[..., 1])
    return np.stack([even - odd, even, even + odd], axis=-1)


def _other(found: _Point, r: float) -> Iterator[_Point]:
    """Yield points that may lead further: the turns that the multipliers ask for, then short ways round."""
    signs, lengths, costs = found.signs, found.lengths, found.costs
    assert costs is not None
    none = lengths < NONE * np.where(signs == 0.0, lengths.mean(), r)
    least = costs.min(axis=-1)
    wanted = np.where(none & (least < -WORTH), costs.argmin(axis=-1) - 1.0, signs)
    changed = np.argwhere(wanted != signs)
    if len(changed):
        yield found._replace(signs=wanted)
    if len(changed) > 1:
        row, k = changed[np.argmin(least[tuple(changed.T)])]
        one = signs.copy()
        one[row, k] = wanted[row, k]
        yield found._replace(signs=one)
    # Turns that follow one another, also beyond an encounter, by more than half a circle together.
    flown = np.flatnonzero(~none)
    for run in np.split(flown, np.flatnonzero(np.diff(signs.ravel()[flown])) + 1):
        angle = float((np.abs(signs) * lengths).ravel()[run].sum()) / r
        if angle > math.pi:
            one, rest = signs.copy(), lengths.copy()
            if angle < 2.0 * math.pi:
                one.ravel()[run] *= -1.0
            rest.ravel()[run] *= abs(2.0 * math.pi - angle) / angle
            yield found._replace(signs=one, lengths=rest)


def _by_program(
    problem: MessengerTour, plan: TourPlan, request: Request, seconds: float | None
) -> TourPlan:
    """Return what Ipopt makes of the program that is fitted to `plan`, or `plan`."""
    from ..registry import find_backend

    fitted = problem.formulate("primitives").fitted(plan)
    answer = request.within(
        find_backend("ipopt"), fitted.program, time_limit=seconds, warm_start=fitted.encode(plan),
        # An adaptive one was measured to lose its way on one program in ten.
        options={"mu_strategy": "monotone"},
    )  # fmt: skip
    if answer.point is None:
        return plan
    found: TourPlan = fitted.decode(answer.point)
    better = found.length < plan.length
    return found if better and problem.verify(found, tolerance=ROUNDING).ok else plan
