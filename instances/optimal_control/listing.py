"""Catalogue entries of optimal control: the field's benchmark problems with reference values."""

from __future__ import annotations

import math

from ..catalogue import CatalogueEntry, Provenance
from . import classic, oscillators, switching
from .entry import ATHANS, BETTS, BRYSON, COPS, MAURER, MAXIMUM, RAO, SHOOTING, VASSILIADIS, entry
from .listing_vehicles import vehicle_entries

__all__ = ["catalogue_entries"]


def catalogue_entries() -> tuple[CatalogueEntry, ...]:
    """Return the benchmark problems of optimal control."""
    return (*_smooth(), *_oscillators(), *_switching(), *vehicle_entries())


def _smooth() -> tuple[CatalogueEntry, ...]:
    ours = Provenance.OURS
    hypersensitive = (
        classic.hypersensitive,
        "Leaves 1.5, rests at 0 and reaches 1",
        RAO,
        1.330806904943,
        (
            "the value functions of the stable and of the unstable manifold, which H = 0 gives: "
            "(F(1.5) - 1.5⁴ + F(1) + 1) / 4 with F(a) = a² √(1 + a⁴) + arsinh a²"
        ),
    )
    return (
        entry(
            classic.brachistochrone,
            "A bead slides from (0, 10) to (10, 5) in the shortest time",
            "Johann Bernoulli: Acta Eruditorum, 1696; " + BRYSON,
            1.801603122453,
            "the cycloid through both points",
            analytic=True,
        ),
        *(
            entry(
                classic.bryson_denham,
                f"Least effort to turn a cart around before a wall at {where}",
                f"{BRYSON}, section 3.11",
                value,
                formula,
                name=name,
                analytic=True,
                limit=limit,
            )
            for name, where, limit, value, formula in (
                ("bryson-denham", "1/9, which it glides along", 1 / 9, 4.0, "4 / (9 l)"),
                ("bryson-denham-touch", "1/5, which it touches", 0.2, 2.24, "2 + 6 (1 - 4 l)²"),
                ("bryson-denham-edge", "1/6, the limit between both", 1 / 6, 8 / 3, "4 / (9 l)"),
                ("bryson-denham-free", "0.3, which it never reaches", 0.3, 2.0, "2"),
            )
        ),
        entry(
            classic.dido,
            "The most land that a rope of 2 m encloses with a straight shore",
            "The problem of Dido; Zenodorus proved the half-disc",
            -2 / math.pi,
            "-l² / (2 π)",
            analytic=True,
            note=MAXIMUM,
        ),
        entry(
            classic.double_integrator_energy,
            "Rest to rest by 1 in a second with least ∫ u² dt",
            BRYSON,
            12.0,
            "u = 6 - 12 t",
            analytic=True,
        ),
        entry(
            classic.hanging_chain,
            "A chain of length 4 between (0, 1) and (1, 3), by its length as an integral",
            f"{COPS}, problem 4",
            5.068480110993,
            "the catenary of that length",
            analytic=True,
            printed="5.06848",
        ),
        entry(*hypersensitive, analytic=True, note="Two boundary layers of width 1 in 10 000."),
        entry(
            *hypersensitive,
            name="hypersensitive-40",
            analytic=True,
            note="The horizon is short enough for a uniform mesh.",
            horizon=40.0,
        ),
        entry(
            classic.linear_regulator,
            "A linear plant and a quadratic cost over 2 time units",
            f"{BRYSON}, chapter 5",
            math.tanh(2 * math.sqrt(2)) / (math.sqrt(2) - math.tanh(2 * math.sqrt(2))),
            "Riccati: tanh(√2 T) / (√2 - tanh(√2 T))",
            analytic=True,
            provenance=ours,
        ),
        entry(
            classic.zermelo,
            "A boat's quickest way home through a shear current",
            f"{BRYSON}, section 2.7",
            5.457865263561,
            "the tangent of the heading is linear in time",
            analytic=True,
            printed="5.46",
        ),
        entry(
            classic.decay_fit,
            "The rate p at which exp(-p t) follows 1 / (1 + t) best: a parameter, and no control",
            "Ours, in the manner of parameter estimation in " + BETTS,
            0.015326220637722,
            "the least of a function of p, p = 0.546581496745",
            analytic=True,
            provenance=ours,
        ),
    )


