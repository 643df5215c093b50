"""Limits of the checks of a motion: 1.1 times the accepted violation is refused, 0.9 times is not."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from check_limits import assert_allowed, names_of
from checked import lobatto
from numpy.polynomial import Polynomial

from crosstrack.models import ControlPlan, OptimalControlProblem, PhasePlan
from crosstrack.models.optimal_control.plan import Piecewise

TOLERANCE, FIXED = 1e-6, 1e-5
#: Units of length and of time.
UNITS = [(1e-3, 10.0), pytest.param((1.0, 1.0), marks=pytest.mark.slow), (1e3, 0.1)]
KNOTS = np.array([0.0, 0.8, 2.0])
END = KNOTS[-1]
NODES = lobatto(7)
#: A force, and its motion; the place is never less than 0.02.
FORCE = Polynomial([-1.0, 3.0, -1.5])
SPEED = FORCE.integ() + 0.1
PLACE = SPEED.integ()
STILL = 0.8

LIMITS = [
    "motion",
    "continuity of states",
    "times",
    "initial values",
    "final values",
    "bounds of states",
    "bounds of controls",
    "bounds of parameters",
    "path",
    "end",
    "kept",
    "objective",
]
LINKS = ["x goes on from first to second", "time goes on from first to second"]


def extremes(course):
    """Return the least and the largest value of a polynomial over the phase."""
    inner = [root.real for root in course.deriv().roots() if not root.imag and 0 < root.real < END]
    values = course(np.array([0.0, END, *inner]))
    return values.min(), values.max()


PLACE = PLACE - extremes(PLACE)[0] + 0.02
SIZES = {name: np.abs(extremes(one)).max() for name, one in zip("xv", (PLACE, SPEED), strict=True)}
#: Sizes are largest values on a grid.
ACCURACY = 0.02


def problem(unit, *, time=None, z_rate=0.0, **options):
    """Return a problem that the motion keeps, with other options for what it is declared with."""
    length, second = unit
    ocp = OptimalControlProblem("limits")
    ocp.parameter("p", **options.get("p", {}))
    phase = ocp.phase(time=time or (0.0, (0.5 * second, 9.0 * second)), equation="2")
    x, v, z = (phase.state(name, **options.get(name, {})) for name in "xvz")
    u = phase.control("u", **options.get("u", {}))
    phase.dynamics({x: v, v: u, z: z_rate * length / second})
    phase.path(x + second * v, name="path", **{"upper": 9.0 * length, **options.get("path", {})})
    phase.invariant("kept", -(z**2), scale=options.get("kept", 0.1) * length**2)
    ocp.subject_to(phase.final(x), name="end", **{"upper": 9.0 * length, **options.get("end", {})})
    ocp.minimise(phase.final(x), scale=0.1 * length)
    return ocp


def part(unit, *, off=(), start=0.0, name="phase 1", shift=0.0):
    """Return the motion over one phase; `off` holds pairs of a state, 0 … 2, and changes by interval."""
    length, second = unit
    states, controls = [], []
    for k, (low, high) in enumerate(pairwise(KNOTS)):
        s = low + 0.5 * (NODES + 1.0) * (high - low)
        table = np.column_stack([PLACE(s) + shift, SPEED(s) / second, np.full(s.size, STILL)])
        for state, changes in off:
            table[:, state] += changes[k](0.5 * (NODES + 1.0)) / (second if state == 1 else 1.0)
        states.append(table * length)
        controls.append(FORCE(s)[:, None] * length / second**2)
    knots = start + KNOTS * second
    one, other = (Piecewise(knots, (NODES,) * 2, tuple(each)) for each in (states, controls))
    return PhasePlan(name, one, other, ("x", "v", "z"), ("u",))


def plan(unit, *, p=0.7, **how):
    return ControlPlan((part(unit, **how),), {"p": np.array([p])})


NOTHING = Polynomial([0.0])
RISE, FALL = Polynomial([0, 0, 1.0]), Polynomial([1.0, -1.0]) ** 2
BUMP = 16 * RISE * FALL


def along(unit):
    """Yield the cases along the way, as :func:`limits` does."""
    length, second = unit
    given = problem(unit)
    for state, name in enumerate("xv"):
        size = TOLERANCE * SIZES[name]
        units = length / second**state
        for sign in (1.0, -1.0):
            bump = sign * size * BUMP
            yield "motion", size * units, f"{name} at t = ", lambda x, k=state, b=bump: (
                given, plan(unit, off=[(k, (x * b, NOTHING))])
            )  # fmt: skip
            jump = sign * 0.5 * size
            where = f"{name} at t = {0.8 * second:.6g} s"
            yield "continuity of states", size * units, where, lambda x, k=state, j=jump: (
                given, plan(unit, off=[(k, (x * j * RISE, -x * j * FALL))])
            )  # fmt: skip
    # The scale of an invariant is its first value, or the declared scale if that is larger.
    for scale in (0.1, 1.0):
        allowed = TOLERANCE * max(scale, STILL**2)
        bump = allowed / (2.0 * STILL) * BUMP
        yield "kept", allowed * length**2, "t = ", lambda x, s=scale, b=bump: (
            problem(unit, kept=s), plan(unit, off=[(2, (NOTHING, -x * b))])
        )  # fmt: skip
        rate = allowed / (2.0 * STILL) / END
        where = f"t = {END * second:.6g} s (integrated)"
        yield "kept", allowed * length**2, where, lambda x, s=scale, r=rate: (
            problem(unit, kept=s, z_rate=x * r), plan(unit)
        )  # fmt: skip
    cases = (
        ("bounds of states", "v", SPEED, length / second),
        ("bounds of controls", "u", FORCE, length / second**2),
    )
    for check, name, course, units in cases:
        for side, value in zip(("lower", "upper"), extremes(course), strict=True):
            sign = 1.0 if side == "upper" else -1.0
            yield check, TOLERANCE * abs(value) * units, f"{name} at t = ", lambda x, n=name, s=side, v=value, g=sign, w=units: (
                problem(unit, **{n: {s: (v - g * x * TOLERANCE * abs(v)) * w}}), plan(unit)
            )  # fmt: skip
    # The scale is the size of the course if the bound is much smaller.
    little = TOLERANCE * SIZES["x"]
    yield "bounds of states", little * length, "x at t = ", lambda x: (
        problem(unit, x={"lower": (0.02 + x * little) * length}), plan(unit)
    )  # fmt: skip
    low, high = extremes(PLACE + SPEED)
    for side, value, sign in (("lower", low, -1.0), ("upper", high, 1.0)):
        # The same holds for a path constraint, unless its scale is declared.
        moved = SIZES["x"] + SIZES["v"]
        own = abs(value) if abs(value) > 0.1 * moved else moved
        for scale in (None, 5.0):
            size = TOLERANCE * (scale or own)
            how = {} if scale is None else {"scale": scale * length}
            yield "path", size * length, "t = ", lambda x, s=side, v=value, g=sign, z=size, h=how: (
                problem(unit, path={"upper": None, s: (v - g * x * z) * length, **h}), plan(unit)
            )  # fmt: skip


def at_ends(unit):
    """Yield the cases of times, ends and parameters, as :func:`limits` does."""
    length, second = unit
    given = problem(unit)
    # A fixed time has no tolerance but for rounding.
    exact = TOLERANCE * FIXED * END * second
    for sign in (1.0, -1.0):
        yield "times", exact, "start", lambda x, g=sign: (given, plan(unit, start=g * x * exact))
        yield "times", exact, "end", lambda x, g=sign: (
            problem(unit, time=(0.0, END * second + g * x * exact)), plan(unit)
        )  # fmt: skip
    early = TOLERANCE * FIXED * 10.0 * second
    yield "times", early, "start", lambda x: (
        problem(unit, time=(-10.0 * second, (-9.0 * second, 0.0))),
        plan(unit, start=-10.0 * second + x * early),
    )  # fmt: skip
    length_of_it = TOLERANCE * END * second
    for word, time in (
        ("end", lambda x: (0.0, (END * second + x * length_of_it, 9.0 * second))),
        ("end", lambda x: (0.0, (0.0, END * second - x * length_of_it))),
        ("start", lambda x: ((x * length_of_it, second), (0.0, 9.0 * second))),
        ("start", lambda x: ((-second, -x * length_of_it), (0.0, 9.0 * second))),
    ):
        yield "times", length_of_it, word, lambda x, t=time: (problem(unit, time=t(x)), plan(unit))
    late = TOLERANCE * 12.0 * second
    yield "times", late, "end", lambda x: (
        problem(unit, time=(10.0 * second, (12.0 * second + x * late, 99.0 * second))),
        plan(unit, start=10.0 * second),
    )  # fmt: skip
    for name, course in (("x", PLACE), ("v", SPEED)):
        units = length if name == "x" else length / second
        size = TOLERANCE * SIZES[name]
        for word, s in (("initial", 0.0), ("final", END)):
            where = f"{name} at t = {s * second:.6g} s"
            value = course(s)
            for sign in (1.0, -1.0):
                yield f"{word} values", size * units, where, lambda x, n=name, w=word, v=value, g=sign, z=size, k=units: (
                    problem(unit, **{n: {w: (v + g * x * z) * k}}), plan(unit)
                )  # fmt: skip
    for value, scale, bounds in (
        (0.7, 0.7, lambda off: {"upper": 0.7 - off}),
        (-0.7, 0.7, lambda off: {"upper": -0.7 - off}),
        (0.7, 5.0, lambda off: {"lower": 0.7 + off, "upper": 5.0}),
    ):
        yield "bounds of parameters", TOLERANCE * scale, "p", lambda x, b=bounds, z=scale, v=value: (
            problem(unit, p=b(x * TOLERANCE * z)), plan(unit, p=v)
        )  # fmt: skip
    for scale in (None, 5.0):
        size = TOLERANCE * (scale or PLACE(END))
        how = {} if scale is None else {"scale": scale * length}
        for side, sign in (("lower", -1.0), ("upper", 1.0)):
            yield "end", size * length, "", lambda x, s=side, g=sign, z=size, h=how: (
                problem(unit, end={"upper": None, s: (PLACE(END) - g * x * z) * length, **h}), plan(unit)
            )  # fmt: skip


def limits(unit):
    """Yield the name of each check, its largest accepted violation, its place, and a case.

    The case returns problem and plan for a share of that violation."""
    yield from along(unit)
    yield from at_ends(unit)
    length, _ = unit
    # The end of the motion is off by less than its own tolerance.
    size = TOLERANCE * 0.1
    for sign in (1.0, -1.0):
        yield "objective", size * length, "the integrated motion", lambda x, g=sign: (
            problem(unit), plan(unit, off=[(0, (NOTHING, g * x * size * RISE))])
        )  # fmt: skip


def two_phases(unit, *, link=True):
    """Return a problem whose second phase is the first one again."""
    length, second = unit
    ocp = OptimalControlProblem("two phases")
    phases = []
    for name in ("first", "second"):
        free = (0.0, 90.0 * second)
        phase = ocp.phase(name, time=(0.0 if name == "first" else free, free))
        x, v = phase.state("x", scale=3.0 * length), phase.state("v")
        u = phase.control("u")
        z = phase.state("z")
        phase.dynamics({x: v, v: u, z: 0.0})
        phases.append(phase)
    if link:
        ocp.link(*phases, "x")
    ocp.minimise(phases[1].end)
    return ocp


def in_two(unit, *, gap=0.0, late=0.0, shift=None, off=((), ())):
    """Return the plan whose second phase begins where the first ends, but for a gap."""
    shift = PLACE(END) - PLACE(0.0) + gap if shift is None else shift
    first = part(unit, name="first", off=off[0])
    start = END * unit[1] + late
    return ControlPlan((first, part(unit, name="second", start=start, shift=shift, off=off[1])))


@cache
def cases_of(unit):
    return [*limits(unit)]


@pytest.mark.sample(2)
@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("name", LIMITS)
def test_the_limit_of_each_check(name, unit):
    cases = [case for case in cases_of(unit) if case[0] == name]
    assert cases
    for _, allowed, where, case in cases:

        def verify(x, case=case, where=where):
            ocp, motion = case(x)
            found = ocp.verify(motion)
            if x > 1.0:
                assert found.violated[0].where.startswith(where), str(found)
            return found

        assert_allowed(name, allowed, verify, rel=ACCURACY)


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_limits_of_a_link(sign, unit):
    place, late = TOLERANCE * 3.0, TOLERANCE * 90.0 * unit[1]
    ocp = two_phases(unit)
    assert_allowed(
        LINKS[0], place * unit[0], lambda x: ocp.verify(in_two(unit, gap=sign * x * place))
    )
    assert_allowed(LINKS[1], late, lambda x: ocp.verify(in_two(unit, late=sign * x * late)))


@pytest.mark.parametrize("unit", UNITS)
def test_the_phase_nearest_to_its_own_limit_is_reported(unit):
    ocp = two_phases(unit, link=False)
    far = 100.0
    # The scale that is declared is more than the first course.
    small, large = TOLERANCE * 3.0 * BUMP, TOLERANCE * (far + SIZES["x"]) * BUMP
    for first, second, name in ((1.1, 0.9, "first"), (0.9, 1.1, "second")):
        off = [(0, (first * small, NOTHING))], [(0, (second * large, NOTHING))]
        found = ocp.verify(in_two(unit, shift=far, off=off))
        assert [check.name for check in found.violated] == ["motion"]
        assert found.violated[0].where.endswith(f"of phase '{name}'")


def test_an_unstable_phase_leaves_the_objective_unchecked():
    ocp = OptimalControlProblem("an unstable phase")
    parts = []
    for name, rate in (("first", 0.0), ("second", 20.0)):
        phase = ocp.phase(name, time=(0.0, 2.0))
        x = phase.state("x")
        phase.dynamics({x: rate * x})
        knots = np.array([0.0, 2.0])
        none = Piecewise(knots, (NODES,), (np.zeros((NODES.size, 0)),))
        still = Piecewise(knots, (NODES,), (np.zeros((NODES.size, 1)),))
        parts.append(PhasePlan(name, still, none, ("x",), ()))
    ocp.minimise(phase.final(x))
    found = ocp.verify(ControlPlan(tuple(parts)))
    assert found.ok and names_of(found) == {"motion", "continuity of states", "times"}


def test_every_check_has_its_limit():
    unit = (1.0, 1.0)
    wide = {"lower": -9.0, "upper": 9.0}
    ocp = problem(unit, x={**wide, "initial": (-9, 9), "final": (-9, 9)}, u=wide, p=wide)
    found = ocp.verify(plan(unit)), two_phases(unit).verify(in_two(unit))
    assert all(each.ok for each in found), found
    assert names_of(found[0]) == set(LIMITS)
    assert names_of(found[1]) == {"motion", "continuity of states", "times", "objective", *LINKS}
    bare = problem(unit).verify(plan(unit))
    assert names_of(found[0]) - names_of(bare) == {
        "initial values", "final values", "bounds of states", "bounds of controls", "bounds of parameters"
    }  # fmt: skip
