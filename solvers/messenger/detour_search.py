"""``detour-search``: tours around no-fly zones and within time windows, by detours of shortest legs."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ...jit import clock
from ...models.messenger.dubins import WORDS, advance, word_lengths
from ...models.messenger.elongation import elongated
from ...models.messenger.model import MessengerTour
from ...models.messenger.plan import TourPlan
from ...models.messenger.zones import depth
from ..contract.backend import Answer, Feature, Guarantee, Option, Request, Termination
from .emission import cut
from .extensions import TourBackend
from .last_leg import Disc, shortest_to_disc
from .search import TourSearch

__all__ = ["DetourSearch"]

Pose = tuple[float, float, float]
#: Signs and lengths (m) of primitives.
Path = tuple[tuple[int, float], ...]

#: Number of poses beside a disc, per direction.
AROUND = 10
#: Margin of the radius of a vehicle, as a share, and number of poses tried as the start of its leg.
MARGIN, TRIES = 1e-9, 8
#: Places in a disc, and times per full circle, at which a vehicle is met after waiting.
GOALS, DELAYS = 4, 8
#: Relative rounding error of the length flown at the limits of a window.
ROUNDING = 1e-12
#: Number of ranges of headings. With windows, a beam keeps one partial tour per range.
HEADINGS = 8
#: Share of the time for the tour without zones and its bound.
SHARE = 0.3


class DetourSearch(TourBackend):
    """Beam search over orders, with legs that avoid zones and wait for time windows; ours.

    The tour without zones and windows is tried first, and its bound remains valid. Each leg is the shortest
    path to the next vehicle's disc if it is clear of the zones. Otherwise it leads over poses beside the zones,
    joined by the shortest clear Dubins words (Dijkstra). A leg that arrives before the window is replaced by
    a longer one, with full circles if necessary. The poses are drawn again in each round. With windows, the
    beam of each round is twice as wide as the one before.
    """

    name = "detour-search"
    guarantee = Guarantee.RELAXATION
    features = frozenset(
        {Feature.SEED, Feature.INCUMBENTS, Feature.INTERRUPT, Feature.DUAL_BOUND, Feature.GAP}
    )
    single_threaded = True
    requires = ("clarabel",)
    carries = frozenset({"no_fly", "windows", "wind"})
    options: ClassVar[Mapping[str, Option]] = {
        "rounds": Option(4, "Number of rounds with other poses beside the zones.", int, lower=1),
        "width": Option(4, "Number of partial tours of the first beam.", int, lower=1),
    }
    summary = (
        "no-fly zones and time windows: beam over orders, detours, and the bound without them; ours"
    )

    def refuses(self, problem: MessengerTour) -> str:
        """Return the reason why the backend does not cover `problem`, or an empty string."""
        if problem.no_fly is None and problem.windows is None:
            return "models without no-fly zones and time windows: use tour-search"
        if problem.closed and problem.wind is not None:
            return "a closed tour in wind"
        if problem.turning_radius == 0 or problem.heading is None:
            return "a turning radius of 0 or a start without a heading"
        return super().refuses(problem)

    def fly(self, problem: MessengerTour, request: Request) -> Answer:
        """Search for the given number of rounds, or until a limit is reached or the gap is closed."""
        begin, left = clock(), request.left()
        best: TourPlan | None = None

        def offer(plan: TourPlan | None) -> None:
            nonlocal best
            if plan is None or (best is not None and plan.length >= best.length):
                return
            if problem.verify(plan, tolerance=request.tolerance).ok:
                best = plan
                request.control.incumbent(plan.length, plan)

        draw = np.random.default_rng(request.seed or 0)
        if problem.windows is not None:
            # A beam needs few compiled kernels, so that a first call with a short limit has a plan.
            offer(_Round(problem, request, draw, request.options["width"]).plan())
        free = request.within(
            TourSearch(), replace(problem, no_fly=None, windows=None), options={"patience": 4},
            time_limit=None if left is None else SHARE * left,
        )  # fmt: skip
        offer(free.point)
        bound = max(free.dual_bound or 0.0, bound_windows(problem))
        request.control.prove(bound)
        rounds, limit, optimal = 0, None, False
        while rounds < request.options["rounds"] and limit is None and not optimal:
            widening = 0 if problem.windows is None else rounds
            offer(_Round(problem, request, draw, request.options["width"] << widening).plan())
            rounds += 1
            optimal = best is not None and best.length - bound <= request.gap * best.length
            limit = request.limit
        if best is None:
            message = (
                "no tour clear of the zones and within the windows was found, which does not prove that none "
                "exists"
            )
            return Answer(Termination.NO_SOLUTION, limit, dual_bound=bound, message=message)
        return Answer(
            Termination.OPTIMAL if optimal else Termination.FEASIBLE, None if optimal else limit, best,
            best.length, bound, seconds={"solve": clock() - begin}, statistics={"rounds": rounds},
        )  # fmt: skip


def bound_windows(problem: MessengerTour) -> float:
    """Return a lower bound (m) on the finish: the vehicle with the latest window, and the straight flight home."""
    if problem.windows is None:
        return 0.0
    begin = np.maximum(problem.windows[:, 0], 0.0)
    finish = problem.speed * begin
    if problem.closed and problem.start is not None:
        # The sum of the length flown and of the distance home increases, as the vehicle is slower.
        places = problem.positions + problem.velocities * begin[:, None]
        home = np.hypot(*(places - problem.start[:2]).T) - problem.radius
        finish = finish + np.maximum(home, 0.0)
    return float(finish.max())


class _State(NamedTuple):
    """Partial tour: length flown (m), pose, encounters by vehicle (length flown), and primitives."""

    flown: float
    pose: Pose
    stops: dict[int, float]
    path: Path


@dataclass
class _Round:
    """One beam search with its own poses beside the zones."""

    problem: MessengerTour
    request: Request
    draw: np.random.Generator
    width: int
    edges: dict[tuple[Pose, Pose], Path | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.speed, self.r = self.problem.speed, self.problem.turning_radius
        self.poses = [pose for zone in self.problem.no_fly or () for pose in self.beside(zone)]
        windows = self.problem.windows
        if windows is None:
            windows = np.tile([0.0, math.inf], (self.problem.size, 1))
        self.windows: list[list[float]] = (self.speed * windows).tolist()

    def beside(self, zone: Any) -> Iterator[Pose]:
        """Yield poses that lead around a zone in both directions."""
        if zone.ndim == 1:
            out = zone[2] / math.cos(math.pi / AROUND) * (1 + 0.2 * self.draw.random())
            turns = 2 * math.pi * (np.arange(AROUND) + self.draw.random()) / AROUND
            places = complex(*zone[:2]) + out * np.exp(1j * turns)
        else:
            corners = zone[np.any(zone != np.roll(zone, 1, axis=0), axis=1)] @ [1, 1j]
            before, after = corners - np.roll(corners, 1), np.roll(corners, -1) - corners
            turns = np.angle(before / np.abs(before) - after / np.abs(after))
            # A reflex corner points inwards; its pose is then unused, because paths are checked.
            places = corners + self.r * self.draw.uniform(0.05, 1.5) * np.exp(1j * turns)
        for place, turn in zip(places.tolist(), turns.tolist(), strict=True):
            for side in (0.5, -0.5):
                yield place.real, place.imag, turn + side * math.pi

    def join(self, a: Pose, b: Pose) -> Path | None:
        """Return the shortest clear Dubins path between two poses, or None."""
        if (a, b) not in self.edges:
            words = [(word_lengths(*a, *b, self.r, word), word) for word in range(6)]
            paths = (
                tuple(zip(WORDS[word].tolist(), parts, strict=True))
                for parts, word in sorted(words, key=lambda item: sum(item[0]))
                if sum(parts) < math.inf
            )
            self.edges[a, b] = next((path for path in paths if self.is_clear(a, path)), None)
        return self.edges[a, b]

    def is_clear(self, pose: Pose, path: Path) -> bool:
        """Return whether a path avoids all zones."""
        for sign, length in path:
            piece = (complex(pose[0], pose[1]), pose[2], sign / self.r, length)
            if any(depth(zone, piece) > 0.0 for zone in self.problem.no_fly or ()):
                return False
            pose = advance(*pose, length, sign, self.r)
        return True

    def reach(self, pose: Pose) -> list[tuple[float, Pose, Path]]:
        """Return the poses beside the zones by the length (m) of the shortest clear path to each."""
        done: dict[Pose, tuple[float, Path]] = {}
        heap: list[tuple[float, Pose, Path]] = [(0.0, pose, ())]
        while heap and not self.request.control.stopped:
            length, place, path = heapq.heappop(heap)
            if place in done:
                continue
            done[place] = length, path
            for to in self.poses:
                if to not in done and (more := self.join(place, to)) is not None:
                    heapq.heappush(heap, (length + sum(s for _, s in more), to, path + more))
        return [(length, place, path) for place, (length, path) in done.items()]

    def soonest(self, flown: float, pose: Pose, vehicle: int) -> float:
        """Return a lower bound on the length flown (m) at an encounter: a straight flight."""
        problem = self.problem
        x, y = problem.where(vehicle, flown / self.speed) - pose[:2]
        fast = float(np.hypot(*problem.velocities[vehicle])) / self.speed
        return flown + max(math.hypot(x, y) - float(problem.radius[vehicle]), 0.0) / (1 + fast)

    def wait(self, flown: float, pose: Pose, vehicle: int, least: float) -> Iterator[Path]:
        """Yield clear paths that meet `vehicle` as soon as its window is open; `least` (m) is the shortest leg.

        Circles at the start use up long waits. If no path has the length required, the encounter is later by
        a part of a full circle.
        """
        begin, end = self.windows[vehicle]
        around, reach = 2 * math.pi * self.r, float(self.problem.radius[vehicle]) * (1 - MARGIN)
        turns = 2 * math.pi * (np.arange(GOALS) + self.draw.random()) / GOALS
        offsets = [0j, *(0.9 * reach * np.exp(1j * turns)).tolist()] if reach else [0j]
        for delay in np.linspace(0.0, around, DELAYS + 1).tolist():
            until, successes = begin + delay, 0
            x, y = self.problem.where(vehicle, until / self.speed).tolist()
            circles = int((until - flown - least) / around)
            trials = [
                (count, sign) for count in (circles, circles - 1) if count > 0 for sign in (1, -1)
            ]
            for offset in offsets if until <= end else ():
                for count, sign in [*trials, (0, 0)]:
                    *parts, a, b, c, exists = elongated(
                        *pose, x + offset.real, y + offset.imag, self.r, until - flown - count * around
                    )  # fmt: skip
                    path = ((sign, count * around), *zip((a, b, c), parts, strict=True))
                    if exists and self.is_clear(pose, path):
                        successes += 1
                        yield path
                        break
            if successes:
                return

    def meet(
        self, state: _State, vehicle: int, places: list[tuple[float, Pose, Path]]
    ) -> list[_State]:
        """Return the partial tours with one more vehicle, over the best of the poses."""
        problem, best = self.problem, math.inf
        result: list[_State] = []
        tries = 0
        begin, end = self.windows[vehicle]
        for low, (length, pose, path) in sorted(
            ((self.soonest(state.flown + item[0], item[1], vehicle), item) for item in places),
            key=lambda pair: pair[0],
        ):
            if max(low, begin) >= best or tries == TRIES:
                break
            flown = state.flown + length
            disc = Disc.at(problem, vehicle, flown / self.speed, MARGIN)
            most = disc.limit(pose, self.speed, self.r)
            leg = shortest_to_disc(
                pose, disc, self.speed, self.r, min(most, max(best, begin) - flown)
            )
            if leg is None:
                continue
            least = sum(part for _, part in leg)
            if flown + least < begin * (1 - ROUNDING):
                legs = [*self.wait(flown, pose, vehicle, least)]
            else:
                timely = flown + least <= end * (1 + ROUNDING)
                legs = [tuple(leg)] if timely and self.is_clear(pose, tuple(leg)) else []
            tries += bool(legs)
            states = [self.follow(state, vehicle, pose, length, path, leg) for leg in legs]
            if states and states[0].flown < best:
                result, best = states, states[0].flown
        return result

    def follow(
        self, state: _State, vehicle: int, pose: Pose, length: float, path: Path, leg: Path
    ) -> _State:
        """Return the partial tour after a path of a given length to a pose, and a leg to a vehicle."""
        for sign, part in leg:
            pose = advance(*pose, part, sign, self.r)
        flown = state.flown + length + sum(part for _, part in leg)
        return _State(flown, pose, {**state.stops, vehicle: flown}, state.path + path + leg)

    def extend(self, state: _State) -> Iterator[_State]:
        """Yield the partial tours with one more vehicle: directly, otherwise around the zones."""
        around: list[tuple[float, Pose, Path]] = []
        for vehicle in range(self.problem.size):
            if vehicle in state.stops or self.request.control.stopped:
                continue
            new = self.meet(state, vehicle, [(0.0, state.pose, ())])
            if not new and self.poses:
                around = around or self.reach(state.pose)
                new = self.meet(state, vehicle, around)
            for item in new:
                late = (
                    other not in item.stops
                    and self.soonest(item.flown, item.pose, other) > end * (1 + ROUNDING)
                    for other, (_, end) in enumerate(self.windows)
                )  # fmt: skip
                if not any(late):
                    yield item

    def part_of(self, state: _State) -> tuple[Any, ...]:
        """Return the class of a partial tour: its vehicles, and the last one. A beam keeps the shortest per class.

        With windows, also the part of the circle to which the heading belongs: waiting ends at one time with
        several headings.
        """
        heading = 0 if self.problem.windows is None else state.pose[2] % (2 * math.pi) * HEADINGS
        return frozenset(state.stops), [*state.stops][-1], int(heading / (2 * math.pi))

    def plan(self) -> TourPlan | None:
        """Return the tour of the beam search, or None."""
        problem = self.problem
        assert problem.start is not None
        start: Pose = (float(problem.start[0]), float(problem.start[1]), float(problem.start[2]))
        beam = [_State(0.0, start, {}, ())]
        for _ in range(problem.size):
            new = sorted(
                (item for state in beam for item in self.extend(state)), key=lambda s: s.flown
            )
            unique = {self.part_of(item): item for item in reversed(new)}
            beam = sorted(unique.values(), key=lambda s: s.flown)[: self.width]
        best: tuple[float, _State] | None = None
        for state in beam:
            if problem.closed:
                self.poses.append(start)
                back = [item for item in self.reach(state.pose) if item[1] == start and item[2]]
                self.poses.pop()
                if not back:
                    continue
                state = state._replace(flown=state.flown + back[0][0], path=state.path + back[0][2])
            if best is None or state.flown < best[0]:
                best = state.flown, state
        if best is None or self.request.control.stopped:
            return None
        path = [(sign, part, None) for sign, part in best[1].path]
        return cut(problem, start, path, best[1].stops)
