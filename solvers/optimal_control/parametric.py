"""Transcribed program as a function of its data: free, fixed and given columns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.fields import show
from ...models.optimal_control.lagrange import interpolation
from ...models.optimal_control.model import OptimalControlProblem
from ...models.optimal_control.plan import ControlPlan
from ...models.optimal_control.transcription.base import Transcription
from ...models.programs.nonlinear import NonlinearProgram
from ..nlp.ipopt import NARROW
from ..nlp.quality import descent_by_curvature
from ..nlp.scaled import Scaled

if TYPE_CHECKING:
    import casadi

__all__ = ["Parametric", "Point"]

Floats = NDArray[np.float64]

#: Largest number of columns for which functions are expanded to scalar operations; more fill the memory.
MOST_EXPANDED = 20_000


class Parametric:
    """Program of `formulation` in its free columns z, with the data as CasADi's parameters p.

    Columns with equal bounds are constants. Solvers then have fewer columns and, if times are fixed,
    constant derivatives. Columns, rows and objective are scaled as in
    :class:`~..nlp.scaled.Scaled`, while p has the units of the data. Rows without a free column depend
    on the data alone and are not passed to solvers. `free` and `given` are the indices of the free columns
    and of those of the data, `rows` those of the rows that depend on a free column. `data` maps names to
    quantities, `declared` are their values, and `guess` is the start of a search as z.
    """

    def __init__(self, formulation: Transcription) -> None:
        self.formulation = formulation
        program = formulation.program
        assert isinstance(program, NonlinearProgram)
        self.program, self.scaled = program, Scaled(program)
        layout = formulation.layout
        parameters = layout.definition.parameters
        self.data = {item.name: item for item in parameters if item.given}
        if "warm" in self.data:
            raise InvalidData(
                "data 'warm' cannot be passed to a prepared solver, whose option has this name: rename it",
                field="warm",
            )
        sizes = [item.size for item in parameters]
        self.given = layout.parameter_columns[np.repeat([p.given for p in parameters], sizes) > 0]
        self.declared = program.column_lower[self.given]
        chosen = program.column_lower < program.column_upper
        chosen[self.given] = False
        self.free = np.flatnonzero(chosen)
        row, column = map(np.array, program.first_order.sparsity_out(1).get_triplet())
        self.rows = np.unique(row[chosen[column]])
        self._data_rows = np.setdiff1d(np.arange(program.row_count), self.rows)
        #: Whether functions are expanded to scalar operations, which are several times as fast. Tables and
        #: functions of other libraries have no scalar form.
        self._expands = program.size <= MOST_EXPANDED
        try:
            if self._expands:
                program.function.expand()
        except RuntimeError:
            self._expands = False
        self.guess = self.start(program.guess)

    @property
    def model(self) -> OptimalControlProblem:
        """Problem as declared."""
        return self.formulation.model

    # -- data ------------------------------------------------------------------------------------

    def named(self, values: Floats) -> dict[str, Floats]:
        """Return the entries of all data by name."""
        ends = np.cumsum([quantity.size for quantity in self.data.values()])
        return dict(zip(self.data, np.split(values, ends[:-1]), strict=False))

    def values(self, data: Mapping[str, Any]) -> Floats:
        """Return the entries of all data, with declared values for data that are not given; errors name the data."""
        if not data.keys() <= self.data.keys():
            self.model.definition.given(data)  # raises, with the names of the data
        parts = [
            quantity.read(data[name]) if name in data else quantity.lower
            for name, quantity in self.data.items()
        ]
        return np.concatenate([*parts, np.empty(0)])

    # -- numbers ---------------------------------------------------------------------------------

    @cached_property
    def bounds(self) -> dict[str, Floats]:
        """Bounds under CasADi's names: ``lbx, ubx, lbg, ubg``.

        If there are more equations than columns, which solvers reject, equations become narrow ranges.
        """
        selected = {"x": self.free, "g": self.rows}
        result = {name: bound[selected[name[-1]]] for name, bound in self.scaled.bounds.items()}
        equal = result["lbg"] == result["ubg"]
        width = np.where(equal, NARROW, 0.0) if equal.sum() > self.free.size else 0.0
        return {**result, "lbg": result["lbg"] - width, "ubg": result["ubg"] + width}

    def start(self, columns: Floats) -> Floats:
        """Return z for `columns` of the program, moved into its bounds."""
        z = self.scaled.start(columns)[self.free]
        return np.clip(z, self.bounds["lbx"], self.bounds["ubx"])

    def begin(self, warm: Any) -> tuple[Floats, tuple[Floats, Floats] | None]:
        """Return the z of a step, plan or samples, or the guess by default, with its multipliers if known."""
        if warm is None or warm is False:
            return self.guess, None
        if isinstance(warm, Point):
            if warm.posed is not self:
                raise InvalidData("warm must be a step of this solver, got another's", field="warm")
            return warm.z, warm.multipliers
        plan = getattr(warm, "plan", warm)
        if not isinstance(plan, ControlPlan | Mapping):
            raise InvalidData(
                "warm must be true or false, a step, a plan or a solution with one, or samples, got "
                f"{show(warm)}",
                field="warm",
            )
        plan = self.model.as_plan(plan)
        plan = ControlPlan(plan.phases, {**plan.parameters, **self.named(self.declared)})
        return self.start(self.formulation.encode(plan)), None

    def columns(self, z: Floats, p: Floats) -> Floats:
        """Return the columns of the program at z and p."""
        result = self.program.column_lower.copy()
        result[self.free] = z * self.program.column_scale[self.free]
        result[self.given] = p
        return result

    def duals(self, multipliers: Floats) -> Floats:
        """Return CasADi's multipliers of the rows with the signs and units of the program."""
        complete = np.zeros(self.program.row_count)
        complete[self.rows] = multipliers
        return self.scaled.duals(complete)

    def breach(self, g: Floats, p: Floats) -> float:
        """Return the largest violation of a scaled row; g are the scaled rows passed to solvers."""
        low, high = self.all_bounds
        if self._data_rows.size:
            g = np.append(g, np.array(self.data_values(p), float))
        return float(np.maximum(low - g, g - high).max(initial=0.0))

    def label(self, what: str, index: int) -> str:
        """Return the description of a ``"column"`` of z or of a ``"row"`` passed to solvers."""
        places = self.free if what == "column" else self.rows
        return str(getattr(self.program, f"{what}_name")(int(places[index])))

    @cached_property
    def at_begin(self) -> tuple[NDArray[np.int64], Floats, Floats, Floats]:
        """Columns of the controls of the first interval, weights of its start, and bounds of the controls."""
        phase, declared = self.formulation.layout.phases[0], self.model.definition.phases[0]
        count = len(declared.control_names)  # without those of an epigraph form
        columns = phase.control_columns[:count, phase.visit_control[: phase.visit_starts[1]]]
        weights = interpolation(phase.schemes[0].control_points, -1.0)[0]
        return columns, weights, *declared.bounds("controls")

    # -- functions -------------------------------------------------------------------------------

    def problem(self) -> dict[str, Any]:
        """Return the program in the form of ``nlpsol``: ``{"x", "p", "f", "g"}``."""
        z, p, f, g = self._values()
        return {"x": z, "p": p, "f": f, "g": g[self.rows.tolist()]}

    @cached_property
    def value(self) -> casadi.Function:
        """``(x, p) -> (f, g)``."""
        import casadi

        x, p, f, g = self.problem().values()
        return casadi.Function("value", [x, p], [f, casadi.densify(g)])

    def derivative(self, name: str) -> casadi.Function:
        """Return a function of :class:`Scaled`, such as ``"hessian"``, of the free columns and p."""
        import casadi

        z, p, columns = self._symbols()
        function = getattr(self.scaled, name)
        arguments, extra = [z, p], []
        if "lam_g" in function.name_in():
            kind = type(z)
            weight, duals = kind.sym("lam_f"), kind.sym("lam_g", self.rows.size)
            stacked = casadi.vertcat(duals, casadi.DM.zeros(self._data_rows.size))
            order = np.argsort(np.concatenate([self.rows, self._data_rows]))
            arguments += [weight, duals]
            extra = [weight, stacked[order.tolist()]]
        names, parts = function.name_out(), []
        results = self._expanded(function).call([columns, [], *extra])
        free, rows = self.free.tolist(), self.rows.tolist()
        for result, part in zip(names, results, strict=True):
            if result.startswith(("jac", "hess", "triu")):
                part = part[rows if result.startswith("jac") else free, free]
                # Remove structural entries that fixed columns make 0.
                part = casadi.sparsify(part) if self._expands else part
            elif result != "f":
                part = part[rows if result == "g" else free]
            parts.append(part)
        return casadi.Function(function.name(), arguments, parts, function.name_in(), names)

    @cached_property
    def all_bounds(self) -> tuple[Floats, Floats]:
        """Bounds of the rows passed to solvers, then of those that depend on the data alone."""
        low, high = (
            np.append(self.bounds[name], self.scaled.bounds[name][self._data_rows])
            for name in ("lbg", "ubg")
        )
        return low, high

    @cached_property
    def data_values(self) -> casadi.Function:
        """Scaled rows that depend on the data alone, ``(p) -> (g)``."""
        import casadi

        z, p, _, g = self._values()
        rows = casadi.substitute(g[self._data_rows.tolist()], z, casadi.DM.zeros(*z.shape))
        return casadi.Function("of_data", [p], [casadi.densify(rows)])

    def stacked(self, z: Any, p: Any) -> Any:
        """Return the scaled columns of the complete program as an expression of z and p."""
        import casadi

        fixed = np.setdiff1d(np.arange(self.program.size), [*self.free, *self.given])
        values = self.scaled.start(self.program.column_lower)
        data = p / casadi.DM(self.program.column_scale[self.given])
        columns = casadi.vertcat(z, data, casadi.DM(values[fixed]))
        return columns[np.argsort(np.concatenate([self.free, self.given, fixed])).tolist()]

    def _symbols(self) -> tuple[Any, Any, Any]:
        """Return z, p and the scaled columns of the complete program."""
        import casadi

        kind: Any = casadi.SX if self._expands else casadi.MX
        z, p = kind.sym("x", self.free.size), kind.sym("p", self.given.size)
        return z, p, self.stacked(z, p)

    def _values(self) -> tuple[Any, Any, Any, Any]:
        """Return z, p, and the scaled objective and rows."""
        import casadi

        z, p, columns = self._symbols()
        f, g = self._expanded(self.program.function)(columns * casadi.DM(self.program.column_scale))
        return z, p, f / self.program.objective_scale, g / casadi.DM(self.program.row_scale)

    def _expanded(self, function: Any) -> Any:
        return function.expand() if self._expands else function


