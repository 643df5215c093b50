"""Gymnasium environment of unknown grids, for external learning libraries."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import BackendMissing, InvalidData
from ...models.fields import Flag, Whole, required, show
from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.world import (
    BLOCKED,
    FREE,
    LOOK,
    OUT_OF_STEPS,
    REACHED,
    TARGET,
    UNKNOWN,
    Looks,
    World,
)
from .memory import Memory

__all__ = ["UnknownGridEnv"]


#: Approximate side of a rendered image, pixels.
_LARGE = 512
_VEHICLE = 3
_LETTERS = {UNKNOWN: "?", FREE: ".", BLOCKED: "@", TARGET: "T", _VEHICLE: "V"}
_COLOURS = {
    UNKNOWN: (160, 160, 160),
    FREE: (255, 255, 255),
    BLOCKED: (30, 30, 30),
    TARGET: (0, 150, 80),
    _VEHICLE: (0, 90, 200),
}


class UnknownGridEnv:
    """Environment whose episodes are runs in the scenes of a model.

    The class derives from ``gymnasium.Env``, which is imported with the first instance. Actions are
    0 … 3 for up, down, left and right. The reward of a step is -1, and -2 if the last step allowed does
    not reach the target. The return of an episode is therefore minus the cost of the run in the model's
    objective. An episode is terminated at the target, and truncated if all steps are used.

    An observation is a dictionary with the following entries:

    ``map``
        Masked map, shape (rows, columns): -1 unknown, 0 free, 1 blocked, 2 target, as in
        observations of policies. Without `memory` it is the paper's O_g.
    ``view``
        Cells of the view, shape (m, n). Cells outside the map are blocked.
    ``image``
        Image that replaces ``map`` and ``view`` if the model has a camera, shape (256, 256, 3), 0 … 255.
    ``position``, ``target``
        Row and column of vehicle and target.
    ``corner``
        Row and column of the view's first cell, possibly outside the map.

    The info dictionary has the index of the ``scene``, and the ``steps`` and ``collisions`` so far.
    Observations, info and public attributes do not contain the true map.

    Parameters
    ----------
    model : UnknownGridNavigation
        Model with its true maps.
    scene : int, optional
        Scene of all episodes. None draws a scene at each reset with the generator of the environment.
    memory : bool, default True
        Whether ``map`` contains all cells seen so far, or only the current view.
    render_mode : {"ansi", "rgb_array"}, optional
        Result of :meth:`render`: text or an image. None disables it.

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

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["ansi", "rgb_array"], "render_fps": 4}
    np_random: np.random.Generator

    def __new__(cls, *_: Any, **__: Any) -> UnknownGridEnv:
        """Return an instance of the class that derives from ``gymnasium.Env``, too."""
        derived = _derived(cls)  # type: ignore[arg-type]  # classes are hashable
        instance: UnknownGridEnv = object.__new__(derived)
        return instance

    def __init__(
        self,
        model: UnknownGridNavigation,
        scene: int | None = None,
        *,
        memory: bool = True,
        render_mode: str | None = None,
    ) -> None:
        from gymnasium.spaces import Box, Dict, Discrete, MultiDiscrete

        self._model = required("model", model, UnknownGridNavigation)
        if model.is_blinded:
            raise InvalidData("model must have its true maps, got one without", field="model")
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InvalidData(
                f"render_mode must be ansi, rgb_array or None, got {show(render_mode)}",
                field="render_mode",
            )
        self.problem = model.blinded()
        self.render_mode = render_mode
        self._scene = None if scene is None else self._number(scene)
        self._all = Flag().coerce("memory", memory, {})
        self._world: World | None = None
        shape, view = model.shape, model.view
        cells: dict[str, Any]
        if model.camera is None:
            cells = {
                "map": Box(UNKNOWN, TARGET, tuple(shape.tolist()), np.int8),
                "view": Box(FREE, TARGET, tuple(view.tolist()), np.int8),
            }
        else:
            cells = {"image": Box(0, 255, (256, 256, 3), np.uint8)}
        self.action_space = Discrete(4)
        self.observation_space = Dict(
            {
                **cells,
                "position": MultiDiscrete(shape),
                "target": MultiDiscrete(shape),
                "corner": MultiDiscrete(shape, start=-(view // 2)),
            }
        )

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin an episode.

        Parameters
        ----------
        seed : int, optional
            Seed of the generator that draws scenes. None keeps the generator.
        options : mapping, optional
            ``{"scene": index}`` selects the scene of this episode.

        Returns
        -------
        observation : dict
            First observation.
        info : dict
            Index of the scene, steps and collisions.

        Raises
        ------
        InvalidData
            An option is unknown, or the scene is out of range.
        """
        model = self._model
        super().reset(seed=seed, options=options)  # type: ignore[misc]  # gymnasium.Env's
        options = dict(options or {})
        scene = options.pop("scene", self._scene)
        if options:
            raise InvalidData(
                f"unknown option {show(next(iter(options)))}; allowed: scene", field="options"
            )
        if scene is None:
            scene = self.np_random.integers(model.scenes)
        self._now = self._number(scene)
        self._world = World(model)
        self._steps = 0
        self._memory = Memory(model.shape, model.view, model.targets[[self._now]])
        self._map = np.full(tuple(model.shape), UNKNOWN, np.int8)
        self._look(LOOK)
        return self._observation(), self._info()

    def step(
        self, action: int | np.integer[Any]
    ) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Execute an action.

        Parameters
        ----------
        action : int
            0 up, 1 down, 2 left, 3 right.

        Returns
        -------
        observation : dict
            Observation after the step.
        reward : float
            -1, or -2 if the last step allowed does not reach the target.
        terminated, truncated : bool
            True if the vehicle has reached the target, or all steps are used.
        info : dict
            Index of the scene, steps and collisions.

        Raises
        ------
        InvalidData
            The action is invalid, or no episode is active.
        """
        if self._world is None:
            raise InvalidData("reset must begin an episode before its first step", field="action")
        self._look(Whole(0, 3).coerce("action", action, {}))
        self._steps += 1
        terminated, truncated = self._state == REACHED, self._state == OUT_OF_STEPS
        return self._observation(), -1.0 - truncated, terminated, truncated, self._info()

    def render(self) -> str | NDArray[np.uint8] | None:
        """Return the known map as text, or as an image of uint8; None without a mode or an episode."""
        if self.render_mode is None or self._world is None:
            return None
        if self.render_mode == "rgb_array" and self.problem.camera is not None:
            return self._image()
        known = self._map.copy()
        known[tuple(self.problem.targets[self._now])] = TARGET
        known[tuple(self._looks.positions[0])] = _VEHICLE
        if self.render_mode == "ansi":
            return "\n".join("".join(_LETTERS[cell] for cell in row) for row in known.tolist())
        colours = np.array([_COLOURS[k - 1] for k in range(len(_COLOURS))], np.uint8)
        side = max(_LARGE // max(known.shape), 1)
        drawn: NDArray[np.uint8] = colours[known + 1].repeat(side, axis=0).repeat(side, axis=1)
        return drawn

    def _number(self, scene: Any) -> int:
        return int(Whole(0, self._model.scenes - 1).coerce("scene", scene, {}))

    def _look(self, action: int) -> None:
        """Execute an action in the simulator and store the observation."""
        assert self._world is not None
        answers = self._world(np.array([[self._now, action]], float))
        self._looks = Looks.read(self.problem, np.array([self._now]), answers)
        if self.problem.camera is None:
            row = np.zeros(1, np.int64)
            if action != LOOK:
                self._memory.act(row, np.array([action]))
            known = self._memory.look(row, *self._looks[1:3], self._looks.view)
            self._map = (known.known if self._all else known.current)[0]

    @property
    def _state(self) -> int:
        return int(self._looks.states[0])

    def _image(self) -> NDArray[np.uint8]:
        image: NDArray[np.uint8] = np.rint(255 * self._looks.view[0]).astype(np.uint8)
        return image

    def _observation(self) -> dict[str, Any]:
        if self.problem.camera is None:
            cells = {"map": self._map.copy(), "view": self._looks.view[0].astype(np.int8)}
        else:
            cells = {"image": self._image()}
        return {
            **cells,
            "position": self._looks.positions[0].copy(),
            "target": self.problem.targets[self._now].copy(),
            "corner": self._looks.corners[0].copy(),
        }

    def _info(self) -> dict[str, Any]:
        collisions = int(self._looks.collisions[0])
        return {"scene": self._now, "steps": self._steps, "collisions": collisions}


@cache
def _derived(cls: type[UnknownGridEnv]) -> type[UnknownGridEnv]:
    """Return a subclass of `cls` and ``gymnasium.Env``, so that the module loads without Gymnasium."""
    try:
        from gymnasium import Env
    except ImportError as error:
        raise BackendMissing(
            "UnknownGridEnv needs gymnasium: pip install 'crosstrack[learn]'"
        ) from error
    if issubclass(cls, Env):
        return cls
    derived: type[UnknownGridEnv] = type(
        cls.__name__, (cls, Env), {"__doc__": cls.__doc__, "__module__": cls.__module__}
    )
    return derived
