"""Comparison with other packages from PyPI, for the tables of ``docs/how-well.md``.

``python tests/benchmarks/peers.py`` measures everything within some minutes and writes
``docs/measured/peers.json``; ``peers.py grid-path fleet`` measures these problems alone. It requires the extra
``benchmark``, and the public maps and TSPLIB files that the tests read. Each problem runs in a separate process.

Times are medians of whole calls on fresh models, after one that loads and compiles. If a call takes long,
only one is timed. Our times include the verification. Every peer's plan is verified in the same way, untimed.
"""

from __future__ import annotations

import math
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from scipy.interpolate import BSpline, PPoly

HERE = Path(__file__).resolve()
sys.path[:0] = [str(HERE.parents[1])]

from benchmarks.attractor.test_speed import load_nolds  # noqa: E402
from benchmarks.error_correction import cspy_peer  # noqa: E402
from benchmarks.fleet.test_min_max import DATA  # noqa: E402
from benchmarks.grid_path import test_grid_speed as grids  # noqa: E402
from benchmarks.measured import write  # noqa: E402
from benchmarks.minimum_snap import test_trajectory_rivals as rivals  # noqa: E402
from benchmarks.resource_routing import labelling_peer  # noqa: E402

import crosstrack as ct  # noqa: E402
from crosstrack.instances.fleet import read_tsplib  # noqa: E402
from crosstrack.jit import compile_always  # noqa: E402
from crosstrack.models import AttractorAnalysis, FleetRouting, GridPath  # noqa: E402
from crosstrack.models.attractor import AttractorEstimate, Slope  # noqa: E402

#: Largest number of timed calls, and total time (s) after which no further call starts.
REPEATS, LONG = 9, 0.5
#: Time limit (s) of cspy, and time (s) of each search for a fleet's routes.
PATIENCE, SEARCH = 60.0, 5.0
#: Number of scenarios of a map, and seeds of a search.
SCENARIOS, SEEDS = 9, range(3)
#: Longest distance for PyVRP and OR-Tools, which use integers. PyVRP's penalties require small ones.
LARGEST = 20_000

Row = tuple[Any, ...]
Rows = Iterator[Row]
COLUMNS = {
    "instance": "", "package": "", "objective": ".9g", "seconds": ".2g", "times ours": ".4g",
    "our check": "",
}  # fmt: skip


def timed(call: Callable[[Any], Any], fresh: Callable[[], Any]) -> tuple[float, Any]:
    """Return the median time (s) of a call after one that loads and compiles, and the last answer."""
    call(fresh())
    spent: list[float] = []
    while not spent or (len(spent) < REPEATS and sum(spent) < LONG):
        model = fresh()
        begin = time.perf_counter()
        found = call(model)
        spent.append(time.perf_counter() - begin)
    return median(spent), found


def checked(model: Any, plan: Any) -> tuple[float | None, str]:
    """Return the objective of a plan by our check, and what the check says."""
    if plan is None:
        return None, "no plan"
    found = model.verify(model.as_plan(plan))
    return found.objective, "accepted" if found.ok else "rejected"


def beside(
    problem: str,
    names: str,
    peers: Mapping[str, Callable[[Any], Any]],
    read: Callable[[Any, Any], Any] = lambda model, found: found,
) -> Rows:
    """Yield the rows of instances: of ``ct.solve`` with defaults, and of peers; `read` makes plans of their answers."""
    for name in names.split():
        fresh = partial(ct.load, f"{problem}/{name}")
        model = fresh()
        ours, found = timed(ct.solve, fresh)
        label = f"crosstrack, `{found.backend}`"
        yield model.name, label, found.primal_bound, ours, None, checked(model, found)[1]
        for peer, call in peers.items():
            seconds, answer = timed(call, fresh)
            objective, word = checked(model, read(model, answer))
            yield model.name, peer, objective, seconds, seconds / ours, word


