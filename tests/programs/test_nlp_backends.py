"""Every nonlinear backend on every conformance case: limits, stops, starts, options, quietness.

Those that stop when told to and clash with nothing run here. The others run the cases in another
process, for which this file is also the script.
"""

from __future__ import annotations

import functools
import threading
import time
from typing import Any

import casadi
import numpy as np
import pytest
from nonlinears import CASES, TWICE, asked, mine
from runs import answer_with, elsewhere, included, loaded_by_describing

import crosstrack as ct
from crosstrack.errors import BackendBroken, UnsupportedFormulation, UnsupportedOption
from crosstrack.models.programs.nonlinear import NonlinearProgram
from crosstrack.solvers.conformance import (
    CaseResult,
    Matrix,
    Status,
    cases_for,
    run_case,
)
from crosstrack.solvers.conformance.nonlinear_hard import nonlinear
from crosstrack.solvers.contract.backend import Control, Feature, Limit, Request, Termination
from crosstrack.solvers.contract.registry import find_backend
from crosstrack.solvers.nlp.casadi_nlp import CasadiNlp
from crosstrack.solvers.nlp.quality import explained_duals

#: Those that stop when told to and clash with nothing.
HERE = ("ipopt", "uno", "sqpmethod", "slsqp", "trust-constr")
#: Those that run the cases in one process.
TOGETHER = ("fatrop", "blocksqp", "bonmin")
BACKENDS = (*HERE, *TOGETHER, "sleqp")


#: What each backend is run with beside its defaults.
CHOICES: dict[str, tuple[dict[str, Any], ...]] = {
    "ipopt": ({}, {"mu_strategy": "monotone"}, {"hessian": "limited-memory"}),
    "uno": ({}, {"preset": "funnelsqp"}, {"preset": "ipopt"}),
    "sqpmethod": ({}, {"qp": "qpoases"}, {"qp": "daqp"}, {"qp": "osqp"}),
    "trust-constr": ({"max_iter": 90},),
    "slsqp": ({"max_iter": 100},),
}
#: Cases in which a solver gives up.
KNOWN = {
    "ipopt hessian=limited-memory": TWICE,
    "uno preset=ipopt": TWICE,
    "sqpmethod": TWICE,
    "sqpmethod qp=daqp": TWICE,
    "sqpmethod qp=osqp": TWICE,
    "slsqp max_iter=100": TWICE,
    "fatrop": TWICE,
}
#: SLEQP's build in CasADi's wheel spent seconds, at random, on formatting statistics that are not
#: printed: its padding is a width that was never set (``sleqp_timer_display``). SciPy's
#: trust-constr and CasADi's sqpmethod take eight seconds and more.
SLOW = {"sleqp", "sqpmethod", "trust-constr"}


#: Each so many cases run with a choice that is not the first.
FEW = 5


def asked_of(name: str, choice: dict[str, Any], every: int) -> list[str]:
    """Return the cases that `name` runs: all, and by further choices each so many but the largest.

    Solvers that run elsewhere take the largest case only if `every` is 1.
    """
    cases = list(cases_for(find_backend(name)))
    integer = {case for case in cases if case.startswith("integer nonlinear")}
    assert bool(integer) == (name == "bonmin")
    assert set(cases) - integer == set(CASES)
    number = CHOICES.get(name, ({},)).index(choice)
    small = [case for case in cases if "pendulum" not in case]
    if number:
        return small[number % every :: every]
    return cases if every == 1 or name in HERE else small


# Conformance.


def test_every_included_solver_runs_the_cases() -> None:
    assert included("nlp") <= set(BACKENDS)


@pytest.mark.parametrize(
    ("name", "every"),
    [
        *[(name, FEW) for name in BACKENDS if name not in SLOW],
        *[pytest.param(name, 1, marks=pytest.mark.slow) for name in BACKENDS],
    ],
)
def test_conformance(name: str, every: int, capfd: pytest.CaptureFixture[str]) -> None:
    failures = []
    choices = CHOICES.get(name, ({},))
    if name in HERE:
        found = suite(name, every)
        written = capfd.readouterr()
        assert written.out == written.err == ""
    else:
        found = suites(*(TOGETHER if name in TOGETHER else (name,)), every=every)[name]
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
            and not (name == "sleqp" and r.reason.startswith("took"))
        ]
        assert {r.case for r in seen} == set(asked_of(name, choice, every))
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


def test_sleqp_finds_an_optimum() -> None:
    (found,) = elsewhere(__file__, "one", quiet=True)
    assert CaseResult.from_dict(found).status is Status.PASS, found


def test_importing_the_suite_loads_no_casadi() -> None:
    assert not {"casadi", "scipy.optimize", "highspy"} & loaded_by_describing()


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
    assert time.perf_counter() - begin < 10.0
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


def test_slsqp_refuses_programs_that_are_too_large() -> None:
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
    for solver, words in (("nothing", "Invalid options"), ("pardiso", "rejects its options")):
        with pytest.raises(BackendBroken, match=words):
            ct.solve(program, "ipopt", isolate=False, backend_options={"linear_solver": solver})
    assert capfd.readouterr().out == ""


def test_nothing_is_written(capfd: pytest.CaptureFixture[str]) -> None:
    for case in ("HS071", "infeasible equations", "unbounded, concave"):
        program = CASES[f"nonlinear: {case}"].program
        assert isinstance(program, NonlinearProgram)
        for name in ("ipopt", "uno", "sqpmethod", "bonmin", "blocksqp"):
            ct.solve(program, name, isolate=False)
        options = {"qp": "qpoases"}
        ct.solve(program, "sqpmethod", isolate=False, backend_options=options)
    # A logarithm of what is negative is no reason to write either.
    beyond = nonlinear(lambda x: (casadi.log(x[0]) ** 2 + casadi.sqrt(x[0] - 3), []), [4.0])
    for name in HERE:
        ct.solve(beyond, name, isolate=False)
    found = capfd.readouterr()
    assert found.out == found.err == ""


@functools.cache
def suites(*names: str, every: int) -> Any:
    """Return the results of backends in one process, that writes nothing."""
    return elsewhere(__file__, str(every), *names, quiet=True)


def suite(name: str, every: int) -> list[list[dict[str, Any]]]:
    """Return the results of a backend by choice and case."""
    backend = find_backend(name)
    return [
        [run_case(backend, case, choice).to_dict() for case in asked_of(name, choice, every)]
        for choice in CHOICES.get(name, ({},))
    ]


def main(every: str, *names: str) -> Any:
    """Return what another process answers: the results of `names`, or one case of SLEQP."""
    if every == "one":
        return [run_case(find_backend("sleqp"), "nonlinear: HS071").to_dict()]
    return {name: suite(name, int(every)) for name in names}


if __name__ == "__main__":
    answer_with(main)
