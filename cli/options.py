"""What several commands share: exit codes, options, and the drawing of a picture."""

from __future__ import annotations

import functools
import io
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..solvers.report.terminal import reserved

if TYPE_CHECKING:
    from ..solvers.crosscheck import Comparison

__all__ = [
    "INFEASIBLE",
    "INTERNAL",
    "INTERRUPTED",
    "MISSING",
    "NO_ANSWER",
    "USAGE",
    "VERIFIED",
    "VIOLATED",
    "common",
    "compare_code",
    "draw",
    "numbers",
    "only",
    "pairs",
    "picture_path",
    "reading",
]

#: The exit codes; ``crosstrack.__main__`` says what each means.
VERIFIED, INTERNAL, USAGE, INFEASIBLE, NO_ANSWER, MISSING, VIOLATED = range(7)
INTERRUPTED = 130

_PLOT_SUFFIXES = (".png", ".pdf", ".svg")


#: The options that commands share one by one.
def as_json(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add ``--json``, and leave standard output to what the command answers."""
    option = click.option("--json", "as_json", is_flag=True, help="Only JSON on standard output.")
    found: Callable[..., Any] = option(reserved()(command))
    return found


in_process = click.option(
    "--in-process",
    is_flag=True,
    help="Run solvers in this process, where one that crashes ends the command.",
)
plot = click.option("--plot", metavar="FILE", help="Write a picture of the plan (png, pdf, svg).")
details = click.option(
    "--details",
    is_flag=True,
    help="Show the plan row by row, such as the errors at each stop, where the model knows how, and how "
    "its program was refined.",
)
tolerance = click.option(
    "--tolerance",
    type=float,
    help="Largest violation accepted, relative to each constraint's scale (default: 1e-6).",
)
memory_limit = click.option(
    "--memory-limit", type=float, help="MiB that a run may hold in memory, at least 64 (Linux)."
)
_READING: list[Callable[..., Any]] = [
    click.option(
        "--data",
        multiple=True,
        metavar="KEY=VALUE",
        help="What INSTANCE lacks where it is a CSV or Excel file, such as alpha1=25.",
    ),
    click.option(
        "--model", metavar="KIND", help="The kind of model of such a file, if several fit."
    ),
    click.option(
        "--trusted",
        is_flag=True,
        help="You know who wrote INSTANCE: functions in CasADi's own text, which can run code, are read.",
    ),
    click.option(
        "--folder",
        metavar="FOLDER",
        help="Where files may lie that INSTANCE refers to (default: below its own folder).",
    ),
]
_COMMON: list[Callable[..., Any]] = [
    click.option("--formulation", help="Formulation for backends that take programs."),
    click.option("--time-limit", type=float, help="Seconds for a run, building included."),
    memory_limit,
    click.option("--gap", type=float, help="Relative gap at which an exact backend may stop."),
    tolerance,
    click.option("--seed", type=int, help="Seed for backends that draw."),
    click.option("--threads", type=int, help="Threads for backends that use several."),
    click.option(
        "--evaluations", type=int, help="Evaluations granted, for backends that count them."
    ),
    click.option("--target", type=float, help="An objective that is good enough to stop at."),
    click.option("--warm-start", metavar="PLAN.json", help="A plan to start from; verified first."),
    as_json,
]


def reading(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of reading an instance file; the command gets them as ``reading``."""

    @functools.wraps(command)
    def called(*, data: Sequence[str], **others: Any) -> Any:
        how = {name: others.pop(name) for name in ("model", "trusted", "folder")}
        return command(reading={"data": pairs(data, "--data"), **how}, **others)

    found: Callable[..., Any] = called
    for option in reversed(_READING):
        found = option(found)
    return found


def common(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that ``solve`` and ``compare`` share."""
    for option in reversed(_COMMON):
        command = option(command)
    return command


def pairs(values: Sequence[str], option: str) -> dict[str, Any]:
    """Return ``KEY=VALUE`` options as a mapping; a value that is JSON is read as such."""
    found: dict[str, Any] = {}
    for value in values:
        key, sign, text = value.partition("=")
        if not sign or not key:
            raise click.BadParameter(f"{value!r} is not KEY=VALUE", param_hint=option)
        try:
            found[key] = json.loads(text)
        except json.JSONDecodeError:
            found[key] = text
    return found


def only(**options: Any) -> dict[str, Any]:
    """Return the options that were given."""
    return {name: value for name, value in options.items() if value is not None}


def numbers(text: str) -> set[int]:
    """Return the whole numbers that ``1-6,9`` names."""
    found: set[int] = set()
    for part in text.split(","):
        first, dash, last = part.partition("-")
        try:
            found.update(range(int(first), int(last if dash else first) + 1))
        except ValueError:
            raise click.BadParameter(
                f"{part!r} is neither a number nor a range", param_hint="--rows"
            ) from None
    return found


def picture_path(value: str | None) -> Path | None:
    """Return where a picture goes; a name that no picture has, or no matplotlib, raises now."""
    if value is None:
        return None
    from ..files import writable
    from ..models.plots import require_matplotlib

    require_matplotlib()
    return writable(value, _PLOT_SUFFIXES)


def draw(model: Any, plan: Any, path: Path, tolerance: float | None = None) -> None:
    """Write the picture of a model with a plan or solution, or of a front; a plan is held to `tolerance` where the picture has one."""
    from ..files import write_bytes
    from ..models.plots import picture_options, plot
    from ..solvers.report.terminal import say

    takes = tolerance is not None and "tolerance" in picture_options(model.kind)
    options = only(tolerance=tolerance) if takes else {}
    picture = io.BytesIO()
    plot(model, plan, **options).savefig(picture, dpi=150, format=path.suffix[1:].lower())
    write_bytes(path, picture.getvalue())
    say(f"picture: {path}")


def compare_code(result: Comparison) -> int:
    """Return the exit code for a comparison."""
    if result.interrupted:
        return INTERRUPTED
    return {"AGREED": VERIFIED, "CONTRADICTION": VIOLATED}.get(str(result.outcome), NO_ANSWER)
