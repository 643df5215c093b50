"""Equations that follow from one another: found, named, and left out where asked.

Where the dynamics conserve something, such as the length of a quaternion or a momentum, the values at
the end depend on one another: a state that starts as given can only be moved within the surface on
which what is conserved stays the same. Conditions on the end beyond the dimension of that surface
follow from the others, or contradict them; either way the program's equations are dependent, and
solvers fail. The dimension is measured: the equations of motion are collocated along a drawn control,
and a pivoted QR counts the rank of what the control, the free initial values, the parameters and the
free times can do to the conditions in the linearised equations.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import casadi
import numpy as np
import scipy.linalg
from numpy.polynomial import legendre
from numpy.typing import NDArray

from ....errors import InvalidData
from ...programs.nonlinear import NonlinearProgram
from ..definition import Definition, Phase
from .schemes import Scheme, radau

if TYPE_CHECKING:
    from .layout import Layout

__all__ = ["Dependence", "dependences", "treat_dependent"]

log = logging.getLogger("crosstrack")

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

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


@dataclass(frozen=True)
class Dependence:
    """Conditions of one phase that follow from others.

    Parameters
    ----------
    phase : int
        The phase's place.
    finals : tuple of int
        States whose final values follow.
    boundaries : tuple of int
        Entries of the boundary constraints that follow.
    paths : tuple of int
        Path equations that the dynamics keep by themselves.
    conditions : int
        Number of conditions on the end in all.
    """

    phase: int
    finals: tuple[int, ...]
    boundaries: tuple[int, ...]
    paths: tuple[int, ...]
    conditions: int


_known: WeakKeyDictionary[Definition, tuple[Dependence, ...]] = WeakKeyDictionary()


def dependences(definition: Definition) -> tuple[Dependence, ...]:
    """Return what is found of every phase, phases without any left out; computed once."""
    found = _known.get(definition)
    if found is None:
        each = (_examine(definition, k) for k in range(len(definition.phases)))
        found = tuple(one for one in each if one is not None)
        _known[definition] = found
    return found


def _conditions(definition: Definition, number: int) -> tuple[list[int], list[int]]:
    """Return the states whose final value is fixed, and the equations among the boundaries."""
    phase = definition.phases[number]
    low, high = phase.stacked("states", "final_lower"), phase.stacked("states", "final_upper")
    finals = np.flatnonzero(low == high).tolist()
    low, high = definition.stacked("boundaries", "lower"), definition.stacked("boundaries", "upper")
    equal = np.flatnonzero(low == high)
    # Only those of this phase alone: what links two phases hangs on both motions.
    own = _own_entries(definition, number)
    rows, columns = (
        np.array(part) for part in definition.endpoint.jac_sparsity(1, 0).get_triplet()
    )
    inside = (own.start <= columns) & (columns < own.stop)
    kept = [int(k) for k in equal if (rows == k).any() and inside[rows == k].all()]
    return finals, kept


def _own_entries(definition: Definition, number: int) -> slice:
    """Return the place of a phase in the endpoint vector."""
    begin = sum(one.end_size for one in definition.phases[:number])
    return slice(begin, begin + definition.phases[number].end_size)


def _examine(definition: Definition, number: int) -> Dependence | None:
    phase = definition.phases[number]
    finals, boundaries = _conditions(definition, number)
    low, high = phase.stacked("paths", "lower"), phase.stacked("paths", "upper")
    kept = set(np.flatnonzero(low == high).tolist())
    total = len(finals) + len(boundaries)
    if not total and not kept:
        return None
    rank, order = -1, np.empty(0, np.int64)
    for seed in (1, 2):  # the second motion is to confirm what the first one finds
        motion = _draw_motion(definition, phase, seed)
        if motion is None:
            log.debug("dependence of phase %r cannot be measured", phase.name)
            return None
        kept &= set(motion.kept)
        found = _rank(_effects(definition, number, finals, boundaries, motion))
        if found[0] > rank:
            rank, order = found
        if not kept and rank == total:
            return None
    if rank < total:
        # Which ones to leave out is decided at the end itself: what is extremal there, such as the
        # largest entry of a quaternion, follows from the others and not they from it.
        there = _carry_to_target(definition, phase)
        if there is not None:
            rows = _effects(definition, number, finals, boundaries, there)
            order = _rank(rows * _preference(phase, finals, there, total)[:, None])[1]
    implied = sorted(int(k) for k in order[rank:])
    return Dependence(
        number,
        tuple(finals[k] for k in implied if k < len(finals)),
        tuple(boundaries[k - len(finals)] for k in implied if k >= len(finals)),
        tuple(sorted(kept)),
        total,
    )


@dataclass(frozen=True, eq=False)
class _Motion:
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


def _draw_motion(
    definition: Definition, phase: Phase, seed: int, begin: Floats | None = None
) -> _Motion | None:
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
            paths = _in_own_terms(
                (felt @ last + direct)[:, starts:],
                (np.abs(felt) @ np.abs(last) + np.abs(direct))[:, starts:],
            )
            kept = np.flatnonzero(~paths.any(axis=1))
            return _Motion(ends, p, effects, starts, tuple(kept.tolist()))
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


def _carry_to_target(definition: Definition, phase: Phase) -> _Motion | None:
    """Return what can be done at the wanted end: effects of a motion from there, carried back."""
    low, high = phase.stacked("states", "final_lower"), phase.stacked("states", "final_upper")
    target = np.where(low == high, low, phase.guess.states[-1])
    onward = _draw_motion(definition, phase, 1, target)
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


def _effects(
    definition: Definition, number: int, finals: list[int], boundaries: list[int], motion: _Motion
) -> Floats:
    """Return what each change does to each condition, each condition in its own terms."""
    nx = len(definition.phases[number].state_names)
    slopes = np.zeros((len(finals) + len(boundaries), motion.ends.size))
    slopes[np.arange(len(finals)), [2 + nx + k for k in finals]] = 1.0
    if boundaries:
        e = np.concatenate([_guessed_ends(one) for one in definition.phases])
        own = _own_entries(definition, number)
        e[own] = motion.ends
        arguments = [
            casadi.MX.sym(name, definition.endpoint.size1_in(k)) for k, name in enumerate("ep")
        ]
        table = casadi.jacobian(definition.endpoint(*arguments)[1], arguments[0])
        slope = casadi.Function("slope", arguments, [casadi.densify(table)])
        slopes[len(finals) :] = np.array(slope(e, motion.parameters), float)[boundaries, own]
    return _in_own_terms(slopes @ motion.effects, np.abs(slopes) @ np.abs(motion.effects))


def _guessed_ends(phase: Phase) -> Floats:
    guess = phase.guess
    ends = [[guess.start, guess.end], guess.states[0], guess.states[-1], np.zeros(phase.integrals)]
    return np.concatenate(ends)


def _preference(phase: Phase, finals: list[int], motion: _Motion, total: int) -> Floats:
    """Return factors near 1 that decide between conditions that follow from one another alike.

    Among the entries of a vector the one that moves more is imposed, of several states the one that
    was declared later; without them rounding would decide.
    """
    names = phase.state_names
    whose = np.array([name.partition("[")[0] for name in names])
    moves = np.linalg.norm(motion.effects[2 + len(names) : 2 + 2 * len(names)], axis=1)
    largest = np.array([moves[whose == one].max() for one in whose])
    share = np.where(moves > 0.0, moves / np.where(largest > 0.0, largest, 1.0), 1.0)
    factors: Floats = 1.0 + 1e-6 * np.arange(total, dtype=float)
    factors[: len(finals)] *= share[finals] ** 0.01
    return factors


def _in_own_terms(effects: Floats, terms: Floats) -> Floats:
    """Return rows in terms of their own size, so that units count for nothing; 0 where they cancel."""
    size, most = (np.linalg.norm(part, axis=1, keepdims=True) for part in (effects, terms))
    return np.where(size > NONE * most, effects / np.where(size > 0.0, size, 1.0), 0.0)


def _rank(effects: Floats) -> tuple[int, Indices]:
    """Return the rank of the rows, and their order: independent ones first."""
    count = effects.shape[0]
    if not effects.size or not np.isfinite(effects).all():
        return count, np.arange(count)
    _, triangle, order = scipy.linalg.qr(effects.T, mode="economic", pivoting=True)
    return int((np.abs(np.diag(triangle)) > NONE).sum()), np.asarray(order, np.int64)


def _words(definition: Definition, one: Dependence) -> list[str]:
    phase = definition.phases[one.phase]
    words = [f"the final value of {phase.state_names[k]!r}" for k in one.finals]
    names = [b.name for b in definition.boundaries for _ in range(b.size)]
    words += [f"boundary constraint {names[k]!r}" for k in one.boundaries]
    paths = [b.name for b in phase.paths for _ in range(b.size)]
    words += [f"path constraint {paths[k]!r}" for k in one.paths]
    return list(dict.fromkeys(words))


def treat_dependent(
    definition: Definition,
    layout: Layout,
    program: NonlinearProgram,
    first_row: int,
    dependent: str,
) -> NonlinearProgram:
    """Return `program` with what is to be done about dependent equations done.

    Parameters
    ----------
    definition : Definition
        What is declared.
    layout : Layout
        Places in the program.
    program : NonlinearProgram
        The program.
    first_row : int
        The first row of the boundary constraints.
    dependent : str
        ``"raise"``, ``"drop"`` or ``"keep"``.

    Raises
    ------
    InvalidData
        Equations are dependent, and ``"raise"`` is asked for.
    """
    found = () if dependent == "keep" else dependences(definition)
    if not found:
        return program
    if dependent == "raise":
        raise InvalidData(_refusal(definition, found), field="final")
    lower, upper = program.column_lower.copy(), program.column_upper.copy()
    row_lower, row_upper = program.row_lower.copy(), program.row_upper.copy()
    for one in found:
        places = layout.phases[one.phase]
        phase = places.phase
        states = np.array(one.finals, np.int64)
        columns = places.state_columns[states, -1]
        lower[columns] = phase.stacked("states", "lower")[states]
        upper[columns] = phase.stacked("states", "upper")[states]
        rows = first_row + np.array(one.boundaries, np.int64)
        blocks = {block.name: block for block in program.rows}
        several = f" of {phase.name}" if len(layout.phases) > 1 else ""
        entry = 0
        for path in phase.paths:
            block = blocks[path.name + several]
            for k in range(path.size):
                if entry in one.paths:
                    begin = block.start + k * places.collocated
                    rows = np.concatenate([rows, np.arange(begin, begin + places.collocated)])
                entry += 1
        row_lower[rows], row_upper[rows] = -np.inf, np.inf
    return replace(
        program, column_lower=lower, column_upper=upper, row_lower=row_lower, row_upper=row_upper
    )


def _refusal(definition: Definition, found: tuple[Dependence, ...]) -> str:
    several = len(definition.phases) > 1
    parts = []
    for one in found:
        of = f" of phase {definition.phases[one.phase].name!r}" if several else ""
        words = _words(definition, one)
        implied = len(one.finals) + len(one.boundaries)
        if implied:
            parts.append(
                f"{implied} of the {one.conditions} conditions at the end{of} follow from the others "
                f"or contradict them, for the dynamics conserve something: for instance "
                f"{', '.join(words[:implied])}"
            )
        if one.paths:
            parts.append(
                f"the dynamics{of} keep {', '.join(words[-len(one.paths) :])} by themselves"
            )
    return (
        f"dependent equations: {'; '.join(parts)}. Leave them out, or let the program do so: "
        "formulation_options={'dependent': 'drop'}; verification checks them all the same"
    )
