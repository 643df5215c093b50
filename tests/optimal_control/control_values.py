"""Catalogue entries whose values are derived independently."""

import math

from derived_closed import (
    around_discs,
    batch_reactor,
    brachistochrone,
    catalyst_mixing,
    decay_fit,
    dubins,
    hanging_chain,
    harmonic_oscillator,
    hypersensitive,
    linear_regulator,
    linear_tangent_steering,
    moon_lander,
    quadrotor,
    tubular_reactor,
    two_stage_ascent,
    unicycle,
    zermelo,
)
from derived_extremals import (
    cart_pole,
    free_flying_robot,
    goddard,
    orbit_raising,
    rayleigh,
    rayleigh_free,
    robot_arm,
    shuttle_reentry,
    van_der_pol,
    van_der_pol_limited,
)
from scipy.integrate import quad

from crosstrack import instances

KIND = "optimal-control"


ENTRIES = {
    e.name.partition("/")[2]: e for e in instances.entries() if e.name.startswith(f"{KIND}/")
}


DERIVED = {
    "aly-chan": lambda: quad(lambda t: (math.cos(t) ** 2 - math.sin(t) ** 2) / 2, 0, math.pi / 2)[
        0
    ],
    "around-discs": around_discs,
    "batch-reactor": batch_reactor,
    "brachistochrone": brachistochrone,
    "brockett": lambda: (2 * math.pi * math.sqrt(0.5 / math.pi)) ** 2,
    "bryson-denham": lambda: 4 / (9 * (1 / 9)),
    "bryson-denham-edge": lambda: 2 + 6 * (1 - 4 / 6) ** 2,
    "bryson-denham-free": lambda: quad(lambda t: 2.0, 0, 1)[0],
    "bryson-denham-touch": lambda: 2 + 6 * (1 - 4 / 5) ** 2,
    "cart-pole": cart_pole,
    "catalyst-mixing": catalyst_mixing,
    "decay-fit": decay_fit,
    "dido": lambda: -math.pi * (2 / math.pi) ** 2 / 2,
    "double-integrator": lambda: 2 * math.sqrt(1),
    "double-integrator-energy": lambda: quad(lambda t: (6 - 12 * t) ** 2, 0, 1)[0],
    "double-integrator-fuel": lambda: 2.5 - math.sqrt(2.5**2 - 4),
    "dubins": dubins,
    "free-flying-robot": free_flying_robot,
    "goddard": goddard,
    "goddard-phases": goddard,
    "hanging-chain": hanging_chain,
    "harmonic-oscillator": harmonic_oscillator,
    "hypersensitive": hypersensitive,
    "hypersensitive-40": hypersensitive,
    "linear-regulator": linear_regulator,
    "linear-tangent-steering": linear_tangent_steering,
    "moon-lander": moon_lander,
    "orbit-raising": orbit_raising,
    "quadrotor": quadrotor,
    "rayleigh": rayleigh,
    "rayleigh-free": rayleigh_free,
    "robot-arm": robot_arm,
    "shuttle-reentry": shuttle_reentry,
    "tubular-reactor": tubular_reactor,
    "two-stage-ascent": two_stage_ascent,
    "unicycle": unicycle,
    "van-der-pol": van_der_pol,
    "van-der-pol-limited": van_der_pol_limited,
    "zermelo": zermelo,
}


#: Their values are the literature's.
PRINTED = {
    "container-crane",
    "delta-iii",
    "hang-glider",
    "lotka-volterra-fishing",
    "maximal-range",
    "minimum-time-to-climb",
    "singular-regulator",
    "tumor",
}
