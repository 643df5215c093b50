"""Every quadratic backend on every conformance case, and against brute force.

What may clash (highspy, CVXPY, CasADi) runs in processes of its own, for which this file is also the
script; the other solvers run here, so that Hypothesis can shrink what it finds.
"""

from __future__ import annotations

import functools
import itertools
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import HealthCheck, given, settings, strategies as st

import crosstrack as ct
from crosstrack.errors import (
    BackendBroken,
    InvalidData,
    UnsupportedFormulation,
    UnsupportedOption,
)
from crosstrack.models import Model
from crosstrack.models.programs.linear import QuadraticProgram
from crosstrack.solvers.attempts import Clock, Ended, Outcome
from crosstrack.solvers.backend import Feature, Limit, Request, Termination
from crosstrack.solvers.conformance import (
    CaseResult,
    Matrix,
    Status,
    all_cases,
    cases_for,
    run_case,
)
from crosstrack.solvers.conformance.quadratic import quadratic
from crosstrack.solvers.conformance.quadratic_larger import certified
from crosstrack.solvers.qp.base import QuadraticBackend, QuadraticOutcome
from crosstrack.solvers.qp.forms import ConicForm, Core, SplitForm, independent_rows
from crosstrack.solvers.qp.polishing import polished
from crosstrack.solvers.qp.proofs import contradiction, examined, recedes
from crosstrack.solvers.qp.quality import measured
from crosstrack.solvers.registry import find_backend

INF = np.inf
#: Solvers that get along in one process, this one.
HERE = ("clarabel", "piqp", "proxqp", "daqp", "quadprog", "osqp", "scs")
BACKENDS = (*HERE, "casadi", "highs", "cvxpy")

CASES = {name: case for name, case in all_cases().items() if name.startswith("quadratic")}

#: What a backend, with the option named, does not take; and why, in its own words.
UNSUPPORTED = {
    "quadprog": "needs a positive definite Hessian",
    "cvxpy SCS": "needs a row or a bound",
}
#: Plugins of CasADi's wheel that load, beside qrqp; and the case in which they fail, in words.
PLUGINS = ("qpoases", "daqp", "highs", "osqp", "proxqp", "piqp", "hpipm")
KNOWN = {"casadi proxqp": ("quadratic: linear program", "which nothing proves")}

#: What each backend is run with, in one process for all choices of one.
CHOICES = {"casadi": ("", *PLUGINS), "cvxpy": ("", "OSQP", "HIGHS", "SCS", "PIQP")}
RUNS = [(name, choice) for name in BACKENDS for choice in CHOICES.get(name, ("",))]


def elsewhere(*arguments: str) -> Any:
    """Return what this file prints as JSON, run as a script in a fresh process."""
    done = subprocess.run(
        [sys.executable, "-X", "faulthandler", __file__, *arguments],
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-4000:]
    return json.loads(done.stdout)


@functools.cache
def results(name: str) -> dict[str, list[CaseResult]]:
    data = main("conformance", name) if name in HERE else elsewhere("conformance", name)
    return {choice: [CaseResult.from_dict(one) for one in found] for choice, found in data.items()}


def mine(name: str) -> QuadraticBackend:
    backend = find_backend(name)
    assert not backend.missing(), f"{name} is expected here"
    assert isinstance(backend, QuadraticBackend)
    return backend


def asked(name: str, program: QuadraticProgram, **arguments: Any) -> Any:
    backend = mine(name)
    options = backend.checked_options(arguments.pop("options", {}))
    return backend.run(program, Request(options=options, **arguments))


@pytest.mark.parametrize(("name", "choice"), RUNS, ids=lambda value: str(value))
def test_conformance(name: str, choice: str) -> None:
    which = f"{name} {choice}".strip()
    found = results(name)[choice]
    case, words = KNOWN.get(which, ("", ""))
    failures = [
        f"{r.case}: {r.reason}"
        for r in Matrix.of(found).failures
        if not (case and r.case.startswith(case) and words in r.reason)
    ]
    assert not failures, "\n".join(failures)
    assert {r.case for r in found} == {c for c in cases_for(find_backend(name)) if c in CASES}
    unforeseen = [
        f"{r.case}: {r.reason}"
        for r in found
        if r.status is Status.UNSUPPORTED
        and not r.reason.startswith("declares no")
        and UNSUPPORTED.get(which, "nothing") not in r.reason
    ]
    assert not unforeseen, "\n".join(unforeseen)
    assert sum(r.status is Status.PASS for r in found) >= (45 if name == "quadprog" else 60)


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
    """Return the optimum of a small strictly convex program, None where it is infeasible."""
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


