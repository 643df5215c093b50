"""What each check of a rich fleet accepts: 0.9 of its tolerance, and not 1.1; and each rule by name."""

from types import SimpleNamespace

import numpy as np
import pytest
from check_limits import SCALES, assert_complete, assert_limit, assert_only, names_of, pairs

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation, UnsupportedOption
from crosstrack.instances.fleet import write_routes_csv, write_vrplib
from crosstrack.models import FleetRouting
from crosstrack.models.fleet import FleetPlan, rich_checks

TOLERANCE = 1e-6
POINTS = np.array([[0.0, 0.0], [0.0, 3.0], [4.0, 3.0], [4.0, 0.0]])
#: Departures at 1 s, services at 4 and 8 s of 1 s each, return at 14 s; and 2, 6, 11 s.
ROUTES = [[1, 2], [3]]
STARTS = [[1.0, 4.0, 9.0, 15.0], [2.0, 6.0, 11.0]]
#: Travel and service times of each route, which limit the scale of the tolerances.
WORK = (14.0, 9.0)


def fleet(scale=1.0, **fields):
    data = {"service": scale * np.array([9.0, 1.0, 1.0, 1.0]), "objective": "sum", **fields}
    return FleetRouting(2, points=scale * POINTS, **data)


def plan_of(scale=1.0, routes=ROUTES, starts=STARTS):
    return FleetPlan(routes, [[scale * t for t in row] for row in starts])


def verify(model, scale, **plan):
    return model.verify(plan_of(scale, **plan), tolerance=TOLERANCE)


def above(value, share, scale, noise=15.0e-12, vehicle=0):
    """Return the upper limit that `value` exceeds by `share` of its tolerance and the noise."""
    return scale * (value - share * (TOLERANCE * min(value, WORK[vehicle]) + noise))


def below(value, share, scale, noise=15.0e-12, vehicle=0):
    """Return the lower limit that `value` misses by `share` of its tolerance and the noise."""
    return scale * (value + share * (TOLERANCE * min(value, WORK[vehicle]) + noise))


def windows(scale, node, span):
    """Return windows that are wide but for one node."""
    rows = [None] * 4
    rows[node] = [(100 * scale, 200 * scale), span]
    return rows


def late(node, time):
    def case(scale, share):
        return verify(
            fleet(scale, windows=windows(scale, node, (0, above(time, share, scale)))), scale
        )

    return case


def early(node, time):
    def case(scale, share):
        span = (below(time, share, scale), 90 * scale)
        return verify(fleet(scale, windows=windows(scale, node, span)), scale)

    return case


def released(node, time, **fields):
    def case(scale, share):
        releases = np.zeros(4)
        releases[node] = below(time, share, scale)
        return verify(fleet(scale, releases=releases, **fields), scale)

    return case


def reloaded(scale, share):
    """The second trip reaches node 2, 4 m from the reload, at 9 s, so it departs by 5 s."""
    releases = np.zeros(4)
    releases[2] = below(5.0, share, scale)
    points = np.vstack([POINTS, [0.0, 3.0]])
    model = FleetRouting(2, points=scale * points, reloads=[1], releases=[*releases, 0.0],
                         objective="sum")  # fmt: skip
    routes, starts = [[1, 2], [3, 4]], [STARTS[0], [2.0, 6.0, 11.0, 14.0]]
    return verify(model, scale, routes=routes, starts=starts)


def shift(vehicle, place, time):
    def case(scale, share):
        shifts = scale * np.array([[0.0, 99.0], [0.0, 99.0]])
        limit = (above if place else below)(time, share, scale, vehicle=vehicle)
        shifts[vehicle, place] = limit
        return verify(fleet(scale, shifts=shifts), scale)

    return case


def duration(scale, share):
    return verify(fleet(scale, max_duration=[99 * scale, above(9.0, share, scale)]), scale)


def hurried(vehicle, place):
    """A service or return begins earlier than travel and service allow, at `ready`."""

    def case(scale, share):
        exact = [[1.0, 4.0, 9.0, 15.0], [2.0, 6.0, 11.0]]
        ready = exact[vehicle][place]
        exact[vehicle][place] = below(ready, -share, 1.0, vehicle=vehicle)
        return verify(fleet(scale), scale, starts=exact)

    return case


