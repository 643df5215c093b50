"""The contest's public points, solved as routes with resources, beside the optima that are known.

``python tests/benchmarks/resource_routing/contest.py`` writes ``docs/measured/resource-routing.json``; it needs
the public points.
"""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve()
sys.path[:0] = [str(HERE.parents[2])]

from benchmarks.cases import CASES, POINTS, ROWS  # noqa: E402
from benchmarks.measured import write  # noqa: E402
from benchmarks.resource_routing.test_labelling_speed import NAME, least  # noqa: E402

import crosstrack as ct  # noqa: E402


def main() -> None:
    """Solve the three rows."""
    assert POINTS.exists(), "the public points are not beside the project"
    rows = []
    for case in CASES.values():
        if case.row is not None:
            model = case.fresh()
            found, seconds = least(20, lambda model=model: ct.solve(model, NAME))
            assert found.termination == "optimal"
            thresholds, known = ROWS[case.row]
            words = ", ".join(map(str, thresholds))
            rows.append((words, known, found.primal_bound, found.primal_bound / known - 1, seconds))
            print(*rows[-1])
    columns = {
        "thresholds": "", "known (m)": ".3f", "ours (m)": ".3f", "difference": "+.0e", "seconds": ".2g",
    }  # fmt: skip
    write("resource-routing", "contest", __file__, columns, rows, ("numba",))


if __name__ == "__main__":
    main()
