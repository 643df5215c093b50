"""Every check of a tour at its limit: 1.1 times what is accepted is refused, 0.9 times is not."""

import cmath
import math
from dataclasses import replace

import numpy as np
import pytest
from limit_cases import SCALES, assert_count, assert_limit, names_of

from crosstrack.models import MessengerTour, Primitive, TourPlan

TOLERANCE, DIGITS = 1e-6, 1e-13
#: Where the path begins, its turning radius and the speed, in the unit of length.
START, HEADING, TURN, SPEED = 1 + 2j, 0.7, 0.1, 10.0
QUARTER = 0.5 * math.pi
#: A rectangle with round corners: leg, turn, and the length of a line or the angle of a turn.
LOOP = [(0, "S", 10.0), (1, "L", QUARTER), (1, "S", 5.0), (2, "L", QUARTER),
        (2, "S", 10.0), (2, "L", QUARTER), (2, "S", 5.0), (2, "L", QUARTER)]  # fmt: skip
#: Radii of the vehicles; the second is met first.
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
    "ends where it begins",
]
COUNTS = ["each vehicle met once", "legs in order", "straight but for turns on the spot"]


def flight(pieces, unit, start=START, heading=HEADING):
    """Return the tour along some pieces, integrated in the complex plane."""
    place, total, primitives, places, lengths = start * unit, 0.0, [], [], []
    for leg, turn, amount in pieces:
        length = amount * unit * (1.0 if turn == "S" else TURN)
        primitives.append(Primitive(leg, turn, length, heading))
        if turn == "S":
            place += length * cmath.exp(1j * heading)
        else:
            place += 1j * TURN * unit * cmath.exp(1j * heading) * (1.0 - cmath.exp(1j * amount))
            heading += amount
        total += length
        places.append(place), lengths.append(total)
    met = [max(k for k, piece in enumerate(pieces) if piece[0] == leg) for leg in (0, 1)]
    points = np.array([[places[k].real, places[k].imag] for k in met])
    times = np.array([lengths[k] for k in met]) / (SPEED * unit)
    begin = [start.real * unit, start.imag * unit, primitives[0].heading]
    return TourPlan((1, 0), times, points, begin, tuple(primitives))


def model_for(plan, unit, off=0.4, **how):
    """Return the model whose vehicles are `off` radii away when `plan` meets them; the second drives."""
    velocities = np.array([[0.0, 0.0], [-0.6, 0.8]]) * unit
    positions = plan.points[::-1] + (off * RADII * unit)[:, None] * [0.8, -0.6]
    positions[1] -= velocities[1] * plan.times[0]
    given = {"start": plan.start, "turning_radius": TURN * unit, "radius": RADII * unit, **how}
    return MessengerTour(positions, velocities, speed=SPEED * unit, **given)


def moved(values, row, by):
    values = values.copy()
    values[row] += by
    return values


def altered(plan, number, **what):
    pieces = list(plan.primitives)
    pieces[number] = pieces[number]._replace(**what)
    return replace(plan, primitives=tuple(pieces))


def followed(plan, *pieces):
    return replace(plan, primitives=(*plan.primitives, *pieces))


def limits(unit):
    """Yield each check with a tolerance, what it accepts, and model and plan for a share of that."""
    plan = flight(LOOP[:3], unit)
    model = model_for(plan, unit)
    for row, vehicle in enumerate(plan.order):
        allowed = TOLERANCE * RADII[vehicle] * unit
        yield "encounter at its point", allowed, lambda x, row=row, allowed=allowed: (
            model, replace(plan, points=moved(plan.points, row, [-0.6 * x * allowed, 0.8 * x * allowed]))
        )  # fmt: skip
        yield "length flown is speed times time", allowed, lambda x, row=row, allowed=allowed: (
            model, replace(plan, times=moved(plan.times, row, -x * allowed / (SPEED * unit)))
        )  # fmt: skip
        yield "encounter within radius", allowed, lambda x, vehicle=vehicle: (
            model_for(plan, unit, moved(np.ones(2), vehicle, x * TOLERANCE)), plan
        )  # fmt: skip
    # Without a radius, the room of a vehicle counts.
    box = np.ptp([plan.start[:2], *plan.points], axis=0)
    room = TOLERANCE * math.hypot(*box) / 2
    exact = MessengerTour(
        plan.points[::-1], radius=0, speed=SPEED * unit, turning_radius=TURN * unit, start=plan.start
    )  # fmt: skip
    yield "encounter within radius", room, lambda x: (
        replace(exact, positions=moved(exact.positions, 0, [x * room, 0.0])), plan
    )  # fmt: skip
    # Only the digits of the path excuse a length.
    digits = DIGITS * (np.abs([plan.start[:2], *plan.points]).max() + plan.length)
    yield "lengths at least 0", digits, lambda x: (
        model, followed(plan, Primitive(1, "S", -x * digits, HEADING + QUARTER))
    )  # fmt: skip
    least = TOLERANCE * LEAST
    yield "starts at its place", least * unit, lambda x: (
        model, flight(LOOP[:3], unit, START + (0.6 - 0.8j) * x * least)
    )  # fmt: skip
    yield "starts with its heading", TOLERANCE, lambda x: (
        model, flight(LOOP[:3], unit, heading=HEADING - x * TOLERANCE)
    )  # fmt: skip
    yield "headings without a jump", TOLERANCE, lambda x: (
        model, altered(plan, 1, heading=HEADING + 2 * math.pi - x * TOLERANCE)
    )  # fmt: skip
    loop = flight(LOOP, unit)
    closed = model_for(loop, unit, closed=True)
    yield "headings without a jump", TOLERANCE, lambda x: (
        closed, flight([*LOOP[:-1], (2, "L", QUARTER + x * TOLERANCE)], unit)
    )  # fmt: skip
    yield "ends where it begins", least * unit, lambda x: (
        closed, altered(loop, 6, length=(5.0 + x * least) * unit)
    )  # fmt: skip


