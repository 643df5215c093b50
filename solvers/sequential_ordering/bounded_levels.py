"""``bounded-levels``: dynamic program over visited nodes and the last one, bounded by assignment problems.

Level k holds the states with k visited nodes. States with equal nodes and equal last nodes are merged, and those whose
bound reaches the length of the incumbent are omitted. A level keeps at most `width` states with the least bounds. The
least bound of a level and of all states dropped before is a lower bound on every path. The search repeats with larger
widths until no state is dropped, which is a proof, or a limit is reached. Incumbents come from ``three-exchange``. If
narrow levels do not suffice, a linear program with cuts (:mod:`.cut_bound`) raises the bound and removes arcs.

Sources: L. Bianco, A. Mingozzi, S. Ricciardelli, "The traveling salesman problem with cumulative costs", Networks 23,
1993 (bounded dynamic programs); G. Shobaki, J. Jamal, "An exact algorithm for the sequential ordering problem and its
application to switching energy minimization in compilers", Computational Optimization and Applications 61, 2015
(assignments of partial paths and merging of states, in a depth-first search).
"""

from __future__ import annotations

import math
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
from .cut_bound import cut_bound
from .level_kernels import BITS, States, expand, new_states
from .three_exchange import ThreeExchange, costs_of, length_of, nearest_available, root_state

__all__ = ["BoundedLevels"]

#: Memory for the states of two levels, in bytes.
MEMORY = 1_000_000_000
#: Largest width times n³ without a time limit. One unit takes 2 to 5 ns (tests/benchmarks/sequential_ordering).
WORK = 15_000_000_000
#: Width of the first search and growth factor of the width.
_NARROW, _WIDER = 16, 4
#: Width after which the bound by cuts is computed.
_HARD = 64
#: Children per state that a level has room for.
_ROOM = 4
#: Share of a time limit for the incumbent, and iterations of ``three-exchange`` per node without a limit.
_SHARE, _PER_NODE = 0.5, 400
#: Rounding errors of bounds relative to the largest length, if distances are not integers.
_SAFE = 1e-12


class BoundedLevels(Backend):
    """Bounded dynamic program with repeated wider searches."""

    name = "bounded-levels"
    accepts = SequentialOrdering
    guarantee = Guarantee.EXACT
    features = frozenset(
        {
            Feature.GAP, Feature.INCUMBENTS, Feature.DUAL_BOUND, Feature.INTERRUPT, Feature.WARM_START,
            Feature.SEED,
        }
    )  # fmt: skip
    single_threaded = True
    options: ClassVar[dict[str, Option]] = {
        "width": Option(
            0,
            "largest number of states per level; 0 means as many as 1 GB holds and, without a time limit, about two "
            "minutes suffice for",
            int,
            lower=0,
        )
    }
    summary = (
        "dynamic program over visited nodes with assignment bounds; incumbents of three-exchange"
    )

    def run(self, problem: SequentialOrdering, request: Request) -> Answer:
        """Solve the problem and return the answer with its termination."""
        begin = clock()
        search = _Search(problem, request)
        try:
            search.solve()
        except OutOfTime:  # its loops could not be compiled in time
            request.control.stop(Limit.TIME)
        limit = None if search.proven else request.control.limit or search.limit
        found = search.value < problem.missing
        termination = Termination.FEASIBLE if found else Termination.NO_SOLUTION
        if search.proven:
            termination = Termination.OPTIMAL if found else Termination.INFEASIBLE
        return Answer(
            termination, limit, search.plan, search.value if found else None,
            min(search.bound, search.value) if found or not search.proven else None,
            seconds={"solve": clock() - begin},
            statistics={"width": search.width, "states": search.states, "bound at the start": search.root},
        )  # fmt: skip


