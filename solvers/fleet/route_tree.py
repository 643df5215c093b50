"""Linear programs of the nodes of a branch-and-bound tree over routes, and the branching.

For prices π of the rows with right-hand sides b, and the least reduced cost c_k of the m_k routes of each
kind of vehicle, π b + Σ m_k min(c_k, 0) is a lower bound for every π (Lagrange). So no tolerance of the
linear program enters the bound; the possible rounding error of the sums is subtracted. The prices are
smoothed (A. Pessoa and others, "Automation and combination of linear-programming based stabilization
techniques in column generation", INFORMS Journal on Computing 30, 2018).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..contract.backend import Request
from .route_master import Master
from .route_pricing import TIERS, Network, Pricing

__all__ = ["FEASIBLE", "INTEGRAL", "PENALTY", "Node", "Relaxed", "Stopped", "Tree"]

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Weight of the best prices in the smoothed prices.
SMOOTH = 0.6
#: Relative difference of the linear program and its bound at which it is solved.
SOLVED = 1e-7
#: Share of the gap that remains when arcs are excluded again.
SHRINK = 0.7
#: Largest relative gap at which arcs are excluded.
CLOSE = 0.1
#: Cost of a missing visit in units of the longest distance: first value, factor and largest value.
PENALTY, RAISE, HIGHEST = 2.0, 10.0, 1e9
#: Number of missing visits up to which a linear program is feasible, and relative tolerance of a plan.
LACKING, FEASIBLE = 1e-6, 1e-9
#: Rounding error of one operation.
EPSILON = 2.0**-52
#: Largest distance of an integral value to a whole number.
INTEGRAL = 1e-6


@dataclass(frozen=True)
class Node:
    """Node of the tree: forbidden arcs of each kind, required edges and numbers of routes.

    `gap` is the difference of the incumbent and the bound at the last exclusion of arcs.
    """

    forbidden: Mask
    required: frozenset[tuple[int, int]]
    counts: tuple[tuple[float, float], ...]
    gap: float = math.inf


@dataclass
class Relaxed:
    """Solution of a node's linear program: its bound, and values of the columns if it was solved.

    `node` lacks arcs that no better plan uses.
    """

    node: Node
    bound: float
    value: float = math.inf
    values: Floats | None = None


class Stopped(Exception):
    """A stop was requested, or labels do not fit into memory."""


class Tree:
    """Nodes of the tree, solved one at a time.

    Routes are at most `longest` long. A node needs no further work at the bound `enough`; without costs, at any
    positive bound. `edges` are the rows of the edges that some node requires.
    """

    def __init__(self, network: Network, master: Master, request: Request, priced: bool) -> None:
        self.network, self.master, self.request, self.priced = network, master, request, priced
        self.control = request.control
        self.pricing = Pricing(network, request.control.flag)
        self.longest = self.enough = math.inf
        #: Least value of the plans that excluded arcs remove.
        self.removed = math.inf
        self.edges = dict[tuple[int, int], int]()

    def prunes(self, bound: float) -> bool:
        """Return whether a bound excludes better plans from a node."""
        return bound >= self.enough if self.priced else bound > 0.0

    def _apply(self, node: Node) -> None:
        """Pass the limits of a node to the linear program."""
        master, n = self.master, self.network.size
        for k, (low, high) in enumerate(node.counts):
            master.bound_row(n + k, low, high)
        for edge, row in self.edges.items():
            master.bound_row(row, 1.0 if edge in node.required else -math.inf, math.inf)
        most = self.longest * (1.0 + 1e-12)
        allowed = [
            column.length <= most
            and not node.forbidden[column.kind, column.tails, column.heads].any()
            and _remembers(column.route, self.network.near)
            for column in master.columns
        ]
        master.allow(np.array(allowed, bool))

    def converge(self, node: Node, quick: bool = False) -> Relaxed:
        """Solve the linear program of a node, or stop once its bound prunes the node.

        If `quick`, the heuristic searches end the solution, without a bound.
        """
        self._apply(node)
        master, bound, guide, tier, exact = self.master, -math.inf, -math.inf, 0, len(TIERS)
        proof: tuple[Floats, float, list[float]] | None = None
        master.set_penalty(PENALTY if self.priced else 1.0)
        center: Floats | None = None
        while True:
            value, values, duals, lacking = self._solved()
            if not self.priced and value <= FEASIBLE:
                return Relaxed(node, 0.0, value, values)
            mixed = 0.0 if center is None else SMOOTH
            while True:
                prices = duals if center is None else mixed * center + (1.0 - mixed) * duals
                below, leasts, added = self._price(node, prices, tier)
                if center is None or below > guide:
                    center, guide = prices, below
                if tier == exact and below > bound:
                    bound, proof = below, (prices, below, leasts)
                if self.prunes(bound):
                    return Relaxed(node, min(bound, self.removed), value)
                if added:
                    tier = 0
                    break
                if mixed:
                    mixed = 0.0
                elif quick and tier == exact - 1:
                    return Relaxed(node, bound, value, None if lacking > LACKING else values)
                elif tier < exact:
                    tier, mixed, guide = tier + 1, SMOOTH, bound
                elif lacking > LACKING and self.priced:
                    if master.penalty > HIGHEST:
                        raise Stopped
                    master.set_penalty(RAISE * master.penalty)
                    center, tier = None, 0
                    break
                else:
                    return self._finish(node, bound, proof, value, values)
            if self.priced and value - bound <= SOLVED * abs(value) and lacking <= LACKING:
                return self._finish(node, bound, proof, value, values)

    def _finish(
        self, node: Node, bound: float, proof: tuple[Floats, float, list[float]] | None,
        value: float, values: Floats,
    ) -> Relaxed:  # fmt: skip
        """Exclude arcs that no better plan uses, if the gap is smaller than at the last exclusion.

        At prices with the bound `below` and the least reduced costs c of each kind, a plan with a route of
        reduced cost r costs at least below − c + r (S. Irnich, G. Desaulniers, J. Desrosiers, A. Hadjar,
        "Path-reduced costs for eliminating arcs in routing and scheduling", INFORMS Journal on Computing 22, 2010).
        """
        gap = self.enough - bound
        if (
            proof is not None
            and self.priced
            and gap < SHRINK * node.gap
            and gap < CLOSE * abs(bound)
        ):
            duals, below, leasts = proof
            prices, forbidden = self.master.prices(duals), node.forbidden.copy()
            for k, (low, _) in enumerate(node.counts):
                least = leasts[k] if leasts[k] <= 0.0 or low >= 1.0 else 0.0
                most = self.enough - below + least + 2.0 * self._error(duals)
                useful = self.pricing.useful(k, prices, forbidden[k], self.longest, most)
                if useful is None:
                    break
                forbidden[k] |= ~useful
            self.removed = min(self.removed, self.enough)
            node = replace(node, forbidden=forbidden, gap=gap)
        return Relaxed(node, min(bound, self.removed), value, values)

    def _error(self, duals: Floats) -> float:
        """Return the possible rounding error of a reduced cost."""
        # Every label sums at most n + 1 reduced costs, and each of these the prices of all rows.
        n = self.network.size
        size = float(self.network.costs.max()) + math.fsum(np.abs(duals).tolist())
        return EPSILON * (n + 4) * (n + len(duals) + 8) * size

    def _solved(self) -> tuple[float, Floats, Floats, float]:
        """Return the solution of the linear program over the known routes."""
        solved = None if self.control.stopped else self.master.solve(self.request.left())
        if solved is None:
            raise Stopped
        value, values, duals, lacking = solved
        return value, values, self.master.signed(duals), lacking

    def _price(self, node: Node, duals: Floats, tier: int) -> tuple[float, list[float], int]:
        """Return the Lagrangian bound of prices, least reduced costs, and the number of new routes.

        The bound is valid in the last tier.
        """
        master, n = self.master, self.network.size
        prices = master.prices(duals)
        terms, leasts, added = master.terms(duals), [], 0
        error = self._error(duals)
        for k, (low, high) in enumerate(node.counts):
            offset = float(duals[n + k])
            best = self.pricing.best(k, prices, node.forbidden[k], self.longest, offset, tier)
            if best is None:
                raise Stopped
            least, routes = best
            least = min(least, offset) - error
            leasts.append(least)
            terms.append(least * (low if least > 0.0 else high))
            added += sum(master.add(k, route) for route in routes)
        # The caller multiplies the sum by the unit of costs: a few more roundings than terms.
        total = math.fsum(terms) - EPSILON * (len(terms) + 4) * math.fsum(map(abs, terms))
        return total, leasts, added

    def children(self, node: Node, values: Floats) -> list[Node]:
        """Return the two parts of a node with a fractional solution."""
        network, n = self.network, self.network.size
        flow = self.master.flows(values)[:n, :n]
        flow = np.triu(flow + flow.T) if network.symmetric else flow
        away = np.abs(flow - np.round(flow))
        away[flow > 1.0] = 0.0  # a cycle of repeated nodes: the second part would not exclude it
        if away.max(initial=0.0) > INTEGRAL:
            i, j = (int(x) for x in np.unravel_index(away.argmax(), away.shape))
            return self._split_edge(node, i, j)
        visits = np.zeros((len(network.kinds), n))
        counts = np.zeros(len(network.kinds))
        for used in np.flatnonzero(values > 0.0):
            column = self.master.columns[used]
            np.add.at(visits[column.kind], list(column.route), values[used])
            counts[column.kind] += values[used]
        away = np.abs(counts - np.round(counts))
        if away.max() > INTEGRAL:
            k = int(away.argmax())
            low, high = node.counts[k]
            parts = (low, math.floor(counts[k])), (math.ceil(counts[k]), high)
            return [
                replace(node, counts=(*node.counts[:k], part, *node.counts[k + 1 :]))
                for part in parts
            ]
        away = np.abs(visits - np.round(visits))
        if away.max() > INTEGRAL:
            k, i = (int(x) for x in np.unravel_index(away.argmax(), away.shape))
            without, only = node.forbidden.copy(), node.forbidden.copy()
            without[k, i] = without[k, :, i] = True
            others = [other for other in range(len(network.kinds)) if other != k]
            only[others, i] = only[others, :, i] = True
            return [replace(node, forbidden=without), replace(node, forbidden=only)]
        if not self.remember(values):
            raise Stopped
        return [node]

    def _split_edge(self, node: Node, i: int, j: int) -> list[Node]:
        """Return the nodes without and with an edge (an arc if distances are asymmetric)."""
        forbidden = node.forbidden.copy()
        forbidden[:, i, j] = True
        matrix = np.zeros(forbidden.shape[1:])
        matrix[i, j] = 1.0
        if self.network.symmetric:
            forbidden[:, j, i] = True
            matrix[j, i] = 1.0
        if (i, j) not in self.edges:
            self.edges[i, j] = self.master.add_arcs(matrix, 1.0, math.inf)
        required = node.required | {(i, j)}
        return [replace(node, forbidden=forbidden), replace(node, required=required)]

    def remember(self, values: Floats) -> bool:
        """Enlarge the ng-sets so that they exclude the cycles of a solution; return whether it has one.

        Source: R. Roberti and A. Mingozzi, "Dynamic ng-path relaxation for the delivery man problem",
        Transportation Science 48, 2014.
        """
        changed = False
        for k in np.flatnonzero(values > 0.0):
            route = self.master.columns[k].route
            last: dict[int, int] = {}
            for place, stop in enumerate(route):
                if stop in last:
                    self.network.near[list(route[last[stop] : place]), stop] = True
                    changed = True
                last[stop] = place
        return changed


def _remembers(route: tuple[int, ...], near: Mask) -> bool:
    """Return whether a route repeats a node only after it left the ng-sets of that node."""
    if len(set(route)) == len(route):
        return True
    seen = np.zeros(len(near), bool)
    for stop in route:
        if seen[stop]:
            return False
        seen &= near[stop]
        seen[stop] = True
    return True
