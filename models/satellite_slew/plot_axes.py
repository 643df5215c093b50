"""Paths of the body axes of a satellite during a slew, as a picture and as an animation."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..optimal_control.plan import ControlPlan
from ..plots import kit
from .checks import slew_phase
from .model import SatelliteSlew
from .quaternions import product, rotation_about, rotation_matrix

__all__ = ["animate_slew", "draw_axes"]

Floats = NDArray[np.float64]

#: Point of view of the sphere, degrees.
_ELEVATION, _AZIMUTH = 22.0, 36.0
#: Number of points of a path, and half the sides of the animated body.
_POINTS, _BODY = 241, np.array([0.42, 0.28, 0.2])
#: Corners of a box, and its faces as indices of corners.
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
_FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))


def draw_axes(model: SatelliteSlew, plan: ControlPlan | None, scene: kit.Scene) -> None:
    """Draw the paths of the body axes on the unit sphere."""
    axes = _sphere(model, scene)
    if plan is not None:
        part = slew_phase(plan)
        paths = _axis_paths(part.states(part.grid(_POINTS))[:, :4])
        for k in range(3):
            axes.plot(*paths[:, k].T, lw=2.4, zorder=5, gid=f"way {'xyz'[k]}", **kit.axis_style(k))
    begin = rotation_matrix(model.initial_attitude)
    end = rotation_matrix(model.target)
    for k in range(3):
        colour = kit.colour_of(k)
        moved = float(np.linalg.norm(end[:, k] - begin[:, k])) > 0.05
        for place, face, prime in ((begin[:, k], "white", ""), (end[:, k], colour, "'")):
            axes.plot(*np.stack([np.zeros(3), place]).T, lw=0.9, color=colour, zorder=3)
            kit.dots(axes, place[None], "o", face, size=34, edge=colour, width=1.4, zorder=7)
            if not prime or moved:
                axes.text(
                    *(1.16 * place), f"{'xyz'[k]}{prime}", color=colour, fontsize=10, ha="center",
                    va="center", zorder=8,
                )  # fmt: skip
    names = [f"way of body axis {axis}" for axis in "xyz"] if plan is not None else []
    keys = [kit.key(name, lw=2.2, **kit.axis_style(k)) for k, name in enumerate(names)]
    keys += [
        kit.key("begin", marker="o", mfc="white", mec=kit.GREY),
        kit.key("end (')", marker="o", color=kit.GREY),
        kit.key("eigenaxis turn", lw=1.1, ls=":", color=kit.GREY),
    ]
    scene.legend(keys, -(-len(keys) // 3))


def animate_slew(
    model: SatelliteSlew,
    plan: ControlPlan | Any,
    *,
    frames: int = 90,
    interval: float = 60.0,
    turn: float = 40.0,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.FuncAnimation:
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
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    stage = kit.Stage(model, title, size, frames, interval)
    kit.check_option("turn", turn, kit.is_number(turn) and np.isfinite(turn), "be a finite number")
    part = slew_phase(model.as_plan(plan))
    axes = _sphere(model, stage)
    times = part.grid(frames)
    attitudes = part.states(times)[:, :4]
    paths = _axis_paths(attitudes)
    lines, arms = (
        [axes.plot([], [], [], lw=width, zorder=zorder, **kit.axis_style(k))[0] for k in range(3)]
        for width, zorder in ((2.2, 5), (1.2, 6))
    )
    names = [
        axes.text(0, 0, 0, "xyz"[k], fontsize=10, color=kit.colour_of(k), zorder=8)
        for k in range(3)
    ]
    body = Poly3DCollection(
        [], facecolors="#c9d3dc", edgecolors="#6f7f8c", linewidths=0.7, alpha=0.85, zorder=4
    )
    axes.add_collection3d(body, autolim=False)

    def show(frame: int) -> str:
        rotation = rotation_matrix(attitudes[frame])
        corners = (_CORNERS * _BODY) @ rotation.T
        body.set_verts([corners[list(face)] for face in _FACES])
        for k in range(3):
            lines[k].set_data_3d(*paths[: frame + 1, k].T)
            arms[k].set_data_3d(*np.stack([np.zeros(3), rotation[:, k]]).T)
            names[k].set_position_3d(1.16 * rotation[:, k])
        axes.view_init(elev=_ELEVATION, azim=_AZIMUTH + turn * (frame / (frames - 1) - 0.5))
        return f"t = {times[frame] - times[0]:.2f} s of {part.duration:.2f} s"

    return stage.play(show)


# -- parts ---------------------------------------------------------------------------------------


def _sphere(model: SatelliteSlew, scene: kit.Scene) -> Any:
    """Return axes with a bare unit sphere, and the paths of the rotation about one axis."""
    foot = 0.5 / scene.tall
    axes = kit.space_axes(scene.figure, (0.0, foot, 1.0, 1 - scene.head / scene.tall - foot))
    around = np.linspace(0.0, 2 * np.pi, 97)
    wire: dict[str, Any] = {"color": "#e3e6e9", "lw": 0.6, "zorder": 1}
    for angle in np.deg2rad(np.arange(-60, 61, 30)):
        circle = np.cos(angle) * np.array([np.cos(around), np.sin(around)])
        axes.plot(*circle, np.full(around.size, np.sin(angle)), **wire)
    for angle in np.deg2rad(np.arange(0, 180, 30)):
        flat = np.cos(around)
        axes.plot(np.cos(angle) * flat, np.sin(angle) * flat, np.sin(around), **wire)
    axes.set_axis_off()
    axes.set_box_aspect((1, 1, 1), zoom=1.5)
    for name in "xyz":
        getattr(axes, f"set_{name}lim")(-1.05, 1.05)
    axes.view_init(elev=_ELEVATION, azim=_AZIMUTH)
    axis, turned = model.turn
    rotations = rotation_about(axis, np.linspace(0.0, turned, _POINTS))
    paths = _axis_paths(product(model.initial_attitude, rotations))
    for k in range(3):
        axes.plot(*paths[:, k].T, lw=1.1, ls=":", color=kit.GREY, zorder=4, gid="eigenaxis")
    return axes


def _axis_paths(attitudes: Floats) -> Floats:
    """Return the body axes in inertial axes, shape (times, axis, 3)."""
    lengths = np.linalg.norm(attitudes, axis=1, keepdims=True)
    result: Floats = np.swapaxes(rotation_matrix(attitudes / lengths), 1, 2)
    return result
