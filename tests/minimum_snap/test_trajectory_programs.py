"""The programs of a trajectory model against brute force, and their refinement."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from minimum_snap.paths import (
    bounded,
    brute_force,
    make,
    models,
    of_order,
    optimum_of,
    solved_densely,
    walk,
)

import crosstrack as ct
from crosstrack.errors import UnsupportedFormulation, UnsupportedOption
from crosstrack.models import MinimumSnap


def covering(model):
    names = ["legendre", "monomial"]
    if model.continuity <= model.order - 1:
        names.append("hermite")
    return names


@settings(max_examples=10, deadline=None, suppress_health_check=list(HealthCheck))
@given(model=models())
def test_every_program_agrees_with_brute_force(model):
    plan = optimum_of(model)
    best = model.objective(plan)
    size = max(1.0, np.abs(plan.coefficients).max())
    checked = model.verify(plan)
    assert checked.ok, checked
    assert best == pytest.approx(checked.objective)
    for name in covering(model):
        written = model.formulate(name)
        program = written.program
        point = written.encode(plan)
        rows = program.verify(point)
        assert rows.ok, (name, rows)
        assert program.objective(point) == pytest.approx(best, rel=1e-8, abs=1e-9 * size**2)
        again = written.decode(point)
        assert np.allclose(again.coefficients, plan.coefficients, rtol=0, atol=1e-7 * size)
        assert solved_densely(program) == pytest.approx(best, rel=1e-7, abs=1e-8 * size**2), name


@settings(max_examples=15, deadline=None, suppress_health_check=list(HealthCheck))
@given(model=models(), seed=st.integers(0, 999))
def test_blocks_cover_the_rows_and_name_places(model, seed):
    for name in covering(model):
        program = model.formulate(name).program
        assert sum(block.size for block in program.rows) == program.row_count
        assert sum(block.size for block in program.columns) == program.size
        for block in program.rows:
            for entry in range(block.size):
                place = block.place(entry)
                assert place.startswith(("at knot", "on segment")), place
                knot = int(place.split()[2].strip(","))
                assert 0 <= knot <= model.segments


@settings(max_examples=25, deadline=None)
@given(model=models(inner=False))
def test_the_legendre_hessian_is_zeros_and_ones(model):
    program = model.formulate("legendre").program
    hessian = program.hessian.toarray()
    if model.weights is None or np.count_nonzero(model.weights) == 1:
        assert np.array_equal(hessian, np.diag(np.diag(hessian)))
        each = np.diag(hessian).reshape(-1, model.degree + 1)
        assert np.array_equal(
            each, np.tile(np.arange(model.degree + 1) >= model.order, (len(each), 1))
        )
    largest = np.abs(program.matrix).max(axis=1).toarray().ravel()
    assert np.allclose(largest, 1.0)


def test_hermite_keeps_the_constant_and_has_no_rows():
    model = make()
    program = model.formulate("hermite").program
    assert program.row_count == 0
    assert program.size == 2 * 3  # velocity, acceleration, jerk of one knot in 2-D
    assert program.offset > 0
    straight = MinimumSnap([[0.0], [1]], [0, 1])
    assert straight.formulate("hermite").program.size == 0
    assert straight.formulate("hermite").program.objective(np.empty(0)) == pytest.approx(100800)


@pytest.mark.parametrize("name", ["legendre", "monomial", "hermite"])
@pytest.mark.parametrize(("option", "words"), [
    ({"samples": 1}, r"samples must be in \[2, 1000\], got 1"),
    ({"samples": 1001}, "must be in"),
    ({"samples": 8.0}, "must be a whole number"),
    ({"samples": True}, "must be a whole number"),
    ({"samples": "8"}, "must be a whole number"),
    ({"rounds": 3}, "no option 'rounds'"),
    ({"instants": 3}, "no option 'instants'"),
])  # fmt: skip
def test_options_are_checked(name, option, words):
    with pytest.raises(UnsupportedOption, match=words):
        make().formulate(name, **option)


@pytest.mark.parametrize(
    ("name", "changes", "words"),
    [
        ("paper", {"velocity_limit": 9}, "does not support velocity limit"),
        ("paper", {"corridor_lower": -9}, "does not support corridor"),
        (
            "paper",
            {"polytope_segments": [0], "polytope_normals": [[1, 0]], "polytope_offsets": [9]},
            "does not support polytopes",
        ),
        (
            "paper",
            {"derivatives": [[[None] * 2], [[1, None]], [[None] * 2]]},
            "fixes no derivative at inner knots",
        ),
        ("hermite", {"continuity": 4}, "continuity 4 needs another formulation"),
        ("hermite", {"start": np.zeros((4, 2)), "degree": 8}, "derivative 4 is fixed"),
    ],
)
def test_formulations_reject_unsupported_models(name, changes, words):
    with pytest.raises(UnsupportedFormulation, match=words):
        make(**changes).formulate(name)


@pytest.mark.parametrize("backend", ["banded", "piqp:paper"])
def test_equations_11_and_23_to_25_by_hand(backend):
    """There and back in two segments of 1 s, from rest to rest.

    The jerk is free at all knots, so the snap u is 0 there (optimality), and by symmetry u' is 0 in the
    middle: u = k t (1 - t)^2 on the first segment. With v = a = 0 at t = 0 (eq. 23) its integral is
    x = c t^3 + k (t^5 / 120 - t^6 / 180 + t^7 / 840). x(1) = 1 (eq. 24) and x'(1) = 0 give
    k = -630 and c = 3.5. Each segment costs k^2 B(3, 5) = 630^2 / 105 = 3780 (eq. 11).
    """
    rest = np.zeros((2, 1))
    model = MinimumSnap([[0], [1], [0]], [0, 1, 2], continuity=2, start=rest, end=rest)
    name, _, formulation = backend.partition(":")
    found = ct.solve(model, name, formulation=formulation or None)
    assert found.primal_bound == pytest.approx(7560, rel=1e-6)
    by_hand = [0, 0, 0, 3.5, 0, -5.25, 3.5, -0.75]
    np.testing.assert_allclose(found.plan.coefficients[0, :, 0], by_hand, atol=1e-5)
    # Eq. 25 leaves the jerk free, which jumps from 21 - 315 + 420 - 157.5 to the opposite.
    begin, end = found.plan.at_ends(3)
    assert (end[0, 0], begin[1, 0]) == pytest.approx((-31.5, 31.5), rel=1e-4)
    (check,) = (
        MinimumSnap([[0], [1], [0]], [0, 1, 2], start=rest, end=rest).verify(found.plan).violated
    )
    assert check.name == "continuity of jerk"


@pytest.mark.parametrize("backend", ["piqp", "clarabel"])
def test_the_papers_program_breaks_down_and_is_rejected(backend):
    model = walk(100)
    broken = ct.solve(model, backend, formulation="paper", time_limit=30)
    assert broken.termination == "rejected", broken
    assert broken.plan is None
    assert broken.dual_bound is None
    right = ct.solve(model, backend, formulation="legendre")
    assert right.termination == "optimal", right
    assert right.verification.ok


def test_the_papers_program_relaxes_the_minimum_snap_spline():
    model = make()
    answer = ct.solve(model, "piqp", formulation="paper")
    assert answer.termination == "rejected"
    assert "continuity of jerk" in {c.name for c in answer.verification.violated}
    paper = make(continuity=2, start=np.zeros((2, 2)), end=np.zeros((2, 2)))
    assert ct.solve(paper, "piqp", formulation="paper").primal_bound < make().objective(
        brute_force(make())
    )


def test_a_common_seed_is_granted_where_the_solver_draws_nothing():
    first, second = (ct.solve(make(), "cvxpy", seed=seed) for seed in (0, 3))
    assert first.termination == second.termination == "optimal"
    assert np.array_equal(first.plan.coefficients, second.plan.coefficients)


# -- corridors: refinement -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["legendre", "hermite"])
@pytest.mark.parametrize("samples", [2, 8])
def test_refinement_adds_instants_until_the_exact_extremes_settle(name, samples):
    from crosstrack.solvers import Request, find_backend

    model = bounded(degree=8)
    backend = find_backend("piqp")
    written = model.formulate(name, samples=samples)
    values, rows, points, bounds = [], [], [], []
    while True:
        request = Request(options=backend.checked_options({}))
        answer = backend.run(written.program, request)
        assert answer.termination == "optimal"
        values.append(written.program.objective(answer.point))
        bounds.append(written.program.dual_bound(answer.duals, answer.point))
        rows.append(written.program.row_count)
        points.append(answer.point)
        finer = written.refined(answer.point, 1e-6)
        if finer is None:
            break
        # The old program is a relaxation of the new one: its rows are among the new ones.
        assert finer.program.row_count >= written.program.row_count
        written = finer
    assert all(a <= b * (1 + 1e-5) for a, b in pairwise(values))
    assert all(bound <= values[-1] * (1 + 1e-7) for bound in bounds)
    assert rows[-1] > rows[0]
    found = model.verify(written.decode(points[-1]))
    assert found.ok, found
    assert len(values) > 1
    solution = ct.solve(model, "piqp", formulation=name, formulation_options={"samples": samples})
    assert solution.termination == "optimal"
    assert solution.primal_bound == pytest.approx(values[-1], rel=1e-6)
    assert solution.statistics["refinements"] == len(values) - 1


def test_a_plan_that_keeps_the_limits_satisfies_every_refined_program():
    from crosstrack.solvers import Request, find_backend

    model = bounded()
    plan = ct.solve(model, "piqp").plan
    backend = find_backend("piqp")
    for name in ("legendre", "monomial", "hermite"):
        written = model.formulate(name, samples=2)
        for _ in range(3):
            assert written.program.verify(written.encode(plan)).ok
            answer = backend.run(written.program, Request(options=backend.checked_options({})))
            written = written.refined(answer.point, 1e-6) or written


def test_limits_above_the_degree_are_no_trouble():
    """The jerk of a polyline is zero; a limit on it says nothing."""
    model = of_order(1, jerk_limit=1.0, velocity_limit=9.0)
    plan = brute_force(of_order(1))
    assert model.verify(plan).ok
    assert ct.solve(model, "piqp").primal_bound == pytest.approx(model.objective(plan))


@pytest.mark.parametrize("backend", ["piqp", "clarabel"])
def test_a_straight_flight_at_constant_speed_is_optimal(backend):
    """Its objective is zero, which no relative gap can measure."""
    rows = [[1.0], [None], [None]]
    model = MinimumSnap([[0.0], [1], [2]], [0, 1, 2], start=rows, end=rows, velocity_limit=1.5)
    answer = ct.solve(model, backend)
    assert answer.termination == "optimal", answer
    assert answer.primal_bound == pytest.approx(0.0, abs=1e-12)
