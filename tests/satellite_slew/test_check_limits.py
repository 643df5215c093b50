"""Limits of the checks of a slew: 1.1 times the accepted violation is refused, 0.9 times is not."""

from functools import cache

import numpy as np
import pytest
from check_limits import assert_allowed, names_of
from numpy.polynomial import Polynomial
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from crosstrack.models import ControlPlan, PhasePlan, SatelliteSlew
from crosstrack.models.optimal_control.plan import Piecewise
from crosstrack.models.satellite_slew.dynamics import CONTROLS, STATES
from crosstrack.models.satellite_slew.flight import Tracking, verify_flight

TOLERANCE = 1e-6
#: Units of mass and of time.
UNITS = [(1e-3, 10.0), (1.0, 1.0), (1e3, 0.1)]
BETA = np.deg2rad(54.73)
INERTIA = np.array([[228.0, 3.0, -5.0], [3.0, 188.0, 7.0], [-5.0, 7.0, 176.0]])
MOMENTUM, DURATION, BEGIN = 17.53, 8.0, np.array([0.5, 0.1, -0.7, 0.5])
RATE_LIMIT, GIMBAL_LIMIT, TORQUE_LIMIT = 0.05, 1.0, 25.0
#: The course of the gimbals, which begin and end at 0: fast away, slowly back; the last is the fastest.
COURSE = Polynomial([0, 1]) * Polynomial([1, -1]) ** 3 * (256 / 27)
GIMBALS = np.array([0.1, -0.2, 0.15, -0.5])
PARTS = ["attitude", "body rates", "gimbal angles"]
#: A bump of height 1 that leaves both ends as they are.
BUMP = Polynomial([0, 1]) ** 2 * Polynomial([1, -1]) ** 2 * 16
NODES = -np.cos(np.linspace(0.0, np.pi, 25))
#: Places in the phase at which a plan of one interval is measured.
GRID = np.unique(np.concatenate([np.linspace(-1.0, 1.0, 2001), NODES])) / 2 + 0.5


def direction(gimbals):
    """Return the momentum of the gyros in units of one wheel's, shape (…, 3); complex angles are allowed."""
    s, c = np.sin(gimbals), np.cos(gimbals)
    cb, sb = np.cos(BETA), np.sin(BETA)
    return np.stack([
        -cb * s[..., 0] - c[..., 1] + cb * s[..., 2] + c[..., 3],
        c[..., 0] - cb * s[..., 1] - c[..., 2] + cb * s[..., 3],
        sb * s.sum(axis=-1),
    ], axis=-1)  # fmt: skip


def turned(q, w):
    """Return q̇ for body rates w, from the matrix of the quaternion."""
    a, b, c, d = q
    return 0.5 * np.array([[-b, -c, -d], [a, -d, c], [d, a, -b], [-c, b, a]]) @ w


