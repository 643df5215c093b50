"""The pictures of optimal controls and of slews: what is drawn, for plans valid or not."""

import itertools
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedOption
from crosstrack.models import ControlPlan, OptimalControlProblem, PhasePlan, SatelliteSlew
from crosstrack.models.optimal_control.plan import Piecewise
from crosstrack.models.satellite_slew.dynamics import CONTROLS, STATES
from crosstrack.models.satellite_slew.plot import animate_slew
from crosstrack.models.satellite_slew.quaternions import rotation_about
from crosstrack.models.satellite_slew.tracking import Tracking

RED = "#C8102E"
NODES = np.array([-1.0, -0.5, 0.5, 1.0])


def piecewise(function, knots, low=None, high=None):
    """Return a function of time (columns) as cubics between the knots."""
    knots = np.asarray(knots, float)
    at = [a + (NODES + 1) * (b - a) / 2 for a, b in itertools.pairwise(knots)]
    values = tuple(np.column_stack(function(t)) for t in at)
    return Piecewise(knots, (NODES,) * len(at), values, low, high)


def braking(name="braking", bound=np.inf, push=6.0, **more):
    """A cart that goes to and fro: x'' = u."""
    problem = OptimalControlProblem(name)
    phase = problem.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=0, upper=bound, unit="m")
    v = phase.state("v", initial=1, final=-1, unit="m/s")
    u = phase.control("u", lower=-push, upper=push, unit="m/s^2")
    phase.dynamics({x: v, v: u})
    for label, options in more.items():
        phase.path(x + v, name=label.replace("_", " "), **options)
    problem.minimise(phase.integral(u**2), unit="m²/s³")
    return problem


def cruising(knots=(0, 0.5, 1), costates=False, force=-2.0):
    """The exact motion of `braking` under a constant force."""
    states = piecewise(lambda t: (t + force * t**2 / 2, 1 + force * t), knots)
    controls = piecewise(lambda t: (np.full(t.size, force),), knots)
    multipliers = piecewise(lambda t: (0 * t, 4 + 0 * t), knots) if costates else None
    return ControlPlan((PhasePlan("phase 1", states, controls, ("x", "v"), ("u",), multipliers),))


def relay():
    """Two phases that follow one another, with a vector and a state that only one has."""
    problem = OptimalControlProblem("relay")
    first, second = problem.phase("go", time=(0, 1)), problem.phase("stay", time=(1, 3), unit="s")
    r = first.state("r", 2, upper=[1.5, np.inf])
    w = first.control("w", 2, lower=-1, upper=1)
    first.dynamics({r: w})
    r2, extra = second.state("r", 2), second.state("fuel", lower=0)
    second.dynamics({r2: [0.0, 0.0], extra: -0.1})
    problem.link(first, second, "r")
    problem.minimise(first.integral(w[0] ** 2 + w[1] ** 2))
    return problem


def relayed():
    go = PhasePlan(
        "go", piecewise(lambda t: (t, 2 * t), (0, 0.3, 1)),
        piecewise(lambda t: (1 + 0 * t, 2 + 0 * t), (0, 0.3, 1), [-1, -1], [1, 1]),
        ("r[0]", "r[1]"), ("w[0]", "w[1]"),
    )  # fmt: skip
    none = Piecewise(np.array([1.0, 3.0]), (NODES,), (np.zeros((4, 0)),))
    stay = PhasePlan(
        "stay", piecewise(lambda t: (1 + 0 * t, 2 + 0 * t, 1 - 0.1 * t), (1, 3)), none,
        ("r[0]", "r[1]", "fuel"), (),
    )  # fmt: skip
    return ControlPlan((go, stay))


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
        gimbal_rates=np.zeros((count - 1, 4)), saturated=cut, measures=np.ones(count),
    )  # fmt: skip


def panels(figure):
    """Return the axes by the first words of their label."""
    return {axes.get_ylabel().split("\n(")[0].replace("\n", " "): axes for axes in figure.axes}


def artists(axes, gid):
    return [one for one in (*axes.lines, *axes.collections, *axes.patches) if one.get_gid() == gid]


def heights(axes, gid="limit"):
    return sorted({float(y) for line in artists(axes, gid) for y in line.get_ydata()})


def legend(figure):
    return [text.get_text() for found in figure.legends for text in found.get_texts()]


# -- any optimal control -------------------------------------------------------------------------


