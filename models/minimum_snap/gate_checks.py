"""Checks of the gates of a model, and of the positions of a plan in them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...errors import InvalidData
from ..verification import Check
from .bounds import PathData
from .trajectory import Trajectory

__all__ = ["check_gate_data", "check_gates"]


def check_gate_data(model: PathData) -> None:
    """Raise :class:`InvalidData` for gates at missing, given or repeated knots."""
    known: set[int] = set()
    for number, gate in enumerate(model.gates):
        field = f"gates[{number}]"
        knots, dimensions = model.waypoints.shape
        if gate.knot >= knots:
            raise InvalidData(
                f"{field}.knot must be < {knots} (knots), got {gate.knot}", field="gates"
            )
        axes = len(gate.frame.centre)
        if axes != dimensions:
            raise InvalidData(
                f"{field} must have {dimensions} axes as the waypoints, got {axes}", field="gates"
            )
        if np.isfinite(model.waypoints[gate.knot]).any():
            raise InvalidData(
                f"{field}: waypoints[{gate.knot}] must be free (None on all axes), because the gate "
                f"determines the position, got {model.waypoints[gate.knot].tolist()}",
                field="waypoints",
            )
        if gate.knot in known:
            raise InvalidData(f"{field}: knot {gate.knot} has another gate", field="gates")
        known.add(gate.knot)


def check_gates(model: PathData, plan: Trajectory, tolerance: float) -> Iterator[Check]:
    """Yield the checks of the distances from the planes and from the insides of the gates."""
    if not model.gates:
        return
    begin, end = plan.at_ends()
    points = np.concatenate([begin, end[-1:]])
    excess = np.array([gate.excess(points[gate.knot]) for gate in model.gates])
    knots = [gate.knot for gate in model.gates]
    size = float(model.position_scale.max())
    for column, name in enumerate(("plane of the gate", "inside of the gate")):
        yield Check.largest(
            name, excess[:, column], size, "m",
            lambda at: f"knot {knots[at]} (t = {plan.times[knots[at]]:.6g} s)", tolerance,
        )  # fmt: skip
