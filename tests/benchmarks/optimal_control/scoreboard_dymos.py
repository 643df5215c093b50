"""Problems declared here as programs of dymos.

CasADi evaluates the functions and their derivatives inside an ``ExplicitComponent``. The optimiser is SciPy's SLSQP,
because pyOptSparse, which provides Ipopt to OpenMDAO, is not installable by pip. Its dense subproblems limit the
mesh to 20 segments of order 3. The refinement of dymos 1.15.1 fails with the connections of this adapter.
"""

from __future__ import annotations

import math
from typing import Any

import casadi
import dymos as dm
import numpy as np
import openmdao.api as om
from bare import plan_of_nodes
from scoreboard_parts import guessed_integrals, sampled

__all__ = ["solve"]

SEGMENTS, ORDER = 20, 3


def _finite(value: float) -> float | None:
    """Return a bound, or None for an infinite one."""
    return float(value) if math.isfinite(value) else None


class Rates(om.ExplicitComponent):
    """Rates, path constraints and integrands at `num_nodes` instants."""

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("num_nodes", types=int)
        self.options.declare("function", recordable=False)

    def setup(self) -> None:
        """Declare scalar inputs and outputs, and their derivatives at equal nodes."""
        count, function = self.options["num_nodes"], self.options["function"]
        self.sizes = [function.size1_in(k) for k in range(4)]
        self.names = [f"{n}{k}" for n, s in zip("txup", self.sizes, strict=True) for k in range(s)]
        outputs = zip(("rate", "path", "integrand"), range(3), strict=True)
        self.results = [f"{n}{k}" for n, i in outputs for k in range(function.size1_out(i))]
        arguments = [casadi.MX.sym(n, s) for n, s in zip("txup", self.sizes, strict=True)]
        values = casadi.vertcat(*function(*arguments)[:3])
        slopes = casadi.densify(casadi.jacobian(values, casadi.vertcat(*arguments)))
        self.values = casadi.Function("values", arguments, [casadi.densify(values)]).map(count)
        self.slopes = casadi.Function("slopes", arguments, [slopes]).map(count)
        rows = np.arange(count)
        for name in self.names:
            static = name.startswith("p")
            tags = ["dymos.static_target"] if static else []
            self.add_input(name, shape=(1,) if static else (count,), tags=tags)
        for result in self.results:
            self.add_output(result, shape=(count,))
            for name in self.names:
                columns = np.zeros(count, int) if name.startswith("p") else rows
                self.declare_partials(result, name, rows=rows, cols=columns)

    def _arguments(self, inputs: Any) -> list[Any]:
        count = self.options["num_nodes"]
        table = [np.broadcast_to(inputs[name].ravel(), (count,)) for name in self.names]
        cuts = np.cumsum(self.sizes)[:-1]
        return [np.array(part).reshape(-1, count) for part in np.split(np.array(table), cuts)]

    def compute(self, inputs: Any, outputs: Any) -> None:
        """Evaluate the functions."""
        for name, row in zip(
            self.results, self.values(*self._arguments(inputs)).full(), strict=True
        ):
            outputs[name] = row

    def compute_partials(self, inputs: Any, partials: Any) -> None:
        """Evaluate the derivatives."""
        table = self.slopes(*self._arguments(inputs)).full()
        table = table.reshape(len(self.results), -1, len(self.names))
        for k, result in enumerate(self.results):
            for j, name in enumerate(self.names):
                partials[result, name] = table[k, :, j]


