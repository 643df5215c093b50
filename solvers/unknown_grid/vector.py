"""Vectorised Gymnasium environment of unknown grids: many episodes on the arrays of the simulator."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import BackendMissing, InvalidData
from ...models.fields import Array, Flag, Whole, required, show
from ...models.unknown_grid.camera import PIXELS
from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.scenes import aspects_of
from ...models.unknown_grid.world import (
    FREE,
    GOING,
    LOOK,
    OUT_OF_STEPS,
    REACHED,
    TARGET,
    UNKNOWN,
    Looks,
    World,
)
from .memory import Memory

__all__ = ["Episodes", "UnknownGridVectorEnv", "derived", "scene_of"]

Ints = NDArray[np.int64]


class Episodes:
    """Episodes of `size` environments in the scenes of a model, with their latest observations.

    Attributes
    ----------
    states : ndarray of int, shape (size,)
        State of each episode.
    info : dict
        Scene, number of steps and number of collisions of each episode.
    seen : dict
        Observations, one row per environment, see :class:`~.gymnasium.UnknownGridEnv`.
    """

    def __init__(self, model: UnknownGridNavigation, size: int, memory: bool) -> None:
        self._model = required("model", model, UnknownGridNavigation)
        if model.is_blinded:
            raise InvalidData("model must have its true maps, got one without", field="model")
        if aspects := aspects_of(model):
            names = " and ".join(sorted(aspects))
            raise InvalidData(f"model must have no {names} in an environment", field="model")
        self.problem = model.blinded()
        self._remembers = Flag().coerce("memory", memory, {})
        self.states = np.full(size, GOING)
        self.info = {name: np.zeros(size, np.int64) for name in ("scene", "steps", "collisions")}
        self._world = World(model, self.info["scene"])
        places = {name: np.zeros((size, 2), np.int64) for name in ("position", "target", "corner")}
        cells = {
            "map": np.full((size, *model.shape), UNKNOWN, np.int8),
            "view": np.zeros((size, *model.view), np.int8),
        }
        images = {"image": np.zeros((size, PIXELS, PIXELS, 3), np.uint8)}
        self.seen = {**(cells if model.camera is None else images), **places}
        self._memory = Memory(model.shape, model.view, self.seen["target"])

    def checked_scene(self, value: Any) -> int:
        """Return a valid index of a scene."""
        return int(Whole(0, self._model.scenes - 1).coerce("scene", value, {}))

    def begin(self, rows: Ints, scenes: Ints) -> None:
        """Begin episodes of the environments `rows` and observe."""
        self.info["scene"][rows] = scenes
        self._world.restart(rows)
        self.info["steps"][rows] = 0
        self.seen["target"][rows] = self.problem.targets[scenes]
        self._memory.restart(rows)
        self.step(rows, np.full(len(rows), LOOK))

    def step(self, rows: Ints, actions: Ints) -> None:
        """Execute the actions of the environments `rows`, in ascending order, and observe."""
        questions = np.stack([rows, actions], axis=1).astype(float)
        looks = Looks.read(self.problem, rows, self._world(questions))
        self.info["steps"][rows] += actions != LOOK
        self.states[rows], self.info["collisions"][rows] = looks.states, looks.collisions
        self.seen["position"][rows] = looks.positions
        self.seen["corner"][rows] = looks.corners
        if self.problem.camera is not None:
            self.seen["image"][rows] = np.rint(255 * looks.view)
            return
        self.seen["view"][rows] = looks.view
        self._memory.act(rows, actions)
        known = self._memory.look(rows, looks.positions, looks.corners, looks.view)
        self.seen["map"][rows] = known.known if self._remembers else known.current

    def observation(self, row: Any = ...) -> dict[str, Any]:
        """Return a copy of the observations of one environment, or of all."""
        return {name: array[row].copy() for name, array in self.seen.items()}

    def space(self) -> Any:
        """Return Gymnasium's space of the observations of one environment."""
        from gymnasium.spaces import Box, Dict, MultiDiscrete

        shape, view = self.problem.shape, self.problem.view
        limits = {"map": (UNKNOWN, TARGET), "view": (FREE, TARGET), "image": (0, 255)}
        boxes = {
            name: Box(*limits[name], array.shape[1:], array.dtype.type)
            for name, array in self.seen.items()
            if name in limits
        }
        corner = MultiDiscrete(shape, start=-(view // 2))
        return Dict(
            {**boxes, "position": MultiDiscrete(shape), "target": MultiDiscrete(shape), "corner": corner}
        )  # fmt: skip


class UnknownGridVectorEnv:
    """Vectorised environment: `num_envs` episodes in the scenes of a model, all advanced by one call.

    The class derives from ``gymnasium.vector.VectorEnv``, which is imported with the first instance. Actions,
    rewards, observations and info are those of :class:`~.gymnasium.UnknownGridEnv`, with one row per environment.
    With equal seeds, all values equal those of a ``SyncVectorEnv`` of such environments.

    Parameters
    ----------
    model : UnknownGridNavigation
        Model with its true maps.
    num_envs : int, default 1
        Number of environments.
    scene : int, optional
        Scene of all episodes. None draws a scene for each episode with the generator of its environment.
    memory : bool, default True
        Whether ``map`` contains all cells seen so far, or only the current view.
    autoreset_mode : {"NextStep", "SameStep"}, default "NextStep"
        Gymnasium's mode after the end of an episode. The next step begins a new episode and ignores the
        action, or the same step does, and info contains ``final_obs`` and ``final_info``.

    Attributes
    ----------
    problem : UnknownGridNavigation
        Model without its true maps.

    Raises
    ------
    BackendMissing
        Gymnasium is not installed: ``pip install 'crosstrack[learn]'``.
    InvalidData
        An argument is invalid. The message names argument and value.
    """

    def __new__(cls, *_: Any, **__: Any) -> UnknownGridVectorEnv:
        """Return an instance of the class that derives from ``gymnasium.vector.VectorEnv``, too."""
        kind = derived(cls, "vector", "VectorEnv")  # type: ignore[arg-type]  # classes are hashable
        instance: UnknownGridVectorEnv = object.__new__(kind)
        return instance

    def __init__(
        self,
        model: UnknownGridNavigation,
        num_envs: int = 1,
        scene: int | None = None,
        *,
        memory: bool = True,
        autoreset_mode: str = "NextStep",
    ) -> None:
        from gymnasium.spaces import Discrete
        from gymnasium.vector import AutoresetMode
        from gymnasium.vector.utils import batch_space

        self.num_envs = Whole(1, 10**6).coerce("num_envs", num_envs, {})
        self._episodes = Episodes(model, self.num_envs, memory)
        self.problem = self._episodes.problem
        self._scene = None if scene is None else self._episodes.checked_scene(scene)
        modes = {mode.value: mode for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP)}
        mode = getattr(autoreset_mode, "value", autoreset_mode)
        if mode not in modes:
            raise InvalidData(
                f"autoreset_mode must be NextStep or SameStep, got {show(autoreset_mode)}",
                field="autoreset_mode",
            )
        self._same = modes[mode] is AutoresetMode.SAME_STEP
        self.metadata = {"autoreset_mode": modes[mode], "render_modes": []}
        self.single_observation_space, self.single_action_space = (
            self._episodes.space(),
            Discrete(4),
        )
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._rows = np.arange(self.num_envs)
        self._generators: list[np.random.Generator] = []
        self._ended = np.zeros(self.num_envs, bool)

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: Mapping[str, Any] | None = None,
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin an episode in each environment and return the first observations and info.

        Parameters
        ----------
        seed : int or list of int, optional
            Seed of the generator of each environment, or that of the first one, increased by one for each
            further environment. None keeps the generators.
        options : mapping, optional
            ``{"scene": index}`` selects the scene of these episodes.

        Raises
        ------
        InvalidData
            An option is unknown, the scene is out of range, or the number of seeds is wrong.
        """
        from gymnasium.utils.seeding import np_random

        seeds = seed if isinstance(seed, list) else [
            None if seed is None else seed + k for k in self._rows.tolist()
        ]  # fmt: skip
        if len(seeds) != self.num_envs:
            raise InvalidData(
                f"seed must have {self.num_envs} entries, got {len(seeds)}", field="seed"
            )
        former = self._generators
        self._generators = [
            former[row] if former and one is None else np_random(one)[0]
            for row, one in enumerate(seeds)
        ]
        self._begin(self._rows, scene_of(options, self._scene))
        self._ended[:] = False
        return self._episodes.observation(), self._info(self._rows)

    def step(
        self, actions: ArrayLike
    ) -> tuple[dict[str, Any], NDArray[np.float64], Any, Any, dict[str, Any]]:
        """Execute one action in each environment.

        Parameters
        ----------
        actions : array_like of int, shape (num_envs,)
            0 up, 1 down, 2 left, 3 right.

        Returns
        -------
        observations, rewards, terminations, truncations, info
            As of :meth:`.UnknownGridEnv.step`, one row per environment. The reward of a step that begins an
            episode is 0. In the mode ``SameStep`` info has the final observations of ended episodes.

        Raises
        ------
        InvalidData
            An action is invalid, or :meth:`reset` was not called.
        """
        if not self._generators:
            raise InvalidData("reset must begin episodes before their first step", field="actions")
        episodes, begun = self._episodes, self._ended
        moves = Array((self.num_envs,), int, lower=0, upper=3).coerce("actions", actions, {})
        if begun.any():
            self._begin(self._rows[begun], self._scene)
        going = self._rows[~begun]
        episodes.step(going, moves[going])
        terminated, truncated = episodes.states == REACHED, episodes.states == OUT_OF_STEPS
        rewards = np.where(begun, 0.0, -1.0 - truncated)
        self._ended = terminated | truncated
        info: dict[str, Any] = {}
        if self._same and self._ended.any():
            rows = self._rows[self._ended]
            final = np.full(self.num_envs, None, object)
            final[rows] = [episodes.observation(row) for row in rows.tolist()]
            info = {"final_obs": final, "final_info": self._info(rows)}
            info |= {f"_{name}": self._ended for name in info}
            self._ended = np.zeros(self.num_envs, bool)
            self._begin(rows, self._scene)
        return (
            self._episodes.observation(),
            rewards,
            terminated,
            truncated,
            info | self._info(self._rows),
        )

    def _begin(self, rows: Ints, scene: Any) -> None:
        count = self.problem.scenes
        scenes = [self._generators[row].integers(count) if scene is None else self._episodes.checked_scene(scene)
                  for row in rows.tolist()]  # fmt: skip
        self._episodes.begin(rows, np.array(scenes))

    def _info(self, rows: Ints) -> dict[str, Any]:
        """Return the info of the environments `rows` and the masks of these rows, as Gymnasium does."""
        mask = np.zeros(self.num_envs, bool)
        mask[rows] = True
        info = {name: np.where(mask, value, 0) for name, value in self._episodes.info.items()}
        return info | {f"_{name}": mask.copy() for name in info}


def scene_of(options: Mapping[str, Any] | None, default: Any) -> Any:
    """Return the scene in the options of a reset, or the default; raise for other options."""
    given = dict(options or {})
    scene = given.pop("scene", default)
    if given:
        raise InvalidData(
            f"unknown option {show(next(iter(given)))}; allowed: scene", field="options"
        )
    return scene


@cache
def derived(cls: type, module: str, name: str) -> type:
    """Return a subclass of `cls` and a class of Gymnasium, so that the module loads without Gymnasium."""
    try:
        base = getattr(import_module(f"gymnasium.{module}" if module else "gymnasium"), name)
    except ImportError as error:
        raise BackendMissing(
            f"{cls.__name__} needs gymnasium: pip install 'crosstrack[learn]'"
        ) from error
    if issubclass(cls, base):
        return cls
    return type(cls.__name__, (cls, base), {"__doc__": cls.__doc__, "__module__": cls.__module__})
