"""The paper's tables III to VI with our runs: who beats whom, by rank tests over instances.

Its instances are not published; these have its sizes and range of sparsity. Run with ``make bench``,
or::

    CROSSTRACK_MESSENGER_MINUTES=30 pytest tests/benchmarks/messenger/test_messenger_tables.py -s

The minutes (10 by default) are shared out over all runs. All algorithms that can go on do, from fresh
starts, until the time that a run has; the greedy ones end by themselves.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import wilcoxon

import crosstrack as ct
from crosstrack.instances.messenger import generate
from crosstrack.models import MessengerTour

Floats = NDArray[np.float64]

MINUTES = float(os.environ.get("CROSSTRACK_MESSENGER_MINUTES", "10"))
INSTANCES = 10
#: Sparsity of the instances of a size, as in the paper: -1.4 … 17.
SPARSITY = np.linspace(-1.4, 17.0, INSTANCES)


@dataclass(frozen=True)
class Rival:
    """An algorithm with its options."""

    label: str
    backend: str
    options: Mapping[str, Any]

    @property
    def ends(self) -> bool:
        """Whether it ends by itself, long before its time."""
        return "restarts" not in self.options


ON = {"restarts": True}
MA = Rival("MA", "memetic", ON)
MA_T = Rival("MA-T", "memetic-untransformed", ON)
DS = Rival("DS", "direct-sampling", {})
RIVALS = (
    MA,
    MA_T,
    Rival("MAR", "memetic-relaxed", ON),
    Rival("VNS", "variable-neighbourhood", ON),
    Rival("HE-B", "greedy-boundary", {}),
    Rival("HE-B 2-opt", "greedy-boundary", {"two_opt": True}),
    Rival("HE-C", "greedy-centre", {}),
)
#: Vehicles, seeds, and the share of the time that a run has.
SIZES = ((10, 2, 1.0), (20, 1, 4.0), (30, 1, 10.0), (40, 1, 24.0))
#: What a share is, so that table IV takes two thirds of the minutes.
SHARE = MINUTES * 40.0 / sum(INSTANCES * 4 * seeds * part for _, seeds, part in SIZES)


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    model = generate(3, 5.0, 1)
    for one in (*RIVALS, DS):
        ct.solve(model, one.backend)


def length(model: MessengerTour, one: Rival, seed: int, seconds: float | None) -> float:
    """Return the length of the verified plan of a run."""
    found = ct.solve(
        model, one.backend, time_limit=seconds, backend_options=one.options,
        **({} if one.ends else {"seed": seed}),
    )  # fmt: skip
    assert found.verification is not None, found.message
    assert found.verification.ok
    return found.verification.objective


def cell(models: Sequence[MessengerTour], one: Rival, seeds: int, seconds: float | None) -> Floats:
    """Return the mean length over seeds for each instance."""
    return np.array(
        [
            np.mean([length(model, one, seed, seconds) for seed in range(1 if one.ends else seeds)])
            for model in models
        ]
    )


def p_value(ours: Floats, theirs: Floats) -> float:
    """Return the two-sided p of Wilcoxon's signed-rank test on the logarithms of lengths."""
    apart = np.log(ours / theirs)
    return float(wilcoxon(apart, zero_method="zsplit").pvalue) if apart.any() else 1.0


def show(title: str, lengths: Mapping[str, Floats], base: str) -> None:
    """Print one block of a table."""
    print(f"\n{title}")
    print(f"{'':12}{'mean m':>12}{'median m':>12}{'ratio':>9}{'better':>8}{'worse':>7}{'p':>9}")
    for label, found in lengths.items():
        ratio = found / lengths[base]
        print(
            f"{label:12}{found.mean():12.5g}{np.median(found):12.5g}{np.median(ratio):9.4f}"
            f"{(ratio < 1 - 1e-6).sum():8d}{(ratio > 1 + 1e-6).sum():7d}"
            f"{p_value(found, lengths[base]):9.2g}"
        )


def papers(vehicles: int) -> list[MessengerTour]:
    """Return the instances of a size."""
    return [
        generate(vehicles, float(kappa), 100 * vehicles + row)
        for row, kappa in enumerate(SPARSITY, 1)
    ]


@pytest.mark.timeout(0)
@pytest.mark.parametrize("vehicles", [2, 3])
def test_table_three(vehicles: int) -> None:
    """Direct sampling against the memetic algorithm: about equal, and neither is exact."""
    models = papers(vehicles)
    lengths = {
        "DS": cell(models, DS, 1, None),
        "MA": cell(models, replace(MA, options={}), 1, None),
        "MA restarts": cell(models, MA, 3, 4 * SHARE),
    }
    show(f"Table III, {vehicles} vehicles: ratio to DS", lengths, "DS")
    assert np.median(lengths["MA"] / lengths["DS"]) < 1.02


@pytest.mark.timeout(0)
@pytest.mark.parametrize(("vehicles", "seeds", "part"), SIZES)
def test_tables_four_and_five(vehicles: int, seeds: int, part: float) -> None:
    """The memetic algorithm, without its transformation, and the rivals, at equal time."""
    models = papers(vehicles)
    begin = time.perf_counter()
    lengths = {one.label: cell(models, one, seeds, part * SHARE) for one in RIVALS}
    show(
        f"Tables IV and V, {vehicles} vehicles, {part * SHARE:.2f} s a run, {seeds} seeds: ratio to MA",
        lengths, "MA",
    )  # fmt: skip
    print(f"{time.perf_counter() - begin:.0f} s")
    assert np.median(lengths["MA-T"] / lengths["MA"]) > 1.0
    assert p_value(lengths["MA-T"], lengths["MA"]) < 0.05


@pytest.mark.timeout(0)
def test_table_six() -> None:
    """The effect of the two radii, and of the period of local searches, on 10 vehicles."""
    models = [generate(10, 5.0, 600 + row) for row in range(INSTANCES)]
    seconds = 2 * SHARE
    radii = {
        f"{turn:g}, {near:g}": cell(
            [replace(one, turning_radius=turn, radius=near) for one in models], MA, 1, seconds
        )
        for turn in (1.0, 5.0, 10.0)
        for near in (1.0, 5.0, 10.0)
    }
    show(f"Table VI, r_min, r_com, {seconds:.2f} s a run: ratio to 5, 5", radii, "5, 5")
    one_run = replace(MA, options={})
    periods = {}
    for period in (1, 2, 4, 10, 21):
        begin = time.perf_counter()
        label = f"{period}" if period < 21 else "none"
        periods[label] = cell(models, replace(one_run, options={"period": period}), 2, None)
        taken = (time.perf_counter() - begin) / len(models) / 2
        print(f"T_lp {label}: {taken:.2f} s a run of 20 generations")
    show("Table VI, T_lp, 20 generations: ratio to 2", periods, "2")
    assert np.median(radii["1, 10"]) < np.median(radii["10, 1"])
