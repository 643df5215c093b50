"""Which column and row of the program stands for what."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...programs.blocks import Block
from ..definition import Definition, Phase, Quantity
from ..piecewise import Piecewise
from .mesh import Mesh
from .schemes import Scheme

__all__ = ["Layout", "PhaseLayout"]

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class PhaseLayout:
    """Places of one phase.

    Columns stand state by state, control by control; then integrals, t0 and tf. A *visit* is one
    interval's look at one of its collocated points; where neighbours share a point, the interval
    before owns its path constraints.

    Parameters
    ----------
    phase : Phase
        What is declared.
    number : int
        The phase's number, from 1.
    mesh : Mesh
        Its intervals.
    schemes : tuple of Scheme
        One an interval.
    first : int
        Its first column.
    """

    phase: Phase
    number: int
    mesh: Mesh
    schemes: tuple[Scheme, ...]
    first: int

    # -- points and visits -----------------------------------------------------------------------

    @cached_property
    def starts(self) -> Whole:
        """The first point of each interval, and the last of all, (intervals + 1,)."""
        return np.concatenate([[0], np.cumsum([s.points.size - 1 for s in self.schemes])])

    @property
    def points(self) -> int:
        """Number of points with a state."""
        return int(self.starts[-1]) + 1

    @cached_property
    def visit_interval(self) -> Whole:
        """The interval of each visit."""
        sizes = [s.collocated.size for s in self.schemes]
        return np.repeat(np.arange(len(self.schemes)), sizes)

    @cached_property
    def visit_starts(self) -> Whole:
        """The first visit of each interval, and their number."""
        return np.concatenate([[0], np.cumsum([s.collocated.size for s in self.schemes])])

    @property
    def visits(self) -> int:
        """Number of visits."""
        return int(self.visit_starts[-1])

    @cached_property
    def visit_point(self) -> Whole:
        """The point of each visit."""
        return np.concatenate(
            [self.starts[k] + s.collocated for k, s in enumerate(self.schemes)]
        ).astype(np.int64)

    @cached_property
    def visit_control(self) -> Whole:
        """The control of each visit: collocated points counted once."""
        _, place = np.unique(self.visit_point, return_inverse=True)
        return place.reshape(-1).astype(np.int64)

    @cached_property
    def owners(self) -> Whole:
        """The visit that owns each collocated point, in order of the points."""
        _, first = np.unique(self.visit_point, return_index=True)
        return first.astype(np.int64)

    @property
    def collocated(self) -> int:
        """Number of points with a control."""
        return int(self.owners.size)

    def _within(self, tau: Sequence[Floats]) -> Floats:
        f = self.mesh.fractions
        parts = [f[k] + 0.5 * (t + 1.0) * (f[k + 1] - f[k]) for k, t in enumerate(tau)]
        return np.concatenate(parts)

    @cached_property
    def point_fractions(self) -> Floats:
        """Fraction of the phase at which each point lies."""
        inner = self._within([s.points[:-1] for s in self.schemes])
        return np.append(inner, 1.0)

    @cached_property
    def visit_places(self) -> Floats:
        """Fraction of each visit, and that which its interval covers, (2, visits)."""
        sigma = self._within([s.control_points for s in self.schemes])
        return np.vstack([sigma, np.diff(self.mesh.fractions)[self.visit_interval]])

    @cached_property
    def visit_ends(self) -> NDArray[np.bool_]:
        """Whether each visit is to its interval's end, where that is collocated for it alone."""
        ends = [(s.control_points == 1.0) & (not s.shared) for s in self.schemes]
        return np.concatenate(ends)

    # -- columns ---------------------------------------------------------------------------------

    @property
    def nx(self) -> int:
        """Number of states."""
        return len(self.phase.state_names)

    @property
    def nu(self) -> int:
        """Number of controls."""
        return len(self.phase.control_names)

    @property
    def paths(self) -> int:
        """Number of path expressions."""
        return sum(one.size for one in self.phase.paths)

    @cached_property
    def state_columns(self) -> Whole:
        """Columns of the states, (states, points)."""
        return self.first + np.arange(self.nx * self.points).reshape(self.nx, self.points)

    @cached_property
    def control_columns(self) -> Whole:
        """Columns of the controls, (controls, collocated)."""
        begin = self.first + self.nx * self.points
        return begin + np.arange(self.nu * self.collocated).reshape(self.nu, self.collocated)

    @cached_property
    def integral_columns(self) -> Whole:
        """Columns of the integrals."""
        begin = self.first + self.nx * self.points + self.nu * self.collocated
        return begin + np.arange(self.phase.integrals)

    @cached_property
    def time_columns(self) -> Whole:
        """Columns of t0 and tf."""
        begin = self.first + self.nx * self.points + self.nu * self.collocated
        return begin + self.phase.integrals + np.arange(2)

    @property
    def size(self) -> int:
        """Number of columns."""
        return self.nx * self.points + self.nu * self.collocated + self.phase.integrals + 2

    @cached_property
    def end_columns(self) -> Whole:
        """Columns that the endpoint function sees of this phase: t0, tf, x0, xf, integrals."""
        x = self.state_columns
        return np.concatenate([self.time_columns, x[:, 0], x[:, -1], self.integral_columns])

    # -- rows ------------------------------------------------------------------------------------

    @cached_property
    def row_starts(self) -> Whole:
        """The first defect of each interval, for one state, and their number."""
        return np.concatenate([[0], np.cumsum([s.left.shape[0] for s in self.schemes])])

    @property
    def defects(self) -> int:
        """Number of defects of one state."""
        return int(self.row_starts[-1])

    # -- words -----------------------------------------------------------------------------------

    def costates(self, duals: Floats, knots: Floats) -> Piecewise | None:
        """Return the costates that the multipliers of the defects give; None if a scheme has none.

        Parameters
        ----------
        duals : ndarray, shape (defects, nx)
            Multipliers of the rows.
        knots : ndarray, shape (intervals + 1,)
            Times at which intervals begin and end.
        """
        nodes, values = [], []
        for k, scheme in enumerate(self.schemes):
            part = scheme.costates(duals[self.row_starts[k] : self.row_starts[k + 1]])
            if part is None:
                return None
            nodes.append(part[0])
            values.append(part[1])
        return Piecewise(knots, tuple(nodes), tuple(values))

    def _at(self, points: Whole, interval: Whole | None = None) -> Whole:
        """Return phase, interval and node of points, of the interval that begins there if any."""
        if interval is None:
            found = np.searchsorted(self.starts, points, side="right") - 1
            interval = np.minimum(found, len(self.schemes) - 1)
        number = np.full(points.size, self.number)
        return np.stack([number, interval + 1, points - self.starts[interval]], axis=1)

    def _at_owners(self) -> Whole:
        return self._at(self.visit_point[self.owners], self.visit_interval[self.owners])

    def column_blocks(self, several: bool) -> list[Block]:
        """Return the blocks of the phase's columns; names carry the phase where there are several."""
        of, template = _words(self.phase.name, several)
        blocks, at = [], self.first

        def add(name: str, size: int, index: Whole | None, unit: str) -> None:
            nonlocal at
            blocks.append(
                Block(name + of, "", at, size, "" if index is None else template, index, unit)
            )
            at += size

        units = _units(self.phase.states), _units(self.phase.controls)
        for name, unit in zip(self.phase.state_names, units[0], strict=True):
            add(name, self.points, self._at(np.arange(self.points)), unit)
        for name, unit in zip(self.phase.control_names, units[1], strict=True):
            add(name, self.collocated, self._at_owners(), unit)
        for k in range(self.phase.integrals):
            add(f"integral {k + 1}", 1, None, "")
        add("start time", 1, None, self.phase.time_unit)
        add("end time", 1, None, self.phase.time_unit)
        return blocks

    def row_blocks(self, first: int, several: bool) -> list[Block]:
        """Return the blocks of the phase's rows, which begin at row `first`."""
        of, template = _words(self.phase.name, several)
        blocks, at = [], first
        interval = np.repeat(np.arange(len(self.schemes)), np.diff(self.row_starts))
        row = np.concatenate([np.arange(s.left.shape[0]) for s in self.schemes])
        table = np.stack([np.full(row.size, self.number), interval + 1, row + 1], axis=1)
        units = _units(self.phase.states)
        for name, unit in zip(self.phase.state_names, units, strict=True):
            blocks.append(
                Block(
                    f"dynamics of {name}{of}", self.phase.dynamics_equation, at, self.defects,
                    template, table, unit,
                )
            )  # fmt: skip
            at += self.defects
        for path in self.phase.paths:
            own = self._at_owners()
            index = np.vstack(
                [np.column_stack([own, np.full(len(own), k)]) for k in range(path.size)]
            )
            words = f"entry {{3}} {template}" if path.size > 1 else template
            blocks.append(
                Block(path.name + of, path.equation, at, index.shape[0], words, index, path.unit)
            )
            at += index.shape[0]
        for k in range(self.phase.integrals):
            blocks.append(Block(f"definition of integral {k + 1}{of}", "", at, 1))
            at += 1
        return blocks


