"""The verbs and the command line on motions: solve, compare, verify, diagnose, several starts, limits."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import casadi
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import crosstrack as ct
from crosstrack.errors import InvalidData, UnknownName, UnsupportedFormulation
from crosstrack.instances import entries
from crosstrack.models import ControlPlan, Model, OptimalControlProblem, SatelliteSlew
from crosstrack.models.optimal_control.transcription.dependence import dependences
from crosstrack.solvers.crosscheck import rejudged

#: A coarse first mesh: these motions are smooth, and refinement does the rest.
COARSE = {"intervals": 3, "degree": 4}
DROP = {"dependent": "drop"}
ENERGY, BRYSON = "optimal-control/double-integrator-energy", "optimal-control/bryson-denham"
CURVE, FALL = "optimal-control/brachistochrone", 1.801603122
#: The squared lengths of the ways round the disc of `round_a_disc`: two tangents and an arc each.
_TANGENT, _ARC = math.sqrt(1.01 - 0.25), math.pi - 2 * math.acos(0.5 / math.sqrt(1.01))
BELOW, ABOVE = ((2 * _TANGENT + 0.5 * (_ARC + sign * 2 * math.atan(0.1))) ** 2 for sign in (-1, 1))


def run(*arguments: Any, code: int = 0, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run the command line, and insist on its exit code."""
    done = subprocess.run(
        [sys.executable, "-m", "crosstrack", *map(str, arguments)],
        capture_output=True, text=True, timeout=240, check=False, **options,
    )  # fmt: skip
    assert done.returncode == code, (done.returncode, done.stdout[-2000:], done.stderr[-2000:])
    return done


# -- problems ----------------------------------------------------------------------------------------


def overdone(final: float = 1.0) -> OptimalControlProblem:
    """More equations than variables: nothing can be chosen, and yet the end is fixed."""
    ocp = OptimalControlProblem("overdone")
    phase = ocp.phase()
    x, y = phase.state("x", initial=0, final=final), phase.state("y", initial=0, final=0)
    phase.dynamics({x: 1, y: 0})
    ocp.minimise(phase.end)
    return ocp


def turn(
    end: tuple[float, float] = (math.cos(1), math.sin(1)), *, both: bool = True, path: bool = False
) -> OptimalControlProblem:
    """A point on the unit circle, moved by 1 rad in a second: ∫ u² = 1, and x² + y² stays."""
    ocp = OptimalControlProblem("turn")
    phase = ocp.phase()
    x = phase.state("x", initial=1, final=end[0] if both else None)
    y, u = phase.state("y", initial=0, final=end[1]), phase.control("u")
    phase.dynamics({x: -u * y, y: u * x})
    if path:
        phase.path(x**2 + y**2, equals=1, name="unit length")
    phase.guess(x=[1, end[0]], y=[0, end[1]], u=0.8)
    ocp.minimise(phase.integral(u**2))
    return ocp


def chain(count: int, duration: float) -> OptimalControlProblem:
    """Integrators in a row, from rest to rest: whatever the time, all ends can be reached."""
    ocp = OptimalControlProblem("chain")
    phase = ocp.phase(time=(0, duration))
    states = [phase.state(f"x{k}", initial=0, final=float(k == 0)) for k in range(count)]
    u = phase.control("u")
    phase.dynamics(dict(zip(states, [*states[1:], u], strict=True)))
    ocp.minimise(phase.integral(u**2))
    return ocp


def push(
    strength: float, end: Any = 1.0, speed: float | None = None, name: str = "push"
) -> OptimalControlProblem:
    """A mass moved by 1 m from rest to rest; the least strength that does it in a second is 4."""
    ocp = OptimalControlProblem(name)
    phase = ocp.phase(time=(0, end))
    x = phase.state("x", initial=0, final=1, unit="m")
    v = phase.state("v", initial=0, final=0, upper=speed, unit="m/s")
    u = phase.control("u", lower=-strength, upper=strength, unit="m/s²")
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.integral(u**2))
    return ocp


def round_a_disc() -> OptimalControlProblem:
    """Past a disc off the straight line: the way below is the shorter, the guess goes above."""
    ocp = OptimalControlProblem("round a disc")
    phase = ocp.phase()
    x, y = phase.state("x", initial=0, final=2), phase.state("y", initial=0, final=0)
    u, v = phase.control("u", lower=-20, upper=20), phase.control("v", lower=-20, upper=20)
    phase.dynamics({x: u, y: v})
    phase.path((x - 1) ** 2 + (y - 0.1) ** 2, lower=0.25, name="disc")
    phase.guess(x=[0, 1, 2], y=[0, 1, 0])
    ocp.minimise(phase.integral(u**2 + v**2))
    return ocp


