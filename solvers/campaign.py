"""The record of a campaign: one JSON line a finished job, appended at once and never rewritten."""

from __future__ import annotations

import contextlib
import json
import logging
import os
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

from ..errors import InvalidData
from ..models.fields import show
from ..models.model import Model
from .job import Job
from .solution import Solution

try:
    import fcntl
except ImportError:  # Windows has no such locks
    fcntl = None  # type: ignore[assignment]

__all__ = ["Record"]

log = logging.getLogger("crosstrack")


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
    """

    def __init__(self, path: str | os.PathLike[str], *, resume: bool = False) -> None:
        try:
            self.path = Path(path)
        except TypeError:
            raise InvalidData(
                f"record must name a file, got {show(path)}", field="record"
            ) from None
        self._resume = resume
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
            whole = self._load()
            self._file.truncate(whole)
            self._file.seek(whole)
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

    def _load(self) -> int:
        """Read the finished lines; return the size of the file without a line cut off at its end."""
        assert self._file is not None
        content = self._file.read()
        if content and not self._resume:
            raise InvalidData(
                f"record {self.path} exists: resume it, or name another file", field="record"
            )
        whole = content.rfind(b"\n") + 1
        for number, line in enumerate(content[:whole].splitlines(), 1):
            if not line.strip():
                continue
            try:
                data = json.loads(line)
                self._done[data["key"]] = data
            except (ValueError, KeyError, TypeError) as error:
                raise InvalidData(
                    f"record {self.path}, line {number}: no line of a campaign ({error!r})",
                    field="record",
                ) from None
        return whole

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
        return None if data is None else Solution.from_dict(data, model)

    def add(self, job: Job, solution: Solution[Any]) -> None:
        """Append the solution of `job`."""
        assert self._file is not None, "a record is written inside a with statement"
        data = {**solution.to_dict(), "key": job.key()}
        line = json.dumps(data, allow_nan=False, ensure_ascii=False).encode() + b"\n"
        try:
            while line:
                line = line[self._file.write(line) :]
            os.fsync(self._file.fileno())
        except OSError as error:
            raise InvalidData(
                f"record {self.path} cannot be written: {error}; what stands in it is whole",
                field="record",
            ) from None
        self._done[data["key"]] = data
