"""Oscillators, reactors, and problems with bang-bang or singular controls."""

from __future__ import annotations

import math

from ...models.optimal_control.model import OptimalControlProblem
from .benchmark import benchmark


@benchmark
def double_integrator(ocp: OptimalControlProblem) -> None:
    """Return the fastest rest-to-rest move of a unit mass by 1, with a force of at most 1.

    The optimum accelerates for 1 and brakes for 1, and takes 2.
    """
    phase = ocp.phase(time=(0, (0.1, 10)))
    x = phase.state("x", initial=0, final=1, lower=-2, upper=2)
    v = phase.state("v", initial=0, final=0, lower=-2, upper=2)
    u = phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: v, v: u})
    phase.guess(time=[0, 3])
    ocp.minimise(phase.end)


@benchmark
def double_integrator_fuel(ocp: OptimalControlProblem, *, duration: float = 2.5) -> None:
    """Return the rest-to-rest move of a unit mass by 1 in a given time with the smallest ∫ ``|u|`` dt.

    Two non-negative jets represent ``|u|``. The optimum accelerates, coasts and brakes. For a
    duration T >= 2 the coasting speed is v = (T - √(T² - 4)) / 2, and the fuel is 2 v: 1 for T = 2.5.

    Parameters
    ----------
    duration : float
        T.
    """
    phase = ocp.phase(time=(0, duration))
    x = phase.state("x", initial=0, final=1, lower=-2, upper=2)
    v = phase.state("v", initial=0, final=0, lower=-2, upper=2)
    forward = phase.control("forward", lower=0, upper=1)
    backward = phase.control("backward", lower=0, upper=1)
    phase.dynamics({x: v, v: forward - backward})
    ocp.minimise(phase.integral(forward + backward))


@benchmark
def lotka_volterra_fishing(ocp: OptimalControlProblem) -> None:
    """Return the fishing problem: prey and predators at 1 with the smallest ∫ (x - 1)² + (y - 1)² dt.

    Fishing w is either on or off. Solvers compute the relaxed plan with 0 <= w <= 1.
    """
    phase = ocp.phase(time=(0, 12))
    x = phase.state("x", initial=0.5, lower=0, upper=20, scale=1)
    y = phase.state("y", initial=0.7, lower=0, upper=20, scale=1)
    w = phase.control("w", lower=0, upper=1, integer=True)
    phase.dynamics({x: x - x * y - 0.4 * x * w, y: -y + x * y - 0.2 * y * w})
    ocp.minimise(phase.integral((x - 1) ** 2 + (y - 1) ** 2))


@benchmark
def moon_lander(ocp: OptimalControlProblem) -> None:
    """Return the soft landing on the Moon with the smallest ∫ u dt: free fall, then full thrust.

    From height 10 and rate -2, under gravity 1.5 with thrust of at most 3, the two parabolas meet
    at h = 17/3 and v = -√17. Braking from there takes √17 / 1.5 and costs 2 √17 (Meditch, "On the
    problem of optimal thrust programming for a lunar soft landing", IEEE Transactions on Automatic
    Control, 1964).
    """
    phase = ocp.phase(time=(0, (1, 20)))
    height = phase.state("height", initial=10, final=0, lower=0, upper=20)
    rate = phase.state("rate", initial=-2, final=0, lower=-20, upper=20)
    thrust = phase.control("thrust", lower=0, upper=3)
    phase.dynamics({height: rate, rate: thrust - 1.5})
    phase.guess(time=[0, 5], thrust=1.5)
    ocp.minimise(phase.integral(thrust))


@benchmark
def catalyst_mixing(ocp: OptimalControlProblem) -> None:
    """Return the mixing of two catalysts along a reactor for the largest yield of the end product.

    S1 ⇄ S2 under the first catalyst, and S2 → S3 under the second. The optimum is the pure first
    catalyst, a constant mixture on a singular arc, and the pure second one (Gunn and Thomas, "Mass
    transport and chemical reaction in multifunctional catalyst systems", Chemical Engineering
    Science 20, 1965; problem 14 of COPS 3.0, 2004).
    """
    phase = ocp.phase(time=(0, 1), unit="")
    first = phase.state("first", initial=1, lower=0, upper=1)
    second = phase.state("second", initial=0, lower=0, upper=1)
    mixture = phase.control("mixture", lower=0, upper=1)
    forth = mixture * (10 * second - first)
    phase.dynamics({first: forth, second: -forth - (1 - mixture) * second})
    phase.guess(first=[1, 0.9], second=[0, 0.1], mixture=[1, 0])
    # The end product is the remainder.
    ocp.minimise(phase.final(first) + phase.final(second) - 1)


