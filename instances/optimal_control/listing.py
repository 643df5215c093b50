"""What the catalogue holds of optimal control: the field's benchmark problems with their values."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

from ...models.optimal_control.model import OptimalControlProblem
from ..catalogue import CatalogueEntry, Provenance
from . import classic, estimation, flight, oscillators, robots, rockets, switching

__all__ = ["catalogue_entries"]

_BRYSON = "A. E. Bryson, Y.-C. Ho: Applied Optimal Control, Hemisphere, 1975"
_BETTS = (
    "J. T. Betts: Practical Methods for Optimal Control and Estimation Using Nonlinear "
    "Programming, SIAM, 2010"
)
_COPS = (
    "E. D. Dolan, J. J. Moré, T. S. Munson: Benchmarking Optimization Software with COPS 3.0, "
    "Argonne National Laboratory, 2004"
)
_MAURER = (
    "H. Maurer, D. Augustin: Sensitivity analysis and real-time control of parametric optimal "
    "control problems using boundary value methods, in Online Optimization of Large Scale "
    "Systems, Springer, 2001"
)
_VASSILIADIS = (
    "V. S. Vassiliadis, R. W. H. Sargent, C. C. Pantelides: Solution of a class of multistage "
    "dynamic optimization problems, Industrial and Engineering Chemistry Research 33, 1994"
)
_RAO = (
    "A. V. Rao, K. D. Mease: Eigenvector approximate dichotomic basis method for solving "
    "hyper-sensitive optimal control problems, Optimal Control Applications and Methods 21, 2000"
)
_ATHANS = "M. Athans, P. L. Falb: Optimal Control, McGraw-Hill, 1966"

_SHOOTING = "Pontryagin's conditions, shot with DOP853"
_MAXIMUM = "A maximum is sought, so the objective has the opposite sign."


def _entry(
    problem: Callable[..., OptimalControlProblem],
    title: str,
    paper: str,
    objective: float,
    source: str,
    *,
    name: str = "",
    analytic: bool = False,
    printed: str = "",
    provenance: Provenance = Provenance.PUBLIC,
    note: str = "",
    **options: Any,
) -> CatalogueEntry:
    """Return an entry; `analytic` says that the value follows from a formula or one root of it."""
    full = f"optimal-control/{name or problem.__name__.replace('_', '-')}"
    published: dict[str, Any] = {"objective": objective, "source": source, "analytic": analytic}
    words = [note, f"Value: {source}."]
    if printed:
        published["printed"] = printed
        words.append(f"Printed: {printed}.")
    return CatalogueEntry(
        name=full,
        model="optimal-control",
        title=title,
        paper=paper,
        provenance=provenance,
        builder=partial(_build, problem, full, **options),
        published=published,
        note=" ".join(filter(None, words)),
    )


def _build(
    problem: Callable[..., OptimalControlProblem], name: str, **options: Any
) -> OptimalControlProblem:
    """Return the problem that is declared: the functions return builders, to declare more in."""
    return problem(name, **options).build()


def catalogue_entries() -> tuple[CatalogueEntry, ...]:
    """Return the benchmark problems of optimal control."""
    return (*_smooth(), *_oscillators(), *_switching(), *_rockets_and_flight(), *_robots())


def _smooth() -> tuple[CatalogueEntry, ...]:
    ours = Provenance.OURS
    hypersensitive = (
        classic.hypersensitive,
        "Leaves 1.5, rests at 0 and reaches 1",
        _RAO,
        1.330806904943,
        (
            "the value functions of the stable and of the unstable manifold, which H = 0 gives: "
            "(F(1.5) - 1.5⁴ + F(1) + 1) / 4 with F(a) = a² √(1 + a⁴) + arsinh a²"
        ),
    )
    return (
        _entry(
            classic.brachistochrone,
            "A bead slides from (0, 10) to (10, 5) in the shortest time",
            "Johann Bernoulli: Acta Eruditorum, 1696; " + _BRYSON,
            1.801603122453,
            "the cycloid through both points",
            analytic=True,
        ),
        *(
            _entry(
                classic.bryson_denham,
                f"Least effort to turn a cart around before a wall at {where}",
                f"{_BRYSON}, section 3.11",
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
        _entry(
            classic.dido,
            "The most land that a rope of 2 m encloses with a straight shore",
            "The problem of Dido; Zenodorus proved the half-disc",
            -2 / math.pi,
            "-l² / (2 π)",
            analytic=True,
            note=_MAXIMUM,
        ),
        _entry(
            classic.double_integrator_energy,
            "Rest to rest by 1 in a second with least ∫ u² dt",
            _BRYSON,
            12.0,
            "u = 6 - 12 t",
            analytic=True,
        ),
        _entry(
            classic.hanging_chain,
            "A chain of length 4 between (0, 1) and (1, 3), by its length as an integral",
            f"{_COPS}, problem 4",
            5.068480110993,
            "the catenary of that length",
            analytic=True,
            printed="5.06848",
        ),
        _entry(*hypersensitive, analytic=True, note="Two boundary layers of width 1 in 10 000."),
        _entry(
            *hypersensitive,
            name="hypersensitive-40",
            analytic=True,
            note="The horizon is short enough for a uniform mesh.",
            horizon=40.0,
        ),
        _entry(
            classic.linear_regulator,
            "A linear plant and a quadratic cost over 2 time units",
            f"{_BRYSON}, chapter 5",
            math.tanh(2 * math.sqrt(2)) / (math.sqrt(2) - math.tanh(2 * math.sqrt(2))),
            "Riccati: tanh(√2 T) / (√2 - tanh(√2 T))",
            analytic=True,
            provenance=ours,
        ),
        _entry(
            classic.zermelo,
            "A boat's quickest way home through a shear current",
            f"{_BRYSON}, section 2.7",
            5.457865263561,
            "the tangent of the heading is linear in time",
            analytic=True,
            printed="5.46",
        ),
        _entry(
            estimation.decay_fit,
            "The rate p at which exp(-p t) follows 1 / (1 + t) best: a parameter, and no control",
            "Ours, in the manner of parameter estimation in " + _BETTS,
            0.015326220637722,
            "the least of a function of p, p = 0.546581496745",
            analytic=True,
            provenance=ours,
        ),
    )


def _oscillators() -> tuple[CatalogueEntry, ...]:
    return (
        _entry(
            oscillators.aly_chan,
            "A double integrator whose optimum is singular throughout",
            "G. M. Aly, W. C. Chan: Application of a modified quasilinearization technique to "
            "totally singular optimal control problems, International Journal of Control 17, 1973",
            0.0,
            "u = -sin t",
            analytic=True,
            note="Many controls come within 1e-9 of the optimum; they chatter.",
        ),
        _entry(
            oscillators.harmonic_oscillator,
            "The quickest way to stop a swing, from (3, 0) with a force of at most 1",
            "L. S. Pontryagin et al.: The Mathematical Theory of Optimal Processes, 1962",
            4.837716811553,
            "arcs of circles in the phase plane: -1 for 0.250656, +1 for π, -1 for 1.445468",
            analytic=True,
        ),
        _entry(
            oscillators.rayleigh,
            "Rayleigh's oscillator calmed in 4.5 time units with |u| <= 1",
            _MAURER,
            44.720939085,
            _SHOOTING,
            printed="44.7209",
        ),
        _entry(
            oscillators.rayleigh,
            "Rayleigh's oscillator over 2.5 time units, unlimited, with its end free",
            _MAURER,
            29.376079656,
            _SHOOTING,
            name="rayleigh-free",
            printed="29.376",
            horizon=2.5,
            limited=False,
        ),
        _entry(
            oscillators.van_der_pol,
            "Van der Pol's oscillator damped with -0.3 <= u <= 1",
            _VASSILIADIS,
            2.867261045222,
            _SHOOTING,
        ),
        _entry(
            oscillators.van_der_pol,
            "Van der Pol's oscillator with x1 >= -0.4, along which the optimum runs",
            _VASSILIADIS,
            2.953878356004,
            f"{_SHOOTING}, with the arc on the bound from 0.629273 to 1.470744",
            name="van-der-pol-limited",
            state_limit=0.4,
        ),
    )


def _switching() -> tuple[CatalogueEntry, ...]:
    return (
        _entry(
            switching.catalyst_mixing,
            "Most end product from two catalysts: bang, singular arc, bang",
            f"{_COPS}, problem 14",
            -0.048055685860877,
            "matrix exponentials between 0.136299 and 0.725230, with mixture 0.227142",
            analytic=True,
            printed="-4.80556e-2",
        ),
        _entry(
            switching.double_integrator,
            "Rest to rest by 1 in least time with |u| <= 1",
            _ATHANS,
            2.0,
            "2 √d",
            analytic=True,
        ),
        _entry(
            switching.double_integrator_fuel,
            "Rest to rest by 1 in 2.5 with least fuel: push, coast, brake",
            _ATHANS,
            1.0,
            "T - √(T² - 4)",
            analytic=True,
        ),
        _entry(
            switching.moon_lander,
            "A soft landing with least thrust: fall, then brake",
            "J. S. Meditch: On the problem of optimal thrust programming for a lunar soft landing, "
            "IEEE Transactions on Automatic Control 9, 1964",
            2 * math.sqrt(17),
            "2 √17",
            analytic=True,
        ),
    )


def _rockets_and_flight() -> tuple[CatalogueEntry, ...]:
    goddard = (
        "full thrust, the singular arc m g = (1 + v / c) D and coasting, integrated with DOP853"
    )
    return (
        _entry(
            rockets.goddard,
            "Goddard's rocket rises highest: full thrust, singular arc, coasting",
            f"{_COPS}, problem 10",
            -1.012836918318,
            goddard,
            printed="1.0128369",
            note=_MAXIMUM,
        ),
        _entry(
            rockets.goddard_phases,
            "Goddard's rocket in three phases, one an arc",
            f"{_BETTS}, section 4.14.1",
            -1.012836918318,
            goddard,
            printed="1.0128369",
            note=f"{_MAXIMUM} The phases are linked in all states.",
        ),
        _entry(
            flight.hang_glider,
            "The longest glide of a hang glider through a thermal",
            "R. Bulirsch, E. Nerz, H. J. Pesch, O. von Stryk: Combining direct and indirect methods "
            "in optimal control: range maximization of a hang glider, Birkhäuser, 1993; " + _BETTS,
            -1248.031026,
            "Betts",
            printed="1248.031026",
            note=_MAXIMUM,
        ),
        _entry(
            rockets.linear_tangent_steering,
            "The quickest way to a height and a level speed",
            f"{_BRYSON}, section 2.4; {_COPS}, particle steering",
            0.554570878334603,
            "the tangent of the angle is linear in time",
            analytic=True,
            printed="0.554570879",
        ),
        _entry(
            rockets.orbit_raising,
            "The largest circular orbit that a low thrust reaches in 3.32",
            f"{_BRYSON}, section 2.5",
            -1.525277700649,
            _SHOOTING,
            printed="1.5253",
            note=_MAXIMUM,
        ),
        _entry(
            flight.shuttle_reentry,
            "The space shuttle's largest cross range",
            f"{_BETTS}, section 6.1",
            -0.595876076294,
            _SHOOTING,
            printed="34.1412°",
            note=f"{_MAXIMUM} In radians.",
        ),
        _entry(
            rockets.two_stage_ascent,
            "A rocket of two stages reaches orbit with most mass: linked phases",
            f"{_BRYSON}, section 2.4",
            -7.615093100307,
            "the linear-tangent law through both stages, by Gauss quadrature",
            analytic=True,
            provenance=Provenance.OURS,
            note=f"{_MAXIMUM} The numbers of the rocket are ours.",
        ),
    )


def _robots() -> tuple[CatalogueEntry, ...]:
    ours = Provenance.OURS
    return (
        _entry(
            robots.around_discs,
            "The shortest way between two discs",
            "J.-C. Latombe: Robot Motion Planning, Kluwer, 1991",
            4.085899265837,
            "tangents and arcs",
            analytic=True,
            provenance=ours,
            note="Other ways around the discs are local optima: 4.37583 is the next.",
        ),
        _entry(
            robots.cart_pole,
            "A pendulum on a cart swings up in 2 s",
            "M. Kelly: An introduction to trajectory optimization, SIAM Review 59, 2017",
            57.94478030673,
            _SHOOTING,
            note="The swing-up at once is a local optimum too, 58.80766746.",
        ),
        _entry(
            robots.container_crane,
            "A crane moves a container in 9 s with little swing",
            "D. Augustin, H. Maurer: Sensitivity analysis and real-time control of a container "
            "crane under state constraints, in Online Optimization of Large Scale Systems, 2001",
            0.0375194596,
            "Augustin and Maurer",
            printed="0.0375194596",
        ),
        _entry(
            robots.dubins,
            "The shortest way of a car that turns with radius 1 or more",
            "L. E. Dubins: On curves of minimal length with a constraint on average curvature, "
            "American Journal of Mathematics 79, 1957",
            math.pi + 2 * math.sqrt(5),
            "left, straight, left: π + 2 √5",
            analytic=True,
        ),
        _entry(
            robots.free_flying_robot,
            "A robot in space moves by four jets with least propellant",
            "Y. Sakawa: Trajectory planning of a free-flying robot by using the optimal control, "
            f"Optimal Control Applications and Methods 20, 1999; {_BETTS}",
            7.910147051122,
            "the times of the eight switches, optimised with DOP853",
            printed="7.9101",
        ),
        _entry(
            robots.quadrotor,
            "The quickest move of a quadrotor by 5 m",
            "M. Hehn, R. Ritz, R. D'Andrea: Performance benchmarking of quadrotor systems using "
            "time-optimal control, Autonomous Robots 33, 2012",
            1.13185888,
            "full thrust; the pitch rate is bang, singular (where tan of the pitch is linear in "
            "time), bang, singular, bang",
            analytic=True,
        ),
        _entry(
            robots.robot_arm,
            "The quickest turn of an arm whose rod slides",
            f"{_COPS}, problem 8",
            9.14091175,
            "the switching times of its three bang-bang controls",
            printed="9.14093",
        ),
    )
