"""Clarabel: an interior-point method with certificates of infeasibility."""

from __future__ import annotations

from collections.abc import Mapping
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
    solver_options,
    solver_tolerance,
    stop_reason,
)
from .base import COMMON
from .forms import ConicForm, Convex
from .settings import POLISH

__all__ = ["Clarabel"]

#: Number of entries above which Clarabel chooses the method of its factorisation, and number above which
#: the tolerance is ten times larger, which saves one of eleven iterations.
LARGE, HUGE = 50_000, 500_000


class Clarabel(ConvexBackend):
    """Backend for Clarabel (Goulart and Chen 2024), an interior-point method on a homogeneous embedding."""

    name = "clarabel"
    features = COMMON | {Feature.INTERRUPT, Feature.LOG}
    requires = ("clarabel",)
    options: ClassVar[Mapping[str, Option]] = {
        "polish": POLISH,
        "max_iter": Option(200, "Limit on interior-point iterations.", int, lower=1),
    }
    deterministic = True
    summary = "Clarabel: interior point, sparse, finds infeasibility fast"

    def attempt(self, program: Convex, request: Request, clock: Clock) -> Ending:
        """Solve the program with Clarabel."""
        import clarabel  # type: ignore[import-untyped]

        form = ConicForm.of(program)
        cones: list[Any] = []
        if form.zeros:
            cones.append(clarabel.ZeroConeT(form.zeros))
        if form.linear > form.zeros:
            cones.append(clarabel.NonnegativeConeT(form.linear - form.zeros))
        for block in form.cones:
            constructor = {
                ConeKind.SECOND_ORDER: (clarabel.SecondOrderConeT, block.dimension),
                ConeKind.EXPONENTIAL: (clarabel.ExponentialConeT,),
                ConeKind.SEMIDEFINITE: (clarabel.PSDTriangleConeT, order(block.dimension)),
            }[block.kind]
            cones += [constructor[0](*constructor[1:])] * block.count
        settings = clarabel.DefaultSettings()
        settings.verbose = request.verbose
        # Always one thread, as the backend declares.
        settings.max_threads = 1
        # "auto" also considers supernodal factorisation, which is faster if the factors are dense.
        entries = form.matrix.nnz + program.hessian.nnz
        # Each semidefinite cone is a dense block of the linear systems.
        dense = sum(
            block.count * block.dimension * (block.dimension + 1) // 2
            for block in form.cones
            if block.kind is ConeKind.SEMIDEFINITE
        )
        settings.direct_solve_method = "auto" if entries + dense > LARGE else "qdldl"
        share = 1e-2 if entries > HUGE else 1e-3
        tolerance = solver_tolerance(request, 1e-12, 1e-8, share=share)
        for name in ("tol_feas", "tol_gap_abs", "tol_gap_rel"):
            setattr(settings, name, tolerance)
        for name, value in solver_options(request).items():
            setattr(settings, name, value)
        solver = clarabel.DefaultSolver(
            sp.csc_matrix(sp.triu(program.hessian)),
            program.cost,
            form.matrix,
            form.right,
            cones,
            settings,
        )
        control = request.control
        solver.set_termination_callback(lambda info: control.stopped)
        clock.lap("build")
        left = clock.left()
        if left is not None:
            settings.time_limit = left
            solver.update(settings=settings)
        result = solver.solve()
        clock.lap("solve")
        meanings: dict[str, Meaning] = {
            "Solved": Ended.PROVEN,
            "AlmostSolved": Ended.PROVEN,
            "PrimalInfeasible": Ended.INFEASIBLE,
            "AlmostPrimalInfeasible": Ended.INFEASIBLE,
            "DualInfeasible": Ended.UNBOUNDED,
            "AlmostDualInfeasible": Ended.UNBOUNDED,
            "MaxIterations": (Ended.STOPPED, Limit.ITERATIONS),
            "MaxTime": (Ended.STOPPED, Limit.TIME),
            "CallbackTerminated": (Ended.STOPPED, stop_reason(control)),
        }
        return Ending.read(
            "Clarabel",
            str(result.status),
            meanings,
            point=np.array(result.x, float),
            duals=form.duals(result.z, program.row_count),
            statistics={"iterations": int(result.iterations)},
        )
