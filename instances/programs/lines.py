"""Cursor over the lines of a text file, with errors that name the file and the line."""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, show
from ...files import decoded
from .compressed import read_raw
from .scan import Unread, real, whole

__all__ = ["Entries", "Lines"]

#: Number of columns or rows that any file may declare; longer files may declare one per character.
_MOST = 100_000
#: Largest length of a line.
_LONGEST = 1 << 16


@dataclass(frozen=True, eq=False)
class Entries:
    """Entries of a sparse array."""

    #: Indices, counted from 0, shape (count, k).
    index: NDArray[np.int64]
    #: Values, shape (count,).
    values: NDArray[np.float64]
    #: Lines of the file, shape (count,).
    lines: NDArray[np.int64]


class Lines:
    """Cursor over the lines of a UTF-8 text file that are neither blank nor comments.

    `marks` are characters that start a comment, at the start of a line or after a blank.
    """

    def __init__(self, path: Path, marks: str) -> None:
        self._path, self._marks = path, tuple(marks)
        self._text = decoded(read_raw(path), path)
        self._start = self._line = 0
        #: Largest number of columns or rows that the file may declare.
        self.most = max(_MOST, len(self._text))

    def place(self, line: int | None = None) -> str:
        """Return the file and the line, the current one by default, for a message."""
        return f"{self._path}, line {line or self._line}"

    def error(self, message: str, line: int | None = None) -> InvalidData:
        """Return the exception with a message that starts with :meth:`place`."""
        return InvalidData(f"{self.place(line)}: {message}")

    def next(self) -> list[str]:
        """Return the fields of the next line; an empty list at the end of the file."""
        text, size = self._text, len(self._text)
        while self._start < size:
            end = text.find("\n", self._start)
            end = size if end < 0 else end
            line, self._start = text[self._start : end], end + 1
            self._line += 1
            if len(line) > _LONGEST:
                raise self.error(f"a line must have at most {_LONGEST} characters")
            fields = line.split()
            for k, field in enumerate(fields):
                if field.startswith(self._marks):
                    del fields[k:]
                    break
            if fields:
                return fields
        return []

    def fields(self, what: str, count: int) -> list[str]:
        """Return the `count` fields of the next line, which describes `what`."""
        fields = self.next()
        if len(fields) != count:
            if not fields:
                raise self.error(f"the file ends before {what}")
            raise self.error(f"{what} needs {count} fields, got {show(' '.join(fields))}")
        return fields

    def end(self) -> None:
        """Raise if another line follows."""
        fields = self.next()
        if fields:
            raise self.error(f"the file must end here, got {show(' '.join(fields))}")

    def whole(self, what: str, text: str, low: int, high: int) -> int:
        """Return the integer in a field, which must be in ``low … high``."""
        try:
            return whole(text.encode(), low, high, what)
        except Unread as error:
            raise self.error(str(error)) from None

    def real(self, what: str, text: str, infinite: bool = False) -> float:
        """Return the number in a field, which must be finite unless `infinite`, and never NaN."""
        try:
            return real(text.encode(), infinite)
        except Unread as error:
            finite = "" if infinite else "finite "
            raise self.error(f"{what} must be a {finite}number: {error}") from None

    def integer(self, what: str, low: int, high: int) -> int:
        """Return the integer on the next line; see :meth:`whole`."""
        return self.whole(what, self.fields(what, 1)[0], low, high)

    def count(self, what: str, low: int = 0) -> int:
        """Return the number of columns or rows on the next line, at most :attr:`most`."""
        return self.integer(f"number of {what}", low, self.most)

    def number(self, what: str, infinite: bool = False) -> float:
        """Return the number on the next line; see :meth:`real`."""
        return self.real(what, self.fields(what, 1)[0], infinite)

    def entries(
        self,
        what: str,
        shape: tuple[int, ...],
        *,
        base: int = 0,
        symmetric: bool = False,
        infinite: bool = False,
    ) -> Entries:
        """Return the list of entries that follows: their number, then one entry per line.

        `what` names the array in messages, `shape` has the number of values of each index, and `base` is the
        smallest index in the file. If `symmetric`, the last two indices are the row and column of symmetric
        matrices, whose lower triangle is returned. Values may be infinite if `infinite`. Raise ``InvalidData`` if
        the number of entries is wrong, an index is out of range or repeated, or a value is invalid.
        """
        # One entry takes several characters.
        count = self.integer(f"number of {what} entries", 0, len(self._text))
        index, values, lines = array("q"), array("d"), array("q")
        for _ in range(count):
            fields = self.fields(f"entry of {what}", len(shape) + 1)
            place = [
                self.whole(f"index of {what}", field, base, size + base - 1) - base
                for field, size in zip(fields, shape, strict=False)
            ]
            if symmetric and place[-2] < place[-1]:
                place[-2:] = place[:-3:-1]
            index.extend(place)
            values.append(self.real(f"value of {what}", fields[-1], infinite))
            lines.append(self._line)
        result = Entries(
            np.array(index, np.int64).reshape(count, len(shape)),
            np.array(values, float),
            np.array(lines, np.int64),
        )
        order = np.lexsort(result.index.T)
        ordered = result.index[order]
        twice = np.flatnonzero((ordered[1:] == ordered[:-1]).all(axis=1))
        if twice.size:
            pair = np.sort(result.lines[order[twice[0] : twice[0] + 2]])
            raise self.error(f"entry of {what} repeats that of line {pair[0]}", int(pair[1]))
        return result
