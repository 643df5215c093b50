"""Parameter estimation problems of the collection COPS 3, in one phase each.

E. D. Dolan, J. J. Moré and T. S. Munson, "Benchmarking optimization software with COPS 3.0", Argonne
National Laboratory, ANL/MCS-TM-273 (2004), problems 8 (isomerization of alpha-pinene) and 10 (catalytic
cracking of gas oil).
"""

import casadi
import numpy as np

from crosstrack.models import OptimalControlProblem

PINENE_TIMES = [1230, 3060, 4920, 7800, 10680, 15030, 22620, 36420]
PINENE = [
    [88.35, 7.3, 2.3, 0.4, 1.75], [76.4, 15.6, 4.5, 0.7, 2.8], [65.1, 23.1, 5.3, 1.1, 5.8],
    [50.4, 32.9, 6.0, 1.5, 9.3], [37.5, 42.7, 6.0, 1.9, 12.0], [25.9, 49.1, 5.9, 2.2, 17.0],
    [14.0, 57.4, 5.1, 2.6, 21.0], [4.5, 63.1, 3.8, 2.9, 25.7],
]  # fmt: skip
OIL_TIMES = [
    0, 0.025, 0.05, 0.075, 0.1, 0.125, 0.15, 0.175, 0.2, 0.225, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5,
    0.55, 0.65, 0.75, 0.85, 0.95,
]  # fmt: skip
OIL = np.transpose([
    [1, 0.8105, 0.6208, 0.5258, 0.4345, 0.3903, 0.3342, 0.3034, 0.2735, 0.2405, 0.2283, 0.2071,
     0.1669, 0.153, 0.1339, 0.1265, 0.12, 0.099, 0.087, 0.077, 0.069],
    [0, 0.2, 0.2886, 0.301, 0.3215, 0.3123, 0.2716, 0.2551, 0.2258, 0.1959, 0.1789, 0.1457, 0.1198,
     0.0909, 0.0719, 0.0561, 0.046, 0.028, 0.019, 0.014, 0.01],
])  # fmt: skip


def alpha_pinene():
    ocp = OptimalControlProblem("alpha-pinene")
    k = ocp.parameter("k", 5, lower=0, guess=5e-5)
    phase = ocp.phase(time=(0, 36420))
    y = phase.state("y", 5, initial=[100, 0, 0, 0, 0])
    one, two, three = k[0] * y[0], k[1] * y[0], k[2] * y[2]
    four, five = k[3] * y[2], k[4] * y[4]
    phase.dynamics({y: [-one - two, one, two - three - four + five, three, four - five]})
    measured = zip(PINENE_TIMES, PINENE, strict=True)
    ocp.minimise(sum(casadi.sumsqr(phase.at(t, y) - z) for t, z in measured))
    return ocp


def gas_oil():
    ocp = OptimalControlProblem("gas oil")
    k = ocp.parameter("k", 3, lower=0, guess=1)
    phase = ocp.phase(time=(0, 0.95))
    y = phase.state("y", 2, initial=[1, 0])
    phase.dynamics({y: [-(k[0] + k[2]) * y[0] ** 2, k[0] * y[0] ** 2 - k[1] * y[1]]})
    measured = zip(OIL_TIMES, OIL, strict=True)
    ocp.minimise(sum(casadi.sumsqr(phase.at(t, y) - z) for t, z in measured))
    return ocp
