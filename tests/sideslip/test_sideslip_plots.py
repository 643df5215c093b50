"""Plots of sideslip estimates: the drawn data equals that of model and plans."""

import dataclasses

import numpy as np
import pytest
from pictures import artists, legend, panels, render
from sideslip.drives import estimate, kinematic

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedOption
from crosstrack.models.sideslip import Recording

MEASURED = ["yaw rate", "lateral acceleration", "steering", "speed"]


def line(axes, name):
    (found,) = artists(axes, f"curve {name}")
    return found.get_xdata(), found.get_ydata()


def band(axes):
    """Return the lower and the upper edge of the band from the vertices of its path."""
    (found,) = artists(axes, "band")
    return [corners for path in found.get_paths() for corners in path.vertices.tolist()]


def test_angle_error_and_measurements(tmp_path):
    model = kinematic()
    plan = estimate(model.truth + 0.01, 0.004)
    figure = ct.plot(model, plan)
    figure.savefig(tmp_path / "estimate.png", dpi=40)
    shown = panels(figure)
    assert list(shown) == ["sideslip angle", "error", *MEASURED]
    times, angle = line(shown["sideslip angle"], "estimate")
    assert times == pytest.approx(model.recording.times)
    assert angle == pytest.approx(np.degrees(plan.sideslip))
    assert line(shown["sideslip angle"], "truth")[1] == pytest.approx(np.degrees(model.truth))
    assert line(shown["error"], "estimate")[1] == pytest.approx(np.degrees(0.01))
    heights = {round(y, 6) for _, y in band(shown["error"])}
    assert heights == {round(sign * 2 * np.degrees(0.004), 6) for sign in (-1, 1)}
    highest = max(y for _, y in band(shown["sideslip angle"]))
    assert highest == pytest.approx(np.degrees(plan.sideslip.max() + 0.008))
    recording = model.recording
    for name, values in (
        ("yaw rate", np.degrees(recording.yaw_rate)),
        ("lateral acceleration", recording.lateral_acceleration),
        ("steering", np.degrees(recording.steering)),
        ("speed", recording.speed),
    ):
        assert line(shown[name], name)[1] == pytest.approx(values)
    assert figure.get_suptitle() == "formula  ·  10 s, mean error 0.573°, 0 % within 2 deviations"
    assert legend(figure) == ["estimate", "truth", "± 2 deviations"]


def test_others_are_named_with_their_errors():
    model = kinematic()
    good = estimate(model.truth)
    others = {
        "off": model.plan_to_data(estimate(model.truth - 0.02)),
        "mad": estimate(np.full(201, 2.0)),
    }
    figure = render(ct.plot(model, good, others=others))
    words = ["estimate, 0°", "off, 1.15°", "mad, 115°, NOT VALID", "truth", "± 2 deviations"]
    assert [one.split(",")[0] for one in legend(figure)] == [one.split(",")[0] for one in words]
    assert legend(figure)[:2] == words[:2]
    assert legend(figure)[2].endswith("NOT VALID")
    assert "NOT VALID" not in figure.get_suptitle()
    errors = panels(figure)["error"]
    assert line(errors, "off, 1.15°")[1] == pytest.approx(np.degrees(-0.02))
    # The first estimate has the same colour with and without others.
    alone = render(ct.plot(model, others=others))
    assert legend(alone)[0] == "off, 1.15°"
    assert not artists(panels(alone)["error"], "band")


def test_what_is_no_angle_is_said_in_red():
    model = kinematic()
    for angle in (1.6, 1e300):
        figure = render(ct.plot(model, estimate(np.full(201, angle), 1e300)))
        assert "NOT VALID: angle is below 90°" in figure.get_suptitle()
        assert figure._suptitle.get_color() == "#C8102E"


def test_without_plan_or_truth_the_rest_is_drawn():
    model = kinematic()
    plan = estimate(model.truth + 0.3)
    assert list(panels(render(ct.plot(model)))) == ["sideslip angle", *MEASURED]
    alone = dataclasses.replace(model, truth=None)
    # A constant error has no effect on kinematics. The rest is the error of the trapezoidal rule.
    value = alone.verify(plan).objective
    assert value < 1e-3
    for unknown in (alone, model.blinded()):
        figure = render(ct.plot(unknown, plan, others={"same": plan}))
        assert list(panels(figure)) == ["sideslip angle", *MEASURED]
        told = f"changes in a second off by {value:.3g}°"
        assert figure.get_suptitle() == f"formula  ·  10 s, {told}"
        assert "truth" not in legend(figure)
        empty = render(ct.plot(unknown))
        assert list(panels(empty)) == MEASURED
        assert not legend(empty)
    assert "two" in render(ct.plot(model.blinded(), plan, title="two")).get_suptitle()


