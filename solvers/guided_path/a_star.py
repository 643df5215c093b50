"""``a-star``: exact search for tours along a path, with a proven gap if a limit ends it.

Serving an available customer when passing it is always optimal. A state is therefore a position and
the number of customers served in each chain, and it has at most two successors: the nearest
available customer to the left and to the right. A* expands states by the bound of :mod:`.bound`, in
buckets. A beam search with the same bound provides the first incumbent. Wider beams and merges of its chains
(:mod:`.chain_search`) improve it from time to time, in large models also between steps of the ascent of :mod:`.shares`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation
from ...jit import OutOfTime, clock
from ...models.guided_path.data import GuidedPathData
from ...models.guided_path.model import GuidedPathTour
from ...models.guided_path.plan import GuidedPathPlan
from ...models.guided_path.walks import length_of, reduced, served
from ..contract.backend import Answer, Feature, Guarantee, Limit, Option, Request, Termination
from . import search_kernels as kernels
from .beam_kernels import beam
from .bound import SAFE, Tables, needs_of
from .chain_search import CHUNK as MERGED, ChainRounds, merged_starts
from .dynamic_programming import DynamicProgramming
from .insertion import LineBackend
from .share_kernels import Shares
from .shares import no_shares, shares_of
from .state_kernels import least_rest

__all__ = ["AStar"]

Ints = NDArray[np.int64]
Links = NDArray[np.int32]

#: Default memory for states, in bytes. Beams and shares need some more.
MEMORY = 1_100_000_000
#: Initial capacity for states, small enough for interpreted code.
FEW = 8192
#: Maximum number of buckets.
BUCKETS = 1 << 14
#: Growth factor of the capacity.
GROWTH = 4
#: Maximum number of sample states whose bounds the shares raise, from the best tenth of open states.
SAMPLES, TENTH = 24, 10
#: Expansions before the shares of the chains are computed and the search restarts; no limit.
EARLY, FOREVER = 150_000, 1 << 62
#: Expansions between updates of incumbent and gap.
CHUNK = 20_000
#: Maximum number of crossings that the bounds of these expansions compare, about 0.1 s.
SCANNED = 300_000_000
#: Width of the first beam, growth factor of the width, and maximum width.
NARROW, WIDER, WIDEST = 16, 2, 1 << 15
#: Capacity of a beam per unit of its width, and maximum size of its trace and of its states in bytes.
ROOM, TRACE, POOL = 16, 200_000_000, 400_000_000
#: States of the merges before the first beam, about a second, and the share of models that are not large.
FIRST, LATER = 3e8, 0.1
#: Expansions after which the search also merges chains of the incumbent again.
HARD = 60_000
#: Expansions of the search per expansion of the beams.
SHARE = 3
#: Numbers of relevant customers above which the search begins with merges and heuristics without a time limit, and
#: improves the tour before the first beam.
LARGE, MANY = 60, 300


class AStar(LineBackend):
    """A* over positions and counts of the chains, with beam searches for incumbents."""

    name = "a-star"
    guarantee = Guarantee.EXACT
    features = frozenset(
        {
            Feature.GAP, Feature.INCUMBENTS, Feature.DUAL_BOUND, Feature.INTERRUPT,
            Feature.SEED, Feature.WARM_START,
        }
    )  # fmt: skip
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

    def run(self, problem: GuidedPathTour, request: Request) -> Answer:
        """Solve the problem and return the answer with its termination."""
        begin = clock()
        self.require_support(problem)
        search = _Search(problem, request)
        try:
            search.solve()
        except OutOfTime:  # before the tables were complete
            request.control.stop(Limit.TIME)
        limit = None if search.proven else request.limit or search.limit
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
    """Search on one model: tables, states and incumbent."""

    small: GuidedPathData
    tables: Tables
    kept: list[int]

    def __init__(self, model: GuidedPathTour, request: Request) -> None:
        self.model, self.request, self.control = model, request, request.control
        self.plan: GuidedPathPlan | None = None
        self.value, self.best = math.inf, 1 << 62
        self.offer(model.sorted_customers)
        if request.warm_start is not None:
            self.offer(request.warm_start.order)
        self.info = np.zeros(5, np.int64)
        self.root = self.least = self.merged_value = self.width = self.owed = 0
        self.limit: Limit | None = None
        self.rounds: ChainRounds | None = None
        self.ready = self.ended = False

    def prepare(self) -> None:
        """Start with merges of chains and compute the tables, which take half a second for 20,000 customers."""
        flag = self.control.flag
        self.small, numbers = reduced(self.model, flag=flag)
        self.large = self.small.size - 1 > MANY
        self.limited = self.request.time_limit is not None
        if self.limited or self.small.size - 1 > LARGE:
            for stops in merged_starts(self.model, self.request):
                self.offer(stops)
        self.tables = tables = Tables.of(self.small, flag)
        self.kept = [numbers[c] for c in tables.customers.tolist()]
        #: A customer at each place.
        self.visitors = dict(zip(tables.place[:-1].tolist(), self.kept, strict=True))
        self.widest, self.ready = self._widest(), True

    def take(self, shares: Shares) -> None:
        """Add these shares to the bound of the states."""
        self.shares, tables = shares, self.tables
        counts = np.zeros(tables.first.size - 1, np.int64)
        scratch = np.empty(tables.wide.size, np.int16)
        self.root = int(least_rest(tables, shares, counts, int(tables.place[-1]), scratch))
        self.least = max(self.least, min(self.root, self.best))
        self.control.bound = self.bound

    @property
    def bound(self) -> float:
        """Lower bound on the length of every tour proven so far, in m."""
        if not self.ready or (self.ended and self.tables.exact):
            return self.value if self.ended else 0.0
        return self.least * self.tables.unit * (1.0 if self.tables.exact else 1.0 - SAFE)

    @property
    def proven(self) -> bool:
        """True if the incumbent is within the requested gap."""
        return self.ended or self.value - self.bound <= self.request.gap * abs(self.value)

    @property
    def over(self) -> bool:
        """True if the incumbent is proven or a limit is reached."""
        return self.proven or self.request.limit is not None

    def statistics(self) -> dict[str, float | int | str]:
        """Return the statistics of the search."""
        if not self.ready:
            return {}
        return {
            "chains": len(self.tables.first) - 1,
            "customers that matter": len(self.tables.customers),
            "states": int(self.info[kernels.COUNT]),
            "expanded": int(self.info[kernels.EXPANDED]),
            "beam width": self.width,
            "rounds": 0 if self.rounds is None else self.rounds.rounds,
            "bound at the start": self.root * self.tables.unit,
        }

    def solve(self) -> None:
        """Search until the incumbent is proven or a limit is reached."""
        self.prepare()
        self.start()
        self.take(no_shares(self.tables))
        self.merge_first(FIRST * LATER)
        if self.large and not self.over:
            self._tabulate()
            self.merge_first(FIRST)
        self.look()
        if not self.over:
            start = np.array([[*[0] * (len(self.tables.first) - 1), self.tables.place[-1]]])
            samples = start if self.large else self.search(EARLY)
            if not self.over and self.limit is None:
                between = self.alternate if self.large else None
                shares = shares_of(self.tables, self.best, samples, self.control.flag, between)
                if shares is not None:
                    self.take(shares)
                if (shares is not None or self.large) and not self.over:
                    self.search(FOREVER)
        while not self.over and (self.merge() or self.look()):
            self.limit = self.limit or Limit.MEMORY

    def merge_first(self, left: float) -> None:
        """Merge chains as chain-search does, for this number of states: its tours are the best ones of short runs."""
        wanted = self.large or (self.limited and len(self.kept) > LARGE)
        while wanted and left > 0.0 and not self.over:
            left -= self.merge() or left

    def _tabulate(self) -> None:
        """Solve the model by dynamic programming if its table fits."""
        table = DynamicProgramming()
        if not table.refuses(self.model):
            answer = self.request.within(table, self.model)
            if answer.termination is Termination.OPTIMAL and answer.point is not None:
                self.offer(answer.point.order)
                self.start()
                self.least, self.ended = self.best, True

    def merge(self) -> int:
        """Continue the search by merges of chains; return the number of their states, 0 if it has settled."""
        if self.rounds is None:
            try:
                need = needs_of(self.small, self.small.cover, flag=self.control.flag)
            except UnsupportedFormulation:
                return 0
            self.rounds = ChainRounds(self.tables, need, self._order(), self.request.seed)
        if self.rounds.settled:
            return 0
        work = min(self.rounds.left, MERGED)
        if self.merged_value > self.best:
            self.rounds.adopt(self._order())
        value = self.rounds.improve(self.control.flag)
        if value < self.best:
            self.best = value
            self.offer([self.kept[i] for i in self.rounds.best.tolist()])
        self.merged_value = value
        return work

    def alternate(self, bound: int, work: float) -> bool:
        """Store a bound of the shares, and merge chains for as many states; return whether the search is over."""
        self.least = max(self.least, min(bound, self.best))
        self.control.bound = self.bound
        self.owed += int(work)
        while self.owed > 0 and not self.over:
            self.owed -= self.merge() or self.owed
        return self.over

    def _order(self) -> Ints:
        """Return the incumbent as positions in the tables."""
        position = {c: i for i, c in enumerate(self.kept)}
        assert self.plan is not None
        return np.array([position[c] for c in self.plan.order if c in position], np.int64)

    def start(self) -> None:
        """Walk through the relevant customers of the incumbent only, and measure this tour in units."""
        order = self._order().tolist()
        self.offer([self.kept[i] for i in order])
        places = self.tables.place[[-1, *order, -1]]
        self.best = min(self.best, int(np.abs(np.diff(self.tables.at[places])).sum()))

    def offer(self, stops: Iterable[int]) -> None:
        """Store the tour through `stops` if it is shorter than the incumbent."""
        order = served(self.model, stops)
        value = length_of(self.model, order)
        if value < self.value:
            self.plan, self.value = GuidedPathPlan(order), value
            self.control.incumbent(value, self.plan)

    def walk(self, last: int, before: Links, place: Callable[[int], int]) -> None:
        """Offer the tour whose last entry is `last`, following the predecessors in `before`."""
        stops = list[int]()
        while before[last] >= 0:
            stops.append(self.visitors[place(last)])
            last = int(before[last])
        self.offer(reversed(stops))

    def _widest(self) -> int:
        tables = self.tables
        pool = ROOM * (8 * tables.words + 2 * tables.wide.size + 40)
        widest = min(WIDEST, TRACE // (16 * len(tables.customers)), POOL // pool)
        return max(widest, NARROW)

    def look(self) -> bool:
        """Run the next wider beam; return False if the maximum width was already reached."""
        if self.width >= self.widest:
            return False
        width = min(self.width * WIDER, self.widest) if self.width else NARROW
        n, room = len(self.tables.customers), ROOM * width + 2 * len(self.tables.customers)
        trace = np.empty((2 * width * n + 2, 2), np.int32)
        best, last, left = beam(
            self.tables, self.shares, np.empty((room, self.tables.words), np.int64),
            np.empty((room, 4), np.int64), np.empty((room + 1, self.tables.wide.size), np.int16),
            np.empty(room, np.int32), np.empty(room + 1, np.int32),
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
        """Expand up to `steps` states, until the search is exhausted or a limit is reached.

        Returns counts and places of some open states with low bounds.
        """
        words = self.tables.words
        limit = self.request.options["states"] or MEMORY // (8 * words + 40)
        room = min(FEW, limit)
        keys, costs = np.empty((room, words), np.int64), np.empty((room, 2), np.int64)
        parents, links = np.empty(room, np.int32), np.empty((room, 2), np.int32)
        table = np.empty(1 << (2 * room - 1).bit_length(), np.int32)
        span = max(self.best - self.root, 0)
        width = span // BUCKETS + 1
        buckets = np.empty(span // width + 1, np.int32)
        status = None
        compared = self.tables.first.size * self.tables.wide.size + 1
        chunk = int(np.clip(SCANNED // compared, 20, CHUNK))
        while not self.over and (status is None or self.info[kernels.EXPANDED] < steps):
            if status == kernels.FULL:
                if room == limit:
                    self.limit = Limit.MEMORY
                    break
                room = min(GROWTH * room, limit)
                for array in (keys, costs, parents, links):
                    array.resize((room, *array.shape[1:]), refcheck=False)
                table = np.empty(1 << (2 * room - 1).bit_length(), np.int32)
                kernels.rehash(keys, int(self.info[kernels.COUNT]), table)
            states = kernels.States(
                keys, costs, parents, links, table, buckets, self.root, width, self.info
            )
            shared = (self.tables, self.shares, states)
            if status is None:
                status = kernels.search_anew(*shared, self.best, chunk, self.control.flag)
            else:
                self.info[kernels.BEST] = min(self.info[kernels.BEST], self.best)
                status = kernels.search_on(*shared, chunk, self.control.flag)
            del states, shared  # the arrays may be resized
            if self.info[kernels.BEST] < self.best:
                self.best = int(self.info[kernels.BEST])
                goal = int(self.info[kernels.GOAL])
                self.walk(goal, parents, lambda state: self._place(keys[state]))
            if status == kernels.DONE:
                self.least, self.ended = self.best, True
            else:
                least = self.root + int(self.info[kernels.LOWEST]) * width
                self.least = max(self.least, min(least, self.best))
            self.control.bound = self.bound
            hard = len(self.kept) > MANY or self.info[kernels.EXPANDED] >= HARD
            if status == kernels.PAUSED and hard and not self.over:
                self.merge()
            beamed = self.width * WIDER * len(self.kept)
            behind = SHARE * beamed <= self.info[kernels.EXPANDED]
            if status == kernels.PAUSED and behind and not self.over:
                self.look()
        return self._sample_open(keys, costs, links)

    def _sample_open(self, keys: Ints, costs: Ints, links: Links) -> Ints:
        count = int(self.info[kernels.COUNT])
        some = np.flatnonzero(links[:count, 1] != kernels.CLOSED)
        some = some[np.argsort(costs[some, 1], kind="stable")]
        some = some[: max(len(some) // TENTH, min(SAMPLES, len(some)))]
        some = some[np.linspace(0, len(some) - 1, min(SAMPLES, len(some))).astype(int)]
        word, shift, mask = self.tables.fields.T
        return np.asarray(keys[some][:, word] >> shift & mask)

    def _place(self, key: Ints) -> int:
        word, shift, mask = self.tables.fields[-1]
        return int(key[word] >> shift & mask)
