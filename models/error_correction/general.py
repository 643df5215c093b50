"""What an error-correction route uses up, as resources of the more general problem."""

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
    """Return the kind of each point, and the two errors and the corrections as resources.

    Parameters
    ----------
    kinds : sequence of str
        The kind of each point.
    suspect : sequence of bool
        Which corrections may fail; these are reset to `residual` at the most, the others to 0.
    limits : ndarray, shape (4, 2)
        Largest horizontal and vertical error on arrival, by code of kind.
    rates : tuple of float
        Of the horizontal and of the vertical error.
    residual : float
        What a failed correction leaves at the most.
    corrections : int, optional
        Most corrections; no resource without it.
    """
    words = tuple((_SUSPECT if s else "") + kind for kind, s in zip(kinds, suspect, strict=True))
    arrived = sorted(set(words) - {"A"})
    code = {word: KIND_WORDS.index(word.removeprefix(_SUSPECT)) for word in arrived}
    resources = []
    for axis, own in enumerate(("horizontal", "vertical")):
        resets = {
            w: residual if w.startswith(_SUSPECT) else 0.0 for w in arrived if w.endswith(own)
        }
        caps = {word: float(limits[code[word], axis]) for word in arrived}
        resources.append(Resource(f"{own} error", rates[axis], limits=caps, resets=resets))
    if corrections is not None:
        points = [word for word in arrived if word != "B"]
        most = dict.fromkeys(points, float(corrections))
        resources.append(Resource("corrections", limits=most, gains=dict.fromkeys(points, 1.0)))
    return words, tuple(resources)