def open_end(scale, share):
    """An open route ends with its last service."""
    end = 10.0 - share * (TOLERANCE * 9.0 + 10e-12)
    starts = [[1.0, 4.0, 9.0, end], [2.0, 6.0, 11.0]]
    return verify(fleet(scale, ends=[-1, 0]), scale, starts=starts)


def load(capacity, **fields):
    def case(scale, share):
        limits = scale * np.array([capacity / (1 + share * TOLERANCE), 50.0])
        given = {
            name: scale * np.array(value, float)
            for name, value in fields.items()
            if name != "pairs"
        }
        pair = {"pairs": fields["pairs"]} if "pairs" in fields else {}
        return verify(fleet(scale, capacity=limits, **given, **pair), scale)

    return case


def dimension(scale, share):
    limits = [[9.0, 2.0 / (1 + share * TOLERANCE)], [9.0, 9.0]]
    return verify(fleet(scale, demands=[[9, 9], [1, 2], [1, 0], [1, 1]], capacity=limits), scale)


def stations(scale, share):
    """Node 2 renews the battery: 7 m before it, and 5 m after it."""
    model = FleetRouting(
        2, points=scale * np.vstack([POINTS, [0.0, 0.0]]), stations=[2], objective="sum",
        battery=scale * np.array([7.0 / (1 + share * TOLERANCE), 99.0]),
    )  # fmt: skip
    return model.verify(FleetPlan([[1, 2], [3, 4]]), tolerance=TOLERANCE)


LIMITS = {
    "service within a window": [late(1, 4.0), late(2, 9.0), late(3, 6.0), early(1, 4.0), early(2, 9.0),
                                early(3, 6.0)],
    "travel and service take their time": [hurried(0, 2), hurried(0, 3), hurried(1, 1), hurried(1, 2),
                                           open_end],
    "trip departs after releases": [released(2, 1.0), released(3, 2.0), reloaded],
    "route within shift": [shift(0, 0, 1.0), shift(1, 0, 2.0), shift(0, 1, 15.0), shift(1, 1, 11.0)],
    "duration within limit": [duration],
    "load within capacity": [
        load(3.0, demands=[9, 1, 2, 5]),
        load(3.0, pickups=[9, 1, 2, 5]),
        # Delivered 1 and 2, picked up 4 at the first: 3, 6, then 4.
        load(6.0, demands=[0, 1, 2, 5], pickups=[0, 4, 0, 5]),
        # The demand of a pair does not count, nor the pickup of its second node.
        load(4.0, demands=[0, 9, 9, 5], pickups=[0, 4, 9, 5], pairs=[[1, 2]]),
        dimension,
    ],
    "route within battery": [stations],
}  # fmt: skip


@pytest.mark.parametrize(
    ("starts", "fields", "name"),
    [
        ([[0.0, 500.0, 503.0], [0.0, 5.0, 1e15]], {"windows": [None, (0, 10), None, None]}, "service within"),
        ([[1e15] * 3, [1e15] * 3], {"time_cost": 1.0, "objective": "cost"}, "travel and service"),
        ([[1e9] * 2 + [2e9], [1e9] * 2 + [2e9]], {}, "travel and service"),
    ],
)  # fmt: skip
def test_late_times_and_waiting_loosen_no_check(starts, fields, name):
    """A plan must not buy tolerance with a return in the distant future."""
    model = FleetRouting(
        2, points=POINTS, **{"service": [0, 1, 0, 1], "objective": "sum", **fields}, groups=[[1, 2]]
    )
    verified = model.verify(FleetPlan([[1], [3]], starts))
    assert [check.name for check in verified.violated if check.name.startswith(name)]


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize(("name", "case"), pairs(LIMITS))
def test_a_limit_is_kept_within_its_tolerance(name, case, scale):
    assert_limit(name, lambda share: case(scale, share))


def with_loads(**fields):
    return fleet(pickups=[0, 0, 1, 1], demands=[0, 1, 0, 0], capacity=9, **fields)


