"""Judgement of a series, the evidence for it, and the rules between them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from ...errors import InvalidData
from ..declaration import Declared, Nested
from ..fields import Optional, Real, Whole, declared
from ..records import Member

__all__ = ["Evidence", "Judgement", "SurrogateTest"]

#: Nats that neighbours of a regular motion stay nearer than random states, and largest growth of their distance.
TOGETHER, GROWTH = 1.5, 1.0
#: Error of a linear prediction that is due to rounding, and of one of a sum of few lines. Noise in a narrow band has
#: errors from 5e-7.
EXACT, LINES = 1e-8, 0.01
#: Largest ratio of errors of a deterministic motion.
DETERMINED = 0.75
#: Ratio of errors above which the prediction is unclear. Deviations by which the exponent of a chaotic series exceeds 0:
#: then, of maps or flows with few samples per period, and of other flows. Noise that drives a nonlinear system without
#: chaos has ratios from 0.44, or a map with an exponent above 0 by at most 2.6 deviations.
UNCLEAR, DEVIATIONS, MAP_DEVIATIONS, FLOW_DEVIATIONS = 0.4, 4.0, 3.0, 2.0
#: Present edition of the rules, and the ratio of errors above which the prediction is unclear in the first edition.
EDITION, FIRST_UNCLEAR = 2, 0.45
#: Ratio of errors up to which the motion explains nine tenths of the variance that a linear model leaves.
EXPLAINED = math.sqrt(0.1)
#: Smallest correlation of the 0-1 test for chaos.
IRREGULAR = 0.2
#: Smallest separation of neighbours over a chaotic series in nats: of flows, and of maps or flows with few samples per
#: period. A strange map without chaos shows up to 56 (1,000 samples).
NATS, MAP_NATS = 15.0, 80.0
#: Uncertainty of an exponent in nats over the whole series: neighbours that separate slowly, as on the strange
#: attractor without chaos of Grebogi, Ott, Pelikan and Yorke, show a slope of 10 to 40 nats per series.
PARTINGS = 12.0


class Judgement(StrEnum):
    """Result of the tests of a series. A positive exponent alone never implies chaos."""

    #: Linear noise is rejected, and nearby states part exponentially.
    CHAOTIC = "chaotic"
    #: Linear noise is rejected, but neither a regular nor a chaotic motion is shown: undecided.
    NONLINEAR = "nonlinear"
    #: Linear noise explains the series as well.
    NOISE = "noise"
    #: Periodic or quasi-periodic: nearby states stay together.
    REGULAR = "regular"


@dataclass(frozen=True, eq=False)
class Evidence(Declared):
    """Figures of a series that separate noise, regular and chaotic motion.

    Parameters
    ----------
    ahead : int
        Samples ahead of both predictions, >= 1.
    linear, nonlinear : float
        Root mean square errors of predicting by the best autoregressive model and by the nearest states, in standard
        deviations of the series. The latter is the smaller one of their mean and of a linear map of them.
    near, far : float
        Mean logarithm of the distance of random states over that of nearest neighbours, at first and later than a
        sixth of the series, in nats.
    step : int
        Samples per sample of the 0-1 test, >= 1.
    zero_one : float
        Median correlation K of the 0-1 test (Gottwald and Melbourne 2009): 0 for regular motion, 1 for chaos
        and for noise.
    edition : int, optional
        Edition of the figures and of the rules for them, 1 or 2. In the first one, `nonlinear` is the error of the mean
        alone, `step` is an eighth of the mean period instead of a sixth, and deviations are compared as they are.
    """

    ahead: int = declared(Whole(1))
    linear: float = declared(Real(lower=0))
    nonlinear: float = declared(Real(lower=0))
    near: float = declared(Real())
    far: float = declared(Real())
    step: int = declared(Whole(1))
    zero_one: float = declared(Real(lower=-1.0, upper=1.0))
    edition: int = declared(Whole(1, EDITION), added=True, default=1)

    @property
    def stays(self) -> bool:
        """Whether the motion is regular: a short linear recursion is exact, or neighbours do not part.

        They must be near or nearly follow a linear recursion. So does noise in a narrow band, but its neighbours part.
        """
        together = self.near - self.far <= GROWTH
        close = self.far >= TOGETHER or self.linear <= LINES
        return self.linear <= EXACT or (together and close)

    @property
    def needed(self) -> float:
        """Smallest separation of neighbours over the length of a chaotic series, in nats."""
        return NATS if self.step > 1 else MAP_NATS

    @property
    def deviations(self) -> float:
        """Smallest number of deviations by which the exponent of a chaotic series exceeds 0."""
        unclear = UNCLEAR if self.edition == EDITION else FIRST_UNCLEAR
        if self.nonlinear > unclear * self.linear:
            return DEVIATIONS
        return FLOW_DEVIATIONS if self.step > 1 else MAP_DEVIATIONS

    def doubts(self, exponent: float, deviation: float, duration: float) -> str:
        """Return the reason why an exponent does not show chaos in a series of so many seconds, or an empty text.

        Its deviation includes 12 nats over the series. The separation of neighbours has a limit for the same effect, so this
        part is removed from the deviation if no noise can cause it.
        """
        nats, whole = exponent * duration, deviation * duration
        if self.edition == EDITION and self.nonlinear <= EXPLAINED * self.linear:
            whole = math.sqrt(max((whole - PARTINGS) * (whole + PARTINGS), 0.0))
        if nats <= self.deviations * whole:
            return (
                f"the exponent {exponent:.4g} ± {whole / duration:.2g} must exceed 0 by "
                f"{self.deviations:g} deviations"
            )
        if nats < self.needed:
            return (
                f"neighbours part by {nats:.3g} nats over its length: "
                f"{self.needed:g} are needed to call it chaotic"
            )
        return ""

    @property
    def refutes(self) -> str:
        """Reason against chaos, or an empty text."""
        if self.nonlinear > DETERMINED * self.linear:
            return "the nearest states do not predict clearly better than a linear model"
        if self.far >= TOGETHER:
            return "neighbours have not parted within a third of the series"
        if self.zero_one < IRREGULAR:
            return f"the 0-1 test gives {self.zero_one:.2g}"
        return ""


@dataclass(frozen=True, eq=False)
class SurrogateTest(Declared):
    """Test of a series against surrogates that are linear noise.

    Parameters
    ----------
    judgement : Judgement
        Result of the test.
    count : int
        Number of surrogates.
    exceeded : int
        Number of surrogates that are at least as predictable as the series.
    evidence : Evidence, optional
        Further figures that the judgement follows from.
    """

    judgement: Judgement = declared(Member(Judgement))
    count: int = declared(Whole(1))
    exceeded: int = declared(Whole(0))
    evidence: Evidence | None = declared(Optional(Nested(Evidence)), added=True, default=None)

    def check(self) -> None:
        """Reject `exceeded` above `count`."""
        if self.exceeded > self.count:
            raise InvalidData(
                f"exceeded must be <= count = {self.count}, got {self.exceeded}", field="exceeded"
            )

    @property
    def p_value(self) -> float:
        """Probability of a rank at least as extreme by chance."""
        return (1 + self.exceeded) / (1 + self.count)

    def __str__(self) -> str:
        return f"{self.judgement} (p = {self.p_value:.3g})"
