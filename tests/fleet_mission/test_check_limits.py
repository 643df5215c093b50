"""What each check of a mission accepts: 0.9 of its tolerance, and not 1.1."""

from dataclasses import replace
from math import factorial

import numpy as np
import pytest
from check_limits import SCALES, assert_complete, assert_limit, assert_only, pairs
from fleet_mission.missions import delayed, flown, legs, small

from crosstrack.models import Trajectory
from crosstrack.models.fleet_mission import MissionPlan, MovingObstacle, checks

TOLERANCE = 1e-6
HOME, A, B, C = [1, 1], [8, 8], [8, 2], [2, 8]
#: Accepted error of a position: tolerance of a cell of 0.5 m, and rounding of bounds of 10 m.
DEPTH = 0.5 * TOLERANCE + 10e-13
LENGTHS = (
    "bounds",
    "depot",
    "cell",
    "radius",
    "separation",
    "velocity_limit",
    "acceleration_limit",
)


def scaled(scale, **changes):
    """Return :func:`small` with all lengths, and so speeds, multiplied by `scale`."""
    model = small(**changes)
    fields = {name: scale * getattr(model, name) for name in LENGTHS}
    obstacles = [scale * np.array(one.shell) for one in model.obstacles]
    return replace(model, obstacles=obstacles, nodes=scale * model.nodes, **fields)


def verified(plan, scale=1.0, tolerance=TOLERANCE, **changes):
    """Return the verification of a plan for :func:`small`, all lengths multiplied by `scale`."""
    curves = [t and Trajectory(t.times, scale * t.coefficients) for t in plan.trajectories]
    plan = replace(plan, trajectories=tuple(curves))
    return scaled(scale, **changes).verify(plan, tolerance=tolerance)


def flight(first=((1, B), (0, A), (None, B)), second=((2, C),), home=HOME, later=200.0):
    """Return a plan of two robots, one after the other."""
    return delayed(flown([home, *first], [home, *second]), later)


def case(plan_at, share_of=DEPTH, **changes):
    """Return the case of a plan that depends on a violation."""
    return lambda scale, share: verified(plan_at(share * share_of), scale, **changes)


def bump(order, side):
    """Return the polynomial of degree 7 whose derivatives 0 … 3 are 0 at both ends, but one is 1."""
    begin = np.diag([float(factorial(p)) for p in range(4)])
    begin = np.hstack([begin, np.zeros((4, 4))])
    end = np.array(
        [[factorial(p) / factorial(p - i) if p >= i else 0.0 for p in range(8)] for i in range(4)]
    )
    return np.linalg.solve(np.vstack([begin, end]), np.eye(8)[order + 4 * side])


def bent(*bumps, plan=None):
    """Return a plan with bumps: robot, segment, side of it, order, axis and size of the derivative."""
    plan = plan or flight()
    curves = list(plan.trajectories)
    for robot, segment, side, order, axis, size in bumps:
        powers = curves[robot].coefficients.copy()
        powers[segment, :, axis] += size * 20.0**order * bump(order, side)
        curves[robot] = Trajectory(curves[robot].times, powers)
    return replace(plan, trajectories=tuple(curves))


#: The least of both axes counts: 1 m/s, 0.5 m/s² and with them 0.25 m/s³.
UNEVEN = {"velocity_limit": [2.0, 1.0], "acceleration_limit": [0.5, 3.0]}


def jump(order, accepted, knot=3, axis=0, extra=(), **changes):
    """Return the case of a jump at a knot of the first robot."""
    return case(
        lambda e: bent((0, knot, 0, order, axis, e), *extra), accepted, **{**UNEVEN, **changes}
    )


def at_end(order, accepted):
    """Return cases of a derivative at the first start and at the last end."""
    return [
        case(lambda e: bent((1, 0, 0, order, 0, e)), accepted, **UNEVEN),
        case(lambda e: bent((0, 3, 1, order, 1, -e)), accepted, **UNEVEN),
    ]


def jerks(size, axis=0):
    """Return bumps of the jerk at the knot 1 that leave no jump there."""
    return ((0, 0, 1, 3, axis, size), (0, 1, 0, 3, axis, size))


