"""Limits of the checks of a tour: 1.1 times the accepted violation fails, 0.9 times passes."""

import cmath
import math
from dataclasses import replace

import numpy as np
import pytest
from check_limits import SCALES, assert_allowed, assert_count, names_of

from crosstrack.models import MessengerTour, Primitive, TourPlan

DIGITS = 1e-13
#: Turning radius and speed, with the turning radius as unit of length.
TURN, SPEED = 0.1, 10.0
#: Start, heading and tolerance. The tolerance is as small as the rounding error far from the
#: origin.
NEAR, FAR = (1 + 2j, 0.7, 1e-6), (-400 - 300j, -40.0, 1e-10)
QUARTER = 0.5 * math.pi
#: A rectangle with round corners: leg, turn, and the length of a line or the angle of a turn.
LOOP = [(0, "S", 12.0), (1, "L", QUARTER), (1, "S", 5.0), (2, "L", QUARTER),
        (2, "S", 12.0), (2, "L", QUARTER), (2, "S", 5.0), (2, "L", QUARTER)]  # fmt: skip
#: Radii of the vehicles. The second vehicle is met first.
RADII = np.array([0.25, 0.5])
LEAST = float(RADII.min())

LIMITS = [
    "lengths at least 0",
    "headings without a jump",
    "starts at its place",
    "starts with its heading",
    "length flown is speed times time",
    "encounter at its point",
    "encounter within radius",
    "encounter within its window",
    "ends where it begins",
]
COUNTS = ["each vehicle met once", "legs in order", "straight but for turns on the spot"]


def course(pieces, unit, start, heading):
    """Return the primitives of a path, and the place and the length flown after each."""
    place, total, primitives, places = start * unit, 0.0, [], []
    for leg, turn, amount in pieces:
        length = amount * unit * (1.0 if turn == "S" else TURN)
        primitives.append(Primitive(leg, turn, length, heading))
        if turn == "S":
            place += length * cmath.exp(1j * heading)
        else:
            place += 1j * TURN * unit * cmath.exp(1j * heading) * (1.0 - cmath.exp(1j * amount))
            heading += amount
        total += length
        places.append((place.real, place.imag, total))
    return tuple(primitives), np.array(places)


def flight(pieces, unit, start=NEAR[0], heading=NEAR[1]):
    """Return the tour of a path, integrated in the complex plane."""
    primitives, places = course(pieces, unit, start, heading)
    met = [max(k for k, piece in enumerate(pieces) if piece[0] == leg) for leg in (0, 1)]
    times = places[met, 2] / (SPEED * unit)
    begin = [start.real * unit, start.imag * unit, heading]
    return TourPlan((1, 0), times, places[met, :2], begin, primitives)


def digits_of(pieces, unit, start, heading):
    """Return the rounding error of the path after each piece."""
    _, places = course(pieces, unit, start, heading)
    far = np.maximum.accumulate(np.abs(places[:, :2]).max(axis=1))
    first = unit * max(abs(start.real), abs(start.imag))
    return DIGITS * (np.maximum(far, first) + places[:, 2])


def model_for(plan, unit, off=0.4, **how):
    """Return the model whose vehicles are `off` radii away at their encounters; the second one moves."""
    velocities = np.array([[0.0, 0.0], [-0.6, 0.8]]) * unit
    positions = plan.points[::-1] + (off * RADII * unit)[:, None] * [0.8, -0.6]
    positions[1] -= velocities[1] * plan.times[0]
    given = {"start": plan.start, "turning_radius": TURN * unit, "radius": RADII * unit, **how}
    return MessengerTour(positions, velocities, speed=SPEED * unit, **given)


def moved(values, row, by):
    values = values.copy()
    values[row] += by
    return values


def window(vehicle, side, time):
    """Return windows with one limit: the earliest (0) or latest (1) time of a vehicle."""
    windows = np.tile([0.0, math.inf], (2, 1))
    windows[vehicle, side] = time
    return windows


def altered(plan, number, **what):
    pieces = list(plan.primitives)
    pieces[number] = pieces[number]._replace(**what)
    return replace(plan, primitives=tuple(pieces))


def followed(plan, *pieces):
    return replace(plan, primitives=(*plan.primitives, *pieces))


