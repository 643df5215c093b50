"""Random small rich fleets with every feature."""

import dataclasses

import numpy as np

from crosstrack.models import FleetRouting
from crosstrack.models.fleet.features import FEATURES
from crosstrack.solvers.contract.registry import find_backend

#: Fields in units of length, time or cost.
SCALED = (
    "times", "service", "releases", "shifts", "max_duration", "battery", "fixed_cost", "prizes",
)  # fmt: skip


def scaled(model, factor):
    """Return the model with lengths, times and costs multiplied by `factor`."""
    names = [*SCALED, "points" if model.costs is None else "costs"]
    fields = {name: factor * array for name in names if (array := getattr(model, name)) is not None}
    if model.windows is not None:
        fields["windows"] = [
            spans and [(factor * a, factor * b) for a, b in spans] for spans in model.windows
        ]
    return dataclasses.replace(model, **fields)


def supported(name, seeds, **options):
    """Yield the random models of `seeds` that the backend `name` accepts."""
    backend = find_backend(name)
    for seed in seeds:
        model = random_rich(np.random.default_rng(seed), **options)
        if not backend.refuses(model):
            yield model.renamed(f"rich-{seed}")


def random_rich(rng, features=None, customers=None):
    """Return a random small rich model; `features` limits it to these fields and objectives.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of the numbers.
    features : collection of str, optional
        Allowed members of ``crosstrack.models.fleet.features.FEATURES``; all by default.
    customers : int, optional
        Number of nodes to visit; 2 to 4 by default.
    """
    allowed = set(FEATURES if features is None else features)

    def draw(name, share=0.35):
        return name in allowed and rng.random() < share

    n = int(rng.integers(2, 5)) if customers is None else customers
    m = int(rng.integers(1, 4))
    several = rng.random() < 0.3
    depots = [int(x) for x in rng.integers(0, 2, m)] if several else [0]
    first = 2 if several else 1
    data = {"vehicles": m, "depots": depots if several else 0}
    extra = 0
    if draw("reloads", 0.25):
        data["reloads"] = [0] if rng.random() < 0.5 else [first + n]
        extra += data["reloads"] != [0]
        data["max_reloads"] = [1] * m if "max_reloads" in allowed else None
    if draw("stations", 0.2):
        data["stations"] = [first + n + extra]
        extra += 1
    size = first + n + extra
    nodes = list(range(first, first + n))
    if len(set(depots)) < first:  # a depot of no vehicle would be a node to visit
        nodes = [x for x in range(first + n) if x not in {*depots, *data.get("reloads", ())}]
    points = rng.integers(0, 11, (size, 2)).astype(float)
    if rng.random() < 0.3:
        data["costs"] = np.rint(rng.random((size, size)) * 10) * (1 - np.eye(size))
    else:
        data["points"] = points
    objectives = ["sum", "max"] + [name for name in ("cost", "makespan") if name in allowed]
    data["objective"] = str(rng.choice(objectives))
    if draw("times"):
        data["times"] = np.rint(rng.random((size, size)) * 10) * (1 - np.eye(size))
    if draw("speed"):
        data["speed"] = rng.choice([0.5, 1.0, 2.0], m)
    if draw("service"):
        data["service"] = rng.integers(0, 4, size).astype(float)
    if draw("windows", 0.5):
        data["windows"] = [_random_window(rng) if x in nodes or rng.random() < 0.2 else None
                           for x in range(size)]  # fmt: skip
    if draw("releases"):
        data["releases"] = rng.integers(0, 12, size).astype(float)
    _random_loads(rng, data, draw, nodes, size)
    if data["objective"] == "cost":
        for name in ("fixed_cost", "distance_cost", "time_cost"):
            if draw(name, 0.5):
                data[name] = rng.integers(0, 6, m).astype(float)
        if draw("prizes", 0.5):
            data["prizes"] = [
                float(rng.integers(0, 25)) if rng.random() < 0.6 else None for _ in range(size)
            ]
    if draw("shifts"):
        begin = rng.integers(0, 6, m)
        data["shifts"] = np.column_stack([begin, begin + rng.integers(15, 70, m)]).astype(float)
    if draw("max_duration"):
        data["max_duration"] = rng.integers(15, 60, m).astype(float)
    if draw("ends"):
        data["ends"] = [int(rng.choice([-1, depots[0]])) for _ in range(m)]
    if draw("requires"):
        data["requires"] = [["a"] if rng.random() < 0.3 else [] for _ in range(size)]
        data["skills"] = [["a", "b"] if rng.random() < 0.6 else ["b"] for _ in range(m)]
    if draw("groups") and len(nodes) > 2:
        group = nodes[-2:]
        if "prizes" in data and len({data["prizes"][x] is None for x in group}) > 1:
            data["prizes"][group[0]] = data["prizes"][group[1]] = 5.0
        if "pairs" not in data or len(nodes) > 3:
            data["groups"] = [group]
    if rng.random() < 0.3 or "stations" in data:
        data["battery"] = rng.integers(12, 40, m).astype(float)
    free = len(nodes) > 2 and not {"pairs", "groups"} & data.keys()
    if "ends" in data and free and rng.random() < 0.3:
        data["ends"][0] = nodes[-1]
    return FleetRouting(use_all=False, **{k: v for k, v in data.items() if v is not None})


def _random_loads(rng, data, draw, nodes, size):
    m = data["vehicles"]
    width = 2 if draw("dimensions", 0.3) else 1
    shape = (size,) if width == 1 else (size, width)
    if rng.random() < 0.6 or "reloads" in data:
        data["demands"] = rng.integers(0, 4, shape).astype(float)
        data["capacity"] = rng.integers(3, 9, (m,) if width == 1 else (m, width)).astype(float)
        if draw("pickups"):
            data["pickups"] = rng.integers(0, 4, shape).astype(float)
            if draw("backhauls"):
                data["backhauls"] = True
            elif len(nodes) > 2 and draw("pairs", 0.5):
                data["pairs"] = [nodes[:2]]


def _random_window(rng):
    a, b = sorted(rng.integers(0, 40, 2).tolist())
    if rng.random() < 0.3:
        return [(a, b), (b + 3, b + 3 + int(rng.integers(0, 20)))]
    return None if rng.random() < 0.2 else (a, b + 5)