def steady(share):
    """Return a jerk's jump that is `share` of the tolerance of the larger jerk at the knot."""
    size = 1e-3 / (1.0 - share * TOLERANCE)
    return bent((0, 2, 1, 3, 1, 1e-3), (0, 3, 0, 3, 1, size))


def limit(field, most, axis, plan=None):
    """Return the case of the limit of a derivative whose largest component is `most`."""

    def found(scale, share):
        limits = np.full(2, 9.0)
        limits[axis] = most / (1.0 + share * TOLERANCE)
        return verified(plan or flight(), scale, **{field: limits})

    return found


#: Greatest velocity and acceleration of a leg of one metre from rest to rest in a second.
SPEED, PUSH = 35 / 16, 84 * 5**0.5 / 25
#: The way back from (8, 2) is the fastest leg, against both axes.
BACK = replace(
    flight(),
    trajectories=(
        legs([HOME, B, A, B, HOME], [0.0, 20, 40, 60, 76]),
        flight().trajectories[1],
    ),
)


def both(scale, share):
    """Exceed both limits: the larger limit by the larger amount, the other by the larger share."""
    limits = [
        7 * SPEED / 16 / (1.0 + 0.9 * share * TOLERANCE),
        7 * SPEED / 20 / (1.0 + share * TOLERANCE),
    ]
    return verified(BACK, scale, velocity_limit=limits)


def far(scale, share):
    """Ten thousand kilometres from the origin, digits leave open more than the tolerance allows."""
    shift = np.array([-1e7, 0.0])
    noise = 1e-13 * 1e7 + 1e-9 * 0.5
    model = small()
    moved = replace(
        model, obstacles=[], bounds=model.bounds + np.tile(shift, 2), nodes=model.nodes + shift,
        depot=model.depot + shift, cell=0.5,
    )  # fmt: skip
    places = np.array([[1, 1 + share * noise], B, A, B, HOME]) + shift
    first = legs(places, [0.0, 20, 40, 60, 80])
    second = legs(np.array([HOME, C, HOME]) + shift, [200.0, 220, 240])
    plan = MissionPlan([[1, 0], [2]], [first, second], [[20.0, 40], [220.0]])
    return moved.verify(plan, tolerance=1e-9)


def twice(e):
    """Return a plan that visits two nodes at one place in the wrong order, `e` seconds apart."""
    plan = flight(((1, B), (0, A), (None, B)))
    return MissionPlan(
        [[1, 0, 3], [2]], plan.trajectories, [[20.0, 40.0, 40.0 - e], plan.visits[1]]
    )


TWICE = {"nodes": [A, B, C, A]}
AT_HOME = {"nodes": [A, B, C, HOME]}


def outside(when):
    """Return a plan with a node at the depot that is visited before the start or after the end."""

    def plan(e):
        found = flight()
        times = [-e, 20.0, 40.0] if when < 0 else [20.0, 40.0, 80.0 + e]
        route = [3, 1, 0] if when < 0 else [1, 0, 3]
        return MissionPlan([route, [2]], found.trajectories, [times, found.visits[1]])

    return plan


def slow(scale, share):
    """A million seconds ago, digits of times leave open more than the tolerance allows."""
    noise = 16 * np.finfo(float).eps * 1e6 + 1e-9 * 0.5
    plan = twice(0.0)
    first = Trajectory(np.linspace(-1e6, 0.0, 5), plan.trajectories[0].coefficients)
    visits = ([-7.5e5, -5e5, -5e5 - share * noise], plan.visits[1])
    plan = replace(plan, trajectories=(first, plan.trajectories[1]), visits=visits)
    return verified(plan, scale, 1e-9, **TWICE)


def along(side):
    """Return plans that lead along a side of the square at `side`, deeper by `e`."""
    return lambda e: flight(
        ((None, [3, side + e]), (None, [7, side + e]), (1, B), (0, A), (None, B))
    )


