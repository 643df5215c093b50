"""Commands for plans: check, show or export a plan, explain why an instance has none."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from functools import partial
from typing import Any

import click

from .options import (
    INFEASIBLE,
    LIMITS,
    NO_ANSWER,
    VERIFIED,
    VIOLATED,
    as_json,
    draw,
    only,
    options,
    picture_path,
    reading,
)

__all__ = ["check", "diagnose", "export", "show"]


@click.command(short_help="Verify a plan from any source.")
@click.argument("instance")
@click.argument("plan", metavar="PLAN.json")
@reading
@options(formulation="Check every row of this formulation, too.")
@options("tolerance", "details", "plot")
@click.option(
    "--exact",
    is_flag=True,
    help="Verify a linear, mixed-integer or quadratic program in rational arithmetic, and prove a bound "
    "from the multipliers if PLAN.json is a solution.",
)
@as_json
def check(
    instance: str,
    plan: str,
    reading: dict[str, Any],
    formulation: str | None,
    tolerance: float | None,
    details: bool,
    exact: bool,
    as_json: bool,
    plot: str | None,
) -> int:
    """Verify a plan from any source for INSTANCE: exit code 0 if it is valid, 6 if it is not."""
    from ..instances.catalogue import load
    from ..instances.storage import plan_in, read_content
    from ..models.verification import stated
    from ..solvers.contract.solution import Solution
    from ..solvers.report.tables import details_table, verification_table
    from ..solvers.report.terminal import emit, show
    from ..solvers.run.verification import verify

    picture = picture_path(plot)
    model = load(instance, **reading)
    content = read_content(plan)
    loaded = plan_in(model, content, plan)
    has_duals = isinstance(content, dict) and bool(content.get("duals"))
    source = Solution.from_dict(content, model) if exact and has_duals else loaded
    verification = verify(
        model, source, formulation=formulation, exact=exact, **only(tolerance=tolerance)
    )
    if picture is not None:
        draw(model, loaded, picture, tolerance)
    rows = model.details(loaded) if details else []
    if as_json:
        extra = {"details": rows} if details else {}
        report = verification.to_dict()
        emit({"model": model.kind, "instance": model.name, "verification": report, **extra})
    else:
        value = stated(verification.objective, model.maximise)
        objective = "" if value is None else f", objective {value:.10g}"
        bound = stated(verification.bound, model.maximise)
        if bound is not None:
            objective += f", bound {bound:.10g} ({verification.proof})"
        show(f"{model.name}: {'verified' if verification.ok else 'NOT verified'}{objective}")
        show(verification_table(verification), *([details_table(rows)] if rows else []))
    return VERIFIED if verification.ok else VIOLATED


@click.command(short_help="Write a plan for other software.")
@click.argument("instance")
@click.argument("plan", metavar="PLAN.json")
@reading
@click.option("--format", "form", help="Name of the format (default: the problem's first).")
@click.option(
    "--output", metavar="FILE", required=True, help="The file to write; - is standard output."
)
@click.option("--rate", type=float, help="Samples per unit of time, for samples (default: 100).")
@click.option(
    "--precision",
    type=click.Choice(["float32", "float64"]),
    help="Precision of the numbers in poly7: that of the firmware (default: float32) or float64.",
)
@options("tolerance", backend_options="An option of the format.")
@as_json
def export(
    instance: str,
    plan: str,
    reading: dict[str, Any],
    form: str | None,
    output: str,
    rate: float | None,
    precision: str | None,
    backend_options: dict[str, Any],
    tolerance: float | None,
    as_json: bool,
) -> int:
    """Write PLAN.json for INSTANCE as a file for other software.

    Each problem has its own formats; an unknown name lists them. The plan is verified first, and
    an invalid plan is not written (exit code 6).
    """
    from ..files import read_text, writable
    from ..instances.catalogue import load
    from ..instances.exports import choose_format, export_plan
    from ..instances.storage import read_plan
    from ..solvers.report.tables import render, verification_table
    from ..solvers.report.terminal import emit, say, show, write
    from ..solvers.run.verification import verify

    arguments = only(rate=rate, precision=precision) | backend_options
    model = load(instance, **reading)
    name, writer = choose_format(model, form, arguments)
    streamed = output == "-"
    if streamed and as_json:
        raise click.UsageError("--json and --output - both need standard output: use one of them")
    if not streamed:
        writable(output, (writer.suffix,))
    loaded = read_plan(model, plan)
    verification = verify(model, loaded, **only(tolerance=tolerance))
    if not verification.ok:
        parts = f"{model.name}: NOT verified, nothing written", verification_table(verification)
        if as_json:
            emit({"format": name, "path": None, "verification": verification.to_dict()})
        elif streamed:
            say(render(*parts))
        else:
            show(*parts)
        return VIOLATED
    with tempfile.TemporaryDirectory() as folder:
        path = f"{folder}/plan{writer.suffix}" if streamed else output
        report = export_plan(model, loaded, path, name, **arguments)
        if streamed:
            write(read_text(path))
    has_report = hasattr(report, "to_dict")
    message = str(report).replace(path, output) if has_report else f"{output}: {loaded}"
    if as_json:
        emit({"format": name, "path": output, **(report.to_dict() if has_report else {})})
    elif streamed:
        say(message)
    else:
        show(message)
    return VERIFIED


@click.command(short_help="Explain why an instance has no plan.")
@click.argument("instance")
@reading
@options(
    backend={
        "default": None,
        "help": "Find conflicting blocks of a program with this backend instead.",
    },
    formulation="Program whose blocks are examined (default: paper).",
    time_limit="Seconds for each program that is solved (default: 60).",
)
@options(*(name for name in LIMITS if name not in ("time_limit", "warm_start")), "in_process")
@as_json
def diagnose(
    instance: str,
    reading: dict[str, Any],
    backend: str | None,
    formulation: str | None,
    in_process: bool,
    as_json: bool,
    **limits: Any,
) -> int:
    """Explain why INSTANCE has no plan, in the paper's terms (exit code 3), or report that it has one (0)."""
    from ..instances.catalogue import load
    from ..solvers.processes.isolation import Worker
    from ..solvers.report.terminal import emit, progress, show
    from ..solvers.run import diagnosis

    model = load(instance, **reading)
    with progress(f"{instance}: looking for the reason"):
        search = partial(
            diagnosis.diagnose, model, backend, formulation=formulation, **only(**limits)
        )
        if in_process or limits["memory_limit"] is not None:
            result = search()
        else:
            with Worker() as worker:
                result = diagnosis.Diagnosis.from_dict(
                    worker.call(lambda: search().to_dict(), deadline=float("inf"))
                )
    if as_json:
        emit(result.to_dict())
    else:
        show(str(result))
    codes: dict[Any, int] = {True: VERIFIED, False: INFEASIBLE, None: NO_ANSWER}
    return codes[result.feasible]


