"""Random small tours with optional fields, and their shortest lengths by enumeration.

The enumeration shares no code with the models or the solvers: distances of trees come from NetworkX, and
vehicles move step by step on the grid of integers.
"""

import heapq
import itertools

import numpy as np
from scipy.sparse.csgraph import csgraph_from_dense, dijkstra

from crosstrack.models import GuidedPathTour

#: Fields and combinations that are compared.
CASES = (
    ("end",), ("loads",), ("windows",), ("loop",), ("tree",), ("vehicles",),
    ("end", "loads"), ("end", "windows"), ("loads", "windows"), ("end", "loads", "windows"),
    ("loop", "end", "loads", "windows"), ("tree", "end", "loads", "windows"),
    ("vehicles", "loads"), ("vehicles", "end"), ("vehicles", "windows"),
    ("vehicles", "end", "loads", "windows"),
)  # fmt: skip


def random_relation(rng, count):
    """Return chains and pairs along a random order of the customers."""
    customers = rng.permutation(count) + 1
    ends = np.flatnonzero(rng.random(count - 1) < 0.5) + 1
    chains = [part.tolist() for part in np.split(customers, ends)] if rng.random() < 0.8 else []
    pairs = [pair for pair in itertools.combinations(customers.tolist(), 2) if rng.random() < 0.12]
    return chains, pairs


def random_extended(seed, fields, most=6):
    """Return a random model with these optional fields."""
    rng = np.random.default_rng(seed)
    timed = {"vehicles", "windows"} <= set(fields)
    count = int(
        rng.integers(1, (3 if timed else min(most, 4) if "vehicles" in fields else most) + 1)
    )
    chains, pairs = random_relation(rng, count)
    far = 3 if timed else 4 if "vehicles" in fields else 12
    places = rng.integers(0 if "loop" in fields else -far, far + 1, count + 1)
    options = {"coordinates": places}
    if "loop" in fields:
        options["track"] = {"loop": float(rng.integers(12, 20))}
    if "tree" in fields:
        edges = [
            [int(rng.integers(0, k)), k, int(rng.integers(0, 9))]
            for k in range(1, rng.integers(2, 6))
        ]
        edges = [[b, a, length] if length % 2 else [a, b, length] for a, b, length in edges]
        at = rng.integers(0, len(edges), count + 1)
        options["track"] = {"tree": edges, "at": at}
        options["coordinates"] = [rng.integers(0, edges[k][2] + 1) for k in at]
    if "vehicles" in fields:
        starts = np.sort(rng.integers(-far, far + 1, rng.integers(1, 3 if timed else 4)))
        options["vehicles"] = starts
        options["coordinates"][0] = starts[0]
    if "end" in fields:
        only = "vehicles" in fields or "tree" in fields
        options["end"] = "free" if only or rng.random() < 0.5 else int(rng.integers(0, far))
    if "loads" in fields:
        options["loads"] = [rng.integers(0, 4), *rng.integers(-2, 3, count)]
        if rng.random() < 0.8:
            options["capacity"] = int(rng.integers(options["loads"][0], 7))
    if "windows" in fields:
        speed = float(rng.choice([1.0, 2.0] if timed else [0.5, 1.0, 2.0]))
        early = rng.integers(0, 8 if timed else 40, count + 1) * (rng.random(count + 1) < 0.6)
        late = early + rng.integers(0, 10 if timed else 80, count + 1)
        late = [None if rng.random() < 0.5 else int(x) for x in late]
        if rng.random() < 0.7:
            late[0] = None
        options |= {"speed": speed, "windows": list(zip(early.tolist(), late, strict=True))}
        if rng.random() < 0.6:
            options["service"] = rng.integers(0, 4, count + 1)
    return GuidedPathTour(chains=chains, precedence=pairs or (), **options)


def distances(model):
    """Return the distances between all stops, and from all stops to the end (0 if it is free)."""
    x, track = model.coordinates, model.track
    end = model.end if isinstance(model.end, float) else x[0]

    def way(a, b):
        if track == "line":
            return abs(a - b)
        return min(abs(a - b), track.loop - abs(a - b))

    if track == "line" or track.loop:
        ways = np.array([[way(a, b) for b in x] for a in x])
        home = np.array([way(a, end) for a in x])
    else:
        nodes = 1 + max(node for a, b, _ in track.edges for node in (a, b))
        graph = np.full((nodes + model.size,) * 2, np.inf)
        for e, (a, b, length) in enumerate(track.edges):
            row = sorted((x[k], k) for k in range(model.size) if track.at[k] == e)
            line = [(0.0, a), *((y, nodes + k) for y, k in row), (length, b)]
            for (y, node), (z, other) in itertools.pairwise(line):
                graph[node, other] = graph[other, node] = z - y
        # Zeros of a dense matrix would be missing edges.
        ways = dijkstra(csgraph_from_dense(graph, null_value=np.inf))[nodes:, nodes:]
        home = ways[:, 0]
    return ways, home * (not isinstance(model.end, str))


def windows_of(model):
    size = model.size
    opens = np.zeros(size) if model.windows is None else model.windows[:, 0]
    shuts = np.full(size, np.inf) if model.windows is None else model.windows[:, 1]
    takes = np.zeros(size) if model.service is None else model.service
    return opens, shuts, takes


