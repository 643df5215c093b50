"""Write the learning curves of the shipped weights to ``docs/measured/unknown-grid.json``.

``python tests/benchmarks/unknown_grid/learning.py FILE.json …`` takes what ``crosstrack train NAME --json`` printed.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.measured import write  # noqa: E402

from crosstrack.solvers.unknown_grid.networks import shipped_weights  # noqa: E402
from crosstrack.solvers.weights import read_weights  # noqa: E402


def main() -> None:
    """Read the files on the command line and write one row per network and epoch."""
    rows = []
    for path in sys.argv[1:]:
        result = json.loads(Path(path).read_text("utf-8"))
        made = read_weights(shipped_weights(result["name"]), result["name"]).made
        batch = made.get("batch", made.get("images"))
        scores = [one["score"] for one in result["figures"]]
        for epoch in range(1, len(scores) + 1):
            batches = epoch * made["batches"]
            row = [result["name"], epoch, batches, batches * batch, max(scores[:epoch])]
            rows.append([*row, "shipped" if epoch == made["best_epoch"] else ""])
    heads = {
        "network": "", "epoch": "d", "batches": "d", "examples": "d", "best score": ".1f", "weights": "",
    }  # fmt: skip
    said = (
        "Examples are episodes (mcgn-1, macn), decisions (mcgn-2, vin) or images (gmgn). The score is in percent: targets "
        "reached in 192 scenes that were not learned from (mcgn-1: brought into view; mcgn-2: reached from there), for gmgn "
        "the smallest share of cells read right. It is the best so far."
    )
    write("unknown-grid", "learning", __file__, heads, rows, ("torch",), said)


if __name__ == "__main__":
    main()
