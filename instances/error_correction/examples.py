"""Example instances of error-correction routing from the text of the paper."""

from __future__ import annotations

import math

import numpy as np

from ...models.error_correction.model import ErrorCorrectionRouting

__all__ = ["example_1"]


def example_1() -> ErrorCorrectionRouting:
    """Return the paper's example 1: the shorter path to a point may be a dead end.

    Points 1 (A) to 5 (B); 2 and 4 are horizontal and 3 is vertical. Point 3 is 2 m from point 1, or
    2.5 m via point 2. Only the longer path arrives with a horizontal error small enough to reach B.
    The optimal route is 1-2-3-5 of length 4.5.

    The paper publishes d12 = 2, d13 = 2, d23 = 0.5, d35 = 2, δ = 0.1 and thresholds of 0.3. The
    coordinates with these distances and the position of point 4 are ours. The route via point 4 is
    feasible and longer.
    """
    # Points 2 and 4 are 2 m from point 1, and 0.5 m and 0.8 m from point 3, on opposite sides.
    x2, x4 = (8 - 0.5**2) / 4, (8 - 0.8**2) / 4
    return ErrorCorrectionRouting(
        points=np.array(
            [
                [0.0, 0.0, 0.0],
                [x2, math.sqrt(4 - x2**2), 0.0],
                [2.0, 0.0, 0.0],
                [x4, -math.sqrt(4 - x4**2), 0.0],
                [4.0, 0.0, 0.0],
            ]
        ),
        kinds=np.array(["A", "horizontal", "vertical", "horizontal", "B"]),
        alpha1=0.3,
        alpha2=0.3,
        beta1=0.3,
        beta2=0.3,
        theta=0.3,
        delta=0.1,
        ids=(1, 2, 3, 4, 5),
        name="error-correction/example-1",
    )
