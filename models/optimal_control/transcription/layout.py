"""Assignment of the program's columns and rows to states, controls and equations."""

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
    """Columns, points and rows of one phase.

    Columns are ordered state by state and control by control, followed by integrals, t0 and tf. A
    *visit* is the use of one collocated point by one interval. If neighbours share a point, the
    first interval owns its path constraints.

    Parameters
    ----------
    phase : Phase
        Declaration.
    number : int
        Number of the phase, from 1.
    mesh : Mesh
        Intervals.
    schemes : tuple of Scheme
        One scheme per interval.
    first : int
        First column of the phase.
    """

    phase: Phase
    number: int
    mesh: Mesh
    schemes: tuple[Scheme, ...]
    first: int

    # -- points and visits -----------------------------------------------------------------------

    @cached_property
    def starts(self) -> Whole:
        """First point of each interval, and the last point of all, shape (intervals + 1,)."""
        return np.concatenate([[0], np.cumsum([s.points.size - 1 for s in self.schemes])])

    @property
    def points(self) -> int:
        """Number of points with a state."""
        return int(self.starts[-1]) + 1

    @cached_property
    def visit_interval(self) -> Whole:
        """Interval of each visit."""
        sizes = [s.collocated.size for s in self.schemes]
        return np.repeat(np.arange(len(self.schemes)), sizes)

    @cached_property
    def visit_starts(self) -> Whole:
        """First visit of each interval, and the number of visits, shape (intervals + 1,)."""
        return np.concatenate([[0], np.cumsum([s.collocated.size for s in self.schemes])])

    @property
    def visits(self) -> int:
        """Number of visits."""
        return int(self.visit_starts[-1])

    @cached_property
    def visit_point(self) -> Whole:
        """Point of each visit."""
        return np.concatenate(
            [self.starts[k] + s.collocated for k, s in enumerate(self.schemes)]
        ).astype(np.int64)

    @cached_property
    def visit_control(self) -> Whole:
        """Control of each visit, with shared points counted once."""
        _, place = np.unique(self.visit_point, return_inverse=True)
        return place.reshape(-1).astype(np.int64)

    @cached_property
    def owners(self) -> Whole:
        """Visit that owns each collocated point, in the order of the points."""
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
        """Fraction of the phase at each point."""
        inner = self._within([s.points[:-1] for s in self.schemes])
        return np.append(inner, 1.0)

    @cached_property
    def visit_places(self) -> Floats:
        """Fraction of the phase at each visit, and length of its interval, shape (2, visits)."""
        sigma = self._within([s.control_points for s in self.schemes])
        return np.vstack([sigma, np.diff(self.mesh.fractions)[self.visit_interval]])

    @cached_property
    def visit_ends(self) -> NDArray[np.bool_]:
        """Whether each visit is at its interval's end, if only that interval collocates it."""
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
        return sum(path.size for path in self.phase.paths)

    @cached_property
    def state_columns(self) -> Whole:
        """Columns of the states, shape (states, points)."""
        return self.first + np.arange(self.nx * self.points).reshape(self.nx, self.points)

    @cached_property
    def control_columns(self) -> Whole:
        """Columns of the controls, shape (controls, collocated)."""
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
        """Columns of this phase in the endpoint vector: t0, tf, x0, xf, integrals."""
        x = self.state_columns
        return np.concatenate([self.time_columns, x[:, 0], x[:, -1], self.integral_columns])

    # -- rows ------------------------------------------------------------------------------------

    @cached_property
    def row_starts(self) -> Whole:
        """First defect of each interval for one state, and the number of defects."""
        return np.concatenate([[0], np.cumsum([s.left.shape[0] for s in self.schemes])])

    @property
    def defects(self) -> int:
        """Number of defects of one state."""
        return int(self.row_starts[-1])

    # -- words -----------------------------------------------------------------------------------

    def costates(self, duals: Floats, knots: Floats) -> Piecewise | None:
        """Return the costates from the multipliers of the defects; None if a scheme has no mapping.

        Parameters
        ----------
        duals : ndarray, shape (defects, nx)
            Multipliers of the rows.
        knots : ndarray, shape (intervals + 1,)
            Times of the ends of intervals.
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
        """Return phase, interval and node of points; by default of the interval that begins there."""
        if interval is None:
            index = np.searchsorted(self.starts, points, side="right") - 1
            interval = np.minimum(index, len(self.schemes) - 1)
        number = np.full(points.size, self.number)
        return np.stack([number, interval + 1, points - self.starts[interval]], axis=1)

    def _at_owners(self) -> Whole:
        return self._at(self.visit_point[self.owners], self.visit_interval[self.owners])

    def column_blocks(self, several: bool) -> list[Block]:
        """Return the blocks of the phase's columns, with the phase's name if there are several."""
        of, template = _suffix_and_template(self.phase.name, several)
        blocks, start = [], self.first

        def add(name: str, size: int, index: Whole | None, unit: str) -> None:
            nonlocal start
            blocks.append(
                Block(name + of, "", start, size, "" if index is None else template, index, unit)
            )
            start += size

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
        of, template = _suffix_and_template(self.phase.name, several)
        blocks, start = [], first
        interval = np.repeat(np.arange(len(self.schemes)), np.diff(self.row_starts))
        row = np.concatenate([np.arange(s.left.shape[0]) for s in self.schemes])
        table = np.stack([np.full(row.size, self.number), interval + 1, row + 1], axis=1)
        units = _units(self.phase.states)
        for name, unit in zip(self.phase.state_names, units, strict=True):
            blocks.append(
                Block(
                    f"dynamics of {name}{of}", self.phase.dynamics_equation, start, self.defects,
                    template, table, unit,
                )
            )  # fmt: skip
            start += self.defects
        for path in self.phase.paths:
            places = self._at_owners()
            index = np.vstack(
                [np.column_stack([places, np.full(len(places), k)]) for k in range(path.size)]
            )
            place_template = f"entry {{3}} {template}" if path.size > 1 else template
            blocks.append(
                Block(
                    path.name + of,
                    path.equation,
                    start,
                    index.shape[0],
                    place_template,
                    index,
                    path.unit,
                )
            )
            start += index.shape[0]
        for k in range(self.phase.integrals):
            blocks.append(Block(f"definition of integral {k + 1}{of}", "", start, 1))
            start += 1
        return blocks


def _suffix_and_template(name: str, several: bool) -> tuple[str, str]:
    of = f" of {name}" if several else ""
    return of, "in interval {1}, node {2}"


def _units(quantities: Sequence[Quantity]) -> list[str]:
    units: list[str] = []
    for quantity in quantities:
        units += [quantity.unit] * quantity.size
    return units


@dataclass(frozen=True, eq=False)
class Layout:
    """Columns and rows of the whole program.

    Parameters
    ----------
    definition : Definition
        Definition of the problem.
    phases : tuple of PhaseLayout
        Phases in order; the parameters come last.
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
        result: list[PhaseLayout] = []
        first = 0
        for number, (phase, mesh, schemes_of) in enumerate(
            zip(definition.phases, meshes, schemes, strict=True), start=1
        ):
            result.append(PhaseLayout(phase, number, mesh, schemes_of, first))
            first += result[-1].size
        return cls(definition, tuple(result))

    @cached_property
    def parameter_columns(self) -> Whole:
        """Columns of the parameters."""
        begin = self.phases[-1].first + self.phases[-1].size
        return begin + np.arange(len(self.definition.parameter_names))

    def visit_columns(self, number: int) -> Whole:
        """Return the columns of a phase's node functions, x, u, T and p, shape (…, visits)."""
        phase = self.phases[number]
        shared = np.concatenate([phase.time_columns, self.parameter_columns])
        parts = [
            phase.state_columns[:, phase.visit_point],
            phase.control_columns[:, phase.visit_control].reshape(phase.nu, phase.visits),
            np.repeat(shared[:, None], phase.visits, axis=1),
        ]
        return np.concatenate(parts)

    @property
    def size(self) -> int:
        """Number of columns."""
        return self.phases[-1].first + self.phases[-1].size + self.parameter_columns.size

    @cached_property
    def end_columns(self) -> Whole:
        """Columns of the endpoint vector: the ends of all phases, then the parameters."""
        return np.concatenate(
            [*(phase.end_columns for phase in self.phases), self.parameter_columns]
        )
