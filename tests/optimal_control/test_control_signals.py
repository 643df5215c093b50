"""Outputs and path constraints by name, and simulations of a plan under disturbances."""

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import InvalidData, UnknownName
from crosstrack.instances.optimal_control.tables import write_control_samples
from crosstrack.models import OptimalControlProblem
from crosstrack.models.optimal_control import ControlPlan


def mover(*, shown=True):
    ocp = OptimalControlProblem("mover")
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=0)
    v = phase.state("v", initial=1, final=-1)
    u = phase.control("u")
    phase.dynamics({x: v, v: u})
    phase.path(x, upper=0.2, name="height", unit="m")
    if shown:
        phase.output("power", u * v, unit="W")
    ocp.minimise(phase.integral(u**2 / 2))
    return ocp.build()


@pytest.fixture(scope="module")
def solved():
    model = mover()
    return model, ct.solve(model, seed=0).plan


def test_outputs_and_paths_by_name(solved):
    _, plan = solved
    t = np.linspace(0, 1, 7).reshape(7, 1)
    assert plan["power"](t).shape == (7, 1)
    np.testing.assert_allclose(plan["power"](t), plan["u"](t) * plan["v"](t), rtol=1e-14)
    assert plan["height"](0.5) == plan["x"](0.5)
    with pytest.raises(UnknownName, match="height, power"):
        plan["nothing"]
    with pytest.raises(InvalidData, match="derivative"):
        plan["power"](t, 1)


def test_attach_restores_the_outputs_of_a_stored_plan(solved):
    model, plan = solved
    bare = ControlPlan.from_data(plan.to_data())
    with pytest.raises(UnknownName, match=r"model\.attach\(plan\)"):
        bare["power"]
    again = model.plan_from_data(model.plan_to_data(plan))
    assert again["power"](0.3) == plan["power"](0.3)


def test_outputs_are_stored_and_change_no_other_digest(solved):
    model, plan = solved
    read = OptimalControlProblem.from_data(model.data())
    assert read.digest == model.digest != mover(shown=False).digest
    assert read.attach(plan)["power"](0.2) == plan["power"](0.2)
    assert "outputs" not in mover(shown=False).definition.phases[0].data()


def test_output_rejects_a_taken_name():
    phase = OptimalControlProblem("named").phase(time=(0, 1))
    x = phase.state("x")
    with pytest.raises(InvalidData, match="'x'"):
        phase.output("x", 2 * x)


def test_signals_are_exported_and_drawn(solved, tmp_path):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    model, plan = solved
    rows = write_control_samples(plan, tmp_path / "plan.csv", rate=4).read_text().splitlines()
    assert rows[0] == "phase,t,x,v,u,height (m),power (W)"
    assert float(rows[1].split(",")[-1]) == plan["power"](0.0)
    titles = " ".join(one.get_ylabel() + one.get_title() for one in ct.plot(model, plan).axes)
    assert "power" in titles
    assert "height" in titles


def test_undisturbed_flight_is_the_plan(solved):
    flight = solved[1].simulate()
    assert np.abs(flight.deviation).max() < 1e-7
    assert flight.breach is None
    assert not flight.failure


def test_disturbed_flight_in_closed_form(solved):
    # A constant acceleration d and an offset e of the start: x deviates by e + d t² / 2.
    flight = solved[1].simulate(disturbance=[0.0, 0.3], initial={"x": 0.01})
    t = flight.times
    expected = np.stack([0.01 + 0.15 * t**2, 0.3 * t], axis=1)
    np.testing.assert_allclose(flight.deviation, expected, atol=1e-7)
    assert flight.breach.name == "height"
    assert flight.breach.limit == 0.2
    # Before the breach, the motion x(t) = 4 parabolas apart, keeps its limit.
    before = t < flight.breach.time - 1e-9
    assert (flight.observed["height"][before] <= 0.2 * (1 + 2e-6)).all()


def test_feedback_returns_to_the_plan(solved):
    def law(t, x, plan):
        return plan.controls(t) - np.array([100.0, 20.0]) @ (x - plan.states(t))

    plan = solved[1]
    still = plan.simulate(initial=[0.05, 1.0], feedback=law)
    # A double pole at -10: e(t) = (1 + 10 t) exp(-10 t) of the first error.
    t = still.times
    np.testing.assert_allclose(
        still.deviation[:, 0], 0.05 * (1 + 10 * t) * np.exp(-10 * t), atol=1e-6
    )


@pytest.mark.parametrize(
    "options", [{"initial": [1.0]}, {"disturbance": [1.0, np.nan]}, {"initial": {"y": 1.0}}]
)
def test_simulate_rejects_bad_arguments(solved, options):
    with pytest.raises(InvalidData):
        solved[1].simulate(**options)
