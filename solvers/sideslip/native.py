"""Base class of the sideslip estimators, and their result."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import UnsupportedFormulation
from ...jit import clock
from ...models.sideslip.checks import SENSORS, stuck_samples, without_faults
from ...models.sideslip.data import UNKNOWN
from ...models.sideslip.model import SideslipEstimation
from ...models.sideslip.plan import SideslipEstimate
from ..contract.backend import Answer, Backend, Feature, Guarantee, Limit, Request, Termination
from .gates import apply_gates, small_angle_error, time_ranges

__all__ = ["UNKNOWN", "Estimate", "SideslipBackend", "leave_faults_out"]

Floats = NDArray[np.float64]


class Estimate(NamedTuple):
    """Result of an estimator.

    Parameters
    ----------
    sideslip, deviation : ndarray, shape (n,)
        The angle and its standard deviation, rad.
    statistics : mapping
        Statistics of the estimator; empty by default.
    message : str
        Warning for the user; empty by default.
    spread : float
        Standard deviation of the training targets, rad; 0, the default, for estimators that do not learn.
    history : bool
        True if the deviation does not account for recent inputs that differ from the training drives; False by default.
    grip_lost : tuple of (begin, end)
        Time ranges in seconds while an axle slides; empty by default.
    """

    sideslip: Floats
    deviation: Floats
    statistics: Mapping[str, Any] = {}
    message: str = ""
    spread: float = 0.0
    history: bool = False
    grip_lost: tuple[tuple[float, float], ...] = ()


def leave_faults_out(problem: SideslipEstimation) -> tuple[SideslipEstimation, str]:
    """Return a model without faults of its sensors, see :func:`without_faults`, and a message on them."""
    drives = problem.recording, *problem.training
    here, *training = (without_faults(drive) for drive in drives)
    if all(new is old for new, old in zip((here, *training), drives, strict=True)):
        return problem, ""
    remarks = []
    spikes = 0
    for name, wrong in zip(SENSORS, stuck_samples(drives[0]), strict=True):
        differs = getattr(here, name) != getattr(drives[0], name)
        spikes += int(np.count_nonzero(differs & ~wrong))
        if (differs & wrong).any():
            remarks.append(
                f"{name} is stuck at {time_ranges(drives[0], wrong)}: it is replaced by the other sensor"
            )
    if spikes:
        remarks.append(
            f"spikes of the sensors ({spikes}) are replaced by the median of five samples"
        )
    replaced = replace(problem, recording=here, training=tuple(training), truth=None)
    return replaced, "; ".join(remarks)


class SideslipBackend(Backend):
    """Base class of the estimators. A subclass implements :meth:`estimate`."""

    accepts = SideslipEstimation
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.INTERRUPT})
    deterministic = True
    single_threaded = True
    shares_process = True
    #: True if the estimator needs training drives.
    learns = False

    def refuses(self, problem: SideslipEstimation) -> str:
        """Return the reason if the model lacks the training drives that the estimator needs, else ""."""
        if self.learns and not problem.training:
            return "it learns from drives whose angle is known, and the model has no training"
        return ""

    def revise(self, problem: SideslipEstimation) -> tuple[SideslipEstimation, str]:
        """Return the model that is estimated, and a message on its differences: `problem` by default."""
        return problem, ""

    @abstractmethod
    def estimate(self, problem: SideslipEstimation, request: Request) -> Estimate | None:
        """Return the estimate, or None if the run was stopped before one was available."""

    def run(self, problem: SideslipEstimation, request: Request) -> Answer:
        """Return the estimate after the gates. At rest its deviation is that of an unknown angle."""
        refusal = self.refuses(problem)
        if refusal:
            raise UnsupportedFormulation(f"backend {self.name!r}: {refusal}")
        begin = clock()
        problem, remark = self.revise(problem)
        with np.errstate(all="ignore"):  # infinite and NaN angles are replaced below
            estimate = self.estimate(problem, request)
        seconds = {"solve": clock() - begin}
        if estimate is None:
            reason = request.control.reason or Limit.TIME
            return Answer(Termination.NO_SOLUTION, reason, seconds=seconds)
        is_finite = np.isfinite(estimate.sideslip) & np.isfinite(estimate.deviation)
        lost = int((~is_finite).sum())
        angle = np.where(is_finite, np.clip(estimate.sideslip, -math.pi / 2, math.pi / 2), 0.0)
        claimed = np.clip(np.where(is_finite, estimate.deviation, UNKNOWN), 0.0, UNKNOWN)
        if not self.learns:
            claimed = np.minimum(np.hypot(claimed, small_angle_error(problem)), UNKNOWN)
        with np.errstate(all="ignore"):
            gated = apply_gates(problem, angle, claimed, estimate.spread, history=estimate.history)
        deviation = np.where(problem.recording.moving, gated.deviation, UNKNOWN)
        plan = SideslipEstimate(angle, deviation, estimate.grip_lost)
        counts = {
            "samples without an estimate": lost,
            "samples contradicted by kinematics": int(gated.contradicted.sum()),
            "samples outside of the training range": int(gated.outside.sum()),
        }
        statistics = {
            **estimate.statistics,
            **{name: count for name, count in counts.items() if count},
        }
        return Answer(
            Termination.FEASIBLE, request.control.limit, plan, None, seconds=seconds,
            statistics=statistics,
            message="; ".join(part for part in (remark, estimate.message, *gated.messages) if part),
        )  # fmt: skip
