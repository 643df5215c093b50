"""What each check of paths on a map accepts: 0.9 of its tolerance, and not 1.1."""

import numpy as np
import pytest
from check_limits import SCALES, assert_complete, assert_limit, assert_only, pairs

from crosstrack.models import GridPath
from crosstrack.models.grid_path import GridPlan, checks

TOLERANCE = 1e-6
OPEN = ["....", "....", "....", "...."]
ONE = ["....", ".@..", "....", "...."]


def verified(paths, lines, ends, scale=1.0, tolerance=TOLERANCE, origin=(0.0, 0.0), **fields):
    """Return the verification of paths in cells, x and y, on a map whose cells are `scale` wide."""
    start, goals = ends
    fields = {"connectivity": "any", **fields}
    grid = {"blocked": lines, "cell": scale, "origin": origin}
    plan = GridPlan([scale * np.array(path) + origin for path in paths])
    return GridPath(grid, start, goals, **fields).verify(plan, tolerance=tolerance)


def path(lines, ends, points, **fields):
    """Return the case of one path of points that depend on a depth, in cells."""

    def case(scale, share):
        e = share * TOLERANCE
        return verified([points(e)], lines, ends, scale, **fields)

    return case


def turned(lines, ends, points):
    """Return the case with x and y swapped."""
    lines = ["".join(column) for column in zip(*lines, strict=True)]
    ends = tuple(cell[::-1] for cell in ends)
    return path(lines, ends, lambda e: [p[::-1] for p in points(e)])


def far(scale, share):
    """Ten million cells from the origin, digits leave open more than the tolerance allows."""
    tolerance = 1e-9
    e = share * (tolerance + 1e-13 * (1e7 + 4))
    points = [[0.5 + e, 0.5], [2.5, 0.5]]
    origin = (-1e7 * scale, 1e6 * scale)
    return verified([points], OPEN, ((0, 0), (0, 2)), scale, tolerance, origin)


def long(scale, share):
    """Digits of 12 cells count beside so small a tolerance."""
    e = share * (1e-12 + 12e-13)
    points = [[0.5, 0.5], [11.5, 0.5 + e]]
    return verified([points], ROW, ((0, 0), (0, 11)), scale, 1e-12)


def second_goal(scale, share):
    e = share * TOLERANCE
    points = [[[0.5, 0.5], [1.5, 0.5]], [[0.5, 0.5], [0.5, 2.5 + e]]]
    return verified(points, OPEN, ((0, 0), [(0, 1), (2, 0)]), scale, reach="each")


def second_start(scale, share):
    e = share * TOLERANCE
    points = [[[0.5, 0.5], [1.5, 0.5]], [[0.5, 0.5 + e], [0.5, 2.5]]]
    return verified(points, OPEN, ((0, 0), [(0, 1), (2, 0)]), scale, reach="each")


ACROSS, AROUND = ((0, 0), (0, 2)), ((1, 0), (0, 1))
WALL, ROW = ["....", ".@@.", "....", "...."], ["." * 12, "....." + "@" + "." * 6, "." * 12]
LIMITS = {
    "starts at its cell": [
        path(OPEN, ACROSS, lambda e: [[0.5 + 0.6 * e, 0.5 - 0.8 * e], [2.5, 0.5]]),
        path(OPEN, ACROSS, lambda e: [[0.5 - e, 0.5], [2.5, 0.5]]),
        second_start,
        far,
    ],
    "ends at its goal": [
        path(OPEN, ACROSS, lambda e: [[0.5, 0.5], [2.5 - 0.8 * e, 0.5 + 0.6 * e]]),
        path(OPEN, ((0, 0), [(3, 3), (0, 2)]), lambda e: [[0.5, 0.5], [2.5, 0.5 + e]]),
        second_goal,
        long,
    ],
    "keeps to free cells": [
        # A turn within a cell, a cut corner, a turn beyond the map, and one between two cells.
        path(ONE, ACROSS, lambda e: [[0.5, 0.5], [1.5, 1 + e], [2.5, 0.5]]),
        path(ONE, AROUND, lambda e: [[0.5, 1.5], [0.6 + e, 1.4 + e], [1.4 + e, 0.6 + e], [1.5, 0.5]]),
        path(OPEN, ACROSS, lambda e: [[0.5, 0.5], [1.5, -e], [2.5, 0.5]]),
        path(OPEN, ((0, 3), (2, 3)), lambda e: [[3.5, 0.5], [4 + e, 1.5], [3.5, 2.5]]),
        path(WALL, ((0, 0), (0, 3)), lambda e: [[0.5, 0.5], [2, 1 + e], [3.5, 0.5]]),
        turned(WALL, ((0, 0), (0, 3)), lambda e: [[0.5, 0.5], [2, 1 + e], [3.5, 0.5]]),
        # Along a side in one long segment, which is clipped apart from short ones.
        path(ROW, ((0, 0), (0, 11)), lambda e: [[0.5, 0.5], [0.6, 1 + e], [11.4, 1 + e], [11.5, 0.5]]),
        turned(ROW, ((0, 0), (0, 11)), lambda e: [[0.5, 0.5], [0.6, 1 + e], [11.4, 1 + e], [11.5, 0.5]]),
        # The deepest point is nearer to one end of the part within the cell than to its middle.
        path(ONE, ACROSS, lambda e: [[0.5, 0.5], [1.0, 1.0], [1.9, 1 + e], [2.5, 0.5]]),
    ],
    "points at centres of cells": [
        path(OPEN, ACROSS, lambda e: [[0.5, 0.5], [1.5 - e, 0.5], [2.5, 0.5]], connectivity="8"),
        path(OPEN, ACROSS, lambda e: [[0.5, 0.5], [1.5, 0.5 + e], [2.5, 0.5]], connectivity="4"),
    ],
}  # fmt: skip


