"""Linear dynamics, closed forms and small problems with known solutions."""

from __future__ import annotations

import math

import casadi
import numpy as np
from scipy.integrate import quad

from .table import FINE, PUBLISHED as _published

_DTQP = "statement: danielrherber/dt-qp-project, examples"
_CT = "control-toolbox/CTDirect.jl, test/problems"


@_published(math.tanh(1) / 2, f"Hager 2000, Riccati's equation; {_DTQP}", 1e-7)
def hager_mixed(ocp):
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=1)
    u = phase.control("u")
    phase.dynamics({x: x / 2 + u})
    ocp.minimise(phase.integral(5 / 4 * x**2 + x * u + u**2) / 2)


@_published(
    math.tanh(1) + 2 * (math.exp(3) - 1) / (math.exp(3) + 2),
    f"Hager, Hou, Rao 2016; linear-quadratic in x1 x2 and 1 / x2; {_DTQP}",
    1e-7,
)
def hager_hou_rao(ocp):
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=1)
    y = phase.state("y", initial=1)
    u, v = phase.control("u"), phase.control("v")
    phase.dynamics({x: x + u / y + x * y * v, y: -y * (0.5 + y * v)})
    ocp.minimise(phase.integral(2 * x**2 * y**2 + 1.25 / y**2 + v / y + u**2 + v**2))


def _along_the_bound(s: float = 26 / 15) -> float:
    return 225 * s - 6 * s**5 + s**9 / 9 + 0.0288 * s**5


@_published(
    _along_the_bound(), f"Betts, Biehn, Campbell 2002: along the bound throughout; {_DTQP}", 1e-6
)
def betts_biehn_campbell(ocp):
    phase = ocp.phase(time=(34 / 15, 4))
    x = phase.state("x", initial=302399 / 50625)
    v = phase.state("v", initial=70304 / 3375)
    u = phase.control("u")
    phase.dynamics({x: v, v: u})
    phase.path(x - 15 + (phase.time - 4) ** 4, lower=0)
    ocp.minimise(phase.integral(x**2 + 1e-3 * u**2))


def _nagurka(ocp, n):
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", n, initial=np.arange(1.0, n + 1))
    u = phase.control("u", n)
    last = np.array([(-1) ** k * (k + 1.0) for k in range(n)])
    phase.dynamics({x: casadi.vertcat(x[1:], casadi.dot(last, x)) + u})
    ocp.minimise(10 * phase.final(x[0]) ** 2 + phase.integral(casadi.sumsqr(x) + casadi.sumsqr(u)))


def _moved(first: float, second: float, length: float) -> float:
    """Return the least integral of x**2 + u**2 with x' = u between two values."""
    c, s = math.cosh(length), math.sinh(length)
    return ((first**2 + second**2) * c - 2 * first * second) / s


@_published(
    _moved(1, 0.9, 0.75) + _moved(0.9, 0.75, 0.25),
    "Jennings 2002; PSOPT manual: interior point constraint, printed 0.9205314; value: hyperbolic arcs",
    1e-8,
)
def interior_point(ocp):
    first = ocp.phase("first", time=(0, 0.75))
    x = first.state("x", initial=1, final=0.9)
    u = first.control("u")
    first.dynamics({x: u})
    second = ocp.phase("second", time=(0.75, 1))
    y = second.state("x", initial=0.9, final=0.75)
    w = second.control("u")
    second.dynamics({y: w})
    ocp.link(first, second)
    ocp.minimise(first.integral(x**2 + u**2) + second.integral(y**2 + w**2))


@_published(1.0, "Gong, Ross et al. 2008; PSOPT manual: multi-segment problem: 1, 0 and -1", 1e-6)
def stepped_control(ocp):
    phase = ocp.phase(time=(0, 3))
    x = phase.state("x", initial=1, final=1, lower=0)
    u = phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: u})
    ocp.minimise(phase.integral(x))


@_published(1.5**0.25 + 0.5 / 1.5**0.75, f"{_CT}/bolza.jl, printed 1.476; constant control", 1e-7)
def bolza_free_end(ocp):
    phase = ocp.phase(time=(0, (0.1, 100)))
    x = phase.state("x", initial=0, final=1, lower=0)
    u = phase.control("u")
    phase.dynamics({x: u})  # u of the source times its end time
    ocp.minimise(phase.end + phase.integral(u**2) / 2 / phase.end**2)


