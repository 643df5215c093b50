"""Tools shared by the tests of quadratic backends: programs, and direct calls of backends."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from hypothesis import strategies as st

from crosstrack.models.programs.linear import QuadraticProgram
from crosstrack.solvers.conformance import all_cases
from crosstrack.solvers.conformance.quadratic import quadratic
from crosstrack.solvers.contract.backend import Request
from crosstrack.solvers.contract.registry import find_backend
from crosstrack.solvers.programs.attempts import Clock, Ending
from crosstrack.solvers.qp.base import QuadraticBackend

INF = np.inf
#: Solvers that get along in one process, that of the tests.
HERE = ("clarabel", "piqp", "proxqp", "daqp", "quadprog", "osqp", "scs")
CASES = {name: case for name, case in all_cases().items() if name.startswith("quadratic")}


def mine(name: str) -> QuadraticBackend:
    backend = find_backend(name)
    assert not backend.missing(), f"{name} is expected here"
    assert isinstance(backend, QuadraticBackend)
    return backend


def asked(name: str, program: QuadraticProgram, **arguments: Any) -> Any:
    backend = mine(name)
    options = backend.checked_options(arguments.pop("options", {}))
    return backend.run(program, Request(options=options, **arguments))


@st.composite
def programs(draw: Any) -> QuadraticProgram:
    """Draw a small strictly convex program; ranges, equalities, duplicates, infinite bounds."""
    size, rows = draw(st.integers(1, 3)), draw(st.integers(0, 3))
    numbers = st.integers(-4, 4)

    def array(*shape: int) -> np.ndarray:
        count = int(np.prod(shape))
        return np.array(draw(st.lists(numbers, min_size=count, max_size=count)), float).reshape(
            shape
        )

    root = array(size, size)
    matrix = array(rows, size)
    low, high = array(rows), array(rows)
    low, high = np.minimum(low, high), np.maximum(low, high)
    kinds = draw(st.lists(st.integers(0, 3), min_size=rows, max_size=rows))
    for row, kind in enumerate(kinds):
        low[row] = -INF if kind == 0 else low[row]
        high[row] = {1: INF, 2: low[row]}.get(kind, high[row])
    lower, upper = array(size) - 2, array(size) + 3
    open_ = np.array(draw(st.lists(st.booleans(), min_size=2 * size, max_size=2 * size)), bool)
    return quadratic(
        root @ root.T + np.eye(size),
        array(size).tolist(),
        matrix,
        low,
        high,
        lower=np.where(open_[:size], -INF, np.minimum(lower, upper)),
        upper=np.where(open_[size:], INF, np.maximum(lower, upper)),
        offset=float(draw(numbers)),
    )


class Told(QuadraticBackend):
    """Solver that returns a given ending."""

    name = "told"
    requires = ()

    def __init__(self, say: Callable[[QuadraticProgram], Ending]) -> None:
        self.say = say
        self.asked = 0

    def attempt(self, program: QuadraticProgram, request: Request, clock: Clock) -> Ending:
        self.asked += 1
        return self.say(program)


def told(program: QuadraticProgram, say: Callable[[QuadraticProgram], Ending]) -> Any:
    return Told(say).run(program, Request())
