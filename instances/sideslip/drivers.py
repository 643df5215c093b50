"""Drivers with preview, and the uniform design of the training drivers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.declaration import Declared
from ...models.fields import Real, declared

__all__ = ["FIXED", "HELD_OUT", "RANGES", "Design", "Driver", "design_drivers", "uniform_design"]

#: Rows of the design table U15(15^8) of the paper's Table 1, and the factors of its columns: the numbers below 15
#: that are coprime to it.
ROWS, FACTORS = 15, (1, 2, 4, 7, 8, 11, 13, 14)
#: Columns of that table for three factors, from the paper's Table 2.
COLUMNS = (0, 2, 3)
#: Minimum and maximum of the factors in the order of the paper's text: T_d, T_h and T. The paper does not print them.
RANGES = {"delay": (0.05, 0.15), "lag": (0.05, 0.15), "preview": (0.75, 1.2)}
#: Other parameters of the training drivers. The paper neither varies nor prints them.
FIXED = {"correction": 0.15, "gain": 0.95}


@dataclass(frozen=True, eq=False)
class Driver(Declared):
    """Driver with preview of the road ahead.

    Parameters
    ----------
    preview : float
        Preview time, s, 0.1 … 10 (paper: T).
    correction : float
        Time constant of the compensation for the vehicle's lag, s, 0 … 10 (paper: T_c).
    gain : float
        Steering angle per lateral acceleration (paper: C_0), as a multiple of that of a steady turn, 0 … 100.
    delay : float
        Reaction time, s, 0 … 10 (paper: T_d).
    lag : float
        Time constant of the muscles, s, 0.001 … 10 (paper: T_h).
    """

    preview: float = declared(Real(lower=0.1, upper=10.0, unit="s"))
    correction: float = declared(Real(lower=0, upper=10.0, unit="s"))
    gain: float = declared(Real(lower=0, upper=100.0))
    delay: float = declared(Real(lower=0, upper=10.0, unit="s"))
    lag: float = declared(Real(lower=0.001, upper=10.0, unit="s"))


#: Driver of the estimated drive, not part of the design.
HELD_OUT = Driver(preview=0.9, correction=0.14, gain=0.98, delay=0.11, lag=0.09)


class Design(StrEnum):
    """Method of choosing the training drivers."""

    #: The factors follow a uniform design table (Fang and Wang, Number-theoretic Methods in Statistics, 1994).
    UNIFORM = "uniform"
    #: The factors are drawn uniformly at random.
    RANDOM = "random"


def uniform_design() -> NDArray[np.int64]:
    """Return the table U15(15^8) of the paper's Table 1, shape (15, 8): row i of column j is ``i h_j`` modulo 15.

    The entry is 15 instead of 0.
    """
    table: NDArray[np.int64] = np.outer(np.arange(1, ROWS + 1), FACTORS) % ROWS
    return np.where(table == 0, ROWS, table)


def design_drivers(count: int, design: Design, rng: np.random.Generator) -> tuple[Driver, ...]:
    """Return `count` training drivers whose three factors are within :data:`RANGES`.

    A uniform design of fewer than 15 drivers uses the first rows of the table. The factors of the 16th
    and later drivers are random.
    """
    low, high = np.array(list(RANGES.values())).T
    shares = rng.random((count, len(RANGES)))
    if design is Design.UNIFORM:
        levels = uniform_design()[:count, COLUMNS]
        shares[: len(levels)] = (levels - 1.0) / (ROWS - 1)
    parts: Any = np.round(low + (high - low) * shares, 6).tolist()
    return tuple(Driver(**dict(zip(RANGES, factors, strict=True)), **FIXED) for factors in parts)
