"""How tests of backends run what may not share a process: a test's own file is also the script."""

import faulthandler
import functools
import json
import multiprocessing
import os
import runpy
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import pytest

from crosstrack.solvers.conformance import CaseResult, Status
from crosstrack.solvers.contract.registry import declarations


def included(folder: str) -> set[str]:
    """Return the names of the included solvers of programs in `folder` of ``solvers``."""
    entries = [entry for entry in declarations() if isinstance(entry.target, str)]
    names = {entry.name for entry in entries if entry.target.startswith(f".solvers.{folder}.")}
    assert names, f"no solver in {folder}"
    return names


def python(code: str) -> subprocess.CompletedProcess[str]:
    """Run `code` in a fresh process."""
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False
    )


@functools.cache
def _template() -> Any:
    """Return the context of a process that has imported the suite, but no solver, and is copied per run."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["numpy", "pytest", "crosstrack.solvers.conformance"])
    return context


def elsewhere(script: str, *arguments: str, quiet: bool = False) -> Any:
    """Return what `script` answers to `arguments` in a fresh process, that must write nothing if `quiet`."""
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
            patch.setenv(name, "1")
        process = _template().Process(target=_run, args=(script, arguments, folder))
        process.start()
        process.join(240)
        process.kill()
        process.join()
        written, answer = (Path(folder, name).read_text() for name in ("err", "out"))
    assert process.exitcode == 0, written[-4000:]
    assert written == "" or not quiet
    return json.loads(answer)


def _run(script: str, arguments: tuple[str, ...], folder: str) -> None:
    for number, name in ((1, "out"), (2, "err")):
        os.dup2(os.open(Path(folder, name), os.O_CREAT | os.O_WRONLY), number)
    faulthandler.enable()
    sys.argv = [script, *arguments]
    sys.path.insert(0, str(Path(script).parent))
    runpy.run_path(script, run_name="__main__")


def answer_with(main: Callable[..., Any]) -> None:
    """Write what `main` returns for the command line's arguments, as JSON.

    Solvers write to the standard output behind Python's back: it is kept for the answer alone.
    """
    with os.fdopen(os.dup(1), "w") as out:
        os.dup2(2, 1)
        json.dump(main(*sys.argv[1:]), out)


@functools.cache
def loaded_by_describing() -> frozenset[str]:
    """Return the modules that are loaded once all backends of programs and their cases are described."""
    done = python(
        "import json, sys\n"
        "from crosstrack.solvers.conformance import cases_for\n"
        "from crosstrack.solvers.contract.registry import _SOLVERS, find_backend\n"
        "for name in _SOLVERS:\n"
        "    b = find_backend(name); b.missing(); b.version()\n"
        "assert cases_for(find_backend('clarabel')) and cases_for(find_backend('highs'))\n"
        "print(json.dumps(sorted(sys.modules)))"
    )
    assert done.returncode == 0 and not done.stderr, done.stderr
    return frozenset(json.loads(done.stdout))


def unforeseen(found: Iterable[CaseResult], allowed: Mapping[str, str]) -> list[str]:
    """Return the cases that a backend does not take, but for those `allowed`, by name and reason."""
    return [
        f"{r.case}: {r.reason}"
        for r in found
        if r.status is Status.UNSUPPORTED
        and not r.reason.startswith("declares no")
        and not any(r.case.startswith(case) and why in r.reason for case, why in allowed.items())
    ]
