"""Pictures of attractors show the data of the series, the embedding and the plan."""

import math

import numpy as np
import pytest
from attractor.test_model import SHORT, logistic, plain_divergence, plain_sums
from pictures import artists, legend, render, words

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedOption
from crosstrack.models.attractor import (
    AttractorAnalysis,
    AttractorEstimate,
    Slope,
    SurrogateTest,
)
from crosstrack.models.attractor.plot import curves_of

RNG = np.random.default_rng(8)
MAP = AttractorAnalysis(logistic(80), 0.5, "V", name="map")
TWO = Slope("rosenstein", 1.4, 0.01, 1, 4), Slope("correlation", 0.9, 0.02, 0.02, 0.3)


def plan_of(exponent=None, correlation=None, *, delay=1, dimension=2, theiler=0, test=None):
    """An estimate, whatever curves say."""
    return AttractorEstimate(delay, dimension, theiler, exponent, correlation, test)


def wave(count, period=40.0):
    """A series that is smooth."""
    return np.sin(2 * np.pi * np.arange(count) / period)


def drawn(axes, gid):
    """The one line of this kind, as columns."""
    (found,) = artists(axes, gid)
    return np.array(found.get_data_3d() if axes.name == "3d" else found.get_data())


# -- the series and its states ---------------------------------------------------------------------


def test_without_a_plan_the_series_and_its_delay_plot(tmp_path):
    figure = ct.plot(MAP)
    figure.savefig(tmp_path / "none.png", dpi=40)
    states, series = figure.axes
    assert drawn(series, "series").tolist() == [(0.5 * np.arange(80)).tolist(), MAP.series.tolist()]
    assert drawn(states, "states").tolist() == [MAP.series[:-1].tolist(), MAP.series[1:].tolist()]
    assert (series.get_xlabel(), series.get_ylabel()) == ("time (s)", "value (V)")
    assert (states.get_xlabel(), states.get_ylabel()) == ("x(t) (V)", "x(t + 0.5 s) (V)")
    assert figure.get_suptitle() == "map  ·  80 samples, one each 0.5 s"
    assert legend(figure) == []
    # A map is dots, not a line.
    assert artists(states, "states")[0].get_linestyle() == "None"


@pytest.mark.parametrize("dimension", [1, 2])
def test_two_coordinates_at_the_delay_of_the_plan(dimension):
    model = AttractorAnalysis(wave(200), 0.25, "m/s^2")
    states = ct.plot(model, plan_of(delay=10, dimension=dimension)).axes[0]
    assert drawn(states, "states").tolist() == [
        model.series[:-10].tolist(),
        model.series[10:].tolist(),
    ]
    assert states.get_ylabel() == "x(t + 2.5 s) (m/s²)"
    assert artists(states, "states")[0].get_linestyle() == "-"


def test_three_coordinates_in_space():
    model = AttractorAnalysis(wave(200))
    figure = render(ct.plot(model, plan_of(delay=7, dimension=5)))
    states = figure.axes[0]
    assert states.name == "3d"
    assert drawn(states, "states").T.tolist() == model.states(7, 3).tolist()
    assert states.get_zlabel() == "x(t + 14 s) (–)"
    assert "delay 7, dimension 5" in figure.get_suptitle()


def test_a_narrow_picture_is_flat():
    model = AttractorAnalysis(wave(200))
    plan = plan_of(Slope("rosenstein", 0.0, 0.1, 0, 5), delay=7, dimension=3)
    figure = render(ct.plot(model, plan, size=(5, 3.6)))
    assert figure.axes[0].name == "rectilinear"
    assert drawn(figure.axes[0], "states").tolist() == model.states(7, 2).T.tolist()


