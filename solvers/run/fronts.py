"""Result of :func:`crosstrack.front`: the non-dominated plans of two objectives."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from ...models.model import Model
from ...models.verification import stated
from ..contract.solution import Solution
from ..report.fitting import FittedTable
from ..report.tables import Printable, number, seconds_text, table

__all__ = ["EQUAL", "Front", "FrontPoint", "gathered"]

#: Relative difference below which objectives are equal.
EQUAL = 1e-9


@dataclass(frozen=True)
class FrontPoint:
    """One plan of a front.

    Parameters
    ----------
    objective : float
        Objective of the model, or the first of two objectives that a sweep compares.
    second : float
        The second objective.
    limit : float, optional
        Upper limit on the second objective in the run; None for no limit. In a sweep, the value
        of the field.
    solution : Solution
        The verified answer.
    proven : bool
        Whether the objective is proven minimal within the limit, up to the gap.
    """

    objective: float
    second: float
    limit: float | None
    solution: Solution[Any] = field(repr=False)
    proven: bool

    def dominates(self, other: FrontPoint) -> bool:
        """Return True if this point is at least as good in both objectives and better in one."""
        return self._no_worse(other) and not other._no_worse(self)

    def equals(self, other: FrontPoint) -> bool:
        """Return True if both objectives are equal up to rounding."""
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
class Front(Printable):
    """Result of :func:`front` and :func:`sweep`. Printing it shows a table.

    Parameters
    ----------
    model : Model
        The model.
    second : str
        Name of the second objective.
    points : tuple of FrontPoint
        Non-dominated plans, sorted by decreasing second objective.
    dominated : tuple of FrontPoint
        Plans that another plan dominates.
    repeated : tuple of FrontPoint
        Plans that equal one of `points` in both objectives.
    unsolved : tuple of Solution
        Solutions of the runs that ended without a plan.
    field : str
        Name of the field that was limited, or varied by a sweep.
    interrupted : bool
        Whether Ctrl-C ended the runs. Finished runs are included.
    first : str
        First objective of a sweep; empty for the model's own objective.
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
        """Solutions of all points."""
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
        """Return the printable parts: a table of the points, and the end of the other runs."""
        states = (("", self.points), ("dominated", self.dominated), ("repeated", self.repeated))
        shown = sorted(
            ((item, state) for state, points in states for item in points),
            key=lambda pair: (-pair[0].second, pair[0].objective),
        )
        title = f"{self.model.name or self.model.kind}: objective and {self.second}"
        parts: list[Any] = [_table(title, self.field, self.second, shown, swept=bool(self.first))]
        for item in self.unsolved:
            parts.append(
                f"{item.instance or item.model}: {item.termination}"
                f"{f', {item.limit}' if item.limit else ''}"
            )
        if self.interrupted:
            parts.append("interrupted: missing points were not run")
        return parts


def _table(
    title: str, name: str, second: str, rows: Iterable[tuple[FrontPoint, str]], *, swept: bool
) -> FittedTable:
    cells = [
        (
            "" if point.limit is None else number(point.limit),
            number(stated(point.objective, point.solution.maximise and not swept)),
            number(point.second),
            ""
            if point.solution.gap is None
            else f"{point.solution.gap:.1e}"
            if point.solution.gap
            else "0",
            point.solution.backend,
            seconds_text(point.solution.seconds.get("total")),
            ", ".join(word for word in ("proven" if point.proven else "", state) if word),
        )
        for point, state in rows
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
    """Return the front of all plans found.

    Parameters
    ----------
    model : Model
        The model.
    second, name : str
        The second objective, and the field that was limited or varied.
    found : sequence of FrontPoint
        One point per plan.
    answers : sequence of Solution
        Solutions of all runs.
    interrupted : bool
        Whether runs are missing.
    first : str
        First objective of a sweep; empty for the model's own objective.
    """
    efficient: list[FrontPoint] = []
    removed: list[FrontPoint] = []
    same: list[FrontPoint] = []
    # Proven points come first among equal ones, so they are the ones that stay.
    for point in sorted(
        found, key=lambda point: (-point.second, point.objective, not point.proven)
    ):
        if any(other.dominates(point) for other in found):
            removed.append(point)
        elif any(point.equals(other) for other in efficient):
            same.append(point)
        else:
            efficient.append(point)
    unsolved = tuple(answer for answer in answers if answer.plan is None)
    return Front(
        model,
        second,
        tuple(efficient),
        tuple(removed),
        tuple(same),
        unsolved,
        name,
        interrupted,
        first,
    )
