"""Navigation on unknown grids, seen through a camera of limited view.

Source: C. Chen, Y. Wan, B. Li, C. Wang, G. Xie, H. Jiang, "Motion Planning for Heterogeneous Unmanned
Systems under Partial Observation from UAV", IROS 2020, doi 10.1109/IROS45743.2020.9341326.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..declaration import Nested
from ..fields import Array, Flag, Optional, Real, Whole, declared, required, show
from ..grid_path import Connectivity
from ..grid_path.gridmap import read_cells
from ..inputs import Field, Numbers
from ..model import Model
from ..records import Member
from ..verification import TOLERANCE, Verification, check_tolerance
from .camera import Camera
from .checks import Replay, replay, verify_runs
from .moving import fewest_run, obstacle_tracks
from .plan import NavigationRuns
from .scenes import MOST, Corners, Hover, actions_of, aspects_of, check_aspects
from .world import World

__all__ = ["Score", "UnknownGridNavigation"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]


class Maps(Array):
    """Field of Boolean maps, also accepted as one list of text lines per scene; written as lines."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> Truths:
        if isinstance(value, Sequence) and not isinstance(value, str):
            value = [_read_lines(f"{name}[{k}]", text) for k, text in enumerate(value)]
            shapes = [_shape(f"{name}[{k}]", text) for k, text in enumerate(value)]
            for k, text in enumerate(shapes):
                if text != shapes[0]:
                    raise InvalidData(
                        f"{name}[{k}] must have shape {shapes[0]} as the first map, got {text}",
                        field=name,
                    )
        maps: Truths = super().coerce(name, value, sizes)
        return maps

    def encode(self, value: Truths) -> list[list[str]]:
        letters = np.where(value, "@", ".")
        lines: list[list[str]] = letters.view(f"U{value.shape[2]}")[:, :, 0].tolist()
        return lines


def _shape(name: str, value: Any) -> tuple[int, ...]:
    try:
        return np.shape(value)
    except ValueError:
        raise InvalidData(
            f"{name} must have rows of one length, got {show(value)}", field="blocked"
        ) from None


def _read_lines(name: str, value: Any) -> Any:
    """Return lines of text as Boolean cells, and any other value unchanged."""
    if isinstance(value, str):
        value = value.splitlines()
    if isinstance(value, list | tuple) and value and all(isinstance(x, str) for x in value):
        return read_cells(value, name)
    return value


def split_drawing(
    where: str, lines: Sequence[str], first: tuple[int, int] = (0, 0)
) -> tuple[list[str], list[int], list[int]]:
    """Return the lines of a drawing with free cells at both ends, and row and column of start and target.

    Messages name `where`, and count lines and characters from `first`.
    """
    ends = []
    for letter, word in (("S", "start"), ("T", "target")):
        cells = [[r, c] for r, line in enumerate(lines) for c, x in enumerate(line) if x == letter]
        if len(cells) != 1:
            what = "none"
            if cells:
                row, column = np.add(cells[1], first).tolist()
                what = f"a second {letter} in line {row}, column {column}"
            raise InvalidData(
                f"{where} must have one {letter} ({word}), got {what}", field=f"{word}s"
            )
        ends += cells
    plain = [line.replace("S", ".").replace("T", ".") for line in lines]
    return plain, ends[0], ends[1]


class Score(NamedTuple):
    """Performance of runs, measured on the true maps.

    Parameters
    ----------
    scenes, reached : int
        Number of scenes, and number of scenes whose target was reached.
    collisions : int
        Number of steps into obstacles or off the map, in all scenes.
    ratio : float
        Mean ratio of steps taken to fewest steps over the scenes whose target was reached; NaN if
        no target was reached.
    spl : float
        Success weighted by path length, from 0 to 1: the mean over all scenes of S l / max(p, l) with
        the success S (0 or 1), the fewest steps l and the steps taken p (P. Anderson et al., "On
        Evaluation of Embodied Navigation Agents", 2018). Collisions and waiting are steps.
    """

    scenes: int
    reached: int
    collisions: int
    ratio: float
    spl: float


