"""Items and result tables of the paper on guided vehicles with precedence constraints, with their status."""

from __future__ import annotations

from ..paper import Paper, ResultTable, corrected, different, printed

__all__ = ["INSTANCES", "PAPER"]

_CHECK, _DATA = "models.guided_path.checks:verify_tour", "models.guided_path.data:GuidedPathData"
_TABLE = "solvers.guided_path.table_kernels:fill_table"
_HEURISTICS = "solvers.guided_path.insertion"

ITEMS = (
    printed("eq. 1", "chains of the example in Figure 1", "instances.guided_path.listing:catalogue_entries"),
    printed("eq. 2", "distance along the path", _CHECK),
    corrected(
        "eq. 3", "length of the tour", _CHECK,
        "The last inner distance is printed with the index i_n - 1. A tour of n customers goes from i_(n-1) to i_n.",
    ),
    printed("eq. 4-6", "precedence constraints: chains that begin at the start", _DATA),
    printed(
        "section 3, chains without common customers", "one chain per customer", f"{_DATA}.check",
        "Field precedence takes further pairs, so any relation without a cycle can be stated.",
    ),
    corrected(
        "Property 1", "customers without a constraint to the right of all others", "models.guided_path.walks:reduced",
        "The statement takes the start as the leftmost place. With customers on both sides the outermost one on each "
        "side counts. Also, some optimal tour has this form, not each one.",
    ),
    corrected(
        "Algorithm 1", "customers of L and R inserted into a tour of P", "models.guided_path.walks:passed",
        "As Property 1: the outermost customer of R stays in the problem, the others are inserted when they are passed.",
    ),
    printed("Theorem 2", "Algorithm 1 keeps the optimum", "models.guided_path.walks:reduced"),
    printed("Property 2", "a tour visits each customer once", _CHECK),
    printed("eq. 7", "states before a state", _TABLE),
    printed("eq. 8", "recursion of f*(t, S)", _TABLE),
    printed("eq. 9", "boundary conditions", _TABLE),
    printed("eq. 10", "length of the shortest tour", "solvers.guided_path.table_kernels:trace_table"),
    printed(
        "Algorithm 3", "exact dynamic program", "solvers.guided_path.dynamic_programming:DynamicProgramming",
        "Option passing=False leaves out what Property 1 does. The default also leaves out each customer that any tour "
        "passes in time, which changes no length.",
    ),
    printed(
        "Theorem 4", "complexity O(k n^(k+1))", "solvers.guided_path.dynamic_programming:Table.states",
        "The bound is valid and not tight: k² Π(l_i + 1) steps.",
    ),
    printed("Example 5, eq. 11-25", "all values of the dynamic program for the example", _TABLE),
    printed(
        "Algorithm 6", "heuristic: chains merged one by one", f"{_HEURISTICS}:InsertNearest",
        "Step (a) takes the chain whose first customer is nearest to the last customer of the tour; ties go by index. "
        "Earlier versions sorted by distance from the start. On 20 instances of 10 chains the mean length is 871 m.",
    ),
    printed(
        "section 5, revised Algorithm 6", "chains merged by index", f"{_HEURISTICS}:InsertIndex",
    ),
    printed(
        "section 5, greedy insertion", "the nearest available customer comes next", f"{_HEURISTICS}:Greedy",
        "Earlier versions inserted each customer where the tour grew least (1,080 m at k = 10 instead of about 990 m). "
        "The printed lengths do not fit the printed rule. On the same 20 instances of 10 chains, the customer nearest to the start gives "
        "2,971 m, a random available one 3,666 m and the next whole chain 3,144 m (printed 2,309 m).",
    ),
    printed(
        "section 5, instances", "10 groups of 10, integer coordinates from 1 to 200", "instances.guided_path.generator:generate",
        "Lengths of chains are not printed. 50 customers in 10 chains suggests 5 each. At k = 1 the printed mean of 640 m is "
        "that of a chain of about 7: an instance of 5 has 468 m on average.",
    ),
    different(
        "section 6, complexity", "the problem with any number of chains", "instances.guided_path.supersequence:supersequence_tour",
        "The conclusion claims a positive answer if k is part of the input, but the paper proves it for constant k "
        "only. Our reduction shows that the problem is strongly NP-hard for arbitrary k.",
    ),
    printed("Figure 1", "the example: four workstations and a conveyor", "models.guided_path.plot:draw"),
)  # fmt: skip

#: Number of instances of each group.
INSTANCES = 10
_COLUMNS = {
    "Obj GRE": ".0f",
    "Time GRE (s)": ".2g",
    "Obj HEU": ".0f",
    "Time HEU (s)": ".2g",
    "Improvement (%)": ".1f",
}
_NOTE = (
    "The paper prints no coordinates: ours are 10 instances per group, drawn as it states, with chains of 5, so lengths compare "
    "only roughly. Times are those of compiled loops. Improvement is GRE / HEU - 1. At k = 1 only one order exists, so the "
    "printed 677 and 640 cannot both be right."
)
TABLE_1A = ResultTable(
    "table-1a",
    "Table 1(a): greedy insertion (GRE) and Algorithm 6 (HEU), means per group",
    keys=("chains",),
    columns=_COLUMNS,
    rows={
        ("1",): (677, 0.04, 640, 0.035, 5.7),
        ("2",): (816, 0.019, 739, 0.15, 10.5),
        ("3",): (1030, 0.02, 744, 0.61, 38.3),
        ("4",): (1363, 0.02, 926, 7.2, 47.2),
        ("5",): (1374, 0.18, 853, 10.4, 61.1),
        ("6",): (1564, 0.25, 885, 31.3, 76.6),
        ("7",): (1715, 0.26, 957, 47, 79.1),
        ("8",): (1915, 0.28, 889, 55.4, 115.5),
        ("9",): (2228, 0.32, 947, 135, 135.9),
        ("10",): (2309, 0.48, 976, 215, 136.5),
    },
    ours={
        "deviation GRE": ".0f",
        "deviation HEU": ".0f",
        "proven optimum": ".1f",
        "GRE above (%)": ".1f",
        "HEU above (%)": ".1f",
        "time of the proof (s)": ".2g",
    },
    note=_NOTE + " The optimum is proven by a-star.",
)
TABLE_1B = ResultTable(
    "table-1b",
    "Table 1(b): greedy insertion (GRE) and Algorithm 6 with chains by index (HEU), means per group",
    keys=("chains",),
    columns=_COLUMNS,
    rows={
        ("1",): (677, 0.04, 640, 0.04, 5.7),
        ("2",): (816, 0.019, 732, 0.16, 11.5),
        ("3",): (1030, 0.02, 749, 0.62, 37.5),
        ("4",): (1363, 0.02, 910, 6.34, 49.7),
        ("5",): (1374, 0.18, 862, 8.85, 59.4),
        ("6",): (1564, 0.25, 862, 21, 81.4),
        ("7",): (1715, 0.26, 924, 42, 85.4),
        ("8",): (1915, 0.28, 905, 91, 111.5),
        ("9",): (2228, 0.32, 977, 122, 127.9),
        ("10",): (2309, 0.48, 993, 142, 132.5),
    },
    ours={"deviation HEU": ".0f"},
    note=_NOTE,
)

PAPER = Paper(
    "guided-path",
    "Exact and Heuristic Algorithms for Routing AGV on Path with Precedence Constraints, Mathematical Problems in "
    "Engineering 2016, article 5040513, doi 10.1155/2016/5040513",
    ITEMS,
    (TABLE_1A, TABLE_1B),
)
