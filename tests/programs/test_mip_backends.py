"""Every mixed-integer backend on every conformance case, in one process per group of backends.

The solvers' libraries exclude one another (highspy and ortools), so nothing is solved in the
process of the tests: this file is also the script that the other processes run. A backend that is
expected and cannot run fails; only gurobi may be skipped, with the reason.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from runs import answer_with, elsewhere, included, loaded_by_describing, python, unforeseen

from crosstrack.errors import UnsupportedFormulation
from crosstrack.models.programs.linear import MixedIntegerProgram
from crosstrack.solvers.conformance import CaseResult, Matrix, Status, cases_for, run_case
from crosstrack.solvers.conformance.linear import program
from crosstrack.solvers.contract.backend import (
    Answer,
    Backend,
    Feature,
    Limit,
    Request,
    Termination,
)
from crosstrack.solvers.contract.registry import find_backend

EXPECTED = ("highs", "scipy", "scip", "ortools", "cp-sat", "cvxpy")
OPTIONAL = ("gurobi",)
BACKENDS = (*EXPECTED, *OPTIONAL)
#: Backends whose libraries can be loaded in one process.
GROUPS = (("highs", "scipy"), ("ortools", "cp-sat"), ("scip", "gurobi"), ("cvxpy",))
RANDOM = 60
#: Each so many cases by SCIP through CVXPY, and random programs.
FEW = 4

#: The cases that a backend does not take although it declares their features, and why.
UNSUPPORTED = {
    "scipy": {"mixed: tight tolerance": "tolerance must be at least"},
    "cp-sat": {
        "linear: ": "is continuous",
        "mixed: ": "is continuous",
        "integer: general columns, infinite bounds": "needs bounds",
        "integer: unbounded": "needs bounds",
        "cutoff: linear program": "is continuous",
    },
}


@functools.cache
def _answers(every: int, *names: str) -> dict[str, Any]:
    found: dict[str, Any] = elsewhere(__file__, str(every), *names)
    return found


def answers(name: str, every: int = FEW) -> dict[str, Any]:
    """Return what `name` makes of the suite and of random programs, in one process per group."""
    group = next(group for group in GROUPS if name in group)
    found: dict[str, Any] = _answers(every, *group)[name]
    return found


def results(name: str, which: str = "conformance", every: int = FEW) -> tuple[CaseResult, ...]:
    return tuple(CaseResult.from_dict(data) for data in answers(name, every)[which])


def installed(name: str) -> None:
    missing = find_backend(name).missing()
    if missing and name in OPTIONAL:
        pytest.skip(f"{name} needs {', '.join(missing)}")
    assert not missing, f"{name} is expected here, but {', '.join(missing)} is not installed"


parts = pytest.mark.parametrize("every", [FEW, pytest.param(1, marks=pytest.mark.slow)])


def test_every_included_solver_runs_the_cases() -> None:
    assert included("mip") <= set(BACKENDS)


@pytest.mark.parametrize("name", BACKENDS)
def test_conformance(name: str) -> None:
    installed(name)
    found = results(name)
    refused = [r for r in found if "BackendBroken" in r.reason and "licence" in r.reason]
    if name in OPTIONAL and refused:
        pytest.skip(refused[0].reason)
    matrix = Matrix.of(found)
    assert not matrix.failures, f"\n{matrix}"
    cases = cases_for(find_backend(name))
    assert {r.case for r in found} == {one for one in cases if not one.startswith("quadratic")}
    assert not unforeseen(found, UNSUPPORTED.get(name, {}))
    assert sum(r.status is Status.PASS for r in found) >= 30


@parts
def test_cvxpy_reaches_scip(every: int) -> None:
    installed("cvxpy")
    matrix = Matrix.of(results("cvxpy", "scip", every))
    # CVXPY's duals from SCIP are unreliable, so none are returned; it also has no callbacks.
    known = ("declares duals, returned none", "reported no incumbents")
    failures = [r for r in matrix.failures if r.reason not in known]
    assert not failures, f"\n{matrix}"


@parts
@pytest.mark.parametrize("name", BACKENDS[1:])
def test_agrees_with_highs_on_random_programs(name: str, every: int) -> None:
    installed(name)
    if name in OPTIONAL and "random" not in answers(name, every):
        pytest.skip(f"{name} has no valid licence here")
    mine, others = (answers(one, every)["random"] for one in ("highs", name))
    count = RANDOM // every
    assert len(others) >= (count // 10 if name == "cp-sat" else count)
    for seed, (termination, primal, dual, ok) in others.items():
        assert ok, f"program {seed}: the point fails verification"
        assert termination == mine[seed][0], f"program {seed}"
        if termination == Termination.OPTIMAL:
            assert primal == pytest.approx(mine[seed][1], rel=1e-5, abs=1e-5), f"program {seed}"
            assert dual == pytest.approx(primal, rel=1e-5, abs=1e-5), f"program {seed}"


def test_a_false_claim_is_detected() -> None:
    assert answers("highs")["liars"] == dict.fromkeys(LIES, "fail")


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("import highspy", "from ortools.math_opt.python import mathopt"),
        ("from ortools.math_opt.python import mathopt", "import highspy"),
        pytest.param(
            "import cvxpy", "from ortools.sat.python import cp_model", marks=pytest.mark.slow
        ),
    ],
)
def test_the_conflict_group_is_still_real(first: str, second: str) -> None:
    """The day this fails, the libraries get along and the conflict group can go."""
    done = python(f"{first}\n{second}")
    assert done.returncode != 0
    assert "undefined symbol" in done.stderr


def test_describing_backends_loads_no_solver() -> None:
    solvers = {"highspy", "ortools", "pyscipopt", "cvxpy", "gurobipy", "scipy.optimize"}
    assert not solvers & loaded_by_describing()


def test_gurobi_names_the_size_limit() -> None:
    installed("gurobi")
    message = answers("gurobi")["too large"]
    if message is None:
        pytest.skip("gurobi has a licence without the size limit")
    assert message.startswith("BackendBroken")
    assert "1 rows and 2100 columns" in message
    assert "'highs'" in message


def test_cp_sat_names_what_it_does_not_support() -> None:
    installed("cp-sat")
    backend = find_backend("cp-sat")

    def refusal(asked: MixedIntegerProgram) -> str:
        with pytest.raises(UnsupportedFormulation) as caught:
            backend.run(asked, Request())
        return str(caught.value)

    mixed = program([1, 1], [[1, 1]], upper=3, integral=[True, False])
    assert "column 1 is continuous" in refusal(mixed)
    endless = program([1, 1], [[1, 1]], upper=[3, np.inf], integral=True)
    assert "column 1 lies in [0, inf]" in refusal(endless)
    ragged = program([1, 1], [[1 / 3, 1e9 + 1 / 7]], upper=3, integral=True)
    assert "those of row do not" in refusal(ragged)


# The following cases run in the other processes.

#: Changes of a dishonest or careless backend to a correct answer, and the case that detects each.
LIES: dict[str, tuple[str, Callable[[MixedIntegerProgram, Request, Answer], Answer]]] = {
    "a bound above the optimum": (
        "integer: knapsack",
        lambda p, r, a: replace(a, dual_bound=-14.0),
    ),
    "no bound": ("integer: knapsack", lambda p, r, a: replace(a, dual_bound=None)),
    "another objective": ("integer: knapsack", lambda p, r, a: replace(a, primal_bound=-16.0)),
    "a point that breaks a row": (
        "integer: knapsack",
        lambda p, r, a: replace(a, point=np.ones(5), primal_bound=-19.0, dual_bound=-19.0),
    ),
    "a point that is worse": (
        "integer: knapsack",
        lambda p, r, a: replace(a, point=np.zeros(5), primal_bound=0.0),
    ),
    "duals of the wrong sign": (
        "linear: lower rows bind",
        lambda p, r, a: replace(a, duals=-np.asarray(a.duals)),
    ),
    "no duals": ("linear: lower rows bind", lambda p, r, a: replace(a, duals=None)),
    "infeasible for a cutoff": (
        "cutoff: nothing below",
        lambda p, r, a: Answer(Termination.INFEASIBLE),
    ),
    "unbounded for infeasible": (
        "mixed: infeasible, its relaxation unbounded",
        lambda p, r, a: Answer(Termination.UNBOUNDED),
    ),
    "a half-open switch": (
        "mixed: a switch below the tolerance",
        lambda p, r, a: replace(a, point=np.array([5e-7, 0.5]), primal_bound=5e-7, dual_bound=5e-7),
    ),
    "a limit called optimal": (
        "limit: time",
        lambda p, r, a: replace(a, termination=Termination.OPTIMAL, limit=None),
    ),
    "the wrong limit": (
        "stop: while it runs",
        lambda p, r, a: replace(a, limit=Limit.TIME),
    ),
    "a start thrown away": (
        "warm start: kept",
        lambda p, r, a: replace(a, point=np.zeros(p.size), primal_bound=0.0),
    ),
    "the seed ignored": (
        "integer: same seed, same answer",
        lambda p, r, a: replace(a, statistics={"draw": float(np.random.default_rng().random())}),
    ),
    "a seed that decides nothing": (
        "integer: another seed, another search",
        lambda p, r, a: replace(a, statistics={}),
    ),
    "incumbents that get worse": (
        "incumbents: each better and feasible",
        lambda p, r, a: [r.control.incumbent(0.0, np.zeros(p.size)), a][1],  # type: ignore[return-value]
    ),
}


def liar(lie: Callable[[MixedIntegerProgram, Request, Answer], Answer]) -> Backend:
    honest = type(find_backend("highs"))
    answers: list[Answer] = []

    class Liar(honest):  # type: ignore[misc, valid-type]
        def run(self, problem: MixedIntegerProgram, request: Request) -> Answer:
            if not answers:  # all runs of these cases have the same optimum
                answers.append(super().run(problem, request))
            return lie(problem, request, answers[0])

    return Liar()


def random_programs(count: int) -> Iterator[MixedIntegerProgram]:
    """Yield small programs of every kind; ranges, equalities, infinite bounds, decimals."""
    for seed in range(count):
        draw = np.random.default_rng(seed)
        size, rows = int(draw.integers(1, 7)), int(draw.integers(0, 6))
        matrix = draw.integers(-5, 6, (rows, size)) * (draw.random((rows, size)) < 0.7)
        activity = matrix @ draw.integers(-3, 4, size)
        low = np.where(draw.random(rows) < 0.5, activity - draw.integers(0, 4, rows), -np.inf)
        high = np.where(draw.random(rows) < 0.5, activity + draw.integers(0, 4, rows), np.inf)
        if rows and draw.random() < 0.25:
            low[0] = high[0] = activity[0] + draw.integers(0, 2)
        lower = np.where(draw.random(size) < 0.75, -draw.integers(3, 9, size), -np.inf)
        upper = np.where(draw.random(size) < 0.75, draw.integers(3, 9, size), np.inf)
        kind = draw.random()
        integral = draw.random(size) < (0.0 if kind < 0.3 else 1.0 if kind < 0.6 else 0.5)
        if integral.all() and draw.random() < 0.6:
            lower, upper = np.maximum(lower, -9), np.minimum(upper, 9)
        scale = 10.0 if draw.random() < 0.3 else 1.0
        yield program(
            draw.integers(-6, 7, size).astype(float).tolist(),
            matrix / scale,
            low / scale,
            high / scale,
            lower=lower,
            upper=upper,
            integral=integral,
            offset=float(draw.integers(-20, 20)),
        )


def _random(name: str, count: int) -> dict[str, list[Any]]:
    backend = find_backend(name)
    options = backend.checked_options({})
    found = {}
    for seed, asked in enumerate(random_programs(count)):
        try:
            answer = backend.run(asked, Request(time_limit=30.0, options=options))
        except UnsupportedFormulation:
            continue
        ok = answer.point is None or asked.verify(answer.point).ok
        bound = answer.dual_bound
        if answer.duals is not None and Feature.DUALS in backend.features:
            bound = asked.dual_bound(answer.duals)
        found[str(seed)] = [answer.termination.value, answer.primal_bound, bound, ok]
    return found


def _too_large() -> str | None:
    big = program(np.ones(2100).tolist(), np.ones((1, 2100)), 1.0)
    try:
        find_backend("gurobi").run(big, Request())
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return None


def main(every: str, *names: str) -> Any:
    return {name: _results(name, int(every)) for name in names if not find_backend(name).missing()}


def _results(name: str, every: int) -> dict[str, Any]:
    backend = find_backend(name)
    found: dict[str, Any] = {"conformance": _suite(backend, {})}
    if not any("licence" in one["reason"] for one in found["conformance"]):
        found["random"] = _random(name, RANDOM // every)
    if name == "cvxpy":
        found["scip"] = _suite(backend, {"solver": "SCIP"}, every)
    if name == "highs":
        lies = LIES.items()
        found["liars"] = {lie: run_case(liar(how), case).status for lie, (case, how) in lies}
    if name == "gurobi":
        found["too large"] = _too_large()
    return found


def _suite(backend: Backend, options: dict[str, Any], every: int = 1) -> list[dict[str, Any]]:
    cases = [case for case in cases_for(backend) if not case.startswith("quadratic")]
    return [run_case(backend, case, options).to_dict() for case in cases[::every]]


if __name__ == "__main__":
    answer_with(main)
