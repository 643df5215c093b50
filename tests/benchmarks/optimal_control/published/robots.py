"""Robots, thrusters and swimmers."""

from __future__ import annotations

import math

import casadi
import numpy as np

from .table import FINE, PUBLISHED as _published

_CT = "control-toolbox/CTDirect.jl, test/problems"

# Coefficients of the swimmer: factor, multiple of the first angle, sign of the orientation, multiple
# of the third angle.
_DRAG = [
    (543, 0, 0), (186, 1, 0), (37, 2, 0), (12, 1, -2), (30, 1, -1), (2, 2, -2), (12, 2, -1),
    (186, 0, 1), (37, 0, 2), (-6, 1, 1), (-3, 2, 2), (-6, 2, 1), (-6, 1, 2),
]  # fmt: skip
_FRONT = [
    (-42, 1, -1, 0), (-2, 2, -1, 0), (-24, 0, 1, 0), (-300, 1, 1, 0), (-12, 2, 1, 0),
    (-6, 1, -1, -2), (-1, 2, -1, -2), (4, 0, 1, -2), (-12, 1, 1, -2), (-1, 2, 1, -2),
    (18, 1, -1, -1), (8, 0, 1, -1), (-54, 1, 1, -1), (-2, 2, 1, -1), (-18, 1, -1, 1),
    (-38, 0, 1, 1), (-90, 1, 1, 1), (-6, 1, -1, 2), (-18, 0, 1, 2), (-30, 1, 1, 2),
]  # fmt: skip
_REAR = [
    (8, 1, -1, 0), (4, 2, -1, 0), (24, 0, 1, 0), (38, 1, 1, 0), (18, 2, 1, 0), (-2, 1, -1, -2),
    (-1, 2, -1, -2), (-2, 0, 1, -2), (-1, 2, 1, -2), (-54, 1, -1, -1), (-12, 2, -1, -1),
    (-42, 0, 1, -1), (18, 1, 1, -1), (-6, 2, 1, -1), (18, 1, -1, 1), (6, 2, -1, 1),
    (300, 0, 1, 1), (90, 1, 1, 1), (30, 2, 1, 1), (12, 0, 1, 2),
]  # fmt: skip
_TURN = [
    [(105, 0, 0), (186, 1, 0), (2, 2, 0), (12, 1, -2), (30, 1, -1), (1, 2, -2), (-4, 0, 2),
     (-6, 1, 1), (-6, 1, 2)],
    [(105, 0, 0), (-4, 2, 0), (30, 1, -1), (1, 2, -2), (12, 2, -1), (186, 0, 1), (2, 0, 2),
     (-6, 1, 1), (-6, 2, 1)],
]  # fmt: skip


@_published(-0.984273, f"Alouges et al. 2013; Bocop; {_CT}/swimmer.jl: three rods, 25 s", 1e-3)
def swimmer(ocp):
    phase = ocp.phase(time=(0, 25))
    x = phase.state("x", initial=0)
    y = phase.state("y", initial=0, final=0)
    th = phase.state("th", initial=(-3.15, 0), lower=-3.15, upper=3.15)
    a = phase.state("a", initial=(0, 1.5), lower=-1.5, upper=1.5)
    b = phase.state("b", lower=-1.5, upper=1.5)
    u, w = (phase.control(name, lower=-1, upper=1) for name in "uw")
    c, s = casadi.cos, casadi.sin
    drag = sum(f * c(i * a + j * b) for f, i, j in _DRAG)
    along, across, turn = 0, 0, 0
    for control, rows, spin in zip((u, w), (_FRONT, _REAR), _TURN, strict=True):
        along += control * sum(f * s(i * a + k * th + j * b) for f, i, k, j in rows) / 4
        across += control * sum(-k * f * c(i * a + k * th + j * b) for f, i, k, j in rows) / 4
        turn -= control * sum(f * c(i * a + j * b) for f, i, j in spin) / 2
    phase.dynamics({x: along / drag, y: across / drag, th: turn / drag, a: u, b: w})
    ocp.minimise(-phase.final(x))


