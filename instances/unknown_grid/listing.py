"""Catalogue of unknown grids: the paper's tasks, other laws of scenes, and extreme cases."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from ...models.unknown_grid.model import UnknownGridNavigation
from ...models.unknown_grid.scenes import TASKS
from ..catalogue import CatalogueEntry, Provenance, Row, listed
from .laws import SceneLaw, draw_scenes
from .wild import clutter, enclosed, maze, spiral

__all__ = ["OBSTACLES", "PAPER", "SCENES", "STEPS", "catalogue_entries"]

PAPER = (
    "Motion Planning for Heterogeneous Unmanned Systems under Partial Observation from UAV, IROS 2020, "
    "doi 10.1109/IROS45743.2020.9341326"
)
#: Numbers of obstacles per scene, one per column of Table VI, and maximum number of actions per run.
OBSTACLES, STEPS = (2, 3, 4, 5), 40
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
#: Corridor of one cell, and the tracks of two obstacles that cross it.
_CORRIDOR = (".........", "@@@...@@@", "S........", "@@@...@@@", "........T")
_TRACKS = [[[[row, 3] for row in range(5)], [[row, 5] for row in range(4, -1, -1)]]]


def catalogue_entries() -> tuple[CatalogueEntry, ...]:
    """Return the catalogue entries of unknown grids."""
    rows = (*_tasks(), *_laws(), *_aspects(), *_wild())
    return listed("unknown-grid", "unknown-grid", PAPER, rows, note=_OURS)


def _tasks() -> list[Row]:
    return [
        Row(
            f"task-{number}-{obstacles}",
            "task {}: {} × {} cells, view {} × {}, {} walls".format(number, *shape, *view, obstacles),
            partial(
                draw_scenes, shape=shape, obstacles=obstacles, scenes=SCENES, view=view, steps=STEPS
            ),
            _LAW,
        )
        for number, (shape, view) in enumerate(TASKS, 1)
        for obstacles in OBSTACLES
    ]  # fmt: skip


def _laws() -> list[Row]:
    """Return the rows of the other laws, with the sizes of task 2."""
    drawn = partial(draw_scenes, obstacles=4, scenes=FEW, view=(9, 9), steps=STEPS)
    others: dict[str, tuple[str, Mapping[str, Any]]] = {
        "l-shapes": ("4 L-shaped walls", {"law": SceneLaw.L_SHAPES}),
        "u-traps": ("4 U-shaped traps", {"law": SceneLaw.U_TRAPS}),
        "rectangles": ("4 rectangles", {"law": SceneLaw.RECTANGLES}),
        "mixed": ("4 obstacles of all forms", {"law": SceneLaw.MIXED}),
        "close-walls": ("4 walls, no open ground around the target", {"clear": 0}),
        "follow": ("the scenes of close-walls, above which the UAV goes on", {"clear": 0, "uav": "follow"}),
    }  # fmt: skip
    return [
        Row(name, f"{title}, 17 × 17 cells, view 9 × 9", partial(drawn, **options), _DRAWN)
        for name, (title, options) in others.items()
    ]


def _aspects() -> list[Row]:
    """Return one row per aspect of a model, and one with all of them."""
    drawn = partial(
        draw_scenes, SceneLaw.MIXED, obstacles=4, scenes=FEW, view=(9, 9), steps=80, uav="follow"
    )
    noise = {"false_obstacles": 0.05, "missed_obstacles": 0.1}
    aspects: dict[str, tuple[str, dict[str, Any]]] = {
        "eight-neighbours": ("diagonal steps past free corners", {"connectivity": "8"}),
        "corners": ("diagonal steps past any corner", {"connectivity": "8", "corners": "any"}),
        "occlusion": ("only cells in line of sight in view", {"occlusion": True}),
        "noise": ("wrong readings of 5 % of free and 10 % of blocked cells", noise),
        "moving": ("6 obstacles that walk at random", {"moving": 6}),
        "search": ("an unknown target", {"target_known": False, "view": (5, 5), "steps": 200}),
    }
    everything = {key: value for _, fields in aspects.values() for key, value in fields.items()}
    aspects["all-aspects"] = ("all aspects at once", {**everything, "corners": "free"})
    return [
        Row(name, f"{title}, 17 × 17 cells", partial(drawn, **fields), _DRAWN)
        for name, (title, fields) in aspects.items()
    ]


def _wild() -> list[Row]:
    images = partial(draw_scenes, SceneLaw.MIXED, obstacles=4, scenes=FEW, seed=1)
    return [
        Row(
            "u-trap", "a pocket deeper than the view between start and target",
            partial(UnknownGridNavigation.drawn, _POCKET, view=(5, 5), steps=100), provenance=Provenance.OURS,
        ),
        Row(
            "crossing", "two obstacles that move to and fro across a corridor",
            partial(
                UnknownGridNavigation.drawn, _CORRIDOR, view=(5, 5), uav="follow", moving=2, tracks=_TRACKS
            ),
            provenance=Provenance.OURS,
        ),
        Row("maze", "a maze of 33 × 33 cells", partial(maze, 33, 33, 1, uav="follow")),
        Row(
            "spiral", "a corridor that winds inward", partial(spiral, 21, view=(5, 5), uav="follow"),
            provenance=Provenance.OURS,
        ),
        Row(
            "no-way", "a target within a closed ring", partial(enclosed, (17, 17), 2, view=(5, 5)),
            provenance=Provenance.OURS,
        ),
        Row(
            "clutter", "three cells of five blocked, no way",
            partial(clutter, (33, 33), 0.6, 2, way=False, uav="follow"),
        ),
        Row(
            "whole-view", "the whole map in view from everywhere",
            partial(draw_scenes, SceneLaw.U_TRAPS, obstacles=4, scenes=1, view=(35, 35)),
        ),
        Row(
            "tiny-view", "only the neighbours in view",
            partial(draw_scenes, SceneLaw.MIXED, obstacles=4, scenes=FEW, view=(3, 3), uav="follow"),
        ),
        Row(
            "camera-plain", "images in which obstacles have a colour of their own",
            partial(images, camera={"rendering": "plain", "seed": 0}),
        ),
        Row(
            "camera-hard", "images in which colour alone does not tell obstacles",
            partial(images, camera={"rendering": "hard", "seed": 0}),
        ),
        Row(
            "large", "1000 × 1000 cells, three of ten blocked",
            partial(clutter, (1000, 1000), 0.3, 3, uav="follow"),
        ),
    ]  # fmt: skip
