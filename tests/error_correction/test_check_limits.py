"""What each check of a route with corrections accepts: 0.9 of its tolerance, and not 1.1."""

from dataclasses import replace

import numpy as np
import pytest
from check_limits import SCALES, assert_complete, assert_limit, assert_only, pairs

from crosstrack.models import ErrorCorrectionRouting
from crosstrack.models.error_correction import Route, checks

TOLERANCE = 1e-6
#: Points 0 … 5 lie 10 apart on a line, in this order.
KINDS = ["A", "horizontal", "vertical", "horizontal", "vertical", "B"]
ZONE = "no leg through a no-fly polygon"
LIMITS_FREE = dict.fromkeys(("alpha1", "alpha2", "beta1", "beta2", "theta"), 1e4)


def routing(scale, rates=(2.0, 3.0), **changes):
    """Return a model with errors proportional to `scale` and inactive limits unless changed."""
    points = np.outer(np.arange(6.0), [6.0, 0.0, 8.0])
    given = {**LIMITS_FREE, **changes.pop("limits", {})}
    given = {name: scale * value for name, value in given.items()}
    rates = {"horizontal_rate": scale * rates[0], "vertical_rate": scale * rates[1]}
    if "residual" in changes:
        changes["residual"] *= scale
    return ErrorCorrectionRouting(points, KINDS, **given, **rates, **changes)


def threshold(field, error, route, rates=(2.0, 3.0), **changes):
    """Return the case of a threshold that is exceeded by the largest `error` on arrival."""

    def case(scale, share):
        limits = {field: error / (1.0 + share * TOLERANCE)}
        model = routing(scale, rates, limits=limits, **changes)
        return model.verify(Route(route), tolerance=TOLERANCE)

    return case


#: A suspect correction of the worst case leaves the residual, 5 here.
SUSPECT = {"suspect": [False, True, True, False, False, False], "residual": 5.0}
#: Errors are rates times lengths since the last correction: 20 and 30 each leg.
LIMITS = {
    "horizontal error at vertical points": [
        threshold("alpha2", 40.0, [0, 2, 3, 4, 5]),  # at 2, after two legs; 20 at 4
        threshold("alpha2", 60.0, [0, 1, 4, 5]),
        threshold("alpha2", 65.0, [0, 1, 4, 5], **SUSPECT),
    ],
    "vertical error at vertical points": [
        threshold("alpha1", 60.0, [0, 1, 2, 3, 5]),
        threshold("alpha1", 90.0, [0, 2, 3, 1, 4, 5], rates=(2.0, 1.5)),
    ],
    "horizontal error at horizontal points": [
        threshold("beta2", 60.0, [0, 2, 3, 4, 5]),
        threshold("beta2", 20.0, [0, 1, 2, 4, 5]),
    ],
    "vertical error at horizontal points": [
        threshold("beta1", 30.0, [0, 2, 3, 4, 5]),
        threshold("beta1", 90.0, [0, 1, 3, 4, 5]),
    ],
    "horizontal error at B": [
        threshold("theta", 80.0, [0, 1, 4, 5], rates=(2.0, 1.0)),
        threshold("theta", 45.0, [0, 1, 3, 4, 5], residual=5.0, rates=(2.0, 3.0),
                  suspect=[False, False, False, True, False, False]),
    ],
    "vertical error at B": [
        threshold("theta", 90.0, [0, 2, 5], rates=(1.0, 3.0)),
        threshold("theta", 35.0, [0, 2, 3, 4, 5], residual=5.0,
                  suspect=[False, False, False, False, True, False], rates=(1.0, 3.0)),
    ],
}  # fmt: skip
#: Routes with one fault, the number of violations, and the place that the check must name.
FAULTS = {
    "starts at A": [([1, 2, 5], 1, "point b")],
    "ends at B": [([0, 1, 2], 1, "point c")],
    "only correction points between": [([0, 1, 0, 5], 1, "point a"), ([0, 5, 1, 5], 1, "point f")],
    "no point twice": [([0, 1, 2, 1, 5], 1, "point b"), ([0, 2, 2, 5], 1, "point c")],
    "at most 4 corrections": [([0, 1, 2, 3, 4, 1, 5], 1, "")],
}


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize(("name", "case"), pairs(LIMITS))
def test_a_threshold_is_kept_within_its_tolerance(name, case, scale):
    assert_limit(name, lambda share: case(scale, share))


