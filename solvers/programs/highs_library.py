"""HiGHS through highspy: tools shared by its runs on linear, mixed-integer and quadratic programs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ...errors import InvalidData, UnsupportedOption
from ...models.programs.base import RowProgram
from ...models.verification import ROUNDING
from ..contract.backend import Limit, Request
from .attempts import Clock, Ended, Meaning, stop_reason

__all__ = ["ORTOOLS_MARKS", "meanings", "run_highs"]

#: Modules whose presence shows that the HiGHS library of OR-Tools is loaded.
ORTOOLS_MARKS = (
    "ortools.constraint_solver._pywrapcp",
    "ortools.math_opt.core.python.solver",
    "ortools.sat.python.cp_model_helper",
)


def run_highs(
    program: RowProgram,
    integral: Any,
    options: Mapping[str, Any],
    request: Request,
    clock: Clock,
    prepare: Callable[[Any], None],
) -> Any:
    """Solve a program and return the ``highspy.Highs``; `clock` counts ``"build"`` and ``"solve"``.

    `options` are those of HiGHS in addition to seed, threads and time limit. ``prepare(highs)`` passes further
    data: a start, callbacks, a Hessian. Raise ``UnsupportedOption`` or ``InvalidData`` if HiGHS rejects an option
    or the program; otherwise it would solve an empty program.
    """
    import highspy

    highs = highspy.Highs()
    settings = {"output_flag": request.verbose, **options}
    if request.seed is not None:
        settings["random_seed"] = request.seed % (2**31)
    if request.threads is not None:
        # The scheduler is global to the process and keeps its number of threads.
        highspy.Highs.resetGlobalScheduler(True)
        settings["threads"] = request.threads
    for name, value in settings.items():
        if highs.setOptionValue(name, value) == highspy.HighsStatus.kError:
            raise UnsupportedOption(f"backend 'highs': HiGHS refuses {name} = {value!r}")
    matrix = program.matrix
    # HiGHS left an integer column that no row limits at its bound of 7.5.
    is_integer, low, high = integral > 0, program.column_lower, program.column_upper
    low = np.where(is_integer, np.ceil(low - ROUNDING), low)
    high = np.where(is_integer, np.floor(high + ROUNDING), high)
    passed = highs.passModel(
        program.size, program.row_count, matrix.nnz,
        int(highspy.MatrixFormat.kRowwise), int(highspy.ObjSense.kMinimize), program.offset,
        program.cost, low, high, program.row_lower, program.row_upper,
        matrix.indptr.astype(np.int32), matrix.indices.astype(np.int32), matrix.data,
        integral.astype(np.int32),
    )  # fmt: skip
    if passed == highspy.HighsStatus.kError:
        raise InvalidData(f"backend 'highs': HiGHS refuses the program ({program.outline()})")
    prepare(highs)
    clock.lap("build")
    left = clock.left()
    if left is not None:
        highs.setOptionValue("time_limit", left)
    try:
        highs.run()
    finally:
        if request.threads is not None:
            highspy.Highs.resetGlobalScheduler(True)
    clock.lap("solve")
    return highs


def meanings(request: Request) -> dict[Any, Meaning]:
    """Return the ending that each status of HiGHS means."""
    import highspy

    state: Any = highspy.HighsModelStatus
    interrupted = Ended.STOPPED, stop_reason(request.control)
    return {
        state.kOptimal: Ended.PROVEN,
        state.kInfeasible: Ended.INFEASIBLE,
        state.kUnbounded: Ended.UNBOUNDED,
        state.kUnboundedOrInfeasible: Ended.UNCLEAR,
        state.kTimeLimit: (Ended.STOPPED, Limit.TIME),
        state.kIterationLimit: (Ended.STOPPED, Limit.ITERATIONS),
        state.kSolutionLimit: (Ended.STOPPED, Limit.ITERATIONS),
        state.kMemoryLimit: (Ended.STOPPED, Limit.MEMORY),
        state.kInterrupt: interrupted,
        state.kHighsInterrupt: interrupted,
        # Only a cutoff causes this status: no point at or below it exists.
        state.kObjectiveBound: Ended.INFEASIBLE,
    }
