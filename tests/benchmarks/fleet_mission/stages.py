"""Seconds of the stages of a mission with the paper's numbers, from polygons to verified trajectories.

::

    python tests/benchmarks/fleet_mission/stages.py
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from statistics import median

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.measured import write  # noqa: E402

import crosstrack as ct  # noqa: E402

NAME, REPEATS = "fleet-mission/paper", 3
#: Suffix of the statistics with the time (s) of a stage.
STAGE = " seconds"


def main() -> None:
    """Solve the mission once to compile, then some times more."""
    data = ct.load(NAME).data()
    stages: dict[str, list[float]] = {}
    for run in range(1 + REPEATS):
        begin = time.perf_counter()
        model = ct.models.FleetMission.from_data(data)
        spent = {"polygons to grid": time.perf_counter() - begin}
        found = ct.solve(model, "staged", seed=run)
        whole = time.perf_counter() - begin
        assert found.verified, found
        for name, value in found.statistics.items():
            if name.endswith(STAGE):
                spent[name.removesuffix(STAGE)] = float(value)
        spent["verification"] = found.seconds["verify"]
        for name, seconds in {**spent, "in all": whole}.items():
            if run:
                stages.setdefault(name, []).append(seconds)
    share = median(stages["in all"])
    rows = [(name, median(own), median(own) / share) for name, own in stages.items()]
    for row in rows:
        print("{:24s} {:8.3f} s {:7.1%}".format(*row))
    columns = {"stage": "", "seconds": ".3g", "share of all": ".1%"}
    said = f"Medians of {REPEATS} runs of `{NAME}` after one that compiles."
    write("fleet-mission", "stages", __file__, columns, rows, ("numpy", "shapely"), said)


if __name__ == "__main__":
    main()
