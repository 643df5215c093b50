"""Instances of the catalogue for attractors: hunts, known systems, noise, and corrupted series."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from ...models.attractor.model import AttractorAnalysis
from ..catalogue import CatalogueEntry, Provenance
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
HUNT_EXPONENTS = {
    "hunt": 0.08155,
    "hunt-long": 0.08155,
    "hunt-pair": 0.05335,
    "hunt-calm": 0.0,
}

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
    return (*_hunts(), *_known(), *_spoilt())


def _hunt(name: str, count: int) -> AttractorAnalysis:
    hunt = Hunt.from_data(HUNTS[name])
    return simulate_hunt(hunt, count, exponent=HUNT_EXPONENTS[name])


def _hunts() -> tuple[CatalogueEntry, ...]:
    cases: tuple[tuple[str, str, int, dict[str, Any]], ...] = (
        (
            "hunt", "a predator's way, three of which hunt among three obstacles", 1000,
            _FOUND,
        ),
        ("hunt-long", "the same hunt, 10 times as long", 10_000, {}),
        ("hunt-pair", "one predator behind an evader among three obstacles", 2000, {}),
        ("hunt-calm", "three predators behind a quick evader, no obstacles: it repeats itself", 2000, {}),
    )  # fmt: skip
    return tuple(
        _entry(
            name,
            title,
            partial(_hunt, name, count),
            f"{_LOST}{HUNT_EXPONENTS[name]:g} nats/s, {HUNT_EXPONENTS[name] / math.log(2):.3g} bits/s.",
            Provenance.SEEDED,
            published,
        )
        for name, title, count, published in cases
    )


def _known() -> tuple[CatalogueEntry, ...]:
    cases = (
        (System.LOGISTIC, 2000),
        (System.HENON, 2000),
        (System.LORENZ, 5000),
        (System.ROSSLER, 5000),
        (System.MACKEY_GLASS, 5000),
        (System.SINE, 1000),
        (System.TWO_SINES, 2000),
        (System.SAWTOOTH, 1000),
        (System.WHITE_NOISE, 1000),
        (System.AR1, 1000),
        (System.AR2, 1000),
        (System.RANDOM_WALK, 1000),
    )
    found = []
    for system, count in cases:
        known = SYSTEMS[system]
        published: dict[str, Any] = {"source": known.source}
        if known.exponent is not None:
            published["exponent"] = known.exponent
        if known.dimension is not None:
            published["correlation"] = known.dimension
        build = partial(generate, system, count)
        note = f"{_SPECIAL} What is known of it: {known.source}."
        found.append(
            _entry(
                system,
                f"{known.title}, {count} samples",
                build,
                note,
                Provenance.SEEDED,
                published,
            )
        )
    return tuple(found)


def _spoilt() -> tuple[CatalogueEntry, ...]:
    loud = math.sqrt(10.0)
    cases: tuple[tuple[str, str, Callable[[], AttractorAnalysis]], ...] = (
        ("samples-50", "the Hénon map, 50 samples", partial(generate, "henon", 50)),
        ("samples-100000", "Lorenz' equations, 100,000 samples", partial(generate, "lorenz", 100_000)),
        ("quantised", "Lorenz' equations, rounded to 32 values", partial(generate, "lorenz", levels=32)),
        ("tied", "the Hénon map, rounded to 3 values", partial(generate, "henon", levels=3)),
        ("two-values", "white noise, rounded to 2 values", partial(generate, "white-noise", levels=2)),
        ("trend", "Rössler's equations along a slope", partial(generate, "rossler", trend=10.0)),
        ("noise-10db", "Lorenz' equations under noise of ten times their power", partial(generate, "lorenz", noise=loud)),
        ("spikes", "Rössler's equations, one sample in a hundred far off", partial(generate, "rossler", spikes=0.01)),
        ("scale-1e-6", "the Hénon map in millionths", partial(generate, "henon", scale=1e-6)),
        ("scale-1e6", "the Hénon map in millions", partial(generate, "henon", scale=1e6)),
        ("oversampled", "Lorenz' equations, 1000 samples a second", partial(generate, "lorenz", period=0.001)),
        ("undersampled", "Lorenz' equations, a sample in 10 s", partial(generate, "lorenz", 500, period=10.0)),
    )  # fmt: skip
    return tuple(
        _entry(name, title, build, _SPECIAL, Provenance.SEEDED, {}) for name, title, build in cases
    )


def _entry(
    name: str, title: str, builder: Callable[[], AttractorAnalysis], note: str,
    provenance: Provenance, published: Mapping[str, Any],
) -> CatalogueEntry:  # fmt: skip
    return CatalogueEntry(
        name=f"attractor/{name}",
        model="attractor",
        title=title[0].upper() + title[1:],
        paper=PAPER,
        provenance=provenance,
        builder=builder,
        published=published,
        note=note,
    )
