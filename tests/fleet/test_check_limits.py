"""What each check of a fleet's routes accepts: 0.9 of its tolerance, and not 1.1."""

import numpy as np
import pytest
from check_limits import SCALES, assert_complete, assert_limit, assert_only, pairs

from crosstrack.errors import InvalidData
from crosstrack.models import FleetRouting
from crosstrack.models.fleet import FleetPlan, checks

TOLERANCE = 1e-6
POINTS = np.array([[0.0, 0.0], [0.0, 3.0], [4.0, 3.0], [4.0, 0.0]])
#: Nodes 1 and 2 on one route, node 3 on the other: 3 + 4 + 5 and twice 4.
PLAN, LOADS = FleetPlan([[1, 2], [3]]), np.array([12.0, 8.0])


def fleet(scale, **limits):
    return FleetRouting(2, points=scale * POINTS, **limits)


def within(value, share, noise=0.0):
    """Return the limit that `value` exceeds by `share` of the tolerance of that limit and `noise`."""
    return (value - share * noise) / (1.0 + share * TOLERANCE)


def whole(field, value, loads=LOADS, plan=PLAN):
    """Return the case of a limit on all routes together."""
    noise = 1e-12 * max(loads)

    def case(scale, share):
        limit = within(scale * value, share, scale * noise)
        return fleet(scale, **{field: limit}).verify(plan, tolerance=TOLERANCE)

    return case


def each(field, values, vehicle, other=1e3, **more):
    """Return the case of a limit of each vehicle: `vehicle` alone exceeds its own."""

    def case(scale, share):
        limits = np.full(2, other * scale)
        limits[vehicle] = within(scale * values[vehicle], share)
        given = {name: scale * np.array(value) for name, value in more.items()}
        return fleet(scale, **{field: limits}, **given).verify(PLAN, tolerance=TOLERANCE)

    return case


def budget_near_rounding(scale, share):
    """The rounding of the lengths is accepted in addition to a much smaller tolerance."""
    tolerance, noise = 1e-12, 1e-12 * 12.0
    limit = (20.0 - share * noise) / (1.0 + share * tolerance)
    return fleet(scale, budget=scale * limit).verify(PLAN, tolerance=tolerance)


def no_battery(scale, share):
    """A battery of 0 is scaled by the longest distance, 5."""
    points = np.vstack([POINTS, [0.5 * share * TOLERANCE * 5.0, 0.0]])
    model = FleetRouting(2, points=scale * points, battery=[0.0, 20.0 * scale])
    return model.verify(FleetPlan([[4], [1, 2, 3]]), tolerance=TOLERANCE)


def worst_share(scale, share):
    """The vehicle that exceeds most of its own limit decides, not the one that exceeds by most."""
    limits = [within(12.0, 0.8 * share), within(8.0, share)]
    found = fleet(scale, battery=scale * np.array(limits)).verify(PLAN, tolerance=TOLERANCE)
    assert share == 0.0 or "vehicle 1" in {check.where for check in found.checks}
    return found


DEMANDS = [0.0, 1.0, 2.0, 5.0]
LIMITS = {
    "demands within capacity": [
        each("capacity", [3.0, 5.0], 0, demands=DEMANDS),
        each("capacity", [3.0, 5.0], 1, demands=DEMANDS),
    ],
    "route within battery": [
        each("battery", LOADS, 0),
        each("battery", LOADS, 1),
        no_battery,
        worst_share,
    ],
    "sum within budget": [whole("budget", 20.0), budget_near_rounding],
    "deviation within limit": [whole("deviation_limit", np.std(LOADS, ddof=1))],
    "range within limit": [whole("range_limit", 4.0)],
}


def limited(scale, **more):
    """Return a fleet with every limit, for which `PLAN` is feasible."""
    return fleet(
        scale, demands=scale * np.array(DEMANDS), capacity=8 * scale, battery=14 * scale,
        budget=30 * scale, deviation_limit=12 * scale, range_limit=16 * scale, **more,
    )  # fmt: skip


#: Routes with one fault, and the place that the check must name.
FAULTS = {
    "one route for each vehicle": [([[1, 2, 3]], ""), ([[1], [2], [3]], "")],
    "each node visited once": [
        ([[1, 2], [2, 3]], "node 2"),
        ([[1], [3]], "node 2"),
        ([[2], [3]], "node 1"),
        ([[1, 2, 0], [3]], "node 0"),
    ],
    "every vehicle used": [([[1, 2, 3], []], "vehicle 1"), ([[], [1, 2, 3]], "vehicle 0")],
}


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize(("name", "case"), pairs(LIMITS))
def test_a_limit_is_kept_within_its_tolerance(name, case, scale):
    assert_limit(name, lambda share: case(scale, share))


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize(("name", "fault"), pairs(FAULTS))
def test_one_fault_is_named(name, fault, scale):
    routes, where = fault
    model = limited(scale)
    assert model.verify(PLAN).ok
    found = model.verify(FleetPlan(routes))
    assert_only(name, found)
    assert found.violated[0].where == where
    assert found.violated[0].worst == 1.0
    assert (found.objective is None) == (name == "one route for each vehicle")


@pytest.mark.parametrize(
    ("objective", "value"),
    [
        ("sum", 20.0),
        ("max", 12.0),
        ("range", 4.0),
        ("max-sum", 12.0 + 20e-6),
        ("sum-variance", 20.0 + 3.0 * 4.0),
        ("sum-deviation", 20.0 + 3.0 * 8.0**0.5),
    ],
)
def test_objectives_are_those_of_the_lengths_12_and_8(objective, value):
    model = fleet(1.0, objective=objective, q=3.0 * objective.startswith("sum-"))
    found = model.verify(PLAN)
    assert found.objective == pytest.approx(value, rel=1e-12)
    assert found.scale == (10.0 if objective == "range" else 0.0)


def test_an_idle_vehicle_is_accepted_unless_all_are_used():
    assert fleet(1.0, use_all=False).verify(FleetPlan([[1, 2, 3], []])).ok


def test_vehicles_return_to_their_depots():
    model = FleetRouting(2, points=POINTS, depots=[0, 3], battery=[6.0, 6.0])
    assert model.verify(FleetPlan([[1], [2]])).ok
    crossed = model.verify(FleetPlan([[2], [1]]))
    assert_only("route within battery", crossed)
    assert crossed.objective == pytest.approx(10.0)


@pytest.mark.parametrize("node", [-1, 4])
def test_a_node_that_does_not_exist_is_refused(node):
    with pytest.raises(InvalidData, match=rf"routes\[1\]\[1\] must be in 0 … 3, got {node}"):
        fleet(1.0).verify(FleetPlan([[1, 2], [3, node]]))


def test_every_check_is_tested():
    assert_complete({*LIMITS, *FAULTS}, [limited(1.0).verify(PLAN)], checks)
