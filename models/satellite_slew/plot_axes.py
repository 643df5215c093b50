"""Paths of the body axes of a satellite during a slew, as a picture and as an animation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..optimal_control.plan import ControlPlan
from ..plots.options import check_frames, check_option, is_number
from ..plots.space import dots, space_axes
from ..plots.style import DARK, GREY, axis_style, headline, key, legend_below, sheet
from .checks import slew_phase
from .model import SatelliteSlew
from .quaternions import product, rotation_about, rotation_matrix

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from matplotlib.figure import Figure

__all__ = ["animate_slew", "draw_axes"]

Floats = NDArray[np.float64]

#: Point of view of the sphere, degrees.
_ELEVATION, _AZIMUTH = 22.0, 36.0
#: Number of points of a path, and half the sides of the animated body.
_POINTS, _BODY = 241, np.array([0.42, 0.28, 0.2])
#: Corners of a box, and its faces as indices of corners.
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
_FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))


def draw_axes(
    model: SatelliteSlew, plan: ControlPlan | None, *, title: str, wrong: bool, size: Any
) -> Figure:
    """Return a figure with the paths of the body axes on the unit sphere."""
    figure, axes = _sphere(title, wrong, size)
    _draw_eigenaxis(model, axes)
    if plan is not None:
        part = slew_phase(plan)
        paths = _axis_paths(part.states(part.grid(_POINTS))[:, :4])
        for k in range(3):
            axes.plot(*paths[:, k].T, lw=2.4, zorder=5, gid=f"way {'xyz'[k]}", **axis_style(k))
    begin = rotation_matrix(model.initial_attitude)
    end = rotation_matrix(model.target)
    for k in range(3):
        colour = axis_style(k)["color"]
        moved = float(np.linalg.norm(end[:, k] - begin[:, k])) > 0.05
        for place, face, prime in ((begin[:, k], "white", ""), (end[:, k], colour, "'")):
            axes.plot(*np.stack([np.zeros(3), place]).T, lw=0.9, color=colour, zorder=3)
            dots(axes, place[None], "o", face, size=34, edge=colour, width=1.4, zorder=7)
            if not prime or moved:
                axes.text(
                    *(1.16 * place), f"{'xyz'[k]}{prime}", color=colour, fontsize=10, ha="center",
                    va="center", zorder=8,
                )  # fmt: skip
    _legend(figure, plan is not None)
    return figure


def animate_slew(
    model: SatelliteSlew,
    plan: ControlPlan | Any,
    *,
    frames: int = 90,
    interval: float = 60.0,
    turn: float = 40.0,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> FuncAnimation:
    """Return an animation of the slew: the body, its axes and their paths, with a moving view.

    Parameters
    ----------
    model : SatelliteSlew
        Slew.
    plan : ControlPlan or Solution
        Plan of the slew.
    frames : int
        Number of frames, at least 2.
    interval : float
        Duration of a frame, ms.
    turn : float
        Total rotation of the point of view around the satellite, degrees.
    title : str, optional
        Title; by default the name.
    size : (float, float), optional
        Width and height (inch).

    Returns
    -------
    matplotlib.animation.FuncAnimation
        Animation without a window:
        ``animate_slew(model, plan).save("slew.gif", writer="pillow", dpi=80)``.

    Raises
    ------
    InvalidData
        The plan is not that of a slew.
    UnsupportedOption
        The value of an option is not allowed.
    """
    from matplotlib.animation import FuncAnimation
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    check_frames(frames, interval)
    check_option("turn", turn, is_number(turn) and np.isfinite(turn), "be a finite number")
    part = slew_phase(model.as_plan(plan))
    text = (model.name or model.describe()) if title is None else title
    figure, axes = _sphere(text, False, size)
    _draw_eigenaxis(model, axes)
    times = part.grid(frames)
    attitudes = part.states(times)[:, :4]
    paths = _axis_paths(attitudes)
    lines = [axes.plot([], [], [], lw=2.2, zorder=5, **axis_style(k))[0] for k in range(3)]
    arms = [axes.plot([], [], [], lw=1.2, zorder=6, **axis_style(k))[0] for k in range(3)]
    names = [
        axes.text(0, 0, 0, "xyz"[k], fontsize=10, color=axis_style(k)["color"], zorder=8)
        for k in range(3)
    ]
    body = Poly3DCollection(
        [], facecolors="#c9d3dc", edgecolors="#6f7f8c", linewidths=0.7, alpha=0.85, zorder=4
    )
    axes.add_collection3d(body, autolim=False)
    clock = figure.text(0.5, 0.03, "", ha="center", fontsize=9, color=DARK)

    def update(frame: int) -> list[Any]:
        rotation = rotation_matrix(attitudes[frame])
        corners = (_CORNERS * _BODY) @ rotation.T
        body.set_verts([corners[list(face)] for face in _FACES])
        for k in range(3):
            lines[k].set_data_3d(*paths[: frame + 1, k].T)
            arms[k].set_data_3d(*np.stack([np.zeros(3), rotation[:, k]]).T)
            names[k].set_position_3d(1.16 * rotation[:, k])
        clock.set_text(f"t = {times[frame] - times[0]:.2f} s of {part.duration:.2f} s")
        axes.view_init(elev=_ELEVATION, azim=_AZIMUTH + turn * (frame / (frames - 1) - 0.5))
        return [*lines, *arms, *names, body, clock]

    # Draw the first frame at once, so that the figure is complete even if it is never played.
    update(0)
    return FuncAnimation(figure, update, frames=frames, interval=interval, blit=False)


# -- parts ---------------------------------------------------------------------------------------


def _sphere(title: str, wrong: bool, size: Any) -> tuple[Figure, Any]:
    """Return a figure with a bare unit sphere and the inertial axes."""
    figure = sheet(size, (6.4, 6.0))
    tall = figure.get_size_inches()[1]
    low, high = 0.5 / tall, 1 - (0.42 + 0.17 * title.count("\n")) / tall
    axes = space_axes(figure, (0.0, low, 1.0, high - low))
    around = np.linspace(0.0, 2 * np.pi, 97)
    for angle in np.deg2rad(np.arange(-60, 61, 30)):
        ring = np.cos(angle) * np.array([np.cos(around), np.sin(around)])
        axes.plot(*ring, np.full(around.size, np.sin(angle)), color="#e3e6e9", lw=0.6, zorder=1)
    for angle in np.deg2rad(np.arange(0, 180, 30)):
        flat = np.cos(around)
        axes.plot(
            np.cos(angle) * flat, np.sin(angle) * flat, np.sin(around), color="#e3e6e9", lw=0.6,
            zorder=1,
        )  # fmt: skip
    axes.set_axis_off()
    axes.set_box_aspect((1, 1, 1), zoom=1.5)
    for name in "xyz":
        getattr(axes, f"set_{name}lim")(-1.05, 1.05)
    axes.view_init(elev=_ELEVATION, azim=_AZIMUTH)
    headline(figure, title, wrong=wrong)
    return figure, axes


def _axis_paths(attitudes: Floats) -> Floats:
    """Return the body axes in inertial axes, shape (times, axis, 3)."""
    lengths = np.linalg.norm(attitudes, axis=1, keepdims=True)
    result: Floats = np.swapaxes(rotation_matrix(attitudes / lengths), 1, 2)
    return result


def _draw_eigenaxis(model: SatelliteSlew, axes: Any) -> None:
    """Draw the paths of the rotation about one axis."""
    axis, angle = model.turn
    rotations = rotation_about(axis, np.linspace(0.0, angle, _POINTS))
    paths = _axis_paths(product(model.initial_attitude, rotations))
    for k in range(3):
        axes.plot(*paths[:, k].T, lw=1.1, ls=":", color=GREY, zorder=4, gid="eigenaxis")


def _legend(figure: Figure, planned: bool) -> None:
    keys = [
        key(f"way of body axis {'xyz'[k]}", lw=2.2, **axis_style(k)) for k in range(3) if planned
    ]
    keys += [
        key("begin", marker="o", mfc="white", mec=GREY),
        key("end (')", marker="o", color=GREY),
        key("eigenaxis turn", lw=1.1, ls=":", color=GREY),
    ]
    legend_below(figure, keys, rows=-(-len(keys) // 3))
