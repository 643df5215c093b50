"""Scenes for tests: drawings, extreme scenes, a strategy of small scenes, and runs in this process."""

import math
from collections import deque

import numpy as np
from hypothesis import strategies as st

from crosstrack.instances.unknown_grid import clutter, draw_scenes, enclosed, maze, spiral
from crosstrack.models import UnknownGridNavigation
from crosstrack.models.unknown_grid import World
from crosstrack.solvers.contract.backend import Request
from crosstrack.solvers.contract.control import Control
from crosstrack.solvers.unknown_grid.imitation import Scenes, walk_through

drawn = UnknownGridNavigation.drawn

#: Builders of scenes by name. Every policy must terminate in these scenes.
WILD = {
    "maze": lambda: maze(17, 17, 3),
    "maze-paper-hovers-near": lambda: maze(9, 31, 1, view=(3, 3), uav="follow"),
    "spiral": lambda: spiral(11, view=(5, 5)),
    "spiral-follow": lambda: spiral(12, view=(3, 3), uav="follow"),
    "no-way": lambda: enclosed((13, 13), 2, view=(5, 5)),
    "no-way-at-once": lambda: enclosed((7, 7), 1, view=(15, 15)),
    "clutter": lambda: clutter((17, 17), 0.6, 5),
    "clutter-no-way": lambda: clutter((17, 17), 0.6, 5, way=False, view=(3, 3)),
    "thin-clutter": lambda: clutter((20, 15), 0.35, 1, view=(3, 3), uav="follow"),
    "u-trap": lambda: drawn(
        [".......", ".@@@@@.", ".....@.", "S....@T", ".....@.", ".@@@@@.", "......."], view=(3, 3)
    ),
    "beside": lambda: drawn(["ST.", "...", "..."], view=(3, 3)),
    "beside-in-the-dark": lambda: drawn(["S.", "@T"], view=(1, 1)),
    "one-step": lambda: drawn(["S...T"], view=(1, 3), steps=1),
    "one-row": lambda: drawn(["....S.....T."], view=(1, 5)),
    "one-row-blocked": lambda: drawn(["S....@T"], view=(1, 3)),
    "one-column": lambda: drawn(["T", ".", ".", "S"], view=(3, 1)),
    "whole-view": lambda: draw_scenes("u-traps", scenes=2, seed=1, view=(35, 35)),
    "wide-view": lambda: draw_scenes("mixed", shape=(9, 21), scenes=2, seed=2, view=(3, 43)),
    "close-walls": lambda: draw_scenes("walls", obstacles=5, scenes=5, seed=3, clear=0),
}


def run(backend, model, **options):
    """Return the answer of a backend that has no true map and queries the world."""
    whole = backend.checked_options(options)
    request = Request(options=whole, control=Control(oracle=World(model)))
    return backend.run(model.blinded(), request)


def fewest(blocked, start, target):
    """Return the fewest steps between two cells of a map, by breadth-first search in plain Python."""
    away = {tuple(start): 0}
    queue = deque(away)
    while queue:
        row, column = queue.popleft()
        for at in ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1)):
            inside = 0 <= at[0] < len(blocked) and 0 <= at[1] < len(blocked[0])
            if inside and not blocked[at[0]][at[1]] and at not in away:
                away[at] = away[row, column] + 1
                queue.append(at)
    return away.get(tuple(target), math.inf)


@st.composite
def models(draw, most=7, scenes=1, **fixed):
    """Draw a model of small scenes of any density, solvable or not; `fixed` are its fixed fields."""
    rows = draw(st.integers(1, most))
    columns = draw(st.integers(1 if rows > 1 else 2, most))
    blocked, starts, targets = [], [], []
    for _ in range(scenes):
        ends = st.tuples(st.integers(0, rows - 1), st.integers(0, columns - 1))
        start = draw(ends)
        target = draw(ends.filter(lambda one, start=start: one != start))
        cells = draw(st.lists(st.booleans(), min_size=rows * columns, max_size=rows * columns))
        cells = np.array(cells).reshape(rows, columns)
        cells[start] = cells[target] = False
        blocked.append(cells)
        starts.append(start)
        targets.append(target)
    fields = {
        "view": [2 * draw(st.integers(0, side)) + 1 for side in (rows, columns)],
        "steps": draw(st.integers(1, 60)),
        "uav": draw(st.sampled_from(["paper", "follow"])),
        **fixed,
    }
    return UnknownGridNavigation(
        np.array(blocked), np.array(starts), np.array(targets), np.array([rows, columns]), **fields
    )


def watch(model, choose):
    """Return the world after a walk through the scenes of a model, and the observations with their scenes."""
    looks = []

    def record(observed, rows):
        looks.append((observed, rows))
        return choose(observed, rows)

    scenes = Scenes(model.blocked, model.starts, model.targets)
    view = tuple(model.view.tolist())
    return walk_through(scenes, view, record, steps=model.steps, uav=model.uav), looks


def first_look(model):
    """Return the observation at the start of the scenes."""
    return watch(model, lambda observed, rows: np.zeros(len(rows), int))[1][0][0]
