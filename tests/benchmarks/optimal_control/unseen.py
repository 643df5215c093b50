"""Problems of the literature outside the catalogue, declared with defaults and without a guess.

Each has a value that is published or follows from a formula, and its relative accuracy `exact`.
A verified plan is correct if its objective is within `exact` of the value or slightly better. The problems show
how settings tuned on the catalogue perform on other problems.
"""

from __future__ import annotations

import math

import casadi
import numpy as np
from declared_problem import DeclaredProblem, Table
from scipy.optimize import brentq

__all__ = ["UNSEEN", "Unseen"]


UNSEEN = _unseen = Table()
Unseen = DeclaredProblem


# -- closed forms ----------------------------------------------------------------------------------


@_unseen(4e9, "4 w / (9 l)", name="bryson_denham_1e9", weight=1e9)
@_unseen(4e6, "4 w / (9 l)", name="bryson_denham_1e6", weight=1e6)
@_unseen(4e-6, "4 w / (9 l)", name="bryson_denham_1e-6", weight=1e-6)
@_unseen(4e-9, "4 w / (9 l)", name="bryson_denham_1e-9", weight=1e-9)
def bryson_denham(ocp, weight):
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=0, upper=1 / 9)
    v = phase.state("v", initial=1, final=-1)
    u = phase.control("u")
    phase.dynamics({x: v, v: u})
    ocp.minimise(weight * phase.integral(u**2 / 2))


@_unseen(2 * math.pi, "Brockett 1981: a circle of area 1/2, (2 sqrt(pi / 2))^2")
def brockett(ocp):
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=0)
    y = phase.state("y", initial=0, final=0)
    z = phase.state("z", initial=0, final=1)
    u, v = phase.control("u"), phase.control("v")
    phase.dynamics({x: u, y: v, z: x * v - y * u})
    ocp.minimise(phase.integral(u**2 + v**2))


@_unseen(30.0, "sqrt(2 d (1 / a + 1 / b)): GPOPS-II's double integrator with unequal bounds")
@_unseen(37.5, "the ramps, and the rest at the limit", name="car_speed_limit", limit=10.0)
def car(ocp, limit=math.inf):
    phase = ocp.phase(time=(0, (1, 200)))
    x = phase.state("x", initial=0, final=300)
    v = phase.state("v", initial=0, final=0, upper=limit)
    u = phase.control("u", lower=-2, upper=1)
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.end)


@_unseen(32 ** (1 / 3), "(32 d / j)^(1/3): quarter, half, quarter at full jerk")
def jerk_limit(ocp):
    phase = ocp.phase(time=(0, (0.1, 100)))
    x = phase.state("x", initial=0, final=1)
    v = phase.state("v", initial=0, final=0)
    a = phase.state("a", initial=0, final=0)
    j = phase.control("j", lower=-1, upper=1)
    phase.dynamics({x: v, v: a, a: j})
    ocp.minimise(phase.end)


@_unseen(1 / 6, "u = -1 until x = 0 at 1; Luus 2000, section 10.2.1")
def luus_singular(ocp):
    phase = ocp.phase(time=(0, 2))
    x = phase.state("x", initial=1)
    u = phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: u})
    ocp.minimise(phase.integral(x**2 / 2))


def _catenoid() -> float:
    c = brentq(lambda c: c * math.cosh(0.5 / c) - 1, 0.5, 2)
    return c / 2 * (1 + c * math.sinh(1 / c))


@_unseen(_catenoid(), "Euler: the catenary through both ends")
def catenoid(ocp):
    phase = ocp.phase(time=(0, 1))
    y = phase.state("y", initial=1, final=1, lower=0)
    slope = phase.control("slope")
    phase.dynamics({y: slope})
    ocp.minimise(phase.integral(y * casadi.sqrt(1 + slope**2)))


# -- singular arcs and chattering ------------------------------------------------------------------


@_unseen(0.7539839, "Jacobson, Gershwin, Lele 1970; Luus 2000, section 10.2.3", 1e-5)
def jacobson_singular(ocp):
    phase = ocp.phase(time=(0, 5))
    x = phase.state("x", initial=0)
    v = phase.state("v", initial=1)
    u = phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.integral(x**2 + v**2))


