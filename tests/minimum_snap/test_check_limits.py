"""Limits of the checks of a trajectory: 1.1 times the accepted violation is refused, 0.9 times is not."""

import math
from dataclasses import fields

import numpy as np
import pytest
from check_limits import assert_allowed, names_of
from numpy.polynomial import Polynomial

from crosstrack.errors import InvalidData
from crosstrack.models import MinimumSnap, TimeAllocation
from crosstrack.models.minimum_snap import FREE
from crosstrack.models.minimum_snap.trajectory import Trajectory

TOLERANCE = 1e-6
#: Waypoints in the unit of length, and the scale of each axis: its extent, a tenth of 3 at least.
PLACES = np.array([[0.0, 0.0], [1.0, 0.2], [1.0, 0.3], [3.0, 0.2]])
EXTENTS = np.array([3.0, 0.3])
DURATIONS = np.array([1.0, 0.5, 2.0])
#: Units of length and of time.
UNITS = [(1e-3, 10.0), (1.0, 1.0), (1e3, 0.1)]
WORDS = ["velocity", "acceleration", "jerk"]

LIMITS = [
    "times",
    "waypoints",
    *(f"{word} at the ends" for word in WORDS),
    *(f"{word} at inner knots" for word in WORDS),
    *(f"continuity of {word}" for word in ["position", *WORDS]),
    "corridor",
    *(f"{word} limit" for word in WORDS),
    "polytope",
    "degree at most 7",
]

_ROWS = np.zeros((8, 8))
for _k in range(4):
    _ROWS[_k, _k] = math.factorial(_k)
    _ROWS[4 + _k] = [math.perm(power, _k) for power in range(8)]
#: Powers in s of the polynomial with one derivative of 1 at an end, by side and order, and 0 else.
HERMITE = np.linalg.inv(_ROWS).T.reshape(2, 4, 8)
#: A bump of height 1 in the middle of a segment, without derivatives at its ends.
ARCH = Polynomial([0, 1]) ** 4 * Polynomial([1, -1]) ** 4 * 256


def trajectory(unit, *changes, arch=0.0):
    """Return the path that rests at each waypoint, with changes at knots and an arch.

    Parameters
    ----------
    unit : (float, float)
        Of length and time.
    changes : tuple of (segment, side, order, axis, amount)
        A derivative at one end of a segment, and what is added to it.
    arch : float
        Height of a bump in the middle of segment 1, on axis 0.
    """
    length, time = unit
    durations = DURATIONS * time
    powers = np.zeros((3, 9, 2))
    places = PLACES * length
    for k in range(3):
        powers[k, :8] = np.outer(HERMITE[0, 0], places[k]) + np.outer(HERMITE[1, 0], places[k + 1])
    for segment, side, order, axis, amount in changes:
        powers[segment, :8, axis] += HERMITE[side, order] * amount * durations[segment] ** order
    powers[1, :, 0] += arch * ARCH.coef
    return Trajectory(np.concatenate([[0.0], np.cumsum(durations)]), powers)


def model_for(unit, **how):
    length, time = unit
    times = np.concatenate([[0.0], np.cumsum(DURATIONS * time)])
    return MinimumSnap(**{"waypoints": PLACES * length, "times": times, "degree": 8, **how})


def only(value, shape=(3, 2), at=(1, 0)):
    """Return a table that is free but for one entry."""
    table = np.full(shape, FREE)
    table[at] = value
    return table


def usual(unit, order, axis):
    """Return half a wave over the extent in three equal segments."""
    length, time = unit
    mean = DURATIONS.mean() * time
    return 0.5 * math.pi**order * EXTENTS[axis] * length / 3 / mean**order


def peak(order):
    """Return the largest magnitude of a derivative of the arch in s, and the sign that it has there."""
    values = ARCH.deriv(order)(np.linspace(0.0, 1.0, 100_001))
    at = int(np.abs(values).argmax())
    return abs(values[at]), math.copysign(1.0, values[at])


def at_knots(unit):
    """Yield the cases of fixed values and continuity, as :func:`limits` does."""
    length, _ = unit
    for axis, extent in enumerate(EXTENTS):
        place = TOLERANCE * extent * length
        for knot in range(4):
            sides = [(k, side) for k, side in ((knot - 1, 1), (knot, 0)) if 0 <= k < 3]
            yield "waypoints", place, lambda x, a=axis, place=place, sides=sides: (
                model_for(unit), trajectory(unit, *((*at, 0, a, -x * place) for at in sides))
            )  # fmt: skip
        for knot in (1, 2):
            free = PLACES * length
            free[knot] = FREE
            yield "continuity of position", place, lambda x, a=axis, k=knot, place=place, free=free: (
                model_for(unit, waypoints=free), trajectory(unit, (k, 0, 0, a, x * place))
            )  # fmt: skip
        for order, word in enumerate(WORDS, start=1):
            least = usual(unit, order, axis)
            # The scale is the usual derivative, or its own value if that is larger.
            for value in (0.5 * least, -5.0 * least):
                off = TOLERANCE * max(least, abs(value))
                for knot in (0, 3):
                    side = int(knot > 0)
                    rows = np.zeros((3, 2))
                    rows[order - 1, axis] = value
                    model = model_for(unit, **{("start", "end")[side]: rows})
                    yield f"{word} at the ends", off, lambda x, m=model, c=(knot - side, side, order, axis), v=value, off=off: (
                        m, trajectory(unit, (*c, v + x * off))
                    )  # fmt: skip
                for knot in (1, 2):
                    sides = (knot - 1, 1, order, axis), (knot, 0, order, axis)
                    fixed = only(value, (4, 3, 2), (knot, order - 1, axis))
                    yield f"{word} at inner knots", off, lambda x, f=fixed, s=sides, v=value, off=off: (
                        model_for(unit, derivatives=f), trajectory(unit, *((*c, v + x * off) for c in s))
                    )  # fmt: skip
                    yield f"continuity of {word}", off, lambda x, s=sides, v=value, off=off: (
                        model_for(unit), trajectory(unit, (*s[0], v), (*s[1], v + x * off))
                    )  # fmt: skip


