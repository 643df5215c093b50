"""Strict check of files in AMPL's NL format (Gay 2005) before CasADi reads them.

CasADi's reader does not notice a token that is not a number, a segment that ends early or a missing
segment, and adds several objectives to one. The check therefore follows the whole grammar of the text
form, and compares all counts of the header and the column counts of segment k with the content.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

from .scan import Scan, real, require, whole, words

__all__ = ["NlScan"]

#: Operators that CasADi reads, by number of arguments; operator 54 is the sum with its own count.
_UNARY = {13, 14, 15, 16, 37, 38, 39, 40, 41, 42, 43, 44, 45, 46, 49, 51, 53}
_BINARY = {0, 1, 2, 3, 5, 48}
_KNOWN = _UNARY | _BINARY | {54}
_OTHERS = {
    **dict.fromkeys((11, 12), "minimum or maximum"),
    **dict.fromkeys((20, 21, 22, 23, 24, 28, 29, 30, 34, 70, 71, 73), "logical expression"),
    **dict.fromkeys((35, 65, 72), "if-then-else"),
    **dict.fromkeys((47, 50, 52), "inverse hyperbolic function"),
    64: "piecewise-linear term",
}
_UNSUPPORTED = {
    b"F": "imported functions",
    b"S": "suffixes, such as those of special ordered sets,",
    b"L": "logical constraints",
}
#: Names of the numbers in lines 2 to 10 of the header; an upper-case word is refused if it is used.
_HEADER = (
    "columns rows objectives ranges equations LOGICAL",
    "nonlinear_rows nonlinear_objectives COMPLEMENTARITY COMPLEMENTARITY",
    "NETWORK NETWORK",
    "in_rows in_objective in_both",
    "NETWORK FUNCTIONS arithmetic flags",
    "binary integer integer_both integer_rows integer_objective",
    "jacobian gradient",
    "row_name column_name",
    "expressions expressions expressions expressions expressions",
)
#: Number of fields of a line of bounds, by type.
_BOUNDS = {b"0": 3, b"1": 2, b"2": 2, b"3": 1, b"4": 2}
_MOST = 2**31 - 1


class NlScan(Scan):
    """Lines and counts of an NL file."""

    def __init__(self, path: Path, raw: bytes) -> None:
        # The content of a binary file is not text.
        super().__init__(path, b"" if raw[:1] == b"b" else raw)
        self.lines = raw.rstrip().split(b"\n")
        self.counts: Counter[str] = Counter()
        self.past: set[tuple[bytes, int]] = set()
        #: Number of entries of the Jacobian in each column, and starts of the columns in segment k.
        self.jacobian: Counter[int] = Counter()
        self.starts: list[int] = []
        self.gradient, self.maximise = 0, False
        self.defined: set[int] = set()

    def read(self) -> None:
        require(self.raw, "the file is binary or empty: write it as text, with option g")
        self.header()
        while self.line < len(self.lines):
            self.segment()
        self.finish()

    def fields(self, count: int = 0) -> list[bytes]:
        """Return the fields of the next line without its comment."""
        require(self.line < len(self.lines), "the file ends too early")
        fields = self.lines[self.line].partition(b"#")[0].split()
        self.line += 1
        require(fields, "an empty line")
        require(count in (0, len(fields)), f"expected {count} fields, got {len(fields)}")
        return fields

    def header(self) -> None:
        self.section = "header"
        text = re.fullmatch(rb"g\d+", self.fields()[0])
        require(text, "the first line must start with g, as in NL files in text form")
        counts = self.counts
        for line in _HEADER:
            fields, names = self.fields(), line.split()
            # CasADi does not initialise a number that is missing.
            least = max(sum(name.islower() for name in names), 2)
            require(len(fields) >= least, f"expected the {least} numbers {line.lower()}")
            # Further fields describe complementarity and cones.
            for name, field in zip(names + [""] * 9, fields, strict=False):
                number = whole(field, 0, _MOST, "a number of the header")
                counts[name] += number
                require(not number or not name.isupper(), f"{name.lower()} is not supported")
        columns, rows, both = counts["columns"], counts["in_rows"], counts["in_both"]
        require(counts["objectives"] <= 1, "several objectives are not supported")
        largest = max(columns, counts["rows"], counts["expressions"])
        require(
            columns > 0 and largest <= len(self.lines),
            "the numbers of the header exceed the length of the file",
        )
        # CasADi derives the integer columns from these numbers.
        last = max(rows, counts["in_objective"])
        valid = counts["integer_both"] <= both <= min(rows, counts["in_objective"])
        valid &= (
            counts["integer_rows"] <= rows - both and counts["integer_objective"] <= last - rows
        )
        valid &= last + counts["binary"] + counts["integer"] <= columns
        require(valid, "the numbers of nonlinear and integer columns contradict each other")

    def segment(self) -> None:
        fields = self.fields()
        letter, self.section = fields[0][:1], words(fields[0])
        require(letter not in _UNSUPPORTED, f"{_UNSUPPORTED.get(letter)} are not supported")
        columns, rows, objectives = (self.counts[key] for key in ("columns", "rows", "objectives"))
        limit = columns + self.counts["expressions"]
        # Number of segments or entries, and number of fields, by letter.
        shapes = {b"C": (rows, 1), b"O": (objectives, 2), b"V": (limit, 3), b"J": (rows, 2)}
        shapes |= {
            b"G": (objectives, 2),
            b"k": (columns, 1),
            b"x": (columns + 1, 1),
            b"d": (rows + 1, 1),
        }
        shapes |= {b"r": (0, 1), b"b": (0, 1)}
        most, size = shapes.get(letter, (0, 0))
        require(len(fields) == size, f"{words(fields[0])!r} is not the start of a segment")
        number = (
            whole(fields[0][1:], 0, most - 1, "the number") if most or len(fields[0]) > 1 else 0
        )
        key = letter, number if letter in b"COVJG" else 0
        require(key not in self.past, "the segment occurs twice")
        # An expression replaces the linear part that CasADi has read before.
        first = {b"J": b"C", b"G": b"O"}.get(letter)
        require(
            not first or (first, number) in self.past, "the linear part precedes the expression"
        )
        self.past.add(key)
        if letter == b"O":
            self.maximise = bool(whole(fields[1], 0, 1, "the direction of the objective"))
        elif letter == b"V":
            require(number >= columns, "the number of the expression is that of a column")
            whole(fields[2], 0, _MOST, "the use of the expression")
            for index in self.terms(whole(fields[1], 0, limit, "the number of terms"), limit):
                require(self.known(index), f"column {index} is not defined")
        if letter in b"COV":
            self.expression()
            self.defined |= {number} if letter == b"V" else set()
        elif letter in b"rb":
            self.bounds(columns if letter == b"b" else rows)
        elif letter == b"k":
            require(number == columns - 1, "segment k must have one number fewer than the columns")
            self.starts = [whole(self.fields(1)[0], 0, _MOST, "a start") for _ in range(number)]
        elif letter in b"JG":
            terms = self.terms(whole(fields[1], 1, columns, "the number of terms"), columns)
            self.jacobian.update(terms if letter == b"J" else ())
            self.gradient += len(terms) if letter == b"G" else 0
        else:
            self.terms(number, rows if letter == b"d" else columns)

    def terms(self, count: int, limit: int) -> set[int]:
        """Read lines of an index and a number; return the indices."""
        seen: set[int] = set()
        for _ in range(count):
            index, value = self.fields(2)
            real(value)
            place = whole(index, 0, limit - 1, "an index")
            require(place not in seen, f"index {place} occurs twice")
            seen.add(place)
        return seen

    def known(self, index: int) -> bool:
        return index < self.counts["columns"] or index in self.defined

    def expression(self) -> None:
        """Read one expression in prefix form without recursion."""
        missing = 1
        while missing:
            token = self.fields(1)[0]
            kind, rest = token[:1], token[1:]
            missing -= 1
            if kind == b"v":
                known = self.known(whole(rest, 0, _MOST, "a column"))
                require(known, f"{words(token)} is not defined")
            elif kind == b"n":
                real(rest)
            elif kind in (b"s", b"l"):
                most = _MOST if kind == b"l" else 2**15 - 1
                whole(rest, -most, most, "a constant")
            else:
                require(kind == b"o", f"{words(token)!r} is not a part of an expression")
                operator = whole(rest, 0, 99, "an operator")
                what = _OTHERS.get(operator, "unknown operator")
                require(operator in _KNOWN, f"operator {operator} ({what}) is not supported")
                if operator == 54:
                    missing += whole(self.fields(1)[0], 1, len(self.lines), "the number of terms")
                else:
                    missing += 1 + (operator in _BINARY)

    def bounds(self, count: int) -> None:
        kinds: Counter[bytes] = Counter()
        for _ in range(count):
            kind, *values = self.fields()
            require(kind != b"5", "complementarity is not supported")
            valid = 1 + len(values) == _BOUNDS.get(kind)
            require(valid, "bounds must be 0 lower upper, 1 upper, 2 lower, 3, or 4 value")
            sides = [real(value) for value in values]
            require(sides == sorted(sides), "the bounds contradict each other")
            kinds[kind] += 1
        if self.section == "r":
            expected = self.counts["ranges"], self.counts["equations"]
            same = (kinds[b"0"], kinds[b"4"]) == expected
            require(same, "the numbers of ranges and equations differ from the header")

    def finish(self) -> None:
        """Compare the counts of the header with the content."""
        self.section = "end of the file"
        counts, letters = self.counts, Counter(letter for letter, _ in self.past)
        several = int(bool(self.jacobian) and counts["columns"] > 1)
        needed = {"C": counts["rows"], "O": counts["objectives"], "r": int(counts["rows"] > 0)}
        for letter, number in (needed | {"b": 1, "k": several}).items():
            require(letters[letter.encode()] >= number, f"segment {letter} is missing")
        same = (counts["jacobian"], counts["gradient"]) == (self.jacobian.total(), self.gradient)
        require(same, "the numbers of nonzeros differ from the header")
        total = 0
        for column, start in enumerate(self.starts):
            total += self.jacobian[column]
            require(start == total, f"segment k and the Jacobian differ in column {column}")
