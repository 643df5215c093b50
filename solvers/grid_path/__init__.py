"""Shortest paths on a grid."""

BACKENDS = {
    "a-star": ".exact:AStar",
    "dijkstra": ".exact:Dijkstra",
    "jump-point": ".exact:JumpPoint",
}
DIAGNOSES = {"grid-path": ".diagnosis:diagnose_path"}
