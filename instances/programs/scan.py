"""Parts of the strict checks of text files, which run before a library reads them.

The readers of the libraries skip what they do not expect: C functions read ``1.0abc`` as 1, and an
unknown keyword can become a column. The checks therefore accept a subset of each format on which
common readers agree, and refuse everything else with the line and the section.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

from ...errors import InvalidData

__all__ = ["INFINITY", "Scan", "Unread", "real", "whole", "words"]

_NUMBER = re.compile(rb"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_INFINITE = re.compile(rb"[+-]?inf(?:inity)?", re.IGNORECASE)
_WHOLE = re.compile(rb"[+-]?\d{1,18}")
#: Bytes that readers treat in different ways, as white space or as a part of a name.
_CONTROL = re.compile(rb"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]|\r(?!\n|\Z)")
#: From this magnitude on, solvers treat a bound as infinite.
INFINITY = 1e20


class Unread(ValueError):
    """A part of a line is not allowed; :class:`Scan` adds file, line and section."""


class Scan:
    """Position in a text file, for messages.

    Parameters
    ----------
    path : Path
        The file, for messages.
    raw : bytes
        Its content.

    Raises
    ------
    InvalidData
        The file is not UTF-8 or contains control characters.
    """

    def __init__(self, path: Path, raw: bytes) -> None:
        self.path = path
        self.line = 0
        self.section = ""
        try:
            raw.decode("utf-8")
        except UnicodeDecodeError as error:
            self.line = raw.count(b"\n", 0, error.start) + 1
            raise self.refusal(f"byte 0x{raw[error.start]:02x} is not UTF-8") from None
        found = _CONTROL.search(raw)
        if found:
            self.line = raw.count(b"\n", 0, found.start()) + 1
            raise self.refusal(f"control character 0x{raw[found.start()]:02x} is not allowed")

    def refusal(self, message: object) -> InvalidData:
        """Return the exception that names file, line and section."""
        place = f", section {self.section}" if self.section else ""
        return InvalidData(f"{self.path}, line {self.line}{place}: {message}")


def words(token: bytes) -> str:
    """Return a token as text for messages, cut to 40 characters."""
    text = token.decode("utf-8", "replace")
    return text if len(text) <= 40 else text[:37] + "..."


def real(token: bytes, infinite: bool = False) -> float:
    """Return the number that a token denotes completely.

    Parameters
    ----------
    token : bytes
        The token.
    infinite : bool
        Whether ``inf`` and ``infinity`` are allowed.

    Raises
    ------
    Unread
        The token is not a decimal number, overflows, or underflows to 0.
    """
    if infinite and _INFINITE.fullmatch(token):
        return float(token)
    if not _NUMBER.fullmatch(token):
        raise Unread(f"{words(token)!r} is not a number")
    value = float(token)
    digits = re.split(rb"[eE]", token)[0]
    if math.isinf(value) or (value == 0 and re.search(rb"[1-9]", digits)):
        raise Unread(f"{words(token)} is outside the range of floating-point numbers")
    return value


def whole(token: bytes, least: int, most: int, what: str) -> int:
    """Return the integer that a token denotes completely; `what` names it in messages."""
    if not _WHOLE.fullmatch(token) or not least <= int(token) <= most:
        raise Unread(f"{what} must be an integer from {least} to {most}, got {words(token)!r}")
    return int(token)
