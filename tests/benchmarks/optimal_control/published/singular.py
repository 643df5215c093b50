"""Singular arcs, switching and chattering."""

from __future__ import annotations

import math

import casadi

from .table import FINE, PUBLISHED as _published

_CT = "control-toolbox/CTDirect.jl, test/problems"
_BASELINE = "PSOPT manual, tools/regression_baselines_all.json"


@_published(0.2683944, f"Fuller; Bocop; {_CT}/fuller.jl", 1e-5)
def fuller_to_rest(ocp):
    phase = ocp.phase(time=(0, 3.5))
    x = phase.state("x", initial=0, final=0)
    v = phase.state("v", initial=1, final=0)
    u = phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.integral(x**2))


@_published(
    0.268395,
    f"Luus 2000; PROPT: Singular Control 2, printed 0.268336 for 50 nodes; {FINE}",
    1e-5,
)
def luus_singular_second(ocp):
    phase = ocp.phase(time=(0, 5))
    x = phase.state("x", initial=0)
    v = phase.state("v", initial=1)
    u = phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.integral(x**2))


@_published(
    0.1192483, f"Luus 2000; PROPT; {_BASELINE}, printed 0.119262 for 80 nodes; {FINE}", 1e-5
)
def luus_singular_fifth(ocp):
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0)
    v = phase.state("v", initial=-1)
    z = phase.state("z", initial=-math.sqrt(5))
    u = phase.control("u", lower=0, upper=10)
    drift = 16 * phase.time - 8
    phase.dynamics({x: v, v: drift - z * u, z: u})
    ocp.minimise(phase.integral(x**2 + v**2 + 0.0005 * (v + drift - 0.1 * z * u**2) ** 2))


@_published(-0.191814, f"Jackson 1968; Bocop; {_CT}/jackson.jl, printed 0.192011; {FINE}", 1e-5)
def jackson_catalyst(ocp):
    phase = ocp.phase(time=(0, 4))
    a = phase.state("a", initial=1, lower=0, upper=1.1)
    b = phase.state("b", initial=0, lower=0, upper=1.1)
    c = phase.state("c", initial=0, lower=0, upper=1.1)
    u = phase.control("u", lower=0, upper=1)
    swap = u * (a - 10 * b)
    phase.dynamics({a: -swap, b: swap - (1 - u) * b, c: (1 - u) * b})
    ocp.minimise(-phase.final(c))


@_published(-1.012575, f"Seywald, Cliff 1993; Bocop; {_CT}/goddard.jl, printed 1.01257", 2e-6)
def goddard_speed_limit(ocp):
    phase = ocp.phase(time=(0, (0.01, 10)))
    r = phase.state("r", initial=1, lower=1, upper=1.2)
    v = phase.state("v", initial=0, lower=0, upper=0.1)
    m = phase.state("m", initial=1, final=0.6, lower=0.6, upper=1)
    u = phase.control("u", lower=0, upper=1)
    drag = 310 * v**2 * casadi.exp(-500 * (r - 1))
    phase.dynamics({r: v, v: (3.5 * u - drag) / m - 1 / r**2, m: -7 * u})
    ocp.minimise(-phase.final(r))


@_published(
    1.08801,
    f"PSOPT, examples/lotka2 (relaxed), printed 1.088024; {FINE}",
    1e-5,
)
def two_fleets(ocp):
    phase = ocp.phase(time=(0, 12))
    x = phase.state("x", initial=0.5, lower=0, upper=2)
    y = phase.state("y", initial=0.7, lower=0, upper=2)
    u, w = (phase.control(name, lower=0, upper=1) for name in "uw")
    phase.dynamics({x: x - x * y - 0.4 * x * u, y: -y + x * y - 0.2 * y * w})
    ocp.minimise(phase.integral((x - 1) ** 2 + (y - 1) ** 2))


@_published(
    -1.75033,
    f"Ijiri, Thompson 1970; {_BASELINE}, printed -1.742652 and -1.738501; {FINE}",
    3e-5,
)
def wheat_trading(ocp):
    phase = ocp.phase(time=(0, 12))
    cash = phase.state("cash", initial=1, lower=0)
    wheat = phase.state("wheat", initial=0, lower=0)
    buy = phase.control("buy", lower=0, upper=1)
    sell = phase.control("sell", lower=-1, upper=0)

    def price(t):
        return 1 + 0.5 * casadi.sin(math.pi / 3 * t + 3 * math.pi / 2)

    p = price(phase.time)
    phase.dynamics(
        {
            cash: 0.01 * cash - 0.2 * wheat - p * (buy + sell) - 0.01 * buy + 0.05 * sell,
            wheat: -0.05 * wheat + buy + sell,
        }
    )
    ocp.minimise(-(phase.final(cash) + price(12.0) * phase.final(wheat)))


@_published(
    -0.375503,
    f"{_BASELINE}: isoperimetric (the code integrates x), printed -0.3755058; {FINE}",
    5e-6,
)
def isoperimetric_effort(ocp):
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=1, final=0, lower=-10, upper=10)
    u = phase.control("u", lower=-4, upper=4)
    phase.dynamics({x: u - casadi.sin(x)})
    ocp.subject_to(phase.integral(u**2), equals=10)
    ocp.minimise(phase.integral(x))


@_published(
    1.4203125990,
    f"PROPT; {_BASELINE}: Moon Lander, printed 1.420411; value: coasting for 0.23925911, then full"
    " thrust",
    1e-5,
)
def moon_lander_mass(ocp):
    phase = ocp.phase(time=(0, (1e-3, 1000)))
    h = phase.state("h", initial=1, final=0, lower=-20, upper=20)
    v = phase.state("v", initial=-0.783, final=0, lower=-20, upper=20)
    m = phase.state("m", initial=1, lower=0.01, upper=1)
    u = phase.control("u", lower=0, upper=1.227)
    phase.dynamics({h: v, v: u / m - 1, m: -u / 2.349})
    ocp.minimise(phase.integral(u))


@_published(7.811324, "Chang, Petit, Rouchon 2006; PROPT; OptimalControlProblems.jl", 1e-5)
def dielectrophoresis(ocp):
    phase = ocp.phase(time=(0, (1e-3, 100)))
    x = phase.state("x", initial=1, final=2)
    y = phase.state("y", initial=0)
    u = phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: y * u - 0.75 * u**2, y: u - y})
    ocp.minimise(phase.end)
