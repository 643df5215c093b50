"""Last leg of an open tour, compared with closed forms and a dense search; effects of rounding."""

import math

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.models import MessengerTour
from crosstrack.models.messenger import Primitive, TourPlan
from crosstrack.solvers.messenger.last_leg import Disc, shortest_to_disc


def entered(x, y, flown, disc, speed):
    """Return the least length at which places along paths are in the disc."""
    t = flown / speed
    within = np.hypot(disc.x + disc.vx * t - x, disc.y + disc.vy * t - y) <= disc.radius
    return float(flown[within].min()) if within.any() else math.inf


def searched(heading, disc, speed, r, count=361):
    """Return the length of the shortest of many paths: an arc, then a line or the opposite arc."""
    best = math.inf
    first, second = np.meshgrid(
        np.linspace(0, 2 * np.pi, count), np.linspace(0, 2 * np.pi, count), indexing="ij"
    )
    for sign in (1, -1):
        h = heading + sign * first
        x = sign * r * (np.sin(h) - math.sin(heading))
        y = -sign * r * (np.cos(h) - math.cos(heading))
        g = h - sign * second
        u = x - sign * r * (np.sin(g) - np.sin(h))
        v = y + sign * r * (np.cos(g) - np.cos(h))
        best = min(best, entered(u, v, r * (first + second), disc, speed))
        line = second / (2 * np.pi) * 60.0
        u, v = x + line * np.cos(h), y + line * np.sin(h)
        best = min(best, entered(u, v, r * first + line, disc, speed))
    return best


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    "seed", [pytest.param(k, marks=[pytest.mark.slow] if k % 3 else []) for k in range(60)]
)
def test_no_searched_path_to_a_disc_at_rest_is_shorter(seed):
    draw = np.random.default_rng(seed)
    r, radius = float(draw.choice([0.5, 2, 5])), float(draw.choice([0.3, 1, 3]))
    disc = Disc(*(draw.normal(size=2) * draw.choice([1, 3, 10])), 0.0, 0.0, radius)
    heading = float(draw.uniform(0, 2 * np.pi))
    path = shortest_to_disc((0.0, 0.0, heading), disc, 10.0, r, 500.0)
    length = sum(part for _, part in path)
    rough = 0.0 if math.hypot(disc.x, disc.y) <= radius else searched(heading, disc, 10.0, r)
    assert length <= rough + 1e-4
    assert length >= rough - 0.5, "and the grid comes near it"


def drawn(seed):
    """Return heading, disc and turning radius of a case: near or far, at rest or up to 0.99 as fast."""
    draw = np.random.default_rng([30, seed])
    r, radius = 0.5 * 40.0 ** draw.random(), 0.1 * 50.0 ** draw.random()
    apart = 1.001 * radius + draw.choice([r, radius]) * draw.choice([1, 2, 5, 20]) * draw.random()
    pace = 10.0 * draw.choice([0.0, draw.random() * 0.99, 0.99])
    angles = draw.uniform(0, 2 * np.pi, 3)
    place, velocity = (
        size * np.exp(1j * angle) for size, angle in zip((apart, pace), angles, strict=False)
    )
    disc = Disc(place.real, place.imag, velocity.real, velocity.imag, radius)
    return float(angles[2]), disc, float(r)


@pytest.mark.parametrize("first", range(0, 120, 20))
def test_no_searched_path_to_a_moving_disc_is_shorter(first):
    """Dense search over two-piece paths below our length; 3 of these 120 discs were once met too late."""
    whole, share = (one.ravel() for one in np.meshgrid(*[np.linspace(0, 1, 120)] * 2))
    for seed in range(first, first + 20):
        heading, disc, r = drawn(seed)
        path = shortest_to_disc((0.0, 0.0, heading), disc, 10.0, r, 1e7)
        length = sum(part for _, part in path)
        ours = np.array([[part] for _, part in path])
        x, y = followed([sign for sign, _ in path], ours, heading, r)
        assert entered(x, y, ours.sum(axis=0), rim(disc, 1e-9), 10.0) == length
        parts = length * (1 - 1e-9) * whole * np.stack([share, 1 - share])
        for signs in ((1, 0), (-1, 0), (1, -1), (-1, 1)):
            x, y = followed(signs, parts, heading, r)
            found = entered(x, y, parts.sum(axis=0), rim(disc, -1e-9), 10.0)
            assert found == math.inf, (seed, signs, found, length)


