"""Pictures of slews, for valid and invalid plans."""

from types import SimpleNamespace

import numpy as np
import pytest
from carts import cruising, piecewise
from pictures import artists, heights, legend, panels

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedOption
from crosstrack.models import ControlPlan, PhasePlan, SatelliteSlew
from crosstrack.models.satellite_slew.dynamics import CONTROLS, STATES
from crosstrack.models.satellite_slew.flight import Tracking
from crosstrack.models.satellite_slew.plot import animate_slew
from crosstrack.models.satellite_slew.quaternions import rotation_about
from crosstrack.models.verification import Verification


def slewed(model, duration=10.0, swing=0.8):
    """A plan of the right shape that moves smoothly, and obeys no equation of motion."""

    def states(t):
        share = (1 - np.cos(np.pi * t / duration)) / 2
        q = rotation_about([1, 0, 0], share * np.pi / 4)
        bulge = swing * np.sin(np.pi * t / duration) ** 2
        rates = [0.12 * np.sin(np.pi * t / duration), 0 * t, 0 * t]
        return (*q.T, *rates, bulge, -0.5 * bulge, -bulge, 0.5 * bulge)

    def controls(t):
        return tuple(sign * 0.3 * np.sin(2 * np.pi * t / duration) for sign in (1, -1, -1, 1))

    knots = np.linspace(0, duration, 9)
    return ControlPlan(
        (PhasePlan("slew", piecewise(states, knots), piecewise(controls, knots), STATES, CONTROLS),)
    )


def flown(end=10.0, count=101):
    t = np.linspace(0, end, count)
    wave = 3e-4 * np.sin(t)
    cut = np.zeros(count - 1, bool)
    cut[10:20] = cut[-5:] = True
    return Tracking(
        times=t, attitudes=np.ones((count, 4)), rates=np.zeros((count, 3)),
        gimbals=np.zeros((count, 4)),
        quaternion_errors=np.column_stack([1 + 0 * t, wave, -wave, 0 * t]),
        rate_errors=np.column_stack([2 * wave, wave, 0 * t]),
        commanded=np.zeros((count - 1, 3)), applied=np.zeros((count - 1, 3)),
        gimbal_rates=np.zeros((count - 1, 4)), saturated=cut, measures=np.full(count, 0.7),
        verification=Verification(end, ()), breach=None,
    )  # fmt: skip


SLEW_PANELS = [
    "quaternion", "body rates", "gimbal angles", "gimbal rates", "singularity det(A Aᵀ)",
    "control torque",
]  # fmt: skip


def test_a_slew_in_the_papers_manner(tmp_path):
    model = SatelliteSlew(name="turn")
    plan = slewed(model)
    figure = ct.plot(model, plan)
    figure.savefig(tmp_path / "slew.png", dpi=50)
    drawn = panels(figure)
    assert list(drawn) == SLEW_PANELS
    assert [axes.get_ylabel().rpartition("\n")[2] for axes in figure.axes] == [
        "(–)", "(rad/s)", "(rad)", "(rad/s)", "(–)", "(N m)",
    ]  # fmt: skip
    assert heights(drawn["body rates"]) == [-0.125, 0.125]
    assert heights(drawn["gimbal rates"]) == [-1, 1]
    assert heights(drawn["control torque"]) == [-25, 25]
    assert heights(drawn["singularity det(A Aᵀ)"]) == [0.2]
    assert heights(drawn["quaternion"]) == heights(drawn["gimbal angles"]) == []
    (line,) = artists(drawn["gimbal angles"], "curve δ1")
    t, value = line.get_data()
    assert value == pytest.approx(plan["delta"](t)[:, 0], abs=1e-12)
    (line,) = artists(drawn["singularity det(A Aᵀ)"], "curve det(A Aᵀ)")
    assert (line.get_ydata() > 0).all()
    # The plan violates the equations of motion, and the title states it.
    assert figure.get_suptitle().startswith("turn  ·  45° about (1, 0, 0), J = ")
    assert "\nNOT VALID: " in figure.get_suptitle()


def test_a_margin_shows_both_limits():
    model = SatelliteSlew(margin=0.2)
    figure = ct.plot(model, slewed(model))
    drawn = panels(figure)
    assert heights(drawn["control torque"]) == [-20, 20]
    assert heights(drawn["control torque"], "limit, nothing in reserve") == [-25, 25]
    assert heights(drawn["gimbal rates"], "limit, nothing in reserve") == [-1, 1]
    assert heights(drawn["body rates"], "limit, nothing in reserve") == []
    assert "limit, nothing in reserve" in legend(figure)
    assert "20 % in reserve" in figure.get_suptitle()


