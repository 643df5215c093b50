"""Irreducible infeasible sets of rows and column bounds of a program."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...models.programs.base import RowProgram
from ...models.programs.blocks import Block
from ...models.programs.conic import ConicProgram
from ...models.programs.linear import QuadraticProgram

__all__ = ["Conflict", "feasibility", "find_conflict", "quick_explanation", "with_blocks"]

ProgramT = TypeVar("ProgramT", bound=RowProgram)

#: Largest number of programs that :func:`find_conflict` solves. A conflict of k among n entries needs at
#: most ``2 k log2(n / k) + 2 k``: 400 suffice for 25 rows of 1,000.
MOST = 400
#: Largest number of terms of a row that its text shows.
TERMS = 6


@dataclass(frozen=True)
class Conflict:
    """Rows and column bounds that no point satisfies together.

    Parameters
    ----------
    program : RowProgram
        The program.
    rows : tuple of int
        Rows of the conflict.
    lower, upper : tuple of int
        Columns whose lower or upper bounds belong to it.
    integral : bool
        Whether the conflict also needs the condition of integers.
    irreducible : bool
        Whether removing any of its rows or bounds ends the conflict; False if a limit ended the search.
    """

    program: RowProgram
    rows: tuple[int, ...]
    lower: tuple[int, ...]
    upper: tuple[int, ...]
    integral: bool
    irreducible: bool

    @cached_property
    def names(self) -> list[str]:
        """Names of the columns."""
        return self.program.column_labels

    def row_text(self, row: int) -> str:
        """Return a row as a formula with the names of its columns."""
        part = self.program.matrix[[row]]
        terms = ""
        for column, value in list(zip(part.indices.tolist(), part.data.tolist(), strict=True))[
            :TERMS
        ]:
            size = "" if abs(value) == 1 else f"{abs(value):.6g} "
            sign = ("- " if value < 0 else "+ ") if terms else ("-" if value < 0 else "")
            terms += f"{' ' if terms else ''}{sign}{size}{self.names[column]}"
        more = part.nnz - TERMS
        terms += f" + … ({more} more terms)" if more > 0 else ""
        low, high = float(self.program.row_lower[row]), float(self.program.row_upper[row])
        if low == high:
            return f"{terms or '0'} = {low:.6g}"
        left = f"{low:.6g} <= " if np.isfinite(low) and np.isfinite(high) else ""
        right = f"<= {high:.6g}" if np.isfinite(high) else f">= {low:.6g}"
        return f"{left}{terms or '0'} {right}"


def find_conflict(
    program: RowProgram, infeasible: Callable[[RowProgram], bool], go_on: Callable[[], bool]
) -> Conflict:
    """Return an irreducible conflict of an infeasible program.

    Cones and the condition of integers are kept. The rows are reduced first, with all column bounds, and
    then the bounds of the columns in the remaining rows.

    Parameters
    ----------
    program : RowProgram
        An infeasible program.
    infeasible : callable
        Function that returns True if a program is proven infeasible.
    go_on : callable
        Function that returns False if the time limit is reached.

    Returns
    -------
    Conflict
        Its rows and bounds exclude every point, even if the search ended early.
    """
    rows, columns = program.row_count, program.size
    solves = 0
    relaxed: Any = program
    integral = getattr(program, "integral", None)
    has_integers = integral is not None and bool(np.any(integral))
    if has_integers:
        relaxed = program.relaxed()  # type: ignore[attr-defined]
        solves += 1
        if infeasible(relaxed):
            program, has_integers = relaxed, False

    def may_solve() -> bool:
        return solves < MOST and go_on()

    def excludes(items: Sequence[int]) -> bool:
        nonlocal solves
        solves += 1
        return infeasible(_restricted(program, np.array(items, np.intp)))

    low = rows + np.flatnonzero(np.isfinite(program.column_lower))
    high = rows + columns + np.flatnonzero(np.isfinite(program.column_upper))
    bounds = np.concatenate([low, high]).tolist()
    needed = quick_explanation(bounds, list(range(rows)), excludes, may_solve)
    used = _columns_of(program, needed)
    bounds = [item for item in bounds if used[(item - rows) % columns]]
    limits = quick_explanation(needed, bounds, excludes, may_solve)
    places = np.array(limits, int) - rows
    return Conflict(
        program,
        tuple(sorted(needed)),
        tuple(sorted(places[places < columns].tolist())),
        tuple(sorted((places[places >= columns] - columns).tolist())),
        has_integers,
        may_solve(),
    )


def quick_explanation(
    background: Sequence[int],
    candidates: Sequence[int],
    excludes: Callable[[Sequence[int]], bool],
    may_solve: Callable[[], bool],
) -> list[int]:
    """Return an irreducible subset of the candidates that excludes every point with the background.

    QuickXplain of Junker, "Preferred explanations and relaxations for over-constrained problems" (AAAI
    2004), figure 2.

    Parameters
    ----------
    background, candidates : sequence of int
        Entries that exclude every point together. Those of the background are always kept.
    excludes : callable
        Function that returns True if a set of entries is proven to exclude every point.
    may_solve : callable
        Function that returns False when a limit is reached. The result is then not reduced further.
    """

    def explain(base: list[int], changed: bool, part: list[int]) -> list[int]:
        if not may_solve():
            return part
        if changed and excludes(base):
            return []
        if len(part) <= 1:
            return part
        first, second = part[: len(part) // 2], part[len(part) // 2 :]
        of_second = explain([*base, *first], True, second)
        of_first = explain([*base, *of_second], bool(of_second), first)
        return [*of_first, *of_second]

    return explain(list(background), True, list(candidates))


def _restricted(program: RowProgram, items: NDArray[np.intp]) -> RowProgram:
    """Return the program with only the rows and column bounds `items`."""
    rows, columns = program.row_count, program.size
    low = np.full(columns, -np.inf)
    high = np.full(columns, np.inf)
    lower = items[(items >= rows) & (items < rows + columns)] - rows
    upper = items[items >= rows + columns] - rows - columns
    low[lower], high[upper] = program.column_lower[lower], program.column_upper[upper]
    changed: dict[str, Any] = {"column_lower": low, "column_upper": high}
    return replace(program.only_rows(np.sort(items[items < rows])), **changed)


def _columns_of(program: RowProgram, rows: Sequence[int]) -> NDArray[np.bool_]:
    """Return the columns in `rows` and in cones; all columns without rows, whose bounds exclude each other."""
    used = np.zeros(program.size, bool)
    used[program.matrix[list(rows)].indices] = True
    cones = getattr(program, "cone_matrix", None)
    if cones is not None:
        used[cones.indices] = True
    return used if used.any() else ~used


def with_blocks(program: RowProgram) -> RowProgram:
    """Return `program` with a block of rows if it has none."""
    if program.rows or not program.row_count:
        return program
    changed: dict[str, Any] = {"rows": (Block("row", "", 0, program.row_count),)}
    return replace(program, **changed)


def feasibility(program: ProgramT) -> ProgramT:
    """Return `program` with a zero objective, because any feasible point is sufficient."""
    objective: dict[str, Any] = {"cost": program.cost * 0.0, "offset": 0.0}
    if isinstance(program, QuadraticProgram | ConicProgram):
        objective["hessian"] = program.hessian * 0.0
    return replace(program, **objective)
