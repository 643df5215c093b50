"""Reading JSON text strictly: what no model could hold is refused, with its place."""

from __future__ import annotations

import json
import math
import re
from typing import Any

from ..errors import InvalidData
from .fields import required, show, unwritable

__all__ = ["parse_json"]


def parse_json(text: str) -> Any:
    """Return the JSON value in `text`.

    Raises
    ------
    InvalidData
        The text is no JSON; a NaN, an infinity or a number beyond the range of floats; a key that
        stands twice; half a character (a lone surrogate); more levels than Python can follow.
    """
    required("text", text, str)
    beyond: list[str] = []

    def constant(word: str) -> Any:
        raise InvalidData(f"{word} is no JSON number: write null where infinity is meant")

    def pairs(items: list[tuple[str, Any]]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for key, value in items:
            if key in found:
                raise InvalidData(f"key {key!r} stands twice in one object", field=key)
            found[key] = value
        return found

    def real(digits: str) -> float:
        found = float(digits)
        if math.isinf(found):
            beyond.append(digits)
        return found

    def whole(digits: str) -> int | float:
        try:
            return int(digits)
        except ValueError:  # more digits than Python converts
            return real(digits)

    # Looked for only where the text may hold some, for texts may be long.
    suspect = _suspect(text)
    try:
        found = json.loads(
            text, parse_constant=constant, object_pairs_hook=pairs,
            parse_float=real if suspect else None, parse_int=whole if suspect else None,
        )  # fmt: skip
        if suspect:
            _refuse_unwritten(found, (), beyond)
    except json.JSONDecodeError as error:
        raise InvalidData(f"no valid JSON: {error}") from None
    except RecursionError:
        raise InvalidData("no valid JSON: nested too deeply") from None
    return found


#: Half a character, written out or as JSON's escape of it.
_HALF = re.compile(r"[\ud800-\udfff]|\\u[dD][89a-fA-F]")
#: An exponent that may be beyond floats.
_LARGE = re.compile(r"[eE]\+?0*[1-9][0-9]{2}")
#: A run of digits beyond floats holds a window of so many of them, wherever windows begin.
_DIGITS = 150


def _suspect(text: str) -> bool:
    """Return whether JSON text may hold half a character or a number beyond floats; fast, not exact."""
    odd = not text.isascii() or "\\u" in text
    return (
        (odd and _HALF.search(text) is not None)
        or _LARGE.search(text) is not None
        or any(text[k : k + _DIGITS].isdigit() for k in range(0, len(text), _DIGITS))
    )


def _refuse_unwritten(value: Any, at: tuple[Any, ...], beyond: list[str]) -> None:
    """Raise where the tree of JSON data holds half a character, or a number `beyond` all floats."""
    field = next((str(key) for key in at if isinstance(key, str) and key != "data"), None)
    if isinstance(value, float) and math.isinf(value):
        raise InvalidData(
            f"{_place(at)} is beyond the range of numbers, got {show(beyond[0])}: write null where "
            "infinity is meant",
            field=field,
        )
    if isinstance(value, str) and unwritable(value):
        raise InvalidData(
            f"{_place(at)} holds half a character (a lone surrogate), got {ascii(value)[:60]}",
            field=field,
        )
    if isinstance(value, dict):
        for key, part in value.items():
            _refuse_unwritten(key, at, beyond)
            _refuse_unwritten(part, (*at, key), beyond)
    elif isinstance(value, list):
        for k, part in enumerate(value):
            _refuse_unwritten(part, (*at, k), beyond)


def _place(at: tuple[Any, ...]) -> str:
    """Return a place in JSON data as messages name it, such as ``points[0][2]``."""
    words = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in at)
    return words.removeprefix(".data").lstrip(".") or "the data"
