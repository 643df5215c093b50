"""Base classes of all programs, of block programs and of programs with linear rows."""

from __future__ import annotations

import dataclasses
import re
from abc import abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...errors import InvalidData, UnknownName
from ..fields import Array, Flag, Whole
from ..model import Model
from ..problems import resolve, table
from ..verification import TOLERANCE, Check, Verification, check_tolerance
from .blocks import Block, without
from .sources.link import Source, named_values

if TYPE_CHECKING:
    import cvxpy

__all__ = ["BlockProgram", "Program", "RowProgram", "row_maxima", "row_sizes"]

Vector = NDArray[np.float64]

#: Function that proves bounds of programs, which imports the classes of programs.
_PROVEN = ".models.programs.certificates:proven"


@dataclass(frozen=True, eq=False, repr=False)
class Program(Model[Vector]):
    """Base of all programs: minimise an objective of a column vector under blocks of rows.

    Parameters
    ----------
    name : str
        Label of the program, which is not part of the content.
    maximise : bool
        Whether the program was written as a maximisation: `cost` and `offset` are then the negated
        ones of its author. Bounds and records contain the minimised objective, and printed results
        the author's. Keyword only, False by default.
    """

    maximise: bool = dataclasses.field(
        default=False, kw_only=True, metadata={"spec": Flag(), "added": True}
    )

    plan_type: ClassVar[type] = np.ndarray
    has_variables: ClassVar[bool] = True

    @property
    def source(self) -> Source | None:
        """Object that was converted to this program and that receives plans; None for other programs."""
        return self.__dict__.get("_source")

    def with_source(self, source: Source) -> Self:
        """Return the program with a link to the object that was converted to it.

        The link is neither part of the content nor of files, and worker processes do not receive it.

        Parameters
        ----------
        source : Source
            The link.
        """
        linked = object.__new__(type(self))
        linked.__dict__.update(self.__dict__, _source=source)
        return linked

    def renamed(self, name: str) -> Self:
        """Return the same program under another name."""
        result = super().renamed(name)
        return result if self.source is None else result.with_source(self.source)

    def proven(self, bound: float, duals: Any, plan: Vector | None) -> tuple[float, str]:
        """Return a lower bound and the kind of its proof, a value of :class:`~.certificates.Proof`.

        Parameters
        ----------
        bound : float
            Lower bound that a solver states.
        duals : ndarray, shape (m,), optional
            Row multipliers of the solver.
        plan : ndarray, shape (n,), optional
            Column vector of the solver.
        """
        result: tuple[float, str] = resolve(_PROVEN)(self, bound, duals, plan)
        return result

    def outline(self) -> str:
        """Return the size of the program in one line."""
        return f"{self.size} columns"

    def describe(self) -> Any:
        """Return a report on the program; printing it shows tables.

        Returns
        -------
        Description
            The class, sizes, density and ranges of coefficients of the program, its special rows and
            columns, whether it is convex, and the backends that accept it; see
            :class:`~crosstrack.solvers.programs.description.Description`.
        """
        reports = table(f"{__name__.partition('.')[0]}.solvers", "DESCRIPTIONS")
        return resolve(reports["program"])(self)

    def details(self, plan: Vector) -> list[dict[str, Any]]:
        """Return one row per value that is not 0, by the author's names, the largest first."""
        return [
            {"variable": name, "value": value}
            for name, value in named_values(self.values_of(plan))
            if value
        ]

    def values_of(self, plan: Vector) -> dict[str, Any]:
        """Return the values of the columns by the names of their author.

        Parameters
        ----------
        plan : ndarray, shape (n,)
            Column vector.

        Returns
        -------
        dict
            For a program made from another library's object the values of its variables. Otherwise one
            entry per block of columns, or per column if the block names each of them.
        """
        if self.source is not None:
            return dict(self.source.values(plan))
        return {"x": np.array(plan)}

    def plan_to_data(self, plan: Vector) -> Any:
        """Return the column vector as a list."""
        return np.asarray(plan, float).tolist()

    def plan_from_data(self, data: Any) -> Vector:
        """Return the column vector in `data`."""
        size = self.size
        return Array((size,)).coerce("point", data, {})

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of columns."""

    if TYPE_CHECKING:

        @property
        def guess(self) -> Vector | None:
            """Start of a search; None if the program has none."""

    else:
        # Not a property at run time, because a subclass may declare a field of this name.
        guess = None

    def dual_bound(self, duals: Vector, point: Vector) -> float:
        """Return the lower bound on the objective that row multipliers prove; -inf by default.

        Parameters
        ----------
        duals : ndarray, shape (m,)
            Row multipliers: ``duals[i] >= 0`` belongs to the lower bound of row i, ``<= 0`` to the
            upper bound.
        point : ndarray, shape (n,)
            Point of the multipliers.

        Returns
        -------
        float
            Lower bound on the objective of all feasible points.
        """
        return -np.inf


class BlockProgram(Program):
    """Base of programs whose rows and columns have bounds and are grouped in named blocks.

    Subclasses are dataclasses that declare the fields below and define the objective.

    Attributes
    ----------
    row_lower, row_upper : ndarray, shape (m,)
        Row bounds; infinite for none.
    column_lower, column_upper : ndarray, shape (n,)
        Column bounds; infinite for none.
    columns, rows : tuple of Block
        Names and equations; either empty or a complete cover.
    """

    if TYPE_CHECKING:
        row_lower: Vector
        row_upper: Vector
        column_lower: Vector
        column_upper: Vector
        columns: tuple[Block, ...]
        rows: tuple[Block, ...]

    @abstractmethod
    def objective(self, point: Vector) -> float:
        """Return the objective at `point`."""

    def check(self) -> None:
        """Raise if the blocks do not cover the program."""
        for name, blocks, size in (
            ("columns", self.columns, self.size),
            ("rows", self.rows, self.row_count),
        ):
            if blocks and sum(block.size for block in blocks) != size:
                raise InvalidData(
                    f"{name}: the blocks cover {sum(b.size for b in blocks)} of {size}", field=name
                )

    @property
    def size(self) -> int:
        """Number of columns."""
        return int(self.column_lower.size)

    @property
    def row_count(self) -> int:
        """Number of rows."""
        return int(self.row_lower.size)

    def outline(self) -> str:
        """Return the size in a few words."""
        integral = "" if self.continuous else f", {int(self.integer_columns.sum())} integral"
        return f"{self.row_count} rows, {self.size} columns{integral}"

    @property
    def integer_columns(self) -> NDArray[np.bool_]:
        """Columns that must be integers, shape (n,)."""
        integral = getattr(self, "integral", None)
        return np.zeros(self.size, bool) if integral is None else integral

    @property
    def continuous(self) -> bool:
        """Whether no column must be an integer."""
        return not self.integer_columns.any()

    @property
    def _rows(self) -> tuple[Block, ...]:
        return self.rows or ((Block("row", "", 0, self.row_count),) if self.row_count else ())

    @property
    def _columns(self) -> tuple[Block, ...]:
        return self.columns or ((Block("column", "", 0, self.size),) if self.size else ())

    def values_of(self, plan: Vector) -> dict[str, Any]:
        """Return the values of the columns by the names of their author; see :meth:`.Program.values_of`."""
        if self.source is not None or not self.columns:
            return super().values_of(plan)
        result: dict[str, Any] = {}
        for block in self.columns:
            part = plan[block.slice]
            named = dict(zip(block.labels, part.tolist(), strict=True)) if block.labels else {}
            result.update(named or {block.name: np.array(part)})
        return result

    def _point(self, plan: Vector) -> Vector:
        """Return `plan` as a column vector of this program, or raise ``InvalidData``."""
        return Array((self.size,)).coerce("point", plan, {})

    def _checks(
        self,
        point: Vector,
        rows: Vector,
        row_sizes: Vector,
        column_sizes: Vector,
        tolerance: float,
        violations: tuple[Vector | None, Vector | None] = (None, None),
    ) -> tuple[Check, ...]:
        """Return the worst violation of every block and of integrality; see :meth:`.RowProgram.verify`.

        The violations of rows and columns are computed unless they are given.
        """
        check_tolerance(tolerance)
        result = []
        columns = point, self.column_lower, self.column_upper, column_sizes, self._columns
        for (value, lower, upper, size, blocks), given in zip(
            ((rows, self.row_lower, self.row_upper, row_sizes, self._rows), columns),
            violations,
            strict=True,
        ):
            violation = np.maximum(np.maximum(lower - value, value - upper), 0.0)
            violation = violation if given is None else given
            near = np.where(value - lower < upper - value, lower, upper)
            bound = np.where(np.isfinite(near), np.abs(near), 0.0)
            scale = np.maximum(size, bound)
            result += [
                Check.largest(
                    block.name, violation[block.slice], scale[block.slice], block.unit,
                    lambda entry, block=block: re.sub(r"^(at|along|in) ", "", block.place(entry)), tolerance,
                    equation=block.equation, limit=bound[block.slice],
                )
                for block in blocks
                if block.size
            ]  # fmt: skip
        if not self.continuous:
            # The difference of a float and the nearest integer is exact.
            apart = np.where(self.integer_columns, np.abs(point - np.round(point)), 0.0)
            result.append(Check.largest("integrality", apart, 1.0, "", self.column_name, tolerance))
        return tuple(result)

    def row_name(self, row: int) -> str:
        """Return the name of a row in the paper's terms."""
        return _name("row", self._rows, row)

    def column_name(self, column: int) -> str:
        """Return the name of a column in the paper's terms."""
        return _name("column", self._columns, column)

    @property
    def column_labels(self) -> list[str]:
        """Names of the columns by their author, such as ``"x[1, 2]"``."""
        return [label for block in self._columns for label in block.entry_labels]

    @property
    def row_labels(self) -> list[str]:
        """Names of the rows by their author."""
        return [label for block in self._rows for label in block.entry_labels]

    def column_block(self, name: str) -> Block:
        """Return the block of columns called `name`, or raise ``UnknownName``."""
        for block in self.columns:
            if isinstance(name, str) and block.name == name:
                return block
        raise UnknownName("block of columns", name, [block.name for block in self.columns])


