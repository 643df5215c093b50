"""Brute force for error-correction routes, sharing nothing with the package but its data."""

from __future__ import annotations

import heapq
import math


def shortest_length(model) -> float | None:
    """Return the length of the shortest route, None for an infeasible model."""
    points = [tuple(map(float, p)) for p in model.points]
    kinds = [str(k) for k in model.kinds]
    limits = {
        "vertical": (model.alpha2, model.alpha1),
        "horizontal": (model.beta2, model.beta1),
        "B": (model.theta, model.theta),
    }
    start, end = kinds.index("A"), kinds.index("B")
    rates = (model.horizontal_rate, model.vertical_rate)

    def arrive(i: int, j: int, errors: tuple[float, float]):
        """Return length and errors after point j, None if a threshold excludes j."""
        d = math.dist(points[i], points[j])
        arrived = tuple(e + r * d for e, r in zip(errors, rates, strict=True))
        for error, limit in zip(arrived, limits[kinds[j]], strict=True):
            if error > limit + 1e-9 * max(1.0, limit):
                return None
        if kinds[j] == "horizontal":
            arrived = (0.0, arrived[1])
        elif kinds[j] == "vertical":
            arrived = (arrived[0], 0.0)
        return d, arrived

    def walks() -> float | None:
        """Dijkstra over exact states: no dominance at all."""
        heap = [(0.0, start, (0.0, 0.0))]
        done = set()
        while heap:
            length, i, errors = heapq.heappop(heap)
            if i == end:
                return length
            if (i, errors) in done:
                continue
            done.add((i, errors))
            for j in range(len(points)):
                if j not in (i, start):
                    step = arrive(i, j, errors)
                    if step is not None:
                        heapq.heappush(heap, (length + step[0], j, step[1]))
        return None

    def routes() -> float | None:
        best = math.inf

        def extend(
            i: int, length: float, errors: tuple[float, float], seen: frozenset[int]
        ) -> None:
            nonlocal best
            for j in range(len(points)):
                if j in seen:
                    continue
                step = arrive(i, j, errors)
                if step is None or length + step[0] >= best:
                    continue
                if j == end:
                    best = length + step[0]
                else:
                    extend(j, length + step[0], step[1], seen | {j})

        extend(start, 0.0, (0.0, 0.0), frozenset({start}))
        return best if math.isfinite(best) else None

    return walks() if model.revisits else routes()