def test_a_panel_a_state_and_a_control(tmp_path):
    model, plan = braking(bound=0.3), cruising()
    figure = ct.plot(model, plan)
    figure.savefig(tmp_path / "control.png")
    assert list(panels(figure)) == ["x", "v", "u"]
    assert [axes.get_ylabel() for axes in figure.axes] == ["x\n(m)", "v\n(m/s)", "u\n(m/s²)"]
    assert [axes.get_xlabel() for axes in figure.axes] == ["", "", "time (s)"]
    assert figure.get_suptitle() == "braking  ·  objective = 4 m²/s³, 1 s"
    for name, axes in panels(figure).items():
        (line,) = artists(axes, f"curve {name}")
        t, value = line.get_data()
        assert t.size > 200
        assert value == pytest.approx(plan[name](t), abs=1e-12)
    # Nodes are dots, and knots ticks at the foot.
    (dots,) = artists(panels(figure)["x"], "node")
    assert dots.get_xdata().size == 2 * NODES.size
    (ticks,) = artists(panels(figure)["v"], "knot")
    assert ticks.get_xdata().tolist() == [0, 0.5, 1]
    assert legend(figure) == ["limit", "node", "knot of the mesh"]


def test_limits_stand_at_their_height():
    drawn = panels(ct.plot(braking(bound=0.3, push=4.0), cruising()))
    assert heights(drawn["x"]) == [0.3]
    assert heights(drawn["v"]) == []
    assert len(artists(drawn["x"], "forbidden")) == 1
    # What is far away is told, so that the curve can still be seen.
    assert heights(drawn["u"]) == [-4]
    assert drawn["u"].get_title(loc="left") == "≤ 4"
    assert drawn["x"].get_title(loc="left") == ""


def test_path_constraints_have_panels():
    model = braking(upper_sum={"lower": 0.2, "upper": 1.2}, level={"equals": 0.5, "unit": "m"})
    drawn = panels(ct.plot(model, cruising()))
    assert list(drawn) == ["x", "v", "u", "upper sum", "level"]
    assert heights(drawn["upper sum"]) == [0.2, 1.2]
    # An equation forbids all but itself, which no shade can show.
    assert heights(drawn["level"]) == [0.5]
    assert artists(drawn["level"], "forbidden") == []
    assert list(panels(ct.plot(model, cruising(), paths=False))) == ["x", "v", "u"]
    chosen = ct.plot(model, cruising(), only=("level", "u"))
    assert list(panels(chosen)) == ["level", "u"]


def test_vectors_have_one_panel_and_phases_share_it():
    figure = ct.plot(relay(), relayed())
    drawn = panels(figure)
    assert list(drawn) == ["r", "fuel", "w"]
    lines = [*artists(drawn["r"], "curve r[0]"), *artists(drawn["r"], "curve r[1]")]
    assert len(lines) == 4
    assert len({line.get_color() for line in lines}) == 2
    assert [text.get_text() for text in drawn["r"].get_legend().get_texts()] == ["r[0]", "r[1]"]
    # A bound of one entry alone has its colour, and shades nothing.
    (limit,) = artists(drawn["r"], "limit")
    assert limit.get_color() == artists(drawn["r"], "curve r[0]")[0].get_color()
    assert [list(part) for part in limit.get_data()] == [[0, 1], [1.5, 1.5]]
    assert artists(drawn["r"], "forbidden") == []
    (band,) = artists(drawn["r"], "phase")
    assert (band.get_x(), band.get_width()) == (1, 2)
    assert [text.get_text() for text in drawn["r"].texts] == ["go", "stay"]
    assert drawn["fuel"].get_xlim() == drawn["w"].get_xlim()


def test_phases_at_the_same_time_are_not_shaded():
    problem = OptimalControlProblem()
    for name in ("one", "two"):
        phase = problem.phase(name, time=(0, 1))
        phase.dynamics({phase.state("y"): 0.0})
    problem.minimise(phase.final(phase.symbols["y"]))
    none = Piecewise(np.array([0.0, 1.0]), (NODES,), (np.zeros((4, 0)),))
    flat = piecewise(lambda t: (0 * t,), (0, 1))
    plan = ControlPlan(tuple(PhasePlan(name, flat, none, ("y",), ()) for name in ("one", "two")))
    figure = ct.plot(problem, plan)
    figure.canvas.draw()
    assert artists(panels(figure)["y"], "phase") == []