class RowProgram(BlockProgram):
    """Base of programs with ``row_lower <= matrix @ x <= row_upper`` and column bounds.

    Subclasses are dataclasses that declare the fields below and define the objective.

    Attributes
    ----------
    cost : ndarray, shape (n,)
        Linear objective coefficients.
    matrix : sparse array, shape (m, n)
        Row coefficients.
    offset : float
        Constant of the objective.
    """

    if TYPE_CHECKING:
        cost: Vector
        matrix: sp.csr_array
        offset: float

    kind: ClassVar[str] = "linearly-constrained-program"

    def shared(self) -> dict[str, Any]:
        """Return the fields that all programs with linear rows have, by name."""
        names = (
            *("cost", "matrix", "row_lower", "row_upper", "column_lower", "column_upper", "offset"),
            *("columns", "rows", "name", "maximise"),
        )
        return {name: getattr(self, name) for name in names}

    @np.errstate(all="ignore")  # overflow gives inf or NaN, which is a violation
    def verify(self, plan: Vector, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the objective and the worst violation of every block and of integrality.

        The tolerance of a column is relative to its bound, that of a row to the largest of its terms
        and bounds. If these are 0, the scale is the other bound of the column, or the row's largest
        coefficient times the size of its column, at most 1.
        """
        point = self._point(plan)
        columns = self._column_sizes
        rows = row_sizes(self.matrix, point, columns)
        checks = self._checks(point, self.matrix @ point, rows, columns, tolerance)
        scale = self._objective_size
        return Verification(self.objective(point), checks, scale=scale, maximise=self.maximise)

    @property
    def _objective_size(self) -> float:
        """Largest coefficient of the objective, at most 1; 1 if all are 0."""
        hessian = getattr(self, "hessian", None)
        parts = [self.cost, [self.offset], [] if hessian is None else hessian.data]
        return min(float(np.abs(np.concatenate(parts)).max()), 1.0) or 1.0

    @property
    def _column_sizes(self) -> Vector:
        """Sizes of columns whose nearest bound is 0: the other bound, at most 1."""
        bounds = np.abs([self.column_lower, self.column_upper])
        size = np.where(np.isfinite(bounds), bounds, 0.0).max(axis=0)
        return np.where(size > 0, np.minimum(size, 1.0), 1.0)

    def signed(self, duals: Vector) -> Vector:
        """Return `duals` with 0 for multipliers of a row bound that does not exist."""
        y = np.asarray(duals, float)
        return np.where(np.isfinite(np.where(y > 0, self.row_lower, self.row_upper)), y, 0.0)

    def row_terms(self, duals: Vector) -> Vector:
        """Return the products of the multipliers with the row bounds that they belong to, shape (m,)."""
        with np.errstate(invalid="ignore"):
            bounds = np.where(duals > 0, self.row_lower, self.row_upper)
            return np.where(duals == 0, 0.0, duals * bounds)

    def sides(self) -> Iterator[tuple[str, NDArray[np.intp], Vector]]:
        """Yield the equality rows, the rows with lower bounds and the rows with upper bounds.

        Each item is the sense ``"="``, ``">"`` or ``"<"``, the row indices and their bounds. Empty
        groups are omitted. A row with two different bounds appears in two groups.
        """
        low, high = self.row_lower, self.row_upper
        equal = low == high
        for sense, take, bound in (
            ("=", equal, low),
            (">", ~equal & np.isfinite(low), low),
            ("<", ~equal & np.isfinite(high), high),
        ):
            if take.any():
                yield sense, np.flatnonzero(take), bound[take]

    @property
    def conditions(self) -> tuple[Block, ...]:
        """Blocks that :meth:`without_rows` can remove."""
        return self.rows

    @cached_property
    def second_objectives(self) -> dict[str, str]:  # type: ignore[override]
        """Rows with upper bounds or without bounds, whose values :func:`crosstrack.front` limits."""
        usable = np.isfinite(self.row_upper) | ~np.isfinite(self.row_lower)
        usable &= self.row_lower < self.row_upper
        labels = self.row_labels
        return {labels[row]: "row_upper" for row in np.flatnonzero(usable)}

    def second_objective(self, name: str, plan: Vector) -> float:
        """Return the value of the row called `name` at `plan`."""
        return float((self.matrix[[self._row(name)]] @ plan)[0])

    def limited(self, name: str, value: float) -> Self:
        """Return the program with the value of the row called `name` limited to at most `value`."""
        upper, row = self.row_upper.copy(), self._row(name)
        upper[row] = min(upper[row], value)
        changed: dict[str, Any] = {"row_upper": upper}
        return replace(self, **changed)

    def _row(self, name: str) -> int:
        if name not in self.second_objectives:
            raise UnknownName(
                f"row of {self.kind!r} with an upper bound", name, self.second_objectives
            )
        return self.row_labels.index(name)

    def without_rows(self, names: Iterable[str]) -> Self:
        """Return the program without the row blocks called `names`."""
        take, blocks = without(self.rows, names)
        return self.only_rows(take, blocks)

    def only_rows(self, take: NDArray[np.intp], rows: tuple[Block, ...] = ()) -> Self:
        """Return the program with only the rows `take`, which form the blocks `rows`."""
        names = ("matrix", "row_lower", "row_upper")
        changed: dict[str, Any] = {name: getattr(self, name)[take] for name in names}
        changed["rows"] = rows
        return replace(self, **changed)

    def to_cvxpy(self) -> tuple[cvxpy.Problem, cvxpy.Variable]:
        """Return a ``cvxpy.Problem`` and its variable, the column vector in the same order."""
        from .export import cvxpy_problem

        return cvxpy_problem(self)


def row_sizes(matrix: sp.csr_array, point: Vector, columns: Vector) -> Vector:
    """Return the largest term of each row, at least that of columns of size `columns`, capped at 1."""
    sizes = abs(matrix)
    smallest = row_maxima(sizes if (columns == 1.0).all() else sizes @ sp.diags_array(columns))
    smallest = np.where(smallest > 0, np.minimum(smallest, 1.0), 1.0)
    sizes.data *= np.abs(point)[sizes.indices]  # the terms
    return np.maximum(row_maxima(sizes), smallest)


def row_maxima(matrix: sp.csr_array) -> Vector:
    """Return the largest magnitude of the entries of each row; 0 for empty rows."""
    # SciPy's own maximum takes 0.5 ms for any size.
    result = np.zeros(matrix.shape[0])
    filled = np.flatnonzero(np.diff(matrix.indptr))
    if filled.size:
        result[filled] = np.maximum.reduceat(np.abs(matrix.data), matrix.indptr[filled])
    return result


def _name(what: str, blocks: Sequence[Block], entry: int) -> str:
    count = sum(block.size for block in blocks)
    place = Whole(0, count - 1).coerce(what, entry, {})
    block = next(item for item in blocks if place < item.start + item.size)
    return block.describe(place - block.start)
