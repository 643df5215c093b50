"""Quadratic programs: the forms that solvers read, their JSON, and what other tools read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from quadratics import CASES, INF, asked, programs

from crosstrack.errors import (
    InvalidData,
)
from crosstrack.models import Model
from crosstrack.models.programs.linear import QuadraticProgram
from crosstrack.solvers.conformance.quadratic import quadratic
from crosstrack.solvers.contract.backend import Termination
from crosstrack.solvers.qp.forms import ConicForm, Core, SplitForm, independent_rows

# Forms.


def test_the_core_omits_fixed_columns_and_empty_rows() -> None:
    program = quadratic(
        [[2, 1, 0], [1, 2, 1], [0, 1, 2]],
        [1, -1, 3],
        [[1, 1, 1], [0, 0, 0], [0, 1, 0], [1, 0, 1]],
        [1, -1, 2, -INF],
        [4, 1, 2, INF],
        lower=[-INF, 2, -INF],
        upper=[INF, 2, INF],
        offset=3.0,
    )
    core = Core.of(program)
    assert core.columns.tolist() == [0, 2]
    assert core.rows.tolist() == [0]
    point = np.array([0.3, -0.7])
    whole = core.point(point)
    assert whole is not None
    assert core.program.objective(point) == pytest.approx(program.objective(whole))
    assert core.program.matrix @ point + 2 == pytest.approx((program.matrix @ whole)[:1])
    duals = core.duals(np.array([1.5]))
    assert duals is not None
    assert duals.tolist() == [1.5, 0, 0, 0]


def test_forms_give_multipliers_back() -> None:
    program = quadratic(
        [1, 1], [0, 0], [[1, 0], [0, 1], [1, 1], [1, -1]], [1, -INF, 0, -2], [1, 3, INF, 2]
    )
    form, split = ConicForm.of(program), SplitForm.of(program)
    assert form.zeros == 1
    # Equal row, rows 1 and 3 from above, rows 2 and 3 from below.
    assert form.duals([5.0, 1, 2, 3, 4], 4).tolist() == [-5, -1, 3, 2]
    assert split.duals([7.0], [1.0, 2.0, 3.0]).tolist() == [7, 1, 2, 3]


def test_dependent_rows_are_found() -> None:
    program = CASES["quadratic: dependent equalities"].program
    kept, rows = independent_rows(program)
    assert kept.row_count == len(rows) == 2
    free = CASES["quadratic: rows from below"].program
    assert independent_rows(free)[0] is free


# The program itself.


def test_json_and_digest() -> None:
    program = CASES["quadratic: portfolio, 200 columns"].program
    back = Model.from_json(program.to_json())
    assert isinstance(back, QuadraticProgram)
    assert back.digest == program.digest
    assert (back.hessian != program.hessian).nnz == 0
    assert back.row_upper.tolist() == program.row_upper.tolist()
    other = replace(program, cost=program.cost + 1e-12)
    assert other.digest != program.digest


@pytest.mark.parametrize(
    ("hessian", "words"),
    [
        ([[1, 1], [0, 1]], r"hessian\[0, 1\] is 1, but hessian\[1, 0\] is 0: it must be symmetric"),
        ([[1, 0], [0, -1]], r"hessian\[1, 1\] is -1, which no positive semidefinite matrix"),
        ([[0, 1], [1, 1]], r"hessian\[0, 0\] is 0"),
    ],
)
def test_a_hessian_that_cannot_be_convex(hessian: list[list[float]], words: str) -> None:
    with pytest.raises(InvalidData, match=words):
        quadratic(hessian, [0, 0])


@settings(max_examples=25, deadline=None, derandomize=True)
@given(programs())
def test_the_export_to_qpsolvers_is_the_same_program(program: QuadraticProgram) -> None:
    import qpsolvers

    mine_ = asked("daqp", program)
    exported = program.to_qpsolvers()
    exported.P = exported.P.toarray()
    exported.G = None if exported.G is None else exported.G.toarray()
    exported.A = None if exported.A is None else exported.A.toarray()
    # DAQP wants arrays that it could write to.
    exported.q, exported.lb, exported.ub = (
        None if values is None else np.array(values)
        for values in (exported.q, exported.lb, exported.ub)
    )
    theirs = qpsolvers.solve_problem(exported, solver="daqp")
    assert theirs.found == (mine_.termination is Termination.OPTIMAL)
    if theirs.found:
        assert theirs.obj + program.offset == pytest.approx(mine_.primal_bound, rel=1e-6, abs=1e-6)
