"""Tables of answers and verdicts, as text for ``print`` and as rich tables for a terminal."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from ...models.problems import model_type, model_types
from ...models.verification import Verification
from ..backend import Limit, Termination
from ..solution import Solution
from .fitting import FittedTable

if TYPE_CHECKING:
    from ..repeats import Spread

__all__ = [
    "number",
    "render",
    "seconds_text",
    "solutions_table",
    "spreads_table",
    "table",
    "verification_table",
]

#: Seconds of compilation below which nobody would notice it.
_NOTICEABLE = 0.05

_STYLES = {
    Termination.OPTIMAL: "green",
    Termination.LOCALLY_OPTIMAL: "green",
    Termination.REJECTED: "bold red",
    Termination.FAILED: "bold red",
}


def table(
    title: str,
    columns: Sequence[str],
    rows: Iterable[Sequence[Any]],
    *,
    right: Sequence[str] = (),
    whole: Sequence[str] = (),
    drop: Sequence[str] = (),
) -> FittedTable:
    """Return a table that fits the terminal it is printed on.

    Parameters
    ----------
    title : str
        Above the table; empty for none.
    columns : sequence of str
        Headers.
    rows : iterable of sequence
        The cells: text, or anything that has a ``str``.
    right : sequence of str
        Columns of numbers, aligned right and never folded.
    whole : sequence of str
        Further columns that are never folded; the first one, which names the row, is one of them.
    drop : sequence of str
        Columns that a narrow terminal leaves out, the first one first.
    """
    from rich.text import Text

    place = {name: k for k, name in enumerate(columns)}
    return FittedTable(
        title,
        tuple(columns),
        [[cell if isinstance(cell, Text) else Text(str(cell)) for cell in row] for row in rows],
        frozenset(place[name] for name in right),
        frozenset({0, *(place[name] for name in (*right, *whole))}),
        tuple(place[name] for name in drop if name in place),
    )


def render(*parts: Any, width: int = 120) -> str:
    """Return rich tables and text as plain text, without colours."""
    from rich.console import Console

    console = Console(file=io.StringIO(), width=width, color_system=None, legacy_windows=False)
    for part in parts:
        console.print(part, markup=False, highlight=False, soft_wrap=isinstance(part, str))
    output = console.file
    assert isinstance(output, io.StringIO)
    return "\n".join(line.rstrip() for line in output.getvalue().splitlines())


def number(value: float | None, digits: int = 3) -> str:
    """Return a bound for people: fixed decimals, six digits at least, an empty cell for None."""
    if value is None:
        return ""
    if value and not 1e-3 <= abs(value) < 1e9:
        return f"{value:.6g}"
    whole = len(str(int(abs(value)))) if abs(value) >= 1 else 0
    return f"{value:.{max(digits, digits + 3 - whole)}f}"


def seconds_text(value: float | None) -> str:
    """Return seconds with a unit that fits."""
    if value is None:
        return ""
    for factor, unit in ((1.0, "s"), (1e3, "ms"), (1e6, "µs")):
        if value * factor >= 1 or unit == "µs":
            return f"{value * factor:.3g} {unit}"
    return ""


def _ended(solution: Solution[Any]) -> Any:
    from rich.text import Text

    text = str(solution.termination)
    if solution.limit is not None:
        text += f", {'interrupted' if solution.limit is Limit.INTERRUPTED else f'{solution.limit} limit'}"
    return Text(text, style=_STYLES.get(solution.termination, ""))


def solutions_table(solutions: Sequence[Solution[Any]], title: str = "") -> FittedTable:
    """Return a table of answers: objective, bound, gap, seconds and verification of each.

    Compilation, which only a first call on a machine pays for, has a column of its own where it
    took a noticeable time, and is no part of the total shown.
    """
    kind = solutions[0].model if solutions else ""
    unit = model_type(kind).objective_unit if kind in model_types() else ""
    if not isinstance(unit, str):
        unit = ""  # each problem of the kind has its own
    objective = f"objective ({unit})" if unit else "objective"
    compiled = any(s.seconds.get("compile", 0.0) > _NOTICEABLE for s in solutions)
    rows = []
    for s in solutions:
        first = s.seconds.get("compile", 0.0)
        total = s.seconds.get("total")
        rows.append(
            (
                s.backend + (f" : {s.formulation}" if s.formulation else ""),
                _ended(s),
                number(s.primal_bound),
                number(s.dual_bound),
                "" if s.gap is None else f"{s.gap:.1e}" if s.gap else "0",
                seconds_text(s.seconds.get("solve")),
                seconds_text(None if total is None else max(total - first, 0.0)),
                *([seconds_text(first) if first > _NOTICEABLE else ""] if compiled else []),
                "" if s.verification is None else s.verification.summary(),
            )
        )
    columns = (
        *("backend", "termination", objective, "bound", "gap", "solve", "total"),
        *(["compile"] if compiled else []),
        "verification",
    )
    return table(
        title,
        columns,
        rows,
        right=columns[2:-1],
        drop=("compile", "total", "gap", "bound", "solve"),
    )


def verification_table(verification: Verification) -> FittedTable:
    """Return a table of the checks of a plan."""
    from rich.text import Text

    rows = []
    for check in verification.checks:
        state = "within tolerance" if check.within_tolerance else "ok" if check.ok else "VIOLATED"
        style = "" if check.ok else "bold red"
        rows.append(
            (
                check.name,
                check.equation,
                Text(state, style=style),
                f"{check.worst:.3g} {check.unit}",
                f"{check.tolerance:.3g}",
                check.where,
            )
        )
    columns = ("constraint", "eq.", "state", "worst", "tolerance", "where")
    return table("", columns, rows, whole=columns[2:5], drop=("tolerance", "eq."))


def spreads_table(spreads: Sequence[Spread]) -> FittedTable:
    """Return a table of repeated runs: successes, and quartiles of objective and seconds."""
    rows = [
        (
            spread.backend + (f" : {spread.formulation}" if spread.formulation else ""),
            f"{spread.successes} of {spread.runs}",
            *(number(value) for value in spread.objective or (None,) * 3),
            *(seconds_text(value) for value in spread.seconds),
        )
        for spread in spreads
    ]
    quartiles = ("quarter", "median", "three quarters")
    columns = (
        "repeated",
        "verified",
        *(f"objective\n{word}" for word in quartiles),
        *(f"seconds\n{word}" for word in quartiles),
    )
    return table("", columns, rows, right=columns[1:])
