"""What :func:`crosstrack.front` returns: plans of which none dominates another."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..models.model import Model
from .report.fitting import FittedTable
from .report.tables import markup, number, render, seconds_text, table
from .solution import Solution

__all__ = ["EQUAL", "Front", "FrontPoint", "gathered"]

#: What counts as equal, relative.
EQUAL = 1e-9


@dataclass(frozen=True)
class FrontPoint:
    """One plan of a front.

    Parameters
    ----------
    objective : float
        The model's objective, or the first of two that a sweep compares.
    second : float
        The second objective.
    limit : float, optional
        The limit on the second objective under which the plan was sought; None for none. In a sweep
        the value of the field.
    solution : Solution
        The verified answer.
    proven : bool
        Whether the objective is proven to be the least within the limit, up to the gap asked for.
    """

    objective: float
    second: float
    limit: float | None
    solution: Solution[Any] = field(repr=False)
    proven: bool

    def dominates(self, other: FrontPoint) -> bool:
        """Return whether this is no worse in either objective, and better in one."""
        return self._no_worse(other) and not other._no_worse(self)

    def equals(self, other: FrontPoint) -> bool:
        """Return whether both objectives are equal, rounding aside."""
        return self._no_worse(other) and other._no_worse(self)

    def _no_worse(self, other: FrontPoint) -> bool:
        pairs = ((self.objective, other.objective), (self.second, other.second))
        return all(mine <= its + EQUAL * max(abs(mine), abs(its)) for mine, its in pairs)

    def to_dict(self) -> dict[str, Any]:
        """Return the point as JSON data."""
        return {
            "objective": self.objective,
            "second": self.second,
            "limit": self.limit,
            "proven": self.proven,
            "solution": self.solution.to_dict(),
        }


@dataclass(frozen=True)
class Front:
    """What :func:`front` found; printed, a table.

    Parameters
    ----------
    model : Model
        What was asked.
    second : str
        The second objective.
    points : tuple of FrontPoint
        Plans of which none dominates another, by the second objective from large to small.
    dominated : tuple of FrontPoint
        Plans that were found and are dominated.
    repeated : tuple of FrontPoint
        Plans that equal one of `points` in both objectives.
    unsolved : tuple of Solution
        How the runs under the other limits ended, without a plan.
    field : str
        The field that was limited, or varied by a sweep.
    interrupted : bool
        Whether Ctrl-C ended it; what had been found is there.
    first : str
        The first objective of a sweep; empty where it is the model's own.
    """

    model: Model[Any]
    second: str
    points: tuple[FrontPoint, ...]
    dominated: tuple[FrontPoint, ...] = ()
    repeated: tuple[FrontPoint, ...] = ()
    unsolved: tuple[Solution[Any], ...] = ()
    field: str = ""
    interrupted: bool = False
    first: str = ""

    @property
    def solutions(self) -> tuple[Solution[Any], ...]:
        """The answers of all points."""
        return tuple(point.solution for point in self.points)

    def to_dict(self) -> dict[str, Any]:
        """Return the front as JSON data."""
        return {
            "model": self.model.kind,
            "instance": self.model.name,
            "digest": self.model.digest,
            **({"first": self.first} if self.first else {}),
            "second": self.second,
            "field": self.field,
            "points": [point.to_dict() for point in self.points],
            "dominated": [point.to_dict() for point in self.dominated],
            "repeated": [point.to_dict() for point in self.repeated],
            "unsolved": [solution.to_dict() for solution in self.unsolved],
            "interrupted": self.interrupted,
        }

    def parts(self) -> list[Any]:
        """Return what to print: the points, and how the other runs ended."""
        states = (("", self.points), ("dominated", self.dominated), ("repeated", self.repeated))
        shown = sorted(
            ((one, state) for state, points in states for one in points),
            key=lambda pair: (-pair[0].second, pair[0].objective),
        )
        title = f"{self.model.name or self.model.kind}: objective and {self.second}"
        parts: list[Any] = [_table(title, self.field, self.second, shown)]
        for one in self.unsolved:
            parts.append(
                f"{one.instance or one.model}: {one.termination}"
                f"{f', {one.limit}' if one.limit else ''}"
            )
        if self.interrupted:
            parts.append("interrupted: what is missing was not run")
        return parts

    def summary(self) -> str:
        """Return the points as a table of text."""
        return render(*self.parts(), width=140)

    def __str__(self) -> str:
        return self.summary()

    def _repr_html_(self) -> str:
        return markup(*self.parts())


def _table(
    title: str, name: str, second: str, rows: Iterable[tuple[FrontPoint, str]]
) -> FittedTable:
    cells = [
        (
            "" if one.limit is None else number(one.limit),
            number(one.objective),
            number(one.second),
            ""
            if one.solution.gap is None
            else f"{one.solution.gap:.1e}"
            if one.solution.gap
            else "0",
            one.solution.backend,
            seconds_text(one.solution.seconds.get("total")),
            ", ".join(word for word in ("proven" if one.proven else "", state) if word),
        )
        for one, state in rows
    ]
    columns = (name, "objective", second, "gap", "backend", "total", "state")
    return table(title, columns, cells, right=(name, "objective", second, "gap", "total"))


def gathered(
    model: Model[Any],
    second: str,
    name: str,
    found: Sequence[FrontPoint],
    answers: Sequence[Solution[Any]],
    interrupted: bool,
    first: str = "",
) -> Front:
    """Return the front of all plans that were found.

    Parameters
    ----------
    model : Model
        What was asked.
    second, name : str
        The second objective, and the field that was limited or varied.
    found : sequence of FrontPoint
        One for each plan.
    answers : sequence of Solution
        How all runs ended.
    interrupted : bool
        Whether runs are missing.
    first : str
        The first objective of a sweep.
    """
    kept: list[FrontPoint] = []
    removed: list[FrontPoint] = []
    same: list[FrontPoint] = []
    # Of equal ones the proven one is kept.
    for one in sorted(found, key=lambda one: (-one.second, one.objective, not one.proven)):
        if any(other.dominates(one) for other in found):
            removed.append(one)
        elif any(one.equals(other) for other in kept):
            same.append(one)
        else:
            kept.append(one)
    unsolved = tuple(one for one in answers if one.plan is None)
    return Front(
        model, second, tuple(kept), tuple(removed), tuple(same), unsolved, name, interrupted, first
    )
