"""Small programs and rational arithmetic for the tests of certificates."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import scipy.sparse as sp

from crosstrack.models.programs.linear import MixedIntegerProgram

INF = math.inf


def linear(cost, matrix, row_lower, row_upper, lower, upper, integral=False, offset=0.0):
    """Return a program; scalars are repeated."""
    matrix = np.atleast_2d(np.asarray(matrix, float))
    rows, size = matrix.shape
    return MixedIntegerProgram(
        cost=np.asarray(cost, float),
        matrix=sp.csr_array(matrix),
        row_lower=np.broadcast_to(np.asarray(row_lower, float), rows),
        row_upper=np.broadcast_to(np.asarray(row_upper, float), rows),
        column_lower=np.broadcast_to(np.asarray(lower, float), size),
        column_upper=np.broadcast_to(np.asarray(upper, float), size),
        integral=np.broadcast_to(np.asarray(integral, bool), size),
        offset=offset,
    )


def exact(vector):
    return [Fraction(entry) for entry in np.asarray(vector, float).tolist()]


def pairs(left, right):
    return zip(exact(left), exact(right), strict=True)


def times(matrix, vector):
    """Return ``matrix @ vector`` in rational arithmetic."""
    rows = matrix.toarray().tolist()
    return [
        sum((Fraction(a) * v for a, v in zip(row, vector, strict=True)), Fraction(0))
        for row in rows
    ]
