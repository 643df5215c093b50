"""Catalogue entries of minimum-derivative trajectories."""

from __future__ import annotations

from functools import partial

import numpy as np

from ...models.fields import Real
from ...models.minimum_snap.model import MinimumDerivative, MinimumSnap
from ...models.minimum_snap.time_allocation import TimeAllocation
from ..catalogue import CatalogueEntry, Provenance, Row, listed
from .corridors import corridor, gates, hurried
from .paths import figure_eight, helix, random_walk, random_waypoints, square, times_by_distance

__all__ = [
    "PAPER",
    "allocation_entries",
    "derivative_entries",
    "paper_walk",
    "reach",
    "snap_entries",
    "times_for_walk",
    "weighted",
]

PAPER = (
    '"Parallel Swarm Intelligent Motion Planning with Energy-Balanced for Multirobot in Obstacle '
    'Environment", Wireless Communications and Mobile Computing, 2021'
)
_MELLINGER = "D. Mellinger, V. Kumar: Minimum snap trajectory generation and control, ICRA 2011"
_RICHTER = "C. Richter, A. Bry, N. Roy: Polynomial trajectory planning, ISRR 2013"
_HOGAN = "T. Flash, N. Hogan: The coordination of arm movements, Journal of Neuroscience 5(7), 1985"

_OURS = "The waypoints are ours; the papers cited publish none for it."
_CORRIDOR = (
    "Ours by seed. Boxes and limits were drawn around a way that keeps each with a margin, so it "
    "is feasible with slack; at the optimum some boxes and limits of both kinds are active."
)
#: Problems of the paper: name, size in words, segments, time of the first knot, remark.
_PAPERS = (
    ("paper", "3 segments", 3, 0.0, ""),
    (
        "paper-5",
        "5 segments",
        5,
        0.0,
        (
            " The paper's powers of absolute time are badly scaled by now: its program's optimality "
            "system has a condition number above 1e20, and some backends fail on it."
        ),
    ),
    (
        "paper-late",
        "5 segments, a minute after the clock began",
        5,
        60.0,
        (
            " It is paper-5 a minute later. In the paper's powers of absolute time few digits or none "
            "are right, and verification rejects what comes out; a segment's own time knows no difference."
        ),
    ),
)
#: Seed of the small corridor. It has turns, and boxes and limits of both kinds are active.
_TURNING = 357
#: Index of the infeasible segment of corridor-infeasible.
_HURRIED = 6


def paper_walk(segments: int, start: float = 0.0) -> MinimumSnap:
    """Return the problem of the paper on a seeded random walk: C², from rest to rest.

    The first knot is at time `start`, s, because the paper's polynomials are of absolute time.
    """
    rest = np.zeros((2, 3))
    points = random_waypoints(segments, 3, seed=2021)
    return MinimumSnap(
        waypoints=points,
        times=np.round(Real(unit="s").coerce("start", start, {}) + times_by_distance(points), 3),
        continuity=2,
        start=rest,
        end=rest,
    )


def reach(distance: float = 0.3, duration: float = 0.8) -> MinimumDerivative:
    """Return the movement of a hand from rest to rest: one segment of minimum jerk.

    With distance d, m, and duration T, s, the optimum is x = d (10 s³ - 15 s⁴ + 6 s⁵) with s = t / T.
    Its objective is 720 d² / T⁵.
    """
    far, long = (
        Real(lower=0, strict=True).coerce(name, value, {})
        for name, value in (("distance", distance), ("duration", duration))
    )
    return MinimumDerivative(
        waypoints=np.array([[0.0], [far]]), times=np.array([0.0, long]), order=3
    )


def weighted() -> MinimumDerivative:
    """Return a problem with weights on velocity, acceleration and snap, of degree 9."""
    points = random_waypoints(6, 2, seed=3)
    return MinimumDerivative(
        waypoints=points,
        times=times_by_distance(points),
        weights=np.array([0.1, 1.0, 0.0, 0.1]),
        degree=9,
        continuity=4,
    )


def _jerk() -> MinimumDerivative:
    points = random_waypoints(8, 3, seed=8)
    return MinimumDerivative(waypoints=points, times=times_by_distance(points), order=3)


