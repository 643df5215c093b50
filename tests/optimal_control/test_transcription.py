"""Transcriptions: their schemes, programs and derivatives, costates, orders, and refinement.

The exact solutions here come from Riccati's equation, through the exponential of its Hamiltonian
matrix, and from closed forms; the programs of linear-quadratic problems are solved by Newton's
method on their own derivatives, so that no solver's tolerance stands between scheme and order.
"""

import math
import threading
import time
from dataclasses import replace
from itertools import pairwise

import casadi
import mpmath
import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import HealthCheck, given, settings, strategies as st
from scipy.linalg import expm
from scipy.sparse.linalg import splu

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedOption
from crosstrack.instances import optimal_control
from crosstrack.models import ControlPlan, OptimalControlProblem
from crosstrack.models.optimal_control.hamiltonian import hamiltonian_spread
from crosstrack.models.optimal_control.lagrange import differentiation, interpolation
from crosstrack.models.optimal_control.transcription.mesh import Mesh
from crosstrack.models.optimal_control.transcription.schemes import (
    gauss,
    gauss_points,
    hermite_simpson,
    integration,
    radau,
    radau_points,
    trapezoid,
)
from crosstrack.solvers.backend import Control, Limit
from crosstrack.solvers.execution import execute
from crosstrack.solvers.job import Job

FORMULATIONS = ("gauss", "radau", "hermite-simpson", "trapezoid")
QUICK = settings(
    max_examples=6, deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True
)

# -- schemes -------------------------------------------------------------------------------------------

#: Scheme, degree to which its rows are exact for X (the last row by itself), that of the quadrature,
#: and that of the plan's polynomial.
SCHEMES = [
    *((gauss(n), n, 2 * n, 2 * n - 1, n) for n in (1, 2, 3, 5, 8, 13)),
    *((radau(n), n, n, 2 * n - 2, n) for n in (1, 2, 3, 5, 8, 13)),
    (hermite_simpson(), 3, 4, 3, 3),
    (trapezoid(), 2, 2, 1, 2),
]
NAMES = [f"{one[0].name}-{one[0].collocated.size}" for one in SCHEMES]


def defects(scheme, degree):
    """What the rows leave of X = T_degree, whose rate is its derivative; the interval is [-1, 1]."""
    basis = np.polynomial.chebyshev.Chebyshev.basis(degree)
    return scheme.left @ basis(scheme.points) - scheme.right @ basis.deriv()(scheme.control_points)


@pytest.mark.parametrize(("scheme", "rows", "last", "quadrature", "plan"), SCHEMES, ids=NAMES)
def test_rows_are_exact_to_their_degree_and_not_beyond(scheme, rows, last, quadrature, plan):
    for degree in range(last + 1):
        found = defects(scheme, degree)
        assert abs(found[-1]) < 1e-11
        if degree <= rows:
            assert np.abs(found).max() < 1e-10
    assert np.abs(defects(scheme, rows + 1)).max() > 1e-6
    assert abs(defects(scheme, last + 1)[-1]) > 1e-9


@pytest.mark.parametrize(("scheme", "rows", "last", "quadrature", "plan"), SCHEMES, ids=NAMES)
def test_weights_are_exact_to_their_degree_and_not_beyond(scheme, rows, last, quadrature, plan):
    assert (scheme.weights > 0).all() and scheme.weights.sum() == pytest.approx(2, abs=1e-13)

    def error(degree):
        basis = np.polynomial.chebyshev.Chebyshev.basis(degree)
        whole = basis.integ()
        return scheme.weights @ basis(scheme.control_points) - (whole(1) - whole(-1))

    assert max(abs(error(degree)) for degree in range(quadrature + 1)) < 1e-12
    assert abs(error(quadrature + 1)) > 1e-9


@pytest.mark.parametrize(("scheme", "rows", "last", "quadrature", "plan"), SCHEMES, ids=NAMES)
def test_the_plan_follows_polynomials_of_its_degree(scheme, rows, last, quadrature, plan):
    for degree in range(plan + 1):
        basis = np.polynomial.chebyshev.Chebyshev.basis(degree)
        values = scheme.from_states @ basis(scheme.points)
        values = values + scheme.from_rates @ basis.deriv()(scheme.control_points)
        assert values == pytest.approx(basis(scheme.plan_points), abs=1e-12)
    assert scheme.points[0] == -1 and scheme.points[-1] == 1 and (np.diff(scheme.points) > 0).all()
    assert (scheme.plan_points[0], scheme.plan_points[-1]) == (-1, 1)


