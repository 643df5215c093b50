"""Oscillators: van der Pol, Rayleigh, the harmonic oscillator, and a totally singular problem."""

from __future__ import annotations

import math

from ...models.optimal_control.model import OptimalControlProblem
from .benchmark import benchmark

__all__ = ["aly_chan", "harmonic_oscillator", "rayleigh", "van_der_pol"]


@benchmark
def van_der_pol(ocp: OptimalControlProblem, *, state_limit: float | None = None) -> None:
    """Return van der Pol's oscillator, damped over 5 time units with the smallest ∫ (x1² + x2² + u²) dt.

    The control satisfies -0.3 <= u <= 1. A second form has x1 >= -0.4 as well, and its optimum
    follows the bound for a while (Vassiliadis, Sargent and Pantelides, "Solution of a class of
    multistage dynamic optimization problems. 2", Industrial and Engineering Chemistry Research 33,
    1994).

    Parameters
    ----------
    state_limit : float, optional
        Largest -x1.
    """
    phase = ocp.phase(time=(0, 5))
    x1 = phase.state("x1", initial=0, lower=None if state_limit is None else -state_limit)
    x2 = phase.state("x2", initial=1)
    u = phase.control("u", lower=-0.3, upper=1)
    phase.dynamics({x1: (1 - x2**2) * x1 - x2 + u, x2: x1})
    phase.guess(x2=[1, 0])
    ocp.minimise(phase.integral(x1**2 + x2**2 + u**2))


@benchmark
def rayleigh(ocp: OptimalControlProblem, *, horizon: float = 4.5, limited: bool = True) -> None:
    """Return Rayleigh's model of a tunnel-diode oscillator, damped from (-5, -5).

    The smallest ∫ (x1² + u²) dt, either in 4.5 time units to rest with ``|u|`` <= 1, or in 2.5 without
    this limit and with a free end (Maurer and Augustin, "Sensitivity analysis and real-time control of
    parametric optimal control problems using boundary value methods", in "Online Optimization of
    Large Scale Systems", Springer, 2001).

    Parameters
    ----------
    horizon : float
        tf.
    limited : bool
        Whether ``|u|`` is limited and the end is at rest.
    """
    phase = ocp.phase(time=(0, horizon))
    end, limit = (0, 1) if limited else (None, None)
    x1 = phase.state("x1", initial=-5, final=end, scale=5)
    x2 = phase.state("x2", initial=-5, final=end, scale=5)
    u = phase.control("u", lower=None if limit is None else -limit, upper=limit)
    phase.dynamics({x1: x2, x2: -x1 + x2 * (1.4 - 0.14 * x2**2) + 4 * u})
    phase.guess(x1=[-5, 0], x2=[-5, 0], u=0)
    ocp.minimise(phase.integral(x1**2 + u**2))


@benchmark
def harmonic_oscillator(ocp: OptimalControlProblem) -> None:
    """Return the fastest stop of a frictionless oscillator from (3, 0), with a force of at most 1.

    The force is -1, +1 and -1. The trajectory consists of circular arcs in the phase plane. The
    middle one is a half circle and takes π (Pontryagin et al., "The Mathematical Theory of Optimal
    Processes", 1962, section 5, example 2).
    """
    phase = ocp.phase(time=(0, (1, 12)))
    x = phase.state("x", initial=3, final=0, lower=-5, upper=5)
    v = phase.state("v", initial=0, final=0, lower=-5, upper=5)
    force = phase.control("force", lower=-1, upper=1)
    phase.dynamics({x: v, v: -x + force})
    # Motion without force.
    phase.guess(time=[0, 5], x=lambda t: 3 * math.cos(t), v=lambda t: -3 * math.sin(t), force=0)
    ocp.minimise(phase.end)


@benchmark
def aly_chan(ocp: OptimalControlProblem) -> None:
    """Return a double integrator with a totally singular optimum: u = -sin t, with cost 0.

    The control enters the dynamics linearly and the cost not at all, so the Hamiltonian does not
    determine it (Aly and Chan, "Application of a modified quasilinearization technique to totally
    singular optimal control problems", International Journal of Control 17, 1973).
    """
    phase = ocp.phase(time=(0, math.pi / 2))
    x = phase.state("x", initial=0, lower=-5, upper=5, scale=1)
    v = phase.state("v", initial=1, lower=-5, upper=5, scale=1)
    u = phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: v, v: u})
    phase.guess(x=[0, 1], v=[1, 0], u=0)
    ocp.minimise(phase.integral((v**2 - x**2) / 2))
