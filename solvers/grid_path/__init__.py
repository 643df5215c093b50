"""Shortest paths on a grid; the loops are compiled by Numba."""

#: Names that modules of other problems import, beside the public ones.
SHARED = ("smoothing.smooth",)
BACKENDS = {
    "a-star": ".exact:AStar",
    "dijkstra": ".exact:Dijkstra",
    "jump-point": ".exact:JumpPoint",
    "any-angle": ".any_angle:AnyAngle",
    "theta-star": ".theta_star:ThetaStar",
    "shortcut-visibility": ".shortcut:ShortcutVisibility",
    "shortcut-greedy": ".shortcut:ShortcutGreedy",
    "rrt-star": ".rrt_star:RRTStar",
}
DIAGNOSES = {"grid-path": ".diagnosis:diagnose_path"}