@_unseen(1.2521, "Luus 2000, section 10.2.4", 3e-4)
def luus_singular_third(ocp):
    phase = ocp.phase(time=(0, 5))
    x = phase.state("x", initial=1)
    v = phase.state("v", initial=0)
    a = phase.state("a", initial=0)
    u = phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: v, v: a, a: u})
    ocp.minimise(phase.integral(x**2))


@_unseen(1.5284e-5, "Fuller; Sager, mintoc.de, relaxed", 2e-3)
def fuller(ocp):
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0.01, final=0.01)
    v = phase.state("v", initial=0, final=0)
    u = phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: v, v: 1 - 2 * (1 + u) / 2})
    ocp.minimise(phase.integral(x**2))


@_unseen(1.34408, "Sager 2005, mintoc.de, relaxed", 1e-5)
def lotka_volterra(ocp):
    phase = ocp.phase(time=(0, 12))
    x = phase.state("x", initial=0.5)
    y = phase.state("y", initial=0.7)
    w = phase.control("w", lower=0, upper=1)
    phase.dynamics({x: x - x * y - 0.4 * x * w, y: -y + x * y - 0.2 * y * w})
    ocp.minimise(phase.integral((x - 1) ** 2 + (y - 1) ** 2))


@_unseen(7571.67158, "Ledzewicz, Schaettler 2008; Patterson, Rao 2014 (GPOPS-II)", 1e-6)
def tumor(ocp):
    grow, b, d, g, mu = 0.084, 5.85, 0.00873, 0.15, 0.02
    most = ((b - mu) / d) ** 1.5
    phase = ocp.phase(time=(0, (0.1, 5)))
    p = phase.state("p", initial=most / 2, lower=0.01, upper=most)
    q = phase.state("q", initial=most / 4, lower=0.01, upper=most)
    y = phase.state("y", initial=0, lower=0, upper=15)
    u = phase.control("u", lower=0, upper=75)
    phase.dynamics(
        {
            p: -grow * p * casadi.log(p / q),
            q: q * (b - mu - d * p ** (2 / 3) - g * u),
            y: u,
        }
    )
    ocp.minimise(phase.final(p))


# -- chemistry and biology -------------------------------------------------------------------------


@_unseen(-0.610802920554, "Pontryagin, shot with DOP853; printed 0.6107775 (Rajesh et al. 2001)")
def batch_reactor(ocp):
    phase = ocp.phase(time=(0, 1))
    a = phase.state("a", initial=1)
    b = phase.state("b", initial=0)
    T = phase.control("T", lower=298, upper=398)
    k1, k2 = 4000 * casadi.exp(-2500 / T), 620000 * casadi.exp(-5000 / T)
    phase.dynamics({a: -k1 * a**2, b: k1 * a**2 - k2 * b})
    ocp.minimise(-phase.final(b))


@_unseen(-0.57354505, "Ray 1981; Biegler 1984", 1e-6)
def tubular_reactor(ocp):
    phase = ocp.phase(time=(0, 1))
    a = phase.state("a", initial=1)
    b = phase.state("b", initial=0)
    u = phase.control("u", lower=0, upper=5)
    phase.dynamics({a: -(u + u**2 / 2) * a, b: u * a})
    ocp.minimise(-phase.final(b))


@_unseen(0.13309, "Kirk 1970; Luus 2000: 0.133094 (a local optimum has 0.24442)", 2e-4)
def stirred_tank(ocp):
    phase = ocp.phase(time=(0, 0.78))
    x = phase.state("x", initial=0.09)
    y = phase.state("y", initial=0.09)
    u = phase.control("u", lower=0, upper=5)
    r = (y + 0.5) * casadi.exp(25 * x / (x + 2))
    phase.dynamics({x: -(2 + u) * (x + 0.25) + r, y: 0.5 - y - r})
    ocp.minimise(phase.integral(x**2 + y**2 + 0.1 * u**2))


