"""``insert-nearest`` and ``insert-index``: the paper's Algorithm 6, which merges chains one by one.

Source: "Exact and Heuristic Algorithms for Routing AGV on Path with Precedence Constraints",
Mathematical Problems in Engineering 2016, article 5040513. The tour so far is one chain, whose order
stays; the next chain is merged into it by the dynamic program for k = 2, so each merge is the best.

Any relation is covered by the fewest chains, and no merge breaks what it says between them. For the
tour so far keeps the relation with everything that it implies, and so does the chain; an order
of both that keeps all three always exists.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...jit import clock
from ...models.guided_path.data import GuidedPathData
from ...models.guided_path.model import GuidedPathTour
from ...models.guided_path.plan import GuidedPathPlan
from ...models.guided_path.walks import length_of, reduced, served
from ..backend import Answer, Backend, Feature, Guarantee, Limit, Request, Termination

__all__ = ["ChainBackend", "InsertIndex", "InsertNearest", "ordered_chains"]

Ints = NDArray[np.int64]


def ordered_chains(
    model: GuidedPathData,
    numbers: tuple[int, ...],
    chains: tuple[tuple[int, ...], ...],
    nearest: bool,
) -> tuple[tuple[int, ...], ...]:
    """Return chains in the order in which a heuristic takes them.

    Parameters
    ----------
    model : GuidedPathData
        The whole model, whose own chains say the index.
    numbers : tuple of int
        The number in `model` of each customer.
    chains : tuple of tuples of int
        The chains that cover the relation.
    nearest : bool
        Whether those come first that have a customer nearer to the start; ties, and all otherwise, by
        the index of the model's chain in which their first customer is, and its number.
    """
    index = {c: (k, place) for k, chain in enumerate(model.chains) for place, c in enumerate(chain)}
    rest = (len(model.chains), 0)
    away = np.abs(model.coordinates - model.coordinates[0]).tolist()

    def key(chain: tuple[int, ...]) -> tuple[Any, ...]:
        least = min(away[numbers[c]] for c in chain) if nearest else 0.0
        return least, index.get(numbers[chain[0]], rest), chain[0]

    return tuple(sorted(chains, key=key))


class ChainBackend(Backend):
    """Base of the heuristics that build a tour chain by chain; a subclass only says by which loop.

    The customers that Property 1 leaves out are served as they are passed, and so are at last all
    others, which may shorten the tour; its length before is a statistic.
    """

    accepts = GuidedPathTour
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.INTERRUPT})
    deterministic = True
    single_threaded = True
    nearest: ClassVar[bool] = True

    @abstractmethod
    def loop(self) -> Callable[..., bool]:
        """Return the kernel that fills in the order, and says whether it was finished.

        Its arguments are the coordinates, the closure, the customers chain after chain, where each chain
        begins among them, the order to fill in, and the stop flag.
        """

    def run(self, problem: GuidedPathTour, request: Request) -> Answer:
        """Build the tour."""
        begin = clock()
        small, numbers = reduced(problem, passing=False)
        chains = ordered_chains(problem, numbers, small.cover, self.nearest)
        members = np.array([c for chain in chains for c in chain], np.int64)
        starts = np.cumsum([0, *map(len, chains)])
        order = np.zeros(len(members), np.int64)
        done = self.loop()(
            small.coordinates, small.closure, members, starts, order, request.control.flag
        )
        plan = None
        counts: Mapping[str, float | int | str] = {"chains": len(chains)}
        if done:
            plan = GuidedPathPlan(served(problem, [numbers[c] for c in order.tolist()]))
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
    """Algorithm 6, chains with a customer nearer to the start first; ties by index."""

    name = "insert-nearest"
    summary = "the paper's Algorithm 6: chains merged one by one, the nearest first"

    def loop(self) -> Callable[..., bool]:
        """Return the loop over merges."""
        from .insertion_kernels import merge_chains

        return merge_chains


class InsertIndex(InsertNearest):
    """Algorithm 6, chains by index."""

    name = "insert-index"
    summary = "the paper's Algorithm 6: chains merged one by one, by index"
    nearest = False
