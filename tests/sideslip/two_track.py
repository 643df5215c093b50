"""Two-track simulator with Magic Formula tyres, written apart from the package's vehicle.

The chassis has four wheels, longitudinal and lateral load transfer, a banked road, drive and brake forces. The
tyres follow the Magic Formula with a stiffness and a peak that depend on the load, a friction ellipse and a
relaxation length (H. B. Pacejka, Tire and Vehicle Dynamics, 2012, chapters 4 and 5). Only NumPy is used.

`drive(name, seed)` returns one of the 13 scenarios in `SCENARIOS`. The motion depends on the scenario only and is
kept; the seed draws the sensor noise. Axes are those of ISO 8855, wheels have the order front left, front right, rear
left, rear right, and units are SI.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["CAR", "SCENARIOS", "Car", "Drive", "Scenario", "drive", "magic_formula", "simulate"]

Floats = NDArray[np.float64]
Four = tuple[float, float, float, float]

GRAVITY = 9.80665
#: Period of the recordings and step of the integration, s.
PERIOD, STEP = 0.02, 0.004


@dataclass(frozen=True)
class Car:
    """Vehicle and tyres. `stiffness` is that of one tyre of each axle at the static load of the car."""

    mass: float = 1500.0
    inertia: float = 2500.0
    front: float = 1.2
    rear: float = 1.5
    track: float = 1.5
    height: float = 0.55
    #: Share of the front axle in the lateral load transfer.
    roll_share: float = 0.55
    stiffness: tuple[float, float] = (40_000.0, 45_000.0)
    #: Mass at which `stiffness` is given.
    nominal_mass: float = 1500.0
    #: Shape and curvature of the Magic Formula, and loss of friction per relative increase of the load.
    shape: float = 1.35
    curvature: float = -0.5
    load_loss: float = 0.1
    #: Load of the largest stiffness, relative to the static load.
    stiffest: float = 2.0
    #: Longitudinal slip stiffness per load.
    longitudinal: float = 20.0
    relaxation: float = 0.3
    #: Time constant of the load transfer, s, and deceleration by drag at 1 m/s, 1/m.
    settling: float = 0.05
    drag: float = 3e-4

    @property
    def base(self) -> float:
        return self.front + self.rear

    def static_loads(self, mass: float | None = None) -> tuple[float, float]:
        """Return the static load of one tyre of each axle."""
        weight = 0.5 * (self.mass if mass is None else mass) * GRAVITY / self.base
        return weight * self.rear, weight * self.front


#: Mid-size car that understeers.
CAR = Car()


def magic_formula(
    slip: float, load: float, friction: float, car: Car, axle: int, nominal: float
) -> float:
    """Return the lateral force of one tyre at a slip angle (rad) and a load (N)."""
    if load <= 0.0 or friction <= 0.0:
        return 0.0
    peak = friction * load * max(1.0 - car.load_loss * (load / nominal - 1.0), 0.3)
    # sin(2 atan x) = 2 x / (1 + x²)
    x, x0 = load / (nominal * car.stiffest), 1.0 / car.stiffest
    stiffness = car.stiffness[axle] * (x / (1.0 + x * x)) / (x0 / (1.0 + x0 * x0))
    s = stiffness / (car.shape * peak) * slip
    return peak * math.sin(car.shape * math.atan(s - car.curvature * (s - math.atan(s))))


@dataclass(frozen=True)
class Scenario:
    """Inputs of a drive as functions of time."""

    duration: float
    speed: float
    steering: Callable[[float], float]
    #: Desired longitudinal acceleration, m/s².
    thrust: Callable[[float], float] = lambda t: 0.0
    #: Friction at the left and at the right wheels.
    friction: Callable[[float], tuple[float, float]] = lambda t: (0.95, 0.95)
    #: Bank angle of the road, rad, positive if the left side is higher.
    bank: Callable[[float], float] = lambda t: 0.0
    car: Car = CAR
    #: Constant errors of yaw rate (rad/s) and lateral acceleration (m/s²).
    bias: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Drive:
    """Measurements and truth of a drive, with one entry per sample."""

    name: str
    times: Floats
    speed: Floats
    steering: Floats
    yaw_rate: Floats
    lateral_acceleration: Floats
    longitudinal_acceleration: Floats
    #: Rim speeds ω R of the four wheels, m/s, shape (n, 4).
    wheel_speeds: Floats
    truth: Floats
    #: True values without noise: forward and lateral speed, yaw rate, specific forces, loads (n, 4), friction, bank.
    true: dict[str, Floats] = field(repr=False)
    car: Car = CAR

    def recording(self) -> dict[str, Floats]:
        """Return the arguments of `Recording` that every version of the package has."""
        names = "times", "speed", "steering", "yaw_rate", "lateral_acceleration"
        return {name: getattr(self, name) for name in names}


class Motion:
    """Equations of motion.

    The state holds forward and lateral speed, yaw rate, four lagged slip angles, and the lagged longitudinal and
    lateral acceleration that determine the loads.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario, self.car = scenario, scenario.car
        car = self.car
        static = car.static_loads()
        self.static = static[0], static[0], static[1], static[1]
        self.nominal = car.static_loads(car.nominal_mass)

    def loads(self, ax: float, ay: float) -> Four:
        """Return the wheel loads, at least zero."""
        car, s = self.car, self.static
        pitch = 0.5 * car.mass * ax * car.height / car.base
        roll = car.mass * ay * car.height / car.track
        front, rear = car.roll_share * roll, (1.0 - car.roll_share) * roll
        return (
            max(s[0] - pitch - front, 0.0), max(s[1] - pitch + front, 0.0),
            max(s[2] + pitch - rear, 0.0), max(s[3] + pitch + rear, 0.0),
        )  # fmt: skip

    def rates(self, t: float, x: tuple[float, ...]) -> tuple[tuple[float, ...], dict[str, Any]]:
        """Return the derivative of the state, and the forces and wheel speeds."""
        car, scenario = self.car, self.scenario
        vx, vy, r, ax_lag, ay_lag = x[0], x[1], x[2], x[7], x[8]
        delta, (left, right) = scenario.steering(t), scenario.friction(t)
        loads = self.loads(ax_lag, ay_lag)
        # The driver compensates the drag. Rear-wheel drive; the front wheels have 70 % of the brake force.
        wanted = scenario.thrust(t) + car.drag * vx * abs(vx)
        share = (0.35, 0.35, 0.15, 0.15) if wanted < 0.0 else (0.0, 0.0, 0.5, 0.5)
        force_x = force_y = moment = 0.0
        slopes, wheels = [], []
        for i in range(4):
            axle, side = (0 if i < 2 else 1), (0.5 if i % 2 == 0 else -0.5) * car.track
            at = car.front if axle == 0 else -car.rear
            friction = left if i % 2 == 0 else right
            turn = delta if axle == 0 else 0.0
            cos, sin = math.cos(turn), math.sin(turn)
            px, py = vx - r * side, vy + r * at
            wx, wy = px * cos + py * sin, py * cos - px * sin
            slip = math.atan2(-wy, abs(wx)) if wx or wy else 0.0
            slopes.append(math.hypot(wx, wy) / car.relaxation * (slip - x[3 + i]))
            most = friction * loads[i]
            along = car.mass * wanted * share[i]
            along = min(max(along, -0.95 * most), 0.95 * most)
            left_over = math.sqrt(max(1.0 - (along / most) ** 2, 0.0)) if most > 0.0 else 0.0
            across = left_over * magic_formula(
                x[3 + i], loads[i], friction, car, axle, self.nominal[axle]
            )
            fx, fy = along * cos - across * sin, along * sin + across * cos
            force_x, force_y = force_x + fx, force_y + fy
            moment += at * fy - side * fx
            spin = 1.0 + along / (car.longitudinal * loads[i]) if loads[i] > 0.0 else 1.0
            wheels.append(wx * spin)
        force_x -= car.mass * car.drag * vx * abs(vx)
        ax, ay = force_x / car.mass, force_y / car.mass
        change = (
            ax + vy * r,
            ay - GRAVITY * math.sin(scenario.bank(t)) - vx * r,
            moment / car.inertia,
            *slopes,
            (ax - ax_lag) / car.settling,
            (ay - ay_lag) / car.settling,
        )
        return change, {"ax": ax, "ay": ay, "loads": loads, "wheels": wheels}


