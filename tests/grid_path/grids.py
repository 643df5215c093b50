"""Maps for tests, reference paths by SciPy's graph algorithms, and MovingAI's files."""

from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra, minimum_spanning_tree

from crosstrack.models import GridPath
from crosstrack.models.grid_path import GridMap

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "movingai"

#: Maps with their scenarios.
SCENARIOS = {
    "arena": "arena.map.scen",
    "den312d": "den312d.map.scen",
    "den520d": "den520d.map.scen",
    "maze-32-32-2": "maze-32-32-2-random-1.scen",
    "maze512-8-0": "maze512-8-0.map.scen",
    "random-64-64-20": "random-64-64-20-random-1.scen",
    "room-32-32-4": "room-32-32-4-random-1.scen",
}


def movingai(name):
    """Return a map, and its scenarios as (start, goal, optimal length as printed)."""
    if not DATA.is_dir():
        pytest.skip(f"MovingAI's maps are not at {DATA}")
    lines = (DATA / f"{name}.map").read_text("ascii").splitlines()
    rows = [line.split() for line in (DATA / SCENARIOS[name]).read_text("ascii").splitlines()[1:]]
    cases = [
        ((int(y), int(x)), (int(v), int(u)), length)
        for *_, x, y, u, v, length in filter(None, rows)
    ]
    return GridMap(lines[4:]), cases


def as_printed(length, printed):
    """Whether `length` is what was printed, with six significant digits or eight decimals.

    The printed values had been summed in floats of 4 bytes, or with too few digits of √2, so that the
    last digit may be rounded the wrong way. Other lengths of paths so short differ by more.
    """
    if len(printed.partition(".")[2]) == 8:
        return abs(length - float(printed)) <= 1e-7
    return abs(length - float(printed)) <= 0.55 * 10.0 ** (np.floor(np.log10(length)) - 5)


def graph(grid, diagonal=True, weights=None):
    """Return all steps between neighbours as a sparse matrix over all cells; costs in m."""
    free = ~grid.blocked
    number = np.arange(free.size).reshape(free.shape)
    weight = np.ones(free.size) if weights is None else np.asarray(weights).ravel()
    entries = []
    for row, column in ((0, 1), (1, 0), (1, 1), (1, -1))[: 4 if diagonal else 2]:
        rows, columns = free.shape
        a = (slice(0, rows - row), slice(max(0, -column), columns - max(0, column)))
        b = (slice(row, rows), slice(max(0, column), columns + min(0, column)))
        opened = free[a] & free[b] & free[a[0], b[1]] & free[b[0], a[1]]
        tail, head = number[a][opened], number[b][opened]
        entries.append(
            (np.hypot(row, column) * grid.cell * 0.5 * (weight[tail] + weight[head]), tail, head)
        )
    cost, tail, head = (np.concatenate(part) for part in zip(*entries, strict=True))
    return coo_array((cost, (tail, head)), shape=(free.size, free.size)).tocsr()


def costs(model):
    """Return the cost to each goal by SciPy, infinite without a path."""
    known = graph(model.map, model.connectivity == "8", model.weights)
    columns = model.map.shape[1]
    far = dijkstra(known, directed=False, indices=int(model.start @ [columns, 1]))
    return far[model.goals @ [columns, 1]]


def optimum(model):
    """Return the minimum objective by SciPy, infinite without a plan."""
    found = costs(model)
    return float(found.sum() if model.reach == "each" else found.min())


def keeps_the_rules(blocked, cells, diagonal=True):
    """Return whether cells, shape (k, 2), are free and consecutive without cutting corners."""
    steps = np.diff(cells, axis=0)
    a, b = cells[:-1], cells[1:]
    beside = blocked[a[:, 0], b[:, 1]] | blocked[b[:, 0], a[:, 1]]
    longest = 2 if diagonal else 1
    return bool(
        not blocked[tuple(cells.T)].any()
        and (abs(steps).max(axis=1, initial=0) <= 1).all()
        and ((abs(steps).sum(axis=1) >= 1) & (abs(steps).sum(axis=1) <= longest)).all()
        and not beside.any()
    )


def maze(size, seed, loops=0.0):
    """Return a maze of corridors one cell wide, without a share of further walls.

    The corridors are a random tree over every other cell, so without `loops` two cells are joined by
    one path.
    """
    rng = np.random.default_rng(seed)
    half = (size + 1) // 2
    number = np.arange(half * half).reshape(half, half)
    pairs = np.vstack(
        [
            np.column_stack([number[:, :-1].ravel(), number[:, 1:].ravel()]),
            np.column_stack([number[:-1].ravel(), number[1:].ravel()]),
        ]
    )
    lattice = coo_array((rng.random(len(pairs)) + 0.01, pairs.T), shape=(half * half, half * half))
    tree = minimum_spanning_tree(lattice.tocsr()).tocoo()
    opened = np.vstack([np.column_stack(tree.coords), pairs[rng.random(len(pairs)) < loops]])
    blocked = np.ones((2 * half - 1, 2 * half - 1), bool)
    blocked[::2, ::2] = False
    ends = np.stack(np.divmod(opened, half), axis=-1)
    blocked[tuple(ends.sum(axis=1).T)] = False
    return blocked


def serpentine(size):
    """Return a map with one serpentine corridor."""
    blocked = np.zeros((size, size), bool)
    blocked[1::4, :-1] = blocked[3::4, 1:] = True
    return blocked


def small(seed):
    """Return a small model: scattered walls, mazes, one free cell, ties, duplicates, wild weights."""
    rng = np.random.default_rng(seed)
    rows, columns = rng.integers(1, 12, 2)
    kind = rng.integers(5)
    blocked = rng.random((rows, columns)) < (0.0, 0.25, 0.45, 0.5, 1.0)[kind]
    if kind == 3:
        blocked = maze(int(max(rows, columns)), seed, loops=0.2)
    blocked[tuple(rng.integers(blocked.shape))] = False
    free = np.argwhere(~blocked)
    goals = free[rng.integers(len(free), size=rng.integers(1, 5))]
    weights = None
    if rng.random() < 0.4:
        # Powers of ten up to a ratio of 1e6, or few values and so many ties.
        weights = 10.0 ** (
            rng.uniform(-3, 3, blocked.shape)
            if rng.random() < 0.5
            else rng.integers(0, 2, blocked.shape)
        )
    return GridPath(
        GridMap(blocked, cell=10.0 ** rng.integers(-3, 4), origin=rng.uniform(-5, 5, 2)),
        free[rng.integers(len(free))],
        np.vstack([goals, goals[:1]]) if rng.random() < 0.3 else goals,
        connectivity=str(rng.choice(["4", "8"])),
        reach=str(rng.choice(["nearest", "each"])),
        weights=weights,
    )
