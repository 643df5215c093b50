"""Tables of answers and verdicts: plain text, rich tables for terminals, HTML for notebooks."""

from __future__ import annotations

import html
import io
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

from ...errors import BackendMissing
from ...models.problems import model_type, model_types
from ...models.verification import Verification
from ..contract.enums import Limit, Termination
from .fitting import FittedTable, legible

if TYPE_CHECKING:
    from pandas import DataFrame

__all__ = [
    "SHOWN",
    "Printable",
    "details_table",
    "frame",
    "markup",
    "number",
    "render",
    "seconds_text",
    "solutions_table",
    "table",
    "values_parts",
    "verification_table",
]


class Answered(Protocol):
    """Fields of a :class:`~crosstrack.solvers.contract.solution.Solution` that these tables show.

    A protocol avoids a circular import, because the module of Solution imports this one.
    """

    @property
    def model(self) -> str: ...
    @property
    def instance(self) -> str: ...
    @property
    def backend(self) -> str: ...
    @property
    def formulation(self) -> str | None: ...
    @property
    def termination(self) -> Termination: ...
    @property
    def limit(self) -> Limit | None: ...
    @property
    def primal_bound(self) -> float | None: ...
    @property
    def dual_bound(self) -> float | None: ...
    @property
    def value(self) -> float | None: ...
    @property
    def bound(self) -> float | None: ...
    @property
    def gap(self) -> float | None: ...
    @property
    def verified(self) -> bool: ...
    @property
    def verification(self) -> Verification | None: ...
    @property
    def seconds(self) -> Mapping[str, float]: ...
    @property
    def seed(self) -> int | None: ...
    @property
    def message(self) -> str: ...