#: A model, routes that keep its rule, and routes that break it with the place that the check must name.
FAULTS = {
    "one route for each vehicle": [(fleet(), ROUTES, [[1, 2, 3]], "")],
    "each node visited once": [
        (fleet(), ROUTES, [[1, 2], []], "node 3"),
        (fleet(), ROUTES, [[1, 2], [3, 2]], "node 2"),
        (fleet(), ROUTES, [[1, 2, 0], [3]], "node 0"),
        (fleet(reloads=[0]), [[1, 0, 2], [3, 0]], [[1, 0], [3]], "node 2"),
        (fleet(objective="cost", prizes=[None, None, 1, 0]), [[1], []], [[2], [3]], "node 1"),
    ],
    "every vehicle used": [(fleet(use_all=True), ROUTES, [[1, 2, 3], []], "vehicle 1")],
    "one node of each group": [
        (fleet(groups=[[2, 3]]), [[1, 2], []], [[1, 2], [3]], "group 0"),
        (fleet(groups=[[2, 3]]), [[1, 3], []], [[1], []], "group 0"),
        (fleet(groups=[[2, 3]], objective="cost", prizes=[None, None, 1, 2]), [[1], []], ROUTES, "group 0"),
    ],
    "pickup before its delivery": [
        (with_loads(pairs=[[3, 1]]), [[3, 1], [2]], [[1, 3], [2]], "pair 3 to 1"),
        (with_loads(pairs=[[3, 1]]), [[3, 2, 1], []], [[1, 2], [3]], "pair 3 to 1"),
        (with_loads(pairs=[[3, 1]], reloads=[0]), [[2, 0, 3, 1], []], [[3, 0, 1], [2]], "pair 3 to 1"),
    ],
    "deliveries before backhauls": [
        (with_loads(backhauls=True), [[1, 2, 3], []], [[2, 1, 3], []], "vehicle 0, node 2"),
        (with_loads(backhauls=True), [[1, 3, 2], []], [[1, 2], [3]], "vehicle 1, node 3"),
        (with_loads(backhauls=True, reloads=[0]), [[1, 2, 3, 0], []], [[1, 2, 0, 3], []], "vehicle 0, node 3"),
        (with_loads(backhauls=True, stations=[0], battery=99), [[1, 2, 0, 3], []], [[0, 2, 1, 3], []],
         "vehicle 0, node 2"),
    ],
    "skills of the vehicle": [
        (fleet(requires=[[], ["a"], [], ["a", "b"]], skills=[["b", "a"], []]), [[1, 3], [2]],
         [[3], [1, 2]], "vehicle 1, node 1"),
        (fleet(requires=[[], ["a"], [], ["a", "b"]], skills=[["b", "a"], ["a"]]), [[3], [1, 2]], ROUTES,
         "vehicle 1, node 3"),
    ],
    "reloads within limit": [
        (fleet(reloads=[0], max_reloads=[1, 0]), [[1, 0, 2], [3]], [[1, 2], [3, 0]], "vehicle 1"),
        (fleet(reloads=[0], max_reloads=[1, 0]), [[0, 1, 2], [3]], [[0, 1, 0, 2], [3]], "vehicle 0"),
    ],
}  # fmt: skip


@pytest.mark.parametrize(("name", "fault"), pairs(FAULTS))
def test_one_fault_is_named(name, fault):
    model, routes, wrong, where = fault
    assert model.verify(model.with_schedule(routes)).ok
    found = model.verify(model.with_schedule(wrong))
    assert_only(name, found)
    assert found.violated[0].where == where
    assert found.violated[0].worst == 1.0


@pytest.mark.parametrize("starts", [None, [], STARTS[:1], [*STARTS, []], [STARTS[0], [2.0, 6.0]]])
def test_missing_times_are_named(starts):
    found = fleet().verify(FleetPlan(ROUTES, starts))
    assert_only("times of each route", found)


