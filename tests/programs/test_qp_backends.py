"""Every quadratic backend on every conformance case, and against brute force.

What may clash (highspy, CVXPY, CasADi, qpsolvers) runs in processes of its own, for which this file is
also the script; the other solvers run here, so that Hypothesis can shrink what it finds.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import HealthCheck, given, settings
from quadratics import CASES, HERE, INF, asked, mine, programs
from runs import answer_with, elsewhere, included, loaded_by_describing, python, unforeseen

from crosstrack.errors import (
    BackendBroken,
    UnsupportedFormulation,
    UnsupportedOption,
)
from crosstrack.models.programs.linear import QuadraticProgram
from crosstrack.solvers.conformance import (
    CaseResult,
    Matrix,
    Status,
    all_cases,
    cases_for,
    run_case,
)
from crosstrack.solvers.conformance.quadratic import quadratic
from crosstrack.solvers.contract.backend import Limit, Request, Termination
from crosstrack.solvers.contract.registry import find_backend

#: Plugins of CasADi's wheel that load, beside qrqp.
PLUGINS = ("qpoases", "daqp", "highs", "osqp", "proxqp", "piqp", "hpipm")
#: What each backend is run with, in one process for all choices of one.
CHOICES = {
    "casadi": ("", *PLUGINS),
    "cvxpy": ("", "OSQP", "HIGHS", "SCS", "PIQP", "DAQP", "ECOS"),
    "qpsolvers": ("", "daqp", "ecos", "highs", "osqp", "piqp", "proxqp", "quadprog", "scs"),
}
BACKENDS = (*HERE, "highs", *CHOICES)
#: Each so many cases run with an option that is not the default.
FEW = 10
RUNS = [(name, choice) for name in BACKENDS for choice in CHOICES.get(name, ("",))]

DEFINITE = "not positive definite"
#: Cases that a backend with the named option does not support, with part of its message.
UNSUPPORTED = {
    "quadprog": "needs a positive definite Hessian",
    "cvxpy SCS": "needs a row or a bound",
    "qpsolvers quadprog": DEFINITE,
    "qpsolvers ecos": DEFINITE,
}
#: Case in which an option fails, with part of the message.
KNOWN = {
    "casadi proxqp": ("quadratic: linear program", "which nothing proves"),
    # They know no time limit: through the dispatcher they are stopped with their process.
    **dict.fromkeys(
        ("cvxpy PIQP", "cvxpy ECOS", "qpsolvers piqp", "qpsolvers ecos"),
        ("quadratic, limit: time", "took"),
    ),
}


@functools.cache
def results(name: str, every: int = 1) -> dict[str, Any]:
    """Return the answers of one process per backend: all its tasks, so that libraries load once."""
    return dict(
        main("all", name, every) if name in HERE else elsewhere(__file__, "all", name, str(every))
    )


def conformance_cases(name: str, choice: str, every: int) -> list[str]:
    """Return the cases of a run: all of a backend, and each so many of its options."""
    names = [case for case in cases_for(find_backend(name)) if case in CASES]
    return names[len(choice) % every :: every] if choice else names


def test_every_included_solver_runs_the_cases() -> None:
    assert included("qp") <= set(BACKENDS)


@pytest.mark.parametrize("every", [FEW, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("name", "choice"), RUNS, ids=lambda value: str(value))
def test_conformance(name: str, choice: str, every: int) -> None:
    which = f"{name} {choice}".strip()
    found = [CaseResult.from_dict(one) for one in results(name, every)["conformance"][choice]]
    case, words = KNOWN.get(which, ("", ""))
    failures = [
        f"{r.case}: {r.reason}"
        for r in Matrix.of(found).failures
        if not (case and r.case.startswith(case) and words in r.reason)
    ]
    assert not failures, "\n".join(failures)
    assert [r.case for r in found] == conformance_cases(name, choice, every)
    allowed = {"": UNSUPPORTED[which]} if which in UNSUPPORTED else {}
    assert not unforeseen(found, allowed)
    passed = sum(r.status is Status.PASS for r in found)
    least = 28 if DEFINITE in UNSUPPORTED.get(which, "") or name == "quadprog" else 38
    assert passed >= (least // every - 1 if choice else least)


@pytest.mark.parametrize("name", [n for n in CASES if CASES[n].expectation.point is not None])
def test_the_cases_are_right(name: str) -> None:
    case = CASES[name]
    assert isinstance(case.program, QuadraticProgram)
    point = np.array(case.expectation.point, float)
    found = case.program.verify(point, tolerance=1e-9)
    assert found.ok
    assert found.objective == pytest.approx(case.expectation.objective, abs=1e-9)
    if case.expectation.duals is not None:
        duals = np.array(case.expectation.duals, float)
        assert case.program.dual_bound(duals, point) == pytest.approx(found.objective, abs=1e-9)


# Brute force: some set of rows and bounds binds at an optimum, so that all sets are tried.


def brute_force(program: QuadraticProgram) -> float | None:
    """Return the optimum of a small strictly convex program, None if it is infeasible."""
    hessian, size = program.hessian.toarray(), program.size
    rows = np.vstack([program.matrix.toarray(), np.eye(size)])
    low = np.concatenate([program.row_lower, program.column_lower])
    high = np.concatenate([program.row_upper, program.column_upper])
    sides = [
        [(at, value) for value in dict.fromkeys((low[at], high[at])) if np.isfinite(value)]
        for at in range(len(rows))
    ]
    best = None
    for count in range(size + 1):
        for chosen in itertools.combinations([s for s in sides if s], count):
            for ends in itertools.product(*chosen):
                active = rows[[at for at, _ in ends]]
                right = np.array([value for _, value in ends])
                system = np.block([[hessian, -active.T], [active, np.zeros((count, count))]])
                point = np.linalg.lstsq(system, np.concatenate([-program.cost, right]))[0][:size]
                value = rows @ point
                if (value >= low - 1e-9).all() and (value <= high + 1e-9).all():
                    objective = program.objective(point)
                    best = objective if best is None else min(best, objective)
    return best


@settings(max_examples=15, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(programs())
def test_all_agree_with_brute_force(program: QuadraticProgram) -> None:
    optimum = brute_force(program)
    for name in HERE:
        answer = asked(name, program)
        if optimum is None:
            assert answer.termination is Termination.INFEASIBLE, (name, answer)
            continue
        assert answer.termination is Termination.OPTIMAL, (name, answer)
        assert answer.primal_bound == pytest.approx(optimum, rel=1e-7, abs=1e-7), name
        assert answer.dual_bound == pytest.approx(optimum, rel=1e-7, abs=1e-7), name
        assert program.verify(answer.point).ok, name


def test_highs_solves_programs_on_which_it_failed() -> None:
    """Without rows it forgot the Hessian; on flat objectives it cycled, or called them unbounded."""
    found = results("highs", FEW)["flat"]
    assert len(found) == FLAT
    for seed, (mine_, others) in found.items():
        assert mine_[0] == others[0], seed
        if others[1] is not None:
            assert mine_[1] == pytest.approx(others[1], rel=1e-6, abs=1e-6), seed


def test_the_export_to_cvxpy_is_the_same_program() -> None:
    found = results("cvxpy", FEW)["export"]
    assert len(found) > 10
    for name, value in found.items():
        optimum = CASES[name].expectation.objective
        assert value == pytest.approx(optimum, rel=1e-4, abs=1e-4), name


# Options and refusals.


@pytest.mark.parametrize("name", BACKENDS)
def test_options_are_checked(name: str) -> None:
    backend = find_backend(name)
    with pytest.raises(UnsupportedOption, match="has no option 'nonsense'"):
        backend.checked_options({"nonsense": 1})
    for option, wrong in {"polish": 1, "max_iter": 0, "plugin": "none"}.items():
        if option in backend.options:
            with pytest.raises(UnsupportedOption, match=option):
                backend.checked_options({option: wrong})
    assert backend.checked_options({})


def test_options_reach_the_solver() -> None:
    program = CASES["quadratic: portfolio, 200 columns"].program
    for name, option in (("clarabel", "max_iter"), ("piqp", "max_iter"), ("osqp", "max_iter")):
        answer = asked(name, program, options={option: 1, "polish": False})
        assert answer.limit is Limit.ITERATIONS, name
    assert asked("piqp", program, options={"linear_algebra": "sparse"}).statistics["factors"] == (
        "sparse"
    )


def test_quadprog_names_the_eigenvalues_it_does_not_support() -> None:
    backend = mine("quadprog")
    flat = CASES["quadratic: no rows, one column linear"].program
    assert "1 of 2 columns have none, column 1 first" in backend.refuses(flat)
    singular = CASES["quadratic: many optimal points"].program
    assert not backend.refuses(singular)
    with pytest.raises(UnsupportedFormulation, match=r"eigenvalues range from .* to 2"):
        backend.run(singular, Request())


@pytest.mark.parametrize("name", ["daqp", "quadprog"])
def test_dense_backends_refuse_programs_that_are_too_large(name: str) -> None:
    size = 20_000
    large = QuadraticProgram(
        hessian=sp.eye_array(size, format="csr"),
        cost=np.zeros(size),
        matrix=sp.csr_array((0, size)),
        row_lower=np.zeros(0),
        row_upper=np.zeros(0),
        column_lower=np.full(size, -1.0),
        column_upper=np.full(size, 1.0),
    )
    backend = mine(name)
    assert "is dense" in backend.refuses(large)
    assert "20000 columns" in backend.refuses(large)
    with pytest.raises(UnsupportedFormulation, match="GB"):
        backend.run(large, Request())
    assert asked("osqp", large).termination is Termination.OPTIMAL


def test_options_depend_on_the_program_type() -> None:
    program = CASES["quadratic: rows from below"].program
    linear = next(c.program for n, c in all_cases().items() if n == "linear: lower rows bind")
    highs, cvxpy = find_backend("highs"), find_backend("cvxpy")
    with pytest.raises(UnsupportedOption, match="mip_heuristic_effort is for mixed-integer"):
        highs.run(program, Request(options={"mip_heuristic_effort": 0.5}))
    with pytest.raises(UnsupportedOption, match="'SCIP' accepts no quadratic program"):
        cvxpy.run(program, Request(options={"solver": "SCIP"}))
    with pytest.raises(UnsupportedOption, match="'CLARABEL' accepts no mixed-integer program"):
        cvxpy.run(linear, Request(options={"solver": "CLARABEL"}))


@pytest.mark.parametrize(
    "names", ["clarabel", pytest.param(" ".join((*PLUGINS, "clarabel")), marks=pytest.mark.slow)]
)
def test_casadi_names_a_plugin_that_does_not_load(names: str) -> None:
    found, absences = elsewhere(__file__, "plugins", names)
    assert set(found) == {"qrqp", "qpoases", *names.split()}
    assert not found["qrqp"]
    assert not found["qpoases"]
    for name, why in found.items():
        assert not why or f"plugin {name!r} does not load" in why
    absent = [name for name, why in found.items() if why]
    for name in absent:
        assert absences[name].startswith(BackendBroken.__name__)
    # The day this fails, the wheel has become complete, and the list of those that run can grow.
    assert absent == ["clarabel"]


@pytest.mark.parametrize(("name", "quadratic"), [("qpsolvers", "osqp"), ("cvxpy", "OSQP")])
def test_an_unavailable_solver_is_refused_with_the_available_ones(
    name: str, quadratic: str
) -> None:
    found = results(name, FEW)["found"]
    assert quadratic in found["quadratic"]
    for solver, words in found["refused"].items():
        assert f"solver={solver!r}" in words
        assert quadratic in words
    gurobi = next(words for solver, words in found["refused"].items() if solver.lower() == "gurobi")
    assert "licence" in gurobi


def test_describing_backends_loads_no_solver() -> None:
    solvers = {"highspy", "cvxpy", "casadi", "clarabel", "piqp", "proxsuite", "daqp", "quadprog"}
    assert not (solvers | {"osqp", "scs", "qpsolvers", "scipy.optimize"}) & loaded_by_describing()


def test_casadi_and_highspy_still_clash() -> None:
    """The day this fails, the libraries get along, and CasADi's HiGHS may leave the group."""
    done = python("import casadi; casadi.load_conic('highs'); import highspy")
    assert done.returncode != 0
    assert "undefined symbol" in done.stderr