def test_the_worst_violation_is_ringed():
    plan = cruising()
    figure = ct.plot(braking(bound=0.2), plan)
    assert figure.get_suptitle().endswith("\nNOT VALID: bounds of states")
    assert figure._suptitle.get_color() == RED
    (ring,) = artists(panels(figure)["x"], "violation")
    assert ring.get_xdata()[0] == pytest.approx(0.5)
    assert ring.get_ydata()[0] == pytest.approx(0.25)
    assert "worst violation" in legend(figure)
    # A tolerance that accepts it rings nothing.
    lenient = ct.plot(braking(bound=0.2), plan, tolerance=0.1)
    assert "NOT VALID" not in lenient.get_suptitle()
    assert artists(panels(lenient)["x"], "violation") == []


def test_costates_and_deviation():
    model = braking()
    figure = ct.plot(model, cruising(costates=True), costates=True, deviation=True)
    drawn = panels(figure)
    assert list(drawn) == ["x", "v", "u", "costate λ of x", "costate λ of v", "deviation"]
    (line,) = artists(drawn["costate λ of v"], "curve v")
    assert line.get_ydata() == pytest.approx(4)
    assert drawn["deviation"].get_yscale() == "log"
    assert heights(drawn["deviation"]) == [1e-6]
    off = ControlPlan(
        (
            PhasePlan(
                "phase 1", cruising().phases[0].states, cruising(force=-2.1).phases[0].controls,
                ("x", "v"), ("u",),
            ),
        )
    )  # fmt: skip
    drawn = panels(ct.plot(model, off, deviation=True))
    (line,) = artists(drawn["deviation"], "curve v")
    assert line.get_ydata()[-1] == pytest.approx(0.1, rel=1e-6)
    with pytest.raises(InvalidData, match="no costates in phase 'phase 1'"):
        ct.plot(model, cruising(), costates=True)


def test_without_a_plan_the_guess_is_drawn():
    model = braking(level={"equals": 0.5})
    figure = ct.plot(model)
    figure.canvas.draw()
    assert list(panels(figure)) == ["x", "v", "u"]
    assert figure.get_suptitle() == "braking  ·  guess, 1 s"
    assert legend(figure) == ["guess", "limit"]
    (line,) = artists(panels(figure)["v"], "curve v")
    assert line.get_ydata()[[0, -1]].tolist() == [1, -1]
    with pytest.raises(InvalidData, match="there is none"):
        ct.plot(model, deviation=True)


def test_many_intervals_have_neither_dots_nor_ticks():
    figure = ct.plot(braking(), cruising(knots=np.linspace(0, 1, 400)))
    assert legend(figure) == ["limit"]
    plain = ct.plot(braking(), cruising(), mesh=False)
    assert legend(plain) == ["limit"]


def test_wild_and_still_plans_draw():
    model = braking(bound=0.3)
    still = ControlPlan(
        (
            PhasePlan(
                "phase 1", piecewise(lambda t: (0 * t, 0 * t), (0, 1)),
                piecewise(lambda t: (0 * t,), (0, 1)), ("x", "v"), ("u",),
            ),
        )
    )  # fmt: skip
    for plan in (still, cruising(force=1e12), cruising(force=1e-12)):
        ct.plot(model, plan, deviation=True).canvas.draw()


@pytest.mark.parametrize(
    ("options", "field", "message"),
    [
        ({"paths": 1}, "paths", "paths must be True or False, got 1"),
        ({"costates": "yes"}, "costates", "got 'yes'"),
        ({"deviation": None}, "deviation", "got None"),
        ({"mesh": 0}, "mesh", "got 0"),
        ({"tolerance": 0}, "tolerance", "must be a number > 0, got 0"),
        ({"tolerance": True}, "tolerance", "got True"),
        ({"columns": 0}, "columns", "from 1 to 6, got 0"),
        ({"columns": 1.5}, "columns", "got 1.5"),
        ({"only": ("y",)}, "only", "only must hold some of 'x', 'v', 'u', got"),
        ({"only": ()}, "only", "got"),
        ({"only": "x"}, "only", "got 'x'"),
        ({"size": (0, 3)}, "size", r"got \(0, 3\)"),
        ({"size": "big"}, "size", "got 'big'"),
    ],
)
def test_values_that_are_not_allowed(options, field, message):
    with pytest.raises(InvalidData, match=message) as caught:
        ct.plot(braking(), cruising(), **options)
    assert caught.value.field == field


