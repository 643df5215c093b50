"""Gymnasium environment of unknown grids, for external learning libraries."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.fields import Whole, show
from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.world import BLOCKED, FREE, OUT_OF_STEPS, REACHED, TARGET, UNKNOWN
from .vector import Episodes, derived, scene_of

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
        kind = derived(cls, "", "Env")  # type: ignore[arg-type]  # classes are hashable
        instance: UnknownGridEnv = object.__new__(kind)
        return instance

    def __init__(
        self,
        model: UnknownGridNavigation,
        scene: int | None = None,
        *,
        memory: bool = True,
        render_mode: str | None = None,
    ) -> None:
        from gymnasium.spaces import Discrete

        self._episodes = Episodes(model, 1, memory)
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InvalidData(
                f"render_mode must be ansi, rgb_array or None, got {show(render_mode)}",
                field="render_mode",
            )
        self.problem = self._episodes.problem
        self.render_mode = render_mode
        self._scene = None if scene is None else self._episodes.checked_scene(scene)
        self._row = np.zeros(1, np.int64)
        self._is_reset = False
        self.action_space = Discrete(4)
        self.observation_space = self._episodes.space()

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
        super().reset(seed=seed, options=options)  # type: ignore[misc]  # gymnasium.Env's
        scene = scene_of(options, self._scene)
        if scene is None:
            scene = self.np_random.integers(self.problem.scenes)
        self._episodes.begin(self._row, np.array([self._episodes.checked_scene(scene)]))
        self._is_reset = True
        return self._episodes.observation(0), self._info()

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
        if not self._is_reset:
            raise InvalidData("reset must begin an episode before its first step", field="action")
        move = Whole(0, 3).coerce("action", action, {})
        self._episodes.step(self._row, np.array([move]))
        state = self._episodes.states[0]
        terminated, truncated = bool(state == REACHED), bool(state == OUT_OF_STEPS)
        return self._episodes.observation(0), -1.0 - truncated, terminated, truncated, self._info()

    def render(self) -> str | NDArray[np.uint8] | None:
        """Return the known map as text, or as an image of uint8; None without a mode or an episode."""
        if self.render_mode is None or not self._is_reset:
            return None
        seen = self._episodes.observation(0)
        if self.render_mode == "rgb_array" and "image" in seen:
            image: NDArray[np.uint8] = seen["image"]
            return image
        known = seen.get("map", np.full(tuple(self.problem.shape), UNKNOWN))
        known[tuple(seen["target"])] = TARGET
        known[tuple(seen["position"])] = _VEHICLE
        if self.render_mode == "ansi":
            return "\n".join("".join(_LETTERS[cell] for cell in row) for row in known.tolist())
        colours = np.array([_COLOURS[k - 1] for k in range(len(_COLOURS))], np.uint8)
        side = max(_LARGE // max(known.shape), 1)
        drawn: NDArray[np.uint8] = colours[known + 1].repeat(side, axis=0).repeat(side, axis=1)
        return drawn

    def _info(self) -> dict[str, Any]:
        return {name: int(values[0]) for name, values in self._episodes.info.items()}
