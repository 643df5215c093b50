"""Ranks and solved targets of black-box searches on the BBOB functions: a resumable benchmark.

The noiseless functions of N. Hansen, S. Finck, R. Ros and A. Auger (INRIA RR-6829, 2009) come from the package
``coco-experiment``. The even functions are the development set: the stages of ``portfolio`` were chosen with them.
The odd functions, with other instances and seeds, are held out and serve for the published table only. Both sets
contain all five groups: separable, moderate, ill-conditioned, multimodal with adequate and with weak structure.

Run one line per search and function, then print or write the table::

    python tests/benchmarks/black_box/search_ranks.py run runs.jsonl --set development --budgets 20 50
    python tests/benchmarks/black_box/search_ranks.py table runs.jsonl --set held-out --write

Runs that the file contains already are skipped, so an interrupted benchmark resumes.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

sys.path[:0] = [
    str(Path(__file__).parent),
    str(Path(__file__).parents[2]),
    str(Path(__file__).parents[1]),
]

from rivals import HIGH, LOW, RIVALS, Counted, Search, run  # noqa: E402

Floats = NDArray[np.float64]
Row = dict[str, Any]

#: Functions of each set, and the first of its instances.
SETS = {"development": (range(2, 25, 2), 1), "held-out": (range(1, 25, 2), 11)}
DIMENSIONS = (2, 5, 10, 20, 40)
#: Evaluations per variable.
BUDGETS = (20, 50, 1000)
#: Targets, as distances to the optimum. Runs below the last distance are equal.
TARGETS = 10.0 ** np.arange(2.0, -8.1, -0.2)
OPTIMAL = 1e-8
#: Backends of this project in the table.
OWN = (
    "portfolio",
    "surrogate-search",
    "cma-es",
    "dual-annealing",
    "differential-evolution",
    "direct",
)


def problem(
    function: int, dimension: int, instance: int
) -> tuple[Callable[[Floats], float], float]:
    """Return a BBOB function and its minimum."""
    import cocoex

    call = cocoex.BareProblem("bbob", function, dimension, instance)
    return call, float(call.best_value())


def own(name: str) -> Search:
    """Return a backend of this project as a search."""

    def search(function: Counted, d: int, budget: int, seed: int) -> None:
        from black_box.searches import search as answer

        from crosstrack.models import BlackBoxMinimisation

        answer(name, BlackBoxMinimisation(function, [[LOW, HIGH]] * d, budget=budget), seed)

    return search


#: All searches by name.
SEARCHES: dict[str, Search] = {**{name: own(name) for name in OWN}, **RIVALS}


def feasible(name: str, dimension: int, budget: int) -> bool:
    """Return whether a search runs in acceptable time: about a minute per run."""
    count = dimension * budget
    limits = {
        "surrogate-search": 500,
        "Optuna TPE": 500,
        "Optuna CMA-ES": 2000,
        "cma lq-surrogate": 2000,
        "SciPy COBYQA": 2000 if dimension <= 20 else 800,
    }
    if name == "SciPy SHGO":
        return dimension <= 5 and budget <= 50
    return count <= limits.get(name, 10**9)


def read(path: Path) -> dict[tuple[Any, ...], Row]:
    """Return the rows of a file by their key; a truncated last line is dropped."""
    rows: dict[tuple[Any, ...], Row] = {}
    for line in path.read_text("utf-8").splitlines() if path.exists() else ():
        try:
            row = json.loads(line)
        except ValueError:
            continue
        rows[key(row)] = row
    return rows


def key(row: Row) -> tuple[Any, ...]:
    """Return the fields that identify a run."""
    return tuple(row[name] for name in ("set", "search", "function", "dimension", "budget", "seed"))


def benchmark(
    path: Path,
    group: str,
    names: Iterable[str],
    dimensions: Iterable[int],
    budgets: Iterable[int],
    seeds: int,
) -> None:
    """Run all searches that are missing in a file, and append one line for each."""
    functions, instance = SETS[group]
    done = read(path)
    for seed, budget, d, f, name in itertools.product(
        range(seeds), budgets, dimensions, functions, names
    ):
        row: Row = {
            "set": group, "search": name, "function": f, "dimension": d, "budget": budget, "seed": seed,
        }  # fmt: skip
        if key(row) in done or not feasible(name, d, budget):
            continue
        call, minimum = problem(f, d, instance + seed)
        counted = Counted(call, budget * d)
        begin = time.process_time()
        run(SEARCHES[name], counted, d, budget * d, 1000 * instance + seed)
        row["gap"] = counted.best - minimum
        row["left"] = counted.left
        row["seconds"] = round(time.process_time() - begin, 3)
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")


def summary(
    rows: Iterable[Row], names: Iterable[str], budgets: Iterable[int], dimensions: Iterable[int]
) -> dict[tuple[str, int], tuple[float, float, int, float]]:
    """Return mean rank, share of solved targets, runs and CPU seconds per evaluation by search and budget.

    Ranks are taken per function, dimension, budget and seed among the searches that ran there. A case counts if all
    searches ran there that ran in another case of the same dimension and budget, and the first of `names`, so an
    interrupted benchmark leaves no cases with fewer rivals.
    """
    names, budgets, dimensions = list(names), set(budgets), set(dimensions)
    cases: dict[tuple[int, ...], dict[str, Row]] = defaultdict(dict)
    everyone: dict[tuple[int, ...], set[str]] = defaultdict(set)
    for row in rows:
        if (
            row["search"] in names
            and row["budget"] in budgets
            and row["dimension"] in dimensions
            and feasible(row["search"], row["dimension"], row["budget"])
        ):
            place = (row["budget"], row["dimension"], row["function"], row["seed"])
            cases[place][row["search"]] = row
            everyone[place[:2]].add(row["search"])
    ranks: dict[tuple[str, int], list[tuple[float, float, float]]] = defaultdict(list)
    for (budget, d, *_), found in cases.items():
        if set(found) != everyone[budget, d] or names[0] not in found or len(found) < 2:
            continue
        gaps = np.maximum([row["gap"] for row in found.values()], OPTIMAL)
        # Ranks from 1 to 10, so that cases with fewer searches weigh the same.
        places = 1 + 9 * (rankdata(gaps) - 1) / (len(gaps) - 1)
        for name, gap, place in zip(found, gaps, places, strict=True):
            solved = float((gap <= TARGETS * (1 + 1e-9)).mean())
            ranks[name, budget].append((place, solved, found[name]["seconds"] / (budget * d)))
    return {
        place: (
            *np.mean(entries, axis=0)[:2].tolist(),
            len(entries),
            float(np.mean(entries, axis=0)[2]),
        )
        for place, entries in ranks.items()
    }


def main() -> None:
    """Run the benchmark, or print or write its table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("command", choices=("run", "table"))
    parser.add_argument(
        "path", type=Path, nargs="+", help="files of runs; `run` writes to the first"
    )
    parser.add_argument("--set", choices=list(SETS), default="development")
    parser.add_argument("--searches", nargs="+", default=list(SEARCHES))
    parser.add_argument("--dimensions", nargs="+", type=int, default=DIMENSIONS)
    parser.add_argument("--budgets", nargs="+", type=int, default=BUDGETS)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--write", action="store_true", help="write the table of the page")
    given = parser.parse_args()
    if given.command == "run":
        benchmark(
            given.path[0], given.set, given.searches, given.dimensions, given.budgets, given.seeds
        )
        return
    rows = [row for path in given.path for row in read(path).values() if row["set"] == given.set]
    found = summary(rows, given.searches, given.budgets, given.dimensions)
    show(found)
    if given.write:
        write_table(rows, found, given.dimensions)


