"""The picture of a slew, in the paper's manner: attitude, rates, gimbals, singularity and torque.

Beside them, on demand, how far a controller strays that tracks the plan, and the ways that the body
axes go. Source of the choice of panels: the figures of "Path Planning for Rapid Large-Angle Maneuver
of Satellites Based on the Gauss Pseudospectral Method", Mathematical Problems in Engineering, 2016.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import show
from ..optimal_control.plan import ControlPlan
from ..plots.curves import Curve, Limit, Panel, Span, nodes_of, sampled
from ..plots.options import check_flags, check_size, check_tolerance
from ..plots.panels import figure_of, not_valid
from ..plots.style import number
from ..verification import TOLERANCE
from .checks import slew_phase
from .dynamics import SlewMotion
from .gyros import singularity_measure
from .model import SatelliteSlew
from .plot_axes import animate_slew, draw_axes
from .tracking import Tracking

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["PAPER_QUATERNION_ERROR", "PAPER_RATE_ERROR", "animate_slew", "draw"]

Floats = NDArray[np.float64]

#: What the paper says its controller keeps to: errors of the quaternion and of the rates (rad/s).
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
    tolerance: float = TOLERANCE,
    title: str | None = None,
    size: tuple[float, float] | None = None,
) -> Figure:
    """Draw the slew of `plan`: over time, or the ways of the body axes.

    Parameters
    ----------
    model : SatelliteSlew
        The slew.
    plan : ControlPlan, optional
        A plan of it, valid or not; where it breaks a limit, the worst place is ringed in red. None
        draws the guess that the search starts from, or where the axes begin and end.
    view : {"time", "axis"}
        Over time: quaternion, body rates, gimbal angles, gimbal rates, singularity measure
        det(A_t A_tᵀ) and control torque, with their limits. Or the ways of the body axes x, y and z
        on the unit sphere, seen from inertial axes; dotted is the eigenaxis turn.
    tracking : Tracking, optional
        A simulated flight along the plan, whose errors are drawn as well, with what the paper's
        controller kept to as dashed lines. Over time only.
    mesh : bool
        Whether to draw nodes and knots.
    tolerance : float
        Largest violation accepted, relative, for what the title says and what is ringed: that of
        the solution.
    title : str, optional
        Instead of the name, the turn, the objective and the final time.
    size : (float, float), optional
        Width and height (inch).

    Returns
    -------
    matplotlib.figure.Figure
        Six panels, eight with `tracking`, or one of the sphere.

    Raises
    ------
    InvalidData
        The plan is none of a slew, or an option has a value that is not allowed.

    See Also
    --------
    animate_slew : The same axes, moving.
    """
    if view not in ("time", "axis"):
        raise InvalidData(f"view must be 'time' or 'axis', got {show(view)}", field="view")
    check_flags(mesh=mesh)
    check_tolerance(tolerance)
    check_size(size, (1.0, 1.0))
    if tracking is not None and not isinstance(tracking, Tracking):
        raise InvalidData(f"tracking must be a Tracking, got {show(tracking)}", field="tracking")
    if tracking is not None and (view == "axis" or plan is None):
        raise InvalidData("tracking is drawn over time, beside a plan", field="tracking")
    found = None
    if plan is not None:
        slew_phase(plan)
        found = model.verify(plan, tolerance=tolerance)
    text = title
    if text is None:
        objective = None if found is None else found.objective
        text = _title(model, plan, objective) + not_valid(found)
    wrong = found is not None and not found.ok
    if view == "axis":
        return draw_axes(model, plan, title=text, wrong=wrong, size=size)
    drawn = _guessed(model) if plan is None else plan
    panels = _panels(model, drawn, tolerance)
    if tracking is not None:
        panels = [*panels[:3], _attitude_errors(tracking), *panels[3:], _rate_errors(tracking)]
    part = slew_phase(drawn)
    end = part.end if tracking is None else max(part.end, float(tracking.times[-1]))
    spans = [Span("slew", part.start, end, np.asarray(part.states.knots))]
    return figure_of(
        panels, spans, columns=2, title=text, wrong=wrong, time_unit="s", size=size, dotted=mesh,
        guess=plan is None,
    )  # fmt: skip


def _guessed(model: SatelliteSlew) -> ControlPlan:
    from ..optimal_control.plot import guessed

    problem = model.lower()
    if problem is None:
        raise InvalidData("the guess of a slew needs CasADi, which is not installed", field="plan")
    return guessed(problem.definition)


def _title(model: SatelliteSlew, plan: ControlPlan | None, objective: float | None) -> str:
    axis, angle = model.turn
    around = ", ".join(number(float(x), 3) for x in axis)
    parts = [f"{number(float(np.rad2deg(angle)), 5)}° about ({around})"]
    if model.margin:
        parts.append(f"{number(100 * model.margin, 4)} % in reserve")
    if objective is not None:
        parts.append(f"J = {number(objective)} s")
    if plan is not None:
        parts.append(f"tf = {number(plan.end, 5)} s")
    text = ", ".join(parts)
    return f"{model.name}  ·  {text}" if model.name else text


# -- the panels ----------------------------------------------------------------------------------


def _curves(
    names: tuple[str, ...], times: Floats, values: Floats,
    dots: tuple[Floats, Floats] | None = None,
) -> list[Curve]:  # fmt: skip
    return [
        Curve(name, k, times, values[:, k], *(() if dots is None else (dots[0], dots[1][:, k])))
        for k, name in enumerate(names)
    ]


def _panels(model: SatelliteSlew, plan: ControlPlan, tolerance: float) -> list[Panel]:
    """Return the paper's six: attitude, rates and angles; gimbal rates, singularity and torque."""
    part = slew_phase(plan)
    times, states, controls = sampled(part)
    nodes, at_nodes = nodes_of(part.states)
    rates = nodes_of(part.controls)
    motion = SlewMotion.of(model)
    measure = singularity_measure(states[:, 7:], model.beta)
    torque = motion.torque(states[:, 7:], controls)
    begin, end = part.start, part.end

    def within(most: float, whole: float | None = None) -> list[Limit]:
        found = [Limit(begin, end, -most, most, (), tolerance * max(1.0, most))]
        if whole is not None and whole > most:
            found.append(Limit(begin, end, -whole, whole, (), np.inf, "reserve"))
        return found

    least = model.singularity_limit
    return [
        Panel("quaternion", "", _curves(_ATTITUDE, times, states[:, :4], (nodes, at_nodes[:, :4]))),
        Panel(
            "body rates", "rad/s", _curves(_RATES, times, states[:, 4:7], (nodes, at_nodes[:, 4:7])),
            within(model.rate_limit), whole=True,
        ),
        Panel(
            "gimbal angles", "rad",
            _curves(_GIMBALS, times, states[:, 7:], (nodes, at_nodes[:, 7:])),
        ),
        Panel(
            "gimbal rates", "rad/s", _curves(_GIMBALS, times, controls, rates),
            within(model.planned_gimbal_rate, model.gimbal_rate_limit), whole=True,
        ),
        Panel(
            "singularity\ndet(A Aᵀ)", "", [Curve("det(A Aᵀ)", 0, times, measure)],
            [Limit(begin, end, least, np.inf, (), tolerance * max(1.0, least))], whole=True,
        ),
        Panel(
            "control torque", "N m", _curves(_TORQUES, times, torque),
            within(model.planned_torque, model.torque_limit), whole=True,
        ),
    ]  # fmt: skip


