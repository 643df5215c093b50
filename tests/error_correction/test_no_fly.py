"""No-fly polygons: exact crossings, equal optima of all backends, refusals, checks and files."""

import itertools
import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import shapely
from error_correction.test_suspects import routes

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation
from crosstrack.instances.error_correction import random_small
from crosstrack.models import Route
from crosstrack.models.error_correction.arc_flow import ArcFlowFormulation
from crosstrack.models.error_correction.no_fly import crosses, free_legs
from crosstrack.models.error_correction.paper import PaperFormulation
from crosstrack.models.grid_path import Polygon, Polygons

SQUARE = [[0, 0], [4, 0], [4, 4], [0, 4]]
#: Legs and whether they cross the square.
LEGS = {
    "through": ([-1, 1], [5, 2], True),
    "along the diagonal": ([0, 0], [4, 4], True),
    "into": ([-1, 1], [1, 1], True),
    "within": ([1, 1], [2, 2], True),
    "from the boundary inwards": ([0, 2], [1, 2], True),
    "of length zero within": ([1, 1], [1, 1], True),
    "past": ([5, 0], [5, 4], False),
    "along an edge": ([-1, 0], [5, 0], False),
    "through a corner": ([-1, 1], [1, -1], False),
    "to the boundary": ([-1, 2], [0, 2], False),
    "of length zero on the boundary": ([0, 2], [0, 2], False),
}


def restricted(seed, revisits=False):
    """Return a small model of whole numbers with polygons on a grid, so that legs often touch them."""
    rng = np.random.default_rng([363, seed])
    model = random_small(int(rng.integers(3, 7)), seed, revisits=revisits)
    step = float(np.ptp(model.points[:, :2])) / 8
    points = model.points.copy()
    points[:, :2] = np.round(points[:, :2] / step)
    points[:, 2] /= step
    model = replace(
        model, points=points,
        horizontal_rate=model.horizontal_rate * step, vertical_rate=model.vertical_rate * step,
    )  # fmt: skip
    zones = []
    for _ in range(int(rng.integers(1, 4))):
        corner = rng.choice(points)[:2] + rng.integers(-2, 2, 2)
        offsets = np.array([[0, 0], [rng.integers(1, 4), 0], [0, rng.integers(1, 4)]])
        zones.append((corner + offsets).tolist())
    return replace(model, no_fly=zones)


def shortest(model):
    """Return the least length over all simple routes, with crossings by Shapely; inf without a route.

    All coordinates are small integers, for which Shapely's predicates are exact.
    """
    zones = shapely.polygons([zone.shell for zone in model.no_fly])
    plain, least = replace(model, no_fly=None), math.inf
    for route in routes(model):
        checked = plain.verify(route)
        if checked.ok and checked.objective < least:
            places = model.points[list(route.route), :2]
            legs = shapely.linestrings(np.stack([places[:-1], places[1:]], 1))
            ends = shapely.points(places)
            meets = shapely.relate_pattern(legs[:, None], zones, "T********")
            if not (meets.any() or shapely.contains_properly(zones[:, None], ends).any()):
                least = checked.objective
    return least


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6, 1e200])
@pytest.mark.parametrize("case", LEGS)
def test_a_leg_crosses_the_open_interior(case, scale):
    first, last, wanted = LEGS[case]
    square = Polygon(scale * np.array(SQUARE, float))
    for one, other in ((first, last), (last, first)):
        assert crosses(scale * np.array(one), scale * np.array(other), square) == wanted


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6])
def test_the_fast_decision_equals_the_exact_one(scale):
    """For all pairs of whole points, some of them inside, on edges or at corners of two polygons."""
    draw = np.random.default_rng(7)
    points = scale * np.column_stack([draw.integers(0, 9, (20, 2)), draw.random(20)])
    hole = np.array([[3, 3], [5, 3], [5, 5]])
    zones = Polygons().coerce(
        "no_fly",
        [(scale * np.array([[1, 1], [7, 1], [7, 7], [4, 6], [1, 7]]), [scale * hole]),
         scale * np.array([[7, 2], [8, 2], [8, 3]])],
        {},
    )  # fmt: skip
    free = free_legs(points, zones)
    for i, j in itertools.combinations(range(20), 2):
        wanted = not any(crosses(points[i], points[j], zone) for zone in zones)
        assert free[i, j] == free[j, i] == wanted, (i, j)
    assert 30 < free.sum() / 2 < 160 and not free.diagonal().any()


def test_a_hole_is_free():
    ring = Polygon(np.array(SQUARE, float), (np.array([[1, 1], [3, 1], [3, 3], [1, 3]], float),))
    assert not crosses([1.0, 1.0], [3.0, 3.0], ring)
    assert crosses([2.0, 2.0], [2.0, 5.0], ring)


