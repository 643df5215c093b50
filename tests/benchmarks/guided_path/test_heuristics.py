"""How far merging chains and cheapest insertion lie above the optimum, by the number of chains.

The paper's setting: k = 1, …, 10 chains of 5 customers at whole numbers from 1 to 200, ours by seed.
Also what leaving out customers that any tour passes in time saves of the paper's table. Nothing
fails because it is slow. Run with ``make bench``, or::

    pytest tests/benchmarks/guided_path/test_heuristics.py -s
"""

from __future__ import annotations

from statistics import mean, median
from typing import Any

import numpy as np
import pytest
from guided_path.enumerated import chains_tour

from crosstrack.models import GuidedPathTour
from crosstrack.solvers import Answer, Backend, Request
from crosstrack.solvers.guided_path.dynamic_programming import DynamicProgramming
from crosstrack.solvers.guided_path.greedy import Greedy
from crosstrack.solvers.guided_path.insertion import InsertIndex, InsertNearest

SEEDS = 20
HEURISTICS = (InsertNearest, InsertIndex, Greedy)


def answered(backend: Backend, model: GuidedPathTour, **options: Any) -> Answer:
    answer = backend.run(model, Request(options=backend.checked_options(options)))
    assert answer.primal_bound is not None
    assert model.verify(answer.point).ok
    return answer


@pytest.mark.timeout(0)
def test_above_the_optimum(capsys: Any) -> None:
    names = "".join(f"{one.name:>26}" for one in HEURISTICS)
    lines = [
        "",
        f"means of {SEEDS} seeds; as built, and at once served in passing; above the optimum",
    ]
    lines.append(f"{'k':>3}{'optimum':>9}{names}")
    for k in range(1, 11):
        models = [chains_tour(k, 5, seed) for seed in range(SEEDS)]
        least = [answered(DynamicProgramming(), one).primal_bound or 0.0 for one in models]
        line = f"{k:>3}{mean(least):>9.1f}"
        for backend in HEURISTICS:
            answers = [answered(backend(), one) for one in models]
            raw = mean(float(one.statistics["length as built"]) for one in answers)
            final = [one.primal_bound or 0.0 for one in answers]
            assert all(a >= b for a, b in zip(final, least, strict=True))
            above = mean(a / b - 1 for a, b in zip(final, least, strict=True))
            line += f"{raw:>9.1f}{mean(final):>9.1f}{above:>+8.1%}"
        lines.append(line)
    with capsys.disabled():
        print("\n".join(lines))


@pytest.mark.timeout(0)
def test_tables_with_and_without_what_is_passed(capsys: Any) -> None:
    """One seed; the paper's plain table up to k = 9."""
    lines = ["", f"{'k':>3}{'customers':>11}{'entries':>12}{'s':>8}{'plain':>12}{'s':>8}"]
    answered(DynamicProgramming(), chains_tour(2, 5, 0))
    for k in range(1, 11):
        model = chains_tour(k, 5, 0)
        answer = answered(DynamicProgramming(), model)
        left = 5 * k - int(answer.statistics["customers left out"])
        line = f"{k:>3}{left:>11}{answer.statistics['table entries']:>12}{answer.seconds['solve']:>8.3f}"
        if k < 10:
            plain = answered(DynamicProgramming(), model, passing=False)
            assert plain.primal_bound == answer.primal_bound
            line += f"{plain.statistics['table entries']:>12}{plain.seconds['solve']:>8.3f}"
        lines.append(line)
    kept = [
        5 * 10 - int(answer.statistics["customers left out"])
        for seed in range(SEEDS)
        for answer in [answered(DynamicProgramming(), chains_tour(10, 5, seed))]
    ]
    lines.append(f"k = 10: {median(kept):g} of 50 customers matter, median of {SEEDS} seeds")
    with capsys.disabled():
        print("\n".join(lines))


@pytest.mark.timeout(0)
@pytest.mark.parametrize(("k", "size"), [(1000, 5), (5000, 1), (5, 1000), (1, 5000)])
def test_five_thousand_customers(k: int, size: int, capsys: Any) -> None:
    for backend in HEURISTICS:
        runs = [answered(backend(), chains_tour(k, size, seed)) for seed in range(3)]
        seconds = np.median([run.seconds["solve"] for run in runs])
        with capsys.disabled():
            print(f"\n{k} chains of {size}, {backend.name}: {seconds:.2f} s")
