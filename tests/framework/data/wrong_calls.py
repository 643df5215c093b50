"""Calls that type checkers must report, each with its error code; test_packaging.py reads this file."""

import crosstrack as ct
from crosstrack import models as m

m.AttractorAnalysis("series")  # arg-type
m.BlackBoxMinimisation("rastrigin", bounds={"x": 1})  # arg-type
m.ErrorCorrectionRouting([[0, 0, 0]], kinds=[1])  # list-item
m.FleetRouting("two")  # arg-type
m.FleetRouting(2, point=[[0, 0]])  # call-arg
m.FleetMission(vehicles="one")  # arg-type
m.Flight([], (0, 0), (1, 1), m.PointMass(), raduis=1)  # call-arg
m.GridPath(3, (0, 0))  # arg-type
m.GridMap(["..."], cel=2.0)  # call-arg
m.GuidedPathTour([0, 1], chains=[1])  # list-item
m.MessengerTour(positions="here")  # arg-type
m.MinimumDerivative([[0]], [0], order="snap")  # arg-type
m.MinimumSnap([[0]], [0], order=3)  # call-arg
m.TimeAllocation([[0]], time_weights=1)  # call-arg
m.OptimalControlProblem(name=3)  # arg-type
m.ResourceRouting(["a"], resources=["fuel"])  # list-item
m.SatelliteSlew(margn=0.1)  # call-arg
m.SequentialOrdering([[0]], ids=3)  # arg-type
m.SideslipEstimation(vehicle=3)  # arg-type
m.UnknownGridNavigation(steps="many")  # arg-type
m.MixedIntegerProgram(costs=[1.0])  # call-arg

fleet = m.FleetRouting(2, points=[[0, 0], [1, 0], [2, 0]])
fleet.vehicles = 3  # misc
print(fleet.vehicels)  # attr-defined
ct.solvee(fleet)  # attr-defined
print(ct.models.FleetRoutng)  # attr-defined
ct.solve([fleet])  # arg-type
ct.solve(fleet, time_limits=5)  # call-arg
ct.solve(fleet, time_limit="5 s")  # arg-type
print(ct.solve(fleet).plan.routes)  # union-attr
ct.compare(fleet)  # call-arg
ct.load("fleet/two-depots", models="fleet")  # call-arg
ct.verify("fleet", [])  # arg-type
