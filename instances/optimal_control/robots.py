"""Machines: cranes, arms, cars, carts with poles, quadrotors, and robots in space."""

from __future__ import annotations

import math

from ...models.optimal_control.model import OptimalControlProblem
from .benchmark import benchmark


@benchmark
def container_crane(ocp: OptimalControlProblem) -> None:
    """Return the move of a container by a crane in 9 s with little swing and little effort.

    Trolley and hoist are in motion at both ends (Sakawa and Shindo, "Optimal control of container
    cranes", Automatica 18, 1982). The weight of the effort is that of Augustin and Maurer,
    "Sensitivity analysis and real-time control of a container crane under state constraints", in
    "Online Optimization of Large Scale Systems", Springer, 2001.
    """
    phase = ocp.phase(time=(0, 9))
    trolley = phase.state("trolley", initial=0, final=10, lower=-1, upper=15, unit="m")
    rope = phase.state("rope", initial=22, final=14, lower=5, upper=30, unit="m")
    swing = phase.state("swing", initial=0, final=0, lower=-1, upper=1, scale=0.1, unit="rad")
    drive = phase.state("drive", initial=0, final=2.5, lower=-2.5, upper=2.5, unit="m/s")
    hoist = phase.state("hoist", initial=-1, final=0, lower=-1, upper=1, unit="m/s")
    turn = phase.state("turn", initial=0, final=0, lower=-1, upper=1, scale=0.1, unit="rad/s")
    pull = phase.control("pull", lower=-2.83374, upper=2.83374, unit="m/s²")
    lift = phase.control("lift", lower=-0.80865, upper=0.71265, unit="m/s²")
    phase.dynamics(
        {
            trolley: drive,
            rope: hoist,
            swing: turn,
            drive: pull + 17.2656 * swing,
            hoist: lift,
            turn: -(pull + 27.0756 * swing + 2 * hoist * turn) / rope,
        }
    )
    phase.guess(pull=0, lift=0)
    ocp.minimise(phase.integral((swing**2 + turn**2 + 0.01 * (pull**2 + lift**2)) / 2))


@benchmark
def robot_arm(ocp: OptimalControlProblem) -> None:
    """Return the fastest turn of a robot arm by 120°, whose rod retracts to turn faster.

    The three controls are bang-bang (Mössner-Beigel, thesis, Heidelberg, 1995; problem 8 of COPS 3.0,
    2004: 9.1409).
    """
    import casadi

    length = 5.0
    phase = ocp.phase(time=(0, (1, 20)))
    # Length of the extended rod, and its two angles.
    rho = phase.state("rho", initial=4.5, final=4.5, lower=0, upper=length)
    theta = phase.state("theta", initial=0, final=2 * math.pi / 3, lower=-math.pi, upper=math.pi)
    phi = phase.state("phi", initial=math.pi / 4, final=math.pi / 4, lower=0.1, upper=math.pi)
    rho_rate = phase.state("rho_rate", initial=0, final=0, lower=-5, upper=5, scale=1)
    theta_rate = phase.state("theta_rate", initial=0, final=0, lower=-5, upper=5, scale=1)
    phi_rate = phase.state("phi_rate", initial=0, final=0, lower=-5, upper=5, scale=1)
    u = phase.control("u", 3, lower=-1, upper=1)
    inertia = ((length - rho) ** 3 + rho**3) / 3
    phase.dynamics(
        {
            rho: rho_rate,
            theta: theta_rate,
            phi: phi_rate,
            rho_rate: u[0] / length,
            theta_rate: u[1] / (inertia * casadi.sin(phi) ** 2),
            phi_rate: u[2] / inertia,
        }
    )
    # The initial guess of COPS, with a guessed duration.
    phase.guess(time=[0, 10], theta=lambda t: 2 * math.pi / 3 * (t / 10) ** 2)
    ocp.minimise(phase.end)