@st.composite
def programs(draw: Any) -> QuadraticProgram:
    """Draw a small strictly convex program; ranges, equalities, duplicates, infinite bounds."""
    size, rows = draw(st.integers(1, 3)), draw(st.integers(0, 3))
    numbers = st.integers(-4, 4)

    def array(*shape: int) -> np.ndarray:
        count = int(np.prod(shape))
        return np.array(draw(st.lists(numbers, min_size=count, max_size=count)), float).reshape(
            shape
        )

    root = array(size, size)
    matrix = array(rows, size)
    low, high = array(rows), array(rows)
    low, high = np.minimum(low, high), np.maximum(low, high)
    kinds = draw(st.lists(st.integers(0, 3), min_size=rows, max_size=rows))
    for row, kind in enumerate(kinds):
        low[row] = -INF if kind == 0 else low[row]
        high[row] = {1: INF, 2: low[row]}.get(kind, high[row])
    lower, upper = array(size) - 2, array(size) + 3
    open_ = np.array(draw(st.lists(st.booleans(), min_size=2 * size, max_size=2 * size)), bool)
    return quadratic(
        root @ root.T + np.eye(size),
        array(size).tolist(),
        matrix,
        low,
        high,
        lower=np.where(open_[:size], -INF, np.minimum(lower, upper)),
        upper=np.where(open_[size:], INF, np.maximum(lower, upper)),
        offset=float(draw(numbers)),
    )


@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
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


# The polish.


@settings(max_examples=40, deadline=None, derandomize=True)
@given(programs(), st.integers(0, 10**6))
def test_polish_restores_what_noise_took(program: QuadraticProgram, seed: int) -> None:
    answer = asked("clarabel", program)
    if answer.termination is not Termination.OPTIMAL:
        return
    draw = np.random.default_rng(seed)
    start = measured(
        program,
        answer.point + 1e-5 * draw.standard_normal(program.size),
        answer.duals + 1e-5 * draw.standard_normal(program.row_count),
    )
    assert start is not None
    better = polished(program, start)
    assert better.merit <= start.merit
    assert better.proves(1e-9, 1e-9), better.describe()


def test_polish_reaches_the_last_digits() -> None:
    case = CASES["quadratic: portfolio, 200 columns"]
    rough = asked(
        "osqp", case.program, options={"eps": 1e-4, "polish": False}, gap=1, tolerance=1e-2
    )
    start = measured(case.program, rough.point, rough.duals)
    assert start is not None
    assert not start.proves(1e-6, 1e-6)
    exact = polished(case.program, start)
    assert exact.clean
    assert np.abs(exact.point - np.array(case.expectation.point)).max() < 1e-12


def test_polish_never_makes_worse() -> None:
    program = CASES["quadratic: infeasible rows"].program
    start = measured(program, np.array([0.5, 0.5]), None)
    assert start is not None
    assert polished(program, start).merit <= start.merit
    assert not polished(program, start).proves(1e-6, 1e-6)


def test_polish_stops_when_asked() -> None:
    program = CASES["quadratic: rows from below"].program
    start = measured(program, np.array([1.01, 0.99]), None)
    assert start is not None
    assert polished(program, start, lambda: True) is start


def test_polish_can_be_switched_off() -> None:
    program = CASES["quadratic: badly scaled"].program
    rough = asked("scs", program, options={"polish": False})
    exact = asked("scs", program)
    assert "polish" in exact.seconds
    assert "polish" not in rough.seconds
    assert exact.point == pytest.approx([50, 1e-3], abs=1e-9)


# Proofs.


def test_a_contradiction_is_recomputed() -> None:
    program = CASES["quadratic: infeasible rows"].program
    assert contradiction(program, np.array([1.0, -1.0]))
    assert contradiction(program, np.array([1e-12, -1e-12]))
    for wrong in ([-1.0, 1.0], [1.0, 0.0], [0.0, 0.0], [1.0, -1.0001], [np.nan, np.nan]):
        assert not contradiction(program, np.array(wrong)), wrong
    # A weak ray: 1e-8 x >= 1 on a free column is met at 1e8, however small it looks.
    faint = quadratic([0], [0], [[1e-8]], 1)
    assert not contradiction(faint, np.array([1.0]))
    # Bounded columns may take what does not cancel.
    boxed = CASES["quadratic: infeasible within the bounds"].program
    assert contradiction(boxed, np.array([-1.0]))


