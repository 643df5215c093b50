"""Models of PuLP, Pyomo, linopy, gurobipy and MathOpt become programs with their names and values."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from library_models import BUILDERS, Case, build_mathopt, optimum_of
from runs import answer_with, elsewhere

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation
from crosstrack.models.programs.linear import MixedIntegerProgram, QuadraticProgram
from crosstrack.models.programs.nonlinear import NonlinearProgram

SEEDS = range(20)

pytestmark = pytest.mark.filterwarnings("ignore:.*PuLP 4.0:DeprecationWarning")


@pytest.mark.parametrize("library", sorted(BUILDERS))
def test_random_programs_keep_their_optimum_and_names(library: str) -> None:
    for seed in SEEDS:
        case = Case.random(seed)
        model, read, names = BUILDERS[library](case)
        program = ct.load(model)
        assert isinstance(program, MixedIntegerProgram)
        assert program.maximise == case.maximise
        plan = optimum_of(program)
        optimum = case.optimum()
        sign = -1.0 if case.maximise else 1.0
        assert sign * program.objective(plan) == pytest.approx(optimum, abs=1e-7), seed
        values = program.values_of(plan)
        assert set(names) <= set(values)
        assert program.source is not None and program.source.assign is not None
        program.source.assign(plan, None, optimum, "optimal")
        point = read()
        given = np.concatenate([np.ravel(values[name]) for name in names])
        assert sorted(point) == sorted(given)
        assert case.value(point) == pytest.approx(optimum, abs=1e-7), seed
        assert case.violation(point) <= 1e-6
        labels = {name for block in program.columns for name in block.labels}
        if library == "linopy":
            names = [
                f"{'whole' if whole else 'real part'}[{name}]"
                for name, whole in zip(case.names, case.integral, strict=True)
            ]
        assert set(names) <= labels


def main_mathopt() -> Any:
    """Differences of 20 MathOpt programs from their optimum, and what is refused."""
    from ortools.math_opt.python import mathopt

    from crosstrack.models.programs.sources.conversion import program_of

    differences = []
    for seed in SEEDS:
        case = Case.random(seed)
        program = program_of(build_mathopt(case)[0])
        plan = optimum_of(program)
        sign = -1.0 if case.maximise else 1.0
        assert program.maximise == case.maximise
        assert [program.column_name(k) for k in range(program.size)] == [
            f"column {name}" for name in case.names
        ]
        assert program.source.assign is None
        differences.append(sign * program.objective(plan) - case.optimum())
    model = mathopt.Model()
    x, y = model.add_variable(name="x y"), model.add_variable()
    model.maximize(3 * x - x * x - x * y - y * y + 1)
    quadratic = program_of(model)
    model.add_quadratic_constraint(x * x <= 1, name="disc")
    messages = []
    for value in (model, x, mathopt.Model()):
        try:
            program_of(value)
        except ct.CrosstrackError as error:
            messages.append(f"{type(error).__name__}: {error}")
    return {
        "differences": differences,
        "objective": -quadratic.objective(np.array([2.0, 3.0])),
        "columns": [quadratic.column_name(k) for k in range(2)],
        "messages": messages,
    }


def test_mathopt_models_keep_their_optimum() -> None:
    # In a process of its own, because OR-Tools cannot be loaded after highspy.
    pytest.importorskip("ortools", reason="OR-Tools is not installed")
    answer = elsewhere(__file__)
    assert answer["differences"] == pytest.approx([0.0] * len(SEEDS), abs=1e-7)
    assert answer["objective"] == 6 - 4 - 6 - 9 + 1
    assert answer["columns"] == ["column x y", "column [1]"]
    conic, variable, empty = answer["messages"]
    assert conic.startswith("UnsupportedFormulation") and "quadratic constraints (disc)" in conic
    assert variable.startswith("InvalidData") and "mathopt.Model, got" in variable
    assert empty.startswith("InvalidData") and "must have a variable" in empty


def test_pulp_solutions_are_assigned_by_solve() -> None:
    pulp = pytest.importorskip("pulp", reason="PuLP is not installed")
    model, x = pulp.LpProblem("furniture", pulp.LpMaximize), pulp.LpVariable("x", 0, 4, "Integer")
    model += 3 * x + 5
    model += (2 * x <= 7, "wood and time")
    solution = ct.solve(model)
    assert (solution.value, solution.bound) == (14.0, 14.0)
    assert solution.values == {"x": 3.0}
    solution.assign()
    assert x.varValue == 3 and pulp.value(model.objective) == 14.0
    assert pulp.LpStatus[model.status] == "Optimal"
    assert ct.load(model).row_name(0) == "row wood_and_time"


@pytest.mark.parametrize("maximise", [True, False])
def test_multipliers_are_derivatives_of_the_objective_of_the_author(maximise: bool) -> None:
    pulp = pytest.importorskip("pulp", reason="PuLP is not installed")
    pyo = pytest.importorskip("pyomo.environ", reason="Pyomo is not installed")
    sign = 1 if maximise else -1
    model = pulp.LpProblem("m", pulp.LpMaximize if maximise else pulp.LpMinimize)
    x, y = pulp.LpVariable("x", 0), pulp.LpVariable("y", 0)
    model += sign * (3 * x + 5 * y)
    for row in (x <= 4, 2 * y <= 12, 3 * x + 2 * y <= 18, x + y >= 1):
        model += row
    solution = ct.solve(model, "highs")
    solution.assign()
    rows = model.constraints() if callable(model.constraints) else [*model.constraints.values()]
    assert [row.pi for row in rows] == pytest.approx([0, 1.5 * sign, sign, 0])
    assert [row.slack for row in rows] == pytest.approx([2, 0, 0, -7])
    assert model.sol_status == pulp.LpSolutionOptimal
    program = ct.load(model)
    assert program.source is not None and program.source.assign is not None
    program.source.assign(np.zeros(2), None, 0.0, "feasible")
    assert model.sol_status == pulp.LpSolutionIntegerFeasible
    assert rows[0].pi is None and rows[0].slack == 4

    other = pyo.ConcreteModel()
    other.x, other.y = pyo.Var(bounds=(0, None)), pyo.Var(bounds=(0, None))
    sense = pyo.maximize if maximise else pyo.minimize
    other.cost = pyo.Objective(expr=sign * (3 * other.x + 5 * other.y), sense=sense)
    other.rows = pyo.ConstraintList()
    for row in (other.x <= 4, (-5, 2 * other.y, 12), 3 * other.x + 2 * other.y <= 18):
        other.rows.add(row)
    ct.solve(other, "highs").assign()  # a model without the suffix
    other.dual = pyo.Suffix(direction=pyo.Suffix.IMPORT)
    ct.solve(other, "highs").assign()
    assert [other.dual[row] for row in other.rows.values()] == pytest.approx([0, 1.5 * sign, sign])
    other.x.domain = pyo.Integers  # a solution without multipliers leaves none of an earlier one
    ct.solve(other, "highs").assign()
    assert not len(other.dual)


def test_pulp_refusals() -> None:
    pulp = pytest.importorskip("pulp", reason="PuLP is not installed")
    model, x = pulp.LpProblem("m"), pulp.LpVariable("x", 0, 4)
    with pytest.raises(InvalidData, match="model must have a variable"):
        ct.load(model)
    for part in (x, x + 1, x <= 3):
        with pytest.raises(
            InvalidData, match=r"model must be a pulp.LpProblem, got .* whole model"
        ):
            ct.load(part)
    model += x
    model.sos1["pick one"] = {x: 1}
    with pytest.raises(UnsupportedFormulation, match=r"special ordered sets \(pick one\)"):
        ct.load(model)
    del model.sos1["pick one"]
    model += pulp.LpAffineExpression({x: float("nan")}) <= 3
    with pytest.raises(InvalidData, match=r"matrix\[0, 0\] must be finite, got nan"):
        ct.load(model)


def quadratic_pyomo(pyo: Any) -> Any:
    model = pyo.ConcreteModel()
    model.I = pyo.Set(initialize=["a", "b c"])
    model.x = pyo.Var(model.I, bounds=(0, 4))
    model.y = pyo.Var(domain=pyo.Integers, bounds=(None, 3))
    model.w = pyo.Var(initialize=2.0)
    model.w.fix()
    model.p = pyo.Param(mutable=True, initialize=3)
    model.o = pyo.Objective(
        expr=model.x["a"] - model.y**2 * model.w + model.y * model.p + 3, sense=pyo.maximize
    )
    model.c = pyo.Constraint(expr=(-1, model.x["a"] + model.x["b c"], 5))
    model.t = pyo.Constraint(expr=model.w * model.y <= 5 + model.p)
    model.scaling_factor = pyo.Suffix(direction=pyo.Suffix.EXPORT)
    model.scaling_factor[model.y] = model.scaling_factor[model.x["a"]] = 3.0
    return model


def _agree(pyo: Any, model: Any, objective: Any, rows: dict[str, Any]) -> Any:
    """Check objective and rows of a program of a Pyomo model at random points."""
    program = ct.load(model)
    assert program.source is not None and program.source.assign is not None
    names = [program.row_name(k).removeprefix("row ") for k in range(program.row_count)]
    assert sorted(names) == sorted(rows)
    for point in np.random.default_rng(0).uniform(0.5, 3, (3, program.size)):
        program.source.assign(point, None, 0.0, "optimal")
        assert -program.objective(point) == pytest.approx(pyo.value(objective))
        values = (
            program.values(point)[1]
            if isinstance(program, NonlinearProgram)
            else program.matrix @ point
        )
        low, high = program.row_lower - values, program.row_upper - values
        for k, name in enumerate(names):
            row = rows[name]
            body = pyo.value(row.body)
            assert low[k] == pytest.approx(
                -np.inf if row.lower is None else pyo.value(row.lower) - body
            )
            assert high[k] == pytest.approx(
                np.inf if row.upper is None else pyo.value(row.upper) - body
            )
    return program


def test_pyomo_objectives_are_quadratic_or_nonlinear() -> None:
    pyo = pytest.importorskip("pyomo.environ", reason="Pyomo is not installed")
    model = quadratic_pyomo(pyo)
    program = _agree(pyo, model, model.o, {"c": model.c, "t": model.t})
    assert isinstance(program, QuadraticProgram) and program.maximise
    assert program.integral is not None and program.integral.tolist() == [False, False, True]
    assert set(program.values_of(np.ones(3))) == {"x[a]", "x[b c]", "y"}
    # A nonconvex objective and a nonlinear row: through the NL file.
    model.d = pyo.Constraint(expr=pyo.exp(model.x["a"]) * model.y >= -7)
    model.o.deactivate()
    model.o2 = pyo.Objective(expr=model.x["a"] * model.y * model.p + 1, sense=pyo.maximize)
    rows = {"c": model.c, "t": model.t, "d": model.d}
    general = _agree(pyo, model, model.o2, rows)
    assert isinstance(general, NonlinearProgram) and general.maximise
    assert general.integral is not None
    names = general.values_of(general.guess)
    limits = (general.column_lower, general.column_upper, general.integral)
    bounds = dict(zip(names, zip(*limits, strict=True), strict=True))
    assert bounds == {"x[a]": (0, 4, False), "x[b c]": (0, 4, False), "y": (-np.inf, 3, True)}


def test_pyomo_models_need_no_objective_and_may_be_abstract_blocks_or_discretised() -> None:
    pyo = pytest.importorskip("pyomo.environ", reason="Pyomo is not installed")
    dae = pytest.importorskip("pyomo.dae", reason="Pyomo is not installed")
    abstract = pyo.AbstractModel()
    abstract.inner = pyo.Block()
    abstract.inner.x = pyo.Var(bounds=(1, 2))
    abstract.inner.c = pyo.Constraint(rule=lambda block: block.x**2 <= 3)
    model = abstract.create_instance()
    program = ct.load(model)
    assert isinstance(program, NonlinearProgram)
    assert program.objective([1.5]) == 0 and program.values([1.5])[1].tolist() == [2.25]
    assert program.row_name(0) == "row inner.c"
    model.inner.c.deactivate()
    model.o = pyo.Objective(expr=model.inner.x)
    assert ct.load(model).row_count == 0
    model.inner.deactivate()
    assert ct.load(model).column_name(0) == "column inner.x"
    model = pyo.ConcreteModel()
    model.t = dae.ContinuousSet(bounds=(0, 1))
    model.x = pyo.Var(model.t)
    model.dx = dae.DerivativeVar(model.x, wrt=model.t)
    model.o = pyo.Objective(expr=model.x[1])
    model.c = pyo.Constraint(model.t, rule=lambda model, t: model.dx[t] == 1)
    with pytest.raises(UnsupportedFormulation, match=r"type DerivativeVar \(dx\)"):
        ct.load(model)
    pyo.TransformationFactory("dae.finite_difference").apply_to(model, nfe=3)
    assert ct.load(model).size == 8


def test_pyomo_refusals() -> None:
    pyo = pytest.importorskip("pyomo.environ", reason="Pyomo is not installed")
    gdp = pytest.importorskip("pyomo.gdp", reason="Pyomo is not installed")
    model = quadratic_pyomo(pyo)
    for part in (model.y, model.o, pyo.AbstractModel()):
        with pytest.raises(InvalidData, match=r"model must be a pyomo.environ.ConcreteModel"):
            ct.load(part)
    with pytest.raises(InvalidData, match="must have a variable"):
        ct.load(pyo.ConcreteModel())
    model.z = pyo.Var(within=[1, 5, 7])
    model.sos = pyo.SOSConstraint(var=model.x, sos=1)
    with pytest.raises(UnsupportedFormulation, match=r"type SOSConstraint \(sos\)"):
        ct.load(model)
    model.del_component(model.sos)
    model.pieces = pyo.Piecewise(
        model.z, model.w, pw_pts=[0, 1, 9], f_rule=[0, 1, 3], pw_constr_type="EQ", pw_repn="SOS2",
        unbounded_domain_var=True,
    )  # fmt: skip
    with pytest.raises(UnsupportedFormulation, match=r"type SOSConstraint .*pieces"):
        ct.load(model)
    model.del_component(model.pieces)
    model.on, model.off = gdp.Disjunct(), gdp.Disjunct()
    model.either = gdp.Disjunction(expr=[model.on, model.off])
    with pytest.raises(UnsupportedFormulation, match="type Disjunct"):
        ct.load(model)
    for part in (model.either, model.on, model.off):
        part.deactivate()
    model.seven = pyo.Constraint(expr=model.z <= 6)
    with pytest.raises(UnsupportedFormulation, match=r"neither real nor integer \(z\)"):
        ct.load(model)
    model.seven.deactivate()
    model.second = pyo.Objective(expr=model.y)
    with pytest.raises(UnsupportedFormulation, match=r"several objectives \(o, second\)"):
        ct.load(model)
    model.second.deactivate()
    model.unset = pyo.Param(mutable=True)
    model.needs = pyo.Constraint(expr=model.y <= model.unset)
    with pytest.raises(InvalidData, match=r"Pyomo cannot export it: .*unset"):
        ct.load(model)
    model.needs.deactivate()
    model.w.value = None
    with pytest.raises(UnsupportedFormulation, match=r"fixed without a value \(w\)"):
        ct.load(model)
    model.w.value = 2
    model.inverse = pyo.Constraint(expr=pyo.asinh(model.y) <= 1)
    with pytest.raises(UnsupportedFormulation, match=r"such as acosh or asinh .*operator 50"):
        ct.load(model)


def test_gurobi_quadratic_objectives_and_refusals() -> None:
    gp = pytest.importorskip("gurobipy", reason="gurobipy is not installed")
    case = Case.random(0)
    model = BUILDERS["gurobipy"](case)[0]
    x, y = model.addVar(name="x"), model.addVar(vtype="B", ub=5, name="y")
    model.setObjective(3 * x - x * x - x * y - y * y + 1, gp.GRB.MAXIMIZE)
    program = ct.load(model)
    assert isinstance(program, QuadraticProgram)
    place = {program.column_name(k): k for k in range(program.size)}
    assert program.column_upper[place["column y"]] == 1
    point = np.zeros(program.size)
    point[[place["column x"], place["column y"]]] = 2, 3
    assert -program.objective(point) == 6 - 4 - 6 - 9 + 1
    model.optimize()
    solution = ct.solve(program)
    assert solution.value == pytest.approx(model.ObjVal, abs=1e-6)
    with pytest.raises(InvalidData, match=r"model must be a gurobipy.Model, got"):
        ct.load(x)
    model.setObjective(x * y, gp.GRB.MAXIMIZE)
    with pytest.raises(InvalidData, match="hessian"):
        ct.load(model)
    for part, add in {
        "NumGenConstrs = 1": lambda: model.addGenConstrIndicator(y, True, x <= 1),
        "NumQConstrs = 1": lambda: model.addQConstr(x * x <= 1),
        "NumSOS = 1": lambda: model.addSOS(1, [x, y]),
        "NumPWLObjVars = 1": lambda: model.setPWLObj(x, [0, 1, 2], [0, 1, 4]),
        "NumObj = 2": lambda: [model.setObjectiveN(x, k) for k in range(2)],
    }.items():
        model.setObjective(x)
        added = add()
        with pytest.raises(UnsupportedFormulation, match=part):
            ct.load(model)
        if part == "NumPWLObjVars = 1":
            x.Obj = 1.0
        elif part != "NumObj = 2":
            model.remove(added)
    model.NumObj = 1
    x.VType = "S"
    with pytest.raises(UnsupportedFormulation, match=r"semi-continuous variables \(x\)"):
        ct.load(model)


def test_linopy_arrays_masks_scaling_and_refusals() -> None:
    linopy = pytest.importorskip("linopy", reason="linopy is not installed")
    xr = pytest.importorskip("xarray", reason="xarray is not installed")
    model = linopy.Model()
    coords = {"city": ["a", "b c"], "t": [0, 1]}
    mask = xr.DataArray([[True, False], [True, True]], coords, ["city", "t"])
    x = model.add_variables(0, 5, coords=coords.items(), name="x y", mask=mask, dims=["city", "t"])
    y = model.add_variables(0, 9, name="y")
    model.add_constraints(2 * y <= 3, name="c")
    model.add_objective(3 * y - y * y, sense="max")
    program = ct.load(model)
    assert isinstance(program, QuadraticProgram)
    assert [program.column_name(k) for k in range(4)] == [
        *("x y x y[a, 0]", "x y x y[b c, 0]", "x y x y[b c, 1]", "y"),
    ]
    plan = np.array([1.0, 2.0, 3.0, 1.5])
    assert -program.objective(plan) == 4.5 - 2.25
    assert program.source is not None and program.source.assign is not None
    program.source.assign(plan, None, 2.25, "optimal")
    assert np.array_equal(x.solution.values, [[1, np.nan], [2, 3]], equal_nan=True)
    assert y.solution.item() == 1.5 and model.objective.value == 2.25
    with pytest.raises(InvalidData, match=r"model must be a linopy.Model, got"):
        ct.load(x)
    model.objective.scaling = 4.0
    z = model.add_variables(1, 3, name="z", scaling=10.0)
    model.add_constraints(2 * z + y >= 2, name="d", scaling=5.0)
    scaled = ct.load(model)
    assert scaled.objective(np.append(plan, 3)) == program.objective(plan)
    assert (scaled.column_lower[4], scaled.column_upper[4]) == (1, 3)
    assert (scaled.matrix @ np.append(plan, 3) / scaled.row_lower)[1] == 7.5 / 2
    gate = model.add_variables(binary=True, name="gate")
    model.add_indicator_constraints(gate, 1, z <= 2, name="only if")
    with pytest.raises(UnsupportedFormulation, match=r"indicator constraints \(only if\)"):
        ct.load(model)
    model.remove_indicator_constraints("only if")
    model.add_sos_constraints(x, 1, "t")
    with pytest.raises(UnsupportedFormulation, match=r"special ordered sets \(x y\)"):
        ct.load(model)
    model.remove_sos_constraints(x)
    model.add_variables(1, 2, semi_continuous=True, name="either")
    with pytest.raises(UnsupportedFormulation, match=r"semi-continuous variables \(either\)"):
        ct.load(model)


if __name__ == "__main__":
    answer_with(main_mathopt)
