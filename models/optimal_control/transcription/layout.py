"""Assignment of the program's columns and rows to states, controls and equations."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.polynomial import legendre
from numpy.typing import NDArray

from ...programs.blocks import Block
from ...programs.triplets import Triplets
from ..algebraic import algebraic_entries
from ..definition import Definition, Phase, entry_units
from ..lagrange import interpolation
from ..piecewise import Piecewise
from ..plan import PhasePlan
from ..sizes import Sizes
from .mesh import Mesh
from .report import BINDING
from .schemes import Scheme

__all__ = ["Layout", "PhaseLayout", "stack_blocks"]

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]

#: Place of a row or column from its index: phase, interval and node.
_PLACE = "in interval {1}, node {2}"

#: Number of values of a control per interval that determine a line. On the first mesh of penicillin the
#: objective is -88.1038 with 20 values, and -88.0899 with those at the 5 nodes.
FITTED = 20


class PhaseLayout:
    """Columns, points and rows of one phase.

    Columns are ordered state by state and control by control, followed by integrals, t0 and tf. A
    *visit* is the use of one collocated point by one interval. If neighbours share a point, the
    first interval owns its path constraints. `number` counts the phases from 1, and `first` is the
    first column of the phase.
    """

    def __init__(
        self, phase: Phase, number: int, mesh: Mesh, schemes: tuple[Scheme, ...], first: int
    ) -> None:
        self.phase, self.number, self.mesh, self.schemes = phase, number, mesh, schemes
        self.first = first
        self.nx, self.nu = len(phase.state_names), len(phase.control_names)
        #: Controls that may be kept calm: all but algebraic variables, which their equations determine.
        self.calmable = np.delete(np.arange(self.nu), algebraic_entries(phase.controls))
        #: Controls with a finite bound.
        self.bounded = np.flatnonzero(np.isfinite(phase.bounds("controls")).any(axis=0))
        #: Number of path expressions.
        self.paths = sum(path.size for path in phase.paths)

        # First point, visit and defect of each interval, and the last point or the number of all.
        self.starts = _starts(s.points.size - 1 for s in schemes)
        self.visit_starts = _starts(s.collocated.size for s in schemes)
        self.row_starts = _starts(s.left.shape[0] for s in schemes)
        #: Numbers of points with a state, of visits, and of defects of one state.
        self.points = int(self.starts[-1]) + 1
        self.visits = int(self.visit_starts[-1])
        self.defects = int(self.row_starts[-1])

        #: Interval and point of each visit.
        self.visit_interval = np.repeat(np.arange(len(schemes)), np.diff(self.visit_starts))
        local = np.concatenate([s.collocated for s in schemes])
        self.visit_point = self.starts[self.visit_interval] + local
        #: Visit that owns each collocated point, and control of each visit, in the order of the points.
        _, self.owners, control = np.unique(
            self.visit_point, return_index=True, return_inverse=True
        )
        self.visit_control = control.reshape(-1)
        #: Number of points with a control.
        self.collocated = int(self.owners.size)
        #: Number of rows: defects, path constraints, integrals and states at interior instants.
        self.rows = self.nx * self.defects + self.paths * self.collocated + phase.integrals
        self.rows += self.nx * len(phase.instants)
        #: Whether each visit is at its interval's end, if only that interval collocates it.
        self.visit_ends = np.concatenate(
            [(s.control_points == 1.0) & (not s.shared) for s in schemes]
        )
        #: Fraction of the phase at each point.
        self.point_fractions = np.append(self._within([s.points[:-1] for s in schemes]), 1.0)
        #: Fraction of the phase at each visit, and length of its interval, shape (2, visits).
        self.visit_places = np.vstack(
            [
                self._within([s.control_points for s in schemes]),
                np.diff(mesh.fractions)[self.visit_interval],
            ]
        )

        # Columns, with the shapes (states, points), (controls, collocated) and (instants, states).
        inner = self.nx * len(phase.instants)
        parts = self.nx * self.points, self.nu * self.collocated, phase.integrals, 2, inner
        cuts = first + np.cumsum(parts)
        x, u, self.integral_columns, self.time_columns, at = np.split(
            np.arange(first, cuts[-1]), cuts[:-1] - first
        )
        self.instant_columns = at.reshape(-1, self.nx)
        self.state_columns = x.reshape(self.nx, self.points)
        self.control_columns = u.reshape(self.nu, self.collocated)
        #: Number of columns.
        self.size = sum(parts)
        #: Columns of this phase in the endpoint vector: t0, tf, x0, xf, integrals, states at instants.
        self.end_columns = np.concatenate(
            [
                self.time_columns,
                self.state_columns[:, 0],
                self.state_columns[:, -1],
                self.integral_columns,
                at,
            ]
        )

    @cached_property
    def instants(self) -> list[tuple[slice, slice, Floats, Floats]]:
        """Points, visits and coefficients of X and (h / 2) F in the states at each interior instant."""
        result, f = [], self.mesh.fractions
        for place in self.phase.instants:
            k = int(np.searchsorted(f[1:-1], place, side="right"))
            tau = np.clip(2.0 * (place - f[k]) / (f[k + 1] - f[k]) - 1.0, -1.0, 1.0)
            scheme = self.schemes[k]
            shares = interpolation(scheme.plan_points, tau)[0]
            points = slice(self.starts[k], self.starts[k + 1] + 1)
            visits = slice(self.visit_starts[k], self.visit_starts[k + 1])
            result.append((points, visits, shares @ scheme.from_states, shares @ scheme.from_rates))
        return result

    def state_tables(self, x: Floats, rates: Floats | None) -> Iterator[Floats]:
        """Yield the states at the plan's nodes of each interval.

        `x` are the states at the points, and `rates` those at the visits, one row each; None if no scheme
        uses them.
        """
        for k, scheme in enumerate(self.schemes):
            table = scheme.from_states @ x[self.starts[k] : self.starts[k + 1] + 1]
            if rates is not None:
                visits = slice(self.visit_starts[k], self.visit_starts[k + 1])
                table = table + scheme.from_rates @ rates[visits]
            yield table

    def _within(self, tau: Sequence[Floats]) -> Floats:
        f = self.mesh.fractions
        parts = [f[k] + 0.5 * (t + 1.0) * (f[k + 1] - f[k]) for k, t in enumerate(tau)]
        return np.concatenate(parts)

    def costates(self, duals: Floats, knots: Floats) -> Piecewise | None:
        """Return the costates from the defects' multipliers, shape (defects, nx).

        None if a scheme has no mapping. `knots` are the times of the ends of intervals.
        """
        parts = []
        for k, scheme in enumerate(self.schemes):
            part = scheme.costates(duals[self.row_starts[k] : self.row_starts[k + 1]])
            if part is None:
                return None
            parts.append(part)
        nodes, values = zip(*parts, strict=True)
        return Piecewise(knots, nodes, values)

    # -- calm controls ---------------------------------------------------------------------------

    def calm_rows(self, size: int) -> sp.csr_array:
        """Return the rows, (…, size), that restrict the controls to half the degree in calm intervals.

        On a singular arc a mesh gains by chattering what the problem itself does not allow. Right-hand sides are 0.
        """
        rows = Triplets()
        count = 0
        for k, many in enumerate(self.mesh.calm_rows.tolist()):
            if not many:
                continue
            scheme = self.schemes[k]
            nodes = scheme.control_points
            table = np.linalg.inv(legendre.legvander(nodes, nodes.size - 1))[-many:]
            controls = self.visit_control[self.visit_starts[k] : self.visit_starts[k + 1]]
            for columns in self.control_columns[self.calmable][:, controls]:
                rows.add(count + np.arange(many)[:, None], columns, table)
                count += many
        r, c, value, _ = rows.joined()
        return sp.csr_array((value, (r, c)), shape=(count, size))

    def edge_rows(self, size: int) -> sp.csr_array:
        """Return the rows with the values of linear controls at ends of intervals that are not collocated.

        Between bounds at the nodes alone, a steep line exceeds them at the ends of its interval.
        """
        rows, count = Triplets(), 0
        for k, scheme in enumerate(self.schemes):
            first, last = nodes = scheme.control_points[[0, -1]]
            for end in (-1.0, 1.0) if self.mesh.linear and first < last else ():
                share = (end - first) / (last - first)
                for column in self.control_columns[self.bounded] if end not in nodes else ():
                    at = column[self.visit_control[self.visit_starts[[k, k + 1]] - [0, 1]]]
                    rows.add(count, at, [1.0 - share, share])
                    count += 1
        r, c, value, _ = rows.joined()
        return sp.csr_array((value, (r, c)), shape=(count, size))

    def fit_lines(self, columns: Floats, part: PhasePlan) -> None:
        """Replace the controls by the lines that fit those of a plan best, because they may chatter."""
        places = np.linspace(-1.0, 1.0, FITTED + 2)[1:-1]
        fit, ends = np.linalg.pinv(legendre.legvander(places, 1)), self.mesh.fractions
        for k, scheme in enumerate(self.schemes):
            at = ends[k] + 0.5 * (places + 1.0) * (ends[k + 1] - ends[k])
            lines = fit @ part.controls(part.start + at * part.duration)[:, self.calmable]
            values = legendre.legvander(scheme.control_points, 1) @ lines
            visits = self.visit_control[self.visit_starts[k] : self.visit_starts[k + 1]]
            columns[self.control_columns[self.calmable[:, None], visits]] = values.T

    # -- names -----------------------------------------------------------------------------------

    def _at(self, points: Whole, interval: Whole) -> Whole:
        """Return phase, interval and node of points."""
        number = np.full(points.size, self.number)
        return np.stack([number, interval + 1, points - self.starts[interval]], axis=1)

    def _at_owners(self) -> Whole:
        return self._at(self.visit_point[self.owners], self.visit_interval[self.owners])

    def column_blocks(self, several: bool) -> list[Block]:
        """Return the blocks of the phase's columns, without their places in the program."""
        points, last = np.arange(self.points), len(self.schemes) - 1
        # At a knot, the interval that begins there.
        interval = np.minimum(np.searchsorted(self.starts, points, side="right") - 1, last)
        of, phase = self.suffix(several), self.phase
        blocks = [
            Block(name + of, "", 0, index.shape[0], _PLACE, index, unit)
            for names, quantities, index in (
                (phase.state_names, phase.states, self._at(points, interval)),
                (phase.control_names, phase.controls, self._at_owners()),
            )
            for name, unit in zip(names, entry_units(quantities), strict=True)
        ]
        blocks += [Block(f"integral {k + 1}{of}", "", 0, 1) for k in range(phase.integrals)]
        blocks += [
            Block(f"{side} time{of}", "", 0, 1, unit=phase.time_unit) for side in ("start", "end")
        ]
        return blocks + self._instant_blocks(f"states at {{}}{of}")

    def _instant_blocks(self, name: str) -> list[Block]:
        names = [name.format(f"fraction {place:g}") for place in self.phase.instants]
        return [Block(name, "", 0, self.nx) for name in names]

    def row_blocks(self, several: bool) -> list[Block]:
        """Return the blocks of the phase's rows, without their places in the program."""
        of, phase = self.suffix(several), self.phase
        interval = np.repeat(np.arange(len(self.schemes)), np.diff(self.row_starts))
        row = np.arange(self.defects) - self.row_starts[interval]
        table = np.stack([np.full(row.size, self.number), interval + 1, row + 1], axis=1)
        equation = phase.dynamics_equation
        blocks = [
            Block(f"dynamics of {name}{of}", equation, 0, self.defects, _PLACE, table, unit)
            for name, unit in zip(phase.state_names, entry_units(phase.states), strict=True)
        ]
        places = self._at_owners()
        for path in phase.paths:
            entry = np.repeat(np.arange(path.size), len(places))
            index = np.column_stack([np.tile(places, (path.size, 1)), entry])
            template = f"entry {{3}} {_PLACE}" if path.size > 1 else _PLACE
            name = path.name + of
            blocks.append(Block(name, path.equation, 0, entry.size, template, index, path.unit))
        blocks += [
            Block(f"definition of integral {k + 1}{of}", "", 0, 1) for k in range(phase.integrals)
        ]
        return blocks + self._instant_blocks(f"definition of states at {{}}{of}")

    def suffix(self, several: bool) -> str:
        """Return the end of the names of this phase's blocks: empty unless there are several phases."""
        return f" of {self.phase.name}" if several else ""


