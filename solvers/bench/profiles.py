"""Performance and data profiles: share of instances solved within a factor or a budget."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, show

__all__ = ["Profile", "data_profile", "performance_profile"]

Floats = NDArray[np.float64]

#: For each backend the abscissae at which its share rises, ascending, and the shares from there on.
Profile = dict[str, tuple[Floats, Floats]]


def performance_profile(measures: Mapping[str, Sequence[float]]) -> Profile:
    r"""Return performance profiles.

    :math:`\rho_s(\tau)` is the share of the instances on which backend :math:`s` needs at most
    :math:`\tau` times the measure of the best backend on that instance. At 1 it is the share on which
    it is the best, including ties; in the limit, the share it solves at all. Instances that no
    backend solves count in every denominator.

    Parameters
    ----------
    measures : mapping of str to sequence of float
        One measure > 0 per instance and backend, such as seconds, with the instances in the same
        order; inf for a failure.

    Returns
    -------
    mapping of str to (ndarray, ndarray)
        Ratios :math:`\tau`, ascending from 1, and the shares :math:`\rho_s` from there on.

    Raises
    ------
    InvalidData
        A measure is not > 0, or the backends have different numbers of them.

    References
    ----------
    E. D. Dolan, J. J. Moré: Benchmarking optimization software with performance profiles, Mathematical
    Programming 91, 2002. Curves of several backends say which of two is better only pair by pair: N.
    Gould, J. Scott, ACM Transactions on Mathematical Software 43, 2016.
    """
    table = _table(measures)
    best = table.min(axis=0, initial=math.inf)
    solved = np.isfinite(best)
    ratios = np.full(table.shape, math.inf)
    with np.errstate(over="ignore"):  # a ratio beyond all floats is never reached
        ratios[:, solved] = table[:, solved] / best[solved]
    return {name: _steps(row, 1.0) for name, row in zip(measures, ratios, strict=True)}


def data_profile(evaluations: Mapping[str, Sequence[float]], dimensions: Sequence[int]) -> Profile:
    r"""Return data profiles of derivative-free searches.

    :math:`d_s(\kappa)` is the share of the instances that backend :math:`s` solves within
    :math:`\kappa (n_p + 1)` evaluations of the objective with :math:`n_p` variables. One unit of
    :math:`\kappa` is the cost of a gradient by finite differences.

    Parameters
    ----------
    evaluations : mapping of str to sequence of float
        Evaluations > 0 until the instance was solved, per instance and backend, with the instances
        in the same order; inf for a failure.
    dimensions : sequence of int
        Number of variables of each instance, >= 1.

    Returns
    -------
    mapping of str to (ndarray, ndarray)
        :math:`\kappa`, ascending from 0, and the shares from there on.

    Raises
    ------
    InvalidData
        As in :func:`performance_profile`, or `dimensions` has another length or values below 1.

    References
    ----------
    J. J. Moré, S. M. Wild: Benchmarking derivative-free optimization algorithms, SIAM Journal on
    Optimization 20, 2009.
    """
    table = _table(evaluations)
    try:
        sizes = np.asarray(dimensions, float)
    except (TypeError, ValueError):
        sizes = np.empty(())  # a shape that fits no list of instances
    if sizes.shape != table.shape[1:] or not (sizes >= 1).all():
        raise InvalidData(
            f"dimensions must be {table.shape[1]} whole numbers >= 1, one per instance",
            field="dimensions",
        )
    return {
        name: _steps(row, 0.0) for name, row in zip(evaluations, table / (sizes + 1), strict=True)
    }


def _steps(places: Floats, begin: float) -> tuple[Floats, Floats]:
    """Return the abscissae at which the share rises, starting with `begin`, and the shares."""
    finite = np.sort(places[np.isfinite(places)])
    steps = np.unique(np.append(finite, begin))
    shares = np.searchsorted(finite, steps, side="right") / max(places.size, 1)
    return steps, shares


def _table(measures: Mapping[str, Sequence[float]]) -> Floats:
    try:
        rows = [np.asarray(row, float) for row in measures.values()]
    except (AttributeError, TypeError, ValueError):
        raise InvalidData(
            f"measures must be numbers by backend, got {show(measures)}", field="measures"
        ) from None
    if not rows or any(row.ndim != 1 or row.shape != rows[0].shape for row in rows):
        sizes = [row.size for row in rows]
        raise InvalidData(
            f"measures must be equally many for each backend, got {sizes}", field="measures"
        )
    table = np.array(rows)
    if not (table > 0).all():  # rejects NaN, too
        raise InvalidData("measures must be > 0, inf where a backend failed", field="measures")
    return table
