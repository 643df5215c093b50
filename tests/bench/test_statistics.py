"""Formulas of comparisons: by hand, by their laws, and beside other implementations."""

import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from crosstrack.errors import InvalidData
from crosstrack.solvers.bench.profiles import data_profile, performance_profile
from crosstrack.solvers.bench.statistics import (
    compare_pairs,
    compare_seeds,
    correct_tests,
    primal_gap,
    primal_integral,
    shifted_geometric_mean,
    success_interval,
)

times = st.lists(st.floats(0, 1e6), min_size=1, max_size=20)
positive = st.floats(1e-6, 1e6)


def test_the_shifted_geometric_mean_by_hand():
    # sqrt((1 + 1) (7 + 1)) - 1 = 3
    assert shifted_geometric_mean([1, 7]) == pytest.approx(3)
    # (2 * 4 * 8)^(1/3) = 4
    assert shifted_geometric_mean([2, 4, 8], shift=0) == pytest.approx(4)
    assert shifted_geometric_mean([0, 5], shift=0) == 0
    assert shifted_geometric_mean([0, 0]) == 0
    assert shifted_geometric_mean([1, 2], 1e308) == pytest.approx(1.5)
    assert shifted_geometric_mean([1e308, 1e308], 1) == pytest.approx(1e308)


@settings(deadline=None)
@given(times, st.floats(0, 100))
def test_the_shifted_geometric_mean_lies_between_the_geometric_and_the_arithmetic(values, shift):
    found = shifted_geometric_mean(values, shift)
    slack = 1e-9 * (max(values) + shift)
    assert min(values) - slack <= found <= np.mean(values) + slack
    assert found <= shifted_geometric_mean(values, 2 * shift + 1) + slack * 2 + 1e-9
    far = shifted_geometric_mean(values, 1e9)
    assert far == pytest.approx(np.mean(values), rel=1e-2, abs=1e-2 + 1e-3 * max(values))


@settings(deadline=None)
@given(times, st.floats(1e-3, 1e3))
def test_the_shifted_geometric_mean_has_the_units_of_its_values(values, factor):
    scaled = shifted_geometric_mean([factor * value for value in values], factor)
    slack = 1e-8 * factor * (max(values) + 1)
    assert scaled == pytest.approx(factor * shifted_geometric_mean(values, 1.0), abs=slack)


@pytest.mark.parametrize(("values", "shift"), [([], 1), ([-1], 1), ([math.inf], 1), ([1], -1)])
def test_values_without_a_mean_are_refused(values, shift):
    with pytest.raises(InvalidData):
        shifted_geometric_mean(values, shift)


def test_the_primal_integral_by_hand():
    # Gap 1 until 2 s, |12 - 10| / 12 = 1/6 until 5 s, 0 until 10 s: 2 + 3/6 = 2.5
    assert primal_integral([(2, 12), (5, 10)], 10, 10) == pytest.approx(2.5)
    # A worse plan later changes nothing, nor does one after the limit.
    assert primal_integral([(2, 12), (3, 20), (5, 10), (11, 9)], 10, 10) == pytest.approx(2.5)
    assert primal_integral([], 10, 10) == 10
    # Of another sign: no better than none.
    assert primal_integral([(0, 5)], -5, 10) == 10
    assert primal_gap(0, 0) == 0 and primal_gap(None, 0) == 1 and primal_gap(0, 4) == 1
    assert primal_gap(-8, -10) == pytest.approx(0.2)
    # Beside a scale of 1, a millionth is near zero, and a sign says little.
    assert primal_gap(1e-6, 0, 1) == primal_gap(1e-6, -1e-6, 2) == pytest.approx(1e-6)
    assert primal_gap(5, -5, 1) == 1
    assert primal_integral([(2, 0.5)], 0, 4, 1) == pytest.approx(3)


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.floats(0, 100), st.floats(-100, 100)), max_size=8),
    st.floats(-100, 100),
    st.floats(1, 100),
)
def test_the_primal_integral_is_between_nothing_and_the_whole_time(incumbents, best, limit):
    whole = primal_integral(incumbents, best, limit)
    assert -1e-9 <= whole <= limit * (1 + 1e-12)
    # The best plan at once leaves nothing.
    assert primal_integral([(0.0, best)], best, limit) == 0


def test_the_interval_of_a_rate_by_hand():
    # Wilson's for 8 of 10: centre (0.8 + z^2 / 20) / (1 + z^2 / 10), z = 1.959964
    z = 1.959963984540054
    centre = (0.8 + z**2 / 20) / (1 + z**2 / 10)
    half = z / (1 + z**2 / 10) * math.sqrt(0.8 * 0.2 / 10 + z**2 / 400)
    assert success_interval(8, 10) == pytest.approx((centre - half, centre + half))
    assert success_interval(0, 3)[0] == 0 and success_interval(3, 3)[1] == 1
    with pytest.raises(InvalidData):
        success_interval(4, 3)


