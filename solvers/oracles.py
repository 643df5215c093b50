"""Questions that a run in a worker asks of the data that is hidden from it, and their answers.

A question is a header of two whole numbers, rows and columns, and the numbers of a table; an answer is
the same, or the length of a JSON object that says why there is none. Nothing else is read, so neither
end can make the other one run anything.
"""

from __future__ import annotations

import contextlib
import json
import socket
import struct
import threading
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import errors
from ..errors import CrosstrackError, HiddenData, InvalidData

__all__ = ["Asking", "carried", "raised", "serve"]

Floats = NDArray[np.float64]

_HEADER = struct.Struct("<QQ")
#: Stands for the number of rows where a text follows.
_REFUSED = 2**64 - 1
#: Numbers of one table at the most: 1 GB.
_MOST = 2**27


class Asking:
    """The end of the worker: callable, as :attr:`~crosstrack.solvers.Control.oracle` is.

    Parameters
    ----------
    channel : socket
        To the process that has the hidden data.
    """

    def __init__(self, channel: socket.socket) -> None:
        self._channel = channel
        self._lock = threading.Lock()
        self._closed = False

    def __call__(self, questions: Floats) -> Floats:
        """Return the answers; what there is none for raises here, as it did where the data is."""
        body = _packed(np.asarray(questions, np.float64))
        with self._lock:
            if self._closed:
                raise HiddenData("the run has ended: its model answers no more questions")
            self._channel.sendall(body)
            rows, columns = _HEADER.unpack(_read(self._channel, _HEADER.size))
            if rows != _REFUSED:
                return _table(self._channel, rows, columns)
            reason = json.loads(_read(self._channel, columns))
        raise raised(reason) or InvalidData(reason["message"], field=reason["field"])

    def close(self) -> bool:
        """Ask nothing more; return whether no answer is awaited, by a thread that was left behind.

        Else another job would be given that answer: the process must end.
        """
        self._closed = True
        idle = self._lock.acquire(blocking=False)
        if idle:
            self._lock.release()
        return idle


def carried(error: BaseException) -> dict[str, Any]:
    """Return what of an exception goes to another process."""
    return {
        "type": type(error).__name__,
        "message": str(error),
        "field": getattr(error, "field", None),
    }


def raised(data: Mapping[str, Any]) -> CrosstrackError | None:
    """Return the exception of ours that :func:`carried` wrote, None where it is another's."""
    kind = getattr(errors, data["type"], None)
    if not isinstance(kind, type) or not issubclass(kind, CrosstrackError):
        return None
    error = kind.__new__(kind)
    Exception.__init__(error, data["message"])
    if data["field"] is not None:
        error.field = data["field"]  # type: ignore[attr-defined]
    return error


def serve(channel: socket.socket, oracle: Callable[[], Callable[[Any], Any] | None]) -> None:
    """Answer questions until the channel is closed.

    Parameters
    ----------
    channel : socket
        To the worker.
    oracle : callable
        Returns what answers for the job that runs now.
    """
    # Whatever ends this thread closes the channel, so that no worker waits for ever.
    with contextlib.suppress(OSError, EOFError), channel:
        while True:
            rows, columns = _HEADER.unpack(_read(channel, _HEADER.size))
            questions = _table(channel, rows, columns)
            try:
                answers = oracle()
                if answers is None:
                    raise HiddenData("the model answers no questions during a run")
                reply = _packed(np.asarray(answers(questions), np.float64))
            except BaseException as error:
                # Even sys.exit() in a stranger's function ends the run alone.
                reply = _refusal(error)
            channel.sendall(reply)


def _refusal(error: BaseException) -> bytes:
    if not isinstance(error, CrosstrackError):
        error = InvalidData(f"{type(error).__name__}: {error}", field="oracle")
    body = json.dumps(carried(error)).encode()
    return _HEADER.pack(_REFUSED, len(body)) + body


def _packed(table: Floats) -> bytes:
    if table.ndim != 2 or table.size > _MOST:
        raise InvalidData(
            f"a table must have two dimensions and at most {_MOST} numbers, got shape {table.shape}"
        )
    return _HEADER.pack(*table.shape) + table.tobytes()


def _table(channel: socket.socket, rows: int, columns: int) -> Floats:
    data = _read(channel, rows * columns * 8)
    return np.frombuffer(data, np.float64).reshape(rows, columns).copy()


def _read(channel: socket.socket, size: int) -> bytes:
    """Return the next `size` bytes; ``EOFError`` where the channel ends before."""
    parts = []
    while size:
        part = channel.recv(min(size, 2**20))
        if not part:
            raise EOFError
        parts.append(part)
        size -= len(part)
    return b"".join(parts)