class Slew:
    """A slew that keeps every condition: without momentum, the rates follow from the gimbals.

    The last gimbal may begin and end `off` 0 (rad).
    """

    def __init__(self, unit, off=(0.0, 0.0)):
        mass, time = unit
        self.courses = [COURSE * size for size in GIMBALS]
        self.courses[3] += Polynomial([off[0], off[1] - off[0]])
        self.end = DURATION * time
        self.momentum = MOMENTUM * mass / time
        self.inertia = INERTIA * mass
        self.states = self.at(NODES / 2 + 0.5)
        self.controls = self.rates(NODES / 2 + 0.5)
        last = self.states[-1, :4]
        self.fields = {
            "inertia": self.inertia, "momentum": self.momentum, "rate_weight": 0.1 * time**2,
            "rate_limit": RATE_LIMIT / time, "gimbal_rate_limit": GIMBAL_LIMIT / time,
            "torque_limit": TORQUE_LIMIT * mass / time**2, "initial_attitude": BEGIN,
            "final_attitude": -last, "time_range": (1.0 * time, 60.0 * time),
        }  # fmt: skip

    def gimbals(self, s):
        return np.stack([course(np.asarray(s)) for course in self.courses], axis=-1)

    def rates(self, s):
        rates = [course.deriv()(np.asarray(s)) for course in self.courses]
        return np.stack(rates, axis=-1) / self.end

    def body_rates(self, s):
        return -self.momentum * direction(self.gimbals(s)) @ np.linalg.inv(self.inertia)

    def torque(self, s):
        return -self.momentum * direction(self.gimbals(s) + 1e-30j * self.rates(s)).imag / 1e-30

    def measure(self, s):
        steps = np.eye(4)[:, None] * 1e-30j
        jacobian = np.moveaxis(direction(self.gimbals(s) + steps).imag / 1e-30, 0, -1)
        return np.linalg.det(jacobian @ np.swapaxes(jacobian, -1, -2))

    def at(self, s):
        found = solve_ivp(
            lambda at, q: self.end * turned(q, self.body_rates(at)), (0.0, 1.0), BEGIN, "DOP853", s,
            rtol=1e-12, atol=1e-13,
        )  # fmt: skip
        return np.hstack([found.y.T, self.body_rates(s), self.gimbals(s)])

    def model(self, **how):
        return SatelliteSlew(**{**self.fields, **how})

    def plan(self, off=0.0, start=0.0):
        """Return the plan with something added to its states at the nodes."""
        knots = np.array([start, start + self.end])
        states = Piecewise(knots, (NODES,), (self.states + off,))
        controls = Piecewise(knots, (NODES,), (self.controls,))
        return ControlPlan((PhasePlan("slew", states, controls, STATES, CONTROLS),))


slew = cache(Slew)


LIMITS = [
    "start at 0, final time within its range",
    *(f"{end} {part}" for end in ("initial", "final") for part in PARTS),
    *(f"{part} integrated anew" for part in PARTS),
    "body rate limit",
    "gimbal rate limit",
    "control torque limit",
    "gimbal rate limit, 25 % in reserve",
    "control torque limit, 25 % in reserve",
    "singularity measure",
    "norm of the quaternion",
    "total momentum",
]
#: Checks of a flight against a limit that has a tolerance, and without one.
FLOWN = ["body rate", "gimbal rate", "control torque", "singularity measure"]
ENDS = ["final angle off the target", "final body rate", "drift of the quaternion's length"]


def across(q):
    """Return the change of a quaternion by half a radian's turn about the body's x axis."""
    return np.stack([-q[..., 1], q[..., 0], q[..., 3], -q[..., 2]], axis=-1)


def ends(unit):
    """Yield the cases of times and ends, as :func:`limits` does."""
    one, (_, time) = slew(unit), unit
    high = TOLERANCE * 60.0 * time
    where = f"t0 = 0 s, tf = {one.end:.9g} s"
    yield LIMITS[0], high, where, lambda x: (
        one.model(time_range=(one.end + x * high, 60.0 * time)), one.plan()
    )  # fmt: skip
    share = TOLERANCE * one.end
    yield LIMITS[0], share, where, lambda x: (
        one.model(time_range=(time, one.end - x * share)), one.plan()
    )  # fmt: skip
    for sign in (1.0, -1.0):
        yield LIMITS[0], high, "t0 = ", lambda x, sign=sign: (
            one.model(), one.plan(start=sign * x * high)
        )  # fmt: skip
    rates = one.fields["rate_limit"]
    for side, word in enumerate(("initial", "final")):
        attitude = one.states[-side, :4]
        off = across(attitude) / np.abs(across(attitude)).max() * TOLERANCE
        k = int(np.abs(off).argmax())
        yield f"{word} attitude", TOLERANCE, f"q[{k}] = {attitude[k]:.9g}", lambda x, w=word, q=attitude, d=off: (
            one.model(**{f"{w}_attitude": q + x * d}), one.plan()
        )  # fmt: skip
        # To first order, these gimbal angles hold no momentum.
        null = TOLERANCE * np.array([1.0, -1.0, 1.0, -1.0])
        yield f"{word} gimbal angles", TOLERANCE, "delta[", lambda x, w=word, d=null: (
            one.model(**{f"{w}_gimbals": -x * d}), one.plan()
        )  # fmt: skip
        unit_rates = np.abs(Slew(unit, (1e-6, 1e-6)).body_rates(0.0)).max() / 1e-6
        gimbal = TOLERANCE * rates / unit_rates

        def moving(x, side=side, gimbal=gimbal):
            other = Slew(unit, (x * gimbal * (1 - side), x * gimbal * side))
            return other.model(), other.plan()

        yield f"{word} body rates", TOLERANCE * rates, "w[2] = ", moving


