"""The paper on the attractor of a hunt: its items and its figures."""

from __future__ import annotations

from ..paper import Paper, ResultTable, corrected, different, printed

__all__ = ["FIGURES", "PAPER", "SLOPES", "SYSTEMS_TABLE"]

FIGURES = ResultTable(
    "figures",
    "The paper's figures of a hunt, and ours of another hunt",
    keys=("figure",),
    columns={"value": ".3g"},
    rows={
        ("delay, samples",): (8,),
        ("embedding dimension",): (10,),
        ("largest exponent",): (0.12,),
        ("correlation dimension",): (5.5,),
        ("forecast period, s",): (8.3,),
        ("smallest number of variables",): (7,),
        ("largest number of variables",): (13,),
    },
    ours={"deviation": ".2g", "backend": "", "recommended backend": "", "true value": ".3g", "runs": "d"},
    note=(
        "The paper prints neither its record of 1000 points nor equations of motion, so our record is 1000 points of "
        "another hunt and the figures need not agree. Ours are medians and standard deviations over hunts from "
        "different seeds. Exponents are in nats a second; g-p and small-data-sets work in the paper's embedding. The "
        "true exponent is computed from our equations of motion."
    ),
)  # fmt: skip
SLOPES = ResultTable(
    "slopes",
    "Figures 4 and 5: slope by embedding dimension, for 1000 samples of known series",
    keys=("series",),
    columns={},
    rows={(name,): () for name in ("hunt", "hunt, line", "henon", "lorenz", "white-noise", "ar2")},
    ours={**{f"m = {m}": ".2f" for m in range(2, 11)}, "largest": ".2f", "true dimension": ".3g"},
    note=(
        "The paper's figures are not in the text; it states that the slopes reach a maximum of 5.5. A text says that no "
        "radius has a fifth of the pairs, because most states have no other state within a quarter of the deviation."
    ),
)
SYSTEMS_TABLE = ResultTable(
    "systems",
    "Known systems: the paper's methods and ours",
    keys=("system",),
    columns={},
    rows={
        (name,): ()
        for name in ("logistic", "henon", "lorenz", "rossler", "mackey-glass", "ar2", "white-noise")
    },
    ours={
        "samples": "d",
        "exponent, known": ".4g",
        "small-data-sets": ".4f",
        "rosenstein": ".4f",
        "kantz": ".4f",
        "dimension, known": ".3g",
        "g-p": ".2f",
        "correlation-dimension": ".2f",
        "period, samples": ".1f",
        "window, c-c": "d",
        "window, improved-c-c": "d",
        "source": "",
    },
    note=(
        "The paper has no such table. Known values are of the literature. Exponents are in nats a second; none means that "
        "the backend finds no scaling region."
    ),
)