def write_table(
    rows: list[Row],
    found: dict[tuple[str, int], tuple[float, float, int, float]],
    dimensions: Iterable[int],
) -> None:
    """Write the table of the page, with the dimensions that every budget was measured for."""
    from benchmarks.measured import write

    budgets = sorted({budget for _, budget in found})
    names = sorted(
        {name for name, _ in found}, key=lambda name: found.get((name, budgets[0]), (99.0,))
    )
    columns = {"search": ""}
    for budget in budgets:
        columns |= {
            f"{budget} d: rank": ".2f",
            f"{budget} d: solved": ".1f",
            f"{budget} d: runs": "d",
        }
    cells = []
    for name in names:
        row: list[Any] = [name]
        for budget in budgets:
            rank, solved, count, _ = found.get((name, budget), (None, None, None, None))
            row += [rank, None if solved is None else 100 * solved, count]
        cells.append(row)
    sizes = []
    for budget in budgets:
        measured = [d for d in dimensions if summary(rows, names, [budget], [d])]
        sizes.append(f"{budget} d: d = {', '.join(map(str, measured))}")
    seeds = len({row["seed"] for row in rows})
    said = (
        "Mean rank, scaled to 1 (first) … 10 (last) among the searches that ran on a function, and share of solved "
        f"targets in per cent. The 12 odd BBOB functions, {seeds} seed{'s' * (seeds > 1)}; {'; '.join(sizes)}. "
        "A search with fewer runs was left out for its computing time, and so were functions on which not all others "
        "had ended."
    )
    packages = ("cma", "pymoo", "scipy", "nevergrad", "optuna", "coco-experiment")
    write("black-box", "searches", __file__, columns, cells, packages, said)


def show(found: dict[tuple[str, int], tuple[float, float, int, float]]) -> None:
    """Print the summary by budget, the best mean rank first."""
    for budget in sorted({budget for _, budget in found}):
        print(f"budget {budget} d")
        entries = [(values, name) for (name, other), values in found.items() if other == budget]
        for (rank, solved, count, seconds), name in sorted(entries):
            print(
                f"  {name:26s} {rank:6.2f} {100 * solved:6.1f} % {count:5d} runs {1e3 * seconds:8.3f} ms"
            )


if __name__ == "__main__":
    main()