def corner(scale, share):
    """Two robots on a right angle are nearest half-way, when each is 3.5 m from the corner."""
    plan = delayed(flown([HOME, (0, [8, 1])], [HOME, (1, [1, 8])]), 20.0)
    apart = 3.5 * 2**0.5 + share * (DEPTH + 10e-13)
    return verified(plan, scale, nodes=[[8, 1], [1, 8]], separation=apart)


def passing(shift):
    """Return the case of robots that pass each other 0.6 m apart, from (2, 3) and (9 + shift, 3.6)."""
    first = (None, [2, 3]), (None, [8, 3]), (0, [8, 1]), (None, [9, 1])
    x = 9 + shift
    second = (None, [x, 2]), (None, [x, 9]), (None, [x, 3.6]), (None, [x - 6, 3.6]), (1, C)
    plan = delayed(flown([HOME, *first], [HOME, *second]), -40.0)

    def found(scale, share):
        apart = 0.6 + share * (DEPTH + 10e-13)
        return verified(plan, scale, nodes=[[8, 1], C], separation=apart)

    return found


def beside(scale, share):
    """A moving obstacle passes one metre beside the first robot, in half of the scaled time."""
    radius = scale * (0.75 + share * (DEPTH + 10e-13))
    cart = MovingObstacle(radius, [0.0, 35.0], scale * np.array([[9.0, 9.0], [9.0, 2.0]]))
    return verified(flight(), scale, moving=[cart])


def early(e):
    """Return a plan whose second robot departs `e` seconds before 0."""
    return delayed(flown([HOME, (1, B), (0, A), (None, B)], [HOME, (2, C)], pace=2.0**5), -e)


ORDER = 0.5 * TOLERANCE  # the time for a cell at 1 m/s
LIMITS = {
    "nodes passed at their times": [
        case(lambda e: flight(((1, B), (0, [8 - 0.6 * e, 8 + 0.8 * e]), (None, B)))),
        case(lambda e: flight(((1, [8, 2 - e]), (0, A), (None, B)))),
        case(lambda e: flight(second=((2, [2 + e, 8]),))),
    ],
    "visits in order": [
        case(twice, ORDER, **TWICE),
        case(twice, 0.5 * ORDER, **TWICE, velocity_limit=[3.0, 2.0]),
        case(outside(-1), ORDER, **AT_HOME),
        case(outside(1), ORDER, **AT_HOME),
        slow,
    ],
    "begins and ends at the depot": [
        case(lambda e: bent((0, 0, 0, 0, 0, 0.6 * e), (0, 0, 0, 0, 1, -0.8 * e))),
        case(lambda e: bent((1, 1, 1, 0, 1, e))),
        far,
    ],
    "velocity 0 at both ends": at_end(1, TOLERANCE),
    "acceleration 0 at both ends": at_end(2, 0.5 * TOLERANCE),
    "jerk 0 at both ends": at_end(3, 0.25 * TOLERANCE),
    "continuity of position": [jump(0, DEPTH), jump(0, DEPTH, axis=1)],
    "continuity of velocity": [jump(1, TOLERANCE), jump(1, -TOLERANCE, knot=1)],
    "continuity of acceleration": [jump(2, 0.5 * TOLERANCE), jump(2, 0.5 * TOLERANCE, axis=1)],
    "continuity of jerk": [
        lambda scale, share: verified(steady(share), scale, **UNEVEN),
        # A hundredth of the jerk elsewhere, and a thousand times what follows from the limits.
        jump(3, 1e-2 * 1e-2 * TOLERANCE, extra=jerks(1e-2)),
        jump(3, 1e-2 * 1e-2 * TOLERANCE, axis=1, extra=(*jerks(1e-2, 1), *jerks(1e-3))),
        jump(3, 1e3 * TOLERANCE / 1e7, extra=((0, 2, 1, 3, 0, 1e-2), (0, 3, 0, 3, 0, 1e-2)),
             velocity_limit=1e7, acceleration_limit=1.0),
    ],
    "velocity within its limit": [
        limit("velocity_limit", 7 * SPEED / 20, 0),
        limit("velocity_limit", 7 * SPEED / 20, 1),
        limit("velocity_limit", 7 * SPEED / 16, 0, BACK),
        both,
    ],
    "acceleration within its limit": [
        limit("acceleration_limit", 7 * PUSH / 400, 0),
        limit("acceleration_limit", 7 * PUSH / 400, 1),
        limit("acceleration_limit", 7 * PUSH / 256, 0, BACK),
    ],
    "inside the bounds": [
        case(lambda e: flight(((1, B), (0, A), (None, [10 + e, 2])))),
        case(lambda e: flight(((1, B), (0, A), (None, [8, -e])))),
        case(lambda e: flight(second=((2, C), (None, [5, 10 + e])))),
        case(lambda e: flight(second=((2, C), (None, [-e, 5])))),
    ],
    "radius away from obstacles": [case(along(3.75)), case(along(4.0), radius=0.0)],
    "distance between robots": [corner, passing(0.0), passing(0.3)],
    "distance to moving obstacles": [beside],
    "departures at time 0 or later": [case(early, ORDER, objective="makespan", separation=0.0)],
}  # fmt: skip
ALONE = flown([HOME, (1, B), (0, A), (None, B), (None, HOME), (2, C)])
#: Plans with one fault, and the place that the check must name.
FAULTS = {
    "one route for each robot": [(ALONE, "")],
    "each node visited once": [
        (flight(((1, B), (0, A), (1, B))), "node 1"),
        (flight(((None, B), (0, A), (None, B))), "node 1"),
    ],
    "every robot used": [
        (MissionPlan((*ALONE.routes, ()), (*ALONE.trajectories, None), (*ALONE.visits, ())), "robot 1"),
    ],
    "a trajectory for each route": [
        (replace(flight(), trajectories=(flight().trajectories[0], None)), "robot 1"),
    ],
}  # fmt: skip