def line(*cells):
    """Return the centres of cells, which are given as row and column."""
    return [[column + 0.5, row + 0.5] for row, column in cells]


STRAIGHT = line((0, 0), (0, 1), (0, 2))
RISING, FALLING = ["@.", ".@"], [".@", "@."]


def squeezed(lines, shift, *, bent):
    """Return a fault and its ends: a path past the corner of two cells, off by `shift` cells."""
    corner = np.array([1 + shift, 1 + shift if lines is RISING else 1 - shift])
    ends = ((0, 1), (1, 0)) if lines is RISING else ((0, 0), (1, 1))
    begin, end = (np.array(cell[::-1]) + 0.5 for cell in ends)
    # Not at a right angle, and from farther on one side of the corner than on the other.
    slanted = [corner + (begin - 1) * [0.8, 0.4], corner - (begin - 1) * [0.4, 0.2]]
    points = [begin, *([corner] if bent else slanted), end]
    return [points], lines, ends, {}


EIGHT, FOUR = {"connectivity": "8"}, {"connectivity": "4"}
#: Paths with one fault: paths, map, ends and fields.
FAULTS = {
    "one path": [([], OPEN, ACROSS, {}), ([STRAIGHT, STRAIGHT], OPEN, ACROSS, {})],
    "one path for each goal": [
        ([STRAIGHT], OPEN, ((0, 0), [(0, 2), (0, 2)]), {"reach": "each"}),
        ([STRAIGHT, STRAIGHT], OPEN, ((0, 0), [(0, 2)]), {"reach": "each"}),
    ],
    "not between cells that touch": [
        squeezed(lines, sign * shift, bent=bent)
        for lines in (RISING, FALLING)
        for shift in (0.0, 1e-12, 1e-8, 0.9 * TOLERANCE)
        for sign in (1, -1)
        for bent in (True, False)
    ],
    "steps to neighbours": [
        ([line((0, 0), (0, 2))], OPEN, ACROSS, EIGHT),
        ([line((0, 0), (2, 0))], OPEN, ((0, 0), (2, 0)), FOUR),
        ([line((0, 0), (1, 2), (0, 2))[:2]], OPEN, ((0, 0), (1, 2)), EIGHT),
        ([line((0, 0), (0, 1), (0, 1), (0, 2))], OPEN, ACROSS, EIGHT),
        ([line((0, 0), (1, 1))], OPEN, ((0, 0), (1, 1)), FOUR),
        ([line((0, 0), (1, 1))], ["..", "@."], ((0, 0), (1, 1)), FOUR),
        ([line((0, 1), (1, 0))], [".@", ".."][::-1], ((0, 1), (1, 0)), EIGHT),
        ([line((0, 1), (1, 0))], ["@.", ".."], ((0, 1), (1, 0)), EIGHT),
        ([line((0, 0), (1, 1))], [".@", ".."], ((0, 0), (1, 1)), EIGHT),
        ([line((0, 0), (0, 1), (1, 2), (1, 3))], ["..@.", "...."], ((0, 0), (1, 3)), EIGHT),
        ([line((0, 0), (1, 1))], ["..", "@."], ((0, 0), (1, 1)), EIGHT),
    ],
}


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize(("name", "case"), pairs(LIMITS))
def test_a_limit_is_kept_within_its_tolerance(name, case, scale):
    assert_limit(name, lambda share: case(scale, share))


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize(("name", "fault"), pairs(FAULTS))
def test_one_fault_is_named(name, fault, scale):
    *given, fields = fault
    found = verified(*given, scale, **fields)
    assert_only(name, found)
    # A turn on the diagonal of two cells may count once for each of its two segments.
    assert 1.0 <= found.violated[0].worst <= (2.0 if name.startswith("not between") else 1.0)


