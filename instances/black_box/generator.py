"""Test functions within their usual bounds, with optima that can be moved by a seed.

Only ``Generator.random`` is used, and its results are rounded, so that a seed gives the same function
on every machine.
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

#: Usual lower and upper bound of the variables of each function.
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
#: Smallest and largest shift of an optimum as shares of the range: it leaves the centre and stays
#: within the bounds.
_NEAR, _FAR = 0.1, 0.3
#: Number of digits of these shares.
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
    """Return a test function within its usual bounds, with a moved optimum if a seed is given.

    Parameters
    ----------
    function : str
        A :class:`~crosstrack.models.black_box.functions.Landscape`, such as ``"rastrigin"``.
    dimension : int
        Number of variables.
    seed : int, optional
        Seed of the shift, which moves the optimum of each variable up or down by 0.1 to 0.3 of its
        range. None for no shift.
    budget : int
        Largest number of evaluations of a run.
    name : str
        Name of the model.
    **fields
        Other fields of :class:`~crosstrack.models.black_box.Named`: ``stretch``, ``deviation``.

    Returns
    -------
    BlackBoxMinimisation
        The model.

    Raises
    ------
    InvalidData
        The function is unknown, or a number is not allowed.
    """
    kind = Member(Landscape).coerce("function", function, {})
    count = Whole(1, MOST).coerce("dimension", dimension, {})
    checked_seed = Optional(Whole(0)).coerce("seed", seed, {})
    low, high = BOUNDS[Landscape(kind)]
    data = {"name": str(kind), **fields}
    if checked_seed is not None:
        draw = np.random.default_rng(checked_seed).random((2, count))
        share = np.round(_NEAR + (_FAR - _NEAR) * draw[0], _DIGITS)
        # Twelve digits, because products of rounded numbers may differ in the last one.
        data["shift"] = np.round((high - low) * np.where(draw[1] < 0.5, -share, share), 12)
    test_function = Named.from_data(data)
    return BlackBoxMinimisation(test_function, np.tile([low, high], (count, 1)), budget, name=name)
