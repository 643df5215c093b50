r"""Strict check of files in LP format before HiGHS reads them.

The check allows this grammar, which CPLEX, Gurobi, HiGHS and SCIP read alike::

    Minimize | Maximize      [name:] terms, constants and "+ [ quadratic terms ] / 2"
    Subject To               [name:] terms (<= | >= | =) number; the section may be missing
    Bounds                   number <= x <= number | x (<= | >= | =) number | number <= x | x free
    General, Binary          names
    End

Keywords, rows and bounds start a line, and ``\`` starts a comment. HiGHS skips text before a keyword
that it knows, drops constants in rows, reads the name ``info`` as infinity times ``o``, and keeps
bounds of binary columns, and Gurobi adds a sign without a blank before it to a name; the check refuses such
files. A negative upper bound requires an explicit lower bound, as in MPS files. Gurobi reads a constant of the
objective as a column.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from .scan import INFINITY, NUMBER, Scan, Unread, check_bounds, real, require, words

__all__ = ["LpScan"]

#: Keywords at the start of a line: the section, and what an unsupported section contains.
_KEYWORDS = {
    "objective": rb"minimize|minimum|min|maximize|maximum|max",
    "Subject To": rb"subject[ \t]+to|such[ \t]+that|s\.t\.|st",
    "Bounds": rb"bounds?",
    # Before "General", which is a part of it.
    "general constraints": rb"general\s+constraints?|gencons?|pwlobj|pwlcon",
    "General": rb"generals?|gen|integers?",
    "Binary": rb"binary|binaries|bin",
    "semi-continuous columns": rb"semi\s*-\s*continuous|semis?",
    "special ordered sets": rb"sos[12]?",
    "lazy constraints": rb"lazy\s+constraints",
    "cuts": rb"user\s+cuts",
    "several objectives": rb"multi-objectives",
    "End": rb"end",
}
_SECTION = re.compile(
    rb"^[ \t]*(?:"
    + b"|".join(rb"(%s)" % text for text in _KEYWORDS.values())
    + rb")(?=[ \t\r]*$|[ \t]+[^\s:<>=])",
    re.IGNORECASE | re.MULTILINE,
)
_RESERVED = re.compile(
    rb"(?:inf|nan).*|free|lazy|subject|such|user|" + b"|".join(_KEYWORDS.values()), re.IGNORECASE
)
_NAME = rb"[^\s\d.<>=+\-*/^:\[\];][^\s<>=+\-*/^:\[\];]*"
_PLAIN = NUMBER + rb"(?=[\s<>=*/^:\[\]]|\Z)"
#: Two signs only as in "x + -3 y": in "x + - z" a name may be lost, and Gurobi reads a name "x-".
_SIGNS = rb"(?:(?<!\S)[+-]\s*[+-](?=[\d.])|[+-]\s*)?"
_VALUE = rb"%s(?:%s|(?i:inf(?:inity)?)(?=[\s<>=]|\Z))" % (_SIGNS, _PLAIN)
_END = rb"[ \t\r]*(?:\n|\Z)"


def _pattern(text: bytes) -> re.Pattern[bytes]:
    return re.compile(rb"\s*" + text)


_LABEL = _pattern(rb"(%s)\s*:" % _NAME)
_TERM = _pattern(rb"(%s)(?:(%s)\s*)?(%s)?" % (_SIGNS, _PLAIN, _NAME))
_BRACKET = _pattern(rb"(%s)\[" % _SIGNS)
_PRODUCT = _pattern(
    rb"(%s)(?:(%s)\s*)?(%s)\s*(?:\^\s*2(?=[\s+\-\]])|\*\s*(%s))" % (_SIGNS, _PLAIN, _NAME, _NAME)
)
_CLOSE = _pattern(rb"\]\s*/\s*2(?=\s|[+-]|\Z)")
_SIDE = _pattern(rb"(<=|>=|=)\s*(%s)%s" % (_VALUE, _END))
_BOUND = _pattern(
    rb"(?:(%s)[ \t]*(<=|>=|=)[ \t]*)?(%s)(?:[ \t]*(<=|>=|=)[ \t]*(%s)|[ \t]+((?i:free)))?%s"
    % (_VALUE, _NAME, _VALUE, _END)
)
_REST = _pattern(rb"(\S{0,40})")
_WORD = _pattern(rb"(%s)(?=\s|\Z)" % _NAME)


class LpScan(Scan):
    """Text of an LP file without comments, and the names in it up to a position."""

    def __init__(self, path: Path, raw: bytes) -> None:
        super().__init__(path, raw)
        self.text = re.sub(rb"\\[^\n]*", b"", raw)
        #: Position, end of the section, and start of the last part.
        self.at = self.end = self.mark = 0
        self.columns: set[bytes] = set()
        self.rows: set[bytes] = set()
        self.lower: dict[bytes, float] = {}
        self.upper: dict[bytes, float] = {}
        self.integral: dict[bytes, str] = {}

    def read(self) -> None:
        try:
            self.sections()
        finally:
            self.line = self.text.count(b"\n", 0, self.mark) + 1

    def sections(self) -> None:
        parts: dict[str, Callable[[], None]] = {
            "objective": self.objective,
            "Subject To": self.row,
            "Bounds": self.bound,
            "General": self.name,
            "Binary": self.name,
        }
        names, past = list(_KEYWORDS), set[str]()
        self.mark = max(self.text.find(b"->"), 0)
        require(not self.mark, "indicator constraints are not supported")
        found = _SECTION.search(self.text)
        valid = found and not self.text[: found.start()].strip()
        require(valid, "the keyword Minimize or Maximize is missing")
        while found and self.section != "End":
            self.section = names[(found.lastindex or 1) - 1]
            self.mark, self.at = found.start(), found.end()
            found = _SECTION.search(self.text, self.at)
            self.end = found.start() if found else len(self.text)
            if self.section not in parts and self.section != "End":
                contents, self.section = self.section, words(self.text[self.mark : self.at].strip())
                require(not self.rest(), f"{contents} are not supported")
                continue
            require(self.section not in past, "the section occurs twice")
            order = {"objective": 0, "Subject To": 1}.get(self.section, max(len(past), 1))
            require(len(past) == order, "the section is out of order")
            past.add(self.section)
            while self.section != "End" and self.rest():
                parts[self.section]()
        require(self.section == "End", "the keyword End is missing")
        require(not self.text[self.at :].strip(), "text after End")
        self.finish()

    def rest(self) -> bytes:
        """Return the next word of the section, empty at its end."""
        found = _REST.match(self.text, self.at, self.end)
        return found[1] if found else b""

    def take(self, pattern: re.Pattern[bytes]) -> re.Match[bytes] | None:
        found = pattern.match(self.text, self.at, self.end)
        if found:
            self.mark, self.at = found.end() - len(found[0].lstrip()), found.end()
        return found

    def expect(self, pattern: re.Pattern[bytes], what: str) -> re.Match[bytes]:
        found = self.take(pattern)
        if found is None:
            rest = self.expect(_REST, "")[1]
            raise Unread(f"expected {what}, got {words(rest)!r}")
        return found

    def usable(self, *names: bytes) -> None:
        for name in names:
            if _RESERVED.fullmatch(name):
                raise Unread(
                    f"{words(name)!r} is a keyword or a number for HiGHS: rename it or use MPS"
                )

    def label(self) -> bytes:
        found = self.take(_LABEL)
        self.usable(*(found.groups() if found else ()))
        return found[1] if found else b""

    def terms(self, objective: bool) -> None:
        """Read a sum of terms with different columns, up to a relation or the end."""
        seen: set[bytes] = set()
        first = True
        while (word := self.rest()) and word[:1] not in b"<>=":
            bracket = self.take(_BRACKET)
            found = bracket or self.expect(_TERM, "a term")
            signs, number, name = (bracket[1], b"", b"") if bracket else found.groups()
            if not first and not signs.strip():
                raise Unread(
                    f"{words(word)!r} is a part of a name that HiGHS and SCIP cannot read: rename it or use MPS"
                    if word[:1] == b"[" else f"expected + or - before {words(word)!r}"
                )  # fmt: skip
            first = False
            if bracket:
                require(objective, "quadratic constraints are not supported")
                require(b"-" not in signs, "a minus before a bracket: change the signs in it")
                self.bracket()
            elif not name and not (number and objective):
                raise Unread(f"expected a term such as + 2 x, got {words(word)!r}")
            if number:
                real(number)
            if name:
                self.usable(name)
                self.ended(name)
                if name in seen:
                    raise Unread(f"column {words(name)} occurs twice: add the coefficients")
                seen.add(name)
        self.columns |= seen

    def ended(self, name: bytes) -> None:
        """Refuse a sign directly after a name."""
        joined = self.text[self.at : self.at + 1] in (b"+", b"-")
        require(
            not joined,
            f"Gurobi adds a sign without a blank before it to the name {words(name)}: add a blank",
        )

    def bracket(self) -> None:
        seen: set[frozenset[bytes]] = set()
        while not self.take(_CLOSE):
            found = self.expect(_PRODUCT, "x ^ 2, x * y or ] / 2")
            signs, number, left, right = found.groups()
            require(signs.strip() or not seen, "expected a sign between quadratic terms")
            pair = frozenset((left, right or left))
            self.usable(*pair)
            if right:
                self.ended(right)
            if number:
                real(number)
            require(pair not in seen, f"a product of {words(left)} occurs twice: add them")
            seen.add(pair)
            self.columns |= pair

    def objective(self) -> None:
        self.label()
        self.terms(objective=True)
        require(not self.rest(), "a relation in the objective")

    def row(self) -> None:
        name = self.label()
        require(not name or name not in self.rows, f"row {words(name)} is defined twice")
        self.rows.add(name)
        self.terms(objective=False)
        relation, side = self.expect(
            _SIDE, "<=, >= or =, and a number at the end of a line"
        ).groups()
        # Gurobi writes a row without an upper side as "<= 1e+100".
        sign = {b"<=": 1, b">=": -1}.get(relation)
        number = self.value(side)
        free = sign and sign * number >= INFINITY
        require(free or abs(number) < INFINITY, "an infinite right-hand side")

    def value(self, text: bytes) -> float:
        signs = text.count(b"-", 0, len(text) - len(text.lstrip(b"+- \t\r\n")))
        return (-1.0) ** signs * real(text.lstrip(b"+- \t\r\n"), infinite=True)

    def bound(self) -> None:
        found = self.expect(_BOUND, "a bound such as 0 <= x <= 4, x >= -1 or x free")
        left, first, name, second, right, free = found.groups()
        self.usable(name)
        turn = {b"<=": b">=", b">=": b"<=", b"=": b"="}
        sides = [(turn[first], left)] if left else []
        sides += [(second, right)] if right else []
        if len(sides) + bool(free) != 1 and not first == second == b"<=":
            raise Unread("expected a bound such as 0 <= x <= 4, x >= -1 or x free")
        self.columns.add(name)
        for relation, value in [(b">=", b"-inf"), (b"<=", b"inf")] if free else sides:
            number = self.value(value)
            for bounds, other, sign in ((self.lower, b"<=", 1), (self.upper, b">=", -1)):
                if relation != other:
                    fault = name in bounds or sign * number >= INFINITY
                    require(not fault, f"a bound of {words(name)} is infinite or defined twice")
                    bounds[name] = number

    def name(self) -> None:
        name = self.expect(_WORD, "a name")[1]
        require(name in self.columns, f"column {words(name)} is in no row and not in the objective")
        require(name not in self.integral, f"column {words(name)} occurs twice")
        self.integral[name] = self.section

    def finish(self) -> None:
        self.section = "Bounds"
        check_bounds(self.lower, self.upper)
        for name, section in self.integral.items():
            valid = 0 <= self.lower.get(name, 0.0) <= self.upper.get(name, 1.0) <= 1
            require(valid or section != "Binary", f"binary column {words(name)} has other bounds")
