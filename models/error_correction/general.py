"""Errors and corrections of a route as resources of the more general problem."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..resource_routing.resource import Resource
from .points import KIND_WORDS

__all__ = ["resources_of"]

_SUSPECT = "suspect "


def resources_of(
    kinds: Sequence[str],
    suspect: Sequence[bool],
    limits: NDArray[np.float64],
    rates: tuple[float, float],
    residual: float,
    corrections: int | None,
) -> tuple[tuple[str, ...], tuple[Resource, ...]]:
    """Return the kind of each point, and the resources: two errors and the corrections.

    Parameters
    ----------
    kinds : sequence of str
        The kind of each point.
    suspect : sequence of bool
        Whether each correction may fail: it then resets the error to at most `residual`, else to 0.
    limits : ndarray, shape (4, 2)
        Largest horizontal and vertical error on arrival, by code of kind.
    rates : tuple of float
        Rates of the horizontal and of the vertical error, per metre.
    residual : float
        Largest error after a failed correction.
    corrections : int, optional
        Maximum number of corrections; None adds no resource.
    """
    words = tuple((_SUSPECT if s else "") + kind for kind, s in zip(kinds, suspect, strict=True))
    arrival_words = sorted(set(words) - {"A"})
    code = {word: KIND_WORDS.index(word.removeprefix(_SUSPECT)) for word in arrival_words}
    resources = []
    for axis, own in enumerate(("horizontal", "vertical")):
        resets = {
            w: residual if w.startswith(_SUSPECT) else 0.0 for w in arrival_words if w.endswith(own)
        }
        caps = {word: float(limits[code[word], axis]) for word in arrival_words}
        resources.append(Resource(f"{own} error", rates[axis], limits=caps, resets=resets))
    if corrections is not None:
        points = [word for word in arrival_words if word != "B"]
        limits_of_corrections = dict.fromkeys(points, float(corrections))
        resources.append(
            Resource("corrections", limits=limits_of_corrections, gains=dict.fromkeys(points, 1.0))
        )
    return words, tuple(resources)
