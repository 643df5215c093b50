r"""Strict check of files in LP format before HiGHS reads them.

The check allows this grammar, which CPLEX, Gurobi, HiGHS and SCIP read alike::

    Minimize | Maximize      [name:] terms, constants and "+ [ quadratic terms ] / 2"
    Subject To               [name:] terms (<= | >= | =) number      one row per line or more
    Bounds                   number <= x <= number | x (<= | >= | =) number | number <= x | x free
    General, Binary          names
    End

Keywords start a line, numbers and names are separated by blanks or signs, and ``\`` starts a comment.
HiGHS skips everything before a keyword that it knows, drops constants in rows, reads the name ``info``
as infinity times ``o``, and keeps bounds of binary columns; the check refuses such files. A negative
upper bound requires an explicit lower bound, as in MPS files.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

from .scan import INFINITY, Scan, Unread, real, words

__all__ = ["check_lp"]

_TOKEN = re.compile(
    rb"(?P<blank>[ \t\r]+|\\[^\n]*)|(?P<end>\n)|(?P<sign><=|>=|[=+\-*/^:\[\]])"
    rb"|(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)(?=[\s<>=+\-*/^:\[\]\\]|\Z)"
    rb"|(?P<name>[^\s\d.<>=+\-*/^:\[\]\\;][^\s<>=+\-*/^:\[\]\\;]*)"
)
#: Keywords at the start of a line, in lower case, by section.
_KEYWORDS = {
    **dict.fromkeys(
        (b"minimize", b"min", b"minimum", b"maximize", b"max", b"maximum"), "objective"
    ),
    **dict.fromkeys((b"subject to", b"such that", b"st", b"s.t."), "Subject To"),
    **dict.fromkeys((b"bounds", b"bound"), "Bounds"),
    **dict.fromkeys((b"general", b"generals", b"gen", b"integer", b"integers"), "General"),
    **dict.fromkeys((b"binary", b"binaries", b"bin"), "Binary"),
    b"end": "End",
}
_UNSUPPORTED = {
    **dict.fromkeys((b"semi-continuous", b"semi", b"semis"), "semi-continuous columns"),
    **dict.fromkeys((b"sos", b"sos1", b"sos2"), "special ordered sets"),
    **dict.fromkeys((b"general constraints", b"gencons"), "general constraints"),
    **dict.fromkeys((b"general constraint", b"pwlobj", b"pwlcon"), "general constraints"),
    **dict.fromkeys((b"lazy constraints", b"lazy"), "lazy constraints"),
    **dict.fromkeys((b"user cuts", b"user"), "cuts"),
    **dict.fromkeys((b"multi-objectives", b"scenario"), "several objectives or scenarios"),
}
_RELATIONS = (b"<=", b">=", b"=")
#: First words of all keywords.
_FIRST = {re.split(rb"[ -]", text)[0] for text in (*_KEYWORDS, *_UNSUPPORTED)}


def check_lp(path: Path, raw: bytes) -> None:
    """Raise if the text of an LP file is damaged, ambiguous, or beyond linear and quadratic programs.

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
    scan = _Lp(path, raw)
    try:
        scan.tokenize(raw)
        scan.read()
    except Unread as error:
        raise scan.refusal(error) from None


