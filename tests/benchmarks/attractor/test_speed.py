"""Time of exponents and correlation dimensions, compared with nolds.

Kernels are compiled before the measurement. nolds (PyPI) belongs to the extra ``benchmark``; its rows are
skipped if it is not installed. It gets at most 10,000 samples, because it is slow. Run with
``make bench``, or::

    pytest tests/benchmarks/attractor/test_speed.py -s
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest

from crosstrack.instances.attractor.systems import generate
from crosstrack.models import AttractorAnalysis
from crosstrack.solvers.attractor.correlation import CorrelationDimension, correlation_counts
from crosstrack.solvers.attractor.exponents import Kantz, Rosenstein
from crosstrack.solvers.contract.backend import Request

BACKENDS = [Rosenstein(), Kantz(), CorrelationDimension()]
SIZES = [1_000, 10_000, 100_000, 1_000_000]
#: Largest number of samples for nolds.
MOST = 10_000


def pair_counts(states, radii, theiler):
    """Return the exact number of unordered pairs within each radius."""
    counts = correlation_counts(states, radii, theiler, references=len(states))
    return counts.counts.sum(axis=0) // 2


def lorenz(count: int) -> np.ndarray:
    """Return the first coordinate of the Lorenz equations every 0.02 s."""
    return generate("lorenz", count, period=0.02).series


def seconds_of(call: Callable[[], Any], times: int = 3) -> tuple[float, Any]:
    """Return the shortest time (s) of several calls, and the last result."""
    found, best = None, np.inf
    for _ in range(times):
        begin = time.perf_counter()
        found = call()
        best = min(best, time.perf_counter() - begin)
    return best, found


@cache
def load_nolds() -> Any:
    """Return nolds. It looks up its files by the name of a module, but Python 3.11 requires a package."""
    found = importlib.util.find_spec("nolds")
    assert found is not None
    assert found.origin is not None
    with mock.patch("importlib.resources.files", return_value=Path(found.origin).parent):
        import nolds
    return nolds


def run(backend: Any, series: np.ndarray) -> Any:
    """Return the answer of a backend in an embedding common to all backends."""
    options = backend.checked_options({"delay": 8, "dimension": 3, "theiler": 50})
    return backend.run(AttractorAnalysis(series, period=0.02), Request(options=options))


@pytest.mark.timeout(0)
def test_seconds_by_length(capsys: Any) -> None:
    for backend in BACKENDS:
        run(backend, lorenz(2000))  # compiles
    lines = ["", "Lorenz, delay 8, dimension 3: seconds by samples, and the value"]
    lines += ["| backend | " + " | ".join(f"{count:,}" for count in SIZES) + " |"]
    lines += ["|---" * (len(SIZES) + 1) + "|"]
    for backend in BACKENDS:
        cells = []
        for count in SIZES:
            series = lorenz(count)
            taken, answer = seconds_of(lambda: run(backend, series), 3)  # noqa: B023
            slope = answer.point.exponent or answer.point.correlation
            cells.append(f"{taken:.2f} ({slope or 'none'})")
        lines.append(f"| {backend.name} | " + " | ".join(cells) + " |")
    with capsys.disabled():
        print("\n".join(lines), flush=True)


@pytest.mark.timeout(0)
def test_against_nolds(capsys: Any) -> None:
    if importlib.util.find_spec("nolds") is None:
        pytest.skip("nolds is not installed: pip install nolds")
    nolds = load_nolds()
    series = generate("henon", MOST).series
    calls = {
        "rosenstein": lambda: nolds.lyap_r(
            series, emb_dim=2, lag=1, min_tsep=1, trajectory_len=16, fit="poly"
        ),
        "correlation-dimension": lambda: nolds.corr_dim(series, emb_dim=2, lag=1, fit="poly"),
    }
    lines = [
        "",
        f"Hénon, {MOST:,} samples: seconds",
        "| | ours | nolds | ratio |",
        "|---|---|---|---|",
    ]
    for backend in BACKENDS:
        if backend.name not in calls:
            continue
        options = backend.checked_options({"delay": 1, "dimension": 2, "theiler": 1})
        ask = lambda: backend.run(AttractorAnalysis(series), Request(options=options))  # noqa: B023, E731
        ask()
        ours, _ = seconds_of(ask)
        theirs, value = seconds_of(calls[backend.name], 1)
        lines.append(
            f"| {backend.name} | {ours:.3f} | {theirs:.2f} ({value:.4g}) | {theirs / ours:.0f} |"
        )
        assert ours < theirs
    with capsys.disabled():
        print("\n".join(lines), flush=True)


def test_exact_counts_against_a_tree(capsys: Any) -> None:
    from scipy.spatial import cKDTree

    series = lorenz(10_000)
    states = AttractorAnalysis(series).states(8, 3)
    radii = np.geomspace(0.1, 3.0, 16)
    pair_counts(states, radii, 0)
    ours, found = seconds_of(lambda: pair_counts(states, radii, 0))
    tree = cKDTree(states)
    theirs, known = seconds_of(lambda: tree.count_neighbors(tree, radii, p=np.inf), 1)
    assert ((known - len(states)) // 2 == found).all()
    with capsys.disabled():
        print(
            f"\nall pairs of {len(states):,} states within 16 radii: {ours:.2f} s, by a KD-tree "
            f"{theirs:.2f} s, ratio {theirs / ours:.1f}"
        )
