"""Orders of many vehicles by annealing of a simple path."""

import math

import numpy as np
import pytest

from crosstrack.instances.messenger import generate
from crosstrack.models import MessengerTour
from crosstrack.solvers.messenger.emission import Chain
from crosstrack.solvers.messenger.ordering import anneal_order, time_order


def search(model, steps, seed=0):
    """Return the order, its path and its end, from the order of the indices."""
    order = np.append(model.size, np.arange(model.size))
    path, flag = np.zeros((model.size + 1, 4)), np.zeros(1, np.int8)
    path[0, : len(model.start)] = model.start
    draw = np.random.default_rng(seed)
    end = anneal_order(order, Chain(model).scene, path, steps, 0.1, 1e-3, draw, flag)
    return order, path, end


@pytest.mark.parametrize("turning_radius", [0.0, 5.0])
@pytest.mark.parametrize("closed", [False, True])
def test_annealing_shortens_the_path_and_keeps_every_vehicle(turning_radius, closed):
    vehicles = generate(15, 8.0, 3)
    velocities = np.zeros((15, 2)) if closed else vehicles.velocities
    model = MessengerTour(
        vehicles.positions, velocities, 5.0, turning_radius=turning_radius, closed=closed
    )
    _, _, first = search(model, 0)
    order, path, end = search(model, 300)
    assert sorted(order[1:]) == list(range(15)) and order[0] == 15
    assert end < 0.8 * first
    again = path.copy()
    assert time_order(order, 1, 16, Chain(model).scene, again, math.inf) == end
    assert (np.diff(path[:, 3]) >= 0.0).all()
    for k, i in enumerate(order[1:].tolist(), 1):
        apart = math.dist(path[k, :2], model.where(i, path[k, 3]))
        assert apart <= model.radius[i] * (1.0 + 1e-9)


def test_encounters_are_reached_by_paths_of_their_length():
    model = generate(12, 8.0, 4)
    _, path, _ = search(model, 100)
    for k in range(1, 13):
        before, after = path[k - 1], path[k]
        far = math.dist(before[:2], after[:2])
        assert far <= model.speed * (after[3] - before[3]) * (1.0 + 1e-6) + 1e-9


def test_a_set_stop_flag_ends_the_annealing():
    model = generate(6, 8.0, 1)
    order, path = np.append(6, np.arange(6)), np.zeros((7, 4))
    path[0, :3] = model.start
    flag, draw = np.ones(1, np.int8), np.random.default_rng(0)
    anneal_order(order, Chain(model).scene, path, 10**9, 0.1, 1e-3, draw, flag)
    assert order.tolist() == [6, 0, 1, 2, 3, 4, 5]
