"""a-star on chains at whole numbers from 1 to 200: time to a proof, or the gap at the time limit.

Slowness does not fail the test. Run with ``make bench``, or with another time per run and number of
seeds::

    CROSSTRACK_PATH_SECONDS=10 CROSSTRACK_PATH_SEEDS=5 \
        pytest tests/benchmarks/guided_path/test_exact.py -s
"""

from __future__ import annotations

import os
from statistics import median
from typing import Any

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.jit import compile_always
from crosstrack.models import GuidedPathTour

SECONDS = float(os.environ.get("CROSSTRACK_PATH_SECONDS", "10"))
SEEDS = int(os.environ.get("CROSSTRACK_PATH_SEEDS", "5"))
#: Chains, customers of each, and seconds asked of a proof.
PROVEN = [(1, 5, 0.01), (5, 5, 0.01), (10, 5, 0.01), (20, 5, 0.1), (50, 5, 1.0), (100, 5, 10.0)]
LARGE = [(20, 20), (10, 30), (15, 15), (30, 30), (100, 50)]


def model_of(chains: int, each: int, seed: int) -> GuidedPathTour:
    """Return chains of equally many customers, as in the paper's table 1."""
    rng = np.random.default_rng(seed)
    places = np.concatenate(([0], rng.integers(1, 201, chains * each)))
    return GuidedPathTour(places, chains=(np.arange(chains * each) + 1).reshape(chains, each))


@pytest.fixture(scope="module")
def compiled() -> None:
    """Compile every loop first."""
    compile_always()
    ct.solve(model_of(15, 15, 0), "a-star", time_limit=3.0)


@pytest.mark.timeout(0)
@pytest.mark.parametrize(("chains", "each", "asked"), PROVEN)
def test_seconds_to_a_proof(
    chains: int, each: int, asked: float, compiled: None, capsys: Any
) -> None:
    runs = [ct.solve(model_of(chains, each, seed), "a-star") for seed in range(4 * SEEDS)]
    assert all(run.verified and run.termination == "optimal" for run in runs)
    seconds = [run.seconds["solve"] for run in runs]
    with capsys.disabled():
        print(
            f"\n{chains} chains of {each}: median {median(seconds):.4f} s, "
            f"longest {max(seconds):.4f} s, asked {asked:g} s; expanded, median "
            f"{median(run.statistics['expanded'] for run in runs):.0f}"
        )


@pytest.mark.timeout(0)
@pytest.mark.parametrize(("chains", "each"), LARGE)
def test_gap_after_some_seconds(chains: int, each: int, compiled: None, capsys: Any) -> None:
    for seed in range(SEEDS):
        run = ct.solve(model_of(chains, each, seed), "a-star", time_limit=SECONDS)
        assert run.verified
        assert run.dual_bound is not None
        assert run.primal_bound is not None
        with capsys.disabled():
            print(
                f"\n{chains} chains of {each}, seed {seed}: {run.primal_bound:g}, proven "
                f"{run.dual_bound:g}, gap {1.0 - run.dual_bound / run.primal_bound:.2%}, "
                f"{run.termination} after {run.seconds['solve']:.1f} s"
            )
