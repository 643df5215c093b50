"""Errors of the recommended estimator and of all others on the catalogue and on drawn drives, for the problem's page.

``python tests/benchmarks/sideslip/recommended.py`` writes the tables ``recommendation`` and ``recommendation-drawn`` of
``docs/measured/sideslip.json``.
"""

from __future__ import annotations

import sys
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.measured import write  # noqa: E402
from sideslip.recommended import CATALOGUE, KINDS, NAMES, drawn, errors_of  # noqa: E402

from crosstrack.errors import InvalidData  # noqa: E402

#: Seeds per drive of the catalogue, and those of drawn drives, which were not used to choose the rule.
FEW, DRAWN = 3, range(100, 160)
COLUMNS = {"": "", "auto": "", "of auto": ".4f", **dict.fromkeys(NAMES, ".4f"), "ratio to the best": ".2f", "drives": "d"}  # fmt: skip


def row(label: str, cases: list[dict[str, Any]]) -> list[Any]:
    """Return the row of several drives: choices, medians of the errors, and geometric mean of the ratios to the best."""
    chosen, errors = [], []
    for fields in cases:
        try:
            name, found = errors_of(fields)
        except InvalidData:  # the vehicle turns by more than 90°, which the model excludes
            continue
        chosen.append(name)
        errors.append([found[name], *found.values()])
    table = np.array(errors)
    ratios = table[:, 0] / table[:, 1:].min(axis=1)
    names = ", ".join(f"{name} {count}" for name, count in Counter(chosen).most_common())
    print(label, names, ratios.round(2).tolist(), flush=True)
    return [
        label,
        names,
        *np.median(table, axis=0),
        float(np.exp(np.log(ratios).mean())),
        len(table),
    ]


def main() -> None:
    """Write both tables."""
    rows = [
        row(name, [{**fields, "seed": k} for k in range(FEW)]) for name, fields in CATALOGUE.items()
    ]
    said = (
        "Mean error in degrees, median over the drives. The ratio is that of the choice of auto to the best estimator of each drive, as a "
        "geometric mean."
    )
    write("sideslip", "recommendation", __file__, COLUMNS, rows, ("numpy", "scipy"), said)
    groups = defaultdict(list)
    for seed in DRAWN:
        kind, fields = drawn(seed)
        groups[kind].append(fields)
    rows = [row(kind, groups[kind]) for kind in KINDS]
    said += " Roads, speeds, drivers, numbers of training drives and errors are drawn; seeds were not used to choose the rule."
    write("sideslip", "recommendation-drawn", __file__, COLUMNS, rows, ("numpy", "scipy"), said)


if __name__ == "__main__":
    main()