@dataclass(frozen=True, eq=False)
class Point:
    """Point z of a parametric program for the data `values`.

    `multipliers` are those of z's bounds and of the rows passed to solvers, with CasADi's signs and scales.
    """

    posed: Parametric
    values: Floats
    z: Floats
    multipliers: tuple[Floats, Floats]

    @property
    def data(self) -> dict[str, Floats]:
        """Data by name."""
        return self.posed.named(self.values)

    @property
    def problem(self) -> OptimalControlProblem:
        """Problem with these data."""
        return self.posed.model.given(**self.data)

    @cached_property
    def columns(self) -> Floats:
        """Columns of the program."""
        return self.posed.columns(self.z, self.values)

    @cached_property
    def plan(self) -> ControlPlan:
        """Plan, with costates if the transcription provides them."""
        formulation, duals = self.posed.formulation, self.posed.duals(self.multipliers[1])
        return formulation.explained(formulation.decode(self.columns), self.columns, duals)

    def descent(self) -> Floats | None:
        """Return a direction of z along which the objective falls on both sides; None if none is found."""
        program, duals = self.posed.program, self.posed.duals(self.multipliers[1])
        with np.errstate(all="ignore"):
            away = descent_by_curvature(program, self.columns, duals)
        return None if away is None else (away / program.column_scale)[self.posed.free]

    @property
    def u0(self) -> Floats:
        """Controls at the start of the first phase, shape (controls,), computed without decoding the plan."""
        columns, weights, low, high = self.posed.at_begin
        return np.clip(self.columns[columns] @ weights, low, high)
