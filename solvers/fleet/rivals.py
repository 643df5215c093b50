"""Shared parts of the fleet heuristics: the incumbent and the answer."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from ...jit import clock
from ...models.fleet import FleetPlan, FleetRouting, Objective
from ...models.fleet.checks import loads_of, objective_of, value_of
from ...models.fleet.features import list_unsupported
from ..contract.backend import Answer, Backend, Feature, Guarantee, Limit, Request, Termination
from .limit_repair import RULES, excess_of, repair

__all__ = ["Best", "FleetBackend", "FleetHeuristic"]


#: Number of cheapest moves evaluated to give an empty vehicle a node.
TRIED = 16
#: Number of plans beyond limits on the lengths that are repaired, and of moves of each repair.
REPAIRS, TRIALS = 4, 1500
#: Fields of costs, which a stage for a first plan omits.
COSTS = ("fixed_cost", "distance_cost", "time_cost")
#: Share of the time of each stage that searches for a first plan.
SHARE = 0.3


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
            is_limit = any(rule.name == self.broken for rule in RULES)
            if not is_limit or self.plan is not None or self.repairs >= REPAIRS:
                return False
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
        if self.rich:
            self._find_first_plan(best, request)
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

    def _find_first_plan(self, best: Best, request: Request) -> None:
        """Offer plans of simpler objectives until one is feasible, for limits that the search does not use.

        Without limits on the lengths and costs, the sum is minimised, and the longest route if the range or the
        deviation is limited. OR-Tools may find no first plan for the makespan, so it starts in the same way.
        """
        problem, whole = best.problem, request.left() or request.options.get("seconds")
        rules = [rule for rule in RULES if rule.field in problem.limits]
        measures = ["sum"] * (problem.objective is Objective.MAKESPAN)
        measures += ["sum" if rule.measure == "sum" else "max" for rule in rules]
        fields: dict[str, Any] = dict.fromkeys((*(rule.field for rule in rules), *COSTS))
        prizes = None if problem.prizes is None else 0.0 * problem.prizes
        for measure in dict.fromkeys(measures):
            objective = measure if prizes is None else "cost"
            simple = replace(problem, **fields, objective=objective, prizes=prizes, q=0.0)
            if best.plan is not None or request.control.stopped or self.refuses(simple):
                return

            def offer(_: float, plan: FleetPlan) -> None:
                # The check avoids a repair, which would use the time of the stage.
                if excess_of(problem, plan.routes) <= 0.0 and best.offer(plan.routes):
                    control.stop(Limit.TARGET)

            with request.control.stage(SHARE * whole if whole else None, offer) as control:
                stage = replace(request, control=control, target=None, evaluations=None)
                short = Best(simple, stage)
                self.search(short, stage)
            if best.plan is None and short.plan is not None:
                best.offer(short.plan.routes)
