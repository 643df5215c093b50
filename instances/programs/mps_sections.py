"""Strict check of MPS files before HiGHS reads them.

The check allows fixed and free MPS without blanks in names. Several readers disagree on parts of the
format; a file is read as follows, or refused:

- An integer column of a marker without any bound is binary, as in HiGHS, Gurobi and SCIP. With any
  bound, its other bound is 0 or infinite.
- A negative upper bound requires an explicit lower bound: Gurobi makes the lower bound infinite, HiGHS
  and SCIP keep 0. An upper bound of 0 keeps the lower bound 0.
- The right-hand side of the objective is minus its constant.
- A range R on a row of type E with right-hand side b is [b, b + R] if R > 0 and [b + R, b] if R < 0.
- Further rows of type N have no meaning and are dropped.
- QUADOBJ and QSECTION list each off-diagonal entry once, QMATRIX lists it twice.
- Comments and text after ENDATA are ignored. PuLP names a maximisation only in a comment if
  ``with_objsense=True`` is missing; the check refuses such files.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from .scan import INFINITY, Scan, Unread, check_bounds, real, require, words

__all__ = ["MpsScan"]

#: Sections that no program can express, by name.
_UNSUPPORTED = {
    **dict.fromkeys((b"SOS", b"SOS1", b"SOS2", b"SETS"), "special ordered sets"),
    **dict.fromkeys((b"QCMATRIX",), "quadratic constraints"),
    **dict.fromkeys((b"GENCONS",), "general constraints"),
    **dict.fromkeys((b"PWLOBJ", b"PWLNAM", b"PWLCON"), "piecewise-linear functions"),
    **dict.fromkeys((b"LAZYCONS", b"DELAYEDROWS"), "lazy constraints"),
    **dict.fromkeys((b"USERCUTS", b"MODELCUTS"), "cuts"),
    b"INDICATORS": "indicator constraints",
    b"CSECTION": "cones",
}
_QUADRATIC = ("QUADOBJ", "QMATRIX", "QSECTION")
#: Sections that must have occurred before each section, and those that must not.
_SECTIONS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "NAME": ((), ("ROWS",)),
    "OBJSENSE": ((), ("ROWS",)),
    "ROWS": ((), ()),
    "COLUMNS": (("ROWS",), ()),
    "RHS": (("COLUMNS",), ("RANGES",)),
    **dict.fromkeys(("RANGES", "BOUNDS", "ENDATA"), (("COLUMNS",), ())),
    **dict.fromkeys(_QUADRATIC, (("COLUMNS",), _QUADRATIC)),
}
#: HiGHS reads a line that starts with one of these words as the start of a section.
_WITH_TEXT = (b"NAME", b"OBJSENSE", b"QCMATRIX", b"QSECTION", b"CSECTION")
_SENSES = (b"MAX", b"MIN", b"MAXIMIZE", b"MINIMIZE")
#: Lower and upper bound by type: None for the value of the line, NaN for unchanged.
_BOUNDS: dict[bytes, tuple[float | None, float | None]] = {
    **dict.fromkeys((b"LO", b"LI"), (None, math.nan)),
    **dict.fromkeys((b"UP", b"UI"), (math.nan, None)),
    b"FX": (None, None),
    b"MI": (-math.inf, math.nan),
    b"PL": (math.nan, math.inf),
    b"FR": (-math.inf, math.inf),
    b"BV": (0.0, 1.0),
}
#: Sign of an infinite side that removes a row, by type.
_FREE = {b"L": 1, b"G": -1}


class MpsScan(Scan):
    """Names and entries of an MPS file up to the current line."""

    def __init__(self, path: Path, raw: bytes) -> None:
        super().__init__(path, raw)
        self.past: set[str] = set()
        self.senses = 0
        #: Whether a comment of PuLP names the maximisation, which no reader uses.
        self.commented = False
        self.rows: dict[bytes, bytes] = {}
        self.objective = self.column = b""
        self.columns: set[bytes] = set()
        self.marked = False
        #: Name of the vector of the section, and rows with an entry in the column or section.
        self.vector: bytes | None = None
        self.entries: set[bytes] = set()
        #: Rows with an infinite side.
        self.free: set[bytes] = set()
        self.lower: dict[bytes, float] = {}
        self.upper: dict[bytes, float] = {}
        self.hessian: dict[tuple[bytes, bytes], float] = {}
        self.lines = {
            "ROWS": self.row,
            "COLUMNS": self.entry,
            "RHS": self.side,
            "RANGES": self.side,
        }
        self.lines |= {"BOUNDS": self.bound} | dict.fromkeys(_QUADRATIC, self.quadratic)

    def read(self) -> None:
        for line in self.raw.split(b"\n"):
            self.line += 1
            fields = line.split()
            if line[:1] == b"*":
                self.commented |= line.lower().startswith(b"*sense:max")
            elif fields:
                self.fields(fields, line[:1] in b" \t")
            if self.section == "ENDATA":
                return
        raise Unread("ENDATA is missing: the file is not complete")

    def fields(self, fields: list[bytes], indented: bool) -> None:
        word = fields[0].upper()
        if self.section == "OBJSENSE" and len(fields) == 1 and word in _SENSES:
            self.senses += 1
        elif len(fields) == 1 or word in _WITH_TEXT or (word in _UNSUPPORTED and not indented):
            require(not indented, f"{words(word)!r} must be a section at the start of a line")
            self.finish()
            self.start(word, fields[1:])
        else:
            valid = self.section in self.lines and indented
            require(valid, "neither a section nor an indented line of one")
            self.lines[self.section](fields)

    def start(self, word: bytes, rest: list[bytes]) -> None:
        name = words(word)
        require(
            word not in _UNSUPPORTED,
            f"{_UNSUPPORTED.get(word)} of section {name} are not supported",
        )
        require(name in _SECTIONS, f"section {name!r} is unknown")
        require(name not in self.past, f"section {name} occurs twice")
        before, after = _SECTIONS[name]
        valid = self.past.issuperset(before) and self.past.isdisjoint(after)
        require(valid, f"section {name} is out of order, or a section before it is missing")
        if name == "OBJSENSE" and rest:
            self.senses = 1
            require(b" ".join(rest).upper() in (b"MAX", b"MIN"), "OBJSENSE must be MAX or MIN")
        hidden = name == "ROWS" and self.commented and not self.senses
        require(not hidden, "only a comment names the maximisation: add a section OBJSENSE")
        single = name != "QSECTION" or rest == [self.objective]
        require(single, "quadratic constraints of section QSECTION are not supported")
        self.past.add(name)
        self.section, self.vector, self.entries = name, None, set()

    def finish(self) -> None:
        """Check the section that ends."""
        if self.section == "OBJSENSE":
            require(self.senses == 1, "OBJSENSE must be followed by one line with MAX or MIN")
        if self.section == "BOUNDS":
            check_bounds(self.lower, self.upper)
        require(self.section != "COLUMNS" or not self.marked, "marker INTORG without INTEND")
        for (row, column), value in self.hessian.items() if self.section == "QMATRIX" else ():
            symmetric = self.hessian.get((column, row)) == value
            require(symmetric, f"the entry {words(row)}, {words(column)} is not symmetric")

    def row(self, fields: list[bytes]) -> None:
        valid = len(fields) == 2 and fields[0] in (b"N", b"G", b"L", b"E")
        require(valid, "a row must consist of its type N, G, L or E and its name without blanks")
        sense, name = fields
        require(name not in self.rows, f"row {words(name)} is defined twice")
        if sense == b"N" and not self.objective:
            self.objective = name
        self.rows[name] = sense

    def pairs(self, fields: list[bytes], what: str = "row") -> Iterator[tuple[bytes, float]]:
        """Return the one or two pairs of a name and a number."""
        if len(fields) not in (2, 4):
            raise Unread(f"expected one or two pairs of a {what} without blanks and a number")
        return zip(fields[::2], map(real, fields[1::2]), strict=True)

    def once(self, row: bytes) -> None:
        if row not in self.rows or row in self.entries:
            raise Unread(f"row {words(row)} is not defined, or has two entries")
        self.entries.add(row)

    def entry(self, fields: list[bytes]) -> None:
        if len(fields) > 1 and fields[1] == b"'MARKER'":
            expected = b"'INTEND'" if self.marked else b"'INTORG'"
            require(fields[2:] == [expected], "markers INTORG and INTEND must alternate")
            self.marked, self.column = not self.marked, b""
            return
        if fields[0] != self.column:
            require(fields[0] not in self.columns, f"column {words(fields[0])} is defined twice")
            self.column, self.entries = fields[0], set()
            self.columns.add(self.column)
        for row, _ in self.pairs(fields[1:]):
            self.once(row)

    def named(self, vector: bytes) -> None:
        require(self.vector in (None, vector), "more than one vector in a section: keep one")
        self.vector = vector

    def side(self, fields: list[bytes]) -> None:
        named = len(fields) % 2
        if self.section == "RANGES":
            require(named, "a line of RANGES must start with the name of the vector")
        elif named:
            require(fields[0] not in self.rows, "the name of the vector is that of a row, too")
        self.named(fields[0] if named else b"")
        for row, number in self.pairs(fields[named:]):
            self.once(row)
            sided = self.rows[row] != b"N" or (row == self.objective and self.section == "RHS")
            require(sided, f"row {words(row)} has type N and takes no right-hand side or range")
            # Gurobi writes a row of type L without a side as 1e+100.
            if self.section == "RHS" and number * _FREE.get(self.rows[row], 0) >= INFINITY:
                self.free.add(row)
            elif abs(number) >= INFINITY or row in self.free:
                raise Unread(f"the side of row {words(row)} is infinite")

    def bound(self, fields: list[bytes]) -> None:
        kind = fields[0]
        require(
            kind not in (b"SC", b"SI"), "semi-continuous columns (bounds SC, SI) are not supported"
        )
        require(kind in _BOUNDS, f"{words(kind)!r} is not a type of bounds")
        lower, upper = _BOUNDS[kind]
        valued = None in (lower, upper)
        # A line is: type, vector, column, value. The vector may be missing; some writers add a value
        # to types without one. HiGHS decides by whether the second field is a column.
        plain = len(fields) == 2 + valued
        rest = fields[1:] if plain else fields[2:]
        valid = 1 + valued <= len(rest) <= 2 and (plain or fields[1] not in self.columns)
        require(valid, "a bound must consist of type, vector, column and value")
        self.named(b"" if plain else fields[1])
        column, value = rest[0], real(rest[1], infinite=True) if len(rest) == 2 else 0.0
        require(column in self.columns, f"column {words(column)} is not defined")
        integral = abs(value) < 2**31 and value == int(value)
        require(integral or kind not in (b"LI", b"UI"), "not an integer below 2^31: use LO or UP")
        for bounds, side, sign in ((self.lower, lower, 1), (self.upper, upper, -1)):
            if not math.isnan(side or 0.0):
                number = value if side is None else side
                fault = column in bounds or sign * number >= INFINITY
                require(
                    not fault, f"a bound of column {words(column)} is infinite or defined twice"
                )
                bounds[column] = number

    def quadratic(self, fields: list[bytes]) -> None:
        for column, number in self.pairs(fields[1:], "column"):
            pair = fields[0], column
            names = f"{words(fields[0])}, {words(column)}"
            require(self.columns.issuperset(pair), f"a column of the entry {names} is not defined")
            fault = pair in self.hessian or (
                self.section != "QMATRIX" and pair[::-1] in self.hessian
            )
            require(not fault, f"the entry {names} is defined twice")
            self.hessian[pair] = number