def _saturated(tracking: Tracking) -> list[tuple[float, float]]:
    """Return the stretches of time in which a limit cut the command."""
    cut = np.concatenate([[False], tracking.saturated, [False]]).astype(np.int8)
    starts, ends = np.flatnonzero(np.diff(cut) == 1), np.flatnonzero(np.diff(cut) == -1)
    times = tracking.times
    return [(float(times[a]), float(times[b])) for a, b in zip(starts, ends, strict=True)]


def _errors(
    title: str, unit: str, names: tuple[str, ...], values: Floats, kept: float, tracking: Tracking
) -> Panel:
    times = tracking.times
    # The paper's figures forbid nothing: they are what its own controller kept to.
    paper = Limit(float(times[0]), float(times[-1]), -kept, kept, (), np.inf, "paper")
    return Panel(
        title, unit, _curves(names, times, values), [paper], whole=True, shades=_saturated(tracking)
    )


def _attitude_errors(tracking: Tracking) -> Panel:
    values = tracking.quaternion_errors[:, 1:]
    return _errors(
        "quaternion\nerrors", "", _ATTITUDE[1:], values, PAPER_QUATERNION_ERROR, tracking
    )


def _rate_errors(tracking: Tracking) -> Panel:
    return _errors("rate errors", "rad/s", _RATES, tracking.rate_errors, PAPER_RATE_ERROR, tracking)
