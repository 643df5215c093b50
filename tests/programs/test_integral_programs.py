"""Quadratic and nonlinear programs with integral columns: enumeration, refusals, limits.

Solvers whose libraries exclude one another run in workers.
"""

from __future__ import annotations

import importlib.util
import itertools
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import UnsupportedFormulation, UnsupportedOption
from crosstrack.models.formulation import Formulation
from crosstrack.models.programs.linear import MixedIntegerProgram, QuadraticProgram
from crosstrack.models.programs.nonlinear import NonlinearProgram
from crosstrack.solvers.conformance import all_cases, cases_for
from crosstrack.solvers.conformance.linear import program as linear
from crosstrack.solvers.conformance.nonlinear_hard import nonlinear
from crosstrack.solvers.conformance.quadratic import quadratic
from crosstrack.solvers.contract.backend import Answer, Limit, Request, Termination
from crosstrack.solvers.contract.registry import accepted, declarations, find_backend
from crosstrack.solvers.contract.selection import fitting
from crosstrack.solvers.mip import scip

INF = np.inf
CASES = {name: case for name, case in all_cases().items() if name.startswith("integer ")}
QUADRATIC = ("scip", "cvxpy", "gurobi")


def needed(*modules: str) -> None:
    for module in modules:
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is not installed")


def run(name: str, program: Any, **request: Any) -> Answer:
    backend = find_backend(name)
    return backend.run(program, Request(options=backend.checked_options({}), **request))


def random_quadratic(seed: int) -> QuadraticProgram:
    """Return a program of at most 4 integral columns in [-3, 3], often with a semidefinite Hessian."""
    draw = np.random.default_rng(seed)
    size, rows = int(draw.integers(1, 5)), int(draw.integers(0, 3))
    root = draw.integers(-3, 4, (size, int(draw.integers(1, size + 1)))).astype(float)
    low = draw.integers(-6, 7, rows)
    program = quadratic(
        root @ root.T,
        draw.integers(-6, 7, size).astype(float).tolist(),
        draw.integers(-3, 4, (rows, size)),
        np.where(draw.random(rows) < 0.3, -INF, low),
        np.where(draw.random(rows) < 0.3, INF, low + draw.integers(0, 5, rows)),
        lower=-3,
        upper=3,
        offset=float(draw.integers(-5, 6)),
    )
    return replace(program, integral=np.ones(size, bool))


def random_nonlinear(seed: int) -> NonlinearProgram:
    """Return a convex program of 2 or 3 integral columns in [-3, 3] with exponentials and a disk."""
    import casadi

    draw = np.random.default_rng(seed)
    size = int(draw.integers(2, 4))
    centre, rate = draw.uniform(-2, 2, size), draw.uniform(0.2, 1.5, size)
    coefficients, radius = draw.integers(-2, 3, size).tolist(), float(draw.uniform(3, 9))

    def pose(x: Any) -> tuple[Any, list[Any]]:
        terms = [
            casadi.exp(rate[i] * x[i]) - 2 * centre[i] * x[i] + (x[i] - centre[i]) ** 2
            for i in range(size)
        ]
        rows = [sum(coefficients[i] * x[i] for i in range(size)), casadi.sumsqr(x)]
        return sum(terms), rows

    return nonlinear(
        pose, [0.3] * size, -INF, [2.0, radius], lower=-3, upper=3, integral=np.ones(size, bool)
    )


def enumerated(program: Any) -> float:
    """Return the least objective of the integer points within the bounds, infinite without a point."""
    ranges = zip(program.column_lower.tolist(), program.column_upper.tolist(), strict=True)
    sides = [range(int(np.ceil(low)), int(np.floor(high)) + 1) for low, high in ranges]
    points = np.array(list(itertools.product(*sides)), float).reshape(-1, program.size)
    if not len(points):
        return INF
    if isinstance(program, QuadraticProgram):
        curved = 0.5 * np.einsum("ki,ki->k", points @ program.hessian, points)
        values, rows = curved + points @ program.cost + program.offset, points @ program.matrix.T
    else:
        f, g = program.function.map(len(points))(points.T)
        values, rows = np.array(f).ravel(), np.array(g).T
    inside = (rows >= program.row_lower - 1e-9) & (rows <= program.row_upper + 1e-9)
    return float(values[inside.all(axis=1)].min(initial=INF))


def assert_proven(answer: Answer, program: QuadraticProgram) -> None:
    best = enumerated(program)
    if best == INF:
        assert answer.termination is Termination.INFEASIBLE
        return
    assert answer.termination is Termination.OPTIMAL
    assert answer.point is not None and answer.dual_bound is not None
    assert program.verify(answer.point).ok
    assert answer.primal_bound == pytest.approx(best, rel=1e-6, abs=1e-6)
    assert best - 2e-6 * max(1.0, abs(best)) <= answer.dual_bound <= best + 1e-9


