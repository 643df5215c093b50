"""Estimation of constants: problems with a parameter that is optimised with the motion."""

from __future__ import annotations

from ...models.optimal_control.model import OptimalControlProblem
from .benchmark import benchmark

__all__ = ["decay_fit"]


@benchmark
def decay_fit(ocp: OptimalControlProblem) -> None:
    """Return the fit of the rate p of ẋ = -p x to 1 / (1 + t) over 4 s.

    The problem has a parameter and no control. No p fits exactly, so the smallest
    ∫ (x - 1 / (1 + t))² dt is positive. It is the minimum of a function of one variable.
    """
    rate = ocp.parameter("rate", lower=0, upper=5, guess=1, unit="1/s")
    phase = ocp.phase(time=(0, 4))
    x = phase.state("x", initial=1, lower=0, upper=1)
    phase.dynamics({x: -rate * x})
    measured = 1 / (1 + phase.time)
    phase.guess(x=lambda t: 1 / (1 + t))
    ocp.minimise(phase.integral((x - measured) ** 2), unit="s")
