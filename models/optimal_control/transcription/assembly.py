"""Nonlinear program of a problem on a mesh, with derivatives in their known structure.

Values and exact derivatives at one instant and at the ends of phases are created once per definition,
in scalar operations, and mapped over the nodes of any mesh. Rows and derivatives of the program are
constant sparse matrices applied to them. On five problems with 8 to 60 intervals, CasADi's own
Jacobian of the whole program took 2.9 to 270 times as long to evaluate, and its own Hessian 1.8 to
2.5 times (``tests/benchmarks/optimal_control/test_derivatives.py``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import casadi
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...programs.blocks import Block
from ...programs.nonlinear import NonlinearProgram
from ...programs.triplets import Triplets, dm
from ..definition import Definition, Phase
from ..sizes import Sizes
from .layout import Layout, stack_blocks

__all__ = ["Assembly", "Twice", "functions_of"]

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]

#: Functions of the programs of recent layouts, which do not depend on sizes and starts.
_FUNCTIONS: WeakKeyDictionary[Layout, tuple[casadi.Function, ...]] = WeakKeyDictionary()
#: Shortest duration of a phase with free times, relative to the longest possible one.
SHORTEST = 1e-6


# -- functions of one instant ------------------------------------------------------------------------


def _symbols(function: casadi.Function) -> Any:
    """Return the kind of symbols with which `function` is fastest."""
    return casadi.SX if function.is_a("SXFunction") else casadi.MX


@dataclass(frozen=True, eq=False)
class Twice:
    """Vector function with its Jacobian and the Hessian of any linear combination of its entries.

    `first` returns the nonzeros of the Jacobian. `second` takes multipliers, too, and returns the
    nonzeros of the Hessian's upper triangle. `jacobian` and `hessian` are their patterns.
    """

    value: casadi.Function
    first: casadi.Function
    second: casadi.Function
    jacobian: casadi.Sparsity
    hessian: casadi.Sparsity

    @property
    def entries(self) -> int:
        """Number of entries."""
        return int(self.value.size1_out(0))


def _differentiate(name: str, free: Any, entries: Any, arguments: list[Any], kind: Any) -> Twice:
    entries = casadi.densify(entries)
    jacobian = casadi.jacobian(entries, free)
    multipliers = kind.sym("multipliers", entries.numel())
    curved: Any = casadi.triu(casadi.hessian(casadi.dot(multipliers, entries), free)[0])
    # Ordered by columns, as CasADi orders nonzeros.
    return Twice(
        casadi.Function(f"{name}_value", arguments, [entries]),
        casadi.Function(f"{name}_first", arguments, [_nonzeros(jacobian, kind)]),
        casadi.Function(f"{name}_second", [*arguments, multipliers], [_nonzeros(curved, kind)]),
        jacobian.sparsity(),
        curved.sparsity(),
    )


def _nonzeros(matrix: Any, kind: Any) -> Any:
    # Indexing a row vector would give a row.
    return casadi.vec(matrix.nz[:]) if matrix.nnz() else kind(0, 1)


def _node_function(phase: Phase, parameters: int) -> Twice:
    """Return the node function of a phase: ``[(h/2) rate; (h/2) integrand; path]``.

    The first argument stacks x, u, ``T = [t0, tf]`` and p. The second is ``[σ, δ]``: the fraction of
    the phase at the instant, and the fraction that its interval covers, so that h = (tf - t0) δ.
    """
    kind = _symbols(phase.function)
    cuts = np.cumsum([0, len(phase.state_names), len(phase.control_names), 2, parameters])
    free, place = kind.sym("free", int(cuts[-1])), kind.sym("place", 2)
    x, u, times, p = casadi.vertsplit(free, cuts.tolist())
    length = times[1] - times[0]
    rate, path, integrand, _ = phase.function(times[0] + length * place[0], x, u, p)
    half = 0.5 * length * place[1]
    entries = casadi.vertcat(half * rate, half * integrand, path)
    return _differentiate("node", free, entries, [free, place], kind)


def _end_function(definition: Definition) -> Twice:
    """Return ``[objective; boundary]`` as a function of the endpoint vector and the parameters."""
    function = definition.endpoint
    kind = _symbols(function)
    free = kind.sym("free", function.size1_in(0) + function.size1_in(1))
    ends, p = casadi.vertsplit(free, [0, function.size1_in(0), free.numel()])
    entries = casadi.vertcat(*function(ends, p))
    return _differentiate("endpoint", free, entries, [free], kind)


class Functions(NamedTuple):
    """All functions of a definition: node functions of the phases, and the endpoint function."""

    nodes: tuple[Twice, ...]
    endpoint: Twice


@lru_cache(maxsize=64)
def functions_of(definition: Definition) -> Functions:
    """Return the functions of `definition`, created at the first call."""
    parameters = len(definition.parameter_names)
    nodes = tuple(_node_function(phase, parameters) for phase in definition.phases)
    return Functions(nodes, _end_function(definition))


# -- the program of a mesh ---------------------------------------------------------------------------


class _Part(NamedTuple):
    """Function of some columns at several points, and its coefficients in the objective and the rows.

    `columns` has the shape (arguments, points), `places` are further arguments, and `spread` has the
    shape (1 + rows, entries × points).
    """

    twice: Twice
    columns: Whole
    places: casadi.DM | None
    spread: casadi.DM

    @property
    def points(self) -> int:
        """Number of points."""
        return int(self.columns.shape[1])

    def arguments(self, x: Any) -> list[Any]:
        """Return the arguments of the functions, one column per point."""
        # CasADi reshapes column by column, that is point by point.
        stacked = casadi.reshape(x[self.columns.T.reshape(-1).tolist()], *self.columns.shape)
        return [stacked] if self.places is None else [stacked, self.places]

    def selection(self, size: int) -> Any:
        """Return the matrix that selects the arguments of all points, (arguments × points, size)."""
        columns = self.columns.T.reshape(-1)
        ones = np.ones(columns.size), (np.arange(columns.size), columns)
        return casadi.MX(dm(sp.csr_array(ones, shape=(columns.size, size))))

    def blocks(self, pattern: casadi.Sparsity, values: Any) -> Any:
        """Return the block-diagonal matrix of the points' matrices with this pattern."""
        return casadi.MX(casadi.diagcat(*[pattern] * self.points), casadi.vec(values))


