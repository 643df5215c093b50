"""Coverage of stated deviations of the attractor estimates, for the problem's page.

``python tests/benchmarks/attractor/coverage.py`` writes the tables ``coverage``, ``coverage-systems`` and ``coverage-noise`` of
``docs/measured/attractor.json``; ``slopes`` and ``noise`` as arguments select parts. A truth is covered if it lies within two
stated deviations. Verdicts are measured by ``verdicts.py``.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.attractor.known_systems import (  # noqa: E402
    CALIBRATION,
    HELD_OUT,
    SYSTEMS,
    series_of,
)
from benchmarks.attractor.verdicts import disturbed  # noqa: E402
from benchmarks.measured import write  # noqa: E402

from crosstrack.models import AttractorAnalysis  # noqa: E402
from crosstrack.models.attractor import Slope  # noqa: E402
from crosstrack.solvers import Request, find_backend  # noqa: E402

SIZES, STARTS = (1_000, 3_000, 20_000), 2
EXPONENT, DIMENSION = "rosenstein", "correlation-dimension"
WITHIN = 2.0
#: Noise as a share of the deviation, and lengths of the series with noise.
NOISE, NOISY_SIZES = (0.02, 0.05), (1_000, 5_000)


def estimate(name: str, series: np.ndarray, period: float = 1.0) -> Any:
    """Return the estimate of a backend."""
    model = AttractorAnalysis(series, period=period)
    backend = find_backend(name)
    request = Request(seed=0, options=backend.checked_options({}))
    return backend.run(model, request).point


def slope_of(name: str, method: str, count: int, start: int) -> Slope | None:
    """Return the slope that a backend states for a system."""
    plan = estimate(method, series_of(name, count, start), float(SYSTEMS[name].period))
    return plan.exponent or plan.correlation


def truth_of(name: str, method: str) -> float | None:
    """Return the known exponent or dimension of a system."""
    return SYSTEMS[name].dimension if method == DIMENSION else SYSTEMS[name].exponent


def measure() -> dict[tuple[str, str, int], list[Slope | None]]:
    """Return the slopes of all systems, by system, method and length."""
    found = {}
    for name in SYSTEMS:
        for method in (EXPONENT, "kantz", DIMENSION):
            if truth_of(name, method) is not None:
                for count in SIZES:
                    found[name, method, count] = [
                        slope_of(name, method, count, start) for start in range(STARTS)
                    ]
        print(name, flush=True)
    return found


def covers(slope: Slope, truth: float) -> bool:
    """Return whether the truth lies within two stated deviations."""
    return abs(slope.value - truth) <= WITHIN * slope.deviation


def summarise(found: dict[tuple[str, str, int], list[Slope | None]]) -> None:
    """Write the coverage by set of systems, method and length, and by system."""
    rows, groups = [], defaultdict(list)
    for (name, method, count), slopes in found.items():
        groups[method, name in HELD_OUT, count] += [(name, slope) for slope in slopes]
        groups[method, name in HELD_OUT, 0] += [(name, slope) for slope in slopes]
    for (method, held, count), entries in sorted(groups.items(), key=lambda one: one[0]):
        stated = [(slope, truth_of(name, method)) for name, slope in entries if slope is not None]
        good = [covers(slope, truth) for slope, truth in stated]
        width = np.median([slope.deviation / truth for slope, truth in stated]) if stated else None
        error = (
            np.median([abs(slope.value / truth - 1) for slope, truth in stated]) if stated else None
        )
        rows.append(
            [
                method, "held out" if held else "calibration", f"{count:,}" if count else "all",
                len(entries), len(stated), 100 * np.mean(good) if good else None,
                None if width is None else 100 * width, None if error is None else 100 * error,
            ]
        )  # fmt: skip
    columns = {
        "backend": "", "systems": "", "samples": "", "series": "d", "stated": "d",
        "covered, %": ".0f", "median deviation, %": ".1f", "median error, %": ".1f",
    }  # fmt: skip
    write(
        "attractor", "coverage", __file__, columns, rows, ("numpy",),
        "The truth is covered if it lies within two stated deviations. Deviations and errors are relative to the truth. "
        f"The constants are calibrated on {', '.join(CALIBRATION)}; held out are {', '.join(HELD_OUT)}.",
    )  # fmt: skip
    for row in rows:
        print(*row, sep=" | ")
    lines = []
    for name, known in SYSTEMS.items():
        for method, source in (
            (EXPONENT, known.exponent_source),
            (DIMENSION, known.dimension_source),
        ):
            truth = truth_of(name, method)
            if truth is not None:
                cells = []
                for count in SIZES:
                    slope = found[name, method, count][0]
                    missed = "" if slope is None or covers(slope, truth) else " (missed)"
                    cells.append("none" if slope is None else f"{slope}{missed}")
                lines.append([name, method, truth, source, *cells])
    heads = {"system": "", "backend": "", "known": ".4g", "source": ""}
    write(
        "attractor", "coverage-systems", __file__,
        {**heads, **{f"{count:,} samples": "" for count in SIZES}}, lines, ("numpy",),
        "First of two starts. 'none' means that the backend states no figure.",
    )  # fmt: skip


def cover_noise() -> None:
    """Write the coverage of exponents and dimensions of series with noise."""
    rows = []
    for noise in NOISE:
        for method in (EXPONENT, DIMENSION):
            for label, names in (("calibration", CALIBRATION), ("held out", HELD_OUT)):
                for count in NOISY_SIZES:
                    known = [name for name in names if truth_of(name, method) is not None]
                    errors = []
                    for name in known:
                        series = disturbed(series_of(name, count, 0), noise, name)
                        plan = estimate(method, series, float(SYSTEMS[name].period))
                        slope, truth = plan.exponent or plan.correlation, truth_of(name, method)
                        if slope is not None:
                            ratio = slope.deviation / truth, abs(slope.value / truth - 1)
                            errors.append((covers(slope, truth), *ratio))
                    good, width, error = np.transpose(errors)
                    rows.append(
                        [
                            method, 100 * noise, label, f"{count:,}", len(known), len(errors), 100 * good.mean(),
                            100 * np.median(width), 100 * np.median(error),
                        ]
                    )  # fmt: skip
                    print(*rows[-1], sep=" | ", flush=True)
    columns = {
        "backend": "", "noise, %": ".0f", "systems": "", "samples": "", "series": "d", "stated": "d",
        "covered, %": ".0f", "median deviation, %": ".1f", "median error, %": ".1f",
    }  # fmt: skip
    write(
        "attractor", "coverage-noise", __file__, columns, rows, ("numpy",),
        "Series with normal noise, as a share of their deviation. The truth is covered if it lies within two stated deviations.",
    )  # fmt: skip


PARTS = {"slopes": lambda: summarise(measure()), "noise": cover_noise}

if __name__ == "__main__":
    for part in sys.argv[1:] or PARTS:
        PARTS[part]()
