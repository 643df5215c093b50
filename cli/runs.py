"""Commands that run backends on instances: solve, compare, front and reproduce."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase
from glob import glob, has_magic
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .options import (
    DURATION,
    INFEASIBLE,
    INTERNAL,
    INTERRUPTED,
    LIMITS,
    NO_ANSWER,
    VERIFIED,
    VIOLATED,
    as_json,
    compare_code,
    draw,
    numbers,
    only,
    options,
    pairs,
    picture_path,
    reading,
    select,
)

if TYPE_CHECKING:
    from ..solvers.contract.events import Event
    from ..solvers.contract.solution import Solution

__all__ = ["compare", "front", "reproduce", "solve"]


@click.command(short_help="Solve an instance and verify the answer.")
@click.argument("instance")
@reading
@options("backend", "formulation", *LIMITS)
@as_json
@options("backend_options", "formulation_options", "in_process")
@options("details", "plot")
@click.option(
    "--output",
    metavar="FILE",
    help="Write the solution as JSON; - for standard output, which then receives nothing else.",
)
def solve(
    instance: str, reading: dict[str, Any], backend: str, as_json: bool, plot: str | None, output: str | None,
    warm_start: str | None, in_process: bool, details: bool, **limits: Any,
) -> int:  # fmt: skip
    """Solve INSTANCE and verify the answer."""
    from ..files import writable
    from ..instances.catalogue import load
    from ..instances.storage import read_plan
    from ..models.verification import stated
    from ..solvers.contract.backend import Backend
    from ..solvers.contract.job import Job
    from ..solvers.contract.registry import is_plain
    from ..solvers.report.tables import SHOWN, details_table
    from ..solvers.report.terminal import emit, progress, say, show
    from ..solvers.run import dispatch

    as_json = as_json or output == "-"
    picture = picture_path(plot)
    record = None if output in (None, "-") else writable(output)
    model = load(instance, **reading)
    start = None if warm_start is None else read_plan(model, warm_start)
    auto = backend == "auto"
    chosen = Job(model, backend, limits["formulation"]).resolved().backend
    assert isinstance(chosen, Backend)
    with progress(f"{instance}: {backend}") as status:

        def on_event(event: Event) -> None:
            if event.incumbent is not None:
                best = event.incumbent
                objective = stated(best.objective, model.maximise)
                status(f"incumbent {objective:.10g} after {best.seconds:.1f} s")

        solution = dispatch.solve(
            model,
            "auto" if auto else chosen,
            warm_start=start,
            isolate=False if in_process else None if is_plain(chosen) else True,
            on_event=on_event,
            **only(**limits),
        )
    # Files first: a closed pipe must not lose the answer.
    if record is not None:
        solution.save(record)
    if picture is not None:
        if solution.plan is None:
            say("no plan, no picture")
        else:
            draw(model, solution, picture)
    rows = [] if solution.plan is None or not details else model.details(solution.plan)
    if as_json:
        emit(solution.to_dict() | ({"details": rows} if details else {}))
    else:
        is_listed = model.has_variables and len(rows) <= SHOWN  # by the parts of the solution
        show(*solution.parts(), *([details_table(rows)] if rows and not is_listed else []))
        if details and solution.history:
            show(
                details_table(solution.history, "refinement", short=("error", "change", "seconds"))
            )
        if solution.termination in ("infeasible", "locally_infeasible"):
            show(f"crosstrack diagnose {instance} says why")
    return _solve_code(solution)


def _solve_code(solution: Solution[Any]) -> int:
    """Return the exit code for a solution."""
    if solution.limit == "interrupted":
        return INTERRUPTED
    if solution.plan is not None:
        return VERIFIED
    codes = {
        "infeasible": INFEASIBLE,
        "unbounded": INFEASIBLE,
        "rejected": VIOLATED,
        "failed": INTERNAL,
    }
    return codes.get(str(solution.termination), NO_ANSWER)


@click.command(short_help="Solve with several backends and judge.")
@click.argument("instances", nargs=-1, required=True, metavar="INSTANCE...")
@reading
@click.option(
    "--backends",
    "names",
    help="Names separated by commas, each with an optional :formulation (default: all installed backends that accept the first instance).",
)
@options(
    "formulation",
    *LIMITS,
    backend={
        "default": None,
        "show_default": False,
        "multiple": True,
        "help": "A name as in --backends; repeat it for several.",
    },
)
@as_json
@click.option(
    "--grace",
    type=DURATION,
    default=10.0,
    show_default=True,
    help="Seconds past the time limit before a worker is killed.",
)
@options("workers")
@click.option(
    "--repeats", type=int, default=1, show_default=True, help="Runs of each randomised backend."
)
@options("formulation_options", "jsonl", "resume")
def compare(
    instances: Sequence[str], reading: dict[str, Any], names: str | None, backend: Sequence[str], as_json: bool,
    jsonl: str | None, resume: bool, warm_start: str | None, **limits: Any,
) -> int:  # fmt: skip
    """Solve every INSTANCE with several backends in worker processes and compare the answers.

    INSTANCE may be a glob of catalogue names or files in quotation marks, such as 'fleet/*'.
    """
    from ..instances.catalogue import load
    from ..instances.storage import read_plan
    from ..solvers.contract.selection import fitting
    from ..solvers.report.terminal import emit, progress, show
    from ..solvers.run import crosscheck

    if names is not None and backend:
        raise click.UsageError("--backend and --backends name the same: use one of them")
    if resume and jsonl is None:
        raise click.UsageError("--resume needs --jsonl FILE")
    if jsonl == "-":
        raise click.UsageError("--jsonl takes a file, which --resume reads: use --json to print")
    models = [load(instance, **reading) for instance in _expand(instances)]
    listed = [name.strip() for name in (names or "").split(",") if name.strip()] or [*backend]
    chosen = listed or list(fitting(models[0]))
    start = None if warm_start is None else [read_plan(model, warm_start) for model in models]
    total, count = len(models) * len(chosen), 0
    with progress(f"0 of {total}") as status:

        def on_event(event: Event) -> None:
            nonlocal count
            count += 1
            assert event.solution is not None
            status(
                f"{count} done, last: {event.instance} {event.backend} {event.solution.termination}"
            )

        result = crosscheck.compare(
            models, chosen, record=jsonl, resume=resume, warm_start=start, on_event=on_event,
            **only(**limits),
        )  # fmt: skip
    if as_json:
        emit(result.to_dict())
    else:
        show(*result.parts())
    return compare_code(result)


def _expand(patterns: Sequence[str]) -> list[str]:
    """Return names and files with each glob replaced by its matches, each once."""
    from ..instances.catalogue import entries

    result: list[str] = []
    for pattern in patterns:
        matches = [pattern]
        if has_magic(pattern) and not Path(pattern).exists():
            # As in load, the catalogue precedes files of the same name.
            names = [entry.name for entry in entries()]
            matches = [name for name in names if fnmatchcase(name, pattern)]
            matches = matches or sorted(glob(pattern))  # noqa: PTH207 (Path.glob refuses absolute patterns)
            matches = matches or select("instance", [pattern], names)
        result += [name for name in matches if name not in result]
    return result


@click.command(short_help="Trade the objective for a second one.")
@click.argument("instance")
@click.argument("second")
@reading
@options("backend")
@click.option(
    "--limits", metavar="A,B,…", help="Limits on SECOND (default: chosen during the run)."
)
@click.option(
    "--points",
    type=int,
    help="Largest number of runs without --limits (default: 10; unlimited if SECOND is an integer).",
)
@click.option(
    "--step",
    type=float,
    help="Relative decrease from the last plan to the next limit (default: 0.05; one unit if SECOND is an integer).",
)
@click.option(
    "--sweep",
    metavar="FIELD=A,B,…",
    help="Vary a field of the model instead, such as q=0,0.2,0.4, and compare FIRST and SECOND.",
)
@click.option("--first", help="The first objective of a sweep, such as sum.")
@options("formulation", *LIMITS, "backend_options", "jsonl", "resume", "plot")
@as_json
def front(
    instance: str, second: str, reading: dict[str, Any], limits: str | None, points: int | None, step: float | None,
    sweep: str | None, first: str | None, jsonl: str | None, resume: bool, plot: str | None, as_json: bool,
    warm_start: str | None, **settings: Any,
) -> int:  # fmt: skip
    """Solve INSTANCE under limits on its SECOND objective, such as max, and print the Pareto front."""
    from ..instances.catalogue import load
    from ..instances.storage import read_plan
    from ..solvers.report.terminal import emit, progress, show
    from ..solvers.run import pareto

    if resume and jsonl is None:
        raise click.UsageError("--resume needs --jsonl FILE")
    if (sweep is None) != (first is None):
        raise click.UsageError("--sweep and --first go together")
    if sweep is not None and any(value is not None for value in (limits, points, step)):
        raise click.UsageError("--sweep takes no --limits, --points or --step")
    picture = picture_path(plot)
    model = load(instance, **reading)
    with progress(f"{instance}: {second}") as status:
        common: dict[str, Any] = {
            "record": jsonl, "resume": resume, **only(**settings),
            "warm_start": None if warm_start is None else read_plan(model, warm_start),
            "on_event": lambda e: status(f"{e.instance} {e.solution.termination}"),
        }  # fmt: skip
        if sweep is not None and first is not None:
            [(name, values)] = pairs([sweep], "--sweep").items()
            result = pareto.sweep(model, name, _parse_numbers(str(values)), first, second, **common)
        else:
            chosen = None if limits is None else _parse_numbers(limits)
            result = pareto.front(
                model, second, limits=chosen, **only(points=points, step=step), **common
            )
    if picture is not None and result.points:
        draw(result, None, picture)
    if as_json:
        emit(result.to_dict())
    else:
        show(*result.parts())
    if result.interrupted:
        return INTERRUPTED
    return VERIFIED if result.points else max(map(_solve_code, result.unsolved), default=NO_ANSWER)


def _parse_numbers(text: str) -> list[float]:
    """Return the numbers in a comma-separated list such as ``0,0.2,0.4``."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise click.BadParameter(f"{text!r} is not a list of numbers such as 1,2.5") from None


