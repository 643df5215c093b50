"""Policy with predefined actions, and an independent simulator in plain Python."""

import sys
import types

import numpy as np

from crosstrack.models.unknown_grid import World
from crosstrack.solvers import Control, Request
from crosstrack.solvers.unknown_grid.native import NavigationBackend

#: Change of row and column per action.
MOVES = ((-1, 0), (1, 0), (0, -1), (0, 1))


def request_for(model, backend):
    """Return a request of a run in this process with a separate world."""
    return Request(options=backend.checked_options({}), control=Control(oracle=World(model)))


def show_noise(monkeypatch):
    """Replace images by noise that differs between observations."""
    drawing = types.ModuleType("rendering")
    drawing.render = lambda *scene: np.random.default_rng(scene[-1]).random((256, 256, 3))
    monkeypatch.setitem(sys.modules, "crosstrack.models.unknown_grid.rendering", drawing)


class Told(NavigationBackend):
    """Policy with one predefined sequence of actions per scene, which gives up afterwards."""

    name = "told"
    summary = "what it was told"

    def __init__(self, *runs, last=-2):
        self.runs, self.last = [list(one) for one in runs], last
        self.looks = []

    def policy(self, problem, scenes, request):
        return self

    def decide(self, looks):
        self.looks.append(looks)
        return [self._next(self.runs[scene]) for scene in looks.scenes]

    def _next(self, left):
        return "UDLR".index(left.pop(0)) if left else self.last


class PlainWorld:
    """Independent simulator of one scene, cell by cell."""

    def __init__(self, model, scene):
        self.map = model.blocked[scene].tolist()
        self.at = tuple(model.starts[scene].tolist())
        self.target = tuple(model.targets[scene].tolist())
        self.view, self.steps, self.stays = (
            tuple(model.view.tolist()),
            model.steps,
            model.uav == "paper",
        )
        self.centre, self.hit, self.taken, self.fixed = self.at, 0, 0, False
        self._watch()

    def _free(self, row, column):
        inside = 0 <= row < len(self.map) and 0 <= column < len(self.map[0])
        return inside and not self.map[row][column]

    def corner(self):
        return self.centre[0] - self.view[0] // 2, self.centre[1] - self.view[1] // 2

    def _watch(self):
        if not self.fixed:
            self.centre = self.at
            self.fixed = self.stays and any(2 in row for row in self.shown())

    def state(self):
        return 1 if self.at == self.target else 2 if self.taken >= self.steps else 0

    def act(self, action):
        to = self.at[0] + MOVES[action][0], self.at[1] + MOVES[action][1]
        self.taken += 1
        if self._free(*to):
            self.at = to
            self._watch()
        else:
            self.hit += 1

    def shown(self):
        top, left = self.corner()
        return [
            [
                2 if (r, c) == self.target else 0 if self._free(r, c) else 1
                for c in range(left, left + self.view[1])
            ]
            for r in range(top, top + self.view[0])
        ]