def test_costs_and_makespan_of_the_plan():
    plan = plan_of()
    model = fleet(objective="cost", fixed_cost=[10, 20], distance_cost=[2, 3], time_cost=[5, 7])
    assert model.verify(plan).objective == 10 + 2 * 12 + 5 * 14 + 20 + 3 * 8 + 7 * 9
    prized = fleet(objective="cost", prizes=[None, 4, 0, 2])
    assert prized.verify(plan).objective == 20 - 6
    assert prized.verify(prized.with_schedule([[1], []])).objective == 6 - 4
    assert fleet(objective="makespan").verify(plan).objective == 15
    units = [fleet(objective=name).objective_unit for name in ("sum", "cost", "makespan")]
    assert units == ["m", "", "s"]


def test_every_check_is_tested():
    complete = fleet(
        windows=[None] * 4, releases=[0] * 4, max_duration=99, reloads=[0], max_reloads=9, groups=[[3]],
        requires=[[]] * 4, skills=[[]] * 2, pickups=[0] * 4, capacity=9, pairs=[[1, 2]], backhauls=True,
        battery=99, use_all=True,
    )  # fmt: skip
    tested = {*LIMITS, *FAULTS, "times of each route"}
    verified = complete.verify(plan_of())
    assert names_of(verified) == tested
    # The others are in test_check_limits.py.
    plain = names_of(FleetRouting(2, points=POINTS, battery=99).verify(FleetPlan(ROUTES)))
    own = SimpleNamespace(checks=[check for check in verified.checks if check.name not in plain])
    assert_complete(tested - plain, [own], rich_checks)


def test_the_timeline_shows_travel_waiting_services_and_windows():
    model = fleet(windows=[None, (3, 5), (0, 8), None])
    figure = ct.plot(model, plan_of())
    assert len(figure.axes) == 3
    axes = ct.plot(model, plan_of(), parts=["timeline"]).axes[0]
    bars = {item.get_gid(): len(item.get_paths()) for item in axes.collections}
    assert bars == {"window": 2, "service": 3, "travel": 5, "wait": 0}
    assert [line.get_xdata().tolist() for line in axes.lines if line.get_gid() == "late"] == [[9.0]]
    waiting = plan_of(starts=[[0.0, 4.0, 9.0, 15.0], STARTS[1]])
    axes = ct.plot(model, waiting, parts=["timeline"]).axes[0]
    box = next(item for item in axes.collections if item.get_gid() == "wait").get_paths()[0]
    assert box.get_extents().intervalx.tolist() == [3.0, 4.0]
    with pytest.raises(UnsupportedOption, match="'timeline' only with a plan that has times"):
        ct.plot(model, FleetPlan(ROUTES), parts=["timeline"])


def test_exports_contain_reloads_open_ends_and_times(tmp_path):
    model = fleet(objective="cost", reloads=[0], ends=[-1, 0], fixed_cost=5)
    plan = model.with_schedule([[1, 0, 2], [3]])
    rows = write_routes_csv(plan, tmp_path / "a.csv", model=model).read_text().splitlines()
    assert rows[0] == "vehicle,stop,node,x,y,arrival,time"
    assert [row.split(",")[2] for row in rows[1:]] == ["0", "1", "0", "2", "0", "3", "0"]
    assert float(rows[4].split(",")[-1]) == plan.starts[0][3]
    lines = write_vrplib(plan, tmp_path / "a.sol", model=model).read_text().splitlines()
    assert lines == ["Route #1: 1 0 2", "Route #2: 3", f"Cost {model.verify(plan).objective!r}"]
    timed = fleet(objective="cost", time_cost=1.0)
    with pytest.raises(InvalidData, match="starts must be given, as the cost depends on times"):
        write_vrplib(FleetPlan(ROUTES), tmp_path / "c.sol", model=timed)
    charged = FleetRouting(2, points=POINTS, stations=[2], battery=99)
    with pytest.raises(UnsupportedFormulation, match="have no stations"):
        write_vrplib(FleetPlan([[1, 2], [3]]), tmp_path / "c.sol", model=charged)
    with pytest.raises(InvalidData, match="starts must be the times of each route"):
        write_routes_csv(FleetPlan(ROUTES, STARTS[:1]), tmp_path / "b.csv", model=model)
