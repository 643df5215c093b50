"""Limits, random starts and infeasible problems of transcriptions."""

import threading
import time

import casadi
import numpy as np
import pytest
from transcribed import catalogue, layers

import crosstrack as ct
from crosstrack.errors import UnsupportedOption
from crosstrack.models import OptimalControlProblem
from crosstrack.solvers.contract.backend import Control, Limit
from crosstrack.solvers.contract.job import Job
from crosstrack.solvers.run.execution import execute


def test_a_time_limit_between_meshes_returns_the_last_plan():
    """Check the plan found in time, as trapezoids take many meshes for a boundary layer."""
    model = layers()
    begin = time.perf_counter()
    found = ct.solve(
        model,
        formulation="trapezoid",
        formulation_options={"most_nodes": 10**6},
        time_limit=0.4,
        tolerance=1e-9,
    )
    assert time.perf_counter() - begin < 15
    assert found.limit == "time"
    assert found.termination in ("rejected", "no_solution", "locally_optimal", "feasible")
    assert (found.plan is None) == (found.verification is None or not found.verification.ok)


@pytest.mark.parametrize("delay", [0.0, 0.4])
def test_a_stop_during_refinement_returns_a_plan(delay):
    control = Control()
    job = Job(
        model=layers().build(), backend="ipopt", formulation="trapezoid", tolerance=1e-9
    ).resolved()
    timer = threading.Timer(delay, control.stop, [Limit.INTERRUPTED])
    begin = time.perf_counter()
    if delay:
        timer.start()
    else:
        control.stop(Limit.INTERRUPTED)
    found = execute(job, control=control)
    timer.cancel()
    assert time.perf_counter() - begin < 15
    assert found.limit == "interrupted"
    assert (found.plan is None) == (found.verification is None or not found.verification.ok)


def two_ways():
    """Return a path around a disc on either side: the one below is slightly longer."""
    ocp = OptimalControlProblem("two ways")
    phase = ocp.phase()
    q = phase.state("q", 2, initial=[-1, 0], final=[1, 0], lower=-1.5, upper=1.5)
    u = phase.control("u", 2, lower=-6, upper=6)
    phase.dynamics({q: u})
    phase.path(q[0] ** 2 + (q[1] + 0.05) ** 2 >= 0.25, name="disc")
    phase.guess(q=[[-1, 0], [0, -0.8], [1, 0]])
    ocp.minimise(phase.integral(casadi.sumsqr(u)))
    return ocp


def test_a_seed_selects_a_start():
    one = two_ways().formulate("radau")
    drawn_at = {seed: one.started(seed).program.guess for seed in (1, 2, 3)}
    again = two_ways().formulate("radau").started(2).program.guess
    assert (drawn_at[2] == again).all()
    assert np.abs(drawn_at[1] - drawn_at[2]).max() > 0.1
    for guess in drawn_at.values():
        assert (guess >= one.program.column_lower).all()
        assert (guess <= one.program.column_upper).all()
        assert np.abs(guess - one.program.guess).max() > 0.1
    rough = {"formulation_options": {"intervals": 4}, "tolerance": 1e-4}
    first, second = (ct.solve(two_ways(), seed=2, **rough) for _ in range(2))
    assert first.to_dict()["plan"] == second.to_dict()["plan"]
    # Seed 0 is the guess, which is on the longer side; without a seed another start is tried.
    alone, looked = ct.solve(two_ways(), seed=0, **rough), ct.solve(two_ways(), **rough)
    assert looked.primal_bound < 0.95 * alone.primal_bound
    assert looked.statistics["second look"] == "better"


def test_all_starts_are_kept_and_the_best_is_returned():
    options = {"formulation_options": {"intervals": 4}, "tolerance": 1e-4}
    found = ct.solve(two_ways(), starts=3, seed=0, **options)
    assert len(found.starts) == 3 and [one.seed for one in found.starts] == [0, 1, 2]
    values = [one.primal_bound for one in found.starts if one.primal_bound is not None]
    assert found.primal_bound == min(values)
    single = ct.solve(two_ways(), seed=1, **options)
    assert found.starts[1].primal_bound == pytest.approx(single.primal_bound, rel=1e-9)


def test_an_infeasible_problem_names_the_largest_violation():
    ocp = OptimalControlProblem()
    phase = ocp.phase()
    x, u = phase.state("x", initial=0, final=0.5, unit="m"), phase.control("u", lower=-9, upper=9)
    phase.dynamics({x: u})
    phase.path(x + 0 * u <= -1, name="below", equation="5")
    ocp.minimise(phase.integral(u**2))
    found = ct.solve(ocp, formulation_options={"intervals": 3})
    assert found.termination == "locally_infeasible" and found.plan is None
    assert "violated most" in found.message and "below" in found.message


def test_too_little_time_is_locally_infeasible():
    ocp = OptimalControlProblem()
    phase = ocp.phase()
    x, v = phase.state("x", initial=0, final=1), phase.state("v", initial=0, final=0)
    u = phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.integral(u**2))
    found = ct.solve(ocp, formulation_options={"intervals": 3})
    assert found.termination == "locally_infeasible" and "dynamics of" in found.message


def test_refines_a_motion_without_free_variables(run_python, tmp_path):
    """Check a fixed control, which leaves more equations than columns."""
    script = """
import crosstrack as ct
from crosstrack.models import OptimalControlProblem
ocp = OptimalControlProblem()
phase = ocp.phase()
x, u = phase.state("x", initial=0, final=1), phase.control("u", lower=1, upper=1)
phase.dynamics({x: u})
ocp.minimise(phase.integral(x))
print(ct.solve(ocp, formulation_options={"intervals": 1}).termination)
"""
    (tmp_path / "script.py").write_text(script, "utf-8")
    printed = run_python("script.py", cwd=tmp_path)
    assert printed.split()[-1] == "locally_optimal"


@pytest.mark.parametrize(
    "size",
    [
        1e-6,
        1e6,
        1e-9,
        1e9,
    ],
)
def test_units_make_no_conditions_dependent(size):
    ocp = OptimalControlProblem()
    phase = ocp.phase()
    x, v = phase.state("x", initial=0, final=size), phase.state("v", initial=0, final=0)
    u = phase.control("u")
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.integral((u / size) ** 2))
    assert ocp.formulate("gauss").program.row_count


def test_moves_away_from_a_guess_without_derivatives():
    """Check a thrust whose length has no derivative at 0, the default guess."""
    ocp = OptimalControlProblem()
    phase = ocp.phase(time=(0, (1, 5)))
    r = phase.state("r", 2, initial=[0, 0], final=[1, 1])
    v = phase.state("v", 2, initial=[0, 0], final=[0, 0])
    thrust = phase.control("thrust", 2)
    phase.dynamics({r: v, v: thrust})
    phase.path(casadi.norm_2(thrust) <= 1)
    ocp.minimise(phase.duration)
    program = ocp.formulate("gauss").program
    assert not np.isfinite(program.jacobian(program.guess).data).all()
    assert np.isfinite(program.jacobian(program.start()).data).all()
    found = ct.solve(ocp, seed=0, formulation_options={"intervals": 2, "degree": 3})
    # Bang-bang along the diagonal: 2 sqrt(distance).
    assert found.primal_bound == pytest.approx(2.0 * 2.0**0.25, rel=1e-6)


@pytest.mark.parametrize("name", ["hermite-simpson", "trapezoid"])
def test_schemes_of_fixed_order_have_no_degree(name):
    with pytest.raises(
        UnsupportedOption, match=r"has no option 'degree'; its options: .*intervals"
    ):
        catalogue("bryson-denham").formulate(name, degree=6)
