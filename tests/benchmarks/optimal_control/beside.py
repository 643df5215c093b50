"""One call with defaults on every problem of optimal control, for the table of its page.

``python tests/benchmarks/optimal_control/beside.py`` writes ``docs/measured/optimal-control.json``, each
problem solved in a process of its own; the page sets the catalogue's values beside.
"""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve()
sys.path[:0] = [str(HERE.parents[2])]

from benchmarks.measured import write  # noqa: E402
from benchmarks.optimal_control.how_well import ours  # noqa: E402

from crosstrack.instances import entries  # noqa: E402


def main() -> None:
    """Solve everything, one after the other."""
    rows = []
    for entry in entries():
        if entry.name.startswith("optimal-control/"):
            found = ours(entry.name)
            rows.append((entry.name, found["objective"], found["seconds"]))
            print(*rows[-1], found["ended"], flush=True)
    columns = {"instance": "", "objective": ".9g", "seconds": ".2f"}
    write("optimal-control", "values", __file__, columns, rows, ("casadi",))


if __name__ == "__main__":
    main()
