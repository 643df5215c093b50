"""Navigation on unknown grids, seen through a camera of limited view.

Source: C. Chen, Y. Wan, B. Li, C. Wang, G. Xie, H. Jiang, "Motion Planning for Heterogeneous Unmanned
Systems under Partial Observation from UAV", IROS 2020, doi 10.1109/IROS45743.2020.9341326.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..declaration import Nested
from ..fields import Array, Optional, Whole, declared, required, show
from ..grid_path import GridMap, distances
from ..model import Model
from ..records import Member
from ..verification import TOLERANCE, Verification, check_tolerance
from .camera import Camera
from .checks import Replay, replay, verify_runs
from .plan import NavigationRuns
from .scenes import Hover
from .world import World

__all__ = ["Score", "UnknownGridNavigation"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]

#: Cells of all maps together at the most.
MOST = 2**26
_FREE, _BLOCKED = ".G", "@OTW#"


class Maps(Array):
    """Truth values, or one list of lines of text a scene; written as lines."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Truths:
        if isinstance(value, Sequence) and not isinstance(value, str):
            value = [_read_lines(f"{name}[{k}]", one) for k, one in enumerate(value)]
            shapes = [_shape(f"{name}[{k}]", one) for k, one in enumerate(value)]
            for k, one in enumerate(shapes):
                if one != shapes[0]:
                    raise InvalidData(
                        f"{name}[{k}] must have shape {shapes[0]} as the first map, got {one}",
                        field=name,
                    )
        found: Truths = super().coerce(name, value, sizes)
        return found

    def encode(self, value: Truths) -> list[list[str]]:
        letters = np.where(value, "@", ".")
        found: list[list[str]] = letters.view(f"U{value.shape[2]}")[:, :, 0].tolist()
        return found


def _shape(name: str, value: Any) -> tuple[int, ...]:
    try:
        return np.shape(value)
    except ValueError:
        raise InvalidData(
            f"{name} must have rows of one length, got {show(value)}", field="blocked"
        ) from None


def _read_lines(name: str, value: Any) -> Any:
    """Return the truth values of lines of text; anything else as it is."""
    if isinstance(value, str):
        value = value.splitlines()
    if not (isinstance(value, list | tuple) and value and all(isinstance(x, str) for x in value)):
        return value
    for row, line in enumerate(value):
        if len(line) != len(value[0]):
            raise InvalidData(
                f"{name}, line {row} must have {len(value[0])} cells as the first, got {len(line)}",
                field="blocked",
            )
        strange = line.strip(_FREE + _BLOCKED)
        for column, letter in enumerate(line if strange else ""):
            if letter not in _FREE + _BLOCKED:
                raise InvalidData(
                    f"{name}, line {row}, column {column} must be one of {' '.join(_FREE)} (free) or "
                    f"{' '.join(_BLOCKED)} (blocked), got {show(letter)}",
                    field="blocked",
                )
    return [[letter in _BLOCKED for letter in line] for line in value]


class Score(NamedTuple):
    """What runs achieved, measured on the true maps.

    Parameters
    ----------
    scenes, reached : int
        How many there are, and in how many the target was reached.
    collisions : int
        Steps into obstacles or off the map, in all scenes.
    ratio : float
        Mean of steps taken over fewest steps, where the target was reached; NaN where it never was.
    """

    scenes: int
    reached: int
    collisions: int
    ratio: float


