"""Values of catalogue entries from closed forms, or one root of them."""

import math

import mpmath as mp
import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.integrate import quad, solve_ivp
from scipy.optimize import minimize_scalar, root

from crosstrack.instances.optimal_control.rockets import (
    GRAVITY,
    ORBIT_HEIGHT,
    ORBIT_SPEED,
    STAGES,
)


def found_root(function, start, tolerance=1e-13):
    answer = root(function, start, tol=tolerance)
    assert np.abs(answer.fun).max() < 1e-8, answer.message
    return answer.x


def integrated(rates, span, begin, events=None):
    answer = solve_ivp(rates, span, begin, method="DOP853", rtol=1e-12, atol=1e-13, events=events)
    if events is not None:
        assert answer.status == 1
        return answer.t[-1], answer.y[:, -1]
    return answer.y[:, -1]


def brachistochrone():
    with mp.workdps(30):
        ratio, drop, gravity = mp.mpf(2), mp.mpf(5), mp.mpf("9.80665")
        roll = mp.findroot(lambda a: (a - mp.sin(a)) / (1 - mp.cos(a)) - ratio, 3.5)
        return float(roll * mp.sqrt(drop / (1 - mp.cos(roll)) / gravity))


def hypersensitive():
    """H = 0 on both manifolds: V' = -x³ + x √(1 + x⁴) to leave, x³ + x √(1 + x⁴) to arrive."""
    leave = quad(lambda x: -(x**3) + x * math.sqrt(1 + x**4), 0, 1.5, epsabs=1e-14)[0]
    return leave + quad(lambda x: x**3 + x * math.sqrt(1 + x**4), 0, 1, epsabs=1e-14)[0]


def linear_regulator():
    """Riccati's equation backwards in time."""
    return integrated(lambda _t, p: [1 + 2 * p[0] - p[0] ** 2], (0, 2), [0.0])[0]


def zermelo():
    """With tan(heading) = c + t, y = sec θ - sec θf and x by quadrature."""

    def missed(angles):
        first, last = angles
        y = -1.86 + 1 / np.cos(last) - 1 / np.cos(first)
        x = quad(
            lambda s: (np.cos(s) + 1.86 - 1 / np.cos(s) + 1 / np.cos(first)) / np.cos(s) ** 2,
            first,
            last,
            epsabs=1e-13,
        )[0]
        return 3.66 + x, y

    first, last = found_root(missed, [1.83, 4.19])
    return math.tan(last) - math.tan(first)


def hanging_chain():
    """The catenary q + c cosh((t - t0) / c)."""

    def missed(v):
        c, t0, q = v
        return (
            q + c * np.cosh(t0 / c) - 1,
            q + c * np.cosh((1 - t0) / c) - 3,
            c * (np.sinh((1 - t0) / c) + np.sinh(t0 / c)) - 4,
        )

    c, t0, q = found_root(missed, [0.16, 0.4, 0.0])
    return quad(lambda t: (q + c * np.cosh((t - t0) / c)) * np.cosh((t - t0) / c), 0, 1)[0]


def decay_fit():
    def misfit(p):
        return quad(lambda t: (math.exp(-p * t) - 1 / (1 + t)) ** 2, 0, 4, epsabs=1e-14)[0]

    return minimize_scalar(misfit, bounds=(0.3, 0.9), options={"xatol": 1e-10}).fun


def harmonic_oscillator():
    """Arcs of circles: -1, then +1 for π, then -1 until the origin."""

    def after(place, centre, angle):
        return centre + (place - centre) * np.exp(-1j * angle)

    def missed(angles):
        end = after(after(after(3.0, -1, angles[0]), 1, np.pi), -1, angles[1])
        return end.real, end.imag

    return found_root(missed, [0.25, 1.45]).sum() + math.pi


def moon_lander():
    """Free fall meets the parabola of full braking where 4 + 3 (10 - h) = 3 h."""
    h = 34 / 6
    return 3 * math.sqrt(2 * 1.5 * h) / 1.5


def catalyst_mixing():
    """The best of the controls 1, u, 0 with matrix exponentials between the switches."""

    def yielded(times_and_share):
        first, second, share = times_and_share
        x = mp.matrix([1, 0])
        for u, span in ((mp.mpf(1), first), (share, second - first), (mp.mpf(0), 1 - second)):
            x = mp.expm(mp.matrix([[-u, 10 * u], [u, -9 * u - 1]]) * span) * x
        return x[0] + x[1] - 1

    def slope(*v):
        step = mp.mpf(10) ** -10
        moved = [
            [x + step * s * (k == j) for k, x in enumerate(v)] for j in range(3) for s in (1, -1)
        ]
        return [(yielded(moved[2 * j]) - yielded(moved[2 * j + 1])) / (2 * step) for j in range(3)]

    with mp.workdps(30):
        return float(yielded(list(mp.findroot(slope, (0.136, 0.725, 0.227)))))


