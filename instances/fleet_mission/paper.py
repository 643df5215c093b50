"""Items of the paper on missions of a fleet: status and place in the code."""

from __future__ import annotations

from ..grid_path.paper import PAPER as GRID
from ..paper import Paper, corrected, different, printed
from .table_3 import TABLE_3

__all__ = ["PAPER"]

_PIPELINE = "solvers.fleet_mission.paper:PaperPipeline"
_MISSION = "instances.fleet_mission.table_3:table_3_mission"

PAPER = Paper(
    GRID.name,
    GRID.reference,
    items=(
        printed("eq. 1", "sum of the lengths of all routes", "models.fleet.checks:loads_of"),
        corrected(
            "eq. 2", "p = 1 if salesman k travels from i to j", "models.fleet.checks:loads_of",
            "The second case is printed as 2. Eq. 1 sums d p over all arcs, so it is 0: an arc that is not "
            "travelled adds nothing.",
        ),
        corrected(
            "section 3.1", "numbers of robots and nodes", "models.fleet_mission.data:MissionData",
            "Eq. 1 has m salesmen and n cities, the next paragraph m target nodes and n robots, and "
            "cities are counted from T_0 with T_1 as the start. Section 3.2 and the algorithms have m robots "
            "and one starting node, which is taken here.",
        ),
        printed("eq. 14", "energy = distance x unit energy", "solvers.fleet_mission.energies:leg_energies"),
        printed("eq. 15", "sum of the energies of all routes", "models.fleet.checks:objective_of"),
        printed(
            "eq. 17", "unit energy: Manhattan over Euclidean distance",
            "solvers.fleet_mission.energies:unit_energies",
            "Times the Euclidean distance (eq. 14) it is the Manhattan distance. Obstacles enter only by "
            "the choice of the pairs that eq. 17 applies to.",
        ),
        printed(
            "Algorithm 1, lines 1-6", "map, nodes and obstacles on a grid",
            "models.fleet_mission.data:MissionData.map",
        ),
        printed(
            "Algorithm 1, lines 7-13", "unit energies for pairs that are not on a direct path",
            "solvers.fleet_mission.energies:leg_energies",
            "Default of paper-pipeline: Euclidean distance for places that see each other, eq. 17 for all "
            "others. Table 3 does not follow from it: there the grid paths of four robots differ by at most "
            "10 m for q >= 0.4, which only energies that are lengths of grid paths reach (option "
            "energies=paths). The page compares the readings.",
        ),
        printed(
            "Algorithm 1, lines 14-16", "routes by GPSO-AC", "solvers.fleet_mission.stages:Stages.routed"
        ),
        corrected(
            "Algorithm 1, lines 17-22", "smoothing, then polynomials", _PIPELINE,
            "The names of the algorithms are exchanged: line 17 gives minimum snap the task to reduce "
            "turning points, and line 20 gives A* and RRT the task to solve polynomials. Figures 16-18 and "
            "section 4.3 have the order A*, Algorithm 4, minimum snap.",
        ),
        different(
            "eq. 23-25 in a mission", "rest and continuity up to the acceleration",
            "models.fleet_mission.checks:verify_mission",
            "The default of FleetMission also asks for the jerk. continuity=2 asks for eq. 23-25 alone, "
            "and the checks of the jerk have no equation number. The page compares both.",
        ),
        different(
            "times and limits of the curves", "the print has neither",
            "solvers.fleet_mission.flight:times_along",
            "Times follow a trapezoidal speed profile, and each curve is slowed down until it keeps "
            "the limits of velocity and acceleration. With these times the curves of Table 3's mission swing "
            "off the map; the page states how far.",
        ),
        different(
            "Figure 2", "map with depot, nodes and obstacles", _MISSION,
            "Picture without coordinates. Ours is drawn by seed with the printed numbers; the depot is "
            "at the bottom left.",
        ),
        different(
            "Figures 4-6", "graph of paths, and unit energies of two parts of it",
            "solvers.fleet_mission.energies:leg_energies",
            "Pictures of the map that is not printed; the text has no number of theirs.",
        ),
        different(
            "Figure 12", "simulation platform", _PIPELINE,
            "Picture; the available text lacks section 4.1. The backend stands in for the platform.",
        ),
        different(
            "section 4.3, Figures 13-18", "three robots, stage by stage",
            "models.fleet_mission.plot:draw",
            "Pictures without data. draw shows the same stages as layers of one mission.",
        ),
        printed("section 4.4", "4 robots, 75 nodes, 28 obstacles, 14 values of q", _MISSION),
        printed(
            "Figures 19 and 20", "total and deviation over q",
            "instances.fleet_mission.table_3:measure_table_3",
            "Both plot columns of Table 3.",
        ),
    ),
    tables=(TABLE_3,),
)  # fmt: skip
