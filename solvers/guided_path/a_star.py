"""``a-star``: tours along a path solved to proven optimality, or with a proven gap; ours.

Whoever passes an available customer serves it, as that costs nothing and harms nobody. So a state is a
position and how far each chain has been served, and from each there are two ways at the most: to the
nearest available customer left or right. A* goes through them by the bound of :mod:`.bound`, with the
states in buckets by their bounds; a beam search with the same bound finds the tour to beat, and wider
ones from time to time a better one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...jit import clock
from ...models.guided_path.model import GuidedPathTour
from ...models.guided_path.plan import GuidedPathPlan
from ...models.guided_path.walks import length_of, reduced, served
from ..backend import Answer, Backend, Feature, Guarantee, Limit, Option, Request, Termination
from . import search_kernels as kernels
from .beam_kernels import beam
from .bound import Tables
from .insertion import InsertIndex
from .shares import Shares, no_shares, shares_of
from .state_kernels import least_rest

__all__ = ["AStar"]

Ints = NDArray[np.int64]
Links = NDArray[np.int32]

#: Bytes that the states may take where no number of them is given; beams and shares take some more.
MEMORY = 1_100_000_000
#: States that there is room for at first, which is little enough to be interpreted.
FEW = 8192
#: Buckets at the most.
BUCKETS = 1 << 14
#: How much more room there is each time that it is full.
GROWTH = 4
#: States whose bounds the shares raise, at the most; of those that are open, the tenth with the lowest.
SAMPLES, TENTH = 24, 10
#: States expanded before the chains' shares of the gaps are computed, and the search begins again.
EARLY, FOREVER = 150_000, 1 << 62
#: States expanded before incumbents and the gap are looked at.
CHUNK = 20_000
#: States of the first beam, how much wider the next ones are, and the widest.
NARROW, WIDER, WIDEST = 16, 2, 1 << 15
#: Room of a beam for each state of its width, and for the bytes of all that it met.
ROOM, TRACE = 16, 200_000_000
#: States that the search expands for each that beams do.
SHARE = 3
#: Customers that matter above which the paper's Algorithm 6 finds better tours than the first beams.
MANY = 300
#: Customers above which a run with a time limit begins with the paper's Algorithm 6.
LARGE = 60
#: Share of a bound left for the rounding of lengths that no unit divides.
SAFE = 1e-12


class AStar(Backend):
    """A* over positions and counts of the chains, with beams for the tour to beat."""

    name = "a-star"
    accepts = GuidedPathTour
    guarantee = Guarantee.EXACT
    features = frozenset(
        {
            Feature.GAP, Feature.INCUMBENTS, Feature.DUAL_BOUND, Feature.INTERRUPT,
            Feature.WARM_START,
        }
    )  # fmt: skip
    deterministic = True
    single_threaded = True
    options: ClassVar[Mapping[str, Option]] = {
        "states": Option(
            0,
            "States that are kept at the most; 0 means as many as 1.5 GB hold. Beyond, the best tour "
            "is returned with the bound proven so far.",
            int,
            lower=0,
        )
    }
    summary = "exact, by bounds on how often each gap is crossed; ours"

    def starter(self, problem: Any) -> str:
        """Return the paper's Algorithm 6 for tours that an exact search may not end on in time."""
        return "insert-nearest" if problem.size > LARGE else ""

    def run(self, problem: GuidedPathTour, request: Request) -> Answer:
        """Solve, and say how the search ended."""
        begin = clock()
        search = _Search(problem, request)
        search.solve()
        limit = None if search.proven else request.control.reason or search.limit
        return Answer(
            Termination.OPTIMAL if search.proven else Termination.FEASIBLE,
            limit,
            search.plan,
            search.value,
            min(search.bound, search.value),
            seconds={"solve": clock() - begin},
            statistics=search.statistics(),
        )