@_unseen(
    -21.8245, "Jensen 1964, Bojkov et al. 1993; value: Radau on 60 to 300 intervals agrees", 1e-5
)
def stirred_tank_eight(ocp):
    phase = ocp.phase(time=(0, 0.2))
    begin = [0.1883, 0.2507, 0.0467, 0.0899, 0.1804, 0.1394, 0.1046, 0]
    x1, x2, x3, x4, x5, x6, x7, x8 = (
        phase.state(f"x{k + 1}", initial=value) for k, value in enumerate(begin)
    )
    u1, u2, u3, u4 = (
        phase.control(f"u{k + 1}", lower=0, upper=top) for k, top in enumerate([20, 6, 4, 20])
    )
    q = u1 + u2 + u4
    gain = 5.8 * (q * x1 - u4) - 3.7 * u1 - 4.1 * u2
    gain += q * (23 * x4 + 11 * x5 + 28 * x6 + 35 * x7) - 5 * u3**2 - 0.099
    phase.dynamics(
        {
            x1: u4 - q * x1 - 17.6 * x1 * x2 - 23 * x1 * x6 * u3,
            x2: u1 - q * x2 - 17.6 * x1 * x2 - 146 * x2 * x3,
            x3: u2 - q * x3 - 73 * x2 * x3,
            x4: -q * x4 + 35.2 * x1 * x2 - 51.3 * x4 * x5,
            x5: -q * x5 + 219 * x2 * x3 - 51.3 * x4 * x5,
            x6: -q * x6 + 102.6 * x4 * x5 - 23 * x1 * x6 * u3,
            x7: -q * x7 + 46 * x1 * x6 * u3,
            x8: gain,
        }
    )
    ocp.minimise(-phase.final(x8))


@_unseen(-0.35382, "Wen, Yen 1977; Luus 2000: oil shale pyrolysis, 0.35382", 3e-5)
def oil_shale(ocp):
    a = np.exp([8.86, 24.25, 23.67, 18.75, 20.70])
    b = np.array([20300, 37400, 33800, 28200, 31000]) / 1.9872
    phase = ocp.phase(time=(0, (1, 20)))
    x1 = phase.state("x1", initial=1)
    x2 = phase.state("x2", initial=0)
    T = phase.control("T", lower=698.15, upper=748.15)
    k1, k2, k3, k4, k5 = (
        float(ai) * casadi.exp(-float(bi) / T) for ai, bi in zip(a, b, strict=True)
    )
    phase.dynamics({x1: -k1 * x1 - (k3 + k4 + k5) * x1 * x2, x2: k1 * x1 - k2 * x2 + k3 * x1 * x2})
    ocp.minimise(-phase.final(x2))


@_unseen(-6.15, "Lee, Ramirez 1994; Balsa-Canto et al. 2000: 6.15", 2e-3)
def lee_ramirez(ocp):
    phase = ocp.phase(time=(0, 10))
    begin = [1, 0.1, 40, 0, 0, 1, 0]
    x1, x2, x3, x4, x5, x6, x7 = (
        phase.state(f"x{k + 1}", initial=value, lower=0) for k, value in enumerate(begin)
    )
    u1, u2 = phase.control("u1", lower=0, upper=1), phase.control("u2", lower=0, upper=1)
    k = 0.09 * x5 / (0.034 + x5)
    feed = (u1 + u2) / x1
    eat = x3 / (14.35 + x3 * (1 + x3 / 111.5))
    grow = eat * (x6 + 0.22 / (0.22 + x5) * x7)
    make = 0.233 * eat * (0.0005 + x5) / (0.022 + x5)
    phase.dynamics(
        {
            x1: u1 + u2,
            x2: (grow - feed) * x2,
            x3: 100 * u1 / x1 - feed * x3 - grow * x2 / 0.51,
            x4: make * x2 - feed * x4,
            x5: 4 * u2 / x1 - feed * x5,
            x6: -k * x6,
            x7: k * (1 - x7),
        }
    )
    ocp.minimise(-phase.final(x1) * phase.final(x4))


@_unseen(-87.99, "Cuthrell, Biegler 1989; Banga et al. 2005: 87.99", 2e-3)
def penicillin(ocp):
    phase = ocp.phase(time=(0, (72, 200)))
    x = phase.state("x", initial=1.5, lower=0, upper=40)
    p = phase.state("p", initial=0, lower=0, upper=50)
    s = phase.state("s", initial=0, lower=0, upper=25)
    v = phase.state("v", initial=7, lower=0, upper=10)
    u = phase.control("u", lower=0, upper=50)
    h1 = 0.11 * s / (0.006 * x + s)
    h2 = 0.0055 * s / (0.0001 + s * (1 + 10 * s))
    phase.dynamics(
        {
            x: h1 * x - u * x / 500 / v,
            p: h2 * x - 0.01 * p - u * p / 500 / v,
            s: -h1 * x / 0.47 - h2 * x / 1.2 - x * 0.029 * s / (0.0001 + s) + u / v * (1 - s / 500),
            v: u / 500,
        }
    )
    ocp.minimise(-phase.final(p) * phase.final(v))


