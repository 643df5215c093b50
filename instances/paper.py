"""Declarations of a paper's contents and of their status in the code.

Each problem declares its paper in ``instances/<problem>/paper.py``: every equation, algorithm, parameter table
and figure with data as an :class:`Item` with a status, and every result table with its printed cells as a
:class:`ResultTable`. The section "As printed" of the problem's page and the page of all papers are generated
from these declarations.
"""

from __future__ import annotations

import functools
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Protocol

from ..errors import InvalidData, UnknownName
from ..models.problems import resolve, table

__all__ = [
    "Item",
    "Paper",
    "ResultTable",
    "Run",
    "Status",
    "Trials",
    "corrected",
    "different",
    "measurement",
    "paper_of",
    "papers",
    "printed",
]

#: A cell: a number, a text such as "no real robot", or None for an empty cell.
Cell = float | int | str | None


class Status(StrEnum):
    """How the code relates to an item of a paper."""

    #: The code does what the paper prints.
    AS_PRINTED = "as printed"
    #: The print contains an error; the item's reason derives the correction.
    CORRECTED = "corrected"
    #: The code differs deliberately, or the content is not available; the item's reason explains it.
    DIFFERENT = "different"


@dataclass(frozen=True)
class Item:
    """One equation, algorithm, parameter or figure of a paper.

    Parameters
    ----------
    label : str
        The paper's label, such as ``"eq. 16"`` or ``"Algorithm 3, lines 5-11"``.
    about : str
        Its content in a few words.
    code : str
        The function or class that implements it, ``"models.fleet.checks:objective_of"``.
    status : Status
        How the code relates to the print.
    reason : str
        The derivation of a correction, or the reason for a difference with its effect on the results.

    Raises
    ------
    InvalidData
        A text is empty, `code` is not of the form ``module:object``, or a correction or difference has no reason.
    """

    label: str
    about: str
    code: str
    status: Status
    reason: str = ""

    def __post_init__(self) -> None:
        for name in ("label", "about"):
            if not getattr(self, name).strip():
                raise InvalidData(f"{name} must not be empty", field=name)
        module, _, name = self.code.partition(":")
        if not module or not name:
            raise InvalidData(f"code must be 'module:object', got {self.code!r}", field="code")
        if self.status is not Status.AS_PRINTED and not self.reason.strip():
            raise InvalidData(
                f"item {self.label!r} is {self.status}, so it needs a reason", field="reason"
            )

    @property
    def target(self) -> str:
        """The absolute name of the code, ``"crosstrack.models.fleet.checks:objective_of"``."""
        return f"{__name__.partition('.')[0]}.{self.code}"


def printed(label: str, about: str, code: str, reason: str = "") -> Item:
    """Return an item that the code implements as printed; `reason` names the reading of an ambiguous print."""
    return Item(label, about, code, Status.AS_PRINTED, reason)


def corrected(label: str, about: str, code: str, reason: str) -> Item:
    """Return an item with a misprint; `reason` derives the correction."""
    return Item(label, about, code, Status.CORRECTED, reason)


def different(label: str, about: str, code: str, reason: str) -> Item:
    """Return an item that the code implements differently; `reason` explains why and states the effect."""
    return Item(label, about, code, Status.DIFFERENT, reason)


@dataclass(frozen=True)
class ResultTable:
    """A result table of a paper, with its printed cells.

    Parameters
    ----------
    name : str
        Name in commands and measured files, such as ``"table-2"``.
    title : str
        The title shown above it.
    keys : tuple of str
        Heads of the leading cells, which identify a row.
    columns : mapping of str to str
        The printed columns and the format of their numbers, such as ``".1f"``.
    rows : mapping
        The printed cells of each row by its key, one per column; None if the paper leaves the cell empty.
    ours : mapping of str to str
        Further columns that only we have, such as a proven bound or the number of runs.
    note : str
        A remark for readers who compare the figures.

    Raises
    ------
    InvalidData
        A row has too few or too many cells, or a column name occurs twice.
    """

    name: str
    title: str
    keys: tuple[str, ...]
    columns: Mapping[str, str]
    rows: Mapping[tuple[str, ...], Sequence[Cell]]
    ours: Mapping[str, str] = field(default_factory=dict)
    note: str = ""

    def __post_init__(self) -> None:
        names = Counter([*self.keys, *self.columns, *self.ours])
        if max(names.values()) > 1:
            raise InvalidData(
                f"columns of {self.name!r} must have different names, got {list(names.elements())}",
                field="columns",
            )
        for key, cells in self.rows.items():
            if len(key) != len(self.keys) or len(cells) != len(self.columns):
                raise InvalidData(
                    f"row {key} of {self.name!r} must have {len(self.keys)} keys and {len(self.columns)} "
                    f"cells, got {len(key)} and {len(cells)}",
                    field="rows",
                )

    @property
    def printed_cells(self) -> int:
        """Number of cells that the paper prints."""
        return sum(cell is not None for cells in self.rows.values() for cell in cells)

    @property
    def heads(self) -> dict[str, str]:
        """The heads of the table with both values of each printed cell, and the format of each column."""
        pairs = {
            f"{name}{end}": form for name, form in self.columns.items() for end in (", paper", "")
        }
        return {**dict.fromkeys(self.keys, ""), **pairs, **self.ours}

    def cells(self, key: tuple[str, ...], values: Mapping[str, Any]) -> list[Cell]:
        """Return one row with both values of each printed cell, in the order of :attr:`heads`.

        Parameters
        ----------
        key : tuple of str
            The row.
        values : mapping
            Our values by column, as :meth:`check_values` accepts them.
        """
        pairs = zip(self.rows[key], self.columns, strict=True)
        both = [cell for paper, name in pairs for cell in (paper, values.get(name))]
        return [*key, *both, *(values.get(name) for name in self.ours)]

    def check_values(self, key: tuple[str, ...], values: Mapping[str, Any]) -> dict[str, Cell]:
        """Return our values of one row as plain numbers and texts.

        Raises
        ------
        InvalidData
            A column does not exist, or a value is neither a finite number nor a text.
        """
        unknown = [name for name in values if name not in (*self.columns, *self.ours)]
        if unknown:
            raise InvalidData(
                f"row {key} of {self.name!r} has no column {unknown[0]!r}", field=unknown[0]
            )
        plain: dict[str, Cell] = {}
        for name, value in values.items():
            cell = value.item() if hasattr(value, "item") else value
            if isinstance(cell, bool) or not isinstance(cell, float | int | str | None):
                raise InvalidData(
                    f"{name!r} of row {key} must be a number or a text, got {value!r}", field=name
                )
            if isinstance(cell, float) and not abs(cell) < float("inf"):
                raise InvalidData(
                    f"{name!r} of row {key} must be finite, got {value!r}", field=name
                )
            plain[name] = cell
        return plain


