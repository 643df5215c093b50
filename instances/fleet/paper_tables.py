"""Tables 1 and 2 of the paper: printed cells and measurements."""

from __future__ import annotations

import importlib.util
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...models.fleet.model import FleetRouting
from ..paper import ResultTable, Run, Trials
from .generator import generate
from .readers import read_tsplib

__all__ = ["TABLE_1", "TABLE_2", "table_1", "table_2", "table_2_model"]

#: Robots of Table 2, see the item "Table 2, setting".
ROBOTS = 3
#: Backends by the names of the paper.
ALGORITHMS = {
    "TPHA": "tpha",
    "Kmeans-AC": "kmeans-ac",
    "PSO-AC": "pso-ac-serial",
    "GPSO-AC": "pso-ac",
}
#: Seconds of fleet-search for each of the known values.
SECONDS = 20.0
#: Iterations of the swarm in Table 1, fewer than by default: only the ratio of times matters.
MOVES = 10

TABLE_1 = ResultTable(
    "table-1",
    "Table 1: running time and speed-up of GPSO-AC over PSO-AC by the size of the swarm",
    keys=("swarm",),
    columns={"GPU (s)": ".2f", "CPU (s)": ".2f", "ratio": ".2f"},
    rows={
        ("32",): (52.19, 260.96, 5),
        ("64",): (52.97, 553.96, 10.46),
        ("128",): (58.06, 1145.35, 19.73),
        ("256",): (59.07, 1634.82, 27.68),
    },
    ours={"threads (s)": ".2f", "threads": "d", "runs": "d"},
    note=(
        "Without a graphics card the ratio is that of PSO-AC on one thread to GPSO-AC on all "
        "processors, which can be at most their number. 199 random nodes, 4 robots and 10 iterations; "
        "the paper's instance is not known."
    ),
)

#: Time, worst, best, mean and deviation of TPHA, Kmeans-AC, PSO-AC and GPSO-AC by file.
_PRINTED: dict[str, tuple[tuple[float, ...], ...]] = {
    "bayg29": (
        (0.23, 13184.9, 11791.1, 12181, 538.296),
        (0.42, 13135.1, 11733, 12494.5, 375.314),
        (461.28, 10706.1, 10403.2, 10413.3, 55.31),
        (47.11, 10706.1, 10403.2, 10413.3, 55.31),
    ),
    "berlin52": (
        (0.73, 9077.08, 8774.05, 8974.17, 72.99),
        (1.4, 9042.33, 8809.45, 8906.13, 52.98),
        (896.03, 8525.2, 8423.24, 8493.73, 25.43),
        (64.52, 8591.67, 8470.35, 8505.86, 36.31),
    ),
    "st70": (
        (1.38, 1013.24, 977.15, 989.44, 8.71),
        (2.72, 992.144, 964.325, 979.85, 7.24),
        (1245.94, 855.231, 830.09, 841.94, 9.52),
        (77.47, 867.028, 826.925, 77.47, 9.41),
    ),
    "eil101": (
        (3.23, 847.11, 780.26, 802.6, 17.27),
        (6.19, 826.824, 776.452, 796.72, 14.41),
        (2117.81, 706.65, 695.27, 702.55, 3.05),
        (158.65, 712.31, 681.1, 690.9, 7.95),
    ),
    "ch150": (
        (8.47, 9072.97, 8488.81, 8810.75, 125.1),
        (16, 8873.1, 8504.53, 8719.8, 93.6),
        (3669.83, 7607.78, 7347.33, 7432.4, 68.43),
        (237.8, 7022.99, 6673.28, 6833.43, 101.06),
    ),
    "kroA200": (
        (18.11, 38417.8, 36926.4, 37609.7, 377.98),
        (33.63, 37485.6, 36563.1, 37076.2, 279.49),
        (4603.84, 33820.9, 31940.7, 32740.3, 442.56),
        (292.34, 33603.5, 31271.1, 32723.6, 547.5),
    ),
}
_LEAST, _BOUND, _EVEN = (
    "least sum, best known",
    "least sum, proven bound",
    "equal nodes, best known",
)

