"""Picture of a slew with the paper's panels: attitude, rates, gimbals, singularity and torque.

Optional panels show the errors of a controller that tracks the plan, and another view the paths of the
body axes. Source of the choice of panels: the figures of "Path Planning for Rapid Large-Angle Maneuver
of Satellites Based on the Gauss Pseudospectral Method", Mathematical Problems in Engineering, 2016.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, UnsupportedOption
from ..optimal_control.plan import ControlPlan
from ..optimal_control.plot import curves_of, guessed, nodes_of, sampled
from ..plots import kit
from .checks import slew_phase
from .data import VectorLimits
from .dynamics import SlewMotion
from .flight import Tracking
from .gyros import singularity_measure
from .model import SatelliteSlew
from .plot_axes import animate_slew, draw_axes

__all__ = ["PAPER_QUATERNION_ERROR", "PAPER_RATE_ERROR", "animate_slew", "draw"]

Floats = NDArray[np.float64]

#: Error bounds of the paper's controller: quaternion and rates (rad/s).
PAPER_QUATERNION_ERROR, PAPER_RATE_ERROR = 4e-4, 1e-3

_ATTITUDE = ("q0", "q1", "q2", "q3")
_RATES = ("ωx", "ωy", "ωz")
_GIMBALS = ("δ1", "δ2", "δ3", "δ4")
_TORQUES = ("x", "y", "z")


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
    """Draw the slew of `plan` over time, or the paths of the body axes.

    Parameters
    ----------
    model : SatelliteSlew
        Slew.
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
    tolerance : float
        Largest accepted relative violation, for the title and the rings; by default that of the
        solution.
    title : str, optional
        Title; by default the name, the rotation, the objective and the final time.
    size : (float, float), optional
        Width and height (inch).

    Returns
    -------
    matplotlib.figure.Figure
        Six panels, eight with `tracking`, or one panel with the sphere.

    Raises
    ------
    InvalidData
        The plan is not that of a slew.
    UnsupportedOption
        The value of an option is not allowed, or the plan or view does not support it.

    See Also
    --------
    animate_slew : Animation of the body axes.
    """
    kit.check_choice("view", view, "time", "axis")
    kit.check_flags(mesh=mesh)
    tracked = tracking is None or isinstance(tracking, Tracking)
    kit.check_option("tracking", tracking, tracked, "be a Tracking")
    if tracking is not None and (view == "axis" or plan is None):
        raise UnsupportedOption("tracking is drawn over time, beside a plan")
    if plan is not None:
        slew_phase(plan)
    found = kit.verified_plan(model, plan, ControlPlan, tolerance)
    axis, angle = model.turn
    around = ", ".join(kit.number(float(x), 3) for x in axis)
    parts = [f"{kit.number(float(np.rad2deg(angle)), 5)}° about ({around})"]
    if model.margin:
        parts.append(f"{kit.number(100 * model.margin, 4)} % in reserve")
    if found is not None and found.objective is not None:
        parts.append(f"J = {kit.number(found.objective)} s")
    if plan is not None:
        parts.append(f"tf = {kit.number(plan.end, 5)} s")
    text = kit.title_of(model, parts, found, title)
    if view == "axis":
        scene = kit.Scene(text, found, size, (6.4, 6.0))
        draw_axes(model, plan, scene)
        return scene.figure
    drawn = _guessed(model) if plan is None else plan
    panels = _panels(model, drawn, tolerance)
    if tracking is not None:
        attitude, bound = tracking.quaternion_errors[:, 1:], PAPER_QUATERNION_ERROR
        rates = tracking.rate_errors
        flown = kit.Curve("flown", 1, tracking.times, tracking.measures)
        panels[4] = replace(panels[4], curves=[*panels[4].curves, flown])
        panels.insert(
            3, _errors("quaternion\nerrors", "", _ATTITUDE[1:], attitude, bound, tracking)
        )
        panels.append(_errors("rate errors", "rad/s", _RATES, rates, PAPER_RATE_ERROR, tracking))
    part = slew_phase(drawn)
    end = part.end if tracking is None else max(part.end, float(tracking.times[-1]))
    return kit.panel_sheet(
        panels, [kit.Span("slew", part.start, end, part.states.knots)], columns=2, title=text,
        wrong=kit.is_wrong(found), label="time (s)", size=size, mesh=mesh, guess=plan is None,
    )  # fmt: skip


def _guessed(model: SatelliteSlew) -> ControlPlan:
    problem = model.lower()
    if problem is None:
        raise InvalidData("the guess of a slew needs CasADi, which is not installed", field="plan")
    return guessed(problem.definition)


# -- the panels ----------------------------------------------------------------------------------


def _panels(model: SatelliteSlew, plan: ControlPlan, tolerance: float) -> list[kit.Panel]:
    """Return the paper's six panels: attitude, rates, angles, gimbal rates, singularity and torque."""
    part = slew_phase(plan)
    times, states, controls = sampled(part)
    nodes, at_nodes = nodes_of(part.states)
    measure = singularity_measure(states[:, 7:], model.beta)
    torque = SlewMotion.of(model).torque(states[:, 7:], controls)
    ends = np.array([part.start, part.end])

    def panel(
        title: str, unit: str, names: Sequence[str], values: Floats,
        dots: tuple[Floats, Floats] | None, limits: Sequence[kit.Limit] = (),
    ) -> kit.Panel:  # fmt: skip
        curves, marks = curves_of(names, times, values, dots)
        return kit.Panel(title, unit, curves, limits, marks, whole=True)

    def with_norm(
        names: Sequence[str], values: Floats, norm: str
    ) -> tuple[tuple[str, ...], Floats]:
        if model.vector_limits != VectorLimits.NORM:
            return tuple(names), values
        return (*names, norm), np.hstack([values, model.magnitudes(values)])

    def within(upper: float, full: float | None = None) -> list[kit.Limit]:
        limits_drawn = [kit.Limit(ends, -upper, upper, (), tolerance * upper)]
        if full is not None and full > upper:
            label = "limit, nothing in reserve"
            limits_drawn.append(kit.Limit(ends, -full, full, label=label, dashes=":", shaded=False))
        return limits_drawn

    rate_names, rates = with_norm(_RATES, states[:, 4:7], "|ω|")
    _, rate_nodes = with_norm(_RATES, at_nodes[:, 4:7], "|ω|")
    torque_names, torque = with_norm(_TORQUES, torque, "|T|")
    smallest = model.singularity_limit
    safe = kit.Limit(ends, smallest, np.inf, (), tolerance)
    return [
        panel("quaternion", "", _ATTITUDE, states[:, :4], (nodes, at_nodes[:, :4])),
        panel(
            "body rates", "rad/s", rate_names, rates, (nodes, rate_nodes),
            within(model.rate_limit),
        ),
        panel("gimbal angles", "rad", _GIMBALS, states[:, 7:], (nodes, at_nodes[:, 7:])),
        panel(
            "gimbal rates", "rad/s", _GIMBALS, controls, nodes_of(part.controls),
            within(model.planned_gimbal_rate, model.gimbal_rate_limit),
        ),
        panel("singularity\ndet(A Aᵀ)", "", ("det(A Aᵀ)",), measure[:, None], None, [safe]),
        panel(
            "control torque", "N m", torque_names, torque, None,
            within(model.planned_torque, model.torque_limit),
        ),
    ]  # fmt: skip


def _errors(
    title: str, unit: str, names: Sequence[str], values: Floats, bound: float, tracking: Tracking
) -> kit.Panel:
    """Return the panel of the flight's errors, with the bounds of the paper's controller."""
    times, label = tracking.times, "kept by the paper's controller"
    # The paper's bounds are results and not limits, so nothing is shaded.
    paper = kit.Limit(times[[0, -1]], -bound, bound, label=label, dashes="-.", shaded=False)
    curves, _ = curves_of(names, times, values)
    shades = {"saturated": kit.true_intervals(tracking.saturated, times)}
    return kit.Panel(title, unit, curves, [paper], whole=True, shades=shades)
