"""Errors between the points of the error estimate."""

import numpy as np
import pytest
from checked import phase_plan

from crosstrack.models import OptimalControlProblem
from crosstrack.models.optimal_control.transcription.report import examine

NOTHING = np.empty(0)


def test_sees_a_constraint_that_is_exceeded_between_the_points():
    ocp = OptimalControlProblem("touch")
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0)
    u = phase.control("u")
    phase.dynamics({x: u})
    phase.path(x, upper=1 - 1e-9, name="height")
    ocp.minimise(phase.end)
    # The estimate has no point at the peak in the middle.
    plan = phase_plan([0, 1], {"x": lambda t: 1 - 4 * (t - 0.5) ** 2}, {"u": lambda t: 4 - 8 * t})
    report = examine(ocp.definition.phases[0], plan, NOTHING)
    assert report.violations == pytest.approx([1e-9], rel=1e-5)
    below = phase_plan([0, 1], {"x": lambda t: 4 * (t - 0.5) ** 2 - 1}, {"u": lambda t: 8 * t - 4})
    assert examine(ocp.definition.phases[0], below, NOTHING).violations == [0.0]


@pytest.mark.parametrize("excess", [1e-3, 3e-3])
def test_sees_a_control_that_is_saturated_between_the_nodes(excess):
    ocp = OptimalControlProblem("clipped")
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0)
    u = phase.control("u", lower=-9, upper=1)
    phase.dynamics({x: u})
    ocp.minimise(phase.end)
    centre = 0.5 * (1 - np.cos(np.pi * 9 / 19))

    def control(t):
        return 1 + excess - 4 * (t - centre) ** 2

    def state(t):
        return (1 + excess) * t - 4 / 3 * ((t - centre) ** 3 + centre**3)

    plan = phase_plan(
        [0, 1], {"x": state}, {"u": control}, lower=np.array([-9.0]), upper=np.ones(1)
    )
    # At the nodes, the control is within its bounds.
    assert plan.controls.values[0].max() <= 1.0
    report = examine(ocp.definition.phases[0], plan, NOTHING)
    # The integral of the excess, relative to the size of the state.
    lost = 4 / 3 * excess * np.sqrt(excess / 4)
    assert report.errors[0] == pytest.approx(lost / report.sizes.states[0], rel=0.5)
    assert abs(report.places[0] - (2 * centre - 1)) < 0.1