def limits(unit):
    """Yield the name of each check, its largest accepted violation, its place, and a case.

    The case returns model and plan for a share of that violation."""
    one = slew(unit)
    yield from ends(unit)
    rates, inner = one.fields["rate_limit"], BUMP(NODES / 2 + 0.5)[:, None]
    exact, bump = one.at(GRID), BUMP(GRID)[:, None]
    seconds = GRID * one.end

    def changed(table, name, allowed, columns=slice(0, 11)):
        """Return the case whose states are off by `table` at the nodes."""
        off = np.zeros((NODES.size, 11))
        off[:, columns] = inner * table
        return name, allowed, "t = ", lambda x: (one.model(), one.plan(x * allowed * off))

    sideways = across(one.states[:, :4]) / np.abs(bump * across(exact[:, :4])).max()
    yield changed(sideways, "attitude integrated anew", TOLERANCE, slice(0, 4))
    yield changed([0.0, -1.0, 0.0], "body rates integrated anew", TOLERANCE * rates, slice(4, 7))
    # These gimbal angles hold little momentum.
    yield changed([-1.0, 0.9, -0.9, 0.9], "gimbal angles integrated anew", TOLERANCE, slice(7, 11))
    for sign in (0.5, -0.5):
        longer = sign * one.states[:, :4]
        yield changed(longer, "norm of the quaternion", TOLERANCE, slice(0, 4))
    steps = direction(exact[:, 7:] + 1e-6 * bump) - direction(exact[:, 7:])
    drift = Rotation.from_quat(exact[:, [1, 2, 3, 0]]).apply(one.momentum * steps) / 1e-6
    yield changed(
        1.0 / np.abs(drift).max(), "total momentum", TOLERANCE * one.momentum, slice(7, 11)
    )

    spread = one.body_rates(GRID), one.rates(GRID), one.torque(GRID)
    fields = ("rate_limit", "gimbal_rate_limit", "torque_limit")
    labels = ("w", "rate", "T_c")
    for name, field, label, values in zip(LIMITS[10:13], fields, labels, spread, strict=True):
        for norm in (False, True):
            if norm and label == "rate":
                continue
            size = np.linalg.norm(values, axis=1)[:, None] if norm else np.abs(values)
            most = size.max()
            row, column = np.unravel_index(size.argmax(), size.shape)
            where = f"t = {seconds[row]:.6g} s, " + (f"|{label}|" if norm else f"{label}[{column}]")
            margins = (0.0, 0.25) if label != "w" else (0.0,)
            for margin in margins:
                full = f"{name}, 25 % in reserve" if margin else name
                how = {
                    "margin": margin,
                    "vector_limits": "norm" if norm else "components",
                }
                yield full, TOLERANCE * most, where, lambda x, f=field, most=most, how=how: (
                    one.model(**{f: most / (1.0 + x * TOLERANCE) / (1.0 - how["margin"])}, **how),
                    one.plan(),
                )  # fmt: skip
    measure = one.measure(GRID)
    where = f"t = {seconds[measure.argmin()]:.6g} s, det(A_t A_t')"
    yield "singularity measure", TOLERANCE, where, lambda x: (
        one.model(singularity_limit=measure.min() + x * TOLERANCE), one.plan()
    )  # fmt: skip


