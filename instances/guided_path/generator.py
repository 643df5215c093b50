"""Seeded instances of a guided vehicle's tour: integer coordinates, with chains or any relation.

All random numbers come from ``Generator.random``, so that a seed yields the same instance on every
machine.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.fields import Real, Whole
from ...models.guided_path.data import MOST
from ...models.guided_path.model import GuidedPathTour

__all__ = ["generate", "generate_relation"]

#: Largest coordinate, so that coordinates and their sums over any tour are exact integers.
_LARGEST = 2**31


def generate(
    chains: int, length: int, seed: int, lowest: int = 1, highest: int = 200, *, name: str = ""
) -> GuidedPathTour:
    """Return a tour of chains of equal length, as drawn for Table 1 of the paper.

    Parameters
    ----------
    chains, length : int
        Number of chains, and of customers in each; chain 0 contains customers 1, 2, …
    seed : int
        Seed, at least 0. The same seed yields the same coordinates.
    lowest, highest : int
        Range of the uniform integer coordinates, in m, both included. The start is at 0.
    name : str
        Name of the model.

    Returns
    -------
    GuidedPathTour
        The model.

    Raises
    ------
    InvalidData
        A value is out of range. The message contains its name.
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
    """Return a tour with a random acyclic relation.

    Parameters
    ----------
    customers : int
        Number of customers.
    density : float
        Probability that a customer must precede another one with a larger number, 0 to 1.
    seed, lowest, highest, name
        As for :func:`generate`.

    Returns
    -------
    GuidedPathTour
        The model.

    Raises
    ------
    InvalidData
        A value is out of range. The message contains its name.
    """
    count = Whole(1, MOST).coerce("customers", customers, {})
    share = Real(lower=0.0, upper=1.0).coerce("density", density, {})
    places, rng = _drawn(count, seed, lowest, highest)
    pairs = 1 + np.argwhere(np.triu(rng.random((count, count)) < share, 1))
    return GuidedPathTour(places, precedence=pairs, name=name)


def _drawn(
    count: int, seed: int, lowest: int, highest: int
) -> tuple[NDArray[np.float64], np.random.Generator]:
    """Return the coordinates, that of the start first, and the random generator."""
    low, high = (
        Whole(-_LARGEST, _LARGEST).coerce(name, value, {})
        for name, value in (("lowest", lowest), ("highest", highest))
    )
    if low > high:
        raise InvalidData(f"lowest must be <= highest, {high}, got {low}", field="lowest")
    rng = np.random.default_rng(Whole(0).coerce("seed", seed, {}))
    drawn = low + np.floor(rng.random(count) * (high - low + 1))
    return np.concatenate([[0.0], drawn]), rng