def test_a_recession_direction_is_recomputed() -> None:
    flat = CASES["quadratic: unbounded along a flat direction"].program
    assert recedes(flat, np.array([1.0, -1.0]))
    assert recedes(flat, np.array([1e9, -1e9]))
    for wrong in ([-1.0, 1.0], [1.0, 1.0], [1.0, -0.999], [0.0, 0.0]):
        assert not recedes(flat, np.array(wrong)), wrong
    # Curvature of 1e-12 is curvature: this has its minimum, far away.
    assert not recedes(quadratic([1e-12], [-1]), np.array([1.0]))
    rows = CASES["quadratic: unbounded within rows"].program
    assert recedes(rows, np.array([0.0, 1.0]))
    assert not recedes(rows, np.array([1.0, 0.0]))


def test_what_phase_one_settles() -> None:
    for name, case in CASES.items():
        if case.arguments or case.stop_after is not None or Feature.DUALS in case.needs:
            continue
        program = case.program
        assert isinstance(program, QuadraticProgram)
        if (program.column_lower > program.column_upper).any() or not program.size:
            continue
        if (program.row_lower > program.row_upper).any():
            continue
        found = examined(program)
        kind = case.expectation.termination[0]
        assert found.infeasible == (kind is Termination.INFEASIBLE), name
        assert found.unbounded == (kind is Termination.UNBOUNDED), name


class Told(QuadraticBackend):
    """A solver that says what it was told to say."""

    name = "told"
    requires = ()

    def __init__(self, say: Callable[[QuadraticProgram], Outcome]) -> None:
        self.say = say
        self.asked = 0

    def attempt(self, program: QuadraticProgram, request: Request, clock: Clock) -> Outcome:
        self.asked += 1
        return self.say(program)


def told(program: QuadraticProgram, say: Callable[[QuadraticProgram], Outcome]) -> Any:
    return Told(say).run(program, Request())


def test_a_point_for_an_infeasible_program_is_caught() -> None:
    for name in ("quadratic: infeasible rows", "quadratic: infeasible by a thousandth"):
        answer = told(
            CASES[name].program,
            lambda p: Outcome(Ended.PROVEN, np.array([0.5, 0.5]), duals=np.zeros(p.row_count)),
        )
        assert answer.termination is Termination.INFEASIBLE
        assert answer.point is None
        assert answer.statistics["proof"] == "a phase 1 of our own"


def test_qpsolvers_returns_points_for_infeasible_programs_that_we_refuse() -> None:
    """Why nothing is believed: solvers behind qpsolvers were seen to find what does not exist."""
    program = CASES["quadratic: infeasible equalities"].program
    for name in HERE:
        assert asked(name, program).termination is Termination.INFEASIBLE, name


@pytest.mark.parametrize("ended", [Ended.INFEASIBLE, Ended.UNBOUNDED, Ended.UNCLEAR])
def test_a_false_claim_without_proof_is_no_answer(ended: Ended) -> None:
    program = CASES["quadratic: rows from below"].program
    liar = Told(
        lambda p: QuadraticOutcome(ended, ray=np.array([1.0, 1.0]), direction=np.array([1.0, 0.0]))
    )
    answer = liar.run(program, Request())
    assert answer.termination is Termination.FAILED
    assert "which nothing proves" in answer.message
    assert liar.asked == 3  # once more with each proximal term


def test_a_proximal_attempt_comes_after_a_failure() -> None:
    program = CASES["quadratic: many optimal points"].program

    def say(posed: QuadraticProgram) -> Outcome:
        if posed.hessian.toarray()[0, 0] == 1:
            return Outcome(Ended.FAILED, message="too flat")
        # The optimum of the proximal program around the origin.
        at = 2 / (2 + 1e-2)
        return Outcome(Ended.PROVEN, np.array([at, at]), duals=np.zeros(0))

    answer = told(program, say)
    assert answer.termination is Termination.OPTIMAL
    assert answer.statistics["attempts"] == 2
    assert answer.primal_bound == pytest.approx(-2, abs=1e-12)


def test_highs_masters_what_it_was_seen_to_fail_on() -> None:
    """Without rows it forgot the Hessian; on flat objectives it cycled, or called them unbounded."""
    found = elsewhere("flat")
    assert len(found) == FLAT
    for seed, (mine_, others) in found.items():
        assert mine_[0] == others[0], seed
        if others[1] is not None:
            assert mine_[1] == pytest.approx(others[1], rel=1e-6, abs=1e-6), seed


