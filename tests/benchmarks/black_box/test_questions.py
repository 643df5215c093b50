"""Overhead of an oracle query about hidden data, for one point and for batches.

Slowness does not fail the test. Run with ``make bench``, or::

    pytest tests/benchmarks/black_box/test_questions.py -s
"""

from __future__ import annotations

import sys
import time
from typing import Any

import cloudpickle
import numpy as np

import crosstrack as ct
from crosstrack.models import BlackBoxMinimisation
from crosstrack.models.black_box import BlackBoxPoint
from crosstrack.solvers import Answer, Backend, Guarantee, Request, Termination

cloudpickle.register_pickle_by_value(sys.modules[__name__])


def seconds_of(ask: Any, points: int, times: int = 2000) -> float:
    """Return the mean time (s) of a query with the given number of points."""
    asked = np.full((points, 10), 0.5)
    begin = time.perf_counter()
    for _ in range(times):
        ask(asked)
    return (time.perf_counter() - begin) / times


class Asks(Backend):
    """Backend that records the time of queries in its statistics."""

    name = "asks"
    accepts = BlackBoxMinimisation
    guarantee = Guarantee.HEURISTIC
    deterministic = True

    def run(self, problem: BlackBoxMinimisation, request: Request) -> Answer:
        """Query one point and a thousand points repeatedly."""
        taken = {str(count): seconds_of(request.control.ask, count) for count in (1, 1000)}
        return Answer(Termination.FEASIBLE, point=BlackBoxPoint((0.5,) * 10), statistics=taken)


def test_questions(capsys: Any) -> None:
    model = BlackBoxMinimisation("sphere", [[0, 1]] * 10, budget=10**9)
    ct.solve(model, Asks())  # starts the worker
    found = ct.solve(model, Asks())
    assert found.verified
    for count in (1, 1000):
        own, whole = seconds_of(model.oracle(), count), float(found.statistics[str(count)])
        with capsys.disabled():
            print(
                f"\n{count} points: {whole * 1e6:.0f} us, of which the function {own * 1e6:.0f} us"
            )
