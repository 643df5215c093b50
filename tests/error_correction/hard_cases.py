"""Instances that are hard for a search that knows too little: detours, dead ends, chains, ties."""

from __future__ import annotations

import numpy as np

from crosstrack.models import ErrorCorrectionRouting

#: Edges (m) of the box of the detours.
BOX = np.array([1e5, 1e5, 1e4])


def routing(points, draw, threshold, theta, kind=None):
    """Return an instance from the first of `points` to the last, δ = 0.001."""
    kinds = np.where(draw.random(len(points)) < 0.5, "horizontal", "vertical")
    if kind is not None:
        kinds[:] = kind
    kinds[0], kinds[-1] = "A", "B"
    limits = dict.fromkeys(("alpha1", "alpha2", "beta1", "beta2"), threshold)
    return ErrorCorrectionRouting(points, kinds, **limits, theta=theta, delta=1e-3)


def ball(n, theta=48.0, kind=None, seed=0):
    """Points in a ball of 1 km halfway between A and B; with θ = 48 no route reaches B."""
    draw = np.random.default_rng(seed)
    points = draw.normal(size=(n, 3))
    points *= 1e3 * draw.random((n, 1)) ** (1 / 3) / np.linalg.norm(points, axis=1)[:, None]
    points[0], points[-1] = [-5e4, 0, 0], [5e4, 0, 0]
    return routing(points, draw, 52.0, theta, kind)


def wall(n, shape="one", seed=0):
    """Points in a slab outside walls.

    `shape` is ``"one"`` (a wall with a gap at one end), ``"two"`` (two with gaps at opposite ends),
    ``"pocket"`` (A in a pocket that is open away from B) or ``"closed"`` (no gap).
    """
    draw = np.random.default_rng(seed)
    points = draw.random((4 * n, 3)) * BOX
    x, y = points[:, 0], points[:, 1]
    start, threshold = [0.0, 5e4, 5e3], 18.0
    if shape == "one":
        free = (abs(x - 5e4) > 1.2e4) | (y > 9e4)
        threshold = 20.0
    elif shape == "two":
        free = ((abs(x - 3e4) > 1e4) | (y > 9.2e4)) & ((abs(x - 7e4) > 1e4) | (y < 8e3))
    elif shape == "pocket":
        inner = (x > 2e4) & (x < 6e4) & (abs(y - 5e4) < 2e4)
        free = inner | (x < 2e4) | (x > 7.6e4) | (abs(y - 5e4) > 3.6e4)
        start, threshold = [4e4, 5e4, 5e3], 15.0
    else:
        free, threshold = abs(x - 5e4) > 8e3, 15.0
    points = points[free][:n]
    points[0], points[-1] = start, [1e5, 5e4, 5e3]
    return routing(points, draw, threshold, threshold)


def chain(k, seed=0, twins=3, others=2, jitter=0.03, wide=2.1, single=()):
    """`k` clusters in a row; in each the best walk returns to its previous point.

    A cluster has `twins` horizontal points within `jitter` (only one for clusters in `single`) and
    `others` vertical points with arcs from and to these only. Vertical thresholds of `wide` > 2.1 let
    a route skip clusters.
    """
    draw = np.random.default_rng(seed)
    points, kinds = [np.zeros(3)], ["A"]
    for cluster in range(k):
        hub = np.array([cluster + 1.0, 0, 0])
        for kind, at, count in (
            ("horizontal", hub, 1 if cluster in single else twins),
            ("vertical", np.add(hub, [0, 0.45, 0]), others),
        ):
            moves = jitter * draw.uniform(-1, 1, (count, 3))
            moves[0] = 0
            points += list(at + moves)
            kinds += [kind] * count
    return ErrorCorrectionRouting(
        [*points, [k + 1.0, 0, 0]], [*kinds, "B"],
        alpha1=wide, alpha2=0.53, beta1=wide, beta2=1.1, theta=1.7, delta=1.0,
    )  # fmt: skip


