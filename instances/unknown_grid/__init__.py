"""Instances of unknown grids: random scenes and the paper's tasks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .exports import write_runs_csv as write_runs_csv
    from .laws import (
        SceneArrays as SceneArrays,
        SceneLaw as SceneLaw,
        draw_scene_arrays as draw_scene_arrays,
        draw_scenes as draw_scenes,
        training_generator as training_generator,
    )
    from .readers import read_map_scenes as read_map_scenes, read_scenes as read_scenes
    from .wild import clutter as clutter, enclosed as enclosed, maze as maze, spiral as spiral

CATALOGUE = {"unknown-grid": ".listing:catalogue_entries"}
REFERENCES = {"unknown-grid": ".readers:resolve_references"}
TEMPLATES = {"unknown-grid": "unknown-grid/u-trap"}
DEMOS = {"unknown-grid": "unknown-grid/u-trap"}
EXAMPLES = {"unknown-grid": ".laws:draw_scene_arrays"}
EXPORTS = {"csv": ".exports:CSV"}
PAPERS = {"unknown-grid": ".paper:PAPER"}
PAPER_TABLES = {
    "unknown-grid/table-6": ".paper_tables:table_6",
    "unknown-grid/figure-8": ".paper_tables:figure_8",
    "unknown-grid/times": ".paper_tables:times",
    "unknown-grid/policies": ".paper_tables:policies",
}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