def snap_entries() -> tuple[CatalogueEntry, ...]:
    """Return the instances of minimum snap."""
    ours = Provenance.OURS
    walks = [
        Row(
            f"random-{count}",
            f"A random walk of {count} segments in 3-D, 0.5 to 1.5 m long, at 1 m/s",
            partial(random_walk, count, seed=count),
            paper=_RICHTER,
        )
        for count in (10, 100, 1000)
    ]
    papers = [
        Row(
            name,
            f"The paper's own problem, continuous to the acceleration only: {size}",
            partial(paper_walk, count, start),
            "The paper publishes neither coordinates nor times: ours are seeded. Its eq. 25 keeps "
            "acceleration but not jerk continuous, so this is not the minimum-snap spline: the jerk "
            f"jumps at the waypoints.{more}",
            paper=PAPER,
        )
        for name, size, count, start, more in _PAPERS
    ]
    corridors = [
        Row(
            f"corridor-{count}",
            f"A chain of {count} boxes in 3-D with limits of velocity and acceleration",
            partial(corridor, count, seed=seed),
            _CORRIDOR,
        )
        for count, seed in ((10, _TURNING), (1000, 0))
    ]
    rows = (
        Row("figure-eight", "A figure eight in 3-D, 12 segments", figure_eight, provenance=ours),
        Row(
            "figure-eight-yaw",
            "A figure eight in 3-D with yaw along the path as the fourth axis, 12 segments",
            partial(figure_eight, dimensions=4),
            provenance=ours,
        ),
        Row("helix", "Three turns of a helix, 24 segments", helix, provenance=ours),
        Row("square", "Around a square in the plane, 4 segments", square, provenance=ours),
        *walks,
        *papers,
        *corridors,
        Row(
            "corridor-infeasible",
            f"A chain of 10 boxes in which segment {_HURRIED} is too long for its time",
            partial(hurried, 10, _HURRIED, seed=_TURNING),
            "Ours by seed, and infeasible by construction: the velocity limit of segment "
            f"{_HURRIED} is 0.8 of the mean velocity that its two fixed ends demand. Without "
            "that limit it is feasible.",
        ),
        Row(
            "gate-2d",
            "Six slanted rectangles in the plane, as half-spaces, with a velocity limit",
            gates,
            "Ours by seed. Stopping at every gate is feasible and keeps a margin of 0.3 m to every wall.",
        ),
    )
    return listed("minimum-snap", "minimum-snap", _MELLINGER, rows, note=_OURS)


def derivative_entries() -> tuple[CatalogueEntry, ...]:
    """Return the instances that minimise other derivatives or sums of several."""
    optimum = {
        "optimum": 720 * 0.3**2 / 0.8**5,
        "formula": "720 d² / T⁵, from the paper's x = d (10 s³ - 15 s⁴ + 6 s⁵)",
    }
    rows = (
        Row("jerk", "Minimum jerk through a random walk of 8 segments in 3-D", _jerk),
        Row(
            "reach",
            "A hand moves 0.3 m in 0.8 s: one segment of minimum jerk",
            reach,
            "Distance and duration are ours; the shape of the optimum is the paper's.",
            Provenance.OURS,
            optimum,
        ),
        Row(
            "weighted",
            "0.1 velocity² + acceleration² + 0.1 snap², degree 9, C⁴: 6 segments in the plane",
            weighted,
            paper=_RICHTER,
        ),
    )
    return listed("minimum-derivative", "minimum-derivative", _HOGAN, rows, note=_OURS)


def times_for_walk(segments: int, seed: int = 0, *, limited: bool = True) -> TimeAllocation:
    """Return a time allocation problem on a random walk.

    If `limited`, the limits of velocity and acceleration are 0.8 m/s and 1 m/s².
    """
    return TimeAllocation(
        waypoints=random_waypoints(segments, 3, seed=seed),
        time_weight=50.0,
        velocity_limit=np.array([[0.8]]) if limited else None,
        acceleration_limit=np.array([[1.0]]) if limited else None,
    )


def _lap() -> TimeAllocation:
    """Return a time allocation problem on a square with a given total time."""
    return TimeAllocation(waypoints=square().waypoints, total_time=8.0)


def allocation_entries() -> tuple[CatalogueEntry, ...]:
    """Return the instances of time allocation."""
    rows = (
        Row(
            "lap-8s",
            "Around a square in 8 s: when to be at which corner",
            _lap,
            provenance=Provenance.OURS,
        ),
        Row(
            "walk-20",
            "The times of 20 waypoints in 3-D, J + 50 T, without limits",
            partial(times_for_walk, 19, 20, limited=False),
        ),
        Row(
            "walk-20-limited",
            "The times of 20 waypoints in 3-D with limits of velocity and acceleration, J + 50 T",
            partial(times_for_walk, 19, 20),
        ),
    )
    return listed("time-allocation", "time-allocation", _RICHTER, rows, note=_OURS)
