"""Values of catalogue entries from Pontryagin's conditions, by shooting between switches."""

import math
from itertools import pairwise

import numpy as np
from derived_closed import found_root, integrated
from scipy.optimize import minimize

from crosstrack.instances.optimal_control.rockets import (
    AIR,
    DRAG,
    EMPTY,
    EXHAUST,
    THRUST,
)


def extremal(motion, control, states):
    """Return rates of states and costates, with derivatives of the motion by complex steps."""

    def rates(_t, z):
        x, costates = z[:states], z[states : 2 * states]
        u = control(x, costates)
        slopes = np.empty(states)
        for k in range(states):
            moved = x.astype(complex)
            moved[k] += 1e-30j
            slopes[k] = -(costates @ motion(moved, u)[:states].imag) / 1e-30
        rate = motion(x, u)
        # The last entry of the motion is the cost, whose costate is 1.
        if rate.size > states:
            for k in range(states):
                moved = x.astype(complex)
                moved[k] += 1e-30j
                slopes[k] -= motion(moved, u)[states].imag / 1e-30
        return np.concatenate([rate[:states], slopes, rate[states:]])

    return rates


def pol(x, u):
    return np.array([(1 - x[1] ** 2) * x[0] - x[1] + u, x[0], x[0] ** 2 + x[1] ** 2 + u**2])


POL = extremal(pol, lambda x, p: np.clip(-p[0] / 2, -0.3, 1), 2)


def van_der_pol():
    def course(costates):
        return integrated(POL, (0, 5), [0, 1, *costates, 0])

    return course(found_root(lambda p: course(p)[2:4], [0.8329, 4.8857], 1e-11))[4]


def van_der_pol_limited():
    """Return the value with an arc on x1 = -0.4; control and costates are continuous at its ends."""

    def on_bound(_t, z):
        u = z[0] + 0.4 * (1 - z[0] ** 2)  # which keeps x1
        costate = -2 * u
        return [-0.4, -(2 * z[0] + costate * (0.8 * z[0] - 1)), 0.16 + z[0] ** 2 + u**2]

    def course(v):
        first, second, on, off = v
        x1, x2, p1, p2, cost = integrated(POL, (0, on), [0, 1, first, second, 0])
        missed = [x1 + 0.4, p1 + 2 * (x2 + 0.4 * (1 - x2**2))]
        x2, p2, cost = integrated(on_bound, (on, off), [x2, p2, cost])
        p1 = -2 * (x2 + 0.4 * (1 - x2**2))
        end = integrated(POL, (off, 5), [-0.4, x2, p1, p2, cost])
        return [*missed, *end[2:4]], end[4]

    return course(found_root(lambda v: course(v)[0], [0.8336, 5.6676, 0.63, 1.47], 1e-11))[1]


def tunnel_diode(limit):
    def motion(x, u):
        rate = -x[0] + x[1] * (1.4 - 0.14 * x[1] ** 2) + 4 * u
        return np.array([x[1], rate, x[0] ** 2 + u**2])

    return extremal(motion, lambda x, p: np.clip(-2 * p[1], -limit, limit), 2)


def rayleigh():
    def course(costates):
        return integrated(tunnel_diode(1), (0, 4.5), [-5, -5, *costates, 0])

    return course(found_root(lambda p: course(p)[:2], [-12.71, -4.596], 1e-11))[4]


def rayleigh_free():
    def course(costates):
        return integrated(tunnel_diode(np.inf), (0, 2.5), [-5, -5, *costates, 0])

    return course(found_root(lambda p: course(p)[2:4], [-8.737, -2.581], 1e-11))[4]


def orbit_raising():
    """The costates with time as a state of rate 1, which the thrust per mass depends on."""

    def motion(x, u):
        r, radial, tangential, t = x
        push = 0.1405 / (1 - 0.0749 * t)
        return np.array(
            [
                radial,
                tangential**2 / r - 1 / r**2 + push * np.sin(u),
                -radial * tangential / r + push * np.cos(u),
                1 + 0 * t,
            ]
        )

    rates = extremal(motion, lambda x, p: np.arctan2(-p[1], -p[2]), 4)

    def course(costates):
        return integrated(rates, (0, 3.32), [1, 0, 1, 0, *costates, 0])

    def missed(costates):
        r, radial, tangential, _, p, _, q, _ = course(costates)
        return radial, tangential**2 * r - 1, p + 1 - q * tangential / (2 * r)

    return -course(found_root(missed, [-1.877, -0.929, -2.025]))[0]


def cart_pole(start=(6.31, -35.56, 4.34, -4.69)):
    cart, bob, length, gravity = 1.0, 0.3, 0.5, 9.81

    def motion(x, u):
        _, angle, speed, rate = x
        sine, cosine = np.sin(angle), np.cos(angle)
        inertia = cart + bob * sine**2
        pull = length * bob * sine * rate**2
        return np.array(
            [
                speed,
                rate,
                (pull + u + bob * gravity * cosine * sine) / inertia,
                -(cosine * (pull + u) + (cart + bob) * gravity * sine) / (length * inertia),
                u**2 + 0 * angle,
            ]
        )

    def control(x, p):
        inertia = cart + bob * np.sin(x[1]) ** 2
        return -(p[2] - p[3] * np.cos(x[1]) / length) / inertia / 2

    rates = extremal(motion, control, 4)

    def course(costates):
        return integrated(rates, (0, 2), [0, 0, 0, 0, *costates, 0])

    def missed(costates):
        return course(costates)[:4] - [1, np.pi, 0, 0]

    return course(found_root(missed, start, 1e-11))[8]


