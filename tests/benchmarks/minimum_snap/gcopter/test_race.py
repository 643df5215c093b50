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
from crosstrack.models import TimeAllocation
from crosstrack.solvers.minimum_snap import minco_backend
from crosstrack.solvers.minimum_snap.minco import fastest, limits_of

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[3]))
from benchmarks.measured import write
from race import QUAD, allocation, compile_peer, fly, make_track, race, retime, slow_down

#: Relative excess of a limit, and distance from a gate in m, that is the error of the integration.
NOISE, NEAR = 1e-6, 1e-5


def search_seconds(model: TimeAllocation) -> float:
    """Return the CPU time of the search alone, which GCOPTER's program does too."""
    points = minco_backend.first_points(model)
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


def shares(title: str, values: list[float]) -> str:
    """Return the distribution of ratios, best to worst."""
    array = np.array(values)
    low, middle, high = np.quantile(array, [0.1, 0.5, 0.9])
    return (
        f"{title:46} {len(array):4d} tracks, {array.min():.3f} / {low:.3f} / {middle:.3f} / {high:.3f} / "
        f"{array.max():.3f}, {np.mean(array <= 1.0):.0%} at most 1"
    )


def tabulate(
    order: int,
    pieces: int,
    tracks: int,
    violations: int,
    failures: int,
    ratios: dict[str, list[float]],
) -> None:
    """Write the row of an order and a number of pieces to the table of the page."""
    columns = {
        "order": "", "pieces per leg": "", "tracks": "", "violations at 10 kHz": "", "time / GCOPTER's": ".3f",
        "CPU / GCOPTER's": ".1f", "GCOPTER without a flight": "", "time / toppra's": ".3f",
        "toppra beyond the body rate": "", "its rate in 50 ms / limit": ".1f",
        "time / toppra's within the limits": ".3f",
    }  # fmt: skip
    middle = {name: float(np.median(values)) for name, values in ratios.items()}
    averaged = np.array(ratios["the same, averaged over 50 ms"])
    row = (
        order, pieces, tracks, violations,
        middle["flight time / GCOPTER's within the limits"],
        middle["CPU of the search / GCOPTER's"], failures,
        middle["flight time / toppra's along our curve"],
        int((averaged > 1.0).sum()), float(np.median(averaged)),
        middle["flight time / toppra's within the limits"],
    )  # fmt: skip
    said = (
        "Random tracks of 4 to 12 gates, 4 to 8 m apart. Medians. GCOPTER has the better of one and (if we have more) two polynomials of degree 5 per "
        "leg, slowed down to the limits; CPU is that of both searches. toppra has the limits of speed, largest thrust and tilt, "
        "and follows our curve, so its time is a lower bound along this curve, but for the error of its grid. Its attitude "
        "jumps: the body rate is the angle between attitudes 50 ms apart over that time. Within the limits means that its "
        "progress along the curve is averaged over up to 0.8 s, the best of 13 values, and slowed down until the simulation "
        "accepts all limits, with the body rate and the lowest thrust."
    )
    write(
        "minimum-snap",
        "gates",
        __file__,
        columns,
        [row],
        ("numpy", "toppra"),
        said,
        merge=True,
        keys=2,
    )


@pytest.mark.parametrize(
    ("order", "pieces", "tracks"), [(3, 1, 100), (3, 2, 100), (3, 4, 40), (2, 4, 40)]
)
def test_race(order: int, pieces: int, tracks: int, capsys: Any, tmp_path: Path) -> None:
    program = compile_peer(tmp_path)
    if isinstance(program, str):
        pytest.skip(f"the race needs GCOPTER's program, but {program}")
    has_toppra = importlib.util.find_spec("toppra") is not None
    ct.solve(allocation(make_track(0), pieces, order))  # compiles
    ratios: dict[str, list[float]] = {}
    violations, failures = 0, 0

    def note(name: str, value: float) -> None:
        ratios.setdefault(name, []).append(value)

    with capsys.disabled():
        print(f"\norder {order}, {pieces} pieces per leg; times in s, CPU in ms")
        for seed in range(tracks):
            track = make_track(seed)
            model = allocation(track, pieces, order)
            begin = time.process_time()
            solution = ct.solve(model)
            whole = time.process_time() - begin
            assert solution.plan is not None and solution.verification.ok, (seed, solution)
            flight = fly(solution.plan, track)
            bad = flight.worst > 1.0 + NOISE or max(flight.apart, flight.drift) > NEAR
            violations += bad
            ours, search = solution.plan.duration, search_seconds(model)
            line = f"{seed:3d} {len(track.gates):2d} gates, ours {ours:.3f} ({search * 1e3:.0f} ms)"
            peers = [race(program, track, count, repetitions=1) for count in (1, 2)[:pieces]]
            usable = [
                (within, seconds, peer)
                for seconds, peer in peers
                if peer is not None and (within := slow_down(peer)) <= 3.0 * ours
            ]
            if not usable:
                failures += 1
                line += ", GCOPTER diverged"
            else:
                theirs, seconds, peer = min(usable, key=lambda entry: entry[0])
                other = fly(peer, track)
                line += f", GCOPTER {peer.duration:.3f} at {other.worst:.3f} of a limit, "
                line += f"{theirs:.3f} within them ({seconds * 1e3:.0f} ms)"
                note("flight time / GCOPTER's within the limits", ours / theirs)
                note("flight time / GCOPTER's beyond the limits", ours / peer.duration)
                note("CPU of the search / GCOPTER's", search / seconds)
                note("CPU of the whole call / GCOPTER's", whole / seconds)
            if has_toppra and (best := retime(solution.plan)) is not None:
                note("flight time / toppra's along our curve", ours / best.duration)
                note("flight time / toppra's within the limits", ours / best.within)
                note("body rate of toppra's flight / limit", best.body_rate)
                note("the same, averaged over 50 ms", best.averaged)
                line += (
                    f", toppra {best.duration:.3f} at {best.averaged:.2f} of the body rate in 50 ms, "
                    f"{best.within:.3f} within the limits"
                )
            print(line)
        print("ratios: least / 10 % / median / 90 % / largest")
        for name, values in ratios.items():
            print(shares(name, values))
        print(
            f"violations in the simulation: {violations}; GCOPTER without a usable flight: {failures}"
        )
        print(f"vehicle: {QUAD}")
        if has_toppra:
            tabulate(order, pieces, tracks, violations, failures, ratios)
    assert violations == 0
    assert np.mean(ratios["flight time / GCOPTER's within the limits"]) < 1.0
