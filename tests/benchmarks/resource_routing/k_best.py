"""Several best routes beside one: seconds of CPU for ten routes and for one, and their ratio.

``python tests/benchmarks/resource_routing/k_best.py`` writes the table "k-best" of
``docs/measured/resource-routing.json``; it needs the files in ``../shared/data/rcsp``. Compilation and reading are
not measured, and models without a route are left out. The bounds of both runs must be equal and proven, and the
verification checks the number, the order and the limits of all routes.
"""

from __future__ import annotations

import dataclasses
import sys
import warnings
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve()
sys.path[:0] = [str(HERE.parents[2])]

from benchmarks.measured import write  # noqa: E402
from benchmarks.resource_routing.cspy_files import FILES, NAME, least  # noqa: E402

import crosstrack as ct  # noqa: E402
from crosstrack.instances.resource_routing import generate_network  # noqa: E402

#: Number of routes.
ROUTES = 10
#: Points per side of the generated square networks, and their seeds.
SIDES, SEEDS = (10, 20, 40), (2, 3)
#: Number of measured calls; the shortest counts.
REPEATS = 5


def models() -> dict[str, Any]:
    """Return the public files and generated networks by name."""
    cases = {path.name: ct.load(str(path)) for path in sorted(FILES.glob("*.*"))}
    return cases | {
        f"network {side} x {side}, seed {seed}": generate_network(side, seed)
        for side in SIDES
        for seed in SEEDS
    }


def main() -> None:
    """Measure each model with one route and with several."""
    warnings.simplefilter("ignore")
    rows = []
    for name, model in models().items():
        single, several = (dataclasses.replace(model, routes=count) for count in (1, ROUTES))
        for case in (single, several):
            ct.solve(case, NAME)
        best, one = least(REPEATS, lambda case=single: ct.solve(case, NAME))
        if best.termination == "infeasible":
            continue
        answer, many = least(REPEATS, lambda case=several: ct.solve(case, NAME))
        assert best.termination == answer.termination == "optimal"
        assert best.primal_bound == answer.primal_bound
        count = 1 + len(answer.plan.others)
        rows.append((name, len(model.kinds), count, one, many, many / one))
        print(*rows[-1], flush=True)
    columns = {
        "model": "", "points": "d", "routes": "d", "CPU s (one route)": ".2g", "CPU s (all)": ".2g",
        "ratio": ".1f",
    }  # fmt: skip
    write("resource-routing", "k-best", __file__, columns, rows, ("numba",))


if __name__ == "__main__":
    main()
