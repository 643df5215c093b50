"""Animation of a messenger tour."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..fields import required
from ..plots import kit
from .model import MessengerTour
from .plan import TourPlan
from .sampling import outline, track

__all__ = ["animate_tour"]

_PATH, _WAITING, _MET = map(kit.colour_of, range(3))


def animate_tour(
    model: MessengerTour,
    plan: TourPlan | Any,
    *,
    frames: int = 120,
    interval: float = 60.0,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.FuncAnimation:
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
    stage = kit.Stage(model, title, size, frames, interval)
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
    met_at = np.full(model.size, np.inf)
    met_at[order] = plan.times

    axes, scale = stage.map(shown.min(axis=0), shown.max(axis=0))
    axes.plot(*(path.poses[:, :2] * scale).T, lw=0.7, ls=":", color=kit.GREY, zorder=2)
    (way,) = axes.plot([], [], lw=1.8, color=_PATH, zorder=4, gid="path")
    (craft,) = axes.plot([], [], ls="", ms=11, mfc="white", mec=kit.BLACK, mew=1.4, zorder=8)
    vehicles = kit.dots(axes, model.positions * scale, "s", _WAITING, size=16, zorder=6)
    discs = kit.draw_circles(axes, np.empty((0, 2)), [], lw=0.7, alpha=0.28, zorder=3, gid="disc")
    words = (("to be met", _WAITING), ("met", _MET))
    stage.legend_above(
        axes, [kit.key(word, marker="s", color=look, ms=4.5) for word, look in words]
    )

    def show(frame: int) -> str:
        time, (x, y, heading) = times[frame], flown[frame].tolist()
        # The tolerance covers the rounding of the encounter's time.
        colours = [_MET if when <= time + 1e-9 * end else _WAITING for when in met_at]
        places = (model.positions + model.velocities * time) * scale
        vehicles.set_offsets(places)
        discs.set_paths(kit.circles(places, model.radius * scale))
        for artist in (vehicles, discs):
            artist.set_facecolor(colours)
        discs.set_edgecolor(colours)
        done = path.poses[path.flown <= time * model.speed, :2]
        way.set_data(*(np.concatenate([done, [[x, y]]]) * scale).T)
        craft.set_data([x * scale], [y * scale])
        craft.set_marker(kit.heading_marker(heading))
        return f"t = {time:.2f} s of {end:.2f} s, {colours.count(_MET)} of {model.size} met"

    return stage.play(show)
