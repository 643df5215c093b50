"""Switching structures with known instants, and the sampled test of the minimum principle."""

import math
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from derived_closed import found_root, integrated
from derived_extremals import POL
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from transcribed import catalogue

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import OptimalControlProblem
from crosstrack.models.optimal_control import hamiltonian_spread, minimum_principle, structure


@cache
def solved(name):
    """Return an entry of the catalogue with its plan."""
    model = catalogue(name)
    return model, ct.solve(model, seed=0, isolate=False).plan


def arcs_of(model, name):
    """Return the kinds and times of the arcs of one name, and all arcs of the plan."""
    if isinstance(model, str):
        model, plan = solved(model)
    else:
        plan = ct.solve(model, seed=0, isolate=False).plan
    arcs = structure(model, plan)
    chosen = [arc for arc in arcs if arc.name == name]
    return [arc.kind for arc in chosen], [(arc.start, arc.end) for arc in chosen], arcs


def hits_wall(wall):
    ocp = OptimalControlProblem("wall")
    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=0, upper=wall)
    v, u = phase.state("v", initial=1, final=-1), phase.control("u")
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.integral(u**2 / 2))
    return ocp.build()


def test_the_double_integrator_switches_at_half_of_the_time():
    kinds, times, _ = arcs_of("double-integrator", "u")
    assert kinds == ["upper", "lower"]
    np.testing.assert_allclose(times, [(0, 1), (1, 2)], atol=1e-6)


@pytest.mark.parametrize("wall", [1 / 9, 0.14])
def test_bryson_denham_follows_the_wall(wall):
    # Bryson and Ho (1975), section 3.11: on the wall from 3 l to 1 - 3 l if l <= 1/6.
    kinds, times, arcs = arcs_of(hits_wall(wall), "x")
    assert kinds == ["active at upper"]
    np.testing.assert_allclose(times[0], (3 * wall, 1 - 3 * wall), atol=2e-3)
    assert [arc.kind for arc in arcs if arc.name == "u"] == ["interior"]


def test_bryson_denham_touches_a_far_wall():
    # It touches the wall at 1/2 if 1/6 <= l <= 1/4, and does not reach it otherwise.
    kinds, times, _ = arcs_of(hits_wall(0.2), "x")
    assert kinds == ["touch at upper"]
    np.testing.assert_allclose(times[0], (0.5, 0.5), atol=1e-3)
    assert arcs_of(hits_wall(0.3), "x")[0] == []


def test_van_der_pol_leaves_and_reaches_its_bounds_at_the_instants_of_the_extremal():
    kinds, times, _ = arcs_of("van-der-pol", "u")
    assert kinds == ["lower", "interior", "upper", "interior"]
    start = found_root(
        lambda p: integrated(POL, (0, 5), [0, 1, *p, 0])[2:4], [0.8329, 4.8857], 1e-9
    )
    begin = [0, 1, *start, 0]
    motion = solve_ivp(POL, (0, 2), begin, "DOP853", rtol=1e-10, atol=1e-10, dense_output=True)
    grid = np.linspace(0.0, 2.0, 201)

    def off(t, bound):
        return -motion.sol(t)[2] / 2 - bound

    instants = [
        brentq(off, grid[k], grid[k + 1], (bound,))
        for bound in (-0.3, 1.0)
        for k in np.flatnonzero(np.diff(np.sign(off(grid, bound))))
    ]
    assert len(instants) == 3
    np.testing.assert_allclose([end for _, end in times[:-1]], sorted(instants), atol=5e-3)


@pytest.mark.slow
def test_goddard_burns_follows_the_singular_arc_and_coasts():
    kinds, times, arcs = arcs_of("goddard", "thrust")
    assert kinds == ["upper", "singular", "lower"]
    # Instants of `derived_extremals.goddard`, within the stated error.
    errors = [arc.tolerance for arc in arcs if arc.name == "thrust"]
    for (_, end), error, known in zip(times, errors, (0.0235097, 0.0726707), strict=False):
        assert abs(end - known) <= error < 2e-3
    empty = next(arc for arc in arcs if arc.name == "m")
    assert empty.kind == "active at lower"
    assert empty.start == pytest.approx(0.0726707, abs=1e-3)


@pytest.mark.parametrize(
    ("name", "control", "kinds", "switch"),
    [
        ("moon-lander", "thrust", ["lower", "upper"], (math.sqrt(17) - 2) / 1.5),
        ("double-integrator-fuel", "forward", ["upper", "lower"], 0.5),
        ("double-integrator-fuel", "backward", ["lower", "upper"], 2.0),
        # On the singular arc x = A cosh(5 - t); it begins at the end of x = t - t² / 2.
        (
            "singular-regulator",
            "u",
            ["lower", "singular"],
            brentq(lambda t: (t - 1) / (t - t * t / 2) - math.tanh(5 - t), 1.2, 1.6),
        ),
    ],
)
def test_switches_of_affine_controls(name, control, kinds, switch):
    found, times, _ = arcs_of(name, control)
    assert found == kinds
    assert times[0][1] == pytest.approx(switch, abs=3e-3)


