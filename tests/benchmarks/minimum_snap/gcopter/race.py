"""Tracks, GCOPTER, toppra and a simulation for the race through gates.

GCOPTER: Wang, Zhou, Xu and Gao, IEEE Transactions on Robotics 38(5), 2022. Its headers are not part of
this project: the benchmark needs them in ``shared/peers/gcopter`` beside the checkout, g++ and Eigen.
toppra: Pham and Pham, IEEE Transactions on Robotics 34(3), 2018, from PyPI.
"""

from __future__ import annotations

import shutil
import subprocess
from math import perm
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from crosstrack.models import Gate, Quadrotor, TimeAllocation, Trajectory

__all__ = [
    "QUAD",
    "Flight",
    "Retimed",
    "Track",
    "allocation",
    "attitudes",
    "compile_peer",
    "fly",
    "make_track",
    "race",
    "retime",
    "slow_down",
]

Floats = Any

#: Vehicle of all tracks: that of GCOPTER's example (0.61 kg), without drag, with more body rate.
QUAD = Quadrotor(mass=0.61, thrust=(2.0, 12.0), tilt=1.05, body_rate=4.2, speed=8.0)
#: Weight of time, weight of penalties, smoothing, instants per piece, and tolerance of GCOPTER. Weights
#: of 1e2 to 1e5 and penalties of 1e4 to 1e5 were tried: this pair has the shortest times after slowing
#: down to the limits.
SETTINGS = (1e4, 1e5, 1e-2, 16, 1e-5)
#: Vertices of a gate.
VERTICES = 8


#: Time between two attitudes for the averaged body rate, s.
AVERAGED = 0.05
#: Times over which the progress of toppra's motion is averaged, s.
WINDOWS = (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.6, 0.8)


class Track(NamedTuple):
    """Start, polygons of the gates, shape (gates, vertices, 3), and goal."""

    start: Floats
    gates: Floats
    goal: Floats


class Flight(NamedTuple):
    """Largest values of a simulated flight, relative to their limits, and the distance from gates."""

    speed: float
    thrust: float
    lowest: float
    tilt: float
    body_rate: float
    #: Largest distance of the integrated path from a gate, m.
    apart: float
    #: Largest distance of the integrated path from the goal, m.
    drift: float

    @property
    def worst(self) -> float:
        """Largest share of a limit."""
        return max(self[:5])


def make_track(seed: int) -> Track:
    """Return a random track of 4 to 12 gates of 0.5 m, 4 to 8 m apart, that face their neighbours."""
    generator = np.random.default_rng(seed)
    points = [np.zeros(3)]
    for _ in range(int(generator.integers(5, 14))):
        way = generator.standard_normal(3) * [1.0, 1.0, 0.3]
        points.append(points[-1] + way / np.linalg.norm(way) * generator.uniform(4.0, 8.0))
    angle = 2.0 * np.pi * np.arange(VERTICES) / VERTICES
    gates = []
    for before, point, after in zip(points, points[1:], points[2:], strict=False):
        across = np.linalg.svd((after - before)[None])[2][1:]
        gates.append(point + 0.5 * (np.stack([np.cos(angle), np.sin(angle)], axis=1) @ across))
    return Track(points[0], np.array(gates), points[-1])


def allocation(track: Track, pieces: int, order: int) -> TimeAllocation:
    """Return the problem of minimum time with `pieces` polynomials between gates."""
    free: list[Any] = [[None] * 3] * ((len(track.gates) + 1) * pieces - 1)
    gates = [Gate((k + 1) * pieces, polygon=gate) for k, gate in enumerate(track.gates)]
    waypoints = [track.start.tolist(), *free, track.goal.tolist()]
    return TimeAllocation(waypoints, order=order, gates=gates, vehicle=QUAD, minimise="time")


# -- GCOPTER -----------------------------------------------------------------------------------------


def compile_peer(folder: Path) -> Path | str:
    """Return the compiled program, or the reason why it cannot be compiled."""
    peers = Path(__file__).resolve().parents[5] / "shared" / "peers"
    eigen = Path("/usr/include/eigen3")
    compiler = shutil.which("g++")
    if compiler is None:
        return "g++ is not installed"
    if not (peers / "gcopter" / "gcopter.hpp").exists():
        return "the headers of GCOPTER are absent"
    if not eigen.exists():
        return "Eigen is not installed"
    program = folder / "race"
    command = [compiler, "-O3", "-march=native", "-std=c++14", "-w", f"-I{peers}", f"-I{eigen}"]
    source = Path(__file__).with_name("race.cpp")
    subprocess.run([*command, str(source), "-o", str(program)], check=True)
    return program


