"""Linear program over routes, solved by HiGHS, with its cuts.

Each node is visited once by routes, and each kind of vehicle has a number of routes. Rounded capacity
cuts and rows of single edges have one coefficient per arc, so their prices belong to the arcs of the
pricing. Subset-row cuts of three nodes limit the routes with two or more of them to one
(M. Jepsen and others, "Subset-row inequalities applied to the vehicle-routing problem with time
windows", Operations Research 56, 2008).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .route_kernels import CUTS
from .route_pricing import Network, Prices

__all__ = ["Column", "Master"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Least violation of a cut: of a capacity cut, and of a subset-row cut.
VIOLATION, ROWS_VIOLATION = 0.02, 0.05
#: Largest number of cuts added at once, of each family.
AT_ONCE, ROWS_AT_ONCE = 30, 8
#: Largest number of routes in a program with whole routes.
MOST_WHOLE = 4000
#: Smallest value of a column in use.
USED = 1e-7


@dataclass(frozen=True)
class Column:
    """Route of one kind of vehicle: nodes 0 … n - 1 in order, length, relative cost, and arcs."""

    kind: int
    route: tuple[int, ...]
    length: float
    cost: float
    tails: Ints
    heads: Ints


@dataclass
class Master:
    """Linear program over the routes found so far.

    If `covering`, nodes may be visited more than once, which is allowed if a shortcut is never longer.
    `counts`, shape (kinds, 2), limit the number of routes of each kind. `penalty` is the cost of each unit that
    a row lacks, and `prizes`, shape (n,), the relative cost of a node that is not visited, infinite if it must
    be visited. `arcs` are rows with coefficients over arcs, shape (n + 1, n + 1), and their right-hand sides;
    `triples` are rows of subset-row cuts with their members and memory.
    """

    network: Network
    covering: bool
    counts: Floats
    penalty: float
    prizes: Floats
    columns: list[Column] = field(default_factory=list)
    arcs: list[tuple[int, Floats, float]] = field(default_factory=list)
    triples: list[tuple[int, tuple[int, ...], NDArray[np.bool_]]] = field(default_factory=list)

    def __post_init__(self) -> None:
        import highspy

        self.lp: Any = highspy.Highs()
        for name, value in (("output_flag", False), ("parallel", "off"), ("solver", "simplex")):
            self.lp.setOptionValue(name, value)
        self.known = dict[tuple[int, tuple[int, ...]], int]()
        self.spare = list[int]()
        self.index = list[int]()
        self.width = 0
        self.limits: list[tuple[float, float]] = []
        most = math.inf if self.covering else 1.0
        for prize in self.prizes.tolist():
            self._row(1.0, most, prize=prize)
        for low, high in self.counts.tolist():
            self._row(low, high)

    def _row(
        self, low: float, high: float, entries: dict[int, float] | None = None,
        prize: float = math.inf,
    ) -> int:  # fmt: skip
        """Add a row, with a column for what it lacks; return its index."""
        entries = entries or {}
        row = len(self.limits)
        self.limits.append((low, high))
        self.lp.addRow(
            low, high, len(entries), np.array(list(entries), np.int32),
            np.array(list(entries.values()), float),
        )  # fmt: skip
        if low > -math.inf:
            required = math.isinf(prize)
            cost = self.penalty if required else prize
            self.lp.addCol(cost, 0.0, math.inf, 1, np.array([row], np.int32), np.ones(1))
            if required:
                self.spare.append(self.width)
            self.width += 1
        return row

    def set_penalty(self, penalty: float) -> None:
        """Change the cost of each unit that a row lacks."""
        self.penalty = penalty
        for column in self.spare:
            self.lp.changeColCost(column, penalty)

    def bound_row(self, row: int, low: float, high: float) -> None:
        """Change the limits of a row."""
        if self.limits[row] != (low, high):
            self.limits[row] = low, high
            self.lp.changeRowBounds(row, low, high)

    def signed(self, duals: Floats) -> Floats:
        """Return duals without what the limits of the rows and the prizes exclude."""
        low, high = np.array(self.limits).T
        duals[: self.network.size] = np.minimum(duals[: self.network.size], self.prizes)
        duals = np.where(np.isinf(low), np.minimum(duals, 0.0), duals)
        return np.where(np.isinf(high), np.maximum(duals, 0.0), duals)

    def terms(self, duals: Floats) -> list[float]:
        """Return the products of duals and active limits of all rows but those of the kinds."""
        n, kinds = self.network.size, len(self.network.kinds)
        low, high = np.array(self.limits).T
        active = np.where(duals > 0.0, low, high)
        terms = np.multiply(duals, active, out=np.zeros_like(duals), where=duals != 0.0)
        return [*terms[:n].tolist(), *terms[n + kinds :].tolist()]

    def add(self, kind: int, route: tuple[int, ...]) -> bool:
        """Add a route unless it is known; return whether it is new."""
        if (kind, route) in self.known:
            return False
        n = self.network.size
        tails, heads = np.array([n, *route]), np.array([*route, n])
        length = math.fsum(self.network.lengths[kind, tails, heads].tolist())
        cost = math.fsum(self.network.costs[kind, tails, heads].tolist())
        column = Column(kind, route, length, cost, tails, heads)
        entries = dict[int, float]()
        for node in route:
            entries[node] = entries.get(node, 0.0) + 1.0
        entries[n + kind] = 1.0
        for row, matrix, _ in self.arcs:
            entries[row] = float(matrix[tails, heads].sum())
        for row, members, memory in self.triples:
            entries[row] = float(visits_twice(route, members, memory))
        entries = {row: value for row, value in entries.items() if value}
        self.known[kind, route] = len(self.columns)
        self.columns.append(column)
        self.index.append(self.width)
        self.width += 1
        self.lp.addCol(
            cost, 0.0, math.inf, len(entries),
            np.array(list(entries), np.int32), np.array(list(entries.values()), float),
        )  # fmt: skip
        return True

    def allow(self, allowed: NDArray[np.bool_]) -> None:
        """Allow the columns of the mask, shape (columns,), and no other ones."""
        index = np.array(self.index, np.int32)
        high = np.where(allowed, math.inf, 0.0)
        self.lp.changeColsBounds(index.size, index, np.zeros(index.size), high)

    def solve(self, seconds: float | None) -> tuple[float, Floats, Floats, float] | None:
        """Return the value, the columns, the duals and the units lacking; None after a failure."""
        import highspy

        if seconds is not None:
            # The limit is on the total time of the object.
            self.lp.setOptionValue("time_limit", float(self.lp.getRunTime()) + max(seconds, 0.01))
        self.lp.run()
        if self.lp.getModelStatus() != highspy.HighsModelStatus.kOptimal:
            return None
        solution = self.lp.getSolution()
        self.reduced = np.array(solution.col_dual)[self.index]
        values = np.array(solution.col_value)
        value = float(self.lp.getInfo().objective_function_value)
        lacking = float(values[self.spare].sum())
        return value, values[self.index], np.array(solution.row_dual), lacking

    def whole(
        self, most: float, longest: float, seconds: float, stopped: Callable[[], bool]
    ) -> list[Column]:
        """Return the best plan of known routes up to the reduced cost `most`; empty without one.

        Routes are at most `longest` long. It searches for at most `seconds`. The reduced costs are those of the last linear program.
        """
        import highspy

        n, kinds = self.network.size, len(self.network.kinds)
        order = np.argsort(self.reduced, kind="stable")[:MOST_WHOLE]
        chosen = [
            self.columns[k]
            for k in order[self.reduced[order] <= most].tolist()
            if self.columns[k].length <= longest
            and len(set(self.columns[k].route)) == len(self.columns[k].route)
        ]
        program: Any = highspy.Highs()
        options = {"output_flag": False, "parallel": "off", "time_limit": max(seconds, 0.01)}
        for name, value in options.items():
            program.setOptionValue(name, value)
        program.cbMipInterrupt.subscribe(lambda event: event.interrupt() if stopped() else None)
        for low, high in self.limits[: n + kinds]:
            program.addRow(low, high, 0, np.empty(0, np.int32), np.empty(0))
        free = np.flatnonzero(np.isfinite(self.prizes)).astype(np.int32)
        for column in chosen:
            rows = np.array([*column.route, n + column.kind], np.int32)
            program.addCol(column.cost, 0.0, 1.0, rows.size, rows, np.ones(rows.size))
        for row in free:
            program.addCol(float(self.prizes[row]), 0.0, 1.0, 1, np.array([row]), np.ones(1))
        columns = np.arange(len(chosen), dtype=np.int32)
        integer = np.full(len(chosen), int(highspy.HighsVarType.kInteger), np.uint8)
        program.changeColsIntegrality(len(chosen), columns, integer)
        program.run()
        if program.getInfo().primal_solution_status != int(
            highspy.SolutionStatus.kSolutionStatusFeasible
        ):
            return []
        values = np.array(program.getSolution().col_value)[: len(chosen)]
        return [chosen[k] for k in np.flatnonzero(values > 0.5)]

    def prices(self, duals: Floats) -> Prices:
        """Return the prices of nodes, arcs and subset-row cuts."""
        n = self.network.size
        arcs = np.zeros((n + 1, n + 1))
        for row, matrix, _ in self.arcs:
            if duals[row]:
                arcs += duals[row] * matrix
        result = Prices(duals[:n].copy(), arcs, np.zeros(n, np.uint64), np.zeros(n, np.uint64))
        bit = 0
        for row, members, memory in self.triples:
            if duals[row] >= 0.0:
                continue
            result.penalty[bit] = -duals[row]
            result.members[list(members)] |= np.uint64(1 << bit)
            result.memory[memory] |= np.uint64(1 << bit)
            bit += 1
        return result

    # -- cuts ------------------------------------------------------------------------------------

    def flows(self, values: Floats) -> Floats:
        """Return the flow on each arc, shape (n + 1, n + 1)."""
        n = self.network.size
        flow = np.zeros((n + 1, n + 1))
        for k in np.flatnonzero(values > USED):
            column = self.columns[k]
            np.add.at(flow, (column.tails, column.heads), values[k])
        return flow

    def add_arcs(self, matrix: Floats, low: float, high: float) -> int:
        """Add a row with the coefficients `matrix` of the arcs; return its index."""
        entries = {
            self.index[k]: float(matrix[column.tails, column.heads].sum())
            for k, column in enumerate(self.columns)
        }
        row = self._row(low, high, {k: value for k, value in entries.items() if value})
        self.arcs.append((row, matrix, low))
        return row

    def cut_capacity(self, values: Floats) -> int:
        """Add violated rounded capacity cuts, found by greedy growth from each node; return their number.

        A set of nodes with demand d needs at least ⌈d / Q⌉ routes of capacity Q, so as many enter it
        (J. Lysgaard, A. Letchford, R. Eglese, "A new branch-and-cut algorithm for the capacitated
        vehicle routing problem", Mathematical Programming 100, 2004).
        """
        network = self.network
        n, model = network.size, network.model
        if model.demands is None or model.demands.ndim > 1 or np.isfinite(self.prizes).any():
            return 0
        capacity = max(kind.capacity[0] for kind in network.kinds)
        if capacity <= 0.0:
            return 0
        flow = self.flows(values)
        between = flow[:n, :n] + flow[:n, :n].T
        touched = flow[:n].sum(axis=1)  # routes through each node
        demands = model.demands[model.customers]
        # Row s is the set that grows from node s.
        inside = np.eye(n, dtype=bool)
        attached, entering = between.copy(), touched.copy()
        load = demands.copy()
        violated = dict[bytes, float]()
        rows = np.arange(n)
        for _ in range(n - 1):
            key = np.where(inside, -np.inf, attached - 1e-3 * touched)
            node = key.argmax(axis=1)
            entering += touched[node] - attached[rows, node]
            inside[rows, node] = True
            load += demands[node]
            attached += between[node]
            short = np.ceil(load / capacity * (1.0 - 1e-9)) - entering
            for s in np.flatnonzero(short > VIOLATION).tolist():
                violated[inside[s].tobytes()] = float(short[s])
        worst = sorted(violated, key=lambda key: -violated[key])[:AT_ONCE]
        for chosen in worst:
            members = np.append(np.frombuffer(chosen, bool), False)
            need = math.ceil(float(demands[members[:n]].sum()) / capacity * (1.0 - 1e-9))
            # Half of the arcs in and half of the arcs out, so that prices remain symmetric.
            self.add_arcs(0.5 * (members[:, None] != members), float(need), math.inf)
        return len(worst)

    def cut_triples(self, values: Floats, stopped: Callable[[], bool]) -> int:
        """Add violated subset-row cuts of three nodes; return their number, 0 after a stop.

        The memory of a cut contains the nodes that the routes in use visit between its members.
        """
        n = self.network.size
        room = min(ROWS_AT_ONCE, CUTS - len(self.triples))
        used = np.flatnonzero(values > USED)
        if room <= 0 or n < 3:
            return 0
        visits = np.zeros((used.size, n))
        for row, k in enumerate(used):
            visits[row, list(self.columns[k].route)] = 1.0
        weighted = visits * values[used, None]
        pairs = visits.T @ weighted
        known = {members for _, members, _ in self.triples}
        entries = []
        for i in range(n - 2):
            if stopped():
                return 0
            with_i = (visits * visits[:, i, None]).T @ weighted
            total = pairs[i] + pairs[i][:, None] + pairs - 2.0 * with_i
            total[: i + 1] = 0.0
            first, second = np.nonzero(np.triu(total, 1) > 1.0 + ROWS_VIOLATION)
            entries += [
                (-total[j, k], (i, int(j), int(k))) for j, k in zip(first, second, strict=True)
            ]
        entries.sort()
        added = 0
        busy = np.zeros(n, np.int64)
        for _, members in entries:
            if added == room:
                break
            if members in known or (busy[list(members)] >= 3).any():
                continue
            busy[list(members)] += 1
            memory = np.zeros(n, bool)
            memory[list(members)] = True
            for k in used:
                memory[_between(self.columns[k].route, members)] = True
            row_entries = {
                self.index[k]: float(visits_twice(column.route, members, memory))
                for k, column in enumerate(self.columns)
            }
            row = self._row(-math.inf, 1.0, {k: v for k, v in row_entries.items() if v})
            self.triples.append((row, members, memory))
            added += 1
        return added


def visits_twice(
    route: tuple[int, ...], members: tuple[int, ...], memory: NDArray[np.bool_]
) -> int:
    """Return how often a route completes two visits to `members` without leaving `memory`."""
    count = odd = 0
    for node in route:
        if not memory[node]:
            odd = 0
        elif node in members:
            count, odd = count + odd, 1 - odd
    return count


def _between(route: tuple[int, ...], members: tuple[int, ...]) -> list[int]:
    """Return the nodes between the first and the second visit to `members`, the third and the fourth …."""
    places = [place for place, node in enumerate(route) if node in members]
    return [
        node
        for begin, end in zip(places[::2], places[1::2], strict=False)
        for node in route[begin:end]
    ]
