"""Readings of eq. 18-21 on bayg29 against the printed optimum and worst value of PSO-AC.

Each reading turns three centres into three clusters. A random descent moves the centres, and the fitness is
the sum of the shortest tours of the clusters, so that neither swarm nor ants matter. Writes the table
"readings" of ``docs/measured/fleet.json``: ``python tests/benchmarks/fleet/readings.py``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numba
import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.measured import write  # noqa: E402

from crosstrack.instances.fleet.paper_tables import table_2_model, tsplib_file  # noqa: E402
from crosstrack.solvers.fleet.swarm import move_centres, reclassify  # noqa: E402

BEST, WORST = 10403.2, 10706.1
STARTS, STEPS, MOST = 40, 250, 13


@numba.njit
def shortest(d, nodes):
    """Return the length of the shortest tour from node 0 through `nodes`, by Held and Karp."""
    k = len(nodes)
    ways = np.full((1 << k, k), np.inf)
    for i in range(k):
        ways[1 << i, i] = d[0, nodes[i]]
    for s in range(1, 1 << k):
        for i in range(k):
            for j in range(k):
                if not s >> j & 1 and ways[s, i] + d[nodes[i], nodes[j]] < ways[s | 1 << j, j]:
                    ways[s | 1 << j, j] = ways[s, i] + d[nodes[i], nodes[j]]
    return min([ways[(1 << k) - 1, i] + d[nodes[i], 0] for i in range(k)])


def beyond(points, centres, weights, share, labels):
    """Classify as `reclassify`, but stop a centre after its sum has reached the share, not before."""
    labels[:] = -1
    for k in range(len(centres)):
        taken = 0.0
        for i in np.argsort(np.hypot(*(points - centres[k]).T), kind="stable"):
            if labels[i] < 0 and (taken < share or k == len(centres) - 1):
                labels[i] = k
                taken += weights[i]


def in_turn(points, centres, weights, share, labels):
    """Classify the pairs of a sample and a centre by their distance, as long as the share allows."""
    gaps = np.hypot(*(points[:, None] - centres[None]).transpose(2, 0, 1))
    labels[:], taken = -1, np.zeros(len(centres))
    for i, k in zip(*np.unravel_index(np.argsort(gaps, axis=None), gaps.shape), strict=True):
        if labels[i] < 0 and taken[k] + weights[i] <= share:
            labels[i] = k
            taken[k] += weights[i]
    labels[labels < 0] = gaps[labels < 0].argmin(axis=1)


def row(d, points, classify, weights, whole, moved):
    """Return the least sum, and how many descents end at the printed best and worst value."""
    rng, known, ends = np.random.default_rng(1), {}, []
    labels = np.empty(len(points), np.int64)
    for _ in range(STARTS):
        centres, least = points[rng.choice(len(points), 3, replace=False)], np.inf
        for step in range(STEPS):
            trial = centres.copy()
            if step:
                trial[rng.integers(3)] += 10 ** rng.uniform(0.5, 3.0) * rng.normal(size=2)
            place = trial.copy()
            classify(points, place, weights, whole / 3, labels)
            if moved:
                place = move_centres(points, labels, place)
                classify(points, place, weights, whole / 3, labels)
            total = 0.0
            for k in range(3):
                nodes = np.flatnonzero(labels == k) + 1
                key = nodes.tobytes()
                if key not in known:
                    fits = 0 < len(nodes) <= MOST
                    known[key] = shortest(d, nodes) if fits else np.inf
                total += known[key]
            if total <= least:
                centres, least = trial, total
        ends.append(round(least, 1))
    return min(ends), ends.count(BEST), ends.count(WORST)


def main() -> None:
    """Measure all readings."""
    model = table_2_model(tsplib_file("bayg29"))
    d, points = np.array(model.distances), np.array(model.points[1:])
    energy, ones = d[1:].sum(axis=1), np.ones(len(points))
    weights = {"energies": (energy, energy.sum()), "nodes": (ones, ones.sum())}
    rules = {
        "": (reclassify, False),
        ", centres moved before the fitness": (reclassify, True),
        ", a centre stops after its share": (beyond, False),
        ", pairs of sample and centre by distance": (in_turn, False),
    }
    rows = [
        (f"{kind}{name}", *row(d, points, rule, weight, whole, moved))
        for kind, (weight, whole) in weights.items()
        for name, (rule, moved) in rules.items()
    ]
    whole = energy.sum() + d[0].sum()
    rows.insert(1, ("energies, start in R", *row(d, points, reclassify, energy, whole, False)))
    write(
        "fleet", "readings", __file__,
        {"reading": "", "least sum": ".1f", f"ends at {BEST}": "d", f"ends at {WORST}": "d"}, rows,
        said=f"{STARTS} random descents of {STEPS} steps each on bayg29, three robots, tours by dynamic "
        f"programming. Printed: best {BEST}, worst {WORST}.",
    )  # fmt: skip


if __name__ == "__main__":
    main()
