"""Verified tours by a-star, and shortest tours by a plain search."""

import heapq

import pytest

from crosstrack.solvers.contract.backend import Request, Termination
from crosstrack.solvers.guided_path.a_star import AStar


def solve(model, **asked):
    """Return the answer of a-star, and verify its plan."""
    options = {"states": asked.pop("states", 0)}
    answer = AStar().run(model, Request(options=options, **asked))
    found = model.verify(answer.point)
    assert found.ok, found
    assert found.objective == pytest.approx(answer.primal_bound, rel=1e-12, abs=1e-300)
    assert answer.dual_bound <= answer.primal_bound
    return answer


def settled(model, value):
    """Assert that a-star finds and proves the least length."""
    answer = solve(model)
    assert answer.termination is Termination.OPTIMAL
    assert answer.primal_bound == pytest.approx(value, rel=1e-9, abs=1e-9)
    assert answer.dual_bound == pytest.approx(value, rel=1e-6, abs=1e-9)
    return answer


def shortest(model):
    """Return the least length by Dijkstra over positions and sets served, one customer per step."""
    x = model.coordinates.tolist()
    needs = [0] * model.size
    for a, b in model.pairs:
        needs[b] |= 1 << a
    full = 2**model.size - 2
    done, queue = set(), [(0.0, 0, 0)]
    while queue:
        way, served, here = heapq.heappop(queue)
        if (served, here) in done:
            continue
        done.add((served, here))
        if served == full + 1:
            return way
        if served == full:
            heapq.heappush(queue, (way + abs(x[here] - x[0]), full + 1, 0))
        for c in range(1, model.size):
            if not served >> c & 1 and served & needs[c] == needs[c]:
                heapq.heappush(queue, (way + abs(x[c] - x[here]), served | 1 << c, c))
    raise AssertionError("no tour")
