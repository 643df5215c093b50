"""Nonlinear program from many terms of a few kinds, with its exact sparse derivatives.

A term is a function of the logarithm of one duration and the local entries of its segment: the
derivatives at both ends and, above degree 2r-1, the inner coefficients. With ``y_i = T^i d_i`` the
segment has a duration of 1 s. Its cost is then ``Σ_j w_j T^(1-2j) y'G_j y``, and a bounded
derivative is ``T^-j u'y``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...programs.triplets import Triplets, dm
from .bases import unit_gram

__all__ = ["Functions", "Kind", "Terms", "assemble", "bounded", "cost"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Entries of a Gram matrix below this share of the largest entry are rounding errors.
NOISE = 1e-14


class Kind:
    """Scalar function of z = (log T, local entries) and constants c, with two derivatives.

    `value`, `first` and `second` are functions of (z, c): value, gradient, and nonzeros of the upper
    triangle of the Hessian, whose rows and columns are in `pattern`, shape (2, nonzeros).
    """

    def __init__(self, z: Any, c: Any, value: Any) -> None:
        gradient = casadi.densify(casadi.gradient(value, z))
        hessian: Any = casadi.triu(casadi.hessian(value, z)[0])
        self.value = casadi.Function("value", [z, c], [value])
        self.first = casadi.Function("first", [z, c], [gradient])
        self.second = casadi.Function("second", [z, c], [casadi.vec(hessian.nz[:])])
        self.pattern: Ints = np.array(hessian.sparsity().get_triplet(), np.int64).reshape(2, -1)


class Terms(NamedTuple):
    """Batch of terms of the same kind."""

    #: Function of every term.
    kind: Kind
    #: Segment whose duration is the first argument, shape (N,).
    segment: Ints
    #: Indices of the local entries that are the other arguments, shape (N, n).
    entries: Ints
    #: Constants of each term, shape (N, c).
    constants: Floats
    #: Row of the program for each term, shape (N,); None for terms of the objective.
    row: Ints | None


class Functions(NamedTuple):
    """Functions of a :class:`~crosstrack.models.NonlinearProgram`, in its conventions."""

    function: casadi.Function
    derivatives: casadi.Function
    hessian: casadi.Function


def cost(weights: Floats, powers: Floats, order: int) -> Kind:
    """Return the cost of one axis on one segment, for the weights of the orders 1 … r.

    `powers` are the coefficients of the basis functions on [0, 1] in powers of s, one per column.
    """
    z = casadi.SX.sym("z", 1 + len(powers))
    y = _unit(z[0], z[1:], order)
    total = casadi.SX(0)
    for j in np.flatnonzero(weights) + 1:
        gram = weights[j - 1] * unit_gram(powers, int(j))
        gram[np.abs(gram) < NOISE * np.abs(gram).max()] = 0.0
        total += casadi.exp((1 - 2 * j) * z[0]) * casadi.bilin(casadi.DM(gram), y, y)
    return Kind(z, casadi.SX.sym("c", 0), total)


def bounded(size: int, order: int, derivative: int, axes: int) -> Kind:
    """Return the term ``T^-derivative c'y`` of a derivative in time, with stacked axes in y."""
    z, c = casadi.SX.sym("z", 1 + axes * size), casadi.SX.sym("c", axes * size)
    y = [_unit(z[0], own, order) for own in casadi.vertsplit(z[1:], size)]
    return Kind(z, c, casadi.exp(-derivative * z[0]) * casadi.dot(c, casadi.vertcat(*y)))


def _unit(log: Any, entries: Any, order: int) -> Any:
    """Return the entries of the same path scaled to a duration of 1 s."""
    count = entries.numel()
    power = [*range(order), *range(order), *([0] * (count - 2 * order))]
    return casadi.vertcat(*(entries[i] * casadi.exp(p * log) for i, p in enumerate(power)))


def assemble(
    groups: list[Terms], matrix: sp.csr_array, constant: Floats, time_weight: float, rows: int,
    *, total: bool,
) -> Functions:  # fmt: skip
    """Return the program of the columns ``x = (log T, d)``.

    Local entries are ``matrix @ d + constant``, with at most one entry per row of `matrix`. Terms of
    rows are in the order of the rows. If `total`, the last row is the sum of all durations.
    """
    count, free = 1 + max(int(g.segment.max()) for g in groups), matrix.shape[1]
    size, every = count + free, np.arange(count)
    column = np.full(matrix.shape[0], -1)
    entry, own = matrix.nonzero()
    column[entry] = count + own
    x = casadi.MX.sym("x", size)
    weight, duals = casadi.MX.sym("lam_f"), casadi.MX.sym("lam_g", rows)
    durations = casadi.exp(x[:count])
    objective = time_weight * casadi.sum1(durations)
    gradient, jacobian, hessian = Triplets(), Triplets(), Triplets()
    # The durations are the first summands of the gradient and of the Hessian.
    values, firsts, seconds = [], [durations], [durations * weight * time_weight]
    first = second = count
    gradient.add(every, 0, time_weight, every)
    hessian.add(every, every, 1.0, every)
    for kind, segment, entries, constants, row in groups:
        number, flat = segment.size, entries.ravel()
        local = casadi.mtimes(casadi.MX(dm(matrix[flat])), x[count:, 0]) + casadi.DM(constant[flat])
        z = casadi.vertcat(
            x[segment.tolist(), 0].T, casadi.reshape(local, entries.shape[1], number)
        )
        c = casadi.DM(constants.T)
        value = kind.value.map(number)(z, c)
        firsts.append(casadi.vec(kind.first.map(number)(z, c)))
        if row is None:
            objective += casadi.sum2(value)
            share = casadi.repmat(weight, 1, number)
        else:
            values.append(value.T)
            share = duals[row.tolist(), 0].T
        bent = kind.second.map(number)(z, c)
        seconds.append(casadi.vec(bent * casadi.repmat(share, bent.size1(), 1)))
        places = np.column_stack([segment, column[entries]])
        source = first + np.arange(places.size).reshape(places.shape)
        moves = places >= 0
        if row is None:
            gradient.add(places[moves], 0, 1.0, source[moves])
        else:
            at = np.broadcast_to(row[:, None], places.shape)
            jacobian.add(at[moves], places[moves], 1.0, source[moves])
        pair = np.sort(places[:, kind.pattern], axis=1)
        source = second + np.arange(pair[:, 0].size).reshape(pair[:, 0].shape)
        moves = pair[:, 0] >= 0
        hessian.add(pair[:, 0][moves], pair[:, 1][moves], 1.0, source[moves])
        first, second = first + places.size, second + source.size
    if total:
        values.append(casadi.sum1(durations))
        seconds.append(durations * duals[rows - 1])
        jacobian.add(rows - 1, every, 1.0, every)
        hessian.add(every, every, 1.0, second + every)
        second += count
    given, curved = casadi.vertcat(*firsts), casadi.vertcat(*seconds)
    slopes = [
        casadi.densify(gradient.matrix((size, 1), given, first)),
        jacobian.matrix((rows, size), given, first),
    ]
    bends = [hessian.matrix((size, size), curved, second)]
    results = [objective, casadi.vertcat(*values)]
    return Functions(
        casadi.Function("times", [x], results, ["x"], ["f", "g"]),
        casadi.Function("first_order", [x], slopes, ["x"], ["grad_f", "jac_g"]),
        casadi.Function(
            "second_order", [x, weight, duals], bends, ["x", "lam_f", "lam_g"], ["hess"]
        ),
    )
