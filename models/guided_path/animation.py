"""Animation of a guided vehicle's tour."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..fields import required
from ..plots.animation import Stage, play
from ..plots.maps import length_unit
from ..plots.options import check_frames
from ..plots.space import dots
from ..plots.style import BLACK, DARK, GREY, headline, key, legend_row, number, sheet
from .drawn import dress_line, dress_walk, groups_of, look_of, walk_of
from .model import GuidedPathTour
from .plan import GuidedPathPlan

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation

__all__ = ["animate_tour"]

#: Colour of customers that are not served yet.
_WAITING = "#d9d9d9"


def animate_tour(
    model: GuidedPathTour,
    plan: GuidedPathPlan | Any,
    *,
    frames: int = 120,
    interval: float = 60.0,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> FuncAnimation:
    """Return an animation of the tour: the vehicle on its line, its path, and the customers served.

    Parameters
    ----------
    model : GuidedPathTour
        The model.
    plan : GuidedPathPlan or Solution
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
        ``animate_tour(model, plan).save("tour.gif", writer="pillow", dpi=80)``.

    Raises
    ------
    InvalidData
        The plan has another type, or contains an unknown customer.
    UnsupportedOption
        An option has a value that is not allowed.
    """
    check_frames(frames, interval)
    plan = required("plan", model.as_plan(plan), GuidedPathPlan)
    model.verify(plan)  # rejects an unknown customer
    walk = walk_of(model, plan)
    figure = sheet(size, (6.0, 5.0))
    broad, tall = figure.get_size_inches()
    axes = figure.add_axes((0.8 / broad, 1.0 / tall, 1 - 1.0 / broad, 1 - 1.4 / tall))
    scale, unit = length_unit(float(np.ptp(model.coordinates)))
    dress_line(axes, model, scale)
    at = dress_walk(axes, walk, scale)
    axes.set_xlabel(f"position ({unit})", fontsize=8.5)
    text = (model.name or model.describe()) if title is None else title
    headline(figure, text, wrong=False)
    clock = figure.text(0.5, 0.1 / tall, "", ha="center", fontsize=9, color=DARK)

    colours = np.full(model.size, look_of(-1)["color"], object)
    for k, group in enumerate(groups_of(model)):
        colours[list(group)] = look_of(k)["color"]
    own = colours[walk.stops[1:-1]]
    axes.plot(*at.T, lw=0.7, ls=":", color=GREY, zorder=2)
    (way,) = axes.plot([], [], lw=1.6, color=DARK, zorder=4, gid="way")
    (vehicle,) = axes.plot([], [], "s", ms=8, mfc="white", mec=BLACK, mew=1.4, zorder=8)
    customers = dots(axes, at[1:-1], "o", _WAITING, size=22, zorder=6, gid="customer")
    keys = [key("vehicle", marker="s", mfc="white", mec=BLACK, mew=1.4, ms=6)]
    keys.append(key("to be served", marker="o", color=_WAITING, ms=5))
    legend_row(figure, keys, "lower center", (0.5, 0.28 / tall))
    ends = np.linspace(0.0, walk.walked[-1], frames)

    def update(frame: int) -> list[Any]:
        # The tolerance covers the rounding of the distance walked.
        done = walk.walked <= ends[frame] * (1 + 1e-12)
        here = [np.interp(ends[frame], walk.walked, column) for column in at.T]
        if done.all():
            here = at[-1].tolist()
        way.set_data(*np.concatenate([at[done], [here]]).T)
        vehicle.set_data(*([value] for value in here))
        customers.set_facecolors(list(np.where(done[1:-1], own, _WAITING)))
        count = int(done[1:-1].sum())
        clock.set_text(
            f"{number(float(ends[frame]), 4)} m of {number(float(walk.walked[-1]), 6)} m, "
            f"{count} of {len(own)} served"
        )
        return [way, vehicle, customers, clock]

    return play(Stage(figure, axes, scale, clock), update, frames, interval)
