"""Every backend on corridors and limits that leave almost no room, or just none.

A solver may give up, but a contradiction fails. The slow tests of ``test_tightness.py`` require that ``auto``
settles every case. Run with ``make bench``, or::

    pytest tests/benchmarks/minimum_snap/test_tight_corridors.py -s --peer-limit 10
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest
from minimum_snap.tightness import Case, drawn

import crosstrack as ct
from crosstrack.solvers.contract.selection import fitting

#: Number of cases.
COUNT = 40


def tallied(cases: list[Case], backend: str, limit: float) -> tuple[Counter[str], Counter[str]]:
    """Return how the feasible and the infeasible cases ended."""
    feasible: Counter[str] = Counter()
    infeasible: Counter[str] = Counter()
    for case in cases:
        answer = ct.solve(case.model, backend, time_limit=limit)
        ended = str(answer.termination)
        wrong = ended == "infeasible" if case.feasible else answer.plan is not None
        assert not wrong, f"{backend} contradicts {case.name}: {answer}"
        (feasible if case.feasible else infeasible)[ended] += 1
    return feasible, infeasible


@pytest.mark.timeout(0)
def test_no_backend_contradicts(limit: float, capsys: Any) -> None:
    cases = drawn(COUNT)
    for name in fitting(cases[0].model):
        if name != "banded":
            feasible, infeasible = tallied(cases, name, limit)
            with capsys.disabled():
                print(f"\n  {name:16} feasible {dict(feasible)}, infeasible {dict(infeasible)}")
