"""Catalogue entries of black boxes: the paper's five functions, moved ones, special cases, and paths."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from ...models.black_box.model import BlackBoxMinimisation
from ..catalogue import CatalogueEntry, Provenance, Row, listed
from .generator import generate
from .paths import PATHS, path_instance

__all__ = ["FUNCTIONS", "LENGTHS", "PAPER", "catalogue_entries"]

PAPER = (
    "The Robot Path Planning Based on Improved Artificial Fish Swarm Algorithm, Mathematical Problems "
    "in Engineering, 2016"
)

#: Largest number of evaluations of a run: one per fish in 200 iterations of 100 fish.
_BUDGET = 20_000
#: Functions of Table 1: name in the catalogue, formula, number of variables, optimal value.
FUNCTIONS = (
    ("rastrigin-10", "rastrigin", 10, 0.0),
    ("easom", "easom", 2, -1.0),
    ("booth", "booth", 2, 0.0),
    ("bohachevsky", "bohachevsky", 2, 0.0),
    ("sum-squares-10", "sum-squares", 10, 0.0),
)
#: Lengths (m) of the shortest paths on the maps, in any direction and along eight neighbours, proven
#: by the exact searches. A map without a free path has no entry.
LENGTHS = {
    "open": (26.870057685, 26.870057685),
    "cells": (26.417921924, 28.213203436),
    "blocks": (28.605031887, 31.071067812),
    "polygons-30": (42.869391386, 47.798989873),
    "polygons-40": (54.516034089, 59.355339059),
    "gap": (70.784061132, 78.012193309),
    "pocket": (37.095516877, 41.142135624),
    "corners": (37.764045246, 45.899494937),
    "rooms": (49.389034750, 53.941125497),
}

_USUAL = "The paper does not print the bounds: these are the usual ones of this function."
_SPECIAL = "Ours: the paper has no such instance."


def catalogue_entries() -> tuple[CatalogueEntry, ...]:
    """Return the catalogue entries of black boxes."""
    rows = (*_paper(), *_wild(), *map(_path_row, PATHS))
    return listed("black-box", "black-box", PAPER, rows, note=_SPECIAL)


def _paper() -> list[Row]:
    rows = []
    for number, (name, formula, dimension, optimum) in enumerate(FUNCTIONS, 1):
        title = f"{formula.replace('-', ' ')} of {dimension} variables"
        figures = {"optimum": optimum, "source": "the formula"}
        build = partial(generate, formula, dimension, budget=_BUDGET)
        rows += [
            Row(name, f"{title}, as printed", build, _USUAL, Provenance.COMPLETED, figures),
            Row(
                f"{name}-shifted", f"{title}, the optimum moved", partial(build, seed=number),
                f"{_USUAL} Each variable's optimum is moved by 0.1 to 0.3 of its range.",
                published=figures,
            ),
        ]  # fmt: skip
    return rows


def _wild() -> list[Row]:
    narrow = {"name": "rastrigin", "shift": [3.0, 3.0], "stretch": 1e-10}
    wide = {"name": "rastrigin", "shift": [1e8, 3e8], "stretch": 1e8}
    small, everywhere = [[3 - 3e-10, 3 + 7e-10]] * 2, [[-5e8, 5e8]] * 2
    cases: tuple[tuple[str, str, Callable[[], BlackBoxMinimisation], float], ...] = (
        (
            "example", "rastrigin of 2 variables, moved, in 2,000 evaluations",
            partial(generate, "rastrigin", 2, 6, budget=2000), 0.0,
        ),
        ("one-variable", "rastrigin of 1 variable", partial(generate, "rastrigin", 1, 1), 0.0),
        (
            "sphere-100", "a bowl of 100 variables, its middle moved",
            partial(generate, "sphere", 100, 2), 0.0,
        ),
        ("valley-5", "rosenbrock of 5 variables", partial(generate, "rosenbrock", 5), 0.0),
        ("ackley-5", "nearly flat with ripples, moved", partial(generate, "ackley", 5, 3), 0.0),
        (
            "noisy", "a bowl of 4 variables with noise of deviation 0.1 on every value",
            partial(generate, "sphere", 4, 4, deviation=0.1), 0.0,
        ),
        ("constant", "the same everywhere", partial(generate, "constant", 3), 0.0),
        ("step", "terraces: jumps, and no slope between them", partial(generate, "step", 5, 5), 0.0),
        ("corner", "the optimum in a corner of the bounds", partial(_corner, "sphere"), 6.0),
        (
            "bounds-1e-9", "rastrigin between bounds that are 1e-9 apart",
            partial(_within, narrow, small), 0.0,
        ),
        (
            "bounds-1e9", "rastrigin between bounds that are 1e9 apart",
            partial(_within, wide, everywhere), 0.0,
        ),
        (
            "one-fixed", "a bowl of 3 variables, one between equal bounds",
            partial(_within, "sphere", [[-1, 2], [0.5, 0.5], [-2, 1]]), 0.25,
        ),
        (
            "all-fixed", "every variable between equal bounds: a single point",
            partial(_within, "booth", [[2, 2], [2, 2]]), 2.0,
        ),
        (
            "one-evaluation", "booth with a single evaluation",
            partial(_within, "booth", [[-10, 10], [-10, 10]], 1), 0.0,
        ),
    )  # fmt: skip
    return [
        Row(
            name, title, build,
            provenance=Provenance.OURS, published={"optimum": optimum, "source": "the formula"},
        )
        for name, title, build, optimum in cases
    ]  # fmt: skip


def _path_row(name: str) -> Row:
    path_map = PATHS[name]
    published: dict[str, Any] = {}
    if name in LENGTHS:
        anywhere, neighbours = LENGTHS[name]
        published = {"optimum": anywhere, "eight neighbours": neighbours, "source": "any-angle"}
    note = f"The map is ours: the paper shows its maps as pictures only. {path_map.note}".rstrip()
    title = f"{path_map.title}, {path_map.waypoints} waypoints"
    return Row(f"path-{name}", title, partial(path_instance, name), note, published=published)


def _within(function: Any, bounds: Any, budget: int = 10_000) -> BlackBoxMinimisation:
    return BlackBoxMinimisation(function, bounds, budget)


def _corner(function: str) -> BlackBoxMinimisation:
    """Return a bowl whose centre is outside of the bounds: the optimum is 6 at (1, 2, -1)."""
    return _within(function, [[1, 5], [2, 6], [-3, -1]])
