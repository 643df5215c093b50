"""Record file of a campaign: one JSON line per finished job, appended and never rewritten."""

from __future__ import annotations

import codecs
import contextlib
import json
import logging
import os
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

from ...errors import InvalidData
from ...models.fields import show
from ...models.json_text import parse_json
from ...models.model import Model
from ..contract.job import Job
from ..contract.solution import Solution

try:
    import fcntl
except ImportError:  # Windows does not have these locks
    fcntl = None  # type: ignore[assignment]

__all__ = ["LEFT_OUT", "Record", "lines_of"]

log = logging.getLogger("crosstrack")


#: Text in place of a verified plan that was omitted to keep the record small.
LEFT_OUT = "left out"
#: Start of every line of a record, without spaces.
_BEGIN = b'{"model":'


def lines_of(content: bytes, file: Path) -> tuple[list[tuple[int, dict[str, Any]]], bytes]:
    """Parse the lines of a record.

    Parameters
    ----------
    content : bytes
        Content of the file.
    file : Path
        Name of the file, for messages.

    Returns
    -------
    answers : list of tuple (int, dict)
        Line number, from 1, and JSON data of each answer.
    incomplete : bytes
        Last line if it is truncated, else ``b""``.

    Raises
    ------
    InvalidData
        A line is not a JSON object, or the last line is not the start of an answer.
    """
    answers: list[tuple[int, dict[str, Any]]] = []
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
                return answers, last
            raise InvalidData(
                f"record {file}, line {number}: not a line of a campaign: {error}", field="record"
            ) from None
        answers.append((number, data))
    return answers, b""


class Record:
    """JSONL file of solutions, each with the key of its job.

    A line is written and flushed to disk when its job ends, so an interrupted campaign keeps every
    finished job. With `resume`, recorded jobs are not run again. A truncated last line is removed
    before the first new line is written. The file is locked against other campaigns; a warning is
    logged if the file system does not support locks.

    Parameters
    ----------
    path : str or Path
        Name of the file.
    resume : bool
        Continue an existing file. Without it, an existing file raises
        :class:`~crosstrack.errors.InvalidData` and stays unchanged, as does a file that another
        campaign is writing.
    retry : bool
        Run failed jobs again. The last line of a job takes precedence.
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
            raise InvalidData(f"record {self.path} is not a regular file", field="record")
        try:
            # Opened without truncating: another campaign may have created the file meanwhile.
            descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o666)
            self._file = os.fdopen(descriptor, "r+b", buffering=0)
        except OSError as error:
            raise InvalidData(
                f"record {self.path} cannot be written: {error}", field="record"
            ) from None
        try:
            self._lock()  # before reading: another campaign may be appending
            cut = self._load()
            self._file.seek(-len(cut), os.SEEK_END)
            self._file.truncate()
            self._close_line()
        except BaseException:
            self._file.close()
            raise
        return self

    def _lock(self) -> None:
        """Lock the file against other campaigns until it is closed or the process ends."""
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
        """Read the finished lines and return the truncated last line, else ``b""``."""
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
                    f"record {self.path}, line {number}: not a line of a campaign: it has no key",
                    field="record",
                )
            self._done[data["key"]] = data
        if self._retry:
            again = [
                key for key, entry in self._done.items() if entry.get("termination") == "failed"
            ]
            for key in again:
                del self._done[key]
        return cut

    def _close_line(self) -> None:
        """Append the missing newline to a complete last line."""
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
            with contextlib.suppress(OSError):  # no lock, or an error that `add` has reported
                if fcntl is not None:
                    # A process forked meanwhile keeps the file and its lock open.
                    fcntl.flock(self._file, fcntl.LOCK_UN)
            with contextlib.suppress(OSError):
                self._file.close()

    def find(self, job: Job, model: Model[Any]) -> Solution[Any] | None:
        """Return the recorded solution of `job`; None if the job must be run.

        Parameters
        ----------
        job : Job
            The run whose key is looked up.
        model : Model
            The model of the plan.

        Raises
        ------
        InvalidData
            The recorded line cannot be read.
        """
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

        Parameters
        ----------
        job : Job
            The finished run.
        solution : Solution
            Its result.

        Raises
        ------
        TypeError, ValueError, RecursionError
            The solution has content that JSON cannot represent. Nothing is written.
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
            # A line that stays truncated is removed when the record is resumed.
            with contextlib.suppress(OSError):
                self._file.truncate(before)
            raise InvalidData(
                f"record {self.path} cannot be written: {error}; earlier answers are complete",
                field="record",
            ) from None
        self._done[data["key"]] = data