def _starts(sizes: Iterable[int]) -> Whole:
    return np.concatenate([[0], np.cumsum(list(sizes))])


def stack_blocks(start: int, blocks: Iterable[Block]) -> list[Block]:
    """Return the blocks one after the other, beginning at `start`."""
    result = []
    for block in blocks:
        result.append(replace(block, start=start))
        start += block.size
    return result


#: Recent layouts, with which assemblies keep the functions of their programs.
RECENT = 4
_recent: dict[tuple[Any, ...], Layout] = {}


def layout_of(
    definition: Definition, scheme: Callable[[int], Scheme], meshes: Sequence[Mesh]
) -> Layout:
    """Return the layout of a scheme on these meshes; equal to a recent one, the same object."""
    contents = [
        array.tobytes() for mesh in meshes for array in (mesh.fractions, mesh.degrees, mesh.calm)
    ]
    key = definition, scheme, *contents, *(mesh.linear for mesh in meshes)
    layout = _recent.pop(key, None)
    if layout is None:
        layout = Layout(
            definition, meshes, [tuple(scheme(int(n)) for n in m.degrees) for m in meshes]
        )
    _recent[key] = layout
    for oldest in list(_recent)[:-RECENT]:  # a copy, which other threads do not change
        _recent.pop(oldest, None)
    return layout


