"""The independent check of a slew."""

import json
from dataclasses import replace

import numpy as np
import pytest

from crosstrack.errors import InvalidData
from crosstrack.models import ControlPlan, PhasePlan, SatelliteSlew
from crosstrack.models.optimal_control.plan import Piecewise
from crosstrack.models.satellite_slew import model as slews
from crosstrack.models.satellite_slew.quaternions import (
    rotation_about,
)


def test_a_plan_is_verified_and_travels(steered):
    model = SatelliteSlew()
    found = model.verify(steered.plan)
    assert found.ok
    assert {check.equation for check in found.checks} == {"", "1", "3", "10", "13", "23"}
    assert len([c for c in found.checks if c.name.startswith(("initial", "final "))]) == 6
    again = model.plan_from_data(json.loads(json.dumps(model.plan_to_data(steered.plan))))
    assert model.verify(again).objective == found.objective
    # The cost by another quadrature.
    times = np.linspace(0, steered.plan.end, 200_001)
    speed = (0.1 * steered.plan["rate"](times) ** 2).sum(axis=1)
    assert found.objective == pytest.approx(np.trapezoid(1 + speed, times), rel=1e-6)


@pytest.mark.parametrize(
    ("change", "violated"),
    [
        ({"rate_limit": 0.07}, {"body rate limit"}),
        ({"gimbal_rate_limit": 0.5}, {"gimbal rate limit"}),
        ({"torque_limit": 5.0}, {"control torque limit"}),
        ({"singularity_limit": 0.6}, {"singularity measure"}),
        ({"time_range": (1.0, 9.0)}, {"start at 0, final time within its range"}),
        ({"time_range": (20.0, 60.0)}, {"start at 0, final time within its range"}),
        ({"margin": 0.3}, {"gimbal rate limit, 30 % in reserve"}),
        ({"final_attitude": rotation_about([1, 0, 0], 0.7)}, {"final attitude"}),
        ({"initial_attitude": rotation_about([1, 0, 0], 0.1)}, {"initial attitude"}),
        ({"final_gimbals": [0.3, -0.3, 0.3, -0.3]}, {"final gimbal angles"}),
        ({"momentum": 17.6}, {"body rates integrated anew", "total momentum"}),
        ({"inertia": [230, 188, 176]}, {"attitude integrated anew", "total momentum"}),
    ],
)
def test_each_violation_is_found(steered, change, violated):
    found = SatelliteSlew(**change).verify(steered.plan)
    assert not found.ok
    assert violated <= {check.name for check in found.violated}


def altered(plan, column, by, *, controls=False):
    """The plan with something added to one state, as a function of the place in the interval."""
    phase = plan.phases[0]
    part = phase.controls if controls else phase.states
    values = []
    for nodes, table in zip(part.nodes, part.values, strict=True):
        table = table.copy()
        table[:, column] += by(nodes)
        values.append(table)
    new = Piecewise(part.knots, part.nodes, tuple(values), part.lower, part.upper)
    states, rates = (phase.states, new) if controls else (new, phase.controls)
    return ControlPlan(
        (PhasePlan(phase.name, states, rates, phase.state_names, phase.control_names),)
    )


def test_states_that_do_not_follow_from_the_controls_are_found(steered):
    model = SatelliteSlew()
    off = altered(steered.plan, 5, lambda nodes: 1e-4 * (1 - nodes**2))
    names = {check.name for check in model.verify(off).violated}
    assert names == {"body rates integrated anew", "total momentum"}
    longer = altered(steered.plan, 0, lambda nodes: 1e-4 * (1 - nodes**2))
    names = {check.name for check in model.verify(longer).violated}
    assert {"norm of the quaternion", "attitude integrated anew"} <= names
    pushed = altered(steered.plan, 3, lambda nodes: 0.01 + 0 * nodes, controls=True)
    names = {check.name for check in model.verify(pushed).violated}
    assert "gimbal angles integrated anew" in names
    # What breaks the bounds between the nodes only is seen too.
    assert model.verify(off, tolerance=1e-2).ok


def test_the_other_sign_of_the_quaternion_is_the_same_attitude(steered):
    phase = steered.plan.phases[0]
    flip = np.array([-1.0] * 4 + [1.0] * 7)
    states = Piecewise(
        phase.states.knots, phase.states.nodes, tuple(flip * v for v in phase.states.values)
    )
    turned = ControlPlan((replace(phase, states=states),))
    assert SatelliteSlew().verify(turned).ok


def test_what_is_no_plan_of_a_slew_raises(steered):
    model = SatelliteSlew()
    with pytest.raises(InvalidData, match="must be a ControlPlan"):
        model.verify(3)
    phase = steered.plan.phases[0]
    with pytest.raises(InvalidData, match="has 1 phase, got 2"):
        model.verify(ControlPlan((phase, phase)))
    named = replace(phase, control_names=tuple("abcd"))
    with pytest.raises(InvalidData, match="has the controls rate"):
        model.verify(ControlPlan((named,)))


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
def test_a_limit_is_its_own_scale(steered, size):
    model = replace(SatelliteSlew(), rate_limit=size, torque_limit=size, gimbal_rate_limit=size)
    scales = {check.name: check for check in model.verify(steered.plan).checks}
    for name in ("body rate limit", "gimbal rate limit", "control torque limit"):
        assert scales[name].scale == scales[name].limit == size
        assert scales[name].tolerance == pytest.approx(1e-6 * size)
    assert scales["initial body rates"].scale == scales["body rates integrated anew"].scale == size


@pytest.mark.parametrize(("margin", "share"), [(0.0, 0.9), (0.25, 0.9), (0.25, 1.1)])
def test_the_reserve_is_taken_off_both_limits(steered, loads, margin, share):
    """The torque limit could be checked without its reserve, and no test noticed."""
    model = SatelliteSlew(**{k: x / (1 - margin) / share for k, x in loads.items()}, margin=margin)
    found = {c.name.partition(",")[0]: c for c in model.verify(steered.plan).checks}
    for field, largest in loads.items():
        check = found[LIMITED[field]]
        assert check.ok == (share < 1), (field, check)
        assert check.limit == pytest.approx(largest / share)


LIMITED = {"torque_limit": "control torque limit", "gimbal_rate_limit": "gimbal rate limit"}


@pytest.fixture(scope="module")
def loads(steered):
    """Return the largest torque and gimbal rate of a plan, by the field of their limit."""
    small = SatelliteSlew(**dict.fromkeys(LIMITED, 1e-3)).verify(steered.plan)
    found = {check.name: check.worst + 1e-3 for check in small.checks}
    return {field: found[name] for field, name in LIMITED.items()}


def test_a_plan_is_verified_once(steered, monkeypatch):
    seen, plain = [], slews.verify_slew
    monkeypatch.setattr(slews, "verify_slew", lambda *args: seen.append(args) or plain(*args))
    model = SatelliteSlew()
    found = model.verify(steered.plan)
    assert model.verify(model.plan_from_data(model.plan_to_data(steered.plan))) is found
    assert len(seen) == 1
    model.verify(steered.plan, tolerance=1e-5)
    SatelliteSlew().verify(steered.plan)
    assert len(seen) == 3
