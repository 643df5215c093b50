"""Verdicts on nonlinear systems that are not chaotic and driven by noise, for the problem's page.

``python tests/benchmarks/attractor/driven.py`` writes the table ``verdicts-driven`` of ``docs/measured/attractor.json``. The
limits of the judgement were chosen on the same systems with the seeds 1 to 3. Flows are integrated by the method of Euler
and Maruyama with 20 steps per sample. Noise can make the maps around the period of 3 chaotic, so they are left out.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.attractor.verdicts import JUDGEMENTS, judged  # noqa: E402
from benchmarks.measured import write  # noqa: E402

SIZES, SEEDS, SKIPPED, INNER = (1_000, 3_000), (11, 12), 200, 20
Rates = Callable[..., tuple[float, ...]]

#: Time derivatives, seconds between samples, first state, and strengths of the noise.
FLOWS: Mapping[str, tuple[Rates, float, tuple[float, ...], tuple[float, ...]]] = {
    "van der pol 1": (lambda x, y: (y, (1 - x * x) * y - x), 0.3, (1, 1), (0, 0.2)),
    "van der pol 2": (lambda x, y: (y, 2 * (1 - x * x) * y - x), 0.2, (1, 1), (0, 0.3)),
    "van der pol 5": (lambda x, y: (y, 5 * (1 - x * x) * y - x), 0.4, (1, 1), (0, 0.3)),
    "two wells": (lambda x: (x - x**3,), 0.2, (1,), (0.5,)),
    "two wells with inertia": (lambda x, y: (y, x - x**3 - 0.25 * y), 0.3, (1, 0), (0, 0.25)),
    "fitzhugh-nagumo, cycle": (
        lambda x, y: (3 * (x - x**3 / 3 + y), -(x - 0.3 + 0.4 * y) / 3), 0.4, (1, 0), (0.05, 0.05)
    ),
    "fitzhugh-nagumo, excitable": (
        lambda x, y: (10 * (x - x**3 / 3 - y), x + 1.05), 0.1, (-1, 0), (0, 0.2)
    ),
    "brusselator": (
        lambda x, y: (1 + x * x * y - 4 * x, 3 * x - x * x * y), 0.3, (1, 1), (0.05, 0.05)
    ),
    "rossler, period 1": (
        lambda x, y, z: (-y - z, x + 0.2 * y, 0.2 + z * (x - 2.5)), 0.3, (1, 1, 0), (0.1, 0.1, 0)
    ),
    "rosenzweig and macarthur": (
        lambda x, y: (1 - np.exp(x) / 8 - np.exp(y) / (1 + np.exp(x)), 0.35 - 0.7 / (1 + np.exp(x))),
        0.5, (0, 0), (0.05, 0.05),
    ),
}  # fmt: skip
#: Next value, and strength of the noise.
MAPS: Mapping[str, tuple[Callable[[float], float], float]] = {
    "logistic, period 4": (lambda x: 3.5 * x * (1 - x), 0.01),
    "logistic, period 2": (lambda x: 3.3 * x * (1 - x), 0.03),
    "logistic, period 1": (lambda x: 2.9 * x * (1 - x), 0.05),
    "ricker, period 4": (lambda x: x + 2.6 * (1 - np.exp(x)), 0.1),
    "threshold autoregression": (lambda x: 1 - x if x > 0 else 0.9 * x - 0.3, 0.3),
}


def driven(name: str, count: int, seed: int) -> np.ndarray:
    """Return the first coordinate of a system after a transient."""
    rng, found = np.random.default_rng(seed), np.empty(count + SKIPPED)
    if name in MAPS:
        following, strength = MAPS[name]
        x = 0.3
        for k, shock in enumerate(rng.normal(size=len(found))):
            x = following(x) + strength * shock
            found[k] = x = min(max(x, 0.0), 1.0) if name.startswith("logistic") else x
        return found[SKIPPED:]
    rates, period, start, strengths = FLOWS[name]
    state, step = np.array(start, dtype=float), period / INNER
    scale = np.array(strengths) * np.sqrt(step)
    for k in range(len(found)):
        for shock in rng.normal(size=(INNER, len(state))):
            state = state + step * np.array(rates(*state)) + scale * shock
        found[k] = state[0]
    return found[SKIPPED:]


def main() -> None:
    """Judge all series, and write the table."""
    rows = []
    for name in (*FLOWS, *MAPS):
        found = [
            judged(driven(name, count, seed), 1.0)["judgement"] for count in SIZES for seed in SEEDS
        ]
        rows.append([name, len(found), *(found.count(word) for word in JUDGEMENTS)])
        print(*rows[-1], sep=" | ", flush=True)
    rows.append(["all", *np.sum([row[1:] for row in rows], axis=0).tolist()])
    print(*rows[-1], sep=" | ")
    write(
        "attractor", "verdicts-driven", __file__,
        {"system": "", "number": "d", **dict.fromkeys(JUDGEMENTS, "d")}, rows, ("numpy",),
        f"Verdicts on systems without chaos that are driven by noise, {min(SIZES):,} and {max(SIZES):,} samples. The "
        "limits were chosen on these systems with other seeds.",
    )  # fmt: skip


if __name__ == "__main__":
    main()
