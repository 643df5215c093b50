"""HTML elements of a report. Text from outside is escaped."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from ..contract.enums import Limit
from ..contract.solution import Solution
from .statistics import LEVEL, RankTest

__all__ = [
    "cell",
    "choices",
    "count_cell",
    "ended",
    "figure",
    "many",
    "numeric",
    "table",
    "tested",
    "untested",
]

#: Beginning of a cell with a number.
_NUMERIC = '<td class="n"'


def many(number: int, noun: str) -> str:
    """Return a number with its noun, in the plural unless it is 1."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def choices(values: Iterable[str]) -> str:
    """Return the HTML options of a selection list."""
    # With an explicit value, because the displayed text loses spaces.
    return "".join(f'<option value="{escape(v)}">{escape(v)}</option>' for v in values)


def cell(text: str, *, long: bool = False) -> str:
    """Return a table cell with text; a `long` one is wrapped."""
    return f"<td class='long'>{escape(text)}</td>" if long else f"<td>{escape(text)}</td>"


def numeric(value: float | None, text: str) -> str:
    """Return a table cell that is sorted by `value`; cells without a value come last."""
    known = value is not None and math.isfinite(value)
    return f'{_NUMERIC} data-v="{float(value) if known else ""}">{escape(text)}</td>'  # type: ignore[arg-type]


def _holds_numbers(cells: Iterable[str]) -> bool:
    return all(cell.startswith(_NUMERIC) for cell in cells)


def count_cell(value: int) -> str:
    """Return a table cell with a count."""
    return numeric(value, f"{value:,}")


def tested(test: RankTest) -> list[str]:
    """Return the cells of a test whether a first backend is better: answer, p-value and effect.

    Parameters
    ----------
    test : RankTest
        The test.

    Returns
    -------
    list of str
        Three table cells.
    """
    if test.p_value is None:
        return untested(f"{many(test.runs, 'value')}: too few to tell")
    word = "no difference shown" if test.p_value >= LEVEL else "yes" if test.effect > 0 else "worse"
    return [
        cell(word),
        numeric(test.p_value, f"{test.p_value:.2g}"),
        numeric(test.effect, f"{test.effect:+.2f}"),
    ]


def untested(text: str) -> list[str]:
    """Return the cells of a missing test, with the reason."""
    return [cell(text), numeric(None, ""), numeric(None, "")]


def table(
    heads: Sequence[str],
    rows: Sequence[Sequence[str]],
    look: str,
    label: str,
) -> str:
    """Return a sortable table in a box that scrolls.

    Parameters
    ----------
    heads : sequence of str
        Headers. Those of columns with cells of :func:`numeric` only are aligned right.
    rows : sequence
        The cells of each row.
    look : str
        CSS class.
    label : str
        Text alternative.
    """
    columns = list(zip(*rows, strict=True)) or [()] * len(heads)
    top = "".join(
        f'<th scope="col" aria-sort="none"{" class=n" if right else ""}>'
        f'<button type="button">{escape(head)}</button></th>'
        for head, right in zip(heads, map(_holds_numbers, columns), strict=True)
    )
    body = [f"<tr>{''.join(cells)}</tr>" for cells in rows]
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{escape(label)}">'
        f'<table class="{look}"><thead><tr>{top}</tr></thead><tbody>{"".join(body)}</tbody></table></div>'
    )


def figure(drawn: str, note: str) -> str:
    """Return a drawing in a box that scrolls, with a caption."""
    return (
        f'<figure><div class="scroll">{drawn}</div><figcaption>{escape(note)}</figcaption></figure>'
    )


def ended(s: Solution[Any]) -> str:
    """Return the termination and limit of a run as text."""
    text = str(s.termination).replace("_", " ")
    if s.limit is None:
        return text
    return text + (", interrupted" if s.limit is Limit.INTERRUPTED else f", {s.limit} limit")
