"""Table that fits its terminal: columns are folded or omitted, and numbers are never cut."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType
    from rich.text import Text

__all__ = ["FittedTable", "legible"]

#: Control characters of terminals, except line ends, which external names and messages may contain.
_STEERING = dict.fromkeys(
    [*range(9), *range(11, 32), *range(127, 160)], "\N{REPLACEMENT CHARACTER}"
)

#: Spaces between two columns, and at the edges.
GAP, EDGES = 3, 2
#: Smallest width of a folded text column: while columns can be omitted, and in the end.
COMFORT, WORDS = 30, 14


def legible(text: str) -> str:
    """Return `text` with a replacement character for each terminal control character.

    Parameters
    ----------
    text : str
        Text from any source.
    """
    return text.translate(_STEERING)


@dataclass(frozen=True)
class FittedTable:
    """Table for :class:`rich.console.Console`.

    If the terminal is too narrow, text columns are folded, then columns are omitted in the order of
    `drop`. If the table still does not fit, every row becomes a block of lines.

    Parameters
    ----------
    title : str
        Title above the table; empty for none.
    columns : sequence of str
        Headers; lines are separated by line feeds.
    rows : sequence of sequence of Text
        Cells of each row.
    right : frozenset of int
        Columns that are aligned right.
    whole : frozenset of int
        Columns that are never folded, such as numbers and names.
    drop : tuple of int
        Columns that may be omitted, in this order.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Text]]
    right: frozenset[int]
    whole: frozenset[int]
    drop: tuple[int, ...]

    def __rich_console__(
        self, console: Console, options: ConsoleOptions
    ) -> Iterator[RenderableType]:
        from rich import box
        from rich.table import Table

        layout = self._fit(options.max_width)
        if layout is None:
            yield from self._blocks()
            return
        shown, widths = layout
        content = Table(
            title=self.title or None, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False
        )
        for column, width in zip(shown, widths, strict=True):
            justify = "right" if column in self.right else "left"
            content.add_column(self.columns[column], justify=justify, overflow="fold", width=width)  # type: ignore[arg-type]
        for row in self.rows:
            content.add_row(*(row[column] for column in shown))
        yield content

    def _fit(self, width: int) -> tuple[list[int], list[int]] | None:
        """Return the columns to show and their widths; None if not even the fewest fit."""
        for words_width in (COMFORT, WORDS):
            shown = list(range(len(self.columns)))
            for column in (None, *self.drop):
                if column is not None:
                    shown.remove(column)
                widths = self._widths(shown, width, words_width)
                if widths is not None:
                    return shown, widths
        return None

    def _widths(self, shown: Sequence[int], width: int, words_least: int) -> list[int] | None:
        """Return the widths of the columns `shown`; None if they do not fit."""
        room = width - EDGES - GAP * (len(shown) - 1)
        smallest, natural = [], []
        for column in shown:
            cells = [row[column] for row in self.rows]
            head = self.columns[column]
            widest = max([cell.cell_len for cell in cells], default=0)
            words = [len(word) for text in (head, *map(str, cells)) for word in text.split()]
            longest = max(words, default=0)
            header = max([len(line) for line in head.split("\n")])
            if column in self.whole:
                smallest.append(max(widest, *map(len, head.split() or [""])))
                natural.append(max(widest, header))
            else:
                natural.append(max(widest, header))
                smallest.append(min(natural[-1], max(longest, words_least)))
        spare = room - sum(smallest)
        if spare < 0:
            return None
        widths = list(smallest)
        while spare > 0:
            short = [k for k in range(len(widths)) if widths[k] < natural[k]]
            if not short:
                break
            # The narrowest first, so that no text column stays narrow beside a wide one.
            k = min(short, key=lambda k: widths[k])
            widths[k] += 1
            spare -= 1
        return widths

    def _blocks(self) -> Iterator[RenderableType]:
        """Yield every row as lines ``header: cell``."""
        from rich.padding import Padding
        from rich.text import Text

        if self.title:
            yield Text(self.title, style="bold")
        for row in self.rows:
            for number, (head, cell) in enumerate(zip(self.columns, row, strict=True)):
                if cell.plain:
                    name = " ".join(head.split())
                    line = Text(f"{name}: " if name else "") + cell
                    yield Padding(line, (0, 0, 0, 2 if number else 0))
            yield Text("")
