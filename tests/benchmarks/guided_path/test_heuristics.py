"""Savings of leaving out customers that any tour passes in time, and seconds of the heuristics on large tours.

Nothing fails because it is slow. Run with ``make bench``, or::

    pytest tests/benchmarks/guided_path/test_heuristics.py -s
"""

from __future__ import annotations

from statistics import median
from typing import Any

import numpy as np
import pytest
from guided_path.enumerated import chains_tour

from crosstrack.models import GuidedPathTour
from crosstrack.solvers import Answer, Backend, Request
from crosstrack.solvers.guided_path.dynamic_programming import DynamicProgramming
from crosstrack.solvers.guided_path.insertion import Greedy, InsertIndex, InsertNearest

SEEDS = 20
HEURISTICS = (InsertNearest, InsertIndex, Greedy)


def answered(backend: Backend, model: GuidedPathTour, **options: Any) -> Answer:
    answer = backend.run(model, Request(options=backend.checked_options(options)))
    assert answer.primal_bound is not None
    assert model.verify(answer.point).ok
    return answer


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
