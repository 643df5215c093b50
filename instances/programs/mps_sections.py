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
- Text after ENDATA is ignored, and so are comments, except that a file whose maximisation only a comment
  names is refused: PuLP writes such files without ``with_objsense=True``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from .scan import INFINITY, Scan, Unread, real, words

__all__ = ["check_mps"]

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
_QUADRATIC = (b"QUADOBJ", b"QMATRIX", b"QSECTION")
#: HiGHS reads a line that starts with one of these words as the start of a section.
_WITH_TEXT = (b"NAME", b"OBJSENSE", b"QCMATRIX", b"QSECTION", b"CSECTION")
_SENSES = (b"MAX", b"MIN", b"MAXIMIZE", b"MINIMIZE")
_INTEGRAL = (b"BV", b"LI", b"UI")


def check_mps(path: Path, raw: bytes) -> None:
    """Raise if the text of an MPS file is damaged, ambiguous, or beyond linear and quadratic programs.

    Parameters
    ----------
    path : Path
        The file, for messages.
    raw : bytes
        Its content after decompression.

    Raises
    ------
    InvalidData
        HiGHS would misread or ignore a part of the file; the message names line and section.
    """
    scan = _Mps(path, raw)
    try:
        for scan.line, line in enumerate(raw.split(b"\n"), 1):
            fields = line.split()
            if line[:1] == b"*":
                scan.commented |= line.lower().startswith(b"*sense:max")
            elif fields:
                scan.read(fields, line[:1] in b" \t")
            if scan.section == "ENDATA":
                return
        raise Unread("ENDATA is missing: the file is not complete")
    except Unread as error:
        raise scan.refusal(error) from None