@_unseen(-29514.4477, "Joshi 2002; Betts 2010, section 6.17", 1e-6)
def hiv(ocp):
    phase = ocp.phase(time=(0, 50))
    T = phase.state("T", initial=400, lower=0, upper=1200)
    V = phase.state("V", initial=3, lower=0.05, upper=5)
    u1 = phase.control("u1", lower=0, upper=0.02)
    u2 = phase.control("u2", lower=0, upper=0.9)
    phase.dynamics(
        {
            T: 2 - 1.5 * V / (14 + V) - 0.002 * T - 2.5e-4 * V * T + u1 * T,
            V: 30 * V / (1 + V) * (1 - u2) - 0.007 * V * T,
        }
    )
    ocp.minimise(-phase.integral(T - 2.5e5 * u1**2 - 75 * u2**2))


@_unseen(5152.07310, "Jung, Lenhart, Feng 2002; Betts 2010: two strains of tuberculosis", 1e-6)
def tuberculosis(ocp):
    n, mu, r1, r2, p, q, k1, k2, beta, other = 30000, 0.0143, 2, 1, 0.4, 0.1, 0.5, 1, 13, 0.029
    phase = ocp.phase(time=(0, 5))
    S, T, L1, L2, I1, I2 = (
        phase.state(name, initial=share * n / 120, lower=0, upper=n)
        for name, share in zip(
            ["S", "T", "L1", "L2", "I1", "I2"], [76, 1, 36, 2, 4, 1], strict=True
        )
    )
    u1, u2 = (phase.control(name, lower=0.05, upper=0.95) for name in ("u1", "u2"))
    phase.dynamics(
        {
            S: mu * n - beta * S * I1 / n - other * S * I2 / n - mu * S,
            T: u1 * r1 * L1
            - mu * T
            + (1 - (1 - u2) * (p + q)) * r2 * I1
            - beta * T * I1 / n
            - other * T * I2 / n,
            L1: beta * S * I1 / n
            - (mu + k1) * L1
            - u1 * r1 * L1
            + (1 - u2) * p * r2 * I1
            + beta * T * I1 / n
            - other * L1 * I2 / n,
            L2: (1 - u2) * q * r2 * I1 - (mu + k2) * L2 + other * (S + L1 + T) * I2 / n,
            I1: k1 * L1 - mu * I1 - r2 * I1,
            I2: k2 * L2 - mu * I2,
        }
    )
    ocp.minimise(phase.integral(L2 + I2 + 25 * u1**2 + 250 * u2**2))


# -- constraints along the way ---------------------------------------------------------------------


@_unseen(2030.85609, "Betts 2010, section 4.12: alp rider", 1e-5)
def alp_rider(ocp):
    phase = ocp.phase(time=(0, 20))
    x = [
        phase.state(f"x{k}", initial=a, final=b)
        for k, (a, b) in enumerate(zip([2, 1, 2, 1], [2, 3, 1, -2], strict=True))
    ]
    u, v = phase.control("u"), phase.control("v")
    a, b, c, d = x
    phase.dynamics(
        {
            a: -10 * a + u + v,
            b: -2 * b + u + 2 * v,
            c: -3 * c + 5 * d + u - v,
            d: 5 * c - 3 * d + u + 3 * v,
        }
    )
    ground = sum(
        w * casadi.exp(-s * (phase.time - m) ** 2)
        for w, m, s in [(3, 3, 12), (3, 6, 10), (3, 10, 6), (8, 15, 4)]
    )
    square = sum(one**2 for one in x)
    phase.path(square - ground, lower=0.01)
    ocp.minimise(phase.integral(100 * square + 0.01 * (u**2 + v**2)))


@_unseen(0.16982645, "Jacobson, Lele 1969; Teo, Goh, Wong 1991", 1e-4)
def jacobson_lele(ocp):
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0)
    v = phase.state("v", initial=-1)
    u = phase.control("u")
    phase.dynamics({x: v, v: u - v})
    phase.path(v - 8 * (phase.time - 0.5) ** 2, upper=-0.5)
    ocp.minimise(phase.integral(x**2 + v**2 + 0.005 * u**2))


