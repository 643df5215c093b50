"""Small random routes with resources, and their optima by enumeration of all states."""

import heapq
import math

import numpy as np

from crosstrack.models import Resource, ResourceRouting

WORDS = ("depot", "stop", "well", "gate")


def random_model(rng, *, revisits):
    """Return a model of whole numbers, so that all sums are exact: ties, zeros, any resets."""
    hard = rng.random() < 0.8  # each resource limited everywhere, and reset somewhere
    count = int(rng.integers(5 if hard else 3, 9))
    kinds = rng.choice(WORDS[: int(rng.integers(2 if hard else 1, 5))], count).tolist()
    words = sorted(set(kinds))

    def some(share, most):
        least = most // 3
        return {w: int(rng.integers(least, most + 1)) for w in words if rng.random() < share}

    resources = [
        Resource(
            f"r{k}",
            rate=int(rng.integers(0 if k % 2 else hard, 3)),
            initial=int(rng.integers(0, 4)),
            limits=some(1.0 if hard else 0.7, 12),
            gains=some(0.2, 2),
            resets=some(0.5 if hard else 0.3, 2),
        )
        for k in range(int(rng.integers(hard, 4)))
    ]
    start, end = rng.permutation(count)[:2].tolist()
    data = {}
    if rng.random() < 0.5:
        # On a line, distances are whole.
        data["points"] = [[int(x)] for x in rng.integers(0, 9, count)]
    if not data or rng.random() < 0.5:
        share = rng.choice([0.0, 0.05, 0.5])
        # A tree in both directions: a walk that leaves the path has to return to it.
        tree = {(i, int(rng.integers(0, i))) for i in range(1, count)}
        pairs = [[i, j] for i in range(count) for j in range(count) if i != j]
        arcs = [
            pair
            for pair in pairs
            if rng.random() < share or {tuple(pair), tuple(pair[::-1])} & tree
        ]
        data["arcs"] = arcs
        if "points" not in data or rng.random() < 0.5:
            data["lengths"] = rng.integers(0, 4, len(arcs))
        if rng.random() < 0.5:
            data["uses"] = rng.integers(0, 3, (len(arcs), len(resources)))
    return ResourceRouting(kinds, resources, start, end, revisits=revisits, **data)


def neighbours(model):
    """Return of every point what it leads to: the head, the length and the uses."""
    count = len(model.kinds)
    found = {i: [] for i in range(count)}
    pairs = (
        [(i, j) for i in range(count) for j in range(count) if i != j]
        if model.arcs is None
        else model.arcs.tolist()
    )
    for row, (i, j) in enumerate(pairs):
        length = (
            math.dist(model.points[i], model.points[j])
            if model.lengths is None
            else float(model.lengths[row])
        )
        uses = [0.0] * len(model.resources) if model.uses is None else model.uses[row].tolist()
        found[i].append((j, length, uses))
    return found


def least_length(model):
    """Return the length of the best route, inf without one: every state once, without dominance."""
    leads = neighbours(model)
    # Levels above every limit of a resource are equivalent.
    ceilings = [max(dict(r.limits).values(), default=-1.0) + 1.0 for r in model.resources]
    initial = tuple(min(r.initial, c) for r, c in zip(model.resources, ceilings, strict=True))
    tables = [(dict(r.limits), dict(r.gains), dict(r.resets)) for r in model.resources]
    heap = [(0.0, model.start, initial, frozenset())]
    done = set()
    while heap:
        length, here, levels, seen = heapq.heappop(heap)
        if here == model.end:
            return length
        if (here, levels, seen) in done:
            continue
        done.add((here, levels, seen))
        for there, leg, uses in leads[here]:
            if there == model.start or (not model.revisits and there in seen):
                continue
            word, left = model.kinds[there], []
            for k, (limits, gains, resets) in enumerate(tables):
                level = levels[k] + model.resources[k].rate * leg + uses[k] + gains.get(word, 0.0)
                if level > limits.get(word, math.inf):
                    break
                left.append(min(level, resets.get(word, math.inf), ceilings[k]))
            else:
                after = seen if model.revisits else seen | {there}
                heapq.heappush(heap, (length + leg, there, tuple(left), after))
    return math.inf


def rng_of(seed):
    return np.random.default_rng([16, seed])


def random_branches(rng, *, revisits):
    """Return a chain of hubs with wells beside it, to which the way leads back, or on by longer arcs."""
    hubs = int(rng.integers(2, 4))
    kinds, pairs = ["depot"], []
    for hub in range(1, hubs + 1):
        kinds.append(str(rng.choice(["stop", "stop", "gate"])))
        pairs.append((hub - 1, hub))
    last = hubs + 1
    kinds.append("depot")
    pairs.append((hubs, last))
    for hub in rng.integers(1, hubs + 1, int(rng.integers(2, 5))).tolist():
        well = len(kinds)
        kinds.append(str(rng.choice(["well", "well", "gate"])))
        pairs += [(hub, well), (well, hub)]
        pairs += [(well, there) for there in range(1, last + 1) if rng.random() < 0.25]
    arcs = sorted(set(pairs))
    words = sorted(set(kinds))
    resources = [
        Resource(
            f"r{k}",
            rate=1,
            limits={w: int(rng.integers(4, 8)) for w in words},
            resets={w: int(rng.integers(0, 2)) for w in words if w == ("well", "gate")[k]},
        )
        for k in range(int(rng.integers(1, 3)))
    ]
    lengths = rng.integers(0, 4, len(arcs))
    return ResourceRouting(kinds, resources, 0, last, arcs=arcs, lengths=lengths, revisits=revisits)
