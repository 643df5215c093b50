"""Plots of messenger tours, and the sampled poses along a path."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from messenger.flights import flight
from pictures import artists, legend, panels, render, words

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedOption
from crosstrack.instances.messenger import generate
from crosstrack.models.messenger import MessengerTour, Primitive, TourPlan
from crosstrack.models.messenger.plot import animate_tour, draw_progress
from crosstrack.models.messenger.sampling import outline, track


@pytest.fixture(scope="module")
def ten():
    model = ct.load("messenger/B-10-07")
    return model, flight(model)


def plan_of(*pieces, start=(0.0, 0.0, 0.0), order=(), times=(), points=()):
    points = np.reshape(np.array(points, float), (-1, 2))
    return TourPlan(order, times, points, start, tuple(Primitive(*one) for one in pieces))


def tampered(model, plan, **changes):
    """Return the data of a plan with entries of its lists replaced: ``name=(place, value)``."""
    data = plan.to_data()
    for name, (place, value) in changes.items():
        data[name][place] = value
    return model.plan_from_data(data)


# -- places on the path --------------------------------------------------------------------------


def test_a_turn_runs_on_its_circle():
    plan = plan_of((0, "L", 3 * math.pi, 0.0), (1, "S", 4.0, math.pi), (1, "R", math.pi, math.pi))
    flown = np.array([-1.0, 0.0, math.pi, 2 * math.pi, 3 * math.pi, 3 * math.pi + 1, 99.0])
    found = track(plan, 2.0, flown)
    x, y, heading = found.poses.T
    assert x == pytest.approx([0, 0, 2, 0, -2, -2, -4], abs=1e-12)
    assert y == pytest.approx([0, 0, 2, 4, 2, 1, -4], abs=1e-12)
    assert heading == pytest.approx([*np.array([0, 0, 0.5, 1, 1.5, 1.5, 1]) * math.pi], abs=1e-12)
    assert found.legs.tolist() == [0, 0, 0, 0, 0, 1, 1]
    assert found.flown[[0, -1]] == pytest.approx([0, 4 * math.pi + 4])


def test_places_between_agree_with_small_steps():
    rng = np.random.default_rng(3)
    pieces = [(k, str(t), float(x), 0.0) for k, (t, x) in enumerate(
        zip(rng.choice(["L", "S", "R"], 12), rng.exponential(4.0, 12), strict=True)
    )]  # fmt: skip
    plan = plan_of(*pieces, start=(3.0, -2.0, 1.0))
    found = track(plan, 1.5, np.linspace(0, plan.length, 20_001))
    steps = np.diff(found.poses, axis=0)
    step = plan.length / 20_000
    assert np.abs(np.hypot(*steps[:, :2].T) - step).max() < 1e-5 * step
    course = np.arctan2(steps[:, 1], steps[:, 0])
    middle = 0.5 * (found.poses[1:, 2] + found.poses[:-1, 2])
    inner = np.diff(found.legs) == 0
    assert np.abs(np.exp(1j * course[inner]) - np.exp(1j * middle[inner])).max() < 1e-6
    curvature = np.abs(steps[:, 2]) / step
    assert curvature.max() < (1 + 1e-9) / 1.5


def test_on_the_spot_there_are_corners():
    plan = plan_of((0, "S", 2.0, 0.0), (1, "S", 3.0, math.pi / 2), start=(0.0, 0.0, 9.0))
    found = track(plan, 0.0, [1.0, 2.0, 3.0, 5.0])
    assert found.poses[:, :2].tolist() == [[1, 0], [2, 0], [2, 1], [2, 3]]
    assert outline(plan, 0.0).poses[:, :2].tolist() == [[0, 0], [2, 0], [2, 3]]


def test_a_path_without_pieces_stays_where_it_is():
    found = track(plan_of(start=(1.0, 2.0, 3.0)), 5.0, [0.0, 7.0])
    assert found.poses.tolist() == [[1, 2, 3]] * 2
    assert found.flown.tolist() == [0, 0]


@pytest.mark.parametrize(("radius", "length"), [(2.0, 1.0), (2.0, 1e3), (1e-6, 1e3), (5.0, -9.0)])
def test_an_outline_is_smooth_and_short(radius, length):
    found = outline(plan_of((0, "L", length, 0.0), (1, "S", 1.0, 0.0)), radius)
    assert len(found.flown) < 400
    assert found.flown[-1] == pytest.approx(length + 1.0)
    middle = np.hypot(*(found.poses[:-1, :2] - [0, radius]).T)
    assert middle == pytest.approx(np.full(len(middle), radius), rel=1e-3)
    chords = np.hypot(*np.diff(found.poses[:-1, :2], axis=0).T)
    assert chords.max() < 0.08 * radius


# -- the map -------------------------------------------------------------------------------------


def test_draws_path_vehicles_and_encounters(ten, tmp_path):
    model, plan = ten
    figure = ct.plot(model, plan, zoom=False)
    figure.savefig(tmp_path / "tour.png", dpi=40)
    axes, bar = figure.axes
    assert axes.get_aspect() == 1
    (path,) = artists(axes, "path")
    segments = np.array(path.get_segments())
    assert segments[0, 0] == pytest.approx(plan.start[:2])
    assert segments[-1, 1] == pytest.approx(plan.points[-1], abs=1e-6)
    lengths = np.hypot(*(segments[:, 1] - segments[:, 0]).T)
    assert lengths.sum() == pytest.approx(plan.length, rel=1e-3)
    times = path.get_array()
    assert (np.diff(times) > 0).all()
    assert path.get_clim() == pytest.approx((0, plan.times[-1]))
    (tracks,) = artists(axes, "track")
    for ends, vehicle, time in zip(tracks.get_segments(), plan.order, plan.times, strict=True):
        assert ends[0] == pytest.approx(model.positions[vehicle])
        assert ends[1] == pytest.approx(model.where(vehicle, time))
    (discs,) = artists(axes, "disc")
    boxes = [disc.get_extents() for disc in discs.get_paths()]
    assert [box.width for box in boxes] == pytest.approx(2 * model.radius, rel=1e-3)
    assert [box.x0 + box.x1 for box in boxes] == pytest.approx(2 * plan.points[:, 0], abs=1e-2)
    written = words(figure)
    assert {str(k) for k in range(1, 11)} <= set(written)
    assert (
        f"messenger/B-10-07  ·  10 vehicles, {plan.length:.6g} m, {plan.times[-1]:.5g} s" in written
    )
    assert legend(figure) == [
        "start", "vehicle (name) at time 0", "its track", "its disc when met", "encounter (number)",
    ]  # fmt: skip
    assert bar.get_ylabel() == "time (s)"
    assert not artists(axes, "worst violation")
    low, high = axes.get_xlim()
    assert low < segments[..., 0].min()
    assert segments[..., 0].max() < high


def test_colours_by_leg(ten):
    model, plan = ten
    figure = render(ct.plot(model, plan, colour="leg", title="mine", size=(4, 3)))
    (axes,) = [one for one in figure.axes if one.get_xlabel()][:1]
    (path,) = artists(axes, "path")
    colours = {tuple(row) for row in path.get_colors()}
    assert len(colours) == 5
    assert path.get_array() is None
    assert figure.get_suptitle() == "mine"
    assert figure.get_size_inches().tolist() == [4, 3]


def test_violations_have_red_rings(ten):
    model, plan = ten
    place = plan.points[4].tolist()
    wrong = tampered(model, plan, points=(4, [place[0] + 1.0, place[1]]))
    figure = render(ct.plot(model, wrong, zoom=False))
    assert "NOT VALID: encounter at its point" in figure.get_suptitle()
    (ring,) = artists(figure.axes[0], "worst violation")
    assert ring.get_offsets().tolist() == [pytest.approx([place[0] + 1.0, place[1]])]
    assert "worst violation" in legend(figure)
    # Within a larger tolerance the same plan is feasible.
    fine = ct.plot(model, wrong, tolerance=0.5)
    assert "NOT VALID" not in fine.get_suptitle()
    missing = tampered(model, plan, order=(0, plan.order[1]))
    figure = ct.plot(model, missing, zoom=False)
    assert "each vehicle met once" in figure.get_suptitle()
    rings = artists(figure.axes[0], "worst violation")[0].get_offsets()
    worst = np.hypot(*(rings - model.positions[plan.order[0]]).T)
    worst = min(worst.min(), np.hypot(*(rings - plan.points[0]).T).min())
    assert worst < 1e-9


def test_without_a_plan_the_vehicles_are_drawn():
    model = ct.load("messenger/B-10-05")
    figure = render(ct.plot(model))
    (axes,) = figure.axes
    (arrows,) = artists(axes, "velocity")
    drawn = np.stack([arrows.U, arrows.V], axis=1)
    assert drawn / model.velocities == pytest.approx(
        np.full((10, 2), (drawn / model.velocities)[0, 0])
    )
    assert legend(figure) == ["start", "vehicle (name) at time 0", "its disc", "its velocity"]
    assert {str(k) for k in range(10)} <= set(words(figure))
    rest = render(ct.plot(ct.load("messenger/static-closed")))
    assert legend(rest) == ["vehicle (name) at time 0", "its disc"]


@pytest.mark.parametrize("place", [(0, 0), (1e7, -1e7)])
def test_a_far_tour_has_its_begin_beside(place):
    """Encounters at doubling distances: the first half would be a single dot."""
    reach = 4.0 ** np.arange(10)
    where = np.column_stack([reach, (-1.0) ** np.arange(10) * reach]) + place
    model = MessengerTour(where, start=[*place, 1.0], ids=[f"car {k}" for k in range(10)])
    plan = flight(model, range(10))
    figure = render(ct.plot(model, plan))
    assert len(figure.axes) == 3
    whole, _, near = figure.axes
    assert (whole.get_xlabel(), near.get_xlabel()) == ("x (km)", "x (m)")
    assert near.get_title() == "the first half of the encounters"
    assert np.ptp(near.get_xlim()) < np.ptp(whole.get_xlim()) * 1000 / 50
    numbers = [{text.get_text() for text in one.texts} for one in (whole, near)]
    assert {"10", "9", "8"} <= numbers[0]
    assert {"1", "3", "5"} <= numbers[1]
    assert "3" not in numbers[0]
    assert len(ct.plot(model, plan, zoom=False).axes) == 2


def texts(figure):
    """Return the texts of the map without those of its ticks."""
    return [text.get_text() for text in figure.axes[0].texts]


def test_labels_of_a_hundred_vehicles_are_legible():
    model = generate(100, 17, 1, fastest=0.0)
    rows = (model.positions[:, 1] // 40).astype(int)
    plan = flight(model, np.lexsort((model.positions[:, 0] * (-1.0) ** rows, rows)).tolist())
    figure = render(ct.plot(model, plan))
    numbers = [text for text in texts(figure) if text.isdigit()]
    assert sorted(map(int, numbers)) == [1, *range(10, 101, 10)]
    everything = render(ct.plot(model, plan, labels=True))
    assert len([text for text in texts(everything) if text.isdigit()]) > 190
    nothing = render(ct.plot(model, plan, labels=False))
    assert not [text for text in texts(nothing) if text.isdigit()]


def test_encounters_at_one_place_share_a_number():
    model = ct.load("messenger/met-at-start")
    plan = plan_of(
        order=(0, 1, 2, 3), times=[0.0] * 4, points=[[0.0, 0.0]] * 4, start=model.start,
    )  # fmt: skip
    figure = render(ct.plot(model, plan))
    assert "1–4" in words(figure)
    assert "messenger/met-at-start  ·  4 vehicles, 0 m, 0 s" in words(figure)


@pytest.mark.parametrize(
    "model",
    [
        MessengerTour([[0, 0]], start=[0, 0, 0]),
        MessengerTour([[0, 0]], radius=0.0, start=[0, 0]),
        MessengerTour([[1e9, 1e9], [1e9 + 1, 1e9]], radius=0.0),
        MessengerTour([[1e-6, 0], [0, 2e-6]], radius=1e-7, turning_radius=1e-7, speed=1e-6),
        MessengerTour([[k, 0] for k in range(5)], start=[0, 0, 0]),
        MessengerTour([[3, 4]] * 3, [[1, 0], [0, 9.99], [0, 0]], radius=0.0),
        MessengerTour([[1, 2], [8, 2], [5, 9]], start=None, closed=True, radius=1e6),
    ],
)
@pytest.mark.filterwarnings("error")
def test_strange_fields_are_drawn(model, tmp_path):
    ct.plot(model).savefig(tmp_path / "field.png", dpi=30)
    place = [0.0, 0.0] if model.start is None else model.start[:2]
    # A plan without motion violates most checks, and is drawn nevertheless.
    still = plan_of(
        order=range(model.size), times=[0.0] * model.size, points=[place] * model.size,
        start=(*place, 0.0),
    )  # fmt: skip
    ct.plot(model, still).savefig(tmp_path / "still.png", dpi=30)


@pytest.mark.parametrize(
    "plan",
    [
        plan_of(),
        plan_of((0, "L", 1e300, 0.0)),
        plan_of((0, "S", 1e308, 0.0), (1, "S", 1e308, 0.0)),
        plan_of(
            (0, "S", -5.0, 0.0), (7, "R", -5.0, 0.0), order=(0,), times=[-1e300], points=[[0, 1]]
        ),
        plan_of((2**31, "S", 5.0, 2.0), order=(1, 1, 1), times=[1, 2, 3], points=[[1e300, 0]] * 3),
    ],
)
def test_plans_that_are_far_from_valid_are_drawn(plan, tmp_path):
    model = ct.load("messenger/gap")
    figure = ct.plot(model, plan)
    figure.savefig(tmp_path / "wrong.png", dpi=30)
    assert "NOT VALID" in figure.get_suptitle()
    assert str(plan)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"colour": "red"}, "colour must be 'time' or 'leg', got 'red'"),
        ({"labels": 1}, "labels must be True or False"),
        ({"zoom": "yes"}, "zoom must be True or False"),
        ({"tolerance": 0}, "tolerance must"),
        ({"size": (0, 1)}, "size must be"),
        ({"view": "map"}, "no option 'view'"),
    ],
)
def test_rejects_bad_options(ten, options, message):
    with pytest.raises(UnsupportedOption, match=message):
        ct.plot(*ten, **options)


def test_plans_of_other_vehicles_are_refused(ten):
    plan = ten[1]
    with pytest.raises(InvalidData, match="order"):
        ct.plot(ct.load("messenger/gap"), plan)
    with pytest.raises(InvalidData, match="order"):
        animate_tour(ct.load("messenger/gap"), plan)


# -- the animation -------------------------------------------------------------------------------


@pytest.mark.filterwarnings("error")
def test_the_animation_follows_the_tour(ten, tmp_path):
    pytest.importorskip("PIL", reason="a GIF is written by Pillow")
    from PIL import Image

    model, plan = ten
    animation = animate_tour(model, SimpleNamespace(plan=plan), frames=4, size=(3, 3))
    animation.save(tmp_path / "tour.gif", writer="pillow", dpi=50)
    with Image.open(tmp_path / "tour.gif") as image:
        assert image.n_frames == 4
        assert image.size == (150, 150)
    figure = animation._fig
    end = plan.length / model.speed
    assert f"t = {end:.2f} s of {end:.2f} s, 10 of 10 met" in words(figure)
    (way,) = artists(figure.axes[0], "path")
    assert way.get_xydata()[-1] == pytest.approx(plan.points[-1], abs=1e-6)
    animation._func(0)
    assert f"t = 0.00 s of {end:.2f} s, 0 of 10 met" in words(figure)
    for options, field in (
        ({"frames": 1}, "frames"), ({"frames": 2.0}, "frames"), ({"interval": 0}, "interval"),
        ({"size": 3}, "size"),
    ):  # fmt: skip
        with pytest.raises(UnsupportedOption, match=f"^{field} must be "):
            animate_tour(model, plan, **options)


# -- progress ------------------------------------------------------------------------------------


def run(backend="a", primal=400.0, dual=None, steps=(), digest="x", total=9.0):
    incumbents = tuple(SimpleNamespace(seconds=s, objective=o) for s, o in steps)
    return SimpleNamespace(
        digest=digest, instance="tour", backend=backend, primal_bound=primal, dual_bound=dual,
        seconds={"total": total}, incumbents=incumbents,
    )  # fmt: skip


def test_objectives_and_gaps_over_time():
    steps = [(0.5, 900.0), (2.0, 500.0)]
    figure = render(draw_progress([run(steps=steps), run("b", primal=None, dual=380.0)], bound=300))
    drawn = panels(figure)
    assert list(drawn) == ["objective", "gap to the bound"]
    (curve,) = artists(drawn["objective"], "curve a")
    assert curve.get_xydata().tolist() == [[0.5, 900], [2, 900], [2, 500], [9, 500], [9, 400]]
    (gap,) = artists(drawn["gap to the bound"], "curve a")
    assert gap.get_ydata()[[0, -1]] == pytest.approx([100 * 520 / 900, 5])
    assert "proven bound" in legend(figure)
    alone = draw_progress(run())
    assert list(panels(alone)) == ["objective"]
    assert alone.get_suptitle() == "tour"
    twice = draw_progress([run(), run(primal=300.0)], title="both")
    assert {"a 1", "a 2"} <= set(words(twice))


def test_a_run_by_this_version_is_drawn():
    model = ct.load("error-correction/example-1")
    figure = render(draw_progress(ct.solve(model), unit=model.objective_unit))
    assert figure.get_suptitle() == "error-correction/example-1"


@pytest.mark.parametrize(
    ("solutions", "options", "error", "message"),
    [
        ([run(), run(digest="y")], {}, InvalidData, "of one model"),
        ([run(primal=None, dual=1.0)], {}, InvalidData, "one with a plan"),
        ([], {}, InvalidData, "one with a plan"),
        (run(), {"bound": math.inf}, UnsupportedOption, "bound must be a finite number"),
        (run(), {"bound": "low"}, UnsupportedOption, "bound must be a finite number"),
        (run(), {"size": 1}, UnsupportedOption, "size must be"),
    ],
)
def test_progress_that_cannot_be_drawn(solutions, options, error, message):
    with pytest.raises(error, match=message):
        draw_progress(solutions, **options)
