"""Shortest paths on a grid."""

BACKENDS = {
    "any-angle": ".any_angle:AnyAngle",
}