def test_ranks_of_two_samples_by_hand():
    # All five of the first below all five of the second: 2 of the 252 ways to share the ranks.
    found = compare_seeds([1, 2, 3, 4, 5], [6, 7, 8, 9, 10])
    assert found.p_value == pytest.approx(2 / 252) and found.effect == 1
    assert str(found).startswith("less: p = 0.0079")
    # Ten below ten: 2 of the 184756 orders; the approximation gives 1.8e-4.
    assert compare_seeds(range(10), range(10, 20)).p_value == pytest.approx(2 / 184756)
    few = compare_seeds([1, 2], [3, 4])
    assert few.p_value is None and "too few" in str(few)
    assert compare_seeds([1] * 6, [1] * 6).p_value == 1
    # A run that failed is worse than any that did not.
    assert compare_seeds([1, 2, 3, 4, 5], [6, math.inf, math.inf, 9, 10]).effect == 1


def test_ranks_of_pairs_by_hand():
    # Six pairs, the first less in each: 2 of the 64 signs are as extreme.
    found = compare_pairs([1, 2, 3, 4, 5, 6], [2, 4, 6, 8, 10, 12.5])
    assert found.p_value == pytest.approx(2 / 64) and found.effect == 1
    assert compare_pairs([1] * 6, [1] * 6).p_value == 1
    assert compare_pairs([1, 2], [2, 3]).p_value is None
    with pytest.raises(InvalidData, match="second"):
        compare_pairs([1], [1, 2])


@settings(deadline=None)
@given(st.lists(st.tuples(positive, positive), min_size=6, max_size=15))
def test_a_test_does_not_depend_on_the_order(pairs):
    one, two = zip(*pairs, strict=True)
    for compare in (compare_seeds, compare_pairs):
        there, back = compare(one, two), compare(two, one)
        assert there.effect == pytest.approx(-back.effect, abs=1e-12)
        assert (there.p_value is None) == (back.p_value is None)
        if there.p_value is not None:
            assert there.p_value == pytest.approx(back.p_value, rel=1e-6)
            assert 0 <= there.p_value <= 1


def test_several_tests_are_corrected_for_their_number():
    draw = np.random.default_rng(3)
    base = draw.random(12)
    values = {
        "a": base,
        "b": base + 1 + 0.01 * draw.random(12),
        "c": base + 1e-3 * draw.normal(size=12),
    }
    tests = {(a, b): compare_pairs(values[a], values[b]) for a, b in combinations(values, 2)}
    pairs = correct_tests(tests)
    alone = {pair: test.p_value for pair, test in tests.items()}
    ordered = sorted(alone.values())
    # Holm: the least of three p-values counts three times, the next twice, none less than the one before.
    assert pairs["a", "b"].p_value == pytest.approx(3 * ordered[0])
    assert pairs["a", "c"].p_value == pytest.approx(min(1, max(ordered[2], 2 * ordered[1])))
    assert all(pairs[pair].p_value >= alone[pair] for pair in pairs)


@pytest.mark.parametrize(
    "call",
    [
        lambda: shifted_geometric_mean(["soon"]),
        lambda: shifted_geometric_mean([1.0], shift="much"),
        lambda: success_interval(1.5, 3),
        lambda: success_interval("1", 3),
        lambda: primal_gap(1.0, math.nan),
        lambda: primal_gap(1.0, 2.0, math.inf),
        lambda: primal_integral([(0.1, math.nan)], 1.0, 5.0),
        lambda: primal_integral([(0.1,)], 1.0, 5.0),
        lambda: primal_integral([(0.1, 2.0)], 1.0, "5"),
        lambda: compare_seeds([1.0, "two"], [1.0]),
        lambda: compare_pairs([1.0, math.inf], [1.0, 2.0]),
        lambda: performance_profile({"a": ["fast"]}),
        lambda: performance_profile([1.0, 2.0]),
        lambda: data_profile({"a": [1.0]}, ["two"]),
    ],
)
def test_values_that_are_not_numbers_are_refused(call):
    with pytest.raises(InvalidData):
        call()


@pytest.mark.filterwarnings("error")
def test_numbers_near_the_end_of_the_range_overflow_nothing():
    at, shares = performance_profile({"a": [1e308, 1.0], "b": [1e-308, 1.0]})["a"]
    assert (at.tolist(), shares.tolist()) == ([1.0], [0.5])
    far, near = [1e308] * 6, [-1e308] * 6
    assert compare_pairs(far, near).effect == -1.0 and compare_pairs(near, far).effect == 1.0
    assert primal_gap(1e308, -1e308) == 1.0


