"""Aircraft, missiles, gliding and re-entry."""

from __future__ import annotations

import math

import casadi
import numpy as np

from .table import FINE, PUBLISHED as _published

_BASELINE = "PSOPT manual, tools/regression_baselines_all.json"


@_published(
    40.911940,
    f"Subchan, Zbikowski 2009: terminal burn; statement: PSOPT, examples/missile; {FINE}",
    1e-6,
)
def missile_terminal_burn(ocp):
    m, g, area = 1005.0, 9.81, 0.3376  # kg, m/s^2, m^2
    phase = ocp.phase(time=(0, (10, 100)))
    gamma = phase.state(
        "gamma", initial=0, final=-math.pi / 2, lower=-math.pi / 2, upper=math.pi / 2
    )
    v = phase.state("v", initial=272, final=310, lower=200, upper=310, unit="m/s")
    x = phase.state("x", initial=0, final=10000, lower=0, upper=10000, unit="m")
    h = phase.state("h", initial=30, final=0, lower=0, upper=1900, unit="m")
    thrust = phase.control("thrust", lower=1000, upper=6000, unit="N")
    alpha = phase.control("alpha", lower=-0.3, upper=0.3)
    pressure = (3.312e-9 * h**2 - 1.142e-4 * h + 1.224) * v**2 * area / 2
    drag = (-1.9431 * alpha**2 - 0.1499 * alpha + 0.2359) * pressure
    lift = 21.9 * alpha * pressure
    s, c = casadi.sin(alpha), casadi.cos(alpha)
    phase.dynamics(
        {
            gamma: ((thrust - drag) * s + lift * c) / (m * v) - g * casadi.cos(gamma) / v,
            v: ((thrust - drag) * c - lift * s) / m - g * casadi.sin(gamma),
            x: v * casadi.cos(gamma),
            h: v * casadi.sin(gamma),
        }
    )
    near = (1 + casadi.tanh((7500 - x) / 10)) / 2
    phase.path(lift / (m * g), lower=-4, upper=4)
    phase.path(h - 30 * near, lower=0, upper=1900)
    phase.guess(time=(0, 50), thrust=6000.0)
    ocp.minimise(phase.end)


@_published(
    5549.6819,
    "PSOPT, examples/geodesic: 5549.6819 km is the exact geodesic; here in parametric latitude",
    1e-6,
)
def geodesic(ocp):
    a, b, speed = 6384.0, 6353.0, 900.0  # km, km, km/h
    begin = math.radians(90 - 40.6413), math.radians(360 - 73.7781)
    end = math.radians(90 - 51.47), math.radians(360 - 0.4543)
    phase = ocp.phase(time=(0, (3, 10)))
    theta = phase.state("theta", initial=begin[0], final=end[0], lower=0, upper=math.pi)
    phi = phase.state("phi", initial=begin[1], final=end[1], lower=0, upper=2 * math.pi)
    heading = phase.control("heading")
    s, c = casadi.sin(theta), casadi.cos(theta)
    phase.dynamics(
        {
            theta: -speed * casadi.cos(heading) / casadi.sqrt((a * c) ** 2 + (b * s) ** 2),
            phi: speed * casadi.sin(heading) / (a * s),
        }
    )
    ocp.minimise(speed * phase.end)


