"""Memory of the learned policies: the masked map of each scene."""

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
    """Knowledge of n scenes after an observation, as arrays or as tensors of the same shapes.

    Parameters
    ----------
    known : shape (n, rows, columns)
        Cells seen so far: -1 unknown, 0 free, 1 obstacle, 2 target. The target is always marked. A
        cell that caused a collision is an obstacle.
    current : shape (n, rows, columns)
        The paper's masked global matrix O_g of the current view. A target outside the view is -1.
    view : shape (n, m, n')
        Cells of the current view: 0 free or target, 1 obstacle or outside the map.
    corners, positions, targets : shape (n, 2)
        Row and column of the view's first cell (possibly outside the map), of the vehicle, and of the
        target.
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
        """Return tensors: float32 for cells, int64 for positions, bool for `seen`."""
        import torch

        kinds = (np.float32,) * 3 + (np.int64,) * 3 + (np.bool_,)
        fields = zip(self, kinds, strict=True)
        return Observation._make(torch.from_numpy(np.ascontiguousarray(a, k)) for a, k in fields)

    def in_view(self) -> Observation:
        """Return a copy with the partial map O_p as `current`, and positions relative to the view.

        A target outside the view is moved to the nearest cell of the view.
        """
        limits = [side - 1 for side in self.view.shape[1:]]
        targets = self.targets - self.corners
        for axis in (0, 1):
            targets[:, axis] = targets[:, axis].clip(0, limits[axis])
        partial = self.view + 0
        partial[range(len(partial)), targets[:, 0], targets[:, 1]] = TARGET
        return self._replace(
            current=partial, positions=self.positions - self.corners, targets=targets
        )


class Memory:
    """Masked maps of k scenes of equal shape; `targets`, shape (k, 2), are the cells of their targets."""

    def __init__(self, shape: Ints, view: Ints, targets: Ints) -> None:
        self.targets = targets
        self._half = view // 2
        self._shape, self._view = tuple(shape.tolist()), tuple(view.tolist())
        count, (rows, columns) = len(targets), self._shape
        down, across = self._half.tolist()
        # Cells seen so far, and those of the current views. A margin of half a view keeps every window inside.
        self._cells = np.full((2, count, rows + 2 * down, columns + 2 * across), UNKNOWN, np.int8)
        self._windows = sliding_window_view(self._cells, self._view, axis=(2, 3), writeable=True)
        self._inner = (slice(None), slice(down, down + rows), slice(across, across + columns))
        self._hits = np.zeros((count, rows, columns), bool)
        self._seen = np.zeros(count, bool)
        self._places = np.full((count, 2), -1)
        self._actions = np.full(count, -1)

    def restart(self, rows: Ints) -> None:
        """Forget everything about the scenes `rows`."""
        self._cells[0, rows], self._hits[rows], self._seen[rows] = UNKNOWN, False, False
        self._places[rows] = self._actions[rows] = -1

    def look(self, rows: Ints, positions: Ints, corners: Ints, view: Any) -> Observation:
        """Store the views of the scenes `rows`, which are distinct, and return the knowledge of these scenes.

        `positions` are the cells of the vehicle, and `corners` the first cells of the views. A view has
        0 for free cells, 1 for obstacles and cells outside the map, and 2 for the target.
        """
        places, targets = np.asarray(positions), self.targets[rows]
        view = np.where(np.asarray(view) == BLOCKED, BLOCKED, FREE).astype(np.int8)
        self._note_hits(rows, places)
        self._cells[1, rows] = UNKNOWN
        self._windows[:, rows, *(corners + self._half).T] = view
        current = self._cells[1, rows][self._inner]
        away = targets - corners
        seen = ((away >= 0) & (away < self._view)).all(axis=1)
        current[seen, targets[seen, 0], targets[seen, 1]] = TARGET
        self._seen[rows] |= seen
        self._places[rows] = places
        seen = self._seen[rows].copy()
        return Observation(
            self.known(rows), current, view, np.asarray(corners), places, targets, seen
        )

    def known(self, rows: Ints) -> Cells:
        """Return the cells seen so far in the scenes `rows`, shape (n, rows, columns), see :class:`Observation`."""
        known: Cells = self._cells[0, rows][self._inner]
        known[self._hits[rows]] = BLOCKED
        for cells, value in ((self._places, FREE), (self.targets, TARGET)):
            known[np.arange(len(rows)), *cells[rows].T] = value
        return known

    def act(self, rows: Ints, actions: Ints) -> None:
        """Store the next actions, so that the following observation reveals collisions."""
        self._actions[rows] = actions

    def _note_hits(self, rows: Ints, places: Ints) -> None:
        """Mark the cells that caused a collision as obstacles."""
        actions = self._actions[rows]
        stayed = (actions >= 0) & (places == self._places[rows]).all(axis=1)
        cells = places + _MOVES[actions]
        stayed &= ((cells >= 0) & (cells < self._shape)).all(axis=1)
        self._hits[rows[stayed], cells[stayed, 0], cells[stayed, 1]] = True
