"""Calls that type checkers must accept, one model of each kind; test_packaging.py reads this file."""

from typing import Any, assert_type

import numpy as np
from numpy.typing import NDArray

import crosstrack as ct
from crosstrack import models as m

still, moving = np.zeros(12), 10.0 + np.arange(12.0)
grid = m.GridMap(["...", ".@.", "..."], cell=2.0)
drive = m.Recording(0.1 * np.arange(12.0), moving, still, still, still)
attractor = m.AttractorAnalysis(np.sin(np.arange(60.0)).tolist(), 0.5, "m")
black_box = m.BlackBoxMinimisation("rastrigin", [[-5, 5], [2, 2]], budget=50)
builder = m.ProgramBuilder()
builder.columns("x", 2, upper=[4.0, 5.0], cost=[1.0, 2.0], integral=True)
mixed = builder.build(name="mixed")
error_correction = m.ErrorCorrectionRouting(
    [[0, 0, 0], [1, 0, 0], [2, 0, 0]], ["A", "horizontal", "B"], 3, 3, 3, 3, 3, delta=0.1
)
fleet = m.FleetRouting(2, points=[(2, 0), (4, 0), (4, 4)], map=grid, metric="grid", objective="sum")
mission = m.FleetMission([], (0, 0, 10, 10), [[8, 2]], (1, 1), vehicles=1, cell=0.5)
flight = m.Flight(grid, (1, 1), (5, 1), m.PointMass(speed=2.0, acceleration=1.0))
grid_path = m.GridPath({"blocked": ["..."]}, (0, 0), [[0, 2]], connectivity=m.Connectivity.FOUR)
guided = m.GuidedPathTour([0, 3, -1, 2.5], chains=[[1, 2]], ids=("a", 1, "c", 2))
messenger = m.MessengerTour([[0, 30], [9, 60]], [[0, 0], [1, -2]], radius=5)
derivative = m.MinimumDerivative([[0, 0], [1, None]], [0.0, 1.0], order=3, weights=[1, 0, 2])
snap = m.MinimumSnap([[0.0, 0.0], [1.0, 2.0]], times=(0, 1), velocity_limit=[8.0, 9.0])
allocation = m.TimeAllocation(np.array([[0.0, 0.0], [1.0, 2.0]]), time_weight=100)
builder_of_control = m.OptimalControlProblem("integrator")
phase = builder_of_control.phase(time=(0, 1))
position, push = phase.state("position", initial=0, final=1), phase.control("push")
phase.dynamics({position: push})
builder_of_control.minimise(phase.integral(push**2))
control = builder_of_control.build()
ordering = m.SequentialOrdering([[0, 1], [None, 0]], precedence=[[0, 1]], ids=("a", 1))
errand = m.ResourceRouting(
    ["start", "end"], [m.Resource("fuel", 1.0)], 0, 1, [[0, 0], [1, 2]], [[0, 1]]
)
slew = m.SatelliteSlew.about("roll", 45.0, margin=0.1)
vehicle = {
    "mass": 1500.0, "yaw_inertia": 2500.0, "front": 1.2, "rear": 1.5, "cornering_front": 8e4,
    "cornering_rear": 9e4,
}  # fmt: skip
sideslip = m.SideslipEstimation(vehicle, drive, initial=(0, 0))
unknown = m.UnknownGridNavigation.drawn("S..\n..T", view=(3, 3), steps=9)


def plans() -> None:
    """State the types of plans; type checkers alone read it."""
    assert_type(ct.solve(attractor).plan, m.AttractorEstimate | None)
    assert_type(ct.solve(black_box).plan, m.BlackBoxPoint | None)
    assert_type(ct.solve(error_correction, time_limit=5).plan, m.Route | None)
    assert_type(ct.solve(mixed).plan, NDArray[np.float64] | None)
    assert_type(ct.solve(fleet, "auto", seed=1).plan, m.FleetPlan | None)
    assert_type(ct.solve(mission).plan, m.MissionPlan | None)
    assert_type(ct.solve(flight).plan, m.FlightPlan | None)
    assert_type(ct.plan_flight(grid, (1, 1), (5, 1), m.PointMass(2.0)).plan, m.FlightPlan | None)
    assert_type(ct.solve(grid_path).plan, m.GridPlan | None)
    assert_type(ct.solve(guided).plan, m.GuidedPathPlan | None)
    assert_type(ct.solve(messenger).plan, m.TourPlan | None)
    assert_type(ct.solve(derivative).plan, m.Trajectory | None)
    assert_type(ct.solve(snap).plan, m.Trajectory | None)
    assert_type(ct.solve(allocation).plan, m.Trajectory | None)
    assert_type(ct.solve(control).plan, m.ControlPlan | None)
    assert_type(ct.solve(errand).plan, m.Route | None)
    assert_type(ct.solve(ordering).plan, m.SequentialOrderingPlan | None)
    assert_type(ct.solve(slew).plan, m.ControlPlan | None)
    assert_type(ct.solve(sideslip).plan, m.SideslipEstimate | None)
    assert_type(ct.solve(unknown).plan, m.NavigationRuns | None)
    assert_type(ct.solve(ct.load("fleet/two-depots")).plan, Any | None)
    assert_type(ct.load("fleet/two-depots"), m.Model[Any])
    assert_type(ct.verify(fleet, {"routes": [[1], [2]]}), m.Verification)
    assert_type(ct.verify(fleet, ct.solve(fleet)).ok, bool)
    assert_type(ct.compare([fleet, snap], ["highs"], repeats=2), ct.Comparison)
    assert_type(ct.backends(fleet), tuple[ct.solvers.BackendState, ...])
    best = ct.solve(fleet)
    if best.plan is not None:
        assert_type(best.plan.routes, tuple[tuple[int, ...], ...])
    assert fleet.points is not None
    assert_type(fleet.points.tolist(), Any)
    assert_type(fleet.objective, m.Objective)
    assert_type(snap.waypoints.shape, tuple[Any, ...])
    assert_type(ct.instances.entry("fleet/two-depots").title, str)
