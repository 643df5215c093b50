"""``three-exchange``: simulated annealing over local optima of the path-preserving 3-exchange.

Each iteration exchanges random adjacent segments, repairs the path by the local search of :mod:`.exchange_kernels`
at the changed arcs, and accepts or reverses the result. The start is the path to the nearest available node. The
costs are the reduced costs of the assignment problem, which change all paths by the same constant.

Sources: L. M. Gambardella, M. Dorigo, INFORMS Journal on Computing 12, 2000 (exchange); O. Martin, S. W. Otto,
E. W. Felten, "Large-step Markov chains for the traveling salesman problem", Complex Systems 5, 1991 (iterated local
search with the acceptance of annealing).
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ...jit import OutOfTime, clock
from ...models.sequential_ordering.model import SequentialOrdering
from ...models.sequential_ordering.plan import SequentialOrderingPlan
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
from .exchange_kernels import DRAWS, Paths, anneal
from .level_kernels import States, assign_root, new_states

__all__ = ["ThreeExchange", "costs_of", "length_of", "nearest_available", "root_state"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Number of successors of each node that the local search tests.
_NEAR = 12
#: Iterations per call of the kernel, and per node by default.
_CHUNK, _PER_NODE = 1000, 400
#: First temperature, in mean arcs of the first local optimum.
_HOT = 0.5
#: Smallest gain, relative to the largest length.
_SMALL = 1e-12


def costs_of(model: SequentialOrdering) -> Floats:
    """Return the distances of possible arcs, and :attr:`.SequentialOrdering.missing` for the others."""
    return np.where(model.arcs, model.distances, model.missing)


def length_of(cost: Floats, order: NDArray[np.int64]) -> float:
    """Return the length of a path."""
    return float(cost[order[:-1], order[1:]].sum())


def nearest_available(model: SequentialOrdering, cost: Floats) -> NDArray[np.int64]:
    """Return the order that visits the nearest node whose predecessors are visited; ties by number."""
    waiting = model.closure.sum(axis=0)
    order = np.zeros(model.size, np.int64)
    for step in range(model.size - 1):
        waiting[order[step]] = -1
        waiting -= model.closure[order[step]]
        order[step + 1] = np.where(waiting == 0, cost[order[step]], np.inf).argmin()
    return order


def root_state(
    model: SequentialOrdering, cost: Floats, missing: float, flag: NDArray[np.int8]
) -> States | None:
    """Return the state of node 0 with the assignment of all other nodes; None if it was stopped."""
    root = new_states(model.size, 1)
    waits = np.ascontiguousarray(model.closure[1:].any(axis=0))
    return root if assign_root(cost, missing, waits, root, flag) else None


class ThreeExchange(Backend):
    """Iterated local search with exchanges of adjacent segments."""

    name = "three-exchange"
    accepts = SequentialOrdering
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.SEED, Feature.INCUMBENTS, Feature.INTERRUPT, Feature.WARM_START})
    single_threaded = True
    options: ClassVar[dict[str, Option]] = {
        "iterations": Option(
            0,
            f"random exchanges, each followed by a local search; 0 means {_PER_NODE} per node",
            int,
            lower=0,
        )
    }
    summary = "annealing over local optima of the 3-exchange (Gambardella and Dorigo)"

    def run(self, problem: SequentialOrdering, request: Request) -> Answer:
        """Search, and return the shortest path."""
        begin, size, control = clock(), problem.size, request.control
        cost = costs_of(problem)
        done, given = 0, request.warm_start
        shortest = nearest_available(problem, cost) if given is None else np.array(given.order)
        self._report(problem, cost, shortest, request)
        # No shorter path has an arc as long as this one, and the costs of others would cause rounding errors.
        most = min(length_of(cost, shortest), problem.missing)
        cheap = np.minimum(cost, most)
        try:
            # Fewer than four nodes have only one order.
            root = root_state(problem, cheap, most, control.flag) if size > 3 else None
            if root is not None:
                # All paths have the same sum of dual values, but these costs show which arcs are short.
                cheap -= root.row[0][:, None] + root.column[0]
                other = nearest_available(problem, cheap)
                if length_of(cost, other) < length_of(cost, shortest):
                    shortest = other
                    self._report(problem, cost, shortest, request)
                done = self._search(problem, cost, cheap, shortest, most, request)
        except OutOfTime:  # its loops could not be compiled in time
            control.stop(Limit.TIME)
        value = length_of(cost, shortest)
        complete = value < problem.missing
        return Answer(
            Termination.FEASIBLE if complete else Termination.NO_SOLUTION,
            control.limit,
            SequentialOrderingPlan(tuple(shortest.tolist())) if complete else None,
            value if complete else None,
            seconds={"solve": clock() - begin},
            statistics={"iterations": done},
        )

    def _search(
        self,
        model: SequentialOrdering,
        cost: Floats,
        cheap: Floats,
        shortest: Ints,
        missing: float,
        request: Request,
    ) -> int:
        """Anneal from the path `shortest`, which is updated, and return the number of iterations."""
        state, done, share, heat = _paths(model, cheap, shortest), 0, 0.0, 0.0
        lengths, small = np.full(2, length_of(cheap, shortest)), _SMALL * missing
        most = request.options["iterations"] or _PER_NODE * model.size
        rng = np.random.default_rng(request.seed or 0)
        first = True
        while done < most and not request.control.stopped and share < 1.0:
            left, former = request.left(), lengths[1]
            chunk = 0 if first else min(_CHUNK, most - done)
            draws, ahead = rng.random((chunk, DRAWS)), min(1.0, share + chunk / most)
            temperatures = heat * (1.0 - share), heat * (1.0 - ahead)
            anneal(
                state, shortest, lengths, *temperatures, draws, small, first, request.control.flag
            )
            if first:
                heat = _HOT * min(lengths[1], missing) / model.size
            done, first = done + chunk, False
            share = done / most
            if left is not None and request.time_limit:
                share = max(share, 1.0 - left / request.time_limit)
            if lengths[1] < former:
                self._report(model, cost, shortest, request)
        if done < most and not request.control.stopped:  # the share of the time limit is used up
            request.control.stop(Limit.TIME)
        return done

    @staticmethod
    def _report(model: SequentialOrdering, cost: Floats, order: Ints, request: Request) -> None:
        value = length_of(cost, order)
        if value < model.missing:
            request.control.incumbent(value, SequentialOrderingPlan(tuple(order.tolist())))


def _paths(model: SequentialOrdering, cost: Floats, order: NDArray[np.int64]) -> Paths:
    """Return the data and the state of the local search."""
    size, last = model.size, model.size - 1
    allowed = np.where(model.arcs, cost, np.inf)
    count = int(min(_NEAR, last))
    near = np.argsort(allowed, axis=1, kind="stable")[:, :count]
    near[np.isinf(np.take_along_axis(allowed, near, axis=1))] = -1
    pairs = np.array(model.links, np.int64).reshape(-1, 2)
    lists: list[NDArray[np.int64]] = []
    for key, value in ((1, 0), (0, 1)):
        rows = pairs[np.argsort(pairs[:, key], kind="stable")]
        lists += [rows[:, value].copy(), np.searchsorted(rows[:, key], np.arange(size + 1))]
    place = np.empty(size, np.int64)
    place[order] = np.arange(size)
    before, first_before, after, first_after = lists
    return Paths(
        np.ascontiguousarray(cost), np.ascontiguousarray(near), before, first_before, after, first_after,
        order.copy(), place, np.zeros(size, np.int64), np.zeros(size, bool), np.zeros((200, 3), np.int64),
        np.zeros(size, np.int64),
    )  # fmt: skip