@cache
def cases_of(unit):
    return [*limits(unit)]


@pytest.mark.sample(3)
@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("name", LIMITS)
def test_the_limit_of_each_check(name, unit):
    cases = [case for case in cases_of(unit) if case[0] == name]
    assert cases
    for _, allowed, where, case in cases:

        def verify(x, case=case, where=where):
            model, plan = case(x)
            found = model.verify(plan)
            if x > 1.0:
                assert found.violated[0].where.startswith(where), found.violated[0].where
            return found

        assert_allowed(name, allowed, verify)


@pytest.mark.parametrize("unit", UNITS)
def test_every_check_has_its_limit(unit):
    one = slew(unit)
    found = one.model().verify(one.plan()), one.model(margin=0.25).verify(one.plan())
    assert all(each.ok for each in found) and names_of(*found) == set(LIMITS)
    price = 1.0 + one.fields["rate_weight"] * (one.rates(GRID) ** 2).sum(axis=1)
    assert found[0].objective == pytest.approx(np.trapezoid(price, GRID * one.end), rel=1e-6)
    free = one.model(final_gimbals=None).verify(one.plan())
    assert names_of(found[0]) - names_of(free) == {"final gimbal angles"}


def test_gyros_that_hold_momentum_at_rest_conserve_it():
    one = slew(UNITS[1])
    gimbals = [0.3, -0.1, 0.2, 0.1]
    rest = np.concatenate([BEGIN, np.zeros(3), gimbals])
    ends = {"initial_gimbals": gimbals, "final_gimbals": gimbals, "final_attitude": BEGIN}
    still = one.plan(rest - one.states)
    phase = still.phases[0]
    controls = Piecewise(phase.states.knots, (NODES,), (np.zeros((NODES.size, 4)),))
    plan = ControlPlan((PhasePlan("slew", phase.states, controls, STATES, CONTROLS),))
    assert np.abs(one.model(**ends).total_momentum).min() > 1e-3 * one.momentum
    found = one.model(**ends).verify(plan)
    assert found.ok, found


def flight(one):
    """Return instants, states and the rates that are held between them."""
    s = np.linspace(0.0, 1.0, 81)
    return s * one.end, one.at(s), one.rates(s[:-1])


def flown(one, name):
    """Return the field of a flight's limit, and what is met in each sample."""
    _, states, controls = flight(one)
    if name == "body rate":
        return "rate_limit", np.abs(states[:, 4:7])
    if name == "gimbal rate":
        return "gimbal_rate_limit", np.abs(controls)
    if name == "singularity measure":
        return "singularity_limit", one.measure(np.linspace(0.0, 1.0, 81))[:, None]
    # The rates are held while the gimbals turn: both ends of a sample count.
    edges = [direction(states[k : k + 80, 7:] + 1e-30j * controls).imag / 1e-30 for k in (0, 1)]
    return "torque_limit", one.momentum * np.abs(edges).max(axis=0)


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("name", FLOWN)
def test_the_limit_of_each_check_of_a_flight(name, unit):
    one = slew(unit)
    times, states, controls = flight(one)
    field, values = flown(one, name)
    least = name == "singularity measure"
    most, sign = (values.min(), -1.0) if least else (values.max(), 1.0)
    row = int(np.argwhere(values == most)[0, 0])

    def verify(x):
        limit = most / (1.0 + sign * x * TOLERANCE)
        model = one.model(**{field: limit}, margin=0.5)
        found, breach = verify_flight(model, times, states, controls, TOLERANCE, (0.1, 0.1))
        assert (breach is None) == (x < 1.0)
        if breach is not None:
            assert (breach.name, breach.time) == (name, times[row])
            assert [breach.value, breach.worst] == pytest.approx([most, most], rel=1e-12)
            assert breach.limit == limit
        return found

    assert_allowed(name, TOLERANCE * most, verify)