@benchmark
def dubins(ocp: OptimalControlProblem) -> None:
    """Return the shortest path of a car that drives forwards only, with a turning radius of at least 1.

    From (0, 0) heading along x to (4, 4) heading back: an arc, a straight line and an arc (Dubins,
    "On curves of minimal length with a constraint on average curvature", American Journal of
    Mathematics 79, 1957). The straight line is a singular arc.
    """
    import casadi

    phase = ocp.phase(time=(0, (1, 20)))
    x = phase.state("x", initial=0, final=4, lower=-10, upper=10)
    y = phase.state("y", initial=0, final=4, lower=-10, upper=10)
    heading = phase.state(
        "heading", initial=0, final=math.pi, lower=-math.pi, upper=2 * math.pi, unit="rad"
    )
    turn = phase.control("turn", lower=-1, upper=1, unit="rad/s")
    phase.dynamics({x: casadi.cos(heading), y: casadi.sin(heading), heading: turn})
    phase.guess(time=[0, 7], turn=0)
    ocp.minimise(phase.end)


#: Obstacles of :func:`around_discs`: centre and radius.
DISCS = (((1.2, 0.3), 0.5), ((2.8, -0.3), 0.5))


@benchmark
def around_discs(ocp: OptimalControlProblem) -> None:
    """Return the shortest path from (0, 0) to (4, 0) at unit speed between two discs.

    The optimum consists of straight tangents to the discs, and an arc along each disc with an active
    path constraint. Other paths around the discs are separate local optima, selected by the guess
    (Latombe, "Robot Motion Planning", Kluwer, 1991, chapter 4).
    """
    import casadi

    phase = ocp.phase(time=(0, (4, 8)))
    x = phase.state("x", initial=0, final=4, lower=-1, upper=5, unit="m")
    y = phase.state("y", initial=0, final=0, lower=-3, upper=3, unit="m")
    heading = phase.control("heading", lower=-math.pi, upper=math.pi, unit="rad")
    phase.dynamics({x: casadi.cos(heading), y: casadi.sin(heading)})
    for k, ((cx, cy), radius) in enumerate(DISCS, start=1):
        phase.path((x - cx) ** 2 + (y - cy) ** 2, lower=radius**2, name=f"clear of disc {k}")
    # Below the first disc and above the second.
    phase.guess(
        time=[0, 1.3, 2.9, 4.2], x=[0, 1.2, 2.8, 4], y=[0, -0.25, 0.25, 0],
        heading=[-0.2, 0.2, 0.2, -0.2],
    )  # fmt: skip
    ocp.minimise(phase.end)


@benchmark
def cart_pole(ocp: OptimalControlProblem) -> None:
    """Return the swing-up of a pendulum on a cart in 2 s with the smallest ∫ force² dt.

    Two good local optima cost 57.94 and 58.81; a straight guess may lead to either (Kelly, "An
    introduction to trajectory optimization: how to do your own direct collocation", SIAM Review 59,
    2017, section 6).
    """
    import casadi

    cart, bob, length, gravity = 1.0, 0.3, 0.5, 9.81
    phase = ocp.phase(time=(0, 2))
    position = phase.state("position", initial=0, final=1, lower=-2, upper=2, unit="m")
    # From hanging to upright.
    angle = phase.state("angle", initial=0, final=math.pi, lower=-7, upper=7, unit="rad")
    speed = phase.state("speed", initial=0, final=0, lower=-20, upper=20, scale=5, unit="m/s")
    rate = phase.state("rate", initial=0, final=0, lower=-50, upper=50, scale=10, unit="rad/s")
    force = phase.control("force", lower=-20, upper=20, unit="N")
    sine, cosine = casadi.sin(angle), casadi.cos(angle)
    inertia = cart + bob * sine**2
    phase.dynamics(
        {
            position: speed,
            angle: rate,
            speed: (length * bob * sine * rate**2 + force + bob * gravity * cosine * sine)
            / inertia,
            rate: -(
                length * bob * cosine * sine * rate**2
                + force * cosine
                + (cart + bob) * gravity * sine
            )
            / (length * inertia),
        }
    )
    # A swing to the other side first, which costs less than swinging up at once.
    phase.guess(position=[0, 0, 0.6, 0.9, 0.8, 1], angle=[0, 0, -1, 0.5, 2.5, math.pi], force=0)
    ocp.minimise(phase.integral(force**2), unit="N² s")


