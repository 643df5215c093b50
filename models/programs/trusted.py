"""Reading of CasADi's text format for trusted callers, as it can load libraries and crash.

``python -m crosstrack.models.programs.trusted`` is the process that reads a text first.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import TYPE_CHECKING, Any

from ...errors import InvalidData
from ..fields import TRUSTED
from .interpreter import read, readable

if TYPE_CHECKING:
    import casadi

__all__ = ["read_trusted"]

#: Limits of seconds and of bytes of memory for the process that reads a text first.
SECONDS, MEMORY = 60.0, 8 << 30


def read_trusted(text: str, field: str) -> casadi.Function:
    """Return the function in CasADi's `text`; `field` names it in messages.

    Another process reads the text first. If :mod:`.expressions` covers the function, it is rebuilt here from that
    form. CasADi reads the text in this process only if it does not. Raise ``InvalidData`` if the caller does not
    trust the data, or the text cannot be read: the other process crashed, hung or failed.
    """
    if not TRUSTED.get():
        raise InvalidData(
            f"{field} is stored as CasADi's own text, which can run code when it is read. If you "
            "know who wrote it, read it with trusted=True, on the command line with --trusted",
            field=field,
        )
    # -P: a module in the working folder must not shadow one of the standard library.
    command = [sys.executable, "-P", "-m", __name__]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    try:
        completed = subprocess.run(
            command,
            input=text.encode("utf-8", "replace"),
            capture_output=True,
            timeout=SECONDS,
            env=environment,
        )
        answer = json.loads(completed.stdout) if completed.returncode == 0 else {}
        reason = answer.get("error", f"the process that read it ended with {completed.returncode}")
    except subprocess.TimeoutExpired:
        answer, reason = {}, f"reading it took more than {SECONDS:g} s"
    if "function" not in answer:
        raise InvalidData(f"{field} is no serialised casadi.Function: {reason}", field=field)
    if answer["function"] is not None:
        return read(answer["function"], field)
    import casadi

    return casadi.Function.deserialize(text)


def _main() -> None:
    """Read a text from standard input; write its graph, null if it has none, or the error."""
    # Output of native code must not corrupt the answer.
    with os.fdopen(os.dup(1), "w", encoding="utf-8") as stream:
        os.dup2(2, 1)
        if sys.platform != "win32":
            import resource

            resource.setrlimit(
                resource.RLIMIT_AS, (MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1])
            )
        stream.write(json.dumps(_answer(sys.stdin.read())))


def _answer(text: str) -> dict[str, Any]:
    import casadi

    try:
        function = casadi.Function.deserialize(text)
        data, _ = readable(function)
        if isinstance(data, str):
            # The calling process will evaluate the function: a crash must happen here instead.
            function.call(
                [casadi.DM.zeros(function.sparsity_in(k)) for k in range(function.n_in())]
            )
            return {"function": None}
    except (RuntimeError, ValueError, MemoryError, KeyError) as error:
        return {"error": str(error).strip()[:100]}
    return {"function": data}


if __name__ == "__main__":
    _main()
