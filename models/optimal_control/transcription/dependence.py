"""Equations that follow from one another: found, named, and left out where asked.

Where the dynamics conserve something, such as the length of a quaternion or a momentum, the values at
the end depend on one another: a state that starts as given can only be moved within the surface on
which what is conserved stays the same. Conditions on the end beyond the dimension of that surface
follow from the others, or contradict them; either way the program's equations are dependent, and
solvers fail. The dimension is measured: the motion is linearised along a drawn control, and the rank
of what the control, the free initial values and the free times can do to the conditions is counted.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import casadi
import numpy as np
import scipy.linalg
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.integrate import DOP853

from ....errors import InvalidData
from ...programs.nonlinear import NonlinearProgram
from ..definition import Definition, Phase
from .report import evaluated

if TYPE_CHECKING:
    from .layout import Layout

__all__ = ["Dependence", "dependences", "settled"]

log = logging.getLogger("crosstrack")

Floats = NDArray[np.float64]

#: Steps of the linearised motion, of order 8.
STEPS = 24
#: Growth of a disturbance at which the linearised motion is cut off: beyond, everything looks alike.
GROWTH = 50.0
#: Share of the largest effect below which an effect counts as none.
NONE = 1e-8
#: Largest relative drift of what counts as conserved.
CONSERVED = 1e-7


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
        each = (_examined(definition, k) for k in range(len(definition.phases)))
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
    begin = sum(one.end_size for one in definition.phases[:number])
    own = set(range(begin, begin + phase.end_size))
    sparsity = definition.endpoint.jac_sparsity(1, 0)
    rows, columns = (np.array(part) for part in sparsity.get_triplet())
    kept = [int(k) for k in equal if set(columns[rows == k].tolist()) <= own and (rows == k).any()]
    return finals, kept


def _examined(definition: Definition, number: int) -> Dependence | None:
    phase = definition.phases[number]
    finals, boundaries = _conditions(definition, number)
    low, high = phase.stacked("paths", "lower"), phase.stacked("paths", "upper")
    paths = np.flatnonzero(low == high).tolist()
    total = len(finals) + len(boundaries)
    if not total and not paths:
        return None
    best: tuple[int, NDArray[np.int64]] | None = None
    kept = set(paths)
    for seed in (1, 2):
        with np.errstate(all="ignore"):  # what overflows is looked at, and given up
            motion = _linearised(definition, phase, seed)
        if motion is None:
            log.debug("dependence of phase %r cannot be measured", phase.name)
            return None
        kept &= set(_kept_paths(phase, motion, paths))
        if total:
            effects = _effects(definition, number, finals, boundaries, motion)
            rank, order = _rank(effects)
            if best is None or rank > best[0]:
                best = rank, order
        if not kept and (best is None or best[0] == total):
            return None  # the second motion is only to confirm
    rank, order = best if best is not None else (0, np.empty(0, np.int64))
    if rank < total:
        # Which ones to leave out is decided at the end itself: what is extremal there, such as the
        # largest entry of a quaternion, follows from the others and not they from it.
        with np.errstate(all="ignore"):
            there = _at_target(definition, phase)
        if there is not None:
            order = _rank(_effects(definition, number, finals, boundaries, there))[1]
    implied = sorted(int(k) for k in order[rank:])
    if not implied and not kept:
        return None
    return Dependence(
        number,
        tuple(finals[k] for k in implied if k < len(finals)),
        tuple(boundaries[k - len(finals)] for k in implied if k >= len(finals)),
        tuple(sorted(kept)),
        total,
    )


@dataclass(frozen=True, eq=False)
class _Motion:
    """A drawn motion with its linearisation: effects are columns, free values at the start first."""

    times: Floats
    states: Floats
    controls: Floats
    parameters: Floats
    end: Floats
    integral: Floats
    effects: Floats
    integral_effects: Floats
    start_free: NDArray[np.int64]


def _at_target(definition: Definition, phase: Phase) -> _Motion | None:
    """Return what can be done at the wanted end: effects of a motion from there, carried back."""
    low, high = phase.stacked("states", "final_lower"), phase.stacked("states", "final_upper")
    target = np.where(low == high, low, phase.guess.states[-1])
    onward = _linearised(definition, phase, 1, target)
    if onward is None:
        return None
    nx = target.size
    try:
        back = np.linalg.solve(onward.effects[:, :nx], onward.effects[:, nx:])
    except np.linalg.LinAlgError:
        return None
    # Columns of the states' own first values are no effects here.
    own = np.hstack([np.zeros((nx, nx)), back])
    other = np.hstack([np.zeros((onward.integral.size, nx)), onward.integral_effects[:, nx:]])
    return replace(
        onward, end=target, effects=own, integral_effects=other, start_free=np.empty(0, np.int64)
    )


def _linearised(
    definition: Definition, phase: Phase, seed: int, begin: Floats | None = None
) -> _Motion | None:
    """Integrate the phase under a drawn control, with the effects of all that is free.

    From `begin`, where it is given, all states count as free at the start, in units of their own.
    """
    draw = np.random.default_rng(seed)
    nx, nu, nq = len(phase.state_names), len(phase.control_names), phase.integrals
    guess, p = phase.guess, definition.stacked("parameters", "initial_lower")
    low, high = phase.stacked("states", "initial_lower"), phase.stacked("states", "initial_upper")
    free = np.flatnonzero(low < high)
    x = np.clip(guess.states[0], low, high)
    scale = phase.stacked("states", "scale")
    x[free] = np.clip(x + 0.1 * scale * draw.normal(size=nx), low, high)[free]
    if begin is not None:
        x, free = begin.copy(), np.arange(nx)
    basis = max(4, int(np.ceil(2 * nx / max(nu, 1)))) if nu else 0
    size = phase.stacked("controls", "scale")
    middle = guess.controls.mean(axis=0) if nu else np.zeros(0)
    shape = draw.normal(size=(4, nu)) / np.arange(1, 5)[:, None]
    span = guess.end - guess.start
    tangent = _tangent(phase)

    def control(s: float) -> Floats:
        waves = np.cos(np.pi * (np.arange(4) * s + 0.3))
        drawn: Floats = middle + 0.5 * size * np.tanh(waves @ shape)
        return drawn

    steps_of = np.eye(max(basis, 1))

    def rates(t: float, x: Floats, effects: Floats) -> tuple[Floats, Floats]:
        s = (t - guess.start) / span
        parts = tangent(t, x, control(s), p)
        rate, by_x, by_u, by_p = (np.array(part, float) for part in parts)
        change = by_x @ effects[:nx]
        first = free.size
        if nu:
            strength = legendre.legval(2.0 * s - 1.0, steps_of)
            drive = (by_u * size)[:, :, None] * strength
            change[:, first : first + nu * basis] += drive.reshape(nx + nq, nu * basis)
        if p.size:
            change[:, first + nu * basis :] += by_p
        return rate[:, 0], change

    effects = np.zeros((nx + nq, free.size + nu * basis + p.size))
    effects[free, np.arange(free.size)] = scale[free] if begin is None else 1.0
    state = np.concatenate([x, np.zeros(nq)])
    step = span / STEPS
    times, states, controls = [guess.start], [x.copy()], [control(0.0)]
    for k in range(STEPS):
        t = guess.start + k * step
        state, effects = _stepped(rates, t, step, state, effects, nx)
        if not (np.isfinite(state).all() and np.isfinite(effects).all()):
            return None
        times.append(t + step)
        states.append(state[:nx].copy())
        controls.append(control((k + 1) / STEPS))
        grown = (np.abs(effects[:nx]) / scale[:, None]).max(initial=0.0)
        if grown > GROWTH and k >= 5:
            break
    table = np.array(states)
    rate: Floats = rates(times[-1], table[-1], effects)[0]
    # A free end moves along the motion.
    effects = np.column_stack([effects, rate * span])
    return _Motion(
        np.array(times), table, np.array(controls).reshape(len(times), nu), p, table[-1],
        state[nx:], effects[:nx], effects[nx:], free,
    )  # fmt: skip


def _tangent(phase: Phase) -> casadi.Function:
    t, x = casadi.MX.sym("t"), casadi.MX.sym("x", len(phase.state_names))
    u = casadi.MX.sym("u", len(phase.control_names))
    p = casadi.MX.sym("p", phase.function.size1_in(3))
    rate, _, integrand, _ = phase.function(t, x, u, p)
    both = casadi.vertcat(rate, integrand)
    parts = [both, *(casadi.densify(casadi.jacobian(both, z)) for z in (x, u, p))]
    return casadi.Function("tangent", [t, x, u, p], parts)


def _stepped(
    rates: Any, t: float, step: float, state: Floats, effects: Floats, nx: int
) -> tuple[Floats, Floats]:
    """Return state and effects one step of Dormand and Prince's order 8 later."""
    stages: list[tuple[Floats, Floats]] = []
    for k in range(DOP853.n_stages):
        x, v = state.copy(), effects.copy()
        for j, weight in enumerate(DOP853.A[k, :k]):
            if weight:
                x += step * weight * stages[j][0]
                v += step * weight * stages[j][1]
        stages.append(rates(t + DOP853.C[k] * step, x[:nx], v))
    for k, weight in enumerate(DOP853.B):
        state = state + step * weight * stages[k][0]
        effects = effects + step * weight * stages[k][1]
    return state, effects


