"""Programs from arrays in the conventions of SciPy, OSQP and qpsolvers, and from files of arrays."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import qpsolvers
import scipy.sparse as sp
from library_models import solved
from scipy.io import savemat
from scipy.optimize import Bounds, LinearConstraint, NonlinearConstraint, linprog, milp

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models.programs.linear import MixedIntegerProgram, QuadraticProgram
from crosstrack.models.programs.sources.arrays import program_of_arrays, program_of_qpsolvers

EYE, INF = np.eye(2), np.inf


def _same(program: Any, **fields: Any) -> None:
    for name, value in fields.items():
        actual = getattr(program, name)
        actual = actual.toarray() if sp.issparse(actual) else actual
        assert np.array_equal(actual, value), (name, actual, value)


def _optimum(program: Any) -> float:
    plan = solved(
        program.cost, program.matrix, program.row_lower, program.row_upper,
        program.column_lower, program.column_upper, program.integral,
    )  # fmt: skip
    return float(program.objective(plan))


# SciPy.


@pytest.mark.sample(2)
@pytest.mark.parametrize("seed", range(20))
def test_linprog_and_milp_arguments_keep_their_optimum(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 6))
    cost, point = rng.normal(size=n), rng.integers(0, 3, n).astype(float)
    upper, equal = rng.normal(size=(3, n)), rng.integers(-2, 3, (1, n)).astype(float)
    bounds = [(None if rng.random() < 0.3 else -1.0, 4.0 + k) for k in range(n)]
    whole = (rng.random(n) < 0.5).astype(int)
    box = [(low if low is not None else -9.0, high) for low, high in bounds]
    given: dict[str, Any] = {
        "c": cost, "A_ub": sp.csc_array(upper) if seed % 2 else upper, "b_ub": upper @ point + 1,
        "A_eq": equal, "b_eq": equal @ point, "bounds": box,
    }  # fmt: skip
    answer = linprog(**given, integrality=whole)
    assert answer.status == 0
    program = ct.load({**given, "integrality": whole})
    assert isinstance(program, MixedIntegerProgram)
    assert _optimum(program) == pytest.approx(answer.fun, abs=1e-7)
    relaxed = ct.load(tuple(given.values()))
    assert _optimum(relaxed) == pytest.approx(linprog(**given).fun, abs=1e-7)
    low, high = np.array(box).T
    rows = [LinearConstraint(given["A_ub"], -INF, given["b_ub"]), (equal, *[equal @ point] * 2)]
    options: dict[str, Any] = {
        "constraints": rows,
        "bounds": Bounds(low, high),
        "integrality": whole,
    }
    program = ct.load({"c": cost, **options})
    assert _optimum(program) == pytest.approx(milp(cost, **options).fun, abs=1e-7)
    assert program.values_of(point)["x"].tolist() == point.tolist()


def test_columns_are_not_negative_by_default_in_scipy_only() -> None:
    for arrays in ({"c": [1, 2]}, {"c": [1, 2], "bounds": []}, {"c": [1, 2], "integrality": 0}):
        _same(ct.load(arrays), column_lower=[0, 0], column_upper=[INF, INF], offset=0)
    both = {"c": [1, 2], "constraints": LinearConstraint(EYE, -1)}
    _same(ct.load(both), column_lower=[0, 0], row_lower=[-1, -1], row_upper=[INF, INF])
    _same(ct.load({"q": [1, 2]}), column_lower=[-INF, -INF], column_upper=[INF, INF])
    _same(ct.load({"A": EYE, "l": [0, 0], "u": [1, 1]}), column_lower=[-INF, -INF], cost=[0, 0])


@pytest.mark.parametrize(
    ("bounds", "low", "high"),
    [
        ((None, 4), [-INF, -INF], [4, 4]),
        ([(1, 2)], [1, 1], [2, 2]),
        ([(None, 1), (0, None)], [-INF, 0], [1, INF]),
        (np.array([[0, 1], [-INF, INF]]), [0, -INF], [1, INF]),
        (Bounds([0, -1], 5), [0, -1], [5, 5]),
        (Bounds(), [-INF, -INF], [INF, INF]),
    ],
)
def test_bounds_in_every_form_of_scipy(bounds: Any, low: Any, high: Any) -> None:
    _same(ct.load({"c": [1, 2], "bounds": bounds}), column_lower=low, column_upper=high)


def test_constraints_in_every_form_of_milp() -> None:
    single = LinearConstraint(EYE, -1, 3)
    triple = (sp.csr_array(EYE), -1, [3, 3])
    for given in (single, [single], triple, [triple], (*triple[:2], 3)):
        program = ct.load({"c": [1, 2], "constraints": given})
        _same(program, matrix=EYE, row_lower=[-1, -1], row_upper=[3, 3])
        assert [block.name for block in program.rows] == ["constraints[0]"]
    for count in (2, 3):
        for part in (single, triple):
            program = ct.load({"c": [1, 2], "constraints": (part,) * count})
            assert program.row_count == 2 * count
    one_row = ct.load({"c": [1, 2], "constraints": ([1, 1], 0, 5)})
    _same(one_row, matrix=[[1, 1]], row_lower=[0], row_upper=[5])
    whole = ct.load({"c": [1, 2], "integrality": np.array([True, False])})
    _same(whole, integral=[True, False])
    _same(ct.load({"c": [1, 2], "integrality": 1}), integral=[True, True])


# OSQP and qpsolvers.

P, Q = np.array([[2.0, 1.0], [1.0, 3.0]]), np.array([1.0, -2.0])


def test_osqp_upper_triangles_infinite_bounds_and_constants() -> None:
    given: dict[str, Any] = {"P": sp.csc_matrix(np.triu(P)), "q": Q, "A": sp.csc_matrix(EYE)}
    given |= {"l": [-1e30, 0], "u": [1e20, 4], "r": 3.0}
    program = ct.load(given)
    assert isinstance(program, QuadraticProgram)
    _same(program, hessian=P, cost=Q, matrix=EYE, row_lower=[-INF, 0], row_upper=[INF, 4], offset=3)
    _same(ct.load({**given, "P": P}), hessian=P)
    assert isinstance(ct.load({**given, "P": np.zeros((2, 2))}), MixedIntegerProgram)


@pytest.mark.parametrize("parts", list(itertools.product([False, True], repeat=4)))
def test_qpsolvers_problems_of_all_parts_have_their_optimum(parts: tuple[bool, ...]) -> None:
    pytest.importorskip("quadprog", reason="quadprog is not installed")
    rows, equal, low, high = parts
    problem = qpsolvers.Problem(
        P, Q, np.array([[1.0, 2.0], [-1.0, 1.0]]) if rows else None, np.array([1.0, 0.5]) if rows else None,
        np.array([[1.0, 1.0]]) if equal else None, np.array([0.3]) if equal else None,
        np.array([-0.2, -0.1]) if low else None, np.array([0.6, 0.4]) if high else None,
    )  # fmt: skip
    program = program_of_qpsolvers(problem)
    reference = qpsolvers.solve_problem(problem, "quadprog")
    assert reference.found
    exported = [
        part.toarray() if sp.issparse(part) else part for part in program.to_qpsolvers().unpack()
    ]
    solution = qpsolvers.solve_problem(qpsolvers.Problem(*exported), "quadprog")
    assert solution.x == pytest.approx(reference.x, abs=1e-8)
    assert program.objective(reference.x) == pytest.approx(reference.obj, abs=1e-8)
    names = [block.name for block in program.rows]
    assert names == ["G"] * rows + ["A"] * equal
    given = {name: getattr(problem, name) for name in ("P", "q", "G", "h", "A", "b", "lb", "ub")}
    assert program_of_arrays(given).digest == program.digest


def test_qpsolvers_problems_are_solved_by_solve() -> None:
    problem = qpsolvers.Problem(sp.csc_matrix(P), Q, lb=np.zeros(2))
    solution = ct.solve(problem, "clarabel")
    assert solution.value == pytest.approx(-2 / 3)
    assert solution.values["x"] == pytest.approx([0, 2 / 3], abs=1e-6)
    with pytest.raises(InvalidData, match=r"must be a qpsolvers.Problem, got int without P"):
        program_of_qpsolvers(3)  # type: ignore[arg-type]


# Errors.


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({}, "arrays must follow one convention, got the names of none; known: .*milp: bounds, c"),
        ({"constraints": LinearConstraint(EYE)}, "c is missing"),
        ({"c": []}, "model must have a column"),
        ({"c": 3.0}, r"c must have shape \(entries,\), got \(\)"),
        ({"c": EYE}, r"c must have shape \(entries,\), got \(2, 2\)"),
        ({"c": ["1", 2]}, r"c\[0\] must be a number, got '1'"),
        ({"c": [1, np.nan]}, r"c\[1\] must be finite, got nan"),
        ({"c": [1j, 2]}, r"c\[0\] must be a number, got 1j"),
        ({"c": Q, "A_ub": EYE}, "b_ub is missing: A_ub and b_ub belong together"),
        ({"c": Q, "b_eq": Q}, "A_eq is missing"),
        ({"c": Q, "A_ub": [[1, 2], [3]], "b_ub": Q}, r"A_ub must be an array of shape .*\[\[1, 2\]"),
        ({"c": Q, "A_ub": [[1, 2, 3]], "b_ub": [1]}, "A_ub must have 2 columns, got 3"),
        ({"c": Q, "A_ub": EYE, "b_ub": [1, 2, 3]}, "b_ub must have 2 entries, got 3"),
        ({"c": Q, "A_eq": EYE, "b_eq": [1, INF]}, r"b_eq\[1\] must be finite, got inf"),
        ({"c": Q, "A_eq": [[INF, 1]], "b_eq": 0}, r"A_eq\[0, 0\] must be finite, got inf"),
        ({"c": Q, "A_ub": sp.eye(2) * 1j, "b_ub": Q}, "A_ub must be a matrix of numbers, got .*complex"),
        ({"c": Q, "A_ubb": EYE, "b_ub": Q}, "unknown array 'A_ubb' .* did you mean 'A_ub'"),
        ({"c": Q, "bounds": [(0, 1)] * 3}, r"bounds must be Bounds, a pair, or 2 pairs .*got \[\(0, 1"),
        ({"c": Q, "bounds": {"lb": 0}}, "bounds must be Bounds, .*got {'lb': 0}"),
        ({"c": Q, "bounds": 7}, "bounds must be Bounds, .*got 7"),
        ({"c": Q, "bounds": [(0, np.nan), (0, 1)]}, r"bounds\[0\] must be finite, got nan"),
        ({"c": Q, "bounds": Bounds([0] * 3, 1)}, "bounds.lb must have 2 entries, got 3"),
        ({"c": Q, "integrality": [0, 2]}, r"integrality\[1\] must be 0 or 1, got 2.*semi-continuous"),
        ({"c": Q, "integrality": [0] * 3}, "integrality must have 2 entries, got 3"),
        ({"c": Q, "constraints": 5}, r"constraints\[0\] must be a LinearConstraint or .*got 5"),
        ({"c": Q, "constraints": [[1, 2]]}, r"constraints\[0\] must be a LinearConstraint .*\[1, 2\]"),
        (
            {"c": Q, "constraints": NonlinearConstraint(sum, 0, 1)},
            r"constraints\[0\] must be a LinearConstraint",
        ),
        (
            {"c": Q, "constraints": [LinearConstraint(EYE), (np.ones((1, 3)), 0, 1)]},
            r"constraints\[1\].A must have 2 columns, got 3",
        ),
        ((), "a tuple must contain c, A_ub, .* got 0 entries"),
        ((Q,) * 7, "a tuple must contain c, A_ub, .* got 7 entries"),
        ((Q, LinearConstraint(EYE)), "pass LinearConstraint and Bounds by name"),
        ({"A": [[1, 2], [3]], "l": Q, "u": Q}, r"A must be an array of shape .*\[3\]"),
        ({"q": 3.0, "A": EYE, "l": Q, "u": Q}, r"q must have shape \(entries,\), got \(\)"),
        ({"A": EYE, "l": [0] * 3, "u": Q}, "l must have 2 entries, got 3"),
        ({"A": EYE, "l": Q, "u": Q, "r": [1, 2]}, "r must have 1 entries, got 2"),
        ({"P": np.ones((3, 2)), "q": Q}, r"P must have shape \(2, 2\), got \(3, 2\)"),
        ({"P": -EYE, "q": Q}, r"P\[0, 0\] is -1, which no positive semidefinite"),
        ({"P": [[1, 2], [2, 1]], "q": Q}, "P must be positive semidefinite, but .* -1: pose"),
        ({"P": np.triu(P), "q": Q}, r"P\[0, 1\] is 1, but P\[1, 0\] is 0: it must be symmetric"),
        ({"P": P, "q": Q, "lb": [INF, 0]}, r"lb\[0\] must be finite, got inf"),
        ({"P": P, "q": Q, "l": Q}, "unknown array 'l' .*qpsolvers; did you mean 'lb'"),
    ],
)  # fmt: skip
def test_errors_name_field_and_value(arrays: Any, message: str) -> None:
    with pytest.raises(InvalidData, match=message) as caught:
        ct.load(arrays)
    assert caught.value.field


# Files.


def test_mat_files_in_the_convention_of_osqp(tmp_path: Path) -> None:
    path = tmp_path / "small.mat"
    content = {"P": sp.csc_matrix(P), "q": Q[:, None], "A": sp.csc_matrix(EYE), "r": 1.5}
    content |= {"l": [[-1e20], [0]], "u": np.array([[1.0, 2.0]]), "n": 2, "m": 2}
    savemat(path, content)
    program = ct.load(path)
    _same(program, hessian=P, cost=Q, offset=1.5, row_lower=[-INF, 0], row_upper=[1, 2])
    assert program.name == "small"
    savemat(path, {**content, "u": [[1.0, np.nan]]})
    with pytest.raises(InvalidData, match=r"small.mat: u\[1\] must be finite, got nan"):
        ct.load(path)
    path.write_bytes(path.read_bytes()[:150])
    with pytest.raises(InvalidData, match=r"small.mat: "):
        ct.load(path)
    path.write_bytes(b"MATLAB 5.0")
    with pytest.raises(InvalidData, match=r"small.mat: not a MATLAB file up to version 7"):
        ct.load(path)


def _parts(name: str, matrix: Any) -> dict[str, Any]:
    csr = sp.csr_array(matrix)
    names = ("data", "indices", "indptr", "shape")
    return {f"{name}_{part}": getattr(csr, part) for part in names}


def test_refuses_files_that_are_large_after_decompression(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("crosstrack.instances.programs.array_files._LARGEST", 1 << 22)
    arrays = {"P": np.eye(2), "q": np.zeros(2), "A": np.eye(2), "l": np.zeros(2), "u": np.ones(2)}
    large = {**arrays, "other": np.zeros(1 << 19)}  # as many bytes as allowed, beside the others
    for name, write in (
        ("small.mat", lambda path, content: savemat(path, content, do_compression=True)),
        ("small.npz", lambda path, content: np.savez_compressed(path, **content)),
    ):
        write(tmp_path / name, arrays)
        assert ct.load(tmp_path / name).size == 2
        write(tmp_path / name, large)
        assert (tmp_path / name).stat().st_size < 10_000
        with pytest.raises(InvalidData, match=f"{name}: more than 4194304 bytes after"):
            ct.load(tmp_path / name)


def test_npz_files_with_sparse_matrices_in_parts(tmp_path: Path) -> None:
    path = tmp_path / "small.npz"
    rows = np.array([[0.0, 2.0], [1.0, 0.0], [0.0, 0.0]])
    content = {"c": Q, "b_ub": [1.0, 2, 3], "integrality": [1, 0], **_parts("A_ub", rows)}
    np.savez(path, **content)
    program = ct.load(path)
    _same(program, cost=Q, matrix=rows, row_upper=[1, 2, 3], integral=[True, False])
    np.savez(path, q=Q, **_parts("P", P), A=[[1.0, 1.0]], b=[1.0])
    _same(ct.load(path), hessian=P, matrix=[[1, 1]], row_lower=[1], row_upper=[1])
    damaged = {
        "A_ub needs the keys shape, indptr, indices, data": {**content, "A_ub_indices": None},
        "A_ub is no sparse matrix: indices must be < 2": {**content, "A_ub_indices": [7, 7]},
        "b_ub must have 3 entries, got 2": {**content, "b_ub": [1.0, 2.0]},
        "unknown array 'A_ubb'": {**content, "A_ubb": [1.0]},
    }
    for message, arrays in damaged.items():
        np.savez(path, **{name: value for name, value in arrays.items() if value is not None})
        with pytest.raises(InvalidData, match=f"small.npz: .*{message}"):
            ct.load(path)
    np.savez(path, c=np.array([{}], dtype=object))
    with pytest.raises(InvalidData, match=r"small.npz: not an archive of arrays"):
        ct.load(path)
    path.write_bytes(b"PK\x03\x04 no archive")
    with pytest.raises(InvalidData, match=r"small.npz: not an archive of arrays"):
        ct.load(path)
