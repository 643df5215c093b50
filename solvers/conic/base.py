"""Base of the backends for conic programs, which recomputes claims as for quadratic programs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...models.model import Model
from ...models.programs.conic import ConicProgram
from ...models.programs.linear import QuadraticProgram
from ...models.verification import ROUNDING
from ..contract.backend import Answer, Request, Termination
from ..programs.attempts import Ended, Ending
from ..qp.base import QuadraticBackend, Run, answered
from ..qp.forms import Core
from ..qp.proofs import Findings
from ..qp.quality import Quality, measured
from .proofs import examined

__all__ = ["ConicRun", "ConvexBackend"]

Vector = NDArray[np.float64]

#: Largest terms of the rows, relative to the constants of the program, before the answer is computed
#: again with a tighter tolerance: a point that diverges as the tolerance decreases is not a solution.
#: With ``x y >= 1`` and ``x = 0``, terms of 1 / e leave a residual e in one of the two, which rounding
#: hides from 1e8 on. The first value is for points without violations beyond rounding, the second for
#: points that need the tolerance. Points beyond the third are rejected.
LARGE, LARGE_AND_OFF, TOO_LARGE = 1e4, 1e2, 1e7
#: Factor of the tighter tolerance.
TIGHTER = 1e-2


class ConvexBackend(QuadraticBackend):
    """Base of the backends that solve quadratic and conic programs."""

    accepts: ClassVar[type[Model[Any]] | tuple[type[Model[Any]], ...]] = (
        QuadraticProgram,
        ConicProgram,
    )

    def run(self, problem: Any, request: Request) -> Answer:
        """Solve a quadratic or conic program, see :meth:`Backend.run`."""
        if isinstance(problem, ConicProgram):
            if problem.cones:
                return answered(self, problem, request, self.attempt, ConicRun)
            problem = problem.quadratic
        return super().run(problem, request)


@dataclass(frozen=True, eq=False)
class ConicRun(Run):
    """Run on a program with cones."""

    problem: Any
    attempt: Any

    def answer(self) -> Answer:
        if self.problem.size:
            return super().answer()
        # Without columns, either the constants satisfy the constraints or multipliers disprove it.
        ending = self.tried(self.core(), self.request)
        best = self.judged(ending)
        if best is not None and self.accepts(best):
            return self.optimal(ending, best)
        return self.unsolved(ending, best)

    def judged(self, ending: Ending) -> Quality | None:
        """Return the quality of the point; None without a point, or if it diverges.

        A point with unusually large terms is computed again with a tighter tolerance, which it must
        satisfy.
        """
        result = self.quality(ending)
        if result is None or self.limit_reached():
            return result
        usual = LARGE if result.violation <= ROUNDING else LARGE_AND_OFF
        if _measured(self.problem, result.point)[0] <= usual:
            return result
        tighter = replace(self.request, tolerance=self.request.tolerance * TIGHTER)
        tighter_result = self.quality(self.tried(self.core(), tighter))
        if tighter_result is None:
            return None
        share, off = _measured(self.problem, tighter_result.point)
        return tighter_result if share <= TOO_LARGE and off <= tighter.tolerance else None

    def quality(self, ending: Ending) -> Quality | None:
        if ending.point is None or ending.ended in (Ended.INFEASIBLE, Ended.UNBOUNDED):
            return None
        duals = ending.duals
        if duals is None or not np.isfinite(duals).all():
            duals = np.zeros(self.problem.row_count + self.problem.cone_offset.size)
        return measured(self.problem, ending.point, duals)

    def unsolved(
        self, ending: Ending, best: Quality | None, findings: Findings | None = None
    ) -> Answer:
        answer = super().unsolved(ending, best, findings)
        if answer.termination is Termination.FAILED and ending.ended is Ended.PROVEN:
            if best is None:
                remark = (
                    "the solver's point diverges as the tolerance decreases: the program may be weakly "
                    "infeasible, or may not attain its optimum"
                )
                return replace(answer, message="; ".join(filter(None, [answer.message, remark])))
        return answer

    def findings(self, ending: Ending, feasible: Quality | None) -> Findings:
        ray = ending.duals if ending.ended is Ended.INFEASIBLE else None
        direction = ending.point if ending.ended is Ended.UNBOUNDED else None
        if ray is None and (self.problem.column_lower == self.problem.column_upper).all():
            # Without free columns, the multipliers that separate constants and cones are a proof.
            rows = self.problem.cone_rows(self.problem.column_lower)
            ray = np.concatenate([np.zeros(self.problem.row_count), -rows])

        def solve(program: ConicProgram) -> Ending:
            request = replace(self.request, warm_start=None, time_limit=self.clock.left())
            return replace(self, problem=program, request=request).tried(Core.of(program), request)

        proof = examined(
            self.problem,
            solve,
            ray=ray,
            direction=direction,
            point=None if feasible is None else feasible.point,
        )
        self.clock.lap("proof")
        return proof


def _measured(program: ConicProgram, point: Vector) -> tuple[float, float]:
    """Return the largest term of the rows and the largest violation, relative to the largest constant.

    Verification accepts violations in proportion to the terms; this measure is stricter.
    """
    bounds = (program.row_lower, program.row_upper, program.column_lower, program.column_upper)
    constants = np.abs(np.concatenate([*bounds, program.cone_offset]))
    unit = max(1.0, float(constants[np.isfinite(constants)].max(initial=0.0)))
    terms = [
        abs(matrix * point[None, :]).max()
        for matrix in (program.matrix, program.cone_matrix)
        if matrix.nnz
    ]
    off = max((check.worst for check in program.verify(point).checks), default=0.0)
    return float(max(terms, default=0.0)) / unit, off / unit
