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
from typing import Any, ClassVar

import numpy as np

from ...jit import clock
from ...models.guided_path.data import GuidedPathData
from ...models.guided_path.extensions import name_unsupported
from ...models.guided_path.model import GuidedPathTour
from ...models.guided_path.plan import GuidedPathPlan
from ...models.guided_path.walks import length_of, passed, reduced, served
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

__all__ = ["ChainBackend", "Greedy", "InsertIndex", "InsertNearest", "ordered_chains"]


def ordered_chains(
    model: GuidedPathData, numbers: tuple[int, ...], chains: tuple[tuple[int, ...], ...]
) -> tuple[tuple[int, ...], ...]:
    """Return `chains` sorted by the chain in `model` of their first customer, then by its number.

    `numbers` holds the number in `model` of each customer of the chains.
    """
    index = {c: (k, place) for k, chain in enumerate(model.chains) for place, c in enumerate(chain)}
    rest = (len(model.chains), 0)
    return tuple(sorted(chains, key=lambda chain: (index.get(numbers[chain[0]], rest), chain[0])))


class ChainBackend(Backend):
    """Base class of the heuristics that build a tour from chains; a subclass provides the kernel.

    The customers omitted by Property 1 are served when they are passed (Algorithm 1).
    """

    accepts = GuidedPathTour
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.INTERRUPT})
    deterministic = True
    single_threaded = True
    options: ClassVar[Mapping[str, Option]] = {
        "passing": Option(
            False,
            "serve every available customer when it is passed, which may shorten the tour; not in the paper",
            bool,
        ),
    }

    #: Kernel that fills in the order and returns whether it finished, see :func:`merge_nearest`.
    loop: ClassVar[Callable[..., bool]]

    def refuses(self, problem: Any) -> str:
        """Return the optional fields of `problem` that the heuristics do not cover."""
        return name_unsupported(problem)

    def run(self, problem: GuidedPathTour, request: Request) -> Answer:
        """Build the tour and return the answer."""
        begin = clock()
        self.require_support(problem)
        small, numbers = reduced(problem, passing=False)
        chains = ordered_chains(problem, numbers, small.cover)
        members = np.array([c for chain in chains for c in chain], np.int64)
        starts = np.cumsum([0, *map(len, chains)])
        order = np.zeros(len(members), np.int64)
        need = needs_of(small, chains)
        finished = self.loop(small.coordinates, need, members, starts, order, request.control.flag)
        order = members[order]
        plan = None
        counts: Mapping[str, float | int | str] = {"chains": len(chains)}
        if finished:
            stops = [numbers[c] for c in order.tolist()]
            walk = served if request.options["passing"] else passed
            plan = GuidedPathPlan(walk(problem, stops))
            counts = {**counts, "length as built": length_of(small, order.tolist())}
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
