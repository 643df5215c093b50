"""Violations detected by each check of a guided vehicle's tour; checks are counts, so one suffices."""

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


@pytest.mark.parametrize("customer", [0, 5, -1])
def test_a_customer_that_does_not_exist_is_refused(customer):
    with pytest.raises(InvalidData, match=rf"order\[1\] must be in 1 … 4, got {customer}"):
        tour(1.0).verify(GuidedPathPlan([3, customer, 1, 4, 2]))


def test_every_check_is_tested():
    assert_complete(FAULTS, [tour(1.0).verify(GuidedPathPlan([3, 1, 4, 2]))], checks)