def simulate(scenario: Scenario) -> dict[str, Floats]:
    """Return the motion at the sampling times, integrated by the Runge-Kutta method of order 4."""
    motion = Motion(scenario)
    x: tuple[float, ...] = (scenario.speed, *(0.0,) * 8)
    count, inner = round(scenario.duration / PERIOD) + 1, round(PERIOD / STEP)
    rows: dict[str, list[Any]] = {}

    def ahead(slope: tuple[float, ...], h: float) -> tuple[float, ...]:
        return tuple(a + h * b for a, b in zip(x, slope, strict=True))

    for k in range(count):
        t = k * PERIOD
        _, seen = motion.rates(t, x)
        seen |= {"times": t, "vx": x[0], "vy": x[1], "yaw_rate": x[2]}
        seen |= {"steering": scenario.steering(t), "bank": scenario.bank(t)}
        seen["friction"] = scenario.friction(t)
        for name, value in seen.items():
            rows.setdefault(name, []).append(value)
        for i in range(inner):
            s = t + i * STEP
            k1, _ = motion.rates(s, x)
            k2, _ = motion.rates(s + 0.5 * STEP, ahead(k1, 0.5 * STEP))
            k3, _ = motion.rates(s + 0.5 * STEP, ahead(k2, 0.5 * STEP))
            k4, _ = motion.rates(s + STEP, ahead(k3, STEP))
            parts = zip(k1, k2, k3, k4, strict=True)
            x = ahead(tuple((a + 2 * b + 2 * c + d) / 6 for a, b, c, d in parts), STEP)
    return {name: np.array(values, dtype=float) for name, values in rows.items()}


