"""Scoreboard of optimal control: published problems, solved by crosstrack and by other packages.

Every pair of problem and solver runs in a process of its own with a limit of CPU time. The plan is verified by
``model.verify``, whatever solver it comes from. Answers are appended to ``build/scoreboard/answers.jsonl``;
pairs in this file are skipped, so that a run can be resumed::

    python tests/benchmarks/optimal_control/scoreboard.py run --solvers yapss maptor rockit dymos
    python tests/benchmarks/optimal_control/scoreboard.py run --solvers ours --label after
    python tests/benchmarks/optimal_control/scoreboard.py tables

`tables` merges the answers into ``scoreboard_answers.json`` and writes the tables of ``docs/how-well.md`` to
``docs/measured/scoreboard.json``. Only the last label of our answers is shown. Peers are installed by::

    python3 -m venv build/peers/yapss && build/peers/yapss/bin/pip install yapss==0.2.3
    python3 -m venv build/peers/maptor && build/peers/maptor/bin/pip install maptor==0.2.1
    python3 -m venv build/peers/rockit && build/peers/rockit/bin/pip install rockit-meco==0.6.7
    python3 -m venv build/peers/dymos && build/peers/dymos/bin/pip install dymos==1.15.1 casadi==3.8.2

The frozen half (``published/__init__.py``) is measured here only, and no decision about the solver uses it.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import os
import signal
import statistics
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve()
ROOT = HERE.parents[3]
sys.path[:0] = [str(HERE.parent), str(ROOT / "tests")]

ANSWERS = ROOT / "build" / "scoreboard" / "answers.jsonl"
#: All answers that the tables of the page show.
SHOWN = HERE.with_name("scoreboard_answers.json")
#: Columns of the table, in order.
SOLVERS = ("ours", "bare", "yapss", "maptor", "rockit", "dymos")
#: Limit of CPU time (s), and largest ratio of elapsed to CPU time on a loaded machine.
LIMIT, PATIENCE = 60.0, 40.0
#: Limit of CPU time (s) of the verification of one plan.
CHECKING = 60
#: Tolerance of the verification; relative violation or error above which a wrong answer is far off.
TOLERANCE, FAR = 1e-6, 1e-3
#: Outcomes with the known value.
SOLVED = ("verified", "rejected")
#: Claims of an optimum that the verification does not confirm.
WRONG = ("rejected", "other value")
#: Columns of the totals.
TOTALS = ("solved", "verified", "wrong", "far off", "failed", "unknown", "unsupported", "not run")
#: Agreement of two programs on a problem without a published value.
AGREEMENT = 1e-5
#: Code of a process that took too long.
TOO_LONG = 124


def interpreter(solver: str) -> Path:
    """Return the interpreter that has the package of a solver."""
    if solver in ("ours", "bare"):
        return Path(sys.executable)
    return ROOT / "build" / "peers" / solver / "bin" / "python"


def _names(half: str) -> list[str]:
    """Return the names of a half of the problems."""
    import published

    chosen = {"development": published.development, "frozen": published.frozen}
    return list(chosen.get(half, published.problems)())


def _answers() -> list[dict[str, Any]]:
    """Return all recorded answers, oldest first."""
    if not ANSWERS.exists():
        return []
    return [json.loads(line) for line in ANSWERS.read_text().splitlines() if line]


def attempts(solver: str, names: list[str], limit: float) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the verified answer of one solver to each problem, solved in a process of its own."""
    failed: dict[str, Any] = {"claims": False, "objective": None, "seconds": None}
    if not interpreter(solver).exists():
        yield from ((name, {**failed, "status": "not installed"}) for name in names)
        return
    with tempfile.TemporaryDirectory() as folder:
        # The environment of a package sees crosstrack as a folder, for the declarations.
        (Path(folder) / "crosstrack").symlink_to(ROOT)
        environment = {
            **os.environ,
            "PYTHONPATH": folder,
            "OPENMDAO_REPORTS": "0",
            **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"),
        }
        script, longest = HERE.parent / "scoreboard_peers.py", PATIENCE * limit
        command = [interpreter(solver), script, solver, folder, str(limit), str(longest), *names]
        with subprocess.Popen(
            command, env=environment, cwd=folder, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        ) as process:  # fmt: skip
            assert process.stdout is not None
            for line in process.stdout:
                name, code = line.split()
                file = Path(folder) / f"{name}.json"
                if file.exists():
                    yield name, _checked(name, json.loads(file.read_text()))
                elif int(code) in (-signal.SIGXCPU, -signal.SIGKILL):
                    status = f"over {limit:g} s of CPU time"
                    yield name, {**failed, "status": status, "seconds": limit}
                elif int(code) == TOO_LONG:  # shows the load of the machine: no answer
                    print(solver, name, f"over {longest:g} s of elapsed time: run it again")
                else:
                    yield name, {**failed, "status": f"exit {code}"}


