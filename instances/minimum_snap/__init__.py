"""Instances of minimum-derivative trajectories: curves, random walks, corridors, and their files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .bezier import read_bezier as read_bezier, write_bezier as write_bezier
    from .corridors import (
        corridor as corridor,
        corridor_with_way as corridor_with_way,
        gates as gates,
        hurried as hurried,
    )
    from .paths import (
        figure_eight as figure_eight,
        helix as helix,
        random_walk as random_walk,
        random_waypoints as random_waypoints,
        square as square,
        times_by_distance as times_by_distance,
    )
    from .pieces import Poly7 as Poly7
    from .poly7 import (
        PIECES_THAT_FIT as PIECES_THAT_FIT,
        Poly7Report as Poly7Report,
        read_poly7 as read_poly7,
        write_poly7 as write_poly7,
    )
    from .tables import (
        Samples as Samples,
        read_samples as read_samples,
        read_waypoints as read_waypoints,
        sample_columns as sample_columns,
        write_samples as write_samples,
    )

CATALOGUE = {
    "minimum-derivative": ".listing:derivative_entries",
    "minimum-snap": ".listing:snap_entries",
    "time-allocation": ".listing:allocation_entries",
}
PAPERS = {"minimum-snap": ".paper:PAPER"}
REFERENCES = {
    "minimum-derivative": ".tables:resolve_references",
    "minimum-snap": ".tables:resolve_references",
}
TABLE_FILES = {
    "minimum-snap": ".tables:waypoints_of_table",
    "minimum-derivative": ".tables:waypoints_of_table",
    "time-allocation": ".tables:waypoints_of_table",
}
TABLE_COLUMNS = {kind: {x: f"waypoints.{k}" for k, x in enumerate("xyz")} for kind in TABLE_FILES}
HINTS = {"trajectory": ".tables:describe_table"}
DEMOS = {"minimum-snap": "minimum-snap/square"}
EXPORTS = {"poly7": ".poly7:POLY7", "samples": ".tables:SAMPLES", "bezier": ".bezier:BEZIER"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