def test_options_and_forms_of_plans():
    model, plan = braking(), cruising()
    with pytest.raises(UnsupportedOption, match="no option 'colour'; its options: only, paths"):
        ct.plot(model, plan, colour="red")
    figure = ct.plot(model, plan, columns=3, size=(9, 3), title="a title\nof two lines")
    assert figure.get_size_inches().tolist() == [9, 3]
    assert figure.get_suptitle() == "a title\nof two lines"
    assert len({axes.get_position().x0 for axes in figure.axes}) == 3
    for form in (model.plan_to_data(plan), SimpleNamespace(plan=plan)):
        assert ct.plot(model, form).get_suptitle() == ct.plot(model, plan).get_suptitle()
    with pytest.raises(InvalidData, match="phases of the plan must be"):
        ct.plot(model, relayed())
    for size in ((1, 1), (30, 20)):
        ct.plot(model, plan, size=size).canvas.draw()


# -- slews ---------------------------------------------------------------------------------------

SLEW_PANELS = [
    "quaternion", "body rates", "gimbal angles", "gimbal rates", "singularity det(A Aᵀ)",
    "control torque",
]  # fmt: skip


def test_a_slew_in_the_papers_manner(tmp_path):
    model = SatelliteSlew(name="turn")
    plan = slewed(model)
    figure = ct.plot(model, plan)
    figure.savefig(tmp_path / "slew.png")
    drawn = panels(figure)
    assert list(drawn) == SLEW_PANELS
    assert [axes.get_ylabel().rpartition("\n")[2] for axes in figure.axes] == [
        "quaternion", "(rad/s)", "(rad)", "(rad/s)", "det(A Aᵀ)", "(N m)",
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
    # The plan obeys no equation of motion, and the title says so.
    assert figure.get_suptitle().startswith("turn  ·  45° about (1, 0, 0), J = ")
    assert "\nNOT VALID: " in figure.get_suptitle()


def test_a_margin_shows_both_limits():
    model = SatelliteSlew(margin=0.2)
    figure = ct.plot(model, slewed(model))
    drawn = panels(figure)
    assert heights(drawn["control torque"]) == [-20, 20]
    assert heights(drawn["control torque"], "reserve") == [-25, 25]
    assert heights(drawn["gimbal rates"], "reserve") == [-1, 1]
    assert heights(drawn["body rates"], "reserve") == []
    assert "limit, nothing in reserve" in legend(figure)
    assert "20 % in reserve" in figure.get_suptitle()


def test_tracking_adds_the_errors():
    model = SatelliteSlew()
    figure = ct.plot(model, slewed(model), tracking=flown(end=12.0))
    drawn = panels(figure)
    assert list(drawn) == [
        *SLEW_PANELS[:3], "quaternion errors", *SLEW_PANELS[3:], "rate errors",
    ]  # fmt: skip
    assert heights(drawn["quaternion errors"], "paper") == [-4e-4, 4e-4]
    assert heights(drawn["rate errors"], "paper") == [-1e-3, 1e-3]
    assert artists(drawn["rate errors"], "forbidden") == []
    assert len(artists(drawn["rate errors"], "saturated")) == 2
    assert {"saturated", "kept by the paper's controller"} <= set(legend(figure))
    # What is held after the end of the plan is in sight.
    assert drawn["quaternion"].get_xlim()[1] > 12


def test_the_ways_of_the_axes(tmp_path):
    model = SatelliteSlew()
    figure = ct.plot(model, slewed(model), view="axis")
    figure.savefig(tmp_path / "axes.png")
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
    assert legend(figure) == ["guess", "limit"]


@pytest.mark.filterwarnings("error")
def test_the_slew_moves(tmp_path):
    pytest.importorskip("PIL")
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
        with pytest.raises(InvalidData) as caught:
            animate_slew(model, slewed(model), **options)
        assert caught.value.field == field


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
    with pytest.raises(InvalidData, match=message) as caught:
        ct.plot(model, slewed(model), **options)
    assert caught.value.field == field


def test_what_a_slew_refuses():
    model = SatelliteSlew()
    with pytest.raises(UnsupportedOption, match="no option 'axes'; its options: view, tracking"):
        ct.plot(model, axes=(0, 1))
    with pytest.raises(InvalidData, match="beside a plan"):
        ct.plot(model, tracking=flown())
    with pytest.raises(InvalidData, match="plan of a slew has the states"):
        ct.plot(model, cruising())


def test_no_pyplot():
    code = (
        "import sys, crosstrack as ct; from crosstrack.models import SatelliteSlew; "
        "m = SatelliteSlew(); assert 'matplotlib' not in sys.modules; "
        "ct.plot(m).canvas.draw(); ct.plot(m, view='axis').canvas.draw(); "
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, env={"MPLBACKEND": "TkAgg"})
