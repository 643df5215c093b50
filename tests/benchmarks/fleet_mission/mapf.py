"""Agents of MAPF scenarios that the planner on cells and time solves in ten seconds.

::

    python tests/benchmarks/fleet_mission/mapf.py [SCENARIO]

Agents are added in the order of the file. A count is reached if all of its agents have paths without conflicts,
which is checked here by vertices and swaps from the raw map and paths. The limit applies to the processor time of all
counts together, including those before the last one.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.fleet_mission.cells import CellPlanner  # noqa: E402
from benchmarks.measured import ROOT, write  # noqa: E402

FOLDER = ROOT.parent / "shared" / "data" / "mapf"
SECONDS, BATCH = 10.0, 5
MAPS = (
    "empty-16-16",
    "random-32-32-20",
    "room-32-32-4",
    "maze-32-32-4",
    "den312d",
    "warehouse-10-20-10-2-1",
)


def read_map(path):
    """Return blocked cells of a map of the MovingAI format."""
    rows = path.read_text("utf-8").split("\n")
    begin = rows.index("map") + 1
    return np.array([[cell not in ".G" for cell in row] for row in rows[begin:] if row])


def read_scenario(path):
    """Return starts and goals as (row, column)."""
    rows = [line.split("\t") for line in path.read_text("utf-8").split("\n")[1:] if line]
    return [((int(r[5]), int(r[4])), (int(r[7]), int(r[6]))) for r in rows]


def check(blocked, ends, paths):
    """Raise an error unless paths are valid: unit moves in free cells, no shared cell and no swap."""
    assert len(ends) == len(paths)
    long = max(map(len, paths))
    seen = set()
    for (start, goal), path in zip(ends, paths, strict=True):
        cells = [tuple(map(int, cell)) for cell in path]
        assert cells[0] == start and cells[-1] == goal
        cells += [goal] * (long - len(cells))
        for t, (row, column) in enumerate(cells):
            assert not blocked[row, column]
            assert (t, row, column) not in seen
            seen.add((t, row, column))
            if t:
                before = cells[t - 1]
                assert abs(row - before[0]) + abs(column - before[1]) <= 1
                if before != (row, column):
                    assert (t, "move", (row, column), before) not in seen
                    seen.add((t, "move", before, (row, column)))


def solved(scenario, seconds=SECONDS):
    """Return the number of agents solved within the time, the number in the file, and the makespan."""
    blocked = read_map(FOLDER / f"{scenario.rpartition('-random-')[0]}.map")
    ends = read_scenario(FOLDER / f"{scenario}.scen")
    planner = CellPlanner(blocked, seed=1)
    begin = time.process_time()

    def late():
        return time.process_time() - begin > seconds

    count, makespan = 0, 0
    while count < len(ends):
        for start, goal in ends[count : count + BATCH]:
            planner.add(start, goal)
        if not planner.solve(late) or late():
            break
        count, makespan = len(planner.paths), planner.makespan
        paths = planner.cells()
    check(blocked, ends[:count], paths)
    return count, len(ends), makespan


def main() -> None:
    """Solve the scenarios and write a table."""
    rows = []
    for name in sys.argv[1:] or [f"{entry}-random-{k}" for entry in MAPS for k in (1, 2, 3)]:
        rows.append((name, *solved(name)))
        print(*rows[-1], flush=True)
    columns = {"scenario": "", "agents solved": "d", "agents in the file": "d", "steps": "d"}
    text = f"Agents in the order of the file, solved within {SECONDS:g} s of processor time."
    write("fleet-mission", "mapf", __file__, columns, rows, ("numpy",), text)


if __name__ == "__main__":
    main()
