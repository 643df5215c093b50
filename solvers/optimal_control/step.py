"""Result of one solve of a prepared optimal control problem."""

from __future__ import annotations

from dataclasses import dataclass

from ...errors import NoDerivative
from ...models.verification import TOLERANCE, Verification
from .parametric import Point
from .sensitivity import Sensitivity, differentiate

__all__ = ["Step"]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Step(Point):
    """Result of one solve of a prepared solver; expensive attributes are computed at first use.

    Attributes
    ----------
    ok : bool
        Whether the solver reports a local optimum, the rows hold there, and no direction of negative
        curvature was found. Without the structure of the intervals, steps from an earlier step are not
        tested for such directions.
    status : str
        Status reported by the solver.
    objective : float
        Objective of the program at the point.
    seconds : float
        Wall-clock time of the step.
    iterations : int
        Iterations of the solver, including those of a second attempt.
    violation : float
        Largest violation of a scaled row of the program.
    warm : bool
        Whether the point was reached from an earlier step or a plan. A failed warm start is repeated
        from the guess.
    method : str
        ``"structured"``, or the name of the backend that returned the point.
    """

    ok: bool
    status: str
    objective: float
    seconds: float
    iterations: int
    violation: float
    warm: bool
    method: str = ""

    def __repr__(self) -> str:
        return (
            f"<Step {'ok' if self.ok else 'failed'}: {self.status}, objective {self.objective:.10g}, "
            f"{self.iterations} iterations, {self.seconds:.3g} s>"
        )

    def sensitivity(self, name: str) -> Sensitivity:
        """Return the derivatives of the solution with respect to the data `name`.

        Parameters
        ----------
        name : str
            Name of the data.

        Returns
        -------
        Sensitivity
            The derivatives.

        Raises
        ------
        InvalidData
            The problem has no such data.
        NoDerivative
            The step failed, or its solution is not a differentiable function of the data: an active
            constraint has no multiplier, active constraints are dependent, or the curvature vanishes.
        """
        if not self.ok:
            raise NoDerivative(f"the step failed: {self.status}")
        return differentiate(self, name)

    def verification(self, tolerance: float = TOLERANCE) -> Verification:
        """Return the independent verification of the plan, see :func:`crosstrack.verify`.

        Parameters
        ----------
        tolerance : float
            Largest accepted violation, relative to the scale of each check.
        """
        return self.problem.verify(self.plan, tolerance=tolerance)
