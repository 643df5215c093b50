"""Plots of messenger tours: path, tracks of the vehicles and encounters."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..plots import kit
from ..plots.progress import draw_progress
from ..verification import Check
from .model import MessengerTour
from .plan import TourPlan
from .plot_fields import draw_fields, field_keys, zone_places
from .plot_film import animate_tour
from .plot_places import Drawn
from .sampling import Track, track

__all__ = ["animate_tour", "draw", "draw_progress"]

VEHICLE, NAME = kit.colour_of(1), kit.colour_of(5)
#: Indices of the colours of the legs, in cyclic order: all but those of vehicles and of black.
_LEGS = (0, 2, 3, 4, 5)
#: Largest numbers of encounters and of vehicles that are all labelled; beyond, every tenth
#: encounter is.
_MOST_NUMBERS, _MOST_NAMES = 45, 25
#: Share of the map below which the first half of the encounters gets a map of its own.
_CROWDED = 0.2
#: Share of the map's width above which a track or leg has an arrow.
_LONG = 0.04
#: Length of the longest velocity arrow, as a share of the map.
_ARROW = 0.1
#: Encounters share a place on the map if they are closer than this share of its extent.
_NEAR = 1e-3


@kit.documented
@np.errstate(all="ignore")  # an invalid plan may lead beyond the range of numbers
def draw(
    model: MessengerTour,
    plan: TourPlan | None = None,
    *,
    colour: str = "time",
    labels: bool | None = None,
    zoom: bool | None = None,
    tolerance: float = kit.TOLERANCE,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.Figure:
    """Draw the vehicles of `model`, and the tour of `plan`.

    :func:`animate_tour` shows the tour in motion, and :func:`draw_progress` the convergence of solutions.

    Parameters
    ----------
    plan : TourPlan, optional
        Plan of the model, feasible or not. The place of the largest violation of each violated
        check has a red ring. None draws the vehicles at time 0 and their velocities.
    colour : {"time", "leg"}
        Colour of the path: by time, or by leg.
    labels : bool, optional
        Whether to number the encounters and to name the vehicles. Default: True if the labels are
        few enough to be legible. With more encounters, every tenth is numbered.
    zoom : bool, optional
        Whether to add a second, larger map of the first half of the encounters. Default: True if
        these are crowded, as on long tours during which vehicles drive away.
    """
    kit.check_choice("colour", colour, "time", "leg")
    kit.check_flags(optional=True, labels=labels, zoom=zoom)
    result, tour = kit.verified_plan(model, plan, TourPlan, tolerance), None
    tours: list[Drawn] = []
    parts = [model.describe()]
    if plan is not None and result is not None:
        tours = [Drawn(model, part, result, uav) for uav, part in enumerate(plan.parts())]
        tour = tours[0]
        if result.objective is not None:
            parts = [kit.many(model.size, "vehicle"), f"{kit.number(result.objective)} m"]
            parts.append(f"{kit.number(result.objective / model.speed, 5)} s")
    reach = model.radius[:, None]
    start = np.empty((0, 2)) if model.start is None else model.start[None, :2]
    places = np.concatenate([model.positions - reach, model.positions + reach, start])
    maps = [np.concatenate([zone_places(model), *([t.everything for t in tours] or [places])])]
    if tour is not None and len(tours) == 1 and zoom is not False and model.size > 1:
        near = tour.first_half
        if zoom or np.ptp(near, axis=0).max() < _CROWDED * np.ptp(maps[0], axis=0).max():
            maps.append(near)
    boxes = [(part.min(axis=0), part.max(axis=0)) for part in maps]
    several = len(boxes) > 1
    text = kit.title_of(model, parts, result, title)
    scene = kit.Scene(text, result, size, (12.4, 6.2) if several else (7.2, 6.4))
    rows, head = (1, scene.head + 0.2) if several else (2, scene.head)
    foot = 0.64 + kit.LINE * rows
    scaled = tour is not None and colour == "time"
    wide = (scene.broad - (0.95 if scaled else 0.15)) / len(boxes)
    for place, box in enumerate(boxes):
        axes = scene.box(place * wide + 0.72, foot, wide - 0.8, scene.tall - foot - head)
        scale = kit.dress_map(axes, *box)
        draw_fields(model, plan, axes, scale)
        if tour is None:
            _draw_vehicles(model, axes, scale, labels=labels)
            continue
        if place == 0:
            kit.pin_places(axes, result, lambda check: _place_of(tours, check), scale)
        latest = max(float(drawn.path.flown[-1]) for drawn in tours)
        for drawn in tours:
            lines = _draw_tour(drawn, axes, scale, colour, latest)
            # Encounters that the second map shows are numbered there.
            inside = _within(drawn.plan.points, *box)
            if place == 0 and several:
                inside &= ~_within(drawn.plan.points, *boxes[1])
            seen = _within(model.positions, *box) & (drawn is tour)
            _write(drawn, axes, scale, labels, inside, seen)
        if place == 0 and scaled:
            beside = scene.axes(scene.broad - 0.82, foot, 0.68, head)
            kit.color_bar(scene.figure, lines, beside, "time (s)")
        if place:
            axes.set_title("the first half of the encounters", fontsize=8.5, color=kit.DARK, pad=3)
    scene.legend(_keys(model, tour), rows)
    return scene.figure


# -- the maps ------------------------------------------------------------------------------------


def _place_of(tours: list[Drawn], check: Check) -> kit.Floats | None:
    """Return the place that a check of the plan names, or None."""
    places = (tour.place_of(check) for tour in tours)
    return next((place for place in places if place is not None), None)


def _within(places: kit.Floats, least: kit.Floats, most: kit.Floats) -> NDArray[np.bool_]:
    """Return a mask of the places within a box."""
    return np.asarray(((places >= least) & (places <= most)).all(axis=1))


def _together(points: kit.Floats, extent: float) -> list[tuple[int, int]]:
    """Return the first and last index of each run of encounters that share a place on the map."""
    runs: list[tuple[int, int]] = []
    for k, point in enumerate(points):
        if runs and np.hypot(*(point - points[runs[-1][0]])) <= _NEAR * extent:
            runs[-1] = (runs[-1][0], k)
        else:
            runs.append((k, k))
    return runs


def _draw_tour(tour: Drawn, axes: Any, scale: float, colour: str, latest: float) -> Any:
    """Draw vehicles, path and encounters; return the lines of the path."""
    model, plan = tour.model, tour.plan
    _draw_discs(axes, tour.meetings * scale, model.radius[tour.met] * scale)
    _draw_tracks(tour, axes, scale)
    lines = _draw_path(tour.path, axes, scale, colour, model.speed, latest)
    _draw_arrows(tour, axes, scale)
    points = plan.points * scale
    size = 24 if len(points) <= _MOST_NUMBERS else 12
    if len(points):
        kit.dots(axes, points, "o", kit.BLACK, size=size, edge="white", width=0.6, zorder=7)
    _draw_start(axes, plan.start, scale)
    kit.ring(axes, tour.broken * scale, "worst violation")
    return lines


def _draw_path(
    path: Track, axes: Any, scale: float, colour: str, speed: float, latest: float
) -> Any:
    timed = colour == "time"
    times = 0.5 * (path.flown[:-1] + path.flown[1:]) / speed
    lines = kit.draw_shaded_line(
        axes, path.poses[:, :2] * scale, times if timed else None, linewidths=1.7, zorder=4,
        gid="path",
    )  # fmt: skip
    if timed:
        lines.set_clim(0.0, float(np.clip(latest, 0.0, kit.FAR)) / speed or 1.0)
    else:
        lines.set_color([kit.colour_of(_LEGS[leg % len(_LEGS)]) for leg in path.legs[1:]])
    return lines


def _draw_tracks(tour: Drawn, axes: Any, scale: float) -> None:
    """Draw the tracks of the vehicles up to their encounters, each with an arrow."""
    begins, ends = tour.model.positions[tour.met] * scale, tour.meetings * scale
    rest = np.setdiff1d(np.arange(tour.model.size), tour.met)
    _mark_vehicles(axes, np.concatenate([begins, tour.model.positions[rest] * scale]), 13, 1.0)
    tracks = np.stack([begins, ends], axis=1)
    kit.draw_lines(axes, tracks, linewidths=0.9, color=VEHICLE, alpha=0.85, zorder=3, gid="track")
    headings = np.arctan2(*tour.model.velocities[tour.met].T[::-1])
    far = np.hypot(*(ends - begins).T) > _LONG * np.ptp(axes.get_xlim())
    kit.point_ways(axes, (0.5 * (begins + ends))[far], headings[far], VEHICLE, 4.0)


def _mark_vehicles(axes: Any, places: kit.Floats, size: float, width: float) -> None:
    look: dict[str, Any] = {"size": size, "edge": VEHICLE, "width": width, "zorder": 5}
    kit.dots(axes, places, "s", "white", gid="vehicle", **look)


def _draw_discs(axes: Any, middles: kit.Floats, radius: kit.Floats) -> None:
    look = {"facecolor": VEHICLE, "edgecolor": VEHICLE, "lw": 0.7, "alpha": 0.28, "zorder": 2}
    kit.draw_circles(axes, middles, radius, gid="disc", **look)


def _draw_arrows(tour: Drawn, axes: Any, scale: float) -> None:
    """Draw an arrow in the middle of each leg that is long enough."""
    pieces = tour.plan.primitives
    legs = np.unique([primitive.leg for primitive in pieces], return_inverse=True)[1]
    lengths = np.bincount(legs, [primitive.length for primitive in pieces])
    ends = np.cumsum(lengths)
    shown = lengths * scale > _LONG * np.ptp(axes.get_xlim())
    model, along = tour.model, (ends - 0.5 * lengths)[shown]
    middles = track(tour.plan, model.turning_radius, along, model.drift).poses
    # The course over the ground differs from the heading in wind.
    way = np.column_stack([np.cos(middles[:, 2]), np.sin(middles[:, 2])]) + model.drift
    kit.point_ways(axes, middles[:, :2] * scale, np.arctan2(*way.T[::-1]), kit.DARK, 5.5)


def _draw_start(axes: Any, start: kit.Floats, scale: float) -> None:
    look = {"mec": kit.BLACK, "mew": 1.4, "zorder": 8, "gid": "start"}
    kit.point_ways(axes, start[None, :2] * scale, start[2:], "white", 11, **look)


def _draw_vehicles(model: MessengerTour, axes: Any, scale: float, *, labels: bool | None) -> None:
    """Draw the vehicles at time 0, their discs, and arrows proportional to their velocities."""
    places = model.positions * scale
    _draw_discs(axes, places, model.radius * scale)
    _mark_vehicles(axes, places, 16, 1.1)
    fast = np.hypot(*model.velocities.T)
    if fast.any():
        span = max(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()))
        arrows = model.velocities * (_ARROW * span / fast.max())
        axes.quiver(
            *places.T, *arrows.T, color=VEHICLE, angles="xy", scale_units="xy", scale=1, width=0.003,
            zorder=4, gid="velocity",
        )  # fmt: skip
    if model.start is not None and model.heading is None:
        start = model.start[None, :2] * scale
        kit.dots(axes, start, "o", "white", size=60, edge=kit.BLACK, zorder=8)
    elif model.start is not None:
        _draw_start(axes, model.start, scale)
    if labels if labels is not None else model.size <= _MOST_NAMES:
        names = [model.label(k) for k in range(model.size)]
        kit.write_names(axes, places, names, size=7.5, colour=NAME, route=False)


# -- words ---------------------------------------------------------------------------------------


def _write(
    tour: Drawn, axes: Any, scale: float, labels: bool | None, inside: NDArray[np.bool_],
    seen: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Number the encounters `inside` in their order, and name the vehicles in the mask `seen`."""
    if labels is False:
        return
    model, points = tour.model, tour.plan.points
    extent = float(np.ptp(axes.get_xlim())) / scale
    few = labels or inside.sum() <= _MOST_NUMBERS
    runs = [run for run in _together(points, extent) if inside[run[0]]]
    texts = [
        (f"{first + 1}" if first == last else f"{first + 1}–{last + 1}")
        if few or first == 0 or last == len(points) - 1 or (first + 1) % 10 == 0
        else ""
        for first, last in runs
    ]
    if runs:
        firsts = points[[first for first, _ in runs]] * scale
        kit.write_names(axes, firsts, texts, size=8, colour=kit.BLACK)
    rows = np.flatnonzero(seen)
    # The names of vehicles that start close together would overlap.
    spread = float(np.ptp(model.positions, axis=0).max()) > 0.3 * extent
    if len(rows) and (labels or (model.size <= _MOST_NAMES and spread)):
        names = [model.label(int(k)) for k in rows]
        places = model.positions[rows] * scale
        kit.write_names(axes, places, names, size=7, colour=NAME, route=False)


def _keys(model: MessengerTour, tour: Drawn | None) -> list[Any]:
    begin = kit.key("vehicle (name) at time 0", marker="s", mfc="white", mec=VEHICLE, ms=4.5)
    keys = [begin]
    if model.start is not None or tour is not None:
        keys.insert(0, kit.key("start", marker=(3, 0, 0), mfc="white", mec=kit.BLACK, ms=8))
    keys += field_keys(model, None if tour is None else tour.plan)
    disc = {"marker": "o", "ms": 9, "mfc": VEHICLE, "mec": VEHICLE, "alpha": 0.35}
    if tour is None:
        keys += [kit.key("its disc", **disc)] * bool(model.radius.any())
        keys += [kit.key("its velocity", color=VEHICLE, lw=1.4)] * bool(model.velocities.any())
        return keys
    keys += [kit.key("its track", color=VEHICLE, lw=0.9)] * bool(model.velocities.any())
    keys += [kit.key("its disc when met", **disc)] * bool(model.radius.any())
    keys.append(kit.key("encounter (number)", marker="o", color=kit.BLACK, ms=5))
    if len(tour.broken):
        keys.append(kit.key("worst violation", **kit.RING))
    return keys
