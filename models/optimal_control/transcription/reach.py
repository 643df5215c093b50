"""What can be done to the end of a motion: its equations collocated and linearised on one interval."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import casadi
import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from ..definition import Definition, Phase
from .schemes import Scheme, radau

__all__ = ["NONE", "Motion", "carry_to_target", "draw_motion", "in_own_terms"]

Floats = NDArray[np.float64]

#: Share of the sum of its terms, or of the other rows, below which an effect counts as none. Beside
#: it rounding and what the collocation leaves over (RESOLVED) are small.
NONE = 1e-8
#: Largest share that the last two Legendre coefficients of a motion and of its linearisation may
#: have: what one polynomial does not resolve is tried on half the time.
RESOLVED = 1e-10
#: Relative size of a step at which Newton's method has converged.
CONVERGED = 1e-12
#: Growth of the states, in terms of their scales, at which Newton's method is given up.
DIVERGED = 1e3
#: Halvings of the phase's time at most, and Newton's steps for each.
HALVINGS, STEPS = 40, 10


@dataclass(frozen=True, eq=False)
class Motion:
    """A drawn motion, where it begins and ends, and what can be done to that.

    `ends` stacks t0, tf, x0, xf and the integrals, as the endpoint function takes them. `effects` has
    a row for each of them and a column for each change: the states at the start (`starts` columns),
    the control, the parameters, the duration. `kept` are the path expressions that control,
    parameters and time leave alone.
    """

    ends: Floats
    parameters: Floats
    effects: Floats
    starts: int
    kept: tuple[int, ...]


def draw_motion(
    definition: Definition, phase: Phase, seed: int, begin: Floats | None = None
) -> Motion | None:
    """Return a motion under a drawn control with its effects; None where none can be computed.

    From `begin`, where it is given, all states count as free at the start. The motion lasts as long
    as one polynomial resolves it, at most as long as guessed: directions that can be reached at all
    can be reached in a part of the time.
    """
    draw = np.random.default_rng(seed)
    low, high = phase.stacked("states", "initial_lower"), phase.stacked("states", "initial_upper")
    scale = phase.stacked("states", "scale")
    free = np.flatnonzero(low < high)
    x = np.clip(phase.guess.states[0], low, high)
    x[free] = np.clip(x + 0.1 * scale * draw.normal(size=x.size), low, high)[free]
    if begin is not None:
        x, free = begin, np.arange(x.size)
    size = phase.stacked("controls", "scale")
    waves = draw.normal(size=(4, size.size)) / np.arange(1, 5)[:, None]
    p = definition.stacked("parameters", "initial_lower")
    # Polynomials of the control for every state, and nodes that resolve what they do.
    basis = max(4, -(-2 * x.size // size.size)) if size.size else 0
    scheme = radau(2 * basis + 12)
    place = 0.5 * (scheme.points[1:] + 1.0)
    middle = phase.guess.controls.mean(axis=0) / size
    v = middle + 0.3 * legendre.legvander(scheme.points[1:], 3) @ waves
    shapes = np.kron(legendre.legvander(scheme.points[1:], basis)[:, :basis], np.eye(size.size))
    shapes = shapes.reshape(place.size, size.size, basis * size.size)
    tangent = _tangent(phase).map(place.size)

    def evaluate(z: Floats, span: float) -> list[Floats]:
        """Return values and Jacobians at every node, shapes (nodes, entries[, columns])."""
        times = phase.guess.start + span * place
        found = tangent(times[None], z.T, v.T, np.tile(p[:, None], place.size))
        values, *tables = (np.array(part, float) for part in found)
        return [
            values.T,
            *(part.reshape(len(values), place.size, -1).swapaxes(0, 1) for part in tables),
        ]

    with np.errstate(all="ignore"):  # what overflows is tried on half the time
        for halving in range(HALVINGS):
            span = (phase.guess.end - phase.guess.start) * 0.5**halving
            found = _solve(scheme, evaluate, x / scale, span)
            if found is None:
                continue
            z, square, tables = found
            if not _resolved(scheme.points[1:], z):
                continue
            push = np.concatenate([tables[3] @ shapes, tables[4]], axis=2)
            nx = x.size
            right = np.zeros((place.size, nx, free.size + push.shape[2]))
            right[:, free, np.arange(free.size)] = -scheme.left[:, :1]
            right[:, :, free.size :] = 0.5 * span * push[:, :nx]
            moved = np.asarray(np.linalg.solve(square, right.reshape(len(square), -1)), np.float64)
            moved = moved.reshape(right.shape)
            if not _resolved(scheme.points[1:], moved):
                continue
            values, by_t, by_z = tables[:3]
            nq, starts = phase.integrals, free.size
            # The duration moves the end along the motion.
            last = np.column_stack([moved[-1], span * values[-1, :nx]])
            weights = 0.5 * span * scheme.weights
            sums = by_z[:, nx : nx + nq] @ moved
            sums[:, :, starts:] += push[:, nx : nx + nq]
            ends = np.concatenate(
                [
                    [phase.guess.start, phase.guess.start + span],
                    x,
                    scale * z[-1],
                    weights @ values[:, nx : nx + nq],
                ]
            )
            effects = np.zeros((ends.size, last.shape[1]))
            effects[2 + free, np.arange(starts)] = scale[free]
            effects[2 + nx : 2 + 2 * nx] = scale[:, None] * last
            effects[2 + 2 * nx :, :-1] = np.tensordot(weights, sums, 1)
            effects[2 + 2 * nx :, -1] = span * values[-1, nx : nx + nq]
            if phase.end_lower < phase.end_upper:
                effects[1, -1] = span
            elif phase.start_lower < phase.start_upper:
                effects[0, -1] = -span
            else:
                effects[:, -1] = 0.0
            felt, direct = by_z[-1, nx + nq :], np.zeros((values.shape[1] - nx - nq, last.shape[1]))
            direct[:, starts:-1] = push[-1, nx + nq :]
            direct[:, -1] = span * by_t[-1, nx + nq :, 0]
            paths = in_own_terms(
                (felt @ last + direct)[:, starts:],
                (np.abs(felt) @ np.abs(last) + np.abs(direct))[:, starts:],
            )
            kept = np.flatnonzero(~paths.any(axis=1))
            return Motion(ends, p, effects, starts, tuple(kept.tolist()))
    return None


def _solve(
    scheme: Scheme, evaluate: Callable[[Floats, float], list[Floats]], first: Floats, span: float
) -> tuple[Floats, Floats, list[Floats]] | None:
    """Solve the equations of motion on one interval by Newton's method, from a state that stays.

    Returns the states at the nodes, the Jacobian of the equations and the values there; None where
    Newton's method does not converge.
    """
    nodes, nx = scheme.left.shape[0], first.size
    z = np.tile(first, (nodes, 1))
    for _ in range(STEPS):
        tables = evaluate(z, span)
        square: Floats = np.asarray(np.kron(scheme.left[:, 1:], np.eye(nx)), np.float64)
        blocks = square.reshape(nodes, nx, nodes, nx)
        blocks[np.arange(nodes), :, np.arange(nodes)] -= 0.5 * span * tables[2][:, :nx]
        if not np.isfinite(square).all() or np.abs(z).max() > DIVERGED * max(
            1.0, np.abs(first).max()
        ):
            return None
        left = scheme.left @ np.vstack([first, z]) - 0.5 * span * tables[0][:, :nx]
        try:
            step = np.asarray(np.linalg.solve(square, left.ravel()), float).reshape(z.shape)
        except np.linalg.LinAlgError:  # a span on which the motion is not unique
            return None
        z = z - step
        if not np.abs(step).max() > CONVERGED * max(1.0, float(np.abs(z).max())):
            return z, square, tables
    return None


def _tangent(phase: Phase) -> casadi.Function:
    """Return (t, z, v, p) -> (values, their Jacobians by each), with states and controls scaled.

    The values are the rates, scaled as well, the integrands and the paths.
    """
    t, z, v, p = (casadi.MX.sym(name, phase.function.size1_in(k)) for k, name in enumerate("txup"))
    scale = casadi.DM(phase.stacked("states", "scale"))
    size = casadi.DM(phase.stacked("controls", "scale"))
    rate, path, integrand, _ = phase.function(t, scale * z, size * v, p)
    values = casadi.vertcat(rate / scale, integrand, path)
    parts = [casadi.densify(casadi.jacobian(values, one)) for one in (t, z, v, p)]
    return casadi.Function("tangent", [t, z, v, p], [casadi.densify(values), *parts])


def _resolved(points: Floats, table: Floats) -> bool:
    """Return whether polynomials through `table`, (nodes, entries …), have no tail to speak of."""
    waves = np.linalg.solve(
        legendre.legvander(points, points.size - 1), table.reshape(points.size, -1)
    )
    size = np.abs(waves).reshape(table.shape[0], table.shape[1], -1).max(axis=2, initial=0.0)
    return bool((size[-2:] <= RESOLVED * size.max(axis=0)).all())


def carry_to_target(definition: Definition, phase: Phase) -> Motion | None:
    """Return what can be done at the wanted end: effects of a motion from there, carried back."""
    low, high = phase.stacked("states", "final_lower"), phase.stacked("states", "final_upper")
    target = np.where(low == high, low, phase.guess.states[-1])
    onward = draw_motion(definition, phase, 1, target)
    if onward is None:
        return None
    nx = target.size
    last = slice(2 + nx, 2 + 2 * nx)
    effects, ends = onward.effects[:, nx:].copy(), onward.ends.copy()
    scale = phase.stacked("states", "scale")[:, None]
    try:
        effects[last] = scale * np.linalg.solve(onward.effects[last, :nx], effects[last])
    except np.linalg.LinAlgError:
        return None
    ends[last] = target
    return replace(onward, ends=ends, effects=effects, starts=0)


def in_own_terms(effects: Floats, terms: Floats) -> Floats:
    """Return rows in terms of their own size, so that units count for nothing; 0 where they cancel."""
    size, most = (np.linalg.norm(part, axis=1, keepdims=True) for part in (effects, terms))
    return np.where(size > NONE * most, effects / np.where(size > 0.0, size, 1.0), 0.0)
