"""Exit codes, shared options and the drawing of pictures."""

from __future__ import annotations

import functools
import io
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import UnknownName
from ..solvers.report.terminal import reserved

if TYPE_CHECKING:
    from ..solvers.run.crosscheck import Comparison

__all__ = [
    "DURATION",
    "INFEASIBLE",
    "INTERNAL",
    "INTERRUPTED",
    "LIMITS",
    "MISSING",
    "NO_ANSWER",
    "USAGE",
    "VERIFIED",
    "VIOLATED",
    "as_json",
    "compare_code",
    "draw",
    "numbers",
    "only",
    "options",
    "pairs",
    "picture_path",
    "reading",
    "select",
    "verdict_code",
]

#: Function of a command.
Command = Callable[..., Any]

#: Exit codes, explained in ``crosstrack.__main__``.
VERIFIED, INTERNAL, USAGE, INFEASIBLE, NO_ANSWER, MISSING, VIOLATED = range(7)
INTERRUPTED = 130

_PLOT_SUFFIXES = (".png", ".pdf", ".svg")


class _Duration(click.ParamType):  # type: ignore[type-arg]  # generic in recent versions of click only
    """Seconds as a number, or a number with a unit such as ``2min``."""

    name = "duration"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        try:
            return float(value)
        except ValueError:
            from ..instances.tables import NUMBER, TIMES

        match = re.fullmatch(r"(.*[0-9.])\s*([^\W\d]+)", value.strip())
        if match and NUMBER.fullmatch(match[1]) and match[2] in TIMES:
            return float(match[1]) * TIMES[match[2]]
        raise click.BadParameter(
            f"{value!r} is not a duration: write seconds, or a number with one of the units "
            f"{', '.join(TIMES)}, such as 500ms, 10s, 2min or 1.5h",
            ctx,
            param,
        )


DURATION = _Duration()


def _pairs(context: click.Context, parameter: click.Parameter, value: Sequence[str]) -> Any:
    return pairs(value, parameter.opts[0])


def _columns(
    context: click.Context, parameter: click.Parameter, value: Sequence[str]
) -> dict[str, str] | None:
    """Return the map of columns; a comma separates entries if another name and = follow."""
    entries = [entry for text in value for entry in re.split(r",(?=[^,=]+=)", text)]
    bad = next((entry for entry in entries if not all(entry.partition("=")[::2])), None)
    if bad is not None:
        raise click.BadParameter(f"{bad!r} is not NAME=COLUMN", param_hint="--columns")
    result: dict[str, str] = {}
    for name, _, column in (entry.partition("=") for entry in entries):
        if result.setdefault(name, column) != column:
            raise click.BadParameter(f"{name!r} is given twice", param_hint="--columns")
    return result or None


def _criterion(context: click.Context, parameter: click.Parameter, value: Sequence[str]) -> Any:
    """Return the stopping criterion in options such as ``stalled=5``; None without any."""
    from ..solvers import Evaluations, Seconds, Stalled, Target

    kinds: dict[str, Any] = {
        "seconds": Seconds,
        "evaluations": Evaluations,
        "target": Target,
        "stalled": Stalled,
    }
    criterion: Any = None
    for text in value:
        [(kind, limit)] = _pairs(context, parameter, [text]).items()
        if kind not in kinds:
            known = ", ".join(kinds)
            raise click.BadParameter(f"{kind!r} is unknown; known: {known}", param_hint="--stop")
        if kind in ("seconds", "stalled") and isinstance(limit, str):
            limit = DURATION.convert(limit, parameter, context)
        part = kinds[kind](limit)
        criterion = part if criterion is None else criterion | part
    return criterion


