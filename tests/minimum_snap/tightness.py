"""Random corridors and limits as tight as they can be: the critical tightness by linear programs."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from crosstrack.errors import InvalidData
from crosstrack.models.minimum_snap import FREE, MinimumDerivative
from crosstrack.models.minimum_snap.formulations.hermite import HermiteFormulation

#: How far from the critical tightness: wider by these shares, and narrower.
WIDER = (1.0, 0.1, 1e-2, 1e-3, 1e-4)
NARROWER = (-1e-3, -1e-2, -1e-1)


class Case(NamedTuple):
    """A model, whether it is feasible, and what it is."""

    model: MinimumDerivative
    feasible: bool
    name: str


def family(seed: int, most: int = 100) -> Callable[[float], MinimumDerivative]:
    """Return a function from a tightness to a model whose bounds are affine in it."""
    generator = np.random.default_rng(seed)
    count = int(np.round(np.exp(generator.uniform(np.log(3), np.log(most)))))
    axes, order = int(generator.integers(1, 4)), int(generator.integers(3, 5))
    spread = 10 ** generator.uniform(0, 2)
    long = np.exp(generator.uniform(0, np.log(spread), count))
    long /= np.exp(np.log(long).mean())
    times = np.concatenate([[0], np.cumsum(long)])
    # Speeds alike on short and long segments, or steps alike.
    step = long[:, None] if generator.random() < 0.5 else np.ones((count, 1))
    points = np.cumsum(
        np.concatenate([np.zeros((1, axes)), generator.normal(size=(count, axes)) * step]), axis=0
    )
    low, high = np.minimum(points[:-1], points[1:]), np.maximum(points[:-1], points[1:])
    room = generator.uniform(0.2, 1.0, (count, axes)) * np.maximum(np.median(high - low), 1e-3)
    free = generator.random((count + 1, axes)) < generator.choice([0.0, 0.5, 1.0])
    free[[0, -1]] = False
    given = np.where(free, FREE, points)
    kind = int(generator.integers(3))
    moving = generator.normal(size=(order - 1, axes)) / long.mean() ** np.arange(1, order)[:, None]
    options: dict[str, object] = {"order": order}
    if kind == 0:
        # Velocities given at knots lead out of the boxes.
        rates = np.full((count + 1, 1, axes), FREE)
        swing = generator.random((count + 1, axes)) < 0.4
        rates[:, 0][swing] = (generator.normal(size=(count + 1, axes)) * 1.5)[swing]
        rates[[0, -1]] = FREE
        options |= {"derivatives": rates, "start": moving}
    speed = np.full(axes, np.abs(np.diff(points, axis=0) / long[:, None]).max())

    def model(tightness: float) -> MinimumDerivative:
        wide = room * (tightness if kind != 1 else 1.0)
        limits: dict[str, object] = {}
        if kind == 2:
            # A tube of boxes around the middles of the legs. All inner waypoints are free.
            middle = (low + high) / 2
            middle[0], middle[-1] = points[0], points[-1]
            inner = np.full_like(given, FREE)
            inner[[0, -1]] = points[[0, -1]]
            return MinimumDerivative(
                inner, times, corridor_lower=middle - wide, corridor_upper=middle + wide, **options
            )
        if kind == 1:
            limits = {"velocity_limit": tightness * speed}
            if seed % 2:
                limits["acceleration_limit"] = tightness * 4.0 * speed / np.median(long)
        return MinimumDerivative(
            given, times, corridor_lower=low - wide, corridor_upper=high + wide, **limits, **options
        )

    return model


def _central(matrix: sp.csc_array, right: np.ndarray) -> np.ndarray | None:
    """Return the middle of the points with ``matrix @ x <= right`` and the least last entry.

    An interior point without crossover: at a vertex, directions that the minimum leaves free
    would violate bounds between the instants in every round.
    """
    import highspy

    size = matrix.shape[1]
    lp = highspy.HighsLp()
    lp.num_col_, lp.num_row_ = size, right.size
    lp.col_cost_ = np.eye(size)[-1]
    lp.col_lower_, lp.col_upper_ = np.full(size, -np.inf), np.full(size, np.inf)
    lp.row_lower_, lp.row_upper_ = np.full(right.size, -np.inf), right
    lp.a_matrix_.format_ = highspy.MatrixFormat.kColwise
    lp.a_matrix_.start_, lp.a_matrix_.index_ = matrix.indptr, matrix.indices
    lp.a_matrix_.value_ = matrix.data
    solver = highspy.Highs()
    for name, value in (
        ("output_flag", False), ("solver", "ipm"), ("run_crossover", "off"),
        ("ipm_optimality_tolerance", 1e-10), ("primal_feasibility_tolerance", 1e-9),
        ("dual_feasibility_tolerance", 1e-9),
    ):  # fmt: skip
        solver.setOptionValue(name, value)
    solver.passModel(lp)
    solver.run()
    if solver.getModelStatus() != highspy.HighsModelStatus.kOptimal:
        return None
    return np.array(solver.getSolution().col_value)


def critical(model: Callable[[float], MinimumDerivative]) -> tuple[float, float]:
    """Return a tightness that no trajectory has, but for rounding, and one that a known one has.

    The least tightness at which the bounds hold at some instants, to which those are added at which
    the trajectory found sticks out.
    """
    formulation = HermiteFormulation(model(4.0), samples=8)
    for _ in range(12):
        programs = []
        for tightness in (4.0, 5.0):
            other = HermiteFormulation(model(tightness), samples=8)
            object.__setattr__(other, "instants", formulation.instants)
            programs.append(other.program)
        one, two = programs
        parts, right = [], []
        for low, high, sign in (
            (one.row_lower, two.row_lower, -1.0), (one.row_upper, two.row_upper, 1.0)
        ):  # fmt: skip
            take = np.flatnonzero(np.isfinite(low))
            slope = high[take] - low[take]
            parts.append(sp.hstack([sign * one.matrix[take], -sign * slope[:, None]]))
            right.append(sign * (low[take] - 4.0 * slope))
        x = _central(sp.csc_array(sp.vstack(parts)), np.concatenate(right))
        if x is None or x[-1] < 1e-2:
            return 0.0, np.inf
        least = float(x[-1])
        plan = formulation.decode(x[:-1])
        # Tightness that the exact extremes of this trajectory require.
        needs = [least]
        for at, then in zip(model(4.0).bounds, model(5.0).bounds, strict=True):
            peaks = plan.extremes(at.derivative)
            for value, low, high in (
                (peaks.least, at.lower, then.lower), (peaks.largest, at.upper, then.upper)
            ):  # fmt: skip
                slope = high - low
                there = slope != 0
                needs.append(float((4.0 + (value - low)[there] / slope[there]).max(initial=0.0)))
        try:
            if max(needs) <= least * (1 + 2e-5) and model(max(needs) * (1 + 1e-7)).verify(plan).ok:
                return least, max(needs)
            posed = HermiteFormulation(model(least * (1 + 1e-7)), samples=8)
        except InvalidData:
            break  # a fixed value is what decides
        object.__setattr__(posed, "instants", formulation.instants)
        finer = posed.refined(x[:-1], 1e-3)
        if finer is None:
            break
        formulation = finer
    return 0.0, np.inf


def drawn(count: int, first: int = 0, most: int = 100) -> list[Case]:
    """Return `count` cases. They are feasible if wider than the critical tightness, else infeasible."""
    cases: list[Case] = []
    seed = first
    while len(cases) < count:
        seed += 1
        model = family(seed, most)
        low, high = critical(model)
        if not np.isfinite(high):
            continue  # nothing is known of this one
        generator = np.random.default_rng([seed, 1])
        for share in [
            *generator.choice(WIDER, 2, replace=False).tolist(),
            generator.choice(NARROWER),
        ]:
            tightness = (high if share > 0 else low) * (1 + share)
            try:
                one = model(tightness)
            except InvalidData:
                continue  # a fixed value lies outside: refused before anything is solved
            cases.append(Case(one, share > 0, f"{seed}: {share:+.2%}, {one.describe()}"))
    return cases[:count]
