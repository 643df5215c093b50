"""Seconds to a proof by HiGHS and CP-SAT on both programs, by the number of chains of five.

Nothing fails because it is slow. Run with ``make bench``, or::

    pytest tests/benchmarks/guided_path/test_formulations.py -s
"""

from __future__ import annotations

from statistics import median
from typing import Any

import pytest

import crosstrack as ct
from crosstrack.instances.guided_path import generate

SEEDS, SECONDS = range(1, 4), 30.0
RUNS = ("highs:sweeps", "cp-sat:sweeps", "highs:arcs", "cp-sat:arcs")


@pytest.mark.timeout(0)
@pytest.mark.parametrize("chains", [3, 4, 5, 6, 8, 10])
def test_programs(chains: int, capsys: Any) -> None:
    models = [generate(chains, 5, seed) for seed in SEEDS]
    # Those of arcs end with few chains only.
    names = RUNS if chains <= 6 else RUNS[:2]
    found = ct.compare(models, ["a-star", *names], time_limit=SECONDS, compiled=True)
    assert found.outcome == "AGREED"
    cells = []
    for name in names:
        backend, _, formulation = name.partition(":")
        runs = [
            one
            for one in found.solutions
            if (one.backend, one.formulation) == (backend, formulation)
        ]
        seconds = [one.seconds["solve"] for one in runs]
        proven = sum(one.termination == "optimal" for one in runs)
        cells.append(f"{name} {median(seconds):.2f} / {max(seconds):.1f} s, {proven} of 3 proven")
    with capsys.disabled():
        print(f"\n{chains} chains of 5, median / longest: " + "; ".join(cells))
