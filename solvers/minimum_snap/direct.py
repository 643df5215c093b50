"""``banded``: our own direct solver in O(segments), for problems without corridor and limits."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation
from ...models.minimum_snap.bounds import derivative_name
from ...models.minimum_snap.model import MinimumDerivative
from ...models.minimum_snap.trajectory import Trajectory
from ..backend import Answer, Backend, Feature, Guarantee, Request, Termination

__all__ = ["Banded"]

Floats = NDArray[np.float64]

#: Segments whose gradients are formed at a time.
_CHUNK = 65536


class Banded(Backend):
    """Block-tridiagonal elimination of the free derivatives at the knots, all axes at once.

    The optimum of one order has degree ``2 r - 1`` whatever the model allows, and derivatives up to
    ``2 r - 2`` are continuous by optimality where only the position is fixed.
    """

    name = "banded"
    accepts = MinimumDerivative
    guarantee = Guarantee.EXACT
    features = frozenset({Feature.GAP, Feature.DUAL_BOUND})
    deterministic = True
    single_threaded = True
    summary = "direct O(segments) solver for waypoints without corridor and limits; ours"

    def refuses(self, problem: MinimumDerivative) -> str:
        """Return what of `problem` is beyond derivatives at knots."""
        if problem.bounded:
            names = [bound.name for bound in problem.bounds]
            names += ["polytopes"] if problem.halfspaces is not None else []
            return f"{', '.join(names)}: take interior-point"
        order = problem.order
        single = np.count_nonzero(problem.order_weights) == 1
        if problem.degree > 2 * order - 1 and not single:
            return f"degree {problem.degree} with weights of several orders"
        fixed = np.isfinite(problem.conditions)
        if fixed.shape[1] > order and fixed[:, order:].any():
            return f"a fixed {derivative_name(order)} or higher derivative"
        if problem.continuity > order - 1:
            # Where derivative j is fixed at an inner knot, the optimum's 2r-1-j jumps there.
            inner = fixed[1:-1].any(axis=(0, 2))
            jumps = 2 * order - 1 - int(np.flatnonzero(inner).max()) if inner.any() else 2 * order
            if not single or problem.continuity >= jumps:
                return f"continuity {problem.continuity}"
        return ""

    def run(self, problem: MinimumDerivative, request: Request) -> Answer:
        """Solve, and bound the objective from below by the gradient that rounding left."""
        from .banded import solve_hermite
        from .hermite import Outcome, jets_to_coefficients

        refusal = self.refuses(problem)
        if refusal:
            raise UnsupportedFormulation(f"backend {self.name!r} does not cover {refusal}")
        begin = time.perf_counter()
        order = problem.order
        # Derivatives beyond the given rows are free.
        table = np.full((problem.times.size, order, problem.dimensions), np.inf)
        rows = min(order, problem.conditions.shape[1])
        table[:, :rows] = problem.conditions[:, :rows]
        fixed = np.isfinite(table)
        values = np.moveaxis(np.where(fixed, table, 0.0), 2, 0)
        # A copy: kernels are compiled for arrays that may be written, and the model's may not.
        durations = np.array(problem.durations)
        found = solve_hermite(
            durations,
            np.ascontiguousarray(values),
            np.ascontiguousarray(np.moveaxis(fixed, 2, 0)),
            problem.order_weights,
            min(problem.continuity, order - 1),
        )
        statistics: dict[str, float | int | str] = {
            "refinements": found.refinements,
            "factorisations": found.factorisations,
            "stationarity residual": float(found.residual),
            "method": found.method,
        }
        if found.outcome is not Outcome.SOLVED:
            seconds = {"solve": time.perf_counter() - begin}
            if found.outcome is Outcome.NOT_UNIQUE:
                message = (
                    "some motion costs nothing and moves nothing that is fixed, so there is no "
                    "unique optimum: fix more waypoints or derivatives"
                )
            else:
                message = "the durations differ too much for double precision"
            return Answer(
                Termination.NO_SOLUTION, seconds=seconds, statistics=statistics, message=message
            )
        coefficients = jets_to_coefficients(durations, found.jets, found.moments)
        plan = Trajectory(problem.times, coefficients)
        objective = float(found.objective.sum())
        solved = time.perf_counter()
        gain = _gain(problem, found.jets, fixed)
        return Answer(
            Termination.OPTIMAL,
            point=plan,
            primal_bound=objective,
            dual_bound=objective - gain,
            seconds={"solve": solved - begin, "certify": time.perf_counter() - solved},
            statistics=statistics,
        )


def _gain(problem: MinimumDerivative, jets: Floats, fixed: NDArray[np.bool_]) -> float:
    """Return what no trajectory can gain within ``max(1, |d|)`` of the derivatives d at the knots.

    The objective is convex, so it lies above its tangent: the gradient with respect to what is
    free, which exact arithmetic would make zero, times how far each derivative may move.
    """
    from .hermite import scaled_jets, table_of

    order, count = problem.order, problem.segments
    table = table_of(problem.order_weights)
    shared = min(problem.continuity, order - 1) + 1
    knots = np.zeros((problem.dimensions, problem.times.size, order))
    total = 0.0
    for begin in range(0, count, _CHUNK):
        part = slice(begin, min(begin + _CHUNK, count))
        long = problem.durations[part]
        y = scaled_jets(long, jets[:, part]).reshape(problem.dimensions, long.size, 2 * order)
        moments = y @ table.rows.T
        size = table.factors * long[:, None] ** (1.0 - 2.0 * table.orders)
        slope = 2.0 * ((moments * size) @ table.rows)
        slope *= np.tile(long[:, None] ** np.arange(order), 2)
        first, last = slope[..., :order], slope[..., order:]
        knots[:, begin : begin + long.size] += np.where(np.arange(order) < shared, first, 0.0)
        knots[:, begin + 1 : begin + 1 + long.size] += np.where(
            np.arange(order) < shared, last, 0.0
        )
        if shared < order:
            for side, own in ((0, first), (1, last)):
                known = np.moveaxis(fixed, 2, 0)[:, begin + side : begin + side + long.size]
                own = np.where(known, 0.0, own)[..., shared:]
                total += float(
                    np.sum(np.abs(own) * np.maximum(1.0, np.abs(jets[:, part, side, shared:])))
                )
    reach = np.maximum(1.0, np.abs(np.concatenate([jets[:, :, 0], jets[:, -1:, 1]], axis=1)))
    total += float(np.sum(np.where(np.moveaxis(fixed, 2, 0), 0.0, np.abs(knots) * reach)))
    return total
