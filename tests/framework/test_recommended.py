"""The recommended backend is not clearly worse than any other native backend of the problem."""

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.instances import (
    error_correction,
    fleet,
    fleet_mission,
    grid_path,
    guided_path,
    messenger,
    minimum_snap,
    resource_routing,
)
from crosstrack.instances.catalogue import entries
from crosstrack.models import GridPath
from crosstrack.models.verification import TOLERANCE
from crosstrack.solvers.contract.registry import find_backend
from crosstrack.solvers.contract.selection import fitting, recommended

SECONDS = 3.0
#: Estimates are compared by their distance to the truth, and drawn scenes by their spread.
PROBLEMS = (
    "black-box", "error-correction", "resource-routing", "fleet", "fleet-mission", "grid-path",
    "guided-path", "messenger", "minimum-derivative", "minimum-snap", "satellite-slew",
    "time-allocation",
)  # fmt: skip


def across(grid):
    """Return the path from the first to the last free cell of a map."""
    first, last = np.argwhere(~grid.blocked)[[0, -1]]
    return GridPath(grid, first, last)


#: Only libraries solve this rich fleet.
LIBRARIES = ("fleet/mixed-6",)
NAMES = [
    entry.name
    for entry in entries()
    if entry.name.partition("/")[0] in PROBLEMS and entry.name not in LIBRARIES
]
#: Instances of other sizes than the catalogue's, by seed.
GENERATED = {
    "error-correction": lambda seed: error_correction.generate(
        40, 40, (25, 15, 20, 25, 30), seed=seed
    ),
    "resource-routing": lambda seed: resource_routing.generate_network(40, seed=seed),
    "fleet": lambda seed: fleet.generate(25, 3, seed, objective="max"),
    "fleet-mission": lambda seed: fleet_mission.random_mission(8, 4, 2, seed),
    "grid-path": lambda seed: across(grid_path.rooms(60, 60, seed)),
    "guided-path": lambda seed: guided_path.generate(8, 7, seed),
    "messenger": lambda seed: messenger.generate(12, 8.0, seed),
    "minimum-snap": lambda seed: minimum_snap.corridor(6, seed),
}


#: Largest relative excess of the default over another native backend.
MARGIN = 0.01


def size_of(model, value, scale):
    """Return the size to which an excess is related: the objective, or the spread of the values of a black box.

    The minimum of many black boxes is 0, so values near it differ by many orders of magnitude.
    """
    if model.kind != "black-box":
        return max(abs(value), scale)
    points = np.random.default_rng(0).random((200, model.dimension)) * (model.highs - model.lows)
    values = model.function.values(model.layout.canonical(model.lows + points))
    return max(float(np.nanmedian(values)) - value, abs(value))


def compare_with_natives(model, seconds):
    """Assert that the default has a plan if another has one, and that it is within the margin."""
    default = ct.solve(model, time_limit=seconds)
    for other in fitting(model):
        backend = find_backend(other, model)
        if not isinstance(model, backend.accepts) or other == recommended(model).name:
            continue
        if backend.requires:
            continue  # a library of others
        answer = ct.solve(model, other, time_limit=seconds)
        if answer.plan is None or answer.verification.within_tolerance:
            continue
        what = f"{model.name}: {other} has {answer.primal_bound}"
        assert default.plan is not None, what
        size = size_of(model, answer.primal_bound, answer.verification.scale)
        excess = default.primal_bound - answer.primal_bound
        assert excess <= (MARGIN + TOLERANCE) * size, (
            f"{what}, {default.backend} {default.primal_bound}"
        )


@pytest.mark.parametrize("name", NAMES[::80])
def test_the_default_is_no_worse_on_some_of_the_catalogue(name):
    compare_with_natives(ct.load(name), SECONDS)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_the_default_is_no_worse_on_the_catalogue(name):
    compare_with_natives(ct.load(name), SECONDS)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("problem", GENERATED)
def test_the_default_is_no_worse_on_generated_instances(problem, seed):
    model = GENERATED[problem](seed)
    ct.solve(model, time_limit=60)  # compiles
    compare_with_natives(model, SECONDS)