def _effects(
    definition: Definition, number: int, finals: list[int], boundaries: list[int], motion: _Motion
) -> Floats:
    """Return what each free value does to each condition, each condition in its own terms."""
    phase = definition.phases[number]
    nx = len(phase.state_names)
    moves = motion.effects.shape[1]
    fixed_end = phase.end_lower == phase.end_upper
    # How t0, tf, x0, xf and the integrals of this phase move.
    ends = np.zeros((phase.end_size, moves))
    ends[1, -1] = 0.0 if fixed_end else phase.guess.end - phase.guess.start
    scale = phase.stacked("states", "scale")
    start = motion.start_free
    ends[2 + start, np.arange(start.size)] = scale[start]
    ends[2 + nx : 2 + 2 * nx] = motion.effects
    ends[2 + 2 * nx :] = motion.integral_effects
    if fixed_end:
        ends[:, -1] = 0.0
    rows = [_in_own_terms(ends[2 + nx + k], np.abs(ends[2 + nx + k])) for k in finals]
    if boundaries:
        e = np.concatenate(
            [
                np.concatenate(
                    [
                        [one.guess.start, one.guess.end],
                        one.guess.states[0],
                        one.guess.states[-1],
                        np.zeros(one.integrals),
                    ]
                )
                for one in definition.phases
            ]
        )
        begin = sum(one.end_size for one in definition.phases[:number])
        own = slice(begin, begin + phase.end_size)
        e[own] = np.concatenate(
            [[motion.times[0], motion.times[-1]], motion.states[0], motion.end, motion.integral]
        )
        symbols = [
            casadi.MX.sym(name, definition.endpoint.size1_in(k)) for k, name in enumerate("ep")
        ]
        boundary = definition.endpoint(*symbols)[1]
        jacobian = casadi.Function("boundary", symbols, [casadi.jacobian(boundary, symbols[0])])
        table = np.array(jacobian(e, motion.parameters), float)[:, own]
        rows += [
            _in_own_terms(table[k] @ ends, np.abs(table[k]) @ np.abs(ends)) for k in boundaries
        ]
    return np.array(rows, float)


