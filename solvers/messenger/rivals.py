"""Shared parts of the paper's algorithms: the problem as arrays, and the plan of an individual."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...jit import clock
from ...models.messenger.model import MessengerTour
from ...models.messenger.motion import tour
from ...models.messenger.plan import TourPlan
from ..contract.backend import Answer, Feature, Guarantee, Option, Request, Termination
from .decoding import Task, trace
from .emission import safe_radius
from .extensions import TourBackend

__all__ = ["Flight", "RandomRival", "Rival"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Least relative improvement of a new incumbent.
GAIN = 1e-12


@dataclass
class Flight:
    """A problem as arrays of the kernels (see :mod:`.decoding`), and the best plan so far.

    The problem is an open tour that begins with a given heading. `request` receives every better plan.
    """

    problem: MessengerTour
    request: Request
    task: Task = field(init=False)
    rng: np.random.Generator = field(init=False)
    plan: TourPlan | None = field(init=False, default=None)
    length: float = field(init=False, default=math.inf)

    def __post_init__(self) -> None:
        problem = self.problem
        assert problem.start is not None
        reach = safe_radius(problem)
        fleet = np.column_stack([problem.positions, problem.velocities, reach]).astype(float)
        poses = np.zeros((problem.size + 1, 4))
        poses[0, :3] = problem.start
        flag = self.request.control.flag
        self.task = Task(fleet, poses, problem.speed, problem.turning_radius, 0.0, flag)
        self.rng = np.random.default_rng(self.request.seed or 0)

    def blank(self) -> tuple[Ints, Floats]:
        """Return the order of the indices, and genes of 0."""
        return np.arange(self.problem.size), np.zeros((self.problem.size, 2))

    def offer(self, order: Ints, genes: Floats) -> float:
        """Keep the path of an individual if it is the shortest so far; return its length (m)."""
        legs = np.zeros((len(order), 6))
        length: float = trace(order, genes, self.task, legs) * self.problem.speed
        if length < self.length * (1.0 - GAIN):
            words = [
                "".join("RSL"[int(sign) + 1] for sign in row[3:][row[:3] > 0.0]) for row in legs
            ]
            lengths = legs[:, :3][legs[:, :3] > 0.0]
            start = self.task.poses[0, :3].copy()
            self.plan = tour(self.problem, order.tolist(), words, start, lengths)
            self.length = self.plan.length
            self.request.control.incumbent(self.length, self.plan)
        return length


class Rival(TourBackend):
    """Base class of the paper's algorithms; a subclass implements `search`."""

    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.INCUMBENTS, Feature.INTERRUPT})
    single_threaded = True

    @abstractmethod
    def search(self, flight: Flight, request: Request) -> Mapping[str, Any]:
        """Offer paths to `flight` as they improve; return statistics of the algorithm."""

    def refuses(self, problem: MessengerTour) -> str:
        """Return the reason why the paper's algorithms do not cover `problem`, or an empty string."""
        if problem.closed:
            return "closed tours: the paper's tours end at the last encounter"
        if problem.turning_radius == 0:
            return "a turning radius of 0: the paper's UAV is a Dubins vehicle"
        if problem.heading is None:
            return "a start without a heading: the paper's tours begin with a given one"
        return super().refuses(problem)

    def fly(self, problem: MessengerTour, request: Request) -> Answer:
        """Search, and return the best path."""
        begin = clock()
        flight = Flight(problem, request)
        statistics = self.search(flight, request)
        has_plan = flight.plan is not None
        return Answer(
            Termination.FEASIBLE if has_plan else Termination.NO_SOLUTION,
            request.control.limit,
            flight.plan,
            flight.length if has_plan else None,
            seconds={"solve": clock() - begin},
            statistics=dict(statistics),
            message="" if has_plan else "the best individual cannot be flown: a leg is too short",
        )


class RandomRival(Rival):
    """Base class of the paper's randomised algorithms, which the paper runs 25 times each."""

    features = frozenset({Feature.SEED, Feature.INCUMBENTS, Feature.INTERRUPT})
    options: ClassVar[Mapping[str, Option]] = {
        "runs": Option(
            1, "Independent runs; the plan is the best of them, and the statistics hold every length.",
            int, lower=1,
        ),
    }  # fmt: skip

    @abstractmethod
    def search_once(self, flight: Flight, request: Request) -> float:
        """Run the algorithm once; return the length of its best plan (m), or inf without a plan."""

    def search(self, flight: Flight, request: Request) -> Mapping[str, Any]:
        """Run the algorithm the requested number of times, or until a limit is reached."""
        lengths: list[float] = []
        while len(lengths) < request.options["runs"] and not (lengths and request.control.stopped):
            lengths.append(self.search_once(flight, request))
        return {"runs": len(lengths), "lengths": " ".join(map(repr, lengths))}
