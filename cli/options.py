"""Exit codes, shared options and the drawing of pictures."""

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
    from ..solvers.run.crosscheck import Comparison

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

#: Exit codes, explained in ``crosstrack.__main__``.
VERIFIED, INTERNAL, USAGE, INFEASIBLE, NO_ANSWER, MISSING, VIOLATED = range(7)
INTERRUPTED = 130

_PLOT_SUFFIXES = (".png", ".pdf", ".svg")


#: Options shared by several commands.
def as_json(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add ``--json``, which reserves standard output for the JSON document."""
    option = click.option("--json", "as_json", is_flag=True, help="Only JSON on standard output.")
    result: Callable[..., Any] = option(reserved()(command))
    return result


in_process = click.option(
    "--in-process",
    is_flag=True,
    help="Run solvers in this process; a solver that crashes then ends the command.",
)
plot = click.option("--plot", metavar="FILE", help="Write a picture of the plan (png, pdf, svg).")
details = click.option(
    "--details",
    is_flag=True,
    help="Show the details of the plan row by row, such as the errors at each stop, if the model provides "
    "them, and the refinement of its program.",
)
tolerance = click.option(
    "--tolerance",
    type=float,
    help="Largest violation accepted, relative to each constraint's scale (default: 1e-6).",
)
memory_limit = click.option(
    "--memory-limit", type=float, help="Memory limit of a run in MiB, at least 64 (Linux)."
)
_READING: list[Callable[..., Any]] = [
    click.option(
        "--data",
        multiple=True,
        metavar="KEY=VALUE",
        help="A value that a CSV or Excel file lacks, such as alpha1=25.",
    ),
    click.option(
        "--model", metavar="KIND", help="Model kind of a CSV or Excel file, if several fit."
    ),
    click.option(
        "--trusted",
        is_flag=True,
        help="Trust the author of INSTANCE: read functions in CasADi's text format, which can run code.",
    ),
    click.option(
        "--folder",
        metavar="FOLDER",
        help="Folder of files that INSTANCE refers to, in addition to its own folder.",
    ),
]
_COMMON: list[Callable[..., Any]] = [
    click.option("--formulation", help="Formulation for backends that take programs."),
    click.option(
        "--time-limit",
        type=float,
        help="Wall-clock seconds for a run, with building and compiling.",
    ),
    memory_limit,
    click.option("--gap", type=float, help="Relative gap at which an exact backend may stop."),
    tolerance,
    click.option("--seed", type=int, help="Seed of backends that use random numbers."),
    click.option("--threads", type=int, help="Number of threads, for backends that use several."),
    click.option(
        "--evaluations", type=int, help="Limit of evaluations, for backends that count them."
    ),
    click.option(
        "--target", type=float, help="Stop at a plan with this objective or a better one."
    ),
    click.option("--warm-start", metavar="PLAN.json", help="A plan to start from; verified first."),
    as_json,
]


def reading(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options for reading an instance file; the command receives them as ``reading``."""

    @functools.wraps(command)
    def wrapper(*, data: Sequence[str], **arguments: Any) -> Any:
        options = {name: arguments.pop(name) for name in ("model", "trusted", "folder")}
        return command(reading={"data": pairs(data, "--data"), **options}, **arguments)

    result: Callable[..., Any] = wrapper
    for option in reversed(_READING):
        result = option(result)
    return result


def common(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that ``solve`` and ``compare`` share."""
    for option in reversed(_COMMON):
        command = option(command)
    return command


def pairs(values: Sequence[str], option: str) -> dict[str, Any]:
    """Return ``KEY=VALUE`` options as a mapping; values that are valid JSON are decoded."""
    result: dict[str, Any] = {}
    for value in values:
        key, sign, text = value.partition("=")
        if not sign or not key:
            raise click.BadParameter(f"{value!r} is not KEY=VALUE", param_hint=option)
        try:
            result[key] = json.loads(text)
        except json.JSONDecodeError:
            result[key] = text
    return result


def only(**options: Any) -> dict[str, Any]:
    """Return the options that are not None."""
    return {name: value for name, value in options.items() if value is not None}


def numbers(text: str) -> set[int]:
    """Return the integers in a list of numbers and ranges such as ``1-6,9``."""
    result: set[int] = set()
    for part in text.split(","):
        first, dash, last = part.partition("-")
        try:
            result.update(range(int(first), int(last if dash else first) + 1))
        except ValueError:
            raise click.BadParameter(
                f"{part!r} is neither a number nor a range", param_hint="--rows"
            ) from None
    return result


def picture_path(value: str | None) -> Path | None:
    """Return the path of a picture, or raise if it cannot be written or matplotlib is missing."""
    if value is None:
        return None
    from ..files import writable
    from ..models.plots import require_matplotlib

    require_matplotlib()
    return writable(value, _PLOT_SUFFIXES)


def draw(model: Any, plan: Any, path: Path, tolerance: float | None = None) -> None:
    """Write a picture of a model with a plan or solution, or of a front.

    `tolerance` is passed to the picture if it has such an option, and then marks violated constraints.
    """
    from ..files import write_bytes
    from ..models.plots import picture_options, plot
    from ..solvers.report.terminal import say

    accepts_tolerance = tolerance is not None and "tolerance" in picture_options(model.kind)
    options = only(tolerance=tolerance) if accepts_tolerance else {}
    picture = io.BytesIO()
    plot(model, plan, **options).savefig(picture, dpi=150, format=path.suffix[1:].lower())
    write_bytes(path, picture.getvalue())
    say(f"picture: {path}")


def compare_code(result: Comparison) -> int:
    """Return the exit code for a comparison."""
    if result.interrupted:
        return INTERRUPTED
    return {"AGREED": VERIFIED, "CONTRADICTION": VIOLATED}.get(str(result.outcome), NO_ANSWER)