@dataclass(frozen=True)
class Paper:
    """A paper, or the part of it that belongs to one problem.

    Parameters
    ----------
    name : str
        Short name, equal for all parts of one paper.
    reference : str
        The citation.
    items : tuple of Item
        Equations, algorithms, parameters and figures.
    tables : tuple of ResultTable
        Result tables.

    Raises
    ------
    InvalidData
        Two items have the same label, or two tables the same name.
    """

    name: str
    reference: str
    items: tuple[Item, ...] = ()
    tables: tuple[ResultTable, ...] = ()

    def __post_init__(self) -> None:
        for kind, names in (
            ("items", [item.label for item in self.items]),
            ("tables", [result.name for result in self.tables]),
        ):
            for name, count in Counter(names).items():
                if count > 1:
                    raise InvalidData(f"{kind} has {name!r} {count} times", field=kind)

    @property
    def counts(self) -> dict[Status, int]:
        """Number of items by status."""
        counts = Counter(item.status for item in self.items)
        return {status: counts[status] for status in Status}

    def table(self, name: str) -> ResultTable:
        """Return the result table `name`.

        Raises
        ------
        UnknownName
            The paper has no such table.
        """
        known = {item.name: item for item in self.tables}
        if name not in known:
            raise UnknownName("table", name, known)
        return known[name]


class Run(Protocol):
    """The answer of one run, as measuring functions see it; see :class:`~crosstrack.solvers.Solution`."""

    @property
    def plan(self) -> Any: ...
    @property
    def primal_bound(self) -> float | None: ...
    @property
    def dual_bound(self) -> float | None: ...
    @property
    def termination(self) -> Any: ...
    @property
    def limit(self) -> Any: ...
    @property
    def message(self) -> str: ...
    @property
    def seconds(self) -> Mapping[str, float]: ...
    @property
    def statistics(self) -> Mapping[str, Any]: ...
    @property
    def seed(self) -> int | None: ...


class Trials(Protocol):
    """The runs behind a result table; :class:`crosstrack.solvers.report.trials.RecordedTrials` implements it."""

    @property
    def runs(self) -> int:
        """Number of runs per cell, from different seeds."""
        ...

    @property
    def time_limit(self) -> float | None:
        """Seconds for each run."""
        ...

    @property
    def seed(self) -> int:
        """The first seed."""
        ...

    def run(
        self,
        model: Any,
        backend: str,
        *,
        runs: int | None = None,
        time_limit: float | None = None,
        options: Mapping[str, Any] | None = None,
        **limits: Any,
    ) -> Sequence[Run]:
        """Run a backend and return one answer per seed, for one model or for several models in turn.

        Parameters
        ----------
        model : Model or sequence of Model
            The models to solve. Several models in one call share the start of the worker process.
        backend : str
            Name of the backend, ``"name:formulation"`` for a certain formulation.
        runs : int, optional
            Number of runs instead of :attr:`runs`; a deterministic backend runs once.
        time_limit : float, optional
            Seconds instead of :attr:`time_limit`.
        options : mapping, optional
            Options of the backend.
        **limits
            Further limits of :func:`crosstrack.compare`, such as ``evaluations`` or ``tolerance``.
        """
        ...


#: Returns our values of one row of a result table, by column.
Measurement = Callable[[tuple[str, ...], Trials], Mapping[str, Any]]

_ROOM = __package__


def papers() -> dict[str, Paper]:
    """Return the declared papers by problem, such as ``"fleet-mission"``."""
    return {problem: resolve(target) for problem, target in table(_ROOM, "PAPERS").items()}


def paper_of(problem: str) -> Paper:
    """Return the paper of a problem.

    Raises
    ------
    UnknownName
        The problem declares no paper.
    """
    known = table(_ROOM, "PAPERS")
    if problem not in known:
        raise UnknownName("problem to reproduce", problem, known)
    paper: Paper = resolve(known[problem])
    return paper


@functools.cache
def measurement(problem: str, name: str) -> Measurement:
    """Return the function that measures the rows of result table `name` of `problem`.

    Raises
    ------
    UnknownName
        The problem declares no measuring function for this table.
    """
    known = table(_ROOM, "PAPER_TABLES")
    if f"{problem}/{name}" not in known:
        raise UnknownName("table to measure", f"{problem}/{name}", known)
    function: Measurement = resolve(known[f"{problem}/{name}"])
    return function
