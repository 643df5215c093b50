"""Animation of a guided vehicle's tour."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..fields import required
from ..plots import kit
from .drawn import dress_line, dress_walk, groups_of, look_of, walk_of
from .model import GuidedPathTour
from .plan import GuidedPathPlan

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
) -> kit.FuncAnimation:
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
    stage = kit.Stage(model, title, size, frames, interval, (6.0, 5.0))
    plan = required("plan", model.as_plan(plan), GuidedPathPlan)
    model.verify(plan)  # rejects an unknown customer
    walk = walk_of(model, plan)
    axes = stage.axes(0.8, 1.0, 0.2, stage.head)
    scale = dress_line(axes, model, labelled=True)
    at = dress_walk(axes, walk, scale)
    colours = np.full(model.size, look_of(-1)["color"], object)
    for k, group in enumerate(groups_of(model)):
        colours[list(group)] = look_of(k)["color"]
    served = colours[walk.stops[1:-1]]
    axes.plot(*at.T, lw=0.7, ls=":", color=kit.GREY, zorder=2)
    (way,) = axes.plot([], [], lw=1.6, color=kit.DARK, zorder=4, gid="way")
    look: dict[str, Any] = {"marker": "s", "mfc": "white", "mec": kit.BLACK, "mew": 1.4}
    (vehicle,) = axes.plot([], [], ls="", ms=8, zorder=8, gid="vehicle", **look)
    customers = kit.dots(axes, at[1:-1], "o", _WAITING, size=22, zorder=6, gid="customer")
    keys = [
        kit.key("vehicle", ms=6, **look),
        kit.key("to be served", marker="o", color=_WAITING, ms=5),
    ]
    stage.legend(keys, 1, y=0.28)
    ends = np.linspace(0.0, walk.walked[-1], frames)

    def show(frame: int) -> str:
        # The tolerance covers the rounding of the distance walked.
        done = walk.walked <= ends[frame] * (1 + 1e-12)
        here = [np.interp(ends[frame], walk.walked, column) for column in at.T]
        if done.all():
            here = at[-1].tolist()
        way.set_data(*np.concatenate([at[done], [here]]).T)
        vehicle.set_data(*([value] for value in here))
        customers.set_facecolors(list(np.where(done[1:-1], served, _WAITING)))
        walked = (
            f"{kit.number(float(ends[frame]), 4)} m of {kit.number(float(walk.walked[-1]), 6)} m"
        )
        return f"{walked}, {int(done[1:-1].sum())} of {len(served)} served"

    return stage.play(show)
