"""Items and result tables of the paper on artificial fish swarms, with their status in the code."""

from __future__ import annotations

from ..paper import Paper, ResultTable, corrected, different, printed

__all__ = ["MAPS", "PAPER", "SEARCHES"]

_SWARMS = "solvers.black_box.fish_swarms"
_AFSA, _IAFSA = f"{_SWARMS}:Swarm", f"{_SWARMS}:ImprovedSwarm"
_RAND = (
    "rand(0, 1) can only increase a variable, so a fish would never look downwards. Here rand is in [-1, 1], one number per "
    "variable, as printed in eq. 15. Booth after 50 iterations, mean of 15 runs: 0.009, with rand(0, 1) 0.13; "
    "printed 0.007."
)
_NO_ROBOT = (
    "A robot's odometer gives the printed lengths. The maps (Figures 7 and 10) have no data in the text. Our maps and "
    "proven shortest paths are in the table of paths."
)
#: Names of the algorithms in the paper's tables, by backend.
SEARCHES = {"Standard AFSA": "afsa", "Improved AFSA": "iafsa"}
#: Names of the functions in the paper's tables, by instance.
FUNCTIONS = {
    "Rastrigin": "rastrigin-10",
    "Easom": "easom",
    "Booth": "booth",
    "Bohachevsky": "bohachevsky",
    "Sum Squares": "sum-squares-10",
}

ITEMS = (
    printed(
        "eq. 1", "distance of two fish", f"{_SWARMS}:leaders",
        "Distances are Euclidean in the unit cube, which equals the print if all variables have the same range.",
    ),
    corrected("eq. 2", "prey: a point within the visual", f"{_SWARMS}:Swarm.sample_around", _RAND),
    printed("eq. 3", "prey: one step towards a better point", f"{_SWARMS}:Swarm.move_towards"),
    printed("eq. 4", "centre of the swarm, the mean of all fish", f"{_SWARMS}:Swarm.targets"),
    printed(
        "eq. 5", "swarm: one step towards the centre", f"{_SWARMS}:Swarm.targets",
        "As printed, the fish moves if the centre is better, even if the point that it reaches is worse.",
    ),
    printed(
        "eq. 6", "follow: one step towards a better neighbour", f"{_SWARMS}:Swarm.targets",
        "The neighbour is the best one in the visual. As printed, the crowd is counted around X_c for both behaviours.",
    ),
    corrected("eq. 7", "leap within the visual", f"{_SWARMS}:Swarm.prey", _RAND),
    printed("eq. 8-9", "opposite point of each fish, in each iteration", f"{_SWARMS}:ImprovedSwarm.cycle"),
    printed("eq. 10", "attenuation of the visual, s = 3", f"{_SWARMS}:attenuation"),
    printed(
        "eq. 11", "attenuated visual", f"{_SWARMS}:ImprovedSwarm.ranges",
        "The visual on the right is the initial one. If each iteration shrank the last one, Easom would end at 0.010 instead of "
        "0.0007 (mean of 15 runs of 50 iterations; printed 0.0030). The smallest visual is not printed: 0.001 of the range.",
    ),
    printed(
        "eq. 12", "Gaussian factor of the step", f"{_SWARMS}:gaussian",
        "μ is 0. σ is not printed: 0.4, for which the factor is 1 at the start (option sigma). 0.2 gives Easom 0.013.",
    ),
    printed(
        "eq. 13", "adaptive step", f"{_SWARMS}:ImprovedSwarm.ranges",
        "The step on the right is the initial one. The smallest step is not printed: 0.001 of the range.",
    ),
    printed(
        "eq. 14", "inertia weight β", f"{_SWARMS}:inertia",
        "Section 4 prints 0.2 at the start and 0.9 at the end. The prose calls β large at the start. With 0.9 to "
        "0.2, Booth ends at 0.026 instead of 0.006 (printed 0.0007), so the printed values stay.",
    ),
    printed(
        "eq. 15", "new prey: a random step", f"{_SWARMS}:ImprovedSwarm.prey",
        "The printed equation multiplies the position by 1 - β, which pulls the fish towards the origin.",
    ),
    corrected(
        "eq. 16", "new prey: replacement of the position", f"{_SWARMS}:Swarm.search_better",
        "Both sides are exchanged in print. The sentence before it states that the new position replaces the old one if it is "
        "better, so X_i(t) becomes X_i(t + 1).",
    ),
    printed("eq. 17", "new swarm", f"{_SWARMS}:ImprovedSwarm.move_towards", "The move is undone if it leads to a worse point."),
    printed(
        "eq. 18", "new follow: towards the best fish of the swarm", f"{_SWARMS}:ImprovedSwarm.targets",
        "The print has no condition. As for eq. 17, the move is undone if it leads to a worse point.",
    ),
    printed("section 2", "standard AFSA with bulletin and try number", _AFSA, "The try number is not printed: 3 (option tries)."),
    printed(
        "section 3.4, steps 1-6", "IAFSA; step 6 returns to step 2", _IAFSA,
        "The order of the behaviours in step 4 is in a flow chart without text (Figure 3). Here a fish swarms and follows, "
        "preys if both fail, and leaps if all tries fail. A leap is kept even if it is worse. If such leaps were undone, Easom "
        "and Booth would end at 6e-5 and 7e-6 after 50 iterations (printed 3.0e-3 and 7e-4; kept 7e-4 and 6e-3), and at 8e-4 "
        "and 1e-5 with moved optima, but Rastrigin and Sum Squares still at 47 and 63.",
    ),
    different(
        "section 5, HAAFSA", "hybrid swarm of Yao and Ren, a rival on the robot", f"{_SWARMS}:AdaptiveSwarm",
        "The paper names the method without formulas; enhanced preying and segments are derived.",
    ),
    different(
        "section 5, A*", "a rival on the robot", "solvers.grid_path.any_angle:AnyAngle",
        "The grid and its neighbours are not printed. Exact searches of grid paths give our reference.",
    ),
    printed("section 4, parameters", "100 fish, crowd 0.6, visual 30 %, step 10 %", "solvers.black_box.fish:FishSwarm"),
    different(
        "Table 1", "five test functions", "models.black_box.functions:Named",
        "Easom is stored without the printed + 1, and our tables add it. The printed heading names the Cleveland data set, "
        "which has no part in the paper. The bounds are not printed: ours are the usual ones. Booth has a single minimum and "
        "Bohachevsky several, contrary to the prose.",
    ),
    printed("Figure 1", "α over time for several s", f"{_SWARMS}:attenuation"),
    printed("Figure 2", "β and 1 - β over time", f"{_SWARMS}:inertia"),
    different("Figure 4", "best value over iterations", f"{_SWARMS}:Swarm.cycle", "The curves have no data in the text."),
    different("Figures 5-11", "robot, environments, maps, paths", "instances.black_box.paths:path_instance", _NO_ROBOT),
)  # fmt: skip