class _Search:
    """Search on one model: incumbent, bound and the tables of the kernels."""

    def __init__(self, model: SequentialOrdering, request: Request) -> None:
        self.model, self.request, self.control = model, request, request.control
        self.cost, self.missing = costs_of(model), model.missing
        #: Whether all lengths are integers that floats represent exactly.
        self.exact = False
        self.words = -(-model.size // BITS)
        bits = np.zeros((self.words * BITS, model.size), np.int64)
        bits[: model.size] = model.closure
        words = bits.reshape(self.words, BITS, -1)
        self.before = np.ascontiguousarray(np.einsum("wbn,b->nw", words, 1 << np.arange(BITS)))
        self.plan: SequentialOrderingPlan | None = None
        self.value, self.bound, self.root = model.missing, 0.0, 0.0
        self.limit: Limit | None = None
        self.proven, self.cut, self.width, self.states = False, False, 0, 0

    def prove(self, bound: float) -> None:
        """Take a lower bound, with rounding errors, on all paths shorter than the incumbent."""
        bound = math.ceil(bound - 0.5) if self.exact else bound - _SAFE * self.missing
        self.bound = max(self.bound, min(bound, self.value))
        if self.value < self.model.missing:
            self.proven |= self.value - self.bound <= self.request.gap * abs(self.value)
            self.control.prove(self.bound)

    def offer(self, order: NDArray[np.int64]) -> None:
        """Store the path if it is shorter than the incumbent."""
        value = length_of(self.cost, order)
        if value < self.value:
            self.value, self.plan = value, SequentialOrderingPlan(tuple(order.tolist()))
            self.control.incumbent(value, self.plan)

    def solve(self) -> None:
        """Search until the incumbent is proven or a limit is reached."""
        given, limit = self.request.warm_start, self.request.time_limit
        self.offer(
            nearest_available(self.model, self.cost) if given is None else np.array(given.order)
        )
        stage = self.request.within(
            ThreeExchange(), self.model, time_limit=None if limit is None else _SHARE * limit,
            options={"iterations": _PER_NODE * self.model.size}, lift=lambda *found: found,
            warm_start=self.plan,
        )  # fmt: skip
        if stage.point is not None:
            self.offer(np.array(stage.point.order, np.int64))
        # No shorter path has an arc as long as the incumbent, and the costs of others would cause rounding errors.
        self.missing = self.value
        self.cost = np.minimum(self.cost, self.missing)
        whole = bool((self.cost == np.round(self.cost)).all())
        self.exact = whole and self.missing * self.model.size < 2**50
        root = root_state(self.model, self.cost, self.missing, self.control.flag)
        if root is None:
            return
        self.root = min(float(root.rest[0]), self.value)
        self.prove(self.root)
        if self.root >= self.missing:
            self.proven = True
        size = self.model.size
        room = MEMORY // ((1 + _ROOM) * (8 * self.words + 18 * size + 40))
        work = max(1, WORK // size**3) if limit is None else room
        most = self.request.options["width"] or min(room, work)
        while not self.proven and not self.control.stopped:
            if self.width == most:
                self.limit = Limit.MEMORY if most == room else Limit.ITERATIONS
                return
            if self.width >= _HARD and not self.cut:
                self._cut()
                root = root_state(self.model, self.cost, self.missing, self.control.flag)
                if root is None or self.proven:
                    return
            self.width = min(max(self.width * _WIDER, _NARROW), most)
            self._sweep(root)

    def _cut(self) -> None:
        """Raise the bound by cuts, and remove the arcs that no shorter path contains."""
        self.cut, begin, limit = True, clock(), self.request.left()

        def left() -> float:
            spent = clock() - begin
            seconds = math.inf if limit is None else _SHARE * limit - spent
            return 0.0 if self.control.stopped else seconds

        missing = min(self.missing, self.value)
        bound, arcs = cut_bound(self.model, self.cost, missing, left)
        self.prove(bound)
        self.cost = np.where(arcs, self.cost, self.missing)

    def _sweep(self, root: States) -> None:
        """Search all levels with the current width."""
        upper = self.value - (0.5 if self.exact else _SAFE * self.value)
        children = new_states(self.model.size, _ROOM * self.width)
        table = np.empty(1 << (2 * len(children.last)).bit_length(), np.int32)
        level, dropped = root, math.inf
        trace: list[tuple[NDArray[np.int32], NDArray[np.int32]]] = []
        for _ in range(self.model.size - 1):
            expanded, count = expand(
                self.cost, self.missing, self.before, level, len(level.last), children, table, upper,
                self.control.flag,
            )  # fmt: skip
            if self.control.stopped:
                return
            if expanded < len(level.last):
                dropped = min(dropped, float(level.length[expanded] + level.rest[expanded]))
            self.states += count
            bounds = children.length[:count] + children.rest[:count]
            order = np.argsort(bounds, kind="stable")
            if count > self.width:
                dropped = min(dropped, float(bounds[order[self.width]]))
            order = order[: self.width]
            level = States._make(field[order] for field in children)
            trace.append((level.parent, level.last))
            least = float(bounds[order[0]]) if count else math.inf
            self.prove(min(dropped, least, self.value))
            if not count or self.proven:
                break
        else:
            path, state = [], 0
            for parent, last in reversed(trace):
                path.append(int(last[state]))
                state = int(parent[state])
            self.offer(np.array([0, *reversed(path)]))
        if dropped == math.inf:
            self.prove(self.value)
            self.proven = True
        else:
            self.prove(min(dropped, self.value))