@pytest.mark.parametrize("count", [1, 2, 3, 7, 20, 64, 150])
def test_nodes_and_weights_against_thirty_digits(count):
    with mpmath.workdps(30):

        def legendre(n, x):
            before, value = mpmath.mpf(1), mpmath.mpf(x)
            if n == 0:
                return before
            for k in range(2, n + 1):
                before, value = value, ((2 * k - 1) * x * value - (k - 1) * before) / k
            return value

        def slope(n, x):
            return n * (x * legendre(n, x) - legendre(n - 1, x)) / (x * x - 1)

        nodes, weights = gauss_points(count)
        for k in range(0, count, max(1, count // 7)):
            x = mpmath.mpf(float(nodes[k]))
            x -= legendre(count, x) / slope(count, x)
            assert abs(float(x - nodes[k])) < 1e-15
            exact = 2 / ((1 - x * x) * slope(count, x) ** 2)
            assert abs(float(exact / weights[k]) - 1) < 1e-10
        nodes, weights = radau_points(count)
        assert nodes[-1] == 1 and weights[-1] == pytest.approx(2 / count**2, rel=1e-11)
        for k in range(0, count - 1, max(1, count // 7)):
            x = mpmath.mpf(float(nodes[k]))
            for _ in range(2):
                value = legendre(count, x) - legendre(count - 1, x)
                x -= value / (slope(count, x) - slope(count - 1, x))
            assert abs(float(x - nodes[k])) < 1e-15
            exact = (1 + x) / (count * legendre(count - 1, x)) ** 2
            assert abs(float(exact / weights[k]) - 1) < 1e-10


@pytest.mark.parametrize("count", [5, 40, 200])
def test_interpolation_differentiation_and_integration_of_many_nodes(count):
    nodes = np.concatenate([[-1.0], radau_points(count)[0]])
    fine = np.linspace(-1, 1, 333)
    rough = 1e-2 if count == 5 else 1e-12
    assert np.abs(interpolation(nodes, fine) @ np.sin(nodes) - np.sin(fine)).max() < rough
    slope = np.abs(differentiation(nodes) @ np.sin(nodes) - np.cos(nodes)).max()
    assert slope < (0.1 if count == 5 else 1e-15 * count**3)
    own, onto = integration(count)
    assert np.abs(onto @ np.cos(own) - np.sin(np.append(own, 1)) - np.sin(1)).max() < rough


# -- programs: derivatives, names, round trips ---------------------------------------------------------


def everything():
    """Two phases of different states, parameters, integrals, paths, free times, everything at once."""
    ocp = OptimalControlProblem("everything")
    a = ocp.phase("climb", time=(0, (1, 3)), unit="h", equation="12")
    q = a.state("q", 2, initial=[0.1, 0.2], unit="m")
    m = a.state("m", initial=(1, 2), lower=0.1, scale=2)
    u = a.control("u", 2, lower=-2, upper=2, unit="N")
    p = ocp.parameter("p", lower=0.5, upper=2)
    w = ocp.parameter("w", 2, guess=[0.3, 0.4])
    t = a.time
    a.dynamics({q: [casadi.sin(q[1]) + p * u[0] * t, u[1] * q[0] / m], m: -casadi.sumsqr(u) * w[0]})
    a.path(q[0] ** 2 + u[1] ** 2 * t <= 5, name="tube", equation="7")
    a.path(q * u * p, lower=[-4, -5], upper=[4, 5], name="pair")
    b = ocp.phase("glide", time=((1, 3), (4, 6)))
    r = b.state("r")
    n = b.state("m")
    v = b.control("v")
    b.dynamics({r: casadi.exp(-n) * casadi.cos(b.time) + w[1], n: -(v**2) * n})
    b.path(r * v >= -9, name="tube")
    ocp.link(a, b, "m")
    ocp.subject_to(a.final(q[0] * q[1]) + b.final(r) ** 2 * a.end <= 7, name="both", equation="9")
    ocp.subject_to(a.integral(casadi.sumsqr(u) * t) == p * b.integral(v**2 + n), name="equal work")
    ocp.minimise(
        a.integral(q[0] ** 2 * u[1] + p) ** 2 + b.final(n * r) * b.end + casadi.sumsqr(w) * p,
    )
    return ocp


def no_scalar_form(ocp):
    """The same problem with functions that stay as they are, graphs of matrices."""
    phases = []
    for phase in ocp.definition.phases:
        inputs = [casadi.MX.sym(n, phase.function.size1_in(n)) for n in phase.function.name_in()]
        # A matrix product has no place among scalar operations: the graph stays one of matrices.
        outputs = list(phase.function.call(inputs))
        made = casadi.Function(
            "phase", inputs, outputs, phase.function.name_in(), phase.function.name_out()
        )
        assert made.is_a("MXFunction")
        phases.append(replace(phase, function=made))
    e, p = (casadi.MX.sym(n, ocp.definition.endpoint.size1_in(n)) for n in "ep")
    ends = casadi.Function(
        "endpoint",
        [e, p],
        list(ocp.definition.endpoint(e, p)),
        ["e", "p"],
        ["objective", "boundary"],
    )
    return OptimalControlProblem(
        "no scalar form", definition=replace(ocp.definition, phases=tuple(phases), endpoint=ends)
    )


MIXED = Mesh(np.array([0, 0.2, 0.65, 1.0]), np.array([2, 7, 4]), np.array([False, True, False]))


def written(name, problem=None, **options):
    """The formulation of everything on an uneven mesh."""
    if not options:
        options = {"mesh": MIXED if name in ("gauss", "radau", "paper") else [0, 0.3, 0.5, 1]}
    return (problem or everything()).formulate(name, dependent="keep", **options)


def drawn(program, seed=1):
    """A point inside the bounds, its times in order."""
    draw = np.random.default_rng(seed)
    low = np.where(np.isfinite(program.column_lower), program.column_lower, program.guess - 1)
    high = np.where(np.isfinite(program.column_upper), program.column_upper, program.guess + 1)
    return low + draw.uniform(0.1, 0.9, program.size) * (high - low), draw


@pytest.mark.parametrize("kind", ["scalars", "matrices"])
@pytest.mark.parametrize("name", [*FORMULATIONS, "paper"])
def test_derivatives_are_those_of_automatic_differentiation(name, kind):
    problem = everything() if kind == "scalars" else no_scalar_form(everything())
    program = written(name, problem).program
    plain = replace(program, derivatives=None, hessian=None)
    point, draw = drawn(program)
    f, g = program.values(point)
    assert np.isfinite(f) and np.isfinite(g).all()
    assert program.gradient(point) == pytest.approx(plain.gradient(point), rel=1e-10, abs=1e-10)
    mine, theirs = program.jacobian(point), plain.jacobian(point)
    assert abs(mine - theirs).max() < 1e-9 * max(1.0, abs(theirs).max())
    duals, weight = draw.normal(size=program.row_count), 0.7
    mine, theirs = (
        sp.csc_array(one.second_order(point, weight, duals).sparse()) for one in (program, plain)
    )
    assert abs(mine - theirs).max() < 1e-9 * max(1.0, abs(theirs).max())
    assert not sp.tril(mine, -1).count_nonzero()
    # Finite differences know nothing of CasADi.
    step = 1e-6 * draw.normal(size=program.size)
    (f1, g1), (f0, g0) = program.values(point + step), program.values(point - step)
    assert g1 - g0 == pytest.approx(2 * (program.jacobian(point) @ step), abs=1e-8)
    assert f1 - f0 == pytest.approx(2 * float(program.gradient(point) @ step), abs=1e-8)


@pytest.mark.parametrize("name", FORMULATIONS)
def test_functions_of_both_kinds_give_the_same_program(name):
    scalars, matrices = (
        written(name, p).program for p in (everything(), no_scalar_form(everything()))
    )
    point, _ = drawn(scalars)
    assert scalars.values(point)[0] == pytest.approx(matrices.values(point)[0], rel=1e-13)
    assert scalars.values(point)[1] == pytest.approx(
        matrices.values(point)[1], rel=1e-12, abs=1e-13
    )
    assert (scalars.guess == matrices.guess).all()


@pytest.mark.parametrize("name", FORMULATIONS)
def test_every_row_and_column_has_words(name):
    one = written(name)
    program, layout = one.program, one.layout
    for blocks, size in ((program.rows, program.row_count), (program.columns, program.size)):
        assert sum(block.size for block in blocks) == size
    climb, glide = layout.phases
    columns = {program.column_name(k): k for k in range(program.size)}
    rows = {program.row_name(k): k for k in range(program.row_count)}
    if name != "hermite-simpson":
        assert len(columns) == program.size
    assert len(rows) == program.row_count
    # The index map leads from a name to the column: a marked value comes out in the plan.
    for place, state, interval, node in ((climb, "q[1]", 2, 0), (glide, "m", 3, 1)):
        column = columns[f"{state} of {place.phase.name} in interval {interval}, node {node}"]
        entry = place.phase.state_names.index(state)
        assert column == place.state_columns[entry, place.starts[interval - 1] + node]
    assert columns["start time of glide"] == glide.time_columns[0]
    assert columns["end time of climb"] == climb.time_columns[1]
    assert columns["parameter w[1]"] == layout.parameter_columns[2]
    assert columns["integral 1 of climb"] == climb.integral_columns[0]
    for words in (
        "eq. 12, dynamics of q[0] of climb in interval 1, node 1",
        "eq. 7, tube of climb in interval 3, node 1",
        "dynamics of r of glide in interval 2, node 1",
        "definition of integral 2 of climb",
        "eq. 9, both",
        "equal work",
        "m goes on from climb to glide",
        "time goes on from climb to glide",
    ):
        assert any(row == words for row in rows), (words, sorted(rows)[:40])
    units = {block.name: block.unit for block in (*program.rows, *program.columns)}
    assert units["q[0] of climb"] == "m" and units["u[1] of climb"] == "N"
    assert units["dynamics of q[1] of climb"] == "m" and units["end time of climb"] == "h"


def test_a_wrong_point_is_told_by_name():
    one = written("radau")
    point = one.program.guess.copy()
    climb = one.layout.phases[0]
    point[climb.state_columns[0, climb.starts[1] + 2]] += 100
    found = one.program.verify(point)
    (check,) = [c for c in found.checks if c.name == "dynamics of q[0] of climb"]
    assert not check.ok and "interval 2" in check.where and check.worst > 10
    (check,) = [c for c in found.checks if c.name == "tube of climb"]
    assert check.where.endswith("interval 2, node 2") and check.equation == "7"


@pytest.mark.parametrize(
    "name",
    [
        "gauss",
        "paper",
        "radau",
    ],
)
def test_decoding_and_encoding_return_every_column(name):
    one = written(name)
    point, _ = drawn(one.program)
    plan = one.decode(point)
    again = one.encode(plan)
    integrals = np.concatenate([part.integral_columns for part in one.layout.phases])
    kept = np.setdiff1d(np.arange(point.size), integrals)
    assert again[kept] == pytest.approx(point[kept], abs=1e-11)
    # The integrals that come back are those of the plan: their rows hold.
    rows = one.program.values(again)[1]
    for block in one.program.rows:
        if block.name.startswith("definition of integral"):
            assert rows[block.slice] == pytest.approx(0, abs=1e-12)
    assert plan.parameters["w"].tolist() == point[one.layout.parameter_columns[1:]].tolist()


@pytest.mark.parametrize("name", FORMULATIONS)
def test_a_plan_of_another_formulation_satisfies_the_rows(name):
    ocp = regulator(*LINEAR)[0]
    plan = ct.solve(ocp, formulation="radau").plan
    fine = {"intervals": 8, "degree": 7}
    if name in ("hermite-simpson", "trapezoid"):
        fine = {"intervals": 200 if name == "hermite-simpson" else 2000}
    found = ct.verify(ocp, plan, formulation=name, formulation_options=fine, tolerance=2e-6)
    assert found.ok, found.summary()
    assert any(check.name == "dynamics of x[0]" for check in found.checks)


@pytest.mark.parametrize("name", FORMULATIONS)
def test_the_guess_is_where_the_program_starts(name):
    ocp = OptimalControlProblem()
    phase = ocp.phase(time=(1, (2, 9)))
    x, y, u = phase.state("x", initial=2), phase.state("y", upper=5), phase.control("u")
    phase.dynamics({x: u, y: x})
    ocp.minimise(phase.integral(x * u) + phase.integral(phase.time))
    phase.guess(time=[1, 5], x=[2, 6], y=lambda t: 10 * t, u=3)
    one = ocp.formulate(name)
    (part,) = one.layout.phases
    start = one.program.guess
    f = part.point_fractions
    assert start[part.state_columns[0]] == pytest.approx(2 + 4 * f)
    assert start[part.state_columns[1]] == pytest.approx(np.minimum(10 * (1 + 4 * f), 5))
    assert (start[part.control_columns] == 3).all()
    assert start[part.time_columns].tolist() == [1, 5]
    assert start[part.integral_columns] == pytest.approx([3 * 4 * 4, 12], rel=1e-12)


def test_a_plan_of_another_shape_is_not_encoded():
    one = written("radau")
    plan = one.decode(drawn(one.program)[0])
    climb, _ = plan.phases
    for wrong, words in (
        (ControlPlan((climb,), plan.parameters), "the plan has 1 phases, the problem 2"),
        (
            ControlPlan((climb, climb), plan.parameters),
            "3 states and 2 controls, the problem 2 and 1",
        ),
        (ControlPlan(plan.phases, {"p": [1.0]}), "2 value(s) of parameter 'w'"),
    ):
        with pytest.raises(InvalidData) as caught:
            one.encode(wrong)
        assert words in str(caught.value)
    point = drawn(one.program)[0]
    point[one.layout.phases[0].time_columns] = 1.0, 1.0
    with pytest.raises(InvalidData, match="phase 'climb': its end 1 is not after its start 1"):
        one.decode(point)


# -- linear-quadratic problems and Riccati's equation --------------------------------------------------


def riccati(a, b, q, r, s, horizon):
    """P(t) with -P' = A'P + PA - P B R⁻¹ B' P + Q, P(T) = S, as a function of time."""
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


@st.composite
def linear(draw):
    """Draw a linear-quadratic problem of one to three states."""
    n, m = draw(st.integers(1, 3)), draw(st.integers(1, 2))
    make = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    a, b = make.uniform(-1, 1, (n, n)), make.uniform(-1, 1, (n, m))
    root, other = make.uniform(-1, 1, (n, n)), make.uniform(-1, 1, (n, n))
    r = np.diag(make.uniform(0.5, 2, m))
    begin = make.uniform(0.5, 1, n) * make.choice([-1, 1], n)
    return a, b, root @ root.T, r, other @ other.T, begin, make.uniform(1, 2)


def newton(program, rounds=3):
    """Solve a program with equations alone by Newton's method: columns and row multipliers."""
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
    """The formulation, its optimum, and the plan with costates."""
    one = ocp.formulate(name, **options)
    point, duals = newton(one.program)
    plan = one.explained(one.decode(point), point, duals)
    return one.program.objective(point), plan


#: Formulation, options, orders at which objective and final state converge at least.
ORDERS = [
    ("gauss", {"degree": 2}, 4),
    ("radau", {"degree": 2}, 3),
    ("radau", {"degree": 3}, 5),
    ("hermite-simpson", {}, 4),
    ("trapezoid", {}, 2),
]


@pytest.mark.parametrize(("name", "options", "order"), ORDERS)
@QUICK
@given(problem=linear())
def test_discrete_optima_converge_to_riccati_at_their_order(name, options, order, problem):
    ocp, (matrix, state) = regulator(*problem)
    begin, horizon = problem[5], problem[6]
    exact = 0.5 * begin @ matrix(0.0) @ begin
    end = state(horizon, begin)
    values, ends = [], []
    meshes = (4, 8, 16) if order <= 4 else (2, 4, 8)
    for count in meshes:
        value, plan = solved(ocp, name, intervals=count, refine=False, **options)
        values.append(abs(value - exact) / max(1.0, exact))
        ends.append(np.abs(plan["x"](horizon) - end).max() / max(1.0, np.abs(end).max()))
    for errors in (values, ends):
        # Order by the last halving, unless rounding is reached or luck made the coarse one good.
        reached = math.log2(max(errors[1], 1e-15) / max(errors[2], 1e-15))
        overall = math.log2(max(errors[0], 1e-15) / max(errors[2], 1e-15)) / 2
        assert max(reached, overall) > order - 0.6 or errors[2] < 1e-10, errors
        assert errors[2] < 2e-2 * 4.0 ** (2 - order) or errors[2] < 1e-6, errors


@pytest.mark.parametrize("name", ["gauss", "radau"])
@QUICK
@given(problem=linear())
def test_costates_are_the_gradient_of_the_least_cost(name, problem):
    """λ = ∂J*/∂x = P(t) x(t), its sign included, at every node and at both ends."""
    ocp, (matrix, _) = regulator(*problem)
    value, plan = solved(ocp, name, intervals=4, degree=8)
    begin = problem[5]
    assert value == pytest.approx(0.5 * begin @ matrix(0.0) @ begin, rel=1e-9, abs=1e-12)
    (phase,) = plan.phases
    costates = phase.costates
    for k in (0, 1, 3):
        low, high = costates.knots[k], costates.knots[k + 1]
        for tau, found in zip(costates.nodes[k], costates.values[k], strict=True):
            t = low + 0.5 * (tau + 1) * (high - low)
            wanted = matrix(t) @ phase.states.on(k, [tau])[0]
            assert found == pytest.approx(wanted, abs=1e-6 * max(1.0, np.abs(wanted).max()))
    (report,) = hamiltonian_spread(ocp, plan)
    assert report.autonomous and report.relative < 1e-6


def test_costates_foretell_what_a_change_of_the_start_costs():
    """By finite differences, for a problem that is not linear."""

    def problem(begin):
        ocp = OptimalControlProblem()
        phase = ocp.phase(time=(0, 1))
        x, u = phase.state("x", initial=begin), phase.control("u")
        phase.dynamics({x: -(x**3) + u})
        ocp.minimise(phase.integral(x**2 + u**2) + phase.final(x) ** 4)
        return ocp

    options = {"formulation_options": {"intervals": 3, "degree": 8, "refine": False}}
    high, low = (ct.solve(problem(1 + d), **options).primal_bound for d in (1e-3, -1e-3))
    for name in ("gauss", "radau"):
        plan = ct.solve(problem(1), formulation=name, **options).plan
        assert plan.phases[0].costates(0.0)[0] == pytest.approx((high - low) / 2e-3, rel=1e-5)


@pytest.mark.parametrize("name", FORMULATIONS)
def test_low_orders_have_no_costates_and_say_so(name):
    _, plan = solved(regulator(*LINEAR)[0], name, intervals=2)
    assert (plan.phases[0].costates is None) == (name in ("hermite-simpson", "trapezoid"))


@pytest.mark.parametrize("name", ["gauss", "radau", "hermite-simpson", "trapezoid"])
@QUICK
@given(problem=linear(), shift=st.floats(-50, 50), size=st.sampled_from([1e-3, 7.0, 1e4]))
def test_optima_do_not_hang_on_clock_or_units(name, problem, shift, size):
    value, plan = solved(regulator(*problem)[0], name, intervals=3)
    for change in ({"start": shift}, {"size": size}):
        moved, other = solved(regulator(*problem, **change)[0], name, intervals=3)
        assert moved == pytest.approx(value, rel=1e-8, abs=1e-10)
        part = plan.phases[0]
        there = other.phases[0]["x"](there_grid(other)) / change.get("size", 1.0)
        assert there == pytest.approx(part["x"](there_grid(plan)), abs=1e-6)


def there_grid(plan):
    return plan.phases[0].grid(9)


@pytest.mark.parametrize("name", ["gauss", "radau"])
@QUICK
@given(problem=linear(), cut=st.floats(0.15, 0.85))
def test_linked_phases_and_more_intervals_are_the_same_motion(name, problem, cut):
    value, plan = solved(regulator(*problem)[0], name, intervals=2, degree=10)
    for other, mesh in (
        (regulator(*problem, cuts=(cut,))[0], {"intervals": 2, "degree": 10}),
        (regulator(*problem)[0], {"mesh": [0, cut, 1], "degree": 12}),
        (regulator(*problem)[0], {"intervals": 5, "degree": 7}),
    ):
        again, moved = solved(other, name, **mesh)
        assert again == pytest.approx(value, rel=1e-8, abs=1e-11)
        for part in moved.phases:
            t = part.grid(5)
            assert part["x"](t) == pytest.approx(plan["x"](t), abs=1e-6)
            assert part.costates(t) == pytest.approx(plan.phases[0].costates(t), abs=1e-5)


# -- refinement ----------------------------------------------------------------------------------------


def catalogue(name):
    return ct.load(f"optimal-control/{name}")


def layers():
    """Two boundary layers with nothing between: what a coarse mesh does not see."""
    return optimal_control.hypersensitive(horizon=30.0)


@pytest.mark.parametrize(
    ("name", "formulation", "value"),
    [
        ("linear-regulator", "gauss", None),  # smooth
        ("linear-regulator", "paper", None),
        ("double-integrator", "gauss", 2.0),  # bang-bang
        ("double-integrator", "radau", 2.0),
        ("aly-chan", "gauss", 0.0),  # a singular arc
        ("aly-chan", "radau", 0.0),
        ("bryson-denham", "radau", 4.0),  # a wall
        pytest.param("catalyst-mixing", "gauss", -0.0480556858, marks=pytest.mark.slow),
        pytest.param("goddard", "gauss", -1.0128369, marks=pytest.mark.slow),
        pytest.param("goddard", "radau", -1.0128369, marks=pytest.mark.slow),
        pytest.param("hypersensitive", "gauss", 1.330806905, marks=pytest.mark.slow),
        pytest.param("hypersensitive", "radau", 1.330806905, marks=pytest.mark.slow),
        pytest.param("bryson-denham", "hermite-simpson", 4.0, marks=pytest.mark.slow),
    ],
)
def test_refinement_ends_with_a_verified_plan(name, formulation, value):
    model = catalogue(name)
    found = ct.solve(model, formulation=formulation)
    assert found.termination == "locally_optimal" and found.verification.ok, str(found)
    if value is None:
        value = math.tanh(2 * math.sqrt(2)) / (math.sqrt(2) - math.tanh(2 * math.sqrt(2)))
    assert found.primal_bound == pytest.approx(value, abs=2e-6 if name != "goddard" else 1e-5)
    assert found.statistics["meshes"] >= 2
    assert model.verify(found.plan, tolerance=1e-6).ok
    # Less is asked, and found.
    rough = ct.solve(model, formulation=formulation, tolerance=1e-3)
    assert rough.termination == "locally_optimal"


def test_the_paper_refines_one_interval_in_degree():
    found = ct.solve(
        catalogue("linear-regulator"), formulation="paper", formulation_options={"degree": 3}
    )
    assert found.termination == "locally_optimal" and found.statistics["intervals"] == 1
    assert found.statistics["meshes"] > 2 and found.statistics["nodes"] > 6


@pytest.mark.parametrize(
    "options",
    [
        {"rounds": 1, "intervals": 1, "degree": 3},
        {"rounds": 2, "intervals": 1, "degree": 3},
        {"most_nodes": 12, "intervals": 2, "degree": 5},
        {"refine": False, "intervals": 2, "degree": 4},
        {"refine": False, "mesh": [0, 0.1, 1], "degree": 4},
    ],
)
def test_what_a_mesh_cannot_resolve_is_rejected_not_returned(options):
    model = layers()
    found = ct.solve(model, formulation_options=options)
    assert found.termination == "rejected" and found.plan is None and found.primal_bound is None
    assert found.rejected_plan is not None and "violated: motion" in found.message
    assert not found.verification.ok
    worst = [check for check in found.verification.checks if not check.ok]
    assert any(check.name == "motion" and check.worst > 1e-3 for check in worst)
    again = model.verify(model.plan_from_data(found.rejected_plan))
    assert again.ok == found.verification.ok


def test_a_fixed_mesh_stays():
    ocp = regulator(*LINEAR)[0]
    found = ct.solve(ocp, formulation_options={"refine": False, "mesh": [0, 0.3, 1], "degree": 9})
    assert found.plan.phases[0].states.knots == pytest.approx([0, 0.6, 2])
    assert found.statistics["meshes"] == 1 and found.statistics["nodes"] == 18
    # Two phases, one mesh each.
    ocp = regulator(*LINEAR, cuts=(0.5,))[0]
    options = {"refine": False, "mesh": [[0, 1], [0, 0.25, 1]], "degree": 9}
    found = ct.solve(ocp, formulation_options=options)
    assert [part.states.intervals for part in found.plan] == [1, 2]
    assert found.primal_bound == pytest.approx(solved(ocp, "gauss", degree=9)[0], rel=1e-8)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"intervals": 0}, ["'intervals'", "1 to 10000", "got 0"]),
        ({"intervals": 2.0}, ["'intervals'", "whole number", "2.0"]),
        ({"intervals": True}, ["'intervals'", "True"]),
        ({"degree": 0}, ["'degree'", "1 to 400", "got 0"]),
        ({"degree": "5"}, ["'degree'", "'5'"]),
        ({"rounds": 0}, ["'rounds'", "got 0"]),
        ({"most_nodes": -1}, ["'most_nodes'", "got -1"]),
        ({"refine": 1}, ["'refine'", "true or false", "1"]),
        ({"dependent": "x"}, ["'dependent'", "'drop'", "'x'"]),
        ({"mesh": [0, 0.5]}, ["increase from 0 to 1", "0.5"]),
        ({"mesh": [0, 0.7, 0.5, 1]}, ["increase from 0 to 1"]),
        ({"mesh": [0, float("nan"), 1]}, ["increase from 0 to 1", "nan"]),
        ({"mesh": [0, "a", 1]}, ["fractions from 0 to 1", "'a'"]),
        ({"mesh": []}, ["increase from 0 to 1"]),
        ({"mesh": 3}, ["fractions from 0 to 1", "3"]),
        ({"mesh": "even"}, ["fractions from 0 to 1", "'even'"]),
        ({"mesh": [[0, 1], [0, 1]]}, ["2 lists for 1 phases"]),
        ({"nodes": 3}, ["no option 'nodes'", "degree"]),
    ],
)
def test_bad_options_are_named(options, words):
    with pytest.raises(UnsupportedOption) as caught:
        ct.solve(regulator(*LINEAR)[0], formulation_options=options)
    assert all(word in str(caught.value) for word in words), caught.value


