"""Programs from models of PuLP, Pyomo, linopy, gurobipy and MathOpt.

Linear and quadratic models are read from the coefficients that a library exports. Its MPS files are less
exact: that of PuLP has 13 digits and neither the sense nor the constant of the objective, and most rename rows
and columns. Nonlinear Pyomo models are converted through Pyomo's NL file.
"""

from __future__ import annotations

import io
import re
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...errors import CrosstrackError, InvalidData, UnsupportedFormulation, show
from ...models.programs.base import BlockProgram, RowProgram
from ...models.programs.blocks import Block
from ...models.programs.sources.link import Source
from .nl_file import read_nl
from .reading import stated_program

__all__ = ["program_of_gurobi", "program_of_linopy", "program_of_mathopt", "program_of_pulp"]
__all__ += ["program_of_pyomo"]

Vector = NDArray[np.float64]

#: Attributes of a gurobipy model that count parts without an equivalent in a program.
_GUROBI_PARTS = ("NumGenConstrs", "NumPWLObjVars", "NumQConstrs", "NumScenarios", "NumSOS")
#: Fields of an exported MathOpt model without an equivalent in a program.
_MATHOPT_PARTS = (
    *("auxiliary_objectives", "indicator_constraints", "quadratic_constraints"),
    *("second_order_cone_constraints", "sos1_constraints", "sos2_constraints"),
)
#: Suffixes in an NL file, which CasADi does not read.
_SUFFIXES = re.compile(r"^S\d+ \d+ .*\n(?:\d+ \S+\n)*", re.MULTILINE)


@contextmanager
def _export(library: str) -> Iterator[None]:
    """Raise ``InvalidData`` if a library cannot export its model."""
    try:
        yield
    except CrosstrackError:
        raise
    except Exception as error:  # the libraries raise many types
        words = " ".join(str(error).split())[:200] or type(error).__name__
        raise InvalidData(
            f"model must be complete, but {library} cannot export it: {words}", field="model"
        ) from error


@_export("PuLP")
def program_of_pulp(model: Any) -> RowProgram:
    """Return the program of a ``pulp.LpProblem`` with the names of variables and constraints.

    A maximisation is negated. :meth:`.Solution.assign` sets the values of the variables and of the attributes
    ``slack`` and ``pi`` of the constraints. Raise ``InvalidData`` if the object is not a whole model, has no
    variables, a number is not finite, or the objective is not convex, and ``UnsupportedFormulation`` for parts
    without an equivalent, such as special ordered sets.
    """
    import pulp

    _require(isinstance(model, pulp.LpProblem), model, "a pulp.LpProblem")
    _refuse("special ordered sets", [*map(str, model.sos1), *map(str, model.sos2)])
    variables, parts = model.variables(), model.constraints
    rows = parts() if callable(parts) else list(parts.values())  # since and before PuLP 3.3
    order = {variable: k for k, variable in enumerate(variables)}
    cost = np.array([(model.objective or {}).get(variable, 0.0) for variable in variables], float)
    maximise = model.sense == pulp.LpMaximize

    def assign(plan: Vector, duals: Vector | None, objective: float, termination: str) -> None:
        for variable, value in zip(variables, plan.tolist(), strict=True):
            variable.varValue = value
        for row, dual in zip(rows, _slopes(duals, maximise, len(rows)), strict=True):
            row.slack, row.pi = -row.value(), dual
        proven = pulp.LpSolutionOptimal, pulp.LpSolutionIntegerFeasible
        model.assignStatus(pulp.LpStatusOptimal, proven[termination != "optimal"])

    return _program(
        model, [v.name for v in variables], assign, maximise=maximise,
        cost=cost, offset=getattr(model.objective, "constant", 0.0), name=model.name,
        matrix=_matrix([([order[v] for v in row], row.values()) for row in rows], cost.size),
        row_lower=[None if row.sense == pulp.LpConstraintLE else -row.constant for row in rows],
        row_upper=[None if row.sense == pulp.LpConstraintGE else -row.constant for row in rows],
        column_lower=[v.lowBound for v in variables], column_upper=[v.upBound for v in variables],
        integral=[v.cat != pulp.LpContinuous for v in variables], rows=_block("row", [row.name or "" for row in rows]),
    )  # fmt: skip


