"""Spectra of exponents of known systems beside those of their equations, for the problem's page.

``python tests/benchmarks/attractor/spectra.py`` writes the table ``spectra`` of ``docs/measured/attractor.json``.
The spectrum of the equations is that of the images of small displacements, which QR keeps orthogonal.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.attractor.known_systems import (  # noqa: E402
    SYSTEMS,
    inner_steps,
    iterate,
    orbit_of,
    series_of,
)
from benchmarks.measured import write  # noqa: E402

from crosstrack.models import AttractorAnalysis  # noqa: E402
from crosstrack.solvers import Request, find_backend  # noqa: E402

#: Systems on whose series the constants of the backend were chosen, and others.
CHOSEN = ("logistic", "henon", "ikeda", "lorenz", "rossler", "sprott b")
OTHERS = (
    "delayed logistic", "holmes", "burgers", "chen", "diffusionless lorenz", "rucklidge", "lozi", "tinkerbell",
    "chua", "jerk", "thomas",
)  # fmt: skip
SIZES, STARTS, NOISES = (1_000, 3_000), 1, (0.0, 0.05)
DISPLACEMENT, STEPS = 1e-7, 5_000


def spectrum_of(name: str) -> np.ndarray:
    """Return the exponents of the equations in nats per second, the largest first."""
    known = SYSTEMS[name]
    inner, step = inner_steps(known)
    state = orbit_of(known, 1)[0].copy()
    width = 3 if known.number > 0 else int((np.ptp(orbit_of(known, 100), axis=0) > 0).sum())
    axes, logs, image = np.eye(width), np.zeros(width), np.empty((1, 3))
    for _ in range(STEPS):
        images = []
        for axis in (np.zeros(width), *axes.T):
            moved = state.copy()
            moved[:width] += DISPLACEMENT * axis
            iterate(known.number, moved, step, inner, 0, image)
            images.append(image[0].copy())
        state = images[0]
        axes, growth = np.linalg.qr((np.array(images[1:]) - state)[:, :width].T / DISPLACEMENT)
        logs += np.log(np.abs(np.diag(growth)))
    return np.sort(logs / (STEPS * known.period))[::-1]


def main() -> None:
    backend = find_backend("lyapunov-spectrum")
    rows, totals = [], {}
    for name in (*CHOSEN, *OTHERS):
        known, period = spectrum_of(name), float(SYSTEMS[name].period)
        for noise in NOISES:
            for count in SIZES:
                for start in range(STARTS):
                    series = series_of(name, count, start)
                    shocks = np.random.default_rng(start).normal(size=count)
                    model = AttractorAnalysis(series + noise * series.std() * shocks, period)
                    request = Request(options=backend.checked_options({}))
                    spectrum = backend.run(model, request).point.spectrum
                    group = "chosen" if name in CHOSEN else "others"
                    total = totals.setdefault((group, noise, count), [0, 0, 0, 0, 0, 0])
                    total[0] += 1
                    if spectrum is not None:
                        size = min(spectrum.resolved, len(known))
                        apart = np.abs(np.subtract(spectrum.values[:size], known[:size]))
                        covered = apart <= 2 * np.array(spectrum.deviations[:size])
                        total[1] += size
                        total[2] += int(covered.sum())
                        total[3] += 1
                        total[4] += int(covered[0])
                        total[5] += spectrum.resolved > len(known)
                    if start == 0 and noise == 0 and count == SIZES[-1]:
                        rows.append(
                            [
                                name,
                                ", ".join(f"{x:.3g}" for x in known),
                                str(spectrum),
                                spectrum.resolved if spectrum else 0,
                            ]
                        )
                        print(*rows[-1], sep=" | ", flush=True)
    write(
        "attractor", "spectra", __file__, {"system": "", "equations": "", "from 3,000 samples": "", "resolved": "d"},
        rows, ("numpy",), "In nats per second or per step; one series without noise per system.",
    )  # fmt: skip
    lines = [
        [group, f"{100 * noise:g} %", count, *total[:4], total[4], total[5]]
        for (group, noise, count), total in totals.items()
    ]
    for line in lines:
        print(*line, sep=" | ")
    heads = {
        "systems": "", "noise": "", "samples": "d", "series": "d", "resolved exponents": "d", "covered": "d",
        "largest exponents": "d", "covered ": "d", "too many resolved": "d",
    }  # fmt: skip
    write(
        "attractor", "spectra-coverage", __file__, heads, lines, ("numpy",),
        "An exponent is covered if it lies within two stated deviations of that of the equations. The constants "
        f"were chosen on {', '.join(CHOSEN)}.",
    )  # fmt: skip


if __name__ == "__main__":
    main()
