"""``chain-search``: local search that removes chains from a tour and merges them into it again.

Each merge is the paper's dynamic program for two chains, as in its Algorithm 6, restricted to a window of the
tour, see :mod:`.chain_kernels`. ``a-star`` uses the same search for its incumbents.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import ClassVar, cast

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation
from ...jit import Kernel, OutOfTime, clock
from ...models.guided_path.model import GuidedPathTour
from ...models.guided_path.plan import GuidedPathPlan
from ...models.guided_path.walks import length_of, reduced, served
from ..contract.backend import Answer, Feature, Guarantee, Limit, Option, Request, Termination
from .bound import Tables, needs_of
from .chain_kernels import merge_again
from .insertion import ChainLists, LineBackend
from .insertion_kernels import merge_by_index, merge_nearest, merge_walks, visit_nearest

__all__ = ["ChainRounds", "ChainSearch", "merged_starts"]

Ints = NDArray[np.int64]

#: States of all merges in the first round, per customer; growth factor per round.
FIRST, GROWTH = 4000, 2
#: Number of random orders of the chains that are merged at the start.
ORDERS = 5
#: States of all merges after which a round reports its tour.
CHUNK = 40_000_000
#: Accepted increase at the beginning of a round, relative to the length of the tour.
HEAT = 3e-4
#: Rounds without improvement after which the search ends.
STALE = 6


def merged_starts(model: GuidedPathTour, request: Request) -> Iterator[list[int]]:
    """Yield stops of tours by merges and the paper's heuristics, as far as time and memory permit.

    Merges of unrelated chains store only the turns of the walk, which takes a fraction of the time of the paper's
    heuristics that merge. Several orders of the chains are merged in this way before these start. A kernel that must be
    compiled first comes last.
    """
    walks, heuristics = _merged_walks(model, request), _heuristics(model, request)
    if cast(Kernel, merge_nearest).is_compiled and not cast(Kernel, merge_walks).is_compiled:
        return itertools.chain(heuristics, walks)
    # The first heuristic is the greedy one, which takes less time than a merge.
    return itertools.chain(itertools.islice(heuristics, 1), walks, heuristics)


def _merged_walks(model: GuidedPathTour, request: Request) -> Iterator[list[int]]:
    """Yield the turns of merged walks, each shorter than the ones before; none if pairs relate the chains."""
    small, numbers = reduced(model, flag=request.control.flag)
    sizes = np.array(list(map(len, small.cover)))
    if len(small.pairs) != small.size - 1 - sizes.size or sizes.size == 1:
        return
    members = np.array([c for chain in small.cover for c in chain], np.int64)
    starts, walk = np.cumsum([0, *sizes]), np.empty(members.size, np.int64)
    draw, best = np.random.default_rng(request.seed or 0), math.inf
    random = (draw.permutation(sizes.size) for _ in range(ORDERS))
    firsts = (np.empty(0, np.int64), np.arange(sizes.size), np.argsort(-sizes, kind="stable"))
    for order in itertools.chain(firsts, random):
        count = merge_walks(small.coordinates, members, starts, order, walk, request.control.flag)
        if count < 0:
            raise OutOfTime
        stops = walk[:count].tolist()
        if (length := length_of(small, stops)) < best:
            best = length
            yield [numbers[c] for c in stops]


def _heuristics(model: GuidedPathTour, request: Request) -> Iterator[list[int]]:
    """Yield the orders of the paper's heuristics; none if the relation exceeds their memory."""
    flag = request.control.flag
    with suppress(UnsupportedFormulation):
        lists = ChainLists.of(model, flag)
        for loop in (visit_nearest, merge_nearest, merge_by_index):
            yield lists.numbers[lists.order(loop, flag)].tolist()


