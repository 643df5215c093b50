"""A transcribed program as its data vary: what is free, what is fixed, what is given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...models.optimal_control.lagrange import interpolation
from ...models.optimal_control.model import OptimalControlProblem
from ...models.optimal_control.plan import ControlPlan
from ...models.optimal_control.transcription.base import Transcription
from ...models.programs.nonlinear import NonlinearProgram
from ..nlp.ipopt import NARROW
from ..nlp.scaled import Scaled

if TYPE_CHECKING:
    import casadi

__all__ = ["Parametric", "Point"]

Floats = NDArray[np.float64]

#: Columns above which functions stay as they are: in scalar operations they would fill the memory.
MOST_EXPANDED = 20_000


class Parametric:
    """The program of `formulation` in its free columns z, with its data as CasADi's parameters p.

    Columns whose bounds are equal are constants, which leaves solvers fewer columns and, where times
    are fixed, constant derivatives. Columns, rows and objective are scaled as in
    :class:`~..nlp.scaled.Scaled`; p is in the units of the data. Rows without a free column depend on
    the data alone: solvers do not see them.

    Attributes
    ----------
    program : NonlinearProgram
        The whole program.
    free, given : ndarray of int
        Columns that are chosen, and those of the data.
    rows : ndarray of int
        Rows that depend on a free column.
    data : mapping of str to Quantity
        The data by name.
    declared : ndarray
        The entries of all data where none are given.
    guess : ndarray
        z where a search starts.
    """

    def __init__(self, formulation: Transcription) -> None:
        self.formulation = formulation
        program = formulation.program
        assert isinstance(program, NonlinearProgram)
        self.program = program
        self.scaled = Scaled(program)
        layout = formulation.layout
        marks = [np.full(one.size, one.given) for one in layout.definition.parameters]
        marked = np.concatenate([*marks, np.zeros(0, bool)]).astype(bool)
        self.given = layout.parameter_columns[marked]
        chosen = program.column_lower < program.column_upper
        chosen[self.given] = False
        self.free = np.flatnonzero(chosen)
        self._fixed = program.column_lower / program.column_scale
        pattern = program.first_order.sparsity_out(1)
        row, column = (np.asarray(one, np.int64) for one in pattern.get_triplet())
        self.rows = np.unique(row[chosen[column]])
        self._lone = np.setdiff1d(np.arange(program.row_count), self.rows)
        self.data = {one.name: one for one in layout.definition.parameters if one.given}
        self.declared = np.concatenate([*(one.lower for one in self.data.values()), np.zeros(0)])
        self.guess = self.start(program.guess)

    @property
    def model(self) -> OptimalControlProblem:
        """The problem as it was declared."""
        return self.formulation.model

    # -- data ------------------------------------------------------------------------------------

    def named(self, values: Floats) -> dict[str, Floats]:
        """Return the entries of all data by their names."""
        ends = np.cumsum([one.size for one in self.data.values()])
        parts = np.split(values, ends[:-1])
        return dict(zip(self.data, parts, strict=False))

    def values(self, data: Mapping[str, Any]) -> Floats:
        """Return the entries of all data: those given by name, the declared ones else.

        Raises
        ------
        InvalidData
            A name is no data of the problem, or a value has another size or is not finite.
        """
        if not data.keys() <= self.data.keys():
            self.model.definition.given(data)  # which raises, naming what there is
        found, at = self.declared.copy(), 0
        for name, one in self.data.items():
            if name in data:
                found[at : at + one.size] = one.read(data[name])
            at += one.size
        return found

    # -- numbers ---------------------------------------------------------------------------------

    @cached_property
    def bounds(self) -> dict[str, Floats]:
        """Bounds under CasADi's names: ``lbx, ubx, lbg, ubg``.

        Where there are more equations than columns, as solvers refuse, equations are narrow ranges.
        """
        known = self.scaled.bounds
        taken = {"x": self.free, "g": self.rows}
        found = {name: bound[taken[name[-1]]] for name, bound in known.items()}
        equal = found["lbg"] == found["ubg"]
        width = np.where(equal, NARROW, 0.0) if equal.sum() > self.free.size else 0.0
        return {**found, "lbg": found["lbg"] - width, "ubg": found["ubg"] + width}

    def start(self, columns: Floats) -> Floats:
        """Return z at `columns` of the program, moved into its bounds."""
        z: Floats = (columns / self.program.column_scale)[self.free]
        return np.clip(z, self.bounds["lbx"], self.bounds["ubx"])

    def columns(self, z: Floats, p: Floats) -> Floats:
        """Return the columns of the program at z and p."""
        found = self.program.column_lower.copy()
        found[self.free] = z * self.program.column_scale[self.free]
        found[self.given] = p
        return found

    def duals(self, multipliers: Floats) -> Floats:
        """Return CasADi's multipliers of the rows as the program signs and measures them."""
        whole = np.zeros(self.program.row_count)
        whole[self.rows] = multipliers
        return self.scaled.duals(whole)

    def breach(self, g: Floats, p: Floats) -> float:
        """Return the largest violation of a scaled row, where g are the scaled rows solvers see."""
        low, high = self.bounds["lbg"], self.bounds["ubg"]
        worst = float(np.maximum(low - g, g - high).max(initial=0.0))
        if self._lone.size:
            known = self.scaled.bounds
            lone = np.array(self._of_data(p), float).reshape(-1)
            low, high = known["lbg"][self._lone], known["ubg"][self._lone]
            worst = max(worst, float(np.maximum(low - lone, lone - high).max()))
        return worst

    def label(self, what: str, index: int) -> str:
        """Return the words for a ``"column"`` of z or a ``"row"`` that solvers see."""
        places = self.free if what == "column" else self.rows
        return str(getattr(self.program, f"{what}_name")(int(places[index])))

    @cached_property
    def at_begin(self) -> tuple[NDArray[np.int64], Floats, Floats, Floats]:
        """Columns of the controls of the first interval, weights of its begin, and their bounds."""
        one = self.formulation.layout.phases[0]
        columns = one.control_columns[:, one.visit_control[: one.visit_starts[1]]]
        weights = interpolation(one.schemes[0].control_points, -1.0)[0]
        return columns, weights, *one.phase.bounds("controls")

    # -- functions -------------------------------------------------------------------------------

    @cached_property
    def value(self) -> casadi.Function:
        """``(x, p) -> (f, g)``."""
        import casadi

        z, p, f, g = self._values()
        return casadi.Function("value", [z, p], [f, casadi.densify(g[self.rows.tolist()])])

    def problem(self) -> dict[str, Any]:
        """Return the program as ``nlpsol`` takes it: ``{"x", "p", "f", "g"}``."""
        z, p, f, g = self._values()
        return {"x": z, "p": p, "f": f, "g": g[self.rows.tolist()]}

    @cached_property
    def gradient(self) -> casadi.Function:
        """``(x, p) -> (f, grad_f_x)``."""
        return self._posed(self.scaled.gradient)

    @cached_property
    def jacobian(self) -> casadi.Function:
        """``(x, p) -> (g, jac_g_x)``."""
        return self._posed(self.scaled.jacobian)

    @cached_property
    def first_order(self) -> casadi.Function:
        """``(x, p) -> (f, grad_f_x, g, jac_g_x)``."""
        return self._posed(self.scaled.first_order)

    @cached_property
    def hessian(self) -> casadi.Function:
        """``(x, p, lam_f, lam_g) -> (triu_hess_gamma_x_x)``, the upper triangle."""
        return self._posed(self.scaled.hessian, multipliers=True)

    @cached_property
    def whole_hessian(self) -> casadi.Function:
        """``(x, p, lam_f, lam_g) -> (hess_gamma_x_x)``, both triangles."""
        return self._posed(self.scaled.whole_hessian, multipliers=True)

    @cached_property
    def _of_data(self) -> casadi.Function:
        """Rows that depend on the data alone, ``(p) -> (g)``, scaled."""
        import casadi

        z, p, _, g = self._values()
        rows = casadi.substitute(g[self._lone.tolist()], z, casadi.DM.zeros(*z.shape))
        return casadi.Function("of_data", [p], [rows])

    def stacked(self, z: Any, p: Any) -> Any:
        """Return the scaled columns of the whole program as an expression of z and p."""
        import casadi

        scaled = p / casadi.DM(self.program.column_scale[self.given])
        fixed = np.setdiff1d(np.arange(self.program.size), [*self.free, *self.given])
        whole = casadi.vertcat(z, scaled, casadi.DM(self._fixed[fixed]))
        return whole[np.argsort(np.concatenate([self.free, self.given, fixed])).tolist()]

    def _values(self) -> tuple[Any, ...]:
        """Return z, p, the objective and the rows, scaled."""
        import casadi

        z, p, whole = self._symbols()
        f, g = self._function(self.program.function)(whole * casadi.DM(self.program.column_scale))
        return z, p, f / self.program.objective_scale, g / casadi.DM(self.program.row_scale)

    # -- parts -----------------------------------------------------------------------------------

    @cached_property
    def _expands(self) -> bool:
        """Whether the functions are taken apart into scalar operations, which run several times as fast."""
        try:
            self.program.function.expand()
        except RuntimeError:
            return False  # a stranger's function or a table has no scalar form
        return self.program.size <= MOST_EXPANDED

    def _function(self, function: Any) -> Any:
        return function.expand() if self._expands else function

    def _symbols(self) -> tuple[Any, Any, Any]:
        """Return z, p and the scaled columns of the whole program."""
        import casadi

        kind: Any = casadi.SX if self._expands else casadi.MX
        z, p = kind.sym("x", self.free.size), kind.sym("p", self.given.size)
        return z, p, self.stacked(z, p)

    def _posed(self, function: casadi.Function, *, multipliers: bool = False) -> casadi.Function:
        """Return `function` of the whole scaled program as one of the free columns and rows."""
        import casadi

        z, p, whole = self._symbols()
        given, more = [z, p], []
        if multipliers:
            kind = type(z)
            weight, duals = kind.sym("lam_f"), kind.sym("lam_g", self.rows.size)
            stacked = casadi.vertcat(duals, casadi.DM.zeros(self._lone.size))
            order = np.argsort(np.concatenate([self.rows, self._lone]))
            given += [weight, duals]
            more = [weight, stacked[order.tolist()]]
        found = self._function(function)(whole, [], *more)
        results = found if isinstance(found, tuple) else (found,)
        names, parts = function.name_out(), []
        free, rows = self.free.tolist(), self.rows.tolist()
        for name, part in zip(names, results, strict=True):
            if name.startswith(("jac", "hess", "triu")):
                part = part[rows if name.startswith("jac") else free, free]
                # Derivatives that fixed columns make 0 leave the structure.
                part = casadi.sparsify(part) if self._expands else part
            elif name != "f":
                part = part[rows if name == "g" else free]
            parts.append(part)
        return casadi.Function(function.name(), given, parts, function.name_in(), names)


