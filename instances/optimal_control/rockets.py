"""Rockets: the linear-tangent steering law, staging, orbits, and a sounding rocket's thrust."""

from __future__ import annotations

import itertools
import math
from typing import Any

from ...models.optimal_control.model import OptimalControlProblem
from .benchmark import benchmark


@benchmark
def linear_tangent_steering(ocp: OptimalControlProblem) -> None:
    """Return the fastest way to height 5 and horizontal speed 45, at a constant acceleration of 100.

    The tangent of the optimal angle decreases linearly in time (Bryson and Ho, 1975, section 2.4; the
    numbers are those of "particle steering" in COPS 3.0, 2004).
    """
    import casadi

    phase = ocp.phase(time=(0, (0.1, 5)))
    x = phase.state("x", initial=0, lower=0, upper=100)
    y = phase.state("y", initial=0, final=5, lower=0, upper=20)
    vx = phase.state("vx", initial=0, final=45, lower=-100, upper=100)
    vy = phase.state("vy", initial=0, final=0, lower=-100, upper=100)
    angle = phase.control("angle", lower=-math.pi / 2, upper=math.pi / 2, unit="rad")
    phase.dynamics({x: vx, y: vy, vx: 100 * casadi.cos(angle), vy: 100 * casadi.sin(angle)})
    phase.guess(time=[0, 0.3, 0.6], x=[0, 3, 12], vy=[0, 20, 0], angle=[1, 0, -1])
    ocp.minimise(phase.end)


#: Two stages: thrust (t km/s²), propellant flow (t/s), and mass at ignition and at burn-out (t). The
#: second may stop before burn-out.
STAGES = ((1.8, 0.64, 120.0, 40.0), (0.35, 0.08, 30.0, 4.0))
#: g on a flat Earth (km/s²), and the height and speed of the orbit (km and km/s).
GRAVITY, ORBIT_HEIGHT, ORBIT_SPEED = 0.00981, 200.0, 7.8


@benchmark
def two_stage_ascent(ocp: OptimalControlProblem) -> None:
    """Return the ascent of a two-stage rocket into orbit with the largest final mass.

    Two phases are linked in position and velocity, while the mass drops by the empty first stage.
    The Earth is flat and airless, so the linear-tangent law holds through both stages (Bryson and
    Ho, 1975, section 2.4).
    """
    import casadi

    burn = (STAGES[0][2] - STAGES[0][3]) / STAGES[0][1]
    longest = (STAGES[1][2] - STAGES[1][3]) / STAGES[1][1]
    phases = []
    for k, (thrust, flow, full, empty) in enumerate(STAGES):
        first = k == 0
        phase = ocp.phase(
            f"stage {k + 1}", time=(0, burn) if first else (burn, (burn + 50, burn + longest))
        )
        ends = (0, 0, 0, 0) if first else (None, None, None, None)
        to = (None, None, None, None) if first else (None, ORBIT_HEIGHT, ORBIT_SPEED, 0)
        x = phase.state("x", initial=ends[0], lower=0, upper=4000, scale=1000, unit="km")
        y = phase.state(
            "y", initial=ends[1], final=to[1], lower=0, upper=1000, scale=200, unit="km"
        )
        vx = phase.state("vx", initial=ends[2], final=to[2], lower=0, upper=10, unit="km/s")
        vy = phase.state("vy", initial=ends[3], final=to[3], lower=-2, upper=5, unit="km/s")
        m = phase.state("mass", initial=full, lower=empty, upper=full, unit="t")
        pitch = phase.control("pitch", lower=-math.pi / 2, upper=math.pi / 2, unit="rad")
        phase.dynamics(
            {
                x: vx,
                y: vy,
                vx: thrust / m * casadi.cos(pitch),
                vy: thrust / m * casadi.sin(pitch) - GRAVITY,
                m: -flow,
            }
        )
        phases.append(phase)
    boost, sustain = phases
    boost.guess(x=[0, 100], y=[0, 80], vx=[0, 2], vy=[0, 1.2], mass=[120, 40], pitch=[1, 0.7])
    sustain.guess(
        time=[burn, burn + 300], x=[100, 1300], y=[80, 200], vx=[2, ORBIT_SPEED], vy=[1.2, 0],
        mass=[30, 6], pitch=[0.7, 0],
    )  # fmt: skip
    ocp.link(boost, sustain, "x", "y", "vx", "vy")
    ocp.minimise(-sustain.final(m), unit="t")


