"""Searches with Lagrangean bounds: the same optima, sound bounds, and large grids in few labels."""

import math

import numpy as np
import pytest
from resource_draws import least_length, random_branches, random_model, rng_of

import crosstrack as ct
from crosstrack.models import Resource, ResourceRouting
from crosstrack.solvers.resource_routing import labelling
from crosstrack.solvers.resource_routing.multipliers import best_bounds, cumulative
from crosstrack.solvers.resource_routing.network import network

NAME = "resource-labelling"


def exposed(side, seed, *, resources=1, scale=1.0):
    """Return a grid whose short arcs are the exposed ones, with half of the room between the extremes."""
    draw = np.random.default_rng(seed)
    number = np.arange(side * side).reshape(side, side)
    right = np.column_stack([number[:, :-1].ravel(), number[:, 1:].ravel()])
    down = np.column_stack([number[:-1].ravel(), number[1:].ravel()])
    arcs = np.concatenate([right, right[:, ::-1], down, down[:, ::-1]])
    lengths = draw.uniform(1, 20, len(arcs))
    uses = 21 - lengths[:, None] + draw.uniform(0, 2, (len(arcs), resources))
    limits = 20.0 * (side - 1) * np.ones(resources)
    limited = [
        Resource(f"exposure {k}", limits={"crossing": most * scale})
        for k, most in enumerate(limits)
    ]
    kinds = ["crossing"] * side**2
    return ResourceRouting(
        kinds, limited, 0, side**2 - 1, arcs=arcs, lengths=lengths * scale, uses=uses * scale
    )


@pytest.mark.parametrize("draw", [random_model, random_branches])
@pytest.mark.parametrize("revisits", [False, True])
def test_multipliers_change_no_optimum(draw, revisits, monkeypatch):
    """The models of the other tests, whose searches are too short to need multipliers."""
    monkeypatch.setattr(labelling, "LIGHT", -(10**6))
    routes = 0
    for seed in range(15):
        model = draw(rng_of(seed), revisits=revisits)
        wanted = least_length(model)
        found = ct.solve(model, NAME)
        assert found.termination == ("optimal" if wanted < math.inf else "infeasible"), seed
        if wanted < math.inf:
            routes += 1
            assert found.primal_bound == wanted, seed
    assert 6 < routes < 15


def test_the_dual_bounds_the_optimum():
    gaps = []
    for seed in range(40):
        model = random_model(rng_of(seed), revisits=True)
        net = network(model, np.arange(len(model.kinds)), np.zeros(1, np.int8))
        bounds = best_bounds(net)
        if bounds is None:
            continue
        assert set(np.flatnonzero(bounds.weight)) <= set(cumulative(net))
        assert (bounds.weight >= 0).all() and (bounds.reduced >= 0).all()
        least = bounds.ahead[net.start] + bounds.weight @ net.initial
        wanted = least_length(model)
        assert least <= wanted + 1e-9
        gaps.append(wanted - least)
    assert len(gaps) > 5


@pytest.mark.parametrize("resources", [1, 2])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6])
def test_grids_agree_with_the_search_without_multipliers(resources, scale, monkeypatch):
    model = exposed(9, 3, resources=resources, scale=scale)
    plain = ct.solve(model, NAME)
    monkeypatch.setattr(labelling, "LIGHT", -(10**6))
    found = ct.solve(model, NAME)
    assert found.primal_bound == pytest.approx(plain.primal_bound, rel=1e-12)
    assert found.statistics["labels made"] < plain.statistics["labels made"]


@pytest.mark.parametrize("side", [20, 40])
def test_large_grids_take_few_labels(side):
    """The number of labels is nearly proportional to the number of crossings."""
    found = ct.solve(exposed(side, 1), NAME)
    assert found.termination == "optimal"
    assert found.statistics["labels made"] < 100 * side**2