@pytest.mark.parametrize("scale", SCALES)
def test_paths_without_fault_are_accepted(scale):
    corner = [[1.5, 0.5], [1.1, 0.9], [1.5, 0.1], [1.5, 0.5]]  # near two cells that touch
    assert verified([corner], RISING, ((0, 1), (0, 1)), scale).ok
    diagonal = line((0, 0), (1, 1), (2, 1), (3, 2))
    found = verified([diagonal], OPEN, ((0, 0), (3, 2)), scale, **EIGHT)
    assert found.ok
    assert found.objective == pytest.approx(scale * (1 + 2 * 2**0.5), rel=1e-12)
    assert verified([line((0, 0), (1, 0), (1, 1))], OPEN, ((0, 0), (1, 1)), scale, **FOUR).ok


@pytest.mark.parametrize("scale", SCALES)
def test_a_step_costs_the_mean_weight_of_its_cells(scale):
    weights = 1.0 + np.arange(16.0).reshape(4, 4)
    points = [line((0, 0), (1, 1), (1, 2))]
    found = verified(points, OPEN, ((0, 0), (1, 2)), scale, weights=weights, **EIGHT)
    assert found.objective == pytest.approx(scale * (2**0.5 * 3.5 + 6.5), rel=1e-12)


@pytest.mark.parametrize("place", range(10))
def test_every_segment_of_a_long_path_is_clipped(place, monkeypatch):
    """Segments are taken in groups, here of 4; one of 10 leads through the blocked cell."""
    monkeypatch.setattr(checks, "MOST", 4)
    points = [[0.5, 1.5]] * (1 + place) + [[2.5, 1.5]] * (10 - place)
    found = verified([points], ONE, ((1, 0), (1, 2)))
    assert_only("keeps to free cells", found)
    assert found.violated[0].where == f"path 0, segment {place}"
    assert found.violated[0].worst == pytest.approx(0.5)


@pytest.mark.parametrize("shift", [0.4, 3.0])
@pytest.mark.parametrize("point", [1, 2, 3])
def test_the_segment_that_leaves_the_map_is_named(point, shift):
    """A point outside ends the segment before it, also if it is far outside."""
    model = GridPath(
        {"blocked": np.zeros((3, 9), bool).tolist()}, (1, 0), (1, 8), connectivity="any"
    )
    path = np.array([[0.5, 1.5], [2.5, 1.5], [4.5, 1.5], [6.5, 1.5], [8.5, 1.5]])
    path[point, 1] = 3.0 + shift
    plan = GridPlan([path.tolist()])
    (check,) = model.verify(plan).violated
    assert check.where == f"path 0, segment {point - 1}"


@pytest.mark.parametrize("point", [[1.0, -1e308], [4.0, 1e308], [-1e308, 2.0]])
def test_a_point_beyond_all_floats_is_refused(point):
    """In cells of a thousandth of a metre, it is infinitely far away."""
    model = GridPath({"blocked": RISING, "cell": 1e-3}, (0, 1), (0, 1), connectivity="any")
    home = [1.5e-3, 0.5e-3]
    found = model.verify(GridPlan([[home, point, home]]))
    assert_only("keeps to free cells", found)
    assert found.violated[0].worst == np.inf


def test_every_check_is_tested():
    ends = ((0, 0), [(0, 2)])
    found = [
        verified([STRAIGHT], OPEN, ends, connectivity=connectivity, reach=reach)
        for connectivity in ("8", "any")
        for reach in ("nearest", "each")
    ]
    assert_complete({*LIMITS, *FAULTS}, found, checks)
