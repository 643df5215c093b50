"""Cars, trains and overtaking."""

from __future__ import annotations

import math

import casadi
import numpy as np

from .table import FINE, PUBLISHED as _published


@_published(
    1228.58029,
    f"Petit, Sciarretta 2011; OptimalControlProblems.jl, printed 1228.5993; {FINE}",
    1e-7,
)
def electric_vehicle(ocp):
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=10)
    v = phase.state("v", initial=0, final=0)
    u = phase.control("u")
    road = 3 + 0.4 * x - x**2 + 0.1 * x**3
    phase.dynamics({x: v, v: u - 1e-3 * v**2 - 0.1 - road})
    ocp.minimise(phase.integral(u * v + u**2))


@_published(1.90468, f"statement and guess: CasADi, race car along a track; {FINE}", 1e-5)
def race_along_track(ocp):
    phase = ocp.phase(time=(0, (1e-2, 100)))
    x = phase.state("x", initial=0, final=1)
    v = phase.state("v", initial=0)
    u = phase.control("u", lower=0, upper=1)
    phase.dynamics({x: v, v: u - v})
    phase.path(v - 1 + casadi.sin(2 * math.pi * x) / 2, upper=0)
    phase.guess(time=(0, 1), v=1.0)
    ocp.minimise(phase.end)


@_published(
    102.368,
    f"Melnikov, Makmal, Briegel 2014; dymos, joss/examples/mountain_car, printed 102.479; {FINE}",
    3e-4,
)
def mountain_car(ocp):
    phase = ocp.phase(time=(0, (1, 1000)))
    x = phase.state("x", initial=-0.5, final=0.5, lower=-1.2, upper=0.5)
    v = phase.state("v", initial=0, final=(0, 0.07), lower=-0.07, upper=0.07)
    u = phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: v, v: 0.001 * u - 0.0025 * casadi.cos(3 * x)})
    ocp.minimise(phase.end)


@_published(
    0.53988,
    f"maptor, examples/overtaking_maneuver, its waypoints as the guess; {FINE}",
    1e-4,
)
def overtaking(ocp):
    m, inertia, front, rear = 1412.0, 1536.7, 1.06, 1.85  # kg, kg m^2, m, m
    own, other = 9 + 1.8, 9 - 1.8
    phase = ocp.phase(time=(0, (0.1, 60)))
    x = phase.state("x", initial=own, final=own, lower=-2, upper=20)
    y = phase.state("y", initial=0, final=50, lower=-10, upper=50)
    phi = phase.state("phi", initial=math.pi / 2, final=math.pi / 2)
    u = phase.state("u", initial=12, lower=0.5, upper=30)
    v = phase.state("v", initial=0, lower=-5, upper=5)
    w = phase.state("w", initial=0, lower=-2.5, upper=2.5)
    a = phase.control("a", lower=-6, upper=6)
    d = phase.control("d", lower=-0.4, upper=0.4)
    fy = -128916.0 * ((v + front * w) / u - d)
    ry = -85944.0 * (v - rear * w) / u
    s, c = casadi.sin(phi), casadi.cos(phi)
    phase.dynamics(
        {
            x: u * c - v * s,
            y: u * s + v * c,
            phi: w,
            u: a + v * w - fy * casadi.sin(d) / m,
            v: -u * w + (fy * casadi.cos(d) + ry) / m,
            w: (front * fy * casadi.cos(d) - rear * ry) / inertia,
        }
    )
    t = phase.time
    ahead, oncoming = 15 + 5 * casadi.fmin(t, 5), 55 - 55 / 15 * casadi.fmin(t, 15)
    phase.path((x - own) ** 2 + (y - ahead) ** 2, lower=3.5**2 - 1)
    phase.path((x - other) ** 2 + (y - oncoming) ** 2, lower=3.5**2 - 1)
    phase.guess(
        time=5 * np.array([0, 0.2, 0.35, 0.5, 0.65, 0.8, 1]),
        x=np.array([own, own, 9, other, 9, own, own]),
        y=np.array([0, 10, 20, 30, 40, 45, 50]),
        phi=math.pi / 2 + np.array([0, 0, 0.1, 0, -0.1, 0, 0]),
        u=np.array([12, 14, 16, 18, 16, 14, 12.0]),
    )
    ocp.minimise(phase.end / 5 + 0.02 * phase.integral((a / 10) ** 2 + (d / 0.3) ** 2))


@_published(
    4.95571,
    "Vanderbei 2001: train over two slopes; statement and guess: danielrherber/dt-qp-project, which"
    f" adds the small quadratic term; {FINE}",
    1e-5,
)
def train(ocp):
    phase = ocp.phase(time=(0, 4.8))
    x = phase.state("x", initial=0, final=6)
    v = phase.state("v", initial=0, final=0)
    pull = phase.control("pull", lower=0, upper=10)
    brake = phase.control("brake", lower=0, upper=2)
    hill = -2 / math.pi * sum(casadi.atan((x - z) / 0.05) for z in (2, 4))
    phase.dynamics({x: v, v: hill - (0.3 + 0.14 * v + 0.16 * v**2) + pull - brake})
    phase.guess(pull=np.array([10, 0.0]), brake=np.array([2, 0.0]), time=(0, 4.8))
    ocp.minimise(phase.integral(pull * v + 1e-3 * (pull**2 + brake**2)))
