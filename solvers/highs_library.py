"""HiGHS through highspy: what its runs on linear, mixed-integer and quadratic programs share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..errors import InvalidData, UnsupportedOption
from ..models.programs.base import RowProgram
from ..models.verification import ROUNDING
from .attempts import Clock, Ended, Meaning, limited
from .backend import Limit, Request

__all__ = ["meanings", "run_highs"]


def run_highs(
    program: RowProgram,
    integral: Any,
    options: Mapping[str, Any],
    request: Request,
    clock: Clock,
    prepare: Callable[[Any], None],
) -> Any:
    """Return the ``highspy.Highs`` that has solved `program`.

    Parameters
    ----------
    program : RowProgram
        Its columns and rows are handed over.
    integral : ndarray of bool
        Which columns must be whole.
    options : mapping
        HiGHS's own options beside the seed, the threads and the time left.
    request : Request
        What is asked.
    clock : Clock
        Its laps ``"build"`` and ``"solve"`` are counted.
    prepare : callable
        ``prepare(highs)`` hands over what else there is: a start, callbacks, a Hessian.

    Raises
    ------
    UnsupportedOption, InvalidData
        HiGHS refuses an option, or the program; solved all the same, it would be the empty one.
    """
    import highspy

    highs = highspy.Highs()
    given = {"output_flag": request.verbose, **options}
    if request.seed is not None:
        given["random_seed"] = request.seed % (2**31)
    if request.threads is not None:
        # The scheduler is one for the process and keeps its number of threads.
        highspy.Highs.resetGlobalScheduler(True)
        given["threads"] = request.threads
    for name, value in given.items():
        if highs.setOptionValue(name, value) == highspy.HighsStatus.kError:
            raise UnsupportedOption(f"backend 'highs': HiGHS refuses {name} = {value!r}")
    matrix = program.matrix
    # HiGHS was seen to leave a whole column that no row binds at 7.5, its bound.
    whole, low, high = integral > 0, program.column_lower, program.column_upper
    low = np.where(whole, np.ceil(low - ROUNDING), low)
    high = np.where(whole, np.floor(high + ROUNDING), high)
    passed = highs.passModel(
        program.size,
        program.row_count,
        matrix.nnz,
        int(highspy.MatrixFormat.kRowwise),
        int(highspy.ObjSense.kMinimize),
        program.offset,
        program.cost,
        low,
        high,
        program.row_lower,
        program.row_upper,
        matrix.indptr.astype(np.int32),
        matrix.indices.astype(np.int32),
        matrix.data,
        integral.astype(np.int32),
    )
    if passed == highspy.HighsStatus.kError:
        raise InvalidData(f"backend 'highs': HiGHS refuses the program ({program.describe()})")
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
    """Return what each of HiGHS's statuses means."""
    import highspy

    state: Any = highspy.HighsModelStatus
    interrupted = Ended.STOPPED, limited(request.control)
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
        # Only a cutoff makes these: nothing was found at or below it.
        state.kObjectiveBound: Ended.INFEASIBLE,
    }