@_published(
    2.87067,
    "Spong 1995; statement and guess of the time: maptor, examples/acrobot. Value: best of several"
    " starts, Radau and Gauss collocation",
    1e-5,
)
def acrobot(ocp):
    g, half, third = 9.81, 0.5, 1 / 3
    phase = ocp.phase(time=(0, (1e-2, 100)))
    a = phase.state("a", initial=math.pi / 6, final=math.pi)
    b = phase.state("b", initial=0, final=0)
    v = phase.state("v", initial=0, final=0)
    w = phase.state("w", initial=0, final=0)
    torque = phase.control("torque", lower=-20, upper=20)
    s, c = casadi.sin(b), casadi.cos(b)
    m11, m12, m22 = 2 * third + 1 + c, third + half * c, third
    f1 = -g * (1.5 * casadi.sin(a) + half * casadi.sin(a + b)) + half * (2 * v + w) * s * w
    f2 = torque - g * half * casadi.sin(a + b) - half * s * v**2
    whole = m11 * m22 - m12**2
    phase.dynamics({a: v, b: w, v: (m22 * f1 - m12 * f2) / whole, w: (m11 * f2 - m12 * f1) / whole})
    phase.guess(time=(0, 10))
    ocp.minimise(phase.end + 0.01 * phase.integral(torque**2))


@_published(0.961802, f"{_CT}/moonlander.jl: two thrusters, printed 0.962; its guess; {FINE}", 1e-5)
def two_thrusters(ocp):
    g = 9.81
    phase = ocp.phase(time=(0, (0.1, 100)))
    x = phase.state("x", initial=0, final=5)
    y = phase.state("y", initial=0, final=5)
    v = phase.state("v", initial=0, final=0)
    w = phase.state("w", initial=0, final=0)
    th = phase.state("th", initial=0)
    spin = phase.state("spin", initial=0)
    left, right = (phase.control(name, lower=0, upper=2 * g) for name in ("left", "right"))
    total = left + right
    phase.dynamics(
        {
            x: v,
            y: w,
            v: -total * casadi.sin(th),
            w: total * casadi.cos(th) - g,
            th: spin,
            spin: 5 * (right - left),
        }
    )
    phase.guess(left=5.0, right=5.0)
    ocp.minimise(phase.end)


@_published(1.492144, f"{_CT}/quadrotor.jl, printed 1.492: a limited tilt; its guess; {FINE}", 1e-5)
def quadrotor_tilt(ocp):
    phase = ocp.phase(time=(0, (0.1, 100)))
    p = phase.state("p", 3, initial=[0, 0, 2.5], final=[0.01, 5, 2.5])
    v = phase.state("v", 3, initial=[0, 0, 0], final=[0, 0, 0])
    roll, pitch = (
        phase.state(name, initial=0, lower=-math.pi / 2, upper=math.pi / 2)
        for name in ("roll", "pitch")
    )
    thrust = phase.control("thrust", lower=0, upper=9.18 * 5)
    roll_rate, pitch_rate = (
        phase.control(name, lower=-3, upper=3) for name in ("roll_rate", "pitch_rate")
    )
    yaw = phase.control("yaw")
    cr, sr, cp, sp = casadi.cos(roll), casadi.sin(roll), casadi.cos(pitch), casadi.sin(pitch)
    cy, sy = casadi.cos(yaw), casadi.sin(yaw)
    up = casadi.vertcat(cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr)
    phase.dynamics(
        {p: v, v: thrust * up - casadi.DM([0, 0, 9.81]), roll: roll_rate, pitch: pitch_rate}
    )
    phase.path(cp * cr, lower=math.cos(0.55))
    phase.guess(thrust=10.0)
    effort = 1e-8 * (roll**2 + pitch**2 + yaw**2 + thrust**2) + 100 * yaw**2
    ocp.minimise(phase.end + phase.integral(effort))


