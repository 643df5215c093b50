"""Interface of a model that the simulator and the checks use."""

from __future__ import annotations

from enum import StrEnum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .camera import Camera

__all__ = ["Hover", "Scenes"]


class Hover(StrEnum):
    """Motion of the UAV after it has seen the target."""

    #: The UAV hovers, as in the paper. The vehicle may leave the view.
    PAPER = "paper"
    #: The UAV stays above the vehicle, so the vehicle is always in the middle of the view.
    FOLLOW = "follow"


class Scenes(Protocol):
    """Fields of :class:`~crosstrack.models.unknown_grid.UnknownGridNavigation`."""

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
