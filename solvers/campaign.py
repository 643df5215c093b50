"""The record of a campaign: one JSON line a finished job, appended at once and never rewritten."""

from __future__ import annotations

import codecs
import contextlib
import json
import logging
import os
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

from ..errors import InvalidData
from ..models.fields import show
from ..models.model import Model, parse_json
from .job import Job
from .solution import Solution

try:
    import fcntl
except ImportError:  # Windows has no such locks
    fcntl = None  # type: ignore[assignment]

__all__ = ["LEFT_OUT", "Record", "lines_of"]

log = logging.getLogger("crosstrack")


#: What stands for a plan that whoever keeps records small has left out: there was a verified one.
LEFT_OUT = "left out"
#: How each line of a record begins, spaces apart.
_BEGIN = b'{"model":'


def lines_of(content: bytes, file: Path) -> tuple[list[tuple[int, dict[str, Any]]], bytes]:
    """Return the answers in a record with the numbers of their lines, and a last line that was cut off.

    Raises
    ------
    InvalidData
        A line is no JSON object, or the last one is not the start of an answer.
    """
    found: list[tuple[int, dict[str, Any]]] = []
    *whole, last = content.removeprefix(codecs.BOM_UTF8).split(b"\n")
    for number, line in enumerate([*whole, last], 1):
        if not line.strip():
            continue
        try:
            data = parse_json(line.decode("utf-8"))
            if not isinstance(data, dict):
                raise InvalidData(f"it must be an object, got {show(data)}")
        except (UnicodeDecodeError, InvalidData) as error:
            begun = line.replace(b" ", b"")[: len(_BEGIN)]
            if number > len(whole) and _BEGIN.startswith(begun):
                return found, last
            raise InvalidData(
                f"record {file}, line {number}: no line of a campaign: {error}", field="record"
            ) from None
        found.append((number, data))
    return found, b""


class Record:
    """A JSONL file of solutions, each with the key of its job.

    A line is written and flushed to the disk when its job ends, so an interrupted campaign loses
    nothing that was finished; with `resume`, what the file holds is not run again. A last line
    that was cut off in the middle is removed before the first is added. While a campaign runs, its
    file is locked against others; on file systems that know no locks, a warning says so.

    Parameters
    ----------
    path : str or Path
        The file.
    resume : bool
        Go on with a file that exists; without it, such a file raises
        :class:`~crosstrack.errors.InvalidData` and stays as it is, as does one that another
        campaign is writing.
    retry : bool
        Take what failed as not run; its new line, further down, is the one that counts.
    """

    def __init__(
        self, path: str | os.PathLike[str], *, resume: bool = False, retry: bool = False
    ) -> None:
        try:
            self.path = Path(path)
        except TypeError:
            raise InvalidData(
                f"record must name a file, got {show(path)}", field="record"
            ) from None
        self._resume, self._retry = resume, retry
        self._done: dict[str, dict[str, Any]] = {}
        self._file: IO[bytes] | None = None

    def __enter__(self) -> Self:
        if not self.path.parent.is_dir():
            raise InvalidData(f"record {self.path}: its folder does not exist", field="record")
        if self.path.exists() and not self.path.is_file():
            raise InvalidData(f"record {self.path} is no regular file", field="record")
        try:
            # Created where it is missing, and emptied by nobody: another may just have created it.
            descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o666)
            self._file = os.fdopen(descriptor, "r+b", buffering=0)
        except OSError as error:
            raise InvalidData(
                f"record {self.path} cannot be written: {error}", field="record"
            ) from None
        try:
            self._lock()  # before anything is read: another campaign may be adding to it
            cut = self._load()
            self._file.seek(-len(cut), os.SEEK_END)
            self._file.truncate()
            self._close_line()
        except BaseException:
            self._file.close()
            raise
        return self

    def _lock(self) -> None:
        """Keep other campaigns out until the file is closed; the lock ends with the process."""
        if fcntl is None:
            return
        assert self._file is not None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InvalidData(
                f"record {self.path} is in use by another campaign: wait for its end, or name "
                "another file",
                field="record",
            ) from None
        except OSError as error:
            log.warning("record %s cannot be locked (%s): use it once at a time", self.path, error)

    def _load(self) -> bytes:
        """Read the finished lines; return the line that was cut off at the end."""
        assert self._file is not None
        content = self._file.read()
        if content and not self._resume:
            raise InvalidData(
                f"record {self.path} exists: resume it, or name another file", field="record"
            )
        answers, cut = lines_of(content, self.path)
        for number, data in answers:
            if not isinstance(data.get("key"), str):
                raise InvalidData(
                    f"record {self.path}, line {number}: no line of a campaign: it has no key",
                    field="record",
                )
            self._done[data["key"]] = data
        if self._retry:
            again = [key for key, one in self._done.items() if one.get("termination") == "failed"]
            for key in again:
                del self._done[key]
        return cut

    def _close_line(self) -> None:
        """End the last line where it is whole and nothing ended it."""
        assert self._file is not None
        size = self._file.seek(0, os.SEEK_END)
        if size:
            self._file.seek(size - 1)
            if self._file.read(1) != b"\n":
                self._file.write(b"\n")

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._file is not None:
            with contextlib.suppress(OSError):  # no lock, or what `add` has told already
                if fcntl is not None:
                    # A process forked meanwhile holds the file, and its lock, open.
                    fcntl.flock(self._file, fcntl.LOCK_UN)
            with contextlib.suppress(OSError):
                self._file.close()

    def find(self, job: Job, model: Model[Any]) -> Solution[Any] | None:
        """Return the recorded solution of `job`, None where it must be run."""
        data = self._done.get(job.key())
        if data is None:
            return None
        try:
            return Solution.from_dict(data, None if data["plan"] == LEFT_OUT else model)
        except InvalidData as error:
            raise InvalidData(
                f"record {self.path}, key {data['key']}: {error}", field="record"
            ) from None

    def add(self, job: Job, solution: Solution[Any]) -> None:
        """Append the solution of `job`.

        Raises
        ------
        TypeError, ValueError, RecursionError
            The solution holds what JSON cannot; nothing is written.
        InvalidData
            The file cannot be written.
        """
        assert self._file is not None, "a record is written inside a with statement"
        data = {**solution.to_dict(), "key": job.key()}
        text = json.dumps(data, allow_nan=False, ensure_ascii=False)
        try:
            Solution.from_dict(parse_json(text))
        except InvalidData as error:
            raise ValueError(f"it could not be read again: {error}") from None
        line = text.encode() + b"\n"
        before = self._file.seek(0, os.SEEK_END)
        try:
            while line:
                line = line[self._file.write(line) :]
            os.fsync(self._file.fileno())
        except OSError as error:
            with contextlib.suppress(
                OSError
            ):  # a line that stays cut off is removed by who goes on
                self._file.truncate(before)
            raise InvalidData(
                f"record {self.path} cannot be written: {error}; every earlier answer stands in it",
                field="record",
            ) from None
        self._done[data["key"]] = data
