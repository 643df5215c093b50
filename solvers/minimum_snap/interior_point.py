"""``interior-point``: native structured interior point for corridors and limits."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ...jit import clock
from ...models.minimum_snap.model import MinimumDerivative
from ...models.minimum_snap.trajectory import Trajectory
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
from ..programs.scaling import common
from ..run.certification import SHAPE, UNCERTIFIED

if TYPE_CHECKING:
    from .interior_solver import ChainResult

__all__ = ["InteriorPoint"]


class InteriorPoint(Backend):
    """Mehrotra's predictor-corrector method on the knots' derivatives, O(segments) per iteration.

    Every axis is a separate problem unless half-spaces couple the axes. Corridor and limits are
    imposed at instants, and violations between them add further instants. The lower bound is
    therefore valid for the model. Its residuals are the proof: see
    :class:`~crosstrack.solvers.minimum_snap.interior_solver.ChainResult`.
    """

    name = "interior-point"
    accepts = MinimumDerivative
    guarantee = Guarantee.EXACT
    features = frozenset({Feature.GAP, Feature.THREADS, Feature.DUAL_BOUND, Feature.INTERRUPT})
    deterministic = True
    options: ClassVar[Mapping[str, Option]] = {
        "samples": Option(
            8, "Instants of each segment held from the start.", int, lower=2, upper=64
        ),
        "iterations": Option(100, "Most Newton steps for one set of instants.", int, lower=1),
        "rounds": Option(40, "Most additions of instants.", int, lower=1),
    }
    summary = "structured interior point for corridors and limits, O(segments); ours"

    def refuses(self, problem: MinimumDerivative) -> str:
        """Return the features of `problem` that shared knots cannot express, or an empty string."""
        if problem.vehicle is not None or problem.periodic or problem.gates:
            return "vehicles, gates and periodic paths: take formulation cones or legendre"
        if problem.continuity != problem.order - 1:
            return (
                f"continuity {problem.continuity}: knots share the derivatives up to "
                f"{problem.order - 1}"
            )
        if problem.fixes_order:
            return f"a derivative above {problem.order - 1} is fixed"
        return ""

    @np.errstate(all="ignore")  # an overflow yields NaN, which is rejected as a plan
    def run(self, problem: MinimumDerivative, request: Request) -> Answer:
        """Solve every chain, and combine the certificates of their residuals."""
        from .chain import chains
        from .contacts import uncertifiable
        from .interior_solver import Settings, solve_chain

        self.require_support(problem)
        begin = clock()
        # The residuals of the iteration are absolute. Lengths far from 1 m are therefore rescaled.
        unit = common(float(problem.position_scale.max()))
        if unit != 1.0:
            answer = self.run(problem.in_unit(unit), request)
            return _in_metres(answer, problem, unit)
        reason = uncertifiable(problem)
        settings = Settings(
            gap=float(np.clip(0.01 * request.gap, 1e-11, 1e-8)),
            tolerance=float(np.clip(1e-4 * request.tolerance, 1e-12, 1e-8)),
            # Below the allowance for rounding, so that the verification does not depend on it.
            between=5e-4 * request.tolerance,
            samples=request.options.get("samples", 8),
            iterations=request.options.get("iterations", 100),
            rounds=request.options.get("rounds", 40),
            certify=not reason,
        )
        work = partial(solve_chain, settings=settings, flag=request.control.flag)
        groups = chains(problem)
        threads = min(request.threads or 1, len(groups))
        if threads > 1:
            with ThreadPoolExecutor(threads) as pool:
                results = list(pool.map(work, groups))
        else:
            results = []
            for group in groups:
                results.append(work(group))
                if results[-1].status in ("infeasible", "stopped"):
                    break
        answer = _conclude(problem, request, results, len(groups), reason)
        return replace(answer, seconds={"solve": clock() - begin})


def _in_metres(answer: Answer, problem: MinimumDerivative, unit: float) -> Answer:
    """Convert the answer of a problem in units of `unit` m to an answer for `problem`."""
    plan, primal, dual = answer.point, answer.primal_bound, answer.dual_bound
    return replace(
        answer,
        point=None if plan is None else replace(plan, coefficients=plan.coefficients * unit),
        primal_bound=None if primal is None else primal * unit**2,
        dual_bound=None if dual is None else dual * unit**2,
    )


def _conclude(
    problem: MinimumDerivative,
    request: Request,
    results: list[ChainResult],
    groups: int,
    reason: str,
) -> Answer:
    """Return the answer. `reason` explains why paths of `problem` cannot be certified."""
    statistics: dict[str, float | int | str] = {
        "iterations": sum(r.iterations for r in results),
        "refinements": max(r.rounds for r in results),
        "instants": sum(r.instants for r in results),
        "primal residual": max(r.primal for r in results),
        "dual residual": max(r.dual for r in results),
    }
    for result in results:
        if result.status == "infeasible":
            where = ", ".join(map(str, result.conflict[:12].tolist()))
            return Answer(
                Termination.INFEASIBLE, statistics=statistics,
                message=f"the bounds of segment{'s' if result.conflict.size > 1 else ''} {where} "
                "contradict one another",
            )  # fmt: skip
    if any(r.status == "stopped" for r in results) or len(results) < groups:
        limit = request.control.reason or Limit.INTERRUPTED
        return Answer(Termination.NO_SOLUTION, limit, statistics=statistics)
    if not all(np.isfinite(r.powers).all() for r in results):
        return Answer(
            Termination.NO_SOLUTION, Limit.ITERATIONS, statistics=statistics,
            message="the iterations end in what is no number: the optimum is not unique, or the "
            "durations differ too much",
        )  # fmt: skip
    objective = sum(r.objective for r in results)
    # The objective of each axis is a sum of squares, so 0 is a valid bound despite rounding.
    bound = sum(max(r.bound, 0.0) for r in results)
    powers = np.concatenate([r.powers for r in results], axis=2)
    plan = problem.with_yaw(Trajectory(problem.times, powers))
    settled = all(r.status == "solved" for r in results)
    message = "" if settled else "the iterations stalled before the residuals were small"
    if not settled:
        worst = max(r.primal for r in results)
        if worst > request.tolerance:
            # Objective and bound of an iterate that violates its bounds are meaningless.
            return Answer(
                Termination.NO_SOLUTION, Limit.ITERATIONS, statistics=statistics, message=message
            )
    correction = max(r.correction for r in results)
    if settled and reason:
        statistics[SHAPE] = f"{UNCERTIFIED}: {reason}"
    elif settled and np.isfinite(correction):
        statistics["correction"] = correction
    elif settled:
        statistics[SHAPE] = UNCERTIFIED
        return Answer(
            Termination.FEASIBLE, request.control.reason, plan, objective, bound,
            statistics=statistics, message="the objective is proven, but not the shape of the path",
        )  # fmt: skip
    return Answer(
        Termination.OPTIMAL if settled else Termination.FEASIBLE,
        None if settled else Limit.ITERATIONS,
        plan, objective, bound, statistics=statistics, message=message,
    )  # fmt: skip