class ChainRounds:
    """Rounds of the search from one tour, each longer than the one before.

    Parameters
    ----------
    tables : Tables
        Tables of the model.
    need : ndarray of int32
        See :func:`.bound.needs_of`.
    order : ndarray of int, shape (n,)
        A tour, as positions in the tables.
    seed : int, optional
        Seed of the random numbers.
    """

    def __init__(
        self, tables: Tables, need: NDArray[np.int32], order: Ints, seed: int | None
    ) -> None:
        self.tables, self.need = tables, need
        self.order, self.best = order.copy(), order.copy()
        self.draw = np.random.default_rng(seed or 0)
        sizes = np.diff(tables.first)
        states = int(((order.size - sizes + 1) * (sizes + 1)).max())
        self.moves = np.empty(states, np.uint8)
        self.work, self.left = FIRST * order.size, FIRST * order.size
        self.rounds = self.stale = 0
        self.value: int | None = None

    def adopt(self, order: Ints) -> None:
        """Continue from a tour that is shorter than the best one."""
        self.order[:] = self.best[:] = order

    @property
    def settled(self) -> bool:
        """Whether several rounds have not improved the tour, or the tour has no alternative."""
        return self.stale >= STALE or self.tables.first.size <= 2

    def improve(self, flag: NDArray[np.int8]) -> int:
        """Continue the search for at most `CHUNK` states; return the length of the best tour, in units."""
        former = self.value
        work = min(self.left, CHUNK)
        heat = HEAT * (former or int(self.tables.at[-1])) * self.left / self.work
        self.value = int(
            merge_again(
                self.tables, self.need, self.order, self.best, work, heat, heat * (1 - work / self.left),
                self.moves, self.draw, flag,
            )
        )  # fmt: skip
        self.left -= work
        if former is not None and self.value < former:
            self.stale = -1
        if self.left <= 0:
            self.rounds, self.stale = self.rounds + 1, self.stale + 1
            self.work = self.left = GROWTH * self.work
            self.order[:] = self.best
        return self.value


class ChainSearch(LineBackend):
    """Local search with optimal merges of chains in windows of the tour."""

    name = "chain-search"
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.SEED, Feature.INCUMBENTS, Feature.INTERRUPT, Feature.WARM_START})
    options: ClassVar[Mapping[str, Option]] = {
        "rounds": Option(
            10, "maximum number of rounds, each twice as long as the one before", int, lower=0
        )
    }
    summary = "chains of the tour are removed and merged into it again, each merge shortest; ours"

    def run(self, problem: GuidedPathTour, request: Request) -> Answer:
        """Improve the tours of Algorithm 6 and return the answer."""
        begin, control = clock(), request.control
        self.require_support(problem)
        plan, value, rounds = GuidedPathPlan(()), math.inf, 0
        try:
            for order, done in _orders(problem, request):
                rounds = done
                if order and (length := length_of(problem, order)) < value:
                    plan, value = GuidedPathPlan(order), length
                    control.incumbent(value, plan)
        except OutOfTime:
            control.stop(Limit.TIME)
        return Answer(
            Termination.FEASIBLE,
            request.limit,
            plan,
            value,
            seconds={"solve": clock() - begin},
            statistics={"rounds": rounds},
        )


def _orders(model: GuidedPathTour, request: Request) -> Iterator[tuple[tuple[int, ...], int]]:
    """Yield service orders, or () for no change, and the number of complete rounds, until a limit is reached."""
    flag = request.control.flag
    given = [] if request.warm_start is None else [request.warm_start.order]
    best: tuple[int, ...] = ()
    least = math.inf
    starts = itertools.chain([model.sorted_customers], given, merged_starts(model, request))
    for stops in starts:
        order = served(model, stops)
        yield order, 0
        if (length := length_of(model, order)) < least:
            best, least = order, length
    small, numbers = reduced(model, flag=flag)
    tables = Tables.of(small, flag)
    members = [numbers[c] for c in tables.customers.tolist()]
    position = {c: i for i, c in enumerate(members)}
    start = np.array([position[c] for c in best if c in position], np.int64)
    rounds = ChainRounds(tables, needs_of(small, small.cover, flag=flag), start, request.seed)
    while not rounds.settled and rounds.rounds < request.options["rounds"]:
        if request.limit is not None:
            return
        former = rounds.value
        same = rounds.improve(flag) == former
        found = [] if same else [members[i] for i in rounds.best.tolist()]
        yield served(model, found) if found else (), rounds.rounds