@benchmark
def singular_regulator(ocp: OptimalControlProblem) -> None:
    """Return the regulation of a double integrator from (0, 1): smallest ½ ∫ (x² + v²) dt over 5 s.

    The optimum is full braking, then a singular arc with x + v = 0 (Jacobson, Gershwin and Lele,
    "Computation of optimal singular controls", IEEE Transactions on Automatic Control 15, 1970).
    """
    phase = ocp.phase(time=(0, 5))
    x = phase.state("x", initial=0)
    v = phase.state("v", initial=1)
    u = phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.integral((x**2 + v**2) / 2))


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


@benchmark
def batch_reactor(ocp: OptimalControlProblem) -> None:
    """Return the temperature over an hour for the largest yield of the middle product of A → B → C.

    A decays by second order and B by first, both by Arrhenius' law (Logsdon and Biegler, "Accurate
    solution of differential-algebraic optimization problems", Industrial and Engineering Chemistry
    Research 28, 1989: 0.610775; Rajesh et al., 2001: 0.6107775).
    """
    import casadi

    phase = ocp.phase(time=(0, 1), unit="h")
    raw = phase.state("raw", initial=1)
    middle = phase.state("middle", initial=0)
    temperature = phase.control("temperature", lower=298, upper=398, unit="K")
    first = 4000 * casadi.exp(-2500 / temperature) * raw**2
    second = 620_000 * casadi.exp(-5000 / temperature) * middle
    phase.dynamics({raw: -first, middle: first - second})
    ocp.minimise(-phase.final(middle))


@benchmark
def tubular_reactor(ocp: OptimalControlProblem) -> None:
    """Return the rate along a reactor for the largest yield of B; A → B has rate u, A → C has u² / 2.

    (W. H. Ray: "Advanced Process Control", McGraw-Hill, 1981; Logsdon and Biegler, 1989: 0.57353.)
    """
    phase = ocp.phase(time=(0, 1), unit="")
    raw = phase.state("raw", initial=1)
    product = phase.state("wanted", initial=0)
    rate = phase.control("rate", lower=0, upper=5)
    phase.dynamics({raw: -(rate + rate**2 / 2) * raw, product: rate * raw})
    ocp.minimise(-phase.final(product))


@benchmark
def tumor(ocp: OptimalControlProblem) -> None:
    """Return the dosage of an anti-angiogenic agent, 15 in total, for the smallest tumor volume.

    The volume is minimised at a free time. The optimum is full dose, a singular arc, and no dose
    (Ledzewicz and Schättler, "Analysis of optimal controls for a mathematical model of tumour
    anti-angiogenesis", Optimal Control Applications and Methods 29, 2008; an example of GPOPS-II:
    7571.67158).
    """
    import casadi

    growth, birth, death, effect, loss = 0.084, 5.85, 0.00873, 0.15, 0.02
    largest = ((birth - loss) / death) ** 1.5
    phase = ocp.phase(time=(0, (0.1, 5)), unit="d")
    volume = phase.state("volume", initial=largest / 2, lower=0.01, upper=largest, unit="mm³")
    vessels = phase.state("vessels", initial=largest / 4, lower=0.01, upper=largest, unit="mm³")
    total_dose = phase.state("given", initial=0, lower=0, upper=15)
    dose = phase.control("dose", lower=0, upper=75)
    phase.dynamics(
        {
            volume: -growth * volume * casadi.log(volume / vessels),
            vessels: vessels * (birth - loss - death * volume ** (2 / 3) - effect * dose),
            total_dose: dose,
        }
    )
    ocp.minimise(phase.final(volume), unit="mm³")
