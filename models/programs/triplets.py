"""Sparse matrices whose entries are constants and multiples of function values."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import casadi
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

__all__ = ["Triplets", "dm"]

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]


@dataclass(eq=False)
class Triplets:
    """Entries of a sparse matrix: constants, and multiples of function values.

    A source is an index in the vector of all function values; -1 marks a constant.
    """

    rows: list[Whole] = field(default_factory=list)
    columns: list[Whole] = field(default_factory=list)
    factors: list[Floats] = field(default_factory=list)
    sources: list[Whole] = field(default_factory=list)

    def add(self, rows: Any, columns: Any, factors: Any, sources: Any = -1) -> None:
        """Add entries; scalars are broadcast."""
        parts = np.broadcast_arrays(rows, columns, factors, sources)
        flat = [np.asarray(part).reshape(-1) for part in parts]
        self.rows.append(flat[0].astype(np.int64))
        self.columns.append(flat[1].astype(np.int64))
        self.factors.append(flat[2].astype(float))
        self.sources.append(flat[3].astype(np.int64))

    def joined(self) -> tuple[Whole, Whole, Floats, Whole]:
        """Return rows, columns, factors and sources of all entries."""
        none = np.empty(0)
        rows, columns, sources = (
            np.concatenate([*parts, none]).astype(np.int64)
            for parts in (self.rows, self.columns, self.sources)
        )
        return rows, columns, np.concatenate([*self.factors, none]), sources

    def matrix(self, shape: tuple[int, int], given: Any, count: int) -> Any:
        """Return the matrix in CasADi's symbols, with function values from the vector `given` of length `count`."""
        rows, columns, factors, sources = self.joined()
        pattern = sp.csc_array((np.ones(rows.size), (rows, columns)), shape=shape)
        pattern.sum_duplicates()
        pattern.sort_indices()
        # Index of each entry among the nonzeros, column by column as in CasADi.
        keys = np.repeat(np.arange(shape[1]), np.diff(pattern.indptr)) * shape[0] + pattern.indices
        place = np.searchsorted(keys, columns * shape[0] + rows)
        fixed = sources < 0
        constant = np.bincount(place[fixed], factors[fixed], minlength=pattern.nnz)
        moving = sp.csc_array(
            (factors[~fixed], (place[~fixed], sources[~fixed])), shape=(pattern.nnz, count)
        )
        sparsity = _sparsity(pattern)
        values = casadi.MX(casadi.DM(constant))
        if moving.nnz:
            values = values + casadi.mtimes(casadi.MX(dm(moving)), given)
        return casadi.MX(sparsity, values)


def dm(matrix: Any) -> casadi.DM:
    """Return a sparse SciPy matrix as a ``casadi.DM``."""
    csc = sp.csc_array(matrix)
    csc.sort_indices()
    return casadi.DM(_sparsity(csc), csc.data)


def _sparsity(csc: Any) -> casadi.Sparsity:
    # CasADi reads lists 25 times as fast as arrays of whole numbers.
    rows, columns = csc.shape
    return casadi.Sparsity(rows, columns, csc.indptr.tolist(), csc.indices.tolist())