PAPER = Paper(
    "attractor",
    "Method of Quantitative Analysis for Multirobot Cooperative Hunting Behaviors, Mathematical Problems in Engineering, "
    "2016, article 4370635",
    items=(
        corrected(
            "eq. 1, 12", "delay coordinates", "models.attractor.model:AttractorAnalysis.states",
            "Printed as x(t - k τ) for t = 1, …, M, which begins before the series; with x(t + k τ) the M states are the "
            "same, with their coordinates in reverse order.",
        ),
        corrected(
            "eq. 2", "correlation sum C(m, N, r, t)", "solvers.attractor.delays:correlation_sums",
            "Printed for i <= j. With the M pairs i = j the sum could be (M + 1) / (M - 1), so i < j. theta(0) = 1 as printed.",
        ),
        printed("eq. 3", "t disjoint subseries of INT(N / t) samples", "solvers.attractor.delays:correlation_sums"),
        printed("eq. 4-5", "statistic S(m, r, t)", "solvers.attractor.delays:curves"),
        printed("eq. 6", "dispersion ΔS(m, t)", "solvers.attractor.delays:curves"),
        printed(
            "eq. 7", "means over m = 2 … 5 and r = σ/2 … 2σ, and S_cor", "solvers.attractor.delays:Curves.combined",
            "S_cor = ΔS + |S|: the available text has lost all vertical bars, also in eq. 13 and 15.",
        ),
        printed(
            "delay of C-C", "first local minimum of ΔS or first zero of S",
            "solvers.attractor.delays:CorrelationIntegral", "Option criterion; the minimum is the default.",
        ),
        printed("window of C-C", "global minimum of S_cor", "solvers.attractor.delays:CorrelationIntegral.window"),
        printed("eq. 8-9", "mean correlation sum C(t)", "solvers.attractor.delays:curves"),
        printed(
            "eq. 10", "S_c(t) = C(t) - S(t)", "solvers.attractor.delays:Curves.periodic",
            "Equal to the mean of C_s(1, r, t)^m: it depends on sums of one coordinate only.",
        ),
        printed(
            "window of improved C-C", "local peak of S_c",
            "solvers.attractor.delays:ImprovedCorrelationIntegral.window",
            "Which peak is not stated. The first that stands out by 30 % of the range is within 10 % of the known period for "
            "60 of 64 series (Lorenz, Rössler, Mackey-Glass, sine, noise of order 2; c-c: 5, the method of Lu, Cai and Jiang, "
            "which had this name before: 55). The first local maximum is noise, and the global one a multiple of the period.",
        ),
        printed("eq. 11", "window = (m - 1) delay", "solvers.attractor.delays:CorrelationIntegral.find", "m is rounded."),
        different(
            "steps 1-2 of the exponent", "delay and mean period by FFT, m >= 2 d + 1",
            "solvers.attractor.paper_methods:SmallDataSets.embeddings",
            "The paper does not state how the FFT gives the delay: taken is the lag at which the autocorrelation is 1 - 1/e "
            "(Rosenstein 1993), and the smallest m. The paper's own m = 10 breaks its rule, which requires 12 for d = 5.5.",
        ),
        corrected(
            "eq. 13", "distance from the nearest neighbour after i steps",
            "solvers.attractor.partings:rosenstein_curve",
            "Printed with the minimum over the neighbours at each step i. Then every curve is that of nearest neighbours "
            "and does not rise: slopes of -0.0001, 0.011 and 0.0006 for the hunt, Lorenz' equations and the Hénon map, instead "
            "of 0.026, 1.21 and 0.38. The neighbour is chosen at i = 0 and followed.",
        ),
        different(
            "eq. 13, range of i", "each pair to the end of the series", "solvers.attractor.partings:rosenstein_curve",
            "Only states with a future of the whole region take part, so that the mean is over the same pairs at each "
            "step: 0.0259, 1.206 and 0.3832 instead of 0.0273, 1.184 and 0.3840 for the same series.",
        ),
        printed("eq. 14", "mean of ln d over time", "solvers.attractor.partings:Curve", "Natural logarithm: nats a second."),
        different(
            "Figure 3", "straight line through the curve", "solvers.attractor.paper_methods:SmallDataSets.region",
            "The region is not stated: from step 0 to half of the rise.",
        ),
        printed(
            "eq. 15", "correlation sum over all pairs", "solvers.attractor.paper_methods:all_pairs",
            "With i = j and with states that are near in time; correlation-dimension leaves both out.",
        ),
        printed("eq. 16", "step function", "solvers.attractor.paper_methods:all_pairs", "theta(0) = 0, in eq. 2 it is 1."),
        printed("eq. 17", "slope between r_1 = δ/4 and C(r_1)/C(r_2) = 5", "solvers.attractor.paper_methods:slope_of"),
        printed(
            "Figures 4-5", "lines for m = 2 … 10, D is the largest slope",
            "solvers.attractor.paper_methods:GrassbergerProcaccia",
            "The radii of the lines are not stated: those between r_2 and r_1 of eq. 17 (option fit).",
        ),
        printed(
            "forecast period", "1 / λ", "models.attractor.plan:AttractorEstimate.horizon",
            "The unit of λ is printed as bits/s, eq. 14 has the natural logarithm. 8.3 s is the e-folding time if 0.12 is in "
            "nats, the doubling time if it is in bits.",
        ),
        printed(
            "eq. 18", "numbers of variables INT(D + 1) and INT(2D + 1)", "models.attractor.plan:AttractorEstimate.variables",
            "INT is the integer part, as defined below eq. 3. D = 5.5 gives 6 and 12; printed are 7 and 13. Rounding to the "
            "nearest integer gives 7 and 12, rounding up 7 and 13 if D is slightly above 5.5, but then 4 for Lorenz' equations, "
            "which have three variables.",
        ),
        different(
            "Figures 1-2", "record of 1000 points of a robot", "instances.attractor.hunting:Hunt",
            "The record is not printed, and the paper states no equations of motion: a hunt with equations of our own.",
        ),
    ),
    tables=(FIGURES, SLOPES, SYSTEMS_TABLE),
)  # fmt: skip
