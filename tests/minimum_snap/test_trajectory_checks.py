"""Verification of plans: feasible plans pass, and every violation is located."""

import math
from dataclasses import replace

import numpy as np
import pytest
from minimum_snap.paths import INF, TIMES, WAYPOINTS, brute_force, make, violated
from numpy.polynomial import polynomial
from scipy.interpolate import make_interp_spline

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import MinimumDerivative, MinimumSnap
from crosstrack.models.minimum_snap import FREE, knots
from crosstrack.models.minimum_snap.bounds import derivative_name
from crosstrack.models.minimum_snap.trajectory import Trajectory


def rows_of(found):
    return {check.name: check for check in found.checks}


def bumped(plan, segment, axis, powers):
    """Return `plan` with a polynomial in s added to one segment and axis."""
    degree = max(plan.degree, len(powers) - 1)
    c = np.zeros((plan.segments, degree + 1, plan.dimensions))
    c[:, : plan.degree + 1] = plan.coefficients
    c[segment, : len(powers), axis] += powers
    return Trajectory(plan.times, c)


@pytest.fixture(scope="module")
def optimum():
    return brute_force(make())


def test_a_right_plan_passes(optimum):
    found = make().verify(optimum)
    assert found.ok, found
    assert not found.within_tolerance
    names = [(check.name, check.equation) for check in found.checks]
    assert names[:3] == [("times", ""), ("waypoints", "24"), ("continuity of position", "25")]
    assert ("velocity at the ends", "23") in names
    assert ("continuity of jerk", "25") in names
    assert "continuity of snap" not in rows_of(found)
    assert found.objective == pytest.approx(optimum.integral_of_square(4).sum())


def test_moved_waypoint(optimum):
    # Both neighbours moved alike, so only the waypoint is off.
    c = optimum.coefficients.copy()
    bump = np.array([0, 0, 0, 0, 35, -84, 70, -20])
    c[0, :, 1] += 0.01 * bump
    c[1, 0, 1] += 0.01
    c[1, :, 1] -= 0.01 * bump
    found = make().verify(Trajectory(TIMES, c))
    assert [check.name for check in found.violated] == ["waypoints"]
    check = rows_of(found)["waypoints"]
    assert check.worst == pytest.approx(0.01)
    assert check.where == "knot 1, axis 1 (t = 1 s)"
    assert check.unit == "m"
    assert check.equation == "24"


@pytest.mark.parametrize(
    ("order", "word"), list(enumerate(["position", "velocity", "acceleration", "jerk"]))
)
def test_jump_of_each_derivative(optimum, order, word):
    free = make(waypoints=[[0, 0], [None, None], [3, 2]])
    basis = np.zeros((8, 8))
    for j in range(4):
        for p in range(8):
            basis[j, p] = math.factorial(j) if p == j else 0
            basis[4 + j, p] = math.perm(p, j)
    bump = np.linalg.solve(basis, np.eye(8)[order])  # its j-th derivative at 0 is 1, the others 0
    amount = 1e-3 * 2.0**order
    found = free.verify(bumped(optimum, 1, 1, amount * bump))
    assert [check.name for check in found.violated] == [f"continuity of {word}"]
    check = found.violated[0]
    assert check.worst == pytest.approx(1e-3, rel=1e-6)
    assert check.where == "knot 1, axis 1 (t = 1 s)"
    assert check.equation == "25"


@pytest.mark.parametrize(
    ("order", "word"), list(enumerate(["velocity", "acceleration", "jerk"], start=1))
)
@pytest.mark.parametrize("knot", [0, 2])
def test_wrong_end_derivative(optimum, order, word, knot):
    rows = np.zeros((3, 2))
    rows[order - 1, 1] = 1e-3
    model = make(**{"start" if knot == 0 else "end": rows})
    found = model.verify(optimum)
    assert [check.name for check in found.violated] == [f"{word} at the ends"]
    assert found.violated[0].worst == pytest.approx(1e-3, rel=1e-3)
    assert found.violated[0].where.startswith(f"knot {knot}, axis 1")
    assert found.violated[0].equation == "23"


def test_wrong_inner_derivative(optimum):
    rows = np.full((3, 2, 2), FREE)
    rows[1, 1, 0] = optimum(1.0, 2)[0] + 0.5
    found = make(derivatives=rows).verify(optimum)
    assert [check.name for check in found.violated] == ["acceleration at inner knots"]
    assert found.violated[0].worst == pytest.approx(0.5)
    assert found.violated[0].where == "knot 1, axis 0 (t = 1 s)"