def linear_tangent_steering():
    """With tan(angle) = m (1 - 2 t / T), symmetric as vy begins and ends at 0."""

    def missed(v):
        m, end = v
        rise = quad(lambda s: s / math.hypot(1, s * m) * s, -1, 1, epsabs=1e-14)[0]
        return 100 * end / m * np.arcsinh(m) - 45, 100 * m * end**2 / 4 * rise - 5

    return found_root(missed, [1.4, 0.55])[1]


def two_stage_ascent():
    """tan(pitch) = a - b t through both stages, by Gauss quadrature."""
    places, weights = leggauss(60)
    burn = (STAGES[0][2] - STAGES[0][3]) / STAGES[0][1]

    def missed(v):
        a, b, span = v
        reached = np.zeros(3)
        for (thrust, flow, full, _), low, high in zip(
            STAGES, (0, burn), (burn, burn + span), strict=True
        ):
            t = low + (high - low) * (places + 1) / 2
            push, angle = thrust / (full - flow * (t - low)), np.arctan(a - b * t)
            across, up = push * np.cos(angle), push * np.sin(angle) - GRAVITY
            reached += (high - low) / 2 * np.array(
                [weights @ across, weights @ up, weights @ (up * (burn + span - t))]
            )  # fmt: skip
        return reached - [ORBIT_SPEED, 0, ORBIT_HEIGHT]

    return -(STAGES[1][2] - STAGES[1][1] * found_root(missed, [1.2, 0.003, 280])[2])


def around_discs():
    """A tangent, an arc, the tangent between both discs, and the same again: it is symmetric."""
    (cx, cy), radius = (1.2, 0.3), 0.5
    # The start sees the centre at distance d; its tangent touches below the disc.
    d = math.hypot(cx, cy)
    first = math.atan2(cy, cx) - math.asin(radius / d)
    # Through the middle (2, 0), crossing from below the one to above the other.
    near = math.hypot(2 - cx, cy)
    second = math.atan2(-cy, 2 - cx) + math.asin(radius / near)
    arc = radius * (second - first)
    return 2 * (math.sqrt(d**2 - radius**2) + arc + math.sqrt(near**2 - radius**2))


def dubins():
    """Left, straight, left: from circle to circle of radius 1, about (0, 1) and (4, 3)."""
    return math.hypot(4, 3 - 1) + math.pi


def quadrotor():
    """Full thrust; at 10 rad/s to the arc where tan(pitch) = k (T / 2 - t), and to the middle."""
    places, weights = leggauss(80)

    def missed(v):
        on, off, k, end = v
        half = end / 2
        pitches = (
            lambda t: 10 * t,
            lambda t: np.arctan(k * (half - t)),
            lambda t: 10 * (half - t),
        )
        up, across = -9.81 * half, 0.0
        for pitch, low, high in zip(pitches, (0, on, off), (on, off, half), strict=True):
            t = low + (high - low) * (places + 1) / 2
            w = weights * (high - low) / 2
            up += w @ (20 * np.cos(pitch(t)))
            across += 2 * w @ ((half - t) * 20 * np.sin(pitch(t)))
        return (
            10 * on - np.arctan(k * (half - on)),
            10 * (half - off) - np.arctan(k * (half - off)),
            up,
            across - 5,
        )

    return found_root(missed, [0.14, 0.474, 14.0, 1.13])[3]


def tubular_reactor():
    """The yield p of a unit of A over the length left: the rate is 1 / p - 1, and at most 5."""
    arc = -math.log(1 - 17.5 / 5 / 6) / 17.5
    rest = solve_ivp(
        lambda _, p: (1 - p) ** 2 / (2 * p),
        (0, 1 - arc),
        [1 / 6],
        method="DOP853",
        rtol=1e-13,
        atol=1e-14,
    )
    return -float(rest.y[0, -1])


def unicycle():
    """A geodesic from its three costates at the start."""

    def motion(_, s):
        along = s[4] * math.cos(s[2]) + s[5] * math.sin(s[2])
        across = s[5] * math.cos(s[2]) - s[4] * math.sin(s[2])
        forward = [along * math.cos(s[2]), along * math.sin(s[2])]
        return [*forward, s[6], along**2 + s[6] ** 2, 0, 0, -along * across]

    def course(costates):
        return integrated(motion, (0, 1), [0, 0, 0, 0, *costates])

    start = found_root(lambda p: course(p)[:3] - [0, 1, 0], [3.0, 5.0, -1.5])
    return float(course(start)[3])


def batch_reactor():
    """Pontryagin's conditions in the first rate, of whose square the second is a multiple."""
    ratio = 620_000 / 4000**2
    low, high = (4000 * math.exp(-2500 / t) for t in (298, 398))

    def motion(_, s):
        raw, middle, p, q = s
        gain = raw**2 * (q - p)
        rate = min(high, max(low, gain / max(2 * ratio * middle * q, 1e-300)))
        loss = ratio * rate**2
        return [
            -rate * raw**2,
            rate * raw**2 - loss * middle,
            2 * rate * raw * (p - q),
            loss * q,
        ]

    def course(costates):
        return integrated(motion, (0, 1), [1, 0, *costates])

    start = found_root(lambda c: course(c)[2:] - [0, 1], [0.4, 0.7])
    return -float(course(start)[1])
