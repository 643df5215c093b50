"""The kit of checks: a count that must be 0, the largest of many violations, and limits."""

import math

import numpy as np
import pytest

from crosstrack.errors import InvalidData
from crosstrack.models.verification import ROUNDING, Check, Verification, check_entries


def test_a_count_accepts_0_and_names_its_first_place():
    none, two = Check.count("a", []), Check.count("a", ["node 3", "node 5"], unit="nodes")
    assert none.ok and none.worst == 0.0 and none.where == ""
    assert not two.ok and two.worst == 2.0 and two.where == "node 3" and two.unit == "nodes"
    assert Check.count("a", 0).ok and not Check.count("a", 1).ok
    assert Check.count("a", 3, equation="7").equation == "7"


def test_the_largest_violation_is_relative_to_what_is_accepted():
    check = Check.largest("a", [1.0, 2.0, 3.0], [1.0, 0.5, 10.0], "m", lambda k: f"{k}", 0.1)
    assert (check.worst, check.where, check.scale) == (2.0, "1", 0.5)
    assert check.tolerance == pytest.approx(0.05) and check.rounding == ROUNDING * 0.5
    noisy = Check.largest(
        "a", [1.0, 2.0], 1.0, "m", lambda k: f"{k}", 0.1, noise=[0.0, 5.0], limit=[7.0, 8.0]
    )
    assert (noisy.worst, noisy.where, noisy.limit) == (1.0, "0", 7.0)


def test_a_violation_of_0_has_no_sign():
    largest = Check.largest("a", [-0.0, -1.0], 1.0, "m", lambda k: f"{k}", 0.1)
    scaled = Check.scaled("a", "", -0.0, "m", "end", 0.1, 1.0)
    assert "worst 0 m" in str(largest) and "worst 0 m" in str(scaled)


def test_places_are_indices_of_any_shape():
    values = np.zeros((2, 3))
    values[1, 2] = 4.0
    check = Check.largest("a", values, [1.0, 1.0, 2.0], "", lambda row, k: f"{row}, {k}", 0.1)
    assert (check.where, check.worst, check.scale) == ("1, 2", 4.0, 2.0)
    assert Check.largest("a", 4.0, 1.0, "", lambda k: f"{k}", 0.1).where == "0"


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_nan_and_infinity_are_the_largest_violations(value):
    check = Check.largest("a", [1e200, value, -math.inf], 1.0, "", lambda k: f"{k}", 0.1)
    assert check.worst == math.inf and not check.ok and check.share == math.inf
    beside = Check.largest("a", [0.0, value], 1.0, "", lambda k: f"{k}", 0.1)
    assert beside.where == "1" and not beside.ok


@pytest.mark.parametrize("part", ["scale", "noise"])
def test_a_violation_with_an_infinite_scale_is_not_accepted(part):
    sizes = {"scale": 1.0, "noise": 0.0, part: [1.0, math.inf]}
    check = Check.largest("a", [0.05, 3.0], unit="", where=str, tolerance=0.1, **sizes)
    assert check.where == "1" and not check.ok and check.share == math.inf
    slack = Check.largest("a", [0.05, -3.0], unit="", where=str, tolerance=0.1, **sizes)
    assert slack.where == "0" and slack.ok


@pytest.mark.parametrize("tolerance", [math.nan, math.inf])
def test_a_check_without_a_finite_tolerance_is_the_worst(tolerance):
    held, unlimited = Check.count("a", 0), Check("b", "", 0.0, "", tolerance, "")
    assert not unlimited.ok and unlimited.share == math.inf
    assert Check.worst_of([held, unlimited], held) is unlimited
    assert Verification(1.0, (held, unlimited)).excess == math.inf


def test_without_a_violation_the_place_is_that_of_the_smallest_slack():
    check = Check.within("a", [1.0, 3.0, 2.0], 4.0, "m", lambda k: f"{k}", 0.1)
    assert (check.worst, check.where, check.limit, check.ok) == (0.0, "1", 4.0, True)
    infinite = Check.within("a", [1.0, 2.0], [math.inf, 4.0], "m", lambda k: f"{k}", 0.1)
    assert infinite.where == "1" and infinite.ok


def test_limits_are_the_scales_unless_another_scale_is_stated():
    check = Check.within("a", [5.0, 30.0], [4.0, 20.0], "m", lambda k: f"{k}", 0.1)
    assert (check.worst, check.where, check.scale, check.limit) == (10.0, "1", 20.0, 20.0)
    other = Check.within("a", [5.0, 30.0], [4.0, 20.0], "m", "here", 0.1, scale=[0.1, 20.0])
    assert (other.worst, other.where, other.scale, other.limit) == (1.0, "here", 0.1, 4.0)


def test_no_values_violate_nothing():
    check = Check.largest("a", [], 3.0, "m", lambda k: f"{k}", 0.1, limit=5.0)
    assert (check.worst, check.where, check.tolerance, check.limit) == (
        0.0, "", pytest.approx(0.3), 5.0
    )  # fmt: skip
    assert Check.largest("a", [], np.empty(0), "m", "nowhere", 0.1).where == "nowhere"


def test_the_worst_of_checks_has_the_largest_share_of_its_tolerance():
    low = Check.scaled("a", "", 2.0, "", "low", 0.1, 100.0)
    high = Check.scaled("a", "", 1.0, "", "high", 0.1, 1.0)
    none = Check.count("a", 0)
    assert Check.worst_of([low, high, none], none) is high
    assert Check.worst_of([], none) is none
    assert (low.share, none.share, Check.count("a", 1).share) == (0.2, 0.0, math.inf)


def test_entries_outside_the_range_are_refused():
    check_entries("order", [1, 3], 1, 3, "order")
    for entry in (0, 4):
        with pytest.raises(InvalidData, match=rf"routes\[0\]\[1\] must be in 1 … 3, got {entry}"):
            check_entries("routes[0]", [2, entry], 1, 3, "routes")
