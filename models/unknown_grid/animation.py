"""Animation of a run on an unknown grid."""

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
    """Animate the run of one scene: vehicle, UAV, its view, and the cells seen so far.

    If a side of the map has more than 60 cells, only the part around the vehicle is shown.

    Parameters
    ----------
    model : UnknownGridNavigation
        Model with its true maps.
    plan : NavigationRuns or Solution
        Plan of the model, valid or not.
    scene : int, default 0
        Index of the scene.
    frames : int, default 120
        Maximum number of frames, at least 2. Longer runs skip steps.
    interval : float, default 150
        Time between frames, ms.
    title : str, optional
        Title that replaces the name of the model.
    size : (float, float), optional
        Width and height of the figure, inches.

    Returns
    -------
    matplotlib.animation.FuncAnimation
        Animation without a window. Save it with
        ``animate_run(model, plan).save("run.gif", writer="pillow", dpi=80)``, or call
        ``to_jshtml()`` for an HTML page.

    Raises
    ------
    HiddenData
        The model is a backend's view, without the true maps.
    InvalidData
        The plan does not fit the model.
    UnsupportedOption
        An option is outside its allowed range.
    """
    check_frames(frames, interval)
    scene = check_scene(model, scene)
    runs = required("plan", model.as_plan(plan), NavigationRuns)
    model.verify(runs)  # raises if the numbers of runs and scenes differ
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
