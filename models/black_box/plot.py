"""Pictures of black boxes: a curve, a contour map, cross-sections through a point, or a path."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...errors import InvalidData
from ..fields import required, show
from ..plots import kit
from ..plots.progress import draw_progress
from .model import BlackBoxMinimisation
from .plan import BlackBoxPoint
from .sampled_values import draw_fronts, levels_of, sampled, shade_infeasible
from .waypoints import WaypointPath

__all__ = ["animate_search", "draw", "draw_progress"]

#: Largest number of cross-sections, and of plans in addition to the first.
_MOST, _MOST_OTHERS = 12, 12
#: Number of values of a single curve per value of a section.
_FINER = 4
#: Ratio of distance from 0 to width above which the ticks of an axis have an offset.
_NARROW = 1e4
#: Colours of points without a value, and of a constant function.
_NONE, _SAME = "#d9d9d9", "#c7e9b4"
#: Line of a bound.
_BOUND: dict[str, Any] = {"color": kit.DARK, "ls": "--", "lw": 0.9}
#: Number of points per segment at which a path is tested for blocked cells.
_POINTS = 2001
#: Number of earlier paths shown by an animation.
_EARLIER = 5


@kit.documented
@np.errstate(all="ignore")  # overflow gives inf or NaN, which is no value
def draw(
    model: BlackBoxMinimisation,
    plan: BlackBoxPoint | None = None,
    *,
    others: Mapping[str, Any] | None = None,
    view: str = "map",
    points: int = 101,
    tolerance: float = kit.TOLERANCE,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.Figure:
    """Draw the function of `model`, and the point of `plan`.

    A function of one variable is a curve, and one of two variables a contour map, whose levels have
    equal shares of the area if the values are uneven. Of more variables, the first twelve have one
    cross-section each, through the point or the middle of the bounds. A waypoint path is drawn on
    its map; :func:`animate_search` shows the search for it, and :func:`draw_progress` the convergence
    of solutions. A white veil with a red border covers infeasible points of a contour map. Several
    objectives are drawn as the points of the front. Fixed variables are ignored. Points without a value, or at which the function
    raises, are gaps; the function must not raise at the plans.

    Parameters
    ----------
    model : BlackBoxMinimisation
        Model. The picture evaluates its function without using the budget.
    plan : BlackBoxPoint, optional
        Point of the model, within the bounds or not.
    others : dict of str to plan, optional
        Further points of the model by their label in the legend: plans, their JSON data or
        solutions.
    view : {"map", "values"}
        Whether a path is drawn on its map, or as a function of its variables.
    points : int
        Number of values along each axis, from 2 to 2001; a single curve has four times as many.
    """
    kit.check_choice("view", view, "map", "values")
    kit.check_whole("points", points, 2, 2001)
    path = isinstance(model.function, WaypointPath) and view == "map"
    plans = kit.name_plans(
        model, plan, others, BlackBoxPoint, name="path" if path else "point", most=_MOST_OTHERS,
        tolerance=tolerance,
    )  # fmt: skip
    return _Picture(model, plan, plans, title, size).draw(path, points)


class _Picture:
    """Model and plans of a picture."""

    def __init__(
        self, model: BlackBoxMinimisation, plan: Any, plans: list[kit.Named], title: Any, size: Any
    ) -> None:
        self.model, self.size = model, size
        self.main, self.result = plan is not None, None if plan is None else plans[0].result
        self.plans = [item.plan for item in plans]
        self.names, self.labels = [item.name for item in plans], kit.label_plans(plans, plan)
        self.points = np.array([item.plan.x for item in plans]).reshape(-1, model.dimension)
        self.values = [item.result.objective for item in plans]
        self.text = kit.title_of(model, self._parts(), self.result, title)

    def _parts(self) -> list[str]:
        parts, function = [self.model.describe()], self.model.function
        if self.result is not None and self.result.objective is not None:
            value = self.result.objective
            parts.append(f"value {kit.number(value)}")
            if isinstance(function, WaypointPath):
                line = function.polylines(self.points[:1])[0]
                length = float(np.hypot(*np.diff(line, axis=0).T).sum())
                if value > length * (1 + 1e-12):
                    parts.append(f"of which {kit.number(value - length)} for what is blocked")
        return parts

    def draw(self, path: bool, points: int) -> kit.Figure:
        """Draw a path, a contour map or cross-sections with `points` values along each axis."""
        free = np.flatnonzero(self.model.highs > self.model.lows)
        if path:
            return self._draw_path()
        if self.model.objectives > 1:
            looks = [self._look(k) for k in range(len(self.plans))]
            size = (5.2, 4.4) if self.model.objectives == 2 else (9.6, 4.0)
            scene = kit.Scene(self.text, self.result, self.size, size)
            return draw_fronts(scene, self.model, self.plans, self.labels, looks)
        if len(free) == 2:
            return self._draw_levels(int(free[0]), int(free[1]), points)
        return self._draw_sections((free if free.size else np.arange(1))[:_MOST].tolist(), points)

    def _through(self) -> kit.Floats:
        """Return the point through which sections are drawn: that of a plan, or the middle."""
        model = self.model
        middle = 0.5 * model.lows + 0.5 * model.highs
        through: kit.Floats = np.clip([*self.points, middle][0], model.lows, model.highs)
        return through

    def _visible_range(self, k: int) -> tuple[float, float]:
        """Return the visible range of a variable: the bounds, and points near them."""
        low, high = self.model.bounds[k].tolist()
        width = (high - low) or 0.5 * (abs(high) or 1.0)
        places = np.clip(self.points[:, k], low - width, high + width).tolist()
        lowest, highest = min([low, *places]), max([high, *places])
        return (lowest, highest) if highest > lowest else (low - width, high + width)

    def _look(self, k: int) -> dict[str, Any]:
        """Return the marker of point number `k`; the plan's is white."""
        if k == 0 and self.main:
            return {"marker": "o", "mfc": "white", "mec": kit.BLACK, "ms": 7.0, "mew": 1.3}
        return {"marker": "D", "mfc": kit.colour_of(k), "mec": "white", "ms": 6.0, "mew": 0.8}

    # -- cross-sections --------------------------------------------------------------------------

    def _draw_sections(self, chosen: list[int], points: int) -> kit.Figure:
        """Draw the values along each variable through the first point, or the middle of the bounds."""
        from matplotlib.ticker import ScalarFormatter

        single = len(chosen) == 1
        columns = 1 if single else 2 if len(chosen) <= 4 else 3
        rows = -(-len(chosen) // columns)
        wide, tall = (5.6, 2.9) if single else (2.9 * columns, 1.75 * rows)
        head = 0.46 + kit.LINE * self.text.count("\n")
        scene = kit.Scene(self.text, self.result, self.size, (wide + 0.4, tall + head + 0.9))
        broad, tall = scene.broad, scene.tall
        scene.figure.subplots_adjust(
            left=min(0.85 / broad, 0.3), right=max(1 - 0.15 / broad, 0.8), wspace=0.42, hspace=0.5,
            bottom=min(0.9 / tall, 0.4), top=max(1 - head / tall, 0.6),
        )  # fmt: skip
        panels, places = [], []
        for place, k in enumerate(chosen):
            axes: Any = scene.figure.add_subplot(rows, columns, place + 1)
            panel = self._section(k, points * (_FINER if single else 1))
            first, last = self._visible_range(k)
            kit.draw_panel(panel, axes, [kit.Span("", first, last)], wrong=False)
            for bound in self.model.bounds[k]:
                axes.axvline(bound, zorder=1, gid="bound", **_BOUND)
            if max(abs(first), abs(last)) > _NARROW * (last - first):
                # Write the common part of all ticks once.
                axes.xaxis.set_major_formatter(ScalarFormatter())
            kit.label_axes(axes, f"x[{k}] (–)", "" if place % columns else None)
            if len(self.points):
                spot = self.points[0, k], np.interp(self.points[0, k], *axes.lines[0].get_data())
                kit.pin_places(axes, self.result, {f"x[{k}]": spot})
            panels.append(panel)
            places.append(axes)
        scene.legend([kit.key("bound", **_BOUND), *kit.keys_of(panels, places)])
        return scene.figure

    def _section(self, k: int, points: int) -> kit.Panel:
        low, high = self.model.bounds[k].tolist()
        through = self._through()
        # Add the point itself, because its well may be narrower than a step.
        along = np.unique(np.append(np.linspace(low, high, points), through[k]))
        sample = np.repeat(through[None], along.size, axis=0)
        sample[:, k] = along
        curve = kit.Curve("value", 0, along, sampled(self.model, sample)[0])
        places = np.clip(self.points[:, k : k + 1], *self._visible_range(k))
        marks = [
            kit.Mark(label, place, np.array([value], float), n, self._look(n))  # None is NaN
            for n, (label, place, value) in enumerate(
                zip(self.labels, places, self.values, strict=True)
            )
        ]
        return kit.Panel("value", "", [curve], marks=marks)

    # -- maps of levels --------------------------------------------------------------------------

    def _draw_levels(self, a: int, b: int, points: int) -> kit.Figure:
        """Draw the levels over the variables `a` and `b`."""
        from matplotlib import colormaps

        model = self.model
        head = 0.46 + kit.LINE * self.text.count("\n")
        scene = kit.Scene(self.text, self.result, self.size, (6.0, 4.65 + head))
        axes = scene.axes(0.85, 0.95, 1.2, head)
        along, across = np.linspace(model.lows[[a, b]], model.highs[[a, b]], points).T
        sample = np.repeat(self._through()[None], points * points, axis=0)
        sample[:, a], sample[:, b] = np.tile(along, points), np.repeat(across, points)
        flat, holds = sampled(model, sample)
        values, feasible = flat.reshape(points, points), holds.reshape(points, points)
        finite = values[np.isfinite(values)]
        corners = (along[0], across[0]), (along[-1], across[-1])
        kit.draw_box(axes, *corners, fc=_NONE, ec="none", zorder=0.5, gid="no value")
        dashed: dict[str, Any] = {"ec": kit.DARK, "ls": "--", "lw": 0.9}
        kit.draw_box(axes, *corners, fc="none", zorder=1, gid="bound", **dashed)
        keys = [kit.key("bound", **_BOUND)]
        levels = levels_of(finite)
        grid = along, across, values
        if levels.size > 1:
            shades = colormaps["YlGnBu_r"](np.linspace(0.05, 0.95, levels.size - 1))
            filled = axes.contourf(*grid, levels, colors=shades, zorder=0.7)
            axes.contour(*grid, levels[1:-1], colors="white", linewidths=0.4, zorder=0.8)
            beside = scene.axes(scene.broad - 1.05, 0.95, 0.9, head)
            bar = scene.figure.colorbar(filled, cax=beside, ticks=levels, spacing="uniform")
            texts = [kit.number(level, 4) for level in levels.tolist()]
            bar.ax.set_yticklabels(texts, fontsize=7.5)
            kit.label_axes(bar.ax, y="value (–)")
        elif finite.size:  # the same value everywhere
            ends = [finite[0] - 1, finite[0] + 1]
            axes.contourf(*grid, ends, colors=[_SAME], zorder=0.7)
            text = f"value {kit.number(float(finite[0]))}"
            keys.append(kit.key(text, marker="s", color=_SAME, ms=7))
        if finite.size < values.size:
            keys.append(kit.key("no value", marker="s", color=_NONE, ms=7))
        if not feasible.all():
            keys.append(shade_infeasible(axes, along, across, feasible))
        limits = np.array([self._visible_range(k) for k in (a, b)])
        spots = np.clip(self.points[:, [a, b]], limits[:, 0], limits[:, 1])
        looks = [self._look(k) for k in range(len(spots))]
        for name, spot, look in reversed(list(zip(self.names, spots, looks, strict=True))):
            axes.plot(*spot[:, None], ls="", zorder=9, clip_on=False, gid=name, **look)
        margins = 0.015 * np.diff(limits, axis=1) * [-1, 1]
        axes.axis((limits + margins).ravel().tolist())
        kit.label_axes(axes, f"x[{a}] (–)", f"x[{b}] (–)")
        kit.pin_places(
            axes, self.result, {f"x[{k}]": p for p in self.points[:1, [a, b]] for k in (a, b)}
        )
        kit.bare(axes)
        axes.grid(visible=False)
        keys += [kit.key(label, **look) for label, look in zip(self.labels, looks, strict=True)]
        scene.legend(keys)
        return scene.figure

    # -- paths -----------------------------------------------------------------------------------

    def _draw_path(self) -> kit.Figure:
        """Draw the paths on their map, with the blocked part of the first one in red."""
        function = required("function", self.model.function, WaypointPath)
        lines = function.polylines(self.points)
        low, high = kit.box_near(*kit.corners_of(function.map), [lines.reshape(-1, 2)])
        broad, tall = (high - low) * 5.0 / (high - low).max()
        default = max(4.8, broad + 0.9), max(2.6, tall + 1.3)
        scene = kit.Scene(self.text, self.result, self.size, default)
        axes = scene.axes(0.72, 1.0, 0.15, scene.head)
        scale = kit.dress_map(axes, low, high)
        keys = _draw_field(axes, function, scale)
        white: dict[str, Any] = {"edge": "white", "width": 0.6}
        for k in reversed(range(len(lines))):
            first = k == 0
            look = {**kit.axis_style(k), "lw": 2.0 if first else 1.3, "zorder": 6 - 0.1 * k}
            line = np.clip(lines[k] * scale, -kit.FAR, kit.FAR)
            axes.plot(*line.T, gid="path" if first else "other path", **look)
            turns: dict[str, Any] = {"size": 20 if first else 10, "zorder": 7 - 0.1 * k, **white}
            kit.dots(axes, line[1:-1], "o", look["color"], gid="waypoint", **turns)
        keys += [kit.key(label, lw=1.6, **kit.axis_style(k)) for k, label in enumerate(self.labels)]
        turns_of = lines[:1, 1:-1].repeat(2, axis=1).reshape(-1, 2)
        places = {f"x[{k}]": turn for k, turn in enumerate(turns_of)}
        kit.pin_places(axes, self.result, places, scale)
        blocked = _blocked_part(function, lines[0]) if len(lines) else np.full((1, 2), np.nan)
        if np.isfinite(blocked).any():
            axes.plot(*(blocked * scale).T, color=kit.RED, lw=2.4, zorder=6.5, gid="blocked path")
            keys.append(kit.key("through what is blocked", color=kit.RED, lw=2.4))
        scene.legend(keys)
        return scene.figure


# -- paths in motion -------------------------------------------------------------------------------


def _draw_field(axes: Any, function: WaypointPath, scale: float) -> list[Any]:
    """Draw the map with start and goal, and return the entries of a legend."""
    kit.draw_cells(axes, function.map, scale)
    ends = kit.draw_ends(axes, function.start[None] * scale, function.goal[None] * scale)
    return [*ends, kit.key("blocked", marker="s", mfc=kit.BLOCKED, mec=kit.BLOCKED, ms=7)]


def _blocked_part(function: WaypointPath, line: kit.Floats) -> kit.Floats:
    """Return points along a path, shape (n, 2), with NaN at free points."""
    share = np.linspace(0, 1, _POINTS)[:, None]
    parts = [a + share * (b - a) for a, b in itertools.pairwise(line)]
    path = np.concatenate(parts)
    # A point on the side of a blocked cell is free, so its four neighbours are tested as well.
    shift = 1e-6 * function.map.cell
    around = [path + np.array([x, y]) * shift for x in (-1, 1) for y in (-1, 1)]
    near = (function.map.cells_of(np.clip(points, -1e15, 1e15)) for points in around)
    free = np.any([function.map.holds(cells) for cells in near], axis=0)
    return np.where(free[:, None], np.nan, path)


@kit.documented
def animate_search(
    model: BlackBoxMinimisation,
    incumbents: Sequence[Any],
    *,
    frames: int = 120,
    interval: float = 120.0,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.FuncAnimation:
    """Return an animation of the incumbents of a search, from one improvement to the next.

    Parameters
    ----------
    model : BlackBoxMinimisation
        Model whose function is a :class:`~crosstrack.models.black_box.WaypointPath`.
    incumbents : sequence of Incumbent or Event
        Incumbents in order: ``met`` after ``solve(model, "iafsa", on_event=met.append)``.
    frames : int
        Largest number of frames, at least 2; if there are more improvements, some are omitted.
    """
    function = required("model", model, BlackBoxMinimisation).function
    function = required("function", function, WaypointPath)
    stage = kit.Stage(model, title, size, frames, interval)
    plain = isinstance(incumbents, list | tuple)
    if plain:  # other events have no incumbent
        parts = [getattr(item, "incumbent", item) for item in incumbents]
        incumbents = [part for part in parts if part is not None]
    if not plain or not incumbents or not all(hasattr(line, "plan") for line in incumbents):
        raise InvalidData(
            "incumbents must be a list of at least one, as on_event receives them, got "
            f"{show(incumbents)}",
            field="incumbents",
        )
    selected = np.unique(np.linspace(0, len(incumbents) - 1, frames).round().astype(int))
    steps = [incumbents[k] for k in selected]
    lines = function.polylines(np.array([model.as_plan(line.plan).x for line in steps]))
    axes, scale = stage.map(*kit.box_near(*kit.corners_of(function.map), [lines.reshape(-1, 2)]))
    _draw_field(axes, function, scale)
    look, grey = kit.axis_style(0), {"lw": 0.8, "color": kit.GREY}
    earlier = [
        axes.plot([], [], alpha=0.7 * 0.7**k, zorder=3, gid="earlier path", **grey)[0]
        for k in range(_EARLIER)
    ]
    (path,) = axes.plot([], [], lw=2.0, zorder=5, marker="o", ms=3.5, gid="path", **look)
    red: dict[str, Any] = {"lw": 2.4, "color": kit.RED}
    (within,) = axes.plot([], [], zorder=6, gid="path through what is blocked", **red)
    keys = [kit.key("best so far", lw=2.0, **look), kit.key("before", **grey)]
    stage.legend_above(axes, [*keys, kit.key("blocked", **red)])

    def show_frame(frame: int) -> str:
        frame = min(frame, len(lines) - 1)
        path.set_data(*(lines[frame] * scale).T)
        within.set_data(*(_blocked_part(function, lines[frame]) * scale).T)
        for k, line in enumerate(earlier):
            index = frame - 1 - k
            line.set_data(*(lines[index] * scale).T if index >= 0 else ([], []))
        return f"value {kit.number(steps[frame].objective)} after {steps[frame].seconds:.2f} s"

    return stage.play(show_frame, len(lines))
