"""Recognition of convex problems: never a false claim, and the usual convex problems are found."""

import casadi
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import OptimalControlProblem
from crosstrack.models.optimal_control.convexity import is_convex


def problem(
    cost=None, *, path=None, rate=None, end=None, final=None, bounds=(None, None), **options
):
    """Return a problem with the states x, v, the control u, and expressions made from ``(x, v, u, t)``."""
    ocp = OptimalControlProblem("drawn")
    phase = ocp.phase(time=options.pop("time", (0, 1)))
    x, v = phase.state("x", initial=0.5), phase.state("v", initial=0, **(final or {}))
    u = phase.control("u", lower=-1, upper=1, **options)
    z = x, v, u, phase.time
    phase.dynamics({x: v, v: rate(*z) if rate else u})
    if path is not None:
        lower, upper = bounds
        phase.path(path(*z), **({} if lower is None else {"lower": lower}),
                   **({} if upper is None else {"upper": upper}))  # fmt: skip
    total = phase.integral(cost(*z)) if cost else 0
    ocp.minimise(total + (end(phase, x) if end else 0) + 0 * phase.final(x))
    return ocp.build()


def convex(*arguments, **options):
    """Return whether the problem is recognised as convex."""
    return is_convex(problem(*arguments, **options).definition)


SQUARES = {"cost": lambda x, v, u, t: x**2 + 0.1 * u**2}


@pytest.mark.parametrize(
    "cost",
    [
        lambda x, v, u, t: x**2 + v**2 + u**2,
        lambda x, v, u, t: (x - casadi.sin(t)) ** 2,
        lambda x, v, u, t: casadi.exp(-t) * (x - 2 * v + t) ** 2,
        lambda x, v, u, t: casadi.mtimes([casadi.vertcat(x, v).T, casadi.DM([[2, 1], [1, 3]]), casadi.vertcat(x, v)]),
        lambda x, v, u, t: (x + v) * (x + v) / 3 + x * v - x * v,
        lambda x, v, u, t: casadi.fabs(u) + casadi.exp(x - v),
        lambda x, v, u, t: -casadi.sqrt(x + 2) + casadi.fmax(x, casadi.fmax(v, u) + t),
        lambda x, v, u, t: (0.3 * x + 0.7 * v) ** 2 + x,
        lambda x, v, u, t: x**2 - x * v + v**2 + casadi.exp(u),
        lambda x, v, u, t: 3 * x - u,
    ],
)  # fmt: skip
def test_recognises_convex_costs(cost):
    assert convex(cost)


@pytest.mark.parametrize(
    "cost",
    [
        lambda x, v, u, t: x * v,
        lambda x, v, u, t: x**2 + v**2 - 2.01 * x * v,
        lambda x, v, u, t: -(u**2),
        lambda x, v, u, t: casadi.sin(x),
        lambda x, v, u, t: x**4 - x**2,
        lambda x, v, u, t: (t - 0.5) * x**2,
        lambda x, v, u, t: (t - 0.5) * x * v + x**2 + v**2,
        lambda x, v, u, t: casadi.if_else(x > 0, 1, 2),
        lambda x, v, u, t: casadi.floor(x),
        lambda x, v, u, t: casadi.sign(x),
        lambda x, v, u, t: casadi.fmin(x, v),
        lambda x, v, u, t: casadi.sqrt(casadi.fabs(x)),
        lambda x, v, u, t: casadi.exp(-(x**2)),
        lambda x, v, u, t: casadi.log(1 + x**2),
        lambda x, v, u, t: 1 / (2 + x),
        lambda x, v, u, t: casadi.sin(t) * casadi.fabs(x),
    ],
)
def test_does_not_claim_that_other_costs_are_convex(cost):
    assert not convex(cost)


def test_needs_linear_dynamics_and_fixed_times():
    assert convex(**SQUARES, rate=lambda x, v, u, t: -casadi.cos(t) * x + u + t**2)
    assert not convex(**SQUARES, rate=lambda x, v, u, t: x * u)
    assert not convex(**SQUARES, rate=lambda x, v, u, t: casadi.if_else(x > 0, 1, -1) + u)
    assert not convex(**SQUARES, rate=lambda x, v, u, t: u**2)
    assert not convex(**SQUARES, time=(0, (1, 2)))
    assert not convex(**SQUARES, integer=True)


def test_needs_convex_paths():
    def disc(x, v, u, t):
        return x**2 + v**2

    assert convex(**SQUARES, path=disc, bounds=(None, 4))
    assert not convex(**SQUARES, path=disc, bounds=(0.1, None))
    assert not convex(**SQUARES, path=disc, bounds=(0.1, 4))
    assert convex(**SQUARES, path=lambda x, v, u, t: -disc(x, v, u, t), bounds=(-4, None))
    assert convex(**SQUARES, path=lambda x, v, u, t: x + t * u, bounds=(-3, 3))


def test_composes_integrals_and_ends():
    def cost(x, v, u, t):
        return u**2

    assert convex(cost, end=lambda phase, x: phase.final(x) ** 2)
    assert convex(cost, end=lambda phase, x: casadi.exp(phase.integral(x**2)))
    assert not convex(cost, end=lambda phase, x: -phase.integral(x**2))
    assert not convex(cost, end=lambda phase, x: phase.integral(x**2) ** 2)
    assert not convex(cost, end=lambda phase, x: casadi.sin(phase.final(x)))


