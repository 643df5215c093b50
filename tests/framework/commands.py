"""Run the command line within this process, as fast as its work is; as a script, a list of commands."""

from __future__ import annotations

import contextlib
import io
import json
import os
import subprocess
import sys
from pathlib import Path

from crosstrack.__main__ import main


def run(*arguments, code=0, cwd=None):
    """Return the finished command, whose exit code must be `code` (None: any)."""
    out, err, ended = io.StringIO(), io.StringIO(), None
    with (
        contextlib.chdir(cwd or Path.cwd()),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            main(list(map(str, arguments)))
        except SystemExit as end:
            ended = end.code
    done = subprocess.CompletedProcess(arguments, ended, out.getvalue(), err.getvalue())
    assert code in (None, ended), (arguments, ended, done.stdout[-2000:], done.stderr[-2000:])
    return done


def joined(*paths):
    """Return a value of PYTHONPATH with `paths` before those of the environment."""
    found = [*map(str, paths), os.environ.get("PYTHONPATH", "")]
    return os.pathsep.join(filter(None, found))


def run_all(commands, cwd, *paths, hidden=()):
    """Return the finished `commands`, run in one fresh process that finds modules in `paths` too.

    The loops are not compiled, and the packages `hidden` cannot be imported.
    """
    done = subprocess.run(
        [sys.executable, __file__],
        input=json.dumps([[list(map(str, one)) for one in commands], list(hidden)]),
        env={**os.environ, "PYTHONPATH": joined(*paths), "NUMBA_DISABLE_JIT": "1"},
        cwd=cwd, capture_output=True, text=True, timeout=240, check=False,
    )  # fmt: skip
    assert done.returncode == 0, (done.stdout[-2000:], done.stderr[-3000:])
    return [subprocess.CompletedProcess(*one) for one in json.loads(done.stdout)]


if __name__ == "__main__":
    commands, hidden = json.load(sys.stdin)
    sys.modules.update(dict.fromkeys(hidden))
    finished = [run(*one, code=None) for one in commands]
    print(json.dumps([[one.args, one.returncode, one.stdout, one.stderr] for one in finished]))