def _words(name: str, several: bool) -> tuple[str, str]:
    of = f" of {name}" if several else ""
    return of, "in interval {1}, node {2}"


def _units(quantities: Sequence[Quantity]) -> list[str]:
    units: list[str] = []
    for one in quantities:
        units += [one.unit] * one.size
    return units


@dataclass(frozen=True, eq=False)
class Layout:
    """Places of the whole program.

    Parameters
    ----------
    definition : Definition
        What is declared.
    phases : tuple of PhaseLayout
        The phases, one after the other; the parameters come last.
    """

    definition: Definition
    phases: tuple[PhaseLayout, ...]

    @classmethod
    def of(
        cls,
        definition: Definition,
        meshes: Sequence[Mesh],
        schemes: Sequence[tuple[Scheme, ...]],
    ) -> Layout:
        """Return the layout of `definition` on `meshes`."""
        found: list[PhaseLayout] = []
        first = 0
        for number, (phase, mesh, own) in enumerate(
            zip(definition.phases, meshes, schemes, strict=True), start=1
        ):
            found.append(PhaseLayout(phase, number, mesh, own, first))
            first += found[-1].size
        return cls(definition, tuple(found))

    @cached_property
    def parameter_columns(self) -> Whole:
        """Columns of the parameters."""
        begin = self.phases[-1].first + self.phases[-1].size
        return begin + np.arange(len(self.definition.parameter_names))

    def visit_columns(self, number: int) -> Whole:
        """Return the columns that a phase's node functions see, x, u, T and p: (…, visits)."""
        one = self.phases[number]
        shared = np.concatenate([one.time_columns, self.parameter_columns])
        parts = [
            one.state_columns[:, one.visit_point],
            one.control_columns[:, one.visit_control].reshape(one.nu, one.visits),
            np.repeat(shared[:, None], one.visits, axis=1),
        ]
        return np.concatenate(parts)

    @property
    def size(self) -> int:
        """Number of columns."""
        return self.phases[-1].first + self.phases[-1].size + self.parameter_columns.size

    @cached_property
    def end_columns(self) -> Whole:
        """Columns that the endpoint function sees: the ends of all phases, then parameters."""
        return np.concatenate([*(one.end_columns for one in self.phases), self.parameter_columns])
