"""Calls of public constructors and functions with random invalid arguments, drawn by a seed."""

from __future__ import annotations

import decimal
import fractions
import json
import os
import random
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from crosstrack.errors import InvalidData


class Hostile:
    """Raises from whatever is asked of it."""

    def __array__(self, *_: Any, **__: Any) -> Any:
        raise RuntimeError("no array")

    def __float__(self) -> float:
        raise RuntimeError("no number")

    def __repr__(self) -> str:
        raise RuntimeError("no text")


def _ring() -> list[Any]:
    ring: list[Any] = [1.0]
    ring.append(ring)
    return ring


def _deep() -> Any:
    found: Any = 1.0
    for _ in range(3000):
        found = [found]
    return found


#: Functions that make odd values, called for each use, because a call may consume its value.
ODD: tuple[Callable[[], Any], ...] = (
    *(
        (lambda value=value: value)
        for value in (
            None, True, False, 0, 1, -1, 3, 2**31, 2**63, -(2**63), 2**64, 10**400, -(10**5000), 0.5, -0.0, 1e300, -1.7e308,
            5e-324, float("nan"), float("inf"), -float("inf"), 1 + 2j, "", "x", "1.5", "nan", "\ud800", "\0", "x" * 5000, b"x",
            (), (1,), (1, "a"), (None, None), int, Hostile, KeyError, json, len, decimal.Decimal("1.5"), fractions.Fraction(1, 3),
            range(3), Path("nowhere"), ..., NotImplemented, np.float32(0.5), np.int8(3), np.bool_(True), np.nan,
            np.datetime64("2020-01-01"), np.timedelta64(3, "s"), np.complex128(1j), np.longdouble("1e400"), np.str_("x"), np.ma.masked,
        )
    ),
    list,
    dict,
    lambda: set(),
    lambda: {1, 2},
    lambda: [[1], [2, 3]],
    lambda: [None],
    lambda: ['a'],
    lambda: [float('nan')],
    lambda: [10**400],
    lambda: [10**5000],
    lambda: [[]],
    lambda: [1, 2, 3],
    lambda: [[0.0, 0.0, 0.0]],
    lambda: {1: 2},
    lambda: {'a': 1},
    lambda: {'model': 'x', 'data': {}},
    lambda: object(),
    lambda: bytearray(b'ab'),
    lambda: _ring(),
    lambda: _deep(),
    lambda: Hostile(),
    lambda: iter([1, 2]),
    lambda: (k for k in range(3)),
    lambda: frozenset([1]),
    lambda: np.array([1, 2, 3], object),
    lambda: np.array(['a', 'b']),
    lambda: np.array([1j, 2]),
    lambda: np.array(['2020-01-01'], 'M8[D]'),
    lambda: np.array([1, 2], 'm8[s]'),
    lambda: np.array([(1, 2.0)], [('a', int), ('b', float)]),
    lambda: np.array([1.5], np.float16),
    lambda: np.array(['1e400'], np.longdouble),
    lambda: np.array([True, False]),
    lambda: np.zeros(0),
    lambda: np.zeros((0, 3)),
    lambda: np.zeros((2, 2, 2, 2)),
    lambda: np.full((3, 3), np.nan),
    lambda: np.ma.array([1.0, 2.0, 3.0], mask=[0, 1, 0]),
    lambda: np.ma.array([1.0, 2.0]),
    lambda: np.array(5),
    lambda: np.array(None),
    lambda: np.array([2**63], np.uint64),
    lambda: np.zeros(3, 'V4'),
    lambda: np.array([b'a']),
    lambda: np.rec.array([(1, 2)]),
    lambda: sp.csr_array(np.eye(2)),
    lambda: sp.csr_array(np.eye(2) * 1j),
    lambda: sp.coo_array(np.array([1.0, 0.0])),
    lambda: sp.csr_array(np.eye(2, dtype=bool)),
    lambda: sp.csr_matrix(np.eye(3)),
    lambda: memoryview(b'abcd'),
    lambda: (lambda *a, **k: None),
    lambda: (lambda *a, **k: 1 / 0),
    lambda: np.frompyfunc(lambda _: Hostile(), 1, 1)(np.zeros(2)),
)  # fmt: skip