def clusters(rows, columns, seed=0):
    """Clusters as of :func:`chain` on a lattice, with many ways through."""
    draw = np.random.default_rng(seed)
    points, kinds = [np.zeros(3)], ["A"]
    for row in range(rows):
        for column in range(columns):
            hub = np.array([column + 1.0, row, 0]) + draw.uniform(-0.05, 0.05, 3)
            points += list(hub + draw.uniform(-0.03, 0.03, (2, 3)))
            points += list(np.add(hub, [0, 0, 0.45]) + draw.uniform(-0.03, 0.03, (2, 3)))
            kinds += ["horizontal", "horizontal", "vertical", "vertical"]
    return ErrorCorrectionRouting(
        [*points, [columns + 1.0, rows - 1.0, 0]], [*kinds, "B"],
        alpha1=2.1, alpha2=0.53, beta1=2.1, beta2=1.15, theta=1.7, delta=1.0,
    )  # fmt: skip


def wild(seed):
    """A small instance of one of six kinds: few enough points to try every route.

    A lattice with ties and duplicates; three spots with points within 0, 1e-6 or 1e-2 of each; hubs
    that a walk must return to; a line; any points; a chain of clusters. Rates and thresholds may be 0.
    """
    draw = np.random.default_rng(seed)
    kind, n = seed % 6, int(draw.integers(3, 9))
    revisits = bool(draw.random() < 0.3)
    if kind == 5:
        model = chain(
            int(draw.integers(1, 4)), seed, int(draw.integers(1, 3)), 1, draw.choice([0, 0.01, 0.1])
        )
        limits = np.array([2.1, 0.53, 2.1, 1.1, 1.7]) * (1 + draw.uniform(-0.05, 0.15, 5))
        scale = 10.0 ** draw.integers(0, 7)
        order = draw.permutation(len(model.points))
        return ErrorCorrectionRouting(
            model.points[order] * scale, model.kinds[order], *(limits * scale), delta=1.0,
            revisits=revisits,
        )  # fmt: skip
    if kind == 0:
        points = draw.integers(0, 4, (n, 3)) * [1.0, 1.0, 0.0]
    elif kind == 1:
        points = np.repeat(draw.random((3, 3)), 3, axis=0)[:n]
        points += draw.choice([0, 1e-6, 1e-2]) * draw.random((n, 3))
    elif kind == 2:
        hubs = int(draw.integers(1, 3))
        twins = int(draw.integers(0, 3))
        spots = np.array([[1, 0, 0], [1, 0.5, 0]])
        points = np.vstack(
            [
                [[0, 0, 0]],
                *(np.add(spots, [2.2 * k, 0, 0]) for k in range(hubs)),
                spots[:1] + draw.uniform(-0.05, 0.05, (twins, 3)),
                [[2.2 * hubs, 0, 0]],
            ]
        )
        points += draw.choice([0, 0.02]) * draw.uniform(-1, 1, points.shape)
        kinds = ["A", *["horizontal", "vertical"] * hubs, *["horizontal"] * twins, "B"]
        limits = np.array([1.6, 1.6, 1.6, 1.6, 1.75]) + draw.uniform(-0.05, 0.1, 5)
        return ErrorCorrectionRouting(points, kinds, *limits, delta=1.0, revisits=revisits)
    else:
        points = draw.random((n, 3)) * ([1, 0, 0] if kind == 3 else [1, 0.6, 0.6])
    kinds = np.where(draw.random(n) < 0.5, "horizontal", "vertical")
    kinds[draw.choice(n, 2, replace=False)] = ["A", "B"]
    limits = max(np.ptp(points, axis=0).max(), 1e-3) * draw.choice([0.5, 0.7, 0.9, 1.2])
    limits = limits * draw.choice([1, 1, 1, 0.8, 1.25, 0 if draw.random() < 0.1 else 1], 5)
    if draw.random() < 0.5:
        limits = np.round(limits, 1)
    rates = draw.choice([1, 1, 1, 0.5, 0, 1.3], 2)
    return ErrorCorrectionRouting(
        points, kinds, *limits, horizontal_rate=rates[0], vertical_rate=rates[1], revisits=revisits
    )