@dataclass(frozen=True, eq=False, repr=False)
class UnknownGridNavigation(Model[NavigationRuns]):
    """A vehicle that is led to a target on a map that is not known, in one scene or in many.

    The vehicle goes up, down, left or right by a cell a step. It knows the size of the map, where it is
    and where the target lies, and a UAV shows it the cells of a view around it; so a policy decides
    step by step. A step into an obstacle or off the map is a collision: the vehicle stays, and the
    step is used.

    Parameters
    ----------
    blocked : ndarray of bool, shape (k, rows, columns), or k lists of lines of text
        The true map of each scene. In text ``.`` and ``G`` are free, ``@``, ``O``, ``T``, ``W`` and
        ``#`` blocked. Hidden from backends.
    starts, targets : ndarray of int, shape (k, 2)
        Row and column in each scene; free, and not the same.
    shape : ndarray of int, shape (2,)
        Rows and columns of the maps.
    view : ndarray of int, shape (2,)
        Rows and columns that the UAV sees, both odd, the vehicle in the middle.
    steps : int
        Actions that a run may use, >= 1.
    uav : {"paper", "follow"}
        See :class:`Hover`.
    camera : Camera, optional
        What shows images instead of cells; the target is not to be seen in them.

    Notes
    -----
    The objective is the mean over the scenes of the steps that were taken; a run that does not reach
    the target counts as one step more than allowed, unless it says that there is no way and is right.

    Raises
    ------
    InvalidData
        Naming field, scene and value: a start or target that is blocked or off the map, a view of even
        size, maps of different shapes.

    Examples
    --------
    >>> from crosstrack.models import UnknownGridNavigation
    >>> model = UnknownGridNavigation.drawn(["S..@.", ".@.@.", ".@..T"], view=(3, 3))
    >>> print(model.describe())
    1 scene of 3 × 5 cells, view 3 × 3, 40 steps
    """

    blocked: Truths = declared(Maps(("k", "rows", "columns"), bool), hidden=True)
    starts: Ints = declared(Array(("k", 2), int))
    targets: Ints = declared(Array(("k", 2), int))
    shape: Ints = declared(Array((2,), int, lower=1))
    view: Ints = declared(Array((2,), int, lower=1), default=(11, 11))
    steps: int = declared(Whole(1, 10**6), default=40)
    uav: Hover = declared(Member(Hover), default=Hover.PAPER)
    camera: Camera | None = declared(Optional(Nested(Camera)), default=None)

    kind: ClassVar[str] = "unknown-grid"
    objective_unit: ClassVar[str] = "steps"
    plan_type: ClassVar[type] = NavigationRuns

    def check(self) -> None:
        """Refuse scenes that no vehicle can start in, and views without a middle."""
        count = len(self.starts)
        if not count:
            raise InvalidData("starts must hold at least one scene, got none", field="starts")
        if tuple(self.shape) != self.blocked.shape[1:]:
            raise InvalidData(
                f"shape must be that of the maps, {self.blocked.shape[1:]}, got "
                f"{show(self.shape.tolist())}",
                field="shape",
            )
        if self.blocked.size > MOST:
            raise InvalidData(
                f"blocked must have at most {MOST} cells, got {self.blocked.size}", field="blocked"
            )
        if not (self.view % 2).all() or (self.view > 2 * self.shape + 1).any():
            raise InvalidData(
                "view must be two odd numbers of cells, the vehicle in the middle, at most twice the map "
                f"and one, got {show(self.view.tolist())}",
                field="view",
            )
        for name, cells in (("start", self.starts), ("target", self.targets)):
            outside = np.asarray(((cells < 0) | (cells >= self.shape)).any(axis=1))
            inside = np.where(outside[:, None], 0, cells)
            hit = ~outside & self.blocked[np.arange(count), inside[:, 0], inside[:, 1]]
            for bad, why in ((outside, "lies off the map"), (hit, "is an obstacle")):
                if bad.any():
                    k = int(bad.argmax())
                    raise InvalidData(
                        f"{name}s[{k}] must be a free cell (row, column) of {self.shape[0]} × "
                        f"{self.shape[1]}, got {show(cells[k].tolist())}, which {why}",
                        field=f"{name}s",
                    )
        same = np.asarray((self.starts == self.targets).all(axis=1))
        if same.any():
            k = int(same.argmax())
            raise InvalidData(
                f"targets[{k}] must not be the start, got {show(self.targets[k].tolist())}",
                field="targets",
            )

    @classmethod
    def drawn(cls, *drawings: str | Sequence[str], **fields: Any) -> Self:
        """Return the model of scenes that are drawn in text.

        Parameters
        ----------
        *drawings : str or list of str
            Lines of ``.`` (free), ``@`` or ``#`` (blocked), one ``S`` (start) and one ``T`` (target).
        **fields
            The other fields, such as `view`.

        Raises
        ------
        InvalidData
            Naming drawing, line and column: no start or target, or several, and other letters.
        """
        blocked, starts, targets = [], [], []
        if not drawings:
            raise InvalidData("there must be at least one drawing, got none", field="blocked")
        for k, drawing in enumerate(drawings):
            lines = drawing.splitlines() if isinstance(drawing, str) else drawing
            if not (isinstance(lines, list | tuple) and all(isinstance(x, str) for x in lines)):
                raise InvalidData(
                    f"drawing {k} must be lines of text, got {show(drawing)}", field="blocked"
                )
            ends = []
            for letter, word in (("S", "start"), ("T", "target")):
                found = [
                    (r, c)
                    for r, line in enumerate(lines)
                    for c, x in enumerate(line)
                    if x == letter
                ]
                if len(found) != 1:
                    where = f" at {found[:3]}" if found else ""
                    raise InvalidData(
                        f"drawing {k} must have one {letter} ({word}), got {len(found)}{where}",
                        field=f"{word}s",
                    )
                ends.append(found[0])
            starts.append(ends[0])
            targets.append(ends[1])
            blocked.append([line.replace("S", ".").replace("T", ".") for line in lines])
        checked = Maps(("k", "rows", "columns"), bool).coerce("blocked", blocked, {})
        return cls(
            checked, np.array(starts), np.array(targets), np.array(checked.shape[1:]), **fields
        )

    @property
    def scenes(self) -> int:
        """The number of scenes."""
        return len(self.starts)

    def oracle(self) -> Callable[[Floats], Floats]:
        """Return the :class:`World` of one run, which answers its questions."""
        return World(self)

    def fewest_steps(self) -> Floats:
        """Return the fewest steps from start to target on the true maps, shape (k,), infinite without a way."""
        ends = zip(self.blocked, self.starts, self.targets, strict=True)
        found = [distances(GridMap(one), [a, b], diagonal=False)[0, 1] for one, a, b in ends]
        return np.array(found)

    def replays(self, plan: NavigationRuns | Any) -> tuple[Replay, ...]:
        """Return what the runs of a plan did on the true maps, one a scene."""
        runs = self._checked(self.as_plan(plan)).actions
        every = zip(self.blocked, self.starts.tolist(), runs, strict=True)
        return tuple(replay(one, (row, column), run) for one, (row, column), run in every)

    def score(self, plan: NavigationRuns | Any) -> Score:
        """Return how often the target was reached, collisions, and how long the ways were."""
        taken = self.replays(plan)
        there = np.array(
            [
                bool((one.positions[-1] == t).all())
                for one, t in zip(taken, self.targets, strict=True)
            ]
        )
        steps = np.array([len(one.collided) for one in taken], float)
        ratio = float((steps[there] / self.fewest_steps()[there]).mean()) if there.any() else np.nan
        collisions = int(sum(one.collided.sum() for one in taken))
        return Score(self.scenes, int(there.sum()), collisions, ratio)

    def verify(self, plan: NavigationRuns, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the mean cost, and whether every run is what its outcome says, on the true maps."""
        check_tolerance(tolerance)
        return verify_runs(self, self._checked(plan), tolerance)

    def _checked(self, plan: NavigationRuns) -> NavigationRuns:
        required("plan", plan, NavigationRuns)
        if len(plan) != self.scenes:
            raise InvalidData(
                f"actions must have {self.scenes} entries, one a scene, got {len(plan)}",
                field="actions",
            )
        return plan

    def plan_to_data(self, plan: NavigationRuns) -> Any:
        """Return ``{"actions": […], "outcomes": […]}``."""
        return plan.to_data()

    def plan_from_data(self, data: Any) -> NavigationRuns:
        """Return the plan in `data`."""
        return NavigationRuns.from_data(data)

    def describe(self) -> str:
        """Return the size in a few words."""
        scenes = "1 scene" if self.scenes == 1 else f"{self.scenes} scenes"
        rows, columns = self.shape
        camera = "" if self.camera is None else f", {self.camera.rendering} images"
        return (
            f"{scenes} of {rows} × {columns} cells, view {self.view[0]} × {self.view[1]}, "
            f"{self.steps} steps{camera}"
        )