# The following cases run in the other processes.

#: How many programs without rows, and with few, have a singular Hessian.
FLAT = 30


def flat_programs() -> Iterator[QuadraticProgram]:
    """Yield programs whose Hessian is singular."""
    for seed in range(FLAT):
        draw = np.random.default_rng(seed)
        size, rows = int(draw.integers(2, 8)), int(draw.integers(0, 3)) * (seed % 2)
        root = draw.integers(-3, 4, (size, size - 1))
        matrix = draw.integers(-4, 5, (rows, size))
        activity = matrix @ draw.integers(-3, 4, size)
        yield quadratic(
            root @ root.T,
            draw.integers(-4, 5, size).astype(float).tolist(),
            matrix,
            activity - draw.integers(0, 3, rows),
            activity + draw.integers(0, 3, rows),
            lower=np.where(draw.random(size) < 0.7, -draw.integers(0, 6, size), -INF),
            upper=np.where(draw.random(size) < 0.7, draw.integers(0, 6, size), INF),
        )


def main(task: str, name: str = "", every: str | int = 1) -> Any:
    found: Any
    if task == "all":
        tasks = {"highs": ["flat"], "cvxpy": ["found", "export"], "qpsolvers": ["found"]}
        return {part: main(part, name, every) for part in ("conformance", *tasks.get(name, ()))}
    if task == "conformance":
        backend, option = find_backend(name), "plugin" if name == "casadi" else "solver"
        return {
            choice: [
                run_case(backend, case, {option: choice} if choice else {}).to_dict()
                for case in conformance_cases(name, choice, int(every))
            ]
            for choice in CHOICES.get(name, ("",))
        }
    if task == "plugins":
        from crosstrack.solvers.qp import casadi

        for plugin in set(casadi._PLUGINS) - {"qrqp", "qpoases", *name.split()}:
            del casadi._PLUGINS[plugin]  # a process each
        found = casadi.plugins()
        return found, {plugin: main("absent", plugin) for plugin, why in found.items() if why}
    if task == "found":
        backend, program = find_backend(name), CASES["quadratic: box"].program
        found = backend.found()  # type: ignore[attr-defined]
        refused = {}
        for solver in ("NONE", "gurobi" if name == "qpsolvers" else "GUROBI"):
            try:
                backend.run(program, Request(options={"solver": solver}))
            except UnsupportedOption as error:
                refused[solver] = str(error)
        return {"quadratic": found["quadratic"] if name == "cvxpy" else found, "refused": refused}
    if task == "flat":
        from crosstrack.solvers.qp.clarabel import Clarabel

        def ended(backend: Any, program: QuadraticProgram) -> list[Any]:
            answer = backend.run(program, Request(time_limit=20.0))
            return [answer.termination.value, answer.primal_bound]

        return {
            seed: [ended(find_backend("highs"), program), ended(Clarabel(), program)]
            for seed, program in enumerate(flat_programs())
        }
    if task == "absent":
        backend = find_backend("casadi")
        try:
            backend.run(
                CASES["quadratic: box"].program,
                Request(options=backend.checked_options({"plugin": name})),
            )
        except BackendBroken as error:
            return f"{type(error).__name__}: {error}"
        return ""
    assert task == "export"
    found = {}
    for case in CASES.values():
        value = case.expectation.objective
        if case.arguments or value is None or not case.program.size:
            continue
        problem, _ = case.program.to_cvxpy()
        problem.solve(solver="CLARABEL")
        found[case.name] = float(problem.value)
    return found


if __name__ == "__main__":
    answer_with(main)