def limits(unit, start, heading, tolerance):
    """Yield the name of each check, its largest accepted violation, its place, and a case.

    The case returns model and plan for a share of that violation.
    """
    plan = flight(LOOP[:3], unit, start, heading)
    model = model_for(plan, unit)
    digits = digits_of(LOOP[:3], unit, start, heading)
    for row, vehicle in enumerate(plan.order):
        where = f"vehicle {vehicle}"
        own = digits[2 * row] + DIGITS * np.abs(model.positions[vehicle]).max()
        allowed = tolerance * RADII[vehicle] * unit + own
        yield "encounter at its point", allowed, where, lambda x, row=row, allowed=allowed: (
            model, replace(plan, points=moved(plan.points, row, [-0.6 * x * allowed, 0.8 * x * allowed]))
        )  # fmt: skip
        yield "length flown is speed times time", allowed, where, lambda x, row=row, allowed=allowed: (
            model, replace(plan, times=moved(plan.times, row, -x * allowed / (SPEED * unit)))
        )  # fmt: skip
        share = allowed / (RADII[vehicle] * unit)
        yield "encounter within radius", allowed, where, lambda x, vehicle=vehicle, share=share: (
            model_for(plan, unit, moved(np.ones(2), vehicle, x * share)), plan
        )  # fmt: skip
        for side, sign in ((0, 1), (1, -1)):
            edge = plan.times[row] + sign * np.array([0.0, 1.0]) * allowed / (SPEED * unit)
            yield "encounter within its window", allowed, where, lambda x, vehicle=vehicle, side=side, edge=edge: (
                model_for(plan, unit, windows=window(vehicle, side, edge[0] + x * (edge[1] - edge[0]))), plan
            )  # fmt: skip
    # With a radius of 0, the vehicle's share of the field is the scale.
    box = np.ptp([plan.start[:2], *plan.points], axis=0)
    room = tolerance * math.hypot(*box) / 2 + digits[2] + DIGITS * np.abs(plan.points[1]).max()
    exact = MessengerTour(
        plan.points[::-1], radius=0, speed=SPEED * unit, turning_radius=TURN * unit, start=plan.start
    )  # fmt: skip
    yield "encounter within radius", room, "vehicle 0", lambda x: (
        replace(exact, positions=moved(exact.positions, 0, [x * room, 0.0])), plan
    )  # fmt: skip
    # Only the rounding error of the path excuses a length.
    yield "lengths at least 0", digits[2], "primitive 3", lambda x: (
        model, followed(plan, Primitive(1, "S", -x * digits[2], heading + QUARTER))
    )  # fmt: skip
    least = tolerance * LEAST
    first = least + DIGITS * max(abs(start.real), abs(start.imag))
    yield "starts at its place", first * unit, "start", lambda x: (
        model, flight(LOOP[:3], unit, start + (0.6 - 0.8j) * x * first, heading)
    )  # fmt: skip
    yield "starts with its heading", tolerance, "start", lambda x: (
        model, flight(LOOP[:3], unit, start, heading - x * tolerance)
    )  # fmt: skip
    turn = tolerance + DIGITS * max(abs(heading), abs(heading + QUARTER))
    yield "headings without a jump", turn, "primitive 1", lambda x: (
        model, altered(plan, 1, heading=heading + 2 * math.pi - x * turn)
    )  # fmt: skip
    loop = flight(LOOP, unit, start, heading)
    closed = model_for(loop, unit, closed=True)
    around = tolerance + DIGITS * max(abs(heading), abs(heading + 4 * QUARTER))
    yield "headings without a jump", around, "end", lambda x: (
        closed, flight([*LOOP[:-1], (2, "L", QUARTER + x * around)], unit, start, heading)
    )  # fmt: skip
    gap = least + digits_of(LOOP, 1.0, start, heading)[-1]
    yield "ends where it begins", gap * unit, "end", lambda x: (
        closed, altered(loop, 6, length=(5.0 + x * gap) * unit)
    )  # fmt: skip


def counts(unit):
    """Yield each exact check, with a model and a plan that violates or satisfies it."""
    plan = flight(LOOP[:3], unit)
    model = model_for(plan, unit)
    once = replace(
        plan, order=(0,), times=plan.times[:1], points=plan.points[:1], primitives=plan.primitives[:1]
    )  # fmt: skip
    twice = replace(once, order=(0, 0), times=once.times[[0, 0]], points=once.points[[0, 0]])
    single = MessengerTour(
        plan.points[:1], speed=SPEED * unit, radius=unit, turning_radius=unit, start=plan.start
    )  # fmt: skip
    yield "each vehicle met once", lambda bad: (single, twice if bad else once)
    for leg in (0, 2):
        yield "legs in order", lambda bad, leg=leg: (
            model, followed(plan, Primitive(leg if bad else 1, "S", 0.0, NEAR[1] + QUARTER))
        )  # fmt: skip
    # A UAV that turns on the spot may start with any heading.
    straight = flight([(0, "S", 10.0), (1, "S", 5.0)], unit)
    spot = model_for(straight, unit, turning_radius=0.0, start=[*straight.start[:2], 3.0])
    yield "straight but for turns on the spot", lambda bad: (
        spot, followed(straight, Primitive(1, "L", 1e-12 * unit * bad, NEAR[1]))
    )  # fmt: skip


