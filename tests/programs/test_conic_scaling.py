"""Scaling of the objectives of conic programs, and of those that SCS receives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.models import ConicProgram
from crosstrack.models.programs.cones import ConeBlock, ConeKind
from crosstrack.solvers import Termination
from crosstrack.solvers.programs.scaling import Scaling

DISC = ConeBlock("disc", "", 0, 3, kind=ConeKind.SECOND_ORDER, dimension=3)


def program(**fields: Any) -> ConicProgram:
    """Return a program over the unit disc."""
    rows = np.array([[0.0, 0], [1, 0], [0, 1]])
    return ConicProgram(
        cone_matrix=rows, cone_offset=np.array([1.0, 0, 0]), cones=(DISC,), **fields
    )


@pytest.mark.parametrize("offset", [1e-9, 1e12])
@pytest.mark.parametrize("curvature", [0.0, 1e-12, 1.0])
def test_constants_do_not_scale_objectives_of_another_size(offset: float, curvature: float) -> None:
    posed = program(cost=np.array([3.0, 4]), hessian=curvature * np.eye(2), offset=offset)
    assert Scaling.of_objective(posed) is None
    plain = program(cost=np.array([3.0, 4]), hessian=curvature * np.eye(2))
    for name in ("clarabel", "scs"):
        found, expected = ct.solve(posed, name), ct.solve(plain, name)
        assert found.plan == pytest.approx(expected.plan, abs=1e-6)


@pytest.mark.parametrize("size", [1e-12, 1e12])
def test_objectives_of_the_size_of_their_constant_are_scaled(size: float) -> None:
    posed = program(cost=np.array([3.0, 4]) * size, hessian=np.eye(2) * size, offset=5 * size)
    scaling = Scaling.of_objective(posed)
    assert scaling is not None and 0.1 < scaling.program.offset < 10
    solution = ct.solve(posed, "clarabel")
    assert solution.termination is Termination.OPTIMAL
    assert solution.primal_bound / size == pytest.approx(0.5, rel=1e-6)


@pytest.mark.parametrize("name", ["clarabel", "scs"])
def test_a_large_curvature_does_not_hide_that_of_another_column(name: str) -> None:
    """Divided by the largest curvature, the optimum was below the absolute tolerances of the solvers."""
    disc = {
        "cone_matrix": [[0.0, 0], [1, 0], [0, 1]],
        "cone_offset": [1.0, 0, -2],
        "cones": (DISC,),
    }
    posed = ConicProgram(cost=[0.0, 0.0], hessian=np.diag([1e10, 1.0]), **disc)
    solution = ct.solve(posed, name)
    assert solution.termination is Termination.OPTIMAL
    assert solution.primal_bound == pytest.approx(0.5, rel=1e-5)


@pytest.mark.parametrize("size", [1e3, 1e5, 1e7])
def test_scs_balances_multipliers_and_points(size: float) -> None:
    """Without a linear cost, SCS does not scale the objective itself."""
    rows = np.random.default_rng(0).normal(size=(6, 12))
    curvature = np.diag(np.arange(12) % 4 * size)
    fields: dict[str, Any] = {
        "cost": np.zeros(12), "hessian": curvature, "matrix": rows, "row_lower": np.ones(6),
        "row_upper": np.ones(6), "cone_matrix": np.vstack([np.zeros(12), np.eye(12)]),
        "cone_offset": np.append(2.0, np.zeros(12)),
        "cones": (ConeBlock("ball", "", 0, 13, kind=ConeKind.SECOND_ORDER, dimension=13),),
    }  # fmt: skip
    first, second = (ct.solve(ConicProgram(**fields), name) for name in ("clarabel", "scs"))
    assert second.termination is Termination.OPTIMAL
    assert second.primal_bound == pytest.approx(first.primal_bound, rel=1e-5)
    assert second.statistics["iterations"] < 100_000
