"""``banded``: native direct solver in O(segments) for problems without corridor and limits."""

from __future__ import annotations

import numpy as np

from ...jit import clock
from ...models.minimum_snap.bounds import derivative_name
from ...models.minimum_snap.model import MinimumDerivative
from ...models.minimum_snap.trajectory import Trajectory
from ..contract.backend import Answer, Backend, Feature, Guarantee, Request, Termination

__all__ = ["Banded"]


#: Largest number of segments of a brief run.
_BRIEF = 2000
#: Coefficients above this multiple of the waypoints' extent cause a message.
_SWING = 1e6


class Banded(Backend):
    """Block-tridiagonal elimination of the free derivatives at the knots, all axes at once.

    The optimum for one order has degree ``2 r - 1`` even if the model allows more. If only the
    position is fixed, derivatives up to ``2 r - 2`` are continuous by optimality.
    """

    name = "banded"
    accepts = MinimumDerivative
    guarantee = Guarantee.EXACT
    features = frozenset({Feature.GAP, Feature.DUAL_BOUND})
    deterministic = True
    single_threaded = True
    #: True, because it also certifies the shape, which the objective of other backends does not.
    conclusive = True
    summary = "direct O(segments) solver for waypoints without corridor and limits; ours"

    def refuses(self, problem: MinimumDerivative) -> str:
        """Return the unsupported features of `problem`, or an empty string."""
        if problem.vehicle is not None or problem.periodic or problem.gates:
            return "vehicles, gates and periodic paths: take formulation cones or legendre"
        if problem.bounded:
            names = [bound.name for bound in problem.bounds]
            names += ["polytopes"] if problem.halfspaces is not None else []
            return f"{', '.join(names)}: take interior-point"
        order = problem.order
        single = np.count_nonzero(problem.order_weights) == 1
        if problem.degree > 2 * order - 1 and not single:
            return f"degree {problem.degree} with weights of several orders"
        fixed = np.isfinite(problem.conditions)
        if problem.fixes_order:
            return f"a fixed {derivative_name(order)} or higher derivative"
        if problem.continuity > order - 1:
            # If derivative j is fixed at an inner knot, derivative 2r-1-j of the optimum jumps.
            inner = fixed[1:-1].any(axis=(0, 2))
            jumps = 2 * order - 1 - int(np.flatnonzero(inner).max()) if inner.any() else 2 * order
            if not single or problem.continuity >= jumps:
                return f"continuity {problem.continuity}"
        return ""

    def is_brief(self, problem: MinimumDerivative) -> bool:
        """Return whether even the general kernels take less than 0.1 s for the segments."""
        return problem.segments <= _BRIEF

    def run(self, problem: MinimumDerivative, request: Request) -> Answer:
        """Solve, and prove objective and shape by an additional Newton step."""
        from .banded import solve_hermite
        from .hermite import CERTIFIED, Outcome, jets_to_coefficients

        self.require_support(problem)
        begin = clock()
        table = np.moveaxis(problem.jets, 2, 0)
        fixed = np.isfinite(table)
        # Kernels are compiled for writable arrays, and the model's arrays are read-only.
        durations = np.array(problem.durations)
        result = solve_hermite(
            durations,
            np.where(fixed, table, 0.0),
            fixed,
            problem.order_weights,
            min(problem.continuity, problem.order - 1),
            certify=True,
        )
        statistics: dict[str, float | int | str] = {
            "refinements": result.refinements,
            "factorisations": result.factorisations,
            "method": result.method,
        }
        if result.outcome is not Outcome.SOLVED:
            seconds = {"solve": clock() - begin}
            if result.outcome is Outcome.NOT_UNIQUE:
                statistics["unique"] = "no"
                message = (
                    "some motion costs nothing and moves nothing that is fixed, so there is no "
                    "unique optimum: fix more waypoints or derivatives"
                )
            else:
                message = "the durations differ too much for double precision"
            return Answer(
                Termination.NO_SOLUTION, seconds=seconds, statistics=statistics, message=message
            )
        powers = jets_to_coefficients(durations, result.jets, result.moments)
        plan = problem.with_yaw(Trajectory(problem.times, powers))
        objective = float(result.objective.sum())
        statistics["correction"] = result.correction
        proven = result.correction <= CERTIFIED
        return Answer(
            Termination.OPTIMAL if proven else Termination.FEASIBLE,
            point=plan,
            primal_bound=objective,
            # J is a sum of squares, so 0 is a valid bound.
            dual_bound=max(0.0, objective - result.gap) if proven else 0.0,
            seconds={"solve": clock() - begin},
            statistics=statistics,
            message=_doubt(problem, plan) if proven else (
                f"the shape of segment {result.segment} is certain to {result.correction:.1g} of its size "
                f"only (asked: {CERTIFIED:g}), since the durations differ too much"
            ),
        )  # fmt: skip


def _doubt(problem: MinimumDerivative, plan: Trajectory) -> str:
    """Return a message if coefficients are so large that the knots lose digits, else empty."""
    reach = np.abs(plan.coefficients[:, 1:]).sum(axis=1).max(axis=1)
    at = int(reach.argmax())
    if reach[at] <= _SWING * problem.position_scale.max():
        return ""
    return (
        f"the durations differ too much: segment {at} swings out with coefficients of "
        f"{reach[at]:.1g} m, which double precision keeps to {np.finfo(float).eps * reach[at]:.1g} m"
    )
