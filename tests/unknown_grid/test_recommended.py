"""The recommended policy is not clearly worse than any other one that does not see the true maps."""

import numpy as np
import pytest
from unknown_grid.scenes import run

from crosstrack.instances.unknown_grid import draw_scenes, maze
from crosstrack.instances.unknown_grid.laws import SceneLaw
from crosstrack.solvers.contract.registry import find_backend
from crosstrack.solvers.contract.selection import fitting, recommended

LEARNED = ("small-vin", "vin", "macn", "mcgn")
LAWS = [*map(str, SceneLaw), "mazes"]
#: Largest relative excess of the mean cost over that of another policy. The optimistic assumption of the planner is wrong in traps: a
#: policy without memory may leave them by chance. Standard errors of the mean difference are allowed in addition.
MARGIN, ERRORS = 0.01, 2.0


def models_of(law, seed, count):
    """Return one model with `count` drawn scenes, or `count` models with a maze each."""
    if law == "mazes":
        return [maze(17, 17, count * seed + k, view=(9, 9), steps=100) for k in range(count)]
    return [draw_scenes(law, obstacles=(2, 5), scenes=count, seed=seed, view=(9, 9), steps=40)]


def costs_of(name, models):
    """Return the cost of each scene: its steps, or one more than the limit if the target was not reached."""
    costs = []
    for model in models:
        plan = run(find_backend(name), model).point
        assert model.verify(plan).ok
        for letters, outcome, fewest in zip(
            plan.actions, plan.outcomes, model.fewest_steps(), strict=True
        ):
            costs.append(len(letters) if str(outcome) == "reached" else model.steps + 1)
            assert costs[-1] >= min(fewest, model.steps + 1)
    return np.array(costs)


def compare(law, seed, count, learned):
    models = models_of(law, seed, count)
    chosen = recommended(models[0]).name
    assert chosen == "d-star-lite"
    ours = costs_of(chosen, models)
    for name in fitting(models[0]):
        if name in ("oracle", chosen) or (name in LEARNED and not learned):
            continue
        excess = ours - costs_of(name, models)
        allowed = MARGIN * ours.mean() + ERRORS * excess.std() / np.sqrt(len(excess))
        assert excess.mean() <= allowed, f"{law}: {name} is better by {excess.mean():.2f} steps"


@pytest.mark.parametrize("law", ["walls", "u-traps", "paper"])
def test_the_default_is_no_worse_on_drawn_scenes(law):
    compare(law, 200, 20, False)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [200, 201])
@pytest.mark.parametrize("law", LAWS)
def test_the_default_is_no_worse_on_all_laws(law, seed):
    compare(law, seed, 200, True)
