"""Test functions within their usual bounds, and with optima that a seed moves.

Only ``Generator.random`` is drawn from, and what is computed of it is rounded, so that a seed means
the same function wherever it is used.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from ...models.black_box.functions import Landscape, Named
from ...models.black_box.model import MOST, BlackBoxMinimisation
from ...models.fields import Optional, Whole
from ...models.records import Member

__all__ = ["BOUNDS", "generate"]

#: The least and the greatest value of each variable, as these functions are usually bounded.
BOUNDS: Mapping[Landscape, tuple[float, float]] = MappingProxyType(
    {
        Landscape.RASTRIGIN: (-5.12, 5.12),
        Landscape.EASOM: (-100.0, 100.0),
        Landscape.BOOTH: (-10.0, 10.0),
        Landscape.BOHACHEVSKY: (-100.0, 100.0),
        Landscape.SUM_SQUARES: (-10.0, 10.0),
        Landscape.SPHERE: (-5.12, 5.12),
        Landscape.ROSENBROCK: (-5.0, 10.0),
        Landscape.ACKLEY: (-32.768, 32.768),
        Landscape.STEP: (-100.0, 100.0),
        Landscape.CONSTANT: (-1.0, 1.0),
    }
)
#: Shares of the range by which an optimum is moved at the least and at the most: it leaves the middle,
#: and stays within the bounds.
_NEAR, _FAR = 0.1, 0.3
#: Digits of these shares.
_DIGITS = 3


def generate(
    function: str,
    dimension: int,
    seed: int | None = None,
    *,
    budget: int = 10_000,
    name: str = "",
    **fields: Any,
) -> BlackBoxMinimisation:
    """Return a test function within its usual bounds, with its optimum moved where there is a seed.

    Parameters
    ----------
    function : str
        A :class:`~crosstrack.models.black_box.functions.Landscape`, such as ``"rastrigin"``.
    dimension : int
        Number of variables.
    seed : int, optional
        Same seed, same move: each variable's optimum goes up or down by 0.1 to 0.3 of its range.
        Without it the optimum stays where the formula has it.
    budget : int
        Evaluations that a run may use.
    name : str
        Of the model.
    **fields
        Other fields of :class:`~crosstrack.models.black_box.Named`: ``stretch``, ``deviation``.

    Raises
    ------
    InvalidData
        An unknown function, or a number that is not allowed, named.
    """
    kind = Member(Landscape).coerce("function", function, {})
    count = Whole(1, MOST).coerce("dimension", dimension, {})
    chosen = Optional(Whole(0)).coerce("seed", seed, {})
    low, high = BOUNDS[Landscape(kind)]
    data = {"name": str(kind), **fields}
    if chosen is not None:
        draw = np.random.default_rng(chosen).random((2, count))
        share = np.round(_NEAR + (_FAR - _NEAR) * draw[0], _DIGITS)
        # Twelve digits, as products of rounded numbers may differ in the last one.
        data["shift"] = np.round((high - low) * np.where(draw[1] < 0.5, -share, share), 12)
    found = Named.from_data(data)
    return BlackBoxMinimisation(found, np.tile([low, high], (count, 1)), budget, name=name)