def odd(draw: random.Random) -> Any:
    """Return a value that is invalid almost everywhere."""
    return draw.choice(ODD)()


def changed(value: Any, draw: random.Random) -> Any:
    """Return `value` made odd: another value in its place, or somewhere within."""
    if draw.random() < 0.45:
        return odd(draw)
    if isinstance(value, np.ndarray) and value.size:
        way = draw.randrange(5)
        if way == 0:
            others = [object, complex, np.float16, str] if value.dtype.kind in "iufb" else [object]
            with np.errstate(all="ignore"):
                return value.astype(draw.choice(others))
        if way == 1:
            return np.ma.array(value, mask=np.arange(value.size).reshape(value.shape) == 0)
        if way == 2:
            return value[..., None] if draw.random() < 0.5 else value.ravel()[:-1]
        if way == 3 and value.dtype.kind == "f":
            copy = np.array(value)
            copy.flat[draw.randrange(value.size)] = draw.choice(
                [np.nan, np.inf, -np.inf, 1e308, -1.0, 0.0]
            )
            return copy
        return changed(value.tolist(), draw)
    if isinstance(value, list | tuple) and value:
        parts = list(value)
        at = draw.randrange(len(parts))
        way = draw.randrange(4)
        if way == 0:
            del parts[at]
        elif way == 1:
            parts.insert(at, parts[at])
        else:
            parts[at] = changed(parts[at], draw)
        if draw.random() < 0.1:
            return iter(parts)
        return type(value)(parts) if type(value) in (list, tuple) else parts
    if isinstance(value, dict) and value:
        copy = dict(value)
        key = draw.choice(list(copy))
        if draw.random() < 0.3:
            del copy[key]
        else:
            copy[key] = changed(copy[key], draw)
        return copy
    if isinstance(value, float | int) and not isinstance(value, bool) and draw.random() < 0.5:
        large = value * 1e300 if abs(value) < 1e300 else value
        return draw.choice([-value, large, 2.5, float("inf"), 0, [value]])
    return odd(draw)


def strange_call(number: int) -> tuple[str, Callable[..., Any], list[Any], dict[str, Any]]:
    """Return the name of what is called, the callable and its arguments, at least one of them odd."""
    draw = random.Random(f"call {number}")
    known = _known()
    name, function, positional, named = known[number % len(known)]
    positional, named = list(positional), dict(named)
    for _ in range(draw.choice([1, 1, 1, 2, 3])):
        places: list[Any] = [*range(len(positional)), *named]
        at = draw.choice(places)
        holder: Any = positional if isinstance(at, int) else named
        holder[at] = changed(holder[at], draw)
    return name, function, positional, named


def faulty_call(number: int) -> tuple[str, Callable[..., Any], list[Any], dict[str, Any]]:
    """Return calls that end in every way there is, to try the judge on."""

    def refuse() -> None:
        raise InvalidData("by name")

    ways = (refuse, lambda: time.sleep(60), os.abort, lambda: 1 / 0, lambda: None)
    return "fault", ways[number], [], {}


def shown(positional: list[Any], named: dict[str, Any]) -> str:
    """Return the arguments for a report."""

    def plain(value: Any) -> str:
        try:
            return repr(value).encode("ascii", "backslashreplace").decode()[:80]
        except Exception:
            return type(value).__name__

    return ", ".join([*map(plain, positional), *(f"{k}={plain(v)}" for k, v in named.items())])


@cache
def _known() -> list[tuple[str, Callable[..., Any], tuple[Any, ...], dict[str, Any]]]:
    """Return what is called: a name, the callable and arguments that are right."""
    from table import table

    return table()
