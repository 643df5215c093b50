"""Vehicles that arbitrary loads fill exactly: rounding to whole numbers must keep the only packing."""

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.models import FleetRouting
from crosstrack.solvers.fleet.whole import whole_loads


def draw(seed: int) -> tuple[FleetRouting, list[list[int]]]:
    """Return a fleet and the routes that fill each vehicle exactly."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(1, rng.integers(2, 7), rng.integers(2, 6))
    n = int(counts.sum())
    loads = [rng.random(n) * 10 ** rng.uniform(-6, 6), rng.lognormal(0, 1.5, n)][seed % 2]
    routes = [part.tolist() for part in np.split(1 + rng.permutation(n), np.cumsum(counts)[:-1])]
    demands = np.r_[0, loads]
    capacity = [float(demands[rng.permutation(route)].sum()) for route in routes]
    service = np.ones(n + 1) if rng.random() < 0.5 else None
    model = FleetRouting(
        len(counts), points=rng.random((n + 1, 2)), objective="sum", demands=demands, capacity=capacity,
        service=service, use_all=bool(rng.random() < 0.5),
    )  # fmt: skip
    return model, routes


@pytest.mark.parametrize("count", [200, pytest.param(5000, marks=pytest.mark.slow)])
def test_loads_that_fill_a_vehicle_exactly_fit_after_rounding(count: int) -> None:
    for seed in range(count):
        model, routes = draw(seed)
        demands, _, _, limits = whole_loads(model)
        for k, route in enumerate(routes):
            assert demands[route].sum() <= limits[k, 0]
            # A load that fits after rounding exceeds no capacity by more than the verification accepts.
            scale = demands.sum() / model.demands.sum()
            assert limits[k, 0] <= model.capacity[k] * scale * (1 + 2e-7)


@pytest.mark.parametrize("seeds", [range(12), pytest.param(range(400), marks=pytest.mark.slow)])
def test_pyvrp_fills_vehicles_exactly(seeds: range) -> None:
    pytest.importorskip("pyvrp", reason="PyVRP is an extra")
    missed = []
    for seed in seeds:
        model, _ = draw(seed)
        answer = ct.solve(model, "pyvrp", seed=1, backend_options={"patience": 20})
        if answer.plan is None:
            missed.append(seed)
        else:
            assert model.verify(answer.plan, tolerance=1e-11).ok
    assert len(missed) <= len(seeds) // 50, missed


@pytest.mark.parametrize("dimensions", [1, 3, 8])
@pytest.mark.parametrize("unit", [1.0, 1e-6, 7.3e3])
def test_overloads_times_the_largest_penalty_fit_in_63_bits(dimensions: int, unit: float) -> None:
    """Whole loads up to 2^39 would be exact, but PyVRP multiplies their excess with at most 2^25."""
    rng = np.random.default_rng(dimensions)
    demands = unit * rng.integers(2**35, 2**36, (9, dimensions)).astype(float)
    demands[0] = 0.0
    model = FleetRouting(
        2, points=rng.random((9, 2)), objective="sum", service=np.ones(9), demands=demands,
        capacity=np.tile(demands.sum(axis=0) / 2, (2, 1)),
    )  # fmt: skip
    whole, _, _, limits = whole_loads(model)
    assert int(whole.sum()) * 2**25 < 2**63
    assert int(limits.sum()) < 2**38
    assert (whole[1:] > 2**29).all()  # the resolution of a load