def test_arcs_cover_the_phase_and_are_the_details_of_the_model():
    model, plan = solved("moon-lander")
    rows = model.details(plan)
    assert rows and set(rows[0]) == {"phase", "name", "kind", "start", "end", "tolerance"}
    thrust = [row for row in rows if row["name"] == "thrust"]
    assert thrust[0]["start"] == plan.start and thrust[-1]["end"] == plan.end
    assert all(a["end"] == b["start"] for a, b in pairwise(thrust))
    with pytest.raises(InvalidData, match="tolerance must"):
        structure(model, plan, tolerance=0.5)


def test_a_constraint_determines_an_affine_control():
    ocp = OptimalControlProblem("hold")
    phase = ocp.phase(time=(0, 3))
    x, u = phase.state("x", initial=0, upper=1), phase.control("u", lower=-1, upper=2)
    phase.dynamics({x: u})
    ocp.minimise(-phase.integral(x))
    kinds, times, _ = arcs_of(ocp.build(), "u")
    assert kinds == ["upper", "constrained"]
    assert times[0][1] == pytest.approx(0.5, abs=5e-3)


@pytest.mark.parametrize(
    ("name", "end"),
    [
        ("double-integrator", -1.0),
        ("moon-lander", 0.0),
        pytest.param("goddard", 0.0, marks=pytest.mark.slow),
        ("van-der-pol", None),
    ],
)
def test_the_hamiltonian_of_an_optimum_meets_its_conditions(name, end):
    model, plan = solved(name)
    (report,), (least,) = hamiltonian_spread(model, plan), minimum_principle(model, plan)
    assert report.autonomous and report.relative < 2e-3
    assert (report.required_end is None) == (end is None)
    if end is not None:
        assert report.required_end == end
        assert report.end == pytest.approx(end, abs=2e-3)
        assert report.vanishing == (end == 0.0)
    assert least.relative < 1e-4 and least.samples == 64


def test_an_interior_instant_keeps_the_weights_of_the_minimum_principle():
    ocp = OptimalControlProblem("instant")
    phase = ocp.phase(time=(0, 1))
    x, u = phase.state("x", initial=0), phase.control("u", lower=-3, upper=3)
    phase.dynamics({x: u})
    ocp.minimise(phase.integral(u**2) + (phase.at(0.5, x) - 1) ** 2)
    model = ocp.build()
    (least,) = minimum_principle(model, ct.solve(model, seed=0).plan)
    assert least.relative < 1e-4


def test_another_control_violates_the_minimum_principle():
    model, plan = solved("double-integrator")
    part = plan.phases[0]
    fields = {
        name: getattr(part, name)
        for name in ("name", "states", "state_names", "control_names", "costates")
    }
    weak = type(part.controls)(
        part.controls.knots,
        part.controls.nodes,
        tuple(0.5 * table for table in part.controls.values),
    )
    other = type(plan)((type(part)(controls=weak, **fields),), plan.parameters)
    (least,) = minimum_principle(model, other)
    # H falls by half of |λ_v|, whose largest value is 1, at both ends.
    assert least.excess == pytest.approx(0.5, abs=0.05)
    assert abs(least.better[0]) > 0.8
    with pytest.raises(InvalidData, match="samples must be"):
        minimum_principle(model, plan, samples=0)


def measured_motion():
    """Return a problem whose costates jump at an instant, and whose control acts by an algebraic variable."""
    ocp = OptimalControlProblem("measured")
    phase = ocp.phase(time=(0, 2))
    x, v = phase.state("x", initial=0, final=(0.9, 1.1)), phase.state("v", initial=0)
    u, force = phase.control("u", lower=-4, upper=4), phase.algebraic("force", upper=0.55)
    phase.algebraic_equation(force + 0.1 * force**3 == u)
    phase.dynamics({x: v, v: force - 0.1 * v})
    ocp.minimise(phase.integral(u**2) + 10 * (phase.at(0.8, x) - 0.2) ** 2)
    return ocp.build()


def test_interior_instants_and_algebraic_variables_keep_the_minimum_principle():
    model = measured_motion()
    plan = ct.solve(model, seed=0, isolate=False).plan
    (least,) = minimum_principle(model, plan)
    assert abs(least.relative) < 1e-4
    part = plan.phases[0]
    double = tuple(2 * table for table in part.costates.values)
    double = replace(part, costates=replace(part.costates, values=double))
    # With the wrong costates, another force is better. The sampled controls must carry it along.
    (least,) = minimum_principle(model, replace(plan, phases=(double,)))
    assert least.relative > 0.02
    assert least.better[1] + 0.1 * least.better[1] ** 3 == pytest.approx(least.better[0], abs=1e-7)


def test_a_bound_of_an_algebraic_variable_is_a_constraint():
    model = measured_motion()
    kinds, times, arcs = arcs_of(model, "force")
    assert kinds == ["active at upper"] and times[0][1] - times[0][0] > 0.02
    # The control acts on the rates only by the nonlinear equation.
    assert {arc.kind for arc in arcs if arc.name == "u"} == {"interior"}
    linear = OptimalControlProblem("saturated")
    phase = linear.phase(time=(0, (0.5, 9)))
    x, v = phase.state("x", initial=0, final=1), phase.state("v", initial=0, final=0)
    u, force = phase.control("u", lower=-1, upper=1), phase.algebraic("force")
    phase.algebraic_equation(2 * force == u)
    phase.dynamics({x: v, v: force})
    linear.minimise(phase.end)
    kinds, _, arcs = arcs_of(linear.build(), "u")
    assert kinds == ["upper", "lower"] and all(arc.name == "u" for arc in arcs)
