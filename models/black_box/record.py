"""Records of evaluations: an append-only file of JSON lines that a later run reads first."""

from __future__ import annotations

import contextlib
import json
import math
import os
import threading
import weakref
from collections import defaultdict, deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import show

__all__ = ["Record"]

Floats = NDArray[np.float64]

#: Mark and version of the header line.
_HEADER = {"crosstrack": "black-box record", "version": 1}


class Record:
    """Evaluations in a file of JSON lines, created if it does not exist.

    The first line is a header that describes the function and its variables. Each further line is one
    evaluation, written with one system call when it ends: a process that is killed at any time loses at most
    the evaluations that have not ended. An incomplete last line is removed. Reading executes no code. A file with
    another header or a damaged line raises ``InvalidData`` with file and line.
    """

    def __init__(self, path: str, header: Mapping[str, Any], dimension: int, columns: int) -> None:
        self._path, self._dimension, self._columns = path, dimension, columns
        self._known: defaultdict[bytes, deque[tuple[Floats, str]]] = defaultdict(deque)
        self._lock = threading.Lock()
        try:
            self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
            self._close = weakref.finalize(self, os.close, self._descriptor)
            with Path(path).open("rb") as file:
                content = file.read()
            self._read(content, {**_HEADER, **header})
        except OSError as error:
            raise InvalidData(f"record {path!r}: {error.strerror}", field="record") from None

    def _read(self, content: bytes, header: Mapping[str, Any]) -> None:
        end = content.rfind(b"\n") + 1
        lines = content[:end].splitlines()
        if not lines:
            first = json.dumps(header).encode()
            if not first.startswith(content):  # not the header of a run that was killed
                self._refuse(1, f"must be the header of a record, got {show(content[:40])}")
            if content:
                os.ftruncate(self._descriptor, 0)
            self._write(header)
            return
        stored = self._parsed(lines[0], 1)
        for name in dict.fromkeys([*_HEADER, *header, *stored]):
            if stored.get(name) != header.get(name):
                self._refuse(
                    1,
                    f"its {name} is {show(stored.get(name))}, and this run has {show(header.get(name))}; "
                    "use another file",
                )
        for number, line in enumerate(lines[1:], 2):
            data = self._parsed(line, number)
            x = self._numbers(data.get("x"), self._dimension, number, "x", False)
            values = self._numbers(data.get("values"), self._columns, number, "values", True)
            error = data.get("error", "")
            if not isinstance(error, str):
                self._refuse(number, f"error must be a text, got {show(error)}")
            self._known[x.tobytes()].append((values, error))
        if end < len(content):  # otherwise another run may append at present
            os.ftruncate(self._descriptor, end)

    def _parsed(self, line: bytes, number: int) -> dict[str, Any]:
        try:
            data = json.loads(line)
        except (ValueError, RecursionError):
            data = None
        if not isinstance(data, dict):
            self._refuse(number, f"must be a JSON object, got {show(line[:40])}")
        return data

    def _numbers(self, value: Any, count: int, number: int, name: str, may_lack: bool) -> Floats:
        allowed = (int, float, type(None)) if may_lack else (int, float)
        result = np.full(count, np.inf)
        if isinstance(value, list) and len(value) == count:
            with contextlib.suppress(OverflowError):
                if all(type(entry) in allowed for entry in value):
                    result = np.array(
                        [math.nan if entry is None else float(entry) for entry in value]
                    )
        if np.isinf(result).any() or (np.isnan(result).any() and not may_lack):
            self._refuse(number, f"{name} must be a list of {count} numbers, got {show(value)}")
        return result

    def _refuse(self, number: int, why: str) -> NoReturn:
        self._close()
        raise InvalidData(f"record {self._path!r}, line {number}: {why}", field="record")

    def take(self, x: Floats) -> tuple[Floats, str] | None:
        """Return values and error of the next stored evaluation at `x`, in their order; None without one."""
        answers = self._known.get(x.tobytes())
        return answers.popleft() if answers else None

    def add(self, x: Floats, values: Floats, seconds: float | None, error: str = "") -> None:
        """Append an evaluation with its duration and, at a skipped point, its error; null is no finite value."""
        finite = np.isfinite(values).tolist()
        data: dict[str, Any] = {
            "x": x.tolist(),
            "values": [v if f else None for v, f in zip(values.tolist(), finite, strict=True)],
        }
        if seconds is not None:
            data["seconds"] = round(seconds, 6)
        if error:
            data["error"] = error
        self._write(data)

    def _write(self, data: Mapping[str, Any]) -> None:
        line = json.dumps(data).encode() + b"\n"
        with self._lock:
            if not self._close.alive:  # an abandoned run
                return
            try:
                written, reason = os.write(self._descriptor, line), "the disk is full"
            except OSError as error:
                written, reason = 0, str(error.strerror)
            if written != len(line):
                raise InvalidData(
                    f"record {self._path!r} cannot be written: {reason}", field="record"
                )

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._close()