def best_extended(model):
    """Return the least length over all orders; infinite for an infeasible model."""
    if model.vehicles is not None:
        return best_fleet(model)
    ways, home = distances(model)
    opens, shuts, takes = windows_of(model)
    speed = model.speed or 1.0
    most = np.inf if model.capacity is None else model.capacity
    best = np.inf
    for order in itertools.permutations(range(1, model.size)):
        place = {c: k for k, c in enumerate(order)}
        if any(place[a] > place[b] for a, b in model.pairs):
            continue
        time, load = opens[0] + takes[0], 0.0 if model.loads is None else model.loads[0]
        length, here, fits = 0.0, 0, True
        for c in order:
            length += ways[here, c]
            time = max(time + ways[here, c] / speed, opens[c])
            load += 0.0 if model.loads is None else model.loads[c]
            fits &= time <= shuts[c] and (model.loads is None or 0 <= load <= most)
            time += takes[c]
            here = c
        if fits and time + home[here] / speed <= shuts[0]:
            best = min(best, length + home[here])
    return best


def best_fleet(model):
    """Return the least total length of vehicles on a line, by Dijkstra's algorithm over single steps.

    A state contains the positions and the vehicle of each customer served; -1 is an open customer.
    """
    if model.windows is not None:
        return best_timed_fleet(model)
    starts = tuple(model.vehicles.astype(int).tolist())
    low, high = int(model.coordinates.min()), int(model.coordinates.max())
    todo, seen = [(0, starts, (-1,) * model.size)], set()
    while todo:
        length, at, by = heapq.heappop(todo)
        if (at, by) in seen:
            continue
        seen.add((at, by))
        if min(by[1:]) >= 0 and (model.end == "free" or at == starts):
            return float(length)
        for v, here in enumerate(at):
            for there in (here - 1, here + 1):
                new = (*at[:v], there, *at[v + 1 :])
                if min(low, *starts) <= there <= max(high, *starts) and new == tuple(sorted(new)):
                    heapq.heappush(todo, (length + 1, new, by))
            for c in open_customers(model, by, v, here):
                heapq.heappush(todo, (length, at, (*by[:c], v, *by[c + 1 :])))
    return np.inf


def open_customers(model, by, vehicle, here):
    """Yield the customers at a place that a vehicle may serve now, without regard to time."""
    for c in range(1, model.size):
        if (
            by[c] >= 0
            or model.coordinates[c] != here
            or any(by[a] < 0 for a, b in model.pairs if b == c)
        ):
            continue
        others = {by[d] for chain in model.chains if c in chain for d in chain if d}
        if others <= {-1, vehicle} and carries(model, by, c, vehicle):
            yield c


def best_timed_fleet(model):
    """Return the least total length if vehicles wait, work or move by one metre in each step of time.

    Coordinates and times are integers and the speed is 1 or 2 m/s, so no plan needs shorter steps. A state
    contains the positions, the vehicle of each customer, and per vehicle the customer and the steps left.
    """
    step = 1.0 / model.speed
    starts = tuple(model.vehicles.astype(int).tolist())
    opens, shuts, takes = windows_of(model)
    time = opens[0] + takes[0]
    reach = int(max(model.coordinates.max(), *starts) - min(model.coordinates.min(), *starts))
    ends = max(time, opens.max()) + takes.sum() + 2 * (model.size + 1) * reach * step
    low, high = (int(f([*model.coordinates, *starts])) for f in (min, max))
    states = {(starts, (-1,) * model.size, ((0, 0),) * len(starts)): 0}
    best = np.inf
    while time <= min(ends, shuts[0]) and states:
        todo, current = list(states.items()), dict(states)
        while todo:  # services that begin at this time
            (at, by, busy), length = todo.pop()
            working = [c for c, left in busy if left]
            for v, here in enumerate(at):
                for c in open_customers(model, by, v, here) if not busy[v][1] else ():
                    ready = not any(a in working for a, b in model.pairs if b == c)
                    if ready and opens[c] <= time <= shuts[c]:
                        left = round(takes[c] / step)
                        new = at, (*by[:c], v, *by[c + 1 :]), (*busy[:v], (c, left), *busy[v + 1 :])
                        if length < current.get(new, np.inf):
                            current[new] = length
                            todo.append((new, length))
        states = {}
        for (at, by, busy), length in current.items():
            idle = not any(left for _, left in busy)
            if idle and min(by[1:]) >= 0 and (model.end == "free" or at == starts):
                best = min(best, length)
            moves = [(0,) if left else (-1, 0, 1) for _, left in busy]
            later = tuple((c, left - 1) if left > 1 else (0, 0) for c, left in busy)
            for move in itertools.product(*moves):
                new = tuple(x + d for x, d in zip(at, move, strict=True))
                if new == tuple(sorted(new)) and low <= new[0] and new[-1] <= high:
                    key, way = (new, by, later), length + sum(map(abs, move))
                    if way < min(states.get(key, np.inf), best):
                        states[key] = way
        time += step
    return float(best)


def carries(model, by, customer, vehicle):
    """Return whether the load fits after the service of `customer` by `vehicle`."""
    if model.loads is None:
        return True
    load = model.loads[0] + sum(model.loads[c] for c in range(1, model.size) if by[c] == vehicle)
    return (
        0 <= load + model.loads[customer] <= (np.inf if model.capacity is None else model.capacity)
    )
