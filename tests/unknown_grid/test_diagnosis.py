"""Diagnosis of unreachable targets: statements hold on the map, and removing the named obstacles opens a path."""

import json
from collections import deque

import numpy as np
import pytest
from unknown_grid.scenes import fewest

import crosstrack as ct
from crosstrack.errors import HiddenData
from crosstrack.models import UnknownGridNavigation
from crosstrack.solvers.run.diagnosis import Diagnosis
from crosstrack.solvers.unknown_grid.diagnosis import opening

drawn = UnknownGridNavigation.drawn


def told(model):
    """Return the diagnosis of a model after a round trip through JSON, and its texts."""
    found = ct.diagnose(model)
    assert found.feasible
    stored = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert Diagnosis.from_dict(stored) == found
    return found, [one.text for one in found.findings]


def removals(blocked, start, target):
    """Return the minimum number of obstacles to remove, by a search in plain Python."""
    cost, queue = {tuple(start): 0}, deque([tuple(start)])
    while queue:
        row, column = queue.popleft()
        for at in ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1)):
            if not (0 <= at[0] < blocked.shape[0] and 0 <= at[1] < blocked.shape[1]):
                continue
            one = cost[row, column] + int(blocked[at])
            if one < cost.get(at, 10**9):
                cost[at] = one
                (queue.append if blocked[at] else queue.appendleft)(at)
    return cost[tuple(target)]


def test_reachable_targets_have_no_findings():
    found, texts = told(drawn(["S..", ".@.", "..T"], view=(3, 3), name="open"))
    assert str(found) == (
        "open: a plan exists, for a run may say that there is no way; the target can be reached, in 4 of 40 steps"
    )
    assert not texts
    two = drawn(["S.T"], ["ST."], view=(1, 1))
    assert told(two)[0].summary.endswith("can be reached in all 2 scenes, in 1 to 2 of 40 steps")


def test_a_finding_names_a_closed_ring_and_its_opening():
    model = drawn(
        [".......", ".@@@@@.", ".@...@.", "S@.T.@.", ".@...@.", ".@@@@@.", "......."], view=(3, 3)
    )
    found, (text,) = told(model)
    assert found.summary.endswith("; there is no way to the target")
    ((row, column),) = found.findings[0].data["opening"]
    assert text == (
        "there is no way: 12 obstacles enclose the target at row 3, column 3 in a part of 9 free cells; 24 of 33 "
        "free cells can be reached from the start; without 1 obstacle, such as at row "
        f"{row}, column {column}, there would be one"
    )
    assert model.blocked[0, row, column]
    data = found.findings[0].data
    assert len(data["walls"]) == 12, "corners hold nothing together"
    assert [1, 1] not in data["walls"]
    assert (data["cells"], data["reachable"], data["edge"]) == (9, 24, False)
    # The reverse case: the start is enclosed.
    turned = drawn(
        [".......", ".@@@@@.", ".@...@.", "T@.S.@.", ".@...@.", ".@@@@@.", "......."], view=(3, 3)
    )
    assert "12 obstacles enclose the start at row 3, column 3" in told(turned)[1][0]
    assert "9 of 33 free cells can be reached" in told(turned)[1][0]


def test_the_edge_of_the_map_encloses_too():
    _, (text,) = told(drawn(["S.@T"], view=(1, 3)))
    assert "there is no way: 1 obstacle and the edge of the map enclose the target" in text
    assert "in a part of 1 free cell;" in text
    _, (text,) = told(drawn(["S@@@@@@T"], view=(1, 3)))
    assert "without 6 obstacles, such as at row 0, column 1 and row 0, column 2 and" in text
    assert "column 4 and 2 more, there would be one" in text


def test_ways_that_are_too_long_come_first_the_nearest_miss_before_others():
    model = drawn(
        ["S....T", "@@@@@@"],
        ["S@...T", "......"],
        ["S@@..T", "@@...."],
        ["S@...T", "@....."],
        ["S..T..", "@....."],
        view=(1, 1), steps=4,
    )  # fmt: skip
    found, texts = told(model)
    assert found.summary.endswith(
        "in 1 of 5 scenes, in 3 of 4 steps; 2 without a way; 2 with a way that is too long"
    )
    wheres = [one.where for one in found.findings]
    assert wheres == ["scene 0", "scene 1", "scene 3", "scene 2"]
    assert texts[0] == ("scene 0: the shortest way has 5 steps, 1 more than the 4 that are allowed")
    assert "scene 1: the shortest way has 7 steps, 3 more" in texts[1]
    single = told(drawn(["S....T"], view=(1, 1), steps=4))
    assert single[0].summary.endswith(
        "the target cannot be reached in the 4 steps that are allowed"
    )
    assert single[1] == ["the shortest way has 5 steps, 1 more than the 4 that are allowed"]


@pytest.mark.parametrize("seed", range(30))
def test_no_fewer_obstacles_would_open_a_way(seed):
    random = np.random.default_rng(seed)
    shape = random.integers(2, 12, 2)
    blocked = random.random(tuple(shape)) < random.choice([0.3, 0.6, 0.9])
    start, target = np.zeros(2, int), shape - 1
    blocked[0, 0] = blocked[-1, -1] = False
    found = opening(blocked, start, target)
    assert len(found) == removals(blocked, start, target)
    assert blocked[tuple(found.T)].all()
    freed = blocked.copy()
    freed[tuple(found.T)] = False
    assert np.isfinite(fewest(freed.tolist(), tuple(start), tuple(target)))


def test_large_maps_are_explained():
    blocked = np.zeros((1, 1000, 1000), bool)
    blocked[0, 500] = True
    blocked[0, 100, :] = True
    model = UnknownGridNavigation(blocked, [[0, 0]], [[999, 999]], [1000, 1000])
    found, (text,) = told(model)
    assert "1000 obstacles and the edge of the map enclose the start" in text
    assert "100000 of 998000 free cells" in text
    first, second = found.findings[0].data["opening"]
    assert (first[0], second[0]) == (100, 500)


def test_diagnosis_requires_the_true_maps():
    with pytest.raises(HiddenData, match="blocked of model 'unknown-grid' is hidden"):
        ct.diagnose(drawn(["S@T"], view=(1, 1)).blinded())