@pytest.mark.parametrize("share", [1.1, 0.9])
@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("name", ENDS)
def test_the_end_of_a_flight_has_no_tolerance(name, unit, share):
    one = slew(unit)
    times, states, controls = flight(one)
    angle, rate = 1e-3, 1e-4 / unit[1]
    if name == ENDS[0]:
        half = 0.5 * share * angle
        states[-1, :4] = np.cos(half) * states[-1, :4] + np.sin(half) * across(states[-1, :4])
    elif name == ENDS[1]:
        states[-1, 5] = -share * rate
    else:
        states[40, :4] *= np.sqrt(1.0 - share * 1e-6)
    found, breach = verify_flight(one.model(), times, states, controls, TOLERANCE, (angle, rate))
    assert names_of(found) == {*FLOWN, *ENDS}
    assert [check.name for check in found.violated] == ([name] if share > 1.0 else [])
    check = next(check for check in found.checks if check.name == name)
    limit = {ENDS[0]: angle, ENDS[1]: rate, ENDS[2]: 1e-6}[name]
    assert check.worst == pytest.approx(max(share - 1.0, 0.0) * limit, rel=1e-3)
    assert (check.tolerance, check.limit) == (0.0, limit)
    if breach is not None:
        assert breach.time == times[40 if name == ENDS[2] else -1]
    price = 1.0 + one.fields["rate_weight"] * (controls**2).sum(axis=1)
    assert found.objective == pytest.approx(np.diff(times) @ price, rel=1e-12)


@pytest.mark.parametrize("column", [0, 4, 7])
def test_nan_in_a_flight_is_the_largest_violation(column):
    """A flight that is not a number was verified."""
    one = slew(UNITS[1])
    times, states, controls = flight(one)
    states[-1, column] = np.nan
    found, breach = verify_flight(one.model(), times, states, controls, TOLERANCE, (0.1, 0.1))
    broken = {0: {ENDS[0], ENDS[2]}, 4: {FLOWN[0], ENDS[1]}, 7: {FLOWN[2], FLOWN[3]}}[column]
    assert {check.name for check in found.violated} == broken
    assert {check.worst for check in found.violated} == {np.inf}
    # The torque of the last sample counts from its begin.
    assert breach.time == times[-2 if column == 7 else -1]


def test_overflow_in_a_plan_is_the_largest_violation():
    one = slew(UNITS[1])
    off = np.zeros((NODES.size, 11))
    off[12, :7] = 1e200
    found = one.model().verify(one.plan(off))
    broken = {check.name: check.worst for check in found.violated}
    assert broken["total momentum"] == broken["norm of the quaternion"] == np.inf


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_largest_errors_of_a_flight_are_magnitudes(sign):
    times, states, controls = flight(slew(UNITS[1]))
    verification, breach = verify_flight(
        slew(UNITS[1]).model(), times, states, controls, TOLERANCE, (0.1, 0.1)
    )
    quaternions, rates = np.zeros((81, 4)), np.zeros((81, 3))
    # The scalar part of an error is nearly 1.
    quaternions[:, 0] = 1.0
    quaternions[7, 2], rates[9, 1] = 0.03 * sign, 0.02 * sign
    found = Tracking(
        times=times, attitudes=states[:, :4], rates=states[:, 4:7], gimbals=states[:, 7:],
        quaternion_errors=quaternions, rate_errors=rates, commanded=np.zeros((80, 3)),
        applied=np.zeros((80, 3)), gimbal_rates=controls, saturated=np.arange(80) >= 60,
        measures=np.ones(81), verification=verification, breach=breach,
    )  # fmt: skip
    assert found.ok
    assert (found.max_quaternion_error, found.max_rate_error) == (0.03, 0.02)
    assert found.saturated_share == 0.25
    assert "25 % of the samples saturated from t = 6 s; verified" in str(found)
