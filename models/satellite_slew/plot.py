"""Picture of a slew with the paper's panels: attitude, rates, gimbals, singularity and torque.

Optional panels show the errors of a controller that tracks the plan, and another view the paths of the
body axes. Source of the choice of panels: the figures of "Path Planning for Rapid Large-Angle Maneuver
of Satellites Based on the Gauss Pseudospectral Method", Mathematical Problems in Engineering, 2016.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...errors import UnsupportedOption
from ..optimal_control.plan import ControlPlan
from ..optimal_control.plot import curves_of, guessed, nodes_of, sampled
from ..plots import kit
from ..verification import Check
from .checks import slew_phase
from .data import VectorLimits
from .dynamics import SlewMotion
from .flight import Tracking
from .gyros import singularity_measure
from .model import SatelliteSlew
from .quaternions import product, rotation_about, rotation_matrix

__all__ = ["PAPER_QUATERNION_ERROR", "PAPER_RATE_ERROR", "animate_slew", "draw"]

#: Error bounds of the paper's controller: quaternion and rates (rad/s).
PAPER_QUATERNION_ERROR, PAPER_RATE_ERROR = 4e-4, 1e-3

_ATTITUDE = ("q0", "q1", "q2", "q3")
_RATES = ("ωx", "ωy", "ωz")
_TORQUES = ("x", "y", "z")
#: Title of the panel by the name of a value in the text of a check, and the pattern of its entry.
_TITLES = {
    "q": "quaternion", "w": "body rates", "delta": "gimbal angles", "rate": "gimbal rates",
    "det": "singularity\ndet(A Aᵀ)", "T_c": "control torque",
}  # fmt: skip
_ENTRY = re.compile(r"\b(q|w|delta|rate|det|T_c)\b(?:\[(\d)\])?")


@kit.documented
def draw(
    model: SatelliteSlew,
    plan: ControlPlan | None = None,
    *,
    view: str = "time",
    tracking: Tracking | None = None,
    mesh: bool = True,
    tolerance: float = kit.TOLERANCE,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> kit.Figure:
    """Draw the slew of `plan` over time, or the paths of the body axes; :func:`animate_slew` animates them.

    Parameters
    ----------
    plan : ControlPlan, optional
        Plan of the slew, valid or not. The worst violation of a limit is ringed in red. None draws
        the guess, where the search starts, or the body axes at both ends.
    view : {"time", "axis"}
        Over time: quaternion, body rates, gimbal angles, gimbal rates, singularity measure
        det(A_t A_tᵀ) and control torque, with their limits. Otherwise the paths of the body axes x, y
        and z on the unit sphere in inertial axes, with the eigenaxis rotation as dotted lines.
    tracking : Tracking, optional
        Simulated flight along the plan, whose singularity measure and errors are drawn as well. The
        error bounds of the paper's controller are dashed lines. Over time only.
    mesh : bool
        Whether to draw nodes and knots.
    """
    kit.check_choice("view", view, "time", "axis")
    kit.check_flags(mesh=mesh)
    tracked = tracking is None or isinstance(tracking, Tracking)
    kit.check_option("tracking", tracking, tracked, "be a Tracking")
    if tracking is not None and (view == "axis" or plan is None):
        raise UnsupportedOption("tracking is drawn over time, beside a plan")
    if plan is not None:
        slew_phase(plan, model.gyro_count)
    result = kit.verified_plan(model, plan, ControlPlan, tolerance)
    axis, angle = model.turn
    around = ", ".join(kit.number(float(x), 3) for x in axis)
    parts = [f"{kit.number(float(np.rad2deg(angle)), 5)}° about ({around})"]
    if model.margin:
        parts.append(f"{kit.number(100 * model.margin, 4)} % in reserve")
    if result is not None and result.objective is not None:
        parts.append(f"J = {kit.number(result.objective)} s")
    if plan is not None:
        parts.append(f"tf = {kit.number(plan.end, 5)} s")
    text = kit.title_of(model, parts, result, title)
    if view == "axis":
        scene = kit.Scene(text, result, size, (6.4, 6.0))
        draw_axes(model, plan, scene)
        return scene.figure
    drawn = guessed(model.lower().definition) if plan is None else plan
    panels = _panels(model, drawn, tolerance)
    if tracking is not None:
        attitude, rates = tracking.quaternion_errors[:, 1:], tracking.rate_errors
        flown = kit.Curve("flown", 1, tracking.times, tracking.measures)
        panels[4] = replace(panels[4], curves=[*panels[4].curves, flown])
        errors = "quaternion\nerrors", "", _ATTITUDE[1:], attitude, PAPER_QUATERNION_ERROR
        panels.insert(3, _errors(*errors, tracking))
        panels.append(_errors("rate errors", "rad/s", _RATES, rates, PAPER_RATE_ERROR, tracking))
    part = slew_phase(drawn, model.gyro_count)
    end = part.end if tracking is None else max(part.end, float(tracking.times[-1]))
    figure = kit.panel_sheet(
        panels, [kit.Span("slew", part.start, end, part.states.knots)], columns=2, title=text,
        wrong=kit.is_wrong(result), label="time (s)", size=size, mesh=mesh, guess=plan is None,
    )  # fmt: skip
    places = {panel.title: (axes, panel) for axes, panel in zip(figure.axes, panels, strict=True)}

    def find(check: Check) -> tuple[Any, kit.Curve, float] | None:
        """Return axes, curve and time of a check of a state, a control or a limit."""
        entry, time = _ENTRY.search(check.where), kit.time_of(check)
        if time is None:
            ends = {"initial": part.start, "final": part.end}
            time = ends.get(check.name.partition(" ")[0])
        if entry is None or time is None:
            return None
        axes, panel = places[_TITLES[entry[1]]]
        return axes, panel.curves[-1 if entry[2] is None else int(entry[2])], time

    kit.pin_curves(result, find)
    return figure


# -- the panels ----------------------------------------------------------------------------------


def _panels(model: SatelliteSlew, plan: ControlPlan, tolerance: float) -> list[kit.Panel]:
    """Return the paper's six panels: attitude, rates, angles, gimbal rates, singularity and torque."""
    part = slew_phase(plan, model.gyro_count)
    gimbal_names = tuple(f"δ{k + 1}" for k in range(model.gyro_count))
    times, states, controls = sampled(part)
    nodes, at_nodes = nodes_of(part.states)
    measure = singularity_measure(states[:, 7:], model.gyros)[:, None]
    torque = SlewMotion.of(model).torque(states[:, 7:], controls)
    rates, rate_nodes = states[:, 4:7], at_nodes[:, 4:7]
    rate_names: Sequence[str] = _RATES
    torque_names: Sequence[str] = _TORQUES
    if model.vector_limits == VectorLimits.NORM:
        rates, rate_nodes, torque = (
            np.hstack([values, model.magnitudes(values)]) for values in (rates, rate_nodes, torque)
        )
        rate_names, torque_names = (*_RATES, "|ω|"), (*_TORQUES, "|T|")
    ends = np.array([part.start, part.end])

    def within(upper: float, full: float = 0.0) -> list[kit.Limit]:
        limits = [kit.Limit(ends, -upper, upper, (), tolerance * upper)]
        if full > upper:
            label = "limit, nothing in reserve"
            limits.append(kit.Limit(ends, -full, full, label=label, dashes=":", shaded=False))
        return limits

    gimbal_rate, most_torque = model.planned_gimbal_rate, model.planned_torque
    safe = kit.Limit(ends, model.singularity_limit, np.inf, (), tolerance)
    rows: list[tuple[str, str, Sequence[str], kit.Floats, Any, list[kit.Limit]]] = [
        ("quaternion", "", _ATTITUDE, states[:, :4], (nodes, at_nodes[:, :4]), []),
        ("body rates", "rad/s", rate_names, rates, (nodes, rate_nodes), within(model.rate_limit)),
        ("gimbal angles", "rad", gimbal_names, states[:, 7:], (nodes, at_nodes[:, 7:]), []),
        ("gimbal rates", "rad/s", gimbal_names, controls, nodes_of(part.controls),
         within(gimbal_rate, model.gimbal_rate_limit)),
        (_TITLES["det"], "", ("det(A Aᵀ)",), measure, None, [safe]),
        ("control torque", "N m", torque_names, torque, None,
         within(most_torque, model.torque_limit)),
    ]  # fmt: skip
    panels = []
    for title, unit, names, values, dots, limits in rows:
        curves, marks = curves_of(names, times, values, dots)
        panels.append(kit.Panel(title, unit, curves, limits, marks, whole=True))
    return panels


