"""A tolerance is a share of each constraint's data: limits of 1e-9, 1 and 1e9, for every problem."""

import json
import logging
from dataclasses import replace

import numpy as np
import pytest
from listening import incumbents

import crosstrack as ct
from crosstrack.models import (
    MixedIntegerProgram,
    OptimalControlProblem,
    ProgramBuilder,
    QuadraticProgram,
    Trajectory,
)
from crosstrack.models.verification import Check, Verification
from crosstrack.solvers.contract.verdict import judge
from crosstrack.solvers.programs.scaling import PLAIN, Scaling

SIZES = (1e-9, 1.0, 1e9)


def states(found):
    """Return the state of each check, and its violation relative to its scale."""
    return {
        one.name: "violated" if not one.ok else "near" if one.within_tolerance else "ok"
        for one in found.checks
    }


# -- checks ----------------------------------------------------------------------------------------


def test_a_check_names_its_scale_and_old_records_read():
    check = Check.scaled("c", "1", 3e-16, "m", "here", 1e-6, 1e-9, noise=1e-17, limit=1e-9)
    assert check.ok and check.within_tolerance and not check.near
    assert (check.scale, check.limit) == (1e-9, 1e-9)
    assert Check.from_dict(json.loads(json.dumps(check.to_dict()))) == check
    old = {
        "name": "c", "equation": "", "worst": None, "unit": "", "tolerance": 1e-6, "where": "",
        "ok": False, "within_tolerance": False,
    }  # fmt: skip
    read = Check.from_dict(old)
    assert (read.worst, read.scale, read.limit, read.rounding) == (np.inf, 1.0, None, 1e-9)
    whole = Verification.from_dict({"ok": False, "objective": 1.0, "checks": [old]})
    assert whole.scale == 1.0 and not whole.ok


@pytest.mark.parametrize(
    ("limit", "near"),
    [(1.0, False), (1.1e-5, False), (0.9e-5, True), (2e-6, True), (1e-10, False), (0.0, False), (np.inf, False)],
)  # fmt: skip
def test_a_limit_near_the_tolerance_is_named(limit, near):
    found = Verification(1.0, (Check.scaled("c", "", 0.0, "m", "", 1e-6, 1.0, limit=limit),))
    assert found.checks[0].near is near
    assert found.summary() == ("ok; limits near the tolerance: c" if near else "ok")


def test_a_limit_near_the_tolerance_is_logged_and_in_the_message(caplog):
    b = ProgramBuilder()
    x = b.columns("x", 2, cost=[-1.0, 0.0], upper=1)
    b.rows("thin", 1, (0, x, [1.0, -1.0]), lower=-2e-6, upper=2e-6)
    with caplog.at_level(logging.WARNING, "crosstrack"):
        found = ct.solve(b.build(name="thin"), "highs")
    assert found.plan is not None
    assert "limits near the tolerance: thin" in found.message
    assert "limits near the tolerance: thin" in caplog.text


# -- programs --------------------------------------------------------------------------------------


def row_program(size, row=1.0):
    """Return ``x + y <= size`` and ``x <= size``, the row times `row`."""
    b = ProgramBuilder()
    x = b.columns("x", 2, cost=[-1.0, -2.0], upper=size)
    b.rows("sum", 1, (0, x, [row, row]), upper=row * size)
    return b.build()


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("row", SIZES)
@pytest.mark.parametrize(("off", "state"), [(1.0, "ok"), (1 + 5e-7, "near"), (1.01, "violated"), (10, "violated")])  # fmt: skip
def test_rows_and_bounds_are_relative_to_their_own_data(size, row, off, state):
    program = row_program(size, row)
    assert states(program.verify(np.array([off * size, 0.0])))["sum"] == state
    assert states(program.verify(np.array([off * size, 0.0])))["x"] == state


