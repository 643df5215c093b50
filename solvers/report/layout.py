"""How a paper's tables are set beside our own runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

__all__ = ["Column", "PaperTable", "PaperTables"]


@dataclass(frozen=True)
class Column:
    """One of our runs, beside one of the paper's columns.

    Parameters
    ----------
    backend : str
        The backend, ``"name:formulation"`` for one on a certain formulation.
    published : str
        Key of the paper's seconds that stand beside it, or of its figure; empty where there is none.
    warm : bool
        Whether the run starts from the best plan of the runs before it.
    options : mapping
        The backend's own options; two columns of one backend differ by them.
    figure : str
        What is shown alone: ``"objective"``, or an attribute of the plan such as ``"exponent.value"``. Empty
        shows the seconds of a proof, else the objective and its seconds.
    """

    backend: str
    published: str = ""
    warm: bool = False
    options: Mapping[str, Any] = field(default_factory=dict)
    figure: str = ""

    @property
    def label(self) -> str:
        """What stands above it: the backend, its formulation, its options, and the figure."""
        options = (f"{name}={value}" for name, value in self.options.items())
        shown = self.figure.removesuffix(".value").rpartition(".")[2]
        figure = [shown.replace("_", " ")] if shown not in ("", "objective") else []
        return "\n".join([*self.backend.split(":"), *options, *figure])


@dataclass(frozen=True)
class PaperTable:
    """One table of a paper.

    Parameters
    ----------
    title : str
        What the table is called.
    columns : tuple of Column
        Our runs.
    tolerance : float, optional
        The tolerance that they are asked for.
    repeats : int
        How often each backend that draws runs on each row, from different seeds; medians are shown.
    known : str
        Whose the published optimum is.
    """

    title: str
    columns: tuple[Column, ...]
    tolerance: float | None = None
    repeats: int = 1
    known: str = "paper"


@dataclass(frozen=True)
class PaperTables:
    """The tables of a paper that are reproduced.

    Parameters
    ----------
    tables : mapping of int to PaperTable
        By the number that the catalogue's published figures name as ``"table"``. Where these have
        ``"evaluations"``, a list of whole numbers, there is a row for each, whose runs are granted as many.
    note : str
        What to mind when figures are compared.
    """

    tables: Mapping[int, PaperTable]
    note: str