def _checked(name: str, answer: dict[str, Any]) -> dict[str, Any]:
    """Return an answer with the result of the verification of its plan."""
    from scoreboard_parts import problem_of

    from crosstrack.models.optimal_control.plan import ControlPlan

    answer.update(verified=False, checked_objective=None, violation=None, worst_check="")
    data = answer.pop("plan")
    if data is None:
        return answer

    interrupted = []

    def interrupt(*_: object) -> None:
        interrupted.append(True)
        raise TimeoutError

    signal.signal(signal.SIGPROF, interrupt)
    signal.setitimer(signal.ITIMER_PROF, CHECKING)
    try:
        problem = problem_of(name).build(name).build()
        result = problem.verify(ControlPlan.from_data(data), tolerance=TOLERANCE)
    except Exception:
        if not interrupted:  # CasADi turns the interrupt into other errors
            raise
        answer["worst_check"] = f"verification over {CHECKING} s"
        return answer
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    worst = max(result.checks, key=lambda check: check.worst / check.tolerance)
    violation = worst.worst / worst.tolerance * TOLERANCE
    answer.update(
        verified=result.ok,
        checked_objective=result.objective,
        violation=violation if math.isfinite(violation) else None,
        worst_check=worst.name,
    )
    return answer


def run(given: argparse.Namespace) -> None:
    """Run the pairs that have no answer yet."""
    ANSWERS.parent.mkdir(parents=True, exist_ok=True)
    known = {(row["solver"], row["problem"], row["label"]) for row in _answers()}
    for solver in given.solvers:
        label = given.label if solver == "ours" else ""
        names = given.names or _names(given.half)
        names = [name for name in names if (solver, name, label) not in known]
        for name, answer in attempts(solver, names, given.limit) if names else ():
            row = {"problem": name, "solver": solver, "label": label, **answer}
            with ANSWERS.open("a") as stream:
                stream.write(json.dumps(row) + "\n")
            print(solver, name, row["status"], row["seconds"], flush=True)


# -- judgement --------------------------------------------------------------------------------------


def known_value(name: str, rows: Iterable[Mapping[str, Any]]) -> tuple[float | None, float]:
    """Return the best known value of a problem and its accuracy.

    Without a published value it is the best verified value on which two solvers agree, or None.
    """
    from scoreboard_parts import problem_of

    problem = problem_of(name)
    if problem.value is not None and math.isfinite(problem.value):
        return problem.value, problem.exact
    values = sorted(row["checked_objective"] for row in rows if row.get("verified"))
    for low, high in itertools.pairwise(values):
        if high - low <= AGREEMENT * abs(low):
            return low, AGREEMENT
    return None, AGREEMENT


def judge(row: Mapping[str, Any], value: float | None, exact: float) -> tuple[str, float | None]:
    """Return the outcome of an answer, and the relative error of its objective.

    The outcome is ``"verified"`` (the plan verifies and is as good as the known value), ``"rejected"`` (the
    solver claims an optimum with this value, but the plan violates the problem), ``"other value"`` (it
    claims an optimum with another value), ``"unknown"`` (the plan verifies, and no value is known) or
    ``"failed"``.
    """
    verified = bool(row.get("verified"))
    objective = row.get("checked_objective")
    if objective is None:
        objective = row.get("objective")
    if objective is None or not (verified or row["claims"]):
        return "failed", None
    if value is None:
        return ("unknown" if verified else "rejected"), None
    error = (objective - value) / (abs(value) or 1.0)
    if verified and error <= exact:
        return "verified", error
    if not row["claims"]:
        return "failed", error
    return ("rejected" if not verified and abs(error) <= exact else "other value"), error