@benchmark
def quadrotor(ocp: OptimalControlProblem) -> None:
    """Return the fastest move of a quadrotor by 5 m in the plane, from hover to hover.

    The controls are the thrust per mass, which is bang-bang, and the pitch rate, which is
    bang-singular (Hehn, Ritz and D'Andrea, "Performance benchmarking of quadrotor systems using
    time-optimal control", Autonomous Robots 33, 2012).
    """
    import casadi

    phase = ocp.phase(time=(0, (0.5, 4)))
    x = phase.state("x", initial=0, final=5, lower=-1, upper=6, unit="m")
    z = phase.state("z", initial=0, final=0, lower=-2, upper=2, unit="m")
    vx = phase.state("vx", initial=0, final=0, lower=-20, upper=20, unit="m/s")
    vz = phase.state("vz", initial=0, final=0, lower=-20, upper=20, unit="m/s")
    pitch = phase.state("pitch", initial=0, final=0, lower=-math.pi, upper=math.pi, unit="rad")
    thrust = phase.control("thrust", lower=1, upper=20, unit="m/s²")
    pitch_rate = phase.control("pitch_rate", lower=-10, upper=10, unit="rad/s")
    phase.dynamics(
        {
            x: vx,
            z: vz,
            vx: thrust * casadi.sin(pitch),
            vz: thrust * casadi.cos(pitch) - 9.81,
            pitch: pitch_rate,
        }
    )
    phase.guess(
        time=[0, 0.5, 1, 1.5], vx=[0, 5, 5, 0], pitch=[0, 1, -1, 0], thrust=15, pitch_rate=0
    )
    ocp.minimise(phase.end, unit="s")


@benchmark
def free_flying_robot(ocp: OptimalControlProblem) -> None:
    """Return the move of a robot in space by four jets in 12 s with the least propellant.

    Every jet is on or off (Sakawa, "Trajectory planning of a free-flying robot by using the optimal
    control", Optimal Control Applications and Methods 20, 1999; Betts, 2010, section 6.13: 7.9101).
    """
    import casadi

    phase = ocp.phase(time=(0, 12))
    x = phase.state("x", initial=-10, final=0, lower=-15, upper=15)
    y = phase.state("y", initial=-10, final=0, lower=-15, upper=15)
    theta = phase.state("theta", initial=math.pi / 2, final=0, lower=-5, upper=5, unit="rad")
    vx = phase.state("vx", initial=0, final=0, lower=-5, upper=5)
    vy = phase.state("vy", initial=0, final=0, lower=-5, upper=5)
    omega = phase.state("omega", initial=0, final=0, lower=-3, upper=3, scale=1, unit="rad/s")
    # Forward and backward jets of one side, then of the other.
    jets = phase.control("jets", 4, lower=0, upper=1)
    first, second = jets[0] - jets[1], jets[2] - jets[3]
    phase.dynamics(
        {
            x: vx,
            y: vy,
            theta: omega,
            vx: (first + second) * casadi.cos(theta),
            vy: (first + second) * casadi.sin(theta),
            omega: 0.2 * first - 0.2 * second,
        }
    )
    phase.path(jets[0] + jets[1], upper=1, name="one side")
    phase.path(jets[2] + jets[3], upper=1, name="other side")
    ocp.minimise(phase.integral(casadi.sum1(jets)))


@benchmark
def unicycle(ocp: OptimalControlProblem) -> None:
    """Return the parking of a unicycle one space to the side, with the smallest ∫ (v² + ω²) dt in a unit of time.

    The curves are elastica, because the cost is the squared length of a sub-Riemannian geodesic
    (Sachkov and Moiseev, "Maxwell strata in sub-Riemannian problem on the group of motions of a
    plane", ESAIM: COCV 16, 2010). Two mirrored curves are optimal; a search that begins at rest is
    stationary.
    """
    import casadi

    phase = ocp.phase(time=(0, 1))
    x = phase.state("x", initial=0, final=0)
    y = phase.state("y", initial=0, final=1)
    heading = phase.state("heading", initial=0, final=0, unit="rad")
    v, turn = phase.control("v"), phase.control("turn")
    phase.dynamics({x: v * casadi.cos(heading), y: v * casadi.sin(heading), heading: turn})
    ocp.minimise(phase.integral(v**2 + turn**2))
