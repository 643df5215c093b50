"""The paper of the satellite slew: its items with their status, and its results.

Equations 12-21, the Gauss pseudospectral method, are listed with ``optimal-control``.
"""

from __future__ import annotations

from ..paper import Paper, ResultTable, corrected, different, printed

__all__ = ["PAPER", "REFERENCE"]

REFERENCE = (
    "Path Planning for Rapid Large-Angle Maneuver of Satellites Based on the Gauss Pseudospectral "
    "Method, Mathematical Problems in Engineering, 2016"
)

_MODEL = "models.satellite_slew"
_DATA = f"{_MODEL}.data:SlewData"
_LOWERED = f"{_MODEL}.lowered:slew_problem"
_CHECKS = f"{_MODEL}.checks:verify_slew"
_TRACK = f"{_MODEL}.tracking:track"
_TORQUE = f"{_MODEL}.controller:tracking_torque"
_LYAPUNOV = f"{_MODEL}.controller:lyapunov_function"
_PLOT = f"{_MODEL}.plot:draw"

#: Reason for all terms of the gimbals' inertia.
_GIMBALS = (
    "The terms of the gimbals' inertia and of a changing I_t are left out: the paper prints no I_cg "
    "and drops these terms itself from eq. 9 on. No effect on its results."
)
_CURVES = "The text contains no values of the curves. Our picture has the same panels."

READINGS = ResultTable(
    "readings",
    "Results that the text prints, and ours under both readings of eq. 23",
    keys=("limits of w and T", "h0, N m s"),
    columns={
        "final time, s": ".3f", "computing time, min": ".2f", "mean rate of turn, deg/s": ".2f",
        "error of the quaternion": ".1e", "error of the rates, rad/s": ".1e",
    },
    rows={
        ("norm", "22.36"): (7.836, 4.1, 5.7, 4e-4, 1e-3),
        **dict.fromkeys((("norm", "17.53"), ("components", "17.53"), ("components", "17.468")), (None,) * 5),
    },
    ours={
        "flights within both errors": "d", "largest |w|, rad/s": ".4f", "largest |T|, N m": ".2f", "largest gimbal rate, rad/s": ".3f",
        "least det(A A')": ".3f",
    },
    note=(
        "R = 0.1 s². One run each, Ipopt on several intervals, tolerance 1e-4, two shared processors. "
        "The errors are the largest of eight flights with the paper's law at ω_n = 2 rad/s, ζ = 1 and 50 Hz, one "
        "for each combination of signs of a torque of 0.1 N m about each axis, all of it compensated: the paper "
        "prints neither gains nor disturbance. The paper prints its errors as upper bounds."
    ),
)  # fmt: skip

METHODS = ResultTable(
    "methods",
    "The paper's method, other transcriptions, and steering laws on satellite-slew/paper",
    keys=("method",),
    columns={"final time, s": ".3f", "seconds": ".1f"},
    rows={
        ("one interval, 20 nodes, SQP",): (7.836, 246.0),
        **{
            (name,): (None, None)
            for name in (
                "one interval, degree raised, interior point", "Gauss, several intervals",
                "Radau, several intervals", "Hermite-Simpson", "eigenaxis, pseudo-inverse",
                "eigenaxis, generalised inverse",
            )
        },
    },
    ours={"J, s": ".4f", "tolerance": ".0e", "worst violation": ".1e", "at": "", "verdict": ""},
    note=(
        "The paper prints neither the number of nodes nor the SQP solver; ours is SLSQP with 20 nodes. A "
        "violation is relative to its limit and measured between the nodes too; a plan is accepted up to the "
        "tolerance. One run each on two shared processors."
    ),
)  # fmt: skip

