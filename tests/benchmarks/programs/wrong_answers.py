"""Minimal reproductions of wrong answers, with the solvers' own interfaces.

Each solver calls a program infeasible or unbounded for which crosstrack verified a feasible plan and a
bound. The public programs are those that the solvers receive from crosstrack: in scaled units if the data
differ from 1 by orders of magnitude. The program of the crane is not scaled; HiGHS solves the scaled one.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

import crosstrack as ct
from crosstrack.models import QuadraticProgram
from crosstrack.solvers.programs.scaling import Scaling
from crosstrack.solvers.qp.forms import Core

DATA = Path(__file__).resolve().parents[4] / "shared" / "data" / "programs" / "qp"


def scaled(name: str) -> QuadraticProgram:
    """Return a public program in scaled units, without rows that have no bounds."""
    program: Any = ct.load(DATA / f"{name}.mat")
    scaling = Scaling.of(program)
    result: QuadraticProgram = Core.of(program if scaling is None else scaling.program).program
    return result


def crane(steps: int = 40, seconds: float = 0.05) -> QuadraticProgram:
    """Return the control problem of the example "Compare solvers on your own CVXPY problem"."""
    import cvxpy as cp

    dynamics = np.array(
        [
            [1, seconds, 0, 0],
            [0, 1, -0.4 * seconds, 0],
            [0, 0, 1, seconds],
            [0, 0, -30 * seconds, 1],
        ]
    )
    gain = np.array([[0, seconds, 0, -2 * seconds]])
    x, u = cp.Variable((steps + 1, 4)), cp.Variable((steps, 1))
    rows = [x[0] == [1, 0, 0, 0], x[1:] == x[:-1] @ dynamics.T + u @ gain, u <= 2, u >= -2]
    rows += [x[:, 2] <= 0.05, x[:, 2] >= -0.05]
    cost = cp.sum_squares(x[:, 0]) + 1e-4 * cp.sum_squares(u)
    program: Any = ct.load(cp.Problem(cp.Minimize(cost), rows))
    return program


def highs(program: QuadraticProgram) -> str:
    """Return the status of HiGHS with its default options."""
    import highspy

    solver, lp = highspy.Highs(), highspy.HighsLp()
    solver.silent()
    matrix, hessian = sp.csc_array(program.matrix), sp.csc_array(sp.tril(program.hessian))
    lp.num_col_, lp.num_row_ = program.size, program.row_count
    lp.col_cost_, lp.offset_ = program.cost, program.offset
    lp.col_lower_, lp.col_upper_ = program.column_lower, program.column_upper
    lp.row_lower_, lp.row_upper_ = program.row_lower, program.row_upper
    lp.a_matrix_.format_ = highspy.MatrixFormat.kColwise
    lp.a_matrix_.start_, lp.a_matrix_.index_ = matrix.indptr, matrix.indices
    lp.a_matrix_.value_ = matrix.data
    solver.passModel(lp)
    solver.passHessian(
        program.size, hessian.nnz, int(highspy.HessianFormat.kTriangular),
        hessian.indptr.astype(np.int32), hessian.indices.astype(np.int32), hessian.data,
    )  # fmt: skip
    solver.run()
    return str(solver.modelStatusToString(solver.getModelStatus()))


def piqp(program: QuadraticProgram, tolerance: float) -> str:
    """Return the status of PIQP."""
    import piqp as library  # type: ignore[import-untyped]

    solver = library.SparseSolver()
    for name in ("eps_abs", "eps_rel", "eps_duality_gap_abs", "eps_duality_gap_rel"):
        setattr(solver.settings, name, tolerance)
    solver.settings.check_duality_gap = True
    equal = program.row_lower == program.row_upper
    solver.setup(
        sp.csc_matrix(program.hessian), program.cost,
        sp.csc_matrix(program.matrix[equal]), program.row_lower[equal],
        sp.csc_matrix(program.matrix[~equal]), program.row_lower[~equal], program.row_upper[~equal],
        program.column_lower, program.column_upper,
    )  # fmt: skip
    return str(solver.solve())


def daqp(program: QuadraticProgram, tolerance: float) -> int:
    """Return the exit flag of DAQP; -1 is "infeasible"."""
    import daqp as library  # type: ignore[import-not-found]

    sense = np.where(program.row_lower == program.row_upper, 5, 0).astype(np.int32)
    _, _, flag, _ = library.solve(
        program.hessian.toarray(), program.cost.copy(), program.matrix.toarray(),
        np.clip(program.row_upper, -1e30, 1e30), np.clip(program.row_lower, -1e30, 1e30), sense,
        primal_tol=tolerance, dual_tol=tolerance, iter_limit=100_000, eps_prox=-1.0,
    )  # fmt: skip
    return int(flag)


if __name__ == "__main__":
    print("crane, highs:", highs(crane()))
    print("HUES-MOD, piqp:", piqp(scaled("HUES-MOD"), 1e-8))
    print("STADAT1, piqp:", piqp(scaled("STADAT1"), 1e-8))
    print("QPCBOEI1, daqp:", daqp(scaled("QPCBOEI1"), 1e-11))