@_unseen(44.8044433, "Maurer, Augustin 2001: mixed constraint u + x / 6 <= 0", 1e-7)
def rayleigh_mixed(ocp):
    phase = ocp.phase(time=(0, 4.5))
    x = phase.state("x", initial=-5)
    v = phase.state("v", initial=-5)
    u = phase.control("u")
    phase.dynamics({x: v, v: -x + v * (1.4 - 0.14 * v**2) + 4 * u})
    phase.path(u + x / 6, upper=0)
    ocp.minimise(phase.integral(u**2 + x**2))


@_unseen(4.571044, "PROPT manual: two discs in the way; the value is the speed squared", 1e-5)
def obstacles(ocp):
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=1.2)
    y = phase.state("y", initial=0, final=1.6)
    heading = phase.control("heading")
    speed = 2.138
    u, v = speed * casadi.cos(heading), speed * casadi.sin(heading)
    phase.dynamics({x: u, y: v})
    phase.path((x - 0.4) ** 2 + (y - 0.5) ** 2, lower=0.1)
    phase.path((x - 0.8) ** 2 + (y - 1.5) ** 2, lower=0.1)
    ocp.minimise(phase.integral(u**2 + v**2))


# -- vehicles, robots, flight ----------------------------------------------------------------------


@_unseen(2.98, "Lee 1992; Luus 2000, section 12.4: two-link arm", 1.7e-3)
def two_link_arm(ocp):
    phase = ocp.phase(time=(0, (0.1, 10)))
    a = phase.state("a", initial=0, final=0)
    b = phase.state("b", initial=0, final=0)
    bend = phase.state("bend", initial=0.5, final=0.5)
    turn = phase.state("turn", initial=0, final=0.522)
    u, v = (phase.control(name, lower=-1, upper=1) for name in "uv")
    s, c = casadi.sin(bend), casadi.cos(bend)
    whole = 31 / 36 + 9 / 4 * s**2
    phase.dynamics(
        {
            a: (s * (9 / 4 * c * a**2 + 2 * b**2) + 4 / 3 * (u - v) - 3 / 2 * c * v) / whole,
            b: -(s * (7 / 2 * a**2 + 9 / 4 * c * b**2) - 7 / 3 * v + 3 / 2 * c * (u - v)) / whole,
            bend: b - a,
            turn: a,
        }
    )
    ocp.minimise(phase.end)


@_unseen(3.32, "the inverse of Bryson's orbit raising, whose radius the catalogue has", 1e-7)
def orbit_time(ocp):
    radius = 1.525277700649
    phase = ocp.phase(time=(0, (0.5, 10)))
    r = phase.state("r", initial=1, final=radius)
    u = phase.state("u", initial=0, final=0)
    v = phase.state("v", initial=1, final=radius**-0.5)
    angle = phase.control("angle")
    push = 0.1405 / (1 - 0.0749 * phase.time)
    phase.dynamics(
        {
            r: u,
            u: v**2 / r - 1 / r**2 + push * casadi.sin(angle),
            v: -u * v / r + push * casadi.cos(angle),
        }
    )
    ocp.minimise(phase.end)


@_unseen(3.78086, "Garrard, Jordan 1977; Sager, mintoc.de (Kaya, Noakes 2003: 5.74217)", 1e-5)
def f8_aircraft(ocp):
    phase = ocp.phase(time=(0, (0.1, 20)))
    a = phase.state("a", initial=0.4655, final=0)
    b = phase.state("b", initial=0, final=0)
    c = phase.state("c", initial=0, final=0)
    e = phase.control("e", lower=-0.05236, upper=0.05236)
    lift = -0.877 * a + c - 0.088 * a * c + 0.47 * a**2 - 0.019 * b**2 - a**2 * c + 3.846 * a**3
    lift += -0.215 * e + 0.28 * a**2 * e + 0.47 * a * e**2 + 0.63 * e**3
    pitch = -4.208 * a - 0.396 * c - 0.47 * a**2 - 3.564 * a**3
    pitch += -20.967 * e + 6.265 * a**2 * e + 46 * a * e**2 + 61.4 * e**3
    phase.dynamics({a: lift, b: c, c: pitch})
    ocp.minimise(phase.end)


