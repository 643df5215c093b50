"""Aspects of scenes: neighbours, occlusion, noise, moving obstacles and unknown targets, against plain Python."""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from unknown_grid.aspects import look, plain_request, rules, with_rules
from unknown_grid.plain import Plain, visible
from unknown_grid.scenes import models

from crosstrack.errors import HiddenData, InvalidData
from crosstrack.instances.unknown_grid import draw_scenes
from crosstrack.models import UnknownGridNavigation
from crosstrack.models.unknown_grid import World, checks
from crosstrack.models.unknown_grid.moving import obstacle_tracks
from crosstrack.models.unknown_grid.plan import LETTERS, NavigationRuns
from crosstrack.models.unknown_grid.sensing import in_sight
from crosstrack.models.unknown_grid.world import LOOK
from crosstrack.solvers.unknown_grid import oracle
from crosstrack.solvers.unknown_grid.oracle import Oracle

drawn = UnknownGridNavigation.drawn
OPEN = ["S....", ".....", ".....", ".....", "....T"]


@settings(max_examples=60, deadline=None)
@given(model=models(most=5, scenes=2, steps=12), fields=rules(), data=st.data())
def test_world_and_replay_equal_plain_python(model, fields, data):
    model = with_rules(model, fields)
    tracks, world = obstacle_tracks(model), World(model)
    letters = ["", ""]
    plains = [Plain(model, k, tracks[k]) for k in (0, 1)]
    cells, hits = [plain.start for plain in plains], [0, 0]
    for time in range(model.steps):
        rows = []
        for k in (0, 1):
            if world.state(k) == 0:
                letter = data.draw(st.sampled_from(plains[k].letters()))
                cells[k], hit = plains[k].step(cells[k], time, letter)
                hits[k] += hit
                letters[k] += letter
                rows.append((k, LETTERS.index(letter)))
        if not rows:
            break
        answer = look(world, rows)
        for row, k in enumerate(answer.scenes.tolist()):
            assert (tuple(answer.positions[row]), answer.collisions[row]) == (cells[k], hits[k])
    plan = NavigationRuns(tuple(letters), ("gave up", "gave up"))
    assert not world.contradiction(plan)
    for k, taken in enumerate(model.replays(plan)):
        assert (tuple(taken.positions[-1]), taken.collided.sum()) == (cells[k], hits[k])


@settings(max_examples=60, deadline=None)
@given(model=models(most=5, scenes=2), fields=rules(), steps=st.integers(1, 12))
def test_the_oracle_equals_a_search_over_cells_and_times(model, fields, steps):
    model = with_rules(model, {**fields, "steps": steps})
    answer = Oracle().run(model, plain_request())
    assert model.verify(answer.point).ok and answer.primal_bound == answer.dual_bound
    tracks = obstacle_tracks(model)
    costs = []
    for k, taken in enumerate(model.replays(answer.point)):
        best = Plain(model, k, tracks[k]).fewest()
        if best is None:
            still = Plain(dataclasses.replace(model, steps=25, moving=0), k).fewest()
            assert answer.point.outcomes[k] == ("gave up" if still else "no way")
            costs.append(steps + 1 if still else 0)
        else:
            assert (len(answer.point.actions[k]), taken.collided.sum()) == best
            costs.append(best[0])
    assert answer.dual_bound == pytest.approx(np.mean(costs))
    assert model.verify(answer.point).objective == pytest.approx(answer.dual_bound)


def test_the_oracle_does_not_use_the_code_of_the_verification(monkeypatch):
    model = drawn(["S@T"], ["S.T"], view=(3, 3), moving=1, tracks=[[[[0, 2]]], [[[0, 1]]]], steps=5)
    for name in ("has_way", "replay", "verify_runs"):
        monkeypatch.setattr(checks, name, None)
        monkeypatch.setattr(oracle, name, None, raising=False)
    assert Oracle().run(model, plain_request()).point.outcomes == ("no way", "gave up")