PAPER = Paper(
    "satellite-slew",
    REFERENCE,
    items=(
        different(
            "eq. 1", "total momentum of satellite and gyros",
            f"{_MODEL}.dynamics:SlewMotion.total_momentum",
            f"I w + h in inertial axes. {_GIMBALS}",
        ),
        different("eq. 2", "momentum theorem", f"{_MODEL}.dynamics:SlewMotion.rate", _GIMBALS),
        printed(
            "eq. 3", "rotation, I ẇ + w×(I w + h) = T_c + T_ext",
            f"{_MODEL}.dynamics:SlewMotion.rate",
        ),
        different("eq. 4-7", "torque with inertia of the gimbals",
                  f"{_MODEL}.dynamics:SlewMotion.torque", _GIMBALS),
        different(
            "eq. 8", "R_c(w) = İ_t w", f"{_MODEL}.dynamics:SlewMotion.torque",
            f"{_GIMBALS} The print misses a factor: eq. 6 multiplies R_c by the gimbal rates, so that R_c δ̇ "
            "= İ_t w is what eq. 2 needs.",
        ),
        printed("eq. 9", "torque of the gyros, T_c = -h0 A_t δ̇", f"{_MODEL}.dynamics:SlewMotion.torque"),
        printed("eq. 10", "motion of the quaternion", f"{_MODEL}.quaternions:quaternion_rate"),
        printed(
            "eq. 11", "singularity measure D = det(A_t A_tᵀ)", f"{_MODEL}.gyros:singularity_measure"
        ),
        printed("eq. 22", "objective J, time and gimbal rates", _LOWERED),
        different(
            "eq. 23, C1", "length of the quaternion", _LOWERED,
            "Eq. 10 conserves the length, so as a constraint it is a dependent equation at each node. The "
            "slew declares it as an invariant, and the check measures it.",
        ),
        printed(
            "eq. 23, C2", "body rate, |w| ≤ 1/8 rad/s", f"{_DATA}.magnitudes",
            "|w| is read as the norm: w is printed as a vector without index, and C3 has one. The reading of "
            "components is vector_limits=\"components\". With h0 = 17.53 N m s the norm takes 8.179 s and "
            "components 7.826 s; the printed 7.836 s needs h0 = 22.36 or 17.47 N m s.",
        ),
        printed("eq. 23, C3", "gimbal rates, |δ̇_i| ≤ 1 rad/s", _CHECKS),
        printed("eq. 23, C4", "singularity measure ≥ 0.2", _CHECKS, "The bars of C4 are a determinant, eq. 11."),
        printed(
            "eq. 23, C5", "control torque, |T| ≤ 25 N m", f"{_DATA}.magnitudes",
            "Read as the norm, as C2. The optimum for components has |T| up to 30.4 N m, and more than 25 N m for "
            "24 % of the time.",
        ),
        printed("eq. 24", "equation of motion, eq. 3 again", f"{_MODEL}.dynamics:SlewMotion.rate"),
        corrected(
            "eq. 25", "error quaternion", f"{_MODEL}.quaternions:attitude_error",
            "Printed q_e0 = q0 q_d0 - qᵀq_d. With q = q_d it is q0² - |q|², not 1, and breaks eq. 26. The "
            "product q_d* ∘ q has a plus. q_e is as printed.",
        ),
        printed("eq. 26", "length of the error quaternion", f"{_MODEL}.quaternions:attitude_error"),
        corrected(
            "eq. 27", "motion of the error quaternion", f"{_MODEL}.quaternions:quaternion_rate",
            "With w_e = w - w_d by components the derivative of q_d* ∘ q has the further term q_e × w_d. It is "
            "orthogonal to q_e, so eq. 29-33 hold as printed.",
        ),
        printed("eq. 28", "Lyapunov function V", _LYAPUNOV),
        printed("eq. 29-31", "derivative of V", _LYAPUNOV,
                "The text refers to eq. 24, 27, 29 and 30 as 1, 6, 8 and 9."),
        printed(
            "eq. 32", "control torque T_c", _TORQUE,
            "law=\"paper\": K_p = k1 q_e0, a scalar, and T_ext known. The default, law=\"inertia\", is ours: K_p = 2 "
            "ω_n² I and T_ext unknown. With the same T_ext known, the errors of both differ by less than 10 %.",
        ),
        printed("eq. 33", "V̇ = -w_eᵀ K_d w_e", _LYAPUNOV),
        printed("Section 5, inertia", "I = diag(228, 188, 176) kg m²", _DATA),
        printed("Section 3, pyramid", "β = 54.73°, four gyros", f"{_MODEL}.gyros:momentum_direction"),
        printed("Section 5, state and control", "x = (q, w, δ), u = δ̇", _LOWERED),
        corrected(
            "Section 5, final state", "45° about roll, at rest with gimbals at 0", _DATA,
            "Printed (0.9239, 0.3824): sin 22.5° = 0.3827, and the printed pair has the length 0.99991. It turns by "
            "44.97°; 0.03° at 1/8 rad/s are 0.005 s of the final time.",
        ),
        different(
            "Section 5, end conditions", "eleven values at the end", _LOWERED,
            "Seven are imposed; the other four follow from momentum and length, which eq. 1 and 10 conserve. The check "
            "measures all eleven.",
        ),
        different(
            "Section 5, h0 and R", "momentum of a wheel, weight of the gimbal rates", _DATA,
            "Not printed. R = 0.1 s² is ours, and h0 = 22.36 N m s gives the printed final time. Other pairs do so too.",
        ),
        different(
            "Section 5, tolerance", "ε ≤ 1e-3", _CHECKS,
            "The paper does not define the error. Ours is the violation relative to the limit, between the nodes too, "
            "1e-6 by default.",
        ),
        different(
            "Section 5, SQP", "solution by sequential quadratic programming", "solvers.nlp.ipopt:Ipopt",
            "The paper names no solver. slsqp, sqpmethod and blocksqp are SQP; the default is Ipopt, an interior point, "
            "which also resolves meshes that they do not.",
        ),
        different(
            "Section 6, gains", "k1, K_d and T_ext", _TRACK,
            "Not printed. k1 = 2 ω_n² tr(I) / 3 and K_d = 2 ζ ω_n I with ω_n = 2 rad/s, ζ = 1; both keep the conditions of "
            "the proof.",
        ),
        different(
            "Section 6, simulation", "gyros that give T_c", f"{_MODEL}.controller:Controller.steer",
            "The paper prints no gimbal rates for a torque. Ours are those of the plan plus the pseudo-inverse of the rest, "
            "sampled at 50 Hz, with the limits of eq. 23.",
        ),
        printed("Figure 1", "pyramid of the gyros", f"{_MODEL}.gyros:gimbal_jacobian",
                "The order and zero positions of the gimbals are those of the usual pyramid; the text states neither."),
        different("Figures 2-7", "quaternion, rates, gimbal angles and rates, singularity, torque", _PLOT, _CURVES),
        different("Figures 8, 9", "tracking errors", _PLOT, f"{_CURVES} The bounds in the text are in table readings."),
    ),
    tables=(READINGS, METHODS),
)  # fmt: skip
