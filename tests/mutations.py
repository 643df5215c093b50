"""Break the checks of plans one line at a time, and show that the tests notice.

A verification that no test guards may be weakened by any edit. This script applies small faults
(mutations) to the modules that hold the checks, a fault at a time, and runs the tests of that
problem. A mutation that no test notices has survived; all must die. The faults are drawn from every
place that could be changed, evenly over the functions and by a seed, so that two runs agree.
Tests whose file is named after checks run first, and the others only if a fault survives them.
Usage::

    python tests/mutations.py                  # about 120 mutations, every problem: an hour or two
    python tests/mutations.py grid_path fleet  # some problems
    python tests/mutations.py grid_path --list # what would be changed
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
#: Modules with checks apart from each problem's ``checks.py``, and functions of them; None for all.
MODULES: dict[str, tuple[str, ...]] = {
    "attractor/model.py": ("verify",),
    "black_box/model.py": ("verify",),
    "minimum_snap/knots.py": ("*",),
    "minimum_snap/time_allocation.py": ("verify",),
    "satellite_slew/flight.py": ("*",),
    "sideslip/model.py": ("verify",),
}
#: Modules in ``models`` that all problems share: functions with checks, and the file of their tests.
SHARED: dict[str, tuple[tuple[str, ...], str]] = {
    "verification": (
        ("check_entries", "count", "largest", "within", "worst_of", "share"),
        "framework/test_checks.py",
    ),
}
#: Mutations that change no verdict, as ``file:old source -> new source``: the reason for each.
EQUIVALENT: dict[str, str] = {
    "models/satellite_slew/flight.py:np.abs((states[:, :4] ** 2).sum(axis=1) - 1.0) -> "
    "((states[:, :4] ** 2).sum(axis=1) - 1.0)": "the magnitude is taken again",
    "models/messenger/checks.py:np.asarray(angle, float) + np.pi -> (np.asarray(angle, float) - np.pi)": (
        "both differ by a full turn, which the remainder takes off"
    ),
    "models/optimal_control/checks.py:abs(plan.end) -> (plan.end)": (
        "a phase that ends before 0 starts farther from it"
    ),
    "models/minimum_snap/time_allocation.py:max(0.0, -float(plan.durations[shortest])) -> 0.0": (
        "a trajectory refuses durations that are not > 0, so that the violation is always 0"
    ),
    "models/attractor/checks.py:max(BLOCK // (len(ahead) * self.states.shape[1]), 1) -> "
    "min(BLOCK // (len(ahead) * self.states.shape[1]), 1)":
        "neighbours are followed one at a time, with equal distances",
    "models/attractor/checks.py:max(BLOCK // last, 1) -> min(BLOCK // last, 1)":
        "distances are computed one row at a time, with equal values",
    "models/grid_path/checks.py:len(path) - 1 -> (len(path) + 1)":
        "the additional groups hold no segment",
    "models/grid_path/checks.py:cells + extent - a -> (cells + extent + a)":
        "a longer part of the segment is measured, and its depth is negative outside of the box",
    "models/grid_path/checks.py:np.maximum(first, last).min(axis=1) -> np.maximum(first, last).max(axis=1)":
        "a longer part of the segment is measured, and its depth is negative outside of the box",
}  # fmt: skip
#: Mutations for each problem unless the command line names another number.
SHARE = 9
#: Seconds for the tests of one mutation.
PATIENCE = 900

_SWAPS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.And: ast.Or, ast.Or: ast.And, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
}  # fmt: skip
_CALLS = {"max": "min", "min": "max", "maximum": "minimum", "minimum": "maximum",
          "argmax": "argmin", "any": "all", "all": "any"}  # fmt: skip
#: Keywords and positions of a check's numbers, which get a value that hides every violation.
_WORST = {"Check": 2, "scaled": 2, "count": 1, "largest": 1, "within": 1}


@dataclass(frozen=True)
class Mutation:
    """One fault: which text of a file becomes which other text."""

    file: str
    line: int
    old: str
    new: str
    begin: int
    end: int
    function: str

    @property
    def key(self) -> str:
        """Name of the mutation that does not depend on the line."""
        return f"{self.file}:{self.old} -> {self.new}"

    def apply(self, text: str) -> str:
        """Return the file's text with the fault."""
        raw = text.encode()
        return (raw[: self.begin] + self.new.encode() + raw[self.end :]).decode()