@click.command(short_help="Compare a paper's result tables with our values.")
@click.argument("problem")
@click.option(
    "--table",
    "names",
    multiple=True,
    metavar="NAME",
    help="Name of a table, such as table-2 (default: all).",
)
@click.option("--rows", help="Row numbers in each table, such as 1-6,9 (default: all).")
@click.option(
    "--runs",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Runs per cell, from different seeds.",
)
@options(time_limit={"default": 60.0, "show_default": True, "help": "Seconds for each run."})
@as_json
def reproduce(
    problem: str,
    names: Sequence[str],
    rows: str | None,
    runs: int,
    time_limit: float,
    as_json: bool,
) -> int:
    """Print each cell of the paper's result tables next to our value, for PROBLEM such as error-correction."""
    from ..instances.paper import measurement, paper_of
    from ..models.verification import check_number
    from ..solvers.report import reproduction
    from ..solvers.report.terminal import emit, progress, show

    check_number("time_limit", time_limit)
    paper = paper_of(problem)
    tables = [paper.table(name) for name in names] if names else paper.tables
    positions = None if rows is None else numbers(rows)
    if positions is not None and not any(
        k <= len(t.rows) for t in tables for k in positions if k > 0
    ):
        raise click.BadParameter(f"no row of {problem!r} is among {rows!r}", param_hint="--rows")
    with progress(f"{problem}: ") as status:

        def on_event(event: Event) -> None:
            assert event.solution is not None
            status(f"{event.instance} {event.backend} {event.solution.termination}")

        result = reproduction.reproduce(
            problem,
            [(table, measurement(problem, table.name)) for table in tables],
            rows=positions,
            runs=runs,
            time_limit=time_limit,
            on_event=on_event,
        )
    counts = {str(state): count for state, count in paper.counts.items()}
    if as_json:
        emit({**result.to_dict(), "paper": paper.reference, "items": counts})
    else:
        summary = ", ".join(f"{count} {state}" for state, count in counts.items())
        show(paper.reference, *reproduction.reproduction_parts(result))
        show(f"{len(paper.items)} items of the paper: {summary}")
    if not result.comparison.verdicts and not result.interrupted:
        return VERIFIED
    return compare_code(result.comparison)