@pytest.mark.parametrize(("name", "fault"), pairs(FAULTS))
def test_one_fault_is_named(name, fault):
    route, number, where = fault
    most = 4 if "corrections" in name else None
    model = routing(
        1.0, revisits=name != "no point twice", corrections_limit=most, ids=list("abcdef")
    )
    assert model.verify(Route([0, 1, 2, 3, 4, 5])).ok
    found = model.verify(Route(route))
    assert_only(name, found)
    assert (found.violated[0].worst, found.violated[0].where) == (number, where)


@pytest.mark.parametrize("route", [[], [0]])
def test_a_route_that_is_too_short_is_refused(route):
    found = routing(1.0).verify(Route(route))
    assert "ends at B" in {check.name for check in found.violated}
    assert ("starts at A" in {check.name for check in found.violated}) == (not route)
    assert found.objective is None


@pytest.mark.parametrize("scale", SCALES)
def test_the_length_is_that_of_the_legs(scale):
    found = routing(scale).verify(Route([0, 2, 1, 5]))
    assert found.objective == pytest.approx(70.0, rel=1e-12)


@pytest.mark.parametrize(
    ("theta", "alpha1", "residual", "chances"),
    [
        # At B, the horizontal error is 40, or 45 if the correction at 3 failed.
        (45.0 * (1.0 - 0.5e-9), 65.0, 5.0, (1.0, 1.0, 1.0, 1.0)),
        (45.0 * (1.0 - 2e-9), 65.0, 5.0, (1.0, 1.0, 1.0, 0.7)),
        (39.0, 65.0, 5.0, (1.0, 1.0, 1.0, 0.0)),
        # At 4, the vertical error is 60, or 65 if the correction at 2 failed.
        (42.0, 62.0, 5.0, (1.0, 1.0, 0.7, 0.7 * 0.7)),
        # A failed correction leaves an error below the residual as it is: 60 + 40 at B.
        (105.0, 125.0, 70.0, (1.0, 1.0, 1.0, 1.0)),
    ],
)
def test_the_chance_of_arrival_counts_every_outcome(theta, alpha1, residual, chances):
    """Corrections at 2, 3 and 4 succeed with 0.7; errors grow by 20 and by 30 on each leg."""
    model = routing(
        1.0, limits={"theta": theta, "alpha1": alpha1}, residual=residual, success=0.7,
        suspect=[False, False, True, True, True, False],
    )  # fmt: skip
    found = [stop.chance for stop in model.walk(Route([0, 2, 3, 4, 5]))]
    assert found == pytest.approx([1.0, *chances], rel=1e-12)


@pytest.mark.parametrize("scale", SCALES)
def test_a_leg_through_a_polygon_is_named(scale):
    """The polygon is between points 2 and 3, and its upper edge on the way from 1 to 2."""
    zone = scale * np.array([[7, 0], [17, -1], [17, 1], [12, 0]])
    model = routing(1.0, rates=(0.0, 0.0), no_fly=[zone], ids=list("abcdef"))
    points = model.points * [scale, scale, 1.0]
    found = replace(model, points=points).verify(Route([0, 1, 2, 3, 5]))
    assert_only(ZONE, found)
    assert (found.violated[0].worst, found.violated[0].where) == (1, "leg c-d")


def test_every_check_is_tested():
    zone = [[[0, 1], [1, 1], [1, 2]]]
    found = routing(1.0, corrections_limit=4, no_fly=zone).verify(Route([0, 1, 5]))
    assert_complete({*LIMITS, *FAULTS, ZONE}, [found], checks)
