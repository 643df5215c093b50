"""Value iteration of equation 1 and its gradient by compiled loops, for training.

The loops take an eighth of the time of convolutions of one channel.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel

__all__ = ["iterate", "pass_back"]

Singles = NDArray[np.float32]
Bytes = NDArray[np.uint8]


@kernel
def iterate(fixed: Singles, moves: Singles, values: Singles, best: Bytes) -> None:
    """Fill the values of each iteration and their maximising actions.

    Parameters
    ----------
    fixed : ndarray of float32, shape (n, 4, rows, columns)
        R(s, a).
    moves : ndarray of float32, shape (4, 3, 3)
        gamma P.
    values : ndarray of float32, shape (iterations + 1, n, rows + 2, columns + 2)
        Output V_1, V_2 and so on. The frame must be zero.
    best : ndarray of uint8, shape (iterations + 1, n, rows, columns)
        Output maximising actions.
    """
    count, actions, rows, columns = fixed.shape
    worth = np.empty((4, columns), np.float32)
    for k in range(count):
        for turn in range(len(values)):
            for row in range(rows):
                for action in range(actions):
                    worth[action] = fixed[k, action, row]
                    if turn:
                        for down in range(3):
                            for across in range(3):
                                factor = moves[action, down, across]
                                line = values[turn - 1, k, row + down]
                                for column in range(columns):
                                    worth[action, column] += factor * line[column + across]
                for column in range(columns):
                    top = 0
                    for action in range(1, actions):
                        if worth[action, column] > worth[top, column]:
                            top = action
                    best[turn, k, row, column] = top
                    values[turn, k, row + 1, column + 1] = worth[top, column]


@kernel
def pass_back(
    gradient: Singles, moves: Singles, values: Singles, best: Bytes, fixed: Singles, moved: Singles
) -> None:
    """Add the gradients with respect to R(s, a) and gamma P to `fixed` and `moved`.

    Parameters
    ----------
    gradient : ndarray of float32, shape (n, rows + 2, columns + 2)
        Gradient with respect to the last values. Its frame is ignored. The function overwrites it.
    moves, values, best
        Arguments of :func:`iterate`, after the call.
    fixed, moved : ndarray of float32, shapes (n, 4, rows, columns) and (4, 3, 3)
        Arrays that receive the gradients.
    """
    count, actions, rows, columns = fixed.shape
    before = np.empty((rows + 2, columns + 2), np.float32)
    part = np.empty(columns, np.float32)
    for k in range(count):
        for turn in range(len(values) - 1, -1, -1):
            before[:] = 0.0
            for row in range(rows):
                for action in range(actions):
                    for column in range(columns):
                        chosen = best[turn, k, row, column] == action
                        part[column] = gradient[k, row + 1, column + 1] if chosen else 0.0
                        fixed[k, action, row, column] += part[column]
                    if turn == 0:
                        continue
                    for down in range(3):
                        line = values[turn - 1, k, row + down]
                        into = before[row + down]
                        for across in range(3):
                            factor, total = moves[action, down, across], np.float32(0.0)
                            for column in range(columns):
                                into[column + across] += factor * part[column]
                                total += part[column] * line[column + across]
                            moved[action, down, across] += total
            gradient[k] = before