def race(
    program: Path, track: Track, pieces: int, repetitions: int = 3
) -> tuple[float, Trajectory | None]:
    """Return the least seconds of CPU of GCOPTER on a track, and its trajectory; None on failure."""
    points = np.concatenate([[track.start, track.goal], track.gates.reshape(-1, 3)])
    weight, penalty, smoothing, instants, tolerance = SETTINGS
    numbers = [
        1, QUAD.speed, QUAD.body_rate, QUAD.tilt, *QUAD.thrust, QUAD.mass, QUAD.gravity, weight, penalty,
        smoothing, instants, tolerance, pieces, repetitions, *(points.min(axis=0) - 3.0),
        *(points.max(axis=0) + 3.0), *track.start, *track.goal, len(track.gates),
    ]  # fmt: skip
    for gate in track.gates:
        numbers += [len(gate), *gate.ravel()]
    text = " ".join(str(number) for number in numbers)
    output = subprocess.run(
        [str(program)], input=text, capture_output=True, text=True, timeout=120, check=True
    ).stdout
    words = output[output.rindex("track ") :].split()[1:]
    values = np.array([float(word) for word in words])
    body = values[2:].reshape(-1, 19)
    if not len(body) or not np.isfinite(body).all():
        return float(values[0]), None
    durations = body[:, 0]
    powers = body[:, 1:].reshape(-1, 3, 6)[:, :, ::-1].swapaxes(1, 2)
    scaled = powers * (durations[:, None] ** np.arange(6))[:, :, None]
    times = np.concatenate([[0.0], np.cumsum(durations)])
    return float(values[0]), Trajectory(times, scaled)


def slow_down(plan: Trajectory) -> float:
    """Return the duration of a plan after the least uniform slowing that keeps the limits.

    A plan within its limits is sped up in the same way.
    """

    def worst(factor: float) -> float:
        return fly(Trajectory(plan.times * factor, plan.coefficients), None, 1000.0).worst

    low, high = 0.2, 1.0
    while worst(high) > 1.0 and high < 1e3:
        low, high = high, 1.1 * high
    while high - low > 1e-4 * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if worst(middle) <= 1.0 else (middle, high)
    return high * plan.duration


# -- simulation --------------------------------------------------------------------------------------


def _derivative(plan: Trajectory, t: Floats, order: int) -> Floats:
    """Return a derivative by Horner's method in seconds, apart from the code of the package."""
    edges = np.asarray(plan.times)
    at = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, len(edges) - 2)
    long = edges[at + 1] - edges[at]
    since = t - edges[at]
    value = np.zeros((len(t), 3))
    for power in range(plan.coefficients.shape[1] - 1, order - 1, -1):
        coefficient = plan.coefficients[at, power] / (long**power)[:, None]
        value = value * since[:, None] + perm(power, order) * coefficient
    return value


def attitudes(acceleration: Floats, apart: int = 1) -> tuple[Floats, Floats, Floats, Floats]:
    """Return force of the thrust, its norm, its axis, and the angles between attitudes `apart` instants apart."""
    force = QUAD.mass * (acceleration + np.array([0.0, 0.0, QUAD.gravity]))
    size = np.linalg.norm(force, axis=1)
    axis = force / size[:, None]
    half = np.sqrt(2.0 * (1.0 + axis[:, 2]))
    attitude = np.stack([half / 2.0, -axis[:, 1] / half, axis[:, 0] / half, 0.0 * half], axis=1)
    # The sine of half the rotation is accurate for small angles.
    w, v = attitude[:, :1], attitude[:, 1:]
    before, after = slice(None, -apart), slice(apart, None)
    turn = w[before] * v[after] - w[after] * v[before] - np.cross(v[before], v[after])
    return force, size, axis, 2.0 * np.arcsin(np.minimum(np.linalg.norm(turn, axis=1), 1.0))


def usage(velocity: Floats, acceleration: Floats, step: float) -> tuple[float, ...]:
    """Return the largest speed, thrust, lowest thrust, tilt and body rate relative to their limits."""
    _, size, axis, angle = attitudes(acceleration)
    low, high = QUAD.thrust
    return (
        float(np.linalg.norm(velocity, axis=1).max()) / QUAD.speed,
        float(size.max()) / high,
        low / float(size.min()),
        float(np.arccos(np.clip(axis[:, 2], -1.0, 1.0)).max()) / QUAD.tilt,
        float(angle.max()) / step / QUAD.body_rate,
    )


