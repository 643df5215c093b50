"""SCS: a first-order splitting method on the homogeneous embedding."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp

from ...models.programs.cones import ConeKind, order
from ..conic.base import ConvexBackend
from ..contract.backend import Feature, Limit, Option, Request
from ..programs.attempts import (
    Clock,
    Ended,
    Ending,
    Meaning,
    limit_reached,
    solver_options,
    stop_reason,
)
from .base import COMMON
from .forms import ConicForm, Convex, columnwise
from .settings import EPS, POLISH, first_order_precision, slice_iterations, time_left

__all__ = ["Scs"]

#: Names of the cones in SCS, in its order.
_NAMES = {ConeKind.SECOND_ORDER: "q", ConeKind.SEMIDEFINITE: "s", ConeKind.EXPONENTIAL: "ep"}

#: Binary orders of magnitude between multipliers and point that need no scaling of the objective.
_BALANCED = 7
#: Iterations after which the size of the multipliers is known.
_SETTLED = 1000


class Scs(ConvexBackend):
    """Backend for SCS (O'Donoghue 2021), which is run in slices of time."""

    name = "scs"
    features = COMMON | {Feature.WARM_START, Feature.INTERRUPT, Feature.LOG}
    requires = ("scs",)
    extra = "qp"
    options: ClassVar[Mapping[str, Option]] = {
        "polish": POLISH,
        "eps": EPS,
        "max_iters": Option(200_000, "Limit on iterations.", int, lower=1),
        "scale": Option(0.1, "Initial weight of the constraints.", float, lower=1e-6, upper=1e6),
    }
    deterministic = True
    summary = "SCS: first-order, sparse, warm starts; many iterations for high precision"

    def attempt(self, program: Convex, request: Request, clock: Clock) -> Ending:
        """Solve the program with SCS."""
        import scs  # type: ignore[import-untyped]

        form = ConicForm.of(program, tuple(_NAMES), columnwise)
        eps = first_order_precision(request)
        if not form.right.size:
            # SCS needs a row, so one is added that every point satisfies.
            form = _with_a_row(form, program.size)
        settings: dict[str, Any] = {
            "verbose": request.verbose,
            "eps_abs": eps,
            "eps_rel": eps,
            "eps_infeas": 1e-9,
            **solver_options(request, "eps"),
        }
        cone: dict[str, Any] = {"z": form.zeros, "l": form.linear - form.zeros}
        for kind, name in _NAMES.items():
            cone[name] = [b.dimension for b in form.cones if b.kind is kind for _ in range(b.count)]
        cone["s"] = [order(dimension) for dimension in cone["s"]]
        cone["ep"] = len(cone["ep"])
        data = {
            "P": sp.csc_matrix(sp.triu(program.hessian)),
            "A": form.matrix,
            "b": form.right,
            "c": program.cost,
        }
        control, iteration_limit = request.control, settings["max_iters"]
        start: dict[str, Any] = {"warm_start": False}
        if request.warm_start is not None:
            x = np.asarray(request.warm_start, float)
            slack = form.slack(x)
            start = {"warm_start": True, "x": x, "y": np.zeros(slack.size), "s": slack}
        # The limits are settings of the workspace, which therefore is made for a slice.
        settings["max_iters"] = min(iteration_limit, slice_iterations(data["P"], form.matrix))
        solver = scs.SCS(data, cone, time_limit_secs=time_left(clock), **settings)
        clock.lap("build")
        iterations, unit, settled = 0, 1.0, False
        while True:
            result = solver.solve(**start)
            info = result["info"]
            iterations += int(info["iter"])
            is_late = "time_limit" in info["status"]
            is_paused = "max_iters" in info["status"] and iterations < iteration_limit
            if not is_paused or limit_reached(request, clock) is not None:
                break
            start = {"warm_start": True, "x": result["x"], "y": result["y"], "s": result["s"]}
            if not settled and iterations >= _SETTLED:
                settled, unit = True, _imbalance(result)
                if unit != 1.0:
                    scaled = {**data, "P": data["P"] / unit, "c": data["c"] / unit}
                    solver = scs.SCS(scaled, cone, time_limit_secs=time_left(clock), **settings)
                    start["y"] = start["y"] / unit
        clock.lap("solve")
        meanings: dict[int, Meaning] = {
            scs.SOLVED: Ended.PROVEN,
            scs.INFEASIBLE: Ended.INFEASIBLE,
            scs.UNBOUNDED: Ended.UNBOUNDED,
            scs.INFEASIBLE_INACCURATE: Ended.INFEASIBLE,
            scs.UNBOUNDED_INACCURATE: Ended.UNBOUNDED,
            scs.SOLVED_INACCURATE: (Ended.STOPPED, Limit.ITERATIONS),
        }
        ending = Ending.read(
            "SCS",
            int(info["status_val"]),
            meanings,
            info["status"],
            point=np.array(result["x"], float),
            duals=form.duals(unit * np.asarray(result["y"]), program.row_count),
            statistics={"iterations": iterations},
        )
        if is_late or is_paused:
            return replace(ending, ended=Ended.STOPPED, limit=stop_reason(control, Limit.TIME))
        return ending


def _imbalance(result: Mapping[str, Any]) -> float:
    """Return the ratio of multipliers and point as a power of two, 1 if both are of similar size.

    SCS scales objectives by their linear costs only, and stalls if the multipliers are far larger.
    """
    sizes = [np.abs(result[name]).max(initial=0.0) for name in ("y", "x")]
    if not np.isfinite(sizes).all() or min(sizes) == 0.0:
        return 1.0
    power = float(np.round(np.log2(sizes[0] / max(sizes[1], 1.0))))
    return 2.0**power if abs(power) > _BALANCED else 1.0


def _with_a_row(form: ConicForm, size: int) -> ConicForm:
    row = sp.csc_matrix(([1.0], ([0], [0])), shape=(1, size))
    # The row 0 @ x <= 1; a nonzero coefficient would be a bound for points of large size.
    row.data[:] = 0.0
    return replace(form, matrix=row, right=np.ones(1), linear=1)
