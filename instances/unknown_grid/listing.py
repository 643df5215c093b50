"""Catalogue of unknown grids: the paper's tasks, other laws of scenes, and extreme cases."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from ...models.unknown_grid.model import UnknownGridNavigation
from ..catalogue import CatalogueEntry, Provenance
from .laws import SceneLaw, draw_scenes
from .settings import OBSTACLES, STEPS, TASKS
from .wild import clutter, enclosed, maze, spiral

__all__ = ["PAPER", "SCENES", "catalogue_entries"]

PAPER = (
    "Motion Planning for Heterogeneous Unmanned Systems under Partial Observation from UAV, IROS 2020, "
    "doi 10.1109/IROS45743.2020.9341326"
)
#: Scenes per task, for intervals of about 2 points (the paper has 100), and per other random entry.
SCENES, FEW = 400, 20

_LAW = (
    "Sizes, view and steps are the paper's. The scenes are harder than the paper's: they follow the walls law of "
    f"crosstrack.instances.unknown_grid.draw_scenes, seed 0, {SCENES} scenes."
)
_OURS = "Ours: the paper has no such instance."
_DRAWN = (
    f"{_OURS} {FEW} scenes that crosstrack.instances.unknown_grid.draw_scenes draws with seed 0; it draws as many "
    "as are asked for, these first."
)
#: Instances without random numbers.
_BY_FORMULA = ("u-trap", "spiral", "no-way")

#: Pocket that is open towards the start, with the target behind it.
_POCKET = (
    "...............",
    "....@@@@@@@@...",
    "...........@...",
    "...........@...",
    "S..........@..T",
    "...........@...",
    "...........@...",
    "....@@@@@@@@...",
    "...............",
)

Builder = Callable[[], UnknownGridNavigation]


def catalogue_entries() -> tuple[CatalogueEntry, ...]:
    """Return the catalogue entries of unknown grids."""
    return (*_tasks(), *_laws(), *_wild())


def _tasks() -> list[CatalogueEntry]:
    return [
        _entry(
            f"task-{number}-{obstacles}",
            f"task {number}: {task.side} × {task.side} cells, view {task.view} × {task.view}, {obstacles} walls",
            partial(
                draw_scenes, shape=(task.side,) * 2, obstacles=obstacles, scenes=SCENES,
                view=(task.view,) * 2, steps=STEPS,
            ),
            _LAW,
        )
        for number, task in TASKS.items()
        for obstacles in OBSTACLES
    ]  # fmt: skip


def _laws() -> list[CatalogueEntry]:
    """Return the entries of the other laws, with the sizes of task 2."""
    drawn = partial(draw_scenes, obstacles=4, scenes=FEW, view=(9, 9), steps=STEPS)
    others: tuple[tuple[str, str, Mapping[str, Any]], ...] = (
        ("l-shapes", "4 L-shaped walls", {"law": SceneLaw.L_SHAPES}),
        ("u-traps", "4 U-shaped traps", {"law": SceneLaw.U_TRAPS}),
        ("rectangles", "4 rectangles", {"law": SceneLaw.RECTANGLES}),
        ("mixed", "4 obstacles of all forms", {"law": SceneLaw.MIXED}),
        ("close-walls", "4 walls, no open ground around the target", {"clear": 0}),
        (
            "follow", "the scenes of close-walls, above which the UAV goes on",
            {"clear": 0, "uav": "follow"},
        ),
    )  # fmt: skip
    return [
        _entry(name, f"{title}, 17 × 17 cells, view 9 × 9", partial(drawn, **options), _DRAWN)
        for name, title, options in others
    ]


def _wild() -> list[CatalogueEntry]:
    images = partial(draw_scenes, SceneLaw.MIXED, obstacles=4, scenes=FEW, seed=1)
    cases: tuple[tuple[str, str, Builder], ...] = (
        (
            "u-trap", "a pocket deeper than the view between start and target",
            partial(UnknownGridNavigation.drawn, _POCKET, view=(5, 5), steps=100),
        ),
        ("maze", "a maze of 33 × 33 cells", partial(maze, 33, 33, 1, uav="follow")),
        ("spiral", "a corridor that winds inward", partial(spiral, 21, view=(5, 5), uav="follow")),
        ("no-way", "a target within a closed ring", partial(enclosed, (17, 17), 2, view=(5, 5))),
        (
            "clutter", "three cells of five blocked, no way",
            partial(clutter, (33, 33), 0.6, 2, way=False, uav="follow"),
        ),
        (
            "whole-view", "the whole map in view from everywhere",
            partial(draw_scenes, SceneLaw.U_TRAPS, obstacles=4, scenes=1, view=(35, 35)),
        ),
        (
            "tiny-view", "only the neighbours in view",
            partial(draw_scenes, SceneLaw.MIXED, obstacles=4, scenes=FEW, view=(3, 3), uav="follow"),
        ),
        (
            "camera-plain", "images in which obstacles have a colour of their own",
            partial(images, camera={"rendering": "plain", "seed": 0}),
        ),
        (
            "camera-hard", "images in which colour alone does not tell obstacles",
            partial(images, camera={"rendering": "hard", "seed": 0}),
        ),
        (
            "large", "1000 × 1000 cells, three of ten blocked",
            partial(clutter, (1000, 1000), 0.3, 3, uav="follow"),
        ),
    )  # fmt: skip
    return [_entry(name, title, build, _OURS) for name, title, build in cases]


def _entry(name: str, title: str, build: Builder, note: str) -> CatalogueEntry:
    return CatalogueEntry(
        name=f"unknown-grid/{name}",
        model="unknown-grid",
        title=title,
        paper=PAPER,
        provenance=Provenance.OURS if name in _BY_FORMULA else Provenance.SEEDED,
        builder=build,
        note=note,
    )
