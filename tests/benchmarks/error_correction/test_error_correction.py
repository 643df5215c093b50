"""Speed of ``label-setting`` beside the paper's algorithms, a MIP solver and a peer from PyPI.

Nothing fails because it is slow; everything fails that is wrong. Run with ``make bench``, or::

    pytest tests/benchmarks -k "row" --peer-limit 20
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from typing import Any

import pytest
from benchmarks.cases import CASES, HEAVY, Case, arc_count
from benchmarks.error_correction import cspy_peer
from benchmarks.ledger import Ledger, Row, duration

import crosstrack as ct
from crosstrack.errors import BackendMissing, UnsupportedFormulation

NATIVE = ("two-stage", "pulse", "dynamic-programming")
#: Warm: with the optimal length as a bound, and the optimal route if the solver accepts a start.
PEERS = (*NATIVE, "highs, warm", "highs, cold", "cspy, warm", "cspy, cold")


@dataclass(frozen=True)
class Call:
    """Time and answer of one solver call."""

    own: float
    whole: float
    plan: Any
    length: float | None
    bound: float | None
    optimal: bool
    work: str
    outcome: str


@pytest.fixture(scope="module", autouse=True)
def compiled() -> None:
    """Compile everything beforehand; what that takes is timed in ``test_first_minute.py``."""
    model = ct.load("error-correction/1")
    for backend in ("label-setting", *NATIVE):
        ct.solve(model, backend)
    ct.solve(model, "highs", formulation="arc-flow")


@pytest.mark.parametrize("row", range(1, 7))
def test_cspy_is_right_on_small_rows(row: int) -> None:
    model = ct.load(f"error-correction/{row}")
    best = ct.solve(model, "label-setting").primal_bound
    for bound in (None, best):
        found = cspy_peer.run(model, bound=bound)
        checked = ct.verify(model, found.plan)
        assert found.simple and checked.ok, checked
        assert checked.objective == pytest.approx(best, rel=1e-9)


@pytest.mark.parametrize("name", CASES)
def test_label_setting(name: str, benchmark: Any, ledger: Ledger) -> None:
    case = CASES[name]
    calls = repeated(benchmark, case, lambda model: solved(model, "label-setting"), case.repeats)
    best = case.reference
    if case.optimum is not None:
        assert best.primal_bound == pytest.approx(case.optimum, abs=6e-4)
    check(case, calls)
    wanted = [
        f"{part} ≤ {goal * 1e3:g} ms"
        for part, goal in zip(("own", "whole"), case.goals, strict=True)
        if goal < float("inf")
    ]
    own, whole = (median(getattr(call, part) for call in calls) for part in ("own", "whole"))
    kept = own <= case.goals[0] and whole <= case.goals[1]
    ledger.titles[name] = (
        f"{name}: {best.primal_bound:.3f} m, {best.plan.corrections} corrections; wanted: "
        f"{', '.join(wanted)}: {'kept' if kept else 'MISSED'}"
    )
    enter(ledger, case, "label-setting", calls)
    benchmark.extra_info["own median"] = own


@pytest.mark.parametrize("peer", PEERS)
@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.peer_repeats])
def test_peer(name: str, peer: str, benchmark: Any, ledger: Ledger, limit: float) -> None:
    case = CASES[name]
    reason = obstacle(case, peer)
    if reason:
        ledger.rows.append(Row(name, peer, outcome=reason))
        pytest.skip(reason)
    run = runner(case, peer, limit)
    try:
        calls = repeated(benchmark, case, run, 1 if peer == "highs, cold" else case.peer_repeats)
    except (UnsupportedFormulation, BackendMissing) as error:
        ledger.rows.append(Row(name, peer, outcome=f"refused: {error}"))
        pytest.skip(str(error))
    except pytest.skip.Exception as absent:
        ledger.rows.append(Row(name, peer, outcome=str(absent)))
        raise
    check(case, calls)
    enter(ledger, case, peer, calls)
    own = median(call.own for call in calls)
    benchmark.extra_info["own median"] = own


def repeated(benchmark: Any, case: Case, run: Callable[[Any], Call], repeats: int) -> list[Call]:
    """Return `repeats` calls of `run`, each on a fresh model without cached data."""
    case.reference  # noqa: B018  computed here, outside the first timed call
    calls: list[Call] = []
    benchmark.group = case.name
    benchmark.pedantic(
        lambda model: calls.append(run(model)),
        setup=lambda: ((case.fresh(),), {}),
        rounds=repeats,
    )
    return calls


def obstacle(case: Case, peer: str) -> str:
    """Return why `peer` is not started on `case`, or nothing."""
    if "cold" not in peer:
        return ""
    arcs = arc_count(case)
    if isinstance(arcs, str):
        return f"not run: {arcs}"
    if arcs > HEAVY:
        return f"not run: {arcs:,} arcs, and each is {'a column' if 'highs' in peer else 'an edge'}"
    return ""


def runner(case: Case, peer: str, limit: float) -> Callable[[Any], Call]:
    """Return the function that lets `peer` solve a model."""
    best = case.reference
    if peer in NATIVE:
        return lambda model: solved(model, peer, time_limit=limit)
    if peer.startswith("highs"):
        start = {"warm_start": best.plan} if "warm" in peer else {}
        return lambda model: solved(
            model, "highs", formulation="arc-flow", time_limit=limit, **start
        )
    bound = best.primal_bound if "warm" in peer else None
    return lambda model: solved_by_cspy(model, bound, limit)


def solved(model: Any, backend: str, **options: Any) -> Call:
    """Return one call of a backend."""
    begin = time.perf_counter()
    solution = ct.solve(model, backend, isolate=False, **options)
    whole = time.perf_counter() - begin
    own = solution.seconds["build"] + solution.seconds["solve"]
    optimal = solution.termination == "optimal"
    outcome = str(solution.termination)
    if solution.limit is not None:
        gap = "no gap" if solution.gap is None else f"gap {solution.gap:.2%}"
        outcome += f" ({solution.limit} limit, {gap})"
    return Call(
        own,
        whole,
        solution.plan,
        solution.primal_bound,
        solution.dual_bound,
        optimal,
        work(solution.statistics),
        outcome,
    )


def work(statistics: Any) -> str:
    """Return what a backend counted."""
    parts = []
    if "stage1 labels" in statistics:
        parts.append(f"{statistics['stage1 labels']:,} +")
    if "labels made" in statistics:
        parts.append(f"{statistics['labels made']:,} labels")
    if "nodes" in statistics:
        nodes = statistics["nodes"]
        parts.append(f"{nodes:,} node{'' if nodes == 1 else 's'}")
    return " ".join(parts)


def solved_by_cspy(model: Any, bound: float | None, limit: float) -> Call:
    """Return one call of cspy; its route is verified as every other."""
    begin = time.perf_counter()
    found = cspy_peer.run(model, bound=bound, time_limit=limit)
    in_time = found.search < limit
    verified = None if found.plan is None else ct.verify(model, found.plan)
    whole = time.perf_counter() - begin
    optimal = in_time and found.simple
    outcome = "optimal" if optimal else "no simple route" if in_time else "time limit"
    return Call(
        found.build + found.search,
        whole,
        found.plan if found.simple else None,
        verified.objective if verified is not None and found.simple else None,
        None,
        optimal,
        f"{found.extensions:,} extensions",
        f"{outcome} (search {duration(found.search)} of it, {found.arcs:,} arcs)",
    )


def check(case: Case, calls: list[Call]) -> None:
    """Verify every plan, and check that proofs and bounds agree with the reference optimum."""
    best = case.reference
    assert best.termination == "optimal"
    assert best.verification is not None and best.verification.ok
    for call in calls:
        if call.plan is not None:
            found = ct.verify(case.model, call.plan)
            assert found.ok, found
            assert found.objective >= best.primal_bound * (1 - 1e-9)
        if call.optimal:
            assert call.length == pytest.approx(best.primal_bound, rel=1e-9)
        if call.bound is not None:
            assert call.bound <= best.primal_bound * (1 + 1e-6)


def enter(ledger: Ledger, case: Case, solver: str, calls: list[Call]) -> None:
    """Put the calls of one solver into the table."""
    own, whole = [call.own for call in calls], [call.whole for call in calls]
    last = calls[-1]
    ledger.rows.append(Row(case.name, solver, own, whole, last.work, last.outcome))
