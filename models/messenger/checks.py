"""Independent verification of a tour by integration of its primitives."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, show
from ..fields import required
from ..verification import NEAR, Check, Verification, check_entries, check_tolerance
from .data import TourData
from .plan import SIGNS, TourPlan
from .zones import depth, size_of

__all__ = ["UNDECIDABLE", "check_start", "decidable_length", "integrated", "verify_tour"]

Floats = NDArray[np.float64]

#: Relative rounding error of the coordinates of a path of many primitives.
DIGITS = 1e-13
#: Share of a limit above which rounding makes a check undecidable.
CEILING = NEAR
UNDECIDABLE = "not decidable in double precision"


def integrated(plan: TourPlan, turning_radius: float) -> Floats:
    """Return the poses at the ends of the k primitives, each integrated from the previous one.

    The poses are x, y (m) and heading (rad), shape (k + 1, 3), at the start and after each primitive. With a
    turning radius (m) of 0, the UAV turns on the spot to the heading of the next primitive.
    """
    pieces = plan.primitives
    lengths = np.array([primitive.length for primitive in pieces])
    signs = np.array([SIGNS[primitive.turn] for primitive in pieces])
    # Half the angle of each primitive. The chord formula of an arc covers the line as angle 0.
    half = 0.5 * signs * lengths / turning_radius if turning_radius > 0 else np.zeros(len(pieces))
    if turning_radius > 0:
        headings = plan.start[2] + np.concatenate([[0.0], np.cumsum(2.0 * half)])
    else:
        initial = np.array([primitive.heading for primitive in pieces])
        headings = np.append(initial, initial[-1:] if len(pieces) else plan.start[2:])
    middle = headings[:-1] + half
    chord = lengths * np.sinc(half / np.pi)
    steps = np.stack([chord * np.cos(middle), chord * np.sin(middle)], axis=1)
    places = plan.start[:2] + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    return np.column_stack([places, headings])


def verify_tour(model: TourData, plan: TourPlan, tolerance: float) -> Verification:
    """Return the length of `plan` (m) and the violation of each constraint, see :meth:`.Model.verify`."""
    check_tolerance(tolerance)
    required("plan", plan, TourPlan)
    n = model.size
    if plan.shares:
        raise InvalidData(
            f"shares must be empty for one UAV, got {show(plan.shares)}", field="shares"
        )
    check_entries("order", plan.order, 0, n - 1, "order")
    legs = np.array([item.leg for item in plan.primitives], int)
    lengths = np.array([item.length for item in plan.primitives])
    poses = integrated(plan, model.turning_radius)
    flown = np.concatenate([[0.0], np.cumsum(lengths)])
    # The path is relative to the air, which moves by the drift per metre flown.
    places = poses[:, :2] + flown[:, None] * model.drift
    # Index of the pose at the end of each leg: after the last primitive with this leg number or a
    # lower one.
    ends = np.searchsorted(legs, np.arange(len(plan.order)), side="right")
    met = np.array(plan.order, int)
    size = _sizes(model)
    positions = places[ends]
    vehicles = model.positions[met] + model.velocities[met] * plan.times[:, None]
    # The rounding error grows with the coordinates and the length up to the encounter only.
    far = np.maximum.accumulate(np.abs(poses[:, :2]).max(axis=1)) + flown
    far = far + np.abs(model.drift).max() * flown
    lost = DIGITS * (far[ends] + np.abs(model.positions[met]).max(axis=1))
    noise = DIGITS * float(far[-1])
    apart = np.hypot(*(positions - vehicles).T) - model.radius[met]
    time_error = np.abs(flown[ends] - model.speed * plan.times)
    point_error = np.hypot(*(positions - plan.points).T)

    def worst(
        name: str, values: Floats, places: Sequence[str], scale: Floats | float,
        limits: Floats | None = None, digits: Floats | float = noise,
    ) -> Check:  # fmt: skip
        """Return the check of the largest violation; infinite if rounding makes one undecidable."""
        scales, excused = (np.broadcast_to(item, values.shape) for item in (scale, digits))
        unknown = (scales > 0) & (excused > CEILING * scales)

        def place(k: int) -> str:
            return f"{places[k]}: {UNDECIDABLE}" if unknown[k] else places[k]

        return Check.largest(
            name, np.where(unknown, np.inf, values), scales, "m", place, tolerance,
            noise=np.minimum(excused, CEILING * float(size.min()) or math.inf), limit=limits,
        )  # fmt: skip

    names = [f"vehicle {model.label(k)}" for k in plan.order]
    pieces = [f"primitive {k}" for k in range(len(lengths))]
    counts = np.bincount(met, minlength=n)
    wrong = np.flatnonzero(counts != 1)
    ordered = np.diff(legs)
    last = n if model.closed else n - 1
    stray = (ordered < 0).sum() + ((legs < 0) | (legs > last)).sum()
    vehicles_missed = [f"vehicle {model.label(int(k))}" for k in wrong]
    checks = [
        Check.count("each vehicle met once", vehicles_missed, unit="vehicles"),
        Check.count("legs in order", float(stray), unit="primitives"),
        worst("lengths at least 0", -lengths, pieces, 0.0),
        *_joined(model, plan, poses, tolerance),
        *check_start(model, plan, tolerance),
        worst("length flown is speed times time", time_error, names, size[met], digits=lost),
        worst("encounter at its point", point_error, names, size[met], digits=lost),
        worst("encounter within radius", apart, names, size[met], model.radius[met], digits=lost),
    ]
    if model.windows is not None:
        begin, end = model.speed * model.windows[met].T
        outside = np.maximum(begin - flown[ends], flown[ends] - end)
        checks.append(worst("encounter within its window", outside, names, size[met], digits=lost))
    if model.no_fly is not None:
        inside, bends = np.zeros(len(pieces)), np.array([SIGNS[p.turn] for p in plan.primitives])
        bends = bends / model.turning_radius if model.turning_radius else 0.0 * bends
        for row, data in enumerate(zip(poses[:-1].tolist(), bends.tolist(), lengths, strict=True)):
            (x, y, heading), bend, length = data
            piece = (complex(x, y), heading, bend, max(float(length), 0.0))
            if np.isfinite(piece).all():
                inside[row] = max(depth(zone, piece) for zone in model.no_fly)
        scale = min(map(size_of, model.no_fly))
        near = np.where(inside < -noise, 0.0, noise)  # a path that is far away is decidable
        checks.append(
            worst("clear of no-fly zones", np.maximum(inside, 0.0), pieces, scale, digits=near)
        )
    if model.closed:
        home = model.home_drift * (flown[-1] / model.speed)
        gap = np.array([np.hypot(*(poses[-1, :2] - poses[0, :2] - home))])
        checks.append(worst("ends where it begins", gap, ["end"], float(size.min())))
    elif len(plan.order):
        beyond = np.array([flown[-1] - flown[ends[-1]]])
        checks.append(worst("ends at the last encounter", beyond, ["end"], float(size.min())))
    # The length is its own scale.
    return Verification(float(flown[-1]), tuple(checks), scale=0.0)


def decidable_length(model: TourData) -> float:
    """Return the largest length flown (m) for which double precision can decide an encounter."""
    return CEILING * float(_sizes(model).max()) / DIGITS


def _sizes(model: TourData) -> Floats:
    """Return the position scale of each vehicle (m): its radius, or its share of the field."""
    room = model.extent / model.size
    return np.where(model.radius > 0, model.radius, room)


def _angle_between(angle: Floats | float) -> Floats:
    """Return the absolute difference of headings, in rad, at most π."""
    return np.abs(np.remainder(np.asarray(angle, float) + np.pi, 2 * np.pi) - np.pi)


def _joined(model: TourData, plan: TourPlan, poses: Floats, tolerance: float) -> list[Check]:
    """Return the checks of continuous headings and of the curvature limit."""
    if model.turning_radius == 0:
        turns = [
            f"primitive {k}"
            for k, primitive in enumerate(plan.primitives)
            if primitive.turn != "S" and primitive.length > 0
        ]
        return [Check.count("straight but for turns on the spot", turns, unit="primitives")]
    initial = np.array([primitive.heading for primitive in plan.primitives])
    off = _angle_between(poses[:-1, 2] - initial)
    if model.closed:
        off = np.append(off, _angle_between(poses[-1, 2] - plan.start[2]))
    noise = DIGITS * float(np.abs(poses[:, 2]).max())
    unclear = noise > CEILING
    if unclear:
        off = np.full(max(off.size, 1), np.inf)

    def place(k: int) -> str:
        return ("end" if k == len(initial) else f"primitive {k}") + f": {UNDECIDABLE}" * unclear

    return [
        Check.largest(
            "headings without a jump", off, 1.0, "rad", place, tolerance, noise=min(noise, CEILING)
        )
    ]


def check_start(model: TourData, plan: TourPlan, tolerance: float) -> list[Check]:
    """Return the checks of the position and the heading at the start."""
    checks, size = [], float(_sizes(model).min())
    if model.start is not None:
        off = float(np.hypot(*(plan.start[:2] - model.start[:2])))
        noise = DIGITS * float(np.abs(model.start[:2]).max())
        checks.append(
            Check.scaled("starts at its place", "", off, "m", "start", tolerance, size, noise=noise)
        )
    # A UAV that turns on the spot can take any heading at once.
    if model.heading is not None and model.turning_radius > 0:
        turn = float(_angle_between(plan.start[2] - model.heading))
        checks.append(
            Check.scaled("starts with its heading", "", turn, "rad", "start", tolerance, 1.0)
        )
    return checks
