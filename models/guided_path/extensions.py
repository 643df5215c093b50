"""Optional fields of a guided tour: their names, their consistency, and the refusal of those not carried."""

from __future__ import annotations

from collections.abc import Set as AbstractSet
from typing import Any

import numpy as np

from ...errors import InvalidData
from .track import Track

__all__ = ["check_extensions", "extensions_of", "name_unsupported"]

#: Fields that may change the plans of a model; speed and service matter only with windows.
EXTENSIONS = ("end", "track", "vehicles", "loads", "capacity", "windows")


def extensions_of(model: Any) -> tuple[str, ...]:
    """Return the names of the optional fields that change the feasible plans or their length."""
    values = ((name, getattr(model, name, None)) for name in EXTENSIONS)
    return tuple(
        name
        for name, value in values
        if value is not None and not (isinstance(value, str) and value == "line")
    )


def name_unsupported(model: Any, supported: AbstractSet[str] = frozenset()) -> str:
    """Return why an algorithm that supports only these optional fields cannot solve `model`; empty if it can."""
    missing = [name for name in extensions_of(model) if name not in supported]
    return f"the fields {', '.join(missing)}: 'track-search' does" if missing else ""


def check_extensions(model: Any) -> None:
    """Raise :class:`InvalidData` if optional fields contradict one another or the coordinates."""
    track = model.track
    if isinstance(track, Track):
        _check_track(model, track)
    if model.loads is None and model.capacity is not None:
        raise InvalidData("capacity needs loads, the load of each customer", field="capacity")
    if model.loads is not None:
        most = np.inf if model.capacity is None else model.capacity
        if not 0 <= model.loads[0] <= most:
            raise InvalidData(
                f"loads[0], the load at the start, must be in 0 … {most:g} (capacity), got "
                f"{model.loads[0]:g}",
                field="loads",
            )
        with np.errstate(over="ignore"):
            whole = float(np.abs(model.loads).sum() * max(1, np.size(model.vehicles)))
        if not np.isfinite(whole):
            raise InvalidData(f"loads must have a finite sum, got {whole:g}", field="loads")
    if model.windows is not None:
        if model.speed is None:
            raise InvalidData("windows need a speed in m/s", field="speed")
        wrong = np.flatnonzero(~(model.windows[:, 0] <= model.windows[:, 1]))
        if wrong.size or np.isinf(model.windows[:, 0]).any():
            k = int(wrong[0]) if wrong.size else int(np.argmax(np.isinf(model.windows[:, 0])))
            raise InvalidData(
                f"windows[{k}] must be a finite earliest time and a latest time that is not before it, got "
                f"{model.windows[k].tolist()}",
                field="windows",
            )
    if model.vehicles is not None:
        _check_vehicles(model)
    ends = [model.end] if isinstance(model.end, float) else []
    starts = [] if model.vehicles is None else model.vehicles.tolist()
    with np.errstate(over="ignore"):
        span = float(np.ptp([*model.coordinates, *ends, *starts]))
        total = 4.0 * model.size * (len(starts) + 1) * span / (model.speed or 1.0)
        if model.service is not None:
            total += float(model.service.sum())
        if model.windows is not None:
            total += 4.0 * float(np.abs(model.windows[np.isfinite(model.windows)]).max())
    if not np.isfinite(total):
        raise InvalidData(
            f"speed must be fast enough for finite times over ways of {span:g} m, got "
            f"{'no speed' if model.speed is None else f'{model.speed:g} m/s'}",
            field="speed",
        )


def _check_track(model: Any, track: Track) -> None:
    x = model.coordinates
    if track.loop:
        limits = np.full(len(x), track.loop)
    else:
        limits = np.array([track.edges[edge][2] for edge in track.at])
    wrong = np.flatnonzero((x < 0) | (x > limits))
    if wrong.size:
        k = int(wrong[0])
        what = "the loop" if track.loop else f"edge {track.at[k]}"
        raise InvalidData(
            f"coordinates[{k}] must be in 0 … {limits[k]:g}, the length of {what}, got {x[k]:g}",
            field="coordinates",
        )
    if isinstance(model.end, float) and not (track.loop and 0 <= model.end <= track.loop):
        allowed = f"be in 0 … {track.loop:g}" if track.loop else 'be None or "free" on a tree'
        raise InvalidData(f"end must {allowed}, got {model.end:g}", field="end")


def _check_vehicles(model: Any) -> None:
    starts = model.vehicles
    if not len(starts) or starts[0] != model.coordinates[0] or (np.diff(starts) < 0).any():
        raise InvalidData(
            "vehicles must be the starts of all vehicles in the order on the line, the first at "
            f"coordinates[0] = {model.coordinates[0]:g}, got {starts.tolist()}",
            field="vehicles",
        )
    if isinstance(model.track, Track):
        raise InvalidData("vehicles need a line, got another track", field="vehicles")
    if isinstance(model.end, float):
        raise InvalidData(
            f'end must be None or "free" with several vehicles, got {model.end:g}', field="end"
        )
