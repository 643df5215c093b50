"""Parts of the strict checks of text files, which run before a library reads them.

The libraries skip what they do not expect: C functions read ``1.0abc`` as 1, and an unknown keyword
can become a column. The checks accept the part of each format on which common readers agree, and
refuse everything else with the line and the section.
"""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Self

from ...errors import InvalidData

__all__ = [
    "INFINITY",
    "NUMBER",
    "Scan",
    "Unread",
    "check_bounds",
    "real",
    "require",
    "whole",
    "words",
]

NUMBER = rb"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
#: From this magnitude on, solvers treat a bound as infinite.
INFINITY = 1e20

_REAL = re.compile(rb"[+-]?" + NUMBER)
_WHOLE = re.compile(rb"-?\d{1,18}")
_INFINITE = re.compile(rb"[+-]?inf(?:inity)?", re.IGNORECASE)
#: Bytes that readers treat in different ways, as white space or as a part of a name.
_CONTROL = re.compile(rb"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]|\r(?!\n|\Z)")


class Unread(ValueError):
    """A part of a line is not allowed; :class:`Scan` adds file, line and section."""


class Scan(ABC):
    """Strict reading of the content of a text file, and its position for messages.

    Raise ``InvalidData`` if the file is not UTF-8 or contains control characters.
    """

    def __init__(self, path: Path, raw: bytes) -> None:
        self.path, self.raw, self.line, self.section = path, raw, 0, ""
        found = _CONTROL.search(raw)
        place, fault = found.start() if found else 0, "a control character" if found else ""
        try:
            raw.decode("utf-8")
        except UnicodeDecodeError as error:
            place, fault = error.start, "not UTF-8"
        if fault:
            self.line = raw.count(b"\n", 0, place) + 1
            raise self.refusal(f"byte 0x{raw[place]:02x} is {fault}")

    @classmethod
    def check(cls, path: Path, raw: bytes) -> Self:
        """Return the scan of a file after reading its whole content.

        Raise ``InvalidData`` with line and section if the content is damaged, ambiguous or not supported, so that
        the library that reads the file afterwards would misread or ignore a part of it.
        """
        scan = cls(path, raw)
        try:
            scan.read()
        except Unread as error:
            raise scan.refusal(error) from None
        return scan

    @abstractmethod
    def read(self) -> None:
        """Read the whole file; raise :class:`Unread` at the first fault."""

    def refusal(self, message: object) -> InvalidData:
        """Return the exception that names file, line and section."""
        place = f", section {self.section}" if self.section else ""
        return InvalidData(f"{self.path}, line {self.line}{place}: {message}")


def words(token: bytes) -> str:
    """Return a token as text for messages, cut to 40 characters."""
    text = token.decode("utf-8", "replace")
    return text if len(text) <= 40 else text[:37] + "..."


def require(condition: object, message: str) -> None:
    """Raise :class:`Unread` unless `condition` is true."""
    if not condition:
        raise Unread(message)


def real(token: bytes, infinite: bool = False) -> float:
    """Return the number that a whole token denotes; `infinite` allows ``inf`` and ``infinity``.

    Raise :class:`Unread` if it is not a decimal number, overflows, or underflows to 0.
    """
    if infinite and _INFINITE.fullmatch(token):
        return float(token)
    if not _REAL.fullmatch(token):
        raise Unread(f"{words(token)!r} is not a number")
    value = float(token)
    if math.isinf(value) or (value == 0 and re.match(rb"[^eE]*[1-9]", token)):
        raise Unread(f"{words(token)} is outside the range of floating-point numbers")
    return value


def whole(token: bytes, least: int, most: int, what: str) -> int:
    """Return the integer that a whole token denotes; `what` names it in messages."""
    if not _WHOLE.fullmatch(token) or not least <= int(token) <= most:
        raise Unread(f"{what} must be an integer from {least} to {most}, got {words(token)!r}")
    return int(token)


def check_bounds(lower: dict[bytes, float], upper: dict[bytes, float]) -> None:
    """Raise if the explicit bounds of a column contradict each other, or readers disagree on them."""
    for name, value in upper.items():
        if value < 0 and name not in lower:
            raise Unread(
                f"column {words(name)} has the negative upper bound {value:g} and no lower bound, which "
                "readers treat in different ways: add the lower bound"
            )
        if lower.get(name, 0.0) > value:
            raise Unread(f"the bounds of column {words(name)} contradict each other")
