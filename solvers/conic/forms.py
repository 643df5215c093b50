"""A program with cones in the form that conic solvers read, and the way back to its multipliers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.programs.cones import ConeBlock, ConeKind, inside, order
from ...models.programs.conic import ConicProgram
from ...models.programs.linear import QuadraticProgram
from ..qp.forms import ConicForm, Core

__all__ = ["ConeForm", "Convex", "columnwise", "conic_core"]

Vector = NDArray[np.float64]
Places = NDArray[np.intp]
Convex = QuadraticProgram | ConicProgram


@dataclass(frozen=True, eq=False)
class ConeForm(ConicForm):
    """``matrix @ x + s == right`` with s zero, then nonnegative, then in the cones.

    Parameters
    ----------
    linear : int
        Number of entries of s that are zero or nonnegative.
    cones : tuple of ConeBlock
        The cones of the others, in the solver's order.
    take : ndarray of int
        Which cone row of the program each of the others is.
    """

    linear: int
    cones: tuple[ConeBlock, ...]
    take: Places

    @classmethod
    def posed(
        cls,
        program: Convex,
        kinds: Sequence[ConeKind] = (),
        orders: Callable[[ConeBlock], Places] | None = None,
    ) -> ConeForm:
        """Return `program` in this form.

        Parameters
        ----------
        program : QuadraticProgram or ConicProgram
            What is written.
        kinds : sequence of ConeKind
            The order in which the solver wants the cones; by default as they come.
        orders : callable, optional
            The order in which it wants the rows of a cone of a block, where it is not ours.
        """
        plain = ConicForm.of(program)  # type: ignore[arg-type]  # reads rows and bounds alone
        if isinstance(program, QuadraticProgram):
            return cls(**vars(plain), linear=plain.right.size, cones=(), take=np.empty(0, np.intp))
        cones = sorted(program.cones, key=lambda block: kinds.index(block.kind) if kinds else 0)
        taken = [np.empty(0, np.intp)]
        for block in cones:
            own = np.arange(block.dimension) if orders is None else orders(block)
            starts = block.start + block.dimension * np.arange(block.count)
            taken.append((starts[:, None] + own).ravel())
        take = np.concatenate(taken)
        return cls(
            sp.csc_matrix(sp.vstack([plain.matrix, -program.cone_matrix[take]])),
            np.concatenate([plain.right, program.cone_offset[take]]),
            plain.zeros,
            plain.equal,
            plain.above,
            plain.below,
            plain.right.size,
            tuple(cones),
            take,
        )

    def duals(self, conic: object, rows: int) -> Vector:
        """Return the multipliers of `rows` rows and of the cone rows, from those of this form."""
        z = np.asarray(conic, float)
        cones = np.zeros(self.take.size)
        cones[self.take] = z[self.linear :]
        return np.concatenate([super().duals(z, rows), cones])

    def slack(self, x: Vector) -> Vector:
        """Return an s for a start from `x`: as near to solving the equations as is easily had."""
        s: Vector = self.right - self.matrix @ x
        s[: self.zeros] = 0.0
        s[self.zeros : self.linear] = np.maximum(s[self.zeros : self.linear], 0.0)
        at = self.linear
        for block in self.cones:
            # Of a triangle in another order this is no projection, and still a start.
            part = s[at : at + block.size].reshape(block.count, block.dimension)
            s[at : at + block.size] = inside(block.kind, part).ravel()
            at += block.size
        return s


def columnwise(block: ConeBlock) -> Places:
    """Return where each entry of the lower triangle, column by column, stands row by row."""
    if block.kind is not ConeKind.SEMIDEFINITE:
        return np.arange(block.dimension)
    column, row = np.triu_indices(order(block.dimension))
    return row * (row + 1) // 2 + column


class _ConicCore(Core):
    """The core of a program with cones: its multipliers are those of the rows and cone rows."""

    def duals(self, duals: Vector | None) -> Vector | None:
        """Return multipliers of the whole program; none are zero."""
        if duals is None:
            return None
        rows = self.rows.size
        # All columns fixed: there is nothing to solve, and nobody gives multipliers to cones.
        cones = np.zeros(self.whole.cone_offset.size)  # type: ignore[attr-defined]
        cones[: duals.size - rows] = duals[rows:]
        found = super().duals(duals[:rows])
        assert found is not None
        return np.concatenate([found, cones])


def conic_core(whole: ConicProgram) -> Core:
    """Return the core of `whole`: all of its cones stay."""
    core = Core.of(whole.quadratic)
    kept = core.program
    program = replace(
        whole,
        **{
            name: getattr(kept, name)
            for name in (
                "cost", "hessian", "matrix", "row_lower", "row_upper", "column_lower",
                "column_upper", "offset", "columns", "rows",
            )
        },
        cone_matrix=whole.cone_matrix[:, core.columns],
        cone_offset=whole.cone_rows(core.base),
    )  # fmt: skip
    return _ConicCore(whole, program, core.columns, core.rows, core.base)  # type: ignore[arg-type]
