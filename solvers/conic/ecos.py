"""ECOS: an interior-point method for second-order and exponential cones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.model import Model
from ...models.programs.cones import ConeBlock, ConeKind
from ...models.programs.conic import ConicProgram
from ..contract.backend import Feature, Limit, Option, Request
from ..programs.attempts import Clock, Ended, Ending, Meaning, solver_options, solver_tolerance
from ..qp.base import COMMON
from ..qp.forms import ConicForm
from .base import ConvexBackend

__all__ = ["Ecos"]


class Ecos(ConvexBackend):
    """Backend for ECOS (Domahidi, Chu and Boyd 2013), without semidefinite cones and quadratic objectives."""

    name = "ecos"
    accepts = ConicProgram
    features = COMMON | {Feature.LOG}
    requires = ("ecos",)
    extra = "ecos"
    options: ClassVar[Mapping[str, Option]] = {
        "max_iters": Option(200, "Limit on interior-point iterations.", int, lower=1)
    }
    deterministic = True
    summary = "ECOS: interior point for second-order and exponential cones, small programs"

    def comparison_options(self, kind: type[Model[Any]]) -> Mapping[str, Any]:
        return {}

    def refuses(self, problem: ConicProgram) -> str:
        """Return the part of `problem` that ECOS does not support."""
        if problem.hessian.nnz:
            return "ECOS has no quadratic objectives; state it as a second-order cone"
        if any(block.kind is ConeKind.SEMIDEFINITE for block in problem.cones):
            return "ECOS has no semidefinite cones"
        return ""

    def attempt(self, program: Any, request: Request, clock: Clock) -> Ending:
        """Solve the program with ECOS."""
        import ecos  # type: ignore[import-untyped]

        form = ConicForm.of(program, (ConeKind.SECOND_ORDER, ConeKind.EXPONENTIAL), _order)
        quadratic = [b for b in form.cones if b.kind is ConeKind.SECOND_ORDER]
        count = form.zeros
        equal: dict[str, Any] = {}
        if count:
            equal = {"A": sp.csc_matrix(form.matrix[:count]), "b": form.right[:count]}
        dims = {
            "l": form.linear - count,
            "q": [block.dimension for block in quadratic for _ in range(block.count)],
            "e": sum(b.count for b in form.cones if b.kind is ConeKind.EXPONENTIAL),
        }
        tolerance = solver_tolerance(request, 1e-12, 1e-8, share=1e-2)
        clock.lap("build")
        result = ecos.solve(
            program.cost.copy(),
            sp.csc_matrix(form.matrix[count:]),
            form.right[count:],
            dims,
            **equal,
            verbose=request.verbose,
            feastol=tolerance,
            abstol=tolerance,
            reltol=tolerance,
            **solver_options(request),
        )
        clock.lap("solve")
        status = int(result["info"]["exitFlag"])
        # ECOS 2.0, include/ecos.h: a status plus 10 was reached with reduced precision.
        meanings: dict[int, Meaning] = {
            0: Ended.PROVEN,
            1: Ended.INFEASIBLE,
            2: Ended.UNBOUNDED,
            10: Ended.PROVEN,
            11: Ended.INFEASIBLE,
            12: Ended.UNBOUNDED,
            -1: (Ended.STOPPED, Limit.ITERATIONS),
        }
        return Ending.read(
            "ECOS",
            status,
            meanings,
            result["info"]["infostring"],
            point=np.array(result["x"], float),
            duals=form.duals(np.concatenate([result["y"], result["z"]]), program.row_count),
            statistics={"iterations": int(result["info"]["iter"])},
        )


def _order(block: ConeBlock) -> NDArray[np.intp]:
    """Return the rows of a cone in the order of ECOS, which requires ``exp(x / z) <= y / z``."""
    if block.kind is ConeKind.EXPONENTIAL:
        return np.array([0, 2, 1])
    return np.arange(block.dimension)
