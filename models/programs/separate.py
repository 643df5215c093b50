"""Calls of readers in a separate process, because damaged data can crash native libraries."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable

__all__ = ["answer", "ask"]

#: Largest number of bytes of memory of the process.
MEMORY = 8 << 30


def ask(
    module: str, *arguments: str, data: bytes, seconds: float, folder: str | None = None
) -> subprocess.CompletedProcess[bytes] | None:
    """Run ``python -m module arguments`` on `data` in `folder`; None after `seconds`."""
    # -P: a module in the working folder must not shadow one of the standard library.
    command = [sys.executable, "-P", "-m", module, *arguments]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    try:
        return subprocess.run(
            command, input=data, capture_output=True, timeout=seconds, env=environment, cwd=folder
        )
    except subprocess.TimeoutExpired:
        return None


def answer(read: Callable[[bytes], bytes]) -> None:
    """Write ``read(standard input)`` to standard output, with limited memory."""
    # Output of native code must not corrupt the answer.
    with os.fdopen(os.dup(1), "wb") as stream:
        os.dup2(2, 1)
        if sys.platform != "win32":
            import resource

            highest = resource.getrlimit(resource.RLIMIT_AS)[1]
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, highest))
        stream.write(read(sys.stdin.buffer.read()))
