"""HTML elements of a report. Text from outside is escaped."""

from __future__ import annotations

import math
from collections.abc import Iterable
from html import escape
from typing import Any

from ..contract.enums import Limit
from ..contract.solution import Solution
from .statistics import LEVEL, RankTest

__all__ = ["cell", "choices", "count_cell", "ended", "figure", "many", "numeric", "table", "tested"]


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
    return f'<td class="n" data-v="{float(value) if known else ""}">{escape(text)}</td>'  # type: ignore[arg-type]


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
        return [
            cell(f"{many(test.runs, 'value')}: too few to tell"),
            numeric(None, ""),
            numeric(None, ""),
        ]
    word = "no difference shown" if test.p_value >= LEVEL else "yes" if test.effect > 0 else "worse"
    return [
        cell(word),
        numeric(test.p_value, f"{test.p_value:.2g}"),
        numeric(test.effect, f"{test.effect:+.2f}"),
    ]


def table(
    heads: Iterable[tuple[str, bool]],
    rows: Iterable[Any],
    look: str,
    label: str,
    *,
    tall: bool = False,
) -> str:
    """Return a sortable table in a box that scrolls.

    Parameters
    ----------
    heads : iterable of (str, bool)
        Headers, and whether the column holds numbers.
    rows : iterable
        The cells of each row, or a pair of HTML attributes and cells.
    look : str
        CSS class.
    label : str
        Text alternative.
    tall : bool
        Whether the box has a limited height.
    """
    top = "".join(
        f'<th scope="col" aria-sort="none"{" class=n" if right else ""}>'
        f'<button type="button">{escape(head)}</button></th>'
        for head, right in heads
    )
    body = []
    for row in rows:
        attributes, cells = row if isinstance(row, tuple) else ("", row)
        body.append(f"<tr{attributes}>{''.join(cells)}</tr>")
    return (
        f'<div class="scroll{" tall" if tall else ""}" tabindex="0" role="region" aria-label="{escape(label)}">'
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
