"""Chemistry and biology: reactors whose yield is sought, and a tumor that starves."""

from __future__ import annotations

from ...models.optimal_control.model import OptimalControlProblem
from .benchmark import benchmark

__all__ = ["batch_reactor", "tubular_reactor", "tumor"]


@benchmark
def batch_reactor(ocp: OptimalControlProblem) -> None:
    """Return the temperature over an hour that yields most of the middle product of A → B → C.

    A decays by second order, B by first, both by Arrhenius' law (Logsdon and Biegler, "Accurate
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
    """Return the rate along a reactor that yields most of B, where A → B is u and A → C is u² / 2.

    (W. H. Ray: "Advanced Process Control", McGraw-Hill, 1981; Logsdon and Biegler, 1989: 0.57353.)
    """
    phase = ocp.phase(time=(0, 1), unit="")
    raw = phase.state("raw", initial=1)
    wanted = phase.state("wanted", initial=0)
    rate = phase.control("rate", lower=0, upper=5)
    phase.dynamics({raw: -(rate + rate**2 / 2) * raw, wanted: rate * raw})
    ocp.minimise(-phase.final(wanted))


@benchmark
def tumor(ocp: OptimalControlProblem) -> None:
    """Return the dosage of an agent that starves a tumor of its vessels, of which there is 15.

    The smallest volume is sought that the tumor takes on at a time that is free: full dose, a
    singular arc, no dose (Ledzewicz and Schättler, "Analysis of optimal controls for a mathematical
    model of tumour anti-angiogenesis", Optimal Control Applications and Methods 29, 2008; an example
    of GPOPS-II: 7571.67158).
    """
    import casadi

    growth, birth, death, effect, loss = 0.084, 5.85, 0.00873, 0.15, 0.02
    most = ((birth - loss) / death) ** 1.5
    phase = ocp.phase(time=(0, (0.1, 5)), unit="d")
    volume = phase.state("volume", initial=most / 2, lower=0.01, upper=most, unit="mm³")
    vessels = phase.state("vessels", initial=most / 4, lower=0.01, upper=most, unit="mm³")
    given = phase.state("given", initial=0, lower=0, upper=15)
    dose = phase.control("dose", lower=0, upper=75)
    phase.dynamics(
        {
            volume: -growth * volume * casadi.log(volume / vessels),
            vessels: vessels * (birth - loss - death * volume ** (2 / 3) - effect * dose),
            given: dose,
        }
    )
    ocp.minimise(phase.final(volume), unit="mm³")
