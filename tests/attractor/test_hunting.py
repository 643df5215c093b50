"""The hunt: its equations and their derivatives, its invariants, and its largest exponent."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.integrate import solve_ivp

from crosstrack.errors import InvalidData
from crosstrack.instances.attractor import Hunt, motions, simulate_hunt
from crosstrack.instances.attractor.hunting import hunt_exponent, hunt_states
from crosstrack.instances.attractor.listing import HUNT_EXPONENTS, HUNTS
from crosstrack.instances.attractor.motions import SHARED, hunt_rates, orbit

NONE = np.empty((0, 3))
#: A chase around the arena that repeats itself, and one robot behind the other.
CALM = {"obstacles": NONE, "gains": (0.06, 0.08, 0.1), "flight": 0.12, "speeds": (0.22, 0.32)}
CHASE = {**CALM, "gains": (0.06,)}
WILD = [
    {},
    CALM,
    {"gains": (1e-7, 0.1)},
    {"gains": (0.0, 0.0), "flight": 0.0},
    {"gains": (0.03,) * 3, "obstacles": [[5, 5, 0], [5, 5, 0], [5, 5, 1]]},
    {"gains": (0.02,) * 7, "radius": 0.05},
    {"arena": (40.0, 1.0), "obstacles": NONE, "gains": (0.03,), "radius": 0.05},
    {"gains": (0.3,), "flight": 0.5, "speeds": (0.3, 0.5), "barrier": 0.05},
    {"radius": 0.0, "speeds": (0.05, 0.3)},
    {"obstacles": [[0, 0, 3], [10, 10, 3], [0, 10, 3], [10, 0, 3]], "gains": (0.05, 0.05)},
]


def derivative(hunt, state, tangent=None):
    """Return the rates of a state, and those of a tangent vector, interpreted."""
    tangent = np.zeros(len(state)) if tangent is None else tangent
    rates, growth = np.empty(len(state)), np.empty(len(state))
    hunt_rates.py_func(hunt.motion.constants, state, tangent, rates, growth)
    return rates, growth


def plain(hunt, state):
    """Return the accelerations as the class describes them, body by body."""
    bodies = state.reshape(-1, 4)
    last = len(bodies) - 1
    found = []
    for i, body in enumerate(bodies):
        at, velocity = body[:2], body[2:]
        speed = hunt.speeds[1 if i == last else 0]
        force = hunt.thrust * (1 - velocity @ velocity / speed**2) * velocity
        for axis in (0, 1):
            force[axis] += hunt.barrier / (at[axis] - hunt.radius) ** 2
            force[axis] -= hunt.barrier / (hunt.arena[axis] - hunt.radius - at[axis]) ** 2
        round_ones = [(one[:2], one[2]) for one in hunt.obstacles]
        round_ones += [(one[:2], hunt.radius) for j, one in enumerate(bodies) if j != i]
        for middle, radius in round_ones:
            away = at - middle
            distance = np.linalg.norm(away)
            force += hunt.barrier / (distance - radius - hunt.radius) ** 2 * away / distance
        if i < last:
            ahead = bodies[last, :2] - at
            force += hunt.gains[i] * ahead / math.sqrt(ahead @ ahead + hunt.reach**2)
        else:
            for one in bodies[:last]:
                away = at - one[:2]
                force += hunt.flight * away / (away @ away + hunt.reach**2)
        found.append([*velocity, *force])
    return np.ravel(found)


# -- the equations -------------------------------------------------------------------------------


@pytest.mark.parametrize("options", WILD)
def test_rates_are_what_the_class_says(options):
    hunt = Hunt(**options)
    assert len(hunt.motion.constants) == SHARED + len(hunt.gains) + 3 * len(hunt.obstacles)
    for seed in range(3):
        state = Hunt(**options, seed=seed).motion.start
        assert derivative(hunt, state)[0] == pytest.approx(plain(hunt, state), rel=1e-10, abs=1e-12)


@given(
    options=st.sampled_from(WILD),
    seed=st.integers(0, 1000),
    direction=st.lists(st.floats(-1, 1), min_size=8, max_size=8),
)
@settings(max_examples=60, deadline=None)
def test_derivatives_agree_with_differences(options, seed, direction):
    hunt = Hunt(**options, seed=seed)
    state = hunt.motion.start
    tangent = np.resize(direction, len(state))
    step = 1e-6
    ahead, _ = derivative(hunt, state + step * tangent)
    behind, _ = derivative(hunt, state - step * tangent)
    _, growth = derivative(hunt, state, tangent)
    assert growth == pytest.approx((ahead - behind) / (2 * step), rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("options", [{}, WILD[7], WILD[9]])
def test_orbits_agree_with_scipy(options):
    hunt = Hunt(**options)
    states = hunt_states(hunt, 100, 3.0).reshape(100, -1)
    # Where bodies are nearest to something, steps are hardest.
    for row in np.argsort(hunt.gaps(states.reshape(100, -1, 4)[..., :2]))[:1]:
        motion = hunt.motion._replace(start=states[row].copy(), transient=0.0)
        found = orbit(motion, 2, 0.2)[1]
        wanted = solve_ivp(
            lambda t, x: derivative(hunt, x)[0],
            (0, 0.2), states[row], "DOP853", rtol=1e-9, atol=1e-10,
        ).y[:, -1]  # fmt: skip
        assert found == pytest.approx(wanted, abs=1e-6)


# -- what holds over time ------------------------------------------------------------------------


@pytest.mark.parametrize("options", WILD)
def test_bodies_stay_in_the_arena_off_each_other_and_slow(options):
    hunt = Hunt(**options)
    states = hunt_states(hunt, 200, 2.0)
    places, speeds = states[..., :2], np.hypot(states[..., 2], states[..., 3])
    assert places.min() > hunt.radius
    assert (places < hunt.arena - hunt.radius).all()
    for x, y, radius in hunt.obstacles:
        assert np.hypot(places[..., 0] - x, places[..., 1] - y).min() > radius + hunt.radius
    for i in range(places.shape[1]):
        for j in range(i):
            assert np.hypot(*(places[:, i] - places[:, j]).T).min() > 2 * hunt.radius
    assert hunt.gaps(places).min() > 0
    # One that comes may hand on its speed to another.
    assert speeds.max() < 1.5 * hunt.fastest
    # Thrust keeps them going.
    assert np.ptp(places[-250:, 0], axis=0).max() > 0.01


def test_a_seed_means_the_same_hunt():
    one, other = simulate_hunt(Hunt(seed=3), 100), simulate_hunt(Hunt(seed=4), 100)
    assert one.digest == simulate_hunt(Hunt(seed=3), 100).digest != other.digest
    hunt = Hunt(seed=3)
    assert hunt.data() == Hunt.from_data(hunt.data()).data()
    inner, step = motions._steps(hunt.motion, 0.1)
    plain, compiled = np.empty((5, 16)), np.empty((5, 16))
    arguments = (hunt.motion.kind, hunt.motion.constants, hunt.motion.start, step, inner, 1)
    motions._orbit.py_func(*arguments, plain)
    motions._orbit.dispatcher(*arguments, compiled)
    assert np.array_equal(plain, compiled)


def test_a_series_is_one_coordinate_of_one_robot():
    hunt = Hunt()
    states = hunt_states(hunt, 60, 0.5)
    assert states.shape == (60, 4, 4)
    for robot in range(4):
        for axis in (0, 1):
            model = simulate_hunt(hunt, 60, period=0.5, robot=robot, axis=axis)
            assert np.array_equal(model.series, states[:, robot, axis])
    assert (model.unit, model.period, model.true_exponent, model.chaotic) == ("m", 0.5, None, None)
    told = simulate_hunt(hunt, 60, exponent=0.08, name="mine")
    assert (told.true_exponent, told.chaotic, told.name) == (0.08, True, "mine")
    assert simulate_hunt(hunt, 60, exponent=0.0).chaotic is False


# -- the exponent --------------------------------------------------------------------------------


def test_the_exponent_is_that_of_two_nearby_orbits():
    """Two orbits that are brought together again after each interval part as the tangent vector does."""
    hunt = Hunt(obstacles=[[5.0, 5.0, 1.0]], gains=(0.04,))
    motion = hunt.motion._replace(transient=0.0)
    count, interval, size = 60, 4.0, 1e-7
    inner, step = motions._steps(motion, interval)
    logs = np.empty(count)
    motions._growth(motion.kind, motion.constants, motion.start, step, inner, 0, logs)
    state = motion.start
    other = state + size * np.ones(8)
    found = []
    for _ in range(count):
        before = np.linalg.norm(other - state)
        state, other = (orbit(motion._replace(start=one), 2, interval)[1] for one in (state, other))
        apart = other - state
        found.append(math.log(np.linalg.norm(apart) / before))
        other = state + size * apart / np.linalg.norm(apart)
    # The kernel starts from ones, which are √8 long.
    logs[0] -= math.log(math.sqrt(8))
    assert found == pytest.approx(logs, abs=2e-3)


def test_a_hunt_is_chaotic_among_obstacles_and_calm_without():
    chaotic = hunt_exponent(Hunt(), 3000)
    assert chaotic.exponent > 0.05 and chaotic.exponent > 8 * chaotic.deviation
    chase = hunt_exponent(Hunt(**CHASE), 2000)
    assert abs(chase.exponent) < 2e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hunt", "hunt-pair"])
def test_the_catalogue_states_what_is_computed(name):
    found = hunt_exponent(Hunt.from_data(HUNTS[name]), 100_000)
    assert found.exponent == pytest.approx(HUNT_EXPONENTS[name], abs=1e-5)
    assert found.deviation == pytest.approx(8e-4, abs=1e-4)


@pytest.mark.slow
def test_exponents_do_not_depend_on_where_a_hunt_starts():
    found = [hunt_exponent(Hunt(seed=seed)) for seed in range(4)]
    for one in found:
        assert one.exponent == pytest.approx(HUNT_EXPONENTS["hunt"], abs=4 * one.deviation)
        assert one.deviation < 3e-3
    for seed in range(2):
        assert abs(hunt_exponent(Hunt(**CALM, seed=seed), 10_000).exponent) < 5e-4


# -- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"gains": ()}, "gains must be those of 1 … 20 predators, got 0"),
        ({"gains": (0.1,) * 21}, "gains must be those of 1 … 20 predators, got 21"),
        ({"gains": (-0.1,)}, r"gains\[0\] must be >= 0"),
        ({"gains": (0.1, math.nan)}, r"gains\[1\] must be finite"),
        ({"arena": (10.0,)}, r"arena must have shape \(2,\)"),
        ({"arena": (0.5, 0.5), "obstacles": NONE}, "arena must have room for 4 bodies"),
        ({"obstacles": [[5, 5, 20]]}, "arena must have room"),
        ({"obstacles": [[11, 5, 1]]}, r"obstacles\[0\] must have its middle in the arena"),
        ({"obstacles": [[5, 5, 0.1]] * 51}, "obstacles must be at most 50, got 51"),
        ({"speeds": (0.2, 0)}, r"speeds\[1\] must be >= 0.001"),
        ({"speeds": (0.2, 1e3)}, "barrier must be stronger"),
        ({"barrier": 1e-9}, "barrier must be stronger"),
        ({"reach": 0}, "reach must be >= 0.001 m"),
        ({"thrust": 0}, "thrust must be >= 0.001 1/s"),
        ({"radius": -1}, "radius must be >= 0 m"),
        ({"seed": 0.5}, "seed must be a whole number"),
    ],
)
def test_a_hunt_is_refused(options, message):
    with pytest.raises(InvalidData, match=message):
        Hunt(**options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"hunt": "hunt"}, "hunt must be a Hunt, got 'hunt'"),
        ({"count": 20}, "count must be >= 50"),
        ({"period": 0}, "period must be > 0 s"),
        ({"period": 1e9}, "period must be shorter"),
        ({"robot": 4}, "robot must be <= 3, got 4"),
        ({"axis": 2}, "axis must be <= 1"),
        ({"exponent": math.inf}, "exponent must be finite"),
    ],
)
def test_a_simulation_is_refused(options, message):
    with pytest.raises(InvalidData, match=message):
        simulate_hunt(**{"hunt": Hunt(), **options})


def test_an_orbit_through_a_wall_is_refused():
    hunt = Hunt()
    outside = hunt.motion.start.copy()
    outside[0] = 12.0
    hunt.__dict__["motion"] = hunt.motion._replace(start=outside, transient=0.0)
    with pytest.raises(InvalidData, match="barrier must be stronger"):
        simulate_hunt(hunt, 60)
