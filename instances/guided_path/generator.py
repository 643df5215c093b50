"""Seeded instances of a guided vehicle's tour: whole coordinates, with chains or any relation.

Only ``Generator.random`` is drawn from, so that a seed means the same instance wherever it is used.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.fields import Real, Whole
from ...models.guided_path.data import MOST
from ...models.guided_path.model import GuidedPathTour

__all__ = ["generate", "generate_relation"]

#: Whole numbers up to this size are exact, and so are their sums over any tour.
_LARGEST = 2**31


def generate(
    chains: int, length: int, seed: int, lowest: int = 1, highest: int = 200, *, name: str = ""
) -> GuidedPathTour:
    """Return a tour of chains of equal length: what table 1 of the paper draws.

    Parameters
    ----------
    chains, length : int
        Number of chains, and of the customers in each; chain 0 holds customers 1, 2, …
    seed : int
        Same seed, same coordinates.
    lowest, highest : int
        Coordinates are drawn uniformly from these whole numbers and those between, m. The start is
        at 0.
    name : str
        Of the model.

    Raises
    ------
    InvalidData
        A number that is not allowed, named.
    """
    many = Whole(1, MOST).coerce("chains", chains, {})
    each = Whole(1, MOST // many).coerce("length", length, {})
    places, _ = _drawn(many * each, seed, lowest, highest)
    members = np.arange(1, many * each + 1).reshape(many, each)
    return GuidedPathTour.from_data({"coordinates": places, "chains": members.tolist()}, name=name)


def generate_relation(
    customers: int,
    density: float,
    seed: int,
    lowest: int = 1,
    highest: int = 200,
    *,
    name: str = "",
) -> GuidedPathTour:
    """Return a tour under a random acyclic relation.

    Parameters
    ----------
    customers : int
        Their number.
    density : float
        How likely it is that a customer must precede another one of a larger number, 0 to 1.
    seed, lowest, highest, name
        As for :func:`generate`.

    Raises
    ------
    InvalidData
        A number that is not allowed, named.
    """
    count = Whole(1, MOST).coerce("customers", customers, {})
    share = Real(lower=0.0, upper=1.0).coerce("density", density, {})
    places, rng = _drawn(count, seed, lowest, highest)
    pairs = 1 + np.argwhere(np.triu(rng.random((count, count)) < share, 1))
    return GuidedPathTour(places, precedence=pairs, name=name)


def _drawn(
    count: int, seed: int, lowest: int, highest: int
) -> tuple[NDArray[np.float64], np.random.Generator]:
    """Return coordinates, that of the start first, and what further numbers are drawn from."""
    low, high = (
        Whole(-_LARGEST, _LARGEST).coerce(name, value, {})
        for name, value in (("lowest", lowest), ("highest", highest))
    )
    if low > high:
        raise InvalidData(f"lowest must be <= highest, {high}, got {low}", field="lowest")
    rng = np.random.default_rng(Whole(0).coerce("seed", seed, {}))
    drawn = low + np.floor(rng.random(count) * (high - low + 1))
    return np.concatenate([[0.0], drawn]), rng
