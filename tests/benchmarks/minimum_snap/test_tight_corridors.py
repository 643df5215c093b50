"""What each backend makes of corridors and limits that leave hardly any room, or just none.

Nothing fails because a solver gives up; a contradiction fails, and so does ``auto`` where it leaves
one unsolved. Run with ``make bench``, or::

    pytest tests/benchmarks/minimum_snap/test_tight_corridors.py -s --peer-limit 10
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest
from minimum_snap.tightness import Case, drawn

import crosstrack as ct
from crosstrack.solvers.registry import fitting

#: Cases that `auto` gets, and how many of them the others.
COUNT, EVERY = 200, 5


@pytest.fixture(scope="module")
def cases() -> list[Case]:
    return drawn(COUNT)


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


def shown(capsys: Any, name: str, feasible: Counter[str], infeasible: Counter[str]) -> None:
    with capsys.disabled():
        print(f"\n  {name:16} feasible {dict(feasible)}, infeasible {dict(infeasible)}")


@pytest.mark.timeout(0)
def test_auto_settles_all(cases: list[Case], limit: float, capsys: Any) -> None:
    feasible, infeasible = tallied(cases, "auto", limit)
    shown(capsys, "auto", feasible, infeasible)
    assert set(feasible) <= {"optimal"}
    assert set(infeasible) <= {"infeasible"}


@pytest.mark.timeout(0)
def test_no_backend_contradicts(cases: list[Case], limit: float, capsys: Any) -> None:
    for name in fitting(cases[0].model):
        if name != "banded":
            shown(capsys, name, *tallied(cases[::EVERY], name, limit))
