"""No-fly zones: exact depths against sampling, verification, detours, bounds, refusals and errors."""

import dataclasses
import json
import math

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation
from crosstrack.models import MessengerTour
from crosstrack.models.messenger.zones import depth, is_inside, size_of

SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
ANGLE = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]])


def sampled(piece, count=4001):
    """Return places on a primitive, in equal steps, by numerical integration."""
    place, heading, bend, length = piece
    s = np.linspace(0, length, count)
    middle = heading + bend * 0.5 * (s[1:] + s[:-1])
    return place + np.append(0, np.cumsum(np.exp(1j * middle) * np.diff(s)))


def distance(places, a, b):
    """Return the distances of places from an edge."""
    share = np.clip(((places - a) * np.conj(b - a)).real / abs(b - a) ** 2, 0, 1)
    return np.abs(places - a - share * (b - a))


def pieces(seed, count):
    draw = np.random.default_rng(seed)
    for _ in range(count):
        bend = draw.choice([0.0, 1.0, -1.0]) / draw.choice([0.3, 1.0, 2.5])
        length = draw.uniform(0, 6 if bend == 0 else min(9.0, 6.28 / abs(bend)))
        yield complex(*draw.uniform(-4, 4, 2)), draw.uniform(0, 6.28), float(bend), float(length)


@pytest.mark.parametrize("seed", range(3))
def test_the_depth_in_a_disc_is_that_of_samples(seed):
    zone = np.array([0.3, -0.2, 1.5])
    for piece in pieces(seed, 60):
        near = np.abs(sampled(piece) - complex(*zone[:2])).min()
        assert 1.5 - near - 1e-5 <= depth(zone, piece) <= 1.5 - near + 3e-3  # steps of up to 2e-3


@pytest.mark.parametrize("count", [60, pytest.param(150, marks=pytest.mark.slow)])
@pytest.mark.parametrize("zone", [SQUARE, ANGLE, ANGLE[::-1] - 1])
def test_the_depth_in_a_polygon_is_positive_exactly_if_samples_are_inside(zone, count):
    corners = zone @ [1, 1j]
    entered = 0
    for piece in pieces(7, count):
        places = sampled(piece, 801)
        inside = np.array([is_inside(zone, place) for place in places.tolist()])
        edges = [distance(places, a, b) for a, b in zip(corners, np.roll(corners, -1), strict=True)]
        true = (np.min(edges, axis=0) * inside).max()
        result = depth(zone, piece)
        assert max(result, 0) >= true - 1e-4
        assert result > 0 or not inside[np.min(edges, axis=0) > 1e-3].any()
        assert result <= 0 or true > 0 or np.min(edges) < 0.05
        assert result > -np.min(edges) - 1e-2
        assert result <= 2 * size_of(zone)
        entered += result > 0
    assert count / 7.5 < entered < count * 14 / 15


@pytest.mark.parametrize(
    ("piece", "least"),
    [
        ((-1j, 0.0, 1.0, 6.3), 0.29),  # inscribed: touches every edge
        ((-3 + 0j, 1.5 * math.pi, 0.5, 14.0), 0.17),  # through two corners
        ((0j, 0.5 * math.pi, -2.0, 6.3), 0.49),  # through the centre, touches an edge
        ((-2 - 2j, 0.25 * math.pi, 0.0, 6.0), 0.99),  # diagonal
        ((-3 - 1j, 0.0, 0.0, 6.0), 0.0),  # along an edge
        ((3 + 1j, math.pi, 1e-9, 14.0), 0.0),  # nearly along an edge
    ],
)
@pytest.mark.parametrize("zone", [SQUARE, SQUARE[::-1]])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6])
def test_corners_and_contacts_do_not_hide_a_crossing(piece, least, zone, scale):
    place, heading, bend, length = piece
    result = depth(zone * scale, (place * scale, heading, bend / scale, length * scale)) / scale
    assert result >= least
    assert least > 0 or result < 1e-6


def wall(**fields):
    """Return a model whose straight flight to the first vehicle crosses a disc and a polygon."""
    zones = [[0.0, 40.0, 15.0], [[-60, 60], [-20, 60], [-40, 90]]]
    return MessengerTour(
        [[0, 90], [-70, 80], [60, 10]], [[0, 0], [1, 0.5], [0, 1]], no_fly=zones, **fields
    )


