"""``chain-search``: local search that removes chains from a tour and merges them into it again.

Each merge is the paper's dynamic program for two chains, as in its Algorithm 6, restricted to a window of the
tour, see :mod:`.chain_kernels`. ``a-star`` uses the same search for its incumbents.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation
from ...jit import clock
from ...models.guided_path.extensions import name_unsupported
from ...models.guided_path.model import GuidedPathTour
from ...models.guided_path.plan import GuidedPathPlan
from ...models.guided_path.walks import length_of, reduced, served
from ..contract.backend import (
    Answer,
    Backend,
    Feature,
    Guarantee,
    Limit,
    Option,
    Request,
    Termination,
)
from .bound import Tables, needs_of
from .chain_kernels import merge_again
from .insertion import Greedy, InsertIndex, InsertNearest

__all__ = ["ChainRounds", "ChainSearch", "merged_starts"]

Ints = NDArray[np.int64]

#: States of all merges in the first round, per customer; growth factor per round.
FIRST, GROWTH = 4000, 2
#: States of all merges after which a round reports its tour.
CHUNK = 40_000_000
#: Accepted increase at the beginning of a round, relative to the length of the tour.
HEAT = 3e-4
#: Rounds without improvement after which the search ends.
STALE = 6


def merged_starts(model: GuidedPathTour, request: Request) -> Iterator[GuidedPathPlan]:
    """Yield the tours of the paper's heuristics, as far as time and the memory for relations permit."""
    for backend in (Greedy(), InsertIndex(), InsertNearest()):
        with suppress(UnsupportedFormulation):
            answer = request.within(backend, model, options={"passing": True})
            if answer.point is not None:
                yield answer.point


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


class ChainSearch(Backend):
    """Local search with optimal merges of chains in windows of the tour."""

    name = "chain-search"
    accepts = GuidedPathTour
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.SEED, Feature.INCUMBENTS, Feature.INTERRUPT, Feature.WARM_START})
    single_threaded = True
    options: ClassVar[Mapping[str, Option]] = {
        "rounds": Option(
            10, "maximum number of rounds, each twice as long as the one before", int, lower=0
        )
    }
    summary = "chains of the tour are removed and merged into it again, each merge shortest; ours"

    def refuses(self, problem: Any) -> str:
        """Return the optional fields of `problem` that the search does not cover."""
        return name_unsupported(problem)

    def run(self, problem: GuidedPathTour, request: Request) -> Answer:
        """Improve the tours of Algorithm 6 and return the answer."""
        begin, control = clock(), request.control
        self.require_support(problem)
        starts = [problem.sorted_customers]
        if request.warm_start is not None:
            starts.append(request.warm_start.order)
        plans = (GuidedPathPlan(served(problem, order)) for order in starts)
        value = math.inf
        # A limit may end the run in any of the heuristics.
        for start in itertools.chain(plans, merged_starts(problem, request)):
            if (length := length_of(problem, start.order)) < value:
                plan, value = start, length
                control.incumbent(value, plan)
        rounds, members, best = None, list[int](), math.inf
        while not (control.stopped or request.left() == 0.0):
            if rounds is None:
                small, numbers = reduced(problem)
                tables = Tables.of(small)
                members = [numbers[c] for c in tables.customers.tolist()]
                position = {c: i for i, c in enumerate(members)}
                order = np.array([position[c] for c in plan.order if c in position], np.int64)
                rounds = ChainRounds(tables, needs_of(small, small.cover), order, request.seed)
            if rounds.settled or rounds.rounds >= request.options["rounds"]:
                break
            length = rounds.improve(control.flag)
            if length < best:
                best = length
                found = served(problem, [members[i] for i in rounds.best.tolist()])
                if length_of(problem, found) < value:
                    plan, value = GuidedPathPlan(found), length_of(problem, found)
                    control.incumbent(value, plan)
        limit = control.reason or (Limit.TIME if request.left() == 0.0 else None)
        return Answer(
            Termination.FEASIBLE,
            limit,
            plan,
            value,
            seconds={"solve": clock() - begin},
            statistics={"rounds": 0 if rounds is None else rounds.rounds},
        )