@click.command(short_help="Show a plan in the browser.")
@click.argument("instance")
@click.argument("plan", metavar="[PLAN.json]", required=False)
@reading
@options(
    backend={
        "default": None,
        "multiple": True,
        "show_default": False,
        "help": "Solve with this backend first; repeat it to show several side by side.",
    },
    formulation="Formulation for backends that take programs.",
)
@options(*(name for name in LIMITS if name != "warm_start"), "backend_options")
@click.option(
    "--output", metavar="FILE.html", help="The file to write (default: a temporary file)."
)
@click.option("--no-open", is_flag=True, help="Only write the page.")
def show(
    instance: str,
    plan: str | None,
    reading: dict[str, Any],
    backend: Sequence[str],
    output: str | None,
    no_open: bool,
    **limits: Any,
) -> int:
    """Show INSTANCE, with a plan or solution from PLAN.json or of a backend, as a page in the browser."""
    from click.core import ParameterSource

    from ..files import writable
    from ..instances.catalogue import load
    from ..instances.storage import plan_in, read_content
    from ..solvers.contract.solution import Solution
    from ..solvers.report.terminal import show as write
    from ..solvers.report.view import page
    from ..solvers.run.crosscheck import compare
    from ..solvers.run.dispatch import solve

    if plan is not None and backend:
        raise click.UsageError("PLAN.json and --backend both give a plan: use one of them")
    source = click.get_current_context().get_parameter_source
    if not backend and any(source(name) is ParameterSource.COMMANDLINE for name in limits):
        raise click.UsageError("limits and options of a solver need --backend")
    if output is not None:
        writable(output, (".html", ".htm"))  # before minutes of solving
    model = load(instance, **reading)
    item: Any = model
    shown: Any = None
    if len(backend) == 1:
        item = solve(model, backend[0], **only(**limits))
    elif backend:
        item = compare([model], list(backend), **only(**limits))
    elif plan is not None:
        content = read_content(plan)
        is_record = isinstance(content, dict) and "termination" in content
        shown = Solution.from_dict(content, model) if is_record else plan_in(model, content, plan)
    result = page.show(item, shown, path=output, open=not no_open)
    write(str(result))
    return VERIFIED
