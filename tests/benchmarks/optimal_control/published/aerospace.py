"""Launch and orbit transfer."""

from __future__ import annotations

import math

import casadi
import numpy as np

from .table import FINE, PUBLISHED as _published

_BASELINE = "PSOPT manual, tools/regression_baselines_all.json"


def _equinoctial(y, push, mu, radius, harmonics):
    """Return the rates of modified equinoctial elements (p, f, g, h, k, L) and the radial frame.

    Parameters
    ----------
    y : casadi.MX, shape (6,)
        Elements.
    push : callable
        Function of position and velocity that returns the thrust acceleration in the radial frame.
    mu, radius : float
        Gravitational constant and radius of the Earth.
    harmonics : dict of int to float
        Zonal harmonics J2 to J4.
    """
    p, f, g, h, k, L = casadi.vertsplit(y)
    c, s = casadi.cos(L), casadi.sin(L)
    q = 1 + f * c + g * s
    r, a2, s2 = p / q, h**2 - k**2, 1 + h**2 + k**2
    position = (
        r
        / s2
        * casadi.vertcat(
            c + a2 * c + 2 * h * k * s, s - a2 * s + 2 * h * k * c, 2 * (h * s - k * c)
        )
    )
    velocity = (
        casadi.sqrt(mu / p)
        / s2
        * casadi.vertcat(
            -(s + a2 * s - 2 * h * k * c + g - 2 * f * h * k + a2 * g),
            -(-c + a2 * c + 2 * h * k * s - f + 2 * g * h * k + a2 * f),
            2 * (h * c + k * s + f * h + g * k),
        )
    )
    up = position / r
    normal = casadi.cross(position, velocity)
    normal = normal / casadi.norm_2(normal)
    frame = casadi.horzcat(up, casadi.cross(normal, up), normal)
    z = position[2] / r
    north = casadi.vertcat(0, 0, 1) - z * up
    north = north / casadi.norm_2(north)
    legendre = {
        2: ((3 * z**2 - 1) / 2, 3 * z),
        3: ((5 * z**3 - 3 * z) / 2, (15 * z**2 - 3) / 2),
        4: ((35 * z**4 - 30 * z**2 + 3) / 8, (140 * z**3 - 60 * z) / 8),
    }
    to_north = to_up = 0
    for n, strength in harmonics.items():
        value, slope = legendre[n]
        common = -mu / r**2 * (radius / r) ** n * strength
        to_north += common * casadi.sqrt(1 - z**2) * slope
        to_up += common * (n + 1) * value
    pull = frame.T @ (to_north * north - to_up * up)
    d1, d2, d3 = casadi.vertsplit(pull + push(frame, velocity))
    root = casadi.sqrt(p / mu)
    turn = h * s - k * c
    return (
        casadi.vertcat(
            2 * p / q * root * d2,
            root * (s * d1 + ((q + 1) * c + f) / q * d2 - g / q * turn * d3),
            root * (-c * d1 + ((q + 1) * s + g) / q * d2 + f / q * turn * d3),
            root * s2 * c / (2 * q) * d3,
            root * s2 * s / (2 * q) * d3,
            root * turn / q * d3 + casadi.sqrt(mu * p) * (q / p) ** 2,
        ),
        frame,
        velocity,
    )


@_published(
    -0.2201791,
    f"Betts 2001, section 6.3; Patterson, Rao 2014 (GPOPS-II): 0.2201791; {_BASELINE}: 0.2203403"
    " for |u|^2 within 0.1 %. Guess: thrust along the velocity",
    1e-5,
)
def low_thrust_transfer(ocp):
    thrust, impulse, g0 = 4.446618e-3, 450.0, 32.174  # lb, s, ft/s^2
    phase = ocp.phase(time=(0, (50000, 100000)))
    low = [10e6, -0.2, -0.1, -1, -0.2, math.pi]
    high = [60e6, 0.2, 1, 1, 0.2, 20 * math.pi]
    begin = [21837080.052835, 0, 0, -0.25396764647494, 0, math.pi]
    y = phase.state("y", 6, initial=begin, lower=low, upper=high)
    w = phase.state("w", initial=1, lower=0.1, upper=2)
    u = phase.control("u", 3, lower=-1, upper=1)
    throttle = ocp.parameter("throttle", lower=-50, upper=0, guess=-25)
    force = thrust * (1 + 0.01 * throttle)
    harmonics = {2: 1082.639e-6, 3: -2.565e-6, 4: -1.608e-6}
    rates, frame, velocity = _equinoctial(
        y, lambda frame, velocity: g0 * force / w * u, 1.407645794e16, 20925662.73, harmonics
    )
    phase.dynamics({y: rates, w: -force / impulse})
    phase.path(casadi.sumsqr(u), equals=1)
    p, f, g, h, k = (phase.final(y[i]) for i in range(5))
    ocp.subject_to(p, equals=40007346.015232)
    ocp.subject_to(f**2 + g**2, equals=0.73550320568829**2)
    ocp.subject_to(h**2 + k**2, equals=0.61761258786099**2)
    ocp.subject_to(f * h + g * k, equals=0)
    ocp.subject_to(g * h - k * f, upper=0, lower=-10)
    phase.simulate(time=(0, 86810), u=frame.T @ velocity / casadi.norm_2(velocity))
    ocp.minimise(-phase.final(w))