def limits(unit):
    """Yield the name of each check, its largest accepted violation, and a case.

    The case returns model and plan for a share of that violation."""
    length, time = unit
    yield from at_knots(unit)
    for knot in range(4):
        shift = TOLERANCE * min(1.0, 0.5 * time)

        def late(x, knot=knot, shift=shift):
            plan = trajectory(unit)
            times = plan.times.copy()
            times[knot] -= x * shift
            return model_for(unit), Trajectory(times, plan.coefficients)

        yield "times", shift, late
    # The scale of a position is the extent, here on axis 0.
    place = TOLERANCE * 3.0 * length
    for side, sign in (("upper", 1.0), ("lower", -1.0)):
        edge = {f"corridor_{side}": sign * only(sign + 0.5) * length}
        yield "corridor", place, lambda x, s=sign, e=edge: (
            model_for(unit, **e), trajectory(unit, arch=s * (0.5 * length + x * place))
        )  # fmt: skip
        spaces = {
            "polytope_segments": [0, 1],
            "polytope_normals": [[0.0, 1.0], [2.0 * sign, 0.0]],
            "polytope_offsets": [length, 2.0 * (sign + 0.5) * length],
        }
        yield "polytope", place, lambda x, s=sign, p=spaces: (
            model_for(unit, **p), trajectory(unit, arch=s * (0.5 * length + x * place))
        )  # fmt: skip
        yield "degree at most 7", place, lambda x, s=sign: (
            model_for(unit, degree=7), trajectory(unit, arch=s * x * place / ARCH.coef[8])
        )  # fmt: skip
    for order, word in enumerate(WORDS, start=1):
        height, sign = peak(order)
        height /= (DURATIONS[1] * time) ** order
        # The scale is the limit, or the usual derivative if the limit is 0.
        for limit, scale in ((length, length), (0.0, usual(unit, order, 0))):
            for side in (1.0, -1.0):
                yield f"{word} limit", TOLERANCE * scale, lambda x, v=limit, r=scale, s=sign * side, w=word, h=height: (
                    model_for(unit, **{f"{w}_limit": only(v)}),
                    trajectory(unit, arch=s * (v + x * TOLERANCE * r) / h),
                )  # fmt: skip


def with_free_times(model, **how):
    """Return the same problem with its times free."""
    names = {field.name for field in fields(TimeAllocation)} & {
        field.name for field in fields(model)
    }
    given = {name: getattr(model, name) for name in names}
    total = model.times[-1] - model.times[0]
    return TimeAllocation(**{**given, "time_weight": 2.0, "total_time": total, **how})


@pytest.mark.sample(2)
@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("name", LIMITS)
def test_the_limit_of_each_check(name, unit):
    cases = [case for case in limits(unit) if case[0] == name]
    assert cases
    for _, allowed, case in cases:
        assert_allowed(name, allowed, lambda x, case=case: MinimumSnap.verify(*case(x)))


@pytest.mark.parametrize("name", LIMITS[1:])
def test_the_limit_of_each_check_with_free_times(name):
    _, allowed, case = next(case for case in limits(UNITS[2]) if case[0] == name)

    def verify(x):
        model, plan = case(x)
        return with_free_times(model).verify(plan)

    assert_allowed(name, allowed, verify)


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_limit_of_the_total_time(unit, sign):
    total = DURATIONS.sum() * unit[1]

    def verify(x):
        model = with_free_times(model_for(unit), total_time=total * (1.0 - sign * x * TOLERANCE))
        return model.verify(trajectory(unit))

    assert_allowed("total time", TOLERANCE * total, verify)


def test_a_duration_of_0_is_refused_before_its_check():
    plan = trajectory(UNITS[1])
    found = with_free_times(model_for(UNITS[1])).verify(plan)
    check = next(check for check in found.checks if check.name == "durations > 0")
    assert (check.worst, check.tolerance) == (0.0, 0.0)
    assert check.where == "segment 1 (0.5 s)"
    with pytest.raises(InvalidData, match=r"times\[2\] must be > times\[1\]"):
        Trajectory([0.0, 1.0, 1.0, 3.5], plan.coefficients)


def test_every_check_has_its_limit():
    unit = UNITS[1]
    free = {"derivatives": np.zeros((4, 3, 2)), "polytope_segments": [0], "polytope_normals": [[1.0, 0.0]],
            "polytope_offsets": [9.0], "corridor_upper": 9.0}  # fmt: skip
    wide = {f"{word}_limit": 1e3 for word in WORDS}
    low = model_for(unit, degree=7, **free, **wide)
    plan = trajectory(unit, arch=1e-9)
    found = low.verify(plan), with_free_times(low).verify(plan)
    assert all(one.ok for one in found), found
    assert names_of(found[0]) == set(LIMITS)
    assert names_of(found[1]) == {*LIMITS, "total time", "durations > 0"} - {"times"}
