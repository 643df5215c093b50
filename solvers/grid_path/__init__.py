"""Shortest paths on a grid."""

BACKENDS = {
    "any-angle": ".any_angle:AnyAngle",
    "theta-star": ".theta_star:ThetaStar",
    "shortcut-greedy": ".shortcut:ShortcutGreedy",
    "shortcut-visibility": ".shortcut:ShortcutVisibility",
    "rrt-star": ".rrt_star:RRTStar",
}
