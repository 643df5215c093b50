"""Command line: parse the arguments, call the public functions and print the result.

Exit codes: 0 verified; 1 internal error; 2 usage, bad data, or an output that
cannot be written; 3 proven infeasible or unbounded;
4 no answer within limits, or an inconclusive comparison; 5 backend missing or broken; 6 verification
failed, or the backends contradict each other; 130 interrupted, with the incumbent returned.
"""

from __future__ import annotations

import contextlib
import errno
import importlib
import shutil
import sys
import traceback
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NoReturn, cast

import click

from .cli.options import INTERNAL, INTERRUPTED, MISSING, USAGE, VERIFIED
from .errors import BackendBroken, BackendMissing, CrosstrackError, InvalidData, WorkerFailure
from .solvers.report.terminal import discard, emit, prepare, reserve, say
from .version import __version__

#: Error numbers of a write to a full disk or a closed stream.
_UNWRITABLE = {getattr(errno, name) for name in ("EBADF", "EDQUOT", "EFBIG", "EIO", "ENOSPC")}

#: Module in `cli` that defines each command.
_HOMES = {
    "backends": "lists",
    "models": "lists",
    "instances": "lists",
    "solve": "runs",
    "compare": "runs",
    "bench": "bench",
    "report": "bench",
    "front": "runs",
    "check": "plans",
    "show": "plans",
    "export": "plans",
    "diagnose": "plans",
    "reproduce": "runs",
    "train": "training",
    "compile": "kernels",
    "demo": "demo",
}


class _Help(click.HelpFormatter):
    """Formatter of help pages that puts descriptions below the options on narrow terminals."""

    def write_dl(
        self, rows: Iterable[tuple[str, str]], col_max: int = 30, col_spacing: int = 2
    ) -> None:
        super().write_dl(rows, col_max if self.width >= 60 else 2, col_spacing)


class _Context(click.Context):
    formatter_class = _Help


class _Commands(Mapping[str, click.Command]):
    """Mapping of command names to commands, imported at first use."""

    def __getitem__(self, name: str) -> click.Command:
        home = importlib.import_module(f".cli.{_HOMES[name]}", __package__)
        command = cast(click.Command, getattr(home, name))
        command.context_class = _Context
        return command

    def __iter__(self) -> Iterator[str]:
        return iter(_HOMES)

    def __len__(self) -> int:
        return len(_HOMES)


@click.group(
    commands=cast(Any, _Commands()), context_settings={"help_option_names": ["-h", "--help"]}
)
@click.version_option(__version__, prog_name="crosstrack")
def cli() -> None:
    """Declare planning problems, solve them with any backend, cross-check every answer.

    INSTANCE is a catalogue name such as error-correction/7, a JSON file, a CSV or Excel file with
    --data for what it lacks, or a program in a file (.mps, .lp, .nl, .qplib, .cbf, .mat, .npz, also .gz).
    """


cli.context_class = _Context


def fail(code: int, error: BaseException, as_json: bool) -> NoReturn:
    """Report `error` on standard error, and as JSON on standard output if requested, and exit."""
    message = error.format_message() if isinstance(error, click.ClickException) else str(error)
    if as_json:
        field = getattr(error, "field", None)
        with contextlib.suppress(InvalidData):  # standard error receives the message as well
            emit({"error": {"type": type(error).__name__, "message": message, "field": field}})
    if isinstance(error, click.ClickException):
        error.show()
    else:
        say(f"error: {message}")
    sys.exit(code)


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit with its code."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    as_json = "--json" in arguments
    prepare()
    reserve()
    try:
        # click's default width is at least 50 columns, even on narrower terminals.
        width = min(shutil.get_terminal_size().columns, 80) - 2
        code = cli.main(
            arguments, prog_name="crosstrack", standalone_mode=False, terminal_width=width
        )
    except click.ClickException as error:
        fail(USAGE, error, as_json)
    except (BackendMissing, BackendBroken) as error:
        fail(MISSING, error, as_json)
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("crosstrack"):
            _report_bug(error, as_json)
        missing = f"{error}: 'pip install crosstrack' brings all that crosstrack needs"
        fail(MISSING, BackendMissing(missing), as_json)
    except WorkerFailure as error:
        fail(INTERNAL, error, as_json)
    except CrosstrackError as error:
        fail(USAGE, error, as_json)
    except (KeyboardInterrupt, click.Abort):
        fail(INTERRUPTED, KeyboardInterrupt("interrupted"), as_json)
    except OSError as error:  # click's own output; other writes raise InvalidData
        if error.errno not in _UNWRITABLE:
            _report_bug(error, as_json)
        discard(sys.stdout)
        say(f"error: cannot write: {error.strerror}")
        sys.exit(USAGE)
    except Exception as error:
        _report_bug(error, as_json)
    sys.exit(code if isinstance(code, int) else VERIFIED)


def _report_bug(error: Exception, as_json: bool) -> NoReturn:
    traceback.print_exc()
    fail(INTERNAL, RuntimeError(f"internal error: {type(error).__name__}: {error}"), as_json)


if __name__ == "__main__":
    main()
