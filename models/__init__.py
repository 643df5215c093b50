"""Models, their formulations as programs, and the verification of plans."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy import attach

if TYPE_CHECKING:
    from .attractor import (
        AttractorAnalysis as AttractorAnalysis,
        AttractorEstimate as AttractorEstimate,
        Evidence as Evidence,
        Judgement as Judgement,
        Measures as Measures,
        Slope as Slope,
        Spectrum as Spectrum,
        SurrogateTest as SurrogateTest,
    )
    from .black_box import (
        BlackBoxMinimisation as BlackBoxMinimisation,
        BlackBoxPoint as BlackBoxPoint,
        Named as Named,
        PythonFunction as PythonFunction,
        WaypointPath as WaypointPath,
        as_grid_plan as as_grid_plan,
        path_problem as path_problem,
    )
    from .error_correction import (
        ErrorCorrectionRouting as ErrorCorrectionRouting,
        Route as Route,
        Stop as Stop,
    )
    from .fleet import (
        Deviation as Deviation,
        FleetPlan as FleetPlan,
        FleetRouting as FleetRouting,
        Metric as Metric,
        Objective as Objective,
    )
    from .fleet_mission import (
        FleetMission as FleetMission,
        MissionPlan as MissionPlan,
        MovingObstacle as MovingObstacle,
        lengths_of as lengths_of,
    )
    from .flight import (
        Corridor as Corridor,
        Flight as Flight,
        FlightObjective as FlightObjective,
        FlightPlan as FlightPlan,
        VoxelMap as VoxelMap,
        corridor as corridor,
    )
    from .formulation import Formulation as Formulation
    from .grid_path import (
        Connectivity as Connectivity,
        GridMap as GridMap,
        GridPath as GridPath,
        GridPlan as GridPlan,
        Polygon as Polygon,
        Polygons as Polygons,
        Reach as Reach,
        Sight as Sight,
        as_shapely as as_shapely,
        distances as distances,
        line_of_sight as line_of_sight,
        path_between as path_between,
        trail as trail,
    )
    from .guided_path import (
        GuidedPathPlan as GuidedPathPlan,
        GuidedPathTour as GuidedPathTour,
    )
    from .messenger import (
        MessengerTour as MessengerTour,
        Primitive as Primitive,
        TourPlan as TourPlan,
    )
    from .minimum_snap import (
        FREE as FREE,
        Bound as Bound,
        DifferentialDrive as DifferentialDrive,
        Extremes as Extremes,
        Gate as Gate,
        Halfspaces as Halfspaces,
        MinimumDerivative as MinimumDerivative,
        MinimumSnap as MinimumSnap,
        PointMass as PointMass,
        Quadrotor as Quadrotor,
        TimeAllocation as TimeAllocation,
        Trajectory as Trajectory,
        derivative_name as derivative_name,
    )
    from .model import Model as Model
    from .optimal_control import (
        Arc as Arc,
        Breach as Breach,
        ControlPlan as ControlPlan,
        Estimate as Estimate,
        FlightLimit as FlightLimit,
        HamiltonianReport as HamiltonianReport,
        MinimumReport as MinimumReport,
        MonteCarlo as MonteCarlo,
        OptimalControlProblem as OptimalControlProblem,
        PhasePlan as PhasePlan,
        Piecewise as Piecewise,
        Reintegration as Reintegration,
        RoundedPlan as RoundedPlan,
        Signal as Signal,
        Simulation as Simulation,
        Table as Table,
        covariance as covariance,
        hamiltonian_spread as hamiltonian_spread,
        minimum_principle as minimum_principle,
        monte_carlo as monte_carlo,
        motion as motion,
        round_controls as round_controls,
        scenario_plan as scenario_plan,
        scenarios as scenarios,
        simulate as simulate,
        structure as structure,
        table as table,
    )
    from .problems import (
        model_type as model_type,
        model_types as model_types,
        register_model as register_model,
    )
    from .programs import (
        Block as Block,
        ConeBlock as ConeBlock,
        ConeKind as ConeKind,
        ConicProgram as ConicProgram,
        MixedIntegerProgram as MixedIntegerProgram,
        NonlinearProgram as NonlinearProgram,
        Program as Program,
        ProgramBuilder as ProgramBuilder,
        QuadraticProgram as QuadraticProgram,
    )
    from .resource_routing import (
        Resource as Resource,
        ResourceRouting as ResourceRouting,
    )
    from .satellite_slew import (
        SatelliteSlew as SatelliteSlew,
        Tracking as Tracking,
        track as track,
    )
    from .sequential_ordering import (
        SequentialOrdering as SequentialOrdering,
        SequentialOrderingPlan as SequentialOrderingPlan,
    )
    from .sideslip import (
        Identification as Identification,
        Recording as Recording,
        SideslipEstimate as SideslipEstimate,
        SideslipEstimation as SideslipEstimation,
        Tyre as Tyre,
        Vehicle as Vehicle,
        estimate_speed as estimate_speed,
        identify as identify,
    )
    from .unknown_grid import (
        Aspect as Aspect,
        Camera as Camera,
        Corners as Corners,
        Hover as Hover,
        NavigationRuns as NavigationRuns,
        Outcome as Outcome,
        Rendering as Rendering,
        UnknownGridNavigation as UnknownGridNavigation,
        World as World,
    )
    from .verification import Check as Check, Verification as Verification

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
