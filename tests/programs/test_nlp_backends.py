"""Every nonlinear backend on every conformance case, and what they share.

Each backend runs the cases in a process of its own, for which this file is also the script; those that
neither clash with others nor crash also run here.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

import crosstrack as ct
from crosstrack.errors import BackendBroken, UnsupportedFormulation, UnsupportedOption
from crosstrack.models.programs.blocks import Block
from crosstrack.models.programs.nonlinear import NonlinearProgram
from crosstrack.solvers.attempts import Clock, Ended
from crosstrack.solvers.backend import Control, Feature, Limit, Request, Termination
from crosstrack.solvers.casadi_plugins import muted
from crosstrack.solvers.conformance import (
    CaseResult,
    Matrix,
    Status,
    all_cases,
    cases_for,
    run_case,
)
from crosstrack.solvers.conformance.nonlinear_posing import nonlinear
from crosstrack.solvers.nlp.base import NonlinearBackend, NonlinearOutcome
from crosstrack.solvers.nlp.casadi_nlp import CasadiNlp
from crosstrack.solvers.nlp.quality import estimated_duals, explained_duals, worst_blocks
from crosstrack.solvers.nlp.scaled import Scaled
from crosstrack.solvers.registry import find_backend

INF = np.inf
#: Those that stop when told to and clash with nothing.
HERE = ("ipopt", "uno", "sqpmethod", "slsqp", "trust-constr")
BACKENDS = (*HERE, "fatrop", "sleqp", "blocksqp", "bonmin")

CASES = {name: case for name, case in all_cases().items() if name.startswith("nonlinear")}

#: What each backend is run with beside its defaults, in one process for all choices of one.
CHOICES: dict[str, tuple[dict[str, Any], ...]] = {
    "ipopt": ({}, {"mu_strategy": "monotone"}, {"hessian": "limited-memory"}),
    "uno": ({}, {"preset": "funnelsqp"}, {"preset": "ipopt"}),
    "sqpmethod": ({}, {"qp": "qpoases"}, {"qp": "daqp"}, {"qp": "osqp"}),
    "trust-constr": ({"max_iter": 150},),
    "slsqp": ({"max_iter": 100},),
}
#: Where a solver gives up, honestly: rows that depend on one another leave some without a step.
TWICE = "nonlinear: an equation twice"
KNOWN = {
    "ipopt hessian=limited-memory": TWICE,
    "uno preset=ipopt": TWICE,
    "sqpmethod": TWICE,
    "sqpmethod qp=daqp": TWICE,
    "sqpmethod qp=osqp": TWICE,
    "slsqp max_iter=100": TWICE,
    "fatrop": TWICE,
}


def elsewhere(*arguments: str) -> Any:
    """Return what this file prints as JSON, run as a script in a fresh process that is else quiet."""
    done = subprocess.run(
        [sys.executable, "-X", "faulthandler", __file__, *arguments],
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-4000:]
    assert done.stderr == ""
    return json.loads(done.stdout)


def asked_of(name: str, choice: dict[str, Any]) -> list[str]:
    """Return the cases that `name` runs: all, and by further choices not a second time for duals."""
    cases = list(cases_for(find_backend(name)))
    assert set(cases) == set(CASES)
    first = choice == CHOICES.get(name, ({},))[0]
    return [case for case in cases if first or not case.endswith(", duals")]


def mine(name: str) -> NonlinearBackend:
    backend = find_backend(name)
    assert not backend.missing(), f"{name} is expected here"
    assert isinstance(backend, NonlinearBackend)
    return backend


def asked(name: str, program: NonlinearProgram, **arguments: Any) -> Any:
    backend = mine(name)
    options = backend.checked_options(arguments.pop("options", {}))
    return backend.run(program, Request(options=options, **arguments))


# Conformance.


@pytest.mark.parametrize("name", BACKENDS)
def test_conformance(name: str) -> None:
    failures = []
    choices = CHOICES.get(name, ({},))
    found = elsewhere("conformance", name)
    assert len(found) == len(choices)
    for choice, data in zip(choices, found, strict=True):
        which = " ".join([name, *(f"{key}={value}" for key, value in choice.items())])
        seen = [CaseResult.from_dict(one) for one in data]
        matrix = Matrix.of(seen)
        print(which, matrix, sep="\n")
        known = KNOWN.get(which, "nothing")
        failures += [
            f"{which}, {r.case}: {r.reason}"
            for r in matrix.failures
            if not (r.case.startswith(known) and r.reason.startswith("ended"))
        ]
        assert {r.case for r in seen} == set(asked_of(name, choice))
        lacking = [r.reason for r in seen if r.status is Status.UNSUPPORTED]
        assert set(lacking) <= {"declares no interrupt"}
        assert sum(r.status is Status.PASS for r in seen) >= len(seen) - 3
    assert not failures, "\n".join(failures)


@pytest.mark.parametrize("name", [n for n in CASES if CASES[n].expectation.point is not None])
def test_the_cases_are_right(name: str) -> None:
    case = CASES[name]
    assert isinstance(case.program, NonlinearProgram)
    point = np.array(case.expectation.point, float)
    found = case.program.verify(point, tolerance=1e-9)
    assert found.ok, found.summary()
    assert found.objective == pytest.approx(case.expectation.objective, rel=1e-9, abs=1e-9)
    if case.expectation.duals is not None:
        duals = np.array(case.expectation.duals, float)
        assert case.program.stationarity(point, duals) < 1e-8
        assert explained_duals(case.program, point, duals, 1.0) == pytest.approx(duals)


def test_the_many_hills_are_optima() -> None:
    case = CASES["nonlinear: many hills, six local optima"]
    assert isinstance(case.program, NonlinearProgram)
    for near in ((0.09, -0.71), (1.7, -0.8), (1.6, 0.57)):
        found = asked("ipopt", case.program, warm_start=np.array(near)).primal_bound
        assert min(abs(found - one) for one in case.expectation.objectives) < 1e-9


def test_importing_the_suite_loads_no_casadi() -> None:
    code = (
        "import sys\n"
        "from crosstrack.solvers.conformance import cases_for\n"
        "from crosstrack.solvers.registry import find_backend\n"
        "assert cases_for(find_backend('clarabel')) and cases_for(find_backend('highs'))\n"
        "assert 'casadi' not in sys.modules\n"
        f"for name in {BACKENDS!r}:\n"
        "    b = find_backend(name); b.missing(); b.version()\n"
        "print(sorted({'casadi', 'scipy.optimize', 'highspy'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "[]", done.stdout + done.stderr


# Against known optima.


@st.composite
def convex(draw: Any) -> NonlinearProgram:
    """Draw a strictly convex quadratic program with a point that all rows allow."""
    size, rows = draw(st.integers(1, 3)), draw(st.integers(0, 3))
    numbers = st.integers(-4, 4)

    def array(*shape: int) -> np.ndarray:
        count = int(np.prod(shape))
        return np.array(draw(st.lists(numbers, min_size=count, max_size=count)), float).reshape(
            shape
        )

    root, cost, matrix, inside = array(size, size), array(size), array(rows, size), array(size)
    hessian = root @ root.T + np.eye(size)
    spread = draw(st.lists(st.sampled_from([1.0, 3.0, INF]), min_size=rows, max_size=rows))
    middle = matrix @ inside
    x = casadi.SX.sym("x", size)
    rows_ = casadi.mtimes(casadi.DM(matrix), x) if rows else casadi.SX(0, 1)
    objective = 0.5 * casadi.bilin(casadi.DM(hessian), x, x) + casadi.dot(casadi.DM(cost), x)
    return NonlinearProgram(
        function=casadi.Function("qp", [x], [objective, casadi.densify(rows_)], ["x"], ["f", "g"]),
        row_lower=middle - 1.0,
        row_upper=middle + np.array(spread),
        column_lower=inside - np.where(array(size) > 0, INF, 2.0),
        column_upper=inside + np.where(array(size) > 0, INF, 1.0),
        guess=array(size),
    )


def quadratic_optimum(program: NonlinearProgram) -> float:
    """Return what a quadratic solver makes of a quadratic `program`."""
    from crosstrack.solvers.conformance.quadratic import quadratic

    none, size = np.zeros(program.size), program.size
    hess = np.array(casadi.densify(program.second_order(none, 1.0, np.zeros(program.row_count))))
    hess = hess + np.triu(hess, 1).T
    posed = quadratic(
        hess,
        program.gradient(none).tolist(),
        program.jacobian(none).toarray().reshape(-1, size),
        program.row_lower,
        program.row_upper,
        lower=program.column_lower,
        upper=program.column_upper,
    )
    answer = find_backend("clarabel").run(posed, Request(options={"polish": True}))
    assert answer.termination is Termination.OPTIMAL
    return float(answer.primal_bound)


@settings(max_examples=20, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(convex())
def test_convex_programs_have_their_optimum(program: NonlinearProgram) -> None:
    optimum = quadratic_optimum(program)
    for name in ("ipopt", "uno", "slsqp"):
        answer = asked(name, program)
        assert answer.termination is Termination.LOCALLY_OPTIMAL, (name, answer)
        assert answer.primal_bound == pytest.approx(optimum, rel=1e-6, abs=1e-6), name
        assert program.stationarity(answer.point, answer.duals) < 1e-3, name


@settings(max_examples=15, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(st.lists(st.integers(-4, 4), min_size=7, max_size=7))
def test_other_units_make_no_difference(powers: list[int]) -> None:
    case = CASES["nonlinear: HS071"]
    assert isinstance(case.program, NonlinearProgram)
    units = 10.0 ** np.array(powers)
    columns, rows, objective = units[:4], units[4:6], float(units[6])
    x = casadi.MX.sym("x", 4)
    f, g = case.program.function(x / columns)
    other = NonlinearProgram(
        function=casadi.Function("other", [x], [f * objective, g * rows], ["x"], ["f", "g"]),
        row_lower=case.program.row_lower * rows,
        row_upper=case.program.row_upper * rows,
        column_lower=case.program.column_lower * columns,
        column_upper=case.program.column_upper * columns,
        guess=case.program.guess * columns,
        column_scale=columns,
        row_scale=rows,
        objective_scale=objective,
    )
    plain, answer = asked("ipopt", case.program), asked("ipopt", other)
    assert answer.termination is Termination.LOCALLY_OPTIMAL
    assert answer.primal_bound / objective == pytest.approx(plain.primal_bound, rel=1e-8)
    assert answer.point / columns == pytest.approx(plain.point, rel=1e-6)
    assert answer.duals * rows / objective == pytest.approx(plain.duals, rel=1e-5)
    assert answer.statistics["iterations"] == plain.statistics["iterations"]


def test_scaled_functions_are_the_derivatives_of_one_another() -> None:
    case = CASES["nonlinear: badly scaled, its scales given"]
    assert isinstance(case.program, NonlinearProgram)
    scaled = Scaled(case.program)
    posed = scaled.problem()
    z, duals = np.array([1.2, 3.0, 2.0, 1.5]), np.array([0.3, -0.2])
    weight = casadi.MX.sym("w")
    symbols = casadi.MX.sym("y", 2)
    lagrangian = weight * posed["f"] + casadi.dot(symbols, posed["g"])
    automatic = casadi.Function(
        "automatic",
        [posed["x"], weight, symbols],
        [
            casadi.gradient(posed["f"], posed["x"]),
            casadi.jacobian(posed["g"], posed["x"]),
            casadi.hessian(lagrangian, posed["x"])[0],
        ],
    )
    gradient, jacobian, hessian = (np.array(part) for part in automatic(z, 0.7, duals))
    assert np.array(scaled.gradient(z, [])[1]) == pytest.approx(gradient)
    assert np.array(scaled.jacobian(z, [])[1]) == pytest.approx(jacobian)
    assert np.array(scaled.first_order(z, [])[3]) == pytest.approx(jacobian)
    assert np.array(scaled.hessian(z, [], 0.7, duals)) == pytest.approx(np.triu(hessian))
    assert np.array(scaled.whole_hessian(z, [], 0.7, duals)) == pytest.approx(hessian)


def test_derivatives_given_are_used_and_agree() -> None:
    case = CASES["nonlinear: HS100"]
    program = case.program
    assert isinstance(program, NonlinearProgram)
    given_ = replace(program, derivatives=program.first_order, hessian=program.second_order)
    for name in ("ipopt", "sqpmethod"):
        first, second = asked(name, program), asked(name, given_)
        assert first.point == pytest.approx(second.point, abs=1e-9), name
        assert first.statistics["iterations"] == second.statistics["iterations"], name
    x = casadi.SX.sym("x", program.size)
    grad, jac = program.first_order(x)
    wrong = casadi.Function("wrong", [x], [2 * grad, jac], ["x"], ["grad_f", "jac_g"])
    misled = asked("ipopt", replace(program, derivatives=wrong))
    assert misled.statistics["iterations"] != asked("ipopt", program).statistics["iterations"]


# The judgement.


class Told(NonlinearBackend):
    """A solver that says what it was told to say."""

    name = "told"
    requires = ()

    def __init__(self, say: Callable[[NonlinearProgram, np.ndarray], NonlinearOutcome]) -> None:
        self.say = say

    def attempt(
        self, program: NonlinearProgram, request: Request, clock: Clock, start: np.ndarray
    ) -> NonlinearOutcome:
        return self.say(program, start)


DISK = CASES["nonlinear: Rosenbrock in the unit disk"]


def told(outcome: NonlinearOutcome, **arguments: Any) -> Any:
    assert isinstance(DISK.program, NonlinearProgram)
    return Told(lambda program, start: outcome).run(DISK.program, Request(**arguments))


def test_a_claimed_optimum_is_recomputed() -> None:
    best = np.array(DISK.expectation.point)
    duals = np.array(DISK.expectation.duals)
    right = told(NonlinearOutcome(Ended.PROVEN, best, duals=duals, iterations=3))
    assert right.termination is Termination.LOCALLY_OPTIMAL
    assert right.duals == pytest.approx(duals)
    assert right.statistics["iterations"] == 3
    assert right.statistics["stationarity"] < 1e-9
    assert not right.message
    # Without multipliers, or with wrong ones, they are estimated.
    for other in (None, -duals, np.array([np.nan]), np.zeros(2)):
        again = told(NonlinearOutcome(Ended.PROVEN, best, duals=other))
        assert again.termination is Termination.LOCALLY_OPTIMAL
        assert again.duals == pytest.approx(duals, abs=1e-6)
    inside = told(NonlinearOutcome(Ended.PROVEN, np.array([0.1, 0.1])))
    assert inside.termination is Termination.FEASIBLE
    assert "stationarity of" in inside.message
    outside = told(NonlinearOutcome(Ended.PROVEN, np.array([1.0, 1.0])))
    assert outside.termination is Termination.FAILED
    assert outside.point is None
    assert "calls its point an optimum; violated most: row, 1" in outside.message
    nowhere = told(NonlinearOutcome(Ended.PROVEN, np.array([np.nan, 1.0])))
    assert nowhere.termination is Termination.FAILED


def test_multipliers_that_cancel_explain_nothing() -> None:
    """Of an equation stated twice, multipliers of 1e14 leave rounding that looks like anything."""
    program = CASES[TWICE].program
    assert isinstance(program, NonlinearProgram)
    point = np.array([-0.985339036, -np.sqrt(2 - 0.985339036**2), 0.0])
    duals = np.array([-3.35395698e14, 1.67697849e14])
    answer = Told(lambda p, start: NonlinearOutcome(Ended.PROVEN, point, duals=duals)).run(
        program, Request()
    )
    assert answer.termination is Termination.FEASIBLE
    assert answer.statistics["stationarity"] > 1e-2
    assert np.abs(answer.duals).max() < 10


def test_how_other_ends_are_told() -> None:
    good, bad = np.array([0.1, 0.1]), np.array([2.0, 2.0])
    stopped = NonlinearOutcome(Ended.STOPPED, good, limit=Limit.TIME)
    answer = told(stopped)
    assert (answer.termination, answer.limit) == (Termination.FEASIBLE, Limit.TIME)
    answer = told(replace(stopped, point=bad))
    assert (answer.termination, answer.limit) == (Termination.NO_SOLUTION, Limit.TIME)
    kept = told(replace(stopped, point=bad), warm_start=good)
    assert (kept.termination, kept.limit) == (Termination.FEASIBLE, Limit.TIME)
    assert kept.point == pytest.approx(good)
    failed = told(NonlinearOutcome(Ended.FAILED, good, message="it: broke"))
    assert (failed.termination, failed.limit) == (Termination.FEASIBLE, None)
    assert failed.message.startswith("it: broke; its point is feasible")
    failed = told(NonlinearOutcome(Ended.FAILED, bad, message="it: broke"))
    assert failed.termination is Termination.FAILED
    away = told(NonlinearOutcome(Ended.UNBOUNDED, good, message="it: diverging"))
    assert (away.termination, away.point) == (Termination.NO_SOLUTION, None)
    mended = told(NonlinearOutcome(Ended.FAILED, np.array(DISK.expectation.point), message="it"))
    assert mended.termination is Termination.LOCALLY_OPTIMAL
    assert "yet its point is a local optimum" in mended.message


def test_infeasible_rows_are_named_in_the_paper_s_words() -> None:
    program = nonlinear(
        lambda x: (x[0], [x[0] ** 2, x[0] + x[1], x[1], x[0] ** 2 + x[1] ** 2]),
        [0.0, 0.0],
        row_lower=[-INF, 5, 1, -INF],
        row_upper=[1, INF, INF, 4],
        row_scale=[1, 1, 10, 1],
        rows=(
            Block("reach", "8", 0, 1),
            Block(
                "torque limit",
                "9",
                1,
                2,
                "at node {0} of interval {1}",
                np.array([[4, 2], [5, 2]]),
                "N m",
            ),
            Block("speed", "", 3, 1),
        ),
    )
    words = worst_blocks(program, np.array([3.0, -1.2]))
    assert (
        words
        == "eq. 8, reach, 8; speed, 6.44; eq. 9, torque limit, 3.2 N m at node 4 of interval 2"
    )
    assert worst_blocks(program, np.array([3.0, -1.2]), 1) == "eq. 8, reach, 8"
    answer = asked("ipopt", program)
    assert answer.termination is Termination.LOCALLY_INFEASIBLE
    assert answer.point is None
    assert "eq. 9, torque limit" in answer.message


def test_multipliers_are_estimated() -> None:
    for name in ("HS071", "HS043, Rosen and Suzuki", "HS100", "pendulum, 480 columns"):
        case = CASES[f"nonlinear: {name}"]
        assert isinstance(case.program, NonlinearProgram)
        found = estimated_duals(case.program, np.array(case.expectation.point))
        assert found == pytest.approx(np.array(case.expectation.duals), abs=1e-6), name


# Limits, stops, starts.


@pytest.mark.parametrize("name", HERE)
def test_a_stop_keeps_the_point(name: str) -> None:
    valley = CASES["nonlinear, limit: time"].program
    assert isinstance(valley, NonlinearProgram)
    control = Control()
    timer = threading.Timer(0.02, control.stop, (Limit.INTERRUPTED,))
    timer.start()
    begin = time.perf_counter()
    answer = asked(name, valley, control=control)
    assert time.perf_counter() - begin < 3.0
    if answer.termination is not Termination.LOCALLY_OPTIMAL:
        # SLSQP has its step in one piece; the others are at a point within the bounds.
        assert (answer.termination, answer.limit) == (Termination.FEASIBLE, Limit.INTERRUPTED)
    assert Feature.INTERRUPT in mine(name).features


@pytest.mark.parametrize("name", HERE)
def test_iterations_are_limited(name: str) -> None:
    valley = CASES["nonlinear, limit: time"].program
    assert isinstance(valley, NonlinearProgram)
    answer = asked(name, valley, options={"max_iter": 3})
    assert (answer.termination, answer.limit) == (Termination.FEASIBLE, Limit.ITERATIONS)
    assert answer.statistics["iterations"] <= 4


def test_a_seed_decides_where_the_search_begins() -> None:
    hills = CASES["nonlinear: many hills, six local optima"].program
    assert isinstance(hills, NonlinearProgram)
    for name in HERE:
        first, second = asked(name, hills, seed=5), asked(name, hills, seed=5)
        assert np.array_equal(first.point, second.point), name
    found = {round(asked("ipopt", hills, seed=seed).primal_bound, 6) for seed in range(8)}
    assert len(found) > 1


def test_a_warm_start_saves_iterations() -> None:
    program = CASES["nonlinear: pendulum, 480 columns"].program
    assert isinstance(program, NonlinearProgram)
    cold = asked("ipopt", program)
    again = asked("ipopt", program, warm_start=cold.point)
    assert again.statistics["iterations"] <= cold.statistics["iterations"] / 2
    near = cold.point + 1e-3 * np.random.default_rng(0).standard_normal(program.size)
    assert (
        asked("ipopt", program, warm_start=near).statistics["iterations"]
        < (cold.statistics["iterations"])
    )


def test_the_public_face() -> None:
    program = CASES["nonlinear: HS071"].program
    solution = ct.solve(program, "ipopt")
    assert solution.termination is Termination.LOCALLY_OPTIMAL, str(solution)
    assert solution.plan == pytest.approx([1, 4.743, 3.82115, 1.37941], abs=1e-4)
    assert ct.solve(program).backend == "ipopt"
    # In a worker of its own, for it cannot be interrupted.
    elsewhere_ = ct.solve(program, "blocksqp")
    assert elsewhere_.termination is Termination.LOCALLY_OPTIMAL, str(elsewhere_)
    many = ct.solve(CASES["nonlinear: many hills, six local optima"].program, "ipopt", starts=6)
    assert many.primal_bound == pytest.approx(-1.0316284534898774)
    assert len(many.starts) == 6


# Options, refusals, quietness.


@pytest.mark.parametrize("name", BACKENDS)
def test_options_are_checked(name: str) -> None:
    backend = find_backend(name)
    with pytest.raises(UnsupportedOption, match="has no option 'nonsense'"):
        backend.checked_options({"nonsense": 1})
    wrong = {"max_iter": 0, "qp": "none", "preset": "none", "hessian": "none", "mu_init": -1.0}
    for option, value in wrong.items():
        if option in backend.options:
            with pytest.raises(UnsupportedOption, match=option):
                backend.checked_options({option: value})
    assert backend.checked_options({})


def test_slsqp_refuses_what_does_not_fit() -> None:
    size = 12_000
    x = casadi.MX.sym("x", size)
    large = NonlinearProgram(
        function=casadi.Function(
            "large", [x], [casadi.sumsqr(x), casadi.MX(0, 1)], ["x"], ["f", "g"]
        ),
        row_lower=np.zeros(0),
        row_upper=np.zeros(0),
        column_lower=np.full(size, -1.0),
        column_upper=np.full(size, 1.0),
        guess=np.ones(size),
    )
    assert "12000 columns would take 1.2 GB" in mine("slsqp").refuses(large)
    with pytest.raises(UnsupportedFormulation, match="is dense"):
        asked("slsqp", large)
    assert asked("ipopt", large).termination is Termination.LOCALLY_OPTIMAL


def test_a_plugin_that_does_not_load_is_named(capfd: pytest.CaptureFixture[str]) -> None:
    class Absent(CasadiNlp):
        name = "absent"
        plugin = "worhp"

    program = CASES["nonlinear: HS071"].program
    assert isinstance(program, NonlinearProgram)
    with pytest.raises(BackendBroken, match="plugin 'worhp' does not load"):
        Absent().run(program, Request())
    for solver, words in (("nothing", "Invalid options"), ("pardiso", "refuses its options")):
        with pytest.raises(BackendBroken, match=words):
            mine("ipopt").run(program, Request(options={"linear_solver": solver}))
    assert capfd.readouterr().out == ""


def test_nothing_is_written(capfd: pytest.CaptureFixture[str]) -> None:
    for case in ("HS071", "infeasible equations", "unbounded, concave"):
        program = CASES[f"nonlinear: {case}"].program
        assert isinstance(program, NonlinearProgram)
        for name in ("ipopt", "uno", "sqpmethod", "bonmin", "blocksqp"):
            asked(name, program)
        asked("sqpmethod", program, options={"qp": "qpoases"})
    # A logarithm of what is negative is no reason to write either.
    beyond = nonlinear(lambda x: (casadi.log(x[0]) ** 2 + casadi.sqrt(x[0] - 3), []), [4.0])
    for name in HERE:
        asked(name, beyond)
    found = capfd.readouterr()
    assert found.out == found.err == ""


def test_muting_is_for_one_thread(capsys: pytest.CaptureFixture[str]) -> None:
    with muted():
        print("mine")
        other = threading.Thread(target=print, args=("another's",))
        other.start()
        other.join()
    print("after")
    assert capsys.readouterr().out == "another's\nafter\n"


# What follows runs in the other processes.


def main(task: str, name: str = "") -> Any:
    assert task == "conformance"
    backend = find_backend(name)
    return [
        [run_case(backend, case, choice).to_dict() for case in asked_of(name, choice)]
        for choice in CHOICES.get(name, ({},))
    ]


if __name__ == "__main__":
    # Solvers write to the standard output behind Python's back: keep it for the results alone.
    with os.fdopen(os.dup(1), "w") as out:
        os.dup2(2, 1)
        json.dump(main(*sys.argv[1:]), out)