def slew(*, all_eleven: bool, path: bool = False) -> OptimalControlProblem:
    """The paper's slew written by hand: all 11 conditions at the end, or |q| = 1 on the way."""
    model = SatelliteSlew()
    ocp = OptimalControlProblem("slew by hand")
    phase = ocp.phase(time=(0, (1, 60)))
    end = model.target.tolist()
    some = ([0.0, *end[1:]], [np.inf, *end[1:]])
    q = phase.state("q", 4, initial=[1, 0, 0, 0], final=end if all_eleven else some, scale=1)
    w = phase.state("w", 3, initial=0, final=0 if all_eleven else None, lower=-0.125, upper=0.125)
    delta = phase.state("delta", 4, initial=0, final=0)
    rate = phase.control("rate", 4, lower=-1, upper=1)
    s, c, b, h0 = casadi.sin(delta), casadi.cos(delta), model.beta, model.momentum
    wheels = casadi.vertcat(
        -math.cos(b) * s[0] - c[1] + math.cos(b) * s[2] + c[3],
        c[0] - math.cos(b) * s[1] - c[2] + math.cos(b) * s[3],
        math.sin(b) * casadi.sum1(s),
    )
    jacobian, inertia = casadi.jacobian(wheels, delta), casadi.DM(model.inertia)
    torque = -h0 * (jacobian @ rate)
    phase.dynamics(
        {
            q: casadi.vertcat(
                -0.5 * casadi.dot(w, q[1:]), -0.5 * casadi.cross(w, q[1:]) + 0.5 * q[0] * w
            ),
            w: casadi.solve(inertia, torque - casadi.cross(w, inertia @ w + h0 * wheels)),
            delta: rate,
        }
    )
    phase.path(casadi.det(jacobian @ jacobian.T), lower=0.2, name="singularity measure")
    phase.path(torque, lower=-25, upper=25, name="control torque")
    if path:
        phase.path(casadi.dot(q, q), equals=1, name="unit length")
    ocp.minimise(phase.integral(1 + 0.1 * casadi.dot(rate, rate)))
    guess = lowered(model).definition.phases[0].guess
    phase.guess(
        time=guess.start + guess.fractions * (guess.end - guess.start), q=guess.states[:, :4],
        w=guess.states[:, 4:7], delta=guess.states[:, 7:], rate=guess.controls,
    )  # fmt: skip
    return ocp


def lowered(model: Model[Any] | None) -> OptimalControlProblem:
    """Return the optimal control problem that a model comes down to."""
    while not isinstance(model, OptimalControlProblem):
        assert model is not None
        model = model.lower()
    return model


# -- bad input ---------------------------------------------------------------------------------------


def undriven() -> OptimalControlProblem:
    ocp = OptimalControlProblem("undriven")
    phase = ocp.phase()
    x, v = phase.state("x", initial=0), phase.state("v")
    phase.dynamics({x: v})
    ocp.minimise(phase.end)
    return ocp


def misshapen() -> OptimalControlProblem:
    ocp = OptimalControlProblem("misshapen")
    phase = ocp.phase()
    q, u = phase.state("q", 3, initial=[0, 0, 0]), phase.control("u", 2)
    phase.dynamics({q: u})
    return ocp


def wrong_ends() -> OptimalControlProblem:
    ocp = OptimalControlProblem("wrong ends")
    ocp.phase().state("q", 3, initial=[0, 0])
    return ocp


@pytest.mark.parametrize(
    ("declare", "words"),
    [
        (lambda: push(1, (1, None)), ["end of phase 'phase 1'"]),
        (lambda: push(1, (1, np.inf)), ["end of phase 'phase 1'", "finite"]),
        (undriven, ["v", "dynamics"]),
        (misshapen, ["dynamics of 'q'", "3 entries", "got 2"]),
        (wrong_ends, ["initial value of 'q'", "(2,)"]),
    ],
)
def test_what_cannot_be_solved_is_said_before_anything_runs(declare, words):
    with pytest.raises(InvalidData) as error:
        ct.solve(declare())
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize("formulation", ["gauss", "radau", "hermite-simpson"])
def test_more_equations_than_variables_are_named(formulation):
    with pytest.raises(InvalidData, match="2 of the 2 conditions at the end") as error:
        ct.solve(overdone(), formulation=formulation)
    assert "final value of 'x'" in str(error.value) and "final value of 'y'" in str(error.value)
    answer = ct.solve(overdone(), formulation=formulation, formulation_options=DROP)
    assert answer.verification.ok
    assert answer.plan["x"](1.0) == pytest.approx(1.0)