@pytest.mark.parametrize("unit", SCALES)
@pytest.mark.parametrize("place", [NEAR, FAR], ids=["near", "far"])
@pytest.mark.parametrize("name", LIMITS)
def test_the_limit_of_each_check(name, place, unit):
    cases = [case for case in limits(unit, *place) if case[0] == name]
    assert cases
    for _, allowed, where, case in cases:

        def verify(x, case=case, where=where):
            model, plan = case(x)
            found = model.verify(plan, tolerance=place[2])
            assert all(check.where == where for check in found.violated), str(found)
            return found

        # Far from the origin, positions have fewer digits than headings.
        rough = place is FAR and "heading" not in name
        assert_allowed(name, allowed, verify, rel=1e-2 if rough else 1e-3)


@pytest.mark.parametrize("unit", SCALES)
@pytest.mark.parametrize("name", COUNTS)
def test_the_smallest_violation_of_each_exact_check(name, unit):
    cases = [case for case in counts(unit) if case[0] == name]
    assert cases
    for _, case in cases:
        assert_count(name, lambda bad, case=case: MessengerTour.verify(*case(bad)))


@pytest.mark.parametrize("far", [4e11, 1e14])
def test_digits_excuse_a_tenth_of_the_least_radius(far):
    plan = flight(LOOP[:3], 1.0, far * (1 + 1j))
    found = {check.name: check for check in model_for(plan, 1.0).verify(plan).checks}
    assert found["lengths at least 0"].tolerance == pytest.approx(0.1 * LEAST, abs=0.0)
    assert "not decidable" in found["encounter within radius"].where


@pytest.mark.parametrize("unit", SCALES)
def test_a_path_beyond_the_last_encounter_also_has_a_leg_too_many(unit):
    plan = flight(LOOP[:3], unit)
    allowed = NEAR[2] * LEAST * unit

    def verify(x):
        more = Primitive(2, "S", x * allowed, NEAR[1] + QUARTER)
        return model_for(plan, unit).verify(followed(plan, more))

    assert_allowed("ends at the last encounter", allowed, verify, beside=["legs in order"])


@pytest.mark.parametrize("unit", SCALES)
@pytest.mark.parametrize("shares", [(1.1, 0.9), (0.9, 1.1)])
def test_the_vehicle_nearest_to_its_own_limit_is_reported(shares, unit):
    plan, tolerance = flight(LOOP[:3], unit), 1e-10
    # The rounding error of the second encounter is as large as its tolerance.
    radii = np.array([0.05, 5.0]) * unit
    model = replace(model_for(plan, unit, off=0.0), radius=radii)
    digits = digits_of(LOOP[:3], unit, *NEAR[:2])[[0, 2]]
    digits += DIGITS * np.abs(model.positions[[1, 0]]).max(axis=1)
    allowed = tolerance * radii[[1, 0]] + digits
    times = plan.times + np.array(shares) * allowed / (SPEED * unit)
    (check,) = model.verify(replace(plan, times=times), tolerance=tolerance).violated
    row = int(np.argmax(shares))
    assert check.name == "length flown is speed times time"
    assert check.where == f"vehicle {plan.order[row]}"
    assert check.tolerance == pytest.approx(allowed[row], rel=1e-3, abs=0.0)


def test_every_check_has_its_limit():
    plan, loop = flight(LOOP[:3], 1.0), flight(LOOP, 1.0)
    straight = flight([(0, "S", 10.0), (1, "S", 5.0)], 1.0)
    found = [
        model_for(plan, 1.0).verify(plan),
        model_for(loop, 1.0, closed=True).verify(loop),
        model_for(straight, 1.0, turning_radius=0.0).verify(straight),
        model_for(plan, 1.0, windows=window(0, 1, plan.times[1])).verify(plan),
    ]
    free = model_for(plan, 1.0, start=plan.start[:2]).verify(plan)
    assert free.ok and names_of(found[0]) - names_of(free) == {"starts with its heading"}
    assert all(one.ok for one in found)
    assert names_of(*found) == {*LIMITS, *COUNTS, "ends at the last encounter"}
