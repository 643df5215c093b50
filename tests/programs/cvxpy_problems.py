"""Random problems of CVXPY of every class that has a program here."""

from __future__ import annotations

from typing import Any

import numpy as np

KINDS = ("linear", "quadratic", "second-order", "exponential", "semidefinite", "integer")


def random_problem(number: int) -> Any:
    """Return problem `number`: feasible, bounded, with an optimum that two solvers can compare."""
    import cvxpy as cp

    draw = np.random.default_rng(number)
    kind = KINDS[number % len(KINDS)]
    n, m = int(draw.integers(2, 6)), int(draw.integers(1, 5))
    shape = [(), (n,), (n, m)][draw.integers(3)]
    attributes: dict[str, Any] = [{}, {"bounds": [-2.5, 4.0]}, {"nonneg": True}][draw.integers(3)]
    x = cp.Variable(
        shape, name="x", **attributes, **({"integer": True} if kind == "integer" else {})
    )
    flat = cp.vec(x, order="F") if shape else cp.reshape(x, (1,), order="F")
    size = int(np.prod(shape))
    inside = np.abs(draw.normal(size=size))
    if kind == "integer":
        inside = np.round(inside)
    rows, cost = draw.normal(size=(m, size)), draw.normal(size=size)
    constraints = [rows @ flat <= rows @ inside + draw.random(m), cp.norm_inf(flat) <= 3]
    objective = _PARTS[kind](cp, draw, flat, inside, cost, constraints)
    if draw.random() < 0.3:
        objective = cp.Parameter(nonneg=True, value=0.5 + draw.random(), name="p") * objective
    if draw.random() < 0.3:
        objective += cp.Parameter(value=draw.normal(), name="q")
    goal = cp.Maximize(-objective) if draw.random() < 0.5 else cp.Minimize(objective)
    return cp.Problem(goal, constraints)


def _linear(cp: Any, draw: Any, x: Any, inside: Any, cost: Any, constraints: list[Any]) -> Any:
    if draw.random() < 0.5:
        constraints.append(cp.sum(x) == inside.sum())
        constraints.pop(1)
        constraints.append(cp.max(cp.abs(x)) <= 3 + np.abs(inside).max())
    terms = [
        cp.norm1(x - inside),
        cp.norm_inf(x - inside),
        cp.pos(cp.sum(x)),
        cp.tv(cp.hstack([x, 1])),
    ]
    return cost @ x + terms[draw.integers(len(terms))] + draw.normal()


def _quadratic(cp: Any, draw: Any, x: Any, inside: Any, cost: Any, constraints: list[Any]) -> Any:
    factor = draw.normal(size=(x.size, x.size))
    y = cp.Variable((2, 2), diag=True, name="D")
    constraints.append(cp.trace(y) == 1)
    terms = [
        cp.quad_form(x, factor @ factor.T),
        cp.sum_squares(factor @ x - 1),
        cp.sum(cp.huber(factor @ x - 1, 0.5)),
    ]
    return terms[draw.integers(len(terms))] + cost @ x + cp.sum_squares(y - np.eye(2)) + 2


def _second_order(
    cp: Any, draw: Any, x: Any, inside: Any, cost: Any, constraints: list[Any]
) -> Any:
    constraints.append(cp.SOC(1 + np.linalg.norm(inside) + 0 * x[0], x - 0.1))
    y = cp.Variable((x.size, 2), name="Y")
    constraints.append(cp.norm(y, 2, axis=1) <= 1)
    terms = [
        cp.norm(draw.normal(size=(x.size, x.size)) @ x - inside),
        cp.quad_over_lin(x - inside, 2 + x[0] + 3),
        cp.geo_mean(x + 4) * -1,
    ]
    return terms[draw.integers(len(terms))] + cost @ x + cp.sum(draw.normal(size=y.shape).T @ y)


def _exponential(cp: Any, draw: Any, x: Any, inside: Any, cost: Any, constraints: list[Any]) -> Any:
    t = cp.Variable(name="t")
    constraints.append(cp.ExpCone(x[0], cp.Constant(1.0), t))
    terms = [
        cp.log_sum_exp(draw.normal(size=(3, x.size)) @ x),
        -cp.sum(cp.entr(x + 5)),
        cp.sum(cp.kl_div(x + 5, np.abs(inside) + 1)),
        cp.sum(cp.logistic(x)),
        -cp.sum(cp.log(x + 4)),
    ]
    return terms[draw.integers(len(terms))] + t + 0.1 * cost @ x


def _semidefinite(
    cp: Any, draw: Any, x: Any, inside: Any, cost: Any, constraints: list[Any]
) -> Any:
    k = int(draw.integers(2, 4))
    attribute = ["symmetric", "PSD"][draw.integers(2)]
    square = cp.Variable((k, k), name="X", **{attribute: True})
    weight = draw.normal(size=(k, k))
    weight = weight @ weight.T
    constraints += [square - 0.1 * np.eye(k) >> 0, cp.trace(square) == 1]
    constraints.append(square - 0.05 * np.eye(k) * x[0] >> -np.eye(k))
    terms = [
        cp.lambda_max(square),
        cp.matrix_frac(np.ones(k), square),
        cp.tr_inv(square),
        cp.norm(square - weight, "nuc"),
        -cp.log_det(square),
    ]
    return cp.trace(weight @ square) + 0.2 * terms[draw.integers(len(terms))] + cost @ x


def _integer(cp: Any, draw: Any, x: Any, inside: Any, cost: Any, constraints: list[Any]) -> Any:
    b = cp.Variable(3, boolean=True, name="b")
    y = cp.Variable(nonneg=True, name="y")
    constraints += [cp.sum(x) <= inside.sum() + 5 * cp.sum(b) + y, y <= 4]
    return cost @ x + np.array([1.0, 2.0, 1.5]) @ b + 0.3 * y + cp.norm1(x - inside - 0.25)


_PARTS = {
    "linear": _linear,
    "quadratic": _quadratic,
    "second-order": _second_order,
    "exponential": _exponential,
    "semidefinite": _semidefinite,
    "integer": _integer,
}
