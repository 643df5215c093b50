"""Atmospheric flight: a glider in a thermal, the re-entry of the space shuttle, and a fighter's climb."""

from __future__ import annotations

import math

from ...models.optimal_control.model import OptimalControlProblem
from .benchmark import benchmark


@benchmark
def hang_glider(ocp: OptimalControlProblem) -> None:
    """Return the longest glide of a hang glider through a thermal, from 1000 m down to 900 m.

    The control is the lift coefficient (Bulirsch, Nerz, Pesch and von Stryk, "Combining direct and
    indirect methods in optimal control: range maximization of a hang glider", in "Optimal Control",
    Birkhäuser, 1993; problem 11 of COPS 3.0, 2004).
    """
    import casadi

    mass, area, density, gravity = 100.0, 14.0, 1.13, 9.80665
    phase = ocp.phase(time=(0, (60, 140)))
    x = phase.state("x", initial=0, lower=0, upper=1500, unit="m")
    y = phase.state("y", initial=1000, final=900, lower=800, upper=1100, unit="m")
    vx = phase.state("vx", initial=13.227567500, final=13.227567500, lower=5, upper=25, unit="m/s")
    vy = phase.state(
        "vy", initial=-1.2875005200, final=-1.2875005200, lower=-10, upper=10, unit="m/s"
    )
    lift_coefficient = phase.control("lift_coefficient", lower=0, upper=1.4)
    # The updraft is up to 2.5 m/s around x = 250 m.
    place = (x / 100 - 2.5) ** 2
    sink = vy - 2.5 * (1 - place) * casadi.exp(-place)
    speed = casadi.sqrt(vx**2 + sink**2)
    drag_coefficient = 0.034 + 0.069662 * lift_coefficient**2
    # Both forces divided by the speed, which turns with the relative wind.
    pressure = 0.5 * density * area * speed / mass
    lift, drag = pressure * lift_coefficient, pressure * drag_coefficient
    phase.dynamics(
        {x: vx, y: vy, vx: -lift * sink - drag * vx, vy: lift * vx - drag * sink - gravity}
    )
    phase.guess(time=[0, 100], x=[0, 1250], lift_coefficient=0.7)
    ocp.minimise(-phase.final(x), unit="m")


@benchmark
def shuttle_reentry(ocp: OptimalControlProblem) -> None:
    """Return the re-entry of the space shuttle with the largest cross range, without a heating limit.

    From 260 000 ft and 25 600 ft/s to 80 000 ft and 2500 ft/s over a round non-rotating Earth. The
    controls are angle of attack and bank angle, in feet and slugs (Betts, 2010, section 6.1:
    34.1412°).
    """
    import casadi

    degree = math.pi / 180
    radius, gravitation, mass, area = 20_902_900.0, 0.14076539e17, 203_000 / 32.174, 2690.0
    phase = ocp.phase(time=(0, (1000, 4000)))
    h = phase.state(
        "h", initial=260_000, final=80_000, lower=0, upper=300_000, scale=1e5, unit="ft"
    )
    latitude = phase.state(
        "latitude", initial=0, lower=-89 * degree, upper=89 * degree, scale=1, unit="rad"
    )
    v = phase.state(
        "v", initial=25_600, final=2500, lower=1000, upper=45_000, scale=1e4, unit="ft/s"
    )
    gamma = phase.state(
        "gamma", initial=-degree, final=-5 * degree, lower=-89 * degree, upper=89 * degree,
        scale=0.1, unit="rad",
    )  # fmt: skip
    azimuth = phase.state(
        "azimuth", initial=90 * degree, lower=-math.pi, upper=math.pi, scale=1, unit="rad"
    )
    attack = phase.control("attack", lower=-90 * degree, upper=90 * degree, scale=1, unit="rad")
    bank = phase.control("bank", lower=-89 * degree, upper=degree, scale=1, unit="rad")
    alpha = attack / degree
    density = 0.002378 * casadi.exp(-h / 23_800)
    pressure = 0.5 * density * area * v**2
    lift = pressure * (-0.20704 + 0.029244 * alpha)
    drag = pressure * (0.07854 - 0.61592e-2 * alpha + 0.621408e-3 * alpha**2)
    r = radius + h
    g = gravitation / r**2
    phase.dynamics(
        {
            h: v * casadi.sin(gamma),
            latitude: v / r * casadi.cos(gamma) * casadi.cos(azimuth),
            v: -drag / mass - g * casadi.sin(gamma),
            gamma: lift / (mass * v) * casadi.cos(bank) + casadi.cos(gamma) * (v / r - g / v),
            azimuth: lift * casadi.sin(bank) / (mass * v * casadi.cos(gamma))
            + v / r * casadi.cos(gamma) * casadi.sin(azimuth) * casadi.tan(latitude),
        }
    )
    phase.guess(
        time=[0, 2000], latitude=[0, 0.5], azimuth=[90 * degree, 10 * degree],
        attack=17 * degree, bank=[-75 * degree, 0],
    )  # fmt: skip
    ocp.minimise(-phase.final(latitude), unit="rad")


