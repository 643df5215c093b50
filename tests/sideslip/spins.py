"""Spins: drives whose tyres slide, with an assumed friction of 0.95, and the times without grip.

`driven` uses the package's simulator of a driver on a road. `steered` integrates the single-track model with brush tyres
for given steering angles and is written apart from the package.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crosstrack.errors import InvalidData
from crosstrack.instances.sideslip import generate
from crosstrack.instances.sideslip.vehicles import VEHICLE
from crosstrack.models import SideslipEstimation
from crosstrack.models.sideslip import Recording, Vehicle

ASSUMED = 0.95
RATES = (20, 50, 100, 200)


class Spin(NamedTuple):
    """Drive with its true friction and vehicle, and what was drawn."""

    model: SideslipEstimation
    vehicle: Vehicle
    label: str

    @property
    def sliding(self) -> NDArray[np.bool_]:
        """True for samples at which the whole contact patch of an axle slides (the peak of the brush model)."""
        return self.slides(1.0)

    def slides(self, share: float) -> NDArray[np.bool_]:
        """Return whether an axle uses at least a share of the slip at which it slides."""
        drive, car = self.model.recording, self.vehicle
        truth = self.model.truth
        assert truth is not None
        speed = np.maximum(drive.speed, 1.0)
        slips = (
            drive.steering - truth - car.front * drive.yaw_rate / speed,
            car.rear * drive.yaw_rate / speed - truth,
        )
        stiffness = car.cornering_front, car.cornering_rear
        result = np.zeros(len(drive), dtype=bool)
        for slip, own, load in zip(slips, stiffness, car.loads, strict=True):
            used = np.where(np.abs(slip) < np.pi / 2, np.tan(np.abs(slip)), np.inf)
            result |= own * used >= share * 3.0 * car.friction * load
        return result


def driven(first: int, count: int) -> Iterator[Spin]:
    """Yield spins of a driver on both roads: 12 to 28 m/s, friction 0.2 to 0.6, 20 to 200 Hz, angles above 10°."""
    rng = np.random.default_rng(first)
    while count:
        road = ("serpentine", "lane-change")[rng.integers(2)]
        speed, friction = (round(float(v), 3) for v in (rng.uniform(12, 28), rng.uniform(0.2, 0.6)))
        rate, seed, end = RATES[rng.integers(4)], int(rng.integers(10**6)), 13.4
        model = None
        while model is None and end > 3.0:
            try:
                model = generate(
                    road, seed=seed, speed=speed, samples=round(end * rate), period=1 / rate, drivers=0,
                    tyre="saturating", friction=friction, mismatch={"friction": ASSUMED / friction},
                )  # fmt: skip
            except InvalidData as error:  # beyond 90°: end before
                end = float(re.findall(r"spins ([\d.]+) s", str(error))[0]) - 0.05
        if model is not None and model.truth is not None and np.abs(model.truth).max() > 0.17:
            count -= 1
            car = dataclasses.replace(VEHICLE, tyre="saturating", friction=friction)
            yield Spin(model, car, f"{road}, {speed:.1f} m/s, friction {friction:.2f}, {rate} Hz")


def _steerings(rng: np.random.Generator) -> dict[str, Callable[[float], float]]:
    """Return steering angles over time (rad); the manoeuvre begins at 1 s."""
    size, turn = float(rng.uniform(0.04, 0.2)), 2 * math.pi * float(rng.uniform(0.3, 0.8))
    hold = 1.0 + 1.5 * math.pi / turn

    def dwell(t: float) -> float:
        if hold <= t < hold + 0.5:
            return -size
        phase = turn * ((t if t < hold else t - 0.5) - 1.0)
        return size * math.sin(phase) if 0.0 <= phase < 2 * math.pi else 0.0

    return {
        "step": lambda t: size * min(max(t - 1.0, 0.0) / 0.2, 1.0),
        "sine with dwell": dwell,
        "growing slalom": lambda t: 0.3 * size * max(t - 1.0, 0.0) * math.sin(turn * (t - 1.0)),
        "pulse": lambda t: size if 1.0 <= t < 1.6 else (-0.5 * size if 1.6 <= t < 3.0 else 0.0),
    }


def steered(first: int, count: int, wrong: bool = False) -> Iterator[Spin]:
    """Yield spins with given steering angles: 10 to 30 m/s with drive or brake, friction 0.2 to 0.6 (a third after a change).

    If `wrong`, mass, stiffness and assumed friction are wrong, too, and both sensors have a bias.
    """
    rng = np.random.default_rng([first, 1])
    while count:
        rate, friction = RATES[rng.integers(4)], round(float(rng.uniform(0.2, 0.6)), 3)
        car = dataclasses.replace(VEHICLE, tyre="saturating", friction=friction)
        later = float(rng.uniform(0.2, 0.6)) if rng.random() < 1 / 3 else friction
        steerings = _steerings(rng)
        kind = str(rng.choice(list(steerings)))
        u0, pull = float(rng.uniform(10, 30)), float(rng.choice([0.0, -1.0, 0.5]))
        times = np.arange(round(8.0 * rate)) / rate
        speed = np.maximum(u0 + pull * np.maximum(times - 2.0, 0.0), 3.0)
        delta = np.array([steerings[kind](t) for t in times])
        grip = np.where(times < 4.0, friction, later)
        states, forces = _integrate(car, times, speed, delta, grip, rng)
        inside = np.abs(states[:, 0]) < np.radians(88)
        n = len(times) if inside.all() else int(inside.argmin())
        if n < 3 * rate or np.abs(states[:n, 0]).max() < 0.17:
            continue
        noise = rng.normal(size=(2, n)) * [[0.002], [0.05]]
        bias, factors = np.zeros(2), {"friction": ASSUMED / friction}
        if wrong:
            bias = rng.uniform(-1, 1, 2) * [0.005, 0.1]
            factors["friction"] = float(rng.uniform(0.7, 1.1)) / friction
            factors |= {"mass": float(rng.uniform(0.9, 1.1))}
            factors |= {
                key: float(rng.uniform(0.85, 1.15)) for key in ("cornering_front", "cornering_rear")
            }
        believed: dict[str, Any] = {
            key: getattr(car, key) * value for key, value in factors.items()
        }
        recording = Recording(
            times[:n], speed[:n], delta[:n], states[:n, 1] + noise[0] + bias[0],
            forces[:n] + noise[1] + bias[1],
        )  # fmt: skip
        model = SideslipEstimation(
            dataclasses.replace(car, **believed), recording, truth=states[:n, 0]
        )
        count -= 1
        yield Spin(model, car, f"{kind}, {u0:.1f} m/s, friction {friction:.2f}, {rate} Hz")


def _integrate(
    car: Vehicle, times: Any, speed: Any, delta: Any, grip: Any, rng: np.random.Generator
) -> tuple[Any, Any]:
    """Return angle and yaw rate, shape (n, 2), and lateral acceleration, by Runge-Kutta steps of at most 10 ms."""
    n, period = len(times), float(times[1] - times[0])
    stiffness, loads = (car.cornering_front, car.cornering_rear), car.loads
    inner = math.ceil(period / 0.01)
    h = period / inner
    shocks = rng.normal(size=(n, 2)) * [0.002, 0.01] * math.sqrt(period)
    states, forces = np.zeros((n, 2)), np.zeros(n)

    def force(slip: float, axle: int, mu: float) -> float:
        most = mu * loads[axle]
        if abs(slip) >= math.pi / 2:
            return math.copysign(most, slip)
        q = min(stiffness[axle] * math.tan(abs(slip)) / (3 * most), 1.0)
        return math.copysign(most * (3 * q - 3 * q * q + q**3), slip)

    def rates(x: Any, u: float, d: float, mu: float) -> tuple[Any, float]:
        f = force(d - x[0] - car.front * x[1] / u, 0, mu)
        r = force(car.rear * x[1] / u - x[0], 1, mu)
        a = (f + r) / car.mass
        return np.array([a / u - x[1], (car.front * f - car.rear * r) / car.yaw_inertia]), a

    x = np.zeros(2)
    for k in range(n):
        forces[k] = rates(x, speed[k], delta[k], grip[k])[1]
        states[k] = x
        if k + 1 == n or abs(x[0]) > 1.6:
            states[k:, 0] = x[0]
            break
        for i in range(inner):
            at = [(i + part) / inner for part in (0.0, 0.5, 1.0)]
            u = [speed[k] + part * (speed[k + 1] - speed[k]) for part in at]
            d = [delta[k] + part * (delta[k + 1] - delta[k]) for part in at]
            a = rates(x, u[0], d[0], grip[k])[0]
            b = rates(x + 0.5 * h * a, u[1], d[1], grip[k])[0]
            c = rates(x + 0.5 * h * b, u[1], d[1], grip[k])[0]
            e = rates(x + h * c, u[2], d[2], grip[k])[0]
            x = x + h / 6 * (a + 2 * b + 2 * c + e)
        x = x + shocks[k + 1]
    return states, forces


def marked(times: Any, spans: Any) -> NDArray[np.bool_]:
    """Return whether each time is within one of the spans."""
    result = np.zeros(len(times), dtype=bool)
    for begin, end in spans:
        result |= (times >= begin - 1e-9) & (times <= end + 1e-9)
    return result
