"""Kinds of points as words and codes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Spec, frozen, show
from ..specs import count_rows

__all__ = [
    "END",
    "HORIZONTAL",
    "KIND_WORDS",
    "START",
    "VERTICAL",
    "Kinds",
    "as_kind",
    "kind_word",
]

START, HORIZONTAL, VERTICAL, END = range(4)

#: Word of each kind, by code.
KIND_WORDS = ("A", "horizontal", "vertical", "B")

#: Codes by word, and by the contest's numbers from -1 for A to 2 for B.
_CODES = {text: code for code, word in enumerate(KIND_WORDS) for text in (word, str(code - 1))}


def kind_word(value: Any, where: str) -> str:
    """Return the word for a kind given as a word, a code, or ``"A点"`` as in contest files."""
    word = as_kind(value)
    if word is None:
        raise InvalidData(
            f"{where} must be one of A, horizontal, vertical, B (or -1 for A, 0 for horizontal, "
            f"1 for vertical, 2 for B), got {show(value)}",
            field="kinds",
        )
    return word


def as_kind(value: Any) -> str | None:
    """Return the word for the kind `value`, or None for an unknown kind."""
    if isinstance(value, int | np.integer) and not isinstance(value, bool):
        value = str(int(value))
    if not isinstance(value, str):
        return None
    text = value.removesuffix("点").strip()  # the contest's word for point
    code = _CODES.get(text.removesuffix(".0"))  # 0.0 is what floating-point columns make of 0
    return None if code is None else KIND_WORDS[code]


@dataclass(frozen=True)
class Kinds(Spec):
    """Field of the kinds of points, stored as words."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> NDArray[np.str_]:
        if isinstance(value, str) or not isinstance(value, Iterable):
            raise InvalidData(f"{name} must be a list of words, got {show(value)}", field=name)
        words = [kind_word(entry, f"{name}[{row}]") for row, entry in enumerate(value)]
        count_rows(name, len(words), "n", sizes)
        return self.refreeze(np.array(words, dtype="<U10"))

    def encode(self, value: NDArray[np.str_]) -> Any:
        return value.tolist()

    def feed(self, value: NDArray[np.str_]) -> Iterable[bytes]:
        yield value.tobytes()

    def refreeze(self, value: NDArray[np.str_]) -> NDArray[np.str_]:
        return frozen(value)