@pytest.mark.sample(3)
@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize(("name", "case"), pairs(LIMITS))
def test_a_limit_is_kept_within_its_tolerance(name, case, scale):
    assert_limit(name, lambda share: case(scale, share))


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize(("name", "fault"), pairs(FAULTS))
def test_one_fault_is_named(name, fault, scale):
    plan, where = fault
    found = verified(plan, scale)
    assert_only(name, found)
    assert (found.violated[0].worst, found.violated[0].where) == (1.0, where)
    assert (found.objective is None) == (name == "one route for each robot")


def test_places_of_violations_are_named():
    fast = verified(BACK, velocity_limit=0.9)
    assert_only("velocity within its limit", fast)
    assert fast.violated[0].where == "robot 0, axis 0 (t = 68 s)"
    deep = verified(along(3.85)(0.0))
    assert_only("radius away from obstacles", deep)
    assert deep.violated[0].where.startswith("robot 0 (t = ")
    assert deep.violated[0].where.endswith(", y 3.85 m")


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("objective", ["sum", "range"])
def test_a_range_is_compared_relative_to_the_lengths(objective, scale):
    loads = np.array([2 * np.hypot(7, 1) + 12, 2 * np.hypot(1, 7)])
    found = verified(flight(), scale, objective=objective)
    value, size = (np.ptp(loads), loads.mean()) if objective == "range" else (loads.sum(), 0.0)
    assert found.objective == pytest.approx(scale * value, rel=1e-9)
    assert found.scale == pytest.approx(scale * size, rel=1e-9)


def test_no_distance_between_robots_is_reported_but_not_required():
    plan = flown(
        [HOME, (1, B), (0, A), (None, B)], [HOME, (None, [8, 3]), (None, B), (None, HOME), (2, C)]
    )
    assert_only("distance between robots", verified(plan, separation=0.5))
    found = verified(plan, separation=0.0)
    assert found.ok
    assert found.checks[-1].name == "separation not required"
    assert "robots 0 and 1" in found.checks[-1].where


def test_every_check_is_tested():
    cart = MovingObstacle(0.5, [0.0], [[5.0, 9.0]])
    found = [verified(flight(), separation=separation, moving=[cart]) for separation in (0.0, 0.5)]
    assert_complete({*LIMITS, *FAULTS, "separation not required"}, found, checks)
