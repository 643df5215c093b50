"""Flight in air: a glider in a thermal, and the space shuttle's return."""

from __future__ import annotations

import math

from ...models.optimal_control.model import OptimalControlProblem
from .benchmark import benchmark

__all__ = ["hang_glider", "shuttle_reentry"]


@benchmark
def hang_glider(ocp: OptimalControlProblem) -> None:
    """Return the longest glide of a hang glider through a thermal, from 1000 m down to 900 m.

    Sought is the lift coefficient (Bulirsch, Nerz, Pesch and von Stryk, "Combining direct and
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
    # The thermal blows up to 2.5 m/s around x = 250 m.
    place = (x / 100 - 2.5) ** 2
    sink = vy - 2.5 * (1 - place) * casadi.exp(-place)
    speed = casadi.sqrt(vx**2 + sink**2)
    drag_coefficient = 0.034 + 0.069662 * lift_coefficient**2
    # Both forces over the speed, which turns with the relative wind.
    pressure = 0.5 * density * area * speed / mass
    lift, drag = pressure * lift_coefficient, pressure * drag_coefficient
    phase.dynamics(
        {
            x: vx,
            y: vy,
            vx: -lift * sink - drag * vx,
            vy: lift * vx - drag * sink - gravity,
        }
    )
    phase.guess(time=[0, 100], x=[0, 1250], lift_coefficient=0.7)
    ocp.minimise(-phase.final(x), unit="m")


@benchmark
def shuttle_reentry(ocp: OptimalControlProblem) -> None:
    """Return the space shuttle's return with the largest cross range, without a limit of heating.

    From 260 000 ft and 25 600 ft/s to 80 000 ft and 2500 ft/s over a round Earth at rest, by angle
    of attack and bank angle, in feet and slugs (Betts, 2010, section 6.1: 34.1412°).
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
