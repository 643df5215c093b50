"""Add the present state of trainings to the learning curves in ``docs/measured/unknown-grid.json``.

``python tests/benchmarks/unknown_grid/learning.py FILE.npz.checkpoint.npz …`` reads the checkpoints that
``crosstrack train`` writes after each epoch; call it while the trainings run.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.measured import write  # noqa: E402

from crosstrack.solvers.learning.weights import read_arrays  # noqa: E402

HEADS = {"network": "", "epoch": "d", "batches": "d", "examples": "d", "best score": ".1f"}
SAID = (
    "Examples are episodes (mcgn-1, macn), decisions (mcgn-2, vin) or images (gmgn). The score is in percent and the best so "
    "far: targets reached in 192 scenes that were not learned from (mcgn-1: brought into view; mcgn-2: reached from there), "
    "for gmgn the smaller share of cells read right in plain and hard images. The weights of the best epoch are shipped."
)


def add(states: Iterable[tuple[str, int, int, int, float]]) -> None:
    """Write rows of network, epochs, batches of an epoch, examples of a batch and best score."""
    rows = [
        [name, done, done * many, done * many * size, best]
        for name, done, many, size, best in states
    ]
    write("unknown-grid", "learning", __file__, HEADS, rows, ("torch",), SAID, merge=True, keys=2)


def main() -> None:
    """Add one row for each checkpoint on the command line."""
    states = []
    for path in sys.argv[1:]:
        about = read_arrays(path)[1]
        made = about["checkpoint"]
        score = about["score"] * (100.0 if made["training"] == "gmgn" else 1.0)
        size = made.get("batch", made.get("images"))
        states.append((made["training"], about["done"], made["batches"], size, score))
    add(states)


if __name__ == "__main__":
    main()