@_published(
    0.0635870,
    f"Zhao 2004; statement and guess: yapss, examples/dynamic_soaring; {FINE}",
    1e-5,
)
def dynamic_soaring(ocp):
    g, rho, m, area = 32.2, 0.002378, 5.6, 45.09703  # ft, slug, s
    full = 2 * math.pi
    phase = ocp.phase(time=(0, (10, 30)))
    x = phase.state("x", initial=0, final=0, lower=-1500, upper=1500, unit="ft")
    y = phase.state("y", initial=0, final=0, lower=-1000, upper=1000, unit="ft")
    h = phase.state("h", initial=0, final=0, lower=0, upper=1000, unit="ft")
    v = phase.state("v", lower=10, upper=350, unit="ft/s")
    gamma = phase.state("gamma", lower=-math.radians(75), upper=math.radians(75))
    psi = phase.state("psi", lower=-math.radians(225), upper=math.radians(225))
    lift = phase.control("lift", lower=0, upper=1.5)
    phi = phase.control("phi", lower=-math.radians(75), upper=math.radians(75))
    shear = ocp.parameter("shear", guess=0.08)
    pressure = rho * v**2 / 2 * area
    up, drag = pressure * lift, pressure * (0.00873 + 0.045 * lift**2)
    climb = v * casadi.sin(gamma)
    gust = shear * climb
    cg, sg, cp, sp = casadi.cos(gamma), casadi.sin(gamma), casadi.cos(psi), casadi.sin(psi)
    phase.dynamics(
        {
            x: v * cg * sp + shear * h,
            y: v * cg * cp,
            h: climb,
            v: -drag / m - g * sg - gust * cg * sp,
            gamma: (up * casadi.cos(phi) - m * g * cg + m * gust * sg * sp) / (m * v),
            psi: (up * casadi.sin(phi) - m * gust * cp) / (m * v * cg),
        }
    )
    phase.path(up / (m * g), lower=-2, upper=5)
    for state, turn in ((v, 0), (gamma, 0), (psi, full)):
        ocp.subject_to(phase.final(state) - phase.initial(state), equals=turn)
    phase.guess(
        time=(0, 24),
        x=lambda t: 600 * (math.cos(full * t / 24) - 1),
        y=lambda t: -200 * math.sin(full * t / 24),
        h=lambda t: -420 * (math.cos(full * t / 24) - 1),
        v=150.0,
        gamma=0.0,
        psi=lambda t: full * t / 24,
        lift=0.5,
        phi=math.radians(45),
    )
    ocp.minimise(shear)


@_published(
    -22043.5079,
    "Betts 2010, 10.3: aero-assisted plane change; statement and guess: maptor, examples",
    1e-6,
)
def plane_change(ocp):
    earth, m, rho0, h0, hr = 2.092643e7, 3.315e2, 3.3195e-5, 1e5, 2.41388e4  # ft, slug
    cd0, k, area, mu = 0.032, 1.4, 1.2584e2, 1.40895e16
    rad = math.pi / 180
    a0, a1 = area / (2 * m) * math.sqrt(cd0 / k), cd0 * area / (2 * m)
    phase = ocp.phase(time=(0, (800, 2000)))
    phi = phase.state("phi", initial=0, lower=-89 * rad, upper=89 * rad)
    h = phase.state("h", initial=365000, final=365000, lower=0, upper=400000, unit="ft")
    v = phase.state("v", initial=25745.704, lower=20000, upper=28000, unit="ft/s")
    gamma = phase.state("gamma", initial=-0.55 * rad, lower=-10 * rad, upper=10 * rad)
    psi = phase.state("psi", initial=0, lower=-89 * rad, upper=89 * rad)
    lift = phase.control("lift", lower=0, upper=2)
    bank = phase.control("bank", lower=0, upper=math.pi)
    r, rho = earth + h, rho0 * casadi.exp(-(h - h0) / hr)
    cg, sg = casadi.cos(gamma), casadi.sin(gamma)
    press = a0 * rho * v
    phase.dynamics(
        {
            phi: v / r * cg * casadi.sin(psi),
            h: v * sg,
            v: -a1 * rho * v**2 * (1 + lift**2) - mu * sg / r**2,
            gamma: press * lift * casadi.cos(bank) + v / r * (1 - mu / (r * v**2)) * cg,
            psi: press * lift * casadi.sin(bank) / cg
            - v / r * cg * casadi.cos(psi) * casadi.tan(phi),
        }
    )
    sea = rho0 * math.exp(h0 / hr)
    heat = 17600 * casadi.sqrt(rho / sea) * (v / math.sqrt(mu / earth)) ** 3.15
    phase.path(heat, upper=800)
    turned = casadi.cos(phase.final(phi)) * casadi.cos(phase.final(psi))
    ocp.subject_to(turned, equals=math.cos(18 * rad))
    phase.guess(
        time=(0, 800),
        v=25715.704,
        gamma=np.array([-0.55 * rad, 0]),
        psi=np.array([0, 18 * rad]),
        lift=1.0,
        bank=45 * rad,
    )
    ocp.minimise(-phase.final(v))