@_published(1.0478069, f"Bocop; {_CT}/vanderpol.jl, printed 1.047921; {FINE}", 1e-6)
def van_der_pol_quadratic(ocp):
    phase = ocp.phase(time=(0, 2))
    x = phase.state("x", initial=1)
    v = phase.state("v", initial=0)
    u = phase.control("u")
    phase.dynamics({x: v, v: (1 - x**2) * v - x + u})
    ocp.minimise(phase.integral(x**2 + v**2 + u**2) / 2)


@_published(19.431, f"Robbins 1980; Bocop; {_CT}/robbins.jl, printed 19.4; {FINE}", 1e-3)
def robbins(ocp):
    phase = ocp.phase(time=(0, 10))
    x = phase.state("x", initial=1, final=0, lower=0)
    v = phase.state("v", initial=-2, final=0)
    a = phase.state("a", initial=0, final=0)
    u = phase.control("u")
    phase.dynamics({x: v, v: a, a: u})
    ocp.minimise(phase.integral(3 * x + u**2 / 2))


def _tangent() -> float:
    """Return the value of X1: integrated by parts it is minimised at every instant."""
    return -quad(lambda t: math.sin(t) ** 2 / (4 - 2 * math.cos(t)), 0, math.pi / 2)[0]


@_published(_tangent(), f"Neuenhofen, Kerrigan 2020, X1; by parts, pointwise; {_DTQP}", 1e-7)
def neuenhofen_kerrigan_x1(ocp):
    phase = ocp.phase(time=(0, math.pi / 2))
    x = phase.state("x", initial=0)
    u = phase.control("u", lower=-1.5, upper=1)
    phase.dynamics({x: x**2 / 2 + u})
    ocp.minimise(phase.integral(x**2 + casadi.cos(phase.time) * u))


def _three_arcs() -> float:
    """Return the value of X2, linear-quadratic in x**2: u = -1, a free arc, along the bound."""
    s = math.asinh(1.25)
    first = 1 - 0.4 * math.cosh(s)
    second = first + s / 2
    ramp = 4 / 3 * (1 - (1 - first) ** 3) + first
    return ramp + 0.16 * math.sinh(2 * s) + 0.64 * (1 - second)


@_published(_three_arcs(), f"Neuenhofen, Kerrigan 2020, X2; three arcs; {_DTQP}", 1e-6)
def neuenhofen_kerrigan_x2(ocp):
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=1, lower=math.sqrt(0.4))
    y = phase.state("y", initial=0)
    u = phase.control("u", lower=-1)
    phase.dynamics({x: u / (2 * x), y: 4 * x**4 + u**2})
    ocp.minimise(phase.final(y))


@_published(12.980094, f"PSOPT, examples/path_window, printed 12.97886 for 60 nodes; {FINE}", 1e-6)
def speed_limit_window(ocp):
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=1, lower=-5, upper=5)
    v = phase.state("v", initial=0, final=0, lower=-5, upper=5)
    u = phase.control("u", lower=-20, upper=20)
    t = phase.time
    gate = 1 / (1 + casadi.exp(-200 * (t - 0.35))) / (1 + casadi.exp(200 * (t - 0.65)))
    phase.dynamics({x: v, v: u})
    phase.path(v - 1.3 - 50 * (1 - gate), upper=0)
    ocp.minimise(phase.integral(u**2))


@_published(
    1.0416863,
    f"von Stryk 1999; PROPT; PSOPT manual, printed 1.042568: path tracking robot; {FINE}",
    1e-6,
)
def path_tracking_robot(ocp):
    cost, ends = 0, []
    for k, (begin, end) in enumerate(
        [({"x": 0, "y": 0, "v": 0.5, "w": 0}, {}), ({}, {"x": 0.5, "y": 0.5, "v": 0, "w": 0.5})]
    ):
        phase = ocp.phase(f"leg{k}", time=(k, k + 1))
        x, y, v, w = (
            phase.state(name, initial=begin.get(name), final=end.get(name)) for name in "xyvw"
        )
        a, b = (phase.control(name, lower=-10, upper=10) for name in "ab")
        phase.dynamics({x: v, y: w, v: a, w: b})
        along, across = phase.time / 2 if k == 0 else 0.5, 0 if k == 0 else (phase.time - 1) / 2
        fast, side = (0.5, 0) if k == 0 else (0, 0.5)
        cost += phase.integral(
            100 * ((x - along) ** 2 + (y - across) ** 2) + 500 * ((v - fast) ** 2 + (w - side) ** 2)
        )
        ends.append(phase)
    ocp.link(*ends)
    ocp.minimise(cost)


