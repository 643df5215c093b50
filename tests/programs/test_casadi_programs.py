"""Programs from CasADi: ``Opti`` and mappings of expressions."""

from __future__ import annotations

from typing import Any

import casadi
import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models.programs.nonlinear import NonlinearProgram
from crosstrack.models.programs.sources.casadi_problem import program_of_opti

INF = np.inf


def _shown(program: NonlinearProgram) -> dict[str, Any]:
    names = ("row_lower", "row_upper", "column_lower", "column_upper", "guess")
    return {name: getattr(program, name).tolist() for name in names}


# Mappings of expressions.


@pytest.mark.parametrize("kind", [casadi.SX, casadi.MX])
def test_expressions_with_bounds_parameters_and_integers(kind: Any) -> None:
    x, p = kind.sym("x", 3), kind.sym("p", 2, 2)
    f = casadi.sumsqr(x) * p[0, 1]
    program = ct.load(
        {
            "x": x, "f": f, "g": casadi.vertcat(x[0] * x[1], casadi.exp(x[2])), "p": p,
            "p0": np.array([[1.0, 2], [3, 4]]), "lbg": 1, "lbx": [None, -1, 0], "ubx": casadi.DM([5, 6, 7]),
            "x0": 0.5, "discrete": [True, False, False],
        }
    )  # fmt: skip
    assert isinstance(program, NonlinearProgram)
    assert _shown(program) == {
        "row_lower": [1, 1], "row_upper": [INF, INF], "column_lower": [-INF, -1, 0],
        "column_upper": [5, 6, 7], "guess": [0.5] * 3,
    }  # fmt: skip
    point = np.array([1.0, 2.0, 3.0])
    assert program.objective(point) == 28  # p[0, 1] is 2
    assert program.values(point)[1] == pytest.approx([2, np.exp(3)])
    assert program.integral is not None and program.integral.tolist() == [True, False, False]
    assert program.values_of(point)["x"].tolist() == [1, 2, 3]
    flat = ct.load({"x": x, "f": f, "p": p, "p0": [1, 3, 2, 4]})  # column by column
    assert flat.objective(point) == 28
    assert _shown(flat)["column_lower"] == [-INF] * 3 and flat.row_count == 0


@pytest.mark.parametrize("kind", [casadi.SX, casadi.MX])
def test_matrices_and_constants_are_expressions(kind: Any) -> None:
    x = kind.sym("x", 2)
    bounds = np.array([[1.0, 2.0], [3.0, 4.0]])
    program = ct.load({"x": x, "f": np.float64(3), "g": casadi.diag(x), "lbg": bounds})
    assert program.objective([5.0, 6.0]) == 3
    assert program.values([5.0, 6.0])[1].tolist() == [5, 0, 0, 6]
    assert program.row_lower.tolist() == [1, 3, 2, 4]
    for value in (7, casadi.DM(7), np.int64(7)):
        assert ct.load({"x": x, "f": x[0], "g": value}).values([0.0, 0.0])[1].tolist() == [7]
    two = ct.load({"x": casadi.vertcat(x[0:0], x, kind.sym("y")), "f": x[1]})
    assert two.size == 3


@pytest.mark.parametrize("kind", [casadi.SX, casadi.MX])
def test_invalid_expressions_name_key_and_value(kind: Any) -> None:
    x, z, p = kind.sym("x", 3), kind.sym("z"), kind.sym("p")
    other = (casadi.MX if kind is casadi.SX else casadi.SX).sym("y", 3)
    f, name = casadi.sumsqr(x), kind.__name__
    cases: list[tuple[dict[str, Any], str]] = [
        ({"f": f}, "x is missing"),
        ({"x": x, "f": None}, "f is missing"),
        ({"x": np.ones(3), "f": 0}, "x must be a casadi.MX or SX, got array"),
        ({"x": 2 * x, "f": f}, "x must consist of symbols in a dense column, got 3 x 1"),
        ({"x": kind.sym("P", 2, 2), "f": 0}, "x must consist of symbols in a dense column, got 2 x 2"),
        ({"x": kind.sym("r", 1, 3), "f": 0}, "x must consist of .* got 1 x 3"),
        ({"x": kind(0, 1), "f": 0}, "x must have a symbol"),
        ({"x": x, "f": f, "p": x, "p0": 1}, "x and p must contain each symbol once"),
        ({"x": x, "f": f, "p": p + 1, "p0": 1}, "p must consist of symbols, got 1 x 1"),
        ({"x": x, "f": f * p, "p": p}, "p0 is missing: 1 parameters need values"),
        ({"x": x, "f": f * p, "p": p, "p0": np.nan}, r"p0\[0\] must be finite, got nan"),
        ({"x": x, "f": f + z}, "f and g must depend on x and p only, got z: add it to x or p"),
        ({"x": x, "f": f, "g": z}, "f and g must depend on x and p only, got z"),
        ({"x": x, "f": x}, r"f must be a number, got shape \(3, 1\)"),
        ({"x": x, "f": "a"}, f"f must be a casadi.{name} as x, got 'a'"),
        ({"x": x, "f": casadi.sumsqr(other)}, f"f must be a casadi.{name} as x, got"),
        ({"x": x, "f": f, "g": other}, f"g must be a casadi.{name} as x, got"),
        ({"x": x, "f": f, "g": [x[0]]}, f"g must be a casadi.{name} as x, got"),
        ({"x": x, "f": f, "lbx": [1, 2]}, "lbx must have 3 entries, got 2"),
        ({"x": x, "f": f, "lbx": [1, np.nan, 2]}, r"lbx\[1\] must be finite, got nan"),
        ({"x": x, "f": f, "lbx": INF}, r"lbx\[0\] must be finite, got inf"),
        ({"x": x, "f": f, "ubx": "a"}, r"ubx\[0\] must be a number, got 'a'"),
        ({"x": x, "f": f, "lbx": x}, "lbx must be an array"),
        ({"x": x, "f": f, "lbx": [[1], [2, 3], 0]}, r"lbx must be an array .* \[\[1\], \[2, 3\]"),
        ({"x": x, "f": f, "lbx": 2, "ubx": 1}, r"lbx\[0\] = 2 exceeds ubx\[0\] = 1"),
        ({"x": x, "f": f, "g": z * 0 + x[0], "p": z, "p0": 0, "lbg": 2, "ubg": 1}, r"lbg\[0\] = 2 exceeds"),
        ({"x": x, "f": f, "lbg": [0]}, "lbg must have 0 entries, got 1"),
        ({"x": x, "f": f, "x0": [0, None, 0]}, r"x0\[1\] must be a number, got None"),
        ({"x": x, "f": f, "discrete": [True]}, "discrete has 1 entries where lbx has 3"),
        ({"x": x, "f": f, "discrete": ["a"] * 3}, "discrete must hold true or false"),
        ({"x": x, "f": f, "lb": 0}, "unknown key 'lb' .*did you mean 'lbx' or 'lbg'"),
    ]  # fmt: skip
    for problem, message in cases:
        with pytest.raises(InvalidData, match=message) as caught:
            ct.load(problem)
        assert caught.value.field


