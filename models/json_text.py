"""Strict reading of JSON text, with the place of the error."""

from __future__ import annotations

import json
import math
import re
from typing import Any

from ..errors import InvalidData
from .specs import required, show, unwritable

__all__ = ["parse_json"]


def parse_json(text: str) -> Any:
    """Return the JSON value in `text`.

    Raises
    ------
    InvalidData
        The text is not valid JSON or is nested too deeply; it contains NaN, infinity, a number
        beyond the range of floats, a duplicate key or a lone surrogate.
    """
    required("text", text, str)
    beyond: list[str] = []

    def constant(word: str) -> Any:
        raise InvalidData(f"{word} is no JSON number: write null where infinity is meant")

    def pairs(items: list[tuple[str, Any]]) -> dict[str, Any]:
        result: dict[str, Any] = {}
        for key, value in items:
            if key in result:
                raise InvalidData(f"key {key!r} stands twice in one object", field=key)
            result[key] = value
        return result

    def real(digits: str) -> float:
        result = float(digits)
        if math.isinf(result):
            beyond.append(digits)
        return result

    def whole(digits: str) -> int | float:
        try:
            return int(digits)
        except ValueError:  # more digits than Python converts
            return real(digits)

    # The tree is searched only if the quick scan finds a suspicious text, as texts may be long.
    suspect = _suspect(text)
    try:
        result = json.loads(
            text, parse_constant=constant, object_pairs_hook=pairs,
            parse_float=real if suspect else None, parse_int=whole if suspect else None,
        )  # fmt: skip
        if suspect:
            _reject_invalid(result, (), beyond)
    except json.JSONDecodeError as error:
        raise InvalidData(f"no valid JSON: {error}") from None
    except RecursionError:
        raise InvalidData("no valid JSON: nested too deeply") from None
    return result


#: Lone surrogate, as a character or as a JSON escape.
_HALF = re.compile(r"[\ud800-\udfff]|\\u[dD][89a-fA-F]")
#: Exponent that may exceed the range of floats.
_LARGE = re.compile(r"[eE]\+?0*[1-9][0-9]{2}")
#: Length of a window; every run of digits beyond the range of floats contains a full window.
_DIGITS = 150


def _suspect(text: str) -> bool:
    """Return whether JSON text may contain a lone surrogate or an excessive number; fast, not exact."""
    odd = not text.isascii() or "\\u" in text
    return (
        (odd and _HALF.search(text) is not None)
        or _LARGE.search(text) is not None
        or any(text[k : k + _DIGITS].isdigit() for k in range(0, len(text), _DIGITS))
    )


def _reject_invalid(value: Any, path: tuple[Any, ...], beyond: list[str]) -> None:
    """Raise if the JSON data contain a lone surrogate or a number `beyond` the range of floats."""
    field = next((str(key) for key in path if isinstance(key, str) and key != "data"), None)
    if isinstance(value, float) and math.isinf(value):
        raise InvalidData(
            f"{_place(path)} is beyond the range of numbers, got {show(beyond[0])}: write null where "
            "infinity is meant",
            field=field,
        )
    if isinstance(value, str) and unwritable(value):
        raise InvalidData(
            f"{_place(path)} holds half a character (a lone surrogate), got {ascii(value)[:60]}",
            field=field,
        )
    if isinstance(value, dict):
        for key, part in value.items():
            _reject_invalid(key, path, beyond)
            _reject_invalid(part, (*path, key), beyond)
    elif isinstance(value, list):
        for k, part in enumerate(value):
            _reject_invalid(part, (*path, k), beyond)


def _place(path: tuple[Any, ...]) -> str:
    """Return the place in JSON data as shown in messages, such as ``points[0][2]``."""
    text = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in path)
    return text.removeprefix(".data").lstrip(".") or "the data"