class _Search:
    """The tables and states of one model, and the best plan so far."""

    def __init__(self, model: GuidedPathTour, request: Request) -> None:
        self.model, self.request, self.control = model, request, request.control
        small, numbers = reduced(model)
        self.tables = tables = Tables.of(small)
        self.take(no_shares(tables))
        self.kept = [numbers[c] for c in tables.customers.tolist()]
        #: Somebody to visit at each place.
        self.visitors = dict(zip(tables.place[:-1].tolist(), self.kept, strict=True))
        self.info = np.zeros(5, np.int64)
        self.least = self.root
        self.plan: GuidedPathPlan | None = None
        self.value, self.best = math.inf, 1 << 62
        self.limit: Limit | None = None
        self.width, self.widest = 0, self._widest()
        self.ended = False

    def take(self, shares: Shares) -> None:
        """Bound the states by these shares too."""
        tables = self.tables
        self.shared = (
            tables.first, tables.place, tables.at, tables.length, tables.crossings, tables.needs,
            tables.needed, tables.fields, shares.groups, shares.members, shares.weighted,
            shares.rests, shares.times, shares.over,
        )  # fmt: skip
        counts, most = (
            np.zeros(tables.first.size - 1, np.int64),
            np.empty(tables.length.size, np.int16),
        )
        self.root = int(
            least_rest(
                counts, int(tables.place[-1]), tables.first, tables.place, tables.at, tables.length,
                tables.crossings, *self.shared[8:], most,
            )
        )  # fmt: skip

    @property
    def bound(self) -> float:
        """The least length that a tour may have, as far as is proven, m."""
        if self.ended and self.tables.exact:
            return self.value
        return self.least * self.tables.unit * (1.0 if self.tables.exact else 1.0 - SAFE)

    @property
    def proven(self) -> bool:
        """Whether the plan is as good as was asked."""
        return self.ended or self.value - self.bound <= self.request.gap * abs(self.value)

    @property
    def over(self) -> bool:
        """Whether there is nothing left to do, or no time."""
        if self.request.left() == 0.0:
            self.limit = Limit.TIME
        return self.proven or self.control.stopped or self.limit is Limit.TIME

    def statistics(self) -> dict[str, float | int | str]:
        """Return what the search took."""
        return {
            "chains": len(self.tables.first) - 1,
            "customers that matter": len(self.tables.customers),
            "states": int(self.info[kernels.COUNT]),
            "expanded": int(self.info[kernels.EXPANDED]),
            "beam width": self.width,
            "bound at the start": self.root * self.tables.unit,
        }

    def solve(self) -> None:
        """Search until the plan is proven, or stopped."""
        if self.request.warm_start is not None:
            self.start(self.request.warm_start.order)
        self.start(self.model.sorted_customers)
        if len(self.kept) > MANY:
            merged = self.request.within(InsertIndex(), self.model, options={"passing": True}).point
            if merged is not None:
                self.start(merged.order)
        self.look()
        if not self.over:
            samples = self.search(EARLY)
            shares = None
            if not self.over and self.limit is None:
                shares = shares_of(self.tables, self.best, samples, self.control.flag)
            if shares is not None:
                self.take(shares)
                self.search(FOREVER)
        while not self.over and self.look():
            self.limit = self.limit or Limit.MEMORY

    def start(self, stops: Iterable[int]) -> None:
        """Offer the tour from stop to stop, of which only customers that matter are taken."""
        where = dict(zip(self.kept, self.tables.place[:-1].tolist(), strict=True))
        stops = [c for c in stops if c in where]
        start = int(self.tables.place[-1])
        units = np.abs(
            np.diff(self.tables.at[[start, *map(where.__getitem__, stops), start]])
        ).sum()
        if units < self.best:
            self.best = int(units)
            self.offer(stops)

    def offer(self, stops: Iterable[int]) -> None:
        """Keep the tour from stop to stop if it is the best so far."""
        order = served(self.model, stops)
        value = length_of(self.model, order)
        if value < self.value:
            self.plan, self.value = GuidedPathPlan(order), value
            self.control.incumbent(value, self.plan)

    def walk(self, last: int, before: Links, place: Callable[[int], int]) -> None:
        """Offer the tour that ended at entry `last`, of which each follows another one."""
        stops = list[int]()
        while before[last] >= 0:
            stops.append(self.visitors[place(last)])
            last = int(before[last])
        self.offer(reversed(stops))

    def _widest(self) -> int:
        return max(min(WIDEST, TRACE // (16 * len(self.tables.customers))), NARROW)

    def look(self) -> bool:
        """Look for a better tour by a wider beam; return whether there was a wider one."""
        if self.width >= self.widest:
            return False
        width = min(self.width * WIDER, self.widest) if self.width else NARROW
        n, room = len(self.tables.customers), ROOM * width + 2 * len(self.tables.customers)
        trace = np.empty((2 * width * n + 2, 2), np.int32)
        best, last, left = beam(
            *self.shared, np.empty((room, self.tables.words), np.int64),
            np.empty((room, 3), np.int64), np.empty(room, np.int32), np.empty(room + 1, np.int32),
            np.empty(1 << (2 * room).bit_length(), np.int32), np.empty(n + 1, np.int32), trace,
            self.best, width, self.control.flag,
        )  # fmt: skip
        self.width = width
        if last >= 0:
            self.best = int(best)
            self.walk(int(last), trace[:, 0], lambda entry: int(trace[entry, 1]))
        if left == 0:
            self.least, self.ended = self.best, True
        return True

    def search(self, steps: int) -> Ints:
        """Expand states until no shorter tour is left, no room, or no time; `steps` at the most.

        Return counts and places of some open states with low bounds.
        """
        words = self.tables.words
        most = self.request.options["states"] or MEMORY // (8 * words + 40)
        room = min(FEW, most)
        keys, costs = np.empty((room, words), np.int64), np.empty((room, 2), np.int64)
        parents, links = np.empty(room, np.int32), np.empty((room, 2), np.int32)
        table = np.empty(1 << (2 * room - 1).bit_length(), np.int32)
        width = (self.best - self.root) // BUCKETS + 1
        buckets = np.empty((self.best - self.root) // width + 1, np.int32)
        came = None
        while not self.over and (came is None or self.info[kernels.EXPANDED] < steps):
            if came == kernels.FULL:
                if room == most:
                    self.limit = Limit.MEMORY
                    break
                room = min(GROWTH * room, most)
                for one in (keys, costs, parents, links):
                    one.resize((room, *one.shape[1:]), refcheck=False)
                table = np.empty(1 << (2 * room - 1).bit_length(), np.int32)
                kernels.rehash(keys, int(self.info[kernels.COUNT]), table)
            shared = (
                *self.shared, keys, costs, parents, links, table, buckets, self.root, width, self.info,
            )  # fmt: skip
            flag = self.control.flag
            if came is None:
                came = kernels.search_anew(*shared, self.best, CHUNK, flag)
            else:
                self.info[kernels.BEST] = min(self.info[kernels.BEST], self.best)
                came = kernels.search_on(*shared, CHUNK, flag)
            if self.info[kernels.BEST] < self.best:
                self.best = int(self.info[kernels.BEST])
                self.walk(
                    int(self.info[kernels.GOAL]), parents, lambda state: self._place(keys[state])
                )
            if came == kernels.DONE:
                self.least, self.ended = self.best, True
            else:
                least = self.root + int(self.info[kernels.LOWEST]) * width
                self.least = max(self.least, min(least, self.best))
            self.control.bound = self.bound
            beamed = self.width * WIDER * len(self.kept)
            behind = SHARE * beamed <= self.info[kernels.EXPANDED]
            if came == kernels.PAUSED and behind and not self.over:
                self.look()
        return self._some_open(keys, costs, links)

    def _some_open(self, keys: Ints, costs: Ints, links: Links) -> Ints:
        known = int(self.info[kernels.COUNT])
        some = np.flatnonzero(links[:known, 1] != kernels.CLOSED)
        some = some[np.argsort(costs[some, 1], kind="stable")]
        some = some[: max(len(some) // TENTH, min(SAMPLES, len(some)))]
        some = some[np.linspace(0, len(some) - 1, min(SAMPLES, len(some))).astype(int)]
        word, shift, mask = self.tables.fields.T
        found: Ints = keys[some][:, word] >> shift & mask
        return found

    def _place(self, key: Ints) -> int:
        word, shift, mask = self.tables.fields[-1]
        return int(key[word] >> shift & mask)