@_published(
    143.5897, f"dymos, examples/ssto: SSTO Earth, 143 s within 5 %; its guess; {FINE}", 1e-5
)
def single_stage_to_orbit(ocp):
    g, area = 9.80665, 7.069
    phase = ocp.phase(time=(0, (10, 500)))
    x = phase.state("x", initial=0, unit="m")
    y = phase.state("y", initial=0, final=1.85e5, unit="m")
    v = phase.state("v", initial=0, final=7796.6961, unit="m/s")
    w = phase.state("w", initial=0, final=0, unit="m/s")
    m = phase.state("m", initial=117000, lower=1, unit="kg")
    theta = phase.control("theta", lower=-1.57, upper=1.57)
    thrust = 2.1e6
    drag = 0.5 * 1.225 * casadi.exp(-y / 8.44e3) * 0.5 * area * casadi.sqrt(v**2 + w**2 + 1e-12)
    phase.dynamics(
        {
            x: v,
            y: w,
            v: (thrust * casadi.cos(theta) - drag * v) / m,
            w: (thrust * casadi.sin(theta) - drag * w) / m - g,
            m: -thrust / (g * 265.2),
        }
    )
    line = {"x": (0, 1.15e5), "y": (0, 1.85e5), "v": (0, 7796.6961), "w": (0, 0)}
    phase.guess(
        time=(0, 150),
        m=lambda t: 117000 + (1163 - 117000) * t / 150,
        theta=lambda t: 1.5 - 2.26 * t / 150,
        **{name: (lambda t, a=a, b=b: a + (b - a) * t / 150) for name, (a, b) in line.items()},
    )
    ocp.minimise(phase.end)


@_published(
    0.3995,
    "Enright, Conway 1991; dymos, examples/finite_burn_orbit_raise, test value within 0.2 %;"
    " its guess. Another optimum with burns of the same sense has 0.8218",
    2e-3,
)
def finite_burn_orbit_raise(ocp):
    target, legs = 3.0, []
    plan = [
        ("burn1", (0.5, 10), 30, (0, 2.25), [(1, 1.5), (0, 1.7), (0, 0), (1, 1), (0, 0.1)]),
        (
            "coast",
            (0.5, 50),
            0,
            (2.25, 5.25),
            [(1.3, 1.5), (2.18, 1.7), (0.3285, 0), (0.97, 1), (0, 0)],
        ),
        (
            "burn2",
            (0.5, 10),
            180,
            (5.25, 7),
            [(1, target), (0, 4), (0, 0), (1, target**-0.5), (0.1, 0.2)],
        ),
    ]
    for name, span, angle, times, lines in plan:
        start = 0 if name == "burn1" else ((0.5, 20) if name == "coast" else (0.5, 100))
        phase = ocp.phase(name, time=(start, (0.5, 120)))
        ocp.subject_to(phase.duration, lower=span[0], upper=span[1])
        begin = dict(zip("rtvw", (1, 0, 0, 1), strict=True)) if name == "burn1" else {}
        end = dict(zip("rvw", (target, 0, target**-0.5), strict=True)) if name == "burn2" else {}
        r, t, v, w = (
            phase.state(key, initial=begin.get(key), final=end.get(key)) for key in "rtvw"
        )
        spent = phase.state("spent", initial=0 if begin else None)
        rates = {r: v, t: w / r, v: w**2 / r - 1 / r**2, w: -v * w / r, spent: casadi.MX(0)}
        guess = dict(zip(["r", "t", "v", "w", "spent"], lines, strict=True))
        if angle:
            a = phase.state("a", initial=0.1 if begin else None)
            most = math.radians(angle)
            u = phase.control("u", lower=-most, upper=most)
            rates[v] += a * casadi.sin(u)
            rates[w] += a * casadi.cos(u)
            rates |= {a: a**2 / 1.5, spent: a}
            guess["a"] = (0.1, 0.0)
        phase.dynamics(rates)
        span = np.array(times)
        phase.guess(time=span, **{key: np.array(line) for key, line in guess.items()})
        legs.append((phase, a if angle else None))
    (one, a), (two, _), (three, b) = legs
    ocp.link(one, two, "r", "t", "v", "w", "spent")
    ocp.link(two, three, "r", "t", "v", "w", "spent")
    ocp.subject_to(one.final(a) - three.initial(b), equals=0)
    ocp.minimise(three.final(spent))


@_published(
    0.50785,
    "Ross, Gong, Sekhavat 2007: least fuel from radius 1 to 4 with thrust 0.01; statement and guess:"
    f" danielrherber/dt-qp-project; {FINE}; several optima",
    5e-5,
)
def transfer_least_fuel(ocp):
    most = 0.01
    phase = ocp.phase(time=(0, 57))
    r = phase.state("r", initial=1, final=4, lower=0.1)
    th = phase.state("th", initial=0)
    v = phase.state("v", initial=0, final=0)
    w = phase.state("w", initial=1, final=0.5)
    a, b = (phase.control(name, lower=-1.05 * most, upper=1.05 * most) for name in "ab")
    thrust = phase.control("thrust", lower=0, upper=most)
    phase.dynamics({r: v, th: w / r, v: w**2 / r - 1 / r**2 + a, w: -v * w / r + b})
    phase.path(a**2 + b**2 - thrust**2, upper=0, scale=most**2)
    phase.guess(time=(0, 57), th=np.array([0, 20.0]), a=0.0, b=most, thrust=most)
    ocp.minimise(phase.integral(thrust))
