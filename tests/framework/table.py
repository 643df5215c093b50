"""Right calls of what the library offers, for :mod:`calls` to make strange."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import casadi
import numpy as np

import crosstrack as ct
from crosstrack import instances, models, solvers
from crosstrack.instances import error_correction as ec, minimum_snap as ms, optimal_control as oc
from crosstrack.models import minimum_snap as mms, optimal_control as moc
from crosstrack.solvers.contract import stopping

Call = tuple[str, Callable[..., Any], tuple[Any, ...], dict[str, Any]]

POINTS = [[0, 0, 0], [1.0, 0, 0], [1.5, 0, 0], [9, 9, 9], [3.5, 0, 0]]
KINDS = ["A", "horizontal", "vertical", "horizontal", "B"]
THROUGH = [[0.0, 0.0], [1.0, 2.0], [3.0, 2.0]]
THRESHOLDS = [0.3, 0.3, 0.3, 0.3, 0.3]


def table() -> list[Call]:
    """Return the calls; each has the arguments that make sense."""
    from strange import examples

    found: list[Call] = []

    def add(function: Any, /, *positional: Any, called: str = "", **named: Any) -> None:
        name = called or getattr(function, "__qualname__", type(function).__name__)
        found.append((name, function, positional, named))

    known = [models.Model.from_json(text) for text, _ in examples()]
    plans = [
        model.plan_from_data(json.loads(plan))
        for model, (_, plan) in zip(known, examples(), strict=True)
    ]
    routing, path, mixed, braking, slew = known[0], known[2], known[7], known[11], known[13]
    route, flight, course = plans[0], plans[2], plans[11]

    # -- models and their parts -------------------------------------------------------------------
    for model, plan, (text, written) in zip(known, plans, examples(), strict=True):
        fields = {name: getattr(model, name) for name in model.data() if hasattr(model, name)}
        if "definition" not in fields:
            add(type(model), **fields)
        data = json.loads(text)
        add(models.Model.from_dict, data)
        add(type(model).from_data, data["data"])
        add(model.plan_from_data, json.loads(written))
        add(model.as_plan, plan)
        add(model.verify, plan)
        add(
            ct.verify,
            model,
            json.loads(written),
            formulation=None,
            formulation_options={},
        )
        add(model.renamed, "x")
    add(models.Model.from_json, json.dumps(data))
    add(
        models.MinimumSnap,
        THROUGH,
        [0, 1, 3],
        velocity_limit=9.0,
        corridor_lower=[[-9.0, -9.0]],
        continuity=3,
        degree=8,
    )
    add(models.TimeAllocation, THROUGH, 100.0, None, 4, start=[[0.0, 0.0]], jerk_limit=[900.0])
    add(known[5].at, [0.0, 1.0, 3.0])
    add(models.SatelliteSlew.about, "roll", 45.0, margin=0.1, inertia=[228.0, 188.0, 176.0])
    add(models.OptimalControlProblem, "x")
    add(models.OptimalControlProblem, definition=braking.definition.data())
    add(models.Route, (0, 1, 2, 4))
    add(models.Trajectory, flight.times, flight.coefficients)
    add(models.Trajectory.from_data, flight.to_data())
    add(models.Trajectory.from_bezier, [0.0, 1.0], np.zeros((1, 4, 2)))
    add(models.Trajectory.from_ppoly, flight.to_ppoly())
    add(flight, 0.5, derivative=1, called="Trajectory()")
    add(flight.at_ends, 1)
    add(flight.extremes, 1, np.ones((2, 2)), np.array([0, 1]))
    add(flight.integral_of_square, 2)
    add(mms.derivative_name, 2)
    for one in course.phases:
        add(
            moc.Piecewise,
            one.states.knots,
            one.states.nodes,
            one.states.values,
            [-9.0, -9.0],
            [9.0, 9.0],
        )
        add(
            moc.PhasePlan,
            one.name,
            one.states,
            one.controls,
            one.state_names,
            one.control_names,
            None,
        )
        add(one.states, 0.5, derivative=0, called="Piecewise()")
        add(one.grid, 11)
        add(one.__getitem__, "x")
    add(moc.ControlPlan, course.phases, {"p": np.array([1.0])})
    add(moc.ControlPlan.from_data, course.to_data())
    add(course.phase, "phase 1")
    add(moc.motion, braking, course, 0)
    add(moc.hamiltonian_spread, braking, course)
    add(
        models.track,
        slew,
        plans[13],
        sample_time=2.0,
        after=0.0,
        disturbance=(0.1, 0.1, 0.1),
        homing=5.0,
        inertia_error=0.0,
    )
    add(models.Block, "x", "3", 0, 2, "item {0}", [[0], [1]], "m")
    add(models.ConeBlock, "x", "3", 0, 3, kind="second-order", dimension=3)
    add(models.model_type, "minimum-snap")
    add(models.Check.from_dict, routing.verify(route).checks[0].to_dict())
    add(models.Verification.from_dict, routing.verify(route).to_dict())
    add(
        _built,
        size=2,
        lower=[0.0, 0.0],
        upper=4.0,
        cost=[1.0, 2.0],
        integral=True,
        index=[0, 1],
        template="item {0}",
        name="x",
    )
    add(
        _rowed,
        terms=[([0, 1], [0, 1], 1.0)],
        count=2,
        lower=1.0,
        upper=[2.0, 3.0],
        index=[[0], [1]],
        equation="3",
        unit="m",
    )
    add(
        _coned,
        kind="second-order",
        count=1,
        dimension=3,
        terms=[([0, 1], [0, 1], 1.0)],
        offset=[1.0, 0.0, 0.0],
    )
    for function in (mixed.without_rows, known[9].without_rows):
        add(function, ["cover"])
    add(mixed.row_name, 1)
    add(mixed.column_block, "x")
    add(routing.formulate, "paper", big_m=10.0)
    add(routing.formulate, "arc-flow")
    add(path.formulate, "legendre")
    add(braking.formulate, "gauss", intervals=2)

    # -- declaring an optimal control problem -----------------------------------------------------
    add(_phase, name="go", time=(0.0, 1.0), unit="s", equation="1")
    add(
        _state,
        name="x",
        size=2,
        initial=[0.0, 0.0],
        final=(0.0, 1.0),
        lower=-9.0,
        upper=[9.0, 9.0],
        scale=1.0,
        unit="m",
    )
    add(_control, name="u", size=1, lower=-1.0, upper=1.0, scale=2.0, unit="N")
    add(_parameter, name="p", size=2, lower=-1.0, upper=1.0, guess=[0.0, 0.5], scale=2.0, unit="N")
    add(_dynamics, rates={"x": 1.0, "v": 0.5})
    add(_path, lower=-1.0, upper=[1.0], equals=None, name="cap", equation="2", unit="m", scale=2.0)
    add(_path, equals=1.0, expression=casadi.MX(2))
    add(_subject, lower=-1.0, upper=1.0, name="cap", scale=1.0)
    add(_guess, time=[0.0, 0.5, 1.0], x=[0.0, 1.0, 2.0], u=0.5)
    add(_guess, plan=course)
    add(_minimised, objective=1.0, unit="m")

    # -- verbs --------------------------------------------------------------------------------------
    common = {
        "time_limit": 1.0,
        "gap": 1e-3,
        "seed": None,
        "threads": 1,
        "evaluations": None,
        "target": None,
    }
    for model in (routing, mixed, known[8]):
        add(ct.solve, model, "auto", **common)
        add(
            ct.solve,
            model,
            **common,
            stop=None,
            warm_start=None,
            starts=1,
            backend_options={},
            formulation_options={},
            isolate=False,
        )
    add(
        ct.compare,
        [routing],
        ["label-setting"],
        time_limit=1.0,
        workers=1,
        repeats=1,
        warm_start=[None],
        pool=None,
        record=None,
    )
    add(
        ct.compare,
        routing,
        "label-setting",
        time_limit=1.0,
        backend_options={"label-setting": {}},
        seed=None,
    )
    add(ct.diagnose, routing, None, time_limit=1.0)
    add(ct.load, "error-correction/example-1")
    add(solvers.find_backend, "highs", routing)
    add(solvers.register_backend, solvers.find_backend("label-setting"))
    add(solvers.relative_gap, 1.0, 0.5)
    for criterion, value in (
        ("Seconds", 1.0),
        ("Evaluations", 3),
        ("Target", 1.0),
        ("Stalled", 1.0),
    ):
        add(getattr(stopping, criterion), value)
    add(stopping.AnyOf, (stopping.Seconds(1.0),))
    add(stopping.AllOf, (stopping.Seconds(1.0), stopping.Stalled(1.0)))
    add(solvers.Option(1.0, "x", lower=0.0, upper=9.0).check, "owner", "name", 3.0)
    add(solvers.find_backend("highs").checked_options, {"presolve": True})
    stored = ct.solve(routing, "label-setting").to_dict()
    add(ct.Solution.from_dict, stored)
    add(ct.Solution.from_dict, stored, routing)

    # -- instances ----------------------------------------------------------------------------------
    add(ec.generate, 3, 3, [9.0] * 5, seed=1, delta=0.001, box=1000.0, name="x")
    add(ec.uniform_slab, 5, THRESHOLDS, seed=1, size=(9.0, 9.0, 9.0), delta=0.1)
    add(ec.random_small, 5, 1, revisits=False, name="x")
    add(ec.setting_model, 1)
    add(ms.random_walk, 4, 2, 0, step=1.0, speed=1.0, name="x")
    add(ms.random_waypoints, 4, 2, 0, step=1.0)
    add(ms.figure_eight, 8, 3, size=2.0, height=1.0, climb=0.3, lap=12.0)
    add(ms.helix, 2, 8, radius=1.0, pitch=0.5, speed=1.0)
    add(ms.square, 2.0, 1, speed=1.0)
    add(ms.corridor, 6, 0, 2, cruise=2.0, acceleration=1.2, width=0.4, slack=0.05)
    add(ms.gates, 4, 0, width=0.3, speed=1.0)
    add(ms.hurried, 8, 4, 0)
    add(ms.times_by_distance, THROUGH, 1.0, shortest=0.1, ramp=0.0)
    add(ms.sample_columns, 2, 4)
    add(ms.Poly7, np.ones(2), np.zeros((2, 4, 8)))
    add(oc.bryson_denham, "x", limit=0.1)
    add(oc.hypersensitive, "x", horizon=10.0)
    add(oc.rayleigh, "x", horizon=4.5, limited=True)
    add(oc.van_der_pol, "x", state_limit=-0.4)
    add(oc.brachistochrone, "x", gravity=9.8)
    add(oc.dido, "x", length=2.0)
    add(oc.double_integrator_fuel, "x", duration=2.5)
    add(oc.linear_regulator, "x", horizon=2.0)
    add(
        instances.CatalogueEntry,
        "mine/one",
        "error-correction",
        "title",
        "paper",
        "ours",
        lambda: routing,
        {"a": 1},
        "note",
    )
    add(instances.entry, "error-correction/7")
    add(instances.export_formats, path)
    add(instances.export_plan, path, flight, "out.csv", "samples")
    for name in (
        "read_bezier",
        "read_csv",
        "read_model",
        "read_points",
        "read_poly7",
        "read_samples",
        "read_waypoints",
    ):
        add(getattr(instances, name), "there.is.none")
    add(instances.read_csv, "there.is.none", name="x", alpha1=1.0)
    add(instances.read_plan, path, "there.is.none")
    add(instances.write_text, "out.txt", "text")
    add(instances.write_model, path, "out.json")
    add(instances.write_csv, routing, "out.csv")
    add(instances.write_json, routing, "out.json", points="points.csv")
    add(instances.write_bezier, flight, "out.json")
    add(
        instances.write_poly7,
        models.Trajectory([0, 1], np.zeros((1, 8, 3))),
        "out.csv",
        yaw=0.0,
        precision="float32",
        strict=False,
    )
    add(instances.write_samples, flight, "out.csv", derivatives=2)
    add(instances.write_control_samples, course, "out.csv")
    return found


def _built(**options: Any) -> Any:
    builder = models.ProgramBuilder()
    name, size = options.pop("name"), options.pop("size")
    builder.columns(name, size, **options)
    return builder.build()


def _rowed(terms: Any, count: Any, **options: Any) -> Any:
    builder = models.ProgramBuilder()
    builder.columns("x", 2)
    builder.rows("r", count, *_spread(terms), **options)
    return builder.build()


def _coned(kind: Any, count: Any, dimension: Any, terms: Any, offset: Any) -> Any:
    builder = models.ProgramBuilder()
    builder.columns("x", 2)
    builder.cones("c", kind, count, dimension, *_spread(terms), offset=offset)
    return builder.build_conic()


def _spread(terms: Any) -> Any:
    return terms if isinstance(terms, list) else [terms]


def _declared() -> tuple[Any, Any]:
    problem = models.OptimalControlProblem("x")
    phase = problem.phase(time=(0, 1))
    x, v = phase.state("x"), phase.state("v")
    u = phase.control("u")
    phase.dynamics({x: v, v: u})
    problem.minimise(phase.integral(u**2))
    return problem, phase


def _phase(**options: Any) -> Any:
    return models.OptimalControlProblem("x").phase(**options)


def _state(**options: Any) -> Any:
    return models.OptimalControlProblem("x").phase().state(**options)


def _control(**options: Any) -> Any:
    return models.OptimalControlProblem("x").phase().control(**options)


def _parameter(**options: Any) -> Any:
    return models.OptimalControlProblem("x").parameter(**options)


def _dynamics(rates: Any) -> Any:
    phase = models.OptimalControlProblem("x").phase()
    phase.state("x")
    phase.state("v")
    return phase.dynamics(rates)


def _path(expression: Any = None, **options: Any) -> Any:
    problem, phase = _declared()
    phase.path(phase.symbols["x"] if expression is None else expression, **options)
    return problem.build()


def _subject(**options: Any) -> Any:
    problem, phase = _declared()
    problem.subject_to(phase.final(phase.symbols["x"]), **options)
    return problem.build()


def _guess(**options: Any) -> Any:
    problem, phase = _declared()
    phase.guess(**options)
    return problem.build()


def _minimised(objective: Any, unit: Any) -> Any:
    problem, _ = _declared()
    problem.minimise(objective, unit=unit)
    return problem.build()
