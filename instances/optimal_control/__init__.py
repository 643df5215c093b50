"""Benchmark problems of optimal control, each a function that returns the declared problem."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .classic import (
        brachistochrone,
        bryson_denham,
        dido,
        double_integrator_energy,
        hanging_chain,
        hypersensitive,
        linear_regulator,
        zermelo,
    )
    from .estimation import decay_fit
    from .flight import hang_glider, shuttle_reentry
    from .oscillators import aly_chan, harmonic_oscillator, rayleigh, van_der_pol
    from .robots import (
        around_discs,
        cart_pole,
        container_crane,
        dubins,
        free_flying_robot,
        quadrotor,
        robot_arm,
    )
    from .rockets import (
        goddard,
        goddard_phases,
        linear_tangent_steering,
        orbit_raising,
        two_stage_ascent,
    )
    from .switching import (
        catalyst_mixing,
        double_integrator,
        double_integrator_fuel,
        moon_lander,
    )

__all__ = [
    "aly_chan",
    "around_discs",
    "brachistochrone",
    "bryson_denham",
    "cart_pole",
    "catalyst_mixing",
    "container_crane",
    "decay_fit",
    "dido",
    "double_integrator",
    "double_integrator_energy",
    "double_integrator_fuel",
    "dubins",
    "free_flying_robot",
    "goddard",
    "goddard_phases",
    "hang_glider",
    "hanging_chain",
    "harmonic_oscillator",
    "hypersensitive",
    "linear_regulator",
    "linear_tangent_steering",
    "moon_lander",
    "orbit_raising",
    "quadrotor",
    "rayleigh",
    "robot_arm",
    "shuttle_reentry",
    "two_stage_ascent",
    "van_der_pol",
    "zermelo",
]

_HOMES = {
    "aly_chan": "oscillators",
    "around_discs": "robots",
    "brachistochrone": "classic",
    "bryson_denham": "classic",
    "cart_pole": "robots",
    "catalyst_mixing": "switching",
    "container_crane": "robots",
    "decay_fit": "estimation",
    "dido": "classic",
    "double_integrator": "switching",
    "double_integrator_energy": "classic",
    "double_integrator_fuel": "switching",
    "dubins": "robots",
    "free_flying_robot": "robots",
    "goddard": "rockets",
    "goddard_phases": "rockets",
    "hang_glider": "flight",
    "hanging_chain": "classic",
    "harmonic_oscillator": "oscillators",
    "hypersensitive": "classic",
    "linear_regulator": "classic",
    "linear_tangent_steering": "rockets",
    "moon_lander": "switching",
    "orbit_raising": "rockets",
    "quadrotor": "robots",
    "rayleigh": "oscillators",
    "robot_arm": "robots",
    "shuttle_reentry": "flight",
    "two_stage_ascent": "rockets",
    "van_der_pol": "oscillators",
    "zermelo": "classic",
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
