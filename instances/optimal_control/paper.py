"""The Gauss pseudospectral method of the slew's paper: equations 12-21 with their status."""

from __future__ import annotations

from ..paper import Paper, corrected, different, printed

__all__ = ["PAPER"]

_CONTROL = "models.optimal_control"
_ASSEMBLY = f"{_CONTROL}.transcription.assembly:Assembly.values"
_GAUSS = f"{_CONTROL}.transcription.schemes:gauss"
_METHOD = f"{_CONTROL}.transcription.methods:PaperGauss"

#: Derivation of the sign of eq. 15, 19 and 21.
_SIGN = (
    "Printed (t0 - tf)/2. Eq. 14 gives dt/dτ = (tf - t0)/2, which eq. 20 has. With the printed sign a constant rate of 1 "
    "lowers the state, and together with eq. 20 no time but tf = t0 satisfies the equations."
)

PAPER = Paper(
    "satellite-slew",
    "Path Planning for Rapid Large-Angle Maneuver of Satellites Based on the Gauss Pseudospectral "
    "Method, Mathematical Problems in Engineering, 2016, Section 4",
    items=(
        printed("eq. 12", "cost in Bolza form", _ASSEMBLY),
        printed("eq. 13", "dynamics, path constraints, boundary conditions",
                f"{_CONTROL}.definition:Phase"),
        printed("eq. 14", "time to τ in [-1, 1]", f"{_CONTROL}.piecewise:Piecewise"),
        corrected("eq. 15", "problem in τ", _ASSEMBLY,
                  f"{_SIGN} The cost would be negative. The last line lacks \"≤ 0\" (eq. 13)."),
        printed("eq. 16", "states through -1 and the K nodes", f"{_CONTROL}.lagrange:interpolation"),
        printed("eq. 17", "controls through the K nodes", f"{_CONTROL}.lagrange:interpolation"),
        printed("eq. 18", "differentiation matrix, K × (K + 1)", f"{_CONTROL}.lagrange:differentiation",
                "The text refers to eq. 16 as 1, and prints the shape with k for K."),
        corrected("eq. 19", "dynamics at the nodes", _GAUSS, _SIGN),
        printed("eq. 20", "final state by Gauss quadrature", _GAUSS),
        corrected("eq. 21", "nonlinear program", _METHOD,
                  f"{_SIGN} The sign is wrong in the cost and in the first constraint."),
        different(
            "Section 4, number of nodes", "K", _METHOD,
            "Not printed. Formulation \"paper\" begins with 20 nodes and raises the degree until the verification accepts "
            "the plan; refine=False keeps the first number.",
        ),
    ),
)  # fmt: skip