@settings(max_examples=40, deadline=None)
@given(
    rows=st.sampled_from([1, 3, 5, 7]), columns=st.sampled_from([1, 3, 7, 9]), density=st.floats(0, 0.6),
    seed=st.integers(0, 999),
)  # fmt: skip
def test_lines_of_sight_equal_exact_arithmetic(rows, columns, density, seed):
    blocked = np.random.default_rng(seed).random((1, rows, columns)) < density
    seen = np.empty_like(blocked)
    in_sight(blocked, seen)
    walls, middle = set(map(tuple, np.argwhere(blocked[0]).tolist())), (rows // 2, columns // 2)
    expected = [
        [visible(walls, middle, (row, column)) for column in range(columns)] for row in range(rows)
    ]
    assert seen[0].tolist() == expected


def test_occluded_cells_are_unknown_and_the_target_is_seen_in_sight_only():
    model = drawn(["....T", ".@@@.", "..S..", ".....", "....."], view=(5, 5), occlusion=True)
    view = look(World(model), [(0, LOOK)]).view[0]
    assert view.tolist() == [
        [-1, -1, -1, -1, -1], [-1, 1, 1, 1, -1], [0, 0, 0, 0, 0], [0, 0, 0, 0, 0], [0, 0, 0, 0, 0],
    ]  # fmt: skip
    # The UAV follows until the target is in sight, which is later than in the view.
    corners = [model.starts[0].tolist()]
    world = World(model)
    for action in (3, 3, 0):
        corners.append((look(world, [(0, action)]).corners[0] + 2).tolist())
    assert corners == [[2, 2], [2, 3], [2, 4], [2, 4]]


def test_rates_of_wrong_readings():
    model = draw_scenes(
        "mixed",
        obstacles=4,
        scenes=40,
        view=(17, 17),
        false_obstacles=0.1,
        missed_obstacles=0.25,
        world_seed=7,
    )
    scenes = [(k, LOOK) for k in range(model.scenes)]
    exact = dataclasses.replace(model, false_obstacles=0.0, missed_obstacles=0.0, occlusion=False)
    counts = np.zeros((2, 2))
    worlds, truths, readings = World(model), World(exact), []
    for action in (LOOK, 0, 1, 2):
        asked = [(k, action) for k, _ in scenes]
        true, seen = look(truths, asked), look(worlds, asked)
        readings.append(seen.view)
        for k in range(model.scenes):
            corner = true.corners[k]
            row, column = np.indices(model.view)
            inside = ((row + corner[0] >= 0) & (row + corner[0] < 17)) & (
                (column + corner[1] >= 0) & (column + corner[1] < 17)
            )
            assert (true.view[k][~inside] == seen.view[k][~inside]).all()
            inside[tuple(true.positions[k] - corner)] = False
            wrong = true.view[k] != seen.view[k]
            assert not wrong[true.view[k] == 2].any()
            for kind in (0, 1):
                those = inside & (true.view[k] == kind)
                counts[kind] += those.sum(), wrong[those].sum()
    for kind, rate in ((0, 0.1), (1, 0.25)):
        size, wrong = counts[kind]
        # Six standard deviations of a binomial law.
        assert size > 3000 and abs(wrong - rate * size) < 6 * np.sqrt(size * rate * (1 - rate))
    # Readings of a repeated run are equal, those of another step or another seed differ.
    again = World(model)
    for action, view in zip((LOOK, 0, 1, 2), readings, strict=True):
        assert (look(again, [(k, action) for k, _ in scenes]).view == view).all()
        assert (look(again, scenes).view == view).all()
    other = look(World(dataclasses.replace(model, world_seed=8)), scenes).view
    assert (other != readings[0]).any()
    still = dataclasses.replace(model, uav="follow")
    world = World(still)
    first, second = (look(world, [(0, action)]) for action in (LOOK, LOOK))
    assert (first.view == second.view).all()


def test_errors_of_neighbouring_cells_and_steps_are_independent():
    free = UnknownGridNavigation(
        np.zeros((1, 101, 101), bool), [[50, 50]], [[0, 0]], [101, 101], view=(101, 101),
        false_obstacles=0.3, steps=500,
    )  # fmt: skip
    world = World(dataclasses.replace(free, moving=1, tracks=[[[[100, 100]]]]))
    wrong = [look(world, [(0, action)]).view[0] == 1 for action in [8] * 20]
    flat = np.array(wrong, float)[:, 1:40, 1:40] - 0.3
    for shift in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 1, 1)):
        moved = np.roll(flat, shift, (0, 1, 2))
        # The deviation of the mean of n products of independent values is 0.21 / sqrt(n).
        assert abs((flat * moved).mean()) < 5 * 0.21 / np.sqrt(flat.size)