@pytest.mark.parametrize(("name", "expected"), [
    ("bryson-denham", True), ("linear-regulator", True), ("singular-regulator", True),
    ("double-integrator-fuel", True), ("brachistochrone", False), ("van-der-pol", False),
    ("aly-chan", False), ("hanging-chain", False), ("decay-fit", False),
])  # fmt: skip
def test_recognises_problems_of_the_catalogue(name, expected):
    assert is_convex(ct.load(f"optimal-control/{name}").definition) is expected


# Expressions are trees of these operations on the unknowns, the time and numbers.
_LEAF = st.sampled_from([("x",), ("v",), ("u",), ("t",), (2.0,), (-0.5,)])
_UNARY = ("neg", "sq", "exp", "fabs", "sqrt", "sin", "log", "twice")
_TREES = st.recursive(
    _LEAF,
    lambda inner: st.one_of(
        st.tuples(st.sampled_from(_UNARY), inner),
        st.tuples(st.sampled_from(("add", "sub", "mul", "div", "fmax", "fmin")), inner, inner),
    ),
    max_leaves=7,
)
_APPLY = {
    "neg": lambda a: -a, "sq": lambda a: a**2, "exp": casadi.exp, "fabs": casadi.fabs,
    "sqrt": casadi.sqrt, "sin": casadi.sin, "log": casadi.log, "twice": lambda a: a + a,
    "add": lambda a, b: a + b, "sub": lambda a, b: a - b, "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b, "fmax": casadi.fmax, "fmin": casadi.fmin,
}  # fmt: skip


def _expression(tree, names):
    if len(tree) == 1:
        return names[tree[0]] if isinstance(tree[0], str) else casadi.MX(tree[0])
    return _APPLY[tree[0]](*(_expression(part, names) for part in tree[1:]))


@settings(max_examples=50, deadline=None, derandomize=True)
@given(tree=_TREES, seed=st.integers(0, 2**16))
def test_a_recognised_cost_is_convex_along_every_segment(tree, seed):
    def cost(x, v, u, t):
        return _expression(tree, {"x": x, "v": v, "u": u, "t": t})

    try:
        claimed = convex(cost)
    except InvalidData:  # the expression contains a constant that is not a number
        return
    if not claimed:
        return
    z, t = casadi.MX.sym("z", 3), casadi.MX.sym("t")
    function = casadi.Function("cost", [z, t], [cost(z[0], z[1], z[2], t)])
    draw = np.random.default_rng(seed)
    a, b = draw.normal(scale=2, size=(2, 3, 20))
    places, times = np.hstack([a, 0.5 * (a + b), b]), np.tile(draw.uniform(size=20), 3)
    f = np.array(function.map(60)(places, times[None])).reshape(3, 20)
    f = f[:, np.isfinite(f).all(axis=0)]  # outside its domain, a convex function is infinite
    assert (f[1] <= 0.5 * (f[0] + f[2]) + 1e-9 * (1 + np.abs(f).max(axis=0))).all()


@settings(max_examples=30, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**16), shift=st.floats(-1.0, 1.0))
def test_a_quadratic_cost_is_convex_as_its_least_eigenvalue_is(seed, shift):
    draw = np.random.default_rng(seed)
    root = draw.normal(size=(3, 3))
    matrix = root @ root.T + shift * np.eye(3)
    least = float(np.linalg.eigvalsh(matrix).min())

    def cost(x, v, u, t):
        z = casadi.vertcat(x, v, u)
        return casadi.mtimes([z.T, casadi.DM(matrix), z])

    if abs(least) > 1e-6:
        assert convex(cost) is (least > 0)


@pytest.mark.parametrize("sign", [1, -1])
def test_values_at_interior_instants_are_unknowns(sign):
    ocp = OptimalControlProblem("fit")
    phase = ocp.phase(time=(0, 1))
    x, u = phase.state("x", lower=-2, upper=2), phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: u - x})
    errors = (phase.at(t, x) - t for t in (0.2, 0.5, 0.7))
    ocp.minimise(phase.integral(u**2) + sign * sum(error**2 for error in errors))
    assert is_convex(ocp.definition) is (sign > 0)


def test_a_table_of_two_states_is_not_affine():
    grid = [0.0, 0.4, 0.8, 1.2, 1.6], [0.0, 5.0, 10.0, 15.0]
    values = [[10, 6, 3, 1], [11, 7, 4, 2], [12, 8, 5, 2], [14, 9, 6, 3], [16, 11, 7, 3]]
    table = ct.table(grid, values, outside="raise")
    ocp = OptimalControlProblem("table")
    phase = ocp.phase(time=(0, 10))
    x, h = phase.state("x", initial=0.4, lower=0, upper=1.6), phase.state("h", initial=0, final=4)
    u = phase.control("u", lower=-1, upper=1)
    phase.dynamics({x: 0.02 * table(x, h) - 0.1 * x - 0.3 * u, h: u})
    ocp.minimise(-phase.final(x))
    assert not is_convex(ocp.build().definition)