# -- limits and other starts ---------------------------------------------------------------------------


def test_a_time_limit_between_meshes_returns_what_there_is():
    """Trapezoids take many meshes for a boundary layer; whatever was found in time is judged."""
    model = layers()
    begin = time.perf_counter()
    found = ct.solve(
        model,
        formulation="trapezoid",
        formulation_options={"most_nodes": 10**6},
        time_limit=1.0,
        tolerance=1e-9,
    )
    assert time.perf_counter() - begin < 15
    assert found.limit == "time"
    assert found.termination in ("rejected", "no_solution", "locally_optimal", "feasible")
    assert (found.plan is None) == (found.verification is None or not found.verification.ok)


@pytest.mark.parametrize("delay", [0.0, 1.0])
def test_a_stop_during_refinement_loses_nothing(delay):
    control = Control()
    job = Job(model=layers(), backend="ipopt", formulation="trapezoid", tolerance=1e-9).resolved()
    timer = threading.Timer(delay, control.stop, [Limit.INTERRUPTED])
    begin = time.perf_counter()
    if delay:
        timer.start()
    else:
        control.stop(Limit.INTERRUPTED)
    found = execute(job, control=control)
    timer.cancel()
    assert time.perf_counter() - begin < 15
    assert found.limit == "interrupted"
    assert (found.plan is None) == (found.verification is None or not found.verification.ok)


