"""Runs strange files through the command line and strange calls through the library, and reports each.

``python strangers.py files|calls BEGIN END [STEP]`` prints one line of JSON a case. The process itself
may die of a case: :func:`run` starts it again after the case at fault, and counts it.
"""

from __future__ import annotations

import contextlib
import faulthandler
import json
import os
import random
import resource
import subprocess
import sys
import tempfile
import threading
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent

#: Seconds after which a case hangs; those that solve have a limit of 1 s, and a worker to start.
PATIENCE = float(os.environ.get("STRANGERS_PATIENCE", 120))
#: Bytes that a process may ask for, so that a size of 10**12 is refused rather than granted.
MEMORY = 6 * 2**30

#: Random commands for a file and a plan for it, in addition to `check`.
COMMANDS = (
    *[()] * 25,
    ("solve", "INSTANCE", "--time-limit", "1"),
    ("solve", "INSTANCE", "--time-limit", "1", "--warm-start", "PLAN", "--json"),
    ("export", "INSTANCE", "PLAN", "--output", "out.csv", "--json"),
    ("check", "INSTANCE", "PLAN", "--formulation", "paper"),
    ("diagnose", "INSTANCE", "--time-limit", "1"),
)  # fmt: skip


def _files(numbers: range, report: Any) -> None:
    import strange

    from crosstrack.__main__ import main

    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as log:
        os.chdir(folder)
        # Output of Python and native code goes to the log, crashes and tracebacks to standard error.
        errors = os.fdopen(os.dup(2), "w")
        faulthandler.enable(errors)
        sys.excepthook = lambda kind, error, trace: traceback.print_exception(error, file=errors)
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
        for number in numbers:
            instance, plan = strange.strange_file(number)
            Path("instance.json").write_bytes(instance)
            Path("plan.json").write_bytes(plan)
            draw = random.Random(f"command {number}")
            words = {"INSTANCE": "instance.json", "PLAN": "plan.json"}
            codes = []
            for command in (("check", "INSTANCE", "PLAN"), draw.choice(COMMANDS)):
                if not command:
                    continue
                faulthandler.dump_traceback_later(PATIENCE, exit=True, file=errors)
                report("begin", number, " ".join(command))
                try:
                    main([words.get(word, word) for word in command])
                except SystemExit as end:
                    codes.append(end.code)
                faulthandler.cancel_dump_traceback_later()
                sys.stdout.flush()
                sys.stderr.flush()
                log.seek(0)
                said = log.read().decode(errors="replace")
                log.seek(0)
                log.truncate()
                outcome = f"exit {codes[-1]}"
                if "Traceback (most recent call last)" in said:
                    outcome = "traceback"
                elif "Warning:" in said:
                    outcome = "warning"
                report(
                    "end",
                    number,
                    outcome,
                    said[-1500:] if not outcome.startswith("exit") or codes[-1] == 1 else "",
                )


def _calls(numbers: range, report: Any, made: Callable[[int], Any]) -> None:
    import calls

    from crosstrack.errors import CrosstrackError

    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for number in numbers:
            name, function, positional, named = made(number)
            faulthandler.dump_traceback_later(PATIENCE, exit=True)
            report("begin", number, name)
            outcome, said = "success", ""
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("error")
                    function(*positional, **named)
            except CrosstrackError as error:
                outcome = "refused"
                if not str(error):
                    outcome = "refused without a word"
            except Exception as error:
                outcome = "other exception"
                frames = traceback.extract_tb(error.__traceback__)
                where = " < ".join(
                    f"{Path(f.filename).name}:{f.lineno}" for f in reversed(frames[-5:])
                )
                said = f"{name}: {type(error).__name__}: {str(error)[:200]} [{where}] {calls.shown(positional, named)}"
            faulthandler.cancel_dump_traceback_later()
            report("end", number, outcome, said)


def _script() -> None:
    what, begin, end, step = sys.argv[1], *map(int, sys.argv[2:5])
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    faulthandler.enable()
    stream = os.fdopen(os.dup(1), "w")

    def report(*parts: Any) -> None:
        stream.write(json.dumps(parts) + "\n")
        stream.flush()

    numbers = range(begin, end, step)
    if what == "files":
        _files(numbers, report)
    else:
        import calls

        _calls(numbers, report, {"calls": calls.strange_call, "faults": calls.faulty_call}[what])


def run(what: str, begin: int, end: int, workers: int = 2) -> tuple[Counter[str], list[str]]:
    """Return the endings of the cases `begin` … `end` - 1, and a message for each wrong one.

    Parameters
    ----------
    what : {"files", "calls"}
        Which generator.
    """
    counts: Counter[str] = Counter()
    faults: list[str] = []
    paths = [HERE, HERE.parent / "optimal_control"]
    known = [*map(str, paths), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(known), "MPLBACKEND": "Agg"}

    def share(first: int) -> None:
        while first < end:
            last: list[Any] | None = None
            errors: list[str] = []
            with subprocess.Popen(
                [sys.executable, __file__, what, str(first), str(end), str(workers)],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                env=environment,
            ) as done:
                assert done.stdout is not None and done.stderr is not None
                reader = threading.Thread(
                    target=lambda pipe, into: into.append(pipe.read()), args=(done.stderr, errors)
                )
                reader.start()
                for line in done.stdout:
                    state, number, *rest = json.loads(line)
                    if state == "begin":
                        last = [number, *rest]
                    else:
                        counts[rest[0]] += 1
                        if rest[1]:
                            where = f"{what} {number} {last[1] if last else ''}"
                            faults.append(f"{where}: {rest[0]}: {rest[1]}")
                reader.join()
            if done.returncode == 0:
                return
            if last is None or "made(number)" in errors[0] or "strange_file(number)" in errors[0]:
                broken.append(errors[0])
                return
            hung = "Timeout (" in errors[0]
            counts["hang" if hung else "crash"] += 1
            faults.append(
                f"{what} {last}: {'hang' if hung else f'crash {done.returncode}'}: {errors[0][-1500:]}"
            )
            first = last[0] + workers

    broken: list[str] = []
    threads = [threading.Thread(target=share, args=(begin + k,)) for k in range(workers)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not broken, broken[0]
    return counts, faults


if __name__ == "__main__":
    with contextlib.suppress(BrokenPipeError):
        _script()
