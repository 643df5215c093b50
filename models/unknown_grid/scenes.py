"""What the simulator and the checks read of a model."""

from __future__ import annotations

from enum import StrEnum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .camera import Camera

__all__ = ["Hover", "Scenes"]


class Hover(StrEnum):
    """What the UAV does once it has seen the target."""

    PAPER = "paper"  #: it stays where it is
    FOLLOW = "follow"  #: it goes on above the vehicle, which is better


class Scenes(Protocol):
    """The fields of :class:`~crosstrack.models.unknown_grid.UnknownGridNavigation`, which explains them."""

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
