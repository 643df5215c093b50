"""Independent solutions of tours with extended fields, in the ground frame and without the package's solvers."""

import itertools
import math

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve, minimize

SIGNS = {"L": 1.0, "S": 0.0, "R": -1.0}


def ground(model, letters, lengths):
    """Return place and heading in the ground frame after each primitive, by the formula of a trochoid."""
    wind = np.zeros(2) if model.wind is None else model.wind
    (x, y, h), v, r = model.start, model.speed, model.turning_radius
    rows = []
    for letter, length in zip(letters, lengths, strict=True):
        sign = SIGNS[letter]
        if sign:
            turned = h + sign * length / r
            x += sign * r * (math.sin(turned) - math.sin(h)) + wind[0] * length / v
            y -= sign * r * (math.cos(turned) - math.cos(h)) - wind[1] * length / v
            h = turned
        else:
            x += (math.cos(h) + wind[0] / v) * length
            y += (math.sin(h) + wind[1] / v) * length
        rows.append((x, y, h))
    return np.array(rows)


def integrate(model, letters, lengths):
    """Return the final place in the ground frame, by integration of the equations of motion."""
    state = np.array(model.start)
    for letter, length in zip(letters, lengths, strict=True):
        rate = SIGNS[letter] * model.speed / model.turning_radius

        def motion(t, s, rate=rate):
            x, y = model.speed * np.array([math.cos(s[2]), math.sin(s[2])]) + model.wind
            return [x, y, rate]

        span = (0.0, length / model.speed)
        state = solve_ivp(motion, span, state, "DOP853", rtol=1e-13, atol=1e-12).y[:, -1]
    return state[:2]


def trochoid_time(model):
    """Return the earliest time at the only vehicle of `model`, of radius 0: roots of the turn lengths."""
    around, best = 2 * math.pi * model.turning_radius, math.inf

    def off(x, letters, fly):
        lengths = np.abs(x) * model.turning_radius
        end = fly(model, letters, lengths)
        end = end[-1, :2] if end.ndim == 2 else end
        target = model.positions[0] + model.velocities[0] * lengths.sum() / model.speed
        return (end - target) / model.turning_radius

    for letters in itertools.product("LR", "LSR"):
        if letters[0] == letters[1]:
            continue
        for first in np.linspace(0.2, 6.0, 8):
            for second in (1.0, 4.0, 15.0):
                x, _, ok, _ = fsolve(off, [first, second], (letters, ground), full_output=True)
                if ok != 1 or (x < 0).any() or x[0] * model.turning_radius > around:
                    continue
                if x.sum() * model.turning_radius / model.speed < best * (1 - 1e-6):
                    x, *_ = fsolve(off, x, (letters, integrate), xtol=1e-14, full_output=True)
                    if np.abs(off(x, letters, integrate)).max() < 1e-10:
                        best = min(best, x.sum() * model.turning_radius / model.speed)
    return best


def shortest_flight(model):
    """Return the length of the best flight found: all orders, turns towards the next vehicle, SLSQP."""
    return min(_fly(model, order) for order in itertools.permutations(range(model.size)))


def _fly(model, order):
    wind = np.zeros(2) if model.wind is None else model.wind
    home = np.zeros(2) if model.home_velocity is None else model.home_velocity
    v, r = model.speed, model.turning_radius
    goals = [(model.positions[k], model.velocities[k]) for k in order]
    goals += [(model.start[:2], home)] * model.closed
    place, heading, time = model.start[:2].copy(), model.start[2], 0.0
    letters, guess, ends = [], [], []
    for k, (p, velocity) in enumerate(goals):  # straight flights between the centres, in the air
        rate = velocity - wind
        way = p + rate * time - place
        along, room = way @ rate, v * v - rate @ rate
        wait = (along + math.sqrt(along * along + room * (way @ way))) / room
        place, time = place + way + rate * wait, time + wait
        course = math.atan2(*(way + rate * wait)[::-1])
        turn = math.remainder(course - heading, 2 * math.pi)
        last = k == model.size
        after = math.remainder(model.start[2] - course, 2 * math.pi) if last else 0.0
        letters += ["L" if turn > 0 else "R", "S", "L" if after > 0 else "R"]
        guess += [abs(turn) * r, wait * v, abs(after) * r]
        heading, ends = course, [*ends, 3 * k + 2]
    winding = round((heading + after - model.start[2]) / (2 * math.pi))
    scale = sum(guess) / len(goals) + r

    def off(x):
        poses, flown = ground(model, letters, x * scale), np.cumsum(x * scale)
        time = flown[ends] / v
        where = np.array([p + rate * t for (p, rate), t in zip(goals, time, strict=True)])
        return poses[ends, :2] - where, poses[-1, 2]

    reach = model.radius[list(order)]

    def discs(x):
        return (reach - np.hypot(*off(x)[0][: model.size].T))[reach > 0] / scale

    def exact(x):
        apart, heading = off(x)
        rows = [*(apart[: model.size][reach == 0] / scale).ravel()]
        if model.closed:
            rows += [*apart[-1] / scale, heading - model.start[2] - 2 * math.pi * winding]
        return np.array(rows)

    rules = [{"type": "ineq", "fun": discs}] * bool(reach.any())
    rules += [{"type": "eq", "fun": exact}] * bool(model.closed or not reach.all())
    result = minimize(
        np.sum, np.array(guess) / scale, method="SLSQP", bounds=[(0, None)] * len(guess),
        constraints=rules, options={"maxiter": 300, "ftol": 1e-12},
    )  # fmt: skip
    x = result.x
    ok = (discs(x) >= -1e-9).all() and np.abs(exact(x)).max(initial=0.0) < 1e-9
    return x.sum() * scale if ok else math.inf
