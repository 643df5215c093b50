"""Reading of CasADi's text format for trusted callers, as it can load libraries and crash.

``python -m crosstrack.models.programs.trusted`` is the process that reads a text first.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from ...errors import InvalidData
from ..fields import TRUSTED
from .interpreter import read, readable
from .separate import answer, ask

if TYPE_CHECKING:
    import casadi

__all__ = ["read_trusted"]

#: Largest number of seconds for the process that reads a text first.
SECONDS = 60.0


def read_trusted(text: str, field: str) -> casadi.Function:
    """Return the function in CasADi's `text`, or raise ``InvalidData`` with the name of the `field`.

    Another process reads the text first. If :mod:`.expressions` covers the function, it is rebuilt here from that
    form. CasADi reads the text in this process only if it does not.
    """
    if not TRUSTED.get():
        raise InvalidData(
            f"{field} is stored as CasADi's own text, which can run code when it is read. If you "
            "know who wrote it, read it with trusted=True, on the command line with --trusted",
            field=field,
        )
    completed = ask(__name__, data=text.encode("utf-8", "replace"), seconds=SECONDS)
    result: dict[str, Any]
    if completed is None:
        result, reason = {}, f"reading it took more than {SECONDS:g} s"
    else:
        result = json.loads(completed.stdout) if completed.returncode == 0 else {}
        reason = result.get("error", f"the process that read it ended with {completed.returncode}")
    if "function" not in result:
        raise InvalidData(f"{field} is no serialised casadi.Function: {reason}", field=field)
    if result["function"] is not None:
        return read(result["function"], field)
    import casadi

    return casadi.Function.deserialize(text)


def _graph(text: str) -> dict[str, Any]:
    """Return the graph of the function in a text, null if it has none, or the error."""
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
    answer(lambda data: json.dumps(_graph(data.decode())).encode())