def two_ways():
    """Around a disc on either side: the way below is a little longer."""
    ocp = OptimalControlProblem("two ways")
    phase = ocp.phase()
    q = phase.state("q", 2, initial=[-1, 0], final=[1, 0], lower=-1.5, upper=1.5)
    u = phase.control("u", 2, lower=-6, upper=6)
    phase.dynamics({q: u})
    phase.path(q[0] ** 2 + (q[1] + 0.05) ** 2 >= 0.25, name="disc")
    phase.guess(q=[[-1, 0], [0, -0.8], [1, 0]])
    ocp.minimise(phase.integral(casadi.sumsqr(u)))
    return ocp


def test_a_seed_is_a_start():
    one = two_ways().formulate("radau")
    drawn_at = {seed: one.started(seed).program.guess for seed in (1, 2, 3)}
    again = two_ways().formulate("radau").started(2).program.guess
    assert (drawn_at[2] == again).all()
    assert np.abs(drawn_at[1] - drawn_at[2]).max() > 0.1
    for guess in drawn_at.values():
        assert (guess >= one.program.column_lower).all()
        assert (guess <= one.program.column_upper).all()
        assert np.abs(guess - one.program.guess).max() > 0.1
    rough = {"formulation_options": {"intervals": 4}, "tolerance": 1e-4}
    first, second = (ct.solve(two_ways(), seed=2, **rough) for _ in range(2))
    assert first.to_dict()["plan"] == second.to_dict()["plan"]
    assert ct.solve(two_ways(), seed=0, **rough).primal_bound == pytest.approx(
        ct.solve(two_ways(), **rough).primal_bound, rel=1e-12
    )