#: Thrust of a fighter's two engines in 1000 lbf, one row per Mach number 0, 0.2 … 1.8 and one column
#: per altitude in 1000 ft. Values missing in Bryson, Desai and Hoffman (1969) are from GPOPS-II, ICLOCS2.
ALTITUDES = (0, 5, 10, 15, 20, 25, 30, 40, 50, 70)
THRUSTS = (
    (24.2, 24.0, 20.3, 17.3, 14.5, 12.2, 10.2, 5.7, 3.4, 0.1),
    (28.0, 24.6, 21.1, 18.1, 15.2, 12.8, 10.7, 6.5, 3.9, 0.2),
    (28.3, 25.2, 21.9, 18.7, 15.9, 13.4, 11.2, 7.3, 4.4, 0.4),
    (30.8, 27.2, 23.8, 20.5, 17.3, 14.7, 12.3, 8.1, 4.9, 0.8),
    (34.5, 30.3, 26.6, 23.2, 19.8, 16.8, 14.1, 9.4, 5.6, 1.1),
    (37.9, 34.3, 30.4, 26.8, 23.3, 19.8, 16.8, 11.2, 6.8, 1.4),
    (36.1, 38.0, 34.9, 31.3, 27.3, 23.6, 20.1, 13.4, 8.3, 1.7),
    (36.1, 36.6, 38.5, 36.1, 31.6, 28.1, 24.2, 16.2, 10.0, 2.2),
    (36.1, 35.2, 42.1, 38.7, 35.7, 32.0, 28.1, 19.3, 11.9, 2.9),
    (36.1, 33.8, 45.7, 41.3, 39.8, 34.6, 31.1, 21.7, 13.3, 3.1),
)
#: Lift-curve slope, zero-lift drag and efficiency factor over the Mach number.
MACHS = (0, 0.4, 0.8, 0.9, 1.0, 1.2, 1.4, 1.6, 1.8)
LIFT_SLOPES = (3.44, 3.44, 3.44, 3.58, 4.44, 3.44, 3.01, 2.86, 2.44)
LEAST_DRAGS = (0.013, 0.013, 0.013, 0.014, 0.031, 0.041, 0.039, 0.036, 0.035)
EFFICIENCIES = (0.54, 0.54, 0.54, 0.75, 0.79, 0.78, 0.89, 0.93, 0.93)


@benchmark
def minimum_time_to_climb(ocp: OptimalControlProblem) -> None:
    """Return a supersonic fighter's fastest climb to 20 km and Mach 1.

    The optimum dives through the speed of sound (Bryson, Desai and Hoffman, "Energy-state
    approximation in performance optimization of supersonic aircraft", Journal of Aircraft 6, 1969).
    The air is the U.S. Standard Atmosphere of 1976. All tables are cubic splines, which determine the
    optimal time. The default guess is used.
    """
    import casadi
    import numpy as np

    from ...models.optimal_control.declaration.tables import table

    radius, gravitation, area, impulse, gas = 6_378_145.0, 3.986e14, 49.2386, 1600.0, 287.053
    gravity = 9.80665
    # Temperature falls up to 11 km, is constant, and rises from 20 km; pressure is hydrostatic.
    heights = np.linspace(-2000.0, 24_000.0, 53)
    warmth = np.interp(heights, [-2000, 11_000, 20_000, 32_000], [301.15, 216.65, 216.65, 228.65])
    steps = gravity / gas * np.diff(heights) * 0.5 * (1 / warmth[1:] + 1 / warmth[:-1])
    fall = np.concatenate([[0.0], np.cumsum(steps)])
    fall -= np.interp(0.0, heights, fall)
    densities = table(heights, math.log(101_325 / gas) - fall - np.log(warmth), name="air")
    sounds = table(heights, np.sqrt(1.4 * gas * warmth), name="sound")
    thrusts = table(
        (np.arange(10) / 5, 304.8 * np.array(ALTITUDES)),
        4448.222 * np.array(THRUSTS),
        name="thrust",
    )
    slopes, drags, efficiencies = (
        table(MACHS, values, name=name)
        for name, values in (
            ("slope", LIFT_SLOPES), ("drag", LEAST_DRAGS), ("efficiency", EFFICIENCIES),
        )
    )  # fmt: skip

    steep = math.radians(40)
    phase = ocp.phase(time=(0, (100, 800)))
    h = phase.state("h", initial=0, final=19_994.88, lower=0, upper=21_031.2, unit="m")
    v = phase.state("v", initial=129.314, final=295.092, lower=5, upper=530, unit="m/s")
    gamma = phase.state("gamma", initial=0, final=0, lower=-steep, upper=steep, unit="rad")
    mass = phase.state("mass", initial=19_050.864, lower=1000, upper=20_410, unit="kg")
    attack = phase.control("attack", lower=-math.pi / 4, upper=math.pi / 4, unit="rad")
    mach = v / sounds(h)
    push = thrusts(mach, h)
    pressure = 0.5 * area * casadi.exp(densities(h)) * v**2
    lift = pressure * slopes(mach) * attack
    drag = pressure * (drags(mach) + efficiencies(mach) * slopes(mach) * attack**2)
    r = radius + h
    weight = gravitation / r**2
    phase.dynamics(
        {
            h: v * casadi.sin(gamma),
            v: (push * casadi.cos(attack) - drag) / mass - weight * casadi.sin(gamma),
            gamma: (push * casadi.sin(attack) + lift) / (mass * v)
            + casadi.cos(gamma) * (v / r - weight / v),
            mass: -push / (gravity * impulse),
        }
    )
    ocp.minimise(phase.end, unit="s")