@_export("Pyomo")
def program_of_pyomo(model: Any) -> BlockProgram:
    """Return the program of a Pyomo model with the current values of parameters; see :func:`program_of_pulp`.

    Multipliers are assigned to an imported suffix ``dual`` of linear and convex quadratic models. The program
    contains the active constraints, and the variables in them or in the objective that are not fixed. It is
    a ``NonlinearProgram`` unless the constraints are linear and the objective is convex and quadratic.
    """
    import pyomo.environ as pyo

    whole = isinstance(model, pyo.Block) and not model.is_indexed() and model.is_constructed()
    _require(whole, model, "a pyomo.environ.ConcreteModel or the result of create_instance")
    known = {"Block", "Constraint", "Objective", "Suffix", "ExternalFunction"}
    for part in model.component_objects(active=True):
        kind, states = part.ctype.__name__, hasattr(part, "deactivate")
        unknown = states and kind not in known and any(entry.active for entry in part.values())
        _refuse(f"components of type {kind}", [part.name] * (unknown or kind == "DerivativeVar"))
    fixed = [v for v in model.component_data_objects(pyo.Var) if v.fixed]
    _refuse("variables fixed without a value", [v.name for v in fixed if v.value is None])
    objectives = list(model.component_data_objects(pyo.Objective, active=True))
    _refuse("several objectives", [entry.name for entry in objectives if objectives[1:]])
    return _algebraic(model, objectives) or _nonlinear(model)


def _algebraic(model: Any, objectives: Sequence[Any]) -> RowProgram | None:
    """Return the linear or convex quadratic program of a Pyomo model; None for other models."""
    import pyomo.environ as pyo
    from pyomo.common.collections import ComponentMap
    from pyomo.repn import generate_standard_repn

    order: Any = ComponentMap()

    def places(entries: Iterable[Any]) -> list[int]:
        return [order.setdefault(variable, len(order)) for variable in entries]

    rows, terms, bounds = list(model.component_data_objects(pyo.Constraint, active=True)), [], []
    for row in rows:
        low, body, high = row.to_bounded_expression(evaluate_bounds=True)
        form = generate_standard_repn(body, quadratic=False)
        if form.nonlinear_expr is not None:
            return None
        terms.append((places(form.linear_vars), form.linear_coefs))
        bounds.append([None if side is None else side - form.constant for side in (low, high)])
    form = generate_standard_repn(objectives[0].expr if objectives else 0.0, quadratic=True)
    if form.nonlinear_expr is not None:
        return None
    linear, maximise = (
        places(form.linear_vars),
        bool(objectives) and objectives[0].sense == pyo.maximize,
    )
    pairs = [places(pair) for pair in form.quadratic_vars]
    variables, cost = list(order), np.zeros(len(order))
    others = [v.name for v in variables if not (v.is_continuous() or v.is_integer())]
    _refuse("variables whose domain is neither real nor integer", others)
    cost[linear] = form.linear_coefs

    def assign(plan: Vector, duals: Vector | None, *others: Any) -> None:
        suffix = _assign(model, variables, plan)
        if duals is not None and suffix is not None:
            suffix.update(zip(rows, _slopes(duals, maximise, len(rows)), strict=True))

    try:
        return _program(
            model, [v.name for v in variables], assign, cost=cost, maximise=maximise,
            offset=form.constant, quadratic=_square(form.quadratic_coefs, pairs, cost.size),
            matrix=_matrix(terms, cost.size), rows=_block("row", [row.name for row in rows]),
            row_lower=[low for low, _ in bounds], row_upper=[high for _, high in bounds],
            column_lower=[v.lb for v in variables], column_upper=[v.ub for v in variables],
            integral=[not v.is_continuous() for v in variables],
        )  # fmt: skip
    except InvalidData as error:
        if error.field != "hessian":  # not convex
            raise
        return None