class Assembly:
    """Builder of the program for one layout and the sizes of all quantities."""

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
        self.edges = [phase.edge_rows(layout.size) for phase in layout.phases]
        self.calm = [phase.calm_rows(layout.size) for phase in layout.phases]
        self.row_count = (
            self.row_starts[-1]
            + self.boundaries
            + len(self.free_lengths)
            + sum(rows.shape[0] for rows in (*self.edges, *self.calm))
        )

    # -- structure -------------------------------------------------------------------------------

    @cached_property
    def _parts(self) -> tuple[casadi.DM, tuple[_Part, ...]]:
        """Linear part of the objective and rows, (1 + rows, columns), and the nonlinear parts."""
        linear, layout = Triplets(), self.layout
        parts = [self._nodes(number, linear) for number in range(len(layout.phases))]
        entries = np.arange(self.boundaries + 1)
        spread = Triplets()
        spread.add(np.where(entries > 0, self.row_starts[-1] + entries, 0), entries, 1.0)
        ends = layout.end_columns[:, None]
        parts.append(_Part(self.functions.endpoint, ends, None, self._matrix(spread, entries.size)))
        row = 1 + self.row_starts[-1] + self.boundaries
        for phase in self.free_lengths:
            linear.add(row, phase.time_columns, [-1.0, 1.0])
            row += 1
        for rows in (*self.edges, *self.calm):
            coo = rows.tocoo()
            linear.add(row + coo.row, coo.col, coo.data)
            row += rows.shape[0]
        return self._matrix(linear, layout.size), tuple(parts)

    def _matrix(self, entries: Triplets, columns: int) -> casadi.DM:
        r, c, value, _ = entries.joined()
        return dm(sp.csr_array((value, (r, c)), shape=(1 + self.row_count, columns)))

    def _nodes(self, number: int, linear: Triplets) -> _Part:
        """Return the node functions of a phase, and add the linear part of its rows."""
        phase, integrals = self.layout.phases[number], self.layout.phases[number].phase.integrals
        first, spread = 1 + self.row_starts[number], Triplets()
        states, node = np.arange(phase.nx), self.functions.nodes[number]

        def source(entry: Any, visit: Any) -> Any:
            return np.asarray(visit) * node.entries + np.asarray(entry)

        for k, scheme in enumerate(phase.schemes):
            begin = first + states[:, None] * phase.defects + phase.row_starts[k]
            r, c = np.nonzero(scheme.left)
            linear.add(begin + r, phase.state_columns[:, phase.starts[k] + c], scheme.left[r, c])
            r, c = np.nonzero(scheme.right)
            places = source(states[:, None], phase.visit_starts[k] + c)
            spread.add(begin + r, places, -scheme.right[r, c])
        row = first + phase.nx * phase.defects
        paths = np.arange(phase.paths)[:, None]
        rows = row + paths * phase.collocated + np.arange(phase.collocated)
        spread.add(rows, source(phase.nx + integrals + paths, phase.owners), 1.0)
        row += phase.paths * phase.collocated
        weights = np.concatenate([scheme.weights for scheme in phase.schemes])
        for k in range(integrals):
            linear.add(row + k, phase.integral_columns[k], 1.0)
            spread.add(row + k, source(phase.nx + k, np.arange(phase.visits)), -weights)
        row += integrals
        for at, instant in zip(phase.instant_columns, phase.instants, strict=True):
            points, visits, of_states, of_rates = instant
            linear.add(row + states, at, 1.0)
            linear.add(row + states[:, None], phase.state_columns[:, points], -of_states)
            if of_rates.any():
                sources = source(states[:, None], np.arange(visits.start, visits.stop))
                spread.add(row + states[:, None], sources, -of_rates)
            row += phase.nx
        columns = self.layout.visit_columns(number)
        matrix = self._matrix(spread, node.entries * phase.visits)
        return _Part(node, columns, casadi.DM(phase.visit_places), matrix)

    # -- functions -------------------------------------------------------------------------------

    def values(self, x: Any) -> tuple[Any, Any]:
        """Return the objective and the rows."""
        linear, parts = self._parts
        total = casadi.mtimes(casadi.MX(linear), x)
        for part in parts:
            entries = part.twice.value.map(part.points)(*part.arguments(x))
            total = total + casadi.mtimes(casadi.MX(part.spread), casadi.vec(entries))
        total = casadi.densify(total)
        return total[0], total[1:]

    def first(self, x: Any) -> tuple[Any, Any]:
        """Return the gradient of the objective and the Jacobian of the rows.

        They are separate expressions, because the gradient, which needs few of the parts, took a third of
        Ipopt's evaluations as the first row of one matrix.
        """
        linear, parts = self._parts
        results = []
        for rows in (slice(0, 1), slice(1, None)):
            total = casadi.MX(linear[rows, :])
            for part in parts:
                if not (spread := part.spread[rows, :]).nnz():
                    continue
                values = part.twice.first.map(part.points)(*part.arguments(x))
                product = casadi.mtimes(casadi.MX(spread), part.blocks(part.twice.jacobian, values))
                total = total + casadi.mtimes(product, part.selection(self.layout.size))
            results.append(total)
        return casadi.densify(results[0].T), results[1]

    def _second(self, x: Any, scale: Any, duals: Any) -> Any:
        """Return the upper triangle of the Hessian of ``scale f + duals·g``."""
        multipliers, total = casadi.vertcat(scale, duals), casadi.MX(*(self.layout.size,) * 2)
        for part in self._parts[1]:
            weights = casadi.densify(casadi.mtimes(casadi.MX(part.spread.T), multipliers))
            weights = casadi.reshape(weights, part.twice.entries, part.points)
            values = part.twice.second.map(part.points)(*part.arguments(x), weights)
            blocks = part.blocks(part.twice.hessian, values)
            if (np.diff(part.columns, axis=0) < 0).any():  # entries may move below the diagonal
                blocks = casadi.triu2symm(blocks)
            selection = part.selection(self.layout.size)
            total = total + casadi.mtimes(casadi.mtimes(selection.T, blocks), selection)
        return casadi.triu(total)

    def _functions(self) -> tuple[casadi.Function, ...]:
        """Return the functions of the program, its first and its second derivatives."""
        x, scale = casadi.MX.sym("x", self.layout.size), casadi.MX.sym("lam_f")
        duals = casadi.MX.sym("lam_g", self.row_count)
        return (
            casadi.Function("program", [x], list(self.values(x)), ["x"], ["f", "g"]),
            casadi.Function("first", [x], list(self.first(x)), ["x"], ["grad_f", "jac_g"]),
            casadi.Function(
                "second", [x, scale, duals], [self._second(x, scale, duals)],
                ["x", "lam_f", "lam_g"], ["hess"],
            ),
        )  # fmt: skip

    # -- the program -----------------------------------------------------------------------------

    def program(self, guess: Floats, name: str) -> NonlinearProgram:
        """Return the program, started at `guess`."""
        if self.layout not in _FUNCTIONS:
            _FUNCTIONS[self.layout] = self._functions()
        value, first, second = _FUNCTIONS[self.layout]
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
            scale[layout.instant_columns] = sizes.states
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
            parts.append((0.0, 0.0, np.tile(sizes.states, len(layout.phase.instants))))
        boundaries = self.definition.bounds("boundaries")
        parts.append((*boundaries, self.sizes.boundaries))
        for layout in self.free_lengths:
            longest = layout.phase.end_upper - layout.phase.start_lower
            parts.append((SHORTEST * longest, np.inf, np.array([longest])))
        for layout, sizes, rows in zip(
            self.layout.phases, self.sizes.phases, self.edges, strict=True
        ):
            values = (*layout.phase.bounds("controls"), sizes.controls)
            parts.append(tuple(np.resize(v[layout.bounded], rows.shape[0]) for v in values))  # type: ignore[arg-type]
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
            Block(f"{name}{layout.suffix(several)}", "", 0, rows.shape[0])
            for name, parts in (("ends of controls", self.edges), ("calm controls", self.calm))
            for layout, rows in zip(self.layout.phases, parts, strict=True)
            if rows.shape[0]
        ]
        return tuple(stack_blocks(0, blocks))
