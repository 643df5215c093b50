"""Reactors, fermenters, tanks and heating."""

from __future__ import annotations

import math

import casadi
import numpy as np

from .table import FINE, PUBLISHED as _published

_BASELINE = "PSOPT manual, tools/regression_baselines_all.json"


@_published(-32.686, "Park, Ramirez 1988; Luus 1995; PROPT; AMIGO2, PR_Bioreactor: 32.68", 2e-3)
def park_ramirez(ocp):
    phase = ocp.phase(time=(0, 15))
    out = phase.state("out", initial=0, lower=0)
    total = phase.state("total", initial=0, lower=0)
    cells = phase.state("cells", initial=1, lower=0)
    food = phase.state("food", initial=5, lower=0)
    v = phase.state("v", initial=1, lower=0)
    u = phase.control("u", lower=0, upper=2)
    grow = 21.87 * food / ((food + 0.4) * (food + 62.5))
    make = food * casadi.exp(-5 * food) / (0.1 + food)
    pass_out = 4.75 * grow / (0.12 + grow)
    phase.dynamics(
        {
            out: pass_out * (total - out) - u / v * out,
            total: make * cells - u / v * total,
            cells: (grow - u / v) * cells,
            food: -7.3 * grow * cells + u / v * (20 - food),
            v: u,
        }
    )
    ocp.minimise(-phase.final(out) * phase.final(v))


@_published(
    -20839, "Chen, Hwang 1990; Jayaraman et al. 2001: ethanol in 61.2 h, 20839 to 20842", 1e-3
)
def ethanol(ocp):
    phase = ocp.phase(time=(0, 61.2))
    x = phase.state("x", initial=1, lower=0)
    s = phase.state("s", initial=150, lower=0)
    p = phase.state("p", initial=0, lower=0)
    v = phase.state("v", initial=10, lower=0, upper=200)
    u = phase.control("u", lower=0, upper=12)
    grow = 0.408 / (1 + p / 16) * s / (0.22 + s)
    make = 1 / (1 + p / 71.5) * s / (0.44 + s)
    phase.dynamics(
        {
            x: grow * x - u * x / v,
            s: -10 * grow * x + u * (150 - s) / v,
            p: make * x - u * p / v,
            v: u,
        }
    )
    ocp.minimise(-phase.final(p) * phase.final(v))


@_published(
    262.4165,
    f"Maurer, Wiegand 1992; Luus 2000, 12.4.3; PROPT: warfarin at most 0.026; {FINE}",
    1e-5,
    name="drug_displacement_limited",
    most=0.026,
)
@_published(
    221.2434,
    f"Maurer, Wiegand 1992; Luus 2000, 12.4.3; PROPT, printed 221.3334 for 50 nodes; {FINE}",
    1e-5,
)
def drug_displacement(ocp, most=math.inf):
    phase = ocp.phase(time=(0, (1, 1000)))
    x = phase.state("x", initial=0.02, final=0.02, lower=0, upper=most)
    y = phase.state("y", initial=0, final=2, lower=0)
    u = phase.control("u", lower=0, upper=8)
    d2 = (1 + 0.2 * (x + y)) ** 2
    c1, c2 = d2 + 232 + 46.4 * y, d2 + 232 + 46.4 * x
    c = d2 / (c1 * c2 - 2152.96 * x * y)
    phase.dynamics(
        {
            x: c * (c2 * (0.02 - x) + 46.4 * x * (u - 2 * y)),
            y: c * (c1 * (u - 2 * y) + 46.4 * (0.02 - x)),
        }
    )
    ocp.minimise(phase.end)


@_published(4.731306, f"Abbasi et al.; Sager, mintoc.de: double tank, relaxed; {FINE}", 1e-6)
def double_tank(ocp):
    phase = ocp.phase(time=(0, 10))
    x = phase.state("x", initial=2, lower=1e-3)
    y = phase.state("y", initial=2, lower=1e-3)
    u = phase.control("u", lower=0, upper=1)
    phase.dynamics({x: 1 + u - casadi.sqrt(x), y: casadi.sqrt(x) - casadi.sqrt(y)})
    ocp.minimise(phase.integral(2 * (y - 3) ** 2))


@_published(
    4.370355e-5,
    f"Betts 2001, section 4.7: heating of a probe; {_BASELINE}, printed 4.372837e-5; {FINE}; the two algebraic"
    " temperatures beyond the ends are eliminated",
    1e-5,
)
def heat_diffusion(ocp):
    n, pi, rho = 10, math.pi, -1.0
    a1, a2, a3, a4 = 4.0, 1.0, 4.0, -1.0
    step = 1 / (n - 1)
    places = np.arange(n) * step
    phase = ocp.phase(time=(0, 0.5))
    y = [
        phase.state(f"y{k}", initial=2 + math.cos(pi * place), lower=0, upper=3)
        for k, place in enumerate(places)
    ]
    u = phase.control("u", lower=0, upper=0.1)
    before = y[1] - 2 * step * (y[0] - u) / (a3 + a4 * y[0])
    line = [before, *y, y[-2]]
    decay = casadi.exp(rho * phase.time)
    rates = {}
    for k, place in enumerate(places):
        c = math.cos(pi * place)
        source = (rho * (a1 + 2 * a2) + pi**2 * (a3 + 2 * a4)) * decay * c
        source += -a4 * pi**2 * decay**2 + (2 * a4 * pi**2 + rho * a2) * decay**2 * c**2
        left, here, right = line[k : k + 3]
        flow = (a3 + a4 * here) * (right - 2 * here + left) / step**2
        flow += a4 * ((right - left) / (2 * step)) ** 2
        rates[y[k]] = (source + flow) / (a1 + a2 * here)
    phase.dynamics(rates)
    phase.path(before, lower=0, upper=3)
    target = 2 - decay
    ocp.minimise(phase.integral((y[-1] - target) ** 2 + 1e-3 * u**2) / 2)


