"""Strict check of files in AMPL's NL format (Gay 2005) before CasADi reads them.

CasADi's reader does not notice a token that is not a number, a segment that ends early or a missing
segment, and adds several objectives to one. The check therefore follows the whole grammar of the text
form, and compares all counts of the header and the column counts of segment k with the content.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from .scan import Scan, Unread, real, whole, words

__all__ = ["check_nl"]

#: Operators that CasADi reads, by number of arguments; operator 54 is the sum with its own count.
_UNARY = {13, 14, 15, 16, 37, 38, 39, 40, 41, 42, 43, 44, 45, 46, 49, 51, 53}
_BINARY = {0, 1, 2, 3, 5, 48}
_OTHERS = {
    **dict.fromkeys((11, 12), "minimum or maximum"),
    **dict.fromkeys((20, 21, 22, 23, 24, 28, 29, 30, 34, 70, 71, 73), "logical expression"),
    **dict.fromkeys((35, 65, 72), "if-then-else"),
    **dict.fromkeys((47, 50, 52), "inverse hyperbolic function"),
    **dict.fromkeys((59, 60, 61, 74), "counting expression"),
    64: "piecewise-linear term",
}
_UNSUPPORTED = {
    b"F": "imported functions",
    b"S": "suffixes, such as those of special ordered sets",
    b"L": "logical constraints",
}
_MOST = 2**31 - 1
_HEAD = re.compile(rb"([A-Za-z])(-?\d+)?")


def check_nl(path: Path, raw: bytes) -> None:
    """Raise if an NL file is damaged, binary, or contains a part that CasADi misreads.

    Parameters
    ----------
    path : Path
        The file, for messages.
    raw : bytes
        Its content after decompression.

    Raises
    ------
    InvalidData
        CasADi would misread or ignore a part of the file; the message names line and segment.
    """
    if raw[:1] == b"b":
        raise Scan(path, b"").refusal("the file is binary: write it as text, with option g")
    scan = _Nl(path, raw)
    try:
        scan.header()
        while scan.line < len(scan.lines):
            scan.segment()
        scan.finish()
    except Unread as error:
        raise scan.refusal(error) from None


class _Nl(Scan):
    """Lines and counts of an NL file."""

    def __init__(self, path: Path, raw: bytes) -> None:
        super().__init__(path, raw)
        self.lines = raw.rstrip().split(b"\n")
        self.counts: dict[str, int] = {}
        self.past: set[tuple[bytes, int]] = set()
        #: Number of entries of the Jacobian in each column.
        self.jacobian: Counter[int] = Counter()
        self.gradient = 0
        self.starts: list[int] = []
        self.defined: set[int] = set()
        self.expressions = 0

    def fields(self, *count: int) -> list[bytes]:
        """Return the fields of the next line without its comment."""
        if self.line == len(self.lines):
            raise Unread("the file ends too early")
        fields = self.lines[self.line].partition(b"#")[0].split()
        self.line += 1
        if count and len(fields) not in count:
            raise Unread(f"expected {' or '.join(map(str, count))} fields, got {len(fields)}")
        return fields

    def header(self) -> None:
        self.section = "header"
        if not re.fullmatch(rb"g\d+", (self.fields() or [b""])[0]):
            raise Unread("the first line must start with g, as in NL files in text form")
        names = (
            ("columns rows objectives ranges equations logical", 5),
            ("nonlinear_rows nonlinear_objectives complementarity_linear complementarity", 2),
            ("network network_linear", 2),
            ("in_rows in_objective in_both", 3),
            ("network_columns functions arithmetic flags", 2),
            ("binary integer integer_both integer_rows integer_objective", 5),
            ("jacobian gradient", 2),
            ("", 0),
            ("expressions expressions_1 expressions_2 expressions_3 expressions_4", 5),
        )
        counts = self.counts
        for line, least in names:
            fields, keys = self.fields(), line.split()
            if len(fields) < least:
                raise Unread(f"expected {least} numbers")
            # Further fields describe complementarity and cones, which the loop below refuses if used.
            values = [whole(field, 0, _MOST, "a number of the header") for field in fields]
            counts.update(zip(keys, values, strict=False))
        for key, least, what in (
            ("logical", 0, "logical constraints"),
            ("complementarity_linear", 0, "complementarity conditions"),
            ("complementarity", 0, "complementarity conditions"),
            ("network", 0, "network constraints"),
            ("network_linear", 0, "network constraints"),
            ("network_columns", 0, "network columns"),
            ("functions", 0, "imported functions"),
            ("objectives", 1, "several objectives"),
        ):
            if counts.get(key, 0) > least:
                raise Unread(f"the file contains {what}, which are not supported")
        self.expressions = sum(v for key, v in counts.items() if key.startswith("expressions"))
        largest = max(counts["columns"], counts["rows"], self.expressions)
        if not counts["columns"] or largest > len(self.lines):
            raise Unread("the numbers of columns or rows and the length of the file contradict")
        # CasADi derives the integer columns from these numbers.
        rows, both, objective = counts["in_rows"], counts["in_both"], counts["in_objective"]
        nonlinear = max(rows, objective)
        valid = (
            counts["integer_both"] <= both <= min(rows, objective)
            and counts["integer_rows"] <= rows - both
            and counts["integer_objective"] <= max(objective - rows, 0)
            and nonlinear + counts["binary"] + counts["integer"] <= counts["columns"]
        )
        if not valid:
            raise Unread("the numbers of nonlinear and integer columns contradict each other")

    def segment(self) -> None:
        fields = self.fields()
        found = _HEAD.fullmatch(fields[0]) if fields else None
        if found is None:
            raise Unread("expected the start of a segment, such as C0")
        letter, number = found[1], int((found[2] or b"-1")[:12])
        self.section = words(fields[0])
        if letter in _UNSUPPORTED:
            raise Unread(
                f"segment {words(letter)} contains {_UNSUPPORTED[letter]}, which are not supported"
            )
        if (letter, number) in self.past:
            raise Unread("the segment occurs twice")
        columns, rows = self.counts["columns"], self.counts["rows"]
        limits = {b"C": rows, b"J": rows, b"O": self.counts["objectives"], b"V": _MOST}
        limits |= {
            b"G": self.counts["objectives"],
            b"d": rows + 1,
            b"x": columns + 1,
            b"k": columns,
        }
        sizes = {b"O": 2, b"J": 2, b"G": 2, b"V": 3}
        if letter not in (*limits, b"r", b"b") or len(fields) != sizes.get(letter, 1):
            raise Unread("unknown segment, or the wrong number of fields")
        if not (number < 0 if letter in b"rb" else 0 <= number < limits[letter]):
            raise Unread("the number of the segment is out of range")
        if letter in b"dxkrb" and any(letter == other for other, _ in self.past):
            raise Unread("the segment occurs twice")
        if letter in b"JG" and (b"C" if letter == b"J" else b"O", number) not in self.past:
            raise Unread("the linear part occurs before the nonlinear part, which would replace it")
        self.past.add((letter, number))
        if letter in b"COV":
            if letter == b"O":
                whole(fields[1], 0, 1, "the direction of the objective")
            if letter == b"V":
                self.definition(number, fields[1:])
            self.expression()
            self.defined |= {number} if letter == b"V" else set()
        elif letter in b"rb":
            self.bounds(columns if letter == b"b" else rows)
        elif letter == b"k":
            if number != columns - 1:
                raise Unread("segment k must have one number less than the program has columns")
            self.starts = [whole(self.fields(1)[0], 0, _MOST, "a start") for _ in range(number)]
        elif letter in b"JG":
            terms = self.terms(whole(fields[1], 1, columns, "the number of terms"), columns)
            self.jacobian.update(terms if letter == b"J" else ())
            self.gradient += len(terms) if letter == b"G" else 0
        else:
            self.terms(number, rows if letter == b"d" else columns)

    def terms(
        self, count: int, limit: int, allowed: Callable[[int], bool] = lambda _: True
    ) -> set[int]:
        """Read lines of an index and a number; return the indices."""
        seen: set[int] = set()
        for _ in range(count):
            index, value = self.fields(2)
            place = whole(index, 0, limit - 1, "an index")
            real(value)
            if place in seen or not allowed(place):
                raise Unread(f"index {place} occurs twice, or before its definition")
            seen.add(place)
        return seen

    def known(self, index: int) -> bool:
        return index < self.counts["columns"] or index in self.defined

    def definition(self, number: int, fields: list[bytes]) -> None:
        """Read the linear part of a common expression, whose indices follow those of the columns."""
        columns = self.counts["columns"]
        limit = columns + self.expressions
        if not columns <= number < limit:
            raise Unread("the number of the common expression is out of range")
        whole(fields[1], 0, _MOST, "the use of the expression")
        self.terms(whole(fields[0], 0, limit, "the number of terms"), limit, self.known)

    def expression(self) -> None:
        """Read one expression in prefix form without recursion."""
        missing = 1
        while missing:
            token = self.fields(1)[0]
            kind, rest = token[:1], token[1:]
            missing -= 1
            if kind == b"v":
                if not self.known(whole(rest, 0, _MOST, "a column")):
                    raise Unread(f"{words(token)} is not defined")
            elif kind == b"n":
                real(rest)
            elif kind in (b"s", b"l"):
                whole(
                    rest,
                    *((-(2**15), 2**15 - 1) if kind == b"s" else (-_MOST, _MOST)),
                    "a constant",
                )
            elif kind == b"o":
                operator = whole(rest, 0, 99, "an operator")
                if operator in _UNARY or operator in _BINARY:
                    missing += 1 + (operator in _BINARY)
                elif operator == 54:
                    missing += whole(self.fields(1)[0], 1, len(self.lines), "the number of terms")
                else:
                    what = _OTHERS.get(operator, "unknown operator")
                    raise Unread(f"operator {words(token)} ({what}) is not supported")
            else:
                raise Unread(f"{words(token)!r} is not a part of an expression")

    def bounds(self, count: int) -> None:
        kinds: Counter[bytes] = Counter()
        sizes = {b"0": 3, b"1": 2, b"2": 2, b"3": 1, b"4": 2}
        for _ in range(count):
            fields = self.fields()
            if fields[:1] == [b"5"]:
                raise Unread("complementarity conditions are not supported")
            if not fields or len(fields) != sizes.get(fields[0], 0):
                raise Unread("a bound must be 0 lower upper, 1 upper, 2 lower, 3, or 4 value")
            values = [real(field) for field in fields[1:]]
            if len(values) == 2 and values[0] > values[1]:
                raise Unread("the bounds contradict each other")
            kinds[fields[0]] += 1
        expected = (kinds[b"0"], kinds[b"4"])
        if self.section == "r" and expected != (self.counts["ranges"], self.counts["equations"]):
            raise Unread("the numbers of ranges and equations differ from the header")

    def finish(self) -> None:
        """Compare the counts of the header with the content."""
        self.section = "end of the file"
        counts, letters = self.counts, Counter(letter for letter, _ in self.past)
        needed = [(b"C", counts["rows"]), (b"O", counts["objectives"]), (b"b", 1)]
        needed += [
            (b"r", int(counts["rows"] > 0)),
            (b"k", int(bool(self.jacobian) and counts["columns"] > 1)),
        ]
        for letter, number in needed:
            if letters[letter] < number:
                raise Unread(f"segment {words(letter)} is missing")
        if (counts["jacobian"], counts["gradient"]) != (self.jacobian.total(), self.gradient):
            raise Unread("the numbers of nonzeros differ from the header")
        if letters[b"k"]:
            total = 0
            for column, start in enumerate(self.starts):
                total += self.jacobian[column]
                if start != total:
                    raise Unread(f"segment k and the Jacobian differ in column {column}")