def test_an_unclear_end_is_settled() -> None:
    unclear = Outcome(Ended.UNCLEAR)
    for name, kind in (
        ("quadratic: infeasible, its objective unbounded", Termination.INFEASIBLE),
        ("quadratic: unbounded within rows", Termination.UNBOUNDED),
    ):
        assert told(CASES[name].program, lambda p: unclear).termination is kind


def test_wrong_multipliers_are_mended_or_no_proof() -> None:
    case = CASES["quadratic: rows from below"]
    best = np.array(case.expectation.point)
    mended = told(case.program, lambda p: Outcome(Ended.PROVEN, best, duals=np.array([-9.0, 9.0])))
    assert mended.termination is Termination.OPTIMAL
    assert mended.duals == pytest.approx([2, 0])
    raw = Told(lambda p: Outcome(Ended.PROVEN, best, duals=np.array([-9.0, 9.0])))
    answer = raw.run(case.program, Request(options={"polish": False}))
    assert answer.termination is Termination.FEASIBLE
    assert "above the bound" in answer.message
    assert answer.dual_bound < answer.primal_bound - 1


def test_a_point_that_is_not_feasible_is_named_with_its_residuals() -> None:
    case = CASES["quadratic: rows from below"]
    liar = Told(lambda p: Outcome(Ended.PROVEN, np.array([0.9, 0.9]), duals=np.zeros(2)))
    answer = liar.run(case.program, Request(options={"polish": False}))
    assert answer.termination is Termination.FAILED
    assert answer.point is None
    assert "primal residual 0.1" in answer.message


def test_a_stopped_solver_keeps_its_limit() -> None:
    case = CASES["quadratic: rows from below"]
    stopped = Outcome(Ended.STOPPED, np.array([3.0, 3.0]), limit=Limit.TIME)
    answer = told(case.program, lambda p: stopped)
    assert (answer.termination, answer.limit) == (Termination.FEASIBLE, Limit.TIME)
    outside = replace(stopped, point=np.array([0.0, 0.0]))
    answer = told(case.program, lambda p: outside)
    assert (answer.termination, answer.limit) == (Termination.NO_SOLUTION, Limit.TIME)
    kept = Told(lambda p: outside).run(case.program, Request(warm_start=np.array([1.0, 1.0])))
    assert (kept.termination, kept.primal_bound) == (Termination.FEASIBLE, 2.0)


def test_the_bound_of_an_iteration_limit() -> None:
    program = CASES["quadratic: portfolio, 200 columns"].program
    answer = asked("scs", program, options={"max_iters": 3, "polish": False})
    assert answer.termination in (Termination.NO_SOLUTION, Termination.FEASIBLE)
    assert answer.limit is Limit.ITERATIONS


# Forms.


def test_core_takes_out_what_is_fixed_or_says_nothing() -> None:
    program = quadratic(
        [[2, 1, 0], [1, 2, 1], [0, 1, 2]],
        [1, -1, 3],
        [[1, 1, 1], [0, 0, 0], [0, 1, 0], [1, 0, 1]],
        [1, -1, 2, -INF],
        [4, 1, 2, INF],
        lower=[-INF, 2, -INF],
        upper=[INF, 2, INF],
        offset=3.0,
    )
    core = Core.of(program)
    assert core.columns.tolist() == [0, 2]
    assert core.rows.tolist() == [0]
    point = np.array([0.3, -0.7])
    whole = core.point(point)
    assert whole is not None
    assert core.program.objective(point) == pytest.approx(program.objective(whole))
    assert core.program.matrix @ point + 2 == pytest.approx((program.matrix @ whole)[:1])
    duals = core.duals(np.array([1.5]))
    assert duals is not None
    assert duals.tolist() == [1.5, 0, 0, 0]


def test_forms_give_multipliers_back() -> None:
    program = quadratic(
        [1, 1], [0, 0], [[1, 0], [0, 1], [1, 1], [1, -1]], [1, -INF, 0, -2], [1, 3, INF, 2]
    )
    form, split = ConicForm.of(program), SplitForm.of(program)
    assert form.zeros == 1
    # Equal row, rows 1 and 3 from above, rows 2 and 3 from below.
    assert form.duals([5.0, 1, 2, 3, 4], 4).tolist() == [-5, -1, 3, 2]
    assert split.duals([7.0], [1.0, 2.0, 3.0]).tolist() == [7, 1, 2, 3]


