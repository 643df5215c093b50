"""The equations of a hunt, with their derivatives in one direction."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["SHARED", "hunt_rates"]

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
        growth[at + 2], growth[at + 3] = (
            thrust * (over * dp + bent * p),
            thrust * (over * dq + bent * q),
        )
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
