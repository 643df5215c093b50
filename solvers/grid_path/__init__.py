"""Solvers of shortest paths on grid maps, with kernels compiled by Numba."""

#: Private names that modules of other problems import.
SHARED = ("smoothing.smooth",)
BACKENDS = {
    "a-star": ".exact:AStar",
    "dijkstra": ".exact:Dijkstra",
    "jump-point": ".exact:JumpPoint",
    "any-angle": ".any_angle:AnyAngle",
    "theta-star": ".theta_star:ThetaStar",
    "shortcut-visibility": ".smoothing:ShortcutVisibility",
    "shortcut-greedy": ".smoothing:ShortcutGreedy",
    "rrt-star": ".rrt_star:RRTStar",
}
DIAGNOSES = {"grid-path": ".diagnosis:diagnose_path"}