@_unseen(3.09520, "Kaya, Noakes 2003: Van der Pol, (1, 1) to rest", 1e-5)
def van_der_pol_time(ocp):
    phase = ocp.phase(time=(0, (0.1, 20)))
    x = phase.state("x", initial=1, final=0)
    v = phase.state("v", initial=1, final=0)
    u = phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: v, v: -x + (1 - x**2) * v + u})
    ocp.minimise(phase.end)


@_unseen(28.630408, "Bai, Junkins 2009; Betts 2010, section 6.8: a rigid body by 150 degrees", 1e-6)
def reorientation(ocp):
    half = math.radians(75)
    phase = ocp.phase(time=(0, (1, 100)))
    w = phase.state("w", 3, initial=[0, 0, 0], final=[0, 0, 0])
    q = phase.state("q", 4, initial=[0, 0, 0, 1], final=[math.sin(half), 0, 0, math.cos(half)])
    u = phase.control("u", 3, lower=-50, upper=50)
    inertia = casadi.DM([5621, 4547, 2364])
    phase.dynamics(
        {
            w: (u - casadi.cross(w, inertia * w)) / inertia,
            q: casadi.vertcat(
                q[3] * w + casadi.cross(q[:3], w),
                -casadi.dot(q[:3], w),
            )
            / 2,
        }
    )
    ocp.minimise(phase.end)


@_unseen(-1.712316, "Bryson 1999; PSOPT manual: Bryson's maximum range, 1.712316", 2e-6)
def maximal_range(ocp):
    phase = ocp.phase(time=(0, 2))
    x = phase.state("x", initial=0)
    y = phase.state("y", initial=0, final=0.1)
    v = phase.state("v", initial=0)
    a, b = phase.control("a"), phase.control("b")
    phase.dynamics({x: v * a, y: v * b, v: 0.5 - b})
    phase.path(a**2 + b**2, equals=1)
    ocp.minimise(-phase.final(x))


@_unseen(11.158158715164, "Pontryagin's conditions, shot with DOP853; the best of 60 starts", 1e-7)
def unicycle(ocp):
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=0)
    y = phase.state("y", initial=0, final=1)
    heading = phase.state("heading", initial=0, final=0)
    v, w = phase.control("v"), phase.control("w")
    phase.dynamics({x: v * casadi.cos(heading), y: v * casadi.sin(heading), heading: w})
    ocp.minimise(phase.integral(v**2 + w**2))


@_unseen(
    None,
    "statement: arXiv 2303.16746; no value is published, a verified plan counts",
    1e-4,
    name="truck_trailer_100",
    longest=100,
)
@_unseen(
    None,
    "statement: arXiv 2303.16746; no value is published, a verified plan counts",
    1e-4,
    name="truck_trailer_200",
    longest=200,
)
def truck_trailer(ocp, longest):
    phase = ocp.phase(time=(0, (1, longest)))
    x = phase.state("x", initial=0, final=0)
    y = phase.state("y", initial=0, final=-2)
    a0, a1, a2 = (phase.state(f"a{k}", initial=0, final=math.pi / 2) for k in range(3))
    v = phase.control("v", lower=-0.2, upper=0.2)
    steer = phase.control("steer", lower=-math.pi / 6, upper=math.pi / 6)
    near, far = a0 - a1, a1 - a2
    turn0 = v / 0.4 * casadi.tan(steer)
    turn1 = v / 1.1 * casadi.sin(near) - 0.1 / 1.1 * casadi.cos(near) * turn0
    v1 = v * casadi.cos(near) + 0.1 * casadi.sin(near) * turn0
    turn2 = v1 / 0.8 * casadi.sin(far) - 0.2 / 0.8 * casadi.cos(far) * turn1
    v2 = v1 * casadi.cos(far) + 0.2 * casadi.sin(far) * turn1
    phase.dynamics(
        {x: v2 * casadi.cos(a2), y: v2 * casadi.sin(a2), a0: turn0, a1: turn1, a2: turn2}
    )
    phase.path(near, lower=-math.pi / 2, upper=math.pi / 2)
    phase.path(far, lower=-math.pi / 2, upper=math.pi / 2)
    ocp.minimise(phase.end)
