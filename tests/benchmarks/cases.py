"""Cases of the benchmarks: the paper's large rows, and uniform points in a slab."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import crosstrack as ct
from crosstrack.errors import UnsupportedFormulation
from crosstrack.instances.error_correction import uniform_slab
from crosstrack.models import ErrorCorrectionRouting

__all__ = ["CASES", "HEAVY", "Case", "arc_count"]

#: The public points of rows 7-9; they may be used from here, but never copied.
POINTS = (
    Path(__file__).resolve().parents[3] / "shared" / "data" / "error-correction" / "points_327.csv"
)

#: Thresholds of rows 7-9, with the optimum on the public points.
ROWS = {
    7: ((20, 10, 15, 20, 20), 109342.281),
    8: ((25, 15, 20, 25, 30), 106545.931),
    9: ((50, 50, 50, 50, 50), 103251.457),
}

#: Thresholds of the slab by number of points.
SLABS = {10_000: (25, 15, 20, 25, 30), 100_000: (10, 5, 7.5, 10, 10)}


@dataclass(frozen=True, eq=False)
class Case:
    """One instance to time.

    Parameters
    ----------
    name : str
        As the table shows it.
    size : int
        Number of points.
    seed : int, optional
        Seed of a slab.
    row : int, optional
        The paper's row.
    repeats : int
        Number of calls of ``label-setting``.
    peer_repeats : int
        Number of calls of every other solver; 0 skips them.
    goals : tuple of 2 floats
        Target times of ``label-setting``, s: of the solver and of the whole call; inf for no target.
    """

    name: str
    size: int
    seed: int | None = None
    row: int | None = None
    repeats: int = 50
    peer_repeats: int = 5
    goals: tuple[float, float] = (float("inf"), float("inf"))

    @cached_property
    def model(self) -> ErrorCorrectionRouting:
        """The instance."""
        if self.row is None:
            return uniform_slab(self.size, SLABS[self.size], seed=self.seed, name=self.name)
        if not POINTS.exists():
            return ct.load(f"error-correction/{self.row}")
        with POINTS.open(encoding="utf-8") as file:
            table = list(csv.DictReader(file))
        points = [[float(line[axis]) for axis in "xyz"] for line in table]
        kinds = [line["kind"] for line in table]
        return ErrorCorrectionRouting(
            points, kinds, *ROWS[self.row][0], delta=0.001, name=self.name
        )

    def fresh(self) -> ErrorCorrectionRouting:
        """Return a new model of the same content, on which nothing has been computed yet."""
        m = self.model
        thresholds = (m.alpha1, m.alpha2, m.beta1, m.beta2, m.theta)
        rates = (m.horizontal_rate, m.vertical_rate)
        return ErrorCorrectionRouting(m.points, m.kinds, *thresholds, *rates, name=m.name)

    @property
    def optimum(self) -> float | None:
        """The optimum that is known beforehand."""
        return ROWS[self.row][1] if self.row is not None and POINTS.exists() else None

    @cached_property
    def reference(self) -> ct.Solution:
        """The solution of ``label-setting``, against which the others are checked."""
        return ct.solve(self.model, "label-setting")


def _cases() -> list[Case]:
    origin = "public points" if POINTS.exists() else "points by seed"
    cases = [
        Case(f"row {row}, 327 {origin}", 327, row=row, repeats=200, goals=(1e-3, 10e-3))
        for row in ROWS
    ]
    cases += [
        Case(f"slab 10,000, seed {seed}", 10_000, seed, peer_repeats=1, goals=(0.1, float("inf")))
        for seed in range(3)
    ]
    # The peers need minutes on the largest, so that they are shown one seed of it.
    cases += [
        Case(
            f"slab 100,000, seed {seed}",
            100_000,
            seed,
            repeats=20,
            peer_repeats=int(seed == 0),
            goals=(1.0, float("inf")),
        )
        for seed in range(3)
    ]
    return cases


CASES = {case.name: case for case in _cases()}

#: Arcs above which a solver that holds every arc as an object or a column is not started.
HEAVY = 1_000_000


@cache
def arc_count(case: Case) -> int | str:
    """Return the number of arcs that thresholds leave possible, or why they were not counted."""
    try:
        return len(case.model.formulate("arc-flow").arcs)
    except UnsupportedFormulation as error:
        return str(error).partition(":")[0]
