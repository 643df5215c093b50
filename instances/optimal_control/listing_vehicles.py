"""Catalogue entries of optimal control: rockets, aircraft, robots and reactors."""

from __future__ import annotations

import math

from ..catalogue import CatalogueEntry, Provenance
from . import classic, flight, reactors, robots, rockets
from .entry import BETTS, BRYSON, COPS, MAXIMUM, SHOOTING, entry

__all__ = ["vehicle_entries"]


def vehicle_entries() -> tuple[CatalogueEntry, ...]:
    """Return the benchmark problems of vehicles, robots and reactors."""
    return (*_rockets_and_flight(), *_robots(), *_reactors())


def _rockets_and_flight() -> tuple[CatalogueEntry, ...]:
    goddard = (
        "full thrust, the singular arc m g = (1 + v / c) D and coasting, integrated with DOP853"
    )
    return (
        entry(
            rockets.delta_iii,
            "A rocket of two stages and nine boosters reaches a transfer orbit with most mass",
            f"{BETTS}, section 6.15; D. A. Benson: A Gauss pseudospectral transcription for optimal "
            "control, Massachusetts Institute of Technology, 2005",
            -7529.748477,
            "two transcriptions of this package, Gauss and Radau, which agree to all digits",
            printed="7529.712",
            note=f"{MAXIMUM} Four linked phases with the default guess. The printed value "
            "differs because its propellant flows are rounded.",
        ),
        entry(
            rockets.goddard,
            "Goddard's rocket rises highest: full thrust, singular arc, coasting",
            f"{COPS}, problem 10",
            -1.012836918318,
            goddard,
            printed="1.0128369",
            note=MAXIMUM,
        ),
        entry(
            rockets.goddard_phases,
            "Goddard's rocket in three phases, one per arc",
            f"{BETTS}, section 4.14.1",
            -1.012836918318,
            goddard,
            printed="1.0128369",
            note=f"{MAXIMUM} The phases are linked in all states.",
        ),
        entry(
            flight.hang_glider,
            "The longest glide of a hang glider through a thermal",
            "R. Bulirsch, E. Nerz, H. J. Pesch, O. von Stryk: Combining direct and indirect methods "
            "in optimal control: range maximization of a hang glider, Birkhäuser, 1993; " + BETTS,
            -1248.031026,
            "Betts",
            printed="1248.031026",
            note=MAXIMUM,
        ),
        entry(
            rockets.linear_tangent_steering,
            "The quickest way to a height and a level speed",
            f"{BRYSON}, section 2.4; {COPS}, particle steering",
            0.554570878334603,
            "the tangent of the angle is linear in time",
            analytic=True,
            printed="0.554570879",
        ),
        entry(
            flight.minimum_time_to_climb,
            "The quickest climb of a supersonic fighter to 20 km and Mach 1",
            "A. E. Bryson, M. N. Desai, W. C. Hoffman: Energy-state approximation in performance "
            "optimization of supersonic aircraft, Journal of Aircraft 6, 1969",
            318.186021,
            "two transcriptions of this package, Gauss and Radau, which agree to all digits",
            printed="324.9 by other curves through the same tables",
            note="Thrust, lift and drag come from tables; the default guess is used.",
        ),
        entry(
            rockets.orbit_raising,
            "The largest circular orbit that a low thrust reaches in 3.32",
            f"{BRYSON}, section 2.5",
            -1.525277700649,
            SHOOTING,
            printed="1.5253",
            note=MAXIMUM,
        ),
        entry(
            flight.shuttle_reentry,
            "The space shuttle's largest cross range",
            f"{BETTS}, section 6.1",
            -0.595876076294,
            SHOOTING,
            printed="34.1412°",
            note=f"{MAXIMUM} In radians.",
        ),
        entry(
            rockets.two_stage_ascent,
            "A rocket of two stages reaches orbit with most mass: linked phases",
            f"{BRYSON}, section 2.4",
            -7.615093100307,
            "the linear-tangent law through both stages, by Gauss quadrature",
            analytic=True,
            provenance=Provenance.OURS,
            note=f"{MAXIMUM} The rocket's data are ours.",
        ),
    )


