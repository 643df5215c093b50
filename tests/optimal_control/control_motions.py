"""Optimal control problems for several test modules."""

from __future__ import annotations

import io
import math
from contextlib import redirect_stderr, redirect_stdout
from types import SimpleNamespace
from typing import Any

import pytest

from crosstrack.__main__ import main
from crosstrack.models import OptimalControlProblem

#: A coarse first mesh, sufficient for smooth motions with refinement.
COARSE = {"intervals": 3, "degree": 4}


ENERGY, BRYSON = "optimal-control/double-integrator-energy", "optimal-control/bryson-denham"


CURVE, FALL = "optimal-control/brachistochrone", 1.801603122


#: The squared lengths of the ways round the disc of `round_a_disc`: two tangents and an arc each.
_TANGENT, _ARC = math.sqrt(1.01 - 0.25), math.pi - 2 * math.acos(0.5 / math.sqrt(1.01))


BELOW, ABOVE = ((2 * _TANGENT + 0.5 * (_ARC + sign * 2 * math.atan(0.1))) ** 2 for sign in (-1, 1))


def run(*arguments: Any, code: int = 0) -> SimpleNamespace:
    """Run the command line in this process, and check its exit code."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err), pytest.raises(SystemExit) as ended:
        main([str(one) for one in arguments])
    found = SimpleNamespace(stdout=out.getvalue(), stderr=err.getvalue())
    assert (ended.value.code or 0) == code, (ended.value.code, found.stdout[-2000:], found.stderr)
    return found


def turn(
    end: tuple[float, float] = (math.cos(1), math.sin(1)), *, both: bool = True, path: bool = False
) -> OptimalControlProblem:
    """Return a point that moves on the unit circle by 1 rad in a second: ∫ u² = 1, x² + y² = 1."""
    ocp = OptimalControlProblem("turn")
    phase = ocp.phase()
    x = phase.state("x", initial=1, final=end[0] if both else None)
    y, u = phase.state("y", initial=0, final=end[1]), phase.control("u")
    phase.dynamics({x: -u * y, y: u * x})
    if path:
        phase.path(x**2 + y**2, equals=1, name="unit length")
    phase.guess(x=[1, end[0]], y=[0, end[1]], u=0.8)
    ocp.minimise(phase.integral(u**2))
    return ocp


def push(
    strength: float, end: Any = 1.0, speed: float | None = None, name: str = "push"
) -> OptimalControlProblem:
    """Return a mass that moves by 1 m from rest to rest, which takes a strength of 4 in a second."""
    ocp = OptimalControlProblem(name)
    phase = ocp.phase(time=(0, end))
    x = phase.state("x", initial=0, final=1, unit="m")
    v = phase.state("v", initial=0, final=0, upper=speed, unit="m/s")
    u = phase.control("u", lower=-strength, upper=strength, unit="m/s²")
    phase.dynamics({x: v, v: u})
    ocp.minimise(phase.integral(u**2))
    return ocp


def round_a_disc() -> OptimalControlProblem:
    """Return a path around a disc: the shorter one passes below, the guess passes above."""
    ocp = OptimalControlProblem("round a disc")
    phase = ocp.phase()
    x, y = phase.state("x", initial=0, final=2), phase.state("y", initial=0, final=0)
    u, v = phase.control("u", lower=-20, upper=20), phase.control("v", lower=-20, upper=20)
    phase.dynamics({x: u, y: v})
    phase.path((x - 1) ** 2 + (y - 0.1) ** 2, lower=0.25, name="disc")
    phase.guess(x=[0, 1, 2], y=[0, 1, 0])
    ocp.minimise(phase.integral(u**2 + v**2))
    return ocp
