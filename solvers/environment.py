"""Where a job runs: the machine, its load, and the memory that processes hold."""

from __future__ import annotations

import os
import platform
import sys
from functools import cache
from pathlib import Path
from typing import Any

from ..errors import UnsupportedOption
from ..version import __version__
from .job import Job
from .running import processors

__all__ = ["MIB", "environment", "require_accounts", "resident"]

GIB = 2.0**30
MIB = 2.0**20


@cache
def _machine() -> dict[str, Any]:
    """Return what does not change while this process lives."""
    found: dict[str, Any] = {
        "machine": platform.machine(),
        "system": platform.platform(terse=True),
        "processor": _processor(),
        "processors": processors(),
        "python": platform.python_version(),
        "crosstrack": __version__,
    }
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        pages = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        found["memory"] = round(pages / GIB, 1)
    return found


def _processor() -> str:
    """Return the processor's name; Python knows it on some systems only."""
    listed = Path("/proc/cpuinfo")
    if listed.is_file():
        for line in listed.read_text(errors="replace").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return platform.processor()


def environment(job: Job, *, warm: bool) -> dict[str, Any]:
    """Return where `job`, whose backend is resolved, is about to run; `warm` is the process."""
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
    """Raise where the memory of processes cannot be counted.

    Raises
    ------
    UnsupportedOption
        The system is no Linux.
    """
    if sys.platform != "linux":
        raise UnsupportedOption("memory_limit is kept on Linux only; leave it out")


def resident(process: int) -> float:
    """Return the bytes in memory of a process and of all that it has started, on Linux.

    Pages that several of them share count for each.
    """
    parents: dict[int, int] = {}
    held: dict[int, int] = {}
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            words = (entry / "stat").read_text("utf-8", "replace").rpartition(")")[2].split()
        except OSError:
            continue  # it has ended meanwhile
        # The name in parentheses may hold anything; after it come state, parent, … and pages held.
        parents[int(entry.name)], held[int(entry.name)] = int(words[1]), int(words[21])
    own = {process}
    grows = True
    while grows:
        more = {one for one, parent in parents.items() if parent in own} - own
        own |= more
        grows = bool(more)
    return float(sum(held.get(one, 0) for one in own)) * os.sysconf("SC_PAGE_SIZE")
