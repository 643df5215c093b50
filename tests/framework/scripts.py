"""Run scripts in processes forked from one that has imported the libraries, which takes a second.

Each script has a process, a folder and a ``__main__`` of its own, as ``python script.py`` has. This file is
also the program of the process that forks.
"""

from __future__ import annotations

import json
import os
import runpy
import signal
import subprocess
import sys
import warnings
from pathlib import Path

#: Libraries without threads that conflict with no solver. crosstrack is imported by each script.
LIBRARIES = (
    "matplotlib.pyplot",
    "mpl_toolkits.mplot3d",
    "scipy.interpolate",
    "scipy.ndimage",
    "scipy.optimize",
    "scipy.sparse.linalg",
    "scipy.spatial",
    "shapely",
)
#: Seconds until a script is killed.
PATIENCE = 240


class Scripts:
    """Process that runs scripts in forks of itself; a context manager."""

    def __enter__(self) -> Scripts:
        self._server = subprocess.Popen(
            [sys.executable, __file__],
            env={**os.environ, "MPLBACKEND": "Agg"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        return self

    def __exit__(self, *_: object) -> None:
        self._server.communicate()

    def run(self, script: Path, cwd: Path, *, strict: bool = False) -> str:
        """Return the standard output of `script`; `strict` turns deprecation warnings into errors."""
        assert self._server.stdin is not None and self._server.stdout is not None
        task = {"script": str(script), "cwd": str(cwd), "strict": strict}
        self._server.stdin.write(json.dumps(task) + "\n")
        self._server.stdin.flush()
        code = self._server.stdout.readline().strip()
        out, err = ((cwd / name).read_text("utf-8") for name in ("stdout.txt", "stderr.txt"))
        assert code == "0", f"exit code {code}\n{out}\n{err}"
        return out


def _serve() -> None:
    for library in LIBRARIES:
        __import__(library)
    for line in sys.stdin:
        task = json.loads(line)
        child = os.fork()
        if child == 0:
            _run(**task)
            return  # the interpreter ends as it does after a script
        status = os.waitpid(child, 0)[1]
        print(os.waitstatus_to_exitcode(status), flush=True)


def _run(script: str, cwd: str, strict: bool) -> None:
    signal.alarm(PATIENCE)
    os.chdir(cwd)
    for descriptor, name in enumerate((os.devnull, "stdout.txt", "stderr.txt")):
        file = os.open(name, os.O_RDWR | os.O_CREAT | os.O_TRUNC)
        os.dup2(file, descriptor)
        os.close(file)
    if strict:
        warnings.simplefilter("error", DeprecationWarning)
    sys.argv = [script]
    sys.path[0] = str(Path(script).parent)
    runpy.run_path(script, run_name="__main__")


if __name__ == "__main__":
    _serve()
