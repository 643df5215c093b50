"""Measure the time of a whole step of the planners: the question, the answer and the decision.

``python tests/benchmarks/unknown_grid/loop.py [SCENES ...]`` prints one row per number of scenes and planner, and
``--write`` stores the table of the page. A step is one action of the vehicle in one scene. The kernels are compiled
before, and each value is the least of several runs.
"""

import argparse
import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.measured import write  # noqa: E402

import crosstrack as ct  # noqa: E402
from crosstrack.instances.unknown_grid import draw_scenes  # noqa: E402
from crosstrack.jit import compile_always  # noqa: E402

PLANNERS = ("d-star-lite", "a-star-replanning", "current-view", "baseline-1", "baseline-2")
REPETITIONS = 20
COLUMNS = {
    "scenes": "d",
    "policy": "",
    "steps": "d",
    "step, µs": ".1f",
    "step in a worker, µs": ".1f",
    "decision, µs": ".1f",
    "steps per second": ".0f",
}
SAID = (
    "A step is the question, the answer and the decision, per vehicle. Scenes of the distribution `mixed` on 17 × 17 cells "
    "with 2 to 5 obstacles and a view of 5 × 5 cells. The least of 20 runs on a busy machine of two cores."
)


def measure(planner, scenes):
    """Return a row of the table."""
    model = draw_scenes(
        "mixed", shape=(17, 17), obstacles=(2, 5), view=(5, 5), scenes=scenes, seed=3
    )
    best = {None: (1e9, None), True: (1e9, None)}
    for isolate in best:
        for _ in range(REPETITIONS):
            found = ct.solve(model, planner, isolate=isolate)
            assert found.plan is not None, found.message
            best[isolate] = min(
                best[isolate], (found.seconds["solve"], found), key=lambda pair: pair[0]
            )
    (here, found), (apart, _) = best.values()
    steps = sum(map(len, found.plan.actions))
    decision = 1e3 * found.statistics["ms a decision"]
    return [scenes, planner, steps, 1e6 * here / steps, 1e6 * apart / steps, decision, steps / here]


def main():
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("scenes", nargs="*", type=int, default=[1, 30, 1000])
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    compile_always()
    rows = []
    for scenes in given.scenes:
        for planner in PLANNERS:
            rows.append(measure(planner, scenes))
            print(*map(format, rows[-1], COLUMNS.values()), sep=" | ", flush=True)
    if given.write:
        write("unknown-grid", "loop", __file__, COLUMNS, rows, ("numba", "numpy"), SAID)


if __name__ == "__main__":
    main()
