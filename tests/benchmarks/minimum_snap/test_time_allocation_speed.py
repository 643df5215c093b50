"""How long an allocation of times takes, our descent beside Ipopt on the nonlinear program.

``pytest tests/benchmarks/minimum_snap/test_time_allocation_speed.py -s`` prints the tables.
"""

import statistics
import time

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.models import TimeAllocation

#: How many times the processor's time of our descent Ipopt needs, the geometric mean over the limits:
#: what our descent must be worth to be kept.
WORTH = 3.0
REPEATS = 7


def walk(knots, seed):
    """Waypoints of a random walk."""
    steps = np.random.default_rng(seed).uniform(-2, 2, (knots, 3))
    return np.cumsum(steps, axis=0)


def measured(model, backend="time-gradient", repeats=REPEATS):
    """The solution, the median and the least of ``seconds.solve``, and the least time of the CPU."""
    wall, cpu = [], []
    for _ in range(repeats):
        begin = time.process_time()
        found = ct.solve(model, backend, isolate=False)
        cpu.append(time.process_time() - begin)
        wall.append(found.seconds["solve"])
    return found, statistics.median(wall), min(wall), min(cpu)


def line(label, found, median, least, cpu):
    counts = found.statistics
    print(
        f"{label:34} {found.termination!s:18} {1e3 * median:8.1f} {1e3 * least:8.1f} "
        f"{1e3 * cpu:8.1f} {counts.get('evaluations', 0):6} {counts.get('gradient', 0):9.1e}"
    )


HEAD = (
    f"{'':34} {'ended':18} {'median':>8} {'least':>8} {'cpu':>8} {'evals':>6} {'gradient':>9}  (ms)"
)


@pytest.mark.parametrize("seed", [1, 2, 3, 4, 5])
def test_twenty_waypoints_with_limits(seed):
    """Limits on velocity and acceleration at a share of what the free optimum reaches.

    Second derivatives of the barrier were measured to reduce these times to 0.55 at best.
    """
    points = walk(20, seed)
    free = ct.solve(TimeAllocation(points, 100.0)).plan
    peaks = [
        np.maximum(-found.least, found.largest).max()
        for found in (free.extremes(1), free.extremes(2))
    ]
    print("\n" + HEAD)
    for share in (1.0, 0.8, 0.6, 0.4):
        model = TimeAllocation(
            points, 100.0, velocity_limit=share * peaks[0], acceleration_limit=share * peaks[1]
        )
        found, *times = measured(model)
        line(f"seed {seed}, {share:.0%} of the free peaks", found, *times)
        assert found.termination == "locally_optimal"
        assert found.verification.ok
        assert not found.verification.within_tolerance


@pytest.mark.parametrize("segments", [5, 20, 100])
def test_ipopt_beside_the_descent(segments):
    """Ratios of ``seconds.solve`` and of the whole call, without limits and at shares of the peaks."""
    pytest.importorskip("casadi", reason="casadi is not installed")
    points = walk(segments + 1, 1)
    free = TimeAllocation(points, 100.0)
    path = ct.solve(free).plan
    peaks = [
        np.maximum(-found.least, found.largest).max()
        for found in (path.extremes(1), path.extremes(2))
    ]
    print(
        f"\n{'':20} {'solve, ours':>12} {'Ipopt':>8} {'ratio':>6} {'cpu of all':>12} {'Ipopt':>8}"
    )
    ratios = []
    for share in (None, 1.0, 0.8, 0.6, 0.4):
        limits = {} if share is None else {
            "velocity_limit": share * peaks[0], "acceleration_limit": share * peaks[1],
        }  # fmt: skip
        model = TimeAllocation(points, 100.0, **limits)
        times = 1 if segments == 100 else 3
        ours, *own = measured(model, repeats=times)
        other, *rival = measured(model, "ipopt", repeats=times)
        assert other.primal_bound == pytest.approx(ours.primal_bound, rel=1e-6)
        ratios.append(rival[2] / own[2])
        label = f"{segments}, no limits" if share is None else f"{segments}, {share:.0%}"
        print(
            f"{label:20} {1e3 * own[1]:12.1f} {1e3 * rival[1]:8.1f} {rival[1] / own[1]:6.1f} "
            f"{1e3 * own[2]:12.1f} {1e3 * rival[2]:8.1f} {ratios[-1]:6.1f}  (ms)"
        )
    assert np.exp(np.mean(np.log(ratios))) > WORTH


@pytest.mark.parametrize("weight", [1.0, 1e3, 1e5])
def test_prices_from_idle_to_hurried(weight):
    model = TimeAllocation(walk(20, 1), weight, velocity_limit=2.0, acceleration_limit=2.0)
    figures = measured(model)
    print("\n" + HEAD)
    line(f"price {weight:g}", *figures)
    assert figures[0].termination == "locally_optimal"


@pytest.mark.parametrize("knots", [20, 100, 1000, 10_000])
def test_without_limits(knots):
    figures = measured(TimeAllocation(walk(knots, 1), 100.0))
    print("\n" + HEAD)
    line(f"{knots} waypoints, no limits", *figures)
    assert figures[0].termination == "locally_optimal"


@pytest.mark.parametrize("knots", [50, 100, 200])
def test_longer_paths_with_limits(knots):
    model = TimeAllocation(walk(knots, 1), 100.0, velocity_limit=2.0, acceleration_limit=2.0)
    figures = measured(model)
    print("\n" + HEAD)
    line(f"{knots} waypoints with limits", *figures)
    assert figures[0].termination == "locally_optimal"
