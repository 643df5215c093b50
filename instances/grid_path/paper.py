"""Items of the paper on paths over a grid: status and place in the code."""

from __future__ import annotations

from ..paper import Paper, corrected, different, printed

__all__ = ["PAPER"]

PAPER = Paper(
    "fleet-mission",
    "S. Su, W. Zhao, C. Wang: Parallel Swarm Intelligent Motion Planning with Energy-Balanced for "
    "Multirobot in Obstacle Environment, Wireless Communications and Mobile Computing, 2021, article "
    "8902328",
    items=(
        printed(
            "section 2.1, Figure 1", "the map as a matrix of free and blocked cells",
            "models.grid_path.gridmap:GridMap",
        ),
        printed("eq. 3", "f = g + h of a cell", "models.grid_path.search_kernels:sweep"),
        printed(
            "eq. 4", "Manhattan distance to the goal as h", "models.grid_path.search_kernels:ahead"
        ),
        corrected(
            "Algorithm 2, Figure 3", "A* over four neighbours", "solvers.grid_path.exact:AStar",
            "As printed, line 10 makes the previous current cell the parent. That is wrong as soon as the "
            "search continues from another open cell. Lines 12-15 select a second current cell by the "
            "least g, line 13 is missing, and no line tests whether the goal is reached. Read as the "
            "standard step, lines 12-15 give an open neighbour a new parent if g becomes smaller, and "
            "the search ends at the goal. Every reading that reaches the goal with a connected path of "
            "least f has the same length, because eq. 4 is a consistent lower bound for four neighbours.",
        ),
        corrected(
            "Algorithm 4", "path along lines of sight", "solvers.grid_path.smoothing:smooth",
            "The inner loop tests end > begin, but end is never assigned: line 5 sets last = n and line 12 "
            "decreases last. With last in place of end, each point is joined to the last later point that "
            "it sees. Table 3 and Figure 17 have no other step between grid path and smoothed path.",
        ),
        different(
            "section 3.2.4, start; Figures 7-11", "introduction of the smoothing", "solvers.grid_path.smoothing:smooth",
            "The available text lacks these paragraphs; the figures are pictures. Algorithm 4 and "
            "eq. 23-25 were taken without them.",
        ),
        different(
            "Algorithm 1, line 20: RRT", "random tree as a second search",
            "solvers.grid_path.rrt_star:RRTStar",
            "The paper names RRT in the introduction and in line 20, and gives neither steps nor "
            "parameters. The backend is RRT* of Karaman and Frazzoli; no stage of the pipeline uses it.",
        ),
    ),
)  # fmt: skip
