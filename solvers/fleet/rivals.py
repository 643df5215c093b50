"""Shared parts of the fleet heuristics: the incumbent and the answer."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from ...jit import clock
from ...models.fleet import FleetPlan, FleetRouting
from ...models.fleet.checks import loads_of, objective_of, value_of
from ...models.fleet.features import list_unsupported
from ..contract.backend import Answer, Backend, Feature, Guarantee, Request, Termination
from .limit_repair import RULES, repair

__all__ = ["Best", "FleetBackend", "FleetHeuristic"]


#: Number of cheapest moves evaluated to give an empty vehicle a node.
TRIED = 16
#: Number of plans beyond limits on the lengths that are repaired, and of moves of each repair.
REPAIRS, TRIALS = 4, 1500


@dataclass
class Best:
    """Incumbent: the best plan so far that satisfies every limit; `request` receives every better plan."""

    problem: FleetRouting
    request: Request
    plan: FleetPlan | None = field(init=False, default=None)
    objective: float = field(init=False, default=math.inf)
    broken: str = field(init=False, default="")
    repairs: int = field(init=False, default=0)

    def offer(self, routes: Sequence[Sequence[int]]) -> bool:
        """Make `routes` the incumbent if they are better and feasible; return whether they are."""
        model = self.problem
        plan = model.with_schedule(routes)
        objective = value_of(model, plan)
        if objective is None or not objective < self.objective:
            return False
        checked = model.verify(plan, tolerance=self.request.tolerance)
        if not checked.ok:
            self.broken = next(check.name for check in checked.checks if not check.ok)
            repaired = None
            is_limit = any(rule.name == self.broken for rule in RULES)
            if is_limit and self.plan is None and self.repairs < REPAIRS:
                self.repairs += 1
                repaired = repair(
                    model, routes, self.request.tolerance, self.repairs, TRIALS,
                    lambda: self.request.control.stopped,
                )  # fmt: skip
            return repaired is not None and self.offer(repaired)
        self.plan, self.objective = plan, objective
        self.request.control.incumbent(objective, plan)
        return True

    def offer_filled(self, routes: Sequence[Sequence[int]]) -> bool:
        """Offer `routes` after moving a node to each empty vehicle if every vehicle must be used.

        The move with the best objective is chosen among the :data:`TRIED` moves of least total length
        and the :data:`TRIED` best moves from the longest route. Routes of a rich fleet stay as they are.
        """
        full = [list(route) for route in routes]
        moves = self.problem.use_all and not self.problem.is_rich
        for empty in range(self.problem.vehicles) if moves else ():
            if not full[empty] and not self._fill(full, empty):
                return False  # fewer nodes than vehicles
        return self.offer(full)

    def _fill(self, full: list[list[int]], empty: int) -> bool:
        model, d = self.problem, self.problem.distances
        loads = loads_of(model, FleetPlan(tuple(map(tuple, full))))
        owners, node, before, after = [], [], [], []
        for k, route in enumerate(full):
            if len(route) > 1:
                home = int(model.homes[k])
                owners += [k] * len(route)
                node += route
                before += [home, *route[:-1]]
                after += [*route[1:], home]
        if not node:
            return False
        home = int(model.homes[empty])
        savings = d[before, node] + d[node, after] - d[before, after]
        trips = d[home, node] + d[node, home]
        order = np.argsort(trips - savings, kind="stable")
        longest = order[np.array(owners)[order] == owners[int(loads[owners].argmax())]]
        best, chosen = math.inf, int(order[0])
        for position in [*order[:TRIED], *longest[:TRIED]]:
            trial = loads.copy()
            trial[owners[position]] -= savings[position]
            trial[empty] = trips[position]
            value = objective_of(model, trial)
            if value < best:
                best, chosen = value, int(position)
        full[owners[chosen]].remove(node[chosen])
        full[empty].append(node[chosen])
        return True


class FleetBackend(Backend):
    """Base class of all fleet backends: it refuses models with rich features that a backend lacks.

    Attributes
    ----------
    rich : frozenset of str
        Supported members of ``FEATURES`` in ``models.fleet.features``.
    """

    accepts = FleetRouting
    rich: ClassVar[frozenset[str]] = frozenset()

    def refuses(self, problem: FleetRouting) -> str:
        """Return the names of the rich features that this backend lacks, "" if it has all of them."""
        return list_unsupported(problem, self.rich)


class FleetHeuristic(FleetBackend):
    """Base class of the fleet heuristics; subclasses implement :meth:`search`.

    The answer holds a feasible plan or no plan.
    """

    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.SEED, Feature.INCUMBENTS, Feature.INTERRUPT})

    @abstractmethod
    def search(self, best: Best, request: Request) -> Mapping[str, Any]:
        """Offer improving plans to `best` and return the statistics of the algorithm."""

    def run(self, problem: FleetRouting, request: Request) -> Answer:
        """Run the search and return the answer with the best plan."""
        self.require_support(problem)
        begin = clock()
        best = Best(problem, request)
        statistics = self.search(best, request)
        has_plan = best.plan is not None
        return Answer(
            Termination.FEASIBLE if has_plan else Termination.NO_SOLUTION,
            request.control.limit,
            best.plan,
            best.objective if has_plan else None,
            seconds={"solve": clock() - begin},
            statistics=dict(statistics),
            message="" if has_plan or not best.broken else f"no plan found keeps: {best.broken}",
        )