def test_more_equations_than_variables_may_be_kept():
    # In a worker: Ipopt was seen to die of it, at the refined program.
    answer = ct.solve(overdone(), formulation_options={"dependent": "keep"}, isolate=True)
    assert answer.termination == "locally_optimal", answer.message
    assert answer.plan["x"](1.0) == pytest.approx(1.0)


def test_all_eleven_conditions_of_the_slew_are_too_many():
    with pytest.raises(InvalidData, match="4 of the 11 conditions at the end") as error:
        ct.solve(slew(all_eleven=True))
    text = str(error.value)
    assert "'q[0]'" in text and "'w[" in text
    assert "'dependent': 'drop'" in text


def test_the_length_of_the_quaternion_is_kept_by_the_dynamics():
    with pytest.raises(InvalidData, match="keep path constraint 'unit length' by themselves"):
        ct.solve(slew(all_eleven=False, path=True))


def test_the_slew_with_its_dependent_equations_left_out():
    model = slew(all_eleven=True, path=True)
    answer = ct.solve(
        model, tolerance=2e-2, formulation_options={**DROP, "intervals": 5, "degree": 4}
    )
    assert answer.termination == "locally_optimal", answer.message
    assert answer.primal_bound == pytest.approx(8.652909, rel=2e-2)
    checks = {check.name: check for check in ct.verify(model, answer, tolerance=2e-2).checks}
    # What the program leaves out is verified all the same.
    assert checks["final values"].ok and checks["unit length"].ok
    end = answer.plan.phases[0].states(answer.plan.phases[0].end)
    assert end == pytest.approx([*SatelliteSlew().target, *np.zeros(7)], abs=2e-2)


@pytest.mark.parametrize("path", [False, True])
def test_drop_leaves_out_of_the_program_and_keep_keeps(path):
    model = turn(path=path)
    programs = {
        how: model.formulate("radau", dependent=how, **COARSE).program for how in ("drop", "keep")
    }
    equations = {
        how: int((one.row_lower == one.row_upper).sum() + (one.column_lower == one.column_upper).sum())
        for how, one in programs.items()
    }  # fmt: skip
    # One final value, and the path's equation at each of 12 nodes.
    assert equations["keep"] - equations["drop"] == 1 + 12 * path
    answer = ct.solve(model, formulation_options=DROP)
    assert answer.primal_bound == pytest.approx(1.0, rel=1e-6)
    names = [check.name for check in answer.verification.checks if check.ok]
    assert "final values" in names and ("unit length" in names) is path


def test_what_contradicts_has_no_plan():
    model = turn(end=(2.0, 0.0))
    with pytest.raises(InvalidData, match="or contradict them"):
        ct.solve(model)
    answer = ct.solve(model, formulation_options={**DROP, "refine": False})
    # Which condition is dropped decides whether the search or the verification finds out.
    assert answer.termination in ("rejected", "locally_infeasible")
    assert answer.plan is None
    answer = ct.solve(overdone(2.0), formulation_options=DROP)
    assert answer.termination == "rejected"
    assert "final values" in answer.message


def test_diagnose_sees_what_contradicts():
    found = ct.diagnose(turn(end=(2.0, 0.0)))
    assert found.feasible is False
    # From anywhere on the unit circle, (2, 0) is 1 away at least.
    assert [one.data["by"] for one in found.findings] == pytest.approx([1.0], rel=1e-3)


def test_diagnose_sees_what_nothing_can_move():
    assert ct.diagnose(overdone(2.0)).feasible is not True


def test_no_false_alarm_in_the_catalogue():
    wrong = {}
    for entry in entries():
        if entry.model in ("optimal-control", "satellite-slew"):
            found = dependences(lowered(entry.build()).definition)
            if found:
                wrong[entry.name] = found
    assert not wrong


@pytest.mark.parametrize("duration", [1e-3, 1e-2, 1.0, 1e4])
@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_no_false_alarm_in_slow_and_fast_chains(count, duration):
    assert dependences(chain(count, duration).definition) == ()


def test_a_free_time_start_or_parameter_moves_the_end():
    def drift(time: Any = (0, 1), initial: Any = 0, rate: float | None = 1.0) -> Any:
        ocp = OptimalControlProblem("drift")
        phase = ocp.phase(time=time)
        x = phase.state("x", initial=initial, final=1)
        phase.dynamics({x: ocp.parameter("p", lower=-2, upper=2) if rate is None else rate})
        ocp.minimise(phase.end)
        return dependences(ocp.definition)

    assert drift()
    assert drift(time=(0, (0.5, 2))) == ()
    assert drift(initial=(-1, 1)) == ()
    assert drift(rate=None) == ()


