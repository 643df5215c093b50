"""Measure the time of a whole step of the planners: the question, the answer and the decision.

``python tests/benchmarks/unknown_grid/loop.py [SCENES ...]`` prints one row per number of scenes and planner. A step is
one action of the vehicle in one scene. The kernels are compiled before. "call" is the time of ``ct.solve`` with the
verification, "loop" that of the policy and the simulator, and "CPU" the CPU time of this process during the call. The
ratio compares the loop with the decisions alone. With ``--worker`` the runs use a process of their own.
"""

import argparse
import time

import crosstrack as ct
from crosstrack.instances.unknown_grid import draw_scenes
from crosstrack.jit import compile_always

PLANNERS = ("d-star-lite", "a-star-replanning", "current-view", "baseline-1", "baseline-2")
REPETITIONS = 5
COLUMNS = ("call us", "CPU us", "loop us", "decision us", "ratio", "steps/s")


def measure(planner, scenes, isolate):
    """Return the steps and one value per column, from the fastest of several solves."""
    model = draw_scenes(
        "mixed", shape=(17, 17), obstacles=(2, 5), view=(5, 5), scenes=scenes, seed=3
    )
    runs = []
    for _ in range(REPETITIONS + 1):
        begin, used = time.perf_counter(), time.process_time()
        found = ct.solve(model, planner, isolate=isolate)
        runs.append((time.perf_counter() - begin, time.process_time() - used, found))
    call, used, found = min(runs[1:], key=lambda row: row[2].seconds["solve"])
    assert found.plan is not None, found.message
    steps = sum(map(len, found.plan.actions))
    loop, decision = found.seconds["solve"] / steps, found.statistics["ms a decision"] / 1e3
    times = [1e6 * value for value in (call / steps, used / steps, loop, decision)]
    return steps, (*times, loop / decision, 1.0 / loop)


def main():
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("scenes", nargs="*", type=int, default=[1, 30, 1000])
    parser.add_argument("--worker", action="store_true")
    given = parser.parse_args()
    compile_always()
    print(f"{'scenes':>6} {'planner':18} {'steps':>6} " + " ".join(f"{x:>11}" for x in COLUMNS))
    for scenes in given.scenes:
        for planner in PLANNERS:
            steps, values = measure(planner, scenes, given.worker or None)
            row = " ".join(f"{value:11.1f}" for value in values)
            print(f"{scenes:6} {planner:18} {steps:6} {row}", flush=True)


if __name__ == "__main__":
    main()