def test_a_row_whose_terms_are_0_has_the_size_of_its_coefficients():
    b = ProgramBuilder()
    x = b.columns("x", 2, lower=-1)
    b.rows("same", 1, (0, x, [1e-6, -1e-6]), lower=0, upper=0)
    b.rows("wide", 1, (0, x, [1e9, 0.0]), upper=0)
    program = b.build()
    found = {one.name: one for one in program.verify(np.zeros(2)).checks}
    assert found["same"].scale == 1e-6
    assert found["wide"].scale == 1.0  # a large coefficient excuses nothing


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("backend", ["highs", "clarabel"])
def test_solvers_find_the_optimum_at_every_size(size, backend):
    if backend == "highs":
        program = replace(row_program(size), integral=[False, False])
        best = -2.0 * size
    else:
        program = QuadraticProgram(
            hessian=np.eye(2), cost=[0.0, 0.0], matrix=[[1.0, 1.0]], row_lower=[size],
            row_upper=[np.inf], column_lower=[0.0, 0.0], column_upper=[size, size],
        )  # fmt: skip
        best = 0.25 * size**2
    found = ct.solve(program, backend)
    assert found.termination == "optimal", found
    assert found.primal_bound == pytest.approx(best, rel=1e-6)
    assert found.dual_bound == pytest.approx(best, rel=1e-5)
    if found.duals is not None:
        assert program.dual_bound(found.duals, found.plan) == pytest.approx(best, rel=1e-5)


@pytest.mark.parametrize("factor", [2.0**-40, 2.0**40])
def test_scaling_a_program_changes_neither_points_nor_bounds(factor):
    """A start, a cutoff and incumbents are in the units of the program that was given."""
    model = ct.load("error-correction/example-1")
    plain = model.formulate("arc-flow").program
    assert Scaling.of(plain) is None and PLAIN[0] < 1 < PLAIN[1]
    program = replace(plain, cost=plain.cost * factor)
    assert isinstance(program, MixedIntegerProgram)
    scaling = Scaling.of(program)
    assert scaling is not None and Scaling.of(scaling.program) is None
    assert PLAIN[0] <= np.abs(scaling.program.cost).max() <= PLAIN[1]
    here = ct.solve(plain, "highs")
    heard = []
    there = ct.solve(program, "highs", warm_start=here.plan, on_event=incumbents(heard.append))
    assert there.primal_bound == pytest.approx(here.primal_bound * factor, rel=1e-9)
    assert there.dual_bound == pytest.approx(here.dual_bound * factor, rel=1e-6)
    for one in heard:
        assert one.objective == pytest.approx(program.objective(one.plan), rel=1e-9)


def test_bounds_due_to_rounding_do_not_scale():
    noise = np.full(9, 1e-17)
    program = QuadraticProgram(
        hessian=np.eye(1), cost=[1.0], matrix=np.ones((10, 1)), row_lower=[*noise, 1.0],
        row_upper=np.full(10, np.inf), column_lower=[-np.inf], column_upper=[np.inf],
    )  # fmt: skip
    assert Scaling.of(program) is None


# -- paths -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", ["square", "gate-2d"])
def test_paths_of_every_size(size, name):
    """The same path in another unit: the same verdicts, and J of the unit squared."""
    model = ct.load(f"minimum-snap/{name}")
    other = model.in_unit(1 / size)
    here, there = ct.solve(model), ct.solve(other)
    assert (str(here.termination), str(there.termination)) == ("optimal", "optimal")
    assert there.primal_bound == pytest.approx(here.primal_bound * size**2, rel=1e-6)
    plan = here.plan
    for share in (0.0, 1e-3, 0.1):
        moved = plan.coefficients.copy()
        moved[2, 0] += share * np.ptp(model.waypoints[np.isfinite(model.waypoints).all(axis=1)])
        one = model.verify(Trajectory(plan.times, moved))
        two = other.verify(Trajectory(plan.times, moved * size))
        assert states(one) == states(two)
        assert one.ok is (share == 0.0)


