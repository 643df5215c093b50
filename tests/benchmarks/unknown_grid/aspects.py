"""Measure the planners under every aspect of scenes for ``docs/measured/unknown-grid.json``.

``python tests/benchmarks/unknown_grid/aspects.py [SCENES]`` takes about five minutes of CPU with 400 scenes.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.measured import write  # noqa: E402

import crosstrack as ct  # noqa: E402
from crosstrack.instances.unknown_grid import draw_scenes  # noqa: E402
from crosstrack.solvers import find_backend  # noqa: E402
from crosstrack.solvers.bench.statistics import success_interval  # noqa: E402

ASPECTS = (
    "eight-neighbours", "corners", "occlusion", "noise", "moving", "search", "all-aspects",
)  # fmt: skip
#: ``a-star-replanning`` takes the same steps as ``d-star-lite``.
BACKENDS = ("d-star-lite", "current-view", "oracle")
HEADS = {
    "scenes": "", "policy": "", "reached %": ".1f", "from %": ".1f", "to %": ".1f", "SPL": ".3f",
    "steps to fewest": ".3f", "collisions a scene": ".2f",
}  # fmt: skip
SAID = (
    "Scenes are those of the catalogue's entry of the same name, continued; none is the mixed law without aspects. The range "
    "is Wilson's 95 % interval of the share of targets reached. SPL is the success weighted by path length. The oracle knows "
    "all maps, targets and tracks."
)


def rows(scenes: int) -> Iterator[list[Any]]:
    """Yield one row per aspect and policy that supports it."""
    for aspect in ("none", *ASPECTS):
        entry = ct.load(f"unknown-grid/{ASPECTS[0] if aspect == 'none' else aspect}")
        names = [field.name for field in dataclasses.fields(entry) if field.name != "name"]
        fixed = ("blocked", "starts", "targets", "shape", "camera", "world_seed", "tracks")
        fields = {name: getattr(entry, name) for name in names if name not in fixed}
        if aspect == "none":
            fields["connectivity"] = "4"
        model = draw_scenes("mixed", obstacles=4, scenes=scenes, **fields)
        assert (model.blocked[: entry.scenes] == entry.blocked).all()
        for backend in BACKENDS:
            if find_backend(backend).refuses(model):
                continue
            solution = ct.solve(model, backend)
            assert solution.verification.ok
            score = model.score(solution)
            low, high = success_interval(score.reached, score.scenes)
            share = 100.0 * score.reached / score.scenes
            yield [
                aspect, backend, share, 100.0 * low, 100.0 * high, score.spl, score.ratio,
                score.collisions / score.scenes,
            ]  # fmt: skip
            print(aspect, backend, score, flush=True)


def main() -> None:
    """Write the table, with as many scenes per aspect as the command line gives."""
    scenes = int(sys.argv[1]) if len(sys.argv) > 1 else 400
    write("unknown-grid", "aspects", __file__, HEADS, rows(scenes), ("numpy",), SAID, keys=2)


if __name__ == "__main__":
    main()
