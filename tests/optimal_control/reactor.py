"""Kinetic batch reactor in three phases: 6 states, 4 algebraic variables and the temperature.

J. T. Betts, "Practical Methods for Optimal Control and Estimation Using Nonlinear Programming", SIAM (2010),
example 6.15. The published optimum is 3.16466910 at an end time of 1.7468208 h.
"""

import casadi

from crosstrack.models import OptimalControlProblem

K1, K2, K3 = 2.575e-16, 4.876e-14, 1.7884e-16  # gmol/kg
STAGES = (
    # Times and their guesses in hours, guesses of temperature (K) and pH, and limit of y4.
    ((0, 0.01), (0, 0.01), (393, 372), (9.56, 11.2), True),
    ((0.01, (0.3, 0.8)), (0.01, 0.425), (372, 393), (11.2, 10.9), True),
    (((0.3, 0.8), (1.2, 3.2)), (0.425, 1.7), (393, 393), (10.9, 10.7), False),
)


def _stage(ocp, charge, number):
    time, span, temperatures, acidity, limited = STAGES[number]
    phase = ocp.phase(f"stage {number + 1}", time=time, unit="h")
    begin = (1.5776, 8.32, 0, 0, 0, None) if number == 0 else (None,) * 6
    end = (None, None, None, (1, 2) if number == 2 else None, None, None)
    limits = zip(begin, end, (0, 5, 0, 0, 0, 0), (2, 10, 2, 2, 2, 0.1), strict=True)
    y = [
        phase.state(f"y{k}", initial=a, final=b, lower=low, upper=high, unit="gmol/kg")
        for k, (a, b, low, high) in enumerate(limits, 1)
    ]
    acid = phase.algebraic("pH", lower=0, upper=15)
    y8 = phase.algebraic("y8", lower=0, upper=0.02, guess=0.01, unit="gmol/kg")
    y9 = phase.algebraic("y9", lower=0, upper=5e-5, guess=1e-5, unit="gmol/kg")
    y10 = phase.algebraic("y10", lower=0, upper=5e-5, guess=1e-5, unit="gmol/kg")
    heat = phase.control("T", lower=293.15, upper=393.15, unit="K")
    k1 = 1.3708e12 * casadi.exp(-9.2984e3 / heat)
    back1 = 1.6215e20 * casadi.exp(-1.3108e4 / heat)
    k2 = 5.2282e12 * casadi.exp(-9.5999e3 / heat)
    protons = casadi.exp(-casadi.log(10) * acid)
    first = k1 * y[1] * y[5] - back1 * y10
    second = k2 * y[1] * y8
    third = k1 * y[3] * y[5] - back1 / 2 * y9
    rates = (-second, -first - second, second + third, -third, first, -first - third)
    phase.dynamics(dict(zip(y, rates, strict=True)))
    phase.algebraic_equation(
        charge - y[5] + protons - y8 - y9 - y10 == 0, name="charge balance", scale=1e-2
    )
    for name, z, k, of, scale in (
        ("second", y8, K2, y[0], 1e-2),
        ("third", y9, K3, y[2], 1e-5),
        ("first", y10, K1, y[4], 1e-5),
    ):
        phase.algebraic_equation(
            z - k * of / (k + protons) == 0, name=f"{name} equilibrium", scale=scale
        )
    if limited:
        phase.path(y[3] - 2 * phase.time**2 <= 0, name="transient")
    phase.guess(time=span, pH=acidity, **({} if number else {"y6": 0.0142}))
    phase.simulate(time=span, T=temperatures)
    return phase, y


def reactor():
    ocp = OptimalControlProblem("kinetic batch reactor")
    charge = ocp.parameter("p", lower=0, upper=0.0262, guess=0.0142, unit="gmol/kg")
    (first, y), (second, _), (third, _) = (_stage(ocp, charge, k) for k in range(3))
    ocp.subject_to(first.initial(y[5]) == charge, name="initial charge")
    ocp.subject_to(4 * second.end == third.end, name="quarter")
    ocp.link(first, second)
    ocp.link(second, third)
    ocp.minimise(third.end + 100 * charge, unit="h")
    return ocp
