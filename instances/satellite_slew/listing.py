"""Catalogue entries of satellite slews."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from ...models.satellite_slew.data import VectorLimits
from ...models.satellite_slew.gyros import pyramid_axes
from ...models.satellite_slew.model import SatelliteSlew
from ..catalogue import CatalogueEntry, Provenance, Row, listed

__all__ = ["PAPER", "catalogue_entries"]

PAPER = (
    '"Path Planning for Rapid Large-Angle Maneuver of Satellites Based on the Gauss Pseudospectral '
    'Method", Mathematical Problems in Engineering, 2016'
)

#: Values printed in the paper: final time (s), computing time (s) and tolerance.
_PRINTED: Mapping[str, Any] = {"final_time": 7.836, "computing_seconds": 246.0, "tolerance": 1e-3}
#: Source of values found by several starts on a refined mesh.
_REFINED = "ours: the best of several starts, verified to 1e-6"

_COMPLETED = (
    "The paper prints neither the wheels' momentum h0 nor the weight R of the gimbal rates, and the "
    "final time depends on both"
)
_NORM = (
    "Eq. 23 prints |w| and |T| of vectors, and an index in |δ̇_i| only; plans within the norms keep the "
    "limits under both readings."
)
_OURS = "The satellite is the paper's with limits of each component; the turn is ours."


def catalogue_entries() -> tuple[CatalogueEntry, ...]:
    """Return the catalogue entries of satellite slews."""
    rows = (*_papers(), *_turns(), *_variants())
    return listed("satellite-slew", "satellite-slew", PAPER, rows, note=_OURS)


def _papers() -> tuple[Row, ...]:
    return (
        Row(
            "paper",
            "45° about roll in the least time, 4 gyros; limits of the norms of rate and torque",
            partial(SatelliteSlew, momentum=22.36, vector_limits=VectorLimits.NORM),
            f"{_COMPLETED}: h0 = 22.36 N m s and R = 0.1 s² are ours, and give the paper's 7.836 s. {_NORM}",
            Provenance.COMPLETED,
            {**_PRINTED, "objective": 8.402573, "source": _REFINED},
        ),
        Row(
            "paper-components",
            "The same with limits of each component of rate and torque, and lighter wheels",
            SatelliteSlew,
            f"{_COMPLETED}: h0 = 17.53 N m s and R = 0.1 s² are ours, and give 7.8256 s. The norm of the "
            "rate exceeds 1/8 rad/s by 27 %, that of the torque 25 N m by 22 %.",
            Provenance.COMPLETED,
            {**_PRINTED, "objective": 8.652918, "source": _REFINED},
        ),
        Row(
            "paper-7836",
            "Limits of components, and the wheels' momentum at which it takes the paper's 7.836 s",
            partial(SatelliteSlew, momentum=17.468),
            f"{_COMPLETED}: h0 = 17.468 N m s and R = 0.1 s² are ours.",
            Provenance.COMPLETED,
            _PRINTED,
        ),
        Row(
            "paper-light",
            "Limits of components, lighter wheels, and gimbal rates that cost a tenth",
            partial(SatelliteSlew, momentum=16.704, rate_weight=np.full(4, 0.01)),
            f"{_COMPLETED}: h0 = 16.704 N m s and R = 0.01 s² are ours. With so little weight there "
            "are many local optima: searches stopped at final times from 7.67 to 8.09 s, so use "
            "several starts.",
            Provenance.COMPLETED,
            _PRINTED,
        ),
    )


def _turns() -> tuple[Row, ...]:
    turns = (
        ("pitch-45", "45° about pitch", "pitch", 45.0),
        ("yaw-45", "45° about yaw", "yaw", 45.0),
        ("roll-90", "90° about roll", "roll", 90.0),
        ("roll-180", "180° about roll: the far side, where the scalar part of q ends at 0", "roll", 180.0),
        ("skew-60", "60° about (1, 1, 1)", (1.0, 1.0, 1.0), 60.0),
        ("skew-30", "30° about (2, -2, 1)", (2.0, -2.0, 1.0), 30.0),
    )  # fmt: skip
    return tuple(
        Row(name, title, partial(SatelliteSlew.about, axis, angle), provenance=Provenance.OURS)
        for name, title, axis, angle in turns
    )


def _variants() -> tuple[Row, ...]:
    reserve = "The reserve is ours: a plan at the limits saturates the controller that tracks it."
    margins = tuple(
        Row(
            f"margin-{share}",
            f"The paper's turn with {share} % of the actuators' limits in reserve",
            partial(SatelliteSlew, margin=share / 100),
            reserve,
            Provenance.OURS,
        )
        for share in (10, 20)
    )
    return (
        *margins,
        Row(
            "free-gimbals",
            "The paper's turn, the gimbals ending anywhere",
            partial(SatelliteSlew, final_gimbals=None),
            "The freedom is ours.",
            Provenance.OURS,
        ),
        Row(
            "moving-target",
            "45° about roll towards a moving target: the body rotates about pitch at the end",
            partial(SatelliteSlew, final_rate=np.array([0.0, 0.01, 0.0]), final_gimbals=None),
            "The final rate of 0.57°/s is ours. The gyros end with the momentum that the body then lacks, at "
            "free angles.",
            Provenance.OURS,
        ),
        Row(
            "five-gyros",
            "The paper's turn with five gyros in a pyramid",
            partial(SatelliteSlew, gimbal_axes=pyramid_axes(5, 54.73)),
            "The fifth gyro is ours.",
            Provenance.OURS,
        ),
        Row(
            "infeasible",
            "The paper's turn in 8 s with a fifth of its torque: too little for the time",
            partial(SatelliteSlew, torque_limit=5.0, time_range=np.array([1.0, 8.0])),
            "Ours, and infeasible by construction. As the total momentum is zero, I ẇ = T_c: the rate "
            "grows by at most |(5/228, 5/188, 5/176)| = 0.0446 rad/s² and has to come down again, so "
            "45° take at least 8.39 s.",
            Provenance.OURS,
        ),
    )
