"""How a paper's tables are set beside our own runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

__all__ = ["Column", "PaperTable", "PaperTables"]


@dataclass(frozen=True)
class Column:
    """One of our runs, beside one of the paper's columns.

    Parameters
    ----------
    backend : str
        The backend, ``"name:formulation"`` for one on a certain formulation.
    published : str
        Key of the paper's seconds that stand beside it; empty where there are none.
    warm : bool
        Whether the run starts from the best plan of the runs before it.
    """

    backend: str
    published: str = ""
    warm: bool = False


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
    """

    title: str
    columns: tuple[Column, ...]
    tolerance: float | None = None


@dataclass(frozen=True)
class PaperTables:
    """The tables of a paper that are reproduced.

    Parameters
    ----------
    tables : mapping of int to PaperTable
        By the number that the catalogue's published figures name as ``"table"``.
    note : str
        What to mind when figures are compared.
    """

    tables: Mapping[int, PaperTable]
    note: str
