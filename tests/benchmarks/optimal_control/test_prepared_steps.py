"""Steps of a prepared solver beside CasADi's ``nlpsol`` on the same transcription written by hand.

Both are called in turns at the same states of a closed loop, each warm from its own last step. Nothing
fails because it is slow; everything fails that is wrong. Run with::

    pytest tests/benchmarks/optimal_control/test_prepared_steps.py -s
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import casadi
import numpy as np
import pytest
from benchmarks.ledger import Ledger, Row
from benchmarks.optimal_control.prepared_steps import IPOPT, STEPS as TRACKED, WARM, loop
from optimal_control.steered import FORCE, TRACKING, brake, cart_cost, cart_pole, cart_rates

import crosstrack as ct

INTERVALS, DEGREE, STEPS = 5, 4, 60
Bare = Callable[..., dict[str, Any]]


def bare(
    rates: Callable[[Any, Any], Any],
    cost: Callable[[Any, Any], Any],
    final: Callable[[Any], Any],
    sizes: tuple[int, float, float],
) -> tuple[Any, Any, dict[str, Any], int]:
    """Return Radau collocation over one horizon as plain ``nlpsol``, cold and warm.

    `sizes` contains the number of states, the force's bound and the horizon. The third result contains the
    bounds, the fourth is the column of the first force.
    """
    states, bound, horizon = sizes
    tau = casadi.collocation_points(DEGREE, "radau")
    slope, _, weights = casadi.collocation_coeff(tau)
    length = horizon / INTERVALS
    points = INTERVALS * DEGREE
    x, u = casadi.SX.sym("x", states, points + 1), casadi.SX.sym("u", 1, points)
    p = casadi.SX.sym("p", states)
    rows, total = [x[:, 0] - p], 0
    for k in range(INTERVALS):
        own = x[:, k * DEGREE : (k + 1) * DEGREE + 1]
        slopes = casadi.mtimes(own, slope)
        for j in range(DEGREE):
            force = u[k * DEGREE + j]
            rows.append(slopes[:, j] - length * rates(own[:, j + 1], force))
            total += length * weights[j] * cost(own[:, j + 1], force)
    columns = casadi.vertcat(casadi.vec(x), casadi.vec(u))
    program = {"x": columns, "p": p, "f": total + final(x[:, -1]), "g": casadi.vertcat(*rows)}
    quiet = {"print_time": False}
    call: Any = casadi
    cold = call.nlpsol("cold", "ipopt", program, {**quiet, "ipopt": IPOPT})
    warm = call.nlpsol("warm", "ipopt", program, {**quiet, "ipopt": {**IPOPT, **WARM}})
    free = np.full(states * (points + 1), np.inf)
    high = np.concatenate([free, np.full(points, bound)])
    bounds = {"lbx": -high, "ubx": high, "lbg": 0.0, "ubg": 0.0}
    return cold, warm, bounds, free.size


def _brake_cost(x: Any, u: Any) -> Any:
    return 10 * x[0] ** 2 + 0.1 * u**2


def _cart_cost(x: Any, u: Any) -> Any:
    return cart_cost(x) + 0.01 * u**2


CASES = {
    "brake": (
        brake,
        partial(bare, lambda x, u: casadi.vertcat(x[1], u), _brake_cost, casadi.sumsqr),
        (2, 3.0, 2.0),
    ),
    "cart-pole": (
        cart_pole,
        partial(bare, cart_rates, _cart_cost, lambda x: 10 * cart_cost(x)),
        (4, FORCE, 1.0),
    ),
}


@pytest.mark.parametrize("backend", ["ipopt", "sqpmethod"])
@pytest.mark.parametrize("case", list(CASES))
def test_steps(case: str, backend: str, ledger: Ledger) -> None:
    """Both find the same first force at every step; the ledger holds the seconds."""
    make, posed, sizes = CASES[case]
    problem = make()
    solver = ct.prepare(
        problem, formulation="radau", intervals=INTERVALS, degree=DEGREE, backend=backend
    )
    cold, warm, bounds, first = posed(sizes)
    state = solver.data["x0"]
    rng = np.random.default_rng(0)
    ours, theirs, whole, counts = [], [], [], []
    last: dict[str, Any] = {}
    for number in range(STEPS):
        begin = time.perf_counter()
        step = solver(x0=state, warm=True)
        control = step.u0
        ours.append(time.perf_counter() - begin)
        begin = time.perf_counter()
        last = warm(p=state, **bounds, **last) if number else cold(p=state, x0=0.0, **bounds)
        found = np.array(last["x"]).reshape(-1)
        theirs.append(time.perf_counter() - begin)
        last = {"x0": last["x"], "lam_x0": last["lam_x"], "lam_g0": last["lam_g"]}
        counts.append((step.iterations, int(warm.stats()["iter_count"]) if number else 0))
        assert step.ok
        # The objective says it of both: a force at the start is extrapolated on Radau's nodes.
        node = step.columns[solver.posed.formulation.layout.phases[0].control_columns[0]]
        np.testing.assert_allclose(node, found[first:], atol=1e-5 * sizes[1])
        assert abs(control[0]) <= sizes[1]
        if number < 5:  # what ct.solve takes for such a step
            begin = time.perf_counter()
            ct.solve(
                problem.given(x0=state), formulation="radau", tolerance=1e-6,
                formulation_options={"intervals": INTERVALS, "degree": DEGREE, "refine": False},
            )  # fmt: skip
            whole.append(time.perf_counter() - begin)
        state = step.plan["x"](0.05) + 1e-3 * rng.normal(size=sizes[0])
    mine, bare_ = np.array(ours[1:]), np.array(theirs[1:])
    ratio = float(np.median(mine / bare_))
    iterations = np.median(counts[1:], axis=0)
    title = f"steps of {case} by {backend}"
    ledger.titles[title] = f"{title}, {INTERVALS * DEGREE} nodes, {STEPS} steps, warm"
    rows = {
        "bare nlpsol, ipopt": (bare_.tolist(), f"{iterations[1]:g} iterations", ""),
        "prepared": (
            mine.tolist(),
            f"{iterations[0]:g} iterations",
            f"{ratio:.2f} times the bare step, median of {STEPS - 1} pairs",
        ),
        "crosstrack.solve": (whole, "", ""),
    }
    ledger.rows += [Row(title, name, own, own, *words) for name, (own, *words) in rows.items()]


@pytest.mark.parametrize("name", list(TRACKING))
def test_tracking(name: str, ledger: Ledger) -> None:
    """Structured steps reach the optimum of the bare program in a closed loop of 30 nodes."""
    result = loop(name)
    title = f"tracking: {name}"
    ledger.titles[title] = f"{title}, {TRACKED} steps, warm, seconds of CPU"
    assert result["difference"]["prepared, structured"] < 1e-6
    for key, seconds in result["seconds"].items():
        own = seconds[1:].tolist()
        words = (
            f"99th percentile {1e3 * np.percentile(own, 99):.1f} ms, cold {1e3 * seconds[0]:.1f} ms"
        )
        ledger.rows.append(
            Row(title, key, own, own, f"{np.mean(result['iterations'][key][1:]):.1f}", words)
        )
