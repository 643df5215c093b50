"""The commands about plans: check one, export one, say why there is none."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from functools import partial
from typing import Any

import click

from .options import (
    INFEASIBLE,
    NO_ANSWER,
    VERIFIED,
    VIOLATED,
    as_json,
    details,
    draw,
    in_process,
    memory_limit,
    only,
    pairs,
    picture_path,
    plot,
    reading,
    tolerance,
)

__all__ = ["check", "diagnose", "export"]


@click.command(short_help="Verify somebody else's plan.")
@click.argument("instance")
@click.argument("plan", metavar="PLAN.json")
@reading
@click.option("--formulation", help="Check every row of this formulation as well.")
@tolerance
@details
@as_json
@plot
def check(
    instance: str,
    plan: str,
    reading: dict[str, Any],
    formulation: str | None,
    tolerance: float | None,
    details: bool,
    as_json: bool,
    plot: str | None,
) -> int:
    """Verify somebody else's plan for INSTANCE: exit code 0 when it holds, 6 when it does not."""
    from ..instances.catalogue import load
    from ..instances.storage import read_plan
    from ..solvers.dispatch import verify
    from ..solvers.report.tables import details_table, verification_table
    from ..solvers.report.terminal import emit, show

    picture = picture_path(plot)
    model = load(instance, **reading)
    found = read_plan(model, plan)
    verification = verify(model, found, formulation=formulation, **only(tolerance=tolerance))
    if picture is not None:
        draw(model, found, picture, tolerance)
    rows = model.details(found) if details else []
    if as_json:
        more = {"details": rows} if details else {}
        checked = verification.to_dict()
        emit({"model": model.kind, "instance": model.name, "verification": checked, **more})
    else:
        objective = (
            "" if verification.objective is None else f", objective {verification.objective:.10g}"
        )
        show(f"{model.name}: {'verified' if verification.ok else 'NOT verified'}{objective}")
        show(verification_table(verification), *([details_table(rows)] if rows else []))
    return VERIFIED if verification.ok else VIOLATED


@click.command(short_help="Write a plan for other software.")
@click.argument("instance")
@click.argument("plan", metavar="PLAN.json")
@reading
@click.option("--format", "form", help="A format of the problem (default: its first).")
@click.option(
    "--output", metavar="FILE", required=True, help="The file to write; - is standard output."
)
@click.option("--rate", type=float, help="Samples a unit of time, for samples (default: 100).")
@click.option(
    "--precision",
    type=click.Choice(["float32", "float64"]),
    help="Digits of the numbers in poly7: the firmware's (default: float32), or all.",
)
@click.option(
    "--option", "options", multiple=True, metavar="KEY=VALUE", help="An option of the format's own."
)
@click.option("--tolerance", type=float, help="Largest violation accepted (default 1e-6).")
@as_json
def export(
    instance: str,
    plan: str,
    reading: dict[str, Any],
    form: str | None,
    output: str,
    rate: float | None,
    precision: str | None,
    options: Sequence[str],
    tolerance: float | None,
    as_json: bool,
) -> int:
    """Write PLAN.json for INSTANCE as a file that other software reads.

    Each problem has formats of its own; an unknown name lists them. The plan is verified first:
    one that does not hold is not written (exit code 6).
    """
    from ..files import read_text, writable
    from ..instances.catalogue import load
    from ..instances.exports import choose_format, export_plan
    from ..instances.storage import read_plan
    from ..solvers.dispatch import verify
    from ..solvers.report.tables import render, verification_table
    from ..solvers.report.terminal import emit, say, show, write

    asked = only(rate=rate, precision=precision) | pairs(options, "--option")
    model = load(instance, **reading)
    name, chosen = choose_format(model, form, asked)
    streamed = output == "-"
    if streamed and as_json:
        raise click.UsageError("--json and --output - both want standard output for themselves")
    if not streamed:
        writable(output, (chosen.suffix,))
    found = read_plan(model, plan)
    verification = verify(model, found, **only(tolerance=tolerance))
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
        path = f"{folder}/plan{chosen.suffix}" if streamed else output
        report = export_plan(model, found, path, name, **asked)
        if streamed:
            write(read_text(path))
    says_more = hasattr(report, "to_dict")
    words = str(report).replace(path, output) if says_more else f"{output}: {found}"
    if as_json:
        emit({"format": name, "path": output, **(report.to_dict() if says_more else {})})
    elif streamed:
        say(words)
    else:
        show(words)
    return VERIFIED


@click.command(short_help="Say why an instance has no plan.")
@click.argument("instance")
@reading
@click.option("--backend", help="Filter the blocks of a program with this backend instead.")
@click.option("--formulation", help="The program whose rows are filtered (default: paper).")
@click.option(
    "--time-limit",
    type=float,
    default=60.0,
    show_default=True,
    help="Seconds for each program solved.",
)
@memory_limit
@in_process
@as_json
def diagnose(
    instance: str,
    reading: dict[str, Any],
    backend: str | None,
    formulation: str | None,
    time_limit: float,
    memory_limit: float | None,
    in_process: bool,
    as_json: bool,
) -> int:
    """Say why INSTANCE has no plan, in the paper's words (exit code 3), or that it has one (0)."""
    from ..instances.catalogue import load
    from ..solvers import diagnosis
    from ..solvers.isolation import Worker
    from ..solvers.report.terminal import emit, progress, show

    model = load(instance, **reading)
    with progress(f"{instance}: looking for the reason"):
        search = partial(
            diagnosis.diagnose, model, backend, formulation=formulation, time_limit=time_limit
        )
        if memory_limit is not None:
            found = search(memory_limit=memory_limit)
        elif in_process:
            found = search()
        else:
            with Worker() as worker:
                found = diagnosis.Diagnosis.from_dict(
                    worker.call(lambda: search().to_dict(), deadline=float("inf"))
                )
    if as_json:
        emit(found.to_dict())
    else:
        show(str(found))
    answer: dict[Any, int] = {True: VERIFIED, False: INFEASIBLE, None: NO_ANSWER}
    return answer[found.feasible]
