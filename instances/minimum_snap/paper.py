"""Items of the paper on minimum-snap trajectories: status and place in the code."""

from __future__ import annotations

from ..grid_path.paper import PAPER as GRID
from ..paper import Paper, corrected, different, printed

__all__ = ["PAPER"]

_PROGRAM = "models.minimum_snap.formulations.paper:PaperFormulation"
_PIECES = "models.minimum_snap.formulations.piecewise:PiecewiseFormulation"

PAPER = Paper(
    GRID.name,
    GRID.reference,
    items=(
        printed("eq. 5", "position as powers of absolute time", f"{_PROGRAM}.basis_rows"),
        printed("eq. 6", "velocity", f"{_PROGRAM}.basis_rows"),
        printed("eq. 7", "acceleration", f"{_PROGRAM}.basis_rows"),
        corrected(
            "eq. 8", "snap, the fourth derivative", f"{_PROGRAM}.gram",
            "The sentence before it says acceleration, and section 3.2.2 says jerk (snap). The exponent "
            "(4) and the factor n!/(n - 4)! are those of the fourth derivative.",
        ),
        printed("eq. 9", "a polynomial as a product of powers and coefficients", f"{_PROGRAM}.basis_rows"),
        corrected(
            "eq. 10", "one polynomial per segment", "models.minimum_snap.trajectory:Trajectory",
            "k numbers the segments here and is the degree in eq. 5. The two are separate.",
        ),
        corrected(
            "eq. 11", "integral of the squared snap as a quadratic form", f"{_PROGRAM}.gram",
            "The printed integral covers one segment, from T(i-1) to T(i). P holds all segments in "
            "eq. 13, so the objective is the sum over the segments.",
        ),
        printed("eq. 12", "given position, velocity and acceleration at a knot", f"{_PIECES}._fixed"),
        printed("eq. 13", "equality constraints A P = C", f"{_PIECES}.build"),
        corrected(
            "eq. 23", "rest at both ends: velocity and acceleration 0", f"{_PIECES}._fixed",
            "A is printed as 3 x 1. It multiplies the coefficients of a polynomial of degree k, so it is "
            "3 x (k + 1).",
        ),
        corrected(
            "eq. 24", "positions at the breakpoints", f"{_PIECES}._fixed",
            "A is printed as 1 x 1. It is 1 x (k + 1), for the same reason.",
        ),
        corrected(
            "eq. 25", "continuity of position, velocity and acceleration", f"{_PIECES}._continuous",
            "[A_i(T) - A_(i+1)(T)] is printed as a difference. It multiplies the two blocks P_i and "
            "P_(i+1), so it is the row of the two blocks A_i(T) and -A_(i+1)(T).",
        ),
        different(
            "degree and times", "degree k, times T_0 ... T_(n+1)",
            "models.minimum_snap.bounds:PathData",
            "The paper gives neither. Degree 7 loses nothing: the optimum satisfies X^(8) = 0 on each "
            "segment. Times are data of the model; the mission takes them from a trapezoidal speed profile.",
        ),
        different(
            "default continuity", "continuity up to the jerk",
            "models.minimum_snap.model:MinimumSnap",
            "With eq. 23-25 alone the jerk jumps at every waypoint. The default adds the jerk; "
            "continuity=2 with two rows in start and end is the paper's problem.",
        ),
    ),
)  # fmt: skip
