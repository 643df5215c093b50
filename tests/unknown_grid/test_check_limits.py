"""Limits of the checks of runs: the smallest violation is refused, and a run without it is not."""

import pytest
from check_limits import assert_count, names_of

from crosstrack.models import UnknownGridNavigation
from crosstrack.models.unknown_grid import NavigationRuns

#: Columns of the maps.
SIZES = [3, 30, 300]
COUNTS = [
    "at most as many steps as allowed",
    "a run ends at the target",
    "the target is where the run ends",
    "there is no way",
    "the target was not reached",
]


def model_for(*maps, spare=0):
    """Return the model whose runs may take `spare` steps more than the way needs."""
    steps = len(maps[0][0]) + spare
    return UnknownGridNavigation.drawn(*maps, view=(3, 3), steps=steps)


def drawings(size):
    """Return an open map and one with a wall, each with the way from corner to corner if there is one."""
    row = "." * (size - 1)
    return [f"S{row}", f"{row}T"], [f"S@{row[1:]}", f".@{row[2:]}T"], "R" * (size - 1) + "D"


def counts(size):
    """Yield each check, a model, and the run of its last scene with and without a violation."""
    free, wall, way = drawings(size)
    plain, shut, longer = (
        model_for(free, free),
        model_for(free, wall),
        model_for(free, free, spare=1),
    )
    reached, no_way, gave_up, late = "reached", "no way", "gave up", "out of steps"
    # A collision is a step.
    yield "at most as many steps as allowed", plain, ("U" + way, reached), (way, reached)
    yield "at most as many steps as allowed", plain, ("U" * (size + 1), late), ("U" * size, late)
    yield "a run ends at the target", longer, (way + "D", reached), ("U" + way, reached)
    yield "a run ends at the target", longer, (way + "L", gave_up), (way[:-1] + "L", gave_up)
    # A cell before the target on its column or row, through the wall, and off the map.
    for run in (way[:-1], "D" + "R" * (size - 2), "L" * size, "U" * size):
        yield "the target is where the run ends", plain, (run, reached), (way, reached)
    yield "the target is where the run ends", shut, (way, reached), (way, gave_up)
    yield "there is no way", plain, (way[:-1], no_way), (way[:-1], gave_up)
    yield "there is no way", plain, (way, no_way), (way, reached)
    yield "the target was not reached", plain, (way, gave_up), (way[:-1], gave_up)
    yield "the target was not reached", plain, (way, late), ("L" * size, late)
    yield "the target was not reached", plain, ("L" * (size - 1), late), ("L" * size, late)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", COUNTS)
def test_the_smallest_violation_of_each_check(name, size):
    cases = [case for case in counts(size) if case[0] == name]
    assert cases
    way = drawings(size)[2]
    for _, model, wrong, right in cases:

        def verify(bad, model=model, wrong=wrong, right=right):
            run, outcome = wrong if bad else right
            return model.verify(NavigationRuns((way, run), ("reached", outcome)))

        assert_count(name, verify)
        assert all(check.where == "scene 1" for check in verify(True).violated)


@pytest.mark.parametrize("size", SIZES)
def test_every_check_has_its_limit(size):
    free, wall, way = drawings(size)
    found = model_for(free, wall).verify(NavigationRuns((way, "D"), ("reached", "no way")))
    assert found.ok and names_of(found) == set(COUNTS)
    assert found.objective == (size + 1) / 2
