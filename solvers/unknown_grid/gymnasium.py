"""Unknown grids as an environment of Gymnasium, for learners from elsewhere."""

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

Ints = NDArray[np.int64]

#: Sides of a picture's cells are such that it is about as large, pixels.
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
    """The scenes of a model as an environment: each episode leads the vehicle through one of them.

    It derives from ``gymnasium.Env``, which is loaded where the first one is made. Actions are 0 … 3 for
    up, down, left and right. A step costs 1, and 1 more where it is the last one allowed and does not
    reach the target; so an episode's return is minus what the run costs in the model's objective. At the
    target an episode is terminated, and truncated where the steps are used up.

    An observation is a dictionary of

    ``map``
        The masked map, shape (rows, columns): -1 unknown, 0 free, 1 blocked, 2 the target, as
        :class:`~.memory.Observation` has it; of the current view alone, it is the paper's O_g.
    ``view``
        The cells that the UAV shows, shape (m, n); what lies off the map is blocked.
    ``image``
        In place of these two where the model has a camera: shape (256, 256, 3), 0 … 255.
    ``position``, ``target``
        Row and column of vehicle and target.
    ``corner``
        Row and column of the view's first cell, which may lie off the map.

    What else is returned says the number of the ``scene``, and the ``steps`` and ``collisions`` so far. The
    true map is nowhere in it, nor in a public attribute.

    Parameters
    ----------
    model : UnknownGridNavigation
        With its true maps.
    scene : int, optional
        The scene of all episodes; None draws one at each reset, from the seed of the resets.
    memory : bool
        Whether ``map`` keeps what was seen before; else it holds the current view alone.
    render_mode : {"ansi", "rgb_array"}, optional
        What :meth:`render` returns: text, or an image.

    Attributes
    ----------
    problem : UnknownGridNavigation
        The model without its true maps.

    Raises
    ------
    BackendMissing
        Gymnasium is not installed: ``pip install 'crosstrack[learn]'``.
    InvalidData
        Naming argument and value.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["ansi", "rgb_array"], "render_fps": 4}
    np_random: np.random.Generator

    def __new__(cls, *_: Any, **__: Any) -> UnknownGridEnv:
        """Return an instance of the class that derives from Gymnasium's too."""
        found: UnknownGridEnv = object.__new__(_derived(cls))  # type: ignore[arg-type]  # hashable it is
        return found

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
        seen: dict[str, Any]
        if model.camera is None:
            seen = {
                "map": Box(UNKNOWN, TARGET, tuple(shape.tolist()), np.int8),
                "view": Box(FREE, TARGET, tuple(view.tolist()), np.int8),
            }
        else:
            seen = {"image": Box(0, 255, (256, 256, 3), np.uint8)}
        self.action_space = Discrete(4)
        self.observation_space = Dict(
            {
                **seen,
                "position": MultiDiscrete(shape),
                "target": MultiDiscrete(shape),
                "corner": MultiDiscrete(shape, start=-(view // 2)),
            }
        )

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin an episode, and return the first observation and what else is known.

        Parameters
        ----------
        seed : int, optional
            Of the draws of scenes from now on.
        options : mapping, optional
            ``{"scene": number}`` for the scene of this episode.

        Raises
        ------
        InvalidData
            Another option, or no such scene.
        """
        model = self._model
        super().reset(seed=seed, options=options)  # type: ignore[misc]  # gymnasium.Env's
        options = dict(options or {})
        asked = options.pop("scene", self._scene)
        if options:
            raise InvalidData(
                f"unknown option {show(next(iter(options)))}; allowed: scene", field="options"
            )
        if asked is None:
            asked = self.np_random.integers(model.scenes)
        self._now = self._number(asked)
        self._world = World(model)
        self._steps = 0
        self._memory = Memory(model.shape, model.view, model.targets[[self._now]])
        self._map = np.full(tuple(model.shape), UNKNOWN, np.int8)
        self._look(LOOK)
        return self._observation(), self._info()

    def step(
        self, action: int | np.integer[Any]
    ) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Take a step; return observation, reward, terminated, truncated and what else is known.

        Raises
        ------
        InvalidData
            No action, or no episode that goes on.
        """
        if self._world is None:
            raise InvalidData("reset must begin an episode before its first step", field="action")
        self._look(Whole(0, 3).coerce("action", action, {}))
        self._steps += 1
        terminated, truncated = self._state == REACHED, self._state == OUT_OF_STEPS
        return self._observation(), -1.0 - truncated, terminated, truncated, self._info()

    def render(self) -> str | NDArray[np.uint8] | None:
        """Return what is known, as text or as an image; None without a mode."""
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
        """Ask the world, and note what it answers."""
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
            seen = {"map": self._map.copy(), "view": self._looks.view[0].astype(np.int8)}
        else:
            seen = {"image": self._image()}
        return {
            **seen,
            "position": self._looks.positions[0].copy(),
            "target": self.problem.targets[self._now].copy(),
            "corner": self._looks.corners[0].copy(),
        }

    def _info(self) -> dict[str, Any]:
        collisions = int(self._looks.collisions[0])
        return {"scene": self._now, "steps": self._steps, "collisions": collisions}


@cache
def _derived(cls: type[UnknownGridEnv]) -> type[UnknownGridEnv]:
    """Return `cls` as a subclass of ``gymnasium.Env``; made here, so that the module loads without."""
    try:
        from gymnasium import Env
    except ImportError as error:
        raise BackendMissing(
            "UnknownGridEnv needs gymnasium: pip install 'crosstrack[learn]'"
        ) from error
    if issubclass(cls, Env):
        return cls
    made: type[UnknownGridEnv] = type(
        cls.__name__, (cls, Env), {"__doc__": cls.__doc__, "__module__": cls.__module__}
    )
    return made
