"""Equations, algorithms, parameters and figures of the paper, and their implementation here."""

from __future__ import annotations

from ..paper import Paper, corrected, different, printed
from .listing import PAPER as REFERENCE
from .printed import FIGURE_5, FIGURE_7, TABLE_3, TABLE_4, TABLE_5, TABLE_6

__all__ = ["PAPER"]

_DECODING = "solvers.messenger.decoding"
_MEMETIC = "solvers.messenger.memetic"

PAPER = Paper(
    "messenger",
    REFERENCE,
    items=(
        printed("eq. 1, 3", "Dubins vehicle with the curvature 1 / r_min at most", "models.messenger.checks:_joined"),
        corrected("eq. 2", "length of the tour", "models.messenger.checks:verify_tour",
                  "The sum ends with the leg to vehicle N + 1, which does not exist. Equation 8 has N intervals, so the "
                  "tour ends at the last encounter and the sum ends with the leg from N - 1 to N."),
        corrected("eq. 4", "each vehicle within its radius", "models.messenger.checks:verify_tour",
                  "Printed with <. The access points of eq. 5 are at the distance r_com, so the sign must be ≤."),
        corrected("Lemma 1", "bounds on the time of an encounter", f"{_DECODING}:bisect",
                  "D_min jumps where the vehicle crosses a turning circle. Then δ can have the wrong sign at a bound; the "
                  "lower bound becomes 0, or the upper one is doubled. Also, the statement mixes the pose at the start of "
                  "the tour with that at the vehicle before."),
        corrected("Algorithm 1", "bisection for the shortest path to a moving vehicle", f"{_DECODING}:bisect",
                  "At a jump of D_min the sign of δ changes without a root, and the printed loop never ends. The result "
                  "is then that of the exact first interception, models.messenger.interception:intercept. The threshold "
                  "ε_b is not printed: 1e-9 of the time of a straight flight."),
        different("Algorithm 2", "path of an expected length", "models.messenger.elongation:elongated",
                  "The families of paths and their bounds are in another paper. Ours are closed forms, whose parameter is "
                  "found to rounding instead of a threshold; they reach every length that a path can have. No effect on "
                  "the results beyond ε = 0.01 m per leg, which is the margin of an individual's legs."),
        corrected("eq. 5", "access point on the boundary", f"{_DECODING}:access",
                  "The radius has the index i; it is that of vehicle s_i."),
        printed("eq. 6", "encoding by order, angles and intervals", f"{_DECODING}:assess"),
        corrected("section III-B", "decoding", f"{_DECODING}:violation",
                  "Both inequalities are reversed: a leg is infeasible if D_min > v Δt + ε, as eq. 7 says. The second case "
                  "would fly every leg by ε longer than its time allows; here ε is the length by which a leg may be too "
                  "short, and the returned plan is solved without it."),
        printed("eq. 7", "violation of a leg", f"{_DECODING}:violation"),
        printed("eq. 8", "evaluation of an individual", f"{_MEMETIC}:settle", "κ is not printed: 1e9."),
        printed("Algorithm 3", "memetic algorithm MA", f"{_MEMETIC}:Memetic",
                "Random intervals are between 0 and t_max of Lemma 1 for the leg. With the bound of the leg from the start "
                "of the tour, or a constant bound, mean tours change by 3 to 5 % for 10 and 20 vehicles."),
        printed("section IV-C", "crossover by an auxiliary vector of 1 and 2", f"{_MEMETIC}:cross"),
        printed("section IV-D", "three mutations, p_m in total", f"{_MEMETIC}:mutate",
                "The upper bound of an interval is t_max of Lemma 1."),
        printed("eq. 9", "gradient of the violation", f"{_DECODING}:_repaired",
                "η is not printed: 1e-6 of the interval. Across a jump the slope becomes -v."),
        printed("eq. 10", "repair of an interval", f"{_DECODING}:_repaired",
                "The step size η_t is not printed: 1. The accuracy is 1e-4 m, with 100 steps at most."),
        printed("Definitions 1, 2", "catch-up and meeting pattern", f"{_MEMETIC}:_catches_up",
                "ε_t is arbitrary: 1e-3 of the interval. With the interval itself mean tours change by 3 %."),
        corrected("Proposition 1", "a leg can be shortened if the next vehicle is caught up with",
                  f"{_MEMETIC}:transform",
                  "The proof keeps the heading at s_i. The shortened leg ends with another heading, so later legs can "
                  "become infeasible; the evaluation (eq. 8) then rejects the child."),
        printed("Algorithm 4", "transformation", f"{_MEMETIC}:transform",
                "Literal: the last vehicle is never shortened, and nothing is undone. Undoing steps that violate a later "
                "leg changes mean tours by 2 % up to 30 vehicles and by -8 % at 40; transforming without the condition of catch-up shortens them by "
                "14 % (10 vehicles) to 42 % (30)."),
        corrected("eq. 11", "derivative of the evaluation by an angle", f"{_MEMETIC}:descend",
                  "Printed as f(θ) - f(θ + Δθ), the negative derivative; eq. 12 subtracts it and so ascends. The sign of "
                  "eq. 11 is changed. Δθ is not printed: 1e-4."),
        printed("eq. 12", "step of the gradient search GS", f"{_MEMETIC}:descend",
                "At most 2π / ρ_l steps, as section IV-H counts. Steps of ρ_l in the direction of the descent give mean "
                "tours within 2 % for 20 to 40 vehicles."),
        printed("eq. 13", "sampling search SS", f"{_MEMETIC}:resample"),
        different("eq. 14, 15, 16 and Table I", "complexity of the parts", f"{_MEMETIC}:evolve",
                  "The text and Table I disagree about the repair (N² / ε_r or N / ε_r). Here repair and transformation go "
                  "through the legs once per individual, so a generation has O(NP N) legs. Figure 5 has seconds."),
        printed("Table II", "parameters", f"{_MEMETIC}:Memetic"),
        printed("MA-T", "MA without transformation", f"{_MEMETIC}:MemeticUntransformed"),
        different("MAR", "memetic algorithm for vehicles at rest", f"{_MEMETIC}:MemeticRelaxed",
                  "The original is another paper. As the text describes it: MA's crossover, mutations 1 and 2, GS, and "
                  "shortest encounters. Its tours are shorter than MA's on the seeded instances; in the paper they are longer."),
        different("VNS", "variable neighbourhood search", "solvers.messenger.heuristics:VariableNeighbourhood",
                  "Cited as reference 25; its authors are those of reference 24. The end is not printed: 10 shakes without "
                  "a gain. The printed VNS is longer than HE-B, from which it starts, in 24 of 60 rows."),
        printed("HE-B", "receding horizon, sampled boundaries", "solvers.messenger.heuristics:GreedyBoundary",
                "Horizon and time of the distances are not printed: 2 vehicles, Euclidean distances at time 0. Distances "
                "at the time of the flight give tours far below the printed ones (270 times for 40 vehicles)."),
        printed("HE-C", "receding horizon, centres", "solvers.messenger.heuristics:GreedyCentre", "As HE-B."),
        printed("DS", "double sampling with branch and bound", "solvers.messenger.heuristics:DirectSampling",
                "The printed lengths are even numbers of metres, so the step of time is 0.2 s; 16 samples of a boundary."),
        printed("sparsity κ_P", "distance of the vehicles by the turning radius", "models.messenger.data:TourData.sparsity"),
        different("section V-A, instances", "60 random instances", "instances.messenger.listing:paper_instance",
                  "Not published; speeds and field are not printed. Seeded ones with the printed number of vehicles and "
                  "sparsity, speeds below 3.5 m/s. The text counts 60 instances in Table IV, which has 40."),
        different("Table III, text", "MA is best in 14 of 20 instances", "instances.messenger.paper_tables:table_3",
                  "In the printed cells it is best in 2, and in 12 without DS. In rows B-2-08, B-3-04 and B-3-05 the test "
                  "says that MA beats VNS, whose printed mean is shorter."),
        corrected("Table IV, gap of B-10-08", "22.9 %", "instances.messenger.paper_tables:table_4",
                  "(318.49 - 317.19) / 318.49 = 0.4 %. The other gaps follow from the printed means, up to 2.2 points for 30 "
                  "and 40 vehicles. The text has gaps from 14.30 to 93.29 %, the table from 22.9 to 95.4 %."),
        corrected("Table IV, MA of B-40-01", "23.76e4 m", "instances.messenger.paper_tables:table_4",
                  "The printed gap of 81.3 % follows from 24.76e4, and Table VI has 24.8e4."),
        different("Tables III to VI, shared rows", "the same algorithm, instance and parameters twice",
                  "instances.messenger.paper_tables:table_5",
                  "They disagree: MA on B-2-01 is 12.80 in Table III and 23.2 in Table VI, on B-10-01 456.33 in Table IV "
                  "and 382.73 in Table V, on B-10-10 205.36 and 223.49. Ours is one value."),
        corrected("Table VI, deviations of MA-T", "9.1, 5.4 and 2.4 m on B-10-01, B-10-10 and B-3-10",
                  "instances.messenger.paper_tables:table_6",
                  "25 values with the printed minimum and maximum have a deviation of at least (max - min) / √48, which is "
                  "56.7, 25.9 and 6.8 m."),
        different("Figure 5", "seconds of a run", "instances.messenger.paper_tables:figure_5",
                  "Curves without numbers, measured in MATLAB; ours are seconds of compiled code."),
        different("Figure 6", "six tours of instance B-3-02", "models.messenger.plot:draw",
                  "The instance is not published; ct.plot draws a tour of the seeded one."),
        different("Figure 7", "period of the local search", "instances.messenger.paper_tables:figure_7",
                  "Curves over 300 s without numbers; ours are lengths after 20 generations."),
        different("Figures 1-4, 8, 9", "sketches", "models.messenger.plot:draw", "They have no data."),
    ),
    tables=(TABLE_3, TABLE_4, TABLE_5, TABLE_6, FIGURE_5, FIGURE_7),
)  # fmt: skip