def _assign(model: Any, variables: Any, plan: Vector, *others: Any) -> Any:
    """Set the values of variables of Pyomo; return its imported suffix ``dual`` without old entries, or None."""
    import pyomo.environ as pyo

    for variable, value in zip(variables, plan.tolist(), strict=True):
        variable.set_value(value, skip_validation=True)
    suffix = model.component("dual")
    if not (isinstance(suffix, pyo.Suffix) and suffix.import_enabled()):
        return None
    suffix.clear()
    return suffix


def _slopes(duals: Vector | None, maximise: bool, count: int) -> list[float | None]:
    """Return the derivatives of the author's objective with respect to the bounds of the rows."""
    return [None] * count if duals is None else ((-1.0 if maximise else 1.0) * duals).tolist()


def _nonlinear(model: Any) -> BlockProgram:
    """Return the nonlinear program of a Pyomo model."""
    from pyomo.repn.plugins.nl_writer import NLWriter

    stream = io.StringIO()
    # Presolve and scaling would change rows and columns.
    info = NLWriter().write(
        model, stream, linear_presolve=False, scale_model=False, skip_trivial_constraints=False
    )
    columns = _block("column", [variable.name for variable in info.variables])
    rows = _block("row", [row.name for row in info.constraints])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "model.nl")
        path.write_text(_SUFFIXES.sub("", stream.getvalue()), "utf-8")
        try:
            program = replace(read_nl(path), columns=columns, rows=rows)
        except InvalidData as error:
            reason = str(error).replace(f"{path}: ", "")
            _refuse("expressions unknown to CasADi, such as acosh or asinh", [reason])
    return program.with_source(
        Source(model, program.values_of, partial(_assign, model, info.variables))
    )


@_export("linopy")
def program_of_linopy(model: Any) -> RowProgram:
    """Return the program of a ``linopy.Model``; see :func:`program_of_pulp`.

    Each variable and each constraint is a block. The values are a ``DataArray`` per variable.
    """
    import linopy
    import xarray as xr

    _require(isinstance(model, linopy.Model), model, "a linopy.Model")
    _refuse("special ordered sets", list(getattr(model.variables, "sos", ())))
    _refuse("semi-continuous variables", list(getattr(model.variables, "semi_continuous", ())))
    _refuse("indicator constraints", list(getattr(model.constraints, "indicator", ())))
    data = model.matrices
    # linopy exports the columns and the objective in the units of their scaling.
    scale = getattr(data, "var_scaling", np.ones(data.vlabels.size))
    units, factor = sp.diags_array(scale), float(getattr(model.objective, "scaling", 1.0))

    def values(plan: Vector) -> dict[str, Any]:
        entries = np.full(int(data.vlabels.max()) + 2, np.nan)  # the last one for the label -1
        entries[data.vlabels] = plan
        return {
            name: xr.DataArray(entries[part.labels.values], part.labels.coords, part.labels.dims)
            for name, part in model.variables.items()
        }

    def assign(plan: Vector, duals: Vector | None, objective: float, termination: str) -> None:
        for name, solution in values(plan).items():
            model.variables[name].solution = solution
        model.objective.set_value(objective)
        model.status = "ok"

    program = _program(
        model, [""] * scale.size, None, maximise=model.objective.sense == "max",
        cost=data.c * scale / factor, offset=0.0,
        quadratic=None if data.Q is None else units @ data.Q @ units / (2 * factor),
        matrix=sp.csr_array((0, scale.size)) if data.A is None else data.A @ units,
        row_lower=np.where(data.sense == "<", -np.inf, data.b),
        row_upper=np.where(data.sense == ">", np.inf, data.b),
        column_lower=data.lb / scale, column_upper=data.ub / scale, integral=data.vtypes != "C",
        columns=_blocks_of(model.variables, data.vlabels),
        rows=_blocks_of(model.constraints, data.clabels),
    )  # fmt: skip
    return program.with_source(Source(model, values, assign))


