"""The record of a campaign: one JSON line a finished job, appended at once and never rewritten."""

from __future__ import annotations

import json
import os
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

from ..errors import InvalidData
from ..models.model import Model
from .job import Job
from .solution import Solution

__all__ = ["Record"]


class Record:
    """A JSONL file of solutions, each with the key of its job.

    A line is written and flushed to the disk when its job ends, so an interrupted campaign loses
    nothing that was finished; with `resume`, what the file holds is not run again. A last line
    that was cut off in the middle is removed before the first is added.

    Parameters
    ----------
    path : str or Path
        The file.
    resume : bool
        Go on with a file that exists; without it, such a file raises
        :class:`~crosstrack.errors.InvalidData` and stays as it is.
    """

    def __init__(self, path: str | Path, *, resume: bool = False) -> None:
        self.path = Path(path)
        self._done: dict[str, dict[str, Any]] = {}
        self._file: IO[bytes] | None = None
        if not self.path.parent.is_dir():
            raise InvalidData(f"record {self.path}: its folder does not exist", field="record")
        if self.path.exists() and self.path.stat().st_size and not resume:
            raise InvalidData(
                f"record {self.path} exists: resume it, or name another file", field="record"
            )
        self._whole = self._load() if self.path.exists() else 0

    def _load(self) -> int:
        """Read the finished lines; return the size of the file without a line cut off at its end."""
        content = self.path.read_bytes()
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

    def __enter__(self) -> Self:
        try:
            self._file = self.path.open("r+b" if self.path.exists() else "w+b")
        except OSError as error:
            raise InvalidData(
                f"record {self.path} cannot be written: {error}", field="record"
            ) from None
        self._file.truncate(self._whole)
        self._file.seek(self._whole)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._file is not None:
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
        self._file.write(line)
        self._file.flush()
        os.fsync(self._file.fileno())
        self._done[data["key"]] = data