def test_a_stretch_of_a_long_series_is_told():
    figure = ct.plot(AttractorAnalysis(wave(100_000, 40.0)))
    series = figure.axes[1]
    # 60 crossings of the mean are 30 periods.
    assert len(drawn(series, "series")[0]) == pytest.approx(1200, abs=2)
    assert f"the first {len(drawn(series, 'series')[0])} of 100000 samples" in words(figure)
    slow = ct.plot(AttractorAnalysis(np.linspace(0, 1, 100_000))).axes[1]
    assert len(drawn(slow, "series")[0]) == 8000
    quick = ct.plot(AttractorAnalysis(RNG.normal(size=100_000)))
    assert len(drawn(quick.axes[1], "series")[0]) == 300
    assert len(drawn(quick.axes[0], "states")[0]) <= 6000


def test_nothing_but_the_attractor(tmp_path):
    figure = ct.plot(MAP, plan_of(*TWO, test=SurrogateTest("chaotic", 39, 0)), view="attractor")
    figure.savefig(tmp_path / "attractor.png", dpi=40)
    (states,) = figure.axes
    assert drawn(states, "states").T.tolist() == MAP.states(1, 2).tolist()
    assert any("chaotic" in text for text in words(figure))
    assert len(ct.plot(MAP, view="attractor").axes) == 1


# -- curves ----------------------------------------------------------------------------------------


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", SHORT)
@pytest.mark.parametrize("radius", [None, 0.4])
def test_curves_are_those_counted_by_hand(name, radius):
    model = AttractorAnalysis(SHORT[name], 0.5)
    spread = float(np.ptp(model.series))
    method = "rosenstein" if radius is None else "kantz"
    exponent = Slope(method, 0.3, 0.1, 2, 6, None if radius is None else radius * spread)
    correlation = Slope("correlation", 1.5, 0.1, 0.2 * spread, 0.6 * spread)
    plan = plan_of(exponent, correlation, delay=2, theiler=3)
    first, second = curves_of(model, plan)
    states = model.states(2, 2)
    ahead = np.rint(first.x / 0.5).astype(int)
    assert ahead[0] == 0
    assert ahead[-1] >= 12
    assert {2, 6} <= set(ahead.tolist())
    plain = plain_divergence(states, 3, ahead, exponent.radius)
    assert first.y == pytest.approx(plain, nan_ok=True)
    radii, shares = second.x, second.y
    apart = np.abs(states[:, None] - states).max(axis=2)
    assert radii[0] <= apart[apart > 0].max()
    assert radii[-1] == pytest.approx(np.ptp(states, axis=0).max())
    sums = plain_sums(states, 3, radii)
    assert np.isnan(shares).tolist() == (sums == 0).tolist()
    assert shares[sums > 0] == pytest.approx(np.log(sums[sums > 0]))
    assert shares[-1] == pytest.approx(0.0, abs=1e-12)


def test_the_claimed_slope_and_its_region_are_drawn():
    figure = ct.plot(MAP, plan_of(*TWO), title="mine")
    _, _, first, second = figure.axes
    (region,) = artists(first, "region")
    assert (region.get_x(), region.get_width()) == (0.5, 1.5)
    times, heights = drawn(first, "line divergence")
    assert times.tolist() == [0.5, 2.0]
    assert heights[1] - heights[0] == pytest.approx(1.4 * 1.5)
    # The line goes through the middle of the curve within the region.
    x, y = drawn(first, "curve divergence")
    inside = (x >= 0.5) & (x <= 2.0)
    assert heights.mean() == pytest.approx(
        y[inside].mean() + 1.4 * (times.mean() - x[inside].mean())
    )
    (region,) = artists(second, "region")
    assert (region.get_x(), region.get_x() + region.get_width()) == pytest.approx((0.02, 0.3))
    radii, shares = drawn(second, "line correlation")
    assert radii.tolist() == [0.02, 0.3]
    assert (shares[1] - shares[0]) / math.log(0.3 / 0.02) == pytest.approx(0.9)
    assert (first.get_xlabel(), first.get_ylabel()) == (
        "time ahead (s)",
        "mean ln(distance / V) (–)",
    )
    assert (second.get_xlabel(), second.get_ylabel()) == ("radius r (V)", "ln C(r) (–)")
    assert second.get_xscale() == "log"
    assert {"λ = 1.4 ± 0.01 nats/s", "D = 0.9 ± 0.02"} <= set(words(figure))
    assert legend(figure) == ["computed again", "scaling region", "slope as claimed"]


