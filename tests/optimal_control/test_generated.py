"""Agreement of a step's compiled C code with the step."""

import shutil
import subprocess

import casadi
import numpy as np
import pytest
from optimal_control.steered import brake, cart_pole

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation, UnsupportedOption
from crosstrack.models import OptimalControlProblem

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


@pytest.mark.skipif(COMPILER is None, reason="no C compiler on the path")
@pytest.mark.parametrize(
    ("make", "states"),
    [
        (brake, [[1.0, 0.0], [0.9, -0.2], [4.0, 1.0]]),
        pytest.param(
            cart_pole, [[0.0, 0.0, 0.2, 0.0], [0.1, 0.2, -0.1, 0.3]], marks=pytest.mark.slow
        ),
    ],
)
def test_compiled_steps_agree(make, states, tmp_path):
    problem = make()
    solver = ct.prepare(problem, intervals=3, degree=3, backend="sqpmethod")
    name = f"step_{make.__name__}".replace("_", "")
    source = solver.generate(tmp_path / f"{name}.c")
    library = tmp_path / f"{name}.so"
    subprocess.run(
        [COMPILER, "-O0", "-fPIC", "-shared", str(source), "-o", str(library), "-lm"], check=True
    )
    compiled = casadi.external(name, str(library))
    start = casadi.external(f"{name}_start", str(library))()["z"]
    others = {key: value for key, value in solver.data.items() if key != "x0"}
    last = {"z": start, "lam_x": 0, "lam_g": 0}
    for number, state in enumerate(states):
        step = solver(x0=state, warm=number > 0)
        found = compiled(x0=state, **others, **last)
        assert float(found["objective"]) == pytest.approx(step.objective, rel=1e-9)
        np.testing.assert_allclose(np.array(found["u"]).reshape(-1), step.u0, rtol=1e-7, atol=1e-9)
        assert float(found["violation"]) <= 1e-7
        last = {key: found[f"{key}_out"] for key in last}


def test_a_step_without_a_solution_reports_it(tmp_path):
    from crosstrack.solvers.optimal_control.generated import step_function

    problem = brake(limit=0.01)
    phase = problem.phases[0]
    problem.subject_to(phase.final(phase.symbols["x"]) == [0.0, 0.0], name="rest")
    solver = ct.prepare(problem, intervals=3, degree=3, backend="sqpmethod")
    assert not solver().ok
    found = step_function(solver.posed, solver.solver)(
        x0=[1.0, 0.0], weight=0.1, z=solver.posed.guess, lam_x=0, lam_g=0
    )
    assert float(found["violation"]) > 1e-3


def test_a_step_reports_data_that_break_a_row_or_are_no_numbers():
    from crosstrack.solvers.optimal_control.generated import step_function

    problem = brake()
    area = problem.data("area", value=1.0)
    problem.subject_to(casadi.sqrt(area) <= 2.0, name="range of the data")
    solver = ct.prepare(problem, intervals=3, degree=3, backend="sqpmethod")
    step = step_function(solver.posed, solver.solver)
    start = {"x0": [1, 0], "weight": 0.1, "z": solver.posed.guess, "lam_x": 0, "lam_g": 0}
    for value, violation in ((1, 0.0), (9, 1.0), (np.nan, np.inf), (-1, np.inf)):
        found = float(step(area=value, **start)["violation"])
        scale = solver.posed.program.row_scale[solver.posed._data_rows[0]]
        assert found == pytest.approx(violation / scale, abs=1e-6)
    assert solver(area=1).ok
    assert not solver(area=9).ok
    assert not solver(area=-1).ok


def named(name):
    """Return a problem with data `name`."""
    problem = OptimalControlProblem("named")
    start = problem.data(name, value=1.0)
    phase = problem.phase(time=(0, 1))
    x, force = phase.state("x", initial=start), phase.control("force")
    phase.dynamics({x: force})
    problem.minimise(phase.integral(x**2 + force**2))
    return problem


def test_rejects_data_with_names_of_the_step(tmp_path):
    options = {"intervals": 2, "degree": 2, "backend": "sqpmethod"}
    for name in ("u", "z", "lam_g", "lam_x_out"):
        with pytest.raises(UnsupportedFormulation, match=f"data '{name}' have names of inputs"):
            ct.prepare(named(name), **options).generate(tmp_path / "step.c")
    with pytest.raises(InvalidData, match="data 'warm' cannot be passed"):
        ct.prepare(named("warm"), **options)
    assert ct.prepare(named("self"), **options)(self=2.0).ok


def test_rejects_functions_without_c_code(tmp_path):
    with pytest.raises(UnsupportedOption, match="backend 'sqpmethod' with its option"):
        ct.prepare(brake(), intervals=2, degree=2).generate(tmp_path / "step.c")
    solver = ct.prepare(brake(), intervals=2, degree=2, backend="sqpmethod")
    for name in ("2step.c", "st ep.c", "über.c"):
        with pytest.raises(InvalidData, match="names the function in C"):
            solver.generate(tmp_path / name)
    with pytest.raises(InvalidData):
        solver.generate(tmp_path / "step.txt")
