"""Invalid files and calls: instances and plans damaged at random, by a seed.

Every case follows from its number alone, so that one that fails can be made again.
"""

from __future__ import annotations

import json
import random
import re
from functools import cache
from typing import Any

import numpy as np

Tree = Any


class Raw:
    """Text inserted into JSON unchanged, for content that Python's encoder does not write."""

    def __init__(self, text: str) -> None:
        self.text = text


#: Put in the place of any part of a file.
VALUES: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 2, 3, 7, 0.5, -0.0, 1e-300, 5e-324, 1e150, 1e308, -1.7e308, 2**31, 2**53, 2**63,
    2**64, -(2**63) - 1, 10**30, 10**400, -(10**400), "", "0", "1.5", "nan", "\ud800", "a\udfff", "\0", "é" * 3, "x" * 50_000,
    [], {}, [[]], [[], []], [None], [1], [1, 2, 3], [[1, 2], [3]], [True, 1], [1, "a"], [1, None], [10**400], [0.5, 10**30],
    {"a": 1}, {"": None}, {"0": 0}, {"shape": [1, 1]}, {"kind": "x"}, {"size": -1, "start": 0},
    Raw("1e400"), Raw("-1e400"), Raw("9" * 5000), Raw("-" + "9" * 5000), Raw("1" + "0" * 350), Raw("NaN"), Raw("Infinity"),
    Raw("-Infinity"), Raw("[" * 200 + "]" * 200), Raw("[" * 30_000 + "]" * 30_000), Raw('{"a":' * 300 + "1" + "}" * 300),
    Raw('{"a": 1, "a": 2}'), Raw("[1e400]"), Raw("[1e308, -1e308]"), Raw("01"), Raw("'a'"), Raw("0x10"), Raw("1_000"),
)  # fmt: skip


def written(tree: Tree) -> str:
    """Return `tree` as JSON text, :class:`Raw` parts as they stand."""
    raw: list[str] = []

    def plain(value: Any) -> str:
        raw.append(value.text)
        return f"@raw{len(raw) - 1}@"

    # Numbers beyond what Python turns into text are written by way of Raw only.
    text = json.dumps(tree, default=plain)
    return re.sub('"@raw([0-9]+)@"', lambda found: raw[int(found[1])], text)