def test_dependent_rows_are_found() -> None:
    program = CASES["quadratic: dependent equalities"].program
    kept, rows = independent_rows(program)
    assert kept.row_count == len(rows) == 2
    free = CASES["quadratic: rows from below"].program
    assert independent_rows(free)[0] is free


# Options and refusals.


@pytest.mark.parametrize("name", BACKENDS)
def test_options_are_checked(name: str) -> None:
    backend = find_backend(name)
    with pytest.raises(UnsupportedOption, match="has no option 'nonsense'"):
        backend.checked_options({"nonsense": 1})
    for option, wrong in {"polish": 1, "max_iter": 0, "plugin": "none", "solver": "NONE"}.items():
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


def test_quadprog_says_in_numbers_what_it_cannot_take() -> None:
    backend = mine("quadprog")
    flat = CASES["quadratic: no rows, one column linear"].program
    assert "1 of 2 columns have none, column 1 first" in backend.refuses(flat)
    singular = CASES["quadratic: many optimal points"].program
    assert not backend.refuses(singular)
    with pytest.raises(UnsupportedFormulation, match=r"eigenvalues range from .* to 2"):
        backend.run(singular, Request())


@pytest.mark.parametrize("name", ["daqp", "quadprog"])
def test_dense_backends_refuse_what_does_not_fit(name: str) -> None:
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


def test_what_each_program_type_may_ask() -> None:
    program = CASES["quadratic: rows from below"].program
    linear = next(c.program for n, c in all_cases().items() if n == "linear: lower rows bind")
    highs, cvxpy = find_backend("highs"), find_backend("cvxpy")
    with pytest.raises(UnsupportedOption, match="mip_heuristic_effort is for mixed-integer"):
        highs.run(program, Request(options={"mip_heuristic_effort": 0.5}))
    with pytest.raises(UnsupportedOption, match="'SCIP' takes no quadratic program"):
        cvxpy.run(program, Request(options={"solver": "SCIP"}))
    with pytest.raises(UnsupportedOption, match="'CLARABEL' takes no mixed-integer program"):
        cvxpy.run(linear, Request(options={"solver": "CLARABEL"}))


def test_casadi_names_a_plugin_that_does_not_load() -> None:
    found = elsewhere("plugins")
    assert not found["qrqp"]
    assert not found["qpoases"]
    for name, why in found.items():
        assert not why or f"plugin {name!r} does not load" in why
    absent = [name for name, why in found.items() if why]
    for name in absent:
        assert elsewhere("absent", name).startswith(BackendBroken.__name__)
    # The day this fails, the wheel has become complete, and the list of those that run can grow.
    assert absent == ["clarabel"]


