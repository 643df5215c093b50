"""Measure the networks inside and outside the laws of their training scenes.

``python tests/benchmarks/unknown_grid/laws.py limits`` calibrates the limits of openness and of walls per law on scenes of
their own seed, and ``… laws.py detection`` measures them on other seeds. ``… laws.py success`` measures each network with
the shipped weights, or one network named instead of ``success``. ``… laws.py rates`` copies the rates that messages give,
``… laws.py small`` compares the small network with the planner on all laws, and ``… laws.py walks`` measures the scenes that
networks report outside their law. ``limits`` and ``rates`` write ``solvers/unknown_grid/laws.json``, ``detection``,
``success``, ``small`` and ``walks`` the tables ``outside-law``, ``laws``, ``small-network`` and ``outside-walks`` of
``docs/measured/unknown-grid.json``.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.measured import ROOT, write  # noqa: E402

from crosstrack.instances.unknown_grid import draw_scenes, maze  # noqa: E402
from crosstrack.instances.unknown_grid.laws import SceneArrays, SceneLaw  # noqa: E402
from crosstrack.models.unknown_grid import World  # noqa: E402
from crosstrack.models.unknown_grid.scenes import TASKS  # noqa: E402
from crosstrack.solvers import Control, Request  # noqa: E402
from crosstrack.solvers.contract.registry import find_backend  # noqa: E402
from crosstrack.solvers.unknown_grid.imitation import (  # noqa: E402
    Scenes,
    best_actions,
    first_of,
    shortest_ways,
    walk_through,
)
from crosstrack.solvers.unknown_grid.networks import load_network  # noqa: E402
from crosstrack.solvers.unknown_grid.training_laws import (  # noqa: E402
    MEASURED,
    openness,
    outside_law,
    wall_lengths,
)

#: Shares of the training scenes below the limit of openness and with a wall above the limit, and scenes per task of the
#: calibration.
SHARE, WALLED, CALIBRATED = 0.02, 0.01, 600
#: Scenes per row of a table and of that of the networks' walks, and the seeds of calibration and measurement.
SCENES, WALKED, SEEDS = 600, 150, {"limits": 90, "success": 91, "small": 92, "detection": 93}
LAWS = [*map(str, SceneLaw), "mazes"]
POLICIES = {"small-vin": "small-vin", "vin": "vin", "macn": "macn", "mcgn": "mcgn-1"}


def scenes_of(law, shape, view, count, seed, steps=40):
    """Return scenes of a law, or one maze per scene."""
    if law != "mazes":
        return draw_scenes(
            law, shape=shape, obstacles=(2, 5), scenes=count, seed=seed, view=view, steps=steps
        )
    drawn = [maze(*shape, seed=seed * 10**6 + k) for k in range(count)]
    fields = ("blocked", "starts", "targets")
    arrays = (np.concatenate([getattr(one, name) for one in drawn]) for name in fields)
    return SceneArrays(*arrays).pose(view=view, steps=steps)


def solve(name, model):
    """Return the success of a policy per scene, percent, and its number of scenes outside the law, in this process."""
    backend = find_backend(name)
    options = backend.checked_options({})
    answer = backend.run(model, Request(options=options, control=Control(oracle=World(model))))
    reached = np.array([str(one) == "reached" for one in answer.point.outcomes])
    return 100.0 * reached, answer.statistics.get("scenes outside the law", 0)


def see(model):
    """Return the cells that the optimistic planner has seen at the end of its runs."""
    known = np.zeros_like(model.blocked, np.int8)

    def choose(observed, rows):
        known[rows] = observed.known
        ways = shortest_ways(observed.known == 1, observed.targets)
        return first_of(best_actions(ways, observed.positions))

    view = tuple(model.view.tolist())
    walk_through(Scenes(model.blocked, model.starts, model.targets), view, choose)
    return known


def limits():
    """Calibrate the limits of openness and of walls with the optimistic planner."""
    found = {}
    for law in map(str, SceneLaw):
        seen = [
            see(scenes_of(law, task.shape, task.view, CALIBRATED, SEEDS["limits"]))
            for task in TASKS
        ]
        shares, lengths = (np.concatenate([*map(of, seen)]) for of in (openness, wall_lengths))
        found[law] = {
            "openness": round(float(np.quantile(shares, SHARE)), 3),
            "wall": int(np.quantile(lengths, 1.0 - WALLED, method="higher")),
        }
    save("laws", found)


def detection():
    """Measure the shares of scenes outside the laws of the shipped weights."""
    rows = []
    for law in ("paper", "walls"):
        for name in (law, *(other for other in LAWS if other != law)):
            shares = []
            for task in TASKS:
                model = scenes_of(name, task.shape, task.view, CALIBRATED, SEEDS["detection"])
                shares.append(outside_law(model, law, [see(model)])[0])
            rows.append([law, name, 100.0 * float(np.concatenate(shares).mean())])
            print(rows[-1], flush=True)
    said = (
        f"{CALIBRATED * len(TASKS)} scenes per row with 2 to 5 obstacles, tasks of the paper. Outside: share of the scenes "
        "outside the law of the training by the cells that the optimistic planner has seen in 40 steps. The limits come from "
        "scenes of another seed."
    )
    heads = {"trained on": "", "scenes": "", "outside %": ".1f"}
    write("unknown-grid", "outside-law", __file__, heads, rows, ("numpy",), said)


def save(part, values):
    """Replace one part of the file that the package reads."""
    tables = {"laws": {}, "success": {}}
    if MEASURED.exists():
        tables |= json.loads(MEASURED.read_text("utf-8"))
    text = json.dumps({**tables, part: values}, indent=1, sort_keys=True, ensure_ascii=False)
    MEASURED.write_text(text + "\n", "utf-8")


def places(law):
    """Yield the name of each kind of scenes, and its models."""
    third = SCENES // len(TASKS)
    for name in (law, *(one for one in LAWS if one != law)):
        seed = SEEDS["success"]
        yield name, [scenes_of(name, task.shape, task.view, third, seed) for task in TASKS]
    yield f"{law}, view 5 × 5", [scenes_of(law, (17, 17), (5, 5), SCENES, SEEDS["success"])]
    yield f"{law}, map 11 × 11", [scenes_of(law, (11, 11), (9, 9), SCENES, SEEDS["success"])]


def success(names=()):
    """Measure success and detection of each network, inside and outside the law of its training."""
    rows = []
    for name in names or POLICIES:
        law = load_network(POLICIES[name]).law
        for place, models in places(law):
            reached, planner = [], []
            for model in models:
                reached.append(solve(name, model)[0])
                planner.append(solve("d-star-lite", model)[0])
            rate, best = (float(np.concatenate(one).mean()) for one in (reached, planner))
            rows.append([name, law, place, rate, best])
            print(rows[-1], flush=True)
    said = f"{SCENES} scenes per row with 2 to 5 obstacles, tasks of the paper unless stated, 40 steps."
    heads = {"network": "", "trained on": "", "scenes": "", "reached %": ".1f"}
    heads["d-star-lite %"] = ".1f"
    write("unknown-grid", "laws", __file__, heads, rows, ("torch",), said, merge=True, keys=3)


def walks():
    """Measure the shares of scenes that results report outside the law, by the cells that the networks have seen."""
    rows, third = [], WALKED // len(TASKS)
    for name in LAWS:
        models = [
            scenes_of(name, task.shape, task.view, third, SEEDS["detection"]) for task in TASKS
        ]
        counts = [sum(solve(policy, model)[1] for model in models) for policy in POLICIES]
        rows.append([name, *(100.0 * count / WALKED for count in counts)])
        print(rows[-1], flush=True)
    said = (
        f"{WALKED} scenes per row with 2 to 5 obstacles, tasks of the paper. Share of the scenes that the result reports "
        "outside the law of the training, by the cells that the network itself has seen in 40 steps."
    )
    heads = {"scenes": "", **{f"{policy}, %": ".1f" for policy in POLICIES}}
    write("unknown-grid", "outside-walks", __file__, heads, rows, ("torch",), said)


def rates():
    """Copy the success rates that messages give from the table to the file of the package."""
    tables = json.loads((ROOT / "docs" / "measured" / "unknown-grid.json").read_text("utf-8"))
    found = {}
    for name, law, place, rate, *_ in tables["laws"]["rows"]:
        reasons = {"walls": "walls", law: "inside", "mazes": "maps"}
        reasons |= {f"{law}, view 5 × 5": "view", f"{law}, map 11 × 11": "shape"}
        if reason := reasons.get(place):
            value = round(rate, 1)
            found.setdefault(name, {})[reason] = value if reason == "inside" else [place, value]
    save("success", found)


def small():
    """Compare the small network with the planner in the same scenes."""
    rows = []
    for law in LAWS:
        for view in ((9, 9), (5, 5)):
            model = scenes_of(law, (17, 17), view, SCENES, SEEDS["small"])
            ours, planner = (solve(name, model)[0] for name in ("small-vin", "d-star-lite"))
            away = ours - planner
            half = 1.96 * away.std() / np.sqrt(len(away))
            size = f"{view[0]} × {view[1]}"
            rows.append([law, size, *map(float, (ours.mean(), planner.mean(), away.mean(), half))])
            print(rows[-1], flush=True)
    heads = {"law": "", "view": "", "small-vin %": ".1f", "d-star-lite %": ".1f"}
    heads |= {"difference": ".1f", "± 95 %": ".1f"}
    said = (
        f"{SCENES} scenes per row on 17 × 17 cells with 2 to 5 obstacles, 40 steps, not used in training. The interval is "
        "that of the mean difference per scene."
    )
    write("unknown-grid", "small-network", __file__, heads, rows, ("torch",), said)


if __name__ == "__main__":
    for part in sys.argv[1:]:
        if part in POLICIES:
            success([part])
        else:
            {
                "limits": limits,
                "success": success,
                "rates": rates,
                "small": small,
                "detection": detection,
                "walks": walks,
            }[part]()
