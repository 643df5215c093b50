"""Gaps of ``tour-search`` to its bound, its spread, and public instances.

Run with ``make bench``, or with another time per run::

    CROSSTRACK_MESSENGER_SECONDS=20 pytest tests/benchmarks/messenger/test_tour_search.py -s
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.instances.messenger import generate, read_best_known, read_dtspn
from crosstrack.models import MessengerTour

#: Of a run on 10 vehicles; larger ones have as many times more as they have vehicles.
SECONDS = float(os.environ.get("CROSSTRACK_MESSENGER_SECONDS", "2"))
DATA = Path(__file__).resolve().parents[4] / "shared" / "data" / "dtspn"
#: Options that make a search use all its time.
ENDLESS = {"patience": 10**6, "bound": False}


def run(
    model: MessengerTour, backend: str, seed: int, seconds: float | None, **options: Any
) -> Any:
    """Return a verified solution."""
    found = ct.solve(model, backend, time_limit=seconds, backend_options=options, seed=seed)
    assert found.plan is not None, found
    return found


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    model = generate(3, 5.0, 1)
    run(model, "tour-search", 0, 1.0)


@pytest.mark.timeout(0)
@pytest.mark.parametrize("vehicles", [5, 10, 20])
def test_gaps(vehicles: int) -> None:
    """The gap to the proven bound, sparsity 2.5 and above, all defaults."""
    gaps, seconds = [], []
    for row, kappa in enumerate(np.linspace(2.5, 17.0, 10), 1):
        found = run(generate(vehicles, float(kappa), 1000 * vehicles + row), "tour-search", 0, None)
        gaps.append(100 * found.gap)
        seconds.append(found.seconds["solve"])
    print(
        f"\n{vehicles} vehicles: gap median {np.median(gaps):.2f} %, worst {max(gaps):.2f} %, "
        f"{np.median(seconds):.1f} s in the median"
    )
    assert np.median(gaps) <= (5.0 if vehicles <= 10 else 10.0)


@pytest.mark.timeout(0)
@pytest.mark.parametrize("vehicles", [30, 40])
def test_spread(vehicles: int) -> None:
    """How far apart five seeds end."""
    for row, kappa in enumerate((2.5, 6.0, 10.0, 17.0), 1):
        model = generate(vehicles, kappa, 2000 * vehicles + row)
        lengths = np.array(
            [
                run(model, "tour-search", seed, SECONDS * vehicles / 10, **ENDLESS).primal_bound
                for seed in range(5)
            ]
        )
        print(
            f"\n{vehicles} vehicles, sparsity {kappa:g}: {lengths.min():.5g} … {lengths.max():.5g} m, "
            f"standard deviation {100 * lengths.std() / lengths.mean():.2f} % of the mean, range "
            f"{100 * (lengths.max() / lengths.min() - 1):.2f} %"
        )
        assert lengths.max() < 1.5 * lengths.min()


@pytest.mark.timeout(0)
@pytest.mark.parametrize("vehicles", [6, 8, 10, 12, 14, 16, 18, 20, 25, 30])
def test_public_instances(vehicles: int) -> None:
    """Static closed tours: beside the published upper bounds."""
    if not DATA.is_dir():
        pytest.skip(f"the public instances are not at {DATA}")
    known = read_best_known(DATA / "best_known.csv")
    above, better, gaps = [], 0, []
    names = sorted(name for name in known if name.startswith(f"dtspn-{vehicles:02}-"))[::3]
    for name in names:
        path = DATA / name if name.endswith(".txt") else DATA / f"{name}.txt"
        found = run(read_dtspn(path), "tour-search", 0, SECONDS * vehicles / 10, patience=10**6)
        upper = known[name][1]
        above.append(100 * (found.primal_bound / upper - 1))
        better += found.primal_bound < upper * (1 - 1e-7)
        gaps.append(100 * found.gap)
        assert found.dual_bound <= found.primal_bound * (1 + 1e-7)
    print(
        f"\n{vehicles} discs, {len(names)} instances, {SECONDS * vehicles / 10:g} s: above the published "
        f"upper bound by {np.median(above):.6f} % in the median, {max(above):.4f} % at most; shorter "
        f"on {better} (by {-min(above):.4f} % at most); gap to our bound {np.median(gaps):.3f} % in the median"
    )
    assert max(above) < (0.05 if vehicles <= 20 else 1.0)