def error_correction() -> Rows:
    """Yield rows beside cspy."""
    return beside(
        "error-correction", "6 7 8 9 10 11 12",
        {"cspy": lambda model: cspy_peer.run(model, time_limit=PATIENCE).plan},
    )  # fmt: skip


def resource_routing() -> Rows:
    """Yield rows beside cspy."""
    return beside(
        "resource-routing", "plain network-5 network-20 network-20-again network-40",
        {"cspy": lambda model: labelling_peer.run(model, PATIENCE)[0]},
    )  # fmt: skip


def minimum_snap() -> Rows:
    """Yield rows beside minsnap-trajectories, and SciPy's spline."""

    def pieces(model: Any, found: Any) -> Any:
        if isinstance(found, BSpline):
            powers = [found(model.times[:-1], k) / math.factorial(k) for k in range(8)]
        else:
            powers = np.asarray(found.coefficients).transpose(1, 0, 2)
        return PPoly(powers[::-1], model.times)

    peers = {"minsnap-trajectories": rivals.peer, "SciPy, `make_interp_spline`": rivals.spline}
    yield from beside("minimum-snap", "figure-eight helix random-10 random-100", peers, pieces)
    del peers["minsnap-trajectories"]  # its matrices are dense
    yield from beside("minimum-snap", "random-1000", peers, pieces)