def test_all_starts_are_kept_and_the_best_is_returned():
    options = {"formulation_options": {"intervals": 4}, "tolerance": 1e-4}
    found = ct.solve(two_ways(), starts=3, seed=0, **options)
    assert len(found.starts) == 3 and [one.seed for one in found.starts] == [0, 1, 2]
    values = [one.primal_bound for one in found.starts if one.primal_bound is not None]
    assert found.primal_bound == min(values)
    single = ct.solve(two_ways(), seed=1, **options)
    assert found.starts[1].primal_bound == pytest.approx(single.primal_bound, rel=1e-9)


# -- what cannot be ------------------------------------------------------------------------------------


def test_an_infeasible_problem_names_what_is_violated_most():
    ocp = OptimalControlProblem()
    phase = ocp.phase()
    x, u = phase.state("x", initial=0, final=0.5, unit="m"), phase.control("u", lower=-9, upper=9)
    phase.dynamics({x: u})
    phase.path(x + 0 * u <= -1, name="below", equation="5")
    ocp.minimise(phase.integral(u**2))
    found = ct.solve(ocp, formulation_options={"intervals": 3})
    assert found.termination == "locally_infeasible" and found.plan is None
    assert "violated most" in found.message and "below" in found.message


def test_too_little_time_is_locally_infeasible():
    ocp = OptimalControlProblem()
    phase = ocp.phase()
    x, v = phase.state("x", initial=0, final=1), phase.state("v", initial=0, final=0)
    u = phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.integral(u**2))
    found = ct.solve(ocp, formulation_options={"intervals": 3})
    assert found.termination == "locally_infeasible" and "dynamics of" in found.message


