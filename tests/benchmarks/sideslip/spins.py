"""``unscented-filter`` in spins, its event "grip lost" and the rule that recommends it, for the problem's page.

``python tests/benchmarks/sideslip/spins.py`` writes the tables ``unscented``, ``grip`` and ``rule`` of
``docs/measured/sideslip.json``. Constants were chosen on the drives of `DEVELOPMENT`. The drives of `HELD_OUT` were generated twice:
one constant was changed after the first run, with nearly equal results, so they are not strictly held out.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from benchmarks.sideslip.errors import FEW, SPIN, SPUN, figures, seeded, store  # noqa: E402
from sideslip.spins import Spin, driven, marked, steered  # noqa: E402

from crosstrack.instances.sideslip.listing import _WILD as WILD, MISMATCH  # noqa: E402
from crosstrack.models import SideslipEstimation  # noqa: E402
from crosstrack.models.sideslip import Recording, Vehicle  # noqa: E402
from crosstrack.models.sideslip.checks import linear_contradiction  # noqa: E402
from crosstrack.solvers import Request, find_backend  # noqa: E402
from crosstrack.solvers.contract.selection import recommended  # noqa: E402

NAME = "unscented-filter"
#: Seeds of the groups of spins, and number of drives in each.
DEVELOPMENT, HELD_OUT, COUNT = 1, 1001, 60
GROUPS: dict[str, Any] = {
    "driver on a road": driven,
    "given steering": steered,
    "given steering, vehicle and sensors wrong": lambda first, count: steered(first, count, True),
}


def spun() -> None:
    """Write errors, claims and errors of the event in development and held-out spins."""
    rows, events = [], []
    for when, first in (("development", DEVELOPMENT), ("held out", HELD_OUT)):
        for group, generate in GROUPS.items():
            drives = list(generate(first, COUNT))
            found = figures((drive.model for drive in drives), ("kalman-filter", NAME))
            label = f"{group}, {when}"
            rows.append([label, len(drives), *_summary(found[:, 0]), *_summary(found[:, 1])])
            events.append([label, *_events(drives)])
            print(rows[-1], events[-1], flush=True)
    for label, model in {SPIN: next(seeded(1, **SPUN)), **_tracks("spin")}.items():
        found = figures([model], ("kalman-filter", NAME))
        rows.append([label, 1, *_summary(found[:, 0]), *_summary(found[:, 1])])
    cells = {"mean error": ".2f", "largest": ".2f", "within two": ".0%", "lowest": ".0%"}
    columns = {
        "drives": "d",
        **{f"kalman-filter: {name}": text for name, text in cells.items()},
        **{f"{NAME}: {name}": text for name, text in cells.items()},
    }
    said = (
        "Mean error of a drive in degrees, mean and largest value over the drives; share of samples within two claimed "
        "deviations, mean and lowest value. True friction 0.2 to 0.6, 10 to 30 m/s, 20 to 200 Hz, angles above 10°."
    )
    store("unscented", "spins", columns, rows, said, __file__)
    columns = {"sliding samples missed": ".2%", "samples marked far from the peak": ".2%"}
    columns |= {"slides": "d", "missed": "d", "events": "d", "false": "d", "median delay, s": ".3f"}
    said = (
        "A sample slides if the whole contact patch of an axle slides; it is far from the peak below 75 % of that slip. "
        "A slide is missed if no event overlaps it, an event is false if it is far from the peak throughout. The delay "
        "is that of the first event that ends after the tyre has reached 75 % of the slip."
    )
    store("grip", "spins", columns, events, said, __file__)


def _summary(found: Any) -> list[float]:
    """Return mean and largest error, and mean and lowest share within two deviations."""
    return [
        float(v)
        for v in (found[:, 0].mean(), found[:, 0].max(), found[:, 1].mean(), found[:, 1].min())
    ]


def _events(drives: list[Spin]) -> list[Any]:
    """Return error rates of the event."""
    samples, counts, delays = np.zeros(4), np.zeros(4, int), []
    for drive in drives:
        times = drive.model.recording.times
        plan = find_backend(NAME).run(drive.model.blinded(), Request()).point
        spans, sliding, near = plan.grip_lost, drive.sliding, drive.slides(0.75)
        shown = marked(times, spans)
        samples += [(sliding & ~shown).sum(), sliding.sum(), (shown & ~near).sum(), (~near).sum()]
        edges = np.flatnonzero(np.diff(sliding.astype(int), prepend=0, append=0))
        slides = list(zip(edges[::2], edges[1::2], strict=True))
        slides = [(a, b) for a, b in slides if times[b - 1] - times[a] >= 0.1]
        counts += [
            len(slides), sum(not shown[a:b].any() for a, b in slides),
            len(spans), sum(not near[marked(times, [span])].any() for span in spans),
        ]  # fmt: skip
        begin = times[near.argmax()]
        delays += [first - begin for first, last in spans if near.any() and last >= begin][:1]
    shares = [float(samples[0] / samples[1]), float(samples[2] / samples[3])]
    return [*shares, *counts.tolist(), float(np.median(delays))]


def _tracks(*names: str) -> dict[str, SideslipEstimation]:
    """Return scenarios of the two-track simulator, with linear tyres."""
    from sideslip import two_track

    car, result = two_track.CAR, {}
    stiffness = [2.0 * value for value in car.stiffness]
    vehicle = Vehicle(car.mass, car.inertia, car.front, car.rear, *stiffness)
    for name in names or tuple(two_track.SCENARIOS):
        drive = two_track.drive(name)
        recording = Recording(**drive.recording())
        result[f"two-track simulator, {name}"] = SideslipEstimation(
            vehicle, recording, truth=drive.truth
        )
    return result


def rule() -> None:
    """Write what the rule reads and chooses, and the errors of the choices."""
    slip = {"tyre": "saturating", "road": "serpentine"}
    half = {"road": "serpentine", "mismatch": {"mass": 1.1}}
    cases: dict[str, dict[str, Any]] = {
        **{road: {"road": road} for road in ("lane-change", "serpentine")},
        **{f"{road}, vehicle wrong by 30 %": {"road": road, "mismatch": MISMATCH} for road in ("lane-change", "serpentine")},
        "serpentine, mass believed 10 % too large": half,
        "serpentine, tyres that saturate, linear believed": {**slip, "friction": 0.9, "believed_tyre": "linear"},
        **{name: dict(fields) for name, _, fields in WILD if name not in ("long", "unknown", "untrained")},
        SPIN: SPUN,
    }  # fmt: skip
    rows: list[list[Any]] = []
    names = ("rts-smoother", NAME, "smoother-grnn")
    for label, fields in cases.items():
        models = list(
            seeded(2 if label == SPIN else FEW, **fields)
        )  # other seeds of it turn beyond 90°
        bare = [_untrained(model) for model in models]
        errors = np.median(figures(models, names)[..., 0], axis=0)
        here = [linear_contradiction(model.vehicle, model.recording)[0] for model in models]
        known = [
            max(linear_contradiction(model.vehicle, d)[0] for d in model.training)
            for model in models
        ]
        rows.append(
            [
                label,
                float(np.median(here)),
                float(np.median(known)),
                _chosen(models),
                _chosen(bare),
                *errors,
            ]
        )
    for label, model in _tracks().items():
        errors = figures([model], names[:2])[0, :, 0]
        here = linear_contradiction(model.vehicle, model.recording)[0]
        rows.append([label, here, None, None, _chosen([model]), *errors, None])
    columns = {
        "contradiction, °": ".2f",
        "training drives, °": ".2f",
        "auto": "",
        "auto without training": "",
    }
    said = f"Medians of {FEW} seeds, 2 for the spin; errors are mean errors in degrees. A slash separates choices that differ between seeds."
    store("rule", "drive", {**columns, **dict.fromkeys(names, ".3f")}, rows, said, __file__)


def _untrained(model: SideslipEstimation) -> SideslipEstimation:
    names = ("vehicle", "recording", "disturbance", "yaw_rate_noise", "acceleration_noise", "truth")
    return SideslipEstimation(**{name: getattr(model, name) for name in names})


def _chosen(models: list[SideslipEstimation]) -> str:
    """Return the recommended backends."""
    return " / ".join(sorted({recommended(model).name for model in models}))


if __name__ == "__main__":
    spun()
    rule()
