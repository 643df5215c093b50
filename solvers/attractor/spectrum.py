"""``lyapunov-spectrum``: all Lyapunov exponents from linear maps of neighbourhoods.

Sources: M. Sano and Y. Sawada, "Measurement of the Lyapunov spectrum from a chaotic time series", Physical
Review Letters 55, 1985; J.-P. Eckmann, S. O. Kamphorst, D. Ruelle and S. Ciliberto, "Liapunov exponents from
time series", Physical Review A 34, 1986. Exponents that only the embedding has are removed by a projection on
the directions of the attractor (A. G. Darbyshire and D. S. Broomhead, Physica D 89, 1996), whose number
follows here from a test of curvature.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.attractor.model import AttractorAnalysis
from ...models.attractor.plan import Spectrum
from ...models.attractor.recomputed import DEGENERATE, RANK, SKIPPED
from ..contract.backend import Request
from ..contract.option import Option
from .native import EMBEDDING, AttractorBackend, Finding, embed, poll_of
from .neighbour_kernels import nearest_states, order_states

__all__ = ["LyapunovSpectrum", "Tangents", "resolved_directions"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Largest number of reference states of a spectrum, and of the test of curvature.
MOST, TESTED = 10_000, 300
#: Neighbours per unknown of a linear map, and of the test of curvature.
PER_UNKNOWN, PER_TERM = 3, 4
#: Share of the variance of a direction that curvature explains if the direction is not resolved. Measured: below
#: 0.02 for resolved directions, above 0.85 for others (Hénon, Lorenz, Rössler, torus, sine; 5,000 samples).
CURVED = 0.5
#: Largest number of directions, and parts of the orbit for the standard error.
DIRECTIONS, PARTS = 6, 10
#: Extent of a direction relative to that of the states which is due to rounding.
ROUNDING = 1e-10


class Tangents(NamedTuple):
    """States with the neighbours of some of them, one `step` apart in time, shape (r, k)."""

    states: Floats
    references: Ints
    neighbours: Ints
    step: int

    @property
    def frames(self) -> Floats:
        """Principal directions of the neighbours, shape (r, d, d), the widest first."""
        clouds = self.states[self.neighbours]
        clouds = clouds - clouds.mean(axis=1, keepdims=True)
        result: Floats = np.linalg.svd(clouds, full_matrices=False)[2]
        return result

    def exponents(self, frames: Floats, count: int) -> tuple[Floats, Floats]:
        """Return `count` exponents in nats per step, the largest first, and their standard errors.

        NaN if a map is degenerate.
        """
        axes = np.swapaxes(frames[:, :count], 1, 2)
        now, later = self.states[self.neighbours[:-1]], self.states[self.neighbours[:-1] + self.step]
        now, later = now @ axes[:-1], later @ axes[1:]
        now, later = (x - x.mean(axis=1, keepdims=True) for x in (now, later))
        maps = np.swapaxes(np.linalg.pinv(now, rcond=RANK) @ later, 1, 2)
        turned, logs = np.eye(count), np.empty((len(maps), count))
        for k, jacobian in enumerate(maps):
            turned, growth = np.linalg.qr(jacobian @ turned)
            if np.abs(np.diag(growth)).min() < DEGENERATE:
                return np.full(count, np.nan), np.full(count, np.nan)
            logs[k] = np.log(np.abs(np.diag(growth)))
        logs = logs[min(SKIPPED, len(logs) // 10) :]
        means = np.array([part.mean(axis=0) for part in np.array_split(logs, PARTS)])
        order = np.argsort(-logs.mean(axis=0))
        error = means.std(axis=0, ddof=1) / math.sqrt(PARTS)
        return logs.mean(axis=0)[order], error[order]


def tangents(states: Floats, theiler: int, step: int, count: int, most: int = MOST) -> Tangents | None:
    """Return the `count` neighbours of states `step` samples apart; None if a state has fewer."""
    last = len(states) - step
    ordered, times, places = order_states(np.ascontiguousarray(states[:last]))
    chain = np.arange(0, last, step)[:most]
    which = nearest_states(ordered, times, places[chain], theiler, count, False)[0]
    return None if len(chain) < 2 * PARTS or (which < 0).any() else Tangents(states, chain, which, step)


def resolved_directions(states: Floats, theiler: int, step: int) -> int:
    """Return the number of directions of the attractor that its neighbourhoods resolve.

    Neighbours on a smooth surface extend beyond it by its curvature: their coordinate along a further
    direction is a quadratic function of those along the surface. Such directions, and those that extend no
    further than rounding, are not resolved.
    """
    most = min(states.shape[1], DIRECTIONS)
    terms = 1 + most * (most - 1) // 2
    count = max(min(PER_TERM * terms, len(states) // 8), 2 * states.shape[1])
    near = tangents(states, theiler, step, count, TESTED)
    if near is None:
        return 0
    clouds = states[near.neighbours]
    clouds = clouds - clouds.mean(axis=1, keepdims=True)
    along, sizes, _ = np.linalg.svd(clouds, full_matrices=False)
    floor = ROUNDING * float(np.ptp(states, axis=0).max())
    for k in range(most):
        if np.median(sizes[:, k]) <= floor:
            return k
        columns = [along[..., i] * along[..., j] for i in range(k) for j in range(i + 1)]
        unknowns = len(columns) + 1
        if k and 2 * unknowns > count:
            return k
        rows = np.stack([np.full(along.shape[:2], 1.0 / count), *columns], axis=2)
        y = along[..., k : k + 1]
        left = y - rows @ (np.linalg.pinv(rows) @ y)
        share = (left**2).sum(axis=(1, 2)) * (count - 1) / (count - unknowns)
        if k and 1 - np.median(share) > CURVED:
            return k
    return most


class LyapunovSpectrum(AttractorBackend):
    """Backend for the Lyapunov exponents of all directions that the data show."""

    name = "lyapunov-spectrum"
    summary = "all Lyapunov exponents from linear maps of neighbourhoods (Sano and Sawada, Eckmann)"
    options: ClassVar[Mapping[str, Option]] = {
        **EMBEDDING,
        "step": Option(
            None, "samples from a state to its image; by default half the delay", int, lower=1
        ),
        "neighbours": Option(None, "neighbours of a map; by default 3 per unknown", int, lower=2),
        "exponents": Option(
            None, "number of exponents; by default by a test of curvature", int, lower=1, upper=DIRECTIONS
        ),
    }

    def find(self, problem: AttractorAnalysis, request: Request) -> Finding:
        """Compute the exponents, and their spread over numbers of neighbours and embeddings."""
        poll, options, embedding = poll_of(request), request.options, embed(problem, request.options)
        states = problem.states(embedding.delay, embedding.dimension)
        width = states.shape[1]
        neighbours = options["neighbours"] or PER_UNKNOWN * (width + 1)
        step = options["step"] or (embedding.delay + 1) // 2
        resolved = resolved_directions(states, embedding.theiler, step)
        poll()
        result = _fit(states, embedding.theiler, step, neighbours, resolved, options["exponents"])
        if result is None:
            return Finding(embedding.plan(), {}, "no spectrum: states have too few distinct neighbours")
        values, errors = result
        count = len(values)
        squares, others = errors**2, 0
        for delayed, number in (
            (embedding.dimension, max(neighbours // 2, width + 2)),
            (embedding.dimension, 2 * neighbours),
            (embedding.dimension + 1, neighbours + PER_UNKNOWN * (width // embedding.dimension)),
        ):
            poll()
            if len(problem.series) <= embedding.delay * delayed + 2 * embedding.theiler + number:
                continue
            moved = problem.states(embedding.delay, delayed)
            variant = _fit(moved, embedding.theiler, step, number, resolved, count)
            if variant is not None and len(variant[0]) == count:
                squares, others = squares + (variant[0] - values) ** 2, others + 1
        deviations = np.sqrt(squares)
        resolved = min(resolved, count)
        deviations[resolved:] = np.maximum(deviations[resolved:], np.abs(values[resolved:]))
        rate = 1.0 / (step * problem.period)
        spectrum = Spectrum(
            tuple((values * rate).tolist()), tuple((deviations * rate).tolist()), resolved, neighbours, step
        )
        figures = {"resolved directions": resolved, "other fits": others}
        message = ""
        if resolved < count:
            message = (
                f"exponents after the first {resolved} are orders of magnitude: neighbours lie on a curved "
                "sheet in their directions"
            )
        return Finding(embedding.plan(spectrum=spectrum), figures, message)


def _fit(
    states: Floats, theiler: int, step: int, neighbours: int, resolved: int, count: int | None
) -> tuple[Floats, Floats] | None:
    """Return the exponents per step and their errors, by default with one direction after the resolved ones.

    That direction is kept if its exponent is below the others: then it is transverse to the attractor. If
    not, it belongs to the embedding alone. Directions with degenerate maps are omitted.
    """
    near = tangents(states, theiler, step, neighbours)
    if near is None:
        return None
    frames, most = near.frames, min(states.shape[1], DIRECTIONS)
    for wanted in range(min(count or resolved, most), 0, -1):
        result = near.exponents(frames, wanted)
        if np.isfinite(result[0]).all():
            if count is None and wanted == resolved < most:
                more = near.exponents(frames, wanted + 1)
                if more[0].sum() - result[0].sum() < result[0][-1]:
                    return more
            return result
    return None
