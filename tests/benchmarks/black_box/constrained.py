"""Constraints with few evaluations: which searches find verified plans, and how good they are.

The problems are g04, g06 and g08 of CEC 2006 and those of three worked examples (gains of a controller, a path with a
clearance, a gripper). The rivals are COBYQA of SciPy with its native constraints and CMA-ES with a static penalty of
1000 times the violations, each from random points and restarted. One seed decides the starts of all searches::

    python tests/benchmarks/black_box/constrained.py runs.jsonl --budgets 100 200 --seeds 5 --write
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import sys
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).parents[3]
sys.path[:0] = [str(Path(__file__).parent), *map(str, Path(__file__).parents[1:3])]

from black_box.published import PUBLISHED  # noqa: E402
from rivals import Spent, run  # noqa: E402

from crosstrack.models import BlackBoxMinimisation  # noqa: E402
from crosstrack.models.black_box import PythonFunction  # noqa: E402

Floats = NDArray[np.float64]

EXAMPLES = {"gains": "plot_gain_tuning", "path": "plot_clearance", "gripper": "plot_gripper"}
OWN = ("portfolio", "surrogate-search", "cobyqa", "cma-es", "differential-evolution")
#: Factor of the violations of the rival with a penalty.
PENALTY = 1e3


def problems() -> dict[str, BlackBoxMinimisation]:
    """Return the problems by name; those of the examples are the code in front of the first solution."""
    found = {
        name: BlackBoxMinimisation(
            PythonFunction(function, vectorized=True), bounds, inequalities=count
        )
        for name, (function, bounds, count, _) in PUBLISHED.items()
        if name != "g01"
    }
    for name, file in EXAMPLES.items():
        text = (ROOT / "docs" / "examples" / f"{file}.py").read_text("utf-8")
        space: dict[str, Any] = {}
        exec(text[: text.rindex("\n", 0, text.index("ct.solve("))], space)  # noqa: S102
        found[name] = space["problem"]
    return found


class Constrained:
    """Function with constraints that counts its evaluations and keeps the best feasible value."""

    def __init__(self, model: BlackBoxMinimisation, budget: int) -> None:
        self.model, self.left, self.best = model, budget, float("inf")

    def __call__(self, unit: Any) -> Floats:
        """Return the columns at a point of the unit cube."""
        if self.left <= 0:
            raise Spent
        self.left -= 1
        model = self.model
        x = model.lows + np.clip(np.asarray(unit, float), 0, 1) * (model.highs - model.lows)
        row: Floats = model.function.table(x[None], model.columns)[0]
        if np.isfinite(row).all() and (row[1:] <= 0).all():
            self.best = min(self.best, float(row[0]))
        return np.nan_to_num(row, nan=1e6, posinf=1e6)


def scipy_cobyqa(function: Constrained, d: int, budget: int, seed: int) -> None:
    """COBYQA of SciPy with native constraints."""
    from scipy.optimize import NonlinearConstraint, minimize

    generator = np.random.default_rng(seed)
    last: dict[bytes, Floats] = {}

    def row(x: Floats) -> Floats:
        if x.tobytes() not in last:
            last.clear()
            last[x.tobytes()] = function(x)
        return last[x.tobytes()]

    while True:
        constraint = NonlinearConstraint(lambda x: row(x)[1:], -np.inf, 0.0)
        minimize(
            lambda x: row(x)[0],
            generator.random(d),
            method="COBYQA",
            bounds=[(0, 1)] * d,
            constraints=[constraint],
            options={"initial_tr_radius": 0.1, "maxfev": 10**9, "maxiter": 10**9},
        )


def penalty_cma(function: Constrained, d: int, budget: int, seed: int) -> None:
    """CMA-ES with a static penalty."""
    import cma

    generator = np.random.default_rng(seed)

    def value(x: Floats) -> float:
        row = function(x)
        return float(row[0] + PENALTY * np.maximum(row[1:], 0).sum())

    options = {"bounds": [0, 1], "verbose": -9, "verb_log": 0, "seed": seed + 1}
    while True:
        cma.fmin2(value, generator.random(d), 0.3, options)


RIVALS = {"SciPy COBYQA": scipy_cobyqa, "cma with a penalty": penalty_cma}


def best_of(name: str, model: BlackBoxMinimisation, budget: int, seed: int) -> float:
    """Return the objective of the verified plan of a search, infinite without one."""
    if name in RIVALS:
        function = Constrained(model, budget)
        run(RIVALS[name], function, model.dimension, budget, seed)  # type: ignore[arg-type]
        return function.best
    from black_box.searches import search

    answer, _ = search(name, replace(model, budget=budget), seed)
    if answer.point is None:
        return float("inf")
    check = model.verify(answer.point)
    assert check.ok and check.objective is not None
    return check.objective


def main() -> None:
    """Print the number of plans and the median objective of each search, and write the table of the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("path", type=Path, help="file of runs, which are not repeated")
    parser.add_argument("--budgets", nargs="+", type=int, default=[100, 200])
    parser.add_argument("--searches", nargs="+", default=[*OWN, *RIVALS])
    parser.add_argument("--problems", nargs="+", default=list(problems()))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--write", action="store_true", help="write the table of the page")
    given = parser.parse_args()
    lines = given.path.read_text("utf-8").splitlines() if given.path.exists() else []
    done = {tuple(key): value for key, value in map(json.loads, lines)}
    cells = []
    for budget, name in itertools.product(given.budgets, given.problems):
        row: list[Any] = [name, budget]
        for search in given.searches:
            for seed in range(given.seeds):
                key = (name, budget, search, seed)
                if key not in done:
                    value = best_of(search, problems()[name], budget, seed)
                    done[key] = value if math.isfinite(value) else None
                    with given.path.open("a", encoding="utf-8") as file:
                        file.write(json.dumps([key, done[key]]) + "\n")
            values = [done[name, budget, search, seed] for seed in range(given.seeds)]
            count = len(values) - values.count(None)
            middle = median(math.inf if value is None else value for value in values)
            row.append(f"{count}: {middle:.6g}" if math.isfinite(middle) else f"{count}")
            print(name, budget, search, row[-1], flush=True)
        cells.append(row)
    if given.write:
        from benchmarks.measured import write

        columns = {"problem": "", "evaluations": "d", **dict.fromkeys(given.searches, "")}
        said = (
            f"Number of runs of {given.seeds} seeds with a feasible point, and the median of the best feasible "
            "objectives if most runs have one."
        )
        write("black-box", "constrained", __file__, columns, cells, ("cma", "scipy"), said)


if __name__ == "__main__":
    main()
