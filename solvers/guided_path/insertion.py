"""``insert-nearest``, ``insert-index`` and ``greedy``: the paper's heuristics.

Source: "Exact and Heuristic Algorithms for Routing AGV on Path with Precedence Constraints",
Mathematical Problems in Engineering 2016, article 5040513. Algorithm 6 treats the tour so far as
one chain and merges the next chain into it by the dynamic program for two chains, so each merge is
optimal. The greedy insertion of section 5 visits the nearest available customer.

A general relation is covered by the fewest chains. No merge violates the pairs between them: the
tour so far and the chain satisfy the relation and its closure, and an order that satisfies all
pairs always exists.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import OutOfTime, clock
from ...models.guided_path.data import GuidedPathData
from ...models.guided_path.extensions import name_unsupported
from ...models.guided_path.model import GuidedPathTour
from ...models.guided_path.plan import GuidedPathPlan
from ...models.guided_path.walks import Flag, length_of, passed, reduced, served
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
from .bound import needs_of
from .insertion_kernels import merge_by_index, merge_nearest, visit_nearest

__all__ = [
    "ChainBackend", "ChainLists", "Greedy", "InsertIndex", "InsertNearest", "LineBackend", "ordered_chains",
]  # fmt: skip

Ints = NDArray[np.int64]


def ordered_chains(
    model: GuidedPathData, numbers: tuple[int, ...], chains: tuple[tuple[int, ...], ...]
) -> tuple[tuple[int, ...], ...]:
    """Return `chains` sorted by the chain in `model` of their first customer, then by its number.

    `numbers` holds the number in `model` of each customer of the chains.
    """
    index = {c: (k, place) for k, chain in enumerate(model.chains) for place, c in enumerate(chain)}
    rest = (len(model.chains), 0)
    return tuple(sorted(chains, key=lambda chain: (index.get(numbers[chain[0]], rest), chain[0])))


class ChainLists(NamedTuple):
    """Chains of a model for the kernels of the heuristics.

    Parameters
    ----------
    small : GuidedPathData
        Model without the customers of Property 1.
    members : ndarray of int, shape (n,)
        Its customers, chain after chain.
    numbers : ndarray of int, shape (n,)
        Number in the model of each of them.
    starts : ndarray of int, shape (k + 1,)
        First position of each chain in `members`.
    need : ndarray of int32
        See :func:`.bound.needs_of`.
    """

    small: GuidedPathData
    members: Ints
    numbers: Ints
    starts: Ints
    need: NDArray[np.int32]

    @classmethod
    def of(cls, model: GuidedPathData, flag: Flag) -> ChainLists:
        """Return the chains of `model`; raise :class:`OutOfTime` if `flag` is set."""
        small, numbers = reduced(model, passing=False, flag=flag)
        chains = ordered_chains(model, numbers, small.cover)
        members = np.array([c for chain in chains for c in chain], np.int64)
        starts = np.cumsum([0, *map(len, chains)])
        need = needs_of(small, chains, flag=flag)
        return cls(small, members, np.array(numbers)[members], starts, need)

    def order(self, loop: Callable[..., bool], flag: NDArray[np.int8]) -> Ints:
        """Return the positions in `members` of the tour that a kernel builds, or raise :class:`OutOfTime`."""
        order = np.zeros(len(self.members), np.int64)
        data = (self.small.coordinates, self.need, self.members, self.starts)
        if not loop(*data, order, flag):
            raise OutOfTime
        return order


class LineBackend(Backend):
    """Base class of the backends that cover no optional field."""

    accepts = GuidedPathTour
    single_threaded = True

    def refuses(self, problem: Any) -> str:
        """Return the optional fields of `problem` that the backend does not cover."""
        return name_unsupported(problem)


class ChainBackend(LineBackend):
    """Base class of the heuristics that build a tour from chains; a subclass provides the kernel.

    The customers omitted by Property 1 are served when they are passed (Algorithm 1).
    """

    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.INTERRUPT})
    deterministic = True
    options: ClassVar[Mapping[str, Option]] = {
        "passing": Option(
            False,
            "serve every available customer when it is passed, which may shorten the tour; not in the paper",
            bool,
        ),
    }

    #: Kernel that fills in the order and returns whether it finished, see :func:`merge_nearest`.
    loop: ClassVar[Callable[..., bool]]

    def run(self, problem: GuidedPathTour, request: Request) -> Answer:
        """Build the tour and return the answer."""
        begin, flag = clock(), request.control.flag
        self.require_support(problem)
        plan = None
        counts: dict[str, float | int | str] = {}
        with suppress(OutOfTime):
            lists = ChainLists.of(problem, flag)
            counts["chains"] = len(lists.starts) - 1
            order = lists.order(self.loop, flag)
            walk = served if request.options["passing"] else passed
            plan = GuidedPathPlan(walk(problem, lists.numbers[order].tolist()))
            counts["length as built"] = length_of(lists.small, lists.members[order].tolist())
        return Answer(
            Termination.NO_SOLUTION if plan is None else Termination.FEASIBLE,
            (request.control.reason or Limit.INTERRUPTED) if plan is None else None,
            plan,
            None if plan is None else length_of(problem, plan.order),
            seconds={"solve": clock() - begin},
            statistics=counts,
        )


class InsertNearest(ChainBackend):
    """Algorithm 6: merge the chain whose first customer is nearest to the last customer of the tour; ties by index."""

    name = "insert-nearest"
    summary = "the paper's Algorithm 6: chains merged one by one, the nearest first"
    loop = staticmethod(merge_nearest)


class InsertIndex(ChainBackend):
    """Algorithm 6 as revised for Table 1(b): merge the chains by index."""

    name = "insert-index"
    summary = "the paper's revised Algorithm 6: chains merged one by one, by index"
    loop = staticmethod(merge_by_index)


class Greedy(ChainBackend):
    """Greedy insertion: visit the nearest customer whose predecessors are all served; ties by index."""

    name = "greedy"
    summary = "the paper's greedy insertion: the nearest available customer comes next"
    loop = staticmethod(visit_nearest)
