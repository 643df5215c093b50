"""Animation of a mission, and its background of obstacles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..fields import required
from ..grid_path import as_shapely
from ..plots.animation import play, stage_of
from ..plots.maps import BLOCKED, draw_polygons
from ..plots.options import check_frames
from ..plots.routes import draw_routes
from ..plots.space import dots
from ..plots.style import BLACK, DARK, GREY, axis_style, key, legend_row
from .drawn import sample_times
from .model import FleetMission
from .plan import MissionPlan

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation

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
        draw_polygons(axes, shapely.get_parts(grown), scale, **near)
        keys.append(key("nearer than the radius", marker="s", color=_NEAR, ms=7))
    look = {"fc": BLOCKED, "ec": GREY, "lw": 0.7, "zorder": 0.8, "gid": "obstacle"}
    draw_polygons(axes, as_shapely(model.obstacles), scale, **look)
    low, high = (model.bounds * scale).reshape(2, 2).tolist()
    size = np.subtract(high, low)
    edge = Rectangle((low[0], low[1]), *size, fc="none", ec=GREY, lw=0.8, zorder=0.9, gid="bounds")
    axes.add_patch(edge)
    return [key("obstacle", marker="s", mfc=BLOCKED, mec=GREY, ms=7), *keys]


def animate_mission(
    model: FleetMission,
    plan: MissionPlan | Any,
    *,
    frames: int = 120,
    interval: float = 60.0,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> FuncAnimation:
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
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Circle

    check_frames(frames, interval)
    plan = required("plan", model.as_plan(plan), MissionPlan)
    model.verify(plan)  # raises for nodes that do not exist
    flown = [one for one in plan.trajectories if one is not None]
    robots = [k for k, one in enumerate(plan.trajectories) if one is not None]
    looks = [axis_style(k)["color"] for k in robots]
    curves = [(sample_times(one), one(sample_times(one))) for one in flown]
    times = np.linspace(0.0, plan.end, frames)
    visited = np.full(len(model.nodes), np.inf)
    faces = [DARK] * len(model.nodes)
    for k, (route, when) in enumerate(zip(plan.routes, plan.visits, strict=True)):
        visited[list(route)] = when
        for node in route:
            faces[node] = axis_style(k)["color"]

    everything = np.concatenate([model.bounds.reshape(2, 2), *(curve for _, curve in curves)])
    text = (model.name or model.describe()) if title is None else title
    stage = stage_of(everything.min(axis=0), everything.max(axis=0), title=text, size=size)
    axes, scale = stage.axes, stage.scale
    keys = draw_field(axes, model, scale)
    lines = [curve * scale for _, curve in curves]
    draw_routes(axes, lines, gid="planned", colors=looks, lw=0.6, linestyles="dotted", alpha=0.7)
    ways = [axes.plot([], [], lw=1.8, color=one, zorder=4, gid="path")[0] for one in looks]
    nodes = dots(
        axes,
        model.nodes * scale,
        "o",
        "white",
        size=24,
        edge=BLACK,
        width=0.8,
        zorder=6,
        gid="node",
    )
    dots(axes, model.depot[None] * scale, "s", "white", size=46, edge=BLACK, width=1.4, zorder=5)
    bodies = PatchCollection([], facecolors=looks, edgecolors=BLACK, lw=0.8, zorder=8, gid="robot")
    axes.add_collection(bodies, autolim=False)
    # Smaller discs would be invisible.
    reach = max(model.radius * scale, 0.011 * float(np.ptp(axes.get_xlim())))
    keys += [key("to visit", marker="o", mfc="white", mec=BLACK, ms=5)]
    keys += [key("visited", marker="o", color=DARK, ms=5)]
    legend_row(axes, keys, "lower right", (1.0, 0.98))

    def update(frame: int) -> list[Any]:
        time = float(times[frame])
        discs = []
        for one, way, (instants, curve) in zip(flown, ways, curves, strict=True):
            here = one(np.clip(time, one.times[0], one.times[-1]))
            done = np.concatenate([curve[instants <= time], here[None]])
            way.set_data(*(done * scale).T if time >= one.times[0] else ([], []))
            discs.append(Circle((here[0] * scale, here[1] * scale), reach))
        bodies.set_paths(discs)
        # The tolerance absorbs rounding of frame times at a visit.
        met = visited <= time + 1e-9 * plan.end
        nodes.set_facecolor(
            [face if done else "white" for face, done in zip(faces, met, strict=True)]
        )
        count = int(met.sum())
        stage.clock.set_text(
            f"t = {time:.2f} s of {plan.end:.2f} s, {count} of {len(model.nodes)} nodes visited"
        )
        return [*ways, bodies, nodes, stage.clock]

    return play(stage, update, frames, interval)
