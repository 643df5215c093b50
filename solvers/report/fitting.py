"""A table that fits its terminal: columns fold or go by rank, and a number is never cut."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType
    from rich.text import Text

__all__ = ["FittedTable", "legible"]

#: Characters that steer a terminal, but for the ends of lines: a stranger's names and messages may hold them.
_STEERING = dict.fromkeys(
    [*range(9), *range(11, 32), *range(127, 160)], "\N{REPLACEMENT CHARACTER}"
)

#: Cells between two columns, and those that the edges take.
GAP, EDGES = 3, 2
#: Width below which a column of words is not folded: as long as other columns can go, and at last.
COMFORT, WORDS = 30, 14


def legible(text: str) -> str:
    """Return `text` with a sign in the place of each character that would steer a terminal."""
    return text.translate(_STEERING)


@dataclass(frozen=True)
class FittedTable:
    """A table for :class:`rich.console.Console`.

    Where the terminal is too narrow, columns of words are folded, then columns are left out in the
    order of `drop`; where even that does not do, every row becomes a block of lines.

    Parameters
    ----------
    title : str
        Above the table; empty for none.
    columns : sequence of str
        Headers; lines are separated by line feeds.
    rows : sequence of sequence of Text
        The cells.
    right : frozenset of int
        Columns that are aligned right.
    whole : frozenset of int
        Columns that are never folded: numbers and names.
    drop : tuple of int
        Columns that may be left out, the first one first.
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

        found = self._fit(options.max_width)
        if found is None:
            yield from self._blocks()
            return
        shown, widths = found
        made = Table(
            title=self.title or None, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False
        )
        for column, width in zip(shown, widths, strict=True):
            justify = "right" if column in self.right else "left"
            made.add_column(self.columns[column], justify=justify, overflow="fold", width=width)  # type: ignore[arg-type]
        for row in self.rows:
            made.add_row(*(row[column] for column in shown))
        yield made

    def _fit(self, width: int) -> tuple[list[int], list[int]] | None:
        """Return the columns to show and their widths, None where not even the fewest fit."""
        for least in (COMFORT, WORDS):
            shown = list(range(len(self.columns)))
            for column in (None, *self.drop):
                if column is not None:
                    shown.remove(column)
                widths = self._widths(shown, width, least)
                if widths is not None:
                    return shown, widths
        return None

    def _widths(self, shown: Sequence[int], width: int, words_least: int) -> list[int] | None:
        """Return the widths of the columns `shown`, None where they do not fit."""
        room = width - EDGES - GAP * (len(shown) - 1)
        least, natural = [], []
        for column in shown:
            cells = [row[column] for row in self.rows]
            head = self.columns[column]
            widest = max([cell.cell_len for cell in cells], default=0)
            words = [len(word) for text in (head, *map(str, cells)) for word in text.split()]
            longest = max(words, default=0)
            header = max([len(line) for line in head.split("\n")])
            if column in self.whole:
                least.append(max(widest, *map(len, head.split() or [""])))
                natural.append(max(widest, header))
            else:
                natural.append(max(widest, header))
                least.append(min(natural[-1], max(longest, words_least)))
        spare = room - sum(least)
        if spare < 0:
            return None
        found = list(least)
        while spare > 0:
            short = [k for k in range(len(found)) if found[k] < natural[k]]
            if not short:
                break
            # The narrowest first, so that no column of words starves beside a wide one.
            k = min(short, key=lambda k: found[k])
            found[k] += 1
            spare -= 1
        return found

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
