"""Base of the policies: the loop of observations and decisions."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from ...jit import OutOfTime, clock
from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.plan import LETTERS, NavigationRuns, Outcome
from ...models.unknown_grid.scenes import Aspect, aspects_of
from ...models.unknown_grid.world import BLOCKED, FREE, GOING, LOOK, REACHED, TARGET, Looks
from ..contract.backend import Answer, Backend, Feature, Guarantee, Request, Termination
from ..contract.enums import Limit
from ..contract.option import Option

__all__ = ["GIVE_UP", "MOST_TOGETHER", "NO_WAY", "PERCEPTION", "NavigationBackend", "Policy"]

Ints = NDArray[np.int64]

#: Decisions of a policy in addition to the actions.
NO_WAY, GIVE_UP = -1, -2
_ENDS = {NO_WAY: Outcome.NO_WAY, GIVE_UP: Outcome.GAVE_UP}

#: Largest number of scenes per batch, and of cells of their maps. A cell takes up to 46 bytes.
MOST_TOGETHER, _MOST_CELLS = 2**20, 2**22

#: Options of all policies for models with a camera.
PERCEPTION: Mapping[str, Option] = {
    "perception": Option(
        "k-means",
        "how cells are read from the camera's images: k-means (of colours) or gmgn (learned)",
        str,
        ("k-means", "gmgn"),
    ),
    "perception_weights": Option(
        None,
        "a file of weights for gmgn from 'crosstrack train'; those that are shipped",
        str,
        file=True,
    ),
}


class Policy(Protocol):
    """Policy of a batch of scenes, with its own memory of each scene."""

    def decide(self, looks: Looks) -> Ints:
        """Return an action, :data:`NO_WAY` or :data:`GIVE_UP` for each active scene.

        The actions are 0 … 3, those of :data:`~crosstrack.models.unknown_grid.plan.MOVES` with further aspects.

        Parameters
        ----------
        looks : Looks
            Observations of the active scenes, in ascending order. ``looks.view`` holds cells, shape (n, m,
            n').
        """


class NavigationBackend(Backend):
    """Base of the policies. A subclass implements :meth:`policy`."""

    accepts = UnknownGridNavigation
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.INTERRUPT})
    deterministic = True
    single_threaded = True
    shares_process = True
    options = PERCEPTION
    #: Largest number of scenes per batch of decisions; on large maps batches are smaller.
    together: ClassVar[int] = 1
    #: Aspects of models that the policy supports.
    supports: ClassVar[frozenset[Aspect]] = frozenset()

    def refuses(self, problem: UnknownGridNavigation) -> str:
        """Return the aspects of the model that the policy does not support, or ``""``."""
        return " and ".join(sorted(aspects_of(problem) - self.supports))

    @abstractmethod
    def policy(self, problem: UnknownGridNavigation, scenes: Ints, request: Request) -> Policy:
        """Return the policy of `scenes`. The problem has no true maps."""

    def run(self, problem: UnknownGridNavigation, request: Request) -> Answer:
        """Run the policy in all scenes and return the actions."""
        self.require_support(problem)
        begin = clock()
        run = _Run(problem, request)
        together = min(self.together, max(_MOST_CELLS // int(problem.shape.prod()), 1))
        limit = None
        try:
            for first in range(0, problem.scenes, together):
                scenes = np.arange(first, min(first + together, problem.scenes))
                run.lead(self.policy(problem, scenes, request), scenes)
                if request.control.stopped:
                    break
        except OutOfTime:  # during a decision or a question
            limit = Limit.TIME
        plan = NavigationRuns(tuple(map("".join, run.actions)), tuple(run.outcomes))
        seconds = {"solve": clock() - begin}
        lost = problem.scenes - run.outcomes.count(Outcome.REACHED)
        message = f"target not reached in {lost} of {problem.scenes} scenes" if lost else ""
        statistics = {
            "success %": round(plan.success, 6),
            "collisions": run.collisions,
            "decisions": run.decisions,
            "ms a decision": 1e3 * run.thinking / max(run.decisions, 1),
        }
        if problem.camera is not None:
            statistics["ms an image"] = 1e3 * run.perceiving / max(run.images, 1)
        return Answer(
            Termination.FEASIBLE,
            request.control.limit or limit,
            plan,
            None,
            seconds=seconds,
            statistics=statistics,
            message=message,
        )


class _Run:
    """Actions, outcomes and counters of a pass through all scenes."""

    def __init__(self, problem: UnknownGridNavigation, request: Request) -> None:
        self.problem, self.request = problem, request
        self.actions: list[list[str]] = [[] for _ in range(problem.scenes)]
        self.outcomes = [Outcome.GAVE_UP] * problem.scenes
        self.collisions = self.decisions = self.images = 0
        self.thinking = self.perceiving = 0.0

    def lead(self, policy: Policy, scenes: Ints) -> None:
        """Apply `policy` until all of `scenes` have ended or the run is stopped."""
        chosen = np.full(len(scenes), LOOK)
        while len(scenes) and not self.request.control.stopped:
            try:
                looks = self._look(scenes, chosen)
            except OutOfTime:
                self._discard(scenes)
                raise
            going = looks.states == GOING
            if not going.all():
                for row in np.flatnonzero(~going).tolist():
                    reached = looks.states[row] == REACHED
                    ended = Outcome.REACHED if reached else Outcome.OUT_OF_STEPS
                    self._end(int(scenes[row]), ended, int(looks.collisions[row]))
                scenes, looks = scenes[going], _part(looks, going)
                if not len(scenes):
                    return
            looks = self._perceived(looks)
            begin = clock()
            chosen = np.asarray(policy.decide(looks), np.int64)
            self.thinking += clock() - begin
            self.decisions += len(scenes)
            acts = chosen >= 0
            if not acts.all():
                for row in np.flatnonzero(~acts).tolist():
                    ended = _ENDS[int(chosen[row])]
                    self._end(int(scenes[row]), ended, int(looks.collisions[row]))
                scenes, chosen = scenes[acts], chosen[acts]
            for scene, action in zip(scenes.tolist(), chosen.tolist(), strict=True):
                self.actions[scene].append(LETTERS[action])
        if self.request.control.stopped:
            self._discard(scenes)

    def _discard(self, scenes: Ints) -> None:
        """Remove the last actions of `scenes`, which were not executed."""
        for scene in scenes.tolist():
            del self.actions[scene][-1:]

    def _look(self, scenes: Ints, chosen: Ints) -> Looks:
        questions = np.empty((len(scenes), 2))
        questions[:, 0], questions[:, 1] = scenes, chosen
        return Looks.read(self.problem, scenes, self.request.control.ask(questions))

    def _end(self, scene: int, outcome: Outcome, collisions: int) -> None:
        self.outcomes[scene] = outcome
        self.collisions += collisions

    def _perceived(self, looks: Looks) -> Looks:
        """Return the looks with cells in place of images."""
        if self.problem.camera is None:
            return looks
        from .perception import perceive

        begin = clock()
        method, weights = (self.request.options[k] for k in PERCEPTION)
        size = (int(self.problem.view[0]), int(self.problem.view[1]))
        cells = np.where(perceive(looks.view, size, method, weights), BLOCKED, FREE).astype(float)
        self.perceiving += clock() - begin
        self.images += len(cells)
        # The cells of the vehicle and of the target are known to be free.
        for row, scene in enumerate(looks.scenes.tolist()):
            for cell, value in (
                (looks.positions[row], FREE),
                (self.problem.targets[scene], TARGET),
            ):
                place = cell - looks.corners[row]
                if (place >= 0).all() and (place < self.problem.view).all():
                    cells[row, place[0], place[1]] = value
        return looks._replace(view=cells)


def _part(looks: Looks, rows: NDArray[np.bool_]) -> Looks:
    return Looks._make(array[rows] for array in looks)