def test_a_narrow_bump_between_all_samples_is_found(optimum):
    """s^a (1-s)^b: a bump that a sampler would step over.

    Of a higher degree, its coefficients could not hold the waypoint at its end.
    """
    model = make(degree=17)
    base = brute_force(make())
    bump = polynomial.polyfromroots([0.0] * 5 + [1.0] * 12)
    s = 5 / 17
    bump = bump / polynomial.polyval(s, bump)
    top = base.extremes().largest[1].max()
    edge = top + 0.5
    poked = bumped(base, 1, 0, bump * (edge - float(base(1 + 2 * s)[0]) + 1e-4))
    exact_top = poked.extremes().largest[1, 0]
    corridor = replace(model, corridor_upper=np.array([[9.0, 9], [exact_top - 1e-5, 9]]))
    found = corridor.verify(poked)
    assert [c.name for c in found.violated] == ["corridor"]
    assert found.violated[0].worst == pytest.approx(1e-5, rel=1e-3)
    assert found.violated[0].where.startswith("segment 1, axis 0 (t = 1.6")
    assert replace(model, corridor_upper=[[9.0, 9], [exact_top + 1e-9, 9]]).verify(poked).ok


@pytest.mark.parametrize(
    ("order", "name"),
    list(enumerate(["velocity_limit", "acceleration_limit", "jerk_limit"], start=1)),
)
@pytest.mark.parametrize("sign", [1, -1])
def test_broken_limits(optimum, order, name, sign):
    plan = Trajectory(optimum.times, sign * optimum.coefficients)
    model = make(waypoints=sign * np.array(WAYPOINTS))
    found = plan.extremes(order)
    top = np.maximum(-found.least, found.largest)[1, 0]
    limits = np.full((2, 2), 1e6)
    limits[1, 0] = top - 0.01
    verdict = replace(model, **{name: limits}).verify(plan)
    assert [check.name for check in verdict.violated] == [name.replace("_", " ")]
    assert verdict.violated[0].worst == pytest.approx(0.01, rel=1e-6)
    assert verdict.violated[0].where.startswith("segment 1, axis 0 (t = ")
    t = float(verdict.violated[0].where.split("t = ")[1].split(" ")[0])
    assert abs(plan(t, order)[0]) == pytest.approx(top, rel=1e-5)
    limits[1, 0] = top + 1e-12
    assert replace(model, **{name: limits}).verify(plan).ok


def test_broken_half_space(optimum):
    normal = np.array([3.0, 4.0])
    t = np.linspace(1, 3, 100001)
    reach = (optimum(t) @ normal / 5).max()
    kept = {"polytope_segments": [0, 1], "polytope_normals": [[0, 1], normal]}
    top = max(optimum.extremes().largest[0, 1], 2.0) + 1
    model = make(**kept, polytope_offsets=[top, 5 * reach + 1e-6])
    assert model.verify(optimum).ok
    inside = make(waypoints=[[0, 0], [None, None], [None, None]], **kept,
                  polytope_offsets=[top, 5 * (reach - 0.02)])  # fmt: skip
    found = inside.verify(optimum)
    assert [check.name for check in found.violated] == ["polytope"]
    assert found.violated[0].worst == pytest.approx(0.02, rel=1e-4)
    assert found.violated[0].where.startswith("segment 1, half-space 1 (t = ")


def test_wrong_times_and_degree(optimum):
    found = make().verify(Trajectory([0, 1.001, 3], optimum.coefficients))
    check = rows_of(found)["times"]
    assert not check.ok
    assert check.where == "knot 1"
    assert check.worst == pytest.approx(1e-3)
    high = bumped(optimum, 1, 0, 1e-3 * polynomial.polyfromroots([0.0] * 4 + [1.0] * 4))
    assert violated(make(), high) == {"degree at most 7"}
    assert make(degree=8).verify(high).ok
    assert make().verify(bumped(optimum, 0, 0, np.zeros(12))).ok


