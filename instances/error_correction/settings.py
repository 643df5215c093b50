"""The settings and published figures of the paper on error-correction routes.

Source: "Model and algorithm of UAV path planning considering error correction points", Computer
Integrated Manufacturing Systems, 2022, doi 10.13196/j.cims.2022.04.003, tables 1 to 3. The paper
does not publish its coordinates: the seeds are ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

__all__ = [
    "BOX",
    "DELTA",
    "EXAMPLE_1_OPTIMUM",
    "PAPER",
    "SETTINGS",
    "TABLE_2",
    "TABLE_3",
    "TIGHT",
    "LargeFigures",
    "Setting",
    "SmallFigures",
    "Thresholds",
    "published",
]

#: The citation.
PAPER = (
    "Model and algorithm of UAV path planning considering error correction points, "
    "Computer Integrated Manufacturing Systems, 2022, doi 10.13196/j.cims.2022.04.003"
)

#: Error gained per metre flown, of both kinds, in every row of table 1 (paper: δ).
DELTA = 0.001

#: Edge (m) of the cube that holds the points.
BOX = 100_000.0

#: Length of the optimal route of the paper's example 1.
EXAMPLE_1_OPTIMUM = 4.5


class Thresholds(NamedTuple):
    """The five thresholds in the paper's order.

    Parameters
    ----------
    alpha1, alpha2 : float
        Largest vertical and horizontal error on arrival at a vertical point (paper: α1, α2).
    beta1, beta2 : float
        Largest vertical and horizontal error on arrival at a horizontal point (paper: β1, β2).
    theta : float
        Largest error of either kind on arrival at B (paper: θ).
    """

    alpha1: float
    alpha2: float
    beta1: float
    beta2: float
    theta: float


@dataclass(frozen=True)
class Setting:
    """One row of table 1.

    Parameters
    ----------
    row : int
        Number of the row.
    n : int
        Number of points, A and B included.
    horizontal, vertical : int
        Number of horizontal and of vertical correction points.
    thresholds : Thresholds
        Of the row.
    seed : int
        Ours, for the points; rows with the same seed have the same points.
    contest_optimum : float, optional
        Length (m) of the optimal route on the points of a public contest that have the sizes of the row; proven by
        several exact methods. The paper says that its points are random.
    printed_vertical : int, optional
        The printed number of vertical points; by default the one that is used.
    """

    row: int
    n: int
    horizontal: int
    vertical: int
    thresholds: Thresholds
    seed: int
    contest_optimum: float | None = None
    printed_vertical: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "printed_vertical", self.printed_vertical or self.vertical)


@dataclass(frozen=True)
class SmallFigures:
    """One row of table 2: Gurobi 8.0 on the program of eq. 1-24 against two-stage.

    `gurobi` and `two_stage` are seconds, and `optimum` is the length (m) that both found.
    """

    gurobi: float
    optimum: float
    two_stage: float


@dataclass(frozen=True)
class LargeFigures:
    """One row of table 3: seconds of three algorithms.

    The stages of the two-stage algorithm and the whole are T1, T2 and T in the paper.
    """

    stage_1: float
    stage_2: float
    two_stage: float
    pulse: float
    dynamic_programming: float


#: Thresholds of rows 7 and 10, the tightest of the three that share their points.
TIGHT = Thresholds(20, 10, 15, 20, 20)
_MIDDLE = Thresholds(25, 15, 20, 25, 30)
_WIDE = Thresholds(50, 50, 50, 50, 50)

#: Table 1 by row.
SETTINGS: dict[int, Setting] = {
    setting.row: setting
    for setting in (
        Setting(1, 15, 6, 7, _WIDE, seed=144),
        Setting(2, 20, 12, 6, Thresholds(45, 50, 45, 50, 45), seed=219),
        Setting(3, 21, 12, 7, Thresholds(50, 50, 50, 50, 45), seed=75),
        # Table 1 prints 9, which with A and B are 23 points and not 25.
        Setting(4, 25, 12, 11, Thresholds(45, 45, 45, 50, 45), seed=72, printed_vertical=9),
        Setting(5, 31, 13, 16, Thresholds(45, 45, 45, 50, 45), seed=245),
        Setting(6, 38, 20, 16, Thresholds(45, 45, 45, 45, 45), seed=42),
        Setting(7, 327, 167, 158, TIGHT, seed=39, contest_optimum=109342.281),
        Setting(8, 327, 167, 158, _MIDDLE, seed=39, contest_optimum=106545.931),
        Setting(9, 327, 167, 158, _WIDE, seed=39, contest_optimum=103251.457),
        Setting(10, 613, 306, 305, TIGHT, seed=93),
        Setting(11, 613, 306, 305, _MIDDLE, seed=93),
        Setting(12, 613, 306, 305, _WIDE, seed=93),
    )
}

#: Table 2 by row of table 1.
TABLE_2: dict[int, SmallFigures] = {
    1: SmallFigures(0.34, 154094.0, 0.0121),
    2: SmallFigures(1.15, 101260.0, 0.0150),
    3: SmallFigures(0.09, 136411.0, 0.0072),
    4: SmallFigures(0.66, 124505.0, 0.0120),
    5: SmallFigures(10.52, 128416.0, 0.0300),
    6: SmallFigures(439.59, 135068.0, 0.0840),
}

#: Table 3 by row of table 1.
TABLE_3: dict[int, LargeFigures] = {
    7: LargeFigures(0.71, 0.22, 0.94, 3.76, 4.59),
    8: LargeFigures(1.24, 0.31, 1.55, 15.68, 17.60),
    9: LargeFigures(2.4, 1.79, 4.19, 542.18, 726.76),
    10: LargeFigures(0.24, 0.06, 0.30, 0.60, 0.64),
    11: LargeFigures(0.38, 0.07, 0.45, 1.75, 2.06),
    12: LargeFigures(0.65, 0.15, 0.80, 32.62, 55.06),
}


def published(row: int) -> dict[str, Any]:
    """Return the paper's figures for `row` as JSON data, algorithms by their backends' names.

    They belong to the paper's own points, which are not ours.
    """
    if row in TABLE_2:
        small = TABLE_2[row]
        return {
            "table": 2,
            "row": row,
            "optimum": small.optimum,
            "seconds": {"gurobi": small.gurobi, "two-stage": small.two_stage},
            "solver": "Gurobi 8.0 on the program of eq. 1-24",
        }
    large = TABLE_3[row]
    return {
        "table": 3,
        "row": row,
        "seconds": {
            "two-stage": large.two_stage,
            "pulse": large.pulse,
            "dynamic-programming": large.dynamic_programming,
        },
        "two_stage_seconds": {"stage 1": large.stage_1, "stage 2": large.stage_2},
    }
