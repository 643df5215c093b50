"""Public trajectories beside our optima, for the table of ``docs/problems/minimum-snap.md``.

``python tests/benchmarks/minimum_snap/public_files.py`` writes ``docs/measured/minimum-snap.json``; it needs the
public files that the tests read.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve()
sys.path[:0] = [str(HERE.parents[2]), str(HERE.parents[2] / "minimum_snap")]

from benchmarks.measured import write  # noqa: E402
from test_interop import SYMAO, references, symao  # noqa: E402

import crosstrack as ct  # noqa: E402
from crosstrack.models import MinimumDerivative  # noqa: E402

#: Files with what they minimise and how they were made, as far as it is known.
FILES = {
    "symao_closed_form": "jerk, in closed form",
    "symao_simple": "jerk, by a quadratic program",
    "icsl_jeon_3d": "acceleration² + jerk², degree 8",
}


def main() -> None:
    """Compare the samples of three files."""
    rows = []
    for name, words in FILES.items():
        t, values = references(f"minsnap_trajectories__{name}.mat")
        if name.startswith("symao"):
            model = symao(t, values)
        else:
            times = np.array([0.0, 2.0, 4.0, 7.0])
            points = np.round([values[0, int(np.abs(t - knot).argmin())] for knot in times], 3)
            model = MinimumDerivative(
                waypoints=points, times=times, order=3, weights=np.array([0.0, 1.0, 1.0]), degree=8,
                continuity=4,
            )  # fmt: skip
        plan = ct.solve(model).plan
        # A sample at a knot speaks for one side of a jump.
        far = np.abs(t[:, None] - SYMAO).min(axis=1) > 1e-9 if model.degree == 5 else t >= 0
        apart = [
            float(
                np.abs(plan(t[far], order) - values[order][far]).max() / np.abs(values[order]).max()
            )
            for order in range(4)
        ]
        rows.append((f"{name}.mat", words, model.segments, int(far.sum()), *apart))
        print(*rows[-1])
    columns = {
        "file": "", "least": "", "segments": "", "samples": "",
        **dict.fromkeys(("position", "velocity", "acceleration", "jerk"), ".0e"),
    }  # fmt: skip
    said = "The last four columns: the largest difference relative to the largest value."
    write("minimum-snap", "public", __file__, columns, rows, ("numpy", "scipy"), said)


if __name__ == "__main__":
    main()