def _oscillators() -> tuple[CatalogueEntry, ...]:
    return (
        entry(
            oscillators.aly_chan,
            "A double integrator whose optimum is singular throughout",
            "G. M. Aly, W. C. Chan: Application of a modified quasilinearization technique to "
            "totally singular optimal control problems, International Journal of Control 17, 1973",
            0.0,
            "u = -sin t",
            analytic=True,
            note="Many chattering controls come within 1e-9 of the optimum.",
        ),
        entry(
            oscillators.harmonic_oscillator,
            "The quickest way to stop a swing, from (3, 0) with a force of at most 1",
            "L. S. Pontryagin et al.: The Mathematical Theory of Optimal Processes, 1962",
            4.837716811553,
            "arcs of circles in the phase plane: -1 for 0.250656, +1 for π, -1 for 1.445468",
            analytic=True,
        ),
        entry(
            oscillators.rayleigh,
            "Rayleigh's oscillator calmed in 4.5 time units with |u| <= 1",
            MAURER,
            44.720939085,
            SHOOTING,
            printed="44.7209",
        ),
        entry(
            oscillators.rayleigh,
            "Rayleigh's oscillator over 2.5 time units, unlimited, with its end free",
            MAURER,
            29.376079656,
            SHOOTING,
            name="rayleigh-free",
            printed="29.376",
            horizon=2.5,
            limited=False,
        ),
        entry(
            oscillators.van_der_pol,
            "Van der Pol's oscillator damped with -0.3 <= u <= 1",
            VASSILIADIS,
            2.867261045222,
            SHOOTING,
        ),
        entry(
            oscillators.van_der_pol,
            "Van der Pol's oscillator with x1 >= -0.4, along which the optimum runs",
            VASSILIADIS,
            2.953878356004,
            f"{SHOOTING}, with the arc on the bound from 0.629273 to 1.470744",
            name="van-der-pol-limited",
            state_limit=0.4,
        ),
    )


def _switching() -> tuple[CatalogueEntry, ...]:
    return (
        entry(
            switching.catalyst_mixing,
            "Most end product from two catalysts: bang, singular arc, bang",
            f"{COPS}, problem 14",
            -0.048055685860877,
            "matrix exponentials between 0.136299 and 0.725230, with mixture 0.227142",
            analytic=True,
            printed="-4.80556e-2",
        ),
        entry(
            switching.double_integrator,
            "Rest to rest by 1 in least time with |u| <= 1",
            ATHANS,
            2.0,
            "2 √d",
            analytic=True,
        ),
        entry(
            switching.double_integrator_fuel,
            "Rest to rest by 1 in 2.5 with least fuel: push, coast, brake",
            ATHANS,
            1.0,
            "T - √(T² - 4)",
            analytic=True,
        ),
        entry(
            switching.lotka_volterra_fishing,
            "When to fish so that prey and predators settle",
            "S. Sager: Numerical Methods for Mixed-Integer Optimal Control Problems, 2005; "
            "https://mintoc.de",
            1.34408,
            "the relaxed problem, as printed",
            printed="1.34408",
            note="Fishing is on or off; the value is that of the relaxed problem, a lower bound.",
        ),
        entry(
            switching.singular_regulator,
            "A double integrator comes to rest by way of a singular arc",
            "D. H. Jacobson, S. B. Gershwin, M. M. Lele: Computation of optimal singular controls, "
            "IEEE Transactions on Automatic Control 15, 1970",
            0.376991931,
            "the Gauss scheme at a tolerance of 1e-8",
            printed="0.7539839, for twice the integral",
        ),
        entry(
            switching.moon_lander,
            "A soft landing with least thrust: fall, then brake",
            "J. S. Meditch: On the problem of optimal thrust programming for a lunar soft landing, "
            "IEEE Transactions on Automatic Control 9, 1964",
            2 * math.sqrt(17),
            "2 √17",
            analytic=True,
        ),
    )
