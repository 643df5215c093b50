"""``lyapunov-spectrum``: all Lyapunov exponents from linear maps of neighbourhoods.

Sources: M. Sano and Y. Sawada, "Measurement of the Lyapunov spectrum from a chaotic time series", Physical
Review Letters 55, 1985; J.-P. Eckmann, S. O. Kamphorst, D. Ruelle and S. Ciliberto, "Liapunov exponents from
time series", Physical Review A 34, 1986. Exponents that only the embedding has are removed by a projection on
the directions of the attractor (A. G. Darbyshire and D. S. Broomhead, Physica D 89, 1996), whose number
follows here from the extents of neighbourhoods.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.attractor.model import AttractorAnalysis
from ...models.attractor.plan import Spectrum
from ...models.attractor.recomputed import DEGENERATE, RANK, SKIPPED, step_limit
from ..contract.backend import Request
from ..contract.option import Option
from .native import EMBEDDING, AttractorBackend, Finding, embed, poll_of
from .neighbour_kernels import nearest_states, order_states

__all__ = ["LyapunovSpectrum", "Tangents", "resolved_directions"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Largest number of reference states of a spectrum, and of the test of curvature.
MOST, TESTED = 10_000, 300
#: Number of visited pairs of states, which limits the references, but not below `SOME`, and references of its pilot.
WORK, PILOT, SOME = 50_000_000, 50, 500
#: Neighbours per unknown of a linear map, and of the test of directions.
PER_UNKNOWN, CLOUD = 3, 12
#: Growth of the extent of a direction with four times the neighbours relative to that of the first direction:
#: 0 for noise, 1 for a direction of the attractor, 2 for curvature; and largest extent of a fourth of the
#: neighbours relative to the deviation of the states.
NOISE, SQUARE, NEAR = 0.6, 1.8, 0.5
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
        near = self.neighbours[:-1]
        now, later = self.states[near] @ axes[:-1], self.states[near + self.step] @ axes[1:]
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


def tangents(
    states: Floats, theiler: int, step: int, count: int, most: int = MOST
) -> Tangents | None:
    """Return the `count` neighbours of states `step` samples apart; None if a state has fewer."""
    last = len(states) - step
    ordered, times, places = order_states(np.ascontiguousarray(states[:last]))
    chain = np.arange(0, last, step)[:most]
    visits = nearest_states(ordered, times, places[chain[:PILOT]], theiler, count, False)[2]
    chain = chain[: max(WORK * PILOT // max(visits, 1), SOME, step_limit(states))]
    which = nearest_states(ordered, times, places[chain], theiler, count, False)[0]
    if len(chain) < 2 * PARTS or (which < 0).any():
        return None
    return Tangents(states, chain, which, step)


def resolved_directions(states: Floats, theiler: int, step: int) -> int:
    """Return the number of directions of the attractor that its neighbourhoods resolve.

    The extent of a neighbourhood along the attractor is proportional to its radius. Beyond a smooth surface
    it extends by curvature, which grows with the square of the radius, or by noise, which does not grow. Such
    directions are not resolved.
    """
    count = CLOUD * (states.shape[1] + 1)
    near = tangents(states, theiler, step, count, TESTED)
    if near is None:
        return 0
    extents = []
    for number in (count // 4, count):
        cloud = states[near.neighbours[:, :number]]
        cloud = cloud - cloud.mean(axis=1, keepdims=True)
        sizes = np.linalg.svd(cloud, compute_uv=False) / math.sqrt(number)
        extents.append(np.median(sizes, axis=0)[:DIRECTIONS])
    floor = ROUNDING * float(np.ptp(states, axis=0).max())
    if not floor < extents[0][0] < NEAR * states.std():
        return 0
    growth = np.log(np.maximum(extents[1], floor) / np.maximum(extents[0], floor))
    is_resolved = (growth > NOISE * growth[0]) & (growth < SQUARE * growth[0])
    return len(growth) if is_resolved.all() else int(is_resolved.argmin())


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
            None,
            "number of exponents; by default from the extents of neighbourhoods",
            int,
            lower=1,
            upper=DIRECTIONS,
        ),
    }

    def find(self, problem: AttractorAnalysis, request: Request) -> Finding:
        """Compute the exponents, and their spread over numbers of neighbours and embeddings."""
        poll, options = poll_of(request), request.options
        embedding = embed(problem, options)
        states = problem.states(embedding.delay, embedding.dimension)
        width = states.shape[1]
        neighbours = options["neighbours"] or PER_UNKNOWN * (width + 1)
        step = options["step"] or (embedding.delay + 1) // 2
        resolved = resolved_directions(states, embedding.theiler, step)
        poll()
        result = _fit(states, embedding.theiler, step, neighbours, resolved, options["exponents"])
        if result is None:
            reason = "states have too few distinct neighbours, or none that are near"
            return Finding(embedding.plan(), {}, f"no spectrum: {reason}")
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
        rates, widths = (tuple((x * rate).tolist()) for x in (values, deviations))
        spectrum = Spectrum(rates, widths, resolved, neighbours, step)
        figures = {"resolved directions": resolved, "other fits": others}
        message = ""
        if resolved < count:
            message = (
                f"exponents after the first {resolved} are orders of magnitude: the extent of "
                "neighbourhoods in their directions is that of curvature or noise"
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
