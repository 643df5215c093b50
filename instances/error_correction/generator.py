"""Seeded instances of error-correction routing.

Uniform points are feasible for about one seed in a thousand, so :func:`generate` plants one feasible
route and draws the other points uniformly. Only ``Generator.random`` is used, and planted coordinates
are rounded to the centimetre, so that a seed gives the same points on every platform.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ...models.error_correction.model import ErrorCorrectionRouting, Route
from ...models.fields import Real, Whole, show
from ..seeds import seeded
from .settings import BOX, DELTA, Thresholds

__all__ = ["generate", "generate_with_route", "random_small", "uniform_slab", "with_suspects"]

#: Largest share of a threshold used by a planted route.
_MARGIN = 0.95
#: Shortest planted leg relative to the box; shorter legs end an attempt.
_SHORTEST = 0.02
#: Maximum number of attempts to plant a route.
_ATTEMPTS = 2000

#: Maximum number of points of either kind.
MOST = 10_000_000

_Point = NDArray[np.float64]


def generate(
    n_horizontal: int, n_vertical: int, thresholds: Sequence[float], *, seed: int, delta: float = DELTA,
    box: float | Sequence[float] = BOX, planted_under: Sequence[float] | None = None, name: str = "",
) -> ErrorCorrectionRouting:  # fmt: skip
    """Return a feasible instance with A and B on opposite faces of a box.

    Parameters
    ----------
    n_horizontal, n_vertical, thresholds, seed, delta, box, planted_under, name
        As in :func:`generate_with_route`, with its errors.
    """
    return generate_with_route(
        n_horizontal, n_vertical, thresholds, seed=seed, delta=delta, box=box,
        planted_under=planted_under, name=name,
    )[0]  # fmt: skip


def generate_with_route(
    n_horizontal: int, n_vertical: int, thresholds: Sequence[float], *, seed: int, delta: float = DELTA,
    box: float | Sequence[float] = BOX, planted_under: Sequence[float] | None = None, name: str = "",
) -> tuple[ErrorCorrectionRouting, Route]:  # fmt: skip
    """Return a feasible instance and its planted route, which is rarely optimal.

    A (first) is on the face x = 0 of a box and B (last) on the opposite one. The planted route of both
    kinds of points has a margin to every threshold; the other points are uniform.

    Parameters
    ----------
    n_horizontal, n_vertical : int
        Number of horizontal and of vertical correction points.
    thresholds : sequence of 5 floats
        α1, α2, β1, β2, θ, for instance :class:`Thresholds`.
    seed : int
        Seed of the random numbers; the same seed gives the same points.
    delta : float
        Error gained per metre flown, of both kinds.
    box : float or 3 floats
        Edge (m) of the cube, or the three edges of the box.
    planted_under : sequence of 5 floats, optional
        Thresholds of the planted route, none wider than in `thresholds`: instances with the same seed
        and the same `planted_under` have the same points.
    name : str
        Name of the model.

    Returns
    -------
    model : ErrorCorrectionRouting
        The instance.
    route : Route
        The planted route.

    Raises
    ------
    InvalidData
        An argument is invalid, or no route can be planted under these thresholds.
    """
    limits = _thresholds("thresholds", thresholds)
    planted_limits = (
        limits if planted_under is None else _thresholds("planted_under", planted_under)
    )
    for field, tight, wide in zip(Thresholds._fields, planted_limits, limits, strict=True):
        if tight > wide:
            raise InvalidData(
                f"planted_under must nowhere be wider than thresholds: {field} is {tight:g} "
                f"against {wide:g}",
                field="planted_under",
            )
    counts = [_count("n_horizontal", n_horizontal), _count("n_vertical", n_vertical)]
    rate = Real(lower=0).coerce("delta", delta, {})
    edges = _edges("box", (box, box, box) if isinstance(box, int | float) else box)
    rng = seeded(seed)

    planted = _plant(counts, planted_limits, rate, edges, rng)
    if planted is None:
        raise InvalidData(
            f"no route could be planted: {counts[0]} horizontal and {counts[1]} vertical points "
            f"under thresholds {tuple(planted_limits)} do not lead through a box of {tuple(edges)} m at "
            f"delta = {rate:g}; take wider thresholds, more points or a smaller box",
            field="thresholds",
        )
    stops, kinds = planted
    inner = stops[1:-1]
    rest = [counts[0] - kinds.count(0), counts[1] - kinds.count(1)]
    others = _round(rng.random((sum(rest), 3)) * edges)
    points = np.concatenate([np.reshape(inner, (-1, 3)), others])
    words = np.array(["horizontal", "vertical"])[kinds + [0] * rest[0] + [1] * rest[1]]
    # Sorting random keys gives a permutation that depends only on the stream of `random`.
    order = np.argsort(rng.random(len(points)), kind="stable")
    model = ErrorCorrectionRouting(
        points=np.concatenate([stops[:1], points[order], stops[-1:]]),
        kinds=np.array(["A", *words[order].tolist(), "B"]),
        **limits._asdict(),
        delta=rate,
        name=name,
    )
    places = np.argsort(order)[: len(inner)] + 1
    return model, Route((0, *places.tolist(), len(points) + 1))


def _plant(
    counts: list[int], thresholds: Thresholds, rate: float, edges: _Point, rng: np.random.Generator
) -> tuple[list[_Point], list[int]] | None:
    """Return the stops of a feasible route, A and B included, and the kinds of the others."""
    for _ in range(_ATTEMPTS):
        start = _round(np.array([0.0, *(0.25 + 0.5 * rng.random(2))]) * edges)
        end = _round(np.array([1.0, *(0.25 + 0.5 * rng.random(2))]) * edges)
        walk = _walk(start, end, counts, thresholds, rate, edges, rng)
        if walk is not None:
            return walk
    return None


def _walk(
    start: _Point,
    end: _Point,
    counts: list[int],
    thresholds: Thresholds,
    rate: float,
    edges: _Point,
    rng: np.random.Generator,
) -> tuple[list[_Point], list[int]] | None:
    """Return a random walk from `start` towards `end`; None after a failure."""
    # Largest (horizontal, vertical) error on arrival by kind: 0 horizontal, 1 vertical.
    limits = [(thresholds.beta2, thresholds.beta1), (thresholds.alpha2, thresholds.alpha1)]
    errors = [0.0, 0.0]
    stops, left = [start], list(counts)
    kinds: list[int] = []
    kind = int(rng.random() < 0.5)
    while True:
        here = stops[-1]
        ahead = math.dist(here, end)
        if max(errors) + rate * ahead <= _MARGIN * thresholds.theta:
            return [*stops, end], kinds
        # Kinds alternate in six of seven cases, so routes are irregular.
        kind = 1 - kind if rng.random() < 0.86 else kind
        room = min(_MARGIN * limits[kind][axis] - errors[axis] for axis in (0, 1)) / rate
        leg = min(room * (0.55 + 0.45 * rng.random()), 0.9 * ahead)
        if left[kind] == 0 or leg < _SHORTEST * edges.max():
            return None
        heading = (end - here) / ahead + 1.2 * (rng.random(3) - 0.5)
        stop = _round(here + leg * heading / math.hypot(*heading))
        if (stop < 0).any() or (stop > edges).any():
            return None
        leg = math.dist(here, stop)
        errors = [errors[axis] + rate * leg for axis in (0, 1)]
        errors[kind] = 0.0
        left[kind] -= 1
        stops.append(stop)
        kinds.append(kind)


def uniform_slab(
    n: int,
    thresholds: Sequence[float],
    *,
    seed: int,
    size: Sequence[float] = (100e3, 100e3, 10e3),
    delta: float = DELTA,
    name: str = "",
) -> ErrorCorrectionRouting:
    """Return an instance of `n` uniform points in a slab, for scaling benchmarks.

    A and B are the centres of the faces x = 0 and x = ``size[0]``; about half of the other points are
    of each kind. No route is planted: dense points make the instance feasible.

    Parameters
    ----------
    n : int
        Number of points, A and B included.
    thresholds : sequence of 5 floats
        α1, α2, β1, β2, θ.
    seed : int
        Seed of the random numbers; the same seed gives the same points.
    size : 3 floats
        Edges (m) of the slab.
    delta : float
        Error gained per metre flown, of both kinds.
    name : str
        The model's name.
    """
    if _count("n", n) < 2:
        raise InvalidData(f"n must be at least 2, for A and B, got {n}", field="n")
    edges, rng = _edges("size", size), seeded(seed)
    points = rng.random((n, 3)) * edges
    points[0], points[-1] = edges * (0.0, 0.5, 0.5), edges * (1.0, 0.5, 0.5)
    kinds = np.where(rng.random(n) < 0.5, "horizontal", "vertical")
    kinds[0], kinds[-1] = "A", "B"
    values = _thresholds("thresholds", thresholds)._asdict()
    return ErrorCorrectionRouting(points=points, kinds=kinds, **values, delta=delta, name=name)


def with_suspects(
    model: ErrorCorrectionRouting, share: float, residual: float, *, seed: int, name: str = ""
) -> ErrorCorrectionRouting:
    """Return `model` with independently drawn suspect correction points.

    Parameters
    ----------
    model : ErrorCorrectionRouting
        Source of points, thresholds and rates.
    share : float
        Probability that a correction point is suspect.
    residual : float
        Largest error after a failed correction.
    seed : int
        Seed of the random numbers; the same seed gives the same suspects.
    name : str
        The model's name.
    """
    part = Real(lower=0, upper=1).coerce("share", share, {})
    suspect = seeded(seed).random(len(model.points)) < part
    suspect[[model.start, model.end]] = False
    return replace(model, suspect=suspect, residual=residual, name=name)


def random_small(
    n: int, seed: int, *, revisits: bool = False, name: str = ""
) -> ErrorCorrectionRouting:
    """Return a small instance for property tests, feasible for about half of all seeds.

    A and B are anywhere in the list. In some instances two points coincide, the two rates differ, or a
    threshold is 0.

    Parameters
    ----------
    n : int
        Number of points, 2 to 9, so that all routes can be enumerated.
    seed : int
        Seed of the random numbers; the same seed gives the same instance.
    revisits : bool
        Whether a point may be visited more than once.
    name : str
        The model's name.
    """
    if not 2 <= _count("n", n) <= 9:
        raise InvalidData(f"n must be in 2 … 9, got {n}", field="n")
    rng = seeded(seed)
    points = rng.random((n, 3)) * (1.0, 0.6, 0.6)
    kinds = ["horizontal" if draw < 0.5 else "vertical" for draw in rng.random(n)]
    order = np.argsort(rng.random(n), kind="stable").tolist()
    start, end = order[0], order[-1]
    points[start, 0], points[end, 0] = 0.0, 1.0
    kinds[start], kinds[end] = "A", "B"
    if n > 3 and rng.random() < 0.2:
        points[order[1]] = points[order[2]]
    rates = [1.0, 1.0] if rng.random() < 0.5 else (0.6 + 0.8 * rng.random(2)).tolist()
    # Few points need wide thresholds: the level makes about half of the instances feasible.
    level = _LEVELS[n] * (0.7 + 0.6 * rng.random())
    thresholds = [level * (0.6 + 0.8 * draw) for draw in rng.random(5).tolist()]
    thresholds[4] *= 0.6  # so that most routes need corrections
    if rng.random() < 0.05:
        thresholds[int(5 * rng.random())] = 0.0
    return ErrorCorrectionRouting(
        points=points,
        kinds=np.array(kinds),
        **Thresholds(*thresholds)._asdict(),
        horizontal_rate=rates[0],
        vertical_rate=rates[1],
        revisits=revisits,
        name=name,
    )


#: Mean threshold at which about half of the small instances are feasible, by number of points.
_LEVELS = {2: 1.89, 3: 1.9, 4: 1.71, 5: 1.56, 6: 1.43, 7: 1.36, 8: 1.28, 9: 1.2}


def _round(points: _Point) -> _Point:
    """Return `points` rounded to the centimetre."""
    return np.round(points, 2)


def _count(name: str, value: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 0:
        raise InvalidData(f"{name} must be a whole number >= 0, got {show(value)}", field=name)
    return Whole(0, MOST).coerce(name, value, {})


def _thresholds(name: str, values: Sequence[float]) -> Thresholds:
    if isinstance(values, str) or not isinstance(values, Sequence) or len(values) != 5:
        raise InvalidData(
            f"{name} must be the five numbers alpha1, alpha2, beta1, beta2, theta, "
            f"got {show(values)}",
            field=name,
        )
    rule = Real(lower=0)
    pairs = zip(Thresholds._fields, values, strict=True)
    return Thresholds(*(rule.coerce(f"{name}: {field}", value, {}) for field, value in pairs))


def _edges(name: str, values: Sequence[float]) -> _Point:
    if isinstance(values, str) or not isinstance(values, Sequence) or len(values) != 3:
        raise InvalidData(f"{name} must be three edges (m), got {show(values)}", field=name)
    rule = Real(lower=0, strict=True)
    pairs = enumerate(values)
    return np.array([rule.coerce(f"{name}[{axis}]", value, {}) for axis, value in pairs])