@st.composite
def mixed(draw: st.DrawFn, conserved: int) -> tuple[OptimalControlProblem, np.ndarray]:
    """A controllable linear system, mixed with a value that stays; and how that shows in each state.

    In controllable form every end can be reached; a rotation of the states changes nothing of that.
    """
    order = draw(st.integers(1, 3))
    size = order + conserved
    factors = draw(st.lists(st.floats(-2, 2), min_size=order, max_size=order))
    table, drive = np.zeros((size, size)), np.zeros(size)
    table[: order - 1, 1:order] = np.eye(order - 1)
    table[order - 1, :order] = factors
    drive[order - 1] = 1.0
    seed = draw(st.integers(0, 2**16))
    rotation, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(size, size)))
    start = np.array(draw(st.lists(st.floats(-1, 1), min_size=size, max_size=size)))
    end = start + rotation[:, :order] @ np.ones(order)
    ocp = OptimalControlProblem("mixed")
    phase = ocp.phase()
    x, u = phase.state("x", size, initial=start, final=end), phase.control("u")
    rate = casadi.DM(rotation @ table @ rotation.T) @ x + casadi.DM(rotation @ drive) * u
    phase.dynamics({x: rate})
    ocp.minimise(phase.integral(u**2))
    return ocp, rotation[:, order:]


@settings(max_examples=8, deadline=None)
@given(mixed(conserved=0))
def test_no_false_alarm_where_all_ends_can_be_reached(drawn):
    assert dependences(drawn[0].definition) == ()


@settings(max_examples=8, deadline=None)
@given(mixed(conserved=1))
def test_what_is_conserved_is_found_and_a_state_of_it_named(drawn):
    model, shares = drawn
    (found,) = dependences(model.definition)
    assert len(found.finals) == 1
    # The state named takes part in what is conserved: without its condition the others are free.
    assert abs(shares[found.finals[0], 0]) > 1e-9
    with pytest.raises(InvalidData, match=f"final value of 'x\\[{found.finals[0]}\\]'"):
        _ = model.formulate("gauss").program


def test_boundary_constraints_that_follow_are_named():
    ocp = turn(both=False)
    phase = ocp.phase("second", time=(1, 2))
    x, u = phase.state("z", initial=0), phase.control("w")
    phase.dynamics({x: u})
    ocp.subject_to(phase.final(x), equals=1, name="there")
    ocp.subject_to(2 * phase.final(x), equals=2, name="there again")
    ocp.minimise(phase.integral(u**2))
    with pytest.raises(InvalidData, match=r"of phase 'second'.*boundary constraint 'there"):
        ct.solve(ocp)


# -- infeasible, and why -----------------------------------------------------------------------------


def test_too_far_for_the_time_is_locally_infeasible():
    answer = ct.solve(push(1.0), formulation_options=COARSE)
    assert answer.termination == "locally_infeasible"
    assert answer.plan is None and answer.primal_bound is None
    assert "violated most: dynamics of x" in answer.message
    assert "interval" in answer.message


@pytest.mark.slow
def test_the_infeasible_slew_is_locally_infeasible_in_the_papers_words():
    answer = ct.solve(ct.load("satellite-slew/infeasible"), time_limit=60)
    assert answer.termination == "locally_infeasible"
    assert "violated most: eq. 10, dynamics of q[1]" in answer.message


@pytest.mark.slow
def test_diagnose_says_why_the_infeasible_slew_is():
    found = ct.diagnose(ct.load("satellite-slew/infeasible"), time_limit=60)
    assert found.feasible is False
    # By the torque alone it takes 8.39 s at least, where 8 s are allowed.
    assert any("end time" in finding.text for finding in found.findings)


def given_way(model: Model[Any]) -> dict[str, float]:
    """Return what diagnose says must give, and by how much."""
    found = ct.diagnose(model)
    assert found.feasible is False
    return {str(one.data["block"]): float(one.data["by"]) for one in found.findings if one.data}


def test_diagnose_names_the_limit_the_time_and_the_end_with_what_each_lacks():
    # With |u| <= 1 a second is good for 1/4 m; 1 m takes 2 s, or |u| <= 4.
    gives = given_way(push(1.0))
    assert gives == pytest.approx({"final value of x": 0.75, "end time": 1.0, "u": 3.0}, rel=1e-3)
    # Up to 0.9 m/s at 8 m/s²: 0.9 (1 - 0.9/8) m. Where u gives, no strength is enough: not named.
    gives = given_way(push(8.0, speed=0.9))
    want = {
        "final value of x": 1 - 0.9 * (1 - 0.9 / 8),
        "end time": 1 / 0.9 + 0.9 / 8 - 1,
        "v": 4 - 2 * math.sqrt(2) - 0.9,
    }
    assert gives == pytest.approx(want, rel=0.02)