def test_moving_obstacles_walk_on_free_cells_and_tracks_turn_back():
    model = drawn(["S.@..", ".@...", "....T"], view=(3, 3), moving=3, world_seed=5, steps=300)
    tracks = obstacle_tracks(model)[0]
    assert not model.blocked[0][tracks[..., 0], tracks[..., 1]].any()
    assert np.abs(np.diff(tracks, axis=1)).sum(axis=-1).max() == 1
    assert (tracks[:, 0] != model.starts[0]).any(axis=-1).all()
    assert (obstacle_tracks(model)[0] == tracks).all()
    assert (obstacle_tracks(dataclasses.replace(model, world_seed=6))[0] != tracks).any()
    fixed = drawn(
        OPEN,
        view=(3, 3),
        moving=2,
        tracks=[[[[2, 0], [2, 1], [2, 2]], [[4, 0], [4, 0], [4, 1]]]],
        steps=6,
    )
    assert obstacle_tracks(fixed)[0].tolist() == [
        [[2, 0], [2, 1], [2, 2], [2, 1], [2, 0], [2, 1], [2, 2]],
        [[4, 0], [4, 0], [4, 1], [4, 0], [4, 0], [4, 0], [4, 1]],
    ]


@pytest.mark.parametrize(
    ("track", "letters", "collided", "end"),
    [
        ([[0, 2], [0, 1]], "R", [1], (0, 0)),  # both enter one cell
        ([[0, 1], [0, 0]], "R", [1], (0, 0)),  # exchange
        ([[0, 1], [0, 0]], "W", [1], (0, 0)),  # the obstacle enters the vehicle's cell
        ([[0, 1], [0, 2]], "R", [0], (0, 1)),  # the vehicle follows the obstacle
        ([[1, 0], [0, 1]], "C", [1], (0, 0)),  # both cross one corner
        ([[1, 0], [0, 1]], "W", [0], (0, 0)),
        ([[0, 1], [0, 0], [0, 1]], "WD", [1, 0], (1, 0)),  # the vehicle leaves an obstacle
    ],
)
def test_the_rule_of_collisions(track, letters, collided, end):
    model = drawn(OPEN, view=(3, 3), connectivity="8", moving=1, tracks=[[track]])
    taken = model.replays(NavigationRuns((letters,), ("gave up",)))[0]
    assert taken.collided.astype(int).tolist() == collided and tuple(taken.positions[-1]) == end


def test_success_weighted_by_path_length():
    model = drawn(["S.T", "..."], ["S.T", "..."], ["S@T", ".@."], view=(3, 3), steps=9)

    def spl(*runs):
        ends = tuple("reached" if end else "gave up" for _, end in runs)
        score = model.score(NavigationRuns(tuple(letters for letters, _ in runs), ends))
        return score.spl

    assert spl(("RR", 1), ("RR", 1), ("", 0)) == pytest.approx(2 / 3)
    assert spl(("DRRU", 1), ("RR", 1), ("", 0)) == pytest.approx((0.5 + 1) / 3)
    assert spl(("UURR", 1), ("R", 0), ("", 0)) == pytest.approx(0.5 / 3)  # collisions are steps
    assert spl(("R", 0), ("", 0), ("", 0)) == 0.0
    moving = drawn(
        ["S.T"], view=(3, 3), steps=9, moving=1, tracks=[[[[0, 1], [0, 2], [0, 2], [0, 2], [0, 1]]]]
    )
    assert moving.fewest_steps().tolist() == [np.inf]  # the obstacle always returns
    runs = NavigationRuns(("WWWWWWWWWWWRR",), ("reached",))  # more steps than allowed
    gap = dataclasses.replace(moving, tracks=[[[[0, 1]] * 12 + [[0, 2]] * 9]])
    with np.errstate(all="raise"):
        score = gap.score(runs)
    assert score.spl == 0.0
    eight = drawn(OPEN, view=(3, 3), connectivity="8")
    assert eight.score(NavigationRuns(("RRRRDDDD",), ("reached",))).spl == pytest.approx(0.5)


