"""Minimum time through gates: our flights beside GCOPTER's and toppra's, simulated at 10 kHz.

A flight beyond a limit fails the test, a slow one does not. The output has one line per track and a
summary. Run with ``make bench``, or::

    pytest tests/benchmarks/minimum_snap/gcopter -s
"""

from __future__ import annotations

import importlib.util
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.models import MinimumDerivative, TimeAllocation, Trajectory
from crosstrack.solvers.minimum_snap import minco_backend
from crosstrack.solvers.minimum_snap.minco import fastest, limits_of

sys.path.insert(0, str(Path(__file__).parent))
from race import QUAD, Track, allocation, compile_peer, fly, make_track, race, retime, slow_down

TRACKS = 100
#: Relative excess of a limit, and distance from a gate in m, that is the error of the integration.
NOISE, NEAR = 1e-6, 1e-5


def search_seconds(model: TimeAllocation) -> float:
    """Return the CPU time of the search alone, which GCOPTER's program does too."""
    points = minco_backend._points(model)
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).mean())
    arguments: dict[str, Any] = {
        "regions": minco_backend._regions(model, points, length),
        "jets": np.array(model.unit.jets),
        "rows": minco_backend._rows(model, length),
        "weights": np.array(model.order_weights),
    }
    spent = []
    for _ in range(2):
        begin = time.process_time()
        fastest(points, limits_of(model.vehicle), **arguments)
        spent.append(time.process_time() - begin)
    return min(spent)


def through_centres(track: Track) -> Trajectory:
    """Return the minimum-jerk curve through the centres of the gates, with times by distance."""
    points = np.array([track.start, *track.gates.mean(axis=1), track.goal])
    legs = np.linalg.norm(np.diff(points, axis=0), axis=1)
    times = np.concatenate([[0.0], np.cumsum(legs)])
    return ct.solve(MinimumDerivative(points, times, order=3), "banded").plan


def shares(title: str, values: list[float]) -> str:
    """Return the distribution of ratios, best to worst."""
    array = np.array(values)
    low, middle, high = np.quantile(array, [0.1, 0.5, 0.9])
    return (
        f"{title:46} {len(array):4d} tracks, {array.min():.3f} / {low:.3f} / {middle:.3f} / {high:.3f} / "
        f"{array.max():.3f}, {np.mean(array <= 1.0):.0%} at most 1"
    )


@pytest.mark.parametrize("pieces", [1, 2])
def test_race(pieces: int, capsys: Any, tmp_path: Path) -> None:
    program = compile_peer(tmp_path)
    if isinstance(program, str):
        pytest.skip(f"the race needs GCOPTER's program, but {program}")
    has_toppra = importlib.util.find_spec("toppra") is not None
    ct.solve(allocation(make_track(0), pieces))  # compiles
    ratios: dict[str, list[float]] = {}
    violations, failures = 0, 0

    def note(name: str, value: float) -> None:
        ratios.setdefault(name, []).append(value)

    with capsys.disabled():
        print(f"\n{pieces} pieces per leg; times in s, CPU in ms")
        for seed in range(TRACKS):
            track = make_track(seed)
            model = allocation(track, pieces)
            begin = time.process_time()
            solution = ct.solve(model)
            whole = time.process_time() - begin
            assert solution.plan is not None and solution.verification.ok, (seed, solution)
            flight = fly(solution.plan, track)
            bad = flight.worst > 1.0 + NOISE or max(flight.apart, flight.drift) > NEAR
            violations += bad
            ours, search = solution.plan.duration, search_seconds(model)
            seconds, peer = race(program, track, pieces, repetitions=2 if pieces == 1 else 1)
            line = f"{seed:3d} {len(track.gates):2d} gates, ours {ours:.3f} ({search * 1e3:.0f} ms)"
            if peer is None or (theirs := slow_down(peer)) > 3.0 * ours:
                failures += 1
                line += ", GCOPTER diverged"
            else:
                other = fly(peer, track)
                line += f", GCOPTER {peer.duration:.3f} at {other.worst:.3f} of a limit, "
                line += f"{theirs:.3f} within them ({seconds * 1e3:.0f} ms)"
                note("flight time / GCOPTER's within the limits", ours / theirs)
                note("flight time / GCOPTER's beyond the limits", ours / peer.duration)
                note("CPU of the search / GCOPTER's", search / seconds)
                note("CPU of the whole call / GCOPTER's", whole / seconds)
            if has_toppra:
                for name, curve in (
                    ("our curve", solution.plan),
                    ("centres", through_centres(track)),
                ):
                    best = retime(curve)
                    if best is not None:
                        note(f"flight time / toppra's along {name}", ours / best)
                        line += f", toppra {name} {best:.3f}"
            print(line)
        print("ratios: least / 10 % / median / 90 % / largest")
        for name, values in ratios.items():
            print(shares(name, values))
        print(
            f"violations in the simulation: {violations}; GCOPTER without a usable flight: {failures}"
        )
        print(f"vehicle: {QUAD}")
    assert violations == 0
    assert np.mean(ratios["flight time / GCOPTER's within the limits"]) < 1.0
