"""What every backend for programs with cones shares: claims are recomputed as quadratic ones are."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...models.model import Model
from ...models.programs.conic import ConicProgram
from ...models.programs.linear import QuadraticProgram
from ...models.verification import ROUNDING
from ..attempts import Ended, Ending
from ..backend import Answer, Request, Termination
from ..qp.base import QuadraticBackend, Run, answered
from ..qp.forms import Core
from ..qp.proofs import Findings
from ..qp.quality import Quality, measured
from .proofs import examined

__all__ = ["ConicRun", "ConvexBackend"]

Vector = NDArray[np.float64]

#: How much larger than the constants of a program the terms of its rows may be before an answer is
#: asked for again: what runs off to infinity as the tolerance shrinks is no solution. With ``x y >= 1``
#: and ``x = 0``, terms of 1 / e leave e in one of the two; from 1e8 on rounding hides it. The first
#: figure is for points that hold but for rounding, the second for those that need the tolerance; beyond
#: the last no point counts.
LARGE, LARGE_AND_OFF, TOO_LARGE = 1e4, 1e2, 1e7
#: How much tighter it is asked for, and must hold.
TIGHTER = 1e-2


class ConvexBackend(QuadraticBackend):
    """Base of the backends that take quadratic and conic programs alike."""

    accepts: ClassVar[type[Model[Any]] | tuple[type[Model[Any]], ...]] = (
        QuadraticProgram,
        ConicProgram,
    )

    def run(self, problem: Any, request: Request) -> Answer:
        """Solve `problem`, of either kind, as `request` asks."""
        if isinstance(problem, ConicProgram):
            if problem.cones:
                return answered(self, problem, request, self.attempt, ConicRun)
            problem = problem.quadratic
        return super().run(problem, request)


@dataclass(frozen=True, eq=False)
class ConicRun(Run):
    """One run on a program with cones."""

    problem: Any
    attempt: Any

    def answer(self) -> Answer:
        if self.problem.size:
            return super().answer()
        # Constants alone: the rows and cones hold, or multipliers prove that they do not.
        ending = self.tried(self.core(), self.request)
        best = self.judged(ending)
        if best is not None and self.accepts(best):
            return self.optimal(ending, best)
        return self.unsolved(ending, best)

    def judged(self, ending: Ending) -> Quality | None:
        """Return the quality of the point; None without one, or where it runs off to infinity.

        A point with terms of unusual size must hold once more, and much better.
        """
        found = self.quality(ending)
        if found is None or self.limit_reached():
            return found
        usual = LARGE if found.violation <= ROUNDING else LARGE_AND_OFF
        if _measured(self.problem, found.point)[0] <= usual:
            return found
        tighter = replace(self.request, tolerance=self.request.tolerance * TIGHTER)
        again = self.quality(self.tried(self.core(), tighter))
        if again is None:
            return None
        share, off = _measured(self.problem, again.point)
        return again if share <= TOO_LARGE and off <= tighter.tolerance else None

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
                words = (
                    "the solver's point runs off to infinity as the tolerance shrinks: the program "
                    "may have none (weakly infeasible), or no best one"
                )
                return replace(answer, message="; ".join(filter(None, [answer.message, words])))
        return answer

    def findings(self, ending: Ending, feasible: Quality | None) -> Findings:
        ray = ending.duals if ending.ended is Ended.INFEASIBLE else None
        direction = ending.point if ending.ended is Ended.UNBOUNDED else None
        if ray is None and (self.problem.column_lower == self.problem.column_upper).all():
            # All is constant: what separates the constants from the cones is a proof.
            rows = self.problem.cone_rows(self.problem.column_lower)
            ray = np.concatenate([np.zeros(self.problem.row_count), -rows])

        def solve(program: ConicProgram) -> Ending:
            asked = replace(self.request, warm_start=None, time_limit=self.clock.left())
            return replace(self, problem=program, request=asked).tried(Core.of(program), asked)

        found = examined(
            self.problem,
            solve,
            ray=ray,
            direction=direction,
            point=None if feasible is None else feasible.point,
        )
        self.clock.lap("proof")
        return found


def _measured(program: ConicProgram, point: Vector) -> tuple[float, float]:
    """Return the largest term of the rows, and the largest violation, over the largest constant.

    Verification allows a violation in proportion to the terms; this is the stricter measure.
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
