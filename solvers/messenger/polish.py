"""Local optimisation of a tour: lengths by an interior-point method, turns by their multipliers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.messenger.checks import integrated
from ...models.messenger.model import MessengerTour
from ...models.messenger.motion import tour
from ...models.messenger.plan import SIGNS, TourPlan
from ...models.verification import ROUNDING
from ..contract.backend import Request
from .emission import safe_radius
from .newton import improve
from .stages import Legs

__all__ = ["polish"]

Floats = NDArray[np.float64]

#: Maximum steps of the interior-point method, and its initial barrier parameter.
STEPS, MU = 100, 1e-2
#: Least initial length of a primitive, as a share of a leg's length or of the turning radius.
LEAST = 1e-1
#: Factor on both in a second attempt, which stays closer to its starting point.
NEAR = 1e-1
#: Share below which a primitive has length 0, and least gain per length for a change of its turn.
NONE, WORTH = 1e-6, 1e-6
#: Maximum number of rounds of turn changes, and the relative gain required to continue.
ROUNDS, GAIN = 8, 1e-9
#: Tolerance of the end of a leg, as a share of a position's tolerance.
EXACT = 1e-10
#: Radius, as a share of a leg's length, below which the first stage sets the radius to 0.
FINE = 1e-2


class _Point(NamedTuple):
    """Iterate of the method: a tour in m and rad, relative to the start of the original plan.

    `states`, shape (k + 1, 4), are x, y, heading and length flown at the start and at the end of
    each leg. `signs` and `lengths`, shape (k, 3), describe the primitives. `costs` is the result of
    :func:`_costs` at a local optimum.
    """

    states: Floats
    signs: Floats
    lengths: Floats
    costs: Floats | None = None

    @property
    def length(self) -> float:
        """Length of the tour, in m."""
        return float(self.states[-1, 3])


def polish(problem: MessengerTour, plan: TourPlan, request: Request) -> TourPlan:
    """Return a verified tour of the same order that is at most as long as `plan`.

    Lengths and encounters move to a local optimum for the words of the legs, with three primitives
    each. Then primitives of length 0 change to the turn that shortens the tour according to the
    multipliers, and turns of more than half a circle are reversed, as long as this helps. `request`
    provides clock and stop flag. If a leg of the verified `plan` has more than three primitives
    after merging equal neighbours, or if the turning radius is 0, Ipopt optimises the lengths for
    the given words.
    """
    words = _extend_words(problem, plan) if problem.turning_radius > 0 else None
    if words is None:
        return _solve_program(problem, plan, request)
    field = _Field(problem, plan)
    point = field.point(words)
    optimum = field.solve(point) or field.solve(point, near=True)
    if optimum is None:
        return plan
    optima = [optimum]
    while len(optima) <= ROUNDS:
        for point in _variants(optima[-1], problem.turning_radius):
            if request.limit is not None:
                return field.best(optima)
            optimum = field.solve(point)
            if optimum is not None and optimum.length < optima[-1].length * (1.0 - GAIN):
                optima.append(optimum)
                break
        else:
            break
    return field.best(optima)


def _extend_words(problem: MessengerTour, plan: TourPlan) -> Floats | None:
    """Return signs of three primitives per leg, with turns that may continue after it, (k, 3), or None."""
    words: list[list[float]] = [[] for _ in range(problem.size + problem.closed)]
    for primitive in plan.primitives:
        if primitive.length > 0.0 and (
            not words[primitive.leg] or words[primitive.leg][-1] != SIGNS[primitive.turn]
        ):
            words[primitive.leg].append(SIGNS[primitive.turn])
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


def _assign_lengths(plan: TourPlan, signs: Floats) -> Floats:
    """Return the lengths of `plan` assigned to the primitives with `signs`, shape (k, 3)."""
    lengths, position, leg = np.zeros(signs.shape), 0, -1
    for primitive in plan.primitives:
        if primitive.leg != leg:
            leg, position = primitive.leg, 0
        same = np.flatnonzero(signs[leg, position:] == SIGNS[primitive.turn])
        if primitive.length > 0.0 and same.size:
            position += int(same[0])
            lengths[leg, position] += primitive.length
    return lengths


class _Field:
    """Constant data of all tours of one order, scaled by a leg's typical length."""

    def __init__(self, problem: MessengerTour, plan: TourPlan) -> None:
        n, met, start = problem.size, list(plan.order), plan.start[:2]
        legs = n + problem.closed
        self.problem, self.plan = problem, plan
        self.unit = max(plan.length / legs, problem.extent / n, float(problem.radius.max())) or 1.0
        self.radius = safe_radius(problem)[met] / self.unit
        self.place = np.ascontiguousarray((problem.positions[met] - start) / self.unit)
        self.drift = np.vstack([problem.drifts[met], problem.home_drift])[:legs] / problem.speed
        where, facing = float(problem.start is None), float(problem.heading is None)
        self.free = np.array([where, where, facing])
        self.heading = float(plan.start[2]) if problem.heading is None else problem.heading
        room = np.where(self.radius > 0.0, self.radius, problem.extent / n / self.unit)
        self.exact = max(EXACT * float(room.min()), 1e-13)
        # Small discs allow only short steps. The first stage therefore meets these vehicles at
        # their centres until the lengths converge.
        self.stages = [(self.radius, MU, LEAST)]
        fine = float(self.radius.min(where=self.radius > 0.0, initial=1.0))
        if fine < FINE:
            wide = np.where(self.radius < FINE, 0.0, self.radius)
            near = NEAR * MU
            self.stages = [(wide, near, near), (self.radius, near * fine, near * fine)]

    def point(self, signs: Floats) -> _Point:
        """Return the plan as an iterate; `signs` must contain the turns of its primitives."""
        plan = self.plan
        poses = integrated(plan, self.problem.turning_radius)
        tags = [primitive.leg for primitive in plan.primitives]
        ends = np.searchsorted(tags, np.arange(-1, len(signs)), side="right")
        flown = np.concatenate(
            [[0.0], np.cumsum([primitive.length for primitive in plan.primitives])]
        )
        places = poses[ends, :2] - plan.start[:2]
        states = np.column_stack([places, np.zeros(len(ends)), flown[ends]])
        return _Point(states, signs, _assign_lengths(plan, signs))

    def solve(self, point: _Point, *, near: bool = False) -> _Point | None:
        """Return the local optimum near `point`, with more and smaller steps if `near`; None on failure."""
        r, unit, signs = self.problem.turning_radius, self.unit, point.signs
        # Headings follow from the lengths. Reversing a turn changes all later headings by a full
        # circle.
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
            legs = Legs(bend, self.place, self.drift, discs, turn, self.free)
            steps = improve(states, lengths, legs, costates, share * mu, most, self.exact)
        if steps < 0:
            return None
        costs = _costs(states, lengths, bend, costates, unit / r)
        return _Point(states * [unit, unit, 1.0, unit], signs, lengths * unit, costs)

    def best(self, points: list[_Point]) -> TourPlan:
        """Return the last of `points` that is verified and not longer than the plan, otherwise the plan."""
        for point in reversed(points):
            start = np.array([*(self.plan.start[:2] + point.states[0, :2]), point.states[0, 2]])
            words = ["".join("RSL"[int(sign) + 1] for sign in row) for row in point.signs]
            candidate = tour(self.problem, self.plan.order, words, start, point.lengths.ravel())
            if (
                candidate.length <= self.plan.length
                and self.problem.verify(candidate, tolerance=ROUNDING).ok
            ):
                return candidate
        return self.plan