def test_a_motion_without_any_freedom_is_refined_too(run_python, tmp_path):
    """The control is fixed, so the state is given: more equations than columns are left."""
    script = """
import crosstrack as ct
from crosstrack.models import OptimalControlProblem
ocp = OptimalControlProblem()
phase = ocp.phase()
x, u = phase.state("x", initial=0, final=1), phase.control("u", lower=1, upper=1)
phase.dynamics({x: u})
ocp.minimise(phase.integral(x))
print(ct.solve(ocp, formulation_options={"intervals": 1}).termination)
"""
    (tmp_path / "script.py").write_text(script, "utf-8")
    printed = run_python("script.py", cwd=tmp_path)
    assert printed.split()[-1] == "locally_optimal"


@pytest.mark.parametrize(
    "size",
    [
        1e-6,
        1e6,
        1e-9,
        1e9,
    ],
)
def test_units_make_no_conditions_dependent(size):
    ocp = OptimalControlProblem()
    phase = ocp.phase()
    x, v = phase.state("x", initial=0, final=size), phase.state("v", initial=0, final=0)
    u = phase.control("u")
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.integral((u / size) ** 2))
    assert ocp.formulate("gauss").program.row_count


def test_a_guess_without_derivatives_is_left():
    """The length of a thrust has no derivative at 0, which is where a newcomer's guess is."""
    ocp = OptimalControlProblem()
    phase = ocp.phase(time=(0, (1, 5)))
    r = phase.state("r", 2, initial=[0, 0], final=[1, 1])
    v = phase.state("v", 2, initial=[0, 0], final=[0, 0])
    thrust = phase.control("thrust", 2)
    phase.dynamics({r: v, v: thrust})
    phase.path(casadi.norm_2(thrust) <= 1)
    ocp.minimise(phase.duration)
    program = ocp.formulate("gauss").program
    assert not np.isfinite(program.jacobian(program.guess).data).all()
    assert np.isfinite(program.jacobian(program.start()).data).all()
    found = ct.solve(ocp)
    # Bang-bang along the diagonal: 2 sqrt(distance).
    assert found.primal_bound == pytest.approx(2.0 * 2.0**0.25, rel=1e-6)


@pytest.mark.parametrize("name", ["hermite-simpson", "trapezoid"])
def test_what_has_a_fixed_order_takes_no_degree(name):
    with pytest.raises(
        UnsupportedOption, match=r"has no option 'degree'; its options: .*intervals"
    ):
        catalogue("bryson-denham").formulate(name, degree=6)
