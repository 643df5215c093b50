"""Declaration of the paper on unknown grids: items, result tables and the policies compared on them."""

from __future__ import annotations

from ..paper import Paper, ResultTable, corrected, different, printed

__all__ = ["PAPER", "POLICIES"]

_MCGN, _GMGN = "solvers.unknown_grid.macn", "solvers.unknown_grid.gmgn"
_VALUES = "solvers.unknown_grid.value_iteration:build_planner"
_MEMORY = "solvers.unknown_grid.dnc:build_computer"
_EPISODES = "solvers.unknown_grid.episodes"
_CAMERA = "models.unknown_grid.camera:Pinhole"
_BASELINES = "solvers.unknown_grid.baselines"
_PICTURE = "the map is only in the picture"

#: Policies of the comparison: name in the table, backend and options.
POLICIES: dict[str, tuple[str, dict[str, object]]] = {
    "oracle": ("oracle", {}),
    "d-star-lite": ("d-star-lite", {}),
    "small-vin": ("small-vin", {}),
    "current-view": ("current-view", {}),
    "baseline-1": ("baseline-1", {}),
    "baseline-1-reachable": ("baseline-1-reachable", {}),
    "baseline-2": ("baseline-2", {}),
    "baseline-2-reachable": ("baseline-2-reachable", {}),
    "baseline-2, literal": ("baseline-2", {"literal": True}),
    "vin": ("vin", {}),
    "macn": ("macn", {}),
    "macn, without values": ("macn", {"without": "values"}),
    "macn, without memory": ("macn", {"without": "memory"}),
    "mcgn": ("mcgn", {}),
    "mcgn, without values": ("mcgn", {"without": "values"}),
    "mcgn, without memory": ("mcgn", {"without": "memory"}),
}

_TABLE_6 = ResultTable(
    "table-6",
    "Table VI: targets reached of 100 scenes",
    keys=("task", "method"),
    columns={f"{n} obstacles": ".1f" for n in (2, 3, 4, 5)},
    rows={
        ("1", "MACN"): (84, 70, 70, 72),
        ("1", "MCGN"): (93, 85, 84, 85),
        ("2", "MACN"): (79, 65, 64, 60),
        ("2", "MCGN"): (88, 83, 79, 77),
        ("3", "MACN"): (82, 68, 65, 64),
        ("3", "MCGN"): (90, 82, 82, 79),
    },
    ours={"deviation": ".1f", "reachable in 40": ".1f"},
    note="Our values are means of twice 100 scenes per cell, drawn by the law paper; deviation is the standard "
    "deviation of the two hundreds, averaged over the cells of the row. The last column is the share of targets that can be "
    "reached within 40 steps at all: the proven best value. The scenes of the paper are not published.",
)
_FIGURE_8 = ResultTable(
    "figure-8",
    "Figure 8: steps in eight scenes of Task 1",
    keys=("scene",),
    columns={"MCGN": "d", "MACN": "d"},
    rows={
        ("a",): (16, 16),
        ("b",): (16, 25),
        ("c",): ("reached", "not reached"),
        ("d",): ("not reached", "not reached"),
        ("e",): ("as MACN", "as MCGN"),
        ("f",): ("fewer than MACN", "more than MCGN"),
        ("g",): (17, 18),
        ("h",): ("reached, with a detour", "not reached"),
    },
    note="The eight maps are shown in a picture and not printed as data, so the runs cannot be repeated. Texts state "
    "what the paper says of a scene without a number.",
)
_TIMES = ResultTable(
    "times",
    "Times of Section IV.C, s",
    keys=("network",),
    columns={"seconds": ".4f"},
    rows={("GMGN, one image of 256 × 256",): (0.827,), ("MCGN, one command",): (0.009,)},
    note="The paper used an i5-9400F and an NVIDIA RTX 2060; ours are of one core of a shared machine without a "
    "graphics card.",
)
_POLICIES = ResultTable(
    "policies",
    "All policies on the scenes of Task 2 (ours)",
    keys=("policy",),
    columns={},
    rows={(policy,): () for policy in POLICIES},
    ours={"reached %": ".1f", "deviation": ".1f", "steps / fewest": ".3f", "collisions a scene": ".2f"},
    note="400 scenes by the law paper, 100 for each number of obstacles. Deviation is the standard deviation over the four "
    "hundreds. Without values, the controller reads V = 0; without memory, the computer forgets everything before "
    "each step.",
)  # fmt: skip