def test_diagnose_speaks_of_units_and_bounds():
    found = ct.diagnose(push(1.0, (0.5, 1.0)))
    text = str(found)
    assert "u: the limits -1 to 1 m/s² would have to give by 3 m/s²" in text
    assert "final value of x: the value 1 m would have to give by 0.75 m" in text
    assert "end time: the limits 0.5 to 1 s would have to give by 1 s" in text


@pytest.mark.parametrize("strength", [4.05, 10.0])
def test_diagnose_finds_a_motion_where_there_is_one(strength):
    found = ct.diagnose(push(strength))
    assert found.feasible is True
    assert found.findings == ()


def test_diagnose_without_time_settles_nothing():
    found = ct.diagnose(push(1.0), time_limit=1e-3)
    assert found.feasible is None
    assert "not settled" in found.summary


@pytest.mark.parametrize("backend", ["highs", "ipopt"])
def test_there_are_no_linear_rows_to_filter(backend):
    with pytest.raises(UnsupportedFormulation):
        ct.diagnose(push(1.0), backend)


# -- several starts ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def disc() -> OptimalControlProblem:
    return round_a_disc()


@pytest.fixture(scope="module")
def ways(disc) -> ct.Solution[ControlPlan]:
    return ct.solve(disc, tolerance=1e-3, formulation_options=COARSE, starts=3, seed=3)


def test_all_starts_are_kept_and_the_best_is_returned(ways):
    assert [one.seed for one in ways.starts] == [3, 4, 5]
    values = [one.primal_bound for one in ways.starts]
    assert ways.primal_bound == min(values)
    assert ways.seed == ways.starts[values.index(min(values))].seed
    assert ways.options["starts"] == 3
    # Each of them is a local optimum, one of the two there are.
    for value in values:
        assert min(abs(value - BELOW), abs(value - ABOVE)) <= 2e-3 * ABOVE
    assert all(one.verification.ok and one.termination == "locally_optimal" for one in ways.starts)
    data = json.loads(ways.to_json())
    assert [one["seed"] for one in data["starts"]] == [3, 4, 5]


def test_a_start_that_ends_at_the_worse_is_beaten_by_others(disc, ways):
    alone = ct.solve(disc, tolerance=1e-3, formulation_options=COARSE)
    assert alone.primal_bound == pytest.approx(ABOVE, rel=2e-3)  # where the guess leads
    assert ways.primal_bound == pytest.approx(BELOW, rel=2e-3)


def test_the_same_seed_gives_the_same_plan(disc, ways):
    again = ct.solve(disc, tolerance=1e-3, formulation_options=COARSE, seed=ways.seed)
    assert again.plan.to_data() == ways.plan.to_data()
    other = ct.solve(disc, tolerance=1e-3, formulation_options=COARSE, seed=ways.seed + 17)
    assert other.plan.to_data() != ways.plan.to_data()


def test_compare_notes_who_stopped_at_a_worse_point(disc, ways):
    options = {"tolerance": 1e-3, "formulation_options": COARSE, "time_limit": 60}
    worse = ct.compare(disc, ["ipopt:gauss"], **options)
    better = ct.compare(disc, ["ipopt:radau"], **options, seed=ways.seed)
    verdict = rejudged(disc, worse, better).verdicts[0]
    assert verdict.outcome == "INCONCLUSIVE"  # local searches prove nothing
    notes = [note for note in verdict.notes if "stopped at a worse point" in note]
    assert len(notes) == 1
    assert notes[0].startswith("ipopt:gauss: stopped at a worse point, 5.58")
    assert "19 % above 4.68" in notes[0] and notes[0].endswith("of ipopt:radau")
    assert verdict.best.backend == "ipopt" and verdict.best.formulation == "radau"


# -- one problem by several transcriptions and backends ----------------------------------------------


@pytest.mark.parametrize(
    ("name", "value", "formulations"),
    [
        (CURVE, FALL, ["gauss", "radau", "hermite-simpson"]),
        (BRYSON, 4.0, ["gauss", "radau", "hermite-simpson"]),
        pytest.param(CURVE, FALL, ["paper", "trapezoid"], marks=pytest.mark.slow),
    ],
)
def test_transcriptions_agree(name, value, formulations):
    backends = [f"ipopt:{formulation}" for formulation in formulations]
    found = ct.compare(ct.load(name), backends, time_limit=60, workers=2)
    assert [s.formulation for s in found.solutions] == formulations
    for solution in found.solutions:
        assert solution.termination == "locally_optimal", solution.message
        assert solution.verification.ok
        assert solution.primal_bound == pytest.approx(value, rel=1e-6)
    (verdict,) = found.verdicts
    assert verdict.outcome == "INCONCLUSIVE"
    assert "no exact bound" in verdict.evidence
    assert not any("worse" in note for note in verdict.notes)
    # Whatever hangs on a tolerance is said, by the name of the row.
    for note in verdict.notes:
        assert "within_tolerance only" in note and note.partition(":")[0] == "ipopt"