def find_mutations(path: Path, functions: tuple[str, ...] = ("*",)) -> list[Mutation]:
    """Return every mutation of the functions of the file at `path`."""
    text = path.read_text("utf-8")
    tree = ast.parse(text)
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line.encode()))
    raw = text.encode()
    found: dict[tuple[int, str], Mutation] = {}
    for function in ast.walk(tree):
        if not isinstance(function, ast.FunctionDef):
            continue
        if "*" not in functions and function.name not in functions:
            continue
        for node, new in _faults(function):
            begin = starts[node.lineno - 1] + node.col_offset  # type: ignore[attr-defined]
            end = starts[node.end_lineno - 1] + node.end_col_offset  # type: ignore[attr-defined]
            old = raw[begin:end].decode()
            if ast.dump(ast.parse(new, mode="eval")) != ast.dump(
                ast.parse(f"({old})", mode="eval")
            ):
                line = node.lineno  # type: ignore[attr-defined]
                name = path.relative_to(ROOT).as_posix()
                found[begin, new] = Mutation(name, line, old, new, begin, end, function.name)
    return list(found.values())


def _faults(function: ast.FunctionDef) -> Iterator[tuple[ast.AST, str]]:
    """Yield the expressions of `function` with the source of a faulty one each."""
    for node in _expressions(function):
        if isinstance(node, ast.BinOp | ast.BoolOp) and type(node.op) in _SWAPS:
            other = ast.unparse(node)
            copy = ast.parse(other, mode="eval").body
            assert isinstance(copy, ast.BinOp | ast.BoolOp)
            copy.op = _SWAPS[type(node.op)]()  # type: ignore[assignment]
            yield node, f"({ast.unparse(copy)})"
        elif isinstance(node, ast.Compare) and type(node.ops[0]) in _SWAPS:
            copy = ast.parse(ast.unparse(node), mode="eval").body
            assert isinstance(copy, ast.Compare)
            copy.ops[0] = _SWAPS[type(node.ops[0])]()  # type: ignore[assignment]
            yield node, f"({ast.unparse(copy)})"
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.Invert):
            yield node, f"({ast.unparse(node.operand)})"
        elif isinstance(node, ast.Call):
            name = node.func.id if isinstance(node.func, ast.Name) else None
            name = node.func.attr if isinstance(node.func, ast.Attribute) else name
            if name in _CALLS:
                copy = ast.parse(ast.unparse(node), mode="eval").body
                assert isinstance(copy, ast.Call)
                if isinstance(copy.func, ast.Name):
                    copy.func.id = _CALLS[name]
                else:
                    copy.func.attr = _CALLS[name]  # type: ignore[attr-defined]
                yield node, ast.unparse(copy)
            elif name in ("abs", "fabs") and len(node.args) == 1:
                yield node, f"({ast.unparse(node.args[0])})"
            elif name in _WORST and len(node.args) > _WORST[name]:
                worst = node.args[_WORST[name]]
                # A local helper has other arguments, and an empty list has no violation.
                helper = name != "Check" and isinstance(node.func, ast.Name)
                if not helper and ast.unparse(worst) != "[]":
                    yield worst, "0.0"


def _expressions(function: ast.FunctionDef) -> Iterator[ast.AST]:
    """Yield the nodes of a body, without annotations, defaults and messages."""
    todo: list[ast.AST] = list(function.body)
    while todo:
        node = todo.pop()
        if isinstance(node, ast.FunctionDef | ast.JoinedStr | ast.Raise):
            continue
        if isinstance(node, ast.AnnAssign):
            todo += [node.value] if node.value is not None else []
            continue
        yield node
        todo += ast.iter_child_nodes(node)


def choose_mutations(problem: str, number: int, seed: int = 1) -> list[Mutation]:
    """Return `number` mutations of a problem's checks: every check's violation, then a draw."""
    folder = ROOT / "models" / problem
    every: list[Mutation] = []
    if problem in SHARED:
        every += find_mutations(folder.with_suffix(".py"), SHARED[problem][0])
    if (folder / "checks.py").exists():
        every += find_mutations(folder / "checks.py")
    for name, functions in MODULES.items():
        if name.startswith(f"{problem}/"):
            every += find_mutations(ROOT / "models" / name, functions)
    every = [one for one in every if one.key not in EQUIVALENT]
    blind = [one for one in every if one.new == "0.0"]
    rest = [one for one in every if one.new != "0.0"]
    random.Random(seed).shuffle(rest)
    # Functions take turns, so that a long one does not take every place.
    turns: dict[str, int] = {}
    order = []
    for one in rest:
        name = f"{one.file}:{one.function}"
        turns[name] = turns.get(name, 0) + 1
        order.append((turns[name], one))
    order.sort(key=lambda pair: pair[0])
    return [*blind, *(one for _, one in order)][: max(number, len(blind))]


def run_tests(tests: list[Path], folder: Path) -> tuple[bool, str]:
    """Return whether `tests` fail on the package in `folder`, and the first failure or its reason.

    A timeout, a crash and an error before the first test are failures: the fault was noticed.
    """
    command = [sys.executable, "-m", "pytest", "-x", "-q", "--no-header", "--tb=no",
               "-p", "no:cacheprovider", "-m", "not slow", *map(str, tests)]  # fmt: skip
    try:
        done = _run(command, folder)
    except subprocess.TimeoutExpired:
        return True, f"TIMEOUT after {PATIENCE} s"
    lines = done.stdout.splitlines()
    failed = [line for line in lines if line.startswith(("FAILED", "ERROR"))]
    if failed:
        return True, failed[0].split(" - ")[0]
    if done.returncode < 0:
        return True, f"CRASH by signal {-done.returncode}"
    last = (done.stderr.splitlines() or lines or [""])[-1]
    return done.returncode != 0, f"EXIT {done.returncode} {last}" if done.returncode else ""