def shuttle_reentry():
    """The lift turns along the costates of course and climb, and its drag is worth it."""
    degree, mass = np.pi / 180, 203_000 / 32.174

    def motion(x, u):
        h, latitude, v, climb, azimuth = x
        alpha, bank = u
        pressure = 0.5 * 0.002378 * np.exp(-h / 23_800) * 2690 * v**2
        lift = pressure * (-0.20704 + 0.029244 * alpha)
        drag = pressure * (0.07854 - 0.61592e-2 * alpha + 0.621408e-3 * alpha**2)
        r = 20_902_900 + h
        g = 0.14076539e17 / r**2
        return np.array(
            [
                v * np.sin(climb),
                v / r * np.cos(climb) * np.cos(azimuth),
                -drag / mass - g * np.sin(climb),
                lift / (mass * v) * np.cos(bank) + np.cos(climb) * (v / r - g / v),
                lift * np.sin(bank) / (mass * v * np.cos(climb))
                + v / r * np.cos(climb) * np.sin(azimuth) * np.tan(latitude),
            ]
        )

    def control(x, p):
        up, across = p[3] / x[2], p[4] / (x[2] * np.cos(x[3]))
        gain = -np.hypot(up, across) / p[2]
        return (gain * 0.029244 + 0.61592e-2) / (2 * 0.621408e-3), np.arctan2(-across, -up)

    rates, size = extremal(motion, control, 5), np.array([1e5, 1, 1e4, 0.1, 1])

    def course(v):
        begin = [260_000, 0, 25_600, -degree, 90 * degree, *(v[:5] / size)]
        return integrated(rates, (0, 1000 * v[5]), begin)

    def missed(v):
        z = course(v)
        energy = z[5:] @ motion(z[:5], control(z[:5], z[5:]))
        return (
            (z[0] - 80_000) / 1e5, (z[2] - 2500) / 1e4, 10 * (z[3] + 5 * degree), z[6] + 1, z[9],
            1000 * energy,
        )  # fmt: skip

    start = [-0.008033, -0.2535, -0.7413, -0.02706, 0.96734, 2.0086]
    return -course(found_root(missed, start, 1e-11))[1]


def goddard():
    """Full thrust to the singular surface, along it until the tank is empty, up to the apogee."""

    def drag(h, v):
        return DRAG * v**2 * math.exp(-AIR * (h - 1))

    def flying(thrust):
        def rates(_t, z):
            h, v, m = z
            push = thrust(z)
            return [v, (push - drag(h, v)) / m - 1 / h**2, -push / EXHAUST]

        return rates

    def surface(_t, z):
        return z[2] / z[0] ** 2 - (1 + z[1] / EXHAUST) * drag(z[0], z[1])

    def along(z):
        h, v, m = z
        d = drag(h, v)
        by_h = -2 * m / h**3 + AIR * (1 + v / EXHAUST) * d
        by_v = -d / EXHAUST - (1 + v / EXHAUST) * 2 * d / v
        free = by_h * v - by_v * (d / m + 1 / h**2)
        return -free / (by_v / m - 1 / (EXHAUST * h**2))

    arcs = (
        (lambda _z: THRUST, surface),
        (along, lambda _t, z: z[2] - EMPTY),
        (lambda _z: 0.0, lambda _t, z: z[1]),
    )
    t, z = 0.0, [1.0, 0.0, 1.0]
    for thrust, stop in arcs:
        stop.terminal = True
        t, z = integrated(flying(thrust), (t, t + 1), z, stop)
    return -z[0]


def robot_arm():
    """The rod in a quarter of the time; one switch of the turn, two of the lift, all symmetric."""

    def missed(v):
        end, lift = v
        half, quarter = end / 2, end / 4

        def rates(sign):
            def inner(t, z):
                late = max(t - quarter, 0.0)
                rho = 4.5 - t**2 / 10 + late**2 / 5
                inertia = ((5 - rho) ** 3 + rho**3) / 3
                return [z[1], sign / inertia, z[3], 1 / (inertia * math.sin(z[0]) ** 2)]

            return inner

        z = [math.pi / 4, 0, 0, 0]
        for low, high, sign in ((0, quarter, -1), (quarter, lift, -1), (lift, half, 1)):
            z = integrated(rates(sign), (low, high), z)
        return z[1], 2 * z[2] - 2 * math.pi / 3

    return found_root(missed, [9.14, 2.8])[0]


def free_flying_robot():
    """The best times of eight switches."""
    sign = np.array([-1, 1, -1, 1, -1, 1, 1, -1.0])

    def end(v):
        firing = (
            ((v[0], v[1]), (v[2], 12)),
            ((0, v[3]), (v[4], v[5])),
            ((0, v[6]),),
            ((v[7], 12),),
        )
        z = np.array([-10, -10, math.pi / 2, 0, 0, 0])
        times = sorted((0.0, 12.0, *v))
        for low, high in pairwise(times):
            middle = (low + high) / 2
            a, b, c, d = (any(s < middle < e for s, e in jet) * 1.0 for jet in firing)
            push, turn = a - b + c - d, 0.2 * (a - b - c + d)
            z = integrated(
                lambda _t, z, push=push, turn=turn: [
                    z[3], z[4], z[5], push * math.cos(z[2]), push * math.sin(z[2]), turn,
                ],
                (low, high),
                z,
            )  # fmt: skip
        return z

    found = minimize(
        lambda v: sign @ v + 24,
        [2.54, 4.83, 11.39, 0.61, 7.17, 9.46, 1.05, 10.95],
        jac=lambda _v: sign,
        constraints={"type": "eq", "fun": end},
        method="SLSQP",
        options={"ftol": 1e-13},
    )
    assert np.abs(end(found.x)).max() < 1e-9
    return found.fun