@pytest.mark.parametrize("share", [0.5, 2.0])
def test_small_violations_are_within_tolerance(optimum, share):
    c = optimum.coefficients.copy()
    c[:, 0, 0] += share * 1e-6 * 3  # positions reach 3 m, so that is their scale
    found = make().verify(Trajectory(TIMES, c))
    assert found.ok is (share < 1)
    if found.ok:
        assert "waypoints" in {check.name for check in found.within_tolerance}
    c = optimum.coefficients.copy()
    c[:, 0, 0] += 1e-10
    assert not make().verify(Trajectory(TIMES, c)).within_tolerance


@pytest.mark.parametrize(
    "plan",
    [
        Trajectory([0, 3.0], np.zeros((1, 8, 2))),
        Trajectory([0, 1, 3.0], np.zeros((2, 8, 3))),
    ],
)
def test_plans_of_another_shape_are_refused(plan):
    with pytest.raises(InvalidData, match=r"plan has \d segments in \d-D, the model 2"):
        make().verify(plan)
    with pytest.raises(InvalidData, match="plan has"):
        make().formulate("legendre").encode(plan)


@pytest.mark.parametrize("plan", [None, 3, "route", np.zeros((2, 8, 2))])
def test_rejects_invalid_plans(plan):
    with pytest.raises(InvalidData, match="plan"):
        ct.verify(make(), plan)


@pytest.mark.parametrize("long", [1e-3, 1.0, 1e3])
def test_short_and_long_segments(long):
    times = np.array(TIMES) * long
    model = make(times=times)
    plan = Trajectory(times, brute_force(make()).coefficients)
    assert model.verify(plan).ok
    assert model.verify(plan).objective == pytest.approx(
        make().objective(brute_force(make())) * long**-7
    )
    top = plan.extremes(1).largest[1, 0]
    slow = replace(model, velocity_limit=np.array([[INF, INF], [top * 0.99, INF]]))
    assert violated(slow, plan) == {"velocity limit"}
    off = plan.coefficients.copy()
    off[1, 0, 0] += 1e-4
    assert {"waypoints", "continuity of position"} <= violated(model, Trajectory(times, off))


@pytest.mark.parametrize("far", [1e3, 1e6, 1e7])
def test_a_decimetre_counts_far_from_the_origin(optimum, far):
    """Moving the origin (a map's eastings) changes nothing of the problem, so nothing of its check."""
    points = np.array(WAYPOINTS) + far
    c = optimum.coefficients.copy()
    c[:, 0] += far
    plan = Trajectory(TIMES, c)
    top = optimum.extremes().largest[1, 1]
    upper = np.array([[9.0, 9], [9, top - 0.05]]) + far
    free = [[far, far], [None, None], [far + 3, None]]
    assert make(waypoints=points).verify(plan).ok
    corridor = make(waypoints=free, end=np.zeros((0, 2)), corridor_upper=upper)
    assert violated(corridor, plan) == {"corridor"}
    spaces = {"polytope_segments": [1], "polytope_normals": [[0.0, 1.0]]}
    assert violated(
        make(waypoints=free, end=np.zeros((0, 2)), **spaces, polytope_offsets=[far + top - 0.05]),
        plan,
    ) == {"polytope"}
    c = c.copy()
    c[1, 0, 0] += 0.05
    assert {"waypoints", "continuity of position"} <= violated(
        make(waypoints=points), Trajectory(TIMES, c)
    )


def test_a_wild_segment_excuses_no_jump_elsewhere():
    """A jump of 0.1 m/s² where the path is calm, however violent another segment is."""
    times = np.concatenate([[0.0, 0.1, 0.2], np.arange(1.0, 31.0)])
    points = np.concatenate([[0.0, 1000.0, 2000.0], 2000.0 + np.zeros(30)])
    model = MinimumSnap(points[:, None], times)
    plan = ct.solve(model, "banded").plan
    assert model.verify(plan).ok
    assert np.abs(plan.at_ends(2)[0]).max() > 1e5
    assert np.abs(plan(25.0, 2)).max() < 1
    s = polynomial.Polynomial([0, 1])
    bump = 0.05 * s**2 * (1 - s) ** 4  # jumps by 0.1 m/s² at the start of a late segment
    late = int(np.searchsorted(times, 25.0))
    assert "continuity of acceleration" in violated(model, bumped(plan, late, 0, bump.coef))