def test_a_crossing_by_one_rounding_error_is_detected():
    """The tip of the triangle is above the leg by half of the spacing of numbers, or touches it."""
    end = [3.0, 1.0]
    for tip, wanted in (
        (1 / 3, Fraction(1 / 3) > Fraction(1, 3)),
        (math.nextafter(1 / 3, 1), True),
    ):
        zone = Polygon(np.array([[1.0, tip], [0.5, -1.0], [1.5, -1.0]]))
        assert crosses([0.0, 0.0], end, zone) == wanted


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    "seed", [*range(24), *(pytest.param(k, marks=pytest.mark.slow) for k in range(24, 300))]
)
def test_all_backends_equal_brute_force(seed):
    model = restricted(seed)
    wanted = shortest(model)
    for backend in ("auto", "highs") if seed % 4 == 0 else ("auto",):
        found = ct.solve(model, backend)
        assert found.termination == ("infeasible" if math.isinf(wanted) else "optimal")
        if found.plan is not None:
            assert found.primal_bound == pytest.approx(wanted, rel=1e-9)
            assert "no leg through a no-fly polygon" in {
                check.name for check in found.verification.checks
            }
    if seed % 8 == 0:
        found = ct.solve(model, "highs", formulation="paper")
        assert found.termination == ("infeasible" if math.isinf(wanted) else "optimal")
        assert found.plan is None or found.primal_bound == pytest.approx(wanted, rel=1e-9)


def test_polygons_change_optima():
    changed = [
        shortest(restricted(k))
        != shortest(replace(restricted(k), no_fly=[[[99, 99], [98, 99], [99, 98]]]))
        for k in range(24)
    ]
    assert sum(changed) >= 3


@pytest.mark.parametrize(
    "backend", ["label-setting", "labelling", "pulse", "two-stage", "dynamic-programming"]
)
def test_backends_for_one_error_refuse_polygons(backend):
    with pytest.raises(UnsupportedFormulation, match="no-fly polygons"):
        ct.solve(restricted(0), backend)


def test_a_program_refuses_a_route_through_a_polygon():
    model = replace(
        ct.load("error-correction/example-1"), no_fly=[[[1.5, -1], [2.5, -1], [2.5, 1], [1.5, 1]]]
    )
    for formulation in (ArcFlowFormulation, PaperFormulation):
        with pytest.raises(InvalidData):
            formulation(model).encode(Route((0, 1, 2, 4)))
    assert not ct.diagnose(model).feasible


def test_the_file_form_and_the_digest():
    model = restricted(1)
    assert type(model).from_dict(model.to_dict()) == model
    assert "no_fly" not in replace(model, no_fly=None).data()
    assert replace(model, no_fly=None).digest != model.digest
    assert replace(model, no_fly=[SQUARE]).describe().endswith("; 1 no-fly polygon")
    assert replace(model, no_fly=[SQUARE] * 2).describe().endswith("; 2 no-fly polygons")


@pytest.mark.parametrize(
    ("zones", "message"),
    [
        ([[[0, 0], [1, 1], [1, 0], [0, 1]]], "rings do not cross"),
        ([[[0, 0], [1, 1]]], "at least 3 different points"),
        ([[[0, 0], [1, math.nan], [1, 0]]], r"no_fly\[0\]"),
        (7, "list of polygons"),
    ],
)
def test_a_bad_polygon_is_named(zones, message):
    with pytest.raises(InvalidData, match=message):
        replace(restricted(0), no_fly=zones)


def test_too_many_points_are_refused():
    model = restricted(0)
    count = 4001
    points = np.zeros((count, 3))
    points[:, 0] = np.arange(count)
    kinds = ["A", *["horizontal"] * (count - 2), "B"]
    with pytest.raises(UnsupportedFormulation, match="4,000 points"):
        replace(model, points=points, kinds=kinds, ids=None).lower()


def test_a_route_through_a_polygon_is_drawn_as_violated():
    pytest.importorskip("matplotlib", reason="pictures need the extra plot")
    from pictures import legend

    from crosstrack.models.error_correction.plot import violated_stops

    model = replace(
        ct.load("error-correction/example-1"), no_fly=[[[1.5, -1], [2.5, -1], [2.5, 1], [1.5, 1]]]
    )
    route = Route((0, 1, 2, 4))
    assert violated_stops(model, model.walk(route)) == [1, 2, 3]
    assert {"no-fly polygon", "rule broken"} <= set(legend(ct.plot(model, route)))
    assert "no-fly polygon" not in legend(ct.plot(replace(model, no_fly=None), route))