def _robots() -> tuple[CatalogueEntry, ...]:
    ours = Provenance.OURS
    return (
        entry(
            robots.around_discs,
            "The shortest way between two discs",
            "J.-C. Latombe: Robot Motion Planning, Kluwer, 1991",
            4.085899265837,
            "tangents and arcs",
            analytic=True,
            provenance=ours,
            note="Other paths around the discs are local optima: 4.37583 is the next.",
        ),
        entry(
            robots.cart_pole,
            "A pendulum on a cart swings up in 2 s",
            "M. Kelly: An introduction to trajectory optimization, SIAM Review 59, 2017",
            57.94478030673,
            SHOOTING,
            note="The immediate swing-up is a local optimum, too: 58.80766746.",
        ),
        entry(
            robots.container_crane,
            "A crane moves a container in 9 s with little swing",
            "D. Augustin, H. Maurer: Sensitivity analysis and real-time control of a container "
            "crane under state constraints, in Online Optimization of Large Scale Systems, 2001",
            0.0375194596,
            "Augustin and Maurer",
            printed="0.0375194596",
        ),
        entry(
            robots.dubins,
            "The shortest way of a car that turns with radius 1 or more",
            "L. E. Dubins: On curves of minimal length with a constraint on average curvature, "
            "American Journal of Mathematics 79, 1957",
            math.pi + 2 * math.sqrt(5),
            "left, straight, left: π + 2 √5",
            analytic=True,
        ),
        entry(
            robots.free_flying_robot,
            "A robot in space moves by four jets with least propellant",
            "Y. Sakawa: Trajectory planning of a free-flying robot by using the optimal control, "
            f"Optimal Control Applications and Methods 20, 1999; {BETTS}",
            7.910147051122,
            "the times of the eight switches, optimised with DOP853",
            printed="7.9101",
            note="A local optimum: random starts lead to 7.688619.",
        ),
        entry(
            robots.quadrotor,
            "The quickest move of a quadrotor by 5 m",
            "M. Hehn, R. Ritz, R. D'Andrea: Performance benchmarking of quadrotor systems using "
            "time-optimal control, Autonomous Robots 33, 2012",
            1.13185888,
            "full thrust; the pitch rate is bang, singular (where tan of the pitch is linear in "
            "time), bang, singular, bang",
            analytic=True,
        ),
        entry(
            robots.robot_arm,
            "The quickest turn of an arm whose rod slides",
            f"{COPS}, problem 8",
            9.14091175,
            "the switching times of its three bang-bang controls",
            printed="9.14093",
        ),
        entry(
            robots.unicycle,
            "A unicycle parks one space to the side with the least effort",
            "Y. Sachkov, I. Moiseev: Maxwell strata in sub-Riemannian problem on the group of "
            "motions of a plane, ESAIM: COCV 16, 2010",
            11.158158715164,
            SHOOTING,
            provenance=ours,
            note="Two mirrored plans are optimal; the data are ours.",
        ),
        entry(
            classic.brockett,
            "Brockett's integrator: the shortest closed curve around an area",
            "R. W. Brockett: Control theory and singular Riemannian geometry, Springer, 1982",
            2 * math.pi,
            "4 π times the area: a circle",
            analytic=True,
            note="Any direction of the first step is optimal.",
        ),
        entry(
            classic.maximal_range,
            "The greatest range of a thrust of half the weight",
            "A. E. Bryson: Dynamic Optimization, Addison-Wesley, 1999",
            -1.712316,
            "V. M. Becerra: PSOPT manual",
            printed="-1.712316",
            note=MAXIMUM,
        ),
    )


def _reactors() -> tuple[CatalogueEntry, ...]:
    return (
        entry(
            reactors.batch_reactor,
            "The temperature that yields most of the middle product",
            "J. S. Logsdon, L. T. Biegler: Accurate solution of differential-algebraic optimization "
            "problems, Industrial and Engineering Chemistry Research 28, 1989",
            -0.610802920554,
            SHOOTING,
            printed="0.6107775",
            note=MAXIMUM,
        ),
        entry(
            reactors.tubular_reactor,
            "The rate that yields most of B beside C",
            "W. H. Ray: Advanced Process Control, McGraw-Hill, 1981",
            -0.573545057539,
            "the value function along the reactor: one quadrature",
            analytic=True,
            printed="0.57354505",
            note=MAXIMUM,
        ),
        entry(
            reactors.tumor,
            "A tumor starved of its vessels: full dose, singular arc, no dose",
            "U. Ledzewicz, H. Schättler: Analysis of optimal controls for a mathematical model of "
            "tumour anti-angiogenesis, Optimal Control Applications and Methods 29, 2008",
            7571.67158,
            "M. A. Patterson, A. V. Rao: GPOPS-II, ACM Transactions on Mathematical Software 41, 2014",
            printed="7571.67158",
        ),
    )
