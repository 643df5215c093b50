"""Figures with a title, panels placed in inches and a legend, and their animation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..fields import required
from ..verification import TOLERANCE, Verification, check_tolerance
from .layers import dress_map
from .options import check_frames, check_option
from .style import DARK, LINE, headline, inches, legend_row, legend_rows, number, sheet

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from matplotlib.figure import Figure

__all__ = [
    "Frame", "Named", "Scene", "Stage", "color_bar", "is_wrong", "label_plans", "name_plans",
    "verified_plan",
]  # fmt: skip

#: Height of the space for a title of one line (inch).
_HEAD = 0.46


class Frame:
    """Figure, or part of one, whose panels have margins in inches."""

    def __init__(self, figure: Any) -> None:
        self.figure = figure
        self.broad, self.tall = inches(figure)

    def axes(self, left: float, foot: float, right: float, head: float, **look: Any) -> Any:
        """Return axes with these distances from the edges of the frame (inch)."""
        wide, high = self.broad - left - right, self.tall - foot - head
        return self.box(left, foot, wide, high, **look)

    def box(self, left: float, foot: float, wide: float, high: float, **look: Any) -> Any:
        """Return axes of a width and height, from their lower left corner (inch)."""
        place = np.divide((left, foot, wide, high), (self.broad, self.tall) * 2)
        return self.figure.add_axes(tuple(place.tolist()), **look)

    def legend(
        self, keys: Sequence[Any], rows: int | None = None, *, x: float | None = None, y: float = 0.08
    ) -> None:  # fmt: skip
        """Write a legend around `x`, `y` above the foot (inch); by default in the middle.

        By default, it has as many rows as it needs.
        """
        place = (0.5 if x is None else x / self.broad, y / self.tall)
        rows = legend_rows(keys, self.broad) if rows is None else rows
        legend_row(self.figure, keys, "lower center", place, rows=rows)


class Scene(Frame):
    """Figure with a title, which is red if the plan is not valid.

    `text` is the title, see :func:`.style.title_of`; `result` the verification of the plan; `size` the option of the
    picture, and `default` the size without it (inch). `wrong` states that the plan is not valid for another reason.
    """

    figure: Figure

    def __init__(
        self, text: str, result: Verification | None, size: Any, default: tuple[float, float], *,
        wrong: bool = False,
    ) -> None:  # fmt: skip
        super().__init__(sheet(size, default))
        self.title, self.wrong = text, wrong or is_wrong(result)
        #: Height of the space for the title (inch).
        self.head = _HEAD + LINE * text.count("\n")
        headline(self.figure, text, wrong=self.wrong)

    def halves(self, left: float, right: float) -> tuple[Frame, Frame]:
        """Return the left and the right part of the figure, whose widths have this ratio."""
        parts: Any = self.figure.subfigures(1, 2, width_ratios=[left, right], wspace=0.0)
        return Frame(parts[0]), Frame(parts[1])


class Stage(Scene):
    """Animation: a figure with a clock at its foot.

    The default title is the name of `model`. `title`, `size`, `frames` and `interval` are options of the animation;
    `clock` is the height of the clock above the foot (inch).
    """

    def __init__(
        self, model: Any, title: str | None, size: Any, frames: Any, interval: Any,
        default: tuple[float, float] = (6.4, 6.0), *, clock: float = 0.1,
    ) -> None:  # fmt: skip
        check_frames(frames, interval)
        text = (model.name or model.outline()) if title is None else title
        super().__init__(text, None, size, default)
        self.frames, self.interval = frames, interval
        place = (0.5, clock / self.tall)
        self.clock = self.figure.text(*place, "", ha="center", fontsize=9, color=DARK)

    def map(self, low: NDArray[Any], high: NDArray[Any]) -> tuple[Any, float]:
        """Return a map of a box (m), and the factor from metres to the unit of its axes."""
        axes = self.axes(0.72, 0.72, 0.18, self.head)
        return axes, dress_map(axes, low, high)

    def legend_above(self, axes: Any, keys: Sequence[Any]) -> None:
        """Write a legend in the upper right corner of a map, above its frame."""
        legend_row(axes, keys, "lower right", (1.0, 0.98))

    def play(self, show: Callable[[int], str], frames: int | None = None) -> FuncAnimation:
        """Return the animation; `show` draws a frame and returns the text of the clock."""
        from matplotlib.animation import FuncAnimation

        def update(frame: int) -> list[Any]:
            self.clock.set_text(show(frame))
            return [self.clock]

        # Draw the first frame at once, so that the figure is complete even if it is never played.
        update(0)
        count = self.frames if frames is None else frames
        result = FuncAnimation(
            self.figure, update, frames=count, interval=self.interval, blit=False
        )
        result.motion = Motion(  # type: ignore[attr-defined]
            self.figure, update, count, self.interval, self.clock
        )
        return result


class Motion(NamedTuple):
    """Parts of an animation: figure, function of the frame, number and duration (ms) of frames, and clock."""

    figure: Figure
    update: Callable[[int], Any]
    frames: int
    interval: float
    clock: Any


def color_bar(figure: Any, artist: Any, place: Any, label: str, **look: Any) -> Any:
    """Return the colour scale of `artist` in the axes `place`."""
    bar = figure.colorbar(artist, cax=place, **look)
    bar.set_label(label, fontsize=8.5)
    bar.ax.tick_params(labelsize=8)
    bar.outline.set_visible(False)
    return bar


class Named(NamedTuple):
    """Plan with its name and its verification."""

    name: str
    plan: Any
    result: Verification


def is_wrong(result: Verification | None) -> bool:
    """Return whether the plan violates a constraint."""
    return result is not None and not result.ok


def verified_plan(model: Any, plan: Any, kind: type, tolerance: float) -> Verification | None:
    """Return the verification of a plan of type `kind`, None for None."""
    check_tolerance(tolerance)
    if plan is None:
        return None
    result: Verification = model.verify(required("plan", plan, kind), tolerance=tolerance)
    return result


def name_plans(
    model: Any, plan: Any, others: Any, kind: type, *, name: str, most: int, tolerance: float = TOLERANCE
) -> list[Named]:  # fmt: skip
    """Return `plan`, if there is one, under `name`, and then the plans of the option `others`.

    The option holds at most `most` plans, their JSON data or solutions by name, all of the type `kind`.
    """
    check_tolerance(tolerance)
    named = {} if others is None else others
    good = isinstance(named, Mapping) and all(isinstance(word, str) for word in named)
    rule = f"be at most {most} plans by their names"
    check_option("others", others, good and len(named) <= most, rule)
    plans: list[tuple[str, Any]] = [] if plan is None else [(name, required("plan", plan, kind))]
    plans += [(word, required(word, model.as_plan(value), kind)) for word, value in named.items()]
    return [Named(word, item, model.verify(item, tolerance=tolerance)) for word, item in plans]


def label_plans(plans: Sequence[Named], plan: Any, *, unit: str = "", digits: int = 6) -> list[str]:
    """Return the names of plans in a legend, with objective and verdict unless `plan` is alone."""
    if len(plans) == 1 and plan is not None:
        return [plans[0].name]
    values = [entry.result.objective for entry in plans]
    return [
        entry.name
        + ("" if value is None else f", {number(value, digits)}{unit}")
        + ("" if entry.result.ok else ", NOT VALID")
        for entry, value in zip(plans, values, strict=True)
    ]
