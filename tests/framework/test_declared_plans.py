"""Plans are declared: compared by content, frozen, and written and read as JSON by one base."""

import json
import pickle
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from crosstrack.errors import InvalidData
from crosstrack.models import (
    ControlPlan,
    FleetPlan,
    GridPlan,
    GuidedPathTour,
    MissionPlan,
    Model,
    NavigationRuns,
    PhasePlan,
    Route,
    TourPlan,
    Trajectory,
)
from crosstrack.models.declaration import Declared, Plan
from crosstrack.models.fields import Array, declared
from crosstrack.models.optimal_control import Piecewise


def flight(x=1.0):
    return Trajectory([0, 1], [[[0, 0], [x, 0]]])


def course(x=1.0, costates=None):
    states = Piecewise([0, 1], ([-1, 1],), ([[0], [x]],), upper=[2])
    controls = Piecewise([0, 1], ([0],), ([[0]],))
    return ControlPlan((PhasePlan("go", states, controls, ["x"], ["u"], costates),), {"p": 2})


def tour(x=1.0):
    piece = {"leg": 0, "turn": "S", "length": x, "heading": 0}
    return TourPlan([0], [1], [[x, 0]], [0, 0, 0], [piece])


#: Functions of a number that return plans: equal numbers give equal plans.
PLANS = {
    "route": lambda x: Route([0, int(x)]),
    "fleet": lambda x: FleetPlan([[1, int(x)], []]),
    "grid": lambda x: GridPlan([[[0, 0], [x, 0]]]),
    "mission": lambda x: MissionPlan([[0], []], [flight(x), None], [[0.5], []]),
    "runs": lambda x: NavigationRuns(["R" * int(x)], ["reached"]),
    "tour": tour,
    "trajectory": flight,
    "control": course,
}


@pytest.mark.parametrize("name", PLANS)
def test_plans_are_compared_by_content(name):
    make = PLANS[name]
    plan, same, other = make(2.0), make(2.0), make(3.0)
    assert plan == same and hash(plan) == hash(same) and {plan: 1}[same] == 1
    assert plan != other and plan != plan.to_data()
    read = type(plan).from_data(json.loads(json.dumps(plan.to_data(), allow_nan=False)))
    assert read == plan and read.to_data() == plan.to_data()


@pytest.mark.parametrize("name", PLANS)
def test_pickled_plans_are_equal_and_frozen(name):
    plan = PLANS[name](2.0)
    again = pickle.loads(pickle.dumps(plan))
    assert again == plan
    values = [value for value in vars(again).values() if isinstance(value, np.ndarray)]
    values += list(getattr(again, "paths", ()))
    for array in values:
        with pytest.raises(ValueError, match="WRITEABLE"):
            array.flags.writeable = True


def test_functions_and_parameters_of_a_pickled_plan_are_frozen():
    again = pickle.loads(pickle.dumps(course(costates=Piecewise([0, 1], ([0],), ([[1]],)))))
    [phase] = again.phases
    parts = (phase.states, phase.controls, phase.costates)
    arrays = [array for part in parts for array in (part.knots, *part.nodes, *part.values)]
    for array in (*arrays, phase.states.upper, *again.parameters.values()):
        with pytest.raises(ValueError, match="WRITEABLE"):
            array.flags.writeable = True


def test_the_order_of_parameters_does_not_matter():
    phases = course().phases
    one, other = ControlPlan(phases, {"p": 1, "q": 2}), ControlPlan(phases, {"q": 2, "p": 1})
    assert one == other and hash(one) == hash(other)
    assert one != ControlPlan(phases, {"p": 2, "q": 1})


def test_costates_are_part_of_a_plan():
    costates = Piecewise([0, 1], ([-1, 1],), ([[0], [1]],))
    assert course(costates=costates) != course()


def test_a_model_without_a_declared_plan_defines_its_json():
    class Bare(Model):
        kind = "bare"
        plan_type: ClassVar[type] = dict

        def verify(self, plan, *, tolerance=1e-6):
            raise AssertionError

    with pytest.raises(InvalidData, match="plan must be a Plan, got 3"):
        Bare().plan_to_data(3)
    with pytest.raises(InvalidData, match=r"'bare' cannot read a plan: .* got dict"):
        Bare().plan_from_data({})
    assert issubclass(GuidedPathTour.plan_type, Plan)


@pytest.mark.parametrize("added", [False, True])
def test_a_hidden_array_may_have_a_default(added):
    @dataclass(frozen=True, eq=False)
    class Noted(Declared):
        notes: object = declared(Array(("n",)), hidden=True, added=added, default=np.zeros(3))

    full = {"notes": [1.0, 2.0]}
    assert Noted().data() == ({} if added else {"notes": [0.0, 0.0, 0.0]})
    assert Noted(np.ones(2) * [1, 2]).data() == full and Noted.from_data(full).data() == full