def _cell(row: Mapping[str, Any] | None, value: float | None, exact: float) -> tuple[str, str]:
    """Return the outcome of an answer, and its text in the table."""
    if row is None:
        return "not run", "not run"
    outcome, error = judge(row, value, exact)
    seconds = "" if row["seconds"] is None else f", {row['seconds']:.1f} s"
    if outcome == "failed" and row["status"].startswith(("unsupported", "not installed")):
        return "unsupported", row["status"].partition(":")[0]
    detail = ""
    if outcome == "rejected" and row.get("violation") is not None:
        detail = f" {row['violation']:.0e}"
    elif outcome == "other value" or (error is not None and error < -FAR):
        detail = f" {error:+.0e}"
    return outcome, f"{outcome}{detail}{seconds}"


def _board(half: str, answers: Mapping[tuple[str, str], dict[str, Any]]) -> tuple[Any, Any]:
    """Return the rows of a half, one per problem, and the totals, one row per solver."""
    rows: list[list[Any]] = []
    counts: dict[str, Counter[str]] = {solver: Counter() for solver in SOLVERS}
    times: dict[str, list[float]] = {solver: [] for solver in SOLVERS}
    for name in _names(half):
        own = {solver: answers[name, solver] for solver in SOLVERS if (name, solver) in answers}
        value, exact = known_value(name, own.values())
        cells = [_cell(own.get(solver), value, exact) for solver in SOLVERS]
        rows.append([name, value, *(text for _, text in cells)])
        for solver, (outcome, _) in zip(SOLVERS, cells, strict=True):
            counts[solver][outcome] += 1
            if outcome in WRONG:
                error = judge(own[solver], value, exact)[1]
                violation = own[solver].get("violation") or 0.0
                counts[solver]["far off"] += abs(error or 0.0) > FAR or violation > FAR
            if outcome == "verified":
                times[solver].append(own[solver]["seconds"])
    for count in counts.values():
        count["solved"] = sum(count[outcome] for outcome in SOLVED)
        count["wrong"] = sum(count[outcome] for outcome in WRONG)
    totals = [
        [solver, len(rows), *(counts[solver][kind] for kind in TOTALS),
         statistics.median(times[solver]) if times[solver] else None]
        for solver in SOLVERS
    ]  # fmt: skip
    return rows, totals


def tables(_: argparse.Namespace) -> None:
    """Merge the answers into ``scoreboard_answers.json`` and make the tables of the page."""
    from benchmarks.measured import write

    shown = json.loads(SHOWN.read_text("utf-8")) if SHOWN.exists() else []
    answers = {(row["problem"], row["solver"]): row for row in [*shown, *_answers()]}
    names = [*_names("development"), *_names("frozen")]
    order = [(name, solver) for name in names for solver in SOLVERS if (name, solver) in answers]
    lines = ",\n".join(json.dumps(answers[key]) for key in order)
    SHOWN.write_text(f"[\n{lines}\n]\n", "utf-8")
    columns = {"problem": "", "known value": ".9g", **dict.fromkeys(SOLVERS, "")}
    sums = {"solver": "", "problems": "d", **dict.fromkeys(TOTALS, "d"), "median seconds": ".2f"}
    for half in ("development", "frozen"):
        rows, totals = _board(half, answers)
        write("scoreboard", half, __file__, columns, rows, ("casadi",))
        write("scoreboard", f"{half}-totals", __file__, sums, totals, ("casadi",))
        for row in totals:
            print(half, *row)


def main() -> None:
    """Run, or make the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    commands = parser.add_subparsers(required=True)
    one = commands.add_parser("run")
    one.add_argument("names", nargs="*")
    one.add_argument("--solvers", nargs="+", choices=SOLVERS, default=list(SOLVERS))
    one.add_argument("--half", choices=("development", "frozen", "all"), default="all")
    one.add_argument("--limit", type=float, default=LIMIT, help="CPU seconds per pair")
    one.add_argument("--label", default="now", help="name of the state of our solver")
    one.set_defaults(call=run)
    commands.add_parser("tables").set_defaults(call=tables)
    given = parser.parse_args()
    given.call(given)


if __name__ == "__main__":
    main()
