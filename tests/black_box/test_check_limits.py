"""What each check of a point of a black box accepts: 0.9 of its tolerance, and not 1.1."""

import numpy as np
import pytest
from check_limits import SCALES, assert_complete, assert_limit, assert_only, pairs

from crosstrack.errors import InvalidData
from crosstrack.models import BlackBoxMinimisation
from crosstrack.models.black_box import BlackBoxPoint, PythonFunction, checks

TOLERANCE = 1e-6
#: A variable of a width of 8, one of 2, and two that are fixed.
BOUNDS = np.array([[-5.0, 3.0], [-1.0, 1.0], [2.0, 2.0], [-2.0, -2.0]])
INSIDE = (3.0, 0.5, 2.0, -2.0)


def box(scale, function="sphere", **fields):
    return BlackBoxMinimisation(function, scale * BOUNDS, budget=10, **fields)


def moved(variable, shift, tolerance=TOLERANCE):
    """Return the case of a variable beyond its bound by `shift` times the share."""

    def case(scale, share):
        x = list(INSIDE)
        bound = BOUNDS[variable, 0 if shift < 0 else 1]
        x[variable] = bound + share * shift
        return box(scale).verify(BlackBoxPoint(scale * np.array(x)), tolerance=tolerance)

    return case


def of_shares(scale, share):
    """The variable that is farthest beyond relative to its width is named, not the farthest."""
    x = [3.0 + 0.8 * share * 8e-6, -1.0 - share * 2e-6, 2.0, -2.0]
    found = box(scale).verify(BlackBoxPoint(scale * np.array(x)), tolerance=TOLERANCE)
    assert share == 0.0 or found.checks[0].where == "x[1]"
    return found


LIMITS = {
    "bounds": [
        moved(0, -8e-6),
        moved(0, 8e-6),
        moved(1, -2e-6),
        moved(1, 2e-6),
        # Without a width, digits of the bound: 1e-9 of it, times the tolerance.
        moved(2, 0.01 * 2e-9, tolerance=0.01),
        moved(2, -0.01 * 2e-9, tolerance=0.01),
        moved(3, 0.01 * 2e-9, tolerance=0.01),
        of_shares,
    ]
}


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize(("name", "case"), pairs(LIMITS))
def test_a_limit_is_kept_within_its_tolerance(name, case, scale):
    assert_limit(name, lambda share: case(scale, share))


@pytest.mark.parametrize("x", [5e-324, -5e-324])
def test_a_variable_that_is_fixed_at_0_may_be_nothing_else(x):
    model = BlackBoxMinimisation("sphere", [[0.0, 0.0], [-1.0, 1.0]])
    assert model.verify(BlackBoxPoint([0.0, 1.0])).ok
    found = model.verify(BlackBoxPoint([x, 0.0]))
    assert_only("bounds", found)
    assert found.violated[0].where == "x[0]"
    other = model.verify(BlackBoxPoint([0.0, 2.0]))
    assert_only("bounds", other)
    assert other.violated[0].where == "x[1]"


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_one_value_that_is_no_number_is_enough(bad, place):
    values = 2.0 * np.arange(3.0)
    whole = box(1.0, PythonFunction(lambda x: values, vectorized=True), samples=3)
    found = whole.verify(BlackBoxPoint(INSIDE))
    assert found.ok
    assert (found.objective, found.spread) == (2.0, pytest.approx(4.0 / 3.0**0.5))
    values[place] = bad
    found = whole.verify(BlackBoxPoint(INSIDE))
    assert_only("value is a number", found)
    assert (found.violated[0].worst, found.violated[0].where) == (1.0, f"{bad:g}")
    assert (found.objective, found.spread) == (None, 0.0)


@pytest.mark.parametrize("x", [INSIDE[:3], (*INSIDE, 0.0)])
def test_another_number_of_variables_is_refused(x):
    with pytest.raises(InvalidData, match=f"x must have 4 entries, got {len(x)}"):
        box(1.0).verify(BlackBoxPoint(x))


def rows(values, **fields):
    """Return a model of one variable in -10 … 10 whose function returns `values` at any point."""
    call = PythonFunction(lambda x: np.array(values(x)))
    return BlackBoxMinimisation(call, [[-10.0, 10.0]], budget=10, **fields)


@pytest.mark.parametrize("scale", SCALES)
def test_an_inequality_has_no_tolerance(scale):
    model = rows(lambda x: [0.0, -1.0, scale * x[0]], inequalities=2)
    assert model.verify(BlackBoxPoint([0.0]), tolerance=0.5).ok
    found = model.verify(BlackBoxPoint([5e-324 / min(scale, 1.0)]), tolerance=0.5)
    assert_only("inequalities", found)
    assert found.violated[0].where == "g[1]"


@pytest.mark.parametrize("accepted", [1e-9, 1e-4, 10.0])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_an_equality_is_kept_within_its_tolerance(accepted, sign):
    model = rows(lambda x: [0.0, sign * x[0]], equalities=1, equality_tolerance=accepted)
    for tolerance in (1e-12, 0.5):
        assert model.verify(BlackBoxPoint([0.9 * accepted]), tolerance=tolerance).ok
        if accepted < 5.0:
            found = model.verify(BlackBoxPoint([1.1 * accepted]), tolerance=tolerance)
            assert_only("equalities", found)
            assert found.violated[0].where == "h[0]"


def test_kinds_of_variables_hold_exactly():
    variables = [
        {"type": "category", "values": ["a", "b"]},
        {"type": "integer", "when": {"variable": 0, "in": ["b"]}},
    ]
    model = BlackBoxMinimisation("sphere", [[0, 1], [2, 5]], variables=variables)
    for x in ([0, 2], [1, 2], [1, 5]):
        assert model.verify(BlackBoxPoint(x), tolerance=0.5).ok
    found = model.verify(BlackBoxPoint([1.0, np.nextafter(3.0, 4.0)]), tolerance=0.5)
    assert_only("integers and categories", found)
    assert found.violated[0].where == "x[1]"
    found = model.verify(BlackBoxPoint([0.0, 3.0]), tolerance=0.5)
    assert_only("variables whose condition fails", found)
    assert found.violated[0].where == "x[1]"


def front(*points, x=None):
    """Return the verification of a front for the objectives x² and (x - 1)²."""
    model = rows(lambda x: [x[0] ** 2, (x[0] - 1) ** 2], objectives=2, reference=[5.0, 5.0])
    x = points[0] if x is None else x
    return model.verify(BlackBoxPoint([x], [[p] for p in points]), tolerance=1e-9)


def test_points_of_a_front_do_not_dominate_one_another():
    assert front(0.0, 0.5, 1.0).ok
    found = front(0.0, 0.5, 1.0, np.nextafter(1.0, 2.0) + 1e-7)
    assert_only("dominated by another point", found)
    assert found.violated[0].where == "front[3]"
    assert_only("x is in the front", front(0.0, 0.5, x=0.25))


def test_every_check_is_tested():
    both = rows(
        lambda x: [x[0], -x[0], -1.0, 0.0], objectives=2, reference=[9, 9], inequalities=1,
        equalities=1, variables=["integer"],
    )  # fmt: skip
    found = box(1.0).verify(BlackBoxPoint(INSIDE)), both.verify(BlackBoxPoint([0], [[0], [1]]))
    tested = {
        *LIMITS, "value is a number", "inequalities", "equalities", "integers and categories",
        "variables whose condition fails", "x is in the front", "dominated by another point",
    }  # fmt: skip
    assert_complete(tested, found, checks)
