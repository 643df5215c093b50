"""Mechanics, geometry and test problems with several optima."""

from __future__ import annotations

import math

import casadi
import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq

from .table import PUBLISHED as _published

_DTQP = "statement: danielrherber/dt-qp-project, examples"


@_published(
    2 / math.expm1(2), "control-toolbox/CTDirect.jl, simple_integrator.jl: 2 / (e^2 - 1)", 1e-6
)
def two_sided_effort(ocp):
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=-1, final=0)
    u, w = (phase.control(name, lower=0) for name in "uw")
    phase.dynamics({x: -x - u + w})
    ocp.minimise(phase.integral((u + w) ** 2))


@_published(2 * math.tanh(0.5), "Dadebo, McAuley 1995; pins-ocs/PINS2-tests: 2 tanh(1 / 2)", 1e-8)
def dadebo(ocp):
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=1, final=1)
    y = phase.state("y", initial=0)
    u = phase.control("u")
    phase.dynamics({x: u, y: x**2 + u**2})
    ocp.minimise(phase.final(y))


def _root_regulator() -> float:
    """Return the value of Garg's problem, linear-quadratic in sqrt(y): r'' = 2 r."""
    w, end = math.sqrt(2), 5.0
    a, b = np.linalg.solve([[1, 1], [math.exp(w * end), math.exp(-w * end)]], [w, 1])

    def cost(t: float) -> float:
        up, down = a * math.exp(w * t), b * math.exp(-w * t)
        return ((up + down) ** 2 + (w * (up - down) - up - down) ** 2) / 2

    return quad(cost, 0, end, epsabs=1e-12)[0]


@_published(_root_regulator(), f"Garg et al. 2009; linear-quadratic in sqrt(y); {_DTQP}", 1e-6)
def root_regulator(ocp):
    phase = ocp.phase(time=(0, 5))
    y = phase.state("y", initial=2, final=1, lower=0)
    u = phase.control("u")
    phase.dynamics({y: 2 * y + 2 * u * casadi.sqrt(y)})
    ocp.minimise(phase.integral(u**2 + y) / 2)


@_published(
    -1 / (4 * math.pi), "yapss, examples/isoperimetric: circle of length 1; its guess", 1e-6
)
def closed_curve(ocp):
    phase = ocp.phase(time=(0, 1))
    x, y = phase.state("x"), phase.state("y")
    u, w = phase.control("u"), phase.control("w")
    phase.dynamics({x: u, y: w})
    phase.path(u**2 + w**2, equals=1)
    for state in (x, y):
        ocp.subject_to(phase.final(state) - phase.initial(state), equals=0)
        ocp.subject_to(phase.integral(state), equals=0)
    side = np.array([1, 1, -1, -1, 1]) / 8
    phase.guess(time=np.linspace(0, 1, 5), x=side, y=np.array([1, -1, -1, 1, 1]) / 8)
    ocp.minimise(-phase.integral((y * u - x * w) / 2))


@_published(
    0.04539932,
    f"Williams 2005: tether-assisted reentry; {_DTQP}. Value: Radau and Gauss collocation on 400 intervals",
    1e-6,
)
def tether_reentry(ocp):
    phase = ocp.phase(time=(0, 5))
    a = phase.state("a", initial=math.radians(30), final=0)
    w = phase.state("w", initial=0, final=math.sqrt(6) / 2)
    length = phase.state("length", initial=0.05, final=1)
    v = phase.state("v", initial=0.05, final=0, lower=0)
    u = phase.control("u", lower=0.01, upper=12)
    pull = length * ((w + 1) ** 2 + 3 * casadi.cos(a) ** 2 - 1) - u
    phase.dynamics(
        {
            a: w,
            w: -2 * (w + 1) * v / length - 3 * casadi.sin(a) * casadi.cos(a),
            length: v,
            v: pull,
        }
    )
    ocp.minimise(phase.integral(pull**2) / 2)


def _gornov(ocp, rates, begin, end, most, cost):
    phase = ocp.phase(time=(0, end))
    x = phase.state("x", initial=begin[0])
    y = phase.state("y", initial=begin[1])
    u = phase.control("u", lower=-most, upper=most)
    first, second = rates(x, y, u)
    phase.dynamics({x: first, y: second})
    ocp.minimise(cost(phase.final(x), phase.final(y)))


def _newton() -> float:
    """Return Newton's least resistance of a body of radius 1 and height 1."""

    def radius(p: float) -> float:
        return (1 + p**2) ** 2 / (4 * p)

    def drop(p: float) -> float:
        return (p**2 + 3 / 4 * p**4 - 7 / 4 - math.log(p)) / 4

    last = brentq(lambda p: drop(p) - radius(p), 1.1, 10)
    flat = 1 / radius(last)

    def rate(p: float) -> float:
        slope = ((1 + p**2) * p - (1 + p**2) ** 2 / (4 * p)) / p
        return flat**2 * radius(p) * slope / (1 + p**2)

    return 8 * (flat**2 / 2 + quad(rate, 1, last)[0])


@_published(
    _newton(),
    "Newton 1687: least resistance; yapss, examples/newton. The slope jumps and its rate is not"
    " bounded, so that the infimum is approached only: collocation on 60 to 400 intervals ends"
    " 0.8e-3 to 1.2e-3 above it",
    2e-3,
)
def newton_body(ocp):
    phase = ocp.phase(time=(0, 1))
    y = phase.state("y", lower=0, upper=1)
    slope = phase.state("slope", upper=0)
    bend = phase.control("bend", upper=0)
    phase.dynamics({y: slope, slope: bend})
    phase.guess(y=np.array([1.0, 0.0]), slope=-1.0, time=(0, 1))
    ocp.minimise(phase.integral(8 * phase.time / (1 + slope**2)))


_GORNOV = f"Gornov et al. 2012, several optima; {_DTQP}; best of 20 starts by two collocations"


@_published(11.90801, _GORNOV, 1e-5)
def gornov_pendulum(ocp):
    _gornov(ocp, lambda x, y, u: (y, u - casadi.sin(x)), (5, 0), 5, 1, lambda x, y: x**2 + y**2)


@_published(-5.062174, _GORNOV, 1e-5)
def gornov_bilinear(ocp):
    _gornov(
        ocp,
        lambda x, y, u: (1 - y**2 + 0.5 * y, x * u),
        (0.5, -0.2),
        1.7,
        2,
        lambda x, y: x - y + x * y,
    )


@_published(-4.810827, _GORNOV, 1e-5)
def gornov_heading(ocp):
    _gornov(ocp, lambda x, y, u: (casadi.cos(y), u - casadi.sin(x)), (0, 0), 7, 1, lambda x, y: x)


@_published(28.3863, _GORNOV, 2e-5)
def gornov_series(ocp):
    _gornov(
        ocp,
        lambda x, y, u: (y, u - x + x**3 / 6 - x**5 / 120),
        (5, 0),
        7,
        1,
        lambda x, y: x**2 + y**2 + 2 * x - 19 * y + 365 / 4,
    )