def gain(speed: float, car: Car = CAR) -> float:
    """Return the steering angle per lateral acceleration in a slow steady turn, rad s²/m."""
    front, rear = (2.0 * stiffness for stiffness in car.stiffness)
    return car.base / speed**2 + car.mass / car.base * (car.rear / front - car.front / rear)


def wave(amplitude: float, frequency: float, start: float = 1.0, cycles: float = math.inf) -> Any:
    """Return a sine of time that starts at `start` and ends after some cycles."""
    end = start + cycles / frequency
    turn = 2.0 * math.pi * frequency
    return lambda t: amplitude * math.sin(turn * (t - start)) if start <= t < end else 0.0


def ramp(*knots: tuple[float, float]) -> Any:
    """Return a piecewise linear function of time through (time, value)."""
    times, values = zip(*knots, strict=True)

    def value(t: float) -> float:
        if t <= times[0]:
            return float(values[0])
        for k in range(1, len(times)):
            if t < times[k]:
                part = (t - times[k - 1]) / (times[k] - times[k - 1])
                return float(values[k - 1] + part * (values[k] - values[k - 1]))
        return float(values[-1])

    return value


def dwell(amplitude: float, frequency: float = 0.7, start: float = 1.0) -> Any:
    """Return a sine with a dwell of 0.5 s at its second extreme (ISO 19365)."""
    hold = start + 0.75 / frequency
    whole = wave(amplitude, frequency, start, 1.0)

    def value(t: float) -> float:
        if hold <= t < hold + 0.5:
            return -amplitude
        return float(whole(t if t < hold else t - 0.5))

    return value


def both(knots: Any) -> Any:
    """Return the same friction for the left and the right wheels."""
    return lambda t: (knots(t), knots(t))


def _circle() -> Any:
    """Return the steering of a circle of about 42 m at a speed that rises from 6 m/s at 0.5 m/s²."""

    def value(t: float) -> float:
        speed = 6.0 + 0.5 * max(t - 2.0, 0.0)
        return min(t / 1.5, 1.0) * gain(speed) * speed**2 / 42.0

    return value


