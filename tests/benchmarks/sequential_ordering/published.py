"""Sequential ordering beside published values: TSPLIB's files, and problems similar to those of SOPLIB.

From the folder ``tests``, in ten minutes::

    python -m benchmarks.sequential_ordering.published

Times are CPU seconds of compiled loops. Each row is complete by a number of iterations and a width, not by a time, so
that a busy machine changes no value.
"""

from __future__ import annotations

import time
from pathlib import Path

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


def main() -> None:
    """Measure and write both tables."""
    compile_always()
    measured(generate_ordering(12, 9, 9, 0), 16)
    rows = [
        [name, value, *measured(ct.load(Path(PUBLIC / f"{name}.sop")), 4096)]
        for name, value in TSPLIB.items()
        if (PUBLIC / f"{name}.sop").exists()
    ]
    said = (
        "The best plan is the shortest of three-exchange with two seeds and of bounded-levels, which starts with the plan "
        "of the former and gives the bound, with at most {} states per level. The time of the search is that of one seed; "
        "the time of the bound includes another search. "
    )
    if rows:
        write(
            "sequential-ordering", "tsplib", __file__, COLUMNS, rows, ("numba",), said.format(4096)
        )
    note = (
        "The published value is that of the file R.n.s.p. Ours are other draws by the same rule, so that only the order "
        "of magnitude is comparable. "
    )
    similar = []
    for (n, most, share), value in SOPLIB.items():
        values = measured(generate_ordering(n, most, share, 1), 16)
        similar.append([f"n = {n}, s = {most}, p = {share}", value, *values])
        print(similar[-1], flush=True)
        text = note + said.format(16)
        write("sequential-ordering", "similar", __file__, COLUMNS, similar, ("numba",), text)


if __name__ == "__main__":
    main()