def fly(plan: Trajectory, track: Track | None, rate: float = 10_000.0) -> Flight:
    """Simulate the flight at `rate` Hz from the commands of thrust and attitude.

    The attitude is the smallest rotation of the vertical to the thrust. Body rates are the angles
    between consecutive attitudes per step. The motion is integrated from the commanded forces.
    """
    steps = int(np.ceil(plan.duration * rate))
    t = plan.times[0] + plan.duration * np.arange(steps + 1) / steps
    step = plan.duration / steps
    acceleration = _derivative(plan, t, 2)
    pushed = attitudes(acceleration)[0] / QUAD.mass - np.array([0.0, 0.0, QUAD.gravity])
    speed = (
        np.concatenate([np.zeros((1, 3)), np.cumsum(0.5 * (pushed[1:] + pushed[:-1]), axis=0)])
        * step
    )
    speed += _derivative(plan, t[:1], 1)
    path = (
        np.concatenate([np.zeros((1, 3)), np.cumsum(0.5 * (speed[1:] + speed[:-1]), axis=0)]) * step
    )
    path += _derivative(plan, t[:1], 0)
    apart = 0.0
    if track is not None:
        pieces = plan.segments // (len(track.gates) + 1)
        for number, polygon in enumerate(track.gates, start=1):
            at = (plan.times[number * pieces] - plan.times[0]) / step
            first = min(int(at), steps - 1)
            point = path[first] + (at - first) * (path[first + 1] - path[first])
            centre = polygon.mean(axis=0)
            across, along = polygon[0] - centre, polygon[2] - centre
            normal = np.cross(across, along)
            normal /= np.linalg.norm(normal)
            edges = np.roll(polygon, -1, axis=0) - polygon
            outward = np.cross(edges, normal)
            outward /= np.linalg.norm(outward, axis=1)[:, None]
            outside = np.einsum("ij,ij->i", point - polygon, outward).max()
            apart = max(apart, abs(float((point - centre) @ normal)), float(outside))
    goal = _derivative(plan, t[-1:], 0)[0]
    drift = float(np.linalg.norm(path[-1] - goal))
    return Flight(*usage(speed, acceleration, step), apart, drift)


# -- toppra ------------------------------------------------------------------------------------------


