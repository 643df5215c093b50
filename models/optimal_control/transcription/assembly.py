"""Nonlinear program of a problem on a mesh, with derivatives in their known structure.

Rows and derivatives are constant sparse matrices applied to the values of the node functions. This
avoids automatic differentiation of the whole program, whose cost would grow with the mesh.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...programs.blocks import Block
from ...programs.nonlinear import NonlinearProgram
from ...programs.triplets import Triplets, dm
from ..sizes import Sizes
from .derivatives import functions_of
from .layout import Layout, stack_blocks

__all__ = ["Assembly"]

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]

#: Shortest duration of a phase with free times, relative to the longest possible one.
SHORTEST = 1e-6


class Assembly:
    """Builder of the program for one layout.

    Parameters
    ----------
    layout : Layout
        Columns and rows of the program.
    sizes : Sizes
        Sizes of all quantities.
    """

    def __init__(self, layout: Layout, sizes: Sizes) -> None:
        self.layout, self.sizes = layout, sizes
        self.definition = layout.definition
        self.functions = functions_of(self.definition)
        #: First row of each phase, then of the boundary constraints.
        self.row_starts = np.cumsum([0, *(phase.rows for phase in layout.phases)]).tolist()
        self.boundaries = self.functions.endpoint.entries - 1
        self.free_lengths = [
            phase for phase in layout.phases if phase.phase.start_upper >= phase.phase.end_lower
        ]
        self.calm = [phase.calm_rows(layout.size) for phase in layout.phases]
        self.row_count = (
            self.row_starts[-1]
            + self.boundaries
            + len(self.free_lengths)
            + sum(rows.shape[0] for rows in self.calm)
        )

    # -- structure -------------------------------------------------------------------------------

    @cached_property
    def _rows(self) -> tuple[sp.csr_array, tuple[sp.csr_array, ...]]:
        """Linear part of the rows, (rows, columns), and coefficients of each phase's node functions.

        The latter multiply the entries of the node functions, visit by visit: (rows, entries × visits).
        """
        linear = Triplets()
        spreads = tuple(self._coefficients(k, linear) for k in range(len(self.layout.phases)))
        row = self.row_starts[-1] + self.boundaries
        for phase in self.free_lengths:
            linear.add(row, phase.time_columns, [-1.0, 1.0])
            row += 1
        for calm in self.calm:
            coo = calm.tocoo()
            linear.add(row + coo.row, coo.col, coo.data)
            row += calm.shape[0]
        r, c, value, _ = linear.joined()
        return sp.csr_array((value, (r, c)), shape=(self.row_count, self.layout.size)), spreads

    def _coefficients(self, number: int, linear: Triplets) -> sp.csr_array:
        """Return the coefficients of a phase's node functions, and add the linear part of its rows."""
        phase, integrals = self.layout.phases[number], self.layout.phases[number].phase.integrals
        first, spread = self.row_starts[number], Triplets()
        states, entries = np.arange(phase.nx), self.functions.nodes[number].entries

        def source(entry: Any, visit: Any) -> Any:
            return np.asarray(visit) * entries + np.asarray(entry)

        for k, scheme in enumerate(phase.schemes):
            begin = first + states[:, None] * phase.defects + phase.row_starts[k]
            r, c = np.nonzero(scheme.left)
            linear.add(begin + r, phase.state_columns[:, phase.starts[k] + c], scheme.left[r, c])
            r, c = np.nonzero(scheme.right)
            places = source(states[:, None], phase.visit_starts[k] + c)
            spread.add(begin + r, 0, -scheme.right[r, c], places)
        row = first + phase.nx * phase.defects
        paths = np.arange(phase.paths)[:, None]
        rows = row + paths * phase.collocated + np.arange(phase.collocated)
        spread.add(rows, 0, 1.0, source(phase.nx + integrals + paths, phase.owners))
        row += phase.paths * phase.collocated
        weights = np.concatenate([scheme.weights for scheme in phase.schemes])
        for k in range(integrals):
            linear.add(row + k, phase.integral_columns[k], 1.0)
            spread.add(row + k, 0, -weights, source(phase.nx + k, np.arange(phase.visits)))
        r, _, factor, place = spread.joined()
        shape = (self.row_count, entries * phase.visits)
        return sp.csr_array((factor, (r, place)), shape=shape)

    # -- functions -------------------------------------------------------------------------------

    def _arguments(self, number: int, x: Any) -> list[Any]:
        """Return the arguments of the node functions of a phase, one column per visit."""
        columns = self.layout.visit_columns(number)
        # CasADi reshapes column by column, that is visit by visit.
        stacked = casadi.reshape(x[columns.T.reshape(-1).tolist()], *columns.shape)
        return [stacked, casadi.DM(self.layout.phases[number].visit_places)]

    def values(self, x: Any) -> tuple[Any, Any]:
        """Return the objective and the rows."""
        ends = self.functions.endpoint.value(x[self.layout.end_columns.tolist()])
        linear, spreads = self._rows
        rows = casadi.mtimes(casadi.MX(dm(linear)), x)
        for number, spread in enumerate(spreads):
            node = self.functions.nodes[number].value
            visits = self.layout.phases[number].visits
            entries = casadi.vec(node.map(visits)(*self._arguments(number, x)))
            rows = rows + casadi.mtimes(casadi.MX(dm(spread)), entries)
        if self.boundaries:
            begin = self.row_starts[-1]
            pad = casadi.MX(casadi.DM(begin, 1))
            after = casadi.MX(casadi.DM(self.row_count - begin - self.boundaries, 1))
            rows = rows + casadi.vertcat(pad, ends[1:], after)
        return ends[0], casadi.densify(rows)

    def first(self, x: Any) -> tuple[Any, Any]:
        """Return the gradient of the objective and the Jacobian of the rows."""
        entries = Triplets()
        linear, spreads = self._rows
        values, count = [], 0
        for number, spread in enumerate(spreads):
            twice = self.functions.nodes[number]
            visits = self.layout.phases[number].visits
            row, column = twice.first_at
            if not row.size:
                continue
            values.append(casadi.vec(twice.first.map(visits)(*self._arguments(number, x))))
            # Nonzeros of the node's Jacobian by entry, repeated for each coefficient in `spread`.
            order = np.argsort(row, kind="stable")
            begins = np.searchsorted(row[order], np.arange(twice.entries + 1))
            coo = spread.tocoo()
            visit, entry = np.divmod(coo.col, twice.entries)
            counts = np.diff(begins)[entry]
            which = np.repeat(np.arange(coo.nnz), counts)
            within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
            nonzero = order[begins[entry[which]] + within]
            entries.add(
                coo.row[which],
                self.layout.visit_columns(number)[column[nonzero], visit[which]],
                coo.data[which],
                count + visit[which] * row.size + nonzero,
            )
            count += row.size * visits
        coo = linear.tocoo()
        entries.add(coo.row, coo.col, coo.data)
        twice = self.functions.endpoint
        row, column = twice.first_at
        values.append(twice.first(x[self.layout.end_columns.tolist()]))
        below = row > 0
        entries.add(
            self.row_starts[-1] + row[below] - 1,
            self.layout.end_columns[column[below]],
            1.0,
            count + np.flatnonzero(below),
        )
        gradient = Triplets()
        gradient.add(
            self.layout.end_columns[column[~below]], 0, 1.0, count + np.flatnonzero(~below)
        )
        count += row.size
        stacked = casadi.vertcat(*values)
        size = self.layout.size
        return (
            casadi.densify(gradient.matrix((size, 1), stacked, count)),
            entries.matrix((self.row_count, size), stacked, count),
        )

    def _second(self, x: Any, scale: Any, duals: Any) -> Any:
        """Return the upper triangle of the Hessian of ``scale f + duals·g``."""
        entries = Triplets()
        parts, count = [], 0
        for number, spread in enumerate(self._rows[1]):
            twice = self.functions.nodes[number]
            visits = self.layout.phases[number].visits
            row, column = twice.second_at
            if not row.size:
                continue
            multipliers = casadi.mtimes(casadi.MX(dm(spread.T)), duals)
            multipliers = casadi.reshape(casadi.densify(multipliers), twice.entries, visits)
            values = twice.second.map(visits)(*self._arguments(number, x), multipliers)
            parts.append(casadi.vec(values))
            local = self.layout.visit_columns(number)
            visit = np.arange(visits)
            entries.add(
                local[row],
                local[column],
                1.0,
                count + visit * row.size + np.arange(row.size)[:, None],
            )
            count += row.size * visits
        twice = self.functions.endpoint
        row, column = twice.second_at
        begin = self.row_starts[-1]
        multipliers = casadi.vertcat(scale, duals[begin : begin + self.boundaries])
        parts.append(twice.second(x[self.layout.end_columns.tolist()], multipliers))
        ends = self.layout.end_columns
        low = np.minimum(ends[row], ends[column])
        high = np.maximum(ends[row], ends[column])
        entries.add(low, high, 1.0, count + np.arange(row.size))
        count += row.size
        size = self.layout.size
        return entries.matrix((size, size), casadi.vertcat(*parts), count)

    # -- the program -----------------------------------------------------------------------------

    def program(self, guess: Floats, name: str) -> NonlinearProgram:
        """Return the program, started at `guess`."""
        size = self.layout.size
        x, scale = casadi.MX.sym("x", size), casadi.MX.sym("lam_f")
        duals = casadi.MX.sym("lam_g", self.row_count)
        value = casadi.Function("program", [x], list(self.values(x)), ["x"], ["f", "g"])
        first = casadi.Function("first", [x], list(self.first(x)), ["x"], ["grad_f", "jac_g"])
        second = casadi.Function(
            "second", [x, scale, duals], [self._second(x, scale, duals)],
            ["x", "lam_f", "lam_g"], ["hess"],
        )  # fmt: skip
        lower, upper, column_scale = self.column_bounds()
        row_lower, row_upper, row_scale = self._row_bounds()
        return NonlinearProgram(
            name=name,
            function=value,
            row_lower=row_lower,
            row_upper=row_upper,
            column_lower=lower,
            column_upper=upper,
            guess=np.clip(guess, lower, upper),
            column_scale=column_scale,
            row_scale=row_scale,
            objective_scale=self.sizes.variation,
            derivatives=first,
            hessian=second,
            columns=self._column_blocks(),
            rows=self._row_blocks(),
        )

    def column_bounds(self) -> tuple[Floats, Floats, Floats]:
        """Return the columns' lower and upper bounds and their typical sizes."""
        size = self.layout.size
        lower, upper, scale = np.full(size, -np.inf), np.full(size, np.inf), np.ones(size)
        for layout, sizes in zip(self.layout.phases, self.sizes.phases, strict=True):
            phase, x = layout.phase, layout.state_columns
            for what, columns in (("states", x), ("controls", layout.control_columns)):
                lower[columns.T], upper[columns.T] = phase.bounds(what)
                scale[columns.T] = getattr(sizes, what)
            for side, end in (("initial", 0), ("final", -1)):
                lower[x[:, end]], upper[x[:, end]] = phase.bounds("states", side)
            times = layout.time_columns
            lower[times] = phase.start_lower, phase.end_lower
            upper[times] = phase.start_upper, phase.end_upper
            scale[times] = sizes.time
            scale[layout.integral_columns] = sizes.integrals
        p = self.layout.parameter_columns
        lower[p], upper[p] = self.definition.bounds("parameters")
        scale[p] = self.sizes.parameters
        return lower, upper, scale

    def _row_bounds(self) -> tuple[Floats, Floats, Floats]:
        parts: list[tuple[Any, Any, Any]] = []  # lower, upper and scale of some rows
        for layout, sizes in zip(self.layout.phases, self.sizes.phases, strict=True):
            paths = (*layout.phase.bounds("paths"), sizes.paths)
            parts.append((0.0, 0.0, np.repeat(sizes.states, layout.defects)))
            parts.append(tuple(np.repeat(part, layout.collocated) for part in paths))  # type: ignore[arg-type]
            parts.append((0.0, 0.0, sizes.integrals))
        boundaries = self.definition.bounds("boundaries")
        parts.append((*boundaries, self.sizes.boundaries))
        for layout in self.free_lengths:
            longest = layout.phase.end_upper - layout.phase.start_lower
            parts.append((SHORTEST * longest, np.inf, np.array([longest])))
        for sizes, rows in zip(self.sizes.phases, self.calm, strict=True):
            # The rows are linear in the controls, so the size of the controls is a sufficient scale.
            size = sizes.controls.max(initial=0.0) or 1.0
            parts.append((0.0, 0.0, np.full(rows.shape[0], size)))
        broadcast = [np.broadcast_arrays(*part) for part in parts]
        lower, upper, scale = (np.concatenate(column) for column in zip(*broadcast, strict=True))
        return lower, upper, scale

    def _column_blocks(self) -> tuple[Block, ...]:
        several = len(self.layout.phases) > 1
        blocks = [b for layout in self.layout.phases for b in layout.column_blocks(several)]
        names = self.definition.parameter_names
        blocks += [Block(f"parameter {name}", "", 0, 1) for name in names]
        return tuple(stack_blocks(0, blocks))

    def _row_blocks(self) -> tuple[Block, ...]:
        several = len(self.layout.phases) > 1
        blocks = [b for layout in self.layout.phases for b in layout.row_blocks(several)]
        blocks += [
            Block(item.name, item.equation, 0, item.size, unit=item.unit)
            for item in self.definition.boundaries
        ]
        for layout in self.free_lengths:
            name, unit = f"time goes forward{layout.suffix(several)}", layout.phase.time_unit
            blocks.append(Block(name, "", 0, 1, unit=unit))
        blocks += [
            Block(f"calm controls{layout.suffix(several)}", "", 0, rows.shape[0])
            for layout, rows in zip(self.layout.phases, self.calm, strict=True)
            if rows.shape[0]
        ]
        return tuple(stack_blocks(0, blocks))
