"""SCIP and GLOP inside OR-Tools, through MathOpt."""

from __future__ import annotations

import datetime
from typing import Any

import numpy as np

from ...models.programs.linear import MixedIntegerProgram
from ..contract.backend import Feature, Limit, Request
from ..programs.attempts import (
    Clock,
    Ended,
    Ending,
    Meaning,
    forward_stop,
    solver_tolerance,
    stop_reason,
)
from ..programs.highs_library import ORTOOLS_MARKS
from .base import CALLED_BACK, Incumbents, ProgramBackend, with_cutoff_row

__all__ = ["MathOpt"]


class MathOpt(ProgramBackend):
    """Backend for OR-Tools' MathOpt: its own build of SCIP, and GLOP for linear programs.

    MathOpt's HiGHS is not offered, because version 9.15 can neither interrupt it nor limit its threads.
    With callbacks to SCIP, that version writes two lines to standard error, an error of
    ``SCIPcatchEvent`` about one of several event types. Incumbents and stop requests work anyway.
    """

    name = "ortools"
    features = CALLED_BACK | {Feature.DUALS}
    single_threaded = True
    requires = ("ortools",)
    extra = "ortools"
    # See Highs: the libhighs.so.1 of the two packages conflict.
    conflict_group = "highs"
    natives = ORTOOLS_MARKS
    summary = "OR-Tools MathOpt: SCIP for mixed-integer, GLOP for linear programs"

    def attempt(self, program: MixedIntegerProgram, request: Request, clock: Clock) -> Ending:
        """Solve the program with MathOpt."""
        from ortools.math_opt.python import mathopt
        from ortools.util.python.solve_interrupter import SolveInterrupter

        posed = with_cutoff_row(program, request.cutoff)
        model = _model(mathopt, posed)
        columns = list(model.variables())
        types = mathopt.SolverType
        kind = types.GLOP if program.continuous else types.GSCIP
        parameters = _parameters(mathopt, kind, request)
        more: dict[str, Any] = {}
        if kind is types.GSCIP:
            more = _callbacks(mathopt, program, request)
        if request.warm_start is not None and kind is types.GSCIP:
            values = np.asarray(request.warm_start, float).tolist()
            hint = mathopt.SolutionHint(variable_values=dict(zip(columns, values, strict=True)))
            more["model_params"] = mathopt.ModelSolveParameters(solution_hints=[hint])
        interrupter = SolveInterrupter()
        clock.lap("build")
        left = clock.left()
        if left is not None:
            parameters.time_limit = datetime.timedelta(seconds=left)
        try:
            with forward_stop(request.control, interrupter.interrupt):
                result = mathopt.solve(
                    model, kind, params=parameters, interrupter=interrupter, **more
                )
        except (AttributeError, RuntimeError) as error:
            return _ending_of_error(error)
        finally:
            clock.lap("solve")
        return _ending(mathopt, result, program, request)


def _model(mathopt: Any, program: MixedIntegerProgram) -> Any:
    """Return the model, built from arrays because adding rows one by one takes ten times as long."""
    from ortools.math_opt import model_pb2, sparse_containers_pb2

    costs = np.flatnonzero(program.cost)
    matrix = program.matrix.tocoo()
    order = np.lexsort((matrix.col, matrix.row))
    proto = model_pb2.ModelProto(
        variables=model_pb2.VariablesProto(
            ids=range(program.size),
            lower_bounds=program.column_lower,
            upper_bounds=program.column_upper,
            integers=program.integral,
        ),
        objective=model_pb2.ObjectiveProto(
            offset=program.offset,
            linear_coefficients=sparse_containers_pb2.SparseDoubleVectorProto(
                ids=costs, values=program.cost[costs]
            ),
        ),
        linear_constraints=model_pb2.LinearConstraintsProto(
            ids=range(program.row_count),
            lower_bounds=program.row_lower,
            upper_bounds=program.row_upper,
        ),
        linear_constraint_matrix=sparse_containers_pb2.SparseDoubleMatrixProto(
            row_ids=matrix.row[order],
            column_ids=matrix.col[order],
            coefficients=matrix.data[order],
        ),
    )
    return mathopt.Model.from_model_proto(proto)


