"""Violations detected by each check of a guided vehicle's tour; checks are counts, so one suffices."""

import dataclasses
import itertools

import pytest
from check_limits import SCALES, assert_complete, assert_only, pairs

from crosstrack.errors import InvalidData
from crosstrack.models import GuidedPathTour
from crosstrack.models.guided_path import checks
from crosstrack.models.guided_path.plan import GuidedPathPlan

#: Orders with one fault, and the place that the check must report.
FAULTS = {
    "each customer served once": [
        ([3, 4, 2], "customer a"),
        ([3, 4, 1], "customer b"),
        ([4, 2, 1], "customer c"),
        ([3, 4, 2, 1, 1], "customer a"),
        ([3, 4, 2, 1, 2], "customer b"),
    ],
    "precedence": [
        ([1, 3, 4, 2], "c before a"),
        ([2, 4, 3, 1], "d before b"),
        ([3, 1, 2, 4], "d before b"),
    ],
}


#: Faults of a tour with optional fields: order, vehicles and place, and the largest violation.
FIELD_FAULTS = {
    "load within 0 … capacity": [((1, 3, 2), (0, 0, 0), "customer 3", 1.0)],
    "chain served by one vehicle": [((1, 3, 2), (0, 1, 1), "chain 0", 1.0)],
    "begin within the time window": [((3, 1, 2), (1, 0, 0), "customer 3", 2.0)],
    "end of the tour in time": [((1, 2, 3), (1, 1, 1), "end of the tour", 8.0)],
}


def extended(scale, shut=30.0):
    """Two vehicles at -1 and 4 that serve 1 (pick up) and 2 (set down) at 1 and -2, and 3 at 4."""
    return GuidedPathTour(
        [scale * x for x in (-1.0, 1.0, -2.0, 4.0)],
        chains=[[1, 2]],
        vehicles=[-1.0 * scale, 4.0 * scale],
        loads=[0.0, 1.0, -1.0, 1.0],
        capacity=1.0,
        speed=scale,
        windows=[[0.0, shut], [0.0, 9.0], [0.0, None], [0.0, None]],
        service=[0.0, 1.0, 1.0, 5.0],
    )


def tour(scale):
    return GuidedPathTour(
        [scale * x for x in (0.0, 1.0, -2.0, 3.0, -4.0)],
        chains=[[0, 3, 1]],
        precedence=[[4, 2]],
        ids=["depot", "a", "b", "c", "d"],
    )


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize(("name", "fault"), pairs(FAULTS))
def test_one_fault_is_named(name, fault, scale):
    order, where = fault
    found = tour(scale).verify(GuidedPathPlan(order))
    assert_only(name, found)
    assert found.violated[0].where == where
    assert found.violated[0].worst == 1.0


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("order", [(3, 1, 4, 2), (4, 2, 3, 1), (3, 4, 1, 2), (4, 3, 2, 1)])
def test_a_tour_without_fault_is_accepted(order, scale):
    found = tour(scale).verify(GuidedPathPlan(order))
    assert found.ok, str(found)
    stops = [(0.0, 1.0, -2.0, 3.0, -4.0)[k] for k in (0, *order, 0)]
    length = sum(abs(b - a) for a, b in itertools.pairwise(stops))
    assert found.objective == pytest.approx(scale * length, rel=1e-12)


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("share", [0.9, 1.1])
def test_the_end_of_a_tour_may_be_late_by_the_tolerance(scale, share):
    # Vehicle 0 serves 1 and 2 and returns: 2 + 1 + 3 + 1 + 1 = 8 s. Vehicle 1 needs 5 s.
    model = extended(scale, 8.0 / (1 + share * 1e-6))
    found = model.verify(GuidedPathPlan((1, 2, 3), (0, 0, 1)))
    assert [check.name for check in found.violated] == ["end of the tour in time"] * (share > 1)
    assert found.objective == pytest.approx(6 * scale, rel=1e-12)


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("share", [0.9, 1.1])
def test_the_tolerance_of_loads_is_relative_to_the_largest_pickup_or_delivery(scale, share):
    pickups, excess = [scale] * 4, 4 * share * 1e-6
    model = GuidedPathTour([0, 1, 2, 3, 4, 5], loads=[0, *pickups, -scale * (4 + excess)])
    found = model.verify(GuidedPathPlan((1, 2, 3, 4, 5)))
    assert [check.name for check in found.violated] == ["load within 0 … capacity"] * (share > 1)


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize(("name", "fault"), pairs(FIELD_FAULTS))
def test_one_fault_of_an_optional_field_is_named(name, fault, scale):
    order, vehicles, where, worst = fault
    model = extended(scale, 11.0 if name == "end of the tour in time" else 30.0)
    if name == "begin within the time window":
        model = dataclasses.replace(
            model, windows=[[0, 30], [0, 9], [0, None], [2, 3]], service=[5, 1, 1, 5]
        )
    found = model.verify(GuidedPathPlan(order, vehicles))
    assert_only(name, found)
    (check,) = found.violated
    assert check.where == where
    assert check.worst == pytest.approx(worst)


@pytest.mark.parametrize("customer", [0, 5, -1])
def test_a_customer_that_does_not_exist_is_refused(customer):
    with pytest.raises(InvalidData, match=rf"order\[1\] must be in 1 … 4, got {customer}"):
        tour(1.0).verify(GuidedPathPlan([3, customer, 1, 4, 2]))


def test_every_check_is_tested():
    found = extended(1.0).verify(GuidedPathPlan((1, 2, 3), (0, 0, 1)))
    assert_complete(
        FAULTS | FIELD_FAULTS, [tour(1.0).verify(GuidedPathPlan([3, 1, 4, 2])), found], checks
    )