#: Largest number of values that :func:`values_parts` shows.
SHOWN = 20
#: Seconds of compilation below which its column is omitted.
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
        Title above the table; empty for none.
    columns : sequence of str
        Headers.
    rows : iterable of sequence
        Cells of each row: text, or objects with a ``str``.
    right : sequence of str
        Numeric columns, aligned right and never folded.
    whole : sequence of str
        Further columns that are never folded. The first column, which names the row, never is.
    drop : sequence of str
        Columns that a narrow terminal omits, in this order.
    """
    from rich.text import Text

    place = {name: k for k, name in enumerate(columns)}
    return FittedTable(
        legible(title),
        tuple(columns),
        [
            [cell if isinstance(cell, Text) else Text(legible(str(cell))) for cell in row]
            for row in rows
        ],
        frozenset(place[name] for name in right),
        frozenset({0, *(place[name] for name in (*right, *whole))}),
        tuple(place[name] for name in drop if name in place),
    )


def details_table(
    rows: Sequence[Mapping[str, Any]], title: str = "details", short: Sequence[str] = ()
) -> FittedTable:
    """Return a table of the result of ``Model.details``, or of a solution's history.

    Parameters
    ----------
    rows : sequence of mapping
        Cells by column.
    title : str
        Title of the table.
    short : sequence of str
        Columns whose numbers have 3 significant digits; others have 7.
    """

    def cell(name: str, value: Any) -> str:
        if not isinstance(value, float):
            return "" if value is None else str(value)
        return f"{value:.3g}" if name in short else f"{value:.7g}"

    names = list(rows[0]) if rows else []
    numbers = [name for name in names if any(isinstance(row[name], float) for row in rows)]
    cells = [[cell(name, row[name]) for name in names] for row in rows]
    return table(title, names, cells, right=numbers)


def render(*parts: Any, width: int = 120) -> str:
    """Return rich tables and text as plain text without colours.

    Parameters
    ----------
    *parts : FittedTable or str
        Parts to print.
    width : int
        Characters per line.
    """
    from rich.console import Console

    console = Console(file=io.StringIO(), width=width, color_system=None, legacy_windows=False)
    for part in parts:
        console.print(part, markup=False, highlight=False, soft_wrap=isinstance(part, str))
    output = console.file
    assert isinstance(output, io.StringIO)
    return "\n".join(line.rstrip() for line in output.getvalue().splitlines())


def markup(*parts: Any) -> str:
    """Return tables and text as HTML, with text from models and solvers escaped.

    Parameters
    ----------
    *parts : FittedTable or str
        Parts to print.
    """
    return "\n".join(
        _table_markup(part)
        if isinstance(part, FittedTable)
        else f"<p>{'<br>'.join(html.escape(line) for line in str(part).splitlines())}</p>"
        for part in parts
    )


class Printable(ABC):
    """Base of results that consist of tables and text."""

    @abstractmethod
    def parts(self) -> list[Any]:
        """Return the printable parts in order."""

    def summary(self) -> str:
        """Return tables and text as plain text."""
        return render(*self.parts(), width=140)

    def __str__(self) -> str:
        return self.summary()

    def _repr_html_(self) -> str:
        return markup(*self.parts())


def _table_markup(fitted: FittedTable) -> str:
    def row(tag: str, cells: Iterable[Any]) -> str:
        sides = ("right" if k in fitted.right else "left" for k in range(len(fitted.columns)))
        return "".join(
            f'<{tag} style="text-align: {side}">{html.escape(str(cell))}</{tag}>'
            for side, cell in zip(sides, cells, strict=True)
        )

    title = f"<caption>{html.escape(fitted.title)}</caption>" if fitted.title else ""
    body = "\n".join(f"<tr>{row('td', cells)}</tr>" for cells in fitted.rows)
    head = row("th", fitted.columns)
    return f"<table>{title}<thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody></table>"


def frame(solutions: Sequence[Answered]) -> DataFrame:
    """Return a pandas data frame with one row per answer, and seconds in columns of their own.

    Parameters
    ----------
    solutions : sequence of Solution
        The answers.

    Raises
    ------
    BackendMissing
        pandas is not installed.
    """
    try:
        import pandas as pd
    except ModuleNotFoundError as error:
        raise BackendMissing(
            "to_frame needs pandas, which is not installed: pip install 'crosstrack[pandas]'"
        ) from error
    columns = (
        "instance", "model", "backend", "formulation", "termination", "limit", "primal_bound",
        "dual_bound", "gap", "verified", "seed", "message",
    )  # fmt: skip
    rows = [
        {
            **{name: getattr(s, name) for name in columns},
            "termination": str(s.termination),
            "limit": None if s.limit is None else str(s.limit),
            **{f"seconds_{part}": value for part, value in s.seconds.items()},
        }
        for s in solutions
    ]
    return pd.DataFrame(rows, columns=None if rows else columns)


def number(value: float | None, digits: int = 3) -> str:
    """Return a number as text with `digits` decimals and at least six significant digits.

    None gives an empty text.
    """
    if value is None:
        return ""
    if value and not 1e-3 <= abs(value) < 1e9:
        return f"{value:.6g}"
    whole = len(str(int(abs(value)))) if abs(value) >= 1 else 0
    return f"{value:.{max(digits, digits + 3 - whole)}f}"


def seconds_text(value: float | None) -> str:
    """Return seconds as text with a suitable unit; None gives an empty text."""
    if value is None:
        return ""
    for factor, unit in ((1.0, "s"), (1e3, "ms"), (1e6, "µs")):
        if value * factor >= 1 or unit == "µs":
            return f"{value * factor:.3g} {unit}"
    return ""


def _ended(solution: Answered) -> Any:
    from rich.text import Text

    text = str(solution.termination)
    if solution.limit is not None:
        text += f", {'interrupted' if solution.limit is Limit.INTERRUPTED else f'{solution.limit} limit'}"
    return Text(text, style=_STYLES.get(solution.termination, ""))


def solutions_table(solutions: Sequence[Answered], title: str = "") -> FittedTable:
    """Return a table of answers: objective, bound, gap, seconds and verification of each.

    Compilation, which only the first call on a machine needs, has a column if it was noticeable.

    Parameters
    ----------
    solutions : sequence of Solution
        One per row.
    title : str
        Title of the table.
    """
    kind = solutions[0].model if solutions else ""
    unit = model_type(kind).objective_unit if kind in model_types() else ""
    if not isinstance(unit, str):
        unit = ""  # it differs between models of this kind
    objective = f"objective ({unit})" if unit else "objective"
    compiled = any(s.seconds.get("compile", 0.0) > _NOTICEABLE for s in solutions)
    rows = []
    for s in solutions:
        first = s.seconds.get("compile", 0.0)
        rows.append(
            (
                s.backend + (f" : {s.formulation}" if s.formulation else ""),
                _ended(s),
                number(s.value),
                number(s.bound),
                "" if s.gap is None else f"{s.gap:.1e}" if s.gap else "0",
                seconds_text(s.seconds.get("solve")),
                seconds_text(s.seconds.get("total")),
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


def values_parts(rows: Sequence[Mapping[str, Any]]) -> list[FittedTable | str]:
    """Return a table of the largest values of a program, and a line about the others.

    Parameters
    ----------
    rows : sequence of mapping
        Result of :meth:`.Program.details`.
    """
    if not rows:
        return ["all values are 0"]
    more = len(rows) - SHOWN
    rest = f"{more} smaller nonzero values are not shown (--details, or Solution.values)"
    return [details_table(rows[:SHOWN], ""), *([rest] if more > 0 else [])]


def verification_table(verification: Verification) -> FittedTable:
    """Return a table of the checks of a plan.

    Parameters
    ----------
    verification : Verification
        The result of the verification.
    """
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
