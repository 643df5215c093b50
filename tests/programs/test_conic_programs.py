"""Conic programs as models: data, checks, distances from cones, bounds, export."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from crosstrack.errors import InvalidData
from crosstrack.models import ConeBlock, ConeKind, ConicProgram, Model, ProgramBuilder
from crosstrack.models.programs.cones import inside, inside_dual, missing, symmetric, triangle
from crosstrack.solvers.conformance import all_cases
from crosstrack.solvers.conformance.conic import conic
from crosstrack.solvers.contract.backend import Request
from crosstrack.solvers.contract.registry import find_backend

CASES = {name: case for name, case in all_cases().items() if name.startswith("conic")}
SOLVED = [n for n, c in CASES.items() if c.expectation.point is not None and "duals" not in n]
#: A dimension of each kind.
SIZES = {ConeKind.SECOND_ORDER: 4, ConeKind.EXPONENTIAL: 3, ConeKind.SEMIDEFINITE: 6}


def disc(**others: Any) -> ConicProgram:
    """Return the least x + y over the unit disc."""
    given_: dict[str, Any] = {
        "cost": [1, 1],
        "cone_matrix": [[0, 0], [1, 0], [0, 1]],
        "cone_offset": [1, 0, 0],
        "cones": (ConeBlock("disc", "7", 0, 3, unit="m", kind=ConeKind.SECOND_ORDER),),
    }
    return ConicProgram(**{**given_, **others})


@pytest.mark.parametrize("name", SOLVED)
def test_the_cases_are_right(name: str) -> None:
    case = CASES[name]
    point = np.array(case.expectation.point, float)
    found = case.program.verify(point, tolerance=1e-9)
    assert found.ok, str(found)
    assert found.objective == pytest.approx(case.expectation.objective, abs=1e-9)
    if case.expectation.duals is not None:
        duals = np.array(case.expectation.duals, float)
        assert case.program.dual_bound(duals, point) == pytest.approx(found.objective, abs=1e-9)


@pytest.mark.parametrize("name", SOLVED)
def test_json_is_exact(name: str) -> None:
    program = CASES[name].program
    read = Model.from_json(program.to_json())
    assert isinstance(read, ConicProgram)
    assert read.digest == program.digest == pickle.loads(pickle.dumps(program)).digest
    assert read.to_json() == program.to_json()


def test_the_digest_knows_the_cones_and_not_their_names() -> None:
    program = disc()
    renamed = disc(cones=(ConeBlock("ball", "", 0, 3, kind="second-order"),))
    assert renamed.digest == program.digest
    rays = ConeBlock("rays", "", 0, 3, kind=ConeKind.SECOND_ORDER, dimension=1)
    apart = tuple(ConeBlock(f"ray {k}", "", k, 1, kind=ConeKind.SECOND_ORDER) for k in range(3))
    assert disc(cones=(rays,)).digest == disc(cones=apart).digest != program.digest


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"cones": ()}, "cover 0 of 3"),
        ({"cone_offset": [1, 0]}, "cone_offset"),
        ({"hessian": [[1, 0], [0, -1]]}, "semidefinite"),
        ({"column_lower": [0.0]}, "column_lower"),
        ({"matrix": [[1, 1]]}, "row_lower"),
    ],
)
def test_inconsistent_fields_are_refused(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidData, match=words):
        disc(**changed)


@pytest.mark.parametrize(
    ("size", "kind", "dimension"),
    [(4, "exponential", 0), (5, "semidefinite", 0), (7, "second-order", 3), (0, "second-order", 0)],
)
def test_cones_of_no_such_size_are_refused(size: int, kind: str, dimension: int) -> None:
    with pytest.raises(InvalidData, match="hold no"):
        ConeBlock("cone", "", 0, size, kind=ConeKind(kind), dimension=dimension)
    with pytest.raises(InvalidData, match="power"):
        ConeBlock("cone", "", 0, 3, kind="power")  # type: ignore[arg-type]


def test_violations_name_their_cone() -> None:
    index = np.array([[4], [5]])
    pair = ConeBlock(
        "leg", "12", 0, 6, "leg {0}", index, "m", kind=ConeKind.SECOND_ORDER, dimension=3
    )
    program = disc(
        cone_matrix=np.vstack([disc().cone_matrix.toarray()] * 2),
        cone_offset=[5, 0, 0, 1, 0, 0],
        cones=(pair,),
    )
    found = program.verify(np.array([3.0, 4.0]))
    assert not found.ok
    (check,) = (check for check in found.checks if check.name == "leg")
    assert (check.worst, check.where, check.equation, check.unit) == (4.0, "leg 5", "12", "m")
    # Relative to the largest term: 4.
    assert check.tolerance == pytest.approx(4e-6)
    assert program.verify(np.array([0.6, 0.8])).ok
    assert program.outline() == "0 rows, 2 columns, 2 second-order cones"


def test_a_program_without_rows_stays_one_without_them() -> None:
    program = disc(matrix=[[1, 0], [0, 1]], row_lower=[0, 0])
    assert program.row_upper.tolist() == [np.inf, np.inf]
    assert program.row_count == 2
    assert replace(program, name="x").digest == program.digest


def test_the_builder_writes_cones() -> None:
    builder = ProgramBuilder()
    point = builder.columns("point", 2, lower=-np.inf)
    legs = builder.columns("leg", 2, cost=1.0, unit="m")
    # Both legs of a path from (0, 0) by way of `point` to (10, 0), with the point above 2.
    leg = np.arange(2)
    builder.cones(
        "length",
        ConeKind.SECOND_ORDER,
        2,
        3,
        (3 * leg, legs, 1.0),
        (3 * leg[:, None] + [1, 2], point, 1.0),
        offset=[[0, 0, 0], [0, -10, 0]],
        equation="1",
        template="leg {0}",
        index=leg,
    )
    builder.rows("height", 1, (0, point[1], 1.0), lower=2.0)
    program = builder.build_conic(name="path", offset=3.0)
    assert program.cone_rows(np.array([5.0, 2, 6, 7])).tolist() == [6, 5, 2, 7, -5, 2]
    answer = find_backend("clarabel").run(program, Request())
    assert answer.point[:2] == pytest.approx([5, 2], abs=1e-4)
    assert answer.primal_bound == pytest.approx(3 + 2 * 29**0.5, abs=1e-6)
    found = program.verify(np.array([5.0, 2, 6, 5]))
    assert [check.where for check in found.violated] == ["leg 1"]
    with pytest.raises(InvalidData, match="build_conic"):
        builder.build()
    builder.columns("whole", 1, integral=True)
    with pytest.raises(InvalidData, match="integral"):
        builder.build_conic()


# Cones.


def distance(kind: ConeKind, point: np.ndarray) -> float:
    return float(missing(kind, point[None])[0])


@pytest.mark.parametrize(
    ("kind", "point", "off"),
    [
        ("second-order", [5, 3, 4], 0),
        ("second-order", [4.5, 3, 4], 0.5),
        ("exponential", [1, 1, np.e], 0),
        ("exponential", [1, 1, np.e - 1e-3], 1e-3 / np.e),  # x is nearer than z
        ("exponential", [-1, 0, 0], 0),
        ("exponential", [1e-3, 0, 1], 1e-3),
        ("exponential", [5, 1e-9, 1], 5),  # exp(5e9) overflows
        ("semidefinite", [1, 2**0.5, 1], 0),
        ("semidefinite", [1, 2 * 2**0.5, 1], 1),
    ],
)
def test_distances(kind: str, point: list[float], off: float) -> None:
    found = distance(ConeKind(kind), np.array(point, float))
    assert found == pytest.approx(off, rel=1e-3, abs=1e-12)


def test_triangles_keep_the_inner_product() -> None:
    draw = np.random.default_rng(3)
    one, other = (m + m.transpose(0, 2, 1) for m in draw.normal(size=(2, 5, 4, 4)))
    assert np.allclose(symmetric(triangle(one)), one)
    products = (triangle(one) * triangle(other)).sum(axis=1)
    assert np.allclose(products, np.trace(one @ other, axis1=1, axis2=2))


@pytest.mark.parametrize("kind", list(ConeKind))
def test_points_of_a_cone_and_its_dual_have_no_negative_product(kind: ConeKind) -> None:
    draw = np.random.default_rng(5)
    size = 10.0 ** draw.uniform(-4, 3, size=(2, 400, 1))
    primal, dual = draw.normal(size=(2, 400, SIZES[kind])) * size
    kept, weights = inside(kind, primal), inside_dual(kind, dual)
    assert (missing(kind, kept) <= 1e-12 * (1 + np.abs(kept).max(axis=1))).all()
    products = kept @ weights.T
    lengths = np.linalg.norm(kept, axis=1)[:, None] * np.linalg.norm(weights, axis=1)
    assert (products >= -1e-13 * lengths).all()
    # Points inside stay, and others move to the boundary.
    assert np.allclose(inside(kind, kept), kept, rtol=1e-12, atol=1e-12)
    assert np.allclose(inside_dual(kind, weights), weights, rtol=1e-9, atol=1e-9)
    assert (np.abs(inside(kind, primal) - primal).max(axis=1) > 0).any()


# Bounds.


def random_program(draw: np.random.Generator, curved: bool = True) -> tuple[ConicProgram, Any]:
    """Return a bounded program with all kinds of cones, and a point that is strictly within."""
    size = 4
    point = draw.normal(size=size)
    cones, interior = [], []
    for kind, middle in (
        (ConeKind.SECOND_ORDER, np.array([2.0, 0.3, -0.4, 1.0])),
        (ConeKind.EXPONENTIAL, np.array([-1.0, 1.0, 1.0])),
        (ConeKind.SEMIDEFINITE, triangle(np.eye(3)[None])[0]),
    ):
        cones.append((kind, draw.normal(size=(middle.size, size)), middle))
        interior.append(middle)
    cones = [(kind, rows, middle - rows @ point) for kind, rows, middle in cones]
    root = draw.normal(size=(size, 2))
    program = conic(
        draw.normal(size=size).tolist(),
        cones,
        hessian=root @ root.T if curved else np.zeros(size),
        matrix=[np.ones(size)],
        row_lower=point.sum(),
        row_upper=point.sum() + 1,
        lower=point - 3,
        upper=point + 3,
    )
    return program, point


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(0, 10**6), st.floats(-3, 3))
def test_no_multipliers_prove_too_much(seed: int, power: float) -> None:
    draw = np.random.default_rng(seed)
    program, point = random_program(draw)
    assert program.verify(point).ok
    total = program.row_count + program.cone_offset.size
    bound = program.dual_bound(10**power * draw.normal(size=total), draw.normal(size=program.size))
    assert bound <= program.objective(point) + 1e-9 * max(1.0, abs(bound))


@pytest.mark.parametrize("kind", list(ConeKind))
def test_multipliers_outside_of_the_dual_cone_prove_nothing_wrong(kind: ConeKind) -> None:
    draw = np.random.default_rng(8)
    for point in inside(kind, draw.normal(size=(20, SIZES[kind]))):
        program = conic([], [(kind, [], point.tolist())], offset=7.0)
        assert program.verify(np.zeros(0)).ok
        for weights in draw.normal(size=(5, SIZES[kind])):
            assert program.dual_bound(weights, np.zeros(0)) <= 7.0 + 1e-12


def test_multipliers_of_the_rows_alone_leave_the_cones_out() -> None:
    program = replace(disc(), column_lower=np.array([-2.0, -2.0]))
    assert program.dual_bound(np.zeros(0), np.zeros(2)) == -4.0
    with pytest.raises(InvalidData, match=r"shape \(3,\)"):
        program.dual_bound(np.zeros(2), np.zeros(2))


# CVXPY, which clashes with other solvers: in a process of its own, for which this file is the script.


def test_cvxpy_gives_the_same_values_and_multipliers() -> None:
    done = subprocess.run(
        [sys.executable, __file__], capture_output=True, text=True, timeout=240, check=False
    )
    assert done.returncode == 0, done.stderr[-4000:]
    found = json.loads(done.stdout)
    assert len(found) == 2
    for seed, (value, bound, backend) in enumerate(found):
        program, _ = random_program(np.random.default_rng(seed))
        best = find_backend("clarabel").run(program, Request()).primal_bound
        for other in (value, bound, backend):
            assert other == pytest.approx(best, rel=2e-6, abs=2e-6), seed


def main() -> list[list[float]]:
    from crosstrack.models.programs.export_conic import cvxpy_cone_duals

    found = []
    backend = find_backend("cvxpy")
    options = backend.checked_options({"solver": "SCS"})
    for seed in range(2):
        program, _ = random_program(np.random.default_rng(seed))
        problem, x = program.to_cvxpy()
        problem.solve(solver="CLARABEL")
        # The only row has two bounds, each of them a constraint.
        below, above = (problem.constraints[k].dual_value for k in (0, 1))
        duals = np.concatenate([below - above, cvxpy_cone_duals(problem, program.cones)])
        answer = backend.run(program, Request(options=options))
        bound = program.dual_bound(duals, x.value)
        found.append([float(problem.value), bound, answer.primal_bound])
    return found


if __name__ == "__main__":
    # Solvers write to the standard output behind Python's back: keep it for the results alone.
    with os.fdopen(os.dup(1), "w") as out:
        os.dup2(2, 1)
        json.dump(main(), out)
