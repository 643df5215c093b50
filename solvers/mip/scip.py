"""SCIP through PySCIPOpt."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...models.programs.curvature import CURVATURE
from ...models.programs.linear import MixedIntegerProgram, QuadraticProgram
from ..contract.backend import Feature, Limit, Option, Request
from ..programs.attempts import (
    Clock,
    Ended,
    Ending,
    Meaning,
    ending_if_stopped,
    forward_stop,
    limit_reached,
    loosened_cutoff,
    solver_tolerance,
    stop_reason,
)
from .base import CALLED_BACK, Incumbents, IntegerProgram, ProgramBackend

__all__ = ["Scip"]

Vector = NDArray[np.float64]

#: Rows or columns between two checks of the clock while the program is built at 1e5 rows per second.
LOOK = 1000
#: Largest number of columns of the Hessian that is factorised as a dense matrix.
DENSE = 1000


class Scip(ProgramBackend):
    """Backend for SCIP: branch, cut and price on one thread, for integer quadratic programs as well."""

    name = "scip"
    accepts = (MixedIntegerProgram, QuadraticProgram)
    integral_kinds = integral_only = ("quadratic-program",)
    features = CALLED_BACK | {Feature.DUALS}
    single_threaded = True
    requires = ("pyscipopt",)
    extra = "scip"
    options: ClassVar[Mapping[str, Option]] = {
        "memory_limit": Option(
            None, "Deprecated: MiB; use memory_limit of the call.", float, lower=1
        ),
    }
    summary = "SCIP: branch and cut with constraint propagation; integer quadratic programs"

    def attempt(self, program: IntegerProgram, request: Request, clock: Clock) -> Ending:
        """Solve the program with SCIP."""
        import pyscipopt

        model = pyscipopt.Model()
        _configure(pyscipopt, model, program, request)
        columns, rows = _build(model, program, request, clock)
        late = ending_if_stopped(request, clock)
        if late is not None:
            clock.lap("build")
            return late
        point = (
            np.zeros(program.size)
            if request.warm_start is None
            else np.asarray(request.warm_start, float)
        )
        values = [*zip(columns, point.tolist(), strict=True)]
        if isinstance(program, QuadraticProgram):
            values += _add_curvature(model, program, columns, point)
        if request.warm_start is not None:
            start = model.createSol()
            for column, value in values:
                model.setSolVal(start, column, value)
            model.addSol(start)
        active_events = _listen(pyscipopt, model, program, request, columns)
        clock.lap("build")
        left = clock.left()
        if left is not None:
            model.setParam("limits/time", left)
        with forward_stop(request.control, model.interruptSolve):
            model.optimizeNogil()
        clock.lap("solve")
        # Freeing the tree raises its bound to the incumbent, and reports it.
        active_events.clear()
        ending = _ending(model, program, request, columns, rows)
        model.freeProb()
        return ending


def _configure(pyscipopt: Any, model: Any, program: IntegerProgram, request: Request) -> None:
    model.hideOutput(quiet=not request.verbose)
    # SCIP forbids a feasibility tolerance below its epsilon, 1e-9.
    tolerance = solver_tolerance(request, 1e-9)
    model.setParams(
        {
            # SCIP's Ctrl-C handler would hide the signal from the caller.
            "misc/catchctrlc": False,
            "limits/gap": request.gap,
            "limits/absgap": 0.0,
            "numerics/feastol": tolerance,
            "numerics/dualfeastol": tolerance,
        }
    )
    if request.seed is not None:
        model.setParam("randomization/randomseedshift", request.seed % (2**31))
    if request.cutoff is not None and not program.continuous:
        model.setObjlimit(loosened_cutoff(request.cutoff))
    memory = request.options["memory_limit"]
    if memory is not None:
        warnings.warn(
            "the option memory_limit of backend 'scip' is deprecated: use memory_limit of the call",
            DeprecationWarning,
            stacklevel=2,
        )
        model.setParam("limits/memory", memory)
    if program.continuous:
        # Duals belong to the given rows only if presolve and cuts do not change these.
        model.setPresolve(pyscipopt.SCIP_PARAMSETTING.OFF)
        model.setHeuristics(pyscipopt.SCIP_PARAMSETTING.OFF)
        model.setSeparating(pyscipopt.SCIP_PARAMSETTING.OFF)
        model.disablePropagation()


def _build(
    model: Any, program: IntegerProgram, request: Request, clock: Clock
) -> tuple[list[Any], list[Any]]:
    """Add columns and rows until the run must stop.

    Expressions are built from dictionaries, because summing terms has quadratic cost. Reading the
    program as MPS text takes a third longer and loses empty rows.
    """
    from pyscipopt.scip import Expr, ExprCons, Term

    def until_stopped(items: Iterable[Any]) -> Iterator[Any]:
        for count, item in enumerate(items):
            if count % LOOK == 0 and limit_reached(request, clock) is not None:
                return
            yield item

    columns = [
        model.addVar(
            "",
            vtype="I" if is_integer else "C",
            lb=None if low == -np.inf else low,
            ub=None if high == np.inf else high,
            obj=cost,
        )
        for is_integer, low, high, cost in until_stopped(
            zip(
                np.asarray(program.integral).tolist(),
                program.column_lower.tolist(),
                program.column_upper.tolist(),
                program.cost.tolist(),
                strict=True,
            )
        )
    ]
    terms = [Term(column) for column in columns]
    matrix = program.matrix
    start, index, value = matrix.indptr.tolist(), matrix.indices.tolist(), matrix.data.tolist()
    rows: list[Any] = []
    sides = zip(program.row_lower.tolist(), program.row_upper.tolist(), strict=True)
    for row, (low, high) in enumerate(until_stopped(sides)):
        span = range(start[row], start[row + 1])
        if not span or (low == -np.inf and high == np.inf):
            rows.append(None)
            continue
        expression = Expr({terms[index[k]]: value[k] for k in span})
        bounds = {
            "lhs": None if low == -np.inf else low,
            "rhs": None if high == np.inf else high,
        }
        rows.append(model.addCons(ExprCons(expression, **bounds), modifiable=program.continuous))
    model.addObjoffset(program.offset)
    model.setMinimize()
    return columns, rows


def _add_curvature(
    model: Any, program: QuadraticProgram, columns: list[Any], point: Vector
) -> list[tuple[Any, float]]:
    """Add the quadratic part of the objective, and return the new columns with their values at `point`.

    SCIP accepts linear objectives only. Each square gets a column of its own, because that solved
    integer programs of 14 and 30 columns 3 to 6 times faster than one column for the sum. With one
    column and unbounded integers, SCIP found no bound.
    """
    from pyscipopt.scip import Expr, ExprCons, Term

    factor = _factor(program)
    if factor is None:
        upper = sp.coo_array(sp.triu(program.hessian))
        terms = {
            Term(columns[i], columns[j]): 0.5 * value if i == j else value
            for i, j, value in zip(*upper.coords, upper.data.tolist(), strict=True)
        }
        total = model.addVar("", lb=None, obj=1.0)
        model.addCons(ExprCons(Expr({**terms, Term(total): -1.0}), rhs=0.0))
        return [(total, float(point @ (program.hessian @ point)) / 2)]
    added = []
    for row, value in zip(factor, (factor @ point).tolist(), strict=True):
        root, square = model.addVar("", lb=None), model.addVar("", obj=1.0)
        terms = {Term(columns[i]): float(row[i]) for i in np.flatnonzero(row)}
        model.addCons(ExprCons(Expr({**terms, Term(root): -1.0}), lhs=0.0, rhs=0.0))
        model.addCons(ExprCons(Expr({Term(root, root): 1.0, Term(square): -1.0}), rhs=0.0))
        added += [(root, value), (square, value**2)]
    return added


def _factor(program: QuadraticProgram) -> Vector | None:
    """Return F with ``F.T @ F = hessian / 2``; None if the Hessian is large or not semidefinite."""
    from scipy.linalg.lapack import dpstrf

    places = np.flatnonzero(program.hessian.diagonal())
    if places.size > DENSE:
        return None
    half = program.hessian[places][:, places].toarray() / 2
    if not places.size:
        return np.zeros((0, program.size))
    upper, order, rank, _ = dpstrf(half)
    factor = np.zeros((rank, program.size))
    factor[:, places[order - 1]] = np.triu(upper)[:rank]
    error = np.abs(factor[:, places].T @ factor[:, places] - half).max()
    return factor if error <= CURVATURE * np.abs(half).max() else None


def _listen(
    pyscipopt: Any, model: Any, program: IntegerProgram, request: Request, columns: list[Any]
) -> set[int]:
    """Report improved points and bounds as long as the returned set is not empty."""
    incumbents = Incumbents(program, request)
    kinds = pyscipopt.SCIP_EVENTTYPE
    best, bound = kinds.BESTSOLFOUND, kinds.DUALBOUNDIMPROVED
    active_events = {best, bound}

    class Listener(pyscipopt.Eventhdlr):  # type: ignore[misc]
        def eventinit(self) -> None:
            self.model.catchEvent(best, self)
            self.model.catchEvent(bound, self)

        def eventexit(self) -> None:
            self.model.dropEvent(best, self)
            self.model.dropEvent(bound, self)

        def eventexec(self, event: Any) -> None:
            if not active_events:
                return
            if event.getType() == best:
                incumbents.report(_values(self.model, self.model.getBestSol(), columns))
            incumbents.prove(float(self.model.getDualbound()))

    model.includeEventhdlr(Listener(), "crosstrack incumbents", "reports better solutions")
    return active_events


def _values(model: Any, solution: Any, columns: list[Any]) -> Vector:
    return np.array([model.getSolVal(solution, column) for column in columns], float)


def _ending(
    model: Any, program: IntegerProgram, request: Request, columns: list[Any], rows: list[Any]
) -> Ending:
    interrupted = Ended.STOPPED, stop_reason(request.control)
    exhausted = Ended.STOPPED, Limit.ITERATIONS
    meanings: dict[str, Meaning] = {
        "optimal": Ended.PROVEN,
        "gaplimit": Ended.PROVEN,
        "infeasible": Ended.INFEASIBLE,
        "unbounded": Ended.UNBOUNDED,
        "inforunbd": Ended.UNCLEAR,
        "timelimit": (Ended.STOPPED, Limit.TIME),
        "memlimit": (Ended.STOPPED, Limit.MEMORY),
        "userinterrupt": interrupted,
        "terminate": interrupted,
        "nodelimit": exhausted,
        "totalnodelimit": exhausted,
        "stallnodelimit": exhausted,
        "restartlimit": exhausted,
        "sollimit": exhausted,
        "bestsollimit": exhausted,
    }
    ending = Ending.read("SCIP", model.getStatus(), meanings)
    point, duals = None, None
    if model.getNSols() and ending.ended is not Ended.UNBOUNDED:
        point = _values(model, model.getBestSol(), columns)
    if program.continuous and ending.ended is Ended.PROVEN:
        duals = np.array([0.0 if row is None else model.getDualsolLinear(row) for row in rows])
    return replace(
        ending,
        point=point,
        bound=None if ending.ended is Ended.UNBOUNDED else float(model.getDualbound()),
        duals=duals,
        statistics={
            "nodes": int(model.getNTotalNodes()), "LP iterations": int(model.getNLPIterations())
        },
    )  # fmt: skip
