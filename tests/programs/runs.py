"""How tests of backends run what may not share a process: a test's own file is also the script."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from crosstrack.solvers.conformance import CaseResult, Status


def python(code: str) -> subprocess.CompletedProcess[str]:
    """Run `code` in a fresh process."""
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False
    )


def elsewhere(script: str, *arguments: str, quiet: bool = False) -> Any:
    """Return what `script` answers to `arguments` in a fresh process, that must write nothing if `quiet`."""
    done = subprocess.run(
        [sys.executable, "-X", "faulthandler", script, *arguments],
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-4000:]
    assert done.stderr == "" or not quiet
    return json.loads(done.stdout)


def answer_with(main: Callable[..., Any]) -> None:
    """Write what `main` returns for the command line's arguments, as JSON.

    Solvers write to the standard output behind Python's back: it is kept for the answer alone.
    """
    with os.fdopen(os.dup(1), "w") as out:
        os.dup2(2, 1)
        json.dump(main(*sys.argv[1:]), out)


def loaded_by_describing(names: Iterable[str], modules: set[str]) -> str:
    """Return which of `modules` are loaded once the backends have been looked up and described."""
    done = python(
        "import sys\n"
        "from crosstrack.solvers.contract.registry import find_backend\n"
        f"for name in {tuple(names)!r}:\n"
        "    b = find_backend(name); b.missing(); b.version()\n"
        f"print(sorted({modules!r} & set(sys.modules)))"
    )
    return done.stdout.strip() + done.stderr


def unforeseen(found: Iterable[CaseResult], allowed: Mapping[str, str]) -> list[str]:
    """Return the cases that a backend does not take, but for those `allowed`, by name and reason."""
    return [
        f"{r.case}: {r.reason}"
        for r in found
        if r.status is Status.UNSUPPORTED
        and not r.reason.startswith("declares no")
        and not any(r.case.startswith(case) and why in r.reason for case, why in allowed.items())
    ]