def test_the_target_is_hidden_until_it_is_seen():
    model = drawn(OPEN, view=(3, 3), target_known=False, moving=1, world_seed=3)
    view = model.blinded()
    for name in ("targets", "world_seed", "tracks", "blocked"):
        with pytest.raises(HiddenData, match=f"{name} of model 'unknown-grid' is hidden"):
            getattr(view, name)
    assert view.describe() == model.describe() and view.digest == model.digest
    twin = dataclasses.replace(model, targets=[[4, 3]])
    # Two models that differ in an unseen target give equal observations.
    first, second = (look(World(one), [(0, LOOK)]) for one in (model, twin))
    assert all((a == b).all() for a, b in zip(first, second, strict=True))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"connectivity": "any"}, "connectivity must be 4 or 8, got .*any"),
        ({"connectivity": "6"}, "connectivity must be one of"),
        ({"corners": "one"}, "corners must be free with connectivity 4"),
        ({"connectivity": "8", "corners": "cut"}, "corners must be one of free, one, any"),
        ({"occlusion": 1}, "occlusion must be true or false"),
        ({"false_obstacles": 1}, "false_obstacles must be a probability below 1, got 1"),
        ({"missed_obstacles": -0.1}, "missed_obstacles must be"),
        ({"missed_obstacles": float("nan")}, "missed_obstacles must be"),
        ({"moving": -1}, "moving must be"),
        ({"moving": 1.5}, "moving must be"),
        ({"moving": 900, "steps": 10**6}, "moving must be at most 1000000 / .scenes · steps., got 900"),
        ({"moving": 1, "tracks": [[[[4, 3]]]], "steps": 10**6 * 3}, "steps must be"),
        ({"moving": 3, "tracks": [[[[4, 3]]] * 3], "steps": 4 * 10**5}, "moving must be at most 1000000 / .*got 3"),
        ({"tracks": [[[[0, 1]]]]}, "moving must be the number of tracks per scene, 1, .*got 0"),
        ({"moving": 2, "tracks": [[[[0, 1]]]]}, "moving must be the number of tracks per scene, 1, .*got 2"),
        ({"moving": 1, "tracks": [[[[0, 5]]]]}, r"tracks\[0\]\[0\]\[0\] must be on the map, got \[0, 5\]"),
        ({"moving": 1, "tracks": [[[[0, 1], [0, 3]]]]}, r"tracks\[0\]\[0\]\[1\] must be a neighbour"),
        ({"moving": 1, "tracks": [[[[0, 0], [0, 1]]]]}, "must not be the start of the vehicle"),
        ({"moving": 1, "tracks": [[[0, 1]]]}, "tracks must"),
        ({"moving": 1, "tracks": [[[[0.5, 1]]]]}, r"tracks\[0, 0, 0, 0\] must be whole"),
        ({"moving": 1, "tracks": np.zeros((1, 1, 0, 2), int)}, "tracks must be None or have at least one"),
        ({"tracks": np.zeros((1, 0, 3, 2), int)}, "tracks must be None or have at least one"),
        ({"world_seed": -1}, "world_seed must be"),
        ({"camera": {}, "moving": 1}, "camera must be None with moving obstacles"),
        ({"occlusion": True, "view": (301, 3)}, "view must"),
    ],
    ids=str,
)  # fmt: skip
def test_rejects_contradictory_aspects(fields, message):
    with pytest.raises(InvalidData, match=message):
        drawn(OPEN, **{"view": (3, 3), **fields})
    wall = {"moving": 1, "tracks": [[[[0, 1]]]]}
    with pytest.raises(InvalidData, match=r"tracks\[0\]\[0\]\[0\] must be free"):
        drawn(["S@T"], view=(3, 3), **wall)


def test_plans_with_actions_of_other_models_are_rejected():
    model = drawn(OPEN, view=(3, 3))
    for letter in "QW":
        with pytest.raises(
            InvalidData, match=r"actions\[0\] must have the letters U, D, L, R of this model"
        ):
            model.verify(NavigationRuns((letter,), ("gave up",)))
    with pytest.raises(InvalidData, match=r"an action must be 0 .up., .*, got 8"):
        look(World(drawn(OPEN, view=(3, 3), connectivity="8")), [(0, 8)])
    with pytest.raises(InvalidData, match=r"8 .wait. or -1 .look., got 4"):
        look(World(drawn(OPEN, view=(3, 3), moving=1)), [(0, 4)])


def test_fields_at_their_defaults_keep_digest_and_data():
    model = drawn(OPEN, view=(3, 3))
    assert list(model.data()) == [
        "blocked",
        "starts",
        "targets",
        "shape",
        "view",
        "steps",
        "uav",
        "camera",
    ]
    full = {"connectivity": "8", "corners": "one", "occlusion": True, "false_obstacles": 0.1,
            "missed_obstacles": 0.2, "target_known": False, "moving": 1, "tracks": [[[[4, 0], [3, 0]]]], "world_seed": 9}  # fmt: skip
    digests = {model.digest}
    for count in range(1, 4):
        for names in itertools.combinations(full, count):
            fields = {name: full[name] for name in names}
            try:
                other = drawn(OPEN, view=(3, 3), **fields)
            except InvalidData:
                continue
            assert UnknownGridNavigation.from_data(other.data()).digest == other.digest
            digests.add(other.digest)
    assert len(digests) > 40
