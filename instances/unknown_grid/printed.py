"""Table VI of the paper as it prints it, for the documentation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .settings import OBSTACLES, STEPS, TASKS

__all__ = ["successes"]


def successes() -> tuple[Sequence[str], list[Sequence[Any]], list[str]]:
    """Return columns, rows and notes of table VI: successes of 100 scenes."""
    rows: list[Sequence[Any]] = [
        (
            number, f"{task.side} × {task.side}", f"{task.view} × {task.view}", name,
            *getattr(task, name.lower()),
        )
        for number, task in TASKS.items()
        for name in ("MCGN", "MACN")
    ]  # fmt: skip
    columns = ("task", "map", "view", "", *(f"{one} obstacles" for one in OBSTACLES))
    notes = [
        f"Successes of 100 scenes; a run has failed after {STEPS} steps.",
        "The paper does not say how its scenes are drawn.",
    ]
    return columns, rows, notes
