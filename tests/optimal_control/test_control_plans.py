"""Plans of states and controls: functions of time, JSON and invalid data."""

import copy
import json

import numpy as np
import pytest
from control_declared import INF, NAN, rest_to_rest, two_phases

import crosstrack as ct
from crosstrack.errors import InvalidData, UnknownName
from crosstrack.models import ControlPlan, PhasePlan
from crosstrack.models.optimal_control.plan import Piecewise


def test_plans_are_functions_of_time(answer):
    plan = answer.plan
    assert plan["x"](0.25) == pytest.approx(0.15625, abs=1e-8)
    assert np.ndim(plan["x"](0.25)) == 0
    t = np.array([[0.0, 0.2], [0.7, 1.0]])
    assert plan["v"](t) == pytest.approx(6 * t - 6 * t**2, abs=1e-7)
    assert plan["x"](t, derivative=1) == pytest.approx(plan["v"](t), abs=1e-6)
    assert plan["x"](t, 2) == pytest.approx(6 - 12 * t, abs=1e-4)
    assert plan["u"](t) == pytest.approx(6 - 12 * t, abs=1e-6)
    assert plan.grid(3).tolist() == [0, 0.5, 1] and plan["x"]([]).shape == (0,)
    # Times beyond the ends are accepted within rounding only.
    assert plan["x"](1 + 1e-12) == plan["x"](1.0)


@pytest.mark.parametrize(
    ("ask", "error", "words"),
    [
        (lambda p: p["x"](1.1), InvalidData, ["t must lie in [0, 1]", "1.1"]),
        (lambda p: p["x"]([0.5, -0.2]), InvalidData, ["t must lie in [0, 1]", "-0.2"]),
        (lambda p: p["x"](NAN), InvalidData, ["t must lie in", "nan"]),
        (lambda p: p["x"]("noon"), InvalidData, ["t must be numbers", "'noon'"]),
        (lambda p: p["x"](0.5, -1), InvalidData, ["derivative must be >= 0", "-1"]),
        (lambda p: p["x"](0.5, 0.5), InvalidData, ["derivative must be a whole number", "0.5"]),
        (lambda p: p["y"], UnknownName, ["state or control", "'y'", "u, v, x"]),
        (lambda p: p["x[0]"], UnknownName, ["'x[0]'"]),
        (lambda p: p.phase("no"), UnknownName, ["phase", "'no'", "phase 1"]),
        (lambda p: ControlPlan(p.phases * 2)["x"], InvalidData, ["the plan has 2 phases", "ask one"]),
        (lambda p: ControlPlan(p.phases * 2).grid(), InvalidData, ["the plan has 2 phases"]),
        (lambda p: ControlPlan(()), InvalidData, ["phases", "1 PhasePlan at least"]),
        (lambda p: ControlPlan((3,)), InvalidData, ["phases[0] must be an object", "3"]),
        (lambda p: ControlPlan(p.phases, {"p": "a"}), InvalidData, ["parameters['p']", "a number", "'a'"]),
    ],
)  # fmt: skip
def test_plans_reject_unknown_names_and_times(answer, ask, error, words):
    with pytest.raises(error) as caught:
        ask(answer.plan)
    assert all(word in str(caught.value) for word in words), caught.value


def test_bounded_controls_saturate():
    part = Piecewise(
        [0.0, 1], (np.array([-1.0, 0, 1]),), (np.array([[0.0], [2], [0]]),), [0.0], [1.5]
    )
    assert part([0.5, 0.0]).ravel().tolist() == [1.5, 0]
    assert part(0.5, 1).tolist() == [0]  # the polynomial's own


def test_plans_in_json_are_exact(answer):
    ocp = rest_to_rest().ocp
    data = json.loads(json.dumps(ocp.plan_to_data(answer.plan), allow_nan=False))
    again = ocp.plan_from_data(data)
    t = np.linspace(0, 1, 50)
    for name in "xvu":
        assert (again[name](t) == answer.plan[name](t)).all()
    assert again.phases[0].costates is not None
    assert ocp.verify(again) == ocp.verify(answer.plan)
    assert ct.verify(ocp, data).ok
    assert ocp.plan_to_data(again) == data