def test_describing_backends_loads_no_solver() -> None:
    code = (
        "import sys\n"
        "from crosstrack.solvers.registry import find_backend\n"
        f"for name in {BACKENDS!r}:\n"
        "    b = find_backend(name); b.missing(); b.version()\n"
        "solvers = {'highspy', 'cvxpy', 'casadi', 'clarabel', 'piqp', 'proxsuite', 'daqp', "
        "'quadprog', 'osqp', 'scs', 'qpsolvers', 'scipy.optimize'}\n"
        "print(sorted(solvers & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "[]", done.stdout + done.stderr


def test_casadi_and_highspy_still_clash() -> None:
    """The day this fails, the libraries get along, and CasADi's HiGHS may leave the group."""
    code = "import casadi; casadi.load_conic('highs'); import highspy"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "undefined symbol" in done.stderr


# The program itself.


def test_json_and_digest() -> None:
    program = CASES["quadratic: portfolio, 200 columns"].program
    back = Model.from_json(program.to_json())
    assert isinstance(back, QuadraticProgram)
    assert back.digest == program.digest
    assert (back.hessian != program.hessian).nnz == 0
    assert back.row_upper.tolist() == program.row_upper.tolist()
    other = replace(program, cost=program.cost + 1e-12)
    assert other.digest != program.digest


@pytest.mark.parametrize(
    ("hessian", "words"),
    [
        ([[1, 1], [0, 1]], r"hessian\[0, 1\] is 1, but hessian\[1, 0\] is 0: it must be symmetric"),
        ([[1, 0], [0, -1]], r"hessian\[1, 1\] is -1, which no positive semidefinite matrix"),
        ([[0, 1], [1, 1]], r"hessian\[0, 0\] is 0"),
    ],
)
def test_a_hessian_that_cannot_be_convex(hessian: list[list[float]], words: str) -> None:
    with pytest.raises(InvalidData, match=words):
        quadratic(hessian, [0, 0])


@settings(max_examples=25, deadline=None, derandomize=True)
@given(programs())
def test_the_export_to_qpsolvers_is_the_same_program(program: QuadraticProgram) -> None:
    import qpsolvers

    mine_ = asked("daqp", program)
    exported = program.to_qpsolvers()
    exported.P = exported.P.toarray()
    exported.G = None if exported.G is None else exported.G.toarray()
    exported.A = None if exported.A is None else exported.A.toarray()
    # DAQP wants arrays that it could write to.
    exported.q, exported.lb, exported.ub = (
        None if values is None else np.array(values)
        for values in (exported.q, exported.lb, exported.ub)
    )
    theirs = qpsolvers.solve_problem(exported, solver="daqp")
    assert theirs.found == (mine_.termination is Termination.OPTIMAL)
    if theirs.found:
        assert theirs.obj + program.offset == pytest.approx(mine_.primal_bound, rel=1e-6, abs=1e-6)


def test_the_export_to_cvxpy_is_the_same_program() -> None:
    found = elsewhere("cvxpy")
    assert len(found) > 10
    for name, value in found.items():
        optimum = CASES[name].expectation.objective
        assert value == pytest.approx(optimum, rel=1e-4, abs=1e-4), name


# Through the public face.


def test_solve_verifies_and_bounds() -> None:
    program = CASES["quadratic: receding horizon, 120 columns"].program
    for name in ("clarabel", "osqp", "piqp"):  # the last one in a worker: it cannot be interrupted
        solution = ct.solve(program, name)
        assert solution.termination is Termination.OPTIMAL, str(solution)
        assert solution.gap is not None
        assert solution.gap <= 1e-9
        assert solution.plan == pytest.approx(np.array(CASES_POINT), abs=1e-8)
        assert {"build", "solve", "total"} <= set(solution.seconds)


CASES_POINT = CASES["quadratic: receding horizon, 120 columns"].expectation.point


def test_a_warm_start_saves_iterations() -> None:
    program = CASES["quadratic: portfolio, 200 columns"].program
    best = np.array(CASES["quadratic: portfolio, 200 columns"].expectation.point)
    for name in ("osqp", "scs"):
        cold = asked(name, program).statistics["iterations"]
        warm = asked(name, program, warm_start=best).statistics["iterations"]
        assert warm <= cold, name


def test_a_certified_program_is_certified() -> None:
    draw = np.random.default_rng(0)
    root, matrix = draw.standard_normal((6, 6)), draw.standard_normal((4, 6))
    duals, reduced = np.array([1.0, -2.0, 0.0, 0.5]), np.array([0.0, 1.0, 0.0, -1.0, 0.0, 0.0])
    point = draw.standard_normal(6)
    program = certified(root @ root.T, sp.csr_array(matrix), point, duals, reduced)
    assert program.dual_bound(duals, point) == pytest.approx(program.objective(point), abs=1e-9)


# What follows runs in the other processes.

#: How many programs without rows, and with few, have a singular Hessian.
FLAT = 60


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


def main(task: str, name: str = "") -> Any:
    if task == "conformance":
        backend, option = find_backend(name), "plugin" if name == "casadi" else "solver"
        return {
            choice: [
                run_case(backend, case, {option: choice} if choice else {}).to_dict()
                for case in cases_for(backend)
                if case in CASES
            ]
            for choice in CHOICES.get(name, ("",))
        }
    if task == "plugins":
        from crosstrack.solvers.qp.casadi import plugins

        return plugins()
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
    assert task == "cvxpy"
    found = {}
    for case in CASES.values():
        value = case.expectation.objective
        if case.arguments or value is None or Feature.DUALS in case.needs or not case.program.size:
            continue
        problem, _ = case.program.to_cvxpy()
        problem.solve(solver="CLARABEL")
        found[case.name] = float(problem.value)
    return found


if __name__ == "__main__":
    # Solvers write to the standard output behind Python's back: keep it for the results alone.
    with os.fdopen(os.dup(1), "w") as out:
        os.dup2(2, 1)
        json.dump(main(*sys.argv[1:]), out)