PAPER = Paper(
    "unknown-grid",
    "Motion Planning for Heterogeneous Unmanned Systems under Partial Observation from UAV, IROS 2020, "
    "doi 10.1109/IROS45743.2020.9341326",
    items=(
        printed("Section III", "UGV and UAV move together; the UAV hovers once the target is in its view",
                "models.unknown_grid.sight:uav_cells"),
        printed("Section III.A, O_p", "view of m × n cells with obstacles 1 and target 2",
                "models.unknown_grid.world:World.cells"),
        printed("Section III.A, O_g", "map of M × N cells: -1 outside the view, a target there too",
                "solvers.unknown_grid.memory:Memory.look",
                "Only the current view is known, as Section IV.A.3 builds it."),
        different("Figure 3, GMGN", "ENet, stages 1-5, to a one-channel map, then PPN", f"{_GMGN}:build_network",
                  "Blocks and dilations are ENet's. Its stages 1-4 have half of ENet's channels, so that training takes "
                  "minutes without a graphics card. The paper does not describe PPN: ours averages the map over cells and "
                  "has three convolutions."),
        printed("Section IV.A.2, training of GMGN", "ENet alone, PPN alone, then both together",
                f"{_GMGN}:GmgnTrainer", "Images and labels are rendered from scenes instead of labelled by hand."),
        printed("eq. 1-2", "value iteration: Q = R + gamma P V, V = max Q, K = 30", _VALUES,
                "Four actions with learned 3 × 3 kernels and the gradient through all iterations."),
        printed("eq. 3", "write to the memory: erase, then add", "solvers.unknown_grid.dnc:write"),
        printed("eq. 4", "read from the memory: weighted mean of its rows", "solvers.unknown_grid.dnc:read"),
        printed("Section III.B.3, reward map", "10 at the target, 0 elsewhere", _VALUES),
        printed("Table I", "ConvNet: 3 × 3, 2 → 150; 1 × 1, 150 → R; 3 × 3, 1 → 4 = Q; maximum = V", _VALUES,
                "No activation, as none is printed. So R is linear in O_g and the reward map."),
        printed("Figure 6, MCGN-I", "the controller reads O_g, V and r(t-1); output linear in v(t) and r(t)",
                f"{_MCGN}:First"),
        different("Section IV.C, maps of MCGN-I", "one network for 17 × 17 and 15 × 15 cells",
                  "solvers.unknown_grid.macn:build_network",
                  "The paper does not say whether each task has its own network. Ours serves all three: smaller maps lie "
                  "in the middle of 17 × 17 cells, with obstacles around them."),
        printed("Figure 6, MCGN-II", "ConvNet, VIN and attention on O_p, without the computer",
                "solvers.unknown_grid.value_iteration:build_network",
                "Attention takes the four action values at the vehicle's cell, as VIN does."),
        printed("Section IV.A.3, parallel use", "MCGN-I until the target is in the view, then MCGN-II",
                f"{_MCGN}:combine"),
        printed("Section IV.A.3, expert", "A* on the true map; each O_g with its action", f"{_EPISODES}:lead",
                "Of equally good actions the first of up, down, left, right."),
        printed("Section IV.A.3, separate training", "MCGN-I and MCGN-II", f"{_EPISODES}:ImitationTrainer"),
        different("Table II, learning rate", "10e-5 = 1e-4", f"{_MCGN}:First",
                  "The default of the training, with which MCGN-I and MACN were trained. MCGN-II was trained with 1e-2, "
                  "as its weights reach more targets than those of 120 epochs with 1e-4."),
        different("Table II, epochs and episodes", "120 epochs of 200 episodes, batch 64", f"{_EPISODES}:ImitationTrainer",
                  "The default of the training: 24,000 batches of 64 episodes (of 64 decisions for MCGN-II). The public "
                  "implementation of MACN, whose settings Table II repeats, counts batches as episodes. The shipped "
                  "weights are the best of 88 (MCGN-I) and 81 (MACN) of the 120 epochs. Those of MCGN-II saw 1,100 batches."),
        different("Table II, optimiser and first weights", "not printed", "solvers.learning.gradient:GradientTrainer",
                  "Adam, with a rate that falls as half a cosine and gradients cut to norm 1. First weights are normal with "
                  "standard deviation 0.01 in ConvNet and VIN."),
        printed("Table II, VIN", "30 iterations, 4 channels of Q, 150 channels of the first layer", _VALUES),
        printed("Table II, computer", "LSTM of 256; 32 words of 8; 4 read heads, 1 write head", _MEMORY),
        corrected("eq. 5-6", "camera coordinates by world coordinates: CTW = diag(-1, 1, -1) and an offset",
                  f"{_CAMERA}.camera_from_world",
                  "The text calls the offset the position of the camera's origin in the world. With C = T W the camera's "
                  "origin must map to 0, so the offset is -diag(-1, 1, -1) times that position: the world's origin in the "
                  "camera's frame, as the symbols say. With the text, y would be wrong by twice the camera's y."),
        corrected("eq. 7-8", "grid coordinates by camera coordinates: MTC", f"{_CAMERA}.map_from_camera",
                  "The offset is the camera's origin in the frame of the grid, by the argument of eq. 5-6."),
        corrected("eq. 9", "world coordinates by grid coordinates", f"{_CAMERA}.map_from_world",
                  "Printed with the inverse of MTW = MTC CTW, which is right. The product is the same as that of the "
                  "frames used before."),
        printed("Table III", "Traditional Baseline 1", f"{_BASELINES}:BaselineOne",
                "SearchMinDis2Target chooses among all free cells of the view; baseline-1-reachable is the other reading, "
                "which reaches more targets."),
        corrected("Table IV", "Traditional Baseline 2", f"{_BASELINES}:BaselineTwo",
                  "As printed, CurrentPos becomes MidPoint although one action was executed, and the run ends when the "
                  "target comes into the view: no target is ever reached (option literal). With CurrentPos the vehicle's "
                  "cell and the last stage of Table III it goes back and forth in a pocket, the motion of Figure 7(c)."),
        printed("Table V", "sizes of maps and views of the three tasks",
                "models.unknown_grid.scenes:Task"),
        printed("Section IV.C, observation ratio", "0.65, 0.53 and 0.6", "models.unknown_grid.scenes:Task.ratio"),
        printed("Section IV.C, scenes", "obstacles of different sizes, start and target at random, solvable",
                "instances.unknown_grid.laws:draw_scenes",
                "Law paper. Sizes are not printed: each side has from one cell to a third of the map's. The laws of "
                "our own keep start and target apart and the ground around the target free."),
        printed("Section IV.C, steps", "a run fails after 40 steps; a collision costs a step",
                "models.unknown_grid.checks:replay"),
        printed("Section IV.C, MACN", "the baseline", "solvers.unknown_grid.macn:build_network",
                "Cited, not described. Ours is the network of MCGN-I whose controller reads R and V, used for the whole "
                "run, as in the public implementation whose settings Table II repeats. The UAV hovers for MACN too, although O_g then "
                "does not show the vehicle; the paper does not say so, and its MACN reaches more targets than ours."),
        different("Figure 7", "runs of MCGN and both baselines in one trap", f"{_BASELINES}:BaselineOne",
                  "The map is only in the picture. A test follows baseline 1 through a trap of the same kind, and baseline 2 in a pocket."),
    ),
    tables=(_TABLE_6, _FIGURE_8, _TIMES, _POLICIES),
)  # fmt: skip