def _errors(
    title: str,
    unit: str,
    names: Sequence[str],
    values: kit.Floats,
    bound: float,
    tracking: Tracking,
) -> kit.Panel:
    """Return the panel of the flight's errors, with the bounds of the paper's controller."""
    times, label = tracking.times, "kept by the paper's controller"
    # The paper's bounds are results and not limits, so nothing is shaded.
    paper = kit.Limit(times[[0, -1]], -bound, bound, label=label, dashes="-.", shaded=False)
    curves, _ = curves_of(names, times, values)
    shades = {"saturated": kit.true_intervals(tracking.saturated, times)}
    return kit.Panel(title, unit, curves, [paper], whole=True, shades=shades)


# -- the body axes ---------------------------------------------------------------------------------

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
        part = slew_phase(plan, model.gyro_count)
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


@kit.documented
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
    turn : float
        Total rotation of the point of view around the satellite, degrees.
    """
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    stage = kit.Stage(model, title, size, frames, interval)
    kit.check_option("turn", turn, kit.is_number(turn) and np.isfinite(turn), "be a finite number")
    part = slew_phase(model.as_plan(plan), model.gyro_count)
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
    look = {"facecolors": "#c9d3dc", "edgecolors": "#6f7f8c", "linewidths": 0.7, "alpha": 0.85}
    body = Poly3DCollection([], zorder=4, **look)
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


def _axis_paths(attitudes: kit.Floats) -> kit.Floats:
    """Return the body axes in inertial axes, shape (times, axis, 3)."""
    lengths = np.linalg.norm(attitudes, axis=1, keepdims=True)
    return np.swapaxes(rotation_matrix(attitudes / lengths), 1, 2)