@benchmark
def orbit_raising(ocp: OptimalControlProblem) -> None:
    """Return the transfer from a circular orbit to the largest one that a low thrust reaches in 3.32.

    In units of the first orbit, the thrust of 0.1405 burns 0.0749 of the mass per time unit. From the
    Earth's orbit this reaches nearly the orbit of Mars, 1.525, in 193 days (Bryson and Ho, 1975,
    section 2.5, after Moyer and Pinkham).
    """
    import casadi

    phase = ocp.phase(time=(0, 3.32))
    r = phase.state("r", initial=1, lower=0.5, upper=3)
    radial = phase.state("radial", initial=0, final=0, lower=-2, upper=2)
    tangential = phase.state("tangential", initial=1, lower=0, upper=2)
    # From the outward tangent: it makes a full turn, so [-π, π] is not suitable.
    angle = phase.control("angle", lower=0, upper=2 * math.pi, unit="rad")
    push = 0.1405 / (1 - 0.0749 * phase.time)
    phase.dynamics(
        {
            r: radial,
            radial: tangential**2 / r - 1 / r**2 + push * casadi.sin(angle),
            tangential: -radial * tangential / r + push * casadi.cos(angle),
        }
    )
    ocp.subject_to(phase.final(tangential**2 * r), equals=1, name="the last orbit is circular")
    # Outwards first, then inwards.
    phase.guess(
        r=[1, 1.5], radial=[0, 0.2, 0], tangential=[1, 0.8], angle=lambda t: 0.5 + 5.2 * t / 3.32
    )
    ocp.minimise(-phase.final(r))


#: Goddard's rocket in units of its initial height, mass and weight: largest thrust, drag, inverse
#: scale height of the air, exhaust speed, and empty mass.
THRUST, DRAG, AIR, EXHAUST, EMPTY = 3.5, 310.0, 500.0, 0.5, 0.6


@benchmark
def goddard(ocp: OptimalControlProblem) -> None:
    """Return Goddard's rocket: the thrust for the largest height.

    Full thrust, then a singular arc on which thrust balances drag against gravity loss, then none:
    h = 1.0128369 (Goddard, "A method of reaching extreme altitudes", 1919; the numbers are those of
    Dolan, Moré and Munson, COPS 3.0, 2004, problem 10).
    """
    import casadi

    phase = ocp.phase(time=(0, (0.05, 1)))
    h = phase.state("h", initial=1, lower=1, upper=1.1, scale=0.01)
    v = phase.state("v", initial=0, lower=0, upper=0.5, scale=0.1)
    m = phase.state("m", initial=1, final=EMPTY, lower=EMPTY, upper=1)
    thrust = phase.control("thrust", lower=0, upper=THRUST)
    drag = DRAG * v**2 * casadi.exp(-AIR * (h - 1))
    phase.dynamics({h: v, v: (thrust - drag) / m - 1 / h**2, m: -thrust / EXHAUST})
    phase.guess(time=[0, 0.1, 0.2], h=[1, 1.006, 1.01], v=[0, 0.1, 0], thrust=[THRUST, 1, 0])
    ocp.minimise(-phase.final(h))


