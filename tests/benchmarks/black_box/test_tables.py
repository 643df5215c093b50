"""All searches of black boxes at equal evaluations: the paper's tables 2 and 3, and moved optima.

Each runs from many seeds on the paper's five functions, as printed and with their optima moved. Shown
are medians of how far above the optimum a run ends, with a dot where a Mann-Whitney test over the
seeds, corrected by Holm for all pairs, does not tell a search from the best one of the column, and mean
ranks with the p value of Friedman's test over the functions. What draws nothing has its one value for all
seeds. Run with ``make bench``, or with other seeds and evaluations::

    CROSSTRACK_BLACK_BOX_SEEDS=10 CROSSTRACK_BLACK_BOX_EVALUATIONS=5000,10000,20000 \
        pytest tests/benchmarks/black_box/test_tables.py -s
"""

from __future__ import annotations

import itertools
import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np
import pytest
from scipy import stats

import crosstrack as ct
from crosstrack.instances import entries
from crosstrack.solvers import find_backend
from crosstrack.solvers.backend import Control, Request
from crosstrack.solvers.black_box.paper_tables import TABLES
from crosstrack.solvers.report.layout import Column

SEEDS = int(os.environ.get("CROSSTRACK_BLACK_BOX_SEEDS", "50"))
EVALUATIONS = [
    int(one) for one in os.environ.get("CROSSTRACK_BLACK_BOX_EVALUATIONS", "10000").split(",")
]
#: Searches that the tables lack, as they take longer.
SLOWER = ("dual-annealing", "shgo", "cma-es", "particle-swarm")
#: Of a test that two searches are alike.
LEVEL = 0.05
#: Distances from the optimum below which all count as there.
SAME = 1e-9


def searches() -> dict[str, tuple[str, dict[str, Any]]]:
    """Return the searches of the tables that can be run here: name and options, by label."""
    found = {}
    for column in (*TABLES.tables[2].columns, *map(Column, SLOWER)):
        if not find_backend(column.backend).missing():
            found[" ".join(column.label.split())] = (column.backend, dict(column.options))
    return found


def value_of(case: tuple[str, str, dict[str, Any], int, int]) -> tuple[float, int]:
    """Return what one run finds, verified, and the evaluations that it used."""
    instance, name, options, evaluations, seed = case
    model, backend = ct.load(instance), find_backend(name)
    request = Request(
        seed=seed,
        evaluations=evaluations,
        options=backend.checked_options(options),
        control=Control(oracle=model.oracle()),
    )
    answer = backend.run(model.blinded(), request)
    return float(model.verify(answer.point).objective), answer.statistics["evaluations"]


def alike(values: np.ndarray) -> np.ndarray:
    """Return which pairs of rows a Mann-Whitney test does not tell apart, Holm's correction made."""
    pairs = list(itertools.combinations(range(len(values)), 2))
    found = [stats.mannwhitneyu(values[a], values[b], method="asymptotic").pvalue for a, b in pairs]
    # A test of ties alone has no statistic: nothing tells such rows apart.
    chance = np.nan_to_num(np.array(found), nan=1.0)
    order = np.argsort(chance)
    held = np.maximum.accumulate(chance[order] * np.arange(len(pairs), 0, -1))
    same = np.eye(len(values), dtype=bool)
    for place, corrected in zip(order, held, strict=True):
        a, b = pairs[place]
        same[a, b] = same[b, a] = corrected >= LEVEL
    return same


@pytest.mark.timeout(0)
@pytest.mark.parametrize("table", [2, 3], ids=["printed", "moved"])
@pytest.mark.parametrize("evaluations", EVALUATIONS)
def test_functions_at_equal_evaluations(evaluations: int, table: int, capsys: Any) -> None:
    names = searches()
    rows = [one for one in entries() if one.name.startswith("black-box/")]
    rows = sorted(
        (one for one in rows if one.published.get("table") == table),
        key=lambda one: one.published["row"],
    )
    # What draws nothing gives the same for each seed.
    seeds = [1 if find_backend(name).deterministic else SEEDS for name, _ in names.values()]
    cases = [
        (one.name, name, options, evaluations, seed)
        for one in rows
        for (name, options), count in zip(names.values(), seeds, strict=True)
        for seed in range(count)
    ]
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(mp_context=spawn) as pool:
        done = np.array(list(pool.map(value_of, cases, chunksize=10)))
    parts = np.split(done, np.cumsum(seeds * len(rows))[:-1])
    every = np.array([np.resize(part, (SEEDS, 2)) for part in parts])
    values, used = np.moveaxis(every.reshape(len(rows), len(names), SEEDS, 2), -1, 0)
    assert used.max() <= evaluations
    least = np.array([one.published["optimum"] for one in rows])
    assert (values >= least[:, None, None] - SAME).all()

    values = values - least[:, None, None]
    values[values <= SAME] = 0.0
    middle = np.median(values, axis=2)
    ranks = stats.rankdata(middle, axis=1)
    chance = stats.friedmanchisquare(*ranks.T).pvalue
    order = ranks.mean(axis=0).argsort(kind="stable")
    labels = list(names)
    with capsys.disabled():
        title = "Tables 2 and 3, as printed" if table == 2 else "The same, their optima moved"
        print(f"\n{title}: medians above the optimum, {evaluations} evaluations, {SEEDS} seeds")
        print("| | " + " | ".join(one.name.partition("/")[2] for one in rows) + " | mean rank |")
        print("|---|" + "---|" * (len(rows) + 1))
        same = [alike(values[row])[middle[row].argmin()] for row in range(len(rows))]
        for k in order:
            cells = [
                f"{middle[row, k]:.2g}{' ·' if same[row][k] else ''}" for row in range(len(rows))
            ]
            few = (
                "" if used[:, k].min() == evaluations else f" ({used[:, k].min():.0f} at the least)"
            )
            print(f"| {labels[k]}{few} | " + " | ".join(cells) + f" | {ranks[:, k].mean():.1f} |")
        print(f"Friedman's test that all are alike: p = {chance:.2g}", flush=True)

    # What the paper's table hides: its swarm is pulled to where its optima lie.
    printed, free = labels.index("iafsa shrink=True"), labels.index("iafsa")
    for row, one in enumerate(rows):
        if "rastrigin" in one.name or "sum-squares" in one.name:
            better = middle[row, printed] < 0.7 * middle[row, free]
            assert better == (table == 2), (one.name, middle[row])
    assert chance < LEVEL