@_published(
    2197,
    "dymos, examples/balanced_field: balanced field length in m, test value within 1 %; its guess",
    1e-2,
)
def balanced_field(ocp):
    pound, g, rho, area = 0.45359237, 9.80665, 1.225, 124.7
    m, one = 174200 * pound, 27000 * pound * g  # kg, N per engine
    span, stall = 35.7, math.radians(10)
    foot = 0.3048
    v_stall = math.sqrt(2 * m * g / (rho * area * 2.0))

    def forces(v, h, alpha):
        lift = 0.5 + alpha / stall * 1.5
        ground = 33 * ((h + 1) / (span / 2)) ** 1.5
        k = ground / (1 + ground) / (math.pi * 9.45 * 0.801)
        pressure = rho * v**2 / 2 * area
        return pressure * lift, pressure * (0.03 + k * lift**2)

    def roll(name, start, end, thrust, friction, guess, alpha=None):
        phase = ocp.phase(name, time=(start, end))
        first = 0 if name == "accelerate" else None
        r = phase.state("r", initial=first, lower=0, unit="m")
        v = phase.state("v", initial=None if first is None else 1e-4, lower=0, unit="m/s")
        rates = {}
        angle = 0.0
        if alpha is not None:  # the angle of attack rises linearly from 0
            angle = phase.state("alpha", initial=0, lower=0, upper=stall)
            rates[angle] = alpha
        lift, drag = forces(v, 0.0, angle)
        load = m * g - lift * casadi.cos(angle) - thrust * casadi.sin(angle)
        rates |= {r: v, v: (thrust * casadi.cos(angle) - drag - load * friction) / m}
        phase.dynamics(rates)
        phase.guess(**guess)
        return phase, r, v, angle, load

    anytime = (1, 1000)
    line = np.array
    accelerate, *_ = roll(
        "accelerate", 0, anytime, 2 * one, 0.03,
        {"time": (0, 35), "r": line([0, 2500.0]), "v": line([1e-4, 100.0])},
    )  # fmt: skip
    stop, r_stop, v_stop, *_ = roll(
        "stop", anytime, anytime, 0.0, 0.3,
        {"time": (35, 36), "r": line([2500, 5000.0]), "v": line([110, 1e-4])},
    )  # fmt: skip
    go, _, v_go, *_ = roll(
        "go", anytime, anytime, one, 0.03,
        {"time": (35, 70), "r": line([2500, 300.0]), "v": line([100, 110.0])},
    )  # fmt: skip
    rate = ocp.parameter("rate", lower=0, guess=0.0)
    rotate, _, _, _, load = roll(
        "rotate", anytime, anytime, one, 0.03,
        {"time": (35, 40), "r": line([1750, 1800.0]), "v": line([80, 85.0]), "alpha": 0.0}, rate,
    )  # fmt: skip
    climb = ocp.phase("climb", time=(anytime, anytime))
    r = climb.state("r", lower=0, unit="m")
    v = climb.state("v", lower=0, unit="m/s")
    h = climb.state("h", initial=0, final=35 * foot, lower=0, unit="m")
    gamma = climb.state("gamma", initial=0, final=math.radians(5), lower=0, upper=math.radians(5))
    alpha = climb.control("alpha", lower=-stall, upper=math.radians(15))
    lift, drag = forces(v, h, alpha)
    c, s = casadi.cos(gamma), casadi.sin(gamma)
    climb.dynamics(
        {
            r: v * c,
            v: (one * casadi.cos(alpha) - drag) / m - g * s,
            h: v * s,
            gamma: (one * casadi.sin(alpha) + lift) / (m * v) - g / v * c,
        }
    )
    climb.guess(
        time=(30, 50),
        r=line([5000, 5500]) * foot,
        v=line([160, 170]) * 0.514444,
        h=line([0, 35 * foot]),
        gamma=line([0, math.radians(5)]),
        alpha=math.radians(5),
    )
    for first, second in ((accelerate, stop), (accelerate, go), (go, rotate), (rotate, climb)):
        ocp.link(first, second, "r", "v")
    for phase, low, high in (
        (stop, 1, 1000), (go, 1, 1000), (rotate, 1, 5), (climb, 1, 100)
    ):  # fmt: skip
        ocp.subject_to(phase.duration, lower=low, upper=high)
    ocp.subject_to(stop.final(v_stop), equals=0)
    ocp.subject_to(go.final(v_go) / v_stall, lower=1.2)
    ocp.subject_to(rotate.final(load) / (m * g), equals=0)
    ocp.subject_to(climb.final(v) / v_stall, lower=1.25)
    ocp.subject_to(stop.final(r_stop) - climb.final(r), equals=0)
    ocp.minimise(stop.final(r_stop))