def _costs(states: Floats, lengths: Floats, bend: Floats, costates: Floats, tight: float) -> Floats:
    """Return the derivative of the tour's length if a primitive were R, S or L: shape (k, 3, 3).

    A primitive of curvature κ that begins in the direction e changes the length by
    λ · (e + κ J (D - D_k)) + λ_h κ + λ_s per unit of its length, where D - D_k is the displacement
    of the rest of the leg.
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


def _variants(optimum: _Point, r: float) -> Iterator[_Point]:
    """Yield candidates: turns changed according to the multipliers, then reversed long turns."""
    signs, lengths, costs = optimum.signs, optimum.lengths, optimum.costs
    assert costs is not None
    absent = lengths < NONE * np.where(signs == 0.0, lengths.mean(), r)
    lowest = costs.min(axis=-1)
    target = np.where(absent & (lowest < -WORTH), costs.argmin(axis=-1) - 1.0, signs)
    changed = np.argwhere(target != signs)
    if len(changed):
        yield optimum._replace(signs=target)
    if len(changed) > 1:
        row, k = changed[np.argmin(lowest[tuple(changed.T)])]
        candidate = signs.copy()
        candidate[row, k] = target[row, k]
        yield optimum._replace(signs=candidate)
    # Consecutive equal turns, also across an encounter, with a total of more than half a circle.
    flown = np.flatnonzero(~absent)
    for run in np.split(flown, np.flatnonzero(np.diff(signs.ravel()[flown])) + 1):
        angle = float((np.abs(signs) * lengths).ravel()[run].sum()) / r
        if angle > math.pi:
            candidate, rest = signs.copy(), lengths.copy()
            if angle < 2.0 * math.pi:
                candidate.ravel()[run] *= -1.0
            rest.ravel()[run] *= abs(2.0 * math.pi - angle) / angle
            yield optimum._replace(signs=candidate, lengths=rest)


def _solve_program(problem: MessengerTour, plan: TourPlan, request: Request) -> TourPlan:
    """Return the result of Ipopt for the program fitted to `plan`, or `plan` if it is not better."""
    from ..contract.registry import find_backend

    fitted = problem.formulate("primitives").fitted(plan)
    answer = request.within(
        find_backend("ipopt"), fitted.program, warm_start=fitted.encode(plan),
        # With an adaptive barrier strategy, one program in ten failed to converge (measured).
        options={"mu_strategy": "monotone"},
    )  # fmt: skip
    if answer.point is None:
        return plan
    result: TourPlan = fitted.decode(answer.point)
    better = result.length < plan.length
    return result if better and problem.verify(result, tolerance=ROUNDING).ok else plan