@dataclass(frozen=True, eq=False, repr=False)
class UnknownGridNavigation(Model[NavigationRuns]):
    """Navigation of a vehicle to a target on an unknown map, in one or more scenes.

    The vehicle moves up, down, left or right by one cell per step. A policy decides step by step. It
    has the size of the map, the positions of the vehicle and the target, and the cells of a view that a
    UAV shows. A step into an obstacle or off the map is a collision: the vehicle does not move, and
    the step is used.

    Parameters
    ----------
    blocked : ndarray of bool, shape (k, rows, columns), or k lists of lines of text
        True map of each scene, hidden from backends. In text, ``.`` and ``G`` are free, and ``@``,
        ``O``, ``T``, ``W`` and ``#`` are blocked.
    starts, targets : ndarray of int, shape (k, 2)
        Row and column in each scene. Both cells must be free and differ from each other.
    shape : ndarray of int, shape (2,)
        Numbers of rows and columns of the maps.
    view : ndarray of int, shape (2,), default (11, 11)
        Numbers of rows and columns of the view, both odd, with the UAV above its middle.
    steps : int, default 40
        Maximum number of actions per run, from 1 to 10**6.
    uav : {"paper", "follow"}, default "paper"
        Motion of the UAV after it has seen the target, see :class:`Hover`.
    camera : Camera, optional
        Camera that returns images instead of cells. The target is invisible in them. None returns
        cells.
    connectivity : {"4", "8"}, default "4"
        Neighbours that a step may lead to, see :class:`~crosstrack.models.grid_path.Connectivity`.
    corners : {"free", "one", "any"}, default "free"
        Allowed diagonal steps, see :class:`~crosstrack.models.unknown_grid.Corners`.
    occlusion : bool, default False
        Whether the view only shows the cells in line of sight of its middle cell.
    false_obstacles, missed_obstacles : float, default 0
        Probabilities, below 1, that a shown free cell appears blocked, and a blocked cell free.
    target_known : bool, default True
        Whether a policy receives the targets. Otherwise `targets` is hidden, and a policy has to search.
    moving : int, default 0
        Number of moving obstacles per scene. Policies may wait for them.
    tracks : ndarray of int, shape (k, moving, n, 2), optional
        Cells of the moving obstacles, equal or neighbours one after another, hidden from backends. The
        obstacles move to and fro. None lets them walk at random.
    world_seed : int, default 0
        Seed of the readings and random walks, hidden from backends.

    Notes
    -----
    The objective is the mean number of steps per scene. A run that does not reach the target costs
    `steps` + 1, unless its outcome is ``NO_WAY`` and no path exists.

    Raises
    ------
    InvalidData
        A start or target is blocked or outside the map, the view has an even side, or the shapes of
        the maps differ. The message names field, scene and value.

    Examples
    --------
    >>> from crosstrack.models import UnknownGridNavigation
    >>> model = UnknownGridNavigation.drawn(["S..@.", ".@.@.", ".@..T"], view=(3, 3))
    >>> print(model.describe())
    1 scene of 3 × 5 cells, view 3 × 3, 40 steps
    """

    blocked: Field[Numbers | Sequence[str | Sequence[str]], Truths] = declared(
        Maps(("k", "rows", "columns"), bool), hidden=True
    )
    starts: Field[Numbers, Ints] = declared(Array(("k", 2), int))
    targets: Field[Numbers, Ints] = declared(Array(("k", 2), int))
    shape: Field[Numbers, Ints] = declared(Array((2,), int, lower=1))
    view: Field[Numbers, Ints] = declared(Array((2,), int, lower=1, unit="cells"), default=(11, 11))
    steps: int = declared(Whole(1, 10**6), default=40)
    uav: Field[str, Hover] = declared(Member(Hover), default=Hover.PAPER)
    camera: Field[Camera | Mapping[str, Any] | None, Camera | None] = declared(
        Optional(Nested(Camera)), default=None
    )
    connectivity: Field[str, Connectivity] = declared(
        Member(Connectivity), default=Connectivity.FOUR, added=True
    )
    corners: Field[str, Corners] = declared(Member(Corners), default=Corners.FREE, added=True)
    occlusion: bool = declared(Flag(), default=False, added=True)
    false_obstacles: float = declared(Real(0, 1), default=0.0, added=True)
    missed_obstacles: float = declared(Real(0, 1), default=0.0, added=True)
    target_known: bool = declared(Flag(), default=True, added=True)
    moving: int = declared(Whole(0, 1000), default=0, added=True)
    tracks: Field[Numbers | None, Ints | None] = declared(
        Optional(Array(("k", "moving", "n", 2), int)), hidden=True, default=None, added=True
    )
    world_seed: int = declared(Whole(0, 2**32 - 1), hidden=True, default=0, added=True)

    kind: ClassVar[str] = "unknown-grid"
    objective_unit: ClassVar[str] = "steps"
    plan_type: ClassVar[type] = NavigationRuns

    def check(self) -> None:
        """Raise if a start or target is not a free cell, or the view has no middle cell."""
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
        check_aspects(self)

    def blinded(self) -> Self:
        """Return the view for backends without hidden fields, and without unknown targets."""
        view = super().blinded()
        if not self.target_known:
            view.__dict__.pop("targets", None)
        return view

    @classmethod
    def drawn(cls, *drawings: str | Sequence[str], **fields: Any) -> Self:
        """Return the model of scenes drawn as text.

        Parameters
        ----------
        *drawings : str or list of str
            One drawing per scene: lines of ``.`` (free), ``@`` or ``#`` (blocked), one ``S`` (start)
            and one ``T`` (target).
        **fields
            Further fields of the model, such as `view`.

        Returns
        -------
        UnknownGridNavigation
            Model of the drawings.

        Raises
        ------
        InvalidData
            A drawing has an unknown letter, or not exactly one start and one target. The message
            names drawing, line and column.
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
            plain, start, target = split_drawing(f"drawing {k}", lines)
            blocked.append(plain)
            starts.append(start)
            targets.append(target)
        maps = Maps(("k", "rows", "columns"), bool).coerce("blocked", blocked, {})
        return cls(maps, np.array(starts), np.array(targets), np.array(maps.shape[1:]), **fields)

    @property
    def scenes(self) -> int:
        """Number of scenes."""
        return len(self.starts)

    def oracle(self) -> Callable[[Floats], Floats]:
        """Return the :class:`World` that simulates the scenes for one solve."""
        return World(self)

    def fewest_steps(self) -> Floats:
        """Return the fewest steps from start to target on the true maps, shape (k,).

        The entry of a scene without a path is infinite; with moving obstacles, without a path within `steps`.
        """
        return np.array([np.inf if run is None else len(run) for run in self.fewest_runs()])

    def fewest_runs(self) -> Iterator[str | None]:
        """Yield the actions of a run with the fewest steps per scene; None without a path."""
        tracks = obstacle_tracks(self)
        return (fewest_run(self, k, tracks[k]) for k in range(self.scenes))

    def replays(self, plan: NavigationRuns | Any) -> tuple[Replay, ...]:
        """Return the replays of a plan's runs on the true maps, one per scene.

        Parameters
        ----------
        plan : NavigationRuns, Solution or JSON data
            Plan with one run per scene.

        Raises
        ------
        InvalidData
            The numbers of runs and scenes differ.
        """
        runs = self._checked(self.as_plan(plan)).actions
        scenes = zip(self.blocked, self.starts.tolist(), runs, obstacle_tracks(self), strict=True)
        return tuple(
            replay(cells, (row, column), run, self.corners, tracks)
            for cells, (row, column), run, tracks in scenes
        )

    def score(self, plan: NavigationRuns | Any) -> Score:
        """Return the reached scenes, the collisions, and the steps compared with the fewest steps.

        Parameters
        ----------
        plan : NavigationRuns, Solution or JSON data
            Plan with one run per scene.

        Raises
        ------
        InvalidData
            The numbers of runs and scenes differ.
        """
        replays = self.replays(plan)
        reached = np.array(
            [
                bool((run.positions[-1] == t).all())
                for run, t in zip(replays, self.targets, strict=True)
            ]
        )
        steps = np.array([len(run.collided) for run in replays], float)
        ratio, spl = np.nan, 0.0
        if reached.any():
            fewest = self.fewest_steps()
            finite = reached & np.isfinite(fewest)
            ratio = float((steps[finite] / fewest[finite]).mean()) if finite.any() else np.nan
            valid = finite & (steps <= self.steps)
            spl = float((fewest[valid] / np.maximum(steps, fewest)[valid]).sum())
        collisions = int(sum(run.collided.sum() for run in replays))
        return Score(self.scenes, int(reached.sum()), collisions, ratio, spl / self.scenes)

    def verify(self, plan: NavigationRuns, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the mean cost in steps, and check each outcome on the true maps."""
        check_tolerance(tolerance)
        return verify_runs(self, self._checked(plan), tolerance)

    def _checked(self, plan: NavigationRuns) -> NavigationRuns:
        required("plan", plan, NavigationRuns)
        if len(plan) != self.scenes:
            raise InvalidData(
                f"actions must have {self.scenes} entries, one per scene, got {len(plan)}",
                field="actions",
            )
        allowed = actions_of(self)
        for k, run in enumerate(plan.actions):
            if wrong := run.strip(allowed):
                text = f"have the letters {', '.join(allowed)} of this model, got {show(wrong[0])}"
                raise InvalidData(f"actions[{k}] must {text}", field="actions")
        return plan

    def describe(self) -> str:
        """Return a short description of the size."""
        scenes = "1 scene" if self.scenes == 1 else f"{self.scenes} scenes"
        rows, columns = self.shape
        camera = "" if self.camera is None else f", {self.camera.rendering} images"
        aspects = "".join(f", {aspect}" for aspect in sorted(aspects_of(self)))
        return (
            f"{scenes} of {rows} × {columns} cells, view {self.view[0]} × {self.view[1]}, "
            f"{self.steps} steps{camera}{aspects}"
        )
