"""The paper's algorithms on the contest's public points, which have the sizes of rows 7 to 9.

``python tests/benchmarks/error_correction/contest.py`` writes two tables to ``docs/measured/error-correction.json``: the
algorithms, and the values of λ with which readings of stage 1 find a route. It needs the public points.
"""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve()
sys.path[:0] = [str(HERE.parents[2])]

import numpy as np  # noqa: E402
from benchmarks.cases import CASES, POINTS, ROWS  # noqa: E402
from benchmarks.measured import write  # noqa: E402

import crosstrack as ct  # noqa: E402
from crosstrack.instances.error_correction import TABLE_3  # noqa: E402
from crosstrack.models import Route  # noqa: E402
from crosstrack.solvers.error_correction.airspace import HORIZONTAL, VERTICAL, airspace  # noqa: E402
from crosstrack.solvers.error_correction.printed import FACTORS  # noqa: E402
from crosstrack.solvers.error_correction.printed_kernels import label_points  # noqa: E402

#: Readings of step 3 of stage 1: whether α and β are swapped, and the shares of the thresholds (vertical and
#: horizontal error) that λ shrinks at horizontal and at vertical points.
READINGS = {
    "λ on the vertical error (taken)": (False, (1, 0), (1, 0)),
    "the same, α and β swapped (as printed)": (True, (1, 0), (1, 0)),
    "λ on the error that survives": (False, (1, 0), (0, 1)),
    "λ on the error that is corrected": (False, (0, 1), (1, 0)),
    "λ on both errors": (False, (1, 1), (1, 1)),
}
BACKENDS = ("two-stage", "pulse", "dynamic-programming")


def factors(model, reading) -> str:
    """Return the values of λ with which a reading finds a route that verifies."""
    swapped, *shrunk = READINGS[reading]
    found = []
    for factor in FACTORS:
        space = airspace(model)
        limits = space.limits.copy()
        if swapped:
            limits[[HORIZONTAL, VERTICAL]] = limits[[VERTICAL, HORIZONTAL]]
        for kind, axes in zip((HORIZONTAL, VERTICAL), shrunk, strict=True):
            limits[kind] *= np.where(axes, factor, 1.0)
        _, route, _, _ = label_points(space._replace(limits=limits), 1.0, np.zeros(1, np.int8))
        if route.size and model.verify(Route(tuple(route.tolist()))).ok:
            found.append(f"{factor:g}")
    if len(found) > 2 and len(found) == 1 + round(20 * (float(found[-1]) - float(found[0]))):
        return f"{found[0]} to {found[-1]}"
    return ", ".join(found) or "none"


def main() -> None:
    """Solve the three rows."""
    assert POINTS.exists(), "the public points are not beside the project"
    models = {case.row: case.fresh() for case in CASES.values() if case.row is not None}
    rows = []
    for row, model in models.items():
        line, labels = [str(row)], []
        for backend in BACKENDS:
            ct.solve(model, backend, isolate=False)  # loads the compiled code
            found = min(
                (ct.solve(model, backend, isolate=False, time_limit=60) for _ in range(5)),
                key=lambda one: one.statistics["search_seconds"],
            )
            assert found.termination == "optimal"
            assert abs(found.primal_bound - ROWS[row][1]) < 1e-3
            printed = TABLE_3[row]
            name = backend.replace("-", "_")
            line += [getattr(printed, name), found.statistics["search_seconds"]]
            labels.append(found.statistics["labels extended"])
            if backend == "two-stage":
                first = found.statistics["stage1 length"] / found.primal_bound
                factor = found.statistics["threshold factor"]
        rows.append((*line, *labels, factor, first, ROWS[row][1]))
        print(*rows[-1])
    heads = ("T", "pulse", "DP")
    columns = {
        "row": "",
        **{f"{head}{end}": ".4f" for head in heads for end in (" (s), paper", " (s)")},
        **{f"labels of {head}": "d" for head in ("T2", "pulse", "DP")},
        "λ": "g", "stage 1 over optimum": ".3f", "proven optimum (m)": ".3f",
    }  # fmt: skip
    said = "Least seconds of 5 runs. The paper says that its points are random, so its seconds may be of other points."
    write("error-correction", "contest", __file__, columns, rows, ("numba",), said)
    lines = [
        (reading, *(factors(model, reading) for model in models.values())) for reading in READINGS
    ]
    heads = dict.fromkeys(("reading", *(f"row {row}" for row in models)), "")
    said = "Values of λ, of 0.5, 0.55, …, 1, with which stage 1 finds a route within the thresholds of the model."
    write("error-correction", "readings", __file__, heads, lines, ("numba",), said)
    print(*lines, sep="\n")


if __name__ == "__main__":
    main()
