"""Plots of messenger tours: path, tracks of the vehicles and encounters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..fields import required
from ..plots.labels import write_names
from ..plots.maps import dress_map, length_unit, point_ways
from ..plots.options import check_flags, check_option
from ..plots.progress import draw_progress
from ..plots.space import dots
from ..plots.style import (
    BLACK,
    DARK,
    RED,
    RING,
    axis_style,
    headline,
    key,
    legend_below,
    number,
    sheet,
    title_of,
)
from ..verification import TOLERANCE, Verification, check_tolerance
from .animation import animate_tour
from .drawn import FAR, Drawn, together, within
from .model import MessengerTour
from .plan import TourPlan
from .sampling import Track, track

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["animate_tour", "draw", "draw_progress"]

Floats = NDArray[np.float64]

VEHICLE, NAME = axis_style(1)["color"], axis_style(5)["color"]
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


@np.errstate(all="ignore")  # an invalid plan may lead beyond the range of numbers
def draw(
    model: MessengerTour,
    plan: TourPlan | None = None,
    *,
    colour: str = "time",
    labels: bool | None = None,
    zoom: bool | None = None,
    tolerance: float = TOLERANCE,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> Figure:
    """Draw the vehicles of `model`, and the tour of `plan`.

    Parameters
    ----------
    model : MessengerTour
        The model.
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
    tolerance : float
        Largest relative violation accepted, for the title and the red rings. Use the tolerance of
        the solution.
    title : str, optional
        Title. Default: the name, the length and the time.
    size : (float, float), optional
        Width and height, in inches.

    Returns
    -------
    matplotlib.figure.Figure
        Figure with one map, or with two maps, and the colour scale.

    Raises
    ------
    InvalidData
        The plan has another type, or contains an unknown vehicle.
    UnsupportedOption
        An option has a value that is not allowed.

    See Also
    --------
    animate_tour : Animation of a plan.
    draw_progress : Plot of the incumbents of a solve.
    """
    check_option("colour", colour, colour in ("time", "leg"), "be 'time' or 'leg'")
    check_flags(**{k: v for k, v in (("labels", labels), ("zoom", zoom)) if v is not None})
    check_tolerance(tolerance)
    verification, tour = None, None
    if plan is not None:
        verification = model.verify(required("plan", plan, TourPlan), tolerance=tolerance)
        tour = Drawn(model, plan, verification)
    places = _vehicles_alone(model) if tour is None else tour.everything
    box = places.min(axis=0), places.max(axis=0)
    half = None
    if tour is not None and zoom is not False and model.size > 1:
        near = tour.first_half
        small = np.ptp(near, axis=0).max() < _CROWDED * np.ptp(places, axis=0).max()
        half = near if zoom or small else None
    figure = sheet(size, (7.2, 6.4) if half is None else (12.4, 6.2))
    text = _title(model, verification) if title is None else title
    parts = [box] if half is None else [box, (half.min(axis=0), half.max(axis=0))]
    broad, tall = figure.get_size_inches()
    rows = 2 if half is None else 1
    head = 0.42 + 0.17 * text.count("\n") + 0.2 * (half is not None)
    low, high = (0.64 + 0.17 * rows) / tall, 1 - head / tall
    wide = (broad - (0.95 if tour is not None and colour == "time" else 0.15)) / len(parts) / broad
    for place, (lower, upper) in enumerate(parts):
        left = place * wide + 0.72 / broad
        axes = figure.add_axes((left, low, wide - 0.8 / broad, high - low))
        scale, unit = length_unit(float((upper - lower).max()))
        dress_map(axes, lower * scale, upper * scale, unit)
        if tour is None:
            _draw_vehicles(model, axes, scale, labels=labels)
            continue
        lines = _draw_tour(tour, axes, scale, colour)
        # Encounters that the second map shows are numbered there.
        inside = within(tour.plan.points, lower, upper)
        if place == 0 and half is not None:
            inside &= ~within(tour.plan.points, *parts[1])
        _write(tour, axes, scale, labels, inside, within(model.positions, lower, upper))
        if place == 0 and colour == "time":
            beside = figure.add_axes((1 - 0.82 / broad, low, 0.14 / broad, high - low))
            bar = figure.colorbar(lines, cax=beside)
            bar.set_label("time (s)", fontsize=8.5)
            bar.ax.tick_params(labelsize=8)
            bar.outline.set_visible(False)
        if place:
            axes.set_title("the first half of the encounters", fontsize=8.5, color=DARK, pad=3)
    legend_below(figure, _keys(model, tour), rows=rows)
    headline(figure, text, wrong=verification is not None and not verification.ok)
    return figure


def _title(model: MessengerTour, verification: Verification | None) -> str:
    parts = [model.describe()]
    if verification is not None and verification.objective is not None:
        parts = [
            f"{model.size} vehicle{'s' * (model.size > 1)}",
            f"{number(verification.objective)} m",
        ]
        parts.append(f"{number(verification.objective / model.speed, 5)} s")
    return title_of(model.name, parts, verification)


def _vehicles_alone(model: MessengerTour) -> Floats:
    """Return the places that the map of a model without a plan must include."""
    reach = model.radius[:, None]
    start = np.empty((0, 2)) if model.start is None else model.start[None, :2]
    return np.concatenate([model.positions - reach, model.positions + reach, start])


# -- the maps ------------------------------------------------------------------------------------


def _draw_tour(tour: Drawn, axes: Any, scale: float, colour: str) -> Any:
    """Draw vehicles, path and encounters; return the lines of the path."""
    model, plan = tour.model, tour.plan
    _draw_discs(axes, tour.meetings * scale, model.radius[tour.met] * scale)
    _draw_tracks(tour, axes, scale)
    lines = _draw_path(tour.path, axes, scale, colour, model.speed)
    _draw_arrows(tour, axes, scale)
    points = plan.points * scale
    white: dict[str, Any] = {"edge": "white", "width": 0.6, "zorder": 7}
    if len(points):
        dots(axes, points, "o", BLACK, size=24 if len(points) <= _MOST_NUMBERS else 12, **white)
    _draw_start(axes, plan.start, scale)
    if len(tour.broken):
        dots(
            axes, tour.broken * scale, "o", "none", size=150, edge=RED, width=1.8, zorder=21,
            gid="worst violation",
        )  # fmt: skip
    return lines


def _draw_path(path: Track, axes: Any, scale: float, colour: str, speed: float) -> Any:
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    # The brightest yellow is invisible on white.
    shades = ListedColormap(colormaps["viridis"](np.linspace(0.0, 0.9, 256)))
    places = path.poses[:, :2] * scale
    lines = _draw_lines(
        axes, np.stack([places[:-1], places[1:]], axis=1), linewidths=1.7, zorder=4, cmap=shades,
        capstyle="round", gid="path",
    )  # fmt: skip
    if colour == "time":
        lines.set_array(0.5 * (path.flown[:-1] + path.flown[1:]) / speed)
        lines.set_clim(0.0, float(np.clip(path.flown[-1], 0.0, FAR)) / speed or 1.0)
    else:
        lines.set_color([axis_style(_LEGS[leg % len(_LEGS)])["color"] for leg in path.legs[1:]])
    return lines


def _draw_tracks(tour: Drawn, axes: Any, scale: float) -> None:
    """Draw the tracks of the vehicles up to their encounters, each with an arrow."""
    begins, ends = tour.model.positions[tour.met] * scale, tour.meetings * scale
    rest = np.setdiff1d(np.arange(tour.model.size), tour.met)
    dots(
        axes, np.concatenate([begins, tour.model.positions[rest] * scale]), "s", "white", size=13,
        edge=VEHICLE, width=1.0, zorder=5, gid="vehicle",
    )  # fmt: skip
    _draw_lines(axes, np.stack([begins, ends], axis=1), linewidths=0.9, color=VEHICLE, alpha=0.85,
                zorder=3, gid="track")  # fmt: skip
    headings = np.arctan2(*tour.model.velocities[tour.met].T[::-1])
    far = np.hypot(*(ends - begins).T) > _LONG * np.ptp(axes.get_xlim())
    point_ways(axes, (0.5 * (begins + ends))[far], headings[far], VEHICLE, 4.0)


def _draw_lines(axes: Any, ends: Floats, **look: Any) -> Any:
    """Draw straight lines, shape (k, 2, 2), and return them; the limits of the axes are unchanged."""
    from matplotlib.collections import LineCollection

    lines = LineCollection(list(np.clip(ends, -FAR, FAR)), **look)
    axes.add_collection(lines, autolim=False)
    return lines


def _draw_discs(axes: Any, middles: Floats, radius: Floats) -> None:
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Circle

    circles = [Circle((x, y), r) for (x, y), r in zip(middles, radius, strict=True)]
    axes.add_collection(
        PatchCollection(
            circles, facecolor=VEHICLE, edgecolor=VEHICLE, lw=0.7, alpha=0.28, zorder=2, gid="disc"
        ),
        autolim=False,
    )


def _draw_arrows(tour: Drawn, axes: Any, scale: float) -> None:
    """Draw an arrow in the middle of each leg that is long enough."""
    pieces = tour.plan.primitives
    legs = np.unique([primitive.leg for primitive in pieces], return_inverse=True)[1]
    lengths = np.bincount(legs, [primitive.length for primitive in pieces])
    ends = np.cumsum(lengths)
    shown = lengths * scale > _LONG * np.ptp(axes.get_xlim())
    middles = track(tour.plan, tour.model.turning_radius, (ends - 0.5 * lengths)[shown]).poses
    point_ways(axes, middles[:, :2] * scale, middles[:, 2], DARK, 5.5)


def _draw_start(axes: Any, start: Floats, scale: float) -> None:
    x, y, heading = start.tolist()
    axes.plot(
        x * scale, y * scale, ls="", marker=(3, 0, np.rad2deg(heading) - 90), ms=11, mfc="white",
        mec=BLACK, mew=1.4, zorder=8, gid="start",
    )  # fmt: skip


def _draw_vehicles(model: MessengerTour, axes: Any, scale: float, *, labels: bool | None) -> None:
    """Draw the vehicles at time 0, their discs, and arrows proportional to their velocities."""
    places = model.positions * scale
    _draw_discs(axes, places, model.radius * scale)
    dots(axes, places, "s", "white", size=16, edge=VEHICLE, width=1.1, zorder=5, gid="vehicle")
    fast = np.hypot(*model.velocities.T)
    if fast.any():
        span = max(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()))
        arrows = model.velocities * (_ARROW * span / fast.max())
        axes.quiver(
            *places.T, *arrows.T, color=VEHICLE, angles="xy", scale_units="xy", scale=1, width=0.003,
            zorder=4, gid="velocity",
        )  # fmt: skip
    if model.start is not None:
        heading = model.heading
        if heading is None:
            dots(axes, model.start[None, :2] * scale, "o", "white", size=60, edge=BLACK, zorder=8)
        else:
            _draw_start(axes, model.start, scale)
    if labels if labels is not None else model.size <= _MOST_NAMES:
        names = [model.label(k) for k in range(model.size)]
        write_names(axes, places, names, size=7.5, colour=NAME, route=False)


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
    runs = [run for run in together(points, extent) if inside[run[0]]]
    texts = [
        (f"{first + 1}" if first == last else f"{first + 1}–{last + 1}")
        if few or first == 0 or last == len(points) - 1 or (first + 1) % 10 == 0
        else ""
        for first, last in runs
    ]
    if runs:
        firsts = points[[first for first, _ in runs]] * scale
        write_names(axes, firsts, texts, size=8, colour=BLACK)
    rows = np.flatnonzero(seen)
    # The names of vehicles that start close together would overlap.
    spread = float(np.ptp(model.positions, axis=0).max()) > 0.3 * extent
    if len(rows) and (labels or (model.size <= _MOST_NAMES and spread)):
        names = [model.label(int(k)) for k in rows]
        places = model.positions[rows] * scale
        write_names(axes, places, names, size=7, colour=NAME, route=False)


def _keys(model: MessengerTour, tour: Drawn | None) -> list[Any]:
    begin = key("vehicle (name) at time 0", marker="s", mfc="white", mec=VEHICLE, ms=4.5)
    keys = [begin]
    if model.start is not None or tour is not None:
        keys.insert(0, key("start", marker=(3, 0, 0), mfc="white", mec=BLACK, ms=8))
    disc = {"marker": "o", "ms": 9, "mfc": VEHICLE, "mec": VEHICLE, "alpha": 0.35}
    if tour is None:
        keys += [key("its disc", **disc)] * bool(model.radius.any())
        keys += [key("its velocity", color=VEHICLE, lw=1.4)] * (not model.at_rest)
        return keys
    keys += [key("its track", color=VEHICLE, lw=0.9)] * (not model.at_rest)
    keys += [key("its disc when met", **disc)] * bool(model.radius.any())
    keys.append(key("encounter (number)", marker="o", color=BLACK, ms=5))
    if len(tour.broken):
        keys.append(key("worst violation", **RING))
    return keys
