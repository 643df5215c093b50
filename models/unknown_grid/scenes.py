"""Enumerations, fields and aspects of a model, and checks of its fields that contradict one another."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import show
from ..grid_path.model import Connectivity
from .camera import Camera
from .plan import LETTERS

__all__ = [
    "MOST", "TASKS", "Aspect", "Corners", "Hover", "Scenes", "Task", "actions_of", "aspects_of", "check_aspects",
]  # fmt: skip

#: Maximum number of cells of all maps together, of steps of all moving obstacles together, and of rows and columns
#: of a view with occlusion.
MOST, MOST_WALKED, MOST_SIGHT = 2**26, 10**6, 255


class Task(NamedTuple):
    """Task of Table V: rows and columns of the maps (global scale) and of the UAV's view (observation range)."""

    shape: tuple[int, int]
    view: tuple[int, int]

    @property
    def ratio(self) -> float:
        """Observation ratio: side of the view divided by side of the map."""
        return self.view[0] / self.shape[0]


#: Tasks of the paper, the first one first.
TASKS = (Task((17, 17), (11, 11)), Task((17, 17), (9, 9)), Task((15, 15), (9, 9)))


class Hover(StrEnum):
    """Motion of the UAV after it has seen the target."""

    #: The UAV hovers, as in the paper. The vehicle may leave the view.
    PAPER = "paper"
    #: The UAV stays above the vehicle, so the vehicle is always in the middle of the view.
    FOLLOW = "follow"


class Corners(StrEnum):
    """Diagonal steps that are allowed with eight neighbours, by the two cells beside the step."""

    FREE = "free"  #: Both cells must be free, as in :class:`~crosstrack.models.GridPath`.
    ONE = "one"  #: At least one of the cells must be free. The vehicle may cut corners.
    ANY = "any"  #: The cells do not matter. The vehicle may also pass between two obstacles.


class Aspect(StrEnum):
    """Property of a model that not every policy supports."""

    EIGHT = "eight neighbours"
    OCCLUSION = "occlusion"
    NOISE = "noisy sensing"
    MOVING = "moving obstacles"
    SEARCH = "an unknown target"


class Scenes(Protocol):
    """Fields of :class:`~crosstrack.models.unknown_grid.UnknownGridNavigation`, whose module imports those that use them."""

    @property
    def blocked(self) -> NDArray[np.bool_]: ...
    @property
    def starts(self) -> NDArray[np.int64]: ...
    @property
    def targets(self) -> NDArray[np.int64]: ...
    @property
    def shape(self) -> NDArray[np.int64]: ...
    @property
    def view(self) -> NDArray[np.int64]: ...
    @property
    def steps(self) -> int: ...
    @property
    def uav(self) -> Hover: ...
    @property
    def camera(self) -> Camera | None: ...
    @property
    def connectivity(self) -> Connectivity: ...
    @property
    def corners(self) -> Corners: ...
    @property
    def occlusion(self) -> bool: ...
    @property
    def false_obstacles(self) -> float: ...
    @property
    def missed_obstacles(self) -> float: ...
    @property
    def target_known(self) -> bool: ...
    @property
    def moving(self) -> int: ...
    @property
    def tracks(self) -> NDArray[np.int64] | None: ...
    @property
    def world_seed(self) -> int: ...


def aspects_of(model: Scenes) -> frozenset[Aspect]:
    """Return the aspects of a model, which may lack its hidden fields."""
    present = {
        Aspect.EIGHT: model.connectivity is Connectivity.EIGHT,
        Aspect.OCCLUSION: model.occlusion,
        Aspect.NOISE: max(model.false_obstacles, model.missed_obstacles) > 0,
        Aspect.MOVING: model.moving > 0,
        Aspect.SEARCH: not model.target_known,
    }
    return frozenset(aspect for aspect, here in present.items() if here)


def actions_of(model: Scenes) -> str:
    """Return the letters of the allowed actions. Waiting is the last one."""
    count = 8 if model.connectivity is Connectivity.EIGHT else 4
    return LETTERS[:count] + LETTERS[8:] * (model.moving > 0)


def check_aspects(model: Scenes) -> None:
    """Raise if the fields of neighbours, sensor and moving obstacles contradict one another or the maps."""

    def fail(field: str, allowed: str, value: Any) -> None:
        text = f"{field} must {allowed}, got {show(value)}"
        raise InvalidData(text, field=field.partition("[")[0])

    if model.connectivity is Connectivity.ANY:
        fail("connectivity", "be 4 or 8", model.connectivity.value)
    if model.corners is not Corners.FREE and model.connectivity is Connectivity.FOUR:
        fail(
            "corners",
            "be free with connectivity 4, which has no diagonal steps",
            model.corners.value,
        )
    for name in ("false_obstacles", "missed_obstacles"):
        if getattr(model, name) >= 1:
            fail(name, "be a probability below 1", getattr(model, name))
    if model.camera is not None and (names := aspects_of(model)):
        fail("camera", f"be None with {' and '.join(sorted(names))}", model.camera.rendering.value)
    if model.occlusion and model.view.max() > MOST_SIGHT:
        fail("view", f"be at most {MOST_SIGHT} cells with occlusion", model.view.tolist())
    if model.tracks is not None:
        _check_tracks(model, fail)
    if model.moving and len(model.starts) * model.moving * model.steps > MOST_WALKED:
        fail("moving", f"be at most {MOST_WALKED} / (scenes · steps)", model.moving)
    if model.moving and model.shape.prod() * model.steps > MOST:
        fail("steps", f"be at most {MOST} / cells of a map with moving obstacles", model.steps)


def _check_tracks(model: Scenes, fail: Callable[[str, str, Any], None]) -> None:
    """Raise if the tracks are not paths through free cells that begin beside the start."""
    tracks = model.tracks
    assert tracks is not None
    if not tracks.size:
        fail("tracks", "be None or have at least one cell each", tracks.tolist())
    if tracks.shape[1] != model.moving:
        fail("moving", f"be the number of tracks per scene, {tracks.shape[1]}", model.moving)
    outside = np.asarray(((tracks < 0) | (tracks >= model.shape)).any(axis=-1))
    rows, columns = np.where(outside[..., None], 0, tracks).transpose(3, 0, 1, 2)
    blocked = model.blocked[np.arange(len(model.starts))[:, None, None], rows, columns]
    far = np.zeros_like(outside)
    far[:, :, 1:] = (np.abs(np.diff(tracks, axis=2)) > 1).any(axis=-1)
    at_start = np.zeros_like(outside)
    at_start[:, :, 0] = (tracks[:, :, 0] == model.starts[:, None]).all(axis=-1)
    for bad, allowed in (
        (outside, "be on the map"), (blocked, "be free"), (far, "be a neighbour of the previous cell"),
        (at_start, "not be the start of the vehicle"),
    ):  # fmt: skip
        if bad.any():
            k, m, n = np.argwhere(bad)[0].tolist()
            fail(f"tracks[{k}][{m}][{n}]", allowed, tracks[k, m, n].tolist())