_FUNCTION = ("function", "algorithm")
TABLE_2 = ResultTable(
    "table-2",
    "Table 2: mean of the best values by iterations (the optimum is 0)",
    keys=_FUNCTION,
    columns={"50 Itr": ".2g", "100 Itr": ".2g", "200 Itr": ".2g"},
    rows={
        ("Rastrigin", "Standard AFSA"): (0.019541667, 0.016765714, 0.01565533),
        ("Rastrigin", "Improved AFSA"): (0.004902857, 0.00363, 0.002735),
        ("Easom", "Standard AFSA"): (0.021071, 0.022532, 0.0218015),
        ("Easom", "Improved AFSA"): (0.0030341, 0.003865, 0.00344955),
        ("Booth", "Standard AFSA"): (0.007065, 0.005180909, 0.006078095),
        ("Booth", "Improved AFSA"): (0.000732, 0.001251818, 0.001003333),
        ("Bohachevsky", "Standard AFSA"): (0.010106, 0.013684, 0.008507),
        ("Bohachevsky", "Improved AFSA"): (0.002489, 0.003235, 0.002446),
        ("Sum Squares", "Standard AFSA"): (0.008670, 0.011748, 0.011235),
        ("Sum Squares", "Improved AFSA"): (0.001848, 0.003260, 0.004433),
    },
    ours={
        "deviation": ".2g",
        "moved, 50 Itr": ".2g",
        "moved, 100 Itr": ".2g",
        "moved, 200 Itr": ".2g",
        "2 variables, 50 Itr": ".2g",
        "evaluations": "d",
        "runs": "d",
    },
    note=(
        "Deviation and evaluations are those of 200 iterations. Moved: each variable's optimum is moved by 0.1 to "
        "0.3 of its range. 2 variables: Rastrigin and Sum Squares with 2 variables instead of the 10 that the paper states. The "
        "paper has 50 runs."
    ),
)
TABLE_3 = ResultTable(
    "table-3",
    "Table 3: iterations until convergence",
    keys=_FUNCTION,
    columns={"Max": "d", "Min": "d", "Mean": "d"},
    rows={
        ("Rastrigin", "Standard AFSA"): (128, 45, 81),
        ("Rastrigin", "Improved AFSA"): (22, 8, 16),
        ("Easom", "Standard AFSA"): (27, 7, 19),
        ("Easom", "Improved AFSA"): (11, 5, 5),
        ("Booth", "Standard AFSA"): (24, 5, 17),
        ("Booth", "Improved AFSA"): (15, 4, 9),
        ("Bohachevsky", "Standard AFSA"): (30, 8, 21),
        ("Bohachevsky", "Improved AFSA"): (13, 2, 7),
        ("Sum Squares", "Standard AFSA"): (49, 17, 34),
        ("Sum Squares", "Improved AFSA"): (19, 6, 13),
    },
    ours={"runs": "d"},
    note=(
        "The paper does not define convergence. Here a run of 200 iterations has converged when 99 % of the decrease of its "
        "best value is done. The paper has 100 runs."
    ),
)
_RIVALS = {"A*": ".3f", "AFSA": ".3f", "HAAFSA": ".3f", "IAFSA": ".3f"}
_RATIO = {"IAFSA / A*, printed": ".3f"}
_ROBOT = (
    "Our cells are texts: the paper measures a real robot on maps that it shows as pictures only. An optimal path along "
    "eight neighbours is at most 1.082 times the shortest path, so a printed ratio below 0.924 shows that the paper's A* is "
    "not that search. Along four neighbours the ratio can be as small as 0.707."
)
TABLE_4 = ResultTable(
    "table-4",
    "Table 4: route of the robot in a self-created environment (m)",
    keys=("path",),
    columns=_RIVALS,
    rows={
        ("A-B",): (6.658, 7.201, 6.352, 5.624),
        ("B-C",): (4.713, 5.593, 4.731, 3.956),
        ("C-D",): (3.967, 4.002, 3.989, 3.253),
        ("D-E",): (3.594, 3.702, 3.536, 2.821),
    },
    ours=_RATIO,
    note=_ROBOT,
)
TABLE_5 = ResultTable(
    "table-5",
    "Table 5: route of the robot in a real environment (m)",
    keys=("path",),
    columns=_RIVALS,
    rows={
        ("A-B",): (5.824, 6.855, 5.875, 5.31),
        ("A-C",): (12.621, 14.255, 12.751, 10.982),
        ("E-D",): (3.875, 4.254, 4.045, 3.125),
        ("D-B",): (13.352, 15.245, 14.145, 11.145),
    },
    ours=_RATIO,
    note=_ROBOT,
)
#: Searches compared with the swarms at equal evaluations.
RIVALS = (
    *("dual-annealing", "particle-swarm", "differential-evolution", "direct"),
    *("haafsa", "iafsa", "afsa", "random-search"),
)
EQUAL = ResultTable(
    "equal-evaluations",
    "Median distance from the optimum after 10,000 evaluations",
    keys=("instance",),
    columns={},
    rows={(f"{name}{moved}",): () for moved in ("", "-shifted") for name in FUNCTIONS.values()},
    ours={**dict.fromkeys(RIVALS, ".2g"), "runs": "d"},
    note="The paper has no such table. Values below 1e-9 are shown as 0.",
)
#: Maps for the search of waypoints.
MAPS = (
    *("open", "cells", "blocks", "polygons-30", "polygons-40"),
    *("gap", "pocket", "corners", "rooms", "enclosed"),
)
WALKERS = ("afsa", "haafsa", "iafsa", "differential-evolution", "direct", "random-search")
WAYS = ResultTable(
    "paths",
    "Median length of paths through waypoints after 10,000 evaluations, with the penalty of blocked cells (m)",
    keys=("map",),
    columns={},
    rows={(name,): () for name in MAPS},
    ours={
        "shortest, any direction": ".1f",
        "shortest, eight neighbours": ".1f",
        **dict.fromkeys(WALKERS, ".1f"),
        "runs": "d",
    },
    note="The maps are ours. The shortest lengths are proven; the goal of `enclosed` cannot be reached.",
)

PAPER = Paper(
    "black-box",
    "The Robot Path Planning Based on Improved Artificial Fish Swarm Algorithm, Mathematical Problems in Engineering "
    "2016, article 3297585, doi 10.1155/2016/3297585",
    ITEMS,
    (TABLE_2, TABLE_3, TABLE_4, TABLE_5, EQUAL, WAYS),
)