def test_standstill_is_shaded_and_has_no_angle():
    speed = np.full(201, 20.0)
    speed[40:80], speed[190:] = 0.5, 0.0
    model = kinematic(speed=speed)
    wide = np.where(model.recording.moving, 0.001, 0.9)
    shown = panels(render(ct.plot(model, estimate(model.truth, wide))))
    for axes in shown.values():
        stretches = [(one.get_x(), one.get_x() + one.get_width()) for one in artists(axes, "shade")]
        assert stretches == [pytest.approx((2.0, 4.0)), pytest.approx((9.5, 10.0))]
    angle = line(shown["sideslip angle"], "estimate")[1]
    assert np.isnan(angle).tolist() == (speed < 1).tolist()
    assert max(shown["error"].get_ylim()) < 1.0
    assert max(shown["sideslip angle"].get_ylim()) < 3.0
    assert "below 1 m/s, no meaning" in legend(ct.plot(model))


def test_long_recordings_keep_their_extremes():
    n = 200_000
    speed = np.full(n, 20.0)
    speed[n // 2 : n // 2 + 1_000] = 0.0
    speed[::1000] = 0.0  # halts of one sample, which are not shown
    model = kinematic(n, speed=speed)
    angles = model.truth.copy()
    angles[23_457], angles[177_777] = 0.7, -0.6
    figure = render(ct.plot(model, estimate(angles, 0.01)))
    shown = panels(figure)
    times, angle = line(shown["sideslip angle"], "estimate")
    assert times.size <= 3000
    assert np.nanmax(angle) == pytest.approx(np.degrees(0.7))
    assert np.nanmin(angle) == pytest.approx(np.degrees(-0.6))
    assert times[np.nanargmax(angle)] == pytest.approx(23_457 * 0.05, abs=0.05 * n / 1500)
    (stretch,) = artists(shown["speed"], "shade")
    assert stretch.get_x() == pytest.approx(0.05 * n / 2, abs=0.05 * n / 1500)
    assert (np.diff(times) >= 0).all()


@pytest.mark.parametrize(
    ("n", "period", "speed", "deviation"),
    [
        (10, 1e-9, 20.0, 0.0),
        pytest.param(10, 2.0, 1.0, 1.0, marks=pytest.mark.slow),
        (50, 0.05, [20.0] + [0.0] * 49, 1e-9),
        pytest.param(50, 0.05, [0.0, 1.0] * 25, 0.5, marks=pytest.mark.slow),
        (3001, 0.01, 1000.0, 1e6),
    ],
)
@pytest.mark.filterwarnings("error")
def test_strange_drives_are_drawn(n, period, speed, deviation):
    model = kinematic(n, period, np.array(speed))
    for one, size in ((model, (2.5, 2.5)), (model.blinded(), (12, 3))):
        figure = render(ct.plot(one, estimate(np.zeros(n), deviation), size=size))
        assert all(np.isfinite(axes.get_ylim()).all() for axes in figure.axes)


@pytest.mark.filterwarnings("error")
def test_a_constant_record_is_drawn():
    nothing = np.zeros(20)
    still = Recording(np.arange(20), np.ones(20), nothing, nothing, nothing)
    model = dataclasses.replace(kinematic(20), recording=still, truth=np.zeros(20))
    shown = panels(render(ct.plot(model, estimate(np.zeros(20), 0.0))))
    assert line(shown["error"], "estimate")[1].tolist() == [0.0] * 20


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"others": [1]}, "others must be at most 5 plans by their names"),
        ({"others": {str(k): None for k in range(6)}}, "others must be at most 5"),
        ({"tolerance": 0}, "tolerance must"),
        ({"size": "big"}, "size must be"),
        ({"zoom": True}, "no option 'zoom'"),
    ],
)
def test_values_that_the_picture_does_not_take(options, message):
    model = kinematic()
    with pytest.raises(UnsupportedOption, match=message):
        ct.plot(model, estimate(model.truth), **options)


def test_plans_of_another_drive_are_refused():
    model = kinematic()
    for one in (model, model.blinded()):
        with pytest.raises(
            InvalidData, match="sideslip must have 201 entries, one per sample, got 7"
        ):
            ct.plot(one, estimate(np.zeros(7)))
        with pytest.raises(InvalidData, match="got 8"):
            ct.plot(one, others={"short": estimate(np.zeros(8))})