TABLE_2 = ResultTable(
    "table-2",
    "Table 2: four algorithms on six files of TSPLIB",
    keys=("file", "algorithm"),
    columns={"time (s)": ".2f", "worst": ".6g", "best": ".6g", "mean": ".6g", "deviation": ".4g"},
    rows={
        (name, algorithm): cells
        for name, rows in _PRINTED.items()
        for algorithm, cells in zip(ALGORITHMS, rows, strict=True)
    },
    ours={"runs": "d", _LEAST: ".6g", _BOUND: ".6g", _EVEN: ".6g"},
    note=(
        "Sums of the lengths of three routes from city 1, real-valued distances; the paper has 30 runs. "
        "Times are those of different machines and numbers of iterations. The least sum, and the "
        "bound that is proven for it, have no balance: one robot visits nearly all nodes. With equal "
        "nodes no robot visits more than a third of the nodes, rounded up. Both are by fleet-search."
    ),
)


def tsplib_file(name: str) -> Path | None:
    """Return the TSPLIB file `name`, or None if it is absent.

    It is looked for in the folder that the environment variable ``CROSSTRACK_TSPLIB`` names, else in
    ``../shared/data/tsplib`` beside the project.
    """
    beside = Path(__file__).resolve().parents[3] / "shared" / "data" / "tsplib"
    path = Path(os.environ.get("CROSSTRACK_TSPLIB", beside)) / f"{name}.tsp"
    return path if path.is_file() else None


def table_2_model(path: str | os.PathLike[str], **fields: Any) -> FleetRouting:
    """Return the model of Table 2 for a TSPLIB file: three robots from city 1, least sum of lengths.

    `fields` are other fields of :class:`~crosstrack.models.fleet.FleetRouting`.
    """
    return read_tsplib(path, ROBOTS, display=True, **{"objective": "sum", **fields})


def _mean_seconds(answers: Sequence[Run]) -> float:
    return float(np.mean([run.seconds["solve"] for run in answers]))


def _has_card() -> bool:
    if importlib.util.find_spec("torch") is None:
        return False
    import torch

    return bool(torch.cuda.is_available())


def table_1(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return our times of one size of the swarm, one thread against all processors."""
    model = generate(199, 4, 1, name="table 1", objective="sum")
    options = {"swarm": int(row[0]), "iterations": MOVES}
    serial, parallel = (
        trials.run(model, name, options=options) for name in ("pso-ac-serial", "pso-ac")
    )
    seconds = [_mean_seconds(answers) for answers in (serial, parallel)]
    card = None
    if _has_card():
        card = _mean_seconds(trials.run(model, "pso-ac", options={**options, "device": "gpu"}))
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {
        "GPU (s)": "no graphics card" if card is None else card,
        "CPU (s)": seconds[0],
        "ratio": seconds[0] / (seconds[1] if card is None else card),
        "threads (s)": seconds[1],
        "threads": available or 1,
        "runs": len(serial),
    }


#: Known values by file, of the last file only: all four rows of a file show them.
_LATEST: dict[tuple[Any, ...], dict[str, Any]] = {}


def table_2(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return our values of one algorithm on one file; "no file" if the file is absent."""
    name, algorithm = row
    path = tsplib_file(name)
    if path is None:
        return dict.fromkeys(TABLE_2.columns, "no file")
    model = table_2_model(path)
    key = (name, trials.seed, trials.time_limit)
    if key not in _LATEST:
        _LATEST.clear()
        _LATEST[key] = _known(path, model, trials)
    answers = trials.run(model, ALGORITHMS[algorithm])
    sums = np.array([run.primal_bound for run in answers if run.primal_bound is not None])
    if not sums.size:
        return dict.fromkeys(TABLE_2.columns, "no routes within the time") | _LATEST[key]
    return {
        "time (s)": _mean_seconds(answers),
        "worst": sums.max(),
        "best": sums.min(),
        "mean": sums.mean(),
        "deviation": sums.std(ddof=1) if sums.size > 1 else "one run",
        "runs": sums.size,
        **_LATEST[key],
    }


def _known(path: Path, model: FleetRouting, trials: Trials) -> dict[str, Any]:
    """Return the best known sums, without balance and with equal numbers of nodes, and the bound."""
    count = len(model.customers)
    seconds = min(SECONDS, SECONDS if trials.time_limit is None else trials.time_limit)
    demands = np.ones(model.size)
    demands[model.depots] = 0.0
    even = table_2_model(path, demands=demands, capacity=float(math.ceil(count / ROBOTS)))
    free, balanced = (
        trials.run(instance, "fleet-search", runs=1, time_limit=seconds)[0]
        for instance in (model, even.renamed(f"{path.stem}, equal nodes"))
    )
    return {_LEAST: free.primal_bound, _BOUND: free.dual_bound, _EVEN: balanced.primal_bound}
