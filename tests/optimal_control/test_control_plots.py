"""Pictures of optimal controls, for valid and invalid plans."""

from types import SimpleNamespace

import numpy as np
import pytest
from carts import NODES, braking, cruising, piecewise, relay, relayed
from pictures import artists, heights, legend, panels, render

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedOption
from crosstrack.models import ControlPlan, OptimalControlProblem, PhasePlan
from crosstrack.models.optimal_control.plan import Piecewise

RED = "#C8102E"


def test_draws_one_panel_per_state_and_control(tmp_path):
    model, plan = braking(bound=0.3), cruising()
    figure = ct.plot(model, plan)
    figure.savefig(tmp_path / "control.png", dpi=50)
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
    assert legend(figure) == ["limit", "forbidden", "node", "knot of the mesh"]


def test_draws_limits_at_their_values():
    drawn = panels(ct.plot(braking(bound=0.3, push=4.0), cruising()))
    assert heights(drawn["x"]) == [0.3]
    assert heights(drawn["v"]) == []
    assert len(artists(drawn["x"], "forbidden")) == 1
    # Distant limits are written as text, so that the curve remains visible.
    assert heights(drawn["u"]) == [-4]
    assert drawn["u"].get_title(loc="left") == "≤ 4"
    assert drawn["x"].get_title(loc="left") == ""


def test_path_constraints_have_panels():
    model = braking(upper_sum={"lower": 0.2, "upper": 1.2}, level={"equals": 0.5, "unit": "m"})
    drawn = panels(ct.plot(model, cruising()))
    assert list(drawn) == ["x", "v", "u", "upper sum", "level"]
    assert heights(drawn["upper sum"]) == [0.2, 1.2]
    # An equation has no shaded region.
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
    # A bound of a single entry has its colour and no shaded region.
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
    render(figure)
    assert artists(panels(figure)["y"], "phase") == []


def test_the_worst_violation_is_ringed():
    plan = cruising()
    figure = ct.plot(braking(bound=0.2), plan)
    assert figure.get_suptitle().endswith("\nNOT VALID: bounds of states")
    assert figure._suptitle.get_color() == RED
    (ring,) = artists(panels(figure)["x"], "worst violation")
    assert ring.get_xdata()[0] == pytest.approx(0.5)
    assert ring.get_ydata()[0] == pytest.approx(0.25)
    assert "worst violation" in legend(figure)
    # With a tolerance that accepts the violation, no ring is drawn.
    lenient = ct.plot(braking(bound=0.2), plan, tolerance=0.5)
    assert "NOT VALID" not in lenient.get_suptitle()
    assert artists(panels(lenient)["x"], "worst violation") == []


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
    with pytest.raises(UnsupportedOption, match="no costates in phase 'phase 1'"):
        ct.plot(model, cruising(), costates=True)


def test_without_a_plan_the_guess_is_drawn():
    model = braking(level={"equals": 0.5})
    figure = ct.plot(model)
    render(figure)
    assert list(panels(figure)) == ["x", "v", "u"]
    assert figure.get_suptitle() == "braking  ·  guess, 1 s"
    assert legend(figure) == ["guess", "limit", "forbidden"]
    (line,) = artists(panels(figure)["v"], "curve v")
    assert line.get_ydata()[[0, -1]].tolist() == [1, -1]
    with pytest.raises(UnsupportedOption, match="need a plan"):
        ct.plot(model, deviation=True)


def test_many_intervals_have_neither_dots_nor_ticks():
    figure = ct.plot(braking(), cruising(knots=np.linspace(0, 1, 400)))
    assert legend(figure) == ["limit", "forbidden"]
    plain = ct.plot(braking(), cruising(), mesh=False)
    assert legend(plain) == ["limit", "forbidden"]


def test_draws_unstable_and_constant_plans():
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
        render(ct.plot(model, plan, deviation=True))


@pytest.mark.parametrize(
    ("options", "field", "message"),
    [
        ({"paths": 1}, "paths", "be True or False, got 1"),
        ({"costates": "yes"}, "costates", "got 'yes'"),
        ({"deviation": None}, "deviation", "got None"),
        ({"mesh": 0}, "mesh", "got 0"),
        ({"tolerance": 0}, "tolerance", "be a number > 0 and < 1, got 0"),
        ({"tolerance": True}, "tolerance", "got True"),
        ({"columns": 0}, "columns", "from 1 to 6, got 0"),
        ({"columns": 1.5}, "columns", "got 1.5"),
        ({"only": ("y",)}, "only", "hold some of 'x', 'v', 'u', got"),
        ({"only": ()}, "only", "got"),
        ({"only": "x"}, "only", "got 'x'"),
        ({"size": (0, 3)}, "size", r"got \(0, 3\)"),
        ({"size": "big"}, "size", "got 'big'"),
    ],
)
def test_rejects_invalid_options(options, field, message):
    with pytest.raises(UnsupportedOption, match=f"^{field} must .*{message}"):
        ct.plot(braking(), cruising(), **options)


def test_options_and_forms_of_plans():
    model, plan = braking(), cruising()
    with pytest.raises(
        UnsupportedOption,
        match=r"no option 'colour'; did you mean 'columns.* its options: only, paths",
    ):
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
        render(ct.plot(model, plan, size=size, only=("x",)))