def followed(signs, parts, h, r):
    """Return the ends of paths of arcs and lines from the origin."""
    x = y = 0.0
    for sign, part in zip(signs, parts, strict=True):
        g = h + sign * part / r
        x = x + (sign * r * (np.sin(g) - np.sin(h)) if sign else part * np.cos(h))
        y = y - (sign * r * (np.cos(g) - np.cos(h)) if sign else -part * np.sin(h))
        h = g
    return x, y


def rim(disc, share):
    """Return the disc with its radius enlarged by a share."""
    return disc._replace(radius=disc.radius * (1 + share))


@pytest.mark.parametrize(
    ("place", "closed"),
    [
        ((0.0, 20.0), 20.0 - 2.0),  # straight ahead
        ((20.0, 0.0), 0.5 * math.pi * 5 + 15.0 - 2.0 + 0.0),
        ((0.0, 1.5), 0.0),  # within the disc
    ],
)
def test_one_vehicle_at_rest_in_closed_form(place, closed):
    """To (20, 0): a right turn about (5, 0) until the line leads to the centre."""
    if place == (20.0, 0.0):
        ahead = math.sqrt(15.0**2 - 5.0**2)
        closed = 5.0 * (math.pi - math.atan2(ahead, 5.0)) + ahead - 2.0
    model = MessengerTour([place], radius=2.0, turning_radius=5.0)
    answer = ct.solve(model, time_limit=5, seed=0)
    assert answer.verified
    assert answer.primal_bound == pytest.approx(closed, abs=1e-8, rel=1e-9)


def test_one_vehicle_that_flies_away():
    """A straight pursuit at 4 m/s with 10 m to catch up: (20 - 2) m at 6 m/s."""
    model = MessengerTour([[0.0, 20.0]], [[0.0, 4.0]], radius=2.0)
    assert ct.solve(model, time_limit=5).primal_bound == pytest.approx(30.0, rel=1e-9)


def test_a_disc_that_an_arc_enters():
    """Regression: the result was a full circle of 28.97 m."""
    model = MessengerTour([[2.25, 2.12]], radius=2)
    best = ct.solve(model, time_limit=5)
    rough = searched(0.5 * math.pi, Disc(2.25, 2.12, 0, 0, 2.0), 10.0, 5.0, count=1001)
    assert best.primal_bound == pytest.approx(rough, abs=0.03)
    assert best.primal_bound <= rough + 1e-9
    for name in ("memetic", "greedy-centre", "greedy-boundary"):
        assert best.primal_bound <= ct.solve(model, name, time_limit=5).primal_bound + 1e-9


def test_the_search_for_two_arcs_polls_the_stop_flag():
    """An arc enters the disc after less than a full circle; the line of an arc and a line is longer."""
    flag = np.zeros(1, np.int8)
    case = ((0.0, 0.0, 0.5 * math.pi), Disc(2.25, 2.12, 0, 0, 2.0), 10.0, 5.0, 25.0)
    path = shortest_to_disc(*case, flag)
    assert path == shortest_to_disc(*case)
    assert 0 not in [sign for sign, _ in path]
    flag[0] = 1
    assert shortest_to_disc(*case, flag) is None


@pytest.mark.parametrize(
    "seed", [pytest.param(k, marks=[pytest.mark.slow] if k > 3 else []) for k in range(8)]
)
def test_the_default_is_no_worse_than_the_heuristics_for_one_vehicle(seed):
    draw = np.random.default_rng(seed)
    velocity = draw.uniform(-5, 5, (1, 2)) * (seed % 2)
    model = MessengerTour(
        draw.normal(size=(1, 2)) * 6, velocity, radius=float(draw.uniform(0.5, 3))
    )
    best = ct.solve(model, time_limit=5, seed=0).primal_bound
    for name in ("memetic", "variable-neighbourhood", "direct-sampling", "greedy-boundary"):
        other = ct.solve(model, name, time_limit=5)
        assert best <= other.primal_bound * (1 + 1e-6) + 1e-6, name


@pytest.mark.parametrize(("far", "decided"), [(1e6, True), (1e9, True), (3e16, False)])
def test_undecidable_encounters_are_not_verified(far, decided):
    """Regression: after 3e16 m flown, 3e3 m were excused for a disc of 5 m."""
    model = MessengerTour([[0.0, far]], radius=5.0)
    plan = TourPlan(
        (0,), [far / 10], [[0.0, far]], [0, 0, np.pi / 2], (Primitive(0, "S", far, np.pi / 2),)
    )
    found = model.verify(plan)
    assert found.ok == decided
    if not decided:
        check = next(one for one in found.checks if one.name == "encounter within radius")
        assert "not decidable in double precision" in check.where
        assert not check.ok
