"""Gurobi through gurobipy."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ...errors import BackendBroken
from ...models.programs.linear import MixedIntegerProgram, QuadraticProgram
from ..contract.backend import Feature, Limit, Request
from ..programs.attempts import (
    Clock,
    Ended,
    Ending,
    Meaning,
    forward_stop,
    loosened_cutoff,
    solver_tolerance,
    stop_reason,
)
from .base import CALLED_BACK, Incumbents, IntegerProgram, ProgramBackend

__all__ = ["Gurobi"]

#: Gurobi's error numbers for a missing licence, and for a program that exceeds the licence.
NO_LICENCE, SIZE_LIMITED = 10009, 10010


class Gurobi(ProgramBackend):
    """Backend for Gurobi: mixed-integer and integer quadratic programs.

    The licence in its package permits at most 2000 rows and 2000 columns.
    """

    name = "gurobi"
    accepts = (MixedIntegerProgram, QuadraticProgram)
    integral_kinds = integral_only = ("quadratic-program",)
    features = CALLED_BACK | {Feature.THREADS, Feature.DUALS}
    requires = ("gurobipy",)
    extra = "gurobi"
    summary = "Gurobi: commercial; without a licence only small programs"

    def attempt(self, program: IntegerProgram, request: Request, clock: Clock) -> Ending:
        """Solve the program with Gurobi."""
        import gurobipy

        try:
            with (
                gurobipy.Env(params=_parameters(program, request)) as environment,
                gurobipy.Model(env=environment) as model,
            ):
                return _solve(gurobipy, model, program, request, clock)
        except gurobipy.GurobiError as error:
            if error.errno == SIZE_LIMITED:
                raise BackendBroken(
                    f"backend 'gurobi': the program has {program.row_count} rows and "
                    f"{program.size} columns, but the licence in gurobipy permits 2000 of each: "
                    "install a licence, or solve with another backend, such as 'highs'"
                ) from error
            if error.errno == NO_LICENCE:
                raise BackendBroken(f"backend 'gurobi': no valid licence: {error}") from error
            raise


def _parameters(program: IntegerProgram, request: Request) -> dict[str, Any]:
    tolerance = solver_tolerance(request, 1e-9, 1e-2)
    parameters: dict[str, Any] = {
        "OutputFlag": int(request.verbose),
        "MIPGap": request.gap,
        "MIPGapAbs": 0.0,
        "FeasibilityTol": tolerance,
        "OptimalityTol": tolerance,
        "IntFeasTol": tolerance,
    }
    if request.seed is not None:
        parameters["Seed"] = request.seed % 2_000_000_000
    if request.threads is not None:
        parameters["Threads"] = request.threads
    if request.cutoff is not None and not program.continuous:
        parameters["Cutoff"] = loosened_cutoff(request.cutoff)
    return parameters


def _solve(
    gurobipy: Any, model: Any, program: IntegerProgram, request: Request, clock: Clock
) -> Ending:
    grb = gurobipy.GRB
    columns = model.addMVar(
        program.size,
        lb=program.column_lower,
        ub=program.column_upper,
        obj=program.cost,
        vtype=np.where(np.asarray(program.integral), grb.INTEGER, grb.CONTINUOUS),
    )
    if isinstance(program, QuadraticProgram):
        model.setObjective(columns @ (0.5 * program.hessian) @ columns + program.cost @ columns)
    model.ObjCon = program.offset
    rows = _add_rows(model, program, columns)
    if request.warm_start is not None and not program.continuous:
        columns.Start = np.asarray(request.warm_start, float)
    incumbents = Incumbents(program, request)

    def report(model: Any, where: int) -> None:
        if where == grb.Callback.MIPSOL:
            incumbents.report(np.array(model.cbGetSolution(columns), float))
        elif where == grb.Callback.MIP:
            incumbents.prove(float(model.cbGet(grb.Callback.MIP_OBJBND)))

    clock.lap("build")
    left = clock.left()
    if left is not None:
        model.Params.TimeLimit = left
    with forward_stop(request.control, model.terminate):
        model.optimize(report)
    clock.lap("solve")
    return _ending(grb, model, program, request, columns, rows)


def _add_rows(model: Any, program: IntegerProgram, columns: Any) -> list[tuple[Any, Any]]:
    """Add the rows and return, for each sense, their indices and Gurobi's constraints.

    A two-sided row becomes two constraints, because Gurobi has none; their duals are added.
    """
    return [
        (which, model.addMConstr(program.matrix[which], columns, sense, bound))
        for sense, which, bound in program.sides()
    ]


def _ending(
    grb: Any,
    model: Any,
    program: IntegerProgram,
    request: Request,
    columns: Any,
    rows: list[tuple[Any, Any]],
) -> Ending:
    exhausted = Ended.STOPPED, Limit.ITERATIONS
    meanings: dict[int, Meaning] = {
        grb.OPTIMAL: Ended.PROVEN,
        grb.INFEASIBLE: Ended.INFEASIBLE,
        grb.CUTOFF: Ended.INFEASIBLE,
        grb.UNBOUNDED: Ended.UNBOUNDED,
        grb.INF_OR_UNBD: Ended.UNCLEAR,
        grb.TIME_LIMIT: (Ended.STOPPED, Limit.TIME),
        grb.MEM_LIMIT: (Ended.STOPPED, Limit.MEMORY),
        grb.ITERATION_LIMIT: exhausted,
        grb.NODE_LIMIT: exhausted,
        grb.SOLUTION_LIMIT: exhausted,
        grb.WORK_LIMIT: exhausted,
        # All nodes are processed, but the optimum is not within the tolerances.
        grb.SUBOPTIMAL: Ended.STOPPED,
        grb.INTERRUPTED: (Ended.STOPPED, stop_reason(request.control)),
    }
    ending = Ending.read("Gurobi", model.Status, meanings, f"status {model.Status}")
    point, duals, bound = None, None, None
    if model.SolCount and ending.ended is not Ended.UNBOUNDED:
        point = np.array(columns.X, float)
    if not program.continuous:
        bound = float(model.ObjBound)
    elif ending.ended is Ended.PROVEN:
        bound = float(model.ObjVal)
        duals = np.zeros(program.row_count)
        for which, constraints in rows:
            duals[which] += np.asarray(constraints.Pi)
    counts = {"nodes": int(model.NodeCount), "simplex iterations": int(model.IterCount)}
    return replace(ending, point=point, bound=bound, duals=duals, statistics=counts)
