"""What the paper's algorithms and its rivals share: the problem as arrays, and the plan of a path."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation
from ...jit import clock
from ...models.messenger.model import MessengerTour
from ..backend import Answer, Backend, Feature, Guarantee, Limit, Request, Termination

if TYPE_CHECKING:
    from ...models.messenger.plan import TourPlan

__all__ = ["Flight", "Rival"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Share of a radius that rounding is left.
MARGIN = 1e-9
#: Relative gain that counts as one.
GAIN = 1e-12


@dataclass
class Flight:
    """A problem as the kernels want it (see :mod:`.decoding`), and the best path so far.

    Parameters
    ----------
    problem : MessengerTour
        An open tour that begins with a given heading.
    request : Request
        Told of every better path.
    """

    problem: MessengerTour
    request: Request
    fleet: Floats = field(init=False)
    craft: Floats = field(init=False)
    poses: Floats = field(init=False)
    legs: Floats = field(init=False)
    rng: np.random.Generator = field(init=False)
    plan: TourPlan | None = field(init=False, default=None)
    length: float = field(init=False, default=math.inf)

    def __post_init__(self) -> None:
        one = self.problem
        assert one.start is not None
        radius = one.radius * (1.0 - MARGIN)
        self.fleet = np.column_stack([one.positions, one.velocities, radius]).astype(float)
        start = (*one.start[:2], one.heading or 0.0)
        self.craft = np.array([*start, one.speed, one.turning_radius])
        self.poses = np.zeros((one.size + 1, 4))
        self.poses[0, :3] = start
        self.legs = np.zeros((one.size, 6))
        self.rng = np.random.default_rng(self.request.seed or 0)

    @property
    def flag(self) -> NDArray[np.int8]:
        """What asks the kernels to stop."""
        return self.request.control.flag

    def offer(self, order: Ints, end: float) -> bool:
        """Keep the path in `poses` and `legs`, which ends at `end` (s), if it is the shortest so far."""
        length = end * self.problem.speed
        if not length < self.length * (1.0 - GAIN):
            return False
        self.plan = self._planned(order)
        self.length = self.plan.length
        self.request.control.incumbent(self.length, self.plan)
        return True

    def _planned(self, order: Ints) -> TourPlan:
        """Return the plan whose primitives are those flown, whose lengths give the times."""
        from ...models.messenger.plan import Primitive, TourPlan

        r = self.problem.turning_radius
        pieces = []
        heading = float(self.poses[0, 2])
        for k, leg in enumerate(self.legs.tolist()):
            for length, code in zip(leg[:3], leg[3:], strict=True):
                if length > 0.0:
                    turn = "S" if r == 0.0 else "RSL"[int(code) + 1]
                    pieces.append(Primitive(k, turn, length, code if r == 0.0 else heading))
                    heading += 0.0 if r == 0.0 else code * length / r
        times = np.cumsum(self.legs[:, :3].sum(axis=1)) / self.problem.speed
        return TourPlan(
            tuple(order.tolist()), times, self.poses[1:, :2].copy(), self.poses[0, :3].copy(),
            tuple(pieces),
        )  # fmt: skip


class Rival(Backend):
    """Base of the paper's algorithms and its rivals; a subclass only searches."""

    accepts = MessengerTour
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.SEED, Feature.INCUMBENTS, Feature.INTERRUPT})
    single_threaded = True

    @abstractmethod
    def search(self, flight: Flight, request: Request) -> Mapping[str, Any]:
        """Offer better and better paths to `flight`; return statistics of the algorithm's own."""

    def refuses(self, problem: MessengerTour) -> str:
        """Return what the paper's algorithms do not cover."""
        if problem.closed:
            return "closed tours: the paper's tours end at the last encounter"
        if problem.heading is None and problem.turning_radius > 0:
            return "a start without a heading: the paper's tours begin with a given one"
        return ""

    def run(self, problem: MessengerTour, request: Request) -> Answer:
        """Search, and answer with the best path."""
        refusal = self.refuses(problem)
        if refusal:
            raise UnsupportedFormulation(f"backend {self.name!r} does not cover {refusal}")
        begin = clock()
        flight = Flight(problem, request)
        own = self.search(flight, request)
        limit = None
        if request.control.stopped:
            limit = request.control.reason or Limit.INTERRUPTED
        found = flight.plan is not None
        return Answer(
            Termination.FEASIBLE if found else Termination.NO_SOLUTION,
            limit,
            flight.plan,
            flight.length if found else None,
            seconds={"solve": clock() - begin},
            statistics=dict(own),
        )
