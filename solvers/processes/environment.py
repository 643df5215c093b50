"""Environment of a job: the machine, its load, and the memory of processes."""

from __future__ import annotations

import os
import platform
import sys
from functools import cache
from pathlib import Path
from typing import Any

from ...errors import UnsupportedOption
from ...version import __version__
from ..contract.backend import processors
from ..contract.job import Job

__all__ = ["MIB", "environment", "require_accounts", "resident"]

GIB = 2.0**30
MIB = 2.0**20


@cache
def _machine() -> dict[str, Any]:
    """Return the data of the machine that are constant while this process lives."""
    data: dict[str, Any] = {
        "machine": platform.machine(),
        "system": platform.platform(terse=True),
        "processor": _processor(),
        "processors": processors(),
        "python": platform.python_version(),
        "crosstrack": __version__,
    }
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        pages = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        data["memory"] = round(pages / GIB, 1)
    return data


def _processor() -> str:
    """Return the name of the processor. :mod:`platform` has it on some systems only."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(errors="replace").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return platform.processor()


def environment(job: Job, *, warm: bool) -> dict[str, Any]:
    """Return data about the machine and process before a job starts.

    Parameters
    ----------
    job : Job
        The job.
    warm : bool
        Whether the process has already run a similar job.

    Returns
    -------
    dict
        Hardware, versions of Python, crosstrack and the backend, threads and system load.
    """
    backend = job.resolved().backend
    assert not isinstance(backend, str)
    return {
        **_machine(),
        "backend": backend.version(),
        "threads": job.threads,
        "load": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
        "warm": warm,
        "compiled": job.compiled,
    }


def require_accounts() -> None:
    """Raise an error if the memory of processes cannot be measured.

    Raises
    ------
    UnsupportedOption
        The system is not Linux.
    """
    if sys.platform != "linux":
        raise UnsupportedOption("memory_limit is available on Linux only; omit it")


def resident(process: int) -> float:
    """Return the resident memory in bytes of a process and all its descendants, on Linux.

    Memory shared by several of them counts once for each.

    Parameters
    ----------
    process : int
        Identifier of the process.
    """
    parents: dict[int, int] = {}
    pages: dict[int, int] = {}
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            words = (entry / "stat").read_text("utf-8", "replace").rpartition(")")[2].split()
        except OSError:
            continue  # it has ended meanwhile
        # The name in parentheses may contain anything. State, parent, … and pages follow it.
        parents[int(entry.name)], pages[int(entry.name)] = int(words[1]), int(words[21])
    family = {process}
    grows = True
    while grows:
        children = {
            identifier for identifier, parent in parents.items() if parent in family
        } - family
        family |= children
        grows = bool(children)
    return float(sum(pages.get(identifier, 0) for identifier in family)) * os.sysconf(
        "SC_PAGE_SIZE"
    )