class Arc:
    """The path of a plan by its length, m, with tangent and curvature."""

    def __init__(self, plan: Trajectory, samples: int = 1000) -> None:
        self.spline = plan.to_ppoly()
        steps = samples * plan.segments
        # The curvature is not finite at rest: the first and the last instants are left out.
        rest = 1e-4 * plan.duration
        self.times = np.linspace(plan.times[0] + rest, plan.times[-1] - rest, steps + 1)
        paces = np.linalg.norm(self.spline(self.times, nu=1), axis=1)
        ways = 0.5 * (paces[1:] + paces[:-1]) * np.diff(self.times)
        self.lengths = np.append(0.0, np.cumsum(ways))

    def lengths_at(self, times: Floats) -> Floats:
        """Return the lengths at instants of the plan."""
        lengths: Floats = np.interp(times, self.times, self.lengths)
        return lengths

    def __call__(self, length: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the points, tangents and curvatures at lengths along the path."""
        t = np.interp(length, self.lengths, self.times)
        first, second = self.spline(t, nu=1), self.spline(t, nu=2)
        pace = np.linalg.norm(first, axis=1)[:, None]
        tangent = first / pace
        across = second - (second * tangent).sum(axis=1)[:, None] * tangent
        return self.spline(t), tangent, across / pace**2


class Progress:
    """Motion s(t) along a path, with the second derivative constant between two points of a grid."""

    def __init__(self, grid: Floats, pace: Floats) -> None:
        self.grid, self.pace = grid, pace
        lasting = 2.0 * np.diff(grid) / np.maximum(pace[1:] + pace[:-1], 1e-12)
        self.times = np.append(0.0, np.cumsum(lasting))
        self.bend = np.diff(pace**2) / (2.0 * np.diff(grid))
        areas = grid[:-1] * lasting + pace[:-1] * lasting**2 / 2.0 + self.bend * lasting**3 / 6.0
        self.areas = np.append(0.0, np.cumsum(areas))

    def __call__(self, t: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return the integral of s, s and its two derivatives; the motion rests before and after."""
        inside = np.clip(t, 0.0, self.times[-1])
        at = np.clip(np.searchsorted(self.times, inside, side="right") - 1, 0, len(self.bend) - 1)
        since = inside - self.times[at]
        s, pace, bend = self.grid[at], self.pace[at], self.bend[at]
        area = self.areas[at] + s * since + pace * since**2 / 2.0 + bend * since**3 / 6.0
        area += (t < 0.0) * t * self.grid[0] + np.maximum(t - self.times[-1], 0.0) * self.grid[-1]
        moves = t == inside
        position = s + pace * since + bend * since**2 / 2.0
        return area, position, moves * (pace + bend * since), moves * bend

    def averaged(self, t: Floats, window: float) -> tuple[Floats, Floats, Floats]:
        """Return the mean of s over the last `window` seconds and its two derivatives.

        The path remains the same, and the jumps of the second derivative become ramps.
        """
        now, before = self(t), self(t - window)
        s, pace, bend = ((now[k] - before[k]) / window for k in range(3))
        return s, pace, bend


class Retimed(NamedTuple):
    """Durations of toppra's motions, s, and the largest body rates of the first relative to the limit."""

    duration: float
    #: Largest angle between two instants of the simulation, over the angle that the limit allows.
    body_rate: float
    #: The same, between instants AVERAGED s apart.
    averaged: float
    #: Duration of the motion that keeps all limits in the simulation.
    within: float


def retime(plan: Trajectory, points: int = 60, directions: int = 300) -> Retimed | None:
    """Return the motion of toppra along the path of a plan; None if it fails.

    It has the limits of speed, largest thrust and tilt. The cones of thrust and tilt are replaced by
    planes that touch them, which is a relaxation. It has no limit of the lowest thrust, which is not
    convex, or of the body rate, which depends on the jerk. Its duration is therefore a lower bound for
    every motion along the path, but for the error of the grid. The motion within the limits is that of
    toppra with its progress averaged over the best of WINDOWS, and slowed down uniformly.
    """
    import toppra
    from toppra.constraint import ConstraintType, DiscretizationType, LinearConstraint

    toppra.setup_logging("CRITICAL")
    generator = np.random.default_rng(0)
    ball = generator.standard_normal((directions, 3))
    ball /= np.linalg.norm(ball, axis=1)[:, None]
    around = 2.0 * np.pi * np.arange(60) / 60
    cone = np.stack([np.cos(around), np.sin(around), np.full(60, -np.tan(QUAD.tilt))], axis=1)
    gravity = np.array([0.0, 0.0, QUAD.gravity])
    planes = np.concatenate([ball, cone])
    most = (
        np.concatenate([np.full(directions, QUAD.thrust[1] / QUAD.mass), np.zeros(60)])
        - planes @ gravity
    )

    class Limits(LinearConstraint):
        def __init__(self) -> None:
            super().__init__()
            self.dof = 3
            self.discretization_type = DiscretizationType.Interpolation
            self._constraint_type = ConstraintType.CanonicalLinear
            self.identical = True

        def compute_constraint_params(self, path: Any, gridpoints: Any) -> Any:
            first, second = path(gridpoints, 1), path(gridpoints, 2)
            square = np.maximum((first**2).sum(axis=1), 1e-12)
            bound = np.stack([np.zeros(len(square)), QUAD.speed**2 / square], axis=1)
            return first, second, np.zeros_like(first), planes, most, None, bound

    curve = Arc(plan)

    class Path(toppra.interpolator.AbstractGeometricPath):
        dof = 3
        path_interval = np.array([0.0, curve.lengths[-1]])

        def __call__(self, way: Any, order: int = 0) -> Any:
            return curve(way)[order]

    inner = [
        np.linspace(a, b, points, endpoint=False)
        for a, b in zip(plan.times, plan.times[1:], strict=False)
    ]
    grid = curve.lengths_at(np.append(np.concatenate(inner), plan.times[-1]))
    solver = toppra.algorithm.TOPPRA([Limits()], Path(), gridpoints=grid, solver_wrapper="seidel")
    _, speed, _ = solver.compute_parameterization(0.0, 0.0)
    if speed is None or not np.isfinite(speed).all():
        return None
    progress = Progress(grid, speed)

    def motion(window: float, step: float) -> tuple[Floats, Floats]:
        """Return the velocity and the acceleration along the path at instants `step` apart."""
        t = np.arange(0.0, progress.times[-1] + window, step)
        s, pace, bend = progress.averaged(t, window) if window else progress(t)[1:]
        _, tangent, curvature = curve(s)
        return pace[:, None] * tangent, bend[:, None] * tangent + (pace**2)[:, None] * curvature

    def slowing(window: float, step: float, high: float = 1e3) -> float:
        """Return the least uniform slowing, to 1e-4, that keeps the limits; at most `high`."""
        velocity, acceleration = motion(window, step)
        low = 1.0
        while high - low > 1e-4 * low:
            middle = min(0.5 * (low + high), 1.1 * low)
            shares = usage(velocity / middle, acceleration / middle**2, middle * step)
            low, high = (low, middle) if max(shares) <= 1.0 else (middle, high)
        return high

    duration = float(progress.times[-1])
    within = min((slowing(window, 1e-3) * (duration + window), window) for window in WINDOWS)
    window = within[1]
    acceleration = motion(0.0, 1e-4)[1]
    instants = round(AVERAGED / 1e-4)
    rates = [
        float(attitudes(acceleration, apart)[3].max()) / (apart * 1e-4) / QUAD.body_rate
        for apart in (1, instants)
    ]
    return Retimed(duration, *rates, slowing(window, 1e-4) * (duration + window))
