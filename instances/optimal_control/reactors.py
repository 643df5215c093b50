"""Chemistry and biology: the yield of reactors, and the treatment of a tumor."""

from __future__ import annotations

from ...models.optimal_control.model import OptimalControlProblem
from .benchmark import benchmark

__all__ = ["batch_reactor", "tubular_reactor", "tumor"]


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
