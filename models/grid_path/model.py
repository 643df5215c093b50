"""The shortest path of a robot on a map of cells.

Source: sections 2 and 3.2 of "Parallel Swarm Intelligent Motion Planning with Energy-Balanced for
Multirobot in Obstacle Environment", Wireless Communications and Mobile Computing, 2021.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..declaration import Nested
from ..fields import Array, Optional, declared, show
from ..model import Model
from ..records import Member
from ..verification import TOLERANCE, Verification
from .checks import verify_paths
from .gridmap import GridMap
from .plan import GridPlan

__all__ = ["Connectivity", "GridPath", "Reach"]


class Connectivity(StrEnum):
    """Where a path may lead from a cell."""

    FOUR = "4"  #: to the four neighbours, as in the paper
    EIGHT = "8"  #: diagonally as well, where both cells beside the corner are free
    ANY = "any"  #: along any straight line that keeps to free cells


class Reach(StrEnum):
    """Which goals count."""

    NEAREST = "nearest"  #: one path, to the goal that is the cheapest to reach
    EACH = "each"  #: a path to each goal, in their order


class Goals(Array):
    """Cells, or one cell."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> NDArray[Any]:
        given = self._numbers(name, value)
        return super().coerce(name, given[None] if given.ndim == 1 and given.size else given, sizes)


@dataclass(frozen=True, eq=False, repr=False)
class GridPath(Model[GridPlan]):
    """The shortest path from a cell of a map to another.

    With four or eight neighbours a path leads from the centre of a cell to that of a neighbour, and
    eight neighbours never cut corners: a diagonal step needs both cells beside it free. Where any
    direction is allowed, a path is a polyline through free cells, which may touch blocked ones but
    never leads between two that touch at a corner.

    Parameters
    ----------
    map : GridMap
        Free and blocked cells.
    start : ndarray of int, shape (2,)
        Row and column.
    goals : ndarray of int, shape (2,) or (k, 2)
        Rows and columns.
    connectivity : {"8", "4", "any"}
        See :class:`Connectivity`.
    reach : {"nearest", "each"}
        See :class:`Reach`.
    weights : ndarray, shape (rows, columns), optional
        Cost of a metre in each cell, > 0; a step costs its length times the mean of the two cells'
        weights. Not for connectivity "any".

    Raises
    ------
    InvalidData
        Naming field, cell and value: a start or goal off the map or blocked, weights that are not > 0.

    Examples
    --------
    >>> from crosstrack.models import GridPath
    >>> model = GridPath({"blocked": ["....", ".@@.", "...."]}, start=(0, 0), goals=(2, 3))
    >>> print(model.describe())
    3 × 4 cells, 17% blocked, 8 neighbours
    """

    map: GridMap = declared(Nested(GridMap))
    start: NDArray[np.int64] = declared(Array((2,), int))
    goals: NDArray[np.int64] = declared(Goals(("k", 2), int))
    connectivity: Connectivity = declared(Member(Connectivity), default=Connectivity.EIGHT)
    reach: Reach = declared(Member(Reach), default=Reach.NEAREST)
    weights: NDArray[np.float64] | None = declared(
        Optional(Array(("rows", "columns"), lower=0)), default=None
    )

    kind: ClassVar[str] = "grid-path"
    objective_unit: ClassVar[str] = "m"
    plan_type: ClassVar[type] = GridPlan
    formulations: ClassVar[dict[str, Any]] = {"flow": ".models.grid_path.flow:FlowFormulation"}
    default_formulation: ClassVar[str] = "flow"

    def check(self) -> None:
        """Refuse ends where no robot can be, and weights that are none."""
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

    @np.errstate(all="ignore")  # what overflows is no number, and so is violated
    def verify(self, plan: GridPlan, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the cost of the paths and every constraint, by geometry on the blocked cells."""
        return verify_paths(self, plan, tolerance)

    def plan_to_data(self, plan: GridPlan) -> Any:
        """Return ``{"paths": [[[x, y], …], …]}``."""
        return plan.to_data()

    def plan_from_data(self, data: Any) -> GridPlan:
        """Return the plan in `data`."""
        return GridPlan.from_data(data)

    def describe(self) -> str:
        """Return the size in a few words."""
        rows, columns = self.map.shape
        how = (
            "any direction"
            if self.connectivity is Connectivity.ANY
            else f"{self.connectivity} neighbours"
        )
        goals = f", {len(self.goals)} goals" if len(self.goals) > 1 else ""
        weights = ", weighted" if self.weights is not None else ""
        return f"{rows} × {columns} cells, {self.map.blocked.mean():.0%} blocked, {how}{goals}{weights}"