def _parking() -> Any:
    return ramp((1, 0), (3, 0.45), (8, 0.45), (11, -0.5), (16, -0.5), (19, 0.2), (25, 0))


LANE_CHANGE = Scenario(12.0, 25.0, wave(6.0 * gain(25.0), 0.4, 2.0, 1.0))
SERPENTINE = Scenario(15.0, 18.0, wave(6.0 * gain(18.0), 0.45, 1.0, 5.0))

SCENARIOS: dict[str, Scenario] = {
    "lane-change": LANE_CHANGE,
    "serpentine": SERPENTINE,
    "step-steer": Scenario(10.0, 25.0, ramp((2.0, 0.0), (2.15, 6.5 * gain(25.0)))),
    "sine-with-dwell": Scenario(9.0, 22.0, dwell(9.0 * gain(22.0))),
    "steady-circle": Scenario(32.0, 6.0, _circle(), thrust=ramp((2.0, 0.0), (2.2, 0.55))),
    "ice": replace(
        SERPENTINE,
        steering=wave(3.5 * gain(18.0), 0.4, 1.0),
        friction=lambda t: (0.95 if t < 6.0 else 0.3, 0.95 if t < 6.1 else 0.3),
    ),
    "banked-road": Scenario(
        20.0, 28.0, wave(2.0 * gain(28.0), 0.15, 2.0), bank=ramp((6, 0), (9, 0.08), (14, 0.08), (17, 0)),
    ),
    "braking-in-a-turn": Scenario(
        10.0, 27.0, ramp((1.5, 0.0), (2.2, 4.5 * gain(27.0))), thrust=ramp((5, 0), (5.3, -4), (8, -4)),
    ),
    "spin": Scenario(
        7.0, 18.0, wave(4.2 * gain(18.0), 0.4, 2.0, 2.5), friction=both(lambda t: 0.35), thrust=ramp((3, 0), (3.5, 0.8)),
    ),
    "parking": Scenario(26.0, 2.0, _parking(), thrust=ramp((10, 0), (11, -0.3), (13, 0), (16, 0.4), (18, 0))),
    "highway": Scenario(
        30.0, 35.0,
        lambda t: gain(35.0) * (0.8 * math.sin(0.5 * t) + 0.5 * math.sin(1.3 * t + 1.0)),
    ),
    "mass": replace(SERPENTINE, car=replace(CAR, mass=1.2 * CAR.mass, inertia=1.2 * CAR.inertia)),
    "bias": replace(SERPENTINE, bias=(0.01, 0.3)),
}  # fmt: skip

#: Standard deviations of the sensors: speed, wheel speeds, yaw rate, and both accelerations.
NOISE = {"speed": 0.03, "wheels": 0.05, "yaw_rate": 0.002, "acceleration": 0.05}


@functools.lru_cache(maxsize=32)
def _motion(name: str) -> dict[str, Floats]:
    return simulate(SCENARIOS[name])


def drive(name: str, seed: int = 0) -> Drive:
    """Return the drive of a scenario with the sensor noise of a seed."""
    scenario, true = SCENARIOS[name], _motion(name)
    rng = np.random.default_rng([seed, sorted(SCENARIOS).index(name)])
    n = len(true["times"])
    return Drive(
        name=name,
        times=true["times"],
        speed=np.maximum(true["vx"] + NOISE["speed"] * rng.normal(size=n), 0.0),
        steering=true["steering"],
        yaw_rate=true["yaw_rate"] + scenario.bias[0] + NOISE["yaw_rate"] * rng.normal(size=n),
        lateral_acceleration=true["ay"]
        + scenario.bias[1]
        + NOISE["acceleration"] * rng.normal(size=n),
        longitudinal_acceleration=true["ax"] + NOISE["acceleration"] * rng.normal(size=n),
        wheel_speeds=np.maximum(true["wheels"] + NOISE["wheels"] * rng.normal(size=(n, 4)), 0.0),
        truth=np.arctan2(true["vy"], true["vx"]),
        true=true,
        car=scenario.car,
    )