def test_slopes_from_place_to_place():
    curves = ct.plot(MAP, plan_of(*TWO)).axes
    figure = ct.plot(MAP, plan_of(*TWO), view="slopes")
    for axes, curve in zip(curves[2:], curves_of(MAP, plan_of(*TWO)), strict=True):
        at, heights = drawn(axes, f"curve {curve.name}")
        assert at.tolist() == curve.x.tolist()
        assert heights.tolist() == pytest.approx(curve.y.tolist(), rel=1e-15, nan_ok=True)
    x, y = drawn(curves[2], "curve divergence")
    assert drawn(figure.axes[2], "slopes divergence")[1] == pytest.approx(np.gradient(y, x))
    x, y = drawn(curves[3], "curve correlation")
    local = drawn(figure.axes[3], "slopes correlation")
    assert local[1] == pytest.approx(np.gradient(y, np.log(x)), nan_ok=True)
    assert drawn(figure.axes[2], "line divergence").tolist() == [[0.5, 2.0], [1.4, 1.4]]
    assert drawn(figure.axes[3], "line correlation").tolist() == [[0.02, 0.3], [0.9, 0.9]]
    assert figure.axes[2].get_ylabel() == "slope of ln distance (nats/s)"
    low, high = figure.axes[3].get_ylim()
    assert low < 0.9 < high


def test_one_curve_alone():
    for which, gid in enumerate(("divergence", "correlation")):
        slopes = [None, None]
        slopes[which] = TWO[which]
        for size in (None, (5, 4)):
            figure = ct.plot(MAP, plan_of(*slopes), size=size)
            assert len(figure.axes) == 3
            assert artists(figure.axes[2], f"curve {gid}")


# -- words -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("test", "told"),
    [
        (SurrogateTest("chaotic", 39, 0), "part exponentially: chaotic (p = 0.025: none of 39"),
        (
            SurrogateTest("nonlinear", 99, 4),
            "neither regular nor chaotic motion is shown (p = 0.05: 4 of 99",
        ),
        (
            SurrogateTest("noise", 19, 7),
            "may explain the series as well (p = 0.4: 7 of 19",
        ),
    ],
)
@pytest.mark.parametrize("size", [None, (4, 3)])
def test_the_verdict_stands_below_in_words(test, told, size):
    figure = ct.plot(MAP, plan_of(*TWO, test=test), size=size)
    text = " ".join(" ".join(words(figure)).split())
    assert told in text.replace("\u00a0", " ")


def test_the_title_tells_the_figures_and_whether_they_hold():
    truth = AttractorAnalysis(MAP.series, 0.5, "V", math.log(4), 1.0, True, name="map")
    figure = ct.plot(truth, plan_of(*TWO))
    first, second = figure.get_suptitle().split("\n")
    missed = ((1.4 / math.log(4) - 1) + 0.1 + 1) / 3
    assert first == (
        "map  ·  delay 1, dimension 2, λ = 1.4 ± 0.01 nats/s, D = 0.9 ± 0.02, "
        f"relative error {missed:.3g}"
    )
    assert second.startswith("NOT VALID: exponent is the slope of its curve")
    embedding = ct.plot(MAP, plan_of()).get_suptitle()
    error = MAP.verify(plan_of()).objective
    assert embedding == f"map  ·  delay 1, dimension 2, error of prediction {error:.3g}"