@_published(0.3719623, f"Luus 2000, section 7.4.4: gas absorber, 10 plates; {FINE}", 1e-6)
def gas_absorber(ocp):
    n, low, mid, high = 10, 0.538998, -1.173113, 0.634115
    phase = ocp.phase(time=(0, 15))
    x = phase.state("x", n, initial=-0.0307 - np.arange(n) / (n - 1) * (0.1273 - 0.0307))
    u, w = (phase.control(name, lower=0) for name in "uw")
    plates = np.diag(np.full(n, mid)) + np.diag(np.full(n - 1, low), -1)
    plates += np.diag(np.full(n - 1, high), 1)
    feed = casadi.vertcat(low * u, casadi.DM.zeros(n - 2), high * w)
    phase.dynamics({x: casadi.DM(plates) @ x + feed})
    ocp.minimise(phase.integral(casadi.sumsqr(x) + u**2 + w**2))


def _citron(ocp, end, low, high):
    phase = ocp.phase(time=(0, end))
    x = phase.state("x", initial=1, lower=-0.1, upper=1.1)
    y = phase.state("y", initial=0.01, lower=-0.1, upper=1.1)
    u = phase.control("u", lower=low, upper=high)
    phase.dynamics({x: -u * x, y: u * x - 2.5 * u**1.5 * y})
    ocp.minimise(-phase.final(y))


_CITRON = f"Citron 1969: chemical reactor; statement: danielrherber/dt-qp-project; {FINE}"


@_published(-0.405611, _CITRON, 1e-5)
def citron_reactor(ocp):
    _citron(ocp, 8, 0.1, 0.5)


@_published(-0.408711, _CITRON, 1e-5)
def citron_reactor_wide(ocp):
    _citron(ocp, 8, 0.01, 8)


@_published(
    56.89444,
    "Kim, Lippi, Maurer 2004: semiconductor laser, ps; statement and guess:"
    f" danielrherber/dt-qp-project; {FINE}",
    1e-6,
)
def semiconductor_laser(ocp):
    s0, n0, least, pico = 0.6119512914e5, 1.3955581328e8, 2e-3, 1e-12
    phase = ocp.phase(time=(0, (0.1, 100)))
    s = phase.state("s", initial=1, final=3.4063069073e5 / s0)  # photons over s0
    n = phase.state("n", initial=1, final=1.4128116637e8 / n0)  # carriers over n0
    u = phase.control("u", lower=1, upper=67.5e-3 / least)  # current over 2 mA
    photons, carriers = s * s0, n * n0
    gain = 0.3 * 2.628e4 * (carriers - 7.8e7) * (1 - 9.6e-8 * photons) * photons
    pairs = carriers + 1.5e7
    phase.dynamics(
        {
            s: pico / s0 * (-photons / 2.072e-12 + gain + 1.735e-4 * 2.788 * carriers * pairs),
            n: pico
            / n0
            * (
                least * u / 1.60219e-19
                - carriers * (1e8 + 2.788 * pairs + 7.3e-9 * pairs**2)
                - gain
            ),
        }
    )
    phase.guess(time=(0, 100), u=np.array([1, 67.5e-3 / least]))
    ocp.minimise(phase.end)


@_published(
    0.0232380273,
    f"Luus 2000: two-stage stirred tank; statement: pins-ocs/OCP-tests, TwoStageCSTR; {FINE}",
    1e-7,
)
def stirred_tanks_in_series(ocp):
    phase = ocp.phase(time=(0, 2))
    x1, x2, x3, x4 = (
        phase.state(f"x{k + 1}", initial=value) for k, value in enumerate([0.15, -0.03, 0.1, 0])
    )
    u, w = (phase.control(name, lower=-0.5, upper=0.5) for name in "uw")
    r1 = (x1 + 0.5) * casadi.exp(25 * x2 / (x2 + 2))
    r2 = (x3 + 0.25) * casadi.exp(25 * x4 / (x4 + 2))
    f1, f2 = 0.5 - x1 - r1, r1 - (x2 + 0.25) * (2 + u)
    phase.dynamics(
        {
            x1: f1,
            x2: f2,
            x3: x1 - x3 - 0.1 * f1 - r2 + 0.25,
            x4: x2 - 2 * x4 - w * (x4 + 0.25) - 0.1 * f2 + r2 - 0.25,
        }
    )
    ocp.minimise(phase.integral(x1**2 + x2**2 + x3**2 + x4**2 + 0.1 * (u**2 + w**2)))


@_published(
    216.5906,
    "Flores-Tlacuahuac et al. 2006; ICLOCS; statement: pins-ocs/OCP-tests, ICLOCS_StirredTank with"
    f" w_time = 1; {FINE}",
    1e-6,
)
def stirred_tank_transition(ocp):
    phase = ocp.phase(time=(0, (10, 500)))
    goal = 0.2632, 0.6519
    x = phase.state("x", initial=0.98, final=goal[0], lower=0, upper=1)
    y = phase.state("y", initial=0.39, final=goal[1], lower=0, upper=1)
    u = phase.control("u", lower=0, upper=2)
    react = 300 * x * casadi.exp(-5 / y)
    phase.dynamics(
        {
            x: (1 - x) / 20 - react,
            y: (0.3947 - y) / 20 + react - 600 * 0.000195 * u * (y - 0.38158),
        }
    )
    phase.guess(time=(0, 90))
    ocp.minimise(phase.integral(1 + (x - goal[0]) ** 2 + (y - goal[1]) ** 2 + (u - 0.76) ** 2))
