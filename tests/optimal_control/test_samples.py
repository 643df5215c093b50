"""Warm starts from arrays of another tool, and the transcription in the hands of CasADi alone."""

import shutil
import subprocess

import casadi
import numpy as np
import pytest
from optimal_control.steered import brake, cart_pole
from optimal_control.test_structured import limited, two_phases

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import OptimalControlProblem

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
OPTIONS = {"tolerance": 1e-3, "formulation_options": {"intervals": 5, "degree": 4, "refine": False}}
TIMES = np.linspace(0.0, 1.0, 21)


def samples():
    """Return samples of the cart's states and of its piecewise constant force."""
    return {"time": TIMES, "x": np.outer(1 - TIMES, [0, 0, 0.2, 0]), "force": np.ones(20)}


def test_samples_are_a_start_of_the_search():
    problem = cart_pole()
    plan = problem.build().as_plan(samples())
    np.testing.assert_allclose(plan["x"](0.525), [0, 0, 0.095, 0], atol=1e-12)
    np.testing.assert_allclose(plan["force"](1.0), 1.0)
    np.testing.assert_allclose(plan.parameters["x0"], [0, 0, 0.2, 0])
    found = ct.solve(problem, warm_start=samples(), **OPTIONS)
    assert "warm start" in found.message
    np.testing.assert_allclose(
        found.primal_bound, ct.solve(problem, **OPTIONS).primal_bound, rtol=1e-6
    )


def test_samples_of_an_optimum_need_fewer_iterations():
    best = ct.solve(cart_pole(), **OPTIONS)
    times = np.linspace(0.0, 1.0, 201)
    near = {"time": times, "x": best.plan["x"](times), "force": best.plan["force"](times)}
    again = ct.solve(cart_pole(), warm_start=near, **OPTIONS)
    far = {**near, "x": 3 * np.ones((201, 4)), "force": -15 * np.ones(201)}
    other = ct.solve(cart_pole(), warm_start=far, **OPTIONS)
    assert again.statistics["iterations"] < other.statistics["iterations"]


def test_samples_of_an_exact_plan_verify():
    problem = OptimalControlProblem("straight")
    phase = problem.phase(time=(0, 2))
    x, u = phase.state("x", initial=0, final=4), phase.control("u", upper=3)
    phase.dynamics({x: u})
    problem.minimise(phase.integral(u**2))
    plan = {"time": [0, 1, 2], "x": [0, 2, 4], "u": [2, 2]}
    assert ct.verify(problem, plan).ok
    assert not ct.verify(problem, {**plan, "u": [2, 2.1]}).ok


def test_samples_per_phase_and_of_parameters():
    plan = (
        two_phases()
        .build()
        .as_plan({name: {"time": [k, k + 1], "x": [1, 1], "u": [0]} for k, name in enumerate("ab")})
    )
    assert [part.end for part in plan.phases] == [1.0, 2.0]
    one = {"time": [0, 3], "x": np.zeros((2, 2)), "w": [0, 0.3], "u": [0, 0]}
    problem = limited().build()
    assert problem.as_plan(one).parameters["drag"] == pytest.approx(0.3)
    assert problem.as_plan({**one, "parameters": {"k": 2}}).parameters["k"] == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("change", "field", "words"),
    [
        ({"force": None}, "names", r"must be \['time', 'x', 'force'\], got \['time', 'x'\]"),
        ({"y": [1]}, "names", r"got \['time', 'x', 'force', 'y'\]"),
        ({"x": np.zeros((20, 4))}, "x", "x has 20 entries where time has 21"),
        ({"x": np.zeros((21, 3))}, "x", "has 3 entries where the declaration has 4"),
        ({"x": np.full((21, 4), np.nan)}, "x", "must be finite"),
        ({"force": 3.0}, "force", "must have shape"),
        ({"force": "a"}, "force", "force must be an array of numbers"),
        ({"x": [[0, 0], [1, 2, 3]]}, "x", "x must"),
        ({"time": TIMES[::-1]}, "time", "at least 2 samples that increase"),
        ({"parameters": {"z": 1}}, "parameters", r"must be \['x0'\]"),
        ({"parameters": 3}, "parameters", "must be a mapping"),
    ],
)
def test_bad_samples_are_named(change, field, words):
    data = {name: value for name, value in {**samples(), **change}.items() if value is not None}
    with pytest.raises(InvalidData, match=words) as caught:
        ct.solve(cart_pole(), warm_start=data)
    assert caught.value.field == field


def test_samples_and_solutions_start_prepared_steps():
    solver = ct.prepare(cart_pole(), intervals=5, degree=4, structured=False)
    best = ct.solve(cart_pole(), **OPTIONS)
    cold = solver()
    for start in (samples(), best, best.plan):
        step = solver(warm=start)
        assert (step.ok, step.warm) == (True, True)
        assert step.objective == pytest.approx(cold.objective, rel=1e-6)
    with pytest.raises(InvalidData, match="x has 20 entries where time has 21"):
        solver(warm={**samples(), "x": np.zeros((20, 4))})


# -- export ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [brake, limited])
def test_casadi_alone_finds_the_same_optimum(make):
    program = make().formulate("radau", intervals=4, degree=4, refine=False).program
    options = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-9}}
    solver = casadi.nlpsol("solver", "ipopt", program.to_casadi(), options)
    result = solver(**program.casadi_arguments())
    best = ct.solve(program, "ipopt", tolerance=1e-8)
    assert float(result["f"]) == pytest.approx(best.primal_bound, rel=1e-6)


@pytest.mark.skipif(COMPILER is None, reason="no C compiler on the path")
def test_compiled_functions_equal_those_of_the_program(tmp_path):
    program = limited().formulate("radau", intervals=2, degree=3, refine=False).program
    source, library = tmp_path / "limited.c", tmp_path / "limited.so"
    source.write_text(program.to_c("limited"))
    subprocess.run(
        [COMPILER, "-O0", "-fPIC", "-shared", str(source), "-o", str(library), "-lm"], check=True
    )
    load = {
        end: casadi.external(f"limited{end}", str(library)) for end in ("", "_first", "_second")
    }
    point = program.start() + 0.1
    duals = np.linspace(-1.0, 1.0, program.row_count)
    for end, function, arguments in (
        ("", program.function, [point]),
        ("_first", program.first_order, [point]),
        ("_second", program.second_order, [point, 2.0, duals]),
    ):
        for mine, theirs in zip(load[end].call(arguments), function.call(arguments), strict=True):
            np.testing.assert_allclose(mine.full(), theirs.full(), rtol=1e-12, atol=1e-12)
    stored = casadi.external("limited_arguments", str(library))()
    for name, value in program.casadi_arguments().items():
        np.testing.assert_array_equal(stored[name].full().reshape(-1), value)


def test_rejects_a_name_that_is_not_one_of_c():
    program = brake().formulate("radau", intervals=2, degree=2, refine=False).program
    for name in ("2nd", "a b", None):
        with pytest.raises(InvalidData, match="valid name of a C function"):
            program.to_c(name)