def places(tree: Tree, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the path of every part of `tree`, its own first."""
    found = [at]
    if isinstance(tree, dict):
        for key, value in tree.items():
            found += places(value, (*at, key))
    elif isinstance(tree, list):
        # Of a long list, both ends and the middle: else its entries would be all that is ever hit.
        chosen = {*range(min(len(tree), 3)), len(tree) // 2, len(tree) - 1} if tree else ()
        for key in sorted(chosen):
            found += places(tree[key], (*at, key))
    return found


def mutated(tree: Tree, draw: random.Random) -> Tree:
    """Return `tree` with one part changed in a way that is drawn."""
    tree = json.loads(json.dumps(tree))
    everywhere = places(tree)
    at = draw.choice(everywhere[1:] or everywhere)
    if not at:
        return draw.choice(VALUES)
    holder = tree
    for key in at[:-1]:
        holder = holder[key]
    key, value = at[-1], holder[at[-1]]
    ways = ["replace"] * 4 + ["drop", "wrap", "twice"]
    if isinstance(value, list):
        ways += ["shorter", "longer", "shuffle", "every", "empty"] * 2
    elif isinstance(value, dict):
        ways += ["more", "rename", "less"]
    elif isinstance(value, int | float) and not isinstance(value, bool):
        ways += ["scale", "negate", "shift", "word"]
    way = draw.choice(ways)
    if way == "replace":
        holder[key] = draw.choice(VALUES)
    elif way == "drop":
        del holder[key]
    elif way == "wrap":
        holder[key] = draw.choice([[value], {"0": value}, [[value]]])
    elif way == "twice":
        if isinstance(holder, list):
            holder.insert(key, value)
        else:
            holder[draw.choice([key + "2", key.upper(), "\ud800", "x" * 10_000, ""])] = value
    elif way == "shorter":
        holder[key] = value[: draw.randrange(len(value) + 1)]
    elif way == "longer":
        holder[key] = value + draw.choice([value, [0], [None], [-1], [[0]]])
    elif way == "shuffle":
        draw.shuffle(value)
    elif way == "every":
        holder[key] = [draw.choice(VALUES)] * len(value)
    elif way == "empty":
        holder[key] = draw.choice([[], [[]], {}])
    elif way == "more":
        value[draw.choice(["x", "", "name", "\ud800"])] = draw.choice(VALUES)
    elif way in ("rename", "less"):
        if value:
            name = draw.choice(list(value))
            taken = value.pop(name)
            if way == "rename":
                value[name[::-1] + "_"] = taken
    elif way == "scale":
        big = abs(value) > 1e150
        holder[key] = 0 if big else draw.choice([value * 10**9, value * 1e150, value + 0.5])
    elif way == "negate":
        holder[key] = -value
    elif way == "shift":
        holder[key] = value + draw.choice([-1, 1, 1000, 10**6])
    else:
        holder[key] = str(value)
    return tree


def damaged(text: bytes, draw: random.Random) -> bytes:
    """Return the bytes of a file with something done to them that no encoder does."""
    at = draw.randrange(max(1, len(text)))
    other = draw.randrange(max(1, len(text)))
    low, high = min(at, other), max(at, other)
    ways = (
        lambda: text[:at],
        lambda: text[at:],
        lambda: text[:low] + text[high:],
        lambda: text[:high] + text[low:],
        lambda: b"\xef\xbb\xbf" + text,
        lambda: text.replace(b",", b",\r\n"),
        lambda: text[:at] + bytes([draw.randrange(256)]) + text[at + 1 :],
        lambda: text[:at] + draw.choice([b"\xff", b"\0", b"\xed\xa0\x80", b'"', b"[", b"{", b"}", b"\\"]) + text[at:],
        lambda: text.decode().encode("utf-16"),
        lambda: re.sub(rb"[0-9.]+", lambda m: m[0] if draw.random() < 0.9 else b"1e400", text),
        lambda: re.sub(rb"[0-9.]+", lambda m: m[0] if draw.random() < 0.8 else draw.choice([b"1e200", b"-1", b"0", b"null", b"99999999"]), text),
        lambda: draw.choice([b"", b" ", b"null", b"1", b'"a"', b"[]", b"{}", b"\xff\xfe", b"NaN", b"[" * 100_000]),
    )  # fmt: skip
    return draw.choice(ways)()


# -- what is damaged ------------------------------------------------------------------------------


@cache
def examples() -> tuple[tuple[str, str], ...]:
    """Return small instances of every kind with a plan each, as JSON texts."""
    return tuple(
        (model.to_json(), json.dumps(model.plan_to_data(plan))) for model, plan in _examples()
    )


def _examples() -> list[tuple[Any, Any]]:
    import casadi
    from carts import braking, cruising, relay, relayed

    from crosstrack.models import (
        AttractorAnalysis,
        BlackBoxMinimisation,
        ConeBlock,
        ConeKind,
        ConicProgram,
        ControlPlan,
        ErrorCorrectionRouting,
        FleetMission,
        FleetRouting,
        Flight,
        FlightPlan,
        GridPath,
        GuidedPathTour,
        MessengerTour,
        MinimumDerivative,
        MinimumSnap,
        NonlinearProgram,
        PhasePlan,
        PointMass,
        ProgramBuilder,
        QuadraticProgram,
        Route,
        SatelliteSlew,
        SequentialOrdering,
        SequentialOrderingPlan,
        SideslipEstimation,
        TimeAllocation,
        Trajectory,
    )  # fmt: skip
    from crosstrack.models.attractor import AttractorEstimate, Slope, SurrogateTest
    from crosstrack.models.attractor.checks import Sample
    from crosstrack.models.black_box import BlackBoxPoint
    from crosstrack.models.fleet import FleetPlan
    from crosstrack.models.fleet_mission import MissionPlan
    from crosstrack.models.grid_path import GridPlan
    from crosstrack.models.guided_path import GuidedPathPlan
    from crosstrack.models.messenger import Primitive, TourPlan
    from crosstrack.models.optimal_control.plan import Piecewise
    from crosstrack.models.resource_routing import Resource, ResourceRouting
    from crosstrack.models.sideslip import Recording, SideslipEstimate
    from crosstrack.models.unknown_grid import NavigationRuns, UnknownGridNavigation

    points = [[0, 0, 0], [1.0, 0, 0], [1.5, 0, 0], [9, 9, 9], [3.5, 0, 0]]
    kinds = ["A", "horizontal", "vertical", "horizontal", "B"]
    routing = ErrorCorrectionRouting(points, kinds, 0.3, 0.3, 0.3, 0.3, 0.3, delta=0.1)
    named = ErrorCorrectionRouting(
        points, kinds, 0.3, 0.3, 0.3, 0.3, 0.3, 0.1, 0.2, True, ids=("a", 1, "c", "d", "e"), name="named",
    )  # fmt: skip

    fuel = Resource("fuel", 1.0, 0.5, {"town": 9, "end": 9}, {"town": 0.5}, {"town": 1}, "l")
    charged = ResourceRouting(
        ["start", "town", "end", "town"], [fuel, Resource("time")], 0, 2, [[0.0, 0], [1, 2], [3, 2], [2, 2]],
        [[0, 1], [1, 3], [3, 2], [0, 2]], [2.5, 1, 1, 9], [[0.0, 1], [0.5, 1], [0, 1], [0, 2]], True,
        ("a", 1, "b", "c"), name="drive",
    )  # fmt: skip

    through = [[0.0, 0.0], [1.0, 2.0], [3.0, 2.0]]
    path = Trajectory([0.0, 1.0, 3.0], np.arange(32.0).reshape(2, 8, 2) % 3)
    full = {
        "derivatives": [[[None, None]], [[0.5, None]], [[None, None]]],
        "corridor_lower": -9.0, "corridor_upper": [[9.0, 9.0], [9.0, 9.0]], "velocity_limit": [8.0, 9.0],
        "acceleration_limit": 50.0, "jerk_limit": [[80.0], [90.0]], "polytope_segments": [0, 1],
        "polytope_normals": [[1.0, 0.0], [0.0, 1.0]], "polytope_offsets": [5.0, 5.0], "degree": 9, "continuity": 3,
    }  # fmt: skip

    builder = ProgramBuilder()
    x = builder.columns(
        "x",
        2,
        upper=[4.0, np.inf],
        cost=[1.0, 2.0],
        integral=True,
        template="item {0}",
        index=[0, 1],
    )
    y = builder.columns("y", 1, lower=-np.inf, cost=1.0)
    builder.rows(
        "cover", 2, ([0, 1], x, 1.0), ([0, 1], y, [1.0, 2.0]), lower=1.5, equation="3", unit="m"
    )
    builder.rows("cap", 1, (0, x, 1.0), upper=9.0)
    mixed = builder.build(name="mixed")
    hessian = [[2.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 1.0]]
    rows = {
        "cost": [1.0, -1.0, 0.0], "matrix": [[1.0, 1.0, 0.0], [0.0, 1.0, -1.0]], "row_lower": [1.0, -np.inf],
        "row_upper": [1.0, 5.0], "column_lower": [-np.inf, 0.0, 0.0], "column_upper": [9.0, 9.0, np.inf],
    }  # fmt: skip
    quadratic = QuadraticProgram(hessian=hessian, **rows, offset=1.0, columns=mixed.columns)
    conic = ConicProgram(
        **rows, hessian=hessian,
        cone_matrix=np.vstack([np.eye(3), np.eye(3), np.eye(3)]), cone_offset=np.arange(9.0),
        cones=(
            ConeBlock("soc", "4", 0, 3, kind=ConeKind.SECOND_ORDER),
            ConeBlock("exp", "", 3, 3, kind=ConeKind.EXPONENTIAL),
            ConeBlock("psd", "", 6, 3, "pair {0}", np.array([[0]]), kind=ConeKind.SEMIDEFINITE),
        ),
    )  # fmt: skip
    v = casadi.MX.sym("x", 2)
    rosenbrock = casadi.Function(
        "rosenbrock", [v], [(1 - v[0]) ** 2 + 100 * (v[1] - v[0] ** 2) ** 2, casadi.vertcat(v[0] * v[1])],
        ["x"], ["f", "g"],
    )  # fmt: skip
    nonlinear = NonlinearProgram(
        rosenbrock, [0.5], [np.inf], [-np.inf, -2.0], [2.0, 2.0], [0.5, 1.0], [1.0, 2.0], [3.0], 10.0,
    )  # fmt: skip

    slew = SatelliteSlew.about("roll", 45.0, margin=0.1)
    still = np.concatenate([slew.initial_attitude, np.zeros(7)])
    nodes, knots = (np.array([-1.0, 0.0, 1.0]),), np.array([0.0, 20.0])
    resting = ControlPlan(
        (
            PhasePlan(
                "slew",
                Piecewise(knots, nodes, (np.tile(still, (3, 1)),)),
                Piecewise(knots, nodes, (np.zeros((3, 4)),), [-1.0] * 4, [1.0] * 4),
                tuple(_slew_names("states")), tuple(_slew_names("controls")),
            ),
        )
    )  # fmt: skip
    tour = MessengerTour([[0, 30], [9, 60]], [[0, 0], [1, -2]], ids=("a", 1))
    flown = TourPlan(
        (0, 1), [2.5, 5.0], [[0.0, 25.0], [8.0, 48.0]], tour.start,
        (Primitive(0, "S", 25.0, np.pi / 2), Primitive(1, "R", 2.0, np.pi / 2), Primitive(1, "S", 23.0, 1.17)),
    )  # fmt: skip
    grid = {"blocked": ["...", ".@.", "..."], "cell": 2.0, "origin": [1.0, -1.0]}
    walk = GridPath(grid, (0, 0), [[2, 2], [0, 2]], weights=[[1.0, 2.0, 3.0]] * 3)
    walked = GridPlan(([[2, 0], [4, 0], [6, 0]],))
    fleet = FleetRouting(
        2, points=[[2, 0], [4, 0], [6, 4], [2, 4]], map=grid, objective="sum-deviation", q=0.5,
        demands=[0.0, 1.0, 1.0, 2.0], capacity=3.0, battery=[40.0, 50.0], ids=("a", 1, "c", 2),
    )  # fmt: skip
    mission = FleetMission(
        obstacles=[[[4, 4], [6, 4], [6, 6], [4, 6]]], bounds=(0, 0, 10, 10), nodes=[[8, 2]], depot=(1, 1),
        vehicles=1, cell=0.5, radius=0.25,
    )  # fmt: skip
    # From rest to rest, there and back.
    smooth = np.array([0.0, 0, 0, 0, 35, -84, 70, -20])[:, None] * np.array([7.0, 1.0])
    there, back = smooth.copy(), -smooth
    there[0], back[0] = (1.0, 1.0), (8.0, 2.0)
    driven = MissionPlan([[0]], [Trajectory([0.0, 20.0, 40.0], [there, back])], [[20.0]])
    around = Flight(
        [[[4, 4], [6, 4], [6, 6], [4, 6]]], (1, 1), (8, 2), PointMass(1.0, 1.0), radius=0.25, cell=0.5,
    )  # fmt: skip
    direct = FlightPlan(Trajectory([0.0, 20.0], [there]), path=[[1.0, 1.0], [8.0, 2.0]])
    guided = GuidedPathTour(
        [0, 3, -1, 2.5, 3], chains=[[1, 2]], precedence=[[1, 3], [4, 3]], ids=("a", 1, "c", 2, 3)
    )
    setups = [[0, 4, 6, None], [0, 0, 3, 9], [0, 8, 0, 2], [0, 0, 0, 0]]
    jobs = SequentialOrdering(setups, precedence=[[1, 2]], ids=("a", 1, "c", 2))
    box = BlackBoxMinimisation(
        {"name": "rastrigin", "shift": [1.0, -1.0], "deviation": 0.1}, [[-5, 5], [2, 2]], budget=50
    )
    instants = 0.1 * np.arange(12.0)
    signals = {
        "steering": 0.02 * instants,
        "yaw_rate": 0.1 * instants,
        "lateral_acceleration": instants,
    }
    drive = Recording(instants, 10.0 + instants, **signals)
    car = {
        "mass": 1500.0, "yaw_inertia": 2500.0, "front": 1.2, "rear": 1.5, "cornering_front": 8e4,
        "cornering_rear": 9e4, "friction": 0.8, "tyre": "saturating",
    }  # fmt: skip
    known = Recording(instants, 10.0 + instants, **signals, sideslip=-0.01 * instants)
    sliding = SideslipEstimation(car, drive, [known], truth=-0.01 * instants)
    angles = SideslipEstimate(-0.009 * instants, np.full(12, 0.01))
    waves = np.sin(np.arange(60.0)) + np.sin(1.7 * np.arange(60.0))
    motion = AttractorAnalysis(
        waves, 0.5, "m", true_exponent=0.0, true_dimension=2.0, chaotic=False
    )
    region = {"method": "rosenstein", "deviation": 9.0, "low": 0, "high": 4}
    fitted = Sample(motion.states(2, 3), 1, 0).slope(Slope(value=0.0, **region), 0.5)[0]
    estimate = AttractorEstimate(
        2, 3, 1, Slope(value=fitted, **region), surrogates=SurrogateTest("noise", 39, 20)
    )
    unknown = UnknownGridNavigation.drawn(
        "S..@\n.@..\n...T", "S.@.\n..@.\n..@T", view=(3, 3), steps=9, camera={"rendering": "hard"}
    )
    steps = NavigationRuns(("DDRRR", "D"), ("reached", "no way"))
    vector = np.array([2.0, 0.0, 1.0])
    return [
        (routing, Route((0, 1, 2, 4))), (named, Route((0, 1, 2, 4))),
        (MinimumSnap(through, [0.0, 1.0, 3.0]), path),
        (MinimumSnap(through, [0.0, 1.0, 3.0], **full), path),
        (MinimumDerivative(through, [0.0, 1.0, 3.0], order=3, weights=[1.0, 0.0, 2.0]), path),
        (TimeAllocation(through, time_weight=100.0), path),
        (TimeAllocation(through, total_time=5.0, order=3, velocity_limit=3.0), path),
        (mixed, vector), (quadratic, vector), (conic, vector), (nonlinear, np.array([1.0, 1.0])),
        (braking(bound=9.0, mixed_path={"upper": 9.0}).build(), cruising(costates=True)), (relay().build(), relayed()),
        (slew, resting), (tour, flown), (walk, walked), (fleet, FleetPlan(((1, 2), (3,)))),
        (mission, driven), (around, direct), (guided, GuidedPathPlan((4, 1, 2, 3))), (box, BlackBoxPoint((1.0, 2.0))),
        (sliding, angles), (motion, estimate), (unknown, steps), (charged, Route((0, 1, 3, 2))),
        (jobs, SequentialOrderingPlan((0, 1, 2, 3))),
    ]  # fmt: skip


def _slew_names(what: str) -> list[str]:
    from crosstrack.models import SatelliteSlew

    phase = SatelliteSlew.about("roll", 45.0).lower().definition.phases[0]
    return list(phase.state_names if what == "states" else phase.control_names)


def strange_file(number: int) -> tuple[bytes, bytes]:
    """Return the bytes of an instance and of a plan for it, one of them damaged or both."""
    draw = random.Random(f"file {number}")
    known = examples()
    instance, plan = known[number % len(known)]
    which = draw.random()
    return _strange(instance, draw, which < 0.75), _strange(plan, draw, which > 0.65)


def _strange(text: str, draw: random.Random, damage: bool) -> bytes:
    if not damage:
        return text.encode()
    if draw.random() < 0.25:
        return damaged(text.encode(), draw)
    tree = json.loads(text)
    for _ in range(draw.choice([1, 1, 1, 2, 3])):
        tree = mutated(tree, draw) if not isinstance(tree, Raw) and not _holds_raw(tree) else tree
    return written(tree).encode("utf-8", "surrogatepass")


def _holds_raw(tree: Tree) -> bool:
    if isinstance(tree, dict):
        return any(map(_holds_raw, tree.values()))
    if isinstance(tree, list):
        return any(map(_holds_raw, tree))
    return isinstance(tree, Raw)
