"""Random linear programs, and the same as models of other libraries."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp

Vector = NDArray[np.float64]
INF = np.inf


@dataclass
class Case:
    """A program as arrays, in the sense and with the names of its author."""

    maximise: bool
    cost: Vector
    offset: float
    matrix: Vector
    row_lower: Vector
    row_upper: Vector
    lower: Vector
    upper: Vector
    integral: NDArray[np.bool_]
    names: list[str]

    @staticmethod
    def random(seed: int) -> Case:
        """A feasible bounded program with rows of all kinds and a free column."""
        rng = np.random.default_rng(seed)
        n, m = int(rng.integers(2, 6)), int(rng.integers(1, 5))
        lower, upper = rng.integers(-3, 1, n).astype(float), rng.integers(1, 7, n).astype(float)
        integral = rng.random(n) < (0.5 if seed % 3 else 0.0)
        lower[0], upper[0], integral[0] = -INF, INF, False
        point = np.where(np.isfinite(lower), np.clip(1.0, lower, upper), rng.normal())
        matrix = np.vstack(
            [np.eye(1, n), rng.integers(-4, 5, (m, n)) / 3 * (rng.random((m, n)) < 0.7)]
        )
        matrix[-1, -1] = 1 / 3
        activity, slack = matrix @ point, rng.random((2, m + 1)) + 0.1
        low, high = activity - slack[0], activity + slack[1]
        kind = rng.integers(0, 4, m + 1)
        kind[0] = 0  # a range, which bounds the free column
        low[kind == 1], high[kind == 2] = -INF, INF
        low[kind == 3] = high[kind == 3] = activity[kind == 3]
        names = [f"flow {k} [a, {k}]" if k % 2 else f"x[{k}]" for k in range(n)]
        return Case(
            bool(seed % 2), rng.integers(-9, 10, n) / 7, float(rng.integers(-5, 6)),
            matrix, low, high, lower, upper, integral, names,
        )  # fmt: skip

    def optimum(self) -> float:
        sign = -1.0 if self.maximise else 1.0
        point = solved(
            sign * self.cost, self.matrix, self.row_lower, self.row_upper,
            self.lower, self.upper, self.integral,
        )  # fmt: skip
        return self.value(point)

    def value(self, point: Vector) -> float:
        return float(self.cost @ point) + self.offset

    def violation(self, point: Vector) -> float:
        rows = self.matrix @ point
        parts = [self.row_lower - rows, rows - self.row_upper, self.lower - point]
        parts += [point - self.upper, np.abs(point - np.round(point))[self.integral]]
        return float(max(part.max(initial=0.0) for part in parts))


def solved(
    cost: Vector,
    matrix: Any,
    low: Vector,
    high: Vector,
    lower: Vector,
    upper: Vector,
    integral: NDArray[np.bool_],
) -> Vector:
    """The optimum of a minimisation, by the HiGHS that SciPy brings."""
    rows = LinearConstraint(sp.csr_array(matrix), low, high)
    answer = milp(cost, constraints=rows, bounds=Bounds(lower, upper), integrality=integral * 1)
    assert answer.status == 0, answer.message
    result: Vector = answer.x
    return result


def optimum_of(program: Any) -> Vector:
    return solved(
        program.cost, program.matrix, program.row_lower, program.row_upper,
        program.column_lower, program.column_upper, program.integral,
    )  # fmt: skip


def _finite(bound: float) -> float | None:
    return float(bound) if np.isfinite(bound) else None


#: A model, a function that reads the values of its variables, and their names in the library.
Built = tuple[Any, Callable[[], Vector], list[str]]


def build_pulp(case: Case) -> Built:
    pulp = pytest.importorskip("pulp", reason="PuLP is not installed")
    x = [
        pulp.LpVariable(name, _finite(low), _finite(high), "Integer" if whole else "Continuous")
        for name, low, high, whole in zip(case.names, case.lower, case.upper, case.integral, strict=True)
    ]  # fmt: skip
    model = pulp.LpProblem("random", pulp.LpMaximize if case.maximise else pulp.LpMinimize)
    model += pulp.lpSum(c * v for c, v in zip(case.cost, x, strict=True)) + case.offset
    for row, low, high in zip(case.matrix, case.row_lower, case.row_upper, strict=True):
        terms = pulp.lpSum(c * v for c, v in zip(row, x, strict=True) if c)
        if low == high:
            model += terms == low
        else:  # PuLP has no ranges
            if np.isfinite(low):
                model += terms >= low
            if np.isfinite(high):
                model += terms <= high
    return model, lambda: np.array([v.varValue for v in x]), [v.name for v in x]


def build_pyomo(case: Case) -> Built:
    pyo = pytest.importorskip("pyomo.environ", reason="Pyomo is not installed")
    model = pyo.ConcreteModel()
    model.x = pyo.Var(case.names)
    x = [model.x[name] for name in case.names]
    for v, low, high, whole in zip(x, case.lower, case.upper, case.integral, strict=True):
        v.domain = pyo.Integers if whole else pyo.Reals
        v.bounds = _finite(low), _finite(high)
    cost = sum(c * v for c, v in zip(case.cost, x, strict=True)) + case.offset
    model.o = pyo.Objective(expr=cost, sense=pyo.maximize if case.maximise else pyo.minimize)
    model.rows = pyo.ConstraintList()
    for row, low, high in zip(case.matrix, case.row_lower, case.row_upper, strict=True):
        terms = sum(c * v for c, v in zip(row, x, strict=True)) + 2.5
        shifted = (None if bound is None else bound + 2.5 for bound in map(_finite, (low, high)))
        model.rows.add(pyo.inequality(*(part for part in _between(terms, *shifted))))
    return model, lambda: np.array([pyo.value(v) for v in x]), [v.name for v in x]


def _between(terms: Any, low: float | None, high: float | None) -> tuple[Any, ...]:
    return low, terms, high


def build_gurobi(case: Case) -> Built:
    gp = pytest.importorskip("gurobipy", reason="gurobipy is not installed")
    try:
        environment = gp.Env(params={"OutputFlag": 0})
    except gp.GurobiError as error:
        pytest.skip(f"gurobipy has no licence: {error}")
    model = gp.Model("random", env=environment)
    x = [
        model.addVar(lb=low, ub=high, vtype="I" if whole else "C", name=name)
        for name, low, high, whole in zip(case.names, case.lower, case.upper, case.integral, strict=True)
    ]  # fmt: skip
    for row, low, high in zip(case.matrix, case.row_lower, case.row_upper, strict=True):
        terms = gp.LinExpr(row.tolist(), x)
        if low == high:
            model.addConstr(terms == low)
        elif np.isfinite(low) and np.isfinite(high):
            model.addRange(terms, low, high)
        elif np.isfinite(low):
            model.addConstr(terms >= low)
        else:
            model.addConstr(terms <= high)
    sense = gp.GRB.MAXIMIZE if case.maximise else gp.GRB.MINIMIZE
    model.setObjective(gp.LinExpr(case.cost.tolist(), x) + case.offset, sense)
    return model, lambda: np.array(model.getAttr("Start", x)), case.names


def build_linopy(case: Case) -> Built:
    linopy = pytest.importorskip("linopy", reason="linopy is not installed")
    model = linopy.Model()
    parts = []
    for name, take in (("whole", case.integral), ("real part", ~case.integral)):
        if take.any():
            coords = [("place", np.array(case.names)[take])]
            x = model.add_variables(
                case.lower[take], case.upper[take], coords, name, integer=name == "whole"
            )
            parts.append((np.flatnonzero(take), x))

    def total(row: Vector) -> Any:
        return sum((x * row[take]).sum() for take, x in parts)

    for row, low, high in zip(case.matrix, case.row_lower, case.row_upper, strict=True):
        if low == high:
            model.add_constraints(total(row) == low)
            continue
        if np.isfinite(low):
            model.add_constraints(total(row) >= low)
        if np.isfinite(high):
            model.add_constraints(total(row) <= high)
    model.add_objective(total(case.cost), sense="max" if case.maximise else "min")
    case.offset = 0.0  # linopy has no constants in the objective

    def read() -> Vector:
        point = np.zeros(case.cost.size)
        for take, x in parts:
            point[take] = x.solution.values
        return point

    return model, read, [x.name for _, x in parts]


def build_mathopt(case: Case) -> Built:
    from ortools.math_opt.python import mathopt

    model = mathopt.Model(name="random")
    gone = model.add_variable(name="deleted")
    x = [
        model.add_variable(lb=low, ub=high, is_integer=bool(whole), name=name)
        for name, low, high, whole in zip(case.names, case.lower, case.upper, case.integral, strict=True)
    ]  # fmt: skip
    model.delete_variable(gone)
    for row, low, high in zip(case.matrix, case.row_lower, case.row_upper, strict=True):
        terms = sum(c * v for c, v in zip(row, x, strict=True))
        model.add_linear_constraint(lb=low, ub=high, expr=terms)
    cost = sum(c * v for c, v in zip(case.cost, x, strict=True)) + case.offset
    model.set_objective(cost, is_maximize=case.maximise)
    return model, lambda: np.empty(0), case.names


BUILDERS = {
    "gurobipy": build_gurobi,
    "linopy": build_linopy,
    "pulp": build_pulp,
    "pyomo": build_pyomo,
}