class Layout:
    """Columns and rows of the whole program: the phases in order, then the parameters.

    There is one mesh per phase, and one scheme per interval.
    """

    def __init__(
        self, definition: Definition, meshes: Sequence[Mesh], schemes: Sequence[tuple[Scheme, ...]]
    ) -> None:
        self.definition = definition
        phases: list[PhaseLayout] = []
        first = 0
        for parts in zip(definition.phases, meshes, schemes, strict=True):
            phase, mesh, schemes_of = parts
            phases.append(PhaseLayout(phase, len(phases) + 1, mesh, schemes_of, first))
            first += phases[-1].size
        self.phases = tuple(phases)
        self.parameter_columns = first + np.arange(len(definition.parameter_names))
        #: Number of columns.
        self.size = first + self.parameter_columns.size
        #: Columns of the endpoint vector: the ends of all phases, then the parameters.
        self.end_columns = np.concatenate(
            [*(phase.end_columns for phase in phases), self.parameter_columns]
        )

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

    def strains(self, sizes: Sizes, duals: Floats | None, point: Floats) -> tuple[Floats, ...]:
        """Return the possible gain of the objective, per interval, if its controls were not kept calm.

        On a singular arc the gain is not real; elsewhere, such as at a jump of a control, the calm rows, the last
        of `duals`, restrict the program. The gain is the sum of the multipliers' magnitudes times the size of the
        control: an upper bound for a convex program whose controls stay within that size, and 0 without
        multipliers. Linear controls that are at a bound in `point` have no gain.
        """
        if duals is None:
            return tuple(np.zeros(phase.mesh.intervals) for phase in self.phases)
        counts = (int(part.mesh.calm_rows.sum()) * part.calmable.size for part in self.phases)
        start = duals.size - sum(counts)
        result: list[Floats] = []
        for part, size in zip(self.phases, sizes.phases, strict=True):
            rows = part.mesh.calm_rows
            calm = size.controls[part.calmable]
            if part.mesh.linear:
                values = point[part.control_columns[part.calmable]][:, part.visit_control].T
                bounds = np.stack(part.phase.bounds("controls"))[:, None, part.calmable]
                near = np.abs(values - bounds) <= BINDING * calm
                calm = calm * ~np.logical_and.reduceat(near, part.visit_starts[:-1], 1).any(axis=0)
            calm = np.broadcast_to(calm, (rows.size, calm.shape[-1]))
            factors = np.concatenate([np.repeat(c, n) for c, n in zip(calm, rows, strict=True)])
            shares = np.abs(duals[start : start + factors.size]) * factors
            start += factors.size
            interval = np.repeat(np.arange(rows.size), rows * part.calmable.size)
            result.append(np.bincount(interval, shares, rows.size).astype(float))
        return tuple(result)
