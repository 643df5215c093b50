"""Animation of a messenger tour."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..fields import required
from ..plots.animation import play, stage_of
from ..plots.options import check_frames
from ..plots.space import dots
from ..plots.style import BLACK, GREY, axis_style, key, legend_row
from .model import MessengerTour
from .plan import TourPlan
from .sampling import outline, track

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation

__all__ = ["animate_tour"]

_WAITING, _MET, _PATH = axis_style(1)["color"], axis_style(2)["color"], axis_style(0)["color"]


def animate_tour(
    model: MessengerTour,
    plan: TourPlan | Any,
    *,
    frames: int = 120,
    interval: float = 60.0,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> FuncAnimation:
    """Return an animation of the tour: the UAV, its path so far, and the vehicles with their discs.

    Parameters
    ----------
    model : MessengerTour
        The model.
    plan : TourPlan or Solution
        Plan of the model. It may be infeasible.
    frames : int
        Number of frames, at least 2.
    interval : float
        Time between two frames, in ms.
    title : str, optional
        Title of the animation. Default: the name of the model, or its size.
    size : (float, float), optional
        Width and height, in inches.

    Returns
    -------
    matplotlib.animation.FuncAnimation
        Animation without a window. Save it with
        ``animate_tour(model, plan).save("tour.gif", writer="pillow", dpi=80)``, or call
        ``to_jshtml()`` for a page.

    Raises
    ------
    InvalidData
        The plan has another type, or contains an unknown vehicle.
    UnsupportedOption
        An option has a value that is not allowed.
    """
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Circle

    check_frames(frames, interval)
    plan = required("plan", model.as_plan(plan), TourPlan)
    model.verify(plan)  # rejects an unknown vehicle
    end = plan.length / model.speed
    times = np.linspace(0.0, end, frames)
    path = outline(plan, model.turning_radius)
    flown = track(plan, model.turning_radius, times * model.speed).poses
    order = list(plan.order)
    meetings = model.positions[order] + model.velocities[order] * plan.times[:, None]
    reach = model.radius[order][:, None]
    # Vehicles may leave the map after their encounter.
    shown = np.concatenate([path.poses[:, :2], model.positions, meetings - reach, meetings + reach])
    low, high = shown.min(axis=0), shown.max(axis=0)
    met_at = np.full(model.size, np.inf)
    met_at[order] = plan.times

    text = (model.name or model.describe()) if title is None else title
    stage = stage_of(low, high, title=text, size=size)
    axes, scale = stage.axes, stage.scale
    axes.plot(*(path.poses[:, :2] * scale).T, lw=0.7, ls=":", color=GREY, zorder=2)
    (way,) = axes.plot([], [], lw=1.8, color=_PATH, zorder=4, gid="path")
    (craft,) = axes.plot([], [], ls="", ms=11, mfc="white", mec=BLACK, mew=1.4, zorder=8)
    vehicles = dots(axes, model.positions * scale, "s", _WAITING, size=16, zorder=6)
    discs = PatchCollection([], lw=0.7, alpha=0.28, zorder=3, gid="disc")
    axes.add_collection(discs, autolim=False)
    keys = [key("to be met", marker="s", color=_WAITING, ms=4.5)]
    keys.append(key("met", marker="s", color=_MET, ms=4.5))
    legend_row(axes, keys, "lower right", (1.0, 0.98))

    def update(frame: int) -> list[Any]:
        time, (x, y, heading) = times[frame], flown[frame].tolist()
        # The tolerance covers the rounding of the encounter's time.
        colours = [_MET if when <= time + 1e-9 * end else _WAITING for when in met_at]
        places = (model.positions + model.velocities * time) * scale
        vehicles.set_offsets(places)
        vehicles.set_facecolor(colours)
        radius = model.radius * scale
        discs.set_paths([Circle((a, b), r) for (a, b), r in zip(places, radius, strict=True)])
        discs.set_facecolor(colours)
        discs.set_edgecolor(colours)
        done = path.poses[path.flown <= time * model.speed, :2]
        way.set_data(*(np.concatenate([done, [[x, y]]]) * scale).T)
        craft.set_data([x * scale], [y * scale])
        craft.set_marker((3, 0, np.rad2deg(heading) - 90))
        count = colours.count(_MET)
        stage.clock.set_text(f"t = {time:.2f} s of {end:.2f} s, {count} of {model.size} met")
        return [way, craft, vehicles, discs, stage.clock]

    return play(stage, update, frames, interval)