@pytest.mark.parametrize(
    ("names", "able"),
    [
        (("ipopt", "slsqp", "uno", "sqpmethod"), {"ipopt", "slsqp"}),
        pytest.param(
            ("blocksqp", "bonmin", "fatrop", "sleqp", "trust-constr"), {"trust-constr"},
            marks=pytest.mark.slow,
        ),
    ],
)  # fmt: skip
def test_backends_give_a_verified_motion_or_say_why_not(names, able):
    """The least effort from rest to rest costs 12, whoever finds it."""
    usable = [one.name for one in ct.backends() if one.name in names and one.state == "installed"]
    assert able <= set(usable)
    found = ct.compare(
        ct.load(ENERGY), usable, tolerance=1e-5, time_limit=30, workers=2,
        formulation_options={"intervals": 2, "degree": 4},
    )  # fmt: skip
    solved = []
    for solution in found.solutions:
        if solution.plan is None and solution.stored_plan is None:
            assert solution.message, solution.backend
            assert solution.primal_bound is None
        else:
            assert solution.verification.ok
            assert solution.primal_bound == pytest.approx(12.0, rel=1e-5), solution.backend
            solved.append(solution.backend)
    assert able <= set(solved)
    assert found.outcome == "INCONCLUSIVE"


@pytest.mark.parametrize("name", [ENERGY, BRYSON])
def test_the_papers_kind_of_solver_finds_the_least_effort(name):
    mesh = {"intervals": 2, "degree": 4, "refine": False}
    answer = ct.solve(
        ct.load(name), "sqpmethod", tolerance=1.0, formulation_options=mesh, time_limit=20
    )
    assert answer.termination == "locally_optimal", answer.message


def test_backends_name_themselves_when_they_fail():
    answer = ct.solve(push(1.0), "slsqp", formulation_options={"intervals": 1, "degree": 4})
    assert answer.plan is None
    assert answer.termination in ("locally_infeasible", "failed", "no_solution")
    assert "violated most" in answer.message


# -- plans from elsewhere ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def fastest() -> ct.Solution[ControlPlan]:
    return ct.solve(ct.load(CURVE))


@pytest.mark.parametrize("formulation", ["radau", "hermite-simpson", "paper"])
def test_the_plan_of_one_transcription_starts_another(fastest, formulation):
    answer = ct.solve(ct.load(CURVE), formulation=formulation, warm_start=fastest.plan)
    assert answer.termination == "locally_optimal", answer.message
    assert answer.formulation == formulation
    assert answer.primal_bound == pytest.approx(FALL, rel=1e-6)
    assert answer.options["warm_start"] is not None


def test_a_plan_that_is_good_enough_starts_the_next(disc, ways):
    answer = ct.solve(
        disc, formulation="radau", warm_start=ways, tolerance=1e-3, formulation_options=COARSE
    )
    assert answer.primal_bound == pytest.approx(BELOW, rel=2e-3)


def test_a_plan_of_another_problem_starts_nothing(fastest):
    with pytest.raises(InvalidData, match=r"phase 'phase 1'|states|warm_start"):
        ct.solve(ct.load(ENERGY), warm_start=fastest.plan)


@pytest.mark.parametrize("formulation", ["gauss", "radau"])
def test_rows_of_a_transcription_are_checked_beside_the_motion(fastest, formulation):
    model = ct.load(CURVE)
    found = ct.verify(model, fastest, tolerance=1e-4, formulation=formulation)
    assert found.ok, str(found)
    names = [check.name for check in found.checks]
    assert {"motion", "final values", "dynamics of x", "dynamics of v", "end time"} <= set(names)
    # The JSON data of the plan is the plan.
    assert ct.verify(model, fastest.plan.to_data()).objective == found.objective


def test_rows_of_a_transcription_find_what_was_changed(fastest):
    data = fastest.plan.to_data()
    data["phases"][0]["controls"]["values"][2][1][0] += 0.1
    found = ct.verify(ct.load(CURVE), data, tolerance=1e-4, formulation="gauss")
    wrong = {check.name for check in found.checks if not check.ok}
    assert {"motion", "dynamics of v"} <= wrong


@pytest.mark.slow
def test_rows_of_the_slew_are_those_of_what_it_comes_down_to():
    model = ct.load("satellite-slew/paper")
    answer = ct.solve(model, tolerance=1e-3, formulation_options={"intervals": 6, "degree": 4})
    found = ct.verify(model, answer, tolerance=1e-3, formulation="gauss")
    assert found.ok, str(found)
    assert "dynamics of q" in " ".join(check.name for check in found.checks)