def test_profiles_by_hand():
    # Instance by instance: ratios a = 1, 2, inf, inf; b = 2, 1, 1, inf.
    found = performance_profile({"a": [1, 4, math.inf, math.inf], "b": [2, 2, 5, math.inf]})
    assert found["a"][0].tolist() == [1, 2] and found["a"][1].tolist() == [0.25, 0.5]
    assert found["b"][0].tolist() == [1, 2] and found["b"][1].tolist() == [0.5, 0.75]
    # 6 evaluations in 2 dimensions are 2 gradients, 8 in 3 as well.
    found = data_profile({"a": [6, 8], "b": [3, math.inf]}, [2, 3])
    assert found["a"][0].tolist() == [0, 2] and found["a"][1].tolist() == [0, 1]
    assert found["b"][0].tolist() == [0, 1] and found["b"][1].tolist() == [0, 0.5]
    with pytest.raises(InvalidData):
        performance_profile({"a": [0.0]})
    with pytest.raises(InvalidData):
        performance_profile({"a": [1.0], "b": [1.0, 2.0]})
    with pytest.raises(InvalidData):
        data_profile({"a": [1.0]}, [0])


measures = st.integers(1, 8).flatmap(
    lambda n: st.lists(
        st.lists(
            st.one_of(positive, st.just(math.inf), st.sampled_from([1.0, 2.0])),
            min_size=n,
            max_size=n,
        ),
        min_size=1,
        max_size=4,
    )
)


@settings(deadline=None)
@given(measures, st.floats(1, 100))
def test_profiles_agree_with_their_definition(rows, tau):
    """Counted instance by instance, as the paper defines it."""
    found = performance_profile({str(k): row for k, row in enumerate(rows)})
    for k, row in enumerate(rows):
        within = 0
        for p, value in enumerate(row):
            least = min(other[p] for other in rows)
            within += math.isfinite(value) and value / least <= tau
        at, shares = found[str(k)]
        assert shares[np.searchsorted(at, tau, side="right") - 1] == pytest.approx(
            within / len(row)
        )


@settings(deadline=None)
@given(measures, st.integers(-10, 10))
def test_profiles_are_the_same_in_other_units_and_end_at_the_share_solved(rows, power):
    table = {str(k): row for k, row in enumerate(rows)}
    found = performance_profile(table)
    again = performance_profile(
        {name: [2.0**power * v for v in row] for name, row in table.items()}
    )
    for name, (at, shares) in found.items():
        assert at.tolist() == again[name][0].tolist() and shares.tolist() == again[name][1].tolist()
        assert (np.diff(shares) > 0).all() or at.size == 1 or shares[0] == 0
        assert shares[-1] == pytest.approx(np.isfinite(table[name]).mean())
    # Who never needs less is never above.
    worse = performance_profile({**table, "worse": [2 * v for v in rows[0]]})
    at, shares = worse["worse"]
    first, own = worse["0"]
    assert (own[np.searchsorted(first, at, side="right") - 1] >= shares - 1e-12).all()


@settings(deadline=None, max_examples=40)
@given(
    measures.map(
        lambda rows: [[min(v, 1e5) if math.isfinite(v) else v for v in row] for row in rows]
    )
)
def test_profiles_agree_with_another_package(rows):
    """``perfprof`` on PyPI, after the function of D. J. and N. J. Higham."""
    peer = pytest.importorskip("perfprof", reason="perfprof is not installed")
    import matplotlib.pyplot as plt

    table = np.array(rows).T
    if not np.isfinite(table).any():
        return  # it divides by zero there
    with np.errstate(invalid="ignore"):
        _, lines = peer.perfprof(table, ["-"] * len(rows), thmax=1e12)
    try:
        ours = performance_profile({str(k): row for k, row in enumerate(rows)})
        for k, line in enumerate(lines):
            at, shares = ours[str(k)]
            if line is None:
                assert shares.tolist() == [0.0]
                continue
            theirs, heights = line[0].get_data()
            # Its last point only closes the drawing; ratios that differ by rounding are one.
            for ratio in theirs[:-1]:
                near = ratio * (1 + 1e-12)
                place = np.searchsorted(at, near, side="right") - 1
                assert shares[place] == pytest.approx(heights[:-1][theirs[:-1] <= near].max())
            assert shares[-1] == pytest.approx(heights[-1])
    finally:
        plt.close("all")
