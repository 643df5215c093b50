"""Oracle channel: a run in a worker asks questions about hidden data, and the parent answers.

A question is a header of two integers, rows and columns, followed by the numbers of a table; the highest
bits of the rows select the method of the oracle. An answer has the same format, or is a JSON object with an error. Neither end reads anything else, so
neither end can execute code in the other one.
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

from ... import errors
from ...errors import CrosstrackError, HiddenData, InvalidData

__all__ = ["Asking", "carried", "end_oracle", "raised", "serve"]

Floats = NDArray[np.float64]

_HEADER = struct.Struct("<QQ")
#: Methods of oracles, by the number in the highest bits of a question's rows.
_METHODS, _SHIFT = ("__call__", "part", "start"), 60
#: Number of rows that marks an error text.
_REFUSED = 2**64 - 1
#: Largest number of values in a table: 1 GB.
_MOST = 2**27


class Asking:
    """Worker's end of the channel; callable like :attr:`~crosstrack.solvers.Control.oracle`.

    Parameters
    ----------
    channel : socket
        Socket connected to the process that has the hidden data.
    """

    def __init__(self, channel: socket.socket) -> None:
        self._channel = channel
        self._lock = threading.Lock()
        self._closed = False

    def __call__(self, questions: Floats) -> Floats:
        """Return the answers. An error of the oracle is raised here.

        Parameters
        ----------
        questions : ndarray, shape (m, n)
            One question per row.

        Returns
        -------
        ndarray, shape (m, k)

        Raises
        ------
        HiddenData
            The run has ended.
        CrosstrackError
            The error that the oracle raised.
        """
        return self._answer(questions, 0)

    def part(self, questions: Floats) -> Floats:
        """Return the answers to the first questions, see :meth:`~crosstrack.solvers.Control.ask`."""
        return self._answer(questions, 1)

    def start(self, questions: Floats) -> Floats:
        """Announce questions, see :meth:`~crosstrack.solvers.Control.start`."""
        return self._answer(questions, 2)

    def _answer(self, questions: Floats, method: int) -> Floats:
        body = _packed(np.asarray(questions, np.float64), method)
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
        """Refuse further questions and return True if no thread waits for an answer.

        If it returns False, the process must end, because the next job would receive that answer.
        """
        self._closed = True
        idle = self._lock.acquire(blocking=False)
        if idle:
            self._lock.release()
        return idle


def carried(error: BaseException) -> dict[str, Any]:
    """Return an exception as JSON data for another process, read by :func:`raised`.

    Parameters
    ----------
    error : BaseException
        The exception.

    Returns
    -------
    dict
        Its type, message and field.
    """
    return {
        "type": type(error).__name__,
        "message": str(error),
        "field": getattr(error, "field", None),
    }


def raised(data: Mapping[str, Any]) -> CrosstrackError | None:
    """Return the :class:`CrosstrackError` written by :func:`carried`; None for other exceptions.

    Parameters
    ----------
    data : mapping
        Result of :func:`carried`.
    """
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
        Socket connected to the worker.
    oracle : callable
        Function without arguments that returns the oracle of the current job, or None.
    """
    # If this thread ends, it closes the channel, so that the worker does not wait forever.
    with contextlib.suppress(OSError, EOFError), channel:
        while True:
            rows, columns = _HEADER.unpack(_read(channel, _HEADER.size))
            method, rows = divmod(rows, 1 << _SHIFT)
            questions = _table(channel, rows, columns)
            try:
                answers: Any = oracle()
                if answers is None:
                    raise HiddenData("the model answers no questions during a run")
                if method == 2 and not hasattr(answers, "start"):
                    reply = _packed(np.ones((1, 1)))
                else:
                    answer = getattr(answers, _METHODS[method], answers)
                    reply = _packed(np.asarray(answer(questions), np.float64))
            except BaseException as error:
                # Even sys.exit() in a user's function ends the run only.
                reply = _refusal(error)
            channel.sendall(reply)


def end_oracle(oracle: Any) -> None:
    """End the work of an oracle after a run, such as evaluations that were not requested."""
    if hasattr(oracle, "close"):
        oracle.close()


def _refusal(error: BaseException) -> bytes:
    if not isinstance(error, CrosstrackError):
        error = InvalidData(f"{type(error).__name__}: {error}", field="oracle")
    body = json.dumps(carried(error)).encode()
    return _HEADER.pack(_REFUSED, len(body)) + body


def _packed(table: Floats, method: int = 0) -> bytes:
    if table.ndim != 2 or table.size > _MOST:
        raise InvalidData(
            f"a table must have two dimensions and at most {_MOST} numbers, got shape {table.shape}"
        )
    return _HEADER.pack(table.shape[0] | method << _SHIFT, table.shape[1]) + table.tobytes()


def _table(channel: socket.socket, rows: int, columns: int) -> Floats:
    data = _read(channel, rows * columns * 8)
    return np.frombuffer(data, np.float64).reshape(rows, columns).copy()


def _read(channel: socket.socket, size: int) -> bytes:
    """Return the next `size` bytes; raise ``EOFError`` if the channel ends earlier."""
    parts = []
    while size:
        part = channel.recv(min(size, 2**20))
        if not part:
            raise EOFError
        parts.append(part)
        size -= len(part)
    return b"".join(parts)