#: Options shared by several commands, by the names of the parameters that receive them.
_OPTIONS: dict[str, dict[str, Any]] = {
    "backend": {
        "default": "auto",
        "show_default": True,
        "help": "A name from 'crosstrack backends'.",
    },
    "formulation": {"help": "Formulation for backends that take programs."},
    "time_limit": {
        "type": DURATION,
        "help": "Wall-clock seconds for a run, with building and compiling, or a duration such as 2min.",
    },
    "memory_limit": {"type": float, "help": "Memory limit of a run in MiB, at least 64 (Linux)."},
    "gap": {"type": float, "help": "Relative gap at which an exact backend may stop."},
    "tolerance": {
        "type": float,
        "help": "Largest violation accepted, relative to each constraint's scale (default: 1e-6).",
    },
    "seed": {"type": int, "help": "Seed of backends that use random numbers."},
    "threads": {"type": int, "help": "Number of threads, for backends that use several."},
    "evaluations": {"type": int, "help": "Limit of evaluations, for backends that count them."},
    "target": {"type": float, "help": "Stop at a plan with this objective or a better one."},
    "stop": {
        "multiple": True,
        "metavar": "KIND=VALUE",
        "callback": _criterion,
        "help": "Stop at seconds=S, evaluations=N, target=OBJECTIVE or stalled=S; the first of several.",
    },
    "warm_start": {"metavar": "PLAN.json", "help": "A plan to start from; verified first."},
    "starts": {"type": int, "help": "Number of starts with different seeds (default: 1)."},
    "verbose": {"is_flag": True, "help": "Show the solver's own log on standard error."},
    "backend_options": {
        "flag": "--option",
        "multiple": True,
        "metavar": "KEY=VALUE",
        "callback": _pairs,
        "help": "An option of the backend.",
    },
    "formulation_options": {
        "flag": "--formulation-option",
        "multiple": True,
        "metavar": "KEY=VALUE",
        "callback": _pairs,
        "help": "An option of the formulation.",
    },
    "workers": {
        "type": int,
        "default": 1,
        "show_default": True,
        "help": "Number of parallel jobs.",
    },
    "jsonl": {
        "metavar": "FILE",
        "help": "Append each answer to FILE when it arrives, one JSON line per answer.",
    },
    "resume": {"is_flag": True, "help": "Continue FILE and run only the missing jobs."},
    "in_process": {
        "is_flag": True,
        "help": "Run solvers in this process; a solver that crashes then ends the command.",
    },
    "plot": {"metavar": "FILE", "help": "Write a picture of the plan (png, pdf, svg)."},
    "details": {
        "is_flag": True,
        "help": "Show the details of the plan row by row, such as the errors at each stop, if the "
        "model provides them, and the refinement of its program.",
    },
    "data": {
        "multiple": True,
        "metavar": "KEY=VALUE",
        "callback": _pairs,
        "help": "A value that the file of INSTANCE lacks, such as vehicles=3.",
    },
    "model": {
        "flag": ("--as", "--model"),
        "metavar": "KIND",
        "help": "Kind of model that the file of INSTANCE becomes, if several fit.",
    },
    "columns": {
        "multiple": True,
        "metavar": "NAME=COLUMN,…",
        "callback": _columns,
        "help": "Names in a CSV or Excel file of columns that have other names there, such as "
        "x=Easting,y=Northing.",
    },
    "encoding": {
        "help": "Encoding of a CSV file that is neither UTF-8 nor UTF-16, such as windows-1252."
    },
    "sheet": {"help": "Name or number of the sheet of an Excel file."},
    "missing": {
        "type": click.Choice(["interpolate"]),
        "help": "Interpolate missing cells of samples over time; by default they are errors.",
    },
    "trusted": {
        "is_flag": True,
        "help": "Trust the author of INSTANCE: read functions in CasADi's text format, which can run "
        "code.",
    },
    "folder": {
        "metavar": "FOLDER",
        "help": "Folder of files that INSTANCE refers to, in addition to its own folder.",
    },
}
#: Limits of one run, under the names that the verbs use.
LIMITS = (
    *("time_limit", "memory_limit", "evaluations", "target", "gap", "tolerance", "seed", "threads"),
    *("stop", "warm_start", "starts", "verbose"),
)


def options(*names: str, **changes: Mapping[str, Any] | str) -> Callable[[Command], Command]:
    """Return a decorator that adds shared options to a command.

    Parameters
    ----------
    *names : str
        Options as declared.
    **changes : str or mapping
        Options with another help, or with other parameters of :func:`click.option`.
    """

    def decorate(command: Command) -> Command:
        for name in reversed([*names, *changes]):
            change = changes.get(name, {})
            settings = {
                "flag": f"--{name.replace('_', '-')}",
                **_OPTIONS[name],
                **({"help": change} if isinstance(change, str) else change),
            }
            flag = settings.pop("flag")
            flags = (flag,) if isinstance(flag, str) else flag
            command = click.option(*flags, name, **settings)(command)
        return command

    return decorate


def as_json(command: Command) -> Command:
    """Add ``--json``, which reserves standard output for the JSON document."""
    option = click.option("--json", "as_json", is_flag=True, help="Only JSON on standard output.")
    result: Command = option(reserved()(command))
    return result


def reading(command: Command) -> Command:
    """Add the options for reading an instance file; the command receives them as ``reading``."""
    names = ("data", "columns", "encoding", "sheet", "missing", "model", "trusted", "folder")

    @functools.wraps(command)
    def wrapper(**arguments: Any) -> Any:
        return command(reading={name: arguments.pop(name) for name in names}, **arguments)

    return options(*names)(wrapper)


def pairs(values: Sequence[str], option: str) -> dict[str, Any]:
    """Return ``KEY=VALUE`` options as a mapping; values that are valid JSON are decoded."""
    result: dict[str, Any] = {}
    for value in values:
        key, sign, text = value.partition("=")
        if not sign or not key:
            raise click.BadParameter(f"{value!r} is not KEY=VALUE", param_hint=option)
        if key in result:
            raise click.BadParameter(f"{key!r} is given twice", param_hint=option)
        try:
            result[key] = json.loads(text)
        except json.JSONDecodeError:
            result[key] = text
    return result


def select(what: str, patterns: Sequence[str], names: Iterable[str]) -> list[str]:
    """Return the names that match a glob in `patterns`, each once.

    Parameters
    ----------
    what : str
        Kind of the objects for the message, such as ``"instance"``.
    patterns : sequence of str
        Names or globs; empty for all names.
    names : iterable of str
        The names to choose from.

    Raises
    ------
    UnknownName
        A pattern matches no name; the message suggests similar names or groups such as ``fleet/*``.
    """
    known = [*names]
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in known):
            groups = {f"{name.partition('/')[0]}/*" for name in known if "/" in name}
            raise UnknownName(what, pattern, groups if "*" in pattern and groups else known)
    return [x for x in known if not patterns or any(fnmatchcase(x, p) for p in patterns)]


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
    return verdict_code(result.outcome, result.interrupted)


def verdict_code(outcome: Any, interrupted: bool) -> int:
    """Return the exit code for the outcome of a comparison or of the records of a campaign."""
    if interrupted:
        return INTERRUPTED
    return {"AGREED": VERIFIED, "CONTRADICTION": VIOLATED}.get(str(outcome), NO_ANSWER)