def _in_own_terms(effect: Floats, terms: Floats) -> Floats:
    """Return an effect in terms of its own size, so that units count for nothing; 0 if it cancels."""
    size, most = float(np.linalg.norm(effect)), float(np.linalg.norm(terms))
    return effect / size if size > NONE * most else np.zeros_like(effect)


def _rank(effects: Floats) -> tuple[int, NDArray[np.int64]]:
    """Return the rank of the rows, and their order: independent ones first."""
    if not effects.size or not np.isfinite(effects).all():
        return effects.shape[0], np.arange(effects.shape[0])
    _, triangle, order = scipy.linalg.qr(effects.T, mode="economic", pivoting=True)
    sizes = np.abs(np.diag(triangle))
    full = np.zeros(effects.shape[0])
    full[: sizes.size] = sizes
    return int((full > NONE).sum()), np.asarray(order, np.int64)


def _kept_paths(phase: Phase, motion: _Motion, paths: list[int]) -> list[int]:
    """Return the path equations whose expression does not change along the drawn motion."""
    if not paths:
        return []
    values = evaluated(phase, motion.times, motion.states, motion.controls, motion.parameters)[1]
    drift = np.abs(values - values[:, :1]).max(axis=1)
    moved = np.abs(np.diff(motion.states, axis=0)).max() > 1e-6
    return [
        k
        for k in paths
        if moved and drift[k] <= CONSERVED * max(1.0, float(np.abs(values[k]).max()))
    ]


def _words(definition: Definition, one: Dependence) -> list[str]:
    phase = definition.phases[one.phase]
    words = [f"the final value of {phase.state_names[k]!r}" for k in one.finals]
    names = [b.name for b in definition.boundaries for _ in range(b.size)]
    words += [f"boundary constraint {names[k]!r}" for k in one.boundaries]
    paths = [b.name for b in phase.paths for _ in range(b.size)]
    words += [f"path constraint {paths[k]!r}" for k in one.paths]
    return list(dict.fromkeys(words))


def settled(
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
