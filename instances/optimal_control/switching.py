"""Problems with discontinuous controls: bang-bang, bang-off-bang and bang-singular-bang."""

from __future__ import annotations

from ...models.optimal_control.model import OptimalControlProblem
from .benchmark import benchmark

__all__ = [
    "catalyst_mixing",
    "double_integrator",
    "double_integrator_fuel",
    "lotka_volterra_fishing",
    "moon_lander",
]


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
