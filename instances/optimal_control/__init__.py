"""Benchmark problems of optimal control, each as a function that returns the declared problem."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...lazy import attach

if TYPE_CHECKING:
    from .classic import (
        brachistochrone as brachistochrone,
        brockett as brockett,
        bryson_denham as bryson_denham,
        decay_fit as decay_fit,
        dido as dido,
        double_integrator_energy as double_integrator_energy,
        hanging_chain as hanging_chain,
        hypersensitive as hypersensitive,
        linear_regulator as linear_regulator,
        maximal_range as maximal_range,
        zermelo as zermelo,
    )
    from .flight import (
        hang_glider as hang_glider,
        minimum_time_to_climb as minimum_time_to_climb,
        shuttle_reentry as shuttle_reentry,
    )
    from .robots import (
        around_discs as around_discs,
        cart_pole as cart_pole,
        container_crane as container_crane,
        dubins as dubins,
        free_flying_robot as free_flying_robot,
        quadrotor as quadrotor,
        robot_arm as robot_arm,
        unicycle as unicycle,
    )
    from .rockets import (
        delta_iii as delta_iii,
        goddard as goddard,
        goddard_phases as goddard_phases,
        linear_tangent_steering as linear_tangent_steering,
        orbit_raising as orbit_raising,
        two_stage_ascent as two_stage_ascent,
    )
    from .switching import (
        aly_chan as aly_chan,
        batch_reactor as batch_reactor,
        catalyst_mixing as catalyst_mixing,
        double_integrator as double_integrator,
        double_integrator_fuel as double_integrator_fuel,
        harmonic_oscillator as harmonic_oscillator,
        lotka_volterra_fishing as lotka_volterra_fishing,
        moon_lander as moon_lander,
        rayleigh as rayleigh,
        singular_regulator as singular_regulator,
        tubular_reactor as tubular_reactor,
        tumor as tumor,
        van_der_pol as van_der_pol,
    )

CATALOGUE = {"optimal-control": ".listing:catalogue_entries"}
TEMPLATES = {"optimal-control": "optimal-control/linear-regulator"}
EXPORTS = {"samples": ".tables:SAMPLES"}
PAPERS = {"optimal-control": ".paper:PAPER"}

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__, __dir__, __all__ = attach(__name__, __file__)
