"""Measure the networks inside and outside the laws of their training scenes.

``python tests/benchmarks/unknown_grid/laws.py limits`` calibrates the limits of openness per law on scenes of its own
seed. ``… laws.py success`` then measures each network with the shipped weights on other seeds, or one network named
instead of ``success``. ``… laws.py rates`` copies the rates that messages give, and ``… laws.py small`` compares the
small network with the planner on all laws. ``limits`` and ``rates`` write ``solvers/unknown_grid/laws.json``, ``success``
and ``small`` the tables ``laws`` and ``small-network`` of ``docs/measured/unknown-grid.json``.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.measured import ROOT, write  # noqa: E402

from crosstrack.instances.unknown_grid import draw_scenes, maze  # noqa: E402
from crosstrack.instances.unknown_grid.laws import SceneArrays, SceneLaw  # noqa: E402
from crosstrack.models.unknown_grid import World  # noqa: E402
from crosstrack.solvers import Control, Request  # noqa: E402
from crosstrack.solvers.contract.registry import find_backend  # noqa: E402
from crosstrack.solvers.unknown_grid.imitation import (  # noqa: E402
    TASKS,
    Scenes,
    best_actions,
    first_of,
    shortest_ways,
    walk_through,
)
from crosstrack.solvers.unknown_grid.networks import load_network  # noqa: E402
from crosstrack.solvers.unknown_grid.training_laws import MEASURED, openness  # noqa: E402

#: Share of the training scenes below the limit of openness, and scenes per task of the calibration.
SHARE, CALIBRATED = 0.02, 600
#: Scenes per row of a table, and the seeds of calibration and measurement.
SCENES, SEEDS = 600, {"limits": 90, "success": 91, "small": 92}
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
    """Return success per scene, percent, and the answer of a policy in this process."""
    backend = find_backend(name)
    options = backend.checked_options({})
    answer = backend.run(model, Request(options=options, control=Control(oracle=World(model))))
    reached = np.array([str(one) == "reached" for one in answer.point.outcomes])
    return 100.0 * reached, answer


def limits():
    """Calibrate the limits of openness with the optimistic planner."""
    found = {}
    for law in map(str, SceneLaw):
        shares = []
        for task in TASKS:
            model = scenes_of(law, task.shape, task.view, CALIBRATED, SEEDS["limits"])
            last = SimpleNamespace(known=np.zeros_like(model.blocked, np.int8))

            def choose(observed, rows, last=last):
                last.known[rows] = observed.known
                ways = shortest_ways(observed.known == 1, observed.targets)
                return first_of(best_actions(ways, observed.positions))

            walk_through(Scenes(model.blocked, model.starts, model.targets), task.view, choose)
            shares.append(openness(last.known))
        found[law] = round(float(np.quantile(np.concatenate(shares), SHARE)), 3)
    save("laws", found)


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
            reached, planner, detected = [], [], 0
            for model in models:
                share, answer = solve(name, model)
                reached.append(share)
                detected += answer.statistics["scenes outside the law"]
                planner.append(solve("d-star-lite", model)[0])
            count = sum(map(len, reached))
            rate, best = (float(np.concatenate(one).mean()) for one in (reached, planner))
            rows.append([name, law, place, 100.0 * detected / count, rate, best])
            print(rows[-1], flush=True)
    said = (
        f"{SCENES} scenes per row with 2 to 5 obstacles, tasks of the paper unless stated, 40 steps. Outside: share of "
        "the scenes that the result reports as outside the law of the training. The limits come from scenes of "
        "another seed."
    )
    heads = {"network": "", "trained on": "", "scenes": "", "outside %": ".1f", "reached %": ".1f"}
    heads["d-star-lite %"] = ".1f"
    write("unknown-grid", "laws", __file__, heads, rows, ("torch",), said, merge=True, keys=3)


def rates():
    """Copy the success rates that messages give from the table to the file of the package."""
    tables = json.loads((ROOT / "docs" / "measured" / "unknown-grid.json").read_text("utf-8"))
    found = {}
    for name, law, place, _, rate, _ in tables["laws"]["rows"]:
        reasons = {law: "inside", "mazes": "maps"}
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
            {"limits": limits, "success": success, "rates": rates, "small": small}[part]()
