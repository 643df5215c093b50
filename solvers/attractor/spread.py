"""Stated deviations of slopes: the spread over regions and embeddings, and the calibrated error of the model.

The jackknife of a slope measures the sample only. The error that matters is usually that of the region and the
embedding, so the deviation adds in squares

- the jackknife and half the difference of the slopes within the halves of the region (:func:`~.regions.whole_slope`),
- the spread of the slopes of all regions that were acceptable (:func:`~.regions.region_spread`),
- the root mean square difference of the slopes in other embeddings (:func:`variants`),
- a relative and an absolute error that none of these shows: finite distances of neighbours in a finite series.

The constants of the last part are calibrated by ``tests/benchmarks/attractor/coverage.py`` on one set of systems. The
table of the documentation reports the coverage on another set.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from ...models.attractor.plan import Slope
from .native import Embedding

__all__ = [
    "REFERENCES",
    "describe_variants",
    "variants",
    "widened",
    "widened_dimension",
    "widened_exponent",
]

#: Reference states of the curves in other embeddings.
REFERENCES = 500
#: Relative error of the exponent of a map and of a flow, and of a correlation dimension. Neighbours on a flow are also
#: separated along it. This distance does not grow, so that exponents of flows are too small. For Kantz' method the
#: change with the radius shows this error, so the value for maps is used.
MAP_ERROR, FLOW_ERROR, DIMENSION_ERROR = 0.03, 0.08, 0.04
#: Smallest number of samples per turn of a flow.
TURN = 6
#: Relative error that is added if no other embedding has a slope: of an exponent, of a dimension.
UNCONFIRMED_EXPONENT, UNCONFIRMED_DIMENSION = 0.10, 0.05
#: Uncertainty of an exponent in nats over the whole series: neighbours that separate slowly, as on the strange
#: attractor without chaos of Grebogi, Ott, Pelikan and Yorke, show a slope of 10 to 40 nats per series.
PARTINGS = 12.0
#: Factor of the change of an exponent with half the radius.
RADIUS = 2.0


def variants(embedding: Embedding, count: int) -> Iterator[Embedding]:
    """Yield other embeddings that show the same attractor, if the `count` samples of a series suffice for them.

    They have one and two coordinates more, half the delay, and half the coordinates if there are at least
    six.
    """
    delay, dimension = embedding.delay, embedding.dimension
    other = [(delay, dimension + 1), (delay, dimension + 2)]
    if delay > 1:
        other.append((delay // 2, dimension + 1))
    if dimension >= 6:
        other.append((delay, (dimension + 1) // 2))
    for step, columns in other:
        theiler = max(embedding.theiler, min((columns - 1) * step, count // 10))
        if count - (columns - 1) * step > max(2 * theiler, count // 2):
            yield Embedding(step, columns, theiler)


def describe_variants(slope: Slope, others: Sequence[float]) -> dict[str, float]:
    """Return the statistics of the slopes in other embeddings."""
    return {
        "other embeddings": len(others),
        "least in other embeddings": min(others, default=slope.value),
        "largest in other embeddings": max(others, default=slope.value),
    }


def widened(
    slope: Slope,
    region: float,
    others: Sequence[float],
    *,
    relative: float,
    unconfirmed: float,
    absolute: float = 0.0,
) -> Slope:
    """Return the slope with the deviation that includes all parts.

    `region` is the spread of the slopes of the acceptable regions, and `others` are the slopes in other
    embeddings. The calibrated error is the sum in squares of the share `relative` of the slope and of
    `absolute`. Without others, the share `unconfirmed` of the slope is added.
    """
    squares = [(value - slope.value) ** 2 for value in others if math.isfinite(value)]
    between = unconfirmed * abs(slope.value)
    if squares:
        between = math.sqrt(sum(squares) / len(squares))
    parts = slope.deviation, region, between, relative * abs(slope.value), absolute
    return replace(slope, deviation=math.hypot(*parts))


def widened_exponent(
    slope: Slope,
    region: float,
    others: Sequence[float],
    turn: float,
    duration: float,
    change: float = 0.0,
) -> Slope:
    """Return an exponent with the deviation that includes all parts.

    `turn` is the number of samples per turn, `duration` that of the series in seconds, and `change` the
    difference of the slope with half the radius, which is multiplied by :data:`RADIUS`.
    """
    return widened(
        slope, region, others,
        relative=FLOW_ERROR if turn >= TURN and slope.radius is None else MAP_ERROR,
        unconfirmed=UNCONFIRMED_EXPONENT, absolute=math.hypot(PARTINGS / duration, RADIUS * change),
    )  # fmt: skip


def widened_dimension(slope: Slope, region: float, others: Sequence[float]) -> Slope:
    """Return a correlation dimension with the deviation that includes all parts."""
    return widened(
        slope, region, others, relative=DIMENSION_ERROR, unconfirmed=UNCONFIRMED_DIMENSION
    )