@_published(
    9.1103486e-4,
    f"Coudurier et al. 2018; OptimalControlProblems.jl, printed 9.1092e-4; {FINE}",
    1e-6,
)
def double_oscillator(ocp):
    phase = ocp.phase(time=(0, 2 * math.pi))
    x, y, v, w = (
        phase.state(name, initial=value)
        for name, value in zip("xyvw", (0, 0, None, None), strict=True)
    )
    u = phase.control("u", lower=-1, upper=1)
    force = casadi.sin(phase.time)
    phase.dynamics(
        {
            x: v,
            y: w,
            v: (-103 * x + 3 * y + force) / 100,
            w: (3 * x - 3 * y - 0.5 * (1 - u) * w) / 2,
        }
    )
    ocp.minimise(phase.integral(x**2 + y**2 + u**2) / 2)


@_published(5 * 1.5**2 / 2 / (1 + 5 * 5), "Hull 2003; dymos, examples/hull_problem", 1e-8)
def hull(ocp):
    phase = ocp.phase(time=(0, 5))
    x = phase.state("x", initial=1.5)
    u = phase.control("u")
    phase.dynamics({x: u})
    ocp.minimise(5 * phase.final(x) ** 2 / 2 + phase.integral(u**2 / 2))


@_published(
    3.10812211,
    "Goellmann, Kern, Maurer 2009; Betts 2010, 10.50: delays as six coupled copies",
    1e-5,
)
def delay_chain(ocp):
    phase = ocp.phase(time=(0, 1))
    x = [phase.state(f"x{k}", initial=1 if k == 0 else None) for k in range(6)]
    u = [phase.control(f"u{k}") for k in range(6)]
    before, past = [1.0, *x[:5]], [0.0, 0.0, *u[:4]]
    phase.dynamics({xk: b * p for xk, b, p in zip(x, before, past, strict=True)})
    for k in range(6):
        phase.path(u[k] + x[k], lower=0.3)
        if k:
            ocp.subject_to(phase.initial(x[k]) - phase.final(x[k - 1]), equals=0)
    ocp.minimise(phase.integral(sum(xk**2 + uk**2 for xk, uk in zip(x, u, strict=True))))


@_published(
    12.8738850, "Campbell; Betts 2010, 10.103: pendulum whose multiplier is eliminated", 1e-5
)
def pendulum_dae(ocp):
    g = 9.81
    phase = ocp.phase(time=(0, 3))
    x = phase.state("x", initial=1, final=0, lower=-5, upper=5)
    y = phase.state("y", initial=0, lower=-5, upper=5)
    v = phase.state("v", initial=0, final=0, lower=-5, upper=5)
    w = phase.state("w", initial=0, lower=-5, upper=5)
    u = phase.control("u")
    pull = v**2 + w**2 - g * y  # twice the multiplier
    phase.dynamics({x: v, y: w, v: -pull * x + u * y, w: -g - pull * y - u * x})
    phase.path(pull / 2, lower=-1, upper=15)
    ocp.minimise(phase.integral(u**2))


@_published(
    109.0743477519, "Luus 2000, section 6.4: Nagurka's problem, 6 states; Riccati's equation", 1e-6
)
def nagurka_6(ocp):
    _nagurka(ocp, 6)


@_published(
    4157.8693096, "Luus 2000, section 6.4: Nagurka's problem, 20 states; Riccati's equation", 1e-6
)
def nagurka_20(ocp):
    _nagurka(ocp, 20)


@_published(34363.479209, "Nagurka's problem with 40 states; Riccati's equation", 1e-6)
def nagurka_40(ocp):
    _nagurka(ocp, 40)
