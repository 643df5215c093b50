"""Add the present state of trainings to the learning curves in ``docs/measured/unknown-grid.json``.

``python tests/benchmarks/unknown_grid/learning.py FILE …`` reads the checkpoints ``*.checkpoint.npz`` that ``crosstrack
train`` writes after each epoch, so call it while the trainings run, and curves ``*.jsonl`` of ``gpu_training.py``, of
which it takes the epochs in ``SHOWN`` and the last.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.measured import write  # noqa: E402

from crosstrack.solvers.learning.weights import read_arrays  # noqa: E402
from crosstrack.solvers.unknown_grid.episodes import EPISODES  # noqa: E402

HEADS = {
    "network": "", "first rate": "", "epoch": "d", "batches": "d", "examples": "d", "best score": ".1f",
}  # fmt: skip
#: Epochs of a curve in the table.
SHOWN = (1, 6, 12, 24, 48, 72)
SAID = (
    "Examples are episodes (mcgn-1, macn), decisions (mcgn-2, vin) or images (gmgn). The score is in percent and the best so "
    "far: targets reached in 192 scenes that were not learned from (mcgn-1: brought into view; mcgn-2: reached from there), "
    "for gmgn the smaller share of cells read right in plain and hard images. The rate 0.0001 is the printed one: these rows are "
    "from one GPU. The best epochs of mcgn-1 and macn with this rate, and of mcgn-2, vin and gmgn with the other, are shipped."
)


def add(states: Iterable[tuple[str, float, int, int, int, float]]) -> None:
    """Write rows of network, first rate, epochs, batches of an epoch, examples of a batch and best score."""
    rows = [
        [name, f"{rate:g}", done, done * many, done * many * size, best]
        for name, rate, done, many, size, best in states
    ]
    write("unknown-grid", "learning", __file__, HEADS, rows, ("torch",), SAID, merge=True, keys=3)


def read_curves(path: str) -> list[tuple[str, float, int, int, int, float]]:
    """Return the rows of the shown epochs of all networks in a file of curves."""
    curves: dict[str, list[dict[str, float]]] = {}
    for line in Path(path).read_text("utf-8").splitlines():
        row = json.loads(line)
        if row["score"] >= 0.0:
            curves.setdefault(row["network"], []).append(row)
    options = EPISODES["rate"].default, EPISODES["batches"].default, EPISODES["batch"].default
    rate, many, size = options
    return [
        (name, rate, row["epoch"], many, size, max(one["score"] for one in rows[: k + 1]))
        for name, rows in curves.items()
        for k, row in enumerate(rows)
        if row["epoch"] in SHOWN or row is rows[-1]
    ]


def main() -> None:
    """Add one row for each checkpoint on the command line."""
    states = []
    for path in sys.argv[1:]:
        if path.endswith(".jsonl"):
            states += read_curves(path)
            continue
        about = read_arrays(path)[1]
        made = about["checkpoint"]
        score = about["score"] * (100.0 if made["training"] == "gmgn" else 1.0)
        size = made.get("batch", made.get("images"))
        done, many = about["done"], made["batches"]
        states.append((made["training"], made["rate"], done, many, size, score))
    add(states)


if __name__ == "__main__":
    main()