@benchmark
def goddard_phases(ocp: OptimalControlProblem) -> None:
    """Return Goddard's rocket in three phases: full thrust, singular arc, coasting.

    With its structure declared, the problem is smooth in each phase. On the singular arc
    m g - (1 + v / c) D is 0 (Betts, 2010, section 4.14.1). The phase only requires that it is
    constant, and the optimum determines its value. The empty rocket coasts, so the last phase has no
    mass and no control.
    """
    import casadi

    def drag(h: Any, v: Any) -> Any:
        return DRAG * v**2 * casadi.exp(-AIR * (h - 1))

    wide: dict[str, dict[str, Any]] = {
        "h": {"lower": 1, "upper": 1.1, "scale": 0.01},
        "v": {"lower": 0, "upper": 0.5},
    }

    boost = ocp.phase("boost", time=(0, (0.005, 0.05)))
    h = boost.state("h", initial=1, **wide["h"])
    v = boost.state("v", initial=0, **wide["v"])
    m = boost.state("m", initial=1, lower=EMPTY, upper=1)
    boost.dynamics({h: v, v: (THRUST - drag(h, v)) / m - 1 / h**2, m: -THRUST / EXHAUST})
    boost.guess(time=[0, 0.02], h=[1, 1.001], v=[0, 0.12], m=[1, 0.85])

    arc = ocp.phase("singular arc", time=((0.005, 0.05), (0.05, 0.1)))
    h = arc.state("h", **wide["h"])
    v = arc.state("v", **wide["v"])
    m = arc.state("m", final=EMPTY, lower=EMPTY, upper=1)
    thrust = arc.control("thrust", lower=0, upper=THRUST)
    rates = {h: v, v: (thrust - drag(h, v)) / m - 1 / h**2, m: -thrust / EXHAUST}
    arc.dynamics(rates)
    level = m / h**2 - (1 + v / EXHAUST) * drag(h, v)
    drift = sum(casadi.gradient(level, state) * rate for state, rate in rates.items())
    arc.path(drift, equals=0, name="thrust of the singular arc", scale=10)
    arc.guess(time=[0.02, 0.07], h=[1.001, 1.005], v=[0.12, 0.13], m=[0.85, EMPTY], thrust=2)

    coast = ocp.phase("coast", time=((0.05, 0.1), (0.1, 0.4)))
    h = coast.state("h", **wide["h"])
    v = coast.state("v", final=0, **wide["v"])
    coast.dynamics({h: v, v: -drag(h, v) / EMPTY - 1 / h**2})
    coast.guess(time=[0.07, 0.2], h=[1.005, 1.012], v=[0.13, 0])

    ocp.link(boost, arc)
    ocp.link(arc, coast)
    ocp.minimise(-coast.final(h))


#: Delta III's solid boosters, first and second stage: thrust (N), specific impulse (s), full mass and
#: propellant (kg), and burn time (s).
BOOSTER = (628_500.0, 283.33364, 19_290.0, 17_010.0, 75.2)
FIRST = (1_083_100.0, 301.68, 104_380.0, 95_550.0, 261.0)
SECOND = (110_094.0, 467.21, 19_300.0, 16_820.0, 700.0)
#: Load (kg), drag coefficient times area (m²), and the orbit: semi-major axis (m), eccentricity, and
#: inclination, ascending node and perigee in degrees.
LOAD, DRAG_AREA = 4164.0, 2 * math.pi
ORBIT = (24_361_140.0, 0.7308, 28.5, 269.8, 130.5)
#: Earth: radius (m), gravitation (m³/s²), rotation (rad/s), air density at sea level (kg/m³), and scale
#: height (m).
EARTH, PULL, SPIN, SEA_LEVEL, THINNING = 6_378_145.0, 3.986012e14, 7.29211585e-5, 1.225, 7200.0