class Suite:
    """The tests of a problem, those of checks first: most mutations die there within seconds."""

    def __init__(self, problem: str, folder: Path) -> None:
        tests = sorted((ROOT / "tests" / problem).glob("test_*.py"))
        if problem in SHARED:
            tests = [ROOT / "tests" / SHARED[problem][1]]
        tests.sort(key=lambda path: "check_limits" not in path.name)
        of_checks = [path for path in tests if "check" in path.name]
        others = [path for path in tests if "check" not in path.name]
        self.folder, self.parts = folder, [part for part in (of_checks, others) if part]
        self.passing = 0

    def try_mutation(self, mutation: Mutation) -> tuple[bool, float, str]:
        """Return whether a test fails with `mutation`, the seconds, and the test."""
        begin = time.perf_counter()
        for number, part in enumerate(self.parts):
            if number == self.passing:  # a test that always fails would notice every fault
                failing, test = run_tests(part, self.folder)
                if failing:
                    raise RuntimeError(f"the tests fail without any fault: {test}")
                self.passing += 1
                begin = time.perf_counter()
            dead, test = self._run_broken(part, mutation)
            if dead:
                return True, time.perf_counter() - begin, test
        return False, time.perf_counter() - begin, ""

    def _run_broken(self, tests: list[Path], mutation: Mutation) -> tuple[bool, str]:
        target = self.folder / "crosstrack" / mutation.file
        original = target.read_text("utf-8")
        target.write_text(mutation.apply(original), "utf-8")
        try:
            return run_tests(tests, self.folder)
        finally:
            target.write_text(original, "utf-8")


def check_import(folder: Path) -> None:
    """Raise unless the tests would import the models from `folder`, where the faults are."""
    code = "import crosstrack.models as models; print(models.__file__)"
    done = _run([sys.executable, "-c", code], folder)
    found = Path(done.stdout.strip())
    if folder.resolve() not in found.resolve().parents:
        raise RuntimeError(f"the tests would import {found}, not the copy in {folder}")


def _run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run `command` with the package in `folder` first on the path."""
    environment = {**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=PATIENCE, check=False
    )  # fmt: skip


def main() -> int:
    """Run the command line; the exit code is 1 if a mutation survived."""
    parser = argparse.ArgumentParser(description="Break the checks of plans and run their tests")
    parser.add_argument("problems", nargs="*", help="folders in models/; all by default")
    parser.add_argument("--number", type=int, default=SHARE, help="mutations for each problem")
    parser.add_argument("--seed", type=int, default=1, help="of the draw")
    parser.add_argument("--list", action="store_true", help="show the mutations and run nothing")
    parser.add_argument("--json", type=Path, help="file for the table")
    options = parser.parse_args()
    every = sorted(path.parent.name for path in (ROOT / "models").glob("*/checks.py"))
    every = sorted({*every, *(name.split("/")[0] for name in MODULES), *SHARED})
    unknown = set(options.problems) - set(every)
    if unknown:
        parser.error(f"no problem {min(unknown)!r}; known: {', '.join(every)}")
    rows: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "crosstrack").mkdir()
        for path in ROOT.iterdir():
            if path.name == "models":
                ignored = shutil.ignore_patterns("__pycache__")
                shutil.copytree(path, folder / "crosstrack" / "models", ignore=ignored)
            elif not path.name.startswith(".") and path.name != "tests":
                (folder / "crosstrack" / path.name).symlink_to(path)
        check_import(folder)
        for problem in options.problems or every:
            suite = Suite(problem, folder)
            for mutation in choose_mutations(problem, options.number, options.seed):
                old = " ".join(mutation.old.split())
                head = f"{mutation.file}:{mutation.line} {old} -> {mutation.new}"
                if options.list:
                    print(head)
                    continue
                dead, seconds, test = suite.try_mutation(mutation)
                state = "died" if dead else "SURVIVED"
                print(f"{state:8} {seconds:6.1f} s  {head}  {test}", flush=True)
                rows.append({
                    "file": mutation.file, "line": mutation.line, "old": mutation.old,
                    "new": mutation.new, "died": dead, "test": test,
                })  # fmt: skip
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1) + "\n", "utf-8")
    survivors = sum(not row["died"] for row in rows)
    if not options.list:
        print(f"{len(rows)} mutations, {len(rows) - survivors} died, {survivors} survived")
    return 1 if survivors else 0


if __name__ == "__main__":
    sys.exit(main())
