"""Programs of transcriptions: derivatives, names, guesses and round trips."""

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import casadi
import numpy as np
import pytest
import scipy.sparse as sp
from transcribed import FORMULATIONS, LINEAR, regulator

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import ControlPlan, OptimalControlProblem
from crosstrack.models.optimal_control import sampling
from crosstrack.models.optimal_control.transcription.mesh import Mesh


def everything():
    """Return two phases with different states, parameters, integrals, paths and free times."""
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
    """Return the same problem with functions that remain matrix graphs."""
    phases = []
    for phase in ocp.definition.phases:
        inputs = [casadi.MX.sym(n, phase.function.size1_in(n)) for n in phase.function.name_in()]
        # The function has no scalar form, so the graph keeps its matrices.
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
    """Return the formulation of `everything` on an uneven mesh."""
    if not options:
        options = {"mesh": MIXED if name in ("gauss", "radau", "paper") else [0, 0.3, 0.5, 1]}
    return (problem or everything()).formulate(name, dependent="keep", **options)


def drawn(program, seed=1):
    """Return a point inside the bounds, with increasing times."""
    draw = np.random.default_rng(seed)
    low = np.where(np.isfinite(program.column_lower), program.column_lower, program.guess - 1)
    high = np.where(np.isfinite(program.column_upper), program.column_upper, program.guess + 1)
    return low + draw.uniform(0.1, 0.9, program.size) * (high - low), draw


@pytest.mark.sample(2)
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
    # Finite differences are independent of CasADi.
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
def test_every_row_and_column_has_a_description(name):
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
    # Columns are found by name: a marked value appears in the plan.
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


def test_a_violated_row_is_named():
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
    # The encoded integrals are those of the plan, so their rows are satisfied.
    rows = one.program.values(again)[1]
    for block in one.program.rows:
        if block.name.startswith("definition of integral"):
            assert rows[block.slice] == pytest.approx(0, abs=1e-12)
    assert plan.parameters["w"].tolist() == point[one.layout.parameter_columns[1:]].tolist()


@pytest.fixture(scope="module")
def regulated():
    """A linear regulator with its plan."""
    ocp = regulator(*LINEAR)[0]
    return ocp, ct.solve(ocp, formulation="radau", seed=0).plan


@pytest.mark.parametrize("name", FORMULATIONS)
def test_a_plan_of_another_formulation_satisfies_the_rows(name, regulated):
    ocp, plan = regulated
    fine = {"intervals": 8, "degree": 7}
    if name in ("hermite-simpson", "trapezoid"):
        fine = {"intervals": 200 if name == "hermite-simpson" else 2000}
    found = ct.verify(ocp, plan, formulation=name, formulation_options=fine, tolerance=2e-6)
    assert found.ok, found.summary()
    assert any(check.name == "dynamics of x[0]" for check in found.checks)


@pytest.mark.parametrize("name", FORMULATIONS)
def test_the_program_starts_at_the_guess(name):
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


def test_encode_rejects_a_plan_of_another_shape():
    one = written("radau")
    plan = one.decode(drawn(one.program)[0])
    climb, _ = plan.phases
    for wrong, words in (
        (ControlPlan((climb,), plan.parameters), "must be ['climb', 'glide'], got ['climb']"),
        (
            ControlPlan((climb, replace(climb, name="glide")), plan.parameters),
            "state_names of phase 'glide' of the plan must be",
        ),
        (ControlPlan(plan.phases, {"p": [1.0]}), "parameters of the plan must be"),
        (
            ControlPlan(plan.phases, {**plan.parameters, "w": [1.0]}),
            "parameter 'w' must be 2 finite numbers",
        ),
    ):
        with pytest.raises(InvalidData) as caught:
            one.encode(wrong)
        assert words in str(caught.value)
    point = drawn(one.program)[0]
    point[one.layout.phases[0].time_columns] = 1.0, 1.0
    with pytest.raises(InvalidData, match="phase 'climb': its end 1 is not after its start 1"):
        one.decode(point)


def test_courses_are_kept_safely_by_several_threads(monkeypatch):
    monkeypatch.setattr(sampling, "Course", lambda *parts: parts)
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)

    def look_up(_):
        for number in range(10_000):
            sampling.course_of(object(), object(), np.array([float(number)]))

    try:
        with ThreadPoolExecutor(4) as pool:
            list(pool.map(look_up, range(4)))
    finally:
        sys.setswitchinterval(interval)
        sampling._recent.clear()