# Answers.


@pytest.mark.parametrize("name", ["scip", "gurobi"])
def test_random_quadratic_programs_equal_enumeration(name: str) -> None:
    needed(*find_backend(name).requires)
    programs = [random_quadratic(seed) for seed in range(30)]
    assert 0 < sum(enumerated(program) == INF for program in programs) < 10
    for program in programs:
        assert_proven(run(name, program), program)


def test_random_nonlinear_programs_equal_enumeration() -> None:
    needed("casadi")
    for seed in range(10):
        program = random_nonlinear(seed)
        answer = run("bonmin", program)
        assert answer.termination is Termination.LOCALLY_OPTIMAL
        assert answer.dual_bound is None
        assert program.verify(answer.point).ok
        assert answer.primal_bound == pytest.approx(enumerated(program), rel=1e-6)


@pytest.mark.parametrize("name", CASES)
def test_the_cases_are_right(name: str) -> None:
    program, known = CASES[name].program, CASES[name].expectation
    assert isinstance(program, QuadraticProgram | NonlinearProgram)
    assert program.integral is not None
    if not program.integral.all() or known.termination == (Termination.UNBOUNDED,):
        return  # a continuous column, or no optimum
    finite = np.isfinite(program.column_lower) & np.isfinite(program.column_upper)
    low, high = (np.where(finite, b, r) for b, r in
                 ((program.column_lower, -30), (program.column_upper, 30)))  # fmt: skip
    best = enumerated(replace(program, column_lower=low, column_upper=high))
    expected = INF if known.objective is None else known.objective
    assert best == pytest.approx(expected, rel=1e-12)
    if known.point is not None:
        point = np.array(known.point, float)
        assert program.verify(point).objective == pytest.approx(best)


def test_a_nonconvex_hessian_is_searched_globally() -> None:
    needed("pyscipopt")
    program = replace(
        quadratic([[1, 2], [2, 1]], [0.5, 0.3], lower=-3, upper=3), integral=np.ones(2, bool)
    )
    assert scip._factor(program) is None
    assert_proven(run("scip", program), program)
    assert "cvxpy" not in fitting(program)
    needed("cvxpy")
    with pytest.raises(UnsupportedFormulation, match="must be convex"):
        ct.solve(program, "cvxpy")


# Refusals.


@pytest.mark.parametrize("kind", [QuadraticProgram, NonlinearProgram, MixedIntegerProgram])
def test_every_other_backend_refuses(kind: type[Any]) -> None:
    program: Any
    if kind is NonlinearProgram:
        needed("casadi")
        program = random_nonlinear(0)
    elif kind is QuadraticProgram:
        program = random_quadratic(3)
    else:
        program = linear([1, 1], [[2, 4]], 3, 7, upper=9, integral=[True, False])
    takers = {"quadratic-program": QUADRATIC, "nonlinear-program": ("bonmin",)}.get(program.kind)
    refused = 0
    for declared in declarations():
        backend = declared.load()
        if declared.problem or not isinstance(program, backend.accepts):
            continue
        if takers is None or backend.name in takers:
            assert accepted(program, backend, None) is program
            continue
        assert accepted(program, backend, None) is None
        assert not any(name in CASES for name in cases_for(backend))
        refused += 1
        if backend.missing():
            continue
        with pytest.raises(UnsupportedFormulation) as error:
            ct.solve(program, backend)
        count = int(program.integral.sum())
        for word in (backend.name, program.kind, f"{count} of its {program.size}", *takers):
            assert word in str(error.value)
        with pytest.raises(UnsupportedFormulation, match="must be integers"):
            backend.run(program, Request(options=backend.checked_options({})))
    assert refused == {"quadratic-program": 10, "nonlinear-program": 8}.get(program.kind, 0)
    assert set(fitting(program)) <= set(takers or fitting(program))


def test_without_a_solver_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    absent, present = ("pyscipopt", "gurobipy"), importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name in absent else present(name)
    )
    program, words = random_quadratic(3), r"'scip' \(pip install 'crosstrack\[scip\]'\)"
    with pytest.raises(UnsupportedFormulation, match=f"no installed backend.*{words}"):
        ct.solve(program)
    if find_backend("clarabel").missing() == ():
        with pytest.raises(UnsupportedFormulation, match=words):
            run("clarabel", program)
    assert "crosstrack[scip]" in find_backend("cvxpy").refuses(program)


@pytest.mark.parametrize("name", ["scip", "gurobi"])
def test_continuous_programs_are_left_to_others(name: str) -> None:
    needed(*find_backend(name).requires)
    program = replace(random_quadratic(3), integral=None)
    assert name not in fitting(program)
    with pytest.raises(UnsupportedFormulation, match="only if a column is integral"):
        ct.solve(program, name)


