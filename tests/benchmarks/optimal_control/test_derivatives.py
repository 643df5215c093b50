"""Derivatives of a transcribed program beside CasADi's own of the same functions.

``Assembly`` writes the derivatives in their known structure; without them, ``NonlinearProgram``
differentiates the values automatically. Both are called in turns at the same point. The
test fails for wrong derivatives, not for slow ones. Run with::

    pytest tests/benchmarks/optimal_control/test_derivatives.py -s
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from benchmarks.ledger import Ledger, Row

import crosstrack as ct

PROBLEMS = ("brachistochrone", "goddard", "van-der-pol", "orbit-raising", "container-crane")
#: Intervals of 6 nodes: the first mesh of a search, and two meshes after refinement.
INTERVALS = (8, 20, 60)
#: Number of calls in turns, and seconds after which no further call begins.
CALLS, LIMIT = 25, 2.0


def _time_in_turns(first: Callable[[], Any], second: Callable[[], Any]) -> list[tuple[float, ...]]:
    """Return the seconds of pairs of calls, after one call of each that is not timed."""
    first(), second()
    pairs: list[tuple[float, ...]] = []
    end = time.perf_counter() + LIMIT
    while len(pairs) < 3 or (len(pairs) < CALLS and time.perf_counter() < end):
        pair = []
        for call in (first, second):
            begin = time.perf_counter()
            call()
            pair.append(time.perf_counter() - begin)
        pairs.append(tuple(pair))
    return pairs


@pytest.mark.parametrize("intervals", INTERVALS)
@pytest.mark.parametrize("problem", PROBLEMS)
def test_derivatives(problem: str, intervals: int, ledger: Ledger) -> None:
    """Both return the same matrices; the ledger holds the seconds of the calls and their ratio."""
    model = ct.load(f"optimal-control/{problem}")
    program = model.formulate(None, intervals=intervals, refine=False, dependent="keep").program
    automatic = replace(program, derivatives=None, hessian=None)
    rng = np.random.default_rng(0)
    point = program.guess + 1e-3 * program.column_scale * rng.normal(size=program.size)
    point = np.clip(point, program.column_lower, program.column_upper)
    duals = rng.normal(size=program.row_count)
    for what, ours, theirs in (
        ("Jacobian", *((lambda p=p: p.first_order(point)[1]) for p in (program, automatic))),
        ("Hessian", *((lambda p=p: p.second_order(point, 1.0, duals)) for p in (program, automatic))),
    ):  # fmt: skip
        mine, other = (sp.csc_array(matrix.sparse()) for matrix in (ours(), theirs()))
        assert np.isfinite(mine.data).all()
        assert np.abs((mine - other).data).max(initial=0.0) <= 1e-8 * np.abs(other.data).max()
        seconds = np.array(_time_in_turns(ours, theirs))
        least = seconds.min(axis=0)
        title = f"{what} of {problem}, {intervals} intervals"
        ledger.titles[title] = f"{title}, {program.size} columns"
        ledger.rows += [
            Row(title, "Assembly", seconds[:, 0].tolist(), seconds[:, 0].tolist()),
            Row(
                title, "CasADi", seconds[:, 1].tolist(), seconds[:, 1].tolist(),
                outcome=f"{least[1] / least[0]:.1f} times Assembly, by the shortest of "
                f"{len(seconds)} calls",
            ),
        ]  # fmt: skip
