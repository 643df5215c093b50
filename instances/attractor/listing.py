"""Instances of the catalogue for attractors: hunts, known systems, noise, and corrupted series."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

from ...models.attractor.model import AttractorAnalysis
from ..catalogue import CatalogueEntry, Row, listed
from .hunting import Hunt, simulate_hunt
from .systems import SYSTEMS, System, generate

__all__ = ["HUNTS", "HUNT_EXPONENTS", "PAPER", "catalogue_entries"]

PAPER = (
    "Method of Quantitative Analysis for Multirobot Cooperative Hunting Behaviors, Mathematical Problems "
    "in Engineering, 2016"
)

#: Hunts by name, as fields of :class:`~crosstrack.instances.attractor.Hunt`.
HUNTS: Mapping[str, Mapping[str, Any]] = {
    "hunt": {},
    "hunt-long": {},
    "hunt-pair": {"gains": (0.04,)},
    "hunt-calm": {
        "obstacles": (), "gains": (0.06, 0.08, 0.1), "flight": 0.12, "speeds": (0.22, 0.32),
    },
}  # fmt: skip
#: Largest exponents of hunts in nats per second, from ``hunt_exponent`` over 100,000 s, with standard errors
#: 0.0009 and 0.0008. The last motion is periodic, so its exponent is 0 (computed: 5e-6 ± 6e-6).
HUNT_EXPONENTS = {"hunt": 0.08155, "hunt-long": 0.08155, "hunt-pair": 0.05335, "hunt-calm": 0.0}

#: Figures of the hunt in the paper; ``exponent_bits`` in bits per second, ``horizon`` in seconds.
_FOUND = {
    "delay": 8, "dimension": 10, "exponent_bits": 0.12, "correlation": 5.5, "horizon": 8.3,
}  # fmt: skip
_LOST = (
    "The paper does not print its record. This hunt is ours, and its strengths were chosen for an exponent like the paper's; "
    "the true one is computed from the equations (Benettin), "
)
_SPECIAL = "Ours: the paper has no such instance."


def catalogue_entries() -> tuple[CatalogueEntry, ...]:
    """Return the instances."""
    rows = (*map(_hunt_row, _HUNT_TITLES), *map(_known_row, _COUNTS), *_DISTORTED)
    return listed("attractor", "attractor", PAPER, rows, note=_SPECIAL)


#: Titles, numbers of samples and published figures of the hunts.
_HUNT_TITLES: dict[str, tuple[str, int, Mapping[str, Any]]] = {
    "hunt": ("A predator's way, three of which hunt among three obstacles", 1000, _FOUND),
    "hunt-long": ("The same hunt, 10 times as long", 10_000, {}),
    "hunt-pair": ("One predator behind an evader among three obstacles", 2000, {}),
    "hunt-calm": ("Three predators behind a quick evader, no obstacles: it repeats itself", 2000, {}),
}  # fmt: skip


def _hunt_row(name: str) -> Row:
    title, count, published = _HUNT_TITLES[name]
    nats = HUNT_EXPONENTS[name]
    note = f"{_LOST}{nats:g} nats/s, {nats / math.log(2):.3g} bits/s."
    return Row(name, title, partial(_hunt, name, count), note, published=published)


def _hunt(name: str, count: int) -> AttractorAnalysis:
    hunt = Hunt.from_data(HUNTS[name])
    return simulate_hunt(hunt, count, exponent=HUNT_EXPONENTS[name])


#: Numbers of samples of the known systems.
_COUNTS = {
    **dict.fromkeys((System.LOGISTIC, System.HENON, System.TWO_SINES), 2000),
    **dict.fromkeys((System.LORENZ, System.ROSSLER, System.MACKEY_GLASS), 5000),
    **dict.fromkeys((System.SINE, System.SAWTOOTH, System.WHITE_NOISE), 1000),
    **dict.fromkeys((System.AR1, System.AR2, System.RANDOM_WALK), 1000),
}


def _known_row(system: System) -> Row:
    known, count = SYSTEMS[system], _COUNTS[system]
    figures = {"exponent": known.exponent, "correlation": known.dimension}
    return Row(
        system,
        f"{known.title}, {count} samples",
        partial(generate, system, count),
        f"{_SPECIAL} What is known of it: {known.source}.",
        published={
            "source": known.source,
            **{name: value for name, value in figures.items() if value is not None},
        },
    )


#: Distorted and extreme series of known systems.
_DISTORTED = (
    Row("samples-50", "The Hénon map, 50 samples", partial(generate, "henon", 50)),
    Row("samples-100000", "Lorenz' equations, 100,000 samples", partial(generate, "lorenz", 100_000)),
    Row("quantised", "Lorenz' equations, rounded to 32 values", partial(generate, "lorenz", levels=32)),
    Row("tied", "The Hénon map, rounded to 3 values", partial(generate, "henon", levels=3)),
    Row("two-values", "White noise, rounded to 2 values", partial(generate, "white-noise", levels=2)),
    Row("trend", "Rössler's equations along a slope", partial(generate, "rossler", trend=10.0)),
    Row("noise-10db", "Lorenz' equations under noise of ten times their power", partial(generate, "lorenz", noise=math.sqrt(10.0))),
    Row("spikes", "Rössler's equations, one sample in a hundred far off", partial(generate, "rossler", spikes=0.01)),
    Row("scale-1e-6", "The Hénon map in millionths", partial(generate, "henon", scale=1e-6)),
    Row("scale-1e6", "The Hénon map in millions", partial(generate, "henon", scale=1e6)),
    Row("oversampled", "Lorenz' equations, 1000 samples a second", partial(generate, "lorenz", period=0.001)),
    Row("undersampled", "Lorenz' equations, a sample in 10 s", partial(generate, "lorenz", 500, period=10.0)),
)  # fmt: skip