@dataclass(frozen=True, eq=False)
class Point:
    """A point of a parametric program with its multipliers, as CasADi signs and scales both.

    Parameters
    ----------
    posed : Parametric
        The program.
    values : ndarray
        The entries of all data.
    z : ndarray
        The free columns.
    multipliers : tuple of ndarray
        Those of z's bounds and of the rows that solvers see.
    """

    posed: Parametric
    values: Floats
    z: Floats
    multipliers: tuple[Floats, Floats]

    @property
    def data(self) -> dict[str, Floats]:
        """The data by name."""
        return self.posed.named(self.values)

    @property
    def problem(self) -> OptimalControlProblem:
        """The problem at the data."""
        return self.posed.model.given(**self.data)

    @cached_property
    def columns(self) -> Floats:
        """The columns of the program."""
        return self.posed.columns(self.z, self.values)

    @cached_property
    def plan(self) -> ControlPlan:
        """The plan, with costates where the transcription has them."""
        formulation, duals = self.posed.formulation, self.posed.duals(self.multipliers[1])
        return formulation.explained(formulation.decode(self.columns), self.columns, duals)

    @property
    def u0(self) -> Floats:
        """The controls at the start of the first phase, (controls,), without the plan being made."""
        at, weights, low, high = self.posed.at_begin
        return np.clip(self.columns[at] @ weights, low, high)