@pytest.mark.parametrize("closed", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_the_search_flies_around_the_zones_within_the_bound(closed):
    model = wall(closed=closed)
    best = ct.solve(model, seed=1)
    assert best.backend == "detour-search"
    result = model.verify(best.plan)
    assert result.ok
    free = dataclasses.replace(model, no_fly=None)
    relaxed = ct.solve(free, seed=1)
    assert best.dual_bound <= relaxed.primal_bound * (1 + 1e-9) <= best.primal_bound * (1 + 2e-9)
    assert best.primal_bound < 1.6 * relaxed.primal_bound
    # Independent of the analytic check: dense samples of the path.
    place, heading = complex(*best.plan.start[:2]), best.plan.start[2]
    for turn, length in ((p.turn, p.length) for p in best.plan.primitives):
        bend = {"L": 1, "S": 0, "R": -1}[turn] / 5
        places = sampled((place, heading, bend, length), 2001)
        assert np.abs(places - 40j).min() > 15 - 1e-4
        # The triangle shrunk by 1e-3.
        inner = model.no_fly[1] + 1e-4 * (model.no_fly[1].mean(axis=0) - model.no_fly[1])
        assert not any(is_inside(inner, one) for one in places[::10].tolist())
        place, heading = places[-1], heading + bend * length
    assert closed or ct.solve(model, seed=1).plan == best.plan
    crossing = model.verify(relaxed.plan)
    assert [check.name for check in crossing.violated] == ["clear of no-fly zones"]
    assert ct.solve(model, "curvature-bound").dual_bound <= best.primal_bound * (1 + 1e-9)


@pytest.mark.parametrize("zone", [[50, 50, 1e-12], [[50, 50], [50 + 1e-12, 50], [50, 50 + 1e-12]]])
def test_a_tiny_zone_far_from_the_path_is_decidable(zone):
    model = MessengerTour([[0, 90]], no_fly=[zone])
    plan = ct.solve(MessengerTour([[0, 90]]), seed=1).plan
    assert model.verify(plan).ok


def test_zones_off_the_path_do_not_change_the_optimum():
    model = MessengerTour([[0, 90]], no_fly=[[300, 300, 20]])
    best = ct.solve(model, seed=1)
    assert best.termination == "optimal"
    assert best.primal_bound == pytest.approx(85, rel=1e-6)


def test_a_vehicle_inside_a_zone_is_refused_without_a_claim():
    model = MessengerTour([[0, 60]], radius=5, no_fly=[[0, 60, 20]])
    best = ct.solve(model, seed=1, time_limit=5)
    assert best.plan is None and best.termination == "no_solution"
    assert "does not prove" in best.message
    assert ct.diagnose(model, time_limit=3).feasible is None


def test_other_methods_refuse_zones_by_name():
    model = wall()
    for name in ("tour-search", "memetic", "greedy-boundary", "crew-search"):
        with pytest.raises(UnsupportedFormulation, match=r"no_fly|one UAV"):
            ct.solve(model, name)
    with pytest.raises(UnsupportedFormulation, match="no_fly"):
        model.formulate("primitives")
    with pytest.raises(UnsupportedFormulation, match="without no-fly zones"):
        ct.solve(MessengerTour([[0, 90]]), "detour-search")


def test_json_and_plot_contain_the_zones():
    model = wall()
    again = MessengerTour.from_data(json.loads(json.dumps(model.data())))
    assert again.digest == model.digest != dataclasses.replace(model, no_fly=None).digest
    assert MessengerTour([[0, 90]], no_fly=[]).digest == MessengerTour([[0, 90]]).digest
    assert "2 no-fly zones" in model.describe()
    figure = ct.plot(model)
    marks = [artist.get_gid() for axes in figure.axes for artist in axes.get_children()]
    assert marks.count("no-fly") == 2


@pytest.mark.parametrize(
    "zones",
    [
        3, "disc", [[1, 2]], [[1, 2, 0]], [[1, 2, -3]], [[1, 2, math.nan]], [[[0, 9], [1, 9]]],
        [[[0, 9], [1, 9], [2, 9]]], [[[0, 9, 1], [1, 9, 1], [2, 8, 1]]], [[0, 0, 5]], [None], [[]],
        [[[-9, -9], [9, -9], [0, 20]]], np.array(3.0), [[[0, 9], [1]]],
    ],
)  # fmt: skip
def test_rejects_invalid_zones(zones):
    with pytest.raises(InvalidData, match="no_fly") as error:
        MessengerTour([[0, 90]], no_fly=zones)
    assert error.value.field.startswith("no_fly")


def test_a_repeated_corner_does_not_end_the_search():
    corners = [[-5, 50], [-5, 50], [5, 50], [5, 60], [-5, 60]]
    best = ct.solve(MessengerTour([[0, 90]], no_fly=[corners]), seed=1, time_limit=20)
    plain = ct.solve(MessengerTour([[0, 90]], no_fly=[corners[1:]]), seed=1, time_limit=20)
    assert best.plan is not None and best.primal_bound == pytest.approx(
        plain.primal_bound, rel=0.02
    )


def test_rejects_zones_in_wind():
    with pytest.raises(InvalidData, match="relative to the air"):
        MessengerTour([[0, 90]], no_fly=[[50, 50, 5]], wind=[1, 0])