@_published(
    1831.616, f"Graichen, Petit 2009; OptimalControlProblems.jl, printed 1831.8277; {FINE}", 1e-5
)
def ducted_fan(ocp):
    m, weight, tilt = 2.2, 4.0, math.radians(30)  # kg, N, rad
    phase = ocp.phase(time=(0, (1e-2, 100)))
    x = phase.state("x", initial=0, final=1)
    v = phase.state("v", initial=0, final=0)
    y = phase.state("y", initial=0, final=0)
    w = phase.state("w", initial=0, final=0)
    th = phase.state("th", initial=0, final=0, lower=-tilt, upper=tilt)
    spin = phase.state("spin", initial=0, final=0)
    side = phase.control("side", lower=-5, upper=5)
    lift = phase.control("lift", lower=0, upper=17)
    s, c = casadi.sin(th), casadi.cos(th)
    phase.dynamics(
        {
            x: v,
            v: (side * c - lift * s) / m,
            y: w,
            w: (side * s + lift * c - weight) / m,
            th: spin,
            spin: 4 * side,
        }
    )
    ocp.minimise(phase.integral(2 * side**2 + lift**2) / phase.duration + 1000 * phase.end)


def _elbow(x: float, y: float, reach: float = 0.4) -> tuple[float, float]:
    """Return the joint angles of two links with the base link above the ground."""
    bend = math.acos((x**2 + y**2 - 2 * reach**2) / (2 * reach**2))
    for q2 in (bend, -bend):
        q1 = math.atan2(y, x) - math.atan2(math.sin(q2), 1 + math.cos(q2))
        if q1 >= 0:
            return q1, q2
    raise ValueError(f"target ({x:g}, {y:g}) needs a base link below the ground")


@_published(
    12.8821,
    "maptor, examples/manipulator_2dof: motors and motion together, printed torques 60.7 and 26.9."
    " Value: Radau collocation, 300 intervals",
    1e-4,
)
def manipulator_design(ocp):
    m1, m2, load, g = 2.0, 1.5, 5.0, 9.81  # kg, kg, kg, m/s^2
    reach, mid = 0.4, 0.2
    i1, i2 = m1 * reach**2 / 12, m2 * reach**2 / 12
    (a1, a2), (b1, b2) = _elbow(0.3, 0.1), _elbow(-0.6, 0.1)
    phase = ocp.phase(time=(0, (0.1, 100)))
    q1 = phase.state("q1", initial=a1, final=b1, lower=0, upper=math.pi)
    q2 = phase.state("q2", initial=a2, final=b2, lower=-math.pi, upper=math.pi)
    v1, v2 = (phase.state(f"v{k}", initial=0, final=0, lower=-2, upper=2) for k in (1, 2))
    t1, t2 = phase.control("t1"), phase.control("t2")
    most1, most2 = (ocp.parameter(f"most{k}", lower=5, upper=100, guess=50) for k in (1, 2))
    s, c = casadi.sin(q2), casadi.cos(q2)
    cross = m2 * reach * mid
    m11 = i1 + i2 + m1 * mid**2 + m2 * (reach**2 + mid**2) + 2 * cross * c
    m12, m22 = i2 + m2 * mid**2 + cross * c, i2 + m2 * mid**2
    low, high = casadi.cos(q1), casadi.cos(q1 + q2)
    outer = -g * (load * reach + m2 * mid) * high
    f1 = t1 + outer - g * (m2 * reach + load * reach + m1 * mid) * low
    f1 += cross * (2 * v1 + v2) * s * v2
    f2 = t2 + outer - cross * s * v1**2
    whole = m11 * m22 - m12**2
    phase.dynamics(
        {
            q1: v1,
            q2: v2,
            v1: (m22 * f1 - m12 * f2) / whole,
            v2: (m11 * f2 - m12 * f1) / whole,
        }
    )
    phase.path(reach * (casadi.sin(q1) + casadi.sin(q1 + q2)), lower=0.05)
    for torque, most in ((t1, most1), (t2, most2)):
        phase.path(torque - most, upper=0)
        phase.path(torque + most, lower=0)
    phase.guess(time=(0, 4), t1=2.0, t2=2.0)
    motors = 0.008 * most1 + 0.005 * most2
    ocp.minimise(phase.end + motors + 0.01 * phase.integral(t1**2 + t2**2))


