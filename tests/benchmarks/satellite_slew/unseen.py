"""Drawn slews that no development decision used, by default and verified.

``python tests/benchmarks/satellite_slew/unseen.py [FIRST LAST] [--formulation NAME]`` prints one row per
slew: termination, objective, CPU seconds of the whole call and of a probe, a fixed computation that states
how fast the machine is at this moment.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

import crosstrack as ct
from crosstrack.models import SatelliteSlew

#: Number of slews.
COUNT = 20


def drawn(seed: int) -> SatelliteSlew:
    """Return the slew from rest to rest of a seed: another axis, body, wheels and limits.

    The angle is from 10 to 175 degrees. The momentum of a wheel is from 0.6 to 1.2 times that with which
    the four gyros hold the momentum of the body at the limit of its rates, and the largest torque that of a
    gimbal at 0.6 to 1.6 rad/s.
    """
    draw = np.random.default_rng(seed)
    axis, angle = draw.normal(size=3), draw.uniform(10.0, 175.0)
    size = np.exp(draw.uniform(np.log(20.0), np.log(600.0)))
    inertia = size * np.array([1.0, *draw.uniform(0.7, 1.1, 2)])
    rate = draw.uniform(0.05, 0.15)
    momentum = draw.uniform(0.6, 1.2) * size * rate
    gimbal_rate = draw.uniform(0.6, 1.6)
    return SatelliteSlew.about(
        axis,
        angle,
        inertia=inertia,
        momentum=momentum,
        rate_limit=rate,
        gimbal_rate_limit=gimbal_rate,
        torque_limit=draw.uniform(0.8, 1.6) * momentum * gimbal_rate,
        rate_weight=draw.uniform(0.02, 0.2),
        time_range=(1.0, 240.0),
        name=f"drawn {seed}",
    )


def probe() -> float:
    """Return the CPU seconds of a fixed computation."""
    begin = time.process_time()
    matrix = np.random.default_rng(0).normal(size=(60, 60))
    for _ in range(4000):
        matrix = np.tanh(matrix @ matrix / 60.0)
    return time.process_time() - begin


def main() -> None:
    """Solve the slews and print the rows and the number within 5 s."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("first", type=int, nargs="?", default=1)
    parser.add_argument("last", type=int, nargs="?", default=COUNT)
    parser.add_argument("--formulation")
    options = parser.parse_args()
    good, count = 0, 0
    for seed in range(options.first, options.last + 1):
        model, before = drawn(seed), probe()
        begin = time.process_time()
        found = ct.solve(model, formulation=options.formulation)
        seconds = time.process_time() - begin
        is_verified = found.verification is not None and found.verification.ok
        good, count = good + (is_verified and seconds <= 5.0), count + 1
        print(
            f"{seed:3d} {model.describe():55} {found.termination} J {found.primal_bound} "
            f"verified {is_verified} {seconds:.2f} s, probe {before:.3f} s, "
            f"meshes {found.statistics.get('meshes')} {found.message[:160]}",
            flush=True,
        )
    print(f"{good} of {count} verified within 5 s of CPU")


if __name__ == "__main__":
    main()
