"""Animation of a run on an unknown grid."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..fields import required
from ..plots import kit
from .drawn import Moment, box_around, check_scene, keys_of, walk_of
from .layout import is_square, proportion
from .model import UnknownGridNavigation
from .plan import NavigationRuns

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
) -> kit.FuncAnimation:
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
    scene = check_scene(model, scene)
    box = box_around(model, model.starts[scene])
    ratio = proportion(box)
    wide = min(4.2, 4.2 * ratio)
    default = max(wide, 4.2) + 0.4, wide / ratio + 1.35
    stage = kit.Stage(model, title, size, frames, interval, default, clock=0.68)
    runs = required("plan", model.as_plan(plan), NavigationRuns)
    model.verify(runs)  # raises if the numbers of runs and scenes differ
    walk = walk_of(model, runs, scene)
    steps = np.unique(np.linspace(0, walk.steps, frames).round().astype(int)).tolist()
    height = max(stage.tall - 1.3, 0.5 * stage.tall)
    axes = stage.box(0.2, 0.88, stage.broad - 0.4, height)
    axes.set_aspect("equal" if is_square(box) else "auto")
    stage.legend(keys_of(walk, moving=True), 3)
    cell = min((stage.broad - 0.4) / float(box.size[1]), height / float(box.size[0]))
    moment = Moment(axes, model, scene, walk, float(np.clip(0.62 * 72 * cell, 3.5, 9.0)))

    def show(frame: int) -> str:
        step = steps[min(frame, len(steps) - 1)]
        moment.show(step)
        return f"step {step} of {walk.steps}{f': {walk.outcome}' if step == walk.steps else ''}"

    return stage.play(show, len(steps))
