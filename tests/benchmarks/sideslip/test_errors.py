"""Errors of all estimators of the sideslip angle: the paper's table over many seeds, and what it lacks.

A wrong vehicle, and from how wrong on the filter loses; drivers that the training has not; the
uniform design against random ones; both tyre laws; what was claimed against what was missed.

Shown are medians over the seeds of the mean error in degrees. ``moving-horizon`` is left out, as with
linear tyres it gives what ``kalman-filter`` gives. Nothing depends on the clock. Run with ``make bench``,
or with other seeds::

    CROSSTRACK_SIDESLIP_SEEDS=40 pytest tests/benchmarks/sideslip/test_errors.py -s
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from scipy import stats

import crosstrack as ct
from crosstrack.instances import entries
from crosstrack.instances.sideslip.drivers import RANGES, Driver
from crosstrack.instances.sideslip.generator import generate
from crosstrack.models import SideslipEstimation
from crosstrack.solvers import Request, find_backend

SEEDS = int(os.environ.get("CROSSTRACK_SIDESLIP_SEEDS", "20"))
#: Seeds where there are many rows.
FEW = max(SEEDS // 4, 2)
NAMES = ("rts-smoother", "kalman-filter", "kalman-grnn", "grnn", "linear-regression")
KERNELS, LINE, FILTER = NAMES.index("grnn"), NAMES.index("linear-regression"), 1
ROADS = ("lane-change", "serpentine")
#: What the paper's network may miss, degrees, as a band about its 0.0295 and 0.0377.
ALLOWED = {"lane-change": 0.05, "serpentine": 0.07}
WRONG = {"mass": 1.3, "cornering_front": 0.7, "cornering_rear": 0.7}
#: Parts by which mass is believed too large and stiffness too small.
PARTS = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4)
LEVEL = 0.05

Figures = np.ndarray


def figures_of(model: SideslipEstimation, name: str, **own: Any) -> tuple[float, float, float]:
    """Return the mean error of a run, the deviation of its errors, and the share within 2 deviations."""
    backend = find_backend(name)
    request = Request(options=backend.checked_options(own))
    plan = backend.run(model.blinded(), request).point
    off = np.degrees(plan.sideslip - model.truth)[model.recording.moving]
    return float(model.verify(plan).objective), float(off.std()), model.coverage(plan)


def measured(models: Iterable[SideslipEstimation], names: Sequence[str] = NAMES) -> Figures:
    """Return the figures of every run, shape (models, names, 3)."""
    return np.array([[figures_of(model, name) for name in names] for model in models])


def seeded(count: int = SEEDS, **fields: Any) -> Iterable[SideslipEstimation]:
    """Return the same estimation by so many seeds."""
    return (generate(seed=seed, **fields) for seed in range(count))


def show(
    capsys: Any, title: str, rows: Mapping[str, Figures], names: Sequence[str] = NAMES
) -> None:
    """Print medians of errors, and in brackets means of shares within two deviations."""
    with capsys.disabled():
        counts = "/".join(str(one) for one in sorted({len(found) for found in rows.values()}))
        print(f"\n{title}: mean error (°, median of {counts} seeds), share within 2 deviations (%)")
        print("| | " + " | ".join(names) + " |\n|---|" + "---|" * len(names))
        for label, found in rows.items():
            errors, shares = np.median(found[..., 0], axis=0), found[..., 2].mean(axis=0)
            cells = (f"{e:.4f} ({100 * s:.0f})" for e, s in zip(errors, shares, strict=True))
            print(f"| {label} | " + " | ".join(cells) + " |", flush=True)


@pytest.mark.timeout(0)
@pytest.mark.parametrize("road", ROADS)
def test_the_table_and_the_same_with_a_wrong_vehicle(road: str, capsys: Any) -> None:
    known, wrong = measured(seeded(road=road)), measured(seeded(road=road, mismatch=WRONG))
    show(capsys, f"Table 3, {road}", {"vehicle known": known, "wrong by 30 %": wrong})
    middle, worse = np.median(known[..., 0], axis=0), np.median(wrong[..., 0], axis=0)
    every = known[:, KERNELS]
    with capsys.disabled():
        print(
            f"grnn: mean error {every[:, 0].min():.4f} … {every[:, 0].max():.4f}, deviation of its errors "
            f"{np.median(every[:, 1]):.4f}; linear-regression is better on "
            f"{int((known[:, LINE, 0] < every[:, 0]).sum())} of {SEEDS} seeds"
        )
    assert middle[KERNELS] <= ALLOWED[road]
    assert worse[KERNELS] <= ALLOWED[road]
    assert middle[FILTER] < middle[KERNELS]
    assert worse[FILTER] > 2 * worse[KERNELS]
    both = NAMES.index("kalman-grnn")
    assert middle[both] <= 1.05 * middle[FILTER]
    assert worse[both] < 1.1 * worse[KERNELS]


@pytest.mark.timeout(0)
@pytest.mark.parametrize("road", ROADS)
@pytest.mark.parametrize("what", ["mass", "stiffness", "both"])
def test_from_which_mismatch_on_the_filter_loses(road: str, what: str, capsys: Any) -> None:
    names = ("kalman-filter", "kalman-grnn")
    # Kernels alone know of no vehicle.
    kernels = np.median(measured(seeded(FEW, road=road), ["grnn"])[..., 0])
    rows, middle = {}, []
    for part in PARTS:
        factors = {"mass": 1 + part} if what != "stiffness" else {}
        if what != "mass":
            factors |= {"cornering_front": 1 - part, "cornering_rear": 1 - part}
        rows[f"{100 * part:.0f} %"] = measured(seeded(FEW, road=road, mismatch=factors), names)
        middle.append(np.median(rows[f"{100 * part:.0f} %"][..., 0], axis=0))
    show(capsys, f"{road}, {what} believed wrong", rows, names)
    filters, both = np.array(middle).T
    assert filters[0] < kernels < filters[-1]
    k = int(np.flatnonzero(filters > kernels)[0])
    crossing = np.interp(kernels, filters[k - 1 : k + 1], PARTS[k - 1 : k + 1])
    with capsys.disabled():
        print(
            f"grnn: {kernels:.4f}; the filter loses to it from {100 * crossing:.1f} % on",
            flush=True,
        )
    assert (both <= 1.05 * filters).all()


def drawn(seed: int, beyond: float = 0.0) -> Driver:
    """Return a random driver of the ranges, or one whose every parameter is so far beyond an end."""
    rng = np.random.default_rng([seed, 99])
    low, high = np.array(RANGES).T
    share = rng.random(len(low))
    if beyond:
        share = np.where(share < 0.5, -beyond, 1 + beyond)
    return Driver(*np.round(low + (high - low) * share, 6).tolist())


@pytest.mark.timeout(0)
@pytest.mark.parametrize("road", ROADS)
def test_drivers_that_no_training_has(road: str, capsys: Any) -> None:
    other = {"lane-change": "serpentine", "serpentine": "lane-change"}[road]
    rows = {
        f"{label} drivers": measured(
            generate(road, seed=seed, driver=drawn(seed, beyond)) for seed in range(count)
        )
        for label, beyond, count in (
            ("random", 0.0, SEEDS),
            ("beyond all ranges by 10 %, other", 0.1, FEW),
        )
    }

    def swapped(seed: int) -> SideslipEstimation:
        there = generate(other, seed=seed, speed=generate(road, drivers=0).recording.speed[0])
        here = generate(road, seed=seed, driver=drawn(seed), drivers=0)
        fields = {name: getattr(here, name) for name in ("vehicle", "recording", "truth")}
        return SideslipEstimation(training=there.training, **fields)

    rows["random drivers, learned on the other road"] = measured(map(swapped, range(FEW)))
    for count in (1, 3, 7, 30):
        rows[f"random drivers, {count} to learn from"] = measured(
            generate(road, seed=seed, driver=drawn(seed), drivers=count) for seed in range(FEW)
        )
    show(capsys, f"{road}, held-out drivers", rows)
    assert np.median(rows["random drivers"][:, KERNELS, 0]) <= ALLOWED[road]


@pytest.mark.timeout(0)
@pytest.mark.parametrize("road", ROADS)
@pytest.mark.parametrize("drivers", [5, 15])
def test_uniform_design_against_random(road: str, drivers: int, capsys: Any) -> None:
    names = ("grnn", "linear-regression")
    rows = {
        design: measured(
            (
                generate(road, seed=seed, driver=drawn(seed), drivers=drivers, design=design)
                for seed in range(SEEDS)
            ),
            names,
        )
        for design in ("uniform", "random")
    }
    show(capsys, f"{road}, {drivers} training drivers by design", rows, names)
    for k, name in enumerate(names):
        uniform, random = (rows[design][:, k, 0] for design in ("uniform", "random"))
        chance = stats.wilcoxon(uniform, random).pvalue
        with capsys.disabled():
            print(
                f"{name}: random / uniform {np.median(random / uniform):.3f} (median), Wilcoxon's "
                f"p = {chance:.2g}, greatest error {uniform.max():.4f} and {random.max():.4f}",
                flush=True,
            )
        assert 0.8 < np.median(random / uniform) < 1.5


@pytest.mark.timeout(0)
def test_tyre_laws(capsys: Any) -> None:
    rows = {}
    for friction in (0.9, 0.6, 0.55):
        fields = {"tyre": "saturating", "friction": friction}
        rows[f"saturating, friction {friction:g}"] = measured(seeded(FEW, **fields))
        rows[f"friction {friction:g}, believed linear"] = measured(
            seeded(FEW, **fields, believed_tyre="linear")
        )
    show(capsys, "lane-change by tyres", rows)
    last = np.median(rows["saturating, friction 0.55"][..., 0], axis=0)
    assert last[KERNELS] < last[LINE]  # what no line follows


@pytest.mark.timeout(0)
def test_the_catalogue(capsys: Any) -> None:
    """Every entry with a truth, once: also what was claimed where the training does not fit."""
    rows = {}
    for entry in entries():
        if entry.name.startswith("sideslip/"):
            model = ct.load(entry.name)
            if model.truth is not None and model.training:
                rows[entry.name.partition("/")[2]] = measured([model])
    show(capsys, "The catalogue", rows)
    assert all(np.isfinite(found).all() for found in rows.values())


@pytest.mark.timeout(0)
@pytest.mark.parametrize("road", ROADS)
def test_what_the_angle_is_estimated_from(road: str, capsys: Any) -> None:
    """The paper's choice, the sample itself beside those before it, and speed and steering angle."""
    names = ("grnn", "linear-regression", "kalman-grnn")
    stops = ((0, 22), (4, 10), (7, 0), (9, 0), (14, 15), (24, 22))
    for title, fields in ((road, {}), (f"{road}, stop and go", {"speed": stops})):
        models, rows = list(seeded(FEW, road=road, **fields)), {}
        for label, own in (
            ("5 before (paper)", {}),
            ("1 before", {"lags": 1}),
            ("10 before", {"lags": 10}),
            ("5 up to now", {"ahead": 0}),
            ("5 before, with inputs", {"inputs": True}),
            ("5 up to now, with inputs", {"ahead": 0, "inputs": True}),
        ):
            rows[label] = np.array(
                [[figures_of(model, name, **own) for name in names] for model in models]
            )
        show(capsys, title, rows, names)
        assert all(np.isfinite(found).all() for found in rows.values())