@benchmark
def delta_iii(ocp: OptimalControlProblem) -> None:
    """Return the ascent of a Delta III into a transfer orbit with the largest mass.

    Four phases: six of nine boosters burn with the first stage, then the other three, then the
    first stage alone, and last the second stage, which may stop early. The default guess is used
    (Betts, 2010, section 6.15; Benson, "A Gauss pseudospectral transcription for optimal control", 2005).
    """
    import casadi
    import numpy as np

    pad = math.radians(28.5)
    spin = np.array([0.0, 0.0, SPIN])
    where = EARTH * np.array([math.cos(pad), 0.0, math.sin(pad)])
    flows = [stage[0] / (9.80665 * stage[1]) for stage in (BOOSTER, FIRST, SECOND)]
    lasting, burnt = BOOSTER[4], FIRST[3] / FIRST[4]
    times: tuple[Any, ...] = (
        (0, lasting),
        (lasting, 2 * lasting),
        (2 * lasting, FIRST[4]),
        (FIRST[4], (FIRST[4] + 1, FIRST[4] + SECOND[4])),
    )
    # Number of burning boosters, and the mass that is burnt and then dropped in each phase.
    # The printed propellants and flows differ by less than the 0.1 % that the bounds allow.
    full = 9 * BOOSTER[2] + FIRST[2] + SECOND[2] + LOAD
    phases = []
    for k, burning in enumerate((6, 3, 0, 0)):
        thrust = burning * BOOSTER[0] + FIRST[0] if k < 3 else SECOND[0]
        flow = burning * flows[0] + flows[1] if k < 3 else flows[2]
        length = times[k][1] - times[k][0] if k < 3 else SECOND[4]
        left = full - burning * BOOSTER[3] - (burnt * length if k < 3 else SECOND[3])
        phase = ocp.phase(f"burn {k + 1}", time=times[k])
        start = (where.tolist(), np.cross(spin, where).tolist()) if k == 0 else (None, None)
        r = phase.state("r", 3, initial=start[0], lower=-2 * EARTH, upper=2 * EARTH, unit="m")
        v = phase.state("v", 3, initial=start[1], lower=-10_000, upper=10_000, unit="m/s")
        m = phase.state("mass", initial=full, lower=0.999 * left, upper=full, unit="kg")
        u = phase.control("direction", 3, lower=-1, upper=1)
        distance, wind = casadi.norm_2(r), v - casadi.cross(casadi.DM(spin), r)
        air = SEA_LEVEL * casadi.exp((EARTH - distance) / THINNING)
        # On the pad the relative wind is 0, where the norm has no derivative.
        drag = -0.5 * DRAG_AREA * air * casadi.sqrt(casadi.sumsqr(wind) + 1e-12) * wind
        phase.dynamics({r: v, v: -PULL / distance**3 * r + (thrust * u + drag) / m, m: -flow})
        phase.path(casadi.sumsqr(u), equals=1, name="direction has length 1")
        phase.path(distance, lower=EARTH, name="above the ground", unit="m")
        phases.append(phase)
        full = left - (burning * (BOOSTER[2] - BOOSTER[3]) if k < 2 else FIRST[2] - FIRST[3])
    for before, after in itertools.pairwise(phases):
        ocp.link(before, after, "r", "v")

    r, v, last = phases[-1].final(r), phases[-1].final(v), phases[-1].final(m)
    spun = casadi.cross(r, v)
    round_off = casadi.cross(v, spun) / PULL - r / casadi.norm_2(r)
    node = casadi.vertcat(-spun[1], spun[0], 0)
    # The semi-major axis has a pole between ellipses and hyperbolas; its inverse has none.
    inverse = 2 / casadi.norm_2(r) - casadi.sumsqr(v) / PULL
    leaning = casadi.acos(spun[2] / casadi.norm_2(spun))
    ahead = casadi.dot(casadi.cross(node, round_off), spun) / casadi.norm_2(spun)
    angles = (
        leaning,
        casadi.atan2(node[1], node[0]),
        casadi.atan2(ahead, casadi.dot(node, round_off)),
    )
    ocp.subject_to(
        ORBIT[0] * inverse, equals=1, name="semi-major axis, inverted and over what is wanted"
    )
    ocp.subject_to(casadi.norm_2(round_off), equals=ORBIT[1], name="eccentricity")
    for angle, degrees, name in zip(
        angles, (ORBIT[2], ORBIT[3] - 360, ORBIT[4]),
        ("inclination", "ascending node", "argument of the perigee"), strict=True,
    ):  # fmt: skip
        ocp.subject_to(angle, equals=math.radians(degrees), name=name, scale=1, unit="rad")
    ocp.minimise(-last, unit="kg")
