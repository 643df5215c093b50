"""Measure the time of a whole step of the planners: the question, the answer and the decision.

``python tests/benchmarks/unknown_grid/loop.py [SCENES ...]`` prints one row per number of scenes and planner. A step is
one action of the vehicle in one scene. The first solve compiles and is not measured. The ratio compares the whole
step with the decision alone.
"""

import sys
import time

import crosstrack as ct
from crosstrack.instances.unknown_grid import draw_scenes
from crosstrack.solvers.unknown_grid.native import NavigationBackend

PLANNERS = ("d-star-lite", "a-star-replanning", "current-view", "baseline-1", "baseline-2")
REPETITIONS = 5


def measure(planner, scenes):
    """Return the steps, and the best wall and CPU time of a solve in this process, s."""
    law = {"law": "mixed", "shape": (17, 17), "obstacles": (2, 5), "view": (5, 5)}
    model = draw_scenes(**law, scenes=scenes, seed=3)
    best = []
    for _ in range(REPETITIONS + 1):
        begin, used = time.perf_counter(), time.process_time()
        found = ct.solve(model, planner)
        best.append((time.perf_counter() - begin, time.process_time() - used, found))
    assert found.plan is not None, found.message
    wall, used, found = min(best[1:], key=lambda row: row[0])
    steps = sum(map(len, found.plan.actions))
    return steps, wall, used, found.seconds["solve"], found.statistics["ms a decision"]


def main():
    """Print the table."""
    print(
        "scenes planner             steps  us/step(call)  us/step(loop)  us/decision  ratio  steps/s"
    )
    for scenes in map(int, sys.argv[1:] or ("1", "30", "1000")):
        for planner in PLANNERS:
            steps, wall, _, loop, decision = measure(planner, scenes)
            print(
                f"{scenes:6} {planner:18} {steps:6} {1e6 * wall / steps:14.1f} {1e6 * loop / steps:14.1f}"
                f" {1e3 * decision:12.1f} {1e3 * loop / steps / decision:6.1f} {steps / loop:9.0f}",
                flush=True,
            )


if __name__ == "__main__":
    assert issubclass(NavigationBackend, ct.solvers.Backend)
    main()