class _Squares(Formulation[Any, Any]):
    name = "squares"
    program_type = QuadraticProgram

    def build(self) -> QuadraticProgram:
        return random_quadratic(3)

    def encode(self, plan: Any) -> Any:
        return plan

    def decode(self, point: Any) -> Any:
        return point


class _Posed(MixedIntegerProgram):
    kind: ClassVar[str] = "test-posed"
    formulations: ClassVar[dict[str, Any]] = {"squares": _Squares}


def test_a_formulation_with_integral_columns_is_refused() -> None:
    needed("clarabel")
    given = linear([1] * 4, np.zeros((0, 4)), lower=-3, upper=3, integral=True)
    posed = _Posed(**{**given.shared(), "integral": given.integral})
    with pytest.raises(UnsupportedFormulation, match="4 of its 4 columns must be integers"):
        ct.solve(posed, "clarabel", formulation="squares", isolate=False)


# Runs.


def test_auto_selects_an_exact_solver() -> None:
    needed("pyscipopt")
    answer = ct.solve(random_quadratic(3))
    assert answer.backend == "scip"
    assert answer.termination == "optimal"
    assert answer.dual_bound == pytest.approx(enumerated(random_quadratic(3)))


def test_a_cvxpy_problem_round_trip() -> None:
    needed("cvxpy", "pyscipopt")
    import cvxpy as cp

    draw = np.random.default_rng(0)
    matrix, target = draw.normal(size=(6, 3)), 3 * draw.normal(size=6)
    x, switch = cp.Variable(3, integer=True, name="x"), cp.Variable(boolean=True, name="on")
    level = cp.Variable(name="level")
    objective = cp.sum_squares(matrix @ x - target) + (level - x[0]) ** 2 + 2 * switch
    rows = [cp.sum(x) <= 3, x >= -3, x <= 3, level <= 0.5 + 3 * switch]
    problem = cp.Problem(cp.Maximize(-objective), rows)
    best = min(
        float(
            np.sum((matrix @ point - target) ** 2) + max(point[0] - 0.5 - 3 * on, 0) ** 2 + 2 * on
        )
        for point in map(np.array, itertools.product(range(-3, 4), repeat=3))
        if point.sum() <= 3
        for on in (0, 1)
    )
    answer = ct.solve(problem)
    assert answer.termination == "optimal"
    assert answer.value == pytest.approx(-best, rel=1e-6)
    assert answer.bound == pytest.approx(-best, rel=1e-5)
    answer.assign()
    assert problem.objective.value == pytest.approx(-best, rel=1e-6)
    assert np.abs(x.value - np.round(x.value)).max() < 1e-9
    assert all(row.violation().max() <= 1e-6 for row in rows)


def test_cvxpy_solves_with_scip() -> None:
    needed("cvxpy", "pyscipopt")
    for seed in range(3):
        assert_proven(run("cvxpy", random_quadratic(seed)), random_quadratic(seed))
    backend, request = find_backend("cvxpy"), Request(options={"solver": "HIGHS"})
    with pytest.raises(UnsupportedOption, match="accepts no integer quadratic program"):
        backend.run(random_quadratic(3), request)


def hard(size: int = 30) -> QuadraticProgram:
    draw = np.random.default_rng(1)
    root, target = draw.normal(size=(size + 5, size)), 9 * draw.normal(size=size + 5)
    program = quadratic(root.T @ root, (-root.T @ target).tolist(), lower=-9, upper=9)
    return replace(program, integral=np.ones(size, bool))


def test_limits_and_warm_start() -> None:
    needed("pyscipopt")
    program = hard()
    start = np.round(np.linalg.solve(program.hessian.toarray(), -program.cost)).clip(-9, 9)
    answer = ct.solve(program, "scip", time_limit=1.0, warm_start=start)
    assert answer.termination == "feasible"
    assert answer.limit is Limit.TIME
    assert answer.seconds["total"] < 10.0
    assert answer.primal_bound is not None and answer.dual_bound is not None
    assert answer.dual_bound < answer.primal_bound <= program.objective(start)
    at_start = run(
        "scip", program, warm_start=start, cutoff=program.objective(start), time_limit=0.3
    )
    assert at_start.primal_bound <= program.objective(start) + 1e-6


def test_the_start_of_a_nonlinear_program_is_kept() -> None:
    needed("casadi")
    program = random_nonlinear(1)
    answer = run("bonmin", program, warm_start=np.zeros(program.size), time_limit=1e-9)
    assert answer.termination in (Termination.NO_SOLUTION, Termination.FEASIBLE)
    assert answer.limit is Limit.TIME
    later = run("bonmin", program, warm_start=np.zeros(program.size))
    assert later.primal_bound == pytest.approx(enumerated(program), rel=1e-6)