class Ends(om.ExplicitComponent):
    """Objective and boundary constraints, a function of the endpoint vector and the parameters."""

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("function", recordable=False)

    def setup(self) -> None:
        """Declare one input per entry."""
        function = self.options["function"]
        self.sizes = function.size1_in(0), function.size1_in(1)
        self.names = [f"{n}{k}" for n, s in zip("ep", self.sizes, strict=True) for k in range(s)]
        arguments = [casadi.MX.sym(n, s) for n, s in zip("ep", self.sizes, strict=True)]
        values = casadi.densify(casadi.vertcat(*function(*arguments)))
        slopes = casadi.densify(casadi.jacobian(values, casadi.vertcat(*arguments)))
        self.both = casadi.Function("ends", arguments, [values, slopes])
        for name in self.names:
            self.add_input(name, shape=(1,))
        self.add_output("objective", shape=(1,))
        self.rows = values.numel() - 1
        if self.rows:
            self.add_output("boundary", shape=(self.rows,))
        self.declare_partials("*", "*")

    def _at(self, inputs: Any) -> tuple[Any, Any]:
        point = np.array([inputs[name][0] for name in self.names])
        values, slopes = self.both(point[: self.sizes[0]], point[self.sizes[0] :])
        return values.full().ravel(), slopes.full()

    def compute(self, inputs: Any, outputs: Any) -> None:
        """Evaluate the function."""
        values, _ = self._at(inputs)
        outputs["objective"] = values[0]
        if self.rows:
            outputs["boundary"] = values[1:]

    def compute_partials(self, inputs: Any, partials: Any) -> None:
        """Evaluate the derivatives."""
        _, slopes = self._at(inputs)
        for k, name in enumerate(self.names):
            partials["objective", name] = slopes[0, k]
            if self.rows:
                partials["boundary", name] = slopes[1:, k : k + 1]


def _phase(part: Any) -> Any:
    """Return a phase of dymos for a phase of the declaration."""
    phase = dm.Phase(
        ode_class=Rates,
        ode_init_kwargs={"function": part.function},
        transcription=dm.Radau(num_segments=SEGMENTS, order=ORDER),
    )
    fixed = part.start_lower == part.start_upper
    ends_fixed = fixed and part.end_lower == part.end_upper
    span = part.end_lower - part.start_upper, part.end_upper - part.start_lower
    options: dict[str, Any] = {"fix_duration": True} if ends_fixed else {}
    if not ends_fixed:
        options["duration_bounds"] = max(span[0], 1e-6 * span[1]), span[1]
    if not fixed:
        options["initial_bounds"] = part.start_lower, part.start_upper
        phase.add_boundary_constraint(
            "time", loc="final", lower=part.end_lower, upper=part.end_upper
        )
    phase.set_time_options(fix_initial=fixed, targets=["t0"], units=None, **options)
    sides = [bound for side in ("", "initial", "final") for bound in part.bounds("states", side)]
    for k, (low, high, *ends) in enumerate(zip(*sides, strict=True)):
        phase.add_state(
            f"x{k}", rate_source=f"rate{k}", targets=[f"x{k}"], lower=_finite(low), upper=_finite(high),
            fix_initial=bool(ends[0] == ends[1]), fix_final=bool(ends[2] == ends[3]),
        )  # fmt: skip
        for loc, low_end, high_end in (("initial", *ends[:2]), ("final", *ends[2:])):
            if low_end < high_end and (low_end > low or high_end < high):
                limits = {"lower": _finite(low_end), "upper": _finite(high_end)}
                phase.add_boundary_constraint(f"x{k}", loc=loc, **limits)
    for k, (low, high) in enumerate(zip(*part.bounds("controls"), strict=True)):
        phase.add_control(
            f"u{k}", targets=[f"u{k}"], lower=_finite(low), upper=_finite(high), continuity=False,
            rate_continuity=False,
        )  # fmt: skip
    for k, (low, high) in enumerate(zip(*part.bounds("paths"), strict=True)):
        limits = {"equals": low} if low == high else {"lower": _finite(low), "upper": _finite(high)}
        phase.add_path_constraint(f"path{k}", **limits)
    for k in range(part.integrals):
        phase.add_state(f"q{k}", rate_source=f"integrand{k}", fix_initial=True)
    return phase


