"""Animation of a mission, and its background of obstacles."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..fields import required
from ..grid_path import as_shapely
from ..plots import kit
from .drawn import sample_times
from .model import FleetMission
from .plan import MissionPlan

__all__ = ["animate_mission", "draw_field"]

#: Colour of the area closer to an obstacle than a robot's radius.
_NEAR = "#ececec"


def draw_field(axes: Any, model: FleetMission, scale: float) -> list[Any]:
    """Draw the obstacles, their safety margin and the bounds; return legend entries."""
    import shapely
    from matplotlib.patches import Rectangle

    keys = []
    if model.radius > 0 and len(model.solids.parts):
        grown = shapely.union_all(shapely.buffer(model.solids.parts, model.radius))
        near = {"fc": _NEAR, "ec": "none", "zorder": 0.6, "gid": "too near"}
        kit.draw_polygons(axes, shapely.get_parts(grown), scale, **near)
        keys.append(kit.key("nearer than the radius", marker="s", color=_NEAR, ms=7))
    look = {"fc": kit.BLOCKED, "ec": kit.GREY, "lw": 0.7, "zorder": 0.8, "gid": "obstacle"}
    kit.draw_polygons(axes, as_shapely(model.obstacles), scale, **look)
    low, high = (model.bounds * scale).reshape(2, 2).tolist()
    size = np.subtract(high, low)
    edge = Rectangle(
        (low[0], low[1]), *size, fc="none", ec=kit.GREY, lw=0.8, zorder=0.9, gid="bounds"
    )
    axes.add_patch(edge)
    return [kit.key("obstacle", marker="s", mfc=kit.BLOCKED, mec=kit.GREY, ms=7), *keys]


def animate_mission(
    model: FleetMission,
    plan: MissionPlan | Any,
    *,
    frames: int = 120,
    interval: float = 60.0,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.FuncAnimation:
    """Animate a mission: the robots to scale, and their paths so far.

    Parameters
    ----------
    model : FleetMission
        The model.
    plan : MissionPlan or Solution
        A plan for the model.
    frames : int
        Number of frames, at least 2.
    interval : float
        Time between frames, ms.
    title : str, optional
        Title; by default the name.
    size : (float, float), optional
        Width and height (inch).

    Returns
    -------
    matplotlib.animation.FuncAnimation
        The animation, independent of any window. Save it with
        ``animate_mission(model, plan).save("mission.gif", writer="pillow")``; ``to_jshtml()`` returns
        a page.

    Raises
    ------
    InvalidData
        The plan is not a mission plan, or names a node that does not exist.
    UnsupportedOption
        An option has an invalid value.
    """
    stage = kit.Stage(model, title, size, frames, interval)
    plan = required("plan", model.as_plan(plan), MissionPlan)
    model.verify(plan)  # raises for nodes that do not exist
    robots = [(k, item) for k, item in enumerate(plan.trajectories) if item is not None]
    flown, looks = [item for _, item in robots], [kit.colour_of(k) for k, _ in robots]
    curves = [(sample_times(item), item(sample_times(item))) for item in flown]
    times = np.linspace(0.0, plan.end, frames)
    visited = np.full(len(model.nodes), np.inf)
    faces = [kit.DARK] * len(model.nodes)
    for k, (route, when) in enumerate(zip(plan.routes, plan.visits, strict=True)):
        visited[list(route)] = when
        for node in route:
            faces[node] = kit.colour_of(k)

    everything = np.concatenate([model.bounds.reshape(2, 2), *(curve for _, curve in curves)])
    axes, scale = stage.map(everything.min(axis=0), everything.max(axis=0))
    keys = draw_field(axes, model, scale)
    lines = [curve * scale for _, curve in curves]
    kit.draw_routes(
        axes, lines, gid="planned", colors=looks, lw=0.6, linestyles="dotted", alpha=0.7
    )
    ways = [axes.plot([], [], lw=1.8, color=look, zorder=4, gid="path")[0] for look in looks]
    white: dict[str, Any] = {"edge": kit.BLACK, "width": 0.8, "zorder": 6, "gid": "node"}
    nodes = kit.dots(axes, model.nodes * scale, "o", "white", size=24, **white)
    kit.dots(
        axes, model.depot[None] * scale, "s", "white", size=46, edge=kit.BLACK, width=1.4, zorder=5
    )
    body: dict[str, Any] = {"edgecolors": kit.BLACK, "lw": 0.8, "zorder": 8, "gid": "robot"}
    bodies = kit.draw_circles(axes, np.empty((0, 2)), [], facecolors=looks, **body)
    # Smaller discs would be invisible.
    reach = max(model.radius * scale, 0.011 * float(np.ptp(axes.get_xlim())))
    keys += [kit.key("to visit", marker="o", mfc="white", mec=kit.BLACK, ms=5)]
    stage.legend_above(axes, [*keys, kit.key("visited", marker="o", color=kit.DARK, ms=5)])

    def show(frame: int) -> str:
        time = float(times[frame])
        places = [item(np.clip(time, item.times[0], item.times[-1])) for item in flown]
        for item, way, here, (instants, curve) in zip(flown, ways, places, curves, strict=True):
            done = np.concatenate([curve[instants <= time], here[None]])
            way.set_data(*(done * scale).T if time >= item.times[0] else ([], []))
        bodies.set_paths(kit.circles(np.reshape(places, (-1, 2)) * scale, [reach] * len(places)))
        # The tolerance absorbs rounding of frame times at a visit.
        met = visited <= time + 1e-9 * plan.end
        nodes.set_facecolor(np.where(met, faces, "white").tolist())
        count = f"{int(met.sum())} of {len(model.nodes)} nodes visited"
        return f"t = {time:.2f} s of {plan.end:.2f} s, {count}"

    return stage.play(show)
