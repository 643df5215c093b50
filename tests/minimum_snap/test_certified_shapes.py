"""A QP solver's plan is optimal only if its shape is, as the objective hides it if durations differ."""

from dataclasses import replace

import numpy as np
import pytest
from minimum_snap import pressed

import crosstrack as ct
from crosstrack import jit
from crosstrack.errors import UnsupportedFormulation
from crosstrack.models import MinimumSnap
from crosstrack.models.minimum_snap import FREE
from crosstrack.models.minimum_snap.polynomials import critical_points
from crosstrack.solvers import Answer, Termination
from crosstrack.solvers.minimum_snap import interior_solver
from crosstrack.solvers.minimum_snap.direct import Banded
from crosstrack.solvers.run.certification import DISTANCE, SHAPE

#: Iterations of first-order methods, which end before their time limit.
FEWER = {"scs": {"max_iters": 4000}, "osqp": {"max_iter": 4000}}
BACKENDS = ["piqp", "proxqp", "osqp", "clarabel", "highs", "quadprog", "scs", "daqp"]
#: HiGHS takes as long as all others together.
WITHOUT_HIGHS = [
    pytest.param(name, marks=pytest.mark.slow) if name == "highs" else name for name in BACKENDS
]


def wild_path(seed, segments=40):
    """Return a path whose durations are log-uniform in [0.05, 20] s."""
    draw = np.random.default_rng(seed)
    durations = np.exp(draw.uniform(np.log(0.05), np.log(20.0), segments))
    waypoints = draw.uniform(-1.0, 1.0, (segments + 1, 2)).cumsum(axis=0)
    return MinimumSnap(waypoints, np.concatenate([[0.0], durations.cumsum()]))


def largest_distance(model, plan, other):
    """Return the largest distance at 201 times per segment, in the widest extent of the waypoints."""
    times = np.concatenate(
        [np.linspace(a, b, 201) for a, b in zip(model.times[:-1], model.times[1:], strict=True)]
    )
    extent = np.ptp(model.conditions[:, 0], axis=0).max()
    return np.abs(plan(times) - other(times)).max() / extent


@pytest.mark.parametrize("backend", WITHOUT_HIGHS)
def test_an_optimal_path_has_the_certified_shape(backend):
    outcomes = set()
    for seed in range(3):
        model = wild_path(seed)
        certified = ct.solve(model, "banded").plan
        found = ct.solve(model, backend, formulation="hermite", time_limit=20)
        outcomes.add(str(found.termination))
        if found.plan is None:
            continue
        distance = largest_distance(model, found.plan, certified)
        assert found.termination != "optimal" or distance <= 1.1e-6
        if DISTANCE in found.statistics:
            assert found.statistics[DISTANCE] == pytest.approx(distance, rel=0.1, abs=1e-9)
            if found.statistics[DISTANCE] > 1e-6:
                assert found.termination == "feasible"
                assert "of the extent away from the optimum that banded certifies" in found.message
    assert "feasible" in outcomes


@pytest.mark.parametrize("backend", ["clarabel", "proxqp"])
def test_a_path_of_wild_durations_is_optimal_in_legendre(backend):
    for seed in range(2):
        found = ct.solve(wild_path(seed), backend, formulation="legendre")
        assert found.termination == "optimal", found.message
        assert found.statistics[DISTANCE] <= 1e-6


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_coefficients_in_legendre_have_the_size_of_waypoints(scale):
    model = MinimumSnap([[0.0], [1.0], [3.0], [2.0]], scale * np.array([0.0, 1.0, 2.5, 4.0]))
    formulation = model.formulate("legendre")
    plan = ct.solve(model, "banded").plan
    point = formulation.encode(plan)
    assert 1.0 < np.abs(point).max() < 1e4
    assert formulation.program.objective(point) == pytest.approx(model.objective(plan), rel=1e-9)
    diagonal = formulation.program.hessian.diagonal()
    assert len(set(diagonal[diagonal > 0.0])) == 1 and (scale == 1.0) == (diagonal.max() == 1.0)


@pytest.mark.parametrize("formulation", ["hermite", "legendre"])
def test_a_path_with_even_durations_stays_optimal(formulation):
    draw = np.random.default_rng(5)
    model = MinimumSnap(draw.uniform(0.0, 10.0, (9, 3)), np.arange(9.0))
    for backend in ("piqp", "osqp", "clarabel"):
        found = ct.solve(model, backend, formulation=formulation)
        assert found.termination == "optimal", (backend, found.message)
        assert found.statistics[DISTANCE] <= 1e-6


def test_a_plan_that_banded_cannot_certify_is_only_feasible(monkeypatch):
    draw = np.random.default_rng(5)
    model = MinimumSnap(draw.uniform(0.0, 10.0, (9, 3)), np.arange(9.0))
    for reply in (
        Answer(Termination.FEASIBLE, point=ct.solve(model, "banded").plan, message="too coarse"),
        jit.OutOfTime(),
    ):

        def run(self, problem, request, reply=reply):
            if isinstance(reply, Exception):
                raise reply
            return reply

        monkeypatch.setattr(Banded, "run", run)
        found = ct.solve(model, "clarabel", formulation="hermite", isolate=False)
        assert found.termination == "feasible" and found.verified
        assert "banded cannot certify the plan" in found.message


