"""Shortest path of a robot on a grid map.

Source: sections 2 and 3.2 of "Parallel Swarm Intelligent Motion Planning with Energy-Balanced for
Multirobot in Obstacle Environment", Wireless Communications and Mobile Computing, 2021.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..declaration import Nested
from ..fields import Array, Optional, declared, show
from ..inputs import Field, FloatsOrNone, Numbers
from ..model import Model
from ..records import Member
from ..verification import TOLERANCE, Verification
from .checks import verify_paths
from .gridmap import GridMap
from .plan import GridPlan

__all__ = ["Connectivity", "GridPath", "Reach"]


class Connectivity(StrEnum):
    """Steps that a path may take."""

    FOUR = "4"  #: Steps lead to the four neighbours, as in the paper.
    #: Steps may also be diagonal if both cells beside the corner are free. Paths are shorter.
    EIGHT = "8"
    #: Segments may have any direction within the free cells. Paths are the shortest of the three.
    ANY = "any"


class Reach(StrEnum):
    """Goals that a plan must reach."""

    NEAREST = "nearest"  #: The plan has one path, to the goal with the lowest cost.
    EACH = "each"  #: The plan has one path per goal, in the order of the goals.


class Goals(Array):
    """Field of cells that also accepts a single cell."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> NDArray[Any]:
        cells = self._numbers(name, value)
        return super().coerce(name, cells[None] if cells.ndim == 1 and cells.size else cells, sizes)


@dataclass(frozen=True, eq=False, repr=False)
class GridPath(Model[GridPlan]):
    """Shortest path from a cell of a map to one or more goals.

    With connectivity "4" or "8", a path connects the centres of neighbouring cells. A diagonal step
    requires that both cells beside it are free. With connectivity "any", a path is a polyline through
    free cells. It may touch blocked cells, but not pass between two blocked cells that touch at a
    corner.

    Parameters
    ----------
    map : GridMap
        Map of free and blocked cells.
    start : ndarray of int, shape (2,)
        Row and column of a free cell.
    goals : ndarray of int, shape (2,) or (k, 2)
        Rows and columns of free cells.
    connectivity : {"8", "4", "any"}, default "8"
        Allowed steps, see :class:`Connectivity`.
    reach : {"nearest", "each"}, default "nearest"
        Goals to reach, see :class:`Reach`.
    weights : ndarray, shape (rows, columns), optional
        Cost per metre in each cell, > 0. A step costs its length times the mean weight of its two
        cells. None means 1. Not available with connectivity "any".

    Raises
    ------
    InvalidData
        A start or goal is blocked or outside the map, or the weights are invalid. The message names
        field, cell and value.

    Examples
    --------
    >>> from crosstrack.models import GridPath
    >>> model = GridPath({"blocked": ["....", ".@@.", "...."]}, start=(0, 0), goals=(2, 3))
    >>> print(model.describe())
    3 × 4 cells, 17% blocked, 8 neighbours
    """

    map: Field[GridMap | Mapping[str, Any], GridMap] = declared(Nested(GridMap))
    start: Field[Numbers, NDArray[np.int64]] = declared(Array((2,), int))
    goals: Field[Numbers, NDArray[np.int64]] = declared(Goals(("k", 2), int))
    connectivity: Field[str, Connectivity] = declared(
        Member(Connectivity), default=Connectivity.EIGHT
    )
    reach: Field[str, Reach] = declared(Member(Reach), default=Reach.NEAREST)
    weights: FloatsOrNone = declared(Optional(Array(("rows", "columns"), lower=0)), default=None)

    kind: ClassVar[str] = "grid-path"
    objective_unit: ClassVar[str] = "m"
    plan_type: ClassVar[type] = GridPlan
    formulations: ClassVar[dict[str, Any]] = {"flow": ".models.grid_path.flow:FlowFormulation"}
    default_formulation: ClassVar[str] = "flow"

    def check(self) -> None:
        """Raise if a start or goal is not a free cell, or the weights are invalid."""
        if not len(self.goals):
            raise InvalidData("goals must hold at least one cell, got none", field="goals")
        ends = [("start", self.start), *((f"goals[{k}]", g) for k, g in enumerate(self.goals))]
        rows, columns = self.map.shape
        for name, cell in ends:
            if not self.map.holds(cell):
                inside = ((cell >= 0) & (cell < self.map.shape)).all()
                why = "is blocked" if inside else f"lies outside of {rows} × {columns} cells"
                raise InvalidData(
                    f"{name} must be a free cell (row, column), got {show(cell.tolist())}, which {why}",
                    field=name.partition("[")[0],
                )
        if self.weights is None:
            return
        if self.connectivity is Connectivity.ANY:
            raise InvalidData("weights must not be given with connectivity 'any'", field="weights")
        if self.weights.shape != self.map.shape or (self.weights <= 0).any():
            bad = np.argwhere(self.weights <= 0) if self.weights.shape == self.map.shape else None
            got = f"shape {self.weights.shape}" if bad is None else f"{show(bad[0].tolist())}: <= 0"
            raise InvalidData(
                f"weights must be > 0 with one for each of {rows} × {columns} cells, got {got}",
                field="weights",
            )

    @np.errstate(all="ignore")  # overflow yields NaN, which violates a check
    def verify(self, plan: GridPlan, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the cost of the paths in metres and the checks of all constraints."""
        return verify_paths(self, plan, tolerance)

    def describe(self) -> str:
        """Return a short description of the size."""
        rows, columns = self.map.shape
        how = (
            "any direction"
            if self.connectivity is Connectivity.ANY
            else f"{self.connectivity} neighbours"
        )
        goals = f", {len(self.goals)} goals" if len(self.goals) > 1 else ""
        weights = ", weighted" if self.weights is not None else ""
        return f"{rows} × {columns} cells, {self.map.blocked.mean():.0%} blocked, {how}{goals}{weights}"
