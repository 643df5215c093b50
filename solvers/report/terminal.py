"""Output to a terminal or a pipe: tables and JSON to standard output, the rest to standard error."""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from typing import Any, TextIO

from ...errors import InvalidData
from .fitting import legible

__all__ = [
    "discard",
    "emit",
    "fold",
    "prepare",
    "progress",
    "reserve",
    "reserved",
    "say",
    "show",
    "write",
]

#: Stream for answers while a command runs, else None.
_answers: TextIO | None = None


def reserve() -> None:
    """Redirect the standard output of native code to standard error, for the whole process."""
    from ..processes.output import Diverted

    if sys.stdout is sys.__stdout__:
        with contextlib.suppress(OSError):  # one of the two is closed
            Diverted(2)


@contextmanager
def reserved() -> Iterator[None]:
    """Reserve standard output for answers; other output within the block goes to standard error."""
    global _answers
    before, _answers = _answers, sys.stdout
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        _answers = before


@contextmanager
def _writing() -> Iterator[TextIO]:
    """Yield the stream for answers; raise ``InvalidData`` if it is full, closed or a broken pipe."""
    out = _answers or sys.stdout
    try:
        yield out
        out.flush()  # a write error must be raised here, not when Python ends
    except OSError as error:
        discard(out)
        raise InvalidData(
            f"standard output cannot be written: {error.strerror}", field="standard output"
        ) from None


def show(*parts: Any) -> None:
    """Print tables and text to standard output, with colours on a terminal only.

    Parameters
    ----------
    *parts : FittedTable or str
        Parts to print.
    """
    from rich.console import Console

    class Whole(Console):
        def on_broken_pipe(self) -> None:
            raise  # the error being handled; rich would end the process with code 1

    # A pipe has no width. Without one, rich would fold tables at 80 columns.
    with _writing() as out:
        console = Whole(file=out, width=None if out.isatty() else 160, highlight=False)
        for part in parts:
            words = isinstance(part, str)
            if words:
                part = legible(part)
                if out.isatty():
                    part = fold(part, console.width)
            console.print(part, markup=False, soft_wrap=words)


def fold(text: str, width: int) -> str:
    """Return `text` in lines of at most `width` characters, if its words and numbers allow it.

    Lines end at a space, or at the hyphen between two numbers of a route, whereas a terminal would
    break them anywhere.

    Parameters
    ----------
    text : str
        The text.
    width : int
        Characters per line.
    """
    lines: list[str] = []
    for line in text.split("\n"):
        lines.append("")
        for word in re.split(r"(?<=\S )|(?<=[0-9]-)(?=[0-9])", line):
            if lines[-1].strip() and len(lines[-1] + word.rstrip()) > width:
                lines.append("")
            lines[-1] += word
    return "\n".join(line.rstrip() for line in lines)


def emit(data: Any) -> None:
    """Print JSON to standard output, with escapes for characters that its encoding lacks."""
    text = json.dumps(data, indent=2, allow_nan=False, ensure_ascii=False)
    try:
        text.encode((_answers or sys.stdout).encoding or "utf-8")
    except UnicodeEncodeError:
        text = json.dumps(data, indent=2, allow_nan=False)
    write(text + "\n")


def write(text: str) -> None:
    """Print text to standard output without changes."""
    with _writing() as out:
        out.write(text)


def say(text: str) -> None:
    """Print a message to standard error; an error of the stream is ignored."""
    try:
        sys.stderr.write(legible(text) + "\n")
        sys.stderr.flush()
    except OSError:
        discard(sys.stderr)


def prepare() -> None:
    """Make the standard streams usable even if they are closed or have a small character set."""
    for descriptor, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            # The next opened file would get the closed descriptor, and printing would write into it.
            # Standard output must fail when written to, so it is opened for reading.
            how = os.O_RDONLY if name == "stdout" else os.O_RDWR
            os.set_inheritable(os.open(os.devnull, how), True)
            mode = "r" if name == "stdin" else "w"
            setattr(sys, name, os.fdopen(descriptor, mode, closefd=False))
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


def discard(stream: TextIO) -> None:
    """Redirect `stream` to the null device, so that Python does not fail at exit on unwritten data."""
    with contextlib.suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


@contextmanager
def progress(text: str) -> Iterator[Callable[[str], None]]:
    """Show a spinner on standard error during the block, on a terminal only.

    Yields a function that appends a text to the spinner's line.
    """
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console

    console = Console(stderr=True)

    def line(words: str) -> str:
        return legible(words)[: console.width - 4]  # a second line would flicker

    with console.status(line(text)) as status:
        yield lambda news: status.update(line(f"{text} {news}"))