def test_tracking_adds_the_errors():
    model = SatelliteSlew()
    figure = ct.plot(model, slewed(model), tracking=flown(end=12.0))
    drawn = panels(figure)
    assert list(drawn) == [
        *SLEW_PANELS[:3], "quaternion errors", *SLEW_PANELS[3:], "rate errors",
    ]  # fmt: skip
    assert heights(drawn["quaternion errors"], "kept by the paper's controller") == [-4e-4, 4e-4]
    assert heights(drawn["rate errors"], "kept by the paper's controller") == [-1e-3, 1e-3]
    assert artists(drawn["rate errors"], "forbidden") == []
    assert len(artists(drawn["rate errors"], "shade")) == 2
    assert {"saturated", "kept by the paper's controller"} <= set(legend(figure))
    (measure,) = artists(drawn["singularity det(A Aᵀ)"], "curve flown")
    assert set(measure.get_ydata()) == {0.7}
    # The hold after the end of the plan is visible.
    assert drawn["quaternion"].get_xlim()[1] > 12


def test_the_ways_of_the_axes(tmp_path):
    model = SatelliteSlew()
    figure = ct.plot(model, slewed(model), view="axis")
    figure.savefig(tmp_path / "axes.png", dpi=50)
    (axes,) = figure.axes
    assert axes.name == "3d"
    for k, name in enumerate("xyz"):
        (way,) = artists(axes, f"way {name}")
        places = np.array(way.get_data_3d()).T
        assert np.linalg.norm(places, axis=1) == pytest.approx(1)
        assert places[0] == pytest.approx(np.eye(3)[k])
    assert places[-1] == pytest.approx([0, -np.sin(np.pi / 4), np.cos(np.pi / 4)])
    # The turn is about x, whose way has no end of its own.
    assert [text.get_text() for text in axes.texts] == ["x", "y", "y'", "z", "z'"]
    assert len(artists(axes, "eigenaxis")) == 3
    bare = ct.plot(model, view="axis")
    assert artists(bare.axes[0], "way x") == []
    assert legend(bare) == ["begin", "end (')", "eigenaxis turn"]


def test_a_slew_without_a_plan_shows_the_guess():
    figure = ct.plot(SatelliteSlew())
    assert list(panels(figure)) == SLEW_PANELS
    assert legend(figure) == ["guess", "limit", "forbidden"]


@pytest.mark.filterwarnings("error")
def test_the_slew_moves(tmp_path):
    pytest.importorskip("PIL", reason="PIL is not installed")
    from PIL import Image

    model = SatelliteSlew(name="turn")
    animation = animate_slew(model, SimpleNamespace(plan=slewed(model)), frames=4, size=(3, 3))
    animation.save(tmp_path / "slew.gif", writer="pillow", dpi=50)
    with Image.open(tmp_path / "slew.gif") as image:
        assert image.n_frames == 4
        assert image.size == (150, 150)
    texts = [text.get_text() for text in animation._fig.texts]
    assert "t = 10.00 s of 10.00 s" in texts
    for options, field in (
        ({"frames": 1}, "frames"), ({"frames": 2.0}, "frames"), ({"interval": 0}, "interval"),
        ({"turn": np.inf}, "turn"), ({"size": 3}, "size"),
    ):  # fmt: skip
        with pytest.raises(UnsupportedOption, match=f"^{field} must be "):
            animate_slew(model, slewed(model), **options)


@pytest.mark.parametrize(
    ("options", "field", "message"),
    [
        ({"view": "side"}, "view", "'time' or 'axis', got 'side'"),
        ({"tracking": 3}, "tracking", "must be a Tracking, got 3"),
        ({"mesh": 1}, "mesh", "got 1"),
        ({"tolerance": -1}, "tolerance", "got -1"),
        ({"size": (0, 1)}, "size", "got"),
        ({"tracking": flown(), "view": "axis"}, "tracking", "over time"),
    ],
)
def test_values_that_no_slew_takes(options, field, message):
    model = SatelliteSlew()
    with pytest.raises(UnsupportedOption, match=f"^{field} .*{message}"):
        ct.plot(model, slewed(model), **options)


def test_what_a_slew_refuses():
    model = SatelliteSlew()
    with pytest.raises(UnsupportedOption, match="no option 'axes'; its options: view, tracking"):
        ct.plot(model, axes=(0, 1))
    with pytest.raises(UnsupportedOption, match="beside a plan"):
        ct.plot(model, tracking=flown())
    with pytest.raises(InvalidData, match="plan of a slew has the states"):
        ct.plot(model, cruising())
