"""Orbits of equations of motion, and the largest Lyapunov exponent from the growth of a tangent vector.

Only sums, products, quotients and square roots are used, because every machine rounds them in the same way.
A chaotic orbit amplifies a difference in the last digit of any other function.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...jit import kernel
from ...models.fields import Real, Whole

__all__ = [
    "HENON",
    "HUNT",
    "LORENZ",
    "ROSSLER",
    "SHARED",
    "Growth",
    "Motion",
    "bounded_steps",
    "hunt_rates",
    "largest_exponent",
    "orbit",
]

Floats = NDArray[np.float64]

#: Constants of a hunt before its gains and obstacles: predators, obstacles, width, height, radius, barrier,
#: flight, reach, thrust, speed of predators, speed of the evader.
SHARED = 11


@kernel
def _keep_off(
    gap: float, x: float, y: float, u: float, v: float, barrier: float,
    rates: Floats, growth: Floats, at: int,
) -> None:  # fmt: skip
    """Add the repulsion of a body, ``barrier / gap²`` along (x, y) from the other to it.

    Its derivative in the direction (u, v) is added to `growth`.
    """
    distance = math.sqrt(x * x + y * y)
    nx, ny = x / distance, y / distance
    closing = nx * u + ny * v
    force = barrier / (gap * gap)
    slope = -2.0 * force / gap * closing
    rates[at] += force * nx
    rates[at + 1] += force * ny
    growth[at] += slope * nx + force * (u - nx * closing) / distance
    growth[at + 1] += slope * ny + force * (v - ny * closing) / distance


@kernel
def hunt_rates(
    constants: Floats, state: Floats, tangent: Floats, rates: Floats, growth: Floats
) -> None:
    """Fill in the time derivatives of the places and speeds of the bodies, and of a tangent vector.

    A state has x, y and the speeds along them for each predator, and for the evader last.
    """
    predators, obstacles = int(constants[0]), int(constants[1])
    width, height, radius, barrier = constants[2], constants[3], constants[4], constants[5]
    flight, reach, thrust = constants[6], constants[7], constants[8]
    for i in range(predators + 1):
        at = 4 * i
        x, y, p, q = state[at], state[at + 1], state[at + 2], state[at + 3]
        dx, dy, dp, dq = tangent[at], tangent[at + 1], tangent[at + 2], tangent[at + 3]
        rates[at], rates[at + 1], growth[at], growth[at + 1] = p, q, dp, dq
        # Thrust or drag, towards the speed of its kind.
        speed = constants[9] if i < predators else constants[10]
        over = 1.0 - (p * p + q * q) / (speed * speed)
        bent = -2.0 * (p * dp + q * dq) / (speed * speed)
        rates[at + 2], rates[at + 3] = thrust * over * p, thrust * over * q
        growth[at + 2] = thrust * (over * dp + bent * p)
        growth[at + 3] = thrust * (over * dq + bent * q)
        # The four walls.
        for gap, sign in ((x - radius, 1.0), (width - radius - x, -1.0)):
            rates[at + 2] += sign * barrier / (gap * gap)
            growth[at + 2] -= 2.0 * barrier / (gap * gap * gap) * dx
        for gap, sign in ((y - radius, 1.0), (height - radius - y, -1.0)):
            rates[at + 3] += sign * barrier / (gap * gap)
            growth[at + 3] -= 2.0 * barrier / (gap * gap * gap) * dy
        for k in range(obstacles):
            first = SHARED + predators + 3 * k
            a, b = x - constants[first], y - constants[first + 1]
            gap = math.sqrt(a * a + b * b) - constants[first + 2] - radius
            _keep_off(gap, a, b, dx, dy, barrier, rates, growth, at + 2)
        for j in range(predators + 1):
            if j == i:
                continue
            a, b = x - state[4 * j], y - state[4 * j + 1]
            u, v = dx - tangent[4 * j], dy - tangent[4 * j + 1]
            gap = math.sqrt(a * a + b * b) - 2.0 * radius
            _keep_off(gap, a, b, u, v, barrier, rates, growth, at + 2)
            square = a * a + b * b + reach * reach
            along = a * u + b * v
            if i == predators:
                pull = flight / square
                bend = -2.0 * pull / square * along
            elif j == predators:
                pull = -constants[SHARED + i] / math.sqrt(square)
                bend = -pull / square * along
            else:
                continue
            rates[at + 2] += pull * a
            rates[at + 3] += pull * b
            growth[at + 2] += pull * u + bend * a
            growth[at + 3] += pull * v + bend * b


#: Kinds of equations; a map takes one step per unit of time.
HENON, LORENZ, ROSSLER, HUNT = 0, 1, 2, 3
#: Largest number of steps of an integration.
STEPS = 100_000_000
#: Parts of a growth whose means give its deviation.
_PARTS = 20


class Motion(NamedTuple):
    """Equations of motion with their constants and initial state.

    `kind` is :data:`HENON`, :data:`LORENZ`, :data:`ROSSLER` or :data:`HUNT`, and the constants are in the
    order of its equations. `step` is the longest step of the integration, s. `transient` seconds are
    discarded until the motion is on its attractor.
    """

    kind: int
    constants: Floats
    start: Floats
    step: float
    transient: float


class Growth(NamedTuple):
    """Largest Lyapunov exponent in nats per second, and its standard error from successive parts of the orbit."""

    exponent: float
    deviation: float


def orbit(motion: Motion, count: int, period: float) -> Floats:
    """Return `count` states `period` seconds apart after the transient, shape (count, n).

    The method is that of Runge and Kutta of order 4 with steps of a fixed length. Raise InvalidData if more
    than :data:`STEPS` steps are necessary, or the period of a map is not an integer.
    """
    inner, step = _steps(motion, period)
    skipped = math.ceil(motion.transient / (inner * step))
    bounded_steps(skipped + count, inner)
    states = np.empty((count, len(motion.start)))
    _orbit(motion.kind, motion.constants, motion.start, step, inner, skipped, states)
    return states


def bounded_steps(count: int, inner: int) -> None:
    """Reject `count` periods of `inner` steps if the number of steps is above :data:`STEPS`."""
    if count * inner > STEPS:
        raise InvalidData(
            f"period must be shorter, or samples fewer: {count * inner:.3g} steps of the integration would be "
            f"taken, where at most {STEPS:.0e} are",
            field="period",
        )


def largest_exponent(motion: Motion, duration: float, interval: float = 1.0) -> Growth:
    """Return the largest Lyapunov exponent of a motion, from its equations.

    A tangent vector follows the derivatives of the equations and is normalised after each `interval`, in
    seconds. The exponent is the mean logarithm of its growth (Benettin, Galgani, Giorgilli and Strelcyn,
    Meccanica 15, 1980). The duration after the transient is at least 20 intervals. Raise InvalidData for
    other durations, and if the motion is unbounded.
    """
    interval = Real(0, strict=True, unit="s").coerce("interval", interval, {})
    duration = Real(_PARTS * interval, unit="s").coerce("duration", duration, {})
    inner, step = _steps(motion, interval)
    count = math.ceil(min(duration / interval, STEPS + 1))
    skipped = math.ceil(motion.transient / interval)
    bounded_steps(skipped + count, inner)
    logs = np.empty(count)
    _growth(motion.kind, motion.constants, motion.start, step, inner, skipped, logs)
    if not np.isfinite(logs).all():
        raise InvalidData("motion must stay bounded; its tangent vector did not", field="motion")
    rates = logs / (inner * step)
    parts = [part.mean() for part in np.array_split(rates, _PARTS)]
    return Growth(float(rates.mean()), float(np.std(parts, ddof=1) / math.sqrt(_PARTS)))


def _steps(motion: Motion, period: float) -> tuple[int, float]:
    """Return the number of steps per period and their length; a map has steps of length 1."""
    if motion.kind == HENON:
        return Whole(1).coerce("period", period, {}), 1.0
    inner = max(math.ceil(period / motion.step - 1e-9), 1)
    return inner, period / inner


# -- kernels -------------------------------------------------------------------------------------


@kernel
def _rates(
    kind: int, constants: Floats, state: Floats, tangent: Floats, rates: Floats, growth: Floats
) -> None:
    """Fill in the derivatives of a state and of a tangent vector with respect to time."""
    if kind == HUNT:
        hunt_rates(constants, state, tangent, rates, growth)
        return
    x, y, z = state[0], state[1], state[2]
    u, v, w = tangent[0], tangent[1], tangent[2]
    a, b, c = constants[0], constants[1], constants[2]
    if kind == LORENZ:
        rates[0], growth[0] = a * (y - x), a * (v - u)
        rates[1], growth[1] = x * (b - z) - y, u * (b - z) - x * w - v
        rates[2], growth[2] = x * y - c * z, u * y + x * v - c * w
    else:
        rates[0], growth[0] = -y - z, -v - w
        rates[1], growth[1] = x + a * y, u + a * v
        rates[2], growth[2] = b + z * (x - c), w * (x - c) + z * u


@kernel
def _advance(
    kind: int, constants: Floats, state: Floats, tangent: Floats, step: float, inner: int, work: Floats
) -> None:  # fmt: skip
    """Move a state and a tangent vector by some steps; `work`, shape (6, n), is overwritten."""
    count = len(state)
    for _ in range(inner):
        if kind == HENON:
            a, b = constants[0], constants[1]
            x, y, u, v = state[0], state[1], tangent[0], tangent[1]
            state[0], state[1] = 1.0 - a * x * x + y, b * x
            tangent[0], tangent[1] = -2.0 * a * x * u + v, b * u
            continue
        for k in range(count):
            work[0, k] = state[k]
            work[1, k] = tangent[k]
            work[4, k] = 0.0
            work[5, k] = 0.0
        for stage in range(4):
            _rates(kind, constants, work[0], work[1], work[2], work[3])
            weight = 2.0 if stage == 1 or stage == 2 else 1.0
            ahead = step if stage == 2 else 0.5 * step
            for k in range(count):
                work[4, k] += weight * work[2, k]
                work[5, k] += weight * work[3, k]
                work[0, k] = state[k] + ahead * work[2, k]
                work[1, k] = tangent[k] + ahead * work[3, k]
        for k in range(count):
            state[k] += step / 6.0 * work[4, k]
            tangent[k] += step / 6.0 * work[5, k]


@kernel(interpretable=True)
def _orbit(
    kind: int, constants: Floats, start: Floats, step: float, inner: int, skipped: int, states: Floats
) -> None:  # fmt: skip
    """Fill in the states after `skipped` periods, and one period each thereafter."""
    count = len(start)
    state = start.copy()
    tangent, work = np.zeros(count), np.empty((6, count))
    _advance(kind, constants, state, tangent, step, inner * skipped, work)
    for row in range(len(states)):
        for k in range(count):
            states[row, k] = state[k]
        _advance(kind, constants, state, tangent, step, inner, work)


@kernel(interpretable=True)
def _growth(
    kind: int, constants: Floats, start: Floats, step: float, inner: int, skipped: int, logs: Floats
) -> None:
    """Fill in the logarithms of the growth of a tangent vector in each period after `skipped` ones."""
    count = len(start)
    state = start.copy()
    tangent, work = np.ones(count), np.empty((6, count))
    for row in range(-skipped, len(logs)):
        _advance(kind, constants, state, tangent, step, inner, work)
        length = 0.0
        for k in range(count):
            length += tangent[k] * tangent[k]
        length = math.sqrt(length)
        for k in range(count):
            tangent[k] /= length
        if row >= 0:
            logs[row] = math.log(length)
