"""The public files of constrained shortest paths, beside cspy: seconds of CPU and their ratio.

``python tests/benchmarks/resource_routing/cspy_files.py`` writes ``docs/measured/resource-routing.json``; it needs the
files in ``../shared/data/rcsp``, and cspy 1.0.3. Compilation and reading are not measured.
"""

from __future__ import annotations

import sys
import time
import warnings
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve()
sys.path[:0] = [str(HERE.parents[2])]

from benchmarks.measured import write  # noqa: E402

import crosstrack as ct  # noqa: E402
from crosstrack.models import ResourceRouting  # noqa: E402

FILES = HERE.parents[4] / "shared" / "data" / "rcsp"
NAME = "resource-labelling"
#: Seconds after which cspy is stopped.
LIMIT = 60.0


def least(repeats: int, run: Any) -> tuple[Any, float]:
    """Return the last answer, and the least seconds of CPU of `repeats` calls."""
    seconds = []
    for _ in range(repeats):
        begin = time.process_time()
        answer = run()
        seconds.append(time.process_time() - begin)
    return answer, min(seconds)


def peer(model: ResourceRouting) -> Any:
    """Return the length that cspy finds with its own bidirectional labels, None without a path.

    The construction of its graph is measured, too, as our solver receives arrays.
    """
    from cspy import BiDirectional
    from networkx import DiGraph

    assert model.arcs is not None
    assert model.lengths is not None
    assert model.uses is not None
    prizes = [0.0] * len(model.kinds) if model.prizes is None else model.prizes.tolist()
    names: list[Any] = list(range(len(model.kinds)))
    names[model.start], names[model.end] = "Source", "Sink"
    graph = DiGraph(directed=True, n_res=len(model.resources))
    for (i, j), length, use in zip(
        model.arcs.tolist(), model.lengths.tolist(), model.uses.tolist(), strict=True
    ):
        if j != model.start and i != model.end:
            graph.add_edge(names[i], names[j], weight=length - prizes[j], res_cost=use)
    limits = model.limits[model.codes[model.end]].tolist()
    algorithm = BiDirectional(
        graph, limits, [0.0] * len(limits), elementary=model.has_prizes, time_limit=LIMIT
    )
    algorithm.run()
    return algorithm.total_cost - prizes[model.start] if algorithm.path else None


def main() -> None:
    """Solve every file with both."""
    warnings.simplefilter("ignore")
    rows = []
    for path in sorted(FILES.glob("*.*")):
        model: Any = ct.load(str(path))
        ct.solve(model, NAME)
        found, ours = least(5, lambda model=model: ct.solve(model, NAME))
        assert found.termination == "optimal"
        length, theirs = least(1, lambda model=model: peer(model))
        rows.append(
            (
                path.name,
                found.primal_bound,
                ours,
                "none" if length is None else f"{length:g}",
                theirs,
                theirs / ours,
            )
        )
        print(*rows[-1], flush=True)
    columns = {
        "file": "", "optimum (ours)": ".0f", "CPU s (ours)": ".2g", "cspy's length": "",
        "CPU s (cspy)": ".2g", "ratio": ".1f",
    }  # fmt: skip
    write("resource-routing", "cspy", __file__, columns, rows, ("numba", "cspy"))


if __name__ == "__main__":
    main()
