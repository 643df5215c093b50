"""Every conic backend on every conformance case, against the others, and on what has no solution.

CVXPY clashes with other solvers and runs elsewhere: ``test_mip_backends.py`` has it solve the cases.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from runs import included

import crosstrack as ct
from crosstrack.errors import UnsupportedFormulation, UnsupportedOption
from crosstrack.models import ConicProgram, QuadraticProgram
from crosstrack.solvers.conformance import Matrix, Status, all_cases, cases_for, run_case
from crosstrack.solvers.conformance.conic import BALL, HYPERBOLA, PSD, conic
from crosstrack.solvers.conic.proofs import excludes, recedes
from crosstrack.solvers.contract.backend import Request, Termination
from crosstrack.solvers.contract.registry import find_backend
from crosstrack.solvers.qp.forms import ConicForm, columnwise

from .test_conic_programs import CASES, random_program

BACKENDS = ("clarabel", "scs", "ecos")
#: Fewer iterations than by default: the cases without an answer would take all of them, seven times.
OPTIONS: dict[str, dict[str, Any]] = {"scs": {"max_iters": 5_000}}
UNSUPPORTED = {"ecos": ("no quadratic objectives", "no semidefinite cones")}
#: Cases in which a first-order method does not reach the requested precision.
KNOWN = {
    "scs": ("conic: small disc", "conic: badly scaled columns"),
}
SEEDS = range(12)


def asked(name: str, program: ConicProgram, **arguments: Any) -> Any:
    backend = find_backend(name)
    assert not backend.missing(), f"{name} is expected here"
    options = backend.checked_options({**OPTIONS.get(name, {}), **arguments.pop("options", {})})
    return backend.run(program, Request(options=options, **arguments))


def test_every_included_solver_runs_the_cases() -> None:
    assert included("conic") <= set(BACKENDS)


@pytest.mark.parametrize("name", BACKENDS)
def test_conformance(name: str) -> None:
    backend = find_backend(name)
    names = [case for case in cases_for(backend) if case in CASES]
    assert names == list(CASES)
    found = [run_case(backend, case, OPTIONS.get(name)) for case in names]
    failures = [
        f"{r.case}: {r.reason}"
        for r in Matrix.of(found).failures
        if not (r.case.startswith(KNOWN.get(name, ("nothing",))) and "ended feasible" in r.reason)
    ]
    assert not failures, "\n".join(failures)
    unforeseen = [
        r.reason
        for r in found
        if r.status is Status.UNSUPPORTED
        and not r.reason.startswith("declares no")
        and not any(words in r.reason for words in UNSUPPORTED.get(name, ()))
    ]
    assert not unforeseen
    assert sum(r.status is Status.PASS for r in found) >= 35


@pytest.mark.parametrize("curved", [False, True])
def test_all_agree_on_random_programs(curved: bool) -> None:
    for seed in SEEDS:
        program, _ = random_program(np.random.default_rng(seed), curved)
        names = ["clarabel", "scs"]
        if not curved:
            # ECOS and Clarabel solve them without the semidefinite cones.
            plain = replace(
                program,
                cone_matrix=program.cone_matrix[:7],
                cone_offset=program.cone_offset[:7],
                cones=program.cones[:2],
            )
            best = [asked(name, plain).primal_bound for name in ("clarabel", "ecos")]
            assert best[0] == pytest.approx(best[1], rel=2e-6, abs=2e-6), seed
        found = [asked(name, program) for name in names]
        for name, answer in zip(names, found, strict=True):
            assert answer.termination is Termination.OPTIMAL, (seed, name, answer)
            assert program.verify(answer.point).ok
            bound = program.dual_bound(answer.duals, answer.point)
            assert bound <= answer.primal_bound + 1e-9
            assert bound == pytest.approx(answer.primal_bound, rel=2e-6, abs=2e-6)
        values = [answer.primal_bound for answer in found]
        assert values[0] == pytest.approx(values[1], rel=2e-6, abs=2e-6), seed


@pytest.mark.parametrize("name", ["clarabel", "scs"])
def test_without_cones_it_is_the_quadratic_program(name: str) -> None:
    quadratic = all_cases()["quadratic: portfolio, 200 columns"].program
    assert isinstance(quadratic, QuadraticProgram)
    program = ConicProgram(
        cone_matrix=np.zeros((0, quadratic.size)),
        cone_offset=(),
        cones=(),
        hessian=quadratic.hessian,
        **quadratic.shared(),
    )
    found, same = asked(name, program), asked(name, quadratic)  # type: ignore[arg-type]
    assert found.termination is same.termination is Termination.OPTIMAL
    assert np.array_equal(found.point, same.point)
    assert np.array_equal(found.duals, same.duals)


# Proofs.


def test_rays_that_nearly_prove_something_prove_nothing() -> None:
    program = conic([0, 0], [HYPERBOLA], matrix=[[1, 0]], row_lower=0, row_upper=0)
    for error in (1e-4, 1e-6, 1e-9, 1e-12, 1e-15, 0.0):
        # (1, 1 - e, - sqrt(2 e)) is in the cone, and cancels up to e.
        z = np.array([1.0, 1.0 - error, -np.sqrt(max(2 * error - error**2, 0.0))])
        ray = np.array([-(z[0] + z[1]), *z])
        assert not excludes(program, ray), error
        # The very same ray excludes every point of the row that is moved away from the cone.
        moved = replace(program, row_lower=np.array([-1.0]), row_upper=np.array([-1.0]))
        assert excludes(moved, np.array([-2.0, 1.0, 1.0, 0.0]))


def test_directions_that_nearly_fall_do_not() -> None:
    program = conic(
        [0, 0, 1], [(BALL, np.eye(3), [0, 0, 0])], matrix=[[1, -1, 0]], row_lower=0, row_upper=0
    )
    for fall in (1e-3, 1e-5, 1e-7):
        assert not recedes(program, np.array([1.0, 1.0, -fall])), fall
    assert recedes(replace(program, row_upper=np.array([np.inf])), np.array([1.0, 0.0, -1.0]))


@pytest.mark.parametrize("name", BACKENDS)
def test_infeasible_by_a_long_way_from_the_origin(name: str) -> None:
    cones = [(BALL, [[0, 0], [1, 0], [0, 1]], [1, -1e5, -1e5 - 3 * k]) for k in (0, 1)]
    answer = asked(name, conic([1, 1], cones))
    assert answer.termination is Termination.INFEASIBLE, answer.message
    assert answer.dual_bound is None
    assert answer.point is None


@pytest.mark.parametrize("name", ["clarabel", "scs"])
def test_large_matrices_in_the_order_of_the_solver(name: str) -> None:
    """The least eigenvalue of a matrix without symmetry in its triangle tells orders apart."""
    draw = np.random.default_rng(2)
    matrix = draw.normal(size=(5, 5))
    matrix += matrix.T
    low, high = np.tril_indices(5)
    rows = matrix[low, high] * np.where(low == high, 1.0, 2**0.5)
    answer = asked(name, conic([-1], [(PSD, -(low == high)[:, None].astype(float), rows.tolist())]))
    assert answer.primal_bound == pytest.approx(-np.linalg.eigvalsh(matrix)[0], abs=1e-6)


def test_columnwise_and_back() -> None:
    program, _ = random_program(np.random.default_rng(1))
    form = ConicForm.of(program, [PSD, BALL, program.cones[1].kind], columnwise)
    assert [block.kind for block in form.cones] == [PSD, BALL, program.cones[1].kind]
    assert columnwise(program.cones[2]).tolist() == [0, 1, 3, 2, 4, 5]
    duals = np.arange(1.0, 1 + form.right.size)
    # Rows and cone rows of the form stand where those of the program do.
    back = form.duals(form.right, program.row_count)[program.row_count :]
    assert np.array_equal(back, program.cone_offset)
    assert form.duals(duals, program.row_count).size == program.row_count + back.size


def test_a_comparison_takes_them_all() -> None:
    backends = ["clarabel", "ecos"]
    found = ct.compare([CASES["conic: geometric mean"].program], backends, time_limit=20)
    assert str(found.outcome) == "AGREED"
    assert [solution.backend for solution in found.solutions] == backends


def test_ecos_names_what_it_does_not_support() -> None:
    with pytest.raises(UnsupportedFormulation, match="quadratic objective"):
        asked("ecos", CASES["conic: quadratic objective over a disc"].program)
    with pytest.raises(UnsupportedFormulation, match="semidefinite"):
        asked("ecos", CASES["conic: cut of a triangle"].program)
    with pytest.raises(UnsupportedOption, match="HIGHS"):
        asked("cvxpy", CASES["conic: geometric mean"].program, options={"solver": "HIGHS"})
