"""A run on an unknown grid in motion: what is known grows as the vehicle goes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..fields import required
from ..plots.animation import Stage, play
from ..plots.options import check_frames
from ..plots.style import DARK, headline, legend_below, sheet
from .drawn import Moment, box_around, check_scene, keys_of, walk_of
from .layout import is_square, proportion
from .model import UnknownGridNavigation
from .plan import NavigationRuns

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation

__all__ = ["animate_run"]


def animate_run(
    model: UnknownGridNavigation,
    plan: NavigationRuns | Any,
    *,
    scene: int = 0,
    frames: int = 120,
    interval: float = 150.0,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> FuncAnimation:
    """Return the run of one scene in motion: vehicle, UAV, its view, and what was seen so far.

    Of maps of more than 60 cells along a side the part around the vehicle is shown.

    Parameters
    ----------
    model : UnknownGridNavigation
        The model, with its true maps.
    plan : NavigationRuns or Solution
        A plan for it, valid or not.
    scene : int
        Which scene.
    frames : int
        Number of pictures at the most, at least 2; where there are more steps, some are left out.
    interval : float
        Time from one to the next, ms.
    title : str, optional
        Instead of the name.
    size : (float, float), optional
        Width and height (inch).

    Returns
    -------
    matplotlib.animation.FuncAnimation
        Tied to no window: ``animate_run(model, plan).save("run.gif", writer="pillow", dpi=80)``;
        ``to_jshtml()`` returns a page.

    Raises
    ------
    HiddenData
        The model is as backends see it, without its true maps.
    InvalidData
        The plan is none of this model.
    UnsupportedOption
        An option has a value that is not allowed.
    """
    check_frames(frames, interval)
    scene = check_scene(model, scene)
    runs = required("plan", model.as_plan(plan), NavigationRuns)
    model.verify(runs)  # raises where there are not as many runs as scenes
    walk = walk_of(model, runs, scene)
    steps = np.unique(np.linspace(0, walk.steps, frames).round().astype(int)).tolist()
    box = box_around(model, walk.positions[0])
    ratio = proportion(box)
    wide = min(4.2, 4.2 * ratio)
    figure = sheet(size, (max(wide, 4.2) + 0.4, wide / ratio + 1.35))
    broad, tall = figure.get_size_inches()
    height = max(tall - 1.3, 0.5 * tall)
    axes = figure.add_axes((0.2 / broad, 0.88 / tall, 1 - 0.4 / broad, height / tall))
    axes.set_aspect("equal" if is_square(box) else "auto")
    axes.set_xticks([])
    axes.set_yticks([])
    headline(figure, (model.name or model.describe()) if title is None else title, wrong=False)
    keys = keys_of(walk, moving=True)
    legend_below(figure, keys, rows=3)
    clock = figure.text(0.5, 0.68 / tall, "", ha="center", fontsize=9, color=DARK)
    cell = min((broad - 0.4) / float(box.size[1]), height / float(box.size[0]))
    moment = Moment(axes, model, scene, walk, float(np.clip(0.62 * 72 * cell, 3.5, 9.0)))

    def update(frame: int) -> list[Any]:
        step = steps[min(frame, len(steps) - 1)]
        moment.show(step)
        ended = f": {walk.outcome}" if step == walk.steps else ""
        clock.set_text(f"step {step} of {walk.steps}{ended}")
        return []

    return play(Stage(figure, axes, 1.0, clock), update, len(steps), interval)