def test_title_size_and_json_plans():
    figure = ct.plot(MAP, plan_of(*TWO).data(), title="mine", size=(4, 3))
    assert figure.get_suptitle() == "mine"
    assert figure.get_size_inches().tolist() == [4, 3]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"view": "time"}, "view must be 'curves', 'slopes' or 'attractor', got 'time'"),
        ({"tolerance": 0}, "tolerance must"),
        ({"size": "big"}, "size must be"),
        ({"zoom": 1}, "no option 'zoom'"),
    ],
)
def test_values_that_no_picture_of_attractors_takes(options, message):
    with pytest.raises(UnsupportedOption, match=message):
        ct.plot(MAP, plan_of(), **options)


def test_what_no_picture_shows():
    with pytest.raises(InvalidData, match="delay 50 and dimension 3 need more than 101 samples"):
        ct.plot(MAP, plan_of(delay=50, dimension=3))
    with pytest.raises(InvalidData, match="plan"):
        ct.plot(MAP, "plan")


# -- strange series --------------------------------------------------------------------------------


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("series", "plan"),
    [
        # No neighbours, within the window or the radius.
        (logistic(60), plan_of(Slope("rosenstein", 1, 0, 1, 3), TWO[1], theiler=57)),
        (logistic(60), plan_of(Slope("kantz", 1, 0, 1, 3, 1e-12), TWO[1])),
        # A region beyond the series, and radii beyond all distances, and far below.
        (logistic(60), plan_of(Slope("rosenstein", 1, 0, 1, 58), TWO[1])),
        (logistic(60), plan_of(Slope("rosenstein", 1, 0, 1, 5000), TWO[1])),
        (logistic(60), plan_of(None, Slope("correlation", 1, 0, 1e6, 1e9))),
        (logistic(60), plan_of(None, Slope("correlation", 1, 0, 1e-12, 1e-9))),
        (logistic(60), plan_of(None, Slope("correlation", -1e9, 1e9, 1e-300, 1e300))),
        (logistic(60), plan_of(Slope("rosenstein", 1e300, 1e300, 0, 3))),
        # Two states.
        (logistic(60), plan_of(*TWO, delay=58)),
        # Two values, exact periods, huge and tiny ones.
        (np.tile([0.0, 1.0], 40), plan_of(*TWO)),
        (np.tile([0.0, 3.0, 1.0], 30), plan_of(*TWO, dimension=4)),
        (np.round(4 * wave(90)), plan_of(*TWO, dimension=3, delay=9)),
        (9e149 * RNG.choice([-1.0, 1.0], 60), plan_of(*TWO)),
        (1e-149 * RNG.normal(size=60), plan_of(*TWO)),
        (1e9 + 1e-2 * RNG.normal(size=60), plan_of(*TWO)),
        (np.where(np.arange(80) == 40, 1e9, logistic(80)), plan_of(*TWO)),
    ],
)
def test_strange_series_are_drawn(series, plan):
    model = AttractorAnalysis(series, 1e-3, "rad/s^2")
    figure = ct.plot(model, plan)
    ct.plot(model, plan, view="slopes")
    if not 1e-6 < np.abs([axes.get_xlim() + axes.get_ylim() for axes in figure.axes]).max() < 1e6:
        render(figure)  # ticks of sizes that are not usual
    assert "NOT VALID" in figure.get_suptitle()


@pytest.mark.slow
def test_a_million_samples_are_drawn():
    model = AttractorAnalysis(
        np.resize(logistic(5000), 1_000_000)
        + 1e-3 * np.random.default_rng(0).normal(size=1_000_000)
    )
    render(ct.plot(model))
    figure = render(ct.plot(model, plan_of(TWO[0], TWO[1], dimension=1)))
    radii, shares = drawn(figure.axes[3], "curve correlation")
    # The share of pairs is about linear in the radius; it is counted from a hundred states.
    inside = (radii > 0.02) & (radii < 0.1)
    assert np.polyfit(np.log(radii[inside]), shares[inside], 1)[0] == pytest.approx(0.9, abs=0.2)