def counts(unit):
    """Yield each exact check, and model and plan that break it or not."""
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
            model, followed(plan, Primitive(leg if bad else 1, "S", 0.0, HEADING + QUARTER))
        )  # fmt: skip
    straight = flight([(0, "S", 10.0), (1, "S", 5.0)], unit)
    spot = model_for(straight, unit, turning_radius=0.0)
    yield "straight but for turns on the spot", lambda bad: (
        spot, followed(straight, Primitive(1, "L", 1e-12 * unit * bad, HEADING))
    )  # fmt: skip


@pytest.mark.parametrize("unit", SCALES)
@pytest.mark.parametrize("name", LIMITS)
def test_the_limit_of_each_check(name, unit):
    cases = [case for case in limits(unit) if case[0] == name]
    assert cases
    for _, allowed, case in cases:
        assert_limit(name, allowed, lambda x, case=case: MessengerTour.verify(*case(x)))


@pytest.mark.parametrize("unit", SCALES)
@pytest.mark.parametrize("name", COUNTS)
def test_the_smallest_violation_of_each_exact_check(name, unit):
    cases = [case for case in counts(unit) if case[0] == name]
    assert cases
    for _, case in cases:
        assert_count(name, lambda bad, case=case: MessengerTour.verify(*case(bad)))


@pytest.mark.parametrize("unit", SCALES)
def test_a_path_beyond_the_last_encounter_also_has_a_leg_too_many(unit):
    plan = flight(LOOP[:3], unit)
    allowed = TOLERANCE * LEAST * unit

    def verify(x):
        more = Primitive(2, "S", x * allowed, HEADING + QUARTER)
        return model_for(plan, unit).verify(followed(plan, more))

    assert_limit("ends at the last encounter", allowed, verify, beside=["legs in order"])


@pytest.mark.parametrize("unit", SCALES)
def test_the_vehicle_nearest_to_its_own_limit_is_reported(unit):
    plan, tolerance = flight(LOOP[:3], unit), 1e-10
    # The digits of the second encounter are as large as its tolerance.
    radii = np.array([0.05, 5.0]) * unit
    model = replace(model_for(plan, unit, off=0.0), radius=radii)
    ends = np.cumsum([piece.length for piece in plan.primitives])[[0, 2]]
    far = np.abs([plan.start[:2], plan.points[0]]).max(), np.abs(plan.points).max()
    digits = DIGITS * (far + ends + np.abs(model.positions[[1, 0]]).max(axis=1))
    allowed = tolerance * radii[[1, 0]] + digits
    times = plan.times + np.array([1.1, 0.9]) * allowed / (SPEED * unit)
    (check,) = model.verify(replace(plan, times=times), tolerance=tolerance).violated
    assert (check.name, check.where) == ("length flown is speed times time", "vehicle 1")
    assert check.tolerance == pytest.approx(allowed[0], rel=1e-3)


def test_every_check_has_its_limit():
    plan, loop = flight(LOOP[:3], 1.0), flight(LOOP, 1.0)
    straight = flight([(0, "S", 10.0), (1, "S", 5.0)], 1.0)
    found = [
        model_for(plan, 1.0).verify(plan),
        model_for(loop, 1.0, closed=True).verify(loop),
        model_for(straight, 1.0, turning_radius=0.0).verify(straight),
    ]
    assert all(one.ok for one in found)
    assert names_of(*found) == {*LIMITS, *COUNTS, "ends at the last encounter"}
