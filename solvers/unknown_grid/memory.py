"""What learned policies remember of scenes: the masked map of each, as it grows."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ...models.unknown_grid.plan import STEPS
from ...models.unknown_grid.world import BLOCKED, FREE, TARGET, UNKNOWN

__all__ = ["Memory", "Observation"]

Cells = NDArray[np.int8]
Ints = NDArray[np.int64]

_MOVES = np.array(STEPS)


class Observation(NamedTuple):
    """What is known in n scenes after a look; arrays, or tensors of the same shapes.

    Parameters
    ----------
    known : shape (n, rows, columns)
        All that was seen so far: -1 unknown, 0 free, 1 obstacle, 2 target. The target is marked from the
        beginning; a cell that stopped a step is an obstacle.
    current : shape (n, rows, columns)
        The paper's masked global matrix O_g, of this look alone: a target outside the view is -1.
    view : shape (n, m, n')
        The cells of this look's view: 0, the target too, and 1, also what lies off the map.
    corners, positions, targets : shape (n, 2)
        Row and column of the view's first cell, which may lie off the map, of the vehicle, the target.
    seen : shape (n,)
        Whether the target has been in a view.
    """

    known: Any
    current: Any
    view: Any
    corners: Any
    positions: Any
    targets: Any
    seen: Any

    def tensors(self) -> Observation:
        """Return tensors: float32 for cells, int64 for places, bool for `seen`."""
        import torch

        kinds = (np.float32,) * 3 + (np.int64,) * 3 + (np.bool_,)
        every = zip(self, kinds, strict=True)
        return Observation._make(torch.from_numpy(np.ascontiguousarray(a, k)) for a, k in every)

    def in_view(self) -> Observation:
        """Return the same with the partial map O_p as `current`, and places in the frame of the view.

        A target outside the view is taken to the nearest cell of it.
        """
        limits = [one - 1 for one in self.view.shape[1:]]
        targets = self.targets - self.corners
        for axis in (0, 1):
            targets[:, axis] = targets[:, axis].clip(0, limits[axis])
        partial = self.view + 0
        partial[range(len(partial)), targets[:, 0], targets[:, 1]] = TARGET
        return self._replace(
            current=partial, positions=self.positions - self.corners, targets=targets
        )


class Memory:
    """The masked maps of some scenes of equal shape.

    Parameters
    ----------
    shape, view : ndarray of int, shape (2,)
        Rows and columns of the maps, and of the views.
    targets : ndarray of int, shape (k, 2)
        One a scene.
    """

    def __init__(self, shape: Ints, view: Ints, targets: Ints) -> None:
        self.targets = targets
        self._half = view // 2
        self._shape, self._view = tuple(shape.tolist()), tuple(view.tolist())
        count, (rows, columns) = len(targets), self._shape
        down, across = self._half.tolist()
        # A margin of half a view: no window ever leaves the array.
        self._cells = np.full((count, rows + 2 * down, columns + 2 * across), UNKNOWN, np.int8)
        self._inner = (slice(None), slice(down, down + rows), slice(across, across + columns))
        self._hits = np.zeros((count, rows, columns), bool)
        self._seen = np.zeros(count, bool)
        self._places = np.full((count, 2), -1)
        self._actions = np.full(count, -1)

    def look(self, rows: Ints, positions: Ints, corners: Ints, view: Any) -> Observation:
        """Remember a look in the scenes `rows`, and return what is known in them.

        Parameters
        ----------
        rows : ndarray of int, shape (n,)
            Scenes, 0 and so on, none twice.
        positions, corners : ndarray of int, shape (n, 2)
            Of vehicles and views.
        view : ndarray, shape (n, m, n')
            Cells: 0 free, 1 obstacle or off the map; 2, the target, is free.
        """
        places, targets = np.asarray(positions), self.targets[rows]
        every = np.arange(len(rows))
        view = np.where(np.asarray(view) == BLOCKED, BLOCKED, FREE).astype(np.int8)
        self._note_hits(rows, places)
        at = tuple((corners + self._half).T)
        now = np.full((len(rows), *self._cells.shape[1:]), UNKNOWN, np.int8)
        for cells, which in ((self._cells, rows), (now, every)):
            windows = sliding_window_view(cells, self._view, axis=(1, 2), writeable=True)
            windows[which, *at] = view
        known, current = self._cells[rows][self._inner], now[self._inner]
        known[self._hits[rows]] = BLOCKED
        known[every, places[:, 0], places[:, 1]] = FREE
        known[every, targets[:, 0], targets[:, 1]] = TARGET
        away = targets - corners
        seen = ((away >= 0) & (away < self._view)).all(axis=1)
        current[seen, targets[seen, 0], targets[seen, 1]] = TARGET
        self._seen[rows] |= seen
        self._places[rows] = places
        return Observation(
            known, current, view, np.asarray(corners), places, targets, self._seen[rows].copy()
        )

    def act(self, rows: Ints, actions: Ints) -> None:
        """Note what is done next, so that the following look shows whether it led anywhere."""
        self._actions[rows] = actions

    def _note_hits(self, rows: Ints, places: Ints) -> None:
        """Note which cells stopped a step: they are obstacles, seen or not."""
        actions = self._actions[rows]
        stayed = (actions >= 0) & (places == self._places[rows]).all(axis=1)
        cells = places + _MOVES[actions]
        stayed &= ((cells >= 0) & (cells < self._shape)).all(axis=1)
        self._hits[rows[stayed], cells[stayed, 0], cells[stayed, 1]] = True
