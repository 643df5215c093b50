"""Particle swarm over the centres of clusters; its evaluation by threads, or as array code.

Source: J. Kennedy and R. Eberhart, "Particle swarm optimization", ICNN 1995, with an inertia that falls
(Y. Shi and R. Eberhart, "A modified particle swarm optimizer", 1998).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import ModuleType
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from ...errors import BackendMissing, UnsupportedOption

__all__ = ["Evaluation", "array_evaluation", "fitness", "swarm", "threaded", "torch_evaluation"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flag = NDArray[np.int8]
#: Particles (p, m, dims) to their labels (p, n) and fitness (p,).
Evaluation = Callable[[Floats], tuple[Ints, Floats]]

#: Inertia at the beginning and at the end.
INERTIA = (0.9, 0.4)
#: Longest step of a centre along one axis, in lengths of the unit square.
STRIDE = 0.2


def swarm(
    points: Floats, clusters: int, particles: int, iterations: int, learning: float,
    evaluate: Evaluation, rng: Generator, flag: Flag,
) -> tuple[Ints, int, int]:  # fmt: skip
    """Return the labels of the best particle, the iterations done and the evaluations.

    A particle is the centres of all clusters; at first each lies on points that are drawn. All random
    numbers are drawn here, so particles are the same by whatever they are evaluated.

    Parameters
    ----------
    points : ndarray, shape (n, dims)
        In the unit square.
    clusters, particles, iterations : int
    learning : float
        Both acceleration coefficients.
    evaluate : callable
        See :data:`Evaluation`.
    rng : Generator
    flag : ndarray of int8, shape (1,)
        Stops before the next iteration.
    """
    n = len(points)
    place = np.stack([points[rng.choice(n, clusters, replace=False)] for _ in range(particles)])
    speed = rng.uniform(-STRIDE, STRIDE, place.shape)
    labels, worth = evaluate(place)
    own, own_worth = place.copy(), worth.copy()
    lead = int(worth.argmin())
    best, best_worth, best_labels = place[lead].copy(), float(worth[lead]), labels[lead].copy()
    for step in range(iterations):
        if flag[0]:
            return best_labels, step, (step + 1) * particles
        inertia = INERTIA[0] + (INERTIA[1] - INERTIA[0]) * step / max(iterations - 1, 1)
        pull = learning * rng.random((2, *place.shape))
        speed = inertia * speed + pull[0] * (own - place) + pull[1] * (best - place)
        np.clip(speed, -STRIDE, STRIDE, out=speed)
        place = np.clip(place + speed, 0.0, 1.0)
        labels, worth = evaluate(place)
        better = worth < own_worth
        own[better], own_worth[better] = place[better], worth[better]
        lead = int(worth.argmin())
        if worth[lead] < best_worth:
            best, best_worth, best_labels = place[lead].copy(), float(worth[lead]), labels[lead]
            best_labels = best_labels.copy()
    return best_labels, iterations, (iterations + 1) * particles


def threaded(
    points: Floats, slack: int, balance: float, threads: int, pool: ThreadPoolExecutor | None,
    flag: Flag,
) -> Evaluation:  # fmt: skip
    """Return the evaluation by compiled loops, on as many parts of the swarm as there are threads.

    A particle's fitness depends on it alone, so the parts do not matter.
    """
    from .clustering_kernels import evaluate

    # Compiled here, before threads call it.
    nobody = np.empty((0, 1, points.shape[1])), np.empty((0, len(points)), np.int64), np.empty(0)
    evaluate(points, nobody[0], slack, balance, *nobody[1:], flag)

    def evaluated(place: Floats) -> tuple[Ints, Floats]:
        labels = np.zeros((len(place), len(points)), np.int64)
        worth = np.empty(len(place))

        def part(first: int, last: int) -> None:
            # The loops run without the interpreter's lock.
            evaluate(
                points,
                place[first:last],
                slack,
                balance,
                labels[first:last],
                worth[first:last],
                flag,
            )

        ends = np.linspace(0, len(place), min(threads, len(place)) + 1).astype(int).tolist()
        others = [] if pool is None else [
            pool.submit(part, *pair) for pair in itertools.pairwise(ends[1:])
        ]  # fmt: skip
        part(0, ends[1] if others else len(place))
        for one in others:
            one.result()
        return labels, worth

    return evaluated


def fitness(
    xp: ModuleType, points: Any, place: Any, numbers: Any, slack: int, balance: float
) -> tuple[Any, Any]:
    """Return labels and fitness of all particles, as :func:`.clustering_kernels.evaluate` does.

    The same array code runs on NumPy and on PyTorch.

    Parameters
    ----------
    xp : module
        ``numpy`` or ``torch``.
    points : array, shape (n, dims)
    place : array, shape (particles, m, dims)
    numbers : array of int, shape (max(n, particles),)
        0, 1, 2, … on the device of the others; n >= m.
    slack : int
    balance : float
    """
    particles = numbers[: place.shape[0]]
    clusters, nodes = numbers[: place.shape[1]], numbers[: points.shape[0]]
    squares = (points[None, :, None, :] - place[:, None, :, :]) ** 2
    total = squares[..., 0]
    for j in range(1, squares.shape[-1]):
        total = total + squares[..., j]
    gaps = xp.sqrt(total)
    labels = xp.argmin(gaps, -1)
    counts = (labels[:, :, None] == clusters).sum(1)
    while True:
        large, small = xp.argmax(counts, -1), xp.argmin(counts, -1)
        due = counts[particles, large] - counts[particles, small] > slack
        if not bool(due.any()):
            break
        change = gaps[particles, :, small] - gaps[particles, :, large]
        chosen = xp.argmin(xp.where(labels == large[:, None], change, math.inf), -1)
        moved = (nodes == chosen[:, None]) & due[:, None]
        labels = xp.where(moved, small[:, None], labels)
        step = due[:, None] * 1
        counts = counts + step * (clusters == small[:, None]) - step * (clusters == large[:, None])
    member = labels[:, :, None] == clusters
    widths = xp.where(member, gaps, 0.0).sum(1)
    whole = widths.sum(-1)
    spread = ((widths - widths.mean(-1)[:, None]) ** 2).mean(-1)
    return labels, whole + balance * xp.sqrt(spread)


def array_evaluation(points: Floats, slack: int, balance: float) -> Evaluation:
    """Return the evaluation as array code on NumPy, for comparison."""

    def evaluated(place: Floats) -> tuple[Ints, Floats]:
        numbers = np.arange(max(len(points), len(place)))
        return fitness(np, points, place, numbers, slack, balance)

    return evaluated


def torch_evaluation(
    points: Floats, slack: int, balance: float, device: str = "cuda"
) -> Evaluation:
    """Return the evaluation as array code on PyTorch's `device`.

    Raises
    ------
    BackendMissing
        PyTorch is not installed.
    UnsupportedOption
        It finds no CUDA device.
    """
    try:
        import torch
    except ImportError as error:
        text = "option device='gpu' needs torch: pip install 'crosstrack[gpu]'"
        raise BackendMissing(text) from error
    if device == "cuda" and not torch.cuda.is_available():
        raise UnsupportedOption("option device='gpu' needs a CUDA device, and torch finds none")
    held = torch.as_tensor(points, device=device)

    def evaluated(place: Floats) -> tuple[Ints, Floats]:
        particles = torch.as_tensor(place, device=device)
        numbers = torch.arange(max(len(points), len(place)), device=device)
        labels, worth = fitness(torch, held, particles, numbers, slack, balance)
        return labels.cpu().numpy(), worth.cpu().numpy()

    return evaluated
