"""Classical policies: comparison with exhaustive search in plain Python, and cases of single rules."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from unknown_grid.scenes import WILD, models, run

from crosstrack.instances.unknown_grid import clutter, draw_scenes, maze, spiral
from crosstrack.jit import Kernel
from crosstrack.models.unknown_grid import (
    Camera,
    NavigationRuns,
    Outcome,
    UnknownGridNavigation,
    World,
)
from crosstrack.models.unknown_grid.plan import ACTIONS, STEPS
from crosstrack.models.unknown_grid.world import BLOCKED, FREE, GOING, LOOK, REACHED, Looks
from crosstrack.solvers.contract.backend import Backend, Limit, Request
from crosstrack.solvers.contract.control import Control
from crosstrack.solvers.unknown_grid import (
    baselines,
    dstar_kernels,
    replanning,
    replanning_kernels,
)
from crosstrack.solvers.unknown_grid.baselines import (
    BaselineOne,
    BaselineOneReachable,
    BaselineTwo,
    BaselineTwoReachable,
)
from crosstrack.solvers.unknown_grid.native import GIVE_UP, NO_WAY, NavigationBackend
from crosstrack.solvers.unknown_grid.replanning import AStarReplanning, CurrentView, DStarLite

BASELINES = (BaselineOne, BaselineOneReachable, BaselineTwo, BaselineTwoReachable)
PLANNERS = (DStarLite, AStarReplanning, CurrentView)
EVERY = (*PLANNERS, *BASELINES)
Cell = tuple[int, int]
Guide = Callable[[UnknownGridNavigation, Looks, Cell], int]
drawn = UnknownGridNavigation.drawn


def lead(backend: Backend, model: UnknownGridNavigation) -> NavigationRuns:
    """Return the verified plan of a policy."""
    plan: NavigationRuns = run(backend, model).point
    found = model.verify(plan)
    assert found.ok, found
    return plan


def steps_to(target: Cell, free: Callable[[Cell], bool]) -> dict[Cell, int]:
    """Return the steps to the target of all cells that reach it, by breadth-first search."""
    steps, todo = {target: 0}, deque([target])
    while todo:
        cell = todo.popleft()
        for down, across in STEPS:
            near = cell[0] + down, cell[1] + across
            if near not in steps and free(near):
                steps[near] = steps[cell] + 1
                todo.append(near)
    return steps


def towards(cell: Cell, steps: dict[Cell, int]) -> int:
    """Return the first of up, down, left and right that leads on."""
    near = [steps.get((cell[0] + down, cell[1] + across)) for down, across in STEPS]
    return near.index(steps[cell] - 1)


def led_by(make: Callable[[], Guide], model: UnknownGridNavigation) -> NavigationRuns:
    """Return the runs of a guide with a new instance per scene."""
    ends = {REACHED: Outcome.REACHED, GIVE_UP: Outcome.GAVE_UP, NO_WAY: Outcome.NO_WAY}
    actions, outcomes = [], []
    world, blinded = World(model), model.blinded()
    for scene in range(model.scenes):
        guide, asked, letters = make(), LOOK, ""
        while True:
            answer = world(np.array([[scene, asked]], float))
            looks = Looks.read(blinded, np.array([scene]), answer)
            if looks.states[0] != GOING:
                outcomes.append(ends.get(int(looks.states[0]), Outcome.OUT_OF_STEPS))
                break
            asked = guide(blinded, looks, tuple(looks.positions[0].tolist()))
            if asked < 0:
                outcomes.append(ends[asked])
                break
            letters += ACTIONS[asked]
        actions.append(letters)
    return NavigationRuns(tuple(actions), tuple(outcomes))


def optimistic(remembers: bool) -> Guide:
    """Return a guide that treats unknown cells as free."""
    known: set[Cell] = set()
    expected: list[Cell] = []

    def guide(model: UnknownGridNavigation, looks: Looks, here: Cell) -> int:
        if not remembers:
            known.clear()
        if expected and here != expected[0]:
            known.add(expected[0])
        seen = np.argwhere(looks.view[0] == BLOCKED) + looks.corners[0]
        known.update((r, c) for r, c in seen.tolist())
        rows, columns = model.shape

        def free(cell: Cell) -> bool:
            return 0 <= cell[0] < rows and 0 <= cell[1] < columns and cell not in known

        steps = steps_to(tuple(model.targets[looks.scenes[0]].tolist()), free)
        if here not in steps:
            return NO_WAY
        action = towards(here, steps)
        expected[:] = [(here[0] + STEPS[action][0], here[1] + STEPS[action][1])]
        return action

    return guide


def greedy(patient: bool, reachable: bool) -> Guide:
    """Return a guide to the visible cell nearest the target."""
    sequence: list[int] = []

    def choose(model: UnknownGridNavigation, looks: Looks, here: Cell) -> Iterator[int]:
        seen = np.argwhere(looks.view[0] != BLOCKED) + looks.corners[0]
        cells = {(r, c) for r, c in seen.tolist()}
        target = model.targets[looks.scenes[0]].tolist()
        wanted = steps_to(here, cells.__contains__).keys() if reachable else cells
        if here not in cells:
            return
        goal = min(wanted, key=lambda one: (np.hypot(one[0] - target[0], one[1] - target[1]), one))
        steps = steps_to(goal, cells.__contains__)
        while steps.get(here):
            action = towards(here, steps)
            here = here[0] + STEPS[action][0], here[1] + STEPS[action][1]
            yield action

    def guide(model: UnknownGridNavigation, looks: Looks, here: Cell) -> int:
        if not (patient and sequence):
            sequence[:] = choose(model, looks, here)
        return sequence.pop(0) if sequence else GIVE_UP

    return guide


@st.composite
def wild(draw: st.DrawFn) -> UnknownGridNavigation:
    """Return walls, clutter, mazes or spirals; the target may be out of reach."""
    side, seed = draw(st.integers(5, 13)), draw(st.integers(0, 999))
    sizes = st.sampled_from([1, 3, 5, 9, 2 * side + 1])
    fields: dict[str, Any] = {
        "view": (draw(sizes), draw(sizes)),
        "uav": draw(st.sampled_from(["paper", "follow"])),
        "steps": draw(st.sampled_from([1, 9, 40, 200])),
    }
    law = draw(st.sampled_from(["clutter", "spiral", "maze", "walls", "l-shapes", "u-traps"]))
    if law == "clutter":
        share = draw(st.sampled_from([0.3, 0.45, 0.6]))
        return clutter((side, side), share, seed, **fields)
    if law == "spiral":
        return spiral(side, **fields)
    if law == "maze":
        return maze(side, side, seed, **fields)
    return draw_scenes(
        law, shape=(side, side), obstacles=(1, 5), scenes=3, seed=seed, clear=0, **fields
    )


@settings(deadline=None, max_examples=40)
@given(wild() | models(most=9))
def test_replanning_against_breadth_first_search(model: UnknownGridNavigation) -> None:
    """D* Lite, A* from scratch and exhaustive search take the same steps."""
    plain = led_by(partial(optimistic, True), model)
    assert lead(DStarLite(), model) == plain
    assert lead(AStarReplanning(), model) == plain
    assert lead(CurrentView(), model) == led_by(partial(optimistic, False), model)


@settings(deadline=None, max_examples=40)
@given(wild() | models(most=9))
def test_baselines_against_plain_python(model: UnknownGridNavigation) -> None:
    for baseline in BASELINES:
        plain = led_by(partial(greedy, baseline.patient, baseline.reachable), model)
        assert lead(baseline(), model) == plain


@pytest.mark.parametrize("name", WILD)
def test_wild_scenes(name: str) -> None:
    """Optimistic policies reach every target with enough steps, or prove that no path exists."""
    model = WILD[name]()
    fewest = model.fewest_steps()
    for backend in EVERY:
        plan = lead(backend(), model)
        for letters, outcome, least in zip(plan.actions, plan.outcomes, fewest, strict=True):
            assert outcome is not Outcome.REACHED or least <= len(letters) <= model.steps
            if backend in PLANNERS[:2] and model.steps >= model.shape.prod():
                way = Outcome.NO_WAY if least == np.inf else Outcome.REACHED
                assert outcome is way


def test_no_collisions_where_the_uav_follows() -> None:
    """The vehicle sees its neighbours before it moves there."""
    for law in ("walls", "u-traps", "mixed"):
        model = draw_scenes(law, obstacles=5, scenes=6, view=(5, 5), uav="follow", clear=0)
        for backend in EVERY:
            assert model.score(lead(backend(), model)).collisions == 0


def test_a_cell_out_of_view_costs_one_collision() -> None:
    """The UAV hovers from the start and does not show the wall on the detour."""
    model = drawn(["...@...", "...@...", "S..@..T"], view=(1, 13), uav="paper", steps=40)
    plan = lead(DStarLite(), model)
    (taken,) = model.replays(plan)
    hits = taken.positions[:-1][taken.collided].tolist()
    assert plan.outcomes[0] is Outcome.NO_WAY
    assert hits == [[1, 2], [0, 2]]
    # The policy stores one collision, and returns to its previous cell.
    forgetful = lead(CurrentView(), model)
    assert forgetful.outcomes[0] is Outcome.OUT_OF_STEPS
    assert model.score(forgetful).collisions > 2


def test_ties_go_up_down_left_right() -> None:
    for lines, letters in (
        (["..T", "...", "S.."], "UURR"),
        (["S..", "...", "..T"], "DDRR"),
        (["..S", "...", "T.."], "DDLL"),
        ([".....", ".@@@.", "S@.@T", ".@@@.", "....."], "UURRRRDD"),
    ):
        model = drawn(lines, view=(2 * len(lines) + 1,) * 2)
        for backend in EVERY:
            assert lead(backend(), model).actions == (letters,)
    # Both ends of the last column but one tie; the upper end is chosen.
    beyond = drawn(["S.@...", "..@...", "..@..T", "..@...", "..@..."], view=(5, 5))
    assert lead(BaselineOneReachable(), beyond).actions == ("DDR",)


def test_where_baselines_differ() -> None:
    """The nearest cell is behind a wall whose end is out of view, or changes after each step."""
    wall = drawn(["S..@....."] + ["...@....."] * 6 + ["........."] + ["........T"], view=(7, 7))
    assert lead(BaselineOne(), wall) == NavigationRuns(("DDDRR",), (Outcome.GAVE_UP,))
    assert lead(BaselineOneReachable(), wall).outcomes == (Outcome.REACHED,)
    pocket = drawn(["S.....", ".@....", ".@.@.@", "@....@", "...@@.", ".T@@.@"], view=(5, 5))
    for backend in (BaselineTwo(), BaselineTwoReachable()):
        assert lead(backend, pocket) == NavigationRuns(("DU" * 20,), (Outcome.OUT_OF_STEPS,))
    assert lead(BaselineOneReachable(), pocket).outcomes == (Outcome.REACHED,)
    # No visible cell is nearer for any baseline, but memory leads out.
    deep = drawn([".@@@..", "...@..", "S..@.T", "...@..", ".@@@..", "......"], view=(5, 5))
    for backend in (BaselineOne(), BaselineOneReachable(), BaselineTwo(), BaselineTwoReachable()):
        assert lead(backend, deep).outcomes == (Outcome.GAVE_UP,)
    assert lead(DStarLite(), deep).outcomes == (Outcome.REACHED,)


def test_baselines_in_a_trap_as_in_figure_7() -> None:
    """The visible cell nearest the target is in a dead end; the detour is one row up."""
    trap = drawn(
        ["........", ".@@@@@@.", "S....@.T", ".@@@@@@.", "........"], view=(5, 5), steps=40
    )
    # Table III: from (2, 0) to (2, 2), then (2, 4); from there the target is in no view and nothing is nearer.
    assert lead(BaselineOne(), trap) == NavigationRuns(("RRRR",), (Outcome.GAVE_UP,))


def test_table_4_as_printed() -> None:
    """Planning continues from the chosen cell, and ends when the target enters the view."""
    open_ground = drawn(["S......T"], view=(1, 5))
    # MidPoint is (0, 2), then one cell further each time: each plan from the latest MidPoint is one step to the right.
    assert lead(BaselineTwo(), open_ground).outcomes == (Outcome.REACHED,)
    model = open_ground
    request = {"literal": True}
    plan = run(BaselineTwo(), model, **request).point
    assert plan == NavigationRuns(("RRRRR",), (Outcome.GAVE_UP,))


def with_camera(lines: list[str]) -> UnknownGridNavigation:
    return drawn(lines, view=(3, 3), camera=Camera())


def decide(backend: NavigationBackend, model: UnknownGridNavigation, *looks: Looks) -> list[int]:
    """Return the decisions of a policy on given cells, as if detected from images."""
    request = Request(options=backend.checked_options({}), control=Control())
    policy = backend.policy(model.blinded(), np.array([0]), request)
    return [int(policy.decide(one)[0]) for one in looks]


def shown(position: Cell, cells: Any, corner: Cell) -> Looks:
    view = np.array(cells, float)[None]
    zero = np.zeros(1, np.int64)
    return Looks(zero, np.array([position]), np.array([corner]), zero, zero, view)


@pytest.mark.parametrize("backend", [DStarLite, AStarReplanning])
def test_images_are_doubted_and_collisions_are_not(backend: type[NavigationBackend]) -> None:
    """If images show walls all around, the policy tries each side before it returns NO_WAY."""
    lines = [".....", ".....", "..S.T", ".....", "....."]
    walled = np.full((3, 3), float(BLOCKED))
    walled[1, 1] = FREE
    looks = [shown((2, 2), walled, (1, 1))] * 5
    assert decide(backend(), with_camera(lines), *looks) == [3, 0, 1, 2, NO_WAY]
    assert decide(backend(), drawn(lines, view=(3, 3)), *looks[:1]) == [NO_WAY]


@pytest.mark.parametrize("backend", [DStarLite, AStarReplanning])
def test_cells_that_are_seen_otherwise_later(backend: type[NavigationBackend]) -> None:
    """The latest image replaces earlier ones, so a closed path opens again."""
    open_, closed = np.zeros((3, 3)), np.zeros((3, 3))
    closed[:, 2] = BLOCKED
    looks = [shown((1, 1), view, (0, 0)) for view in (open_, closed)]
    back = shown((1, 1), open_, (0, 0))
    model = with_camera([".....", ".S..T", ".....", "....."])
    first = decide(backend(), model, looks[0], back._replace(positions=np.array([[1, 2]])))
    assert first == [3, 3]
    down = looks[1]._replace(positions=np.array([[2, 1]]))
    assert decide(backend(), model, looks[1], down, down._replace(view=open_[None])) == [1, 1, 0]


@pytest.mark.parametrize("backend", EVERY)
def test_a_batch_takes_the_steps_of_single_scenes(backend: type[NavigationBackend]) -> None:
    class Single(backend):  # type: ignore[misc, valid-type]
        together = 1

    fields: dict[str, Any] = {"obstacles": (2, 6), "scenes": 25, "view": (5, 5), "clear": 0}
    for model in (
        draw_scenes("mixed", seed=5, **fields),
        draw_scenes("u-traps", seed=6, shape=(9, 13), steps=60, uav="follow", **fields),
    ):
        assert lead(backend(), model) == lead(Single(), model)
    request = Request(options=backend().checked_options({}), control=Control(oracle=World(model)))
    batches: list[int] = []
    make = backend.policy

    class Counted(backend):  # type: ignore[misc, valid-type]
        def policy(self, problem: UnknownGridNavigation, scenes: Any, request: Request) -> Any:
            batches.append(len(scenes))
            return make(self, problem, scenes, request)

    Counted().run(model.blinded(), request)
    assert batches == [25]


def test_a_stopped_search_claims_nothing() -> None:
    model = drawn(["S@T"], view=(1, 1))
    for backend in EVERY:
        control = Control(oracle=World(model))
        request = Request(options=backend().checked_options({}), control=control)
        policy = backend().policy(model.blinded(), np.array([0]), request)
        control.stop(Limit.INTERRUPTED)
        assert policy.decide(shown((0, 0), [[FREE]], (0, 0)))[0] == GIVE_UP
        answer = backend().run(model.blinded(), request)
        assert answer.limit is Limit.INTERRUPTED
        assert answer.point == NavigationRuns(("",), (Outcome.GAVE_UP,))


def test_interpreted_kernels_are_the_compiled_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    names = ("maze", "thin-clutter", "clutter-no-way")
    plans = [[lead(one(), WILD[name]()) for one in EVERY] for name in names]
    for module in (dstar_kernels, replanning_kernels, replanning, baselines):
        for name, loop in list(vars(module).items()):
            if isinstance(loop, Kernel):
                monkeypatch.setattr(module, name, loop.py_func)
    assert [[lead(one(), WILD[name]()) for one in EVERY] for name in names] == plans