def test_large_coefficients_do_not_excuse_themselves(optimum):
    """What digits cannot hold is forgiven up to a tolerance in the model's units, and no further."""
    bump = 1e13 * polynomial.polyfromroots([0.0] * 3 + [1.0] * 4)
    bump[-1] += 0.1
    found = make().verify(bumped(optimum, 1, 0, bump))
    check = rows_of(found)["waypoints"]
    assert not check.ok
    assert check.tolerance <= 2e-6 * make().position_scale.max()
    assert "the durations differ too much" in check.where


def test_a_swing_in_one_segment_excuses_no_end_velocity(optimum):
    swing = bumped(optimum, 1, 0, 1e9 * polynomial.polyfromroots([0.0] * 4 + [1.0] * 2))
    found = rows_of(make().verify(swing))
    assert np.abs(swing.at_ends(2)[1]).max() > 1e8
    assert found["acceleration at the ends"].tolerance < 1.0
    assert not found["acceleration at the ends"].ok


def test_polytopes_and_limits_beside_very_unequal_segments():
    """The clock that the extremes are found with must not swallow a short segment."""
    times = [-1e6, 0.0, 1e-11, 1.0]
    plan = Trajectory(times, np.zeros((3, 1, 1)))
    limits = {
        "polytope_segments": [0, 1, 2], "polytope_normals": [[1.0]] * 3, "polytope_offsets": [0.0] * 3,
    }  # fmt: skip
    assert MinimumSnap(np.zeros((4, 1)), times, **limits).verify(plan).ok


def test_position_only_is_scipys_spline():
    times = np.array([0.0, 1, 2.5, 3, 5])
    points = np.array([[0.0, 1], [1, 2], [3, 2], [0, 0], [1, -1]])
    spline = make_interp_spline(
        times, points, k=7, bc_type=([(j, np.zeros(2)) for j in (1, 2, 3)],) * 2
    )
    model = MinimumSnap(points, times)
    plan = brute_force(model)
    t = np.linspace(0, 5, 101)
    assert np.allclose(plan(t), spline(t), atol=1e-8)


def plain_checks(model, plan):
    """Return the worst violation of each derivative at knots, one knot after the other."""
    found = {}
    for order in range(max(model.conditions.shape[1], model.continuity + 1)):
        begin, end = plan.at_ends(order)
        for knot in range(model.segments + 1):
            sides = ([end[knot - 1]] if knot else []) + ([begin[knot]] if knot < len(begin) else [])
            if order < model.conditions.shape[1]:
                ends = "at the ends" if knot in (0, model.segments) else "at inner knots"
                for side in sides:
                    off = np.abs(side - model.conditions[knot, order])
                    known = np.isfinite(model.conditions[knot, order])
                    key = order, ends if order else "waypoints"
                    if known.any():
                        found[key] = max(found.get(key, 0.0), off[known].max())
            if order <= model.continuity and len(sides) == 2:
                key = order, "continuity"
                found[key] = max(found.get(key, 0.0), np.abs(sides[0] - sides[1]).max())
    return found


@pytest.mark.parametrize("together", [1, 2, 5, 1024])
def test_segments_are_checked_in_parts_like_one_by_one(together, monkeypatch):
    monkeypatch.setattr(knots, "SEGMENTS", together)
    rng = np.random.default_rng(7)
    for _ in range(20):
        count, order = int(rng.integers(1, 12)), int(rng.integers(1, 5))
        rows = rng.normal(size=(count + 1, order, 1))
        rows[rng.random(rows.shape) < 0.7] = FREE
        model = MinimumDerivative(
            rng.normal(size=(count + 1, 1)), np.cumsum(rng.uniform(0.5, 2, count + 1)),
            order=order, derivatives=rows, start=rows[0], end=rows[-1],
        )  # fmt: skip
        plan = Trajectory(model.times, rng.normal(size=(count, rng.integers(1, 2 * order + 1), 1)))
        wanted = plain_checks(model, plan)
        checks = {one.name: one for one in model.verify(plan).checks}
        for (derivative, kind), worst in wanted.items():
            word = derivative_name(derivative)
            names = {"waypoints": kind, "continuity": f"continuity of {word}"}
            name = names.get(kind, f"{word} {kind}")
            # The worst is the worst share of what is allowed, which grows with the value.
            assert checks[name].worst <= worst * (1 + 1e-12)
            if kind == "waypoints":
                assert checks[name].worst == pytest.approx(worst, rel=1e-12)