def solve(problem: Any) -> dict[str, Any]:
    """Solve by dymos: Radau on a fixed mesh, and SLSQP."""
    definition = problem.definition
    peer = om.Problem(reports=False)
    peer.driver = om.ScipyOptimizeDriver(optimizer="SLSQP", disp=False)
    peer.driver.declare_coloring(show_summary=False)
    trajectory = peer.model.add_subsystem("traj", dm.Trajectory())
    peer.model.add_subsystem("ends", Ends(function=definition.endpoint))
    names = [f"phase{k}" for k in range(len(definition.phases))]
    phases = [
        trajectory.add_phase(name, _phase(part))
        for name, part in zip(names, definition.phases, strict=True)
    ]
    starts = definition.stacked("parameters", "initial_lower")
    for k, (low, high) in enumerate(zip(*definition.bounds("parameters"), strict=True)):
        free = {"lower": _finite(low), "upper": _finite(high)} if low < high else {}
        trajectory.add_parameter(
            f"p{k}", val=starts[k], opt=bool(low < high), static_target=True,
            targets={name: [f"p{k}"] for name in names}, **free,
        )  # fmt: skip
        peer.model.connect(f"traj.parameter_vals:p{k}", f"ends.p{k}", src_indices=[0])
    entry = 0
    for name, part in zip(names, definition.phases, strict=True):
        states = [f"x{k}" for k in range(len(part.state_names))]
        points = [("time", 0), ("time", -1), *((s, 0) for s in states), *((s, -1) for s in states)]
        points += [(f"q{k}", -1) for k in range(part.integrals)]
        for source, index in points:
            source = f"traj.{name}.timeseries.{source}"
            peer.model.connect(source, f"ends.e{entry}", src_indices=[index], flat_src_indices=True)
            entry += 1
    peer.model.add_objective("ends.objective")
    low, high = definition.bounds("boundaries")
    if low.size:
        equal = low == high
        for rows, limits in (
            (np.flatnonzero(equal), {"equals": low[equal]}),
            (np.flatnonzero(~equal), {"lower": low[~equal], "upper": high[~equal]}),
        ):
            if rows.size:
                alias = "equal" if "equals" in limits else "between"
                peer.model.add_constraint("ends.boundary", indices=rows, alias=alias, **limits)
    peer.setup(force_alloc_complex=False)
    for phase, part in zip(phases, definition.phases, strict=True):
        guess = part.guess
        phase.set_time_val(initial=guess.start, duration=guess.end - guess.start)
        places = np.linspace(0, 1, 4 * SEGMENTS + 1)
        x, u = sampled(guess, places)
        for k, row in enumerate(x):
            phase.set_state_val(f"x{k}", row, 2 * places - 1)
        for k, row in enumerate(u):
            phase.set_control_val(f"u{k}", row, 2 * places - 1)
        for k, value in enumerate(guessed_integrals(part, starts)):
            phase.set_state_val(f"q{k}", [0.0, value])
    dm.run_problem(peer, make_plots=False, simulate=False)
    parts = [
        _nodes(peer, name, phase, part)
        for name, phase, part in zip(names, phases, definition.phases, strict=True)
    ]
    values = [
        float(peer.get_val(f"traj.parameter_vals:p{k}").ravel()[0]) for k in range(starts.size)
    ]
    objective = float(peer.get_val("ends.objective")[0])
    return {
        "status": str(getattr(peer.driver.result, "exit_status", "SUCCESS")),
        "claims": bool(peer.driver.result.success),
        "objective": objective if math.isfinite(objective) else None,
        "plan": plan_of_nodes(definition, parts, values),
    }


def _nodes(peer: Any, name: str, phase: Any, part: Any) -> dict[str, Any]:
    """Return the values at the nodes of one phase."""
    grid = phase.options["transcription"].grid_data
    counts = grid.subset_num_nodes_per_segment["all"]
    cuts = np.cumsum(counts)[:-1]

    def table(kind: str, count: int) -> Any:
        columns = [peer.get_val(f"traj.{name}.timeseries.{kind}{k}").ravel() for k in range(count)]
        return np.array(columns).reshape(count, int(sum(counts))).T

    times = peer.get_val(f"traj.{name}.timeseries.time").ravel()
    ends = np.asarray(grid.segment_ends, float)
    knots = times[0] + (ends - ends[0]) / (ends[-1] - ends[0]) * (times[-1] - times[0])
    nodes = [np.clip(part_nodes, -1, 1) for part_nodes in np.split(grid.node_stau, cuts)]
    return {
        "knots": knots,
        "state_nodes": nodes,
        "control_nodes": nodes,
        "states": np.split(table("x", len(part.state_names)), cuts),
        "controls": np.split(table("u", len(part.control_names)), cuts),
    }