def _blocks_of(parts: Any, active: NDArray[np.int64]) -> tuple[Block, ...]:
    """Return one block per variable or constraint of linopy with the names of its active entries."""
    blocks: list[Block] = []
    for name, part in parts.items():
        start, labels = (blocks[-1].slice.stop if blocks else 0), part.labels
        keys = product(*(labels.indexes[dimension] for dimension in labels.dims))
        names = np.array([f"{name}[{', '.join(map(str, key))}]" for key in keys])
        texts = tuple(names[np.isin(labels.values.ravel(), active)].tolist())
        if texts:
            blocks.append(Block(name, "", start, len(texts), labels=texts if labels.dims else ()))
    return tuple(blocks)


@_export("gurobipy")
def program_of_gurobi(model: Any) -> RowProgram:
    """Return the program of a ``gurobipy.Model`` after its method ``update``; see :func:`program_of_pulp`.

    A constraint of ``addRange`` is an equation with a further column, as in the model.
    :meth:`.Solution.assign` sets the attribute ``Start`` of the variables.
    """
    import gurobipy as gp

    _require(isinstance(model, gp.Model), model, "a gurobipy.Model")
    model.update()
    variables, rows = model.getVars(), model.getConstrs()
    kinds = np.array(model.getAttr("VType", variables), "U1")
    sense = np.array(model.getAttr("Sense", rows), "U1")
    names = model.getAttr("VarName", variables)
    parts = [f"{key} = {getattr(model, key)}" for key in _GUROBI_PARTS if getattr(model, key)]
    parts += [f"NumObj = {model.NumObj}"] if model.NumObj > 1 else []
    _refuse("parts without an equivalent", parts)
    semi = [name for name, kind in zip(names, kinds, strict=True) if kind in ("S", "N")]
    _refuse("semi-continuous variables", semi)
    objective, side = model.getObjective(), np.array(model.getAttr("RHS", rows), float)
    terms = range(objective.size()) if isinstance(objective, gp.QuadExpr) else ()
    pairs = [(objective.getVar1(k).index, objective.getVar2(k).index) for k in terms]
    low, high = (np.array(model.getAttr(key, variables), float) for key in ("LB", "UB"))
    low, high = np.where(kinds == "B", [np.maximum(low, 0), np.minimum(high, 1)], [low, high])
    for bound in (low, high, side):
        bound[np.abs(bound) >= 1e20] *= np.inf  # as in gurobipy

    def assign(plan: Vector, duals: Vector | None, objective: float, termination: str) -> None:
        model.setAttr("Start", variables, plan.tolist())
        model.update()

    return _program(
        model, names, assign, maximise=model.ModelSense == gp.GRB.MAXIMIZE, name=model.ModelName,
        cost=model.getAttr("Obj", variables), offset=model.ObjCon,
        quadratic=_square([objective.getCoeff(k) for k in terms], pairs, len(variables)),
        matrix=model.getA(), rows=_block("row", model.getAttr("ConstrName", rows)),
        row_lower=np.where(sense == "<", -np.inf, side),
        row_upper=np.where(sense == ">", np.inf, side),
        column_lower=low, column_upper=high, integral=kinds != "C",
    )  # fmt: skip


