"""Our values for the rows of the result tables, see :mod:`.paper`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from statistics import fmean, median, stdev
from typing import Any

from ..catalogue import load
from ..paper import Run, Trials
from .generator import generate
from .listing import FUNCTIONS, LENGTHS
from .paper import FUNCTIONS as NAMES, PAPER, RIVALS, SEARCHES, WALKERS

__all__ = ["equal_evaluations", "paths", "table_2", "table_3", "table_4", "table_5"]

#: Distance from the optimum that is shown as 0.
_SAME = 1e-9
#: Number of evaluations that exceeds those of any swarm of the paper in 200 iterations.
_AMPLE = 10**6


def _runs(
    row: tuple[str, ...], trials: Trials, iterations: int, ending: str = "", dimension: int = 0
) -> Sequence[Run]:
    """Return the runs of a swarm over the iterations of the paper."""
    name, algorithm = row
    model: Any = load(f"black-box/{NAMES[name]}{ending}")
    if dimension:
        formula = next(entry[1] for entry in FUNCTIONS if entry[0] == NAMES[name])
        model = generate(formula, dimension)
    options = {"iterations": iterations}
    return trials.run(replace(model, budget=_AMPLE), SEARCHES[algorithm], options=options)


def _above(row: tuple[str, ...], runs: Sequence[Run]) -> list[float]:
    """Return the distances from the optimum."""
    least = next(entry[3] for entry in FUNCTIONS if entry[0] == NAMES[row[0]])
    return [max(value - least, 0.0) for value in _values(runs)]


def _values(runs: Sequence[Run]) -> list[float]:
    """Return the best values of runs, all of which have one."""
    return [value for run in runs if (value := run.primal_bound) is not None]


def table_2(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return the means of the best values after 50, 100 and 200 iterations."""
    cells: dict[str, Any] = {}
    for iterations in (50, 100, 200):
        for ending, head in (("", ""), ("-shifted", "moved, ")):
            runs = _runs(row, trials, iterations, ending)
            values = _above(row, runs)
            cells[f"{head}{iterations} Itr"] = fmean(values)
            if not ending:
                cells["deviation"] = stdev(values) if len(values) > 1 else None
                cells["evaluations"] = round(fmean(run.statistics["evaluations"] for run in runs))
                cells["runs"] = len(runs)
    if NAMES[row[0]].endswith("-10"):
        cells["2 variables, 50 Itr"] = fmean(_above(row, _runs(row, trials, 50, dimension=2)))
    return cells


def table_3(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return how many iterations runs of 200 iterations take to converge."""
    counts = [run.statistics["converged after"] for run in _runs(row, trials, 200)]
    return {
        "Max": max(counts),
        "Min": min(counts),
        "Mean": round(fmean(counts)),
        "runs": len(counts),
    }


def _robot(name: str, row: tuple[str, ...]) -> Mapping[str, Any]:
    """Return texts for cells of the real robot, and the ratio of two printed cells."""
    table = PAPER.table(name)
    cells = dict(zip(table.columns, table.rows[row], strict=True))
    return {
        **dict.fromkeys(cells, "no robot"),
        "IAFSA / A*, printed": float(cells["IAFSA"]) / float(cells["A*"]),  # type: ignore[arg-type]
    }


def table_4(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return that a cell of Table 4 cannot be obtained."""
    return _robot("table-4", row)


def table_5(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return that a cell of Table 5 cannot be obtained."""
    return _robot("table-5", row)


def equal_evaluations(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return the median distances from the optimum of all searches after 10,000 evaluations."""
    (name,) = row
    model = load(f"black-box/{name}")
    least = next(entry[3] for entry in FUNCTIONS if entry[0] == name.removesuffix("-shifted"))
    cells: dict[str, Any] = {"runs": trials.runs}
    for backend in RIVALS:
        runs = trials.run(model, backend, evaluations=10_000)
        value = median(_values(runs)) - least
        cells[backend] = value if value > _SAME else 0.0
    return cells


def paths(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return the median lengths of paths through waypoints on one map."""
    (name,) = row
    model = load(f"black-box/path-{name}")
    shortest = LENGTHS.get(name, (None, None))
    cells: dict[str, Any] = {
        "shortest, any direction": shortest[0],
        "shortest, eight neighbours": shortest[1],
        "runs": trials.runs,
    }
    for backend in WALKERS:
        runs = trials.run(model, backend, evaluations=10_000)
        cells[backend] = median(_values(runs))
    return cells