@pytest.mark.parametrize("size", [1e-9, 1e9])
def test_programs_of_paths_of_every_size_agree_with_the_native_backend(size):
    model = ct.load("minimum-snap/gate-2d").in_unit(1 / size)
    found = [ct.solve(model), ct.solve(model, "clarabel")]
    assert judge("gate", found, model).outcome == "AGREED", found


@pytest.mark.parametrize("size", SIZES)
def test_a_path_ten_times_over_a_small_limit_is_refused(size):
    """A limit is its own scale, however far the other lengths are from it."""
    square = ct.load("minimum-snap/square").in_unit(1 / size)
    plan = ct.solve(square).plan
    fastest = np.abs(plan(np.linspace(plan.times[0], plan.times[-1], 2001), 1)).max()
    for share, ok in ((0.1, False), (1 - 1e-4, False), (1.001, True)):
        limited = replace(square, velocity_limit=share * fastest)
        assert limited.verify(plan).ok is ok


@pytest.mark.parametrize("time", [1e-3, 1.0, 1e3])
def test_paths_of_every_duration(time):
    model = ct.load("minimum-snap/square")
    other = replace(model, times=model.times * time)
    here, there = ct.solve(model).plan, ct.solve(other).plan
    shaken = here.coefficients.copy()
    shaken[1, 3] += 1e-4 * np.abs(shaken).max()
    for plan, ok in ((here, True), (Trajectory(here.times, shaken), False)):
        assert model.verify(plan).ok is ok
        moved = Trajectory(other.times, plan.coefficients)
        assert states(other.verify(moved)) == states(model.verify(plan))
    assert other.verify(there).ok


# -- optimal control -------------------------------------------------------------------------------


def carrying(size):
    """Return a double integrator from 0 to `size` in 1 s, its speed limited."""
    ocp = OptimalControlProblem("move")
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=size, scale=size)
    v = phase.state("v", initial=0, final=0, upper=1.6 * size, scale=size)
    u = phase.control("u", scale=6 * size)
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.integral((u / size) ** 2))
    return ocp.build()


@pytest.mark.parametrize("size", SIZES)
def test_control_problems_of_every_size(size):
    model = carrying(size)
    found = ct.solve(model, "ipopt")
    assert found.plan is not None, found
    assert found.primal_bound == pytest.approx(
        ct.solve(carrying(1.0), "ipopt").primal_bound, rel=1e-5
    )
    wrong = carrying(10 * size)
    verdict = states(wrong.verify(found.plan))
    assert verdict["final values"] == "violated"
    tight = states(carrying(size / 10).verify(found.plan))
    assert tight["bounds of states"] == tight["final values"] == "violated"


@pytest.mark.parametrize("name", ["minimum-snap/corridor-10", "minimum-snap/square"])
def test_a_false_bound_contradicts_a_path_however_gentle(name):
    """The scale of objectives is not larger than they are, or a verdict would accept any bound."""
    model = ct.load(name)
    best = ct.solve(model)
    assert best.verification.scale <= 10 * best.primal_bound
    liar = replace(best, backend="liar", dual_bound=1.01 * best.primal_bound)
    assert judge(name, [best, liar], model).outcome == "CONTRADICTION"


def test_a_worse_plan_is_noted_if_the_best_objective_is_zero():
    """A percentage of nothing does not exist; the campaign met such an instance."""
    from crosstrack.solvers import Guarantee, Solution, Termination
    from crosstrack.solvers.contract.verdict import judge

    def answer(name, value, guarantee):
        return Solution(
            "grid-path", "one", "0", name, Termination.FEASIBLE, guarantee=guarantee, primal_bound=value,
            plan=(), stored_plan=[], verification=Verification(value, (), scale=0.0),
        )  # fmt: skip

    found = judge("one", [answer("a", 0.0, Guarantee.EXACT), answer("b", 2.5, Guarantee.HEURISTIC)])
    assert found.notes == ("b: stopped at a worse point, 2.5: 2.5 above 0 of a",)