def test_unknown_formulations_are_named(fastest):
    with pytest.raises(UnknownName, match=r"nonsense.*gauss"):
        ct.verify(ct.load(CURVE), fastest, formulation="nonsense")


# -- limits ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "backend"),
    [(BRYSON, "ipopt"), (BRYSON, "slsqp"), ("satellite-slew/paper", "ipopt")],
)
def test_no_time_is_a_limit_and_no_error(name, backend):
    answer = ct.solve(ct.load(name), backend, time_limit=1e-3)
    assert answer.limit == "time"
    assert answer.termination == "no_solution"
    assert answer.plan is None


def test_no_time_for_several_starts():
    answer = ct.solve(ct.load(BRYSON), time_limit=1e-3, starts=3)
    assert (answer.termination, answer.limit) == ("no_solution", "time")
    assert len(answer.starts) >= 1


def test_time_that_ends_between_starts_is_named(disc):
    answer = ct.solve(disc, tolerance=1e-3, formulation_options=COARSE, starts=1000, time_limit=1.5)
    assert len(answer.starts) < 1000
    assert answer.plan is not None
    assert answer.limit == "time"


def test_iterations_are_a_limit_too():
    answer = ct.solve(ct.load(CURVE), backend_options={"max_iter": 2})
    assert (answer.limit, answer.plan) == ("iterations", None)


#: Ctrl-C from within, at a moment that is known: no waiting, whatever the machine's load.
_INTERRUPT = """
import json, os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
import casadi
from crosstrack.models.optimal_control.transcription.base import Transcription
from crosstrack.__main__ import main

asked = Transcription.refined
count = 0

def refined(self, point, tolerance):
    global count
    count += 1
    finer = asked(self, point, tolerance)
    if {when}:
        os.kill(os.getpid(), signal.SIGINT)
    return finer

Transcription.refined = refined
main(sys.argv[1:])
"""


def interrupted(when: str, tmp_path: Path, *arguments: Any) -> tuple[int, dict[str, Any]]:
    """Run the command line with Ctrl-C when `when` holds; return the exit code and the JSON."""
    script = tmp_path / "interrupt.py"
    script.write_text(textwrap.dedent(_INTERRUPT.replace("{when}", when)))
    done = subprocess.run(
        [sys.executable, script, *map(str, arguments), "--json"],
        capture_output=True, text=True, timeout=240, check=False,
    )  # fmt: skip
    assert "Traceback" not in done.stderr, done.stderr
    return done.returncode, json.loads(done.stdout)


def test_ctrl_c_between_two_meshes_keeps_what_there_is(tmp_path):
    code, data = interrupted("finer is not None", tmp_path, "solve", BRYSON, "--tolerance", "1e-4")
    assert code == 130
    assert data["limit"] == "interrupted"
    # Whether or not the first mesh is good enough, what comes back is verified.
    assert (data["plan"] is None) is (data["termination"] == "rejected")
    assert data["plan"] is None or data["verification"]["ok"]


def test_ctrl_c_between_two_starts_ends_them_and_keeps_the_best(tmp_path):
    code, data = interrupted(
        "count == 2", tmp_path, "solve", ENERGY, "--starts", 6, "--formulation-option", "intervals=2"
    )  # fmt: skip
    assert len(data["starts"]) < 6
    assert data["plan"] is not None
    assert (code, data["limit"]) == (130, "interrupted")


# -- the command line --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def solved(tmp_path_factory) -> Path:
    path: Path = tmp_path_factory.mktemp("energy") / "solution.json"
    done = run("solve", ENERGY, "--json", "--output", path, "--plot", path.with_suffix(".png"))
    data = json.loads(done.stdout)
    assert json.loads(path.read_text()) == data
    return path


def test_solve_writes_its_answer_and_a_picture(solved):
    data = json.loads(solved.read_text())
    assert data["model"] == "optimal-control"
    assert data["instance"] == ENERGY
    assert (data["backend"], data["formulation"]) == ("ipopt", "gauss")
    assert (data["termination"], data["limit"]) == ("locally_optimal", None)
    assert data["primal_bound"] == pytest.approx(12.0)
    assert data["dual_bound"] is None and data["gap"] is None
    assert data["verification"]["ok"] is True
    assert set(data["plan"]) == {"phases", "parameters"}
    assert {"meshes", "intervals", "nodes", "columns"} <= set(data["statistics"])
    assert {"build", "solve", "decode", "verify", "total"} <= set(data["seconds"])
    assert solved.with_suffix(".png").stat().st_size > 10_000


