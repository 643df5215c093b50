"""A binary heap in two arrays, ordered by (key, item): equal keys leave in order of creation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..jit import kernel

__all__ = ["pop", "push", "widened"]

Keys = NDArray[np.float64]
Items = NDArray[np.int64]


@kernel
def push(keys: Keys, items: Items, size: int, key: float, item: int) -> int:
    """Add ``(key, item)`` to the `size` entries and return the new size; the room must be there."""
    hole = size
    while hole > 0:
        parent = (hole - 1) >> 1
        if keys[parent] < key or (keys[parent] == key and items[parent] < item):
            break
        keys[hole] = keys[parent]
        items[hole] = items[parent]
        hole = parent
    keys[hole] = key
    items[hole] = item
    return size + 1


@kernel
def pop(keys: Keys, items: Items, size: int) -> int:
    """Remove the smallest entry (read it at index 0 before) and return the new size."""
    size -= 1
    key = keys[size]
    item = items[size]
    hole = 0
    child = 1
    while child < size:
        right = child + 1
        if right < size and (
            keys[right] < keys[child]
            or (keys[right] == keys[child] and items[right] < items[child])
        ):
            child = right
        if key < keys[child] or (key == keys[child] and item < items[child]):
            break
        keys[hole] = keys[child]
        items[hole] = items[child]
        hole = child
        child = 2 * hole + 1
    keys[hole] = key
    items[hole] = item
    return size


@kernel
def widened(keys: Keys, items: Items, size: int, room: int) -> tuple[Keys, Items]:
    """Return the arrays with more room and the same `size` entries."""
    wider_keys, wider_items = np.empty(room), np.empty(room, np.int64)
    wider_keys[:size] = keys[:size]
    wider_items[:size] = items[:size]
    return wider_keys, wider_items
