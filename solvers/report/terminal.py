"""Writing to a terminal or a pipe: tables and JSON to standard output, all else to standard error."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

__all__ = ["emit", "progress", "say", "show"]


def show(*parts: Any) -> None:
    """Print tables and text to standard output, with colours on a terminal only."""
    from rich.console import Console

    # A pipe has no width of its own: tables must not fold at 80 columns there.
    console = Console(width=None if sys.stdout.isatty() else 160, highlight=False)
    for part in parts:
        console.print(part, markup=False, soft_wrap=isinstance(part, str))


def emit(data: Any) -> None:
    """Print JSON to standard output."""
    sys.stdout.write(json.dumps(data, indent=2, allow_nan=False, ensure_ascii=False) + "\n")


def say(text: str) -> None:
    """Print a message to standard error."""
    sys.stderr.write(text + "\n")


@contextmanager
def progress(text: str) -> Iterator[Callable[[str], None]]:
    """Show a spinner on standard error while something runs, on a terminal only."""
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console

    with Console(stderr=True).status(text) as status:
        yield lambda news: status.update(f"{text} {news}")
