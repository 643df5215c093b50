"""The paper's table 1 with ours: the speed-up of parallel over serial PSO-AC by the size of the swarm.

The paper prints 5 to 27.7 for 32 to 256 particles on its machine; threads cannot give more than there
are processors. Nothing fails because it is slow. Run with ``make bench``, or::

    pytest tests/benchmarks/fleet/test_pso_speed.py -s
"""

from __future__ import annotations

import importlib.util
import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from statistics import median
from typing import Any

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.models import FleetRouting
from crosstrack.solvers.fleet.swarm import array_evaluation, threaded, torch_evaluation

SWARMS = (32, 64, 128, 256)
NODES, VEHICLES, REPEATS = 200, 4, 9
GO = np.zeros(1, np.int8)


def processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1


def seconds(call: Callable[[Any], Any], place: Any, times: int) -> list[float]:
    spent = []
    for _ in range(times):
        begin = time.perf_counter()
        call(place)
        spent.append(time.perf_counter() - begin)
    return spent


def gpu() -> bool:
    if importlib.util.find_spec("torch") is None:
        return False
    import torch

    return bool(torch.cuda.is_available())


@pytest.mark.timeout(0)
def test_speed_up_of_the_evaluation(capsys: Any) -> None:
    """What is parallel: all else is left out."""
    points = np.random.default_rng(1).random((NODES, 2))
    threads = processors()
    rng = np.random.default_rng(2)
    with ThreadPoolExecutor(threads) as pool:
        ways = {
            "one thread": threaded(points, 1, 1.0, 1, None, GO),
            f"{threads} threads": threaded(points, 1, 1.0, threads, pool, GO),
            "NumPy": array_evaluation(points, 1, 1.0),
        }
        if gpu():
            ways["CUDA"] = torch_evaluation(points, 1, 1.0)
        with capsys.disabled():
            print(
                f"\nevaluation of a swarm, {NODES} nodes, {VEHICLES} clusters: ms, and the speed-up"
            )
        for size in SWARMS:
            place = rng.random((size, VEHICLES, 2))
            spent: dict[str, list[float]] = {name: [] for name in ways}
            for _ in range(REPEATS):  # in turns, so that a busy moment meets all alike
                for name, evaluate in ways.items():
                    spent[name] += seconds(evaluate, place, 1 if name == "NumPy" else 10)
            one = spent["one thread"]
            cells = [
                f"{name} {1e3 * min(each):.2f} ({min(one) / min(each):.2f}, "
                f"{median(one) / median(each):.2f})"
                for name, each in spent.items()
            ]
            with capsys.disabled():
                print(f"  {size:4d} particles   " + "   ".join(cells))
            assert len({evaluate(place)[0].tobytes() for evaluate in ways.values()}) == 1


@pytest.mark.timeout(0)
def test_speed_up_of_the_whole_run(capsys: Any) -> None:
    """Clusters and tours: the same plan in less time."""
    model = FleetRouting(VEHICLES, points=np.random.default_rng(1).random((NODES, 2)))
    with capsys.disabled():
        print(f"\nwhole runs, {NODES} nodes, {VEHICLES} vehicles, {processors()} processors")
    for size in SWARMS:
        spent: dict[str, list[float]] = {"pso-ac": [], "pso-ac-serial": []}
        plans = set()
        for _ in range(1 + REPEATS):
            for name, each in spent.items():
                found = ct.solve(model, name, seed=1, backend_options={"swarm": size})
                each.append(found.seconds["solve"])
                assert found.plan is not None
                plans.add(found.plan.routes)
        serial, parallel = (median(spent[name][1:]) for name in ("pso-ac-serial", "pso-ac"))
        with capsys.disabled():
            print(
                f"  {size:4d} particles   serial {serial:.3f} s   parallel {parallel:.3f} s   "
                f"speed-up {serial / parallel:.2f}"
            )
        assert len(plans) == 1