@_export("MathOpt")
def program_of_mathopt(model: Any) -> RowProgram:
    """Return the program of an ``ortools.math_opt`` model; see :func:`program_of_pulp`. It stores no values."""
    _require(hasattr(model, "export_model"), model, "an ortools.math_opt.python.mathopt.Model")
    data = model.export_model()
    for part in _MATHOPT_PARTS:
        items = getattr(data, part).items()
        _refuse(part.replace("_", " "), [entry.name or str(key) for key, entry in items])
    variables, rows, objective = data.variables, data.linear_constraints, data.objective
    matrix, linear = data.linear_constraint_matrix, objective.linear_coefficients
    ids, row_ids = np.array(variables.ids, int), np.array(rows.ids, int)
    cost, quadratic = np.zeros(ids.size), objective.quadratic_coefficients
    cost[np.searchsorted(ids, linear.ids)] = linear.values
    pairs = np.column_stack([quadratic.row_ids, quadratic.column_ids])
    places = np.searchsorted(row_ids, matrix.row_ids), np.searchsorted(ids, matrix.column_ids)
    return _program(
        model, list(variables.names) or [""] * ids.size, None, maximise=objective.maximize,
        cost=cost, offset=objective.offset, name=data.name,
        quadratic=_square(quadratic.coefficients, np.searchsorted(ids, pairs), ids.size),
        matrix=sp.csr_array((matrix.coefficients, places), shape=(row_ids.size, ids.size)),
        row_lower=rows.lower_bounds, row_upper=rows.upper_bounds,
        column_lower=variables.lower_bounds, column_upper=variables.upper_bounds,
        integral=variables.integers, rows=_block("row", list(rows.names) or [""] * row_ids.size),
    )  # fmt: skip


def _require(is_model: bool, value: Any, allowed: str) -> None:
    """Raise ``InvalidData`` unless an object is a whole model."""
    if not is_model:
        raise InvalidData(
            f"model must be {allowed}, got {show(value)} of type {type(value).__name__}: pass the whole model",
            field="model",
        )


def _refuse(kind: str, names: Sequence[str]) -> None:
    """Raise ``UnsupportedFormulation`` if a model has parts without an equivalent."""
    if names:
        listed = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if names[3:] else "")
        raise UnsupportedFormulation(
            f"the model has {kind} ({listed}), but a program has one objective, constraints, and continuous "
            "and integer variables: reformulate or remove them"
        )


def _unique(what: str, names: Iterable[str]) -> list[str]:
    """Return the names, with a number in place of empty names and after repeated ones."""
    result: dict[str, None] = {}
    for number, name in enumerate(names):
        other = f"{name} ({what} {number})" if name else f"[{number}]"
        result[name if name and name not in result else other] = None
    return list(result)


def _block(what: str, names: Iterable[str]) -> tuple[Block, ...]:
    """Return one block that names its entries; none without entries."""
    labels = tuple(_unique(what, names))
    return (Block(what, "", 0, len(labels), labels=labels),) if labels else ()


def _matrix(rows: Iterable[tuple[Iterable[int], Iterable[float]]], columns: int) -> sp.csr_array:
    """Return the matrix with the given places and values of the entries of each row."""
    parts = [(list(places), list(values)) for places, values in rows]
    start = np.cumsum([0, *(len(places) for places, _ in parts)])
    indices = np.array([place for places, _ in parts for place in places], int)
    data = np.array([value for _, values in parts for value in values], float)
    return sp.csr_array((data, indices, start), shape=(len(parts), columns))


def _square(values: Iterable[float], pairs: Any, size: int) -> sp.coo_array:
    """Return the matrix with the given values at pairs of columns."""
    places = np.array(pairs, int).reshape(-1, 2).T
    return sp.coo_array((np.array(values, float), places), shape=(size, size))


def _program(
    model: Any, names: Sequence[str], assign: Any, *, maximise: bool, cost: Any, offset: float,
    quadratic: Any = None, **fields: Any,
) -> RowProgram:  # fmt: skip
    """Return the program of a model with the objective ``x @ quadratic @ x + cost @ x + offset``."""
    if not len(cost):
        raise InvalidData("model must have a variable, but it has none", field="model")
    fields = {"columns": _block("column", names), **fields}
    program = stated_program(
        maximise=bool(maximise), cost=cost, offset=offset,
        hessian=None if quadratic is None else sp.csr_array(quadratic + quadratic.T), **fields,
    )  # fmt: skip
    return program.with_source(Source(model, program.values_of, assign))
