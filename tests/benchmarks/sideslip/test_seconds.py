"""Seconds of the estimators of the sideslip angle, and the memory of those that learn.

Runs of ``Backend.run``, after one that compiles. Nothing fails because it is slow. Run with
``make bench``, or::

    pytest tests/benchmarks/sideslip/test_seconds.py -s
"""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Iterable
from dataclasses import replace
from statistics import median
from typing import Any

import numpy as np
import pytest

from crosstrack.instances.sideslip.generator import generate
from crosstrack.models import SideslipEstimation
from crosstrack.solvers import Request, Termination, find_backend
from crosstrack.solvers.sideslip import BACKENDS

REPEATS = 5
#: Backends with one quadratic program per sample, skipped for many samples.
SLOW = ("moving-horizon",)
#: Memory limit (bytes) of learning from 1e5 samples. A full table against 1e4 others would take 8e9.
MOST_BYTES = 1_000_000_000


def seconds_of(model: SideslipEstimation, name: str, repeats: int = REPEATS) -> float:
    """Return the median time of the processor (s) of several runs, which must all give angles."""
    backend, taken = find_backend(name), []
    request = Request(options=backend.checked_options({}))
    for _ in range(repeats):
        begin = time.process_time()
        answer = backend.run(model.blinded(), request)
        taken.append(time.process_time() - begin)
        assert answer.termination is Termination.FEASIBLE
        assert np.isfinite(answer.point.sideslip).all()
    return median(taken)


def taught(samples: int, by: SideslipEstimation) -> SideslipEstimation:
    """Return a long drive on the serpentine, with the training drives of another estimation."""
    drive = generate("serpentine", samples=samples, drivers=0)
    fields = {name: getattr(drive, name) for name in ("vehicle", "recording", "truth")}
    return SideslipEstimation(training=by.training, **fields)


def show(capsys: Any, title: str, lines: Iterable[str]) -> None:
    with capsys.disabled():
        print(f"\n{title}", *lines, sep="\n", flush=True)


@pytest.mark.timeout(0)
def test_a_drive(capsys: Any) -> None:
    model, lines = generate("lane-change"), ["| backend | ms | of kalman-filter |", "|---|---|---|"]
    seconds_of(model, "rts-smoother", 1)  # compiles
    filtered = seconds_of(model, "kalman-filter")
    for name in BACKENDS:
        taken = seconds_of(model, name, 1 if name in SLOW else REPEATS)
        lines.append(f"| {name} | {1e3 * taken:.3g} | {taken / filtered:.3g} |")
    show(capsys, model.describe(), lines)


@pytest.mark.timeout(0)
def test_long_drives(capsys: Any) -> None:
    learned = generate("serpentine")
    names = [name for name in BACKENDS if name not in SLOW]
    seconds_of(learned, "rts-smoother", 1)  # compiles
    lines = ["| samples | " + " | ".join(names) + " |", "|---|" + "---|" * len(names)]
    for samples in (1_000, 10_000, 100_000):
        model = taught(samples, learned)
        cells = (f"{seconds_of(model, name, 1):.3g}" for name in names)
        lines.append(f"| {samples} | " + " | ".join(cells) + " |")
    show(
        capsys,
        f"Seconds, {len(learned.training)} drives of {len(learned.recording)} samples",
        lines,
    )


@pytest.mark.timeout(0)
@pytest.mark.parametrize("name", ["grnn", "linear-regression"])
def test_many_examples(name: str, capsys: Any) -> None:
    """Training drives have 1e5 samples in total, the estimated drive 1e4."""
    drives = [generate("serpentine", samples=10_000, drivers=0, seed=seed) for seed in range(11)]
    model = SideslipEstimation(
        vehicle=drives[0].vehicle,
        recording=drives[0].recording,
        training=[replace(one.recording, sideslip=one.truth) for one in drives[1:]],
    )
    taken = seconds_of(model, name, 1)
    tracemalloc.start()
    seconds_of(model, name, 1)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    show(capsys, model.describe(), [f"{name}: {taken:.2f} s, {peak / 1e6:.0f} MB at most"])
    assert peak <= MOST_BYTES