class _Lp(Scan):
    """Tokens of an LP file and the names in it."""

    def __init__(self, path: Path, raw: bytes) -> None:
        super().__init__(path, raw)
        #: Triples of kind, text and line; the last one has the kind "end".
        self.tokens: list[tuple[str, bytes, int]] = []
        self.position = 0
        self.columns: set[bytes] = set()
        self.rows: set[bytes] = set()
        self.lower: dict[bytes, float] = {}
        self.upper: dict[bytes, float] = {}
        self.integral: dict[bytes, str] = {}

    def tokenize(self, raw: bytes) -> None:
        at, self.line = 0, 1
        while at < len(raw):
            found = _TOKEN.match(raw, at)
            if found is None:
                rest = raw[at : at + 40].split()[0]
                if raw[at - 1 : at + 1] == b"->":
                    raise Unread("indicator constraints are not supported")
                hint = (
                    "write <= or >="
                    if rest[:1] in b"<>"
                    else "separate numbers and names by blanks"
                )
                raise Unread(f"{words(rest)!r} is not a part of the LP format: {hint}")
            kind, at = str(found.lastgroup), found.end()
            if kind == "end":
                self.line += 1
            elif kind != "blank":
                self.tokens.append((kind, found.group(), self.line))
        self.tokens.append(("end", b"the end of the file", self.line))

    @property
    def kind(self) -> str:
        return self.tokens[self.position][0]

    @property
    def text(self) -> bytes:
        return self.tokens[self.position][1]

    @property
    def fresh(self) -> bool:
        """Whether the token is the first of its line."""
        return (
            not self.position or self.tokens[self.position - 1][2] != self.tokens[self.position][2]
        )

    def next(self) -> bytes:
        text, self.line = self.tokens[self.position][1:]
        self.position = min(self.position + 1, len(self.tokens) - 1)
        return text

    def take(self, *texts: bytes) -> bool:
        """Pass the token if it is one of `texts`."""
        if self.text in texts and self.kind != "end":
            self.next()
            return True
        return False

    def keyword(self) -> tuple[bytes, int]:
        """Return the keyword at the token and its number of tokens; empty if it is not one."""
        if self.kind != "name" or self.text.lower() not in _FIRST:
            return b"", 0
        texts = [token[1].lower() for token in self.tokens[self.position : self.position + 3]]
        texts += [b""] * (3 - len(texts))
        for count, text in ((3, b"".join(texts)), (2, b" ".join(texts[:2])), (1, texts[0])):
            if text in _KEYWORDS or (text in _UNSUPPORTED and self.fresh and count > 1):
                return text, count
            # Some words are keywords only if they are alone on their line, and otherwise names.
            after = self.tokens[min(self.position + count, len(self.tokens) - 1)]
            alone = self.fresh and (after[2] != self.tokens[self.position][2] or after[0] == "end")
            if text in _UNSUPPORTED and (alone or text.startswith((b"sos", b"semi"))):
                return text, count
        return b"", 0

    def ends(self) -> bool:
        """Whether a section or the file ends at the token."""
        text, count = self.keyword()
        if text and not self.fresh:
            self.line = self.tokens[self.position][2]
            raise Unread(f"{words(text)} is a keyword and must not be a name")
        return bool(count) or self.kind == "end"

    def read(self) -> None:
        sections = {
            "objective": self.objective,
            "Subject To": self.constraints,
            "Bounds": self.bounds,
            "General": self.names,
            "Binary": self.names,
        }
        past: set[str] = set()
        while self.section != "End":
            if not self.ends() or self.kind == "end":
                self.line = self.tokens[self.position][2]
                raise Unread(f"a keyword such as {'End' if past else 'Minimize'} is missing")
            text, count = self.keyword()
            for _ in range(count):
                self.next()
            if text in _UNSUPPORTED:
                if self.ends():
                    continue  # empty sections, as HiGHS writes them
                raise Unread(
                    f"section {words(text)} contains {_UNSUPPORTED[text]}, which are not supported"
                )
            section = _KEYWORDS[text]
            if section in past or (not past) != (section == "objective"):
                raise Unread(f"section {words(text)} occurs twice, or before the objective")
            if section not in ("objective", "Subject To", "End") and "Subject To" not in past:
                raise Unread(f"section {words(text)} occurs before the rows")
            if self.text == b":":
                raise Unread(f"{words(text)} is a keyword and must not be a name")
            past.add(section)
            self.section = section
            if section != "End":
                sections[section]()
        if self.kind != "end":
            raise Unread("text after End")
        self.finish()

    def finish(self) -> None:
        self.section = "Bounds"
        for column, upper in self.upper.items():
            if upper < 0 and column not in self.lower:
                raise Unread(
                    f"column {words(column)} has the negative upper bound {upper:g} and no lower bound, "
                    "which readers treat in different ways: add the lower bound"
                )
            if self.lower.get(column, 0.0) > upper:
                raise Unread(f"the bounds of column {words(column)} contradict each other")
        for column, section in self.integral.items():
            bounds = self.lower.get(column, 0.0), self.upper.get(column, 1.0)
            if section == "Binary" and not 0 <= bounds[0] <= bounds[1] <= 1:
                raise Unread(f"binary column {words(column)} has other bounds than 0 and 1")

    def column(self) -> bytes:
        """Return the name of a column at the token."""
        if self.ends() or self.kind != "name":
            self.line = self.tokens[self.position][2]
            raise Unread(f"expected a name, got {words(self.text)!r}")
        if self.text.lower().startswith((b"inf", b"nan")) or self.text.lower() == b"free":
            raise Unread(f"{words(self.text)!r} is not usable as a name: HiGHS reads a number")
        return self.next()

    def signs(self) -> tuple[int, float]:
        count, sign = 0, 1.0
        while self.text in (b"+", b"-") and self.kind == "sign":
            sign = -sign if self.next() == b"-" else sign
            count += 1
        if count > 2:
            raise Unread("more than two signs")
        return count, sign

    def value(self, infinite: bool = False) -> float:
        """Return the number with its sign at the token."""
        sign = self.signs()[1]
        return sign * real(self.next(), infinite)

    def label(self) -> bytes:
        after = self.tokens[min(self.position + 1, len(self.tokens) - 1)]
        if after[1] != b":" or self.kind != "name":
            return b""
        name = self.column()
        self.next()
        return name

    def terms(self, objective: bool) -> None:
        """Read a sum of terms with different columns."""
        seen: set[bytes] = set()
        first = True
        while not self.ends() and self.text not in _RELATIONS:
            count, sign = self.signs()
            if not first and not count:
                raise Unread(f"expected a sign or a relation before {words(self.text)!r}")
            first = False
            numeric = self.kind == "number"
            if numeric:
                real(self.next())
            if objective and not numeric and self.text == b"[":
                if sign < 0:
                    raise Unread("a minus before a bracket: write the signs in the bracket")
                self.bracket()
            elif self.text == b"[" and not objective:
                raise Unread("quadratic constraints are not supported")
            elif self.kind == "name" and not self.ends():
                name = self.column()
                if name in seen:
                    raise Unread(f"column {words(name)} occurs twice: add the coefficients")
                seen.add(name)
            elif not (numeric and objective):
                raise Unread(f"expected a name, got {words(self.text)!r}")
        self.columns |= seen
        if not objective and not seen:
            raise Unread("a row without columns")

    def bracket(self) -> None:
        """Read quadratic terms ``[ 2 x ^ 2 - y * z ] / 2``."""
        self.next()
        seen: set[frozenset[bytes]] = set()
        while not self.take(b"]"):
            if not self.signs()[0] and seen:
                raise Unread(f"expected a sign or ] before {words(self.text)!r}")
            if self.kind == "number":
                real(self.next())
            first = second = self.column()
            if self.take(b"*"):
                second = self.column()
            elif not (self.take(b"^") and self.next() == b"2"):
                raise Unread("a quadratic term must be x ^ 2 or x * y")
            pair = frozenset((first, second))
            if pair in seen:
                raise Unread(f"the product of {words(first)} and {words(second)} occurs twice")
            seen.add(pair)
            self.columns |= pair
        if not (self.take(b"/") and self.next() == b"2"):
            raise Unread("] must be followed by / 2")

    def objective(self) -> None:
        self.label()
        self.terms(objective=True)
        if not self.ends():
            raise Unread("a relation in the objective")

    def constraints(self) -> None:
        while not self.ends():
            self.line_start()
            name = self.label()
            if name and name in self.rows:
                raise Unread(f"row {words(name)} is defined twice")
            self.rows.add(name)
            self.terms(objective=False)
            if not self.take(*_RELATIONS):
                raise Unread("expected <=, >= or =")
            if abs(self.value()) >= INFINITY:
                raise Unread("an infinite right-hand side")

    def line_start(self) -> None:
        self.line = self.tokens[self.position][2]
        if not self.fresh:
            raise Unread(f"{words(self.text)!r} must start on its own line")

    def bounds(self) -> None:
        while not self.ends():
            self.line_start()
            if self.kind == "name" and not self.text.lower().startswith((b"inf", b"nan")):
                name = self.column()
                if self.text.lower() == b"free" and self.kind == "name":
                    self.next()
                    self.set(name, -math.inf, math.inf)
                    continue
                relation = self.next()
                value = self.value(infinite=True)
            else:
                value = self.value(infinite=True)
                relation = {b"<=": b">=", b">=": b"<="}.get(self.text, self.text)
                self.next()
                name = self.column()
                if relation == b">=" and self.take(b"<="):
                    self.set(name, value, None)
                    relation, value = b"<=", self.value(infinite=True)
            if relation not in _RELATIONS:
                raise Unread("expected <=, >=, = or free")
            self.set(
                name, None if relation == b"<=" else value, None if relation == b">=" else value
            )

    def set(self, name: bytes, lower: float | None, upper: float | None) -> None:
        if name not in self.columns:
            raise Unread(f"column {words(name)} does not occur in the objective or a row")
        for bounds, value, side in ((self.lower, lower, 1), (self.upper, upper, -1)):
            if value is not None:
                if name in bounds or side * value >= INFINITY:
                    raise Unread(f"a bound of column {words(name)} is infinite or defined twice")
                bounds[name] = value

    def names(self) -> None:
        while not self.ends():
            name = self.column()
            if name not in self.columns:
                raise Unread(f"column {words(name)} does not occur in the objective or a row")
            if name in self.integral:
                raise Unread(f"column {words(name)} occurs twice")
            self.integral[name] = self.section