def grid_path() -> Rows:
    """Yield rows of a map: sums over its scenarios, and the median seconds."""
    for name in ("arena", "random-64-64-20", "den520d", "maze512-8-0"):
        grid, cases = grids.movingai(name)
        cases = [case for case in cases if float(case[2]) > 0]
        cases = cases[:: max(1, len(cases) // SCENARIOS)]
        compiled, plain = grids.peers(grid)
        solve = lambda a, b, grid=grid: ct.solve(GridPath(grid, a, b)).plan.paths[0]  # noqa: E731
        searches = {
            "crosstrack, `a-star`": solve,
            "the same without our check": grids.ours(grid, cases)["a-star"],
            **compiled,
            **plain,
        }
        ours = None
        for package, search in searches.items():
            spent, length, passed = [], 0.0, 0
            for start, goal, _ in cases:
                seconds, path = timed(lambda _, s=search, a=start, b=goal: s(a, b), lambda: None)
                points = np.asarray(path)
                points = grid.centres(points) if points.dtype.kind == "i" else points
                plan = {"paths": [points.tolist()]}
                spent.append(seconds)
                passed += checked(GridPath(grid, start, goal), plan)[1] == "accepted"
                length += float(np.hypot(*np.diff(points, axis=0).T).sum())
            middle = median(spent)
            ratio = middle / ours if ours else None
            ours = ours or middle
            yield name, package, length, middle, ratio, f"{passed} of {len(cases)} accepted"


def by_nolds(model: AttractorAnalysis, slope: Slope, told: Mapping[str, int]) -> float:
    """Return the figure of nolds in the same embedding and region."""
    nolds = load_nolds()
    same = {"emb_dim": told["dimension"], "lag": told["delay"], "fit": "poly"}
    if slope.method == "correlation":
        radii = np.geomspace(slope.low, slope.high, 16)
        return nolds.corr_dim(
            model.series, rvals=radii, dist=nolds.measures.rowwise_chebyshev, **same
        )
    return nolds.lyap_r(
        model.series, min_tsep=told["theiler"], tau=model.period,
        trajectory_len=int(slope.high) + 1, fit_offset=int(slope.low), **same,
    )  # fmt: skip


def attractor() -> Rows:
    """Yield rows beside nolds."""
    for name, delay, dimension, theiler in (
        ("logistic", 1, 1, 1), ("henon", 1, 2, 1), ("lorenz", 8, 3, 50), ("rossler", 13, 3, 60),
    ):  # fmt: skip
        fresh, model = partial(ct.load, f"attractor/{name}"), ct.load(f"attractor/{name}")
        told = {"delay": delay, "dimension": dimension, "theiler": theiler}
        for figure, field, backend in (
            ("exponent", "exponent", "rosenstein"),
            ("dimension", "correlation", "correlation-dimension"),
        ):
            ours, found = timed(partial(ct.solve, backend=backend, backend_options=told), fresh)
            slope = getattr(found.plan, field)
            seconds, value = timed(partial(by_nolds, slope=slope, told=told), fresh)
            claim = {field: Slope(slope.method, value, 0.0, slope.low, slope.high)}
            for package, amount, spent, ratio, plan in (
                (f"crosstrack, `{backend}`", slope.value, ours, None, found),
                ("nolds", value, seconds, seconds / ours, AttractorEstimate(**told, **claim)),
            ):
                word = checked(model, plan)[1]
                known = getattr(model, f"true_{figure}")
                yield model.name, figure, known, package, amount, spent, ratio, word


def whole(model: FleetRouting) -> list[list[int]]:
    """Return distances in whole numbers."""
    distances = model.distances
    return np.rint(distances * (LARGEST / distances.max())).astype(int).tolist()


def with_pyvrp(model: FleetRouting, seed: int) -> dict[str, Any] | None:
    """Return routes by PyVRP as its users call it; it knows the sum alone."""
    from pyvrp import Model
    from pyvrp.stop import MaxRuntime

    if model.demands is None or model.capacity is None:
        return None
    stated = Model()
    places = [stated.add_location(*point) for point in model.points.tolist()]
    stated.add_depot(places[0])
    for place, demand in zip(places[1:], model.demands[1:].tolist(), strict=True):
        stated.add_client(place, int(demand))
    stated.add_vehicle_type(model.vehicles, int(model.capacity[0]))
    for i, row in enumerate(whole(model)):
        for j, length in enumerate(row):
            stated.add_edge(places[i], places[j], length)
    best = stated.solve(MaxRuntime(SEARCH), seed, collect_stats=False, display=False).best
    routes = [[stop.idx + 1 for stop in route if stop.is_client()] for route in best.routes()]
    return {"routes": routes + [[]] * (model.vehicles - len(routes))}


def with_ortools(model: FleetRouting, seed: int) -> dict[str, Any] | None:
    """Return routes by OR-Tools' routing library as its users call it; it draws nothing."""
    from ortools.constraint_solver import pywrapcp, routing_enums_pb2

    assert "highspy" not in sys.modules  # each brings a libhighs of its own
    manager = pywrapcp.RoutingIndexManager(model.size, model.vehicles, 0)
    routing = pywrapcp.RoutingModel(manager)
    lengths = routing.RegisterTransitMatrix(whole(model))
    routing.SetArcCostEvaluatorOfAllVehicles(lengths)
    if model.demands is not None and model.capacity is not None:
        loads = routing.RegisterUnaryTransitVector(model.demands.astype(int).tolist())
        most = model.capacity.astype(int).tolist()
        routing.AddDimensionWithVehicleCapacity(loads, 0, most, True, "load")
    else:
        routing.AddDimension(lengths, 0, 10**12, True, "length")
        routing.GetDimensionOrDie("length").SetGlobalSpanCostCoefficient(100)
    asked = pywrapcp.DefaultRoutingSearchParameters()
    asked.local_search_metaheuristic = (
        routing_enums_pb2.LocalSearchMetaheuristic.GUIDED_LOCAL_SEARCH
    )
    asked.time_limit.FromMilliseconds(round(1e3 * SEARCH))
    found = routing.SolveWithParameters(asked)
    if found is None:
        return None
    routes = []
    for vehicle in range(model.vehicles):
        route, at = [], found.Value(routing.NextVar(routing.Start(vehicle)))
        while not routing.IsEnd(at):
            route.append(manager.IndexToNode(at))
            at = found.Value(routing.NextVar(at))
        routes.append(route)
    return {"routes": routes}


def fleet() -> Rows:
    """Yield rows at equal seconds; the value is the median over seeds."""

    def loads(count: int) -> FleetRouting:
        draw = np.random.default_rng(count)
        demands = np.concatenate([[0], draw.integers(1, 10, count)])
        return FleetRouting(
            count // 8, points=draw.integers(0, 1000, (count + 1, 2)), demands=demands, capacity=50.0,
            objective="sum", use_all=False,
        )  # fmt: skip

    def tsplib(name: str, vehicles: int) -> FleetRouting:
        path = DATA / f"{name}.tsp"
        return read_tsplib(path, vehicles, objective="max", use_all=False)

    def ours(model: FleetRouting, seed: int) -> Any:
        return ct.solve(model, "fleet-search", time_limit=SEARCH, seed=seed, threads=1)

    models = {
        "sum, loads, 100 nodes": loads(100),
        "sum, loads, 200 nodes": loads(200),
        "longest of 5, eil76": tsplib("eil76", 5),
        "longest of 3, kroA200": tsplib("kroA200", 3),
    }
    ct.solve(models["sum, loads, 100 nodes"], "fleet-search", time_limit=1.0)  # compiles
    for name, model in models.items():
        base = None
        for package, search in {
            "crosstrack, `fleet-search`": ours, "PyVRP": with_pyvrp, "OR-Tools routing": with_ortools,
        }.items():  # fmt: skip
            values, spent, words = [], [], set()
            for seed in SEEDS if search is not with_ortools else SEEDS[:1]:
                begin = time.perf_counter()
                plan = search(model, seed)
                spent.append(time.perf_counter() - begin)
                value, word = checked(model, plan)
                values += [] if value is None else [value]
                words.add(word)
            if not values:
                yield name, package, None, None, None, None, "knows no longest route"
                continue
            value = median(values)
            base = base or value
            yield (
                name,
                package,
                median(spent),
                value,
                min(values),
                value / base - 1,
                ", ".join(words),
            )


#: What measures each problem, its columns, the packages, and the sentence below its table.
TABLES: dict[str, tuple[Callable[[], Rows], dict[str, str], tuple[str, ...], str]] = {
    "error-correction": (
        error_correction, COLUMNS, ("cspy", "networkx"),
        "Seconds of cspy include those of handing it the arcs that thresholds leave possible.",
    ),
    "resource-routing": (
        resource_routing, COLUMNS, ("cspy", "networkx"),
        "Seconds of cspy include those of handing it the arcs.",
    ),
    "grid-path": (
        grid_path,
        {
            "map": "", "package": "", "length": ".7g", "seconds": ".2g", "times ours": ".4g",
            "our check": "",
        },
        ("pyastar2d", "scikit-image", "networkx", "pathfinding"),
        "Medians over scenarios, and the sum of their lengths. Building what a package keeps of a map is not timed.",
    ),
    "minimum-snap": (
        minimum_snap, COLUMNS, ("minsnap-trajectories", "scipy"),
        "Making a trajectory of what a package returns is not timed.",
    ),
    "fleet": (
        fleet,
        {
            "problem": "", "package": "", "seconds": ".2g", "median value": ".7g", "best": ".7g",
            "median above ours": "+.2%", "our check": "",
        },
        ("pyvrp", "ortools"),
        "One thread each; OR-Tools draws nothing, so it runs once, the others with three seeds.",
    ),
    "attractor": (
        attractor,
        {
            "instance": "", "figure": "", "known": ".4g", "package": "", "value": ".4g", "seconds": ".2g",
            "times ours": ".4g", "our check": "",
        },
        ("nolds",),
        "nolds is told the embedding, and the region that ours chose.",
    ),
}  # fmt: skip


def main(names: list[str]) -> None:
    """Measure one problem here, or several in a process each."""
    if len(names) != 1:
        for name in names or TABLES:
            subprocess.run([sys.executable, str(HERE), name], check=True)
        return
    compile_always()
    measure, columns, packages, said = TABLES[names[0]]
    rows = []
    for row in measure():
        print(*row, sep=" | ", flush=True)
        rows.append(row)
    write("peers", names[0], __file__, columns, rows, packages, said)


if __name__ == "__main__":
    main(sys.argv[1:])
