"""Problems and programs for several test modules."""

from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from scipy.linalg import expm
from scipy.sparse.linalg import splu

import crosstrack as ct
from crosstrack.instances import optimal_control
from crosstrack.models import OptimalControlProblem

FORMULATIONS = ("gauss", "radau", "hermite-simpson", "trapezoid")


def riccati(a, b, q, r, s, horizon):
    """Return P(t) with -P' = A'P + PA - P B R⁻¹ B' P + Q, P(T) = S, as a function of time."""
    n = len(a)
    flow = np.block([[a, -b @ np.linalg.solve(r, b.T)], [-q, -a.T]])

    def at(t):
        moved = expm(flow * (t - horizon)) @ np.vstack([np.eye(n), s])
        return moved[n:] @ np.linalg.inv(moved[:n])

    def state(t, begin):
        both = expm(flow * t) @ np.concatenate([begin, at(0.0) @ begin])
        return both[:n]

    return at, state


def regulator(a, b, q, r, s, begin, horizon, *, start=0.0, size=1.0, cuts=()):
    """Least ½ ∫ x'Qx + u'Ru + ½ x(T)'Sx(T), in units of `size`, from `start` on, in linked phases."""
    ocp = OptimalControlProblem("regulator")
    knots = [start, *(start + horizon * cut for cut in cuts), start + horizon]
    cost, before = 0.0, None
    for k, (t0, tf) in enumerate(pairwise(knots)):
        phase = ocp.phase(f"part {k + 1}", time=(t0, tf))
        x = phase.state("x", len(a), scale=size, initial=None if k else list(size * begin))
        u = phase.control("u", b.shape[1], scale=size)
        phase.dynamics({x: a @ x + b @ u})
        cost += phase.integral((x.T @ q @ x + u.T @ r @ u) / (2 * size**2))
        if before is not None:
            ocp.link(before, phase)
        before = phase
    end = before.final(x)
    ocp.minimise(cost + end.T @ s @ end / (2 * size**2))
    return ocp, riccati(a, b, q, r, s, horizon)


LINEAR = (
    np.array([[0.0, 1.0], [-1.0, 0.4]]), np.array([[0.0], [1.0]]), np.diag([2.0, 0.5]),
    np.array([[0.7]]), np.diag([1.0, 3.0]), np.array([1.0, -0.5]), 2.0,
)  # fmt: skip


def newton(program, rounds=3):
    """Return columns and multipliers of a program with equations only, by Newton's method."""
    free = np.flatnonzero(program.column_lower < program.column_upper)
    assert (program.row_lower == program.row_upper).all()
    assert np.isinf(program.column_lower[free]).all() and np.isinf(program.column_upper[free]).all()
    x, y = program.guess.copy(), np.zeros(program.row_count)
    for block in program.rows:
        if block.name.startswith("definition of integral"):
            y[block.slice] = 1.0  # the objective is their sum
    for _ in range(rounds):
        upper = sp.csc_array(program.second_order(x, 1.0, -y).sparse())
        hessian = (upper + sp.triu(upper, 1).T).tocsc()[free][:, free]
        jacobian = program.jacobian(x)[:, free]
        matrix = sp.bmat([[hessian, -jacobian.T], [jacobian, None]]).tocsc()
        residual = np.concatenate(
            [program.reduced_costs(x, y)[free], program.values(x)[1] - program.row_lower]
        )
        step = splu(matrix).solve(-residual)
        x[free] += step[: free.size]
        y += step[free.size :]
    assert np.abs(program.reduced_costs(x, y)[free]).max() < 1e-8
    return x, y


def solved(ocp, name, **options):
    """Return the formulation, its optimum, and the plan with costates."""
    one = ocp.formulate(name, **options)
    point, duals = newton(one.program)
    plan = one.explained(one.decode(point), point, duals)
    return one.program.objective(point), plan


def catalogue(name):
    return ct.load(f"optimal-control/{name}")


def layers():
    """Return two boundary layers with nothing between them, which a coarse mesh misses."""
    return optimal_control.hypersensitive(horizon=30.0)