@_published(
    28.630408,
    "Bai, Junkins 2009; Betts 2010, section 6.8; PSOPT manual: the fourth quaternion is algebraic",
    1e-6,
)
def reorientation_algebraic(ocp):
    half = math.radians(75)
    phase = ocp.phase(time=(0, (1, 100)))
    q = phase.state("q", 3, initial=[0, 0, 0], final=[math.sin(half), 0, 0], lower=-1.1, upper=1.1)
    w = phase.state("w", 3, initial=[0, 0, 0], final=[0, 0, 0])
    u = phase.control("u", 3, lower=-50, upper=50)
    last = phase.control("last", lower=-1.1, upper=1.1)
    inertia = casadi.DM([5621, 4547, 2364])
    phase.dynamics(
        {q: (last * w + casadi.cross(q, w)) / 2, w: (u - casadi.cross(w, inertia * w)) / inertia}
    )
    phase.path(casadi.sumsqr(q) + last**2, equals=1)
    phase.guess(last=np.cos(np.linspace(0, half, 11)), time=np.linspace(0, 50, 11))
    ocp.minimise(phase.end)


def _orbit_rate(q, n=1.1475e-3):
    """Return the body rates (rad/s) that follow the orbit at attitude `q`."""
    q1, q2, q3, q4 = (q[k] for k in range(4))
    return [
        -n * 2 * (q2 * q3 + q1 * q4),
        -n * (1 - 2 * (q2**2 + q4**2)),
        -n * 2 * (q3 * q4 - q1 * q2),
    ]


def _spin_matrix(q):
    q1, q2, q3, q4 = (q[k] for k in range(4))
    rows = [[-q2, -q3, -q4], [q1, -q4, q3], [q4, q1, -q2], [-q3, q2, q1]]
    return casadi.vertcat(*(casadi.horzcat(*row) for row in rows))


@_published(
    6680106.0,
    "Bhatt 2007: zero-propellant manoeuvre of the space station, 7200 s; PSOPT,"
    " tools/regression_baselines_all.json, 60 nodes; norms are exactly 1 here, within 2e-4 there",
    1e-4,
)
def zero_propellant(ocp):
    n, most = 1.1475e-3, 3 * 3600.0  # rad/s, ft lbf s
    inertia = np.array(
        [
            [18836544.0, 3666370, 2965301],
            [3666370, 27984088, -1129004],
            [2965301, -1129004, 39442649],
        ]
    )
    begin, end = [0.98996, 0.02650, -0.07891, 0.11422], [0.70531, -0.06201, -0.03518, -0.70531]
    phase = ocp.phase(time=(0, 7200))
    near = 1e-4
    ranges = [(np.array(q) - near, np.array(q) + near) for q in (begin, end)]
    q = phase.state(
        "q",
        4,
        initial=ranges[0],
        final=ranges[1],
        lower=[-1, -0.2, -0.2, -1],
        upper=[1, 0.2, 0.2, 1],
    )
    w = phase.state(
        "w", 3, initial=_orbit_rate(begin), final=_orbit_rate(end), lower=-1e-2, upper=1e-2
    )
    h = phase.state(
        "h", 3, initial=[1000, -500, -4200], final=[-9, -3557, -135], lower=-8000, upper=8000
    )
    c = phase.control("c", 4, lower=-1, upper=1)
    gamma = ocp.parameter("gamma", lower=0, upper=most**2, guess=most**2)
    body = casadi.DM(inertia)
    error = 2 * _spin_matrix(c).T @ q
    torque = body @ (0.000128 * error + 0.015846 * (w - casadi.vertcat(*_orbit_rate(c))))
    q1, q2, q3, q4 = (q[k] for k in range(4))
    down = casadi.vertcat(2 * (q2 * q4 - q1 * q3), 2 * (q3 * q4 + q1 * q2), 1 - 2 * (q2**2 + q3**2))
    gravity = 3 * n**2 * casadi.cross(down, body @ down)
    store = torque - casadi.cross(w, h)
    phase.dynamics(
        {
            q: _spin_matrix(q) @ (w - casadi.vertcat(*_orbit_rate(q))) / 2,
            w: casadi.DM(np.linalg.inv(inertia)) @ (gravity - casadi.cross(w, body @ w) - torque),
            h: store,
        }
    )
    phase.path(casadi.sumsqr(c), equals=1)
    phase.path(casadi.sumsqr(h) - gamma, upper=0, scale=most**2)
    phase.path(casadi.sumsqr(store), upper=200.0**2)
    phase.guess(time=np.array([0, 7200.0]), q=np.array([begin, begin]), c=np.array([begin, begin]))
    ocp.minimise(0.1 * gamma + phase.integral(casadi.sumsqr(torque)))
