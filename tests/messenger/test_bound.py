"""Euclidean bound: brute force, all conic backends, validity, and limits."""

import itertools
import math
from fractions import Fraction
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import MessengerTour
from crosstrack.models.messenger.relaxation import Field, euclidean_relaxation
from crosstrack.solvers import Control, Limit, Request, Termination
from crosstrack.solvers.contract.registry import find_backend
from crosstrack.solvers.messenger.bound_conic import Chains
from crosstrack.solvers.messenger.bound_kernels import Data, insertions, prove_length
from crosstrack.solvers.messenger.bound_search import OrderSearch, best_orders, fly_path


def drawn(seed, n=None, **fixed):
    """Return a model with more extreme data than the paper's, of a kind that depends on the seed."""
    draw = np.random.default_rng(seed)
    n = n or 1 + seed % 5
    size = 10.0 ** draw.integers(-2, 5)
    places = draw.uniform(-size, size, (n, 2))
    kind = seed // 5 % 6
    if kind == 1:
        places[:, 1] = 0.0
    if kind == 2 and n > 1:
        places[1:] = places[0]
    if kind == 3:
        places = np.round(places / size) * size
    radius = size * draw.choice([0.0, 1e-6, 0.1, 0.5, 3.0], n, p=[0.3, 0.1, 0.3, 0.2, 0.1])
    # Each disc of the fourth kind contains the start.
    radius = np.hypot(*places.T) * 1.5 if kind == 4 else radius
    ways = draw.uniform(0, 2 * math.pi, n)
    fast = 10 * draw.choice([0.0, 0.35, 0.9, 0.999], n, p=[0.3, 0.4, 0.2, 0.1])
    motion = (fast * [np.cos(ways), np.sin(ways)]).T
    if kind == 5:
        away = places / np.hypot(*places.T)[:, None]
        motion = 9.99 * away * draw.choice([-1, 1], n)[:, None]
    start = [None, [0, 0, 1.0], [0, 0]][seed % 3]
    if start is None and seed % 2:
        return MessengerTour(places, radius=radius, start=None, closed=True, **fixed)
    where = {"start": start or [0.0, 0.0], "closed": bool(seed // 3 % 2), **fixed}
    return MessengerTour(places, motion, radius=radius, **where)


MODELS = [drawn(seed) for seed in range(60)]


@cache
def exhaustive(seed):
    """Return the length of the shortest tour over all orders."""
    model = MODELS[seed]
    field, chains = Field.of(model), Chains(model)
    at = [k + (not field.free) for k in range(model.size)]
    orders = itertools.permutations(range(model.size))
    return min(fly_path(field, o, chains.solve(field.chain(o)), at).length for o in orders)


def plain_bound(field, stops, directions):
    """Return the bound that directions prove, by the Lagrangian in NumPy, without a margin."""
    c, w, r = field.centres[stops], field.velocities[stops], field.radii[stops]
    d = directions / np.maximum(np.hypot(*directions.T), 1.0)[:, None]
    factor = np.ones(len(d))
    for k in reversed(range(len(d))):
        if k + 1 < len(d):
            factor[k] = factor[k + 1] * (1 - d[k + 1] @ w[k + 1])
        factor[k] /= 1 - d[k] @ w[k + 1]
    u = factor[:, None] * d
    pull = u - np.vstack([u[1:], np.zeros((1, 2))])
    # The recursion above satisfies the condition on the multipliers of the times.
    for k in range(len(d)):
        assert factor[k] == pytest.approx(1 + (pull[k:] * w[k + 1 :]).sum(), rel=1e-6)
        assert np.hypot(*u[k]) <= factor[k] * (1 + 1e-12)
    if field.free:
        pull[-1] -= u[0]
        return (u * np.diff(c, axis=0)).sum() - (np.hypot(*pull.T) * r[1:]).sum()
    return (pull * c[1:]).sum() - u[0] @ c[0] - (np.hypot(*pull.T) * r[1:]).sum()


def close(bound, best, model):
    """Return whether a bound is valid and close enough to the optimum.

    If vehicles flee at nearly the speed of the UAV, the flight is up to 1e9 fields long, which
    exceeds the precision of the solver.
    """
    far = best > 1e5 * (model.extent + model.radius.max())
    return -1e-12 * best <= best - bound <= (1e-4 if far else 1e-7) * max(best, model.extent)


@pytest.mark.parametrize(
    "seed", [pytest.param(k, marks=[pytest.mark.slow] * (k % 3 > 0)) for k in range(60)]
)
def test_the_bound_equals_brute_force(seed):
    model = MODELS[seed]
    best = exhaustive(seed)
    found = ct.solve(model, "euclidean-bound")
    assert found.limit is None and found.plan is None
    assert close(found.dual_bound, best, model), (found.dual_bound, best)


@pytest.mark.sample(2)
@pytest.mark.parametrize("seed", range(1, 60, 2))
def test_without_a_turning_radius_the_bound_is_a_plan(seed):
    model = drawn(seed, turning_radius=0)
    best = exhaustive(seed)
    found = ct.solve(model, "euclidean-bound")
    assert found.plan is not None, found.message
    assert found.termination == ("optimal" if found.gap <= 1e-6 else "feasible")
    assert close(found.dual_bound, best, model)
    assert found.primal_bound <= best * (1 + 1e-6) + 1e-7 * model.extent


def test_the_shortest_tour_of_a_square_and_of_a_line():
    square = [[0, 0], [0, 1], [1, 1], [1, 0]]
    found = ct.solve(
        MessengerTour(square, radius=0, start=None, closed=True, turning_radius=0),
        "euclidean-bound",
    )
    assert found.termination == "optimal"
    assert found.primal_bound == pytest.approx(4)
    # Straight on for 10 - 2 m. Then the vehicle approaches: 8 / 2 of the remaining distance.
    line = MessengerTour([[10, 0]], [[-5, 0]], radius=2, speed=5.0001, start=[0, 0])
    wanted = 8 * 5.0001 / (5.0001 + 5)
    assert ct.solve(line, "euclidean-bound").dual_bound == pytest.approx(wanted, rel=1e-8)


@pytest.mark.sample(2)
@pytest.mark.parametrize("seed", range(18))
def test_all_conic_backends_agree_on_the_relaxation(seed):
    model = MODELS[seed]
    # ECOS and SCS fail on vehicles that are nearly as fast as the UAV.
    model = MessengerTour(
        model.positions, model.velocities / 2, model.radius, start=model.start, closed=model.closed
    )
    order = np.random.default_rng(seed).permutation(model.size)[: max(1, model.size - 1)]
    program = euclidean_relaxation(model, order)
    field = Field.of(model)
    path = Chains(model).solve(field.chain(order))
    scale = max(path.bound, 1e-3) * field.unit
    for name in ("clarabel", "ecos", "scs"):
        found = ct.solve(program, name)
        assert found.termination == "optimal", (name, found.message)
        assert abs(found.primal_bound - path.bound * field.unit) <= 1e-6 * scale, name
    assert path.times[-1] - path.bound <= 1e-7 * scale / field.unit
    assert {block.name for block in program.cones} == {"legs", "within radius"}


def test_rejects_an_invalid_order():
    for order in ([], [0, 0], [3], [-1]):
        with pytest.raises(InvalidData, match="order must name vehicles"):
            euclidean_relaxation(drawn(2, n=3), order)


@given(st.integers(0, 10_000), st.booleans())
@settings(max_examples=40, deadline=None, derandomize=True)
def test_any_directions_prove_a_bound(seed, free):
    draw = np.random.default_rng(seed)
    model = drawn(int(draw.integers(0, 60)) // 6 * 6 + (3 if free else 1), n=4)
    assert (model.start is None) == free
    field = Field.of(model)
    order = draw.permutation(4)
    stops = field.chain(order)
    path = Chains(model).solve(stops)
    directions = path.directions + draw.normal(0, 10.0 ** draw.integers(-8, 1), (len(stops) - 1, 2))
    data = Chains(model).data
    found = prove_length(data, stops, directions)
    plain = plain_bound(field, stops, directions)
    assert found <= max(plain, 0)
    assert found == pytest.approx(max(plain, 0), rel=1e-9, abs=1e-9 * np.abs(field.centres).max())
    at = [k + (not field.free) for k in range(4)]
    best = fly_path(field, tuple(order.tolist()), path, at)
    assert found * field.unit <= best.length * (1 + 1e-12)
    # The cost of another vehicle is never overestimated.
    fewer = field.chain(order[:3])
    part = Chains(model).solve(fewer)
    bounds = np.empty(len(fewer) - 1 + (not field.closed))
    insertions(data, fewer, part.directions, part.points, part.times, int(order[3]), bounds)
    for place, bound in enumerate(bounds):
        more = np.insert(fewer, place + 1, order[3])
        way = Chains(model).solve(more)
        if field.free:
            at = list(range(4))
            inner = more[:-1]
        else:
            at = [k + 1 for k in range(4)]
            inner = more[1:5]
        tour = fly_path(field, tuple(inner.tolist()), way, at)
        assert bound * field.unit <= tour.length * (1 + 1e-12)


@pytest.mark.parametrize("slack", [1e-3, 1e-6, 1e-9, 1e-12])
def test_bounds_are_sound_for_vehicles_almost_as_fast_as_the_uav(slack):
    """The bound at points is rational; 1 - d . W loses the digits of the slack."""
    draw = np.random.default_rng(1)
    for _ in range(50):
        ways = draw.uniform(0, 2 * math.pi, 4)
        motion = (1 - slack) * np.column_stack([np.cos(ways), np.sin(ways)])
        field = Field.of(MessengerTour(draw.uniform(-1, 1, (4, 2)), motion, radius=0, speed=1))
        stops = field.chain(draw.permutation(4))
        # Flights that chase the vehicles.
        directions = field.velocities[stops[1:]] * (1 - slack * draw.uniform(0, 1, (4, 1)))
        exact, factor = Fraction(0), Fraction(1)
        for k in reversed(range(4)):
            here, rate = field.centres[stops[k : k + 2]], field.velocities[stops[k + 1]]
            for row in (k + 1, k) if k < 3 else (k,):
                (x, y), (u, v) = map(Fraction, directions[row]), map(Fraction, rate)
                over = 1 - x * u - y * v
                factor = factor * over if row > k else factor / over
            step = [Fraction(there) - Fraction(begin) for begin, there in zip(*here, strict=True)]
            exact += factor * sum(Fraction(d) * s for d, s in zip(directions[k], step, strict=True))
        data = Data(field.centres, field.velocities, field.radii, np.zeros((5, 5)), 0.0, False, 0.0)
        assert prove_length(data, stops, directions) <= max(exact, 0)


@given(st.integers(0, 59), st.floats(-6, 6), st.floats(-3, 3), st.floats(0, 6.28))
@settings(max_examples=25, deadline=None, derandomize=True)
def test_bounds_scale_with_lengths_and_speeds_and_turn_with_the_field(seed, length, speed, angle):
    model = MODELS[seed]
    metre, fast = 10.0**length, 10.0**speed
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    start = None if model.start is None else model.start[:2] @ turn * metre
    other = MessengerTour(
        model.positions @ turn * metre, model.velocities @ turn * fast, radius=model.radius * metre,
        speed=model.speed * fast, start=start, closed=model.closed,
    )  # fmt: skip
    bounds = [ct.solve(one, "euclidean-bound").dual_bound for one in (model, other)]
    far = bounds[0] > 1e5 * (model.extent + model.radius.max())
    off = (1e-4 if far else 1e-7) * max(bounds[0], model.extent)
    assert abs(bounds[1] / metre - bounds[0]) <= off


def crowd(n):
    draw = np.random.default_rng(1)
    return MessengerTour(draw.uniform(0, 1000, (n, 2)), draw.uniform(-4, 4, (n, 2)))


class Counted(Control):
    """Control that stops after a number of polls."""

    def __init__(self, most):
        super().__init__()
        self.left = most

    @property
    def stopped(self):
        self.left -= 1
        return self.left < 0


def test_a_stopped_search_returns_a_bound():
    model = crowd(60)
    found = ct.solve(model, "euclidean-bound", time_limit=0.3)
    assert found.seconds["solve"] < 5
    assert found.termination == "no_solution" and found.limit == "time"
    control = Control()
    control.stop(Limit.INTERRUPTED)
    backend = find_backend("euclidean-bound")
    answer = backend.run(model, Request(control=control))
    assert answer.limit is Limit.INTERRUPTED
    assert answer.dual_bound == 0 < found.dual_bound
    # If it stops after its first tour, it returns a plan whenever the tour is one.
    model = crowd(20)
    plain = MessengerTour(model.positions, model.velocities, turning_radius=0)
    answer = backend.run(plain, Request(control=Counted(60), gap=0.0))
    assert answer.termination is Termination.FEASIBLE and answer.limit is Limit.INTERRUPTED
    assert 0 < answer.dual_bound < answer.primal_bound
    assert plain.verify(answer.point).ok


@pytest.mark.parametrize("curved", [False, True])
def test_the_bound_only_rises(curved):
    told, asked = [], itertools.count()
    search = OrderSearch(crowd(12), curved=curved)
    assert not search.run(lambda: next(asked) > 60, told.append, 1e-6)
    assert told == sorted(told)
    assert 0 < told[-1] <= search.bound


def test_a_cutoff_below_every_tour_is_a_bound():
    model = crowd(8)
    best = ct.solve(model, "euclidean-bound").dual_bound
    backend = find_backend("euclidean-bound")
    answer = backend.run(model, Request(cutoff=best / 2))
    assert answer.termination is Termination.NO_SOLUTION
    assert answer.dual_bound == best / 2
    assert answer.message == "no plan better than the cutoff"
    answer = backend.run(model, Request(cutoff=best * 2))
    assert answer.dual_bound == pytest.approx(best, rel=1e-6)
    assert backend.run(model, Request(cutoff=best)).dual_bound <= best
    # A search that ends at a wide gap proves only that gap.
    assert best * 0.5 <= backend.run(model, Request(gap=0.5)).dual_bound <= best


def test_best_orders_are_sorted_and_proven():
    model = crowd(12)
    orders = best_orders(model, lambda search: False)
    lengths = [length for _, length in orders]
    assert lengths == sorted(lengths) and len({order for order, _ in orders}) == len(orders)
    assert all(sorted(order) == list(range(12)) for order, _ in orders)
    bound = ct.solve(model, "euclidean-bound").dual_bound
    assert lengths[0] == pytest.approx(bound, rel=1e-6)
    search = OrderSearch(model, curved=True)
    assert search.run(lambda: False, lambda bound: None, 1e-6)
    assert search.bound == pytest.approx(min(bound for bound, _ in search.orders), rel=2e-6)
    assert not search.tours and search.best is None
    assert best_orders(model, lambda search: True) == []
