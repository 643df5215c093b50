"""Sequential ordering beside published values: TSPLIB's files, and problems similar to those of SOPLIB.

From the folder ``tests``, in ten minutes::

    python -m benchmarks.sequential_ordering.published

``--tables tsplib`` measures only one table, and ``--tables`` none. The table ``beside`` of ``docs/how-well.md`` is written
from the stored tables. Times are CPU seconds of compiled loops. Each row is complete by a number of iterations and a width, not by a time, so
that a busy machine changes no value.
"""

from __future__ import annotations

import argparse
import json
import time

from benchmarks.measured import ROOT, write

import crosstrack as ct
from crosstrack.instances.sequential_ordering import generate_ordering
from crosstrack.jit import compile_always

PUBLIC = ROOT.parent / "shared" / "data" / "sop"
#: Best known values of TSPLIB's list.
TSPLIB = {
    "ESC07": 2125, "ESC12": 1675, "br17.10": 55, "br17.12": 55, "ft53.1": 7531, "p43.1": 28140,
}  # fmt: skip
#: Best known values of SOPLIB's R.n.s.p: Gambardella, Montemanni, Weyland, European Journal of Operational Research
#: 220, 2012; Gouveia, Ruthmair, Computers & Operations Research 63, 2015.
SOPLIB = {
    (200, 1000, 60): 71556, (200, 100, 15): 1792, (500, 1000, 60): 178212, (500, 1000, 15): 50725,
    (700, 1000, 30): 134474, (500, 1000, 1): 1316,
}  # fmt: skip
SEEDS = (1, 2)
COLUMNS = {
    "problem": "", "published": ".0f", "first plan": ".0f", "its time (s)": ".2f", "best plan": ".0f",
    "time of the search (s)": ".1f", "bound at the start": ".0f", "bound": ".0f", "gap (%)": ".1f", "states": ",.0f",
    "time of the bound (s)": ".1f",
}  # fmt: skip


def measured(model: ct.models.Model, width: int) -> list[float | None]:
    """Return the values of a row."""
    begin = time.process_time()
    first = ct.solve(model, "three-exchange", backend_options={"iterations": 1})
    middle = time.process_time()
    search = [ct.solve(model, "three-exchange", seed=seed) for seed in SEEDS]
    after = time.process_time()
    best = min(search, key=lambda found: found.primal_bound)
    exact = ct.solve(
        model, "bounded-levels", warm_start=best.plan, backend_options={"width": width}
    )
    end = time.process_time()
    return [
        first.primal_bound, middle - begin, exact.primal_bound, (after - middle) / len(SEEDS),
        exact.statistics["bound at the start"], exact.dual_bound, 100 * exact.gap, exact.statistics["states"],
        end - after,
    ]  # fmt: skip


def beside() -> None:
    """Write the table of lengths and bounds beside the published values."""
    tables = json.loads(
        (ROOT / "docs" / "measured" / "sequential-ordering.json").read_text("utf-8")
    )
    columns = {
        "problem": "", "published": ".0f", "ours": ".0f", "bound": ".0f", "gap (%)": ".1f",
        "time (s)": ".1f", "same file": "",
    }  # fmt: skip
    rows = []
    for name, same in (("tsplib", "yes"), ("similar", "no, drawn by the same rule")):
        for row in tables[name]["rows"]:
            values = dict(zip(COLUMNS, row, strict=True))
            seconds = values["time of the search (s)"] + values["time of the bound (s)"]
            picked = (
                values[key] for key in ("problem", "published", "best plan", "bound", "gap (%)")
            )
            rows.append([*picked, seconds, same])
    said = "The time is that of the search and of the bound, in CPU seconds."
    write("sequential-ordering", "beside", __file__, columns, rows, ("numba",), said)


def main() -> None:
    """Measure and write all tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--tables", nargs="*", default=["tsplib", "similar"])
    tables = parser.parse_args().tables
    compile_always()
    if tables:
        measured(generate_ordering(12, 9, 9, 0), 16)
    said = (
        "The best plan is the shortest of three-exchange with two seeds and of bounded-levels, which starts with the plan "
        "of the former and gives the bound, with at most {} states per level. The time of the search is that of one seed; "
        "the time of the bound includes another search. "
    )
    files = [name for name in TSPLIB if (PUBLIC / f"{name}.sop").exists()]
    if "tsplib" in tables and files:
        rows = [
            [name, TSPLIB[name], *measured(ct.load(PUBLIC / f"{name}.sop"), 4096)] for name in files
        ]
        text = said.format(4096)
        write("sequential-ordering", "tsplib", __file__, COLUMNS, rows, ("numba",), text)
    note = (
        "The published value is that of the file R.n.s.p. Ours are other draws by the same rule, so that only the order "
        "of magnitude is comparable. "
    )
    similar = []
    for (n, most, share), value in SOPLIB.items() if "similar" in tables else ():
        values = measured(generate_ordering(n, most, share, 1), 16)
        similar.append([f"n = {n}, s = {most}, p = {share}", value, *values])
        print(similar[-1], flush=True)
        text = note + said.format(16)
        write("sequential-ordering", "similar", __file__, COLUMNS, similar, ("numba",), text)
    beside()


if __name__ == "__main__":
    main()
