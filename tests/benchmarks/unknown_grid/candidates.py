"""Compare files of weights with the shipped ones on scenes that no training, table or limit uses.

``python tests/benchmarks/unknown_grid/candidates.py FOLDER`` reads ``macn.npz``, ``vin.npz``, ``mcgn-1.npz`` and ``mcgn-2.npz``
of the folder. A file should replace the shipped weights if the mean difference of success per scene is positive and its
95 % interval excludes 0. ``mcgn-1`` is compared first, and ``mcgn-2`` then with the better ``mcgn-1``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.unknown_grid.laws import scenes_of  # noqa: E402

from crosstrack.models.unknown_grid import World  # noqa: E402
from crosstrack.models.unknown_grid.scenes import TASKS  # noqa: E402
from crosstrack.solvers import Control, Request, find_backend  # noqa: E402

SCENES, SEED = 200, 93


def rates(name, **options):
    """Return 100 for each scene of the three tasks whose target is reached, and 0 for the others."""
    backend, reached = find_backend(name), []
    for task in TASKS:
        model = scenes_of("paper", task.shape, task.view, SCENES, SEED)
        request = Request(
            options=backend.checked_options(options), control=Control(oracle=World(model))
        )
        runs = backend.run(model, request).point
        reached += [100.0 * (str(outcome) == "reached") for outcome in runs.outcomes]
    return np.array(reached)


def is_better(label, shipped, candidate):
    """Print and return whether the candidate is better by the rule of this module."""
    difference = candidate - shipped
    half = 1.96 * difference.std() / np.sqrt(len(difference))
    better = difference.mean() > half
    print(
        f"{label}: shipped {shipped.mean():.1f} %, candidate {candidate.mean():.1f} %, "
        f"difference {difference.mean():+.1f} ± {half:.1f}: {'replace' if better else 'keep'}",
        flush=True,
    )
    return better


def main():
    """Compare the files of a folder."""
    folder = Path(sys.argv[1])
    for name in ("macn", "vin"):
        is_better(name, rates(name), rates(name, weights=str(folder / f"{name}.npz")))
    first = {"weights": str(folder / "mcgn-1.npz")}
    shipped, candidate = rates("mcgn"), rates("mcgn", **first)
    if not is_better("mcgn-1", shipped, candidate):
        first, candidate = {}, shipped
    both = rates("mcgn", weights_2=str(folder / "mcgn-2.npz"), **first)
    is_better("mcgn-2", candidate, both)


if __name__ == "__main__":
    main()