def bounded_path(seed, segments=12, *, even=False):
    """Return a path in narrow boxes with a velocity limit; rest at each waypoint keeps both."""
    draw = np.random.default_rng(seed)
    durations = np.exp(draw.uniform(np.log(0.05), np.log(20.0), segments))
    durations = np.ones(segments) if even else durations
    points = draw.uniform(-1.0, 1.0, (segments + 1, 1)).cumsum(axis=0)
    speed = 2.1875 * np.abs(np.diff(points, axis=0)) / durations[:, None]
    return MinimumSnap(
        points, np.concatenate([[0.0], durations.cumsum()]),
        corridor_lower=np.minimum(points[:-1], points[1:]) - 0.1,
        corridor_upper=np.maximum(points[:-1], points[1:]) + 0.1,
        velocity_limit=1.2 * speed + 1e-3,
    )  # fmt: skip


def contacts_of(model, plan):
    """Return the instants at which one axis of `plan` touches a bound, as `pressed.solve` takes them."""
    found = []
    for bound in model.bounds:
        for k, long in enumerate(model.durations):
            curve = np.polynomial.Polynomial(plan.coefficients[k, :, 0]).deriv(bound.derivative)
            curve = curve / long**bound.derivative
            slope, bend = curve.deriv(1), curve.deriv(2)
            tops = critical_points(curve.coef[None])[0]
            tops = tops[(tops > 0.0) & (tops < 1.0)]
            for _ in range(3):
                tops = tops - slope(tops) / bend(tops)
            seen = []
            for s in [0.0, 1.0, *tops]:
                for side, edge in ((1, bound.upper[k, 0]), (-1, bound.lower[k, 0])):
                    near = abs(curve(s) - edge) <= 1e-9 * (bound.upper[k, 0] - bound.lower[k, 0])
                    if near and all(abs(s - other) > 1e-6 for other in seen):
                        seen.append(s)
                        sharp = min(side * bend(s), 0.0) if 0.0 < s < 1.0 else 0.0
                        found.append((k, s, bound.derivative, edge, side, sharp))
    return found


@pytest.mark.parametrize("seed", range(4))
def test_a_path_within_bounds_is_optimal_in_sixty_digits(seed):
    model = bounded_path(seed)
    found = ct.solve(model, "interior-point")
    assert found.termination == "optimal" and found.statistics["correction"] <= 1e-7
    contacts = contacts_of(model, found.plan)
    assert contacts
    powers, forces = pressed.solve(model, 0, contacts)
    assert min(forces) > 0.0
    s = (np.arange(33) / 32)[:, None] ** np.arange(8)
    apart = np.abs((powers - found.plan.coefficients[:, :, 0]) @ s.T).max()
    assert apart <= 1e-9 * model.position_scale.max()


@pytest.mark.parametrize(
    "segments", [3, *(pytest.param(count, marks=pytest.mark.slow) for count in (5, 12))]
)
@pytest.mark.parametrize("backend", WITHOUT_HIGHS)
def test_an_optimal_path_within_bounds_has_the_certified_shape(backend, segments):
    for even, seeds in ((False, range(max(1, segments // 5))), (True, range(1))):
        for seed in seeds:
            model = bounded_path(seed, segments, even=even)
            certified = ct.solve(model, "interior-point").plan
            try:
                limits = (
                    {} if even else {"time_limit": 60, "backend_options": FEWER.get(backend, {})}
                )
                found = ct.solve(model, backend, **limits)
            except UnsupportedFormulation:
                assert backend == "quadprog"  # singular Hessians
                continue
            if found.plan is None:
                continue
            distance = model.distance(found.plan, certified)
            assert found.termination != "optimal" or distance <= 1e-6
            assert found.termination != "feasible" or distance > 1e-6, found.message
            assert not even or found.termination == "optimal"


def test_a_right_objective_with_a_wrong_shape_is_only_feasible():
    found = ct.solve(bounded_path(0), "piqp")
    assert found.termination == "feasible" and found.gap <= 1e-6
    assert "of the extent away from the optimum that interior-point certifies" in found.message
    assert found.seconds["certify"] > 0.0


def test_what_cannot_be_certified_keeps_its_answer_and_has_a_note():
    even = bounded_path(0, even=True)
    loose = replace(
        even, waypoints=[*even.waypoints[:2].tolist(), *[[FREE]] * 11], start=[[0.0]], end=[]
    )
    for model, reason in (
        (replace(even, degree=9), "the degree 9 is above 2 order - 1 = 7"),
        (replace(loose, velocity_limit=None), "the optimum may not be unique"),
    ):
        for backend in ("interior-point", "piqp"):
            found = ct.solve(model, backend)
            assert found.termination == "optimal", (reason, found)
            assert reason in found.statistics[SHAPE]
    found = ct.solve(replace(even, continuity=2), "piqp")
    assert found.termination == "optimal"
    assert "interior-point does not cover continuity 2" in found.statistics[SHAPE]


def test_a_path_within_bounds_without_certificate_is_only_feasible(monkeypatch):
    monkeypatch.setattr(interior_solver, "certify_chain", lambda state, threshold: None)
    model = bounded_path(0, even=True)
    for backend in ("auto", "piqp"):
        found = ct.solve(model, backend, isolate=False)
        assert found.termination == "feasible" and found.verified
        assert "not the shape of the path" in found.message
        assert "backends tried" not in found.statistics