def test_check_takes_what_solve_wrote_and_refuses_what_was_changed(solved, tmp_path):
    done = run("check", ENERGY, solved, "--formulation", "gauss", "--json")
    data = json.loads(done.stdout)["verification"]
    assert data["ok"] is True
    assert "dynamics of v" in [check["name"] for check in data["checks"]]
    plan = json.loads(solved.read_text())["plan"]
    plan["phases"][0]["controls"]["values"][3][0][0] += 0.5
    broken = tmp_path / "broken.json"
    broken.write_text(json.dumps(plan))
    data = json.loads(run("check", ENERGY, broken, "--json", code=6).stdout)["verification"]
    assert "motion" in [check["name"] for check in data["checks"] if not check["ok"]]


def test_export_writes_samples_and_no_pieces(solved, tmp_path):
    table = tmp_path / "samples.csv"
    run("export", ENERGY, solved, "--format", "samples", "--rate", 10, "--output", table)
    assert table.read_text().startswith("phase,t,x,v,u\n")
    rows = np.loadtxt(table, delimiter=",", skiprows=1)
    t = rows[:, 1]
    assert t == pytest.approx(np.linspace(0, 1, 11))
    want = np.stack([3 * t**2 - 2 * t**3, 6 * t - 6 * t**2, 6 - 12 * t], axis=1)
    assert rows[:, 2:] == pytest.approx(want, abs=1e-6)
    done = run(
        "export", ENERGY, solved, "--format", "poly7", "--output", tmp_path / "x.csv", code=2
    )
    assert "samples" in done.stderr
    assert not (tmp_path / "x.csv").exists()


def test_a_problem_of_ones_own_goes_through_its_file(tmp_path):
    from crosstrack.instances.storage import write_text

    path = tmp_path / "push.json"
    write_text(path, push(1.0).to_json())
    done = run("solve", path, "--formulation-option", "intervals=3", "--json", code=4)
    data = json.loads(done.stdout)
    assert data["termination"] == "locally_infeasible"
    assert data["plan"] is None and data["verification"] is None
    data = json.loads(run("diagnose", path, "--json", code=3).stdout)
    assert data["feasible"] is False
    assert {"text", "equation", "where", "block", "by", "unit"} <= set(data["findings"][0])
    assert {one["block"] for one in data["findings"]} == {"u", "end time", "final value of x"}


def test_dependent_equations_are_bad_data(tmp_path):
    from crosstrack.instances.storage import write_text

    path = tmp_path / "turn.json"
    write_text(path, turn().to_json())
    done = run("solve", path, "--json", code=2)
    error = json.loads(done.stdout)["error"]
    assert (error["type"], error["field"]) == ("InvalidData", "final")
    assert "dependent equations" in error["message"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["solve", "optimal-control/nope"], "unknown instance"),
        (["solve", BRYSON, "--formulation-option", "degree=0"], "'degree'"),
        (["solve", BRYSON, "--formulation-option", "dependent=maybe"], "'drop'"),
    ],
)  # fmt: skip
def test_bad_usage_is_2(arguments, words):
    done = run(*arguments, code=2)
    assert words in done.stderr
    assert done.stdout == "" and "Traceback" not in done.stderr


def test_compare_is_inconclusive_without_a_bound():
    done = run("compare", ENERGY, "--backends", "ipopt:gauss,ipopt:radau", "--json", code=4)
    data = json.loads(done.stdout)
    assert data["verdict"] == "INCONCLUSIVE"
    rows = data["instances"][0]["solutions"]
    assert [row["formulation"] for row in rows] == ["gauss", "radau"]
    assert all(row["termination"] == "locally_optimal" for row in rows)


def test_models_are_listed_as_data():
    found = {one["model"]: one for one in json.loads(run("models", "--json").stdout)}
    assert set(found["optimal-control"]["formulations"]) >= {"paper", "gauss", "radau"}


def test_a_table_has_the_unit_of_the_problem():
    found = ct.compare(push(10.0), ["ipopt"], formulation_options=COARSE)
    assert "property object" not in str(found)


def test_a_picture_holds_a_solution_to_its_own_tolerance(tmp_path):
    """What is valid as it was asked for is not drawn as invalid."""
    model = ct.load(CURVE)
    coarse = {"intervals": 2, "degree": 3, "refine": False}
    loose = ct.solve(model, formulation="radau", tolerance=1e-1, formulation_options=coarse)
    assert not ct.verify(model, loose.plan, tolerance=1e-6).ok

    def title(**options):
        figure = ct.plot(model, options.pop("plan", loose), **options)
        return " ".join(
            text.get_text() for text in figure.findobj(match=lambda a: hasattr(a, "get_text"))
        )

    assert "NOT VALID" not in title()
    assert "NOT VALID" in title(tolerance=1e-6)
    assert "NOT VALID" in title(plan=loose.plan)
