"""The searches with few labels per point: feasible routes, and no change of what is proven."""

from __future__ import annotations

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.instances.resource_routing import generate_electric, generate_network
from crosstrack.models.resource_routing.route import Route
from crosstrack.solvers.resource_routing.multipliers import plain_bounds
from crosstrack.solvers.resource_routing.narrow_kernels import narrow
from crosstrack.solvers.resource_routing.network import network

FLAG = np.zeros(1, np.int8)


def searched(model, width, weight=0.0, ceiling=np.inf, flag=FLAG):
    net = network(model, np.arange(len(model.kinds)), FLAG)
    return narrow(net, plain_bounds(net).ahead, width, weight, model.revisits, ceiling, flag)


@pytest.mark.parametrize("weight", [0.0, 0.3])
@pytest.mark.parametrize("width", [1, 4, 64])
@pytest.mark.parametrize("seed", range(3))
def test_narrow_searches_find_feasible_routes(seed, width, weight):
    model = generate_network(8, seed)
    best = ct.solve(model, "resource-labelling")
    route, length = searched(model, width, weight)
    if route.size:
        checked = model.verify(Route(tuple(route.tolist())))
        assert checked.ok
        assert checked.objective == pytest.approx(length)
        assert best.primal_bound <= length * (1 + 1e-9)
        again, _ = searched(model, width, weight, ceiling=length)
        assert again.size == 0 or not np.array_equal(again, route)
    if best.plan is None:
        assert not route.size
    elif width == 64 and not weight:
        assert route.size


def test_a_stopped_narrow_search_returns_no_route():
    route, length = searched(generate_network(8, 0), 4, flag=np.ones(1, np.int8))
    assert route.size == 0 and length == np.inf


@pytest.mark.parametrize(
    "model",
    [
        generate_network(12, 1),
        generate_network(12, 1, revisits=True),
        generate_network(12, 1, tightness=0.9),
        generate_network(12, 0, tightness=0.5),
        generate_electric(60, 0),
    ],
    ids=["network", "revisits", "tight", "infeasible", "electric"],
)
def test_a_time_limit_changes_no_proof(model):
    one = ct.solve(model, "resource-labelling")
    other = ct.solve(model, "resource-labelling", time_limit=60.0)
    assert one.termination == other.termination
    assert one.primal_bound == pytest.approx(other.primal_bound)
    assert one.dual_bound == pytest.approx(other.dual_bound)