def _parameters(mathopt: Any, kind: Any, request: Request) -> Any:
    parameters = mathopt.SolveParameters(enable_output=request.verbose)
    if request.seed is not None:
        parameters.random_seed = request.seed % (2**31)
    # The smallest tolerance of SCIP is its epsilon, 1e-9.
    tolerance = solver_tolerance(request, 1e-9)
    if kind is mathopt.SolverType.GLOP:
        parameters.glop.primal_feasibility_tolerance = tolerance
        parameters.glop.dual_feasibility_tolerance = tolerance
        return parameters
    parameters.relative_gap_tolerance = request.gap
    parameters.absolute_gap_tolerance = 0.0
    parameters.gscip.real_params["numerics/feastol"] = tolerance
    parameters.gscip.real_params["numerics/dualfeastol"] = tolerance
    parameters.gscip.bool_params["misc/catchctrlc"] = False
    return parameters


def _callbacks(mathopt: Any, program: MixedIntegerProgram, request: Request) -> dict[str, Any]:
    incumbents = Incumbents(program, request)

    event = mathopt.Event

    def report(data: Any) -> Any:
        if data.mip_stats.dual_bound is not None:
            incumbents.prove(data.mip_stats.dual_bound)
        if data.event is not event.MIP_SOLUTION:
            return mathopt.CallbackResult()
        point = np.zeros(program.size)
        for column, value in (data.solution or {}).items():
            point[column.id] = value
        incumbents.report(point)
        return mathopt.CallbackResult()

    registration = mathopt.CallbackRegistration(
        events={event.MIP_SOLUTION, event.MIP_NODE},
        mip_node_filter=mathopt.VariableFilter(filtered_items=()),  # points of nodes are not needed
    )
    return {"cb": report, "callback_reg": registration}


def _ending_of_error(error: Exception) -> Ending:
    """Return the ending for an exception of MathOpt.

    Version 9.15 raises an ``AttributeError`` while converting its solver's error, which is then the
    context of the exception. One of the errors is not a failure: for an unbounded program, SCIP
    returns a point with objective -inf, which MathOpt rejects.
    """
    cause = error
    if isinstance(error, AttributeError):
        if error.__context__ is None:
            raise error
        cause = error.__context__  # type: ignore[assignment]
    message = str(cause)
    if "-inf; invalid PrimalSolutionProto.objective_value" in message:
        return Ending(Ended.UNCLEAR)
    return Ending(Ended.FAILED, message=f"MathOpt: {message}")


def _ending(mathopt: Any, result: Any, program: MixedIntegerProgram, request: Request) -> Ending:
    reason, limits = mathopt.TerminationReason, mathopt.Limit
    termination = result.termination
    stopped = {
        limits.TIME: Limit.TIME,
        limits.MEMORY: Limit.MEMORY,
        limits.INTERRUPTED: stop_reason(request.control),
    }.get(termination.limit, Limit.ITERATIONS)
    meanings: dict[Any, Meaning] = {
        reason.OPTIMAL: Ended.PROVEN,
        reason.INFEASIBLE: Ended.INFEASIBLE,
        reason.UNBOUNDED: Ended.UNBOUNDED,
        reason.INFEASIBLE_OR_UNBOUNDED: Ended.UNCLEAR,
        reason.FEASIBLE: (Ended.STOPPED, stopped),
        reason.NO_SOLUTION_FOUND: (Ended.STOPPED, stopped),
    }
    point, duals = None, None
    best = result.solutions[0] if result.solutions else None
    if best is not None and best.primal_solution is not None:
        point = np.zeros(program.size)
        for column, value in best.primal_solution.variable_values.items():
            point[column.id] = value
    if program.continuous and best is not None and best.dual_solution is not None:
        duals = np.zeros(program.row_count)
        for row, value in best.dual_solution.dual_values.items():
            duals[row.id] = value
    return Ending.read(
        "MathOpt",
        termination.reason,
        meanings,
        f"{termination.reason.name} {termination.detail}",
        point=point,
        bound=float(termination.objective_bounds.dual_bound),
        duals=duals,
        statistics={
            "nodes": int(result.solve_stats.node_count),
            "simplex iterations": int(result.solve_stats.simplex_iterations),
        },
    )
