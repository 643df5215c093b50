"""Populations, fermentation, epidemics and economics."""

from __future__ import annotations

import math

import casadi

from .table import FINE, PUBLISHED as _published

_CT = "control-toolbox/CTDirect.jl, test/problems"


@_published(-5.4523, f"{_CT}/algal_bacterial.jl, printed 5.45; {FINE}", 2e-5)
def algal_bacterial(ocp):
    phase = ocp.phase(time=(0, 20))
    floor = 2.7628e-3
    s = phase.state("s", initial=0.1629, lower=0)
    e = phase.state("e", initial=0.0487, lower=0)
    v = phase.state("v", initial=0.0003, lower=0)
    q = phase.state("q", initial=0.0177, lower=floor)
    c = phase.state("c", initial=0.035, lower=0)
    share = phase.control("share", lower=0, upper=1)
    d = phase.control("d", lower=0, upper=1.5)
    growth = 6.48 * s / (0.09 + s)
    uptake = 27.3e-3 * v / (0.57e-3 + v)
    algae = 1.0211 * (1 - floor / q)
    phase.dynamics(
        {
            s: d * (0.5 - s) - growth * e / 0.44,
            e: ((1 - share) * growth - d) * e,
            v: share * 23e-3 * growth * e - uptake * c - d * v,
            q: uptake - algae * q,
            c: (algae - d) * c,
        }
    )
    ocp.minimise(-phase.integral(d * c))


def _methane(phase):
    """Declare algae by day and bacteria; return the states and the rate of methane."""
    y = phase.state("y", lower=0)
    s = phase.state("s", lower=0)
    b = phase.state("b", lower=0.001)
    u = phase.control("u", lower=0, upper=1)
    light = casadi.fmax(0, casadi.sin(math.pi / 5 * phase.time)) ** 2
    growth = 0.1 * s / (s + 0.05)
    phase.dynamics(
        {
            y: light * y / (1 + y) - (0.005 + u) * y,
            s: -growth * b + u * (y - s),
            b: (growth - u) * b,
        }
    )
    return y, s, b, growth * b / 3


@_published(-0.614134, f"Bocop; {_CT}/bioreactor.jl: one periodic day, printed 0.614; {FINE}", 1e-5)
def bioreactor_day(ocp):
    phase = ocp.phase(time=(0, 10))
    y, s, b, gas = _methane(phase)
    for state, least in ((y, 1), (s, 0), (b, 1)):
        ocp.subject_to(phase.initial(state) - phase.final(state), equals=0)
        ocp.subject_to(phase.initial(state), lower=least)
    ocp.minimise(-phase.integral(gas))


@_published(-19.0669, f"Bocop; {_CT}/bioreactor.jl: 30 days, printed 19.0745; {FINE}", 5e-4)
def bioreactor_month(ocp):
    phase = ocp.phase(time=(0, 300))
    y, s, b, gas = _methane(phase)
    for state, least, most in ((y, 0.05, 0.25), (s, 0.5, 5), (b, 0.5, 3)):
        ocp.subject_to(phase.initial(state), lower=least, upper=most)
    phase.guess(y=50.0, s=50.0, b=50.0)
    ocp.minimise(-phase.integral(gas))


@_published(
    -2.059511,
    f"Blomqvist-type health insurance; Bocop; {_CT}/insurance.jl: trapezoid. Algebraic controls"
    " of the source are eliminated",
    1e-3,
)
def insurance(ocp):
    horizon = 10
    phase = ocp.phase(time=(0, horizon))
    cover = phase.state("cover", initial=0, lower=0, upper=1.1)
    m = phase.state("m", initial=0.001, lower=0, upper=1.1)
    paid = phase.state("paid", initial=0)
    h = phase.control("h", lower=0, upper=25)
    premium = ocp.parameter("premium", lower=0, guess=0.1)
    t = phase.time
    illness = 0.25 * casadi.exp(-0.25 * t) + math.exp(-0.25 * horizon) / horizon
    effect = m**2 / (1 + m**2)
    slope = 2 * m / (1 + m**2) ** 2
    revenue = 1 - premium + cover - m
    health = 1.5 - 0.2 * t * (1 - effect)
    utility = 1 - casadi.exp(-10 * revenue) + health
    marginal = 10 * casadi.exp(-10 * revenue)
    phase.dynamics({cover: (1 - 0.2 * t * slope / marginal) * h, m: h, paid: cover * illness})
    phase.path(revenue, lower=0)
    phase.path(health, lower=0)
    phase.path(utility, lower=0)
    phase.path(marginal, lower=1e-8)
    ocp.subject_to(phase.final(paid) - premium, equals=0)
    ocp.minimise(-phase.integral(utility * illness))
