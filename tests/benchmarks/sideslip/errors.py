"""Errors of the estimators of the sideslip angle on drives that the paper does not have, for the problem's page.

``python tests/benchmarks/sideslip/errors.py`` writes ``docs/measured/sideslip.json``; names of functions as arguments, such as
``claims``, write only their tables. Errors are medians over seeds of
the mean error in degrees. ``moving-horizon`` is left out, as it equals ``kalman-filter`` for linear tyres.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import wilcoxon

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.measured import write  # noqa: E402

import crosstrack as ct  # noqa: E402
from crosstrack.errors import InvalidData  # noqa: E402
from crosstrack.instances.sideslip.drivers import FIXED, RANGES, Driver  # noqa: E402
from crosstrack.instances.sideslip.generator import generate  # noqa: E402
from crosstrack.instances.sideslip.listing import MISMATCH  # noqa: E402
from crosstrack.models import SideslipEstimation  # noqa: E402
from crosstrack.solvers import Request, find_backend  # noqa: E402

#: Seeds, and seeds of rows that take longer.
SEEDS, FEW = 20, 5
NAMES = (
    "rts-smoother",
    "kalman-filter",
    "unscented-filter",
    "kalman-grnn",
    "grnn",
    "linear-regression",
)
LEARN = ("grnn", "linear-regression")
#: Window of the paper: measurements before the angle, without speed and steering angle.
PAPER = {"ahead": 1, "inputs": False}
ROADS = ("lane-change", "serpentine")
#: A spin: true friction 0.35, assumed 0.95, after drives on a dry road.
SPIN = "serpentine at 18 m/s, friction 0.35, assumed 0.95: a spin"
SPUN: dict[str, Any] = {
    "road": "serpentine", "speed": 18.0, "samples": 268, "tyre": "saturating", "friction": 0.35,
    "training_friction": 0.95, "mismatch": {"friction": 0.95 / 0.35},
}  # fmt: skip
STOPS = ((0, 22), (4, 10), (7, 0), (9, 0), (14, 15), (24, 22))
#: Relative errors of the mass (too large) and of the stiffness (too small).
SHARES = (0.0, 0.01, 0.02, 0.05, 0.1)


def figures(
    models: Iterable[SideslipEstimation], names: Sequence[str] = NAMES, **options: Any
) -> np.ndarray:
    """Return the mean error and the share within two deviations, shape (models, names, 2)."""
    rows = []
    for model in models:
        row = []
        for name in names:
            backend = find_backend(name)
            request = Request(options=backend.checked_options(options))
            plan = backend.run(model.blinded(), request).point
            row.append((model.verify(plan).objective, model.coverage(plan)))
        rows.append(row)
    return np.array(rows)


def seeded(count: int = SEEDS, **fields: Any) -> Iterator[SideslipEstimation]:
    """Yield the same estimation for several seeds."""
    return (generate(seed=seed, **fields) for seed in range(count))


def drawn(seed: int, beyond: float = 0.0) -> Driver:
    """Return a random driver, or one whose factors are beyond their ranges by a share of the width."""
    rng = np.random.default_rng([seed, 99])
    low, high = np.array(list(RANGES.values())).T
    share = rng.random(len(low))
    if beyond:
        share = np.where(share < 0.5, -beyond, 1 + beyond)
    factors = np.round(low + (high - low) * share, 6).tolist()
    return Driver(**dict(zip(RANGES, factors, strict=True)), **FIXED)


def swapped(road: str, seed: int) -> SideslipEstimation:
    """Return a drive on a road whose training drives are on the other road, at the same speed."""
    other = ROADS[1 - ROADS.index(road)]
    here = generate(road, seed=seed, driver=drawn(seed), drivers=0)
    there = generate(other, seed=seed, speed=here.recording.speed[0])
    fields = {name: getattr(here, name) for name in ("vehicle", "recording", "truth")}
    return SideslipEstimation(training=there.training, **fields)


def store(
    table: str, head: str, columns: dict[str, str], rows: Any, said: str, script: str = __file__
) -> None:
    """Write a table whose first column is a text."""
    write("sideslip", table, script, {head: "", **columns}, rows, ("numpy", "scipy"), said)
    print(*map(list, rows), sep="\n", flush=True)


def estimators() -> None:
    """Write the errors of all estimators, with the coverage of their claims."""
    slip = {"tyre": "saturating"}
    cases = {
        "lane change": (SEEDS, {}),
        "lane change, vehicle wrong by 30 %": (SEEDS, {"mismatch": MISMATCH}),
        "serpentine": (SEEDS, {"road": "serpentine"}),
        "serpentine, vehicle wrong by 30 %": (SEEDS, {"road": "serpentine", "mismatch": MISMATCH}),
        **{
            f"lane change, tyres that saturate, friction {mu:g}": (FEW, {**slip, "friction": mu})
            for mu in (0.9, 0.6, 0.55)
        },
        "stop and go": (FEW, {"speed": STOPS}),
    }
    rows = []
    for label, (count, fields) in cases.items():
        found = figures(seeded(count, **fields))
        errors, shares = np.median(found[..., 0], axis=0), found[..., 1].mean(axis=0)
        cells = [f"{e:.4f} ({100 * s:.0f})" for e, s in zip(errors, shares, strict=True)]
        rows.append([label, *cells, count])
    said = "Mean error in degrees, and in brackets the share of samples within two claimed deviations in per cent."
    store("estimators", "drive", {**dict.fromkeys(NAMES, ""), "seeds": "d"}, rows, said)


def claims() -> None:
    """Write the coverage of the claims on drives of the catalogue with errors of the model, and in a spin."""
    names = ("biased", "friction-change", "ice", "missing", "noisy", "stale")
    cases = {f"sideslip/{name}": ct.load(f"sideslip/{name}") for name in names}
    cases[SPIN] = generate(**SPUN)
    rows = [[name, *figures([model])[0, :, 1]] for name, model in cases.items()]
    said = "Share of samples within two claimed deviations."
    store("claims", "drive", dict.fromkeys(NAMES, ".0%"), rows, said)


def spins() -> None:
    """Write the coverage of the claims in spins that were not used to choose the constants of the gates."""
    models = []
    for friction in (0.32, 0.36, 0.40, 0.44):
        fields = SPUN | {"friction": friction, "mismatch": {"friction": 0.95 / friction}}
        for seed in range(20, 28):
            for speed in (16.0, 17.0, 18.0):
                try:
                    models.append(generate(seed=seed, **fields | {"speed": speed}))
                except InvalidData:  # the vehicle turns by more than 90°, which the model excludes
                    continue
    shares = figures(models)[..., 1]
    rows = [
        [name, float(own.min()), float(np.median(own)), float((own >= 0.9).mean())]
        for name, own in zip(NAMES, shares.T, strict=True)
    ]
    said = (
        f"Share of samples within two claimed deviations in {len(models)} spins: serpentine, true friction 0.32 to "
        "0.44, assumed 0.95, 16 to 18 m/s, seeds 20 to 27; drives beyond 90° are left out."
    )
    columns = {"lowest": ".1%", "median": ".1%", "spins with at least 90 %": ".0%"}
    store("spins", "backend", columns, rows, said)


def learning() -> None:
    """Write the effect of the training drives and of the measurements."""
    rows = []
    for road in ROADS:
        here = {"road": road}
        cases: dict[str, tuple[Iterable[SideslipEstimation], dict[str, Any]]] = {
            "by default": (seeded(FEW, **here), {}),
            "measurements of the paper": (seeded(FEW, **here), PAPER),
            "driver beyond all ranges by 10 %": (
                (generate(road, seed=seed, driver=drawn(seed, 0.1)) for seed in range(FEW)), {},
            ),
            "learned on the other road": ((swapped(road, seed) for seed in range(FEW)), {}),
            **{f"{count} drives to learn from": (seeded(FEW, **here, drivers=count), {}) for count in (1, 30)},
        }  # fmt: skip
        for label, (models, options) in cases.items():
            errors = np.median(figures(models, LEARN, **options)[..., 0], axis=0)
            rows.append([f"{road}, {label}", *errors, None, FEW])
        designs = [
            figures((generate(road, seed=seed, driver=drawn(seed), design=design) for seed in range(SEEDS)), LEARN, **PAPER)
            for design in ("uniform", "random")
        ]  # fmt: skip
        chance = float(wilcoxon(designs[0][:, 0, 0] - designs[1][:, 0, 0]).pvalue)
        for label, found in zip(("uniform design", "random design"), designs, strict=True):
            errors = np.median(found[..., 0], axis=0)
            rows.append(
                [
                    f"{road}, {label}, random driver, measurements of the paper",
                    *errors,
                    chance,
                    SEEDS,
                ]
            )
    columns = {**dict.fromkeys(LEARN, ".4f"), "p of the designs, grnn": ".2g", "seeds": "d"}
    said = "Mean error in degrees. p is of Wilcoxon's signed-rank test between the two designs."
    store("learning", "drive", columns, rows, said)


def mismatch() -> None:
    """Write the smallest mismatch with which grnn has a smaller error than kalman-filter."""
    rows = []
    for road in ROADS:
        least = np.median(figures(seeded(FEW, road=road), ["grnn"])[..., 0])
        cells = []
        for factors in (
            {"mass": 1},
            dict.fromkeys(("cornering_front", "cornering_rear"), -1),
            None,
        ):
            signs = (
                {"mass": 1, "cornering_front": -1, "cornering_rear": -1}
                if factors is None
                else factors
            )
            errors = [
                np.median(
                    figures(
                        seeded(
                            FEW,
                            road=road,
                            mismatch={k: 1 + sign * share for k, sign in signs.items()},
                        ),
                        ["kalman-filter"],
                    )[..., 0]
                )
                for share in SHARES
            ]
            k = int(np.flatnonzero(np.array(errors) > least)[0])
            cells.append(np.interp(least, errors[k - 1 : k + 1], SHARES[k - 1 : k + 1]))
        rows.append([road, *cells])
    columns = dict.fromkeys(("mass too large", "stiffness too small", "both"), ".1%")
    store(
        "mismatch", "road", columns, rows, f"Interpolated between 0, 1, 2, 5 and 10 %; {FEW} seeds."
    )


if __name__ == "__main__":
    for part in (estimators, claims, spins, learning, mismatch):
        if not sys.argv[1:] or part.__name__ in sys.argv[1:]:
            part()
