"""Points that are stationary and no minimum: found, left, or called what they are."""

import math
from types import SimpleNamespace

import casadi
import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp

import crosstrack as ct
from crosstrack.models import NonlinearProgram, OptimalControlProblem
from crosstrack.solvers.nlp.quality import NEGATIVE, descent_by_curvature


def drawn(draw):
    """A quadratic program at its origin, with the Hessian and the rows."""
    n = int(draw.integers(2, 60))
    m = int(draw.integers(0, n))
    rows = draw.normal(size=(m, n))
    if m > 2 and draw.random() < 0.3:
        rows[0] = rows[1]
    turn = np.linalg.qr(draw.normal(size=(n, n)))[0]
    bent = 10 ** draw.uniform(-3, 1, n)
    bent[: int(draw.integers(0, 3))] *= -1
    hessian = turn * bent @ turn.T
    upper = sp.csc_array(np.triu(0.5 * (hessian + hessian.T)))
    program = SimpleNamespace(
        size=n, column_scale=np.ones(n), column_lower=np.full(n, -np.inf),
        column_upper=np.full(n, np.inf), row_scale=np.ones(m), row_lower=np.zeros(m),
        row_upper=np.zeros(m), objective_scale=1.0,
        values=lambda x: (0.0, rows @ x),
        jacobian=lambda x: sp.csc_array(rows),
        second_order=lambda x, scale, duals: SimpleNamespace(sparse=lambda: upper),
    )  # fmt: skip
    return program, hessian, rows


@pytest.mark.parametrize("count", [40, pytest.param(300, marks=pytest.mark.slow)])
def test_directions_found_decrease_and_clear_ones_are_found(count):
    draw = np.random.default_rng(1)
    missed = 0
    for _ in range(count):
        program, hessian, rows = drawn(draw)
        n, m = program.size, len(rows)
        found = descent_by_curvature(program, np.zeros(n), np.zeros(m))
        free = scipy.linalg.null_space(rows) if m else np.eye(n)
        least = scipy.linalg.eigvalsh(free.T @ hessian @ free)[0] if free.shape[1] else 0.0
        if found is None:
            missed += least < -20 * NEGATIVE * np.abs(hessian).max()
        else:
            assert found @ hessian @ found < 0
            assert np.abs(rows @ found).max(initial=0.0) < 1e-6
            assert np.abs(found).max() == pytest.approx(1)
    assert missed == 0


def well(start, lower=-np.inf):
    x = casadi.MX.sym("x", 2)
    f = (x[0] ** 2 - 1) ** 2 + (x[1] - 2) ** 2
    return NonlinearProgram(
        name="two wells",
        function=casadi.Function("wells", [x], [f, casadi.MX(0, 1)], ["x"], ["f", "g"]),
        row_lower=[], row_upper=[], column_lower=[lower, -np.inf], column_upper=[np.inf] * 2,
        guess=start,
    )  # fmt: skip


def test_a_saddle_of_a_program_is_left():
    found = ct.solve(well([0.0, 2.0]))
    assert found.termination == "locally_optimal"
    assert found.primal_bound == pytest.approx(0.0, abs=1e-8)
    assert found.statistics["saddle points left"] == 1
    assert "saddle points left" not in ct.solve(well([0.5, 0.0])).statistics


def test_a_symmetric_guess_is_no_trap():
    """Across a current that is the stronger the further off: both sides are better than the middle."""
    ocp = OptimalControlProblem()
    phase = ocp.phase(time=(0, 1))
    x, y = phase.state("x", initial=0), phase.state("y", initial=0)
    heading = phase.control("heading", lower=-math.pi, upper=math.pi)
    phase.dynamics({x: casadi.cos(heading) + 4 * y**2 - 0.75, y: casadi.sin(heading)})
    ocp.minimise(-phase.final(x))
    found = ct.solve(ocp)
    assert found.termination == "locally_optimal"
    assert found.primal_bound == pytest.approx(-0.832978385, rel=1e-6)
    assert found.statistics["saddle points left"] == 1


@pytest.mark.parametrize("name", ["brockett", pytest.param("unicycle", marks=pytest.mark.slow)])
def test_a_guess_that_leads_nowhere_is_followed_by_others(name):
    found = ct.solve(ct.load(f"optimal-control/{name}"))
    assert found.termination == "locally_optimal"
    assert found.statistics["stages"].startswith("gauss: locally infeasible; radau 20x3: ")
    assert found.statistics["stages"].endswith("locally optimal")
    # An explicit formulation has no other stages, only other starts.
    alone = ct.solve(ct.load(f"optimal-control/{name}"), formulation="gauss")
    assert alone.statistics["starts tried"] == 2
    assert alone.message.startswith("2 starts: from the guess locally_infeasible")
    assert alone.primal_bound == pytest.approx(found.primal_bound, rel=1e-6)


def test_the_first_mesh_is_solved_from_two_starts():
    found = ct.solve(ct.load("optimal-control/maximal-range"))
    assert found.primal_bound == pytest.approx(-1.712316, rel=1e-5)
    assert found.statistics["second look"] == "better"
    assert "drawn start" in found.message
    alone = ct.solve(ct.load("optimal-control/maximal-range"), seed=0)
    assert alone.primal_bound == pytest.approx(-0.2523, rel=1e-3)
    assert "second look" not in alone.statistics
