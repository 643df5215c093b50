"""Published problems with constraints.

J. J. Liang and others, "Problem definitions and evaluation criteria for the CEC 2006 special session on
constrained real-parameter optimization": functions of many points, and optima.
"""

import numpy as np


def g01(x):
    a = x.T
    rows = [
        5 * a[:4].sum(0) - 5 * (a[:4] ** 2).sum(0) - a[4:].sum(0),
        2 * a[0] + 2 * a[1] + a[9] + a[10] - 10, 2 * a[0] + 2 * a[2] + a[9] + a[11] - 10,
        2 * a[1] + 2 * a[2] + a[10] + a[11] - 10, -8 * a[0] + a[9], -8 * a[1] + a[10], -8 * a[2] + a[11],
        -2 * a[3] - a[4] + a[9], -2 * a[5] - a[6] + a[10], -2 * a[7] - a[8] + a[11],
    ]  # fmt: skip
    return np.column_stack(rows)


def g04(x):
    a, b, c, d, e = x.T
    u = 85.334407 + 0.0056858 * b * e + 0.0006262 * a * d - 0.0022053 * c * e
    v = 80.51249 + 0.0071317 * b * e + 0.0029955 * a * b + 0.0021813 * c**2
    w = 9.300961 + 0.0047026 * c * e + 0.0012547 * a * c + 0.0019085 * c * d
    f = 5.3578547 * c**2 + 0.8356891 * a * e + 37.293239 * a - 40792.141
    return np.column_stack([f, u - 92, -u, v - 110, 90 - v, w - 25, 20 - w])


def g06(x):
    a, b = x.T
    f = (a - 10) ** 3 + (b - 20) ** 3
    return np.column_stack(
        [f, 100 - (a - 5) ** 2 - (b - 5) ** 2, (a - 6) ** 2 + (b - 5) ** 2 - 82.81]
    )


def g08(x):
    a, b = x.T
    f = -(np.sin(2 * np.pi * a) ** 3) * np.sin(2 * np.pi * b) / (a**3 * (a + b))
    return np.column_stack([f, a**2 - b + 1, 1 - a + (b - 4) ** 2])


#: Function, bounds, number of inequalities and published minimum.
PUBLISHED = {
    "g01": (g01, [(0, 1)] * 9 + [(0, 100)] * 3 + [(0, 1)], 9, -15.0),
    "g04": (g04, [(78, 102), (33, 45)] + [(27, 45)] * 3, 6, -30665.53867178),
    "g06": (g06, [(13, 100), (0, 100)], 2, -6961.81387558),
    "g08": (g08, [(1e-9, 10), (1e-9, 10)], 2, -0.0958250414),
}
