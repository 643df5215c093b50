"""Animation of messenger tours."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..fields import required
from ..plots import kit
from .model import MessengerTour
from .plan import TourPlan
from .plot_fields import draw_fields, zone_places
from .plot_places import Drawn
from .sampling import track

__all__ = ["animate_tour"]

_PATH, _WAITING, _MET = map(kit.colour_of, range(3))


@kit.documented
def animate_tour(
    model: MessengerTour,
    plan: TourPlan | Any,
    *,
    frames: int = 120,
    interval: float = 60.0,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.FuncAnimation:
    """Return an animation of the tour: the UAV, its path so far, and the vehicles with their discs."""
    stage = kit.Stage(model, title, size, frames, interval)
    plan = required("plan", model.as_plan(plan), TourPlan)
    result = model.verify(plan)  # rejects an unknown vehicle
    tours = [Drawn(model, part, result, uav) for uav, part in enumerate(plan.parts())]
    end = plan.length / model.speed
    times = np.linspace(0.0, end, frames)
    flown = [
        track(tour.plan, model.turning_radius, times * model.speed, model.drift).poses
        for tour in tours
    ]
    met_at = np.full(model.size, np.inf)
    met_at[np.array(plan.order, int)] = plan.times
    # Vehicles may leave the map after their encounter.
    everything = np.concatenate([zone_places(model), *(tour.everything for tour in tours)])
    axes, scale = stage.map(everything.min(axis=0), everything.max(axis=0))
    draw_fields(model, plan, axes, scale)
    ways, crafts = [], []
    for tour in tours:
        path = tour.path.poses[:, :2] * scale
        axes.plot(*path.T, lw=0.7, ls=":", color=kit.GREY, zorder=2)
        ways += axes.plot([], [], lw=1.8, color=_PATH, zorder=4, gid="path")
        look: dict[str, Any] = {"ms": 11, "mfc": "white", "mec": kit.BLACK, "mew": 1.4, "zorder": 8}
        crafts += axes.plot([], [], ls="", **look)
    vehicles = kit.dots(axes, model.positions * scale, "s", _WAITING, size=16, zorder=6)
    discs = kit.draw_circles(axes, np.empty((0, 2)), [], lw=0.7, alpha=0.28, zorder=3, gid="disc")
    words = {"to be met": _WAITING, "met": _MET}
    keys = [kit.key(word, marker="s", color=look, ms=4.5) for word, look in words.items()]
    stage.legend_above(axes, keys)

    def show(frame: int) -> str:
        time = times[frame]
        # The tolerance covers the rounding of the encounter's time.
        colours = [_MET if when <= time + 1e-9 * end else _WAITING for when in met_at]
        places = (model.positions + model.velocities * time) * scale
        vehicles.set_offsets(places)
        discs.set_paths(kit.circles(places, model.radius * scale))
        for artist in (vehicles, discs):
            artist.set_facecolor(colours)
        discs.set_edgecolor(colours)
        for tour, poses, way, craft in zip(tours, flown, ways, crafts, strict=True):
            x, y, heading = poses[frame].tolist()
            done = tour.path.poses[tour.path.flown <= time * model.speed, :2]
            way.set_data(*(np.concatenate([done, [[x, y]]]) * scale).T)
            craft.set_data([x * scale], [y * scale])
            craft.set_marker(kit.heading_marker(heading))
        return f"t = {time:.2f} s of {end:.2f} s, {colours.count(_MET)} of {model.size} met"

    return stage.play(show)