# Opti.


def _opti() -> tuple[Any, Any, Any, Any, Any]:
    opti = casadi.Opti()
    x, y, a, b = opti.variable(2, 2), opti.variable(), opti.parameter(), opti.parameter(2)
    opti.minimize(casadi.sumsqr(x) * a + y)
    opti.subject_to(x[0, 1] >= b[0])
    opti.subject_to(opti.bounded(-1, y, b[1]))
    opti.subject_to(x[1, 0] + y == 2)
    return opti, x, y, a, b


def test_opti_keeps_shapes_parameters_and_initial_values() -> None:
    opti, x, _, a, b = _opti()
    with pytest.raises(InvalidData, match=r"parameter opti\w+ of shape \(1, 1\) must .*set_value"):
        ct.load(opti)
    opti.set_value(a, 3)
    with pytest.raises(
        InvalidData, match=r"parameter opti\w+ of shape \(2, 1\) must have a finite"
    ):
        ct.load(opti)
    opti.set_value(b, [1, 4])
    opti.set_initial(x, casadi.DM([[1, 2], [3, 4]]))
    program = ct.load(opti)
    assert isinstance(program, NonlinearProgram)
    assert program.guess.tolist() == [1, 3, 2, 4, 0]
    assert (program.row_lower.tolist(), program.row_upper.tolist()) == ([1, -1, 2], [INF, 4, 2])
    point = np.array([5.0, 6, 7, 8, 9])
    assert program.objective(point) == 3 * (25 + 36 + 49 + 64) + 9
    assert program.values(point)[1].tolist() == [7, 9, 15]
    values = program.values_of(point)
    assert values["variable 0"].tolist() == [[5, 7], [6, 8]]
    assert values["variable 1"].tolist() == [[9]]
    # The Opti can be changed afterwards, and its parameters are read again.
    opti.set_value(a, 4)
    opti.subject_to(x[0, 0] <= 9)
    again = ct.load(opti)
    assert again.row_count == 4 and again.objective(point) == 4 * 174 + 9


def test_opti_integers_and_assignment() -> None:
    opti, x, y, a, b = _opti()
    opti.set_value(a, 1)
    opti.set_value(b, [1, 4])
    opti.set_domain(y, "integer")
    program = ct.load(opti)
    assert isinstance(program, NonlinearProgram)
    assert program.integral is not None
    assert program.integral.tolist() == [False] * 4 + [True]
    assert program.source is not None and program.source.assign is not None
    program.source.assign(np.array([5.0, 6, 7, 8, 9]), np.array([1.0, 2, 3]), 0.0, "optimal")
    assert opti.value(x, opti.initial()).tolist() == [[5, 7], [6, 8]]
    assert opti.value(y, opti.initial()) == 9
    assert opti.value(opti.lam_g, opti.initial()).tolist() == [-1, -2, -3]


def test_solve_assigns_the_optimum_and_multipliers_of_opti() -> None:
    opti = casadi.Opti()
    z, w = opti.variable(3), opti.variable(2)
    opti.minimize(casadi.sumsqr(w) + casadi.sum1(z))
    opti.subject_to(z >= 0)
    opti.subject_to(w[1] + z[0] >= 1)
    solution = ct.solve(opti, "ipopt")
    solution.assign()
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})
    reference = opti.solve()
    assert solution.value == pytest.approx(reference.value(opti.f), abs=1e-6)
    for variable in (z, w, opti.lam_g):
        assigned = opti.value(variable, opti.initial())
        assert assigned == pytest.approx(reference.value(variable), abs=1e-5)


def test_opti_without_variables_or_of_another_type() -> None:
    opti = casadi.Opti()
    opti.variable()
    with pytest.raises(InvalidData, match="must have a variable in its objective or constraints"):
        ct.load(opti)
    with pytest.raises(InvalidData, match=r"must be a casadi.Opti or a mapping .*got str"):
        program_of_opti("opti")  # type: ignore[arg-type]
