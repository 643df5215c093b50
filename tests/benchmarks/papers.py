"""Measure the result tables of a problem's paper and write them to ``docs/measured/<problem>.json``.

``python tests/benchmarks/papers.py PROBLEM [--table NAME] [--rows 1-3] [--runs N] [--time-limit S]`` measures with the
functions of ``crosstrack reproduce``. Rows of an earlier call stay if they are not measured again.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

from benchmarks.measured import write  # noqa: E402

from crosstrack.cli.options import numbers  # noqa: E402
from crosstrack.instances.paper import measurement, paper_of  # noqa: E402
from crosstrack.solvers.report.reproduction import reproduce  # noqa: E402


def main() -> None:
    """Measure the tables named on the command line; each row is written as soon as it is finished."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("problem")
    parser.add_argument("--table", action="append")
    parser.add_argument("--rows", type=numbers)
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--time-limit", type=float, default=60.0)
    options = parser.parse_args()
    paper = paper_of(options.problem)
    tables = [paper.table(name) for name in options.table] if options.table else paper.tables

    def store(row):
        one = row.table
        write(
            options.problem,
            one.name,
            __file__,
            one.heads,
            [one.cells(row.key, row.values)],
            said=one.note,
            merge=True,
            keys=len(one.keys),
            order=list(one.rows),
        )
        print(one.name, *row.key, dict(row.values), flush=True)

    reproduce(
        options.problem,
        [(one, measurement(options.problem, one.name)) for one in tables],
        rows=options.rows,
        runs=options.runs,
        time_limit=options.time_limit,
        on_row=store,
    )


if __name__ == "__main__":
    main()