class _Mps(Scan):
    """Names and entries of an MPS file up to the current line."""

    def __init__(self, path: Path, raw: bytes) -> None:
        super().__init__(path, raw)
        self.past: set[str] = set()
        self.senses = 0
        #: Whether a comment of PuLP names the maximisation, which no reader uses.
        self.commented = False
        self.objective = b""
        self.rows: dict[bytes, bytes] = {}
        self.columns: set[bytes] = set()
        self.column = b""
        self.marked = False
        #: Name of the vector of the current section.
        self.vector: bytes | None = None
        #: Rows with an entry, in the current column or section.
        self.entries: set[bytes] = set()
        self.lower: dict[bytes, float] = {}
        self.upper: dict[bytes, float] = {}
        self.hessian: dict[tuple[bytes, bytes], float] = {}

    def read(self, fields: list[bytes], indented: bool) -> None:
        word = fields[0].upper()
        if self.section == "OBJSENSE" and len(fields) == 1 and word in _SENSES:
            self.senses += 1
        elif len(fields) == 1 or word in _WITH_TEXT or (word in _UNSUPPORTED and not indented):
            if indented:
                raise Unread(f"{words(fields[0])!r} must be a section at the start of a line")
            self.finish()
            self.start(word, fields[1:])
        elif self.section in ("ROWS", "COLUMNS", "BOUNDS"):
            {"ROWS": self.row, "COLUMNS": self.entry, "BOUNDS": self.bound}[self.section](fields)
        elif self.section in ("RHS", "RANGES"):
            self.side(fields)
        elif self.section.encode() in _QUADRATIC:
            self.quadratic(fields)
        else:
            raise Unread("this line belongs to no section")

    def start(self, word: bytes, rest: list[bytes]) -> None:
        name = words(word)
        if word in _UNSUPPORTED:
            raise Unread(f"section {name} contains {_UNSUPPORTED[word]}, which are not supported")
        if name in self.past:
            raise Unread(f"section {name} occurs twice")
        needs = {"NAME": set(), "OBJSENSE": set(), "ROWS": set(), "COLUMNS": {"ROWS"}}
        data = ("RHS", "RANGES", "BOUNDS", "ENDATA", *map(words, _QUADRATIC))
        if name not in needs and name not in data:
            raise Unread(f"section {name!r} is unknown")
        forbidden = {"NAME": {"ROWS"}, "OBJSENSE": {"ROWS"}, "RHS": {"RANGES"}}.get(name, set())
        if not needs.get(name, {"COLUMNS"}) <= self.past or forbidden & self.past:
            raise Unread(f"section {name} is out of order, or the section before it is missing")
        if name == "OBJSENSE" and rest:
            self.senses = 1
            if len(rest) != 1 or rest[0].upper() not in (b"MAX", b"MIN"):
                raise Unread("OBJSENSE must be MAX or MIN")
        if name == "ROWS" and self.commented and not self.senses:
            raise Unread("only a comment names the maximisation: add a section OBJSENSE")
        if name == "QSECTION" and rest != [self.objective]:
            raise Unread("section QSECTION of a constraint is not supported")
        if word in _QUADRATIC and self.past & set(map(words, _QUADRATIC)):
            raise Unread("more than one section of the quadratic objective")
        self.past.add(name)
        self.section, self.vector, self.entries = name, None, set()

    def finish(self) -> None:
        """Check the section that ends."""
        if self.section == "OBJSENSE" and self.senses != 1:
            raise Unread("OBJSENSE must be followed by one line with MAX or MIN")
        if self.section == "COLUMNS" and self.marked:
            raise Unread("marker INTORG without INTEND")
        if self.section == "BOUNDS":
            for column, upper in self.upper.items():
                if upper < 0 and column not in self.lower:
                    raise Unread(
                        f"column {words(column)} has the negative upper bound {upper:g} and no lower bound, "
                        "which readers treat in different ways: add a bound LO or MI"
                    )
                if self.lower.get(column, 0.0) > upper:
                    raise Unread(f"the bounds of column {words(column)} contradict each other")
        if self.section == "QMATRIX":
            for (row, column), value in self.hessian.items():
                if self.hessian.get((column, row)) != value:
                    raise Unread(f"the entry {words(row)}, {words(column)} is not symmetric")

    def row(self, fields: list[bytes]) -> None:
        if len(fields) != 2 or fields[0] not in (b"N", b"G", b"L", b"E"):
            raise Unread("a row must consist of its type N, G, L or E and its name")
        sense, name = fields
        if name in self.rows:
            raise Unread(f"row {words(name)} is defined twice")
        if sense == b"N" and not self.objective:
            self.objective = name
        self.rows[name] = sense

    def entry(self, fields: list[bytes]) -> None:
        if len(fields) > 1 and fields[1] == b"'MARKER'":
            if fields[2:] != [b"'INTEND'" if self.marked else b"'INTORG'"]:
                raise Unread("markers INTORG and INTEND must alternate")
            self.marked, self.column = not self.marked, b""
            return
        if len(fields) not in (3, 5):
            raise Unread("a line must consist of a column and one or two pairs of row and number")
        if fields[0] != self.column:
            if fields[0] in self.columns:
                raise Unread(f"column {words(fields[0])} is defined twice")
            self.column, self.entries = fields[0], set()
            self.columns.add(self.column)
        for row, number in self.pairs(fields[1:]):
            self.once(row)
            real(number)

    def pairs(self, fields: list[bytes]) -> Iterator[tuple[bytes, bytes]]:
        return zip(fields[::2], fields[1::2], strict=True)

    def once(self, row: bytes) -> None:
        if row not in self.rows:
            raise Unread(f"row {words(row)} is not defined")
        if row in self.entries:
            raise Unread(f"row {words(row)} has two entries")
        self.entries.add(row)

    def named(self, vector: bytes) -> None:
        if self.vector not in (None, vector):
            raise Unread("more than one vector in a section: keep one")
        self.vector = vector

    def side(self, fields: list[bytes]) -> None:
        named = len(fields) % 2
        if not 2 <= len(fields) <= 5 or (
            named and fields[0] in self.rows and self.section == "RHS"
        ):
            raise Unread("a line must consist of a vector and one or two pairs of row and number")
        if self.section == "RANGES" and not named:
            raise Unread("a line of RANGES must start with the name of the vector")
        self.named(fields[0] if named else b"")
        for row, number in self.pairs(fields[named:]):
            self.once(row)
            if self.rows[row] == b"N" and (self.section == "RANGES" or row != self.objective):
                raise Unread(f"row {words(row)} has type N and no side")
            if abs(real(number)) >= INFINITY:
                raise Unread(f"{words(number)} counts as infinite")

    def bound(self, fields: list[bytes]) -> None:
        kind = fields[0]
        if kind in (b"SC", b"SI"):
            raise Unread(f"bound {words(kind)} of a semi-continuous column is not supported")
        if kind not in (b"LO", b"UP", b"FX", b"MI", b"PL", b"FR", *_INTEGRAL):
            raise Unread(f"{words(kind)!r} is not a type of bounds")
        valued = kind not in (b"MI", b"PL", b"FR", b"BV")
        # A line is: type, vector, column, value. The vector may be missing; some writers add a value
        # to types without one. HiGHS decides by whether the second field is a column.
        plain = len(fields) == 2 + valued
        rest = fields[1:] if plain else fields[2:]
        if not 1 + valued <= len(rest) <= 2 or (not plain and fields[1] in self.columns):
            raise Unread("a bound must consist of type, vector, column and value")
        self.named(b"" if plain else fields[1])
        column, value = rest[0], real(rest[1], infinite=True) if len(rest) == 2 else 0.0
        if column not in self.columns:
            raise Unread(f"column {words(column)} is not defined")
        if kind in (b"LI", b"UI") and (not abs(value) < 2**31 or value != int(value)):
            raise Unread(f"{words(rest[1])} is not an integer below 2^31: use LO or UP")
        lower = {b"MI": -math.inf, b"FR": -math.inf, b"BV": 0.0}.get(kind, value)
        upper = {b"PL": math.inf, b"FR": math.inf, b"BV": 1.0}.get(kind, value)
        if kind not in (b"UP", b"UI", b"PL"):
            if column in self.lower or lower >= INFINITY:
                raise Unread(
                    f"the lower bound of column {words(column)} is infinite or defined twice"
                )
            self.lower[column] = lower
        if kind not in (b"LO", b"LI", b"MI"):
            if column in self.upper or upper <= -INFINITY:
                raise Unread(
                    f"the upper bound of column {words(column)} is infinite or defined twice"
                )
            self.upper[column] = upper

    def quadratic(self, fields: list[bytes]) -> None:
        if len(fields) not in (3, 5):
            raise Unread(
                "a line must consist of a column and one or two pairs of column and number"
            )
        for column, number in self.pairs(fields[1:]):
            pair = fields[0], column
            if not self.columns.issuperset(pair):
                raise Unread(f"column {words(fields[0])} or {words(column)} is not defined")
            if pair in self.hessian or (self.section != "QMATRIX" and pair[::-1] in self.hessian):
                raise Unread(f"the entry {words(fields[0])}, {words(column)} is defined twice")
            self.hessian[pair] = real(number)