def test_plans_with_parameters_and_phases_in_json():
    ocp, *_ = two_phases((0.2, 1.5))
    knots = np.array([0.0, 1])
    part = Piecewise(knots, (np.array([-1.0, 1]),), (np.zeros((2, 3)),))
    none = Piecewise(knots, (np.array([0.0]),), (np.zeros((1, 1)),), [-INF], [2.0])
    names = ("q[0]", "q[1]", "w")
    plan = ControlPlan(
        (PhasePlan("go", part, none, names, ("u",)), PhasePlan("stop", part, none, names, ("u",))),
        {"p": [1.0, 2.0], "r": 3.0},
    )
    again = ControlPlan.from_data(json.loads(json.dumps(plan.to_data(), allow_nan=False)))
    assert again.to_data() == plan.to_data()
    assert again.parameters["p"].tolist() == [1, 2] and again.parameters["r"].tolist() == [3]
    with pytest.raises(InvalidData, match="parameters of the plan must be"):
        ocp.verify(again)


def bad_plans():
    """Return changes of a plan's data, and the words of their error messages."""

    def put(*path):
        *inner, last, value = path

        def change(data):
            at = data
            for key in inner:
                at = at[key]
            if value is ...:
                del at[last]
            else:
                at[last] = value

        return change

    one = ("phases", 0)
    return [
        (put("phases", []), ["phases"]),
        (put("phases", 3), ["phases must be a list", "3"]),
        (put("phases", ...), ["key 'phases' is missing in the data of a plan"]),
        (put("parameters", [1]), ["parameters must be an object"]),
        (put("parameters", {"p": [1]}), ["parameters of the plan must be []", "'p'"]),
        (put(*one, "name", "b"), ["phases of the plan must be ['phase 1']", "'b'"]),
        (put(*one, "name", 3), ["name must be a string", "3"]),
        (put(*one, "knots", [0, 0, 0, 0]), ["knots must increase"]),
        (put(*one, "knots", ["a", "b"]), ["knots", "number", "'a'"]),
        (put(*one, "knots", [0, 1]), ["1 intervals need as many nodes"]),
        (put(*one, "state_names", 3), ["state_names must be a list", "3"]),
        (put(*one, "state_names", ["x"]), ["states has 2 columns for 1 names"]),
        (put(*one, "state_names", ["v", "x"]), ["state_names", "['x', 'v']", "['v', 'x']"]),
        (put(*one, "control_names", ["w"]), ["control_names", "['u']", "['w']"]),
        (put(*one, "states", 3), ["states must be an object"]),
        (put(*one, "states", "nodes", 3), ["nodes must be a list"]),
        (put(*one, "states", "nodes", 0, 0, -2), ["nodes[0]", ">= -1", "-2"]),
        (put(*one, "states", "values", 0, 0, 0, None), ["values[0][0, 0] must be a number", "None"]),
        (put(*one, "states", "values", 0, 0, 0, NAN), ["values[0]", "finite"]),
        (put(*one, "states", "values", 0, 0, 0, "1"), ["values[0][0, 0] must be a number", "'1'"]),
        (put(*one, "controls", "values", 0, [[1]]), ["values[0] has 1 entries"]),
        (put(*one, "extra", 1), ["a phase of a plan has the keys"]),
    ]  # fmt: skip


@pytest.mark.parametrize(("change", "words"), bad_plans())
def test_rejects_invalid_plan_data(answer, change, words):
    ocp = rest_to_rest().ocp
    data = copy.deepcopy(ocp.plan_to_data(answer.plan))
    change(data)
    with pytest.raises(InvalidData) as caught:
        ct.verify(ocp, data)
    assert all(word in str(caught.value) for word in words), caught.value


@pytest.mark.parametrize("plan", [3, "plan", None, np.zeros(3), {"phases": None}, []])
def test_verify_rejects_values_that_are_not_plans(plan):
    with pytest.raises(InvalidData):
        ct.verify(rest_to_rest().ocp, plan)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_many_points_of_an_interval_have_the_values_of_few(order):
    rng = np.random.default_rng(order)
    nodes = ([-1, 0.2, 1], [-0.5, 0, 0.4, 0.9], [-1, 0.2, 1])
    values = tuple(rng.normal(size=(len(positions), 2)) for positions in nodes)
    functions = Piecewise([0, 1, 3, 4], nodes, values, upper=[1.0, 1.0])
    times = np.concatenate([rng.uniform(0, 4, 2000), [0.5]])
    each = [functions(t, order) for t in times]
    np.testing.assert_allclose(functions(times, order), each, rtol=1e-12, atol=1e-12)


def test_a_derivative_that_overflows_leaves_other_intervals_alone():
    nodes = ([-1, 0, 1], [-1, 0, 1])
    functions = Piecewise([0, 1e-10, 1], nodes, ([[0], [1e300], [0]], [[0], [1], [2]]))
    with np.errstate(all="ignore"):
        assert functions(0.5, 1) == pytest.approx([2.0], rel=1e-9)
        assert not np.isfinite(functions(5e-11, 1)).any()
