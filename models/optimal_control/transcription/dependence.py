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
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import casadi
import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ....errors import InvalidData
from ...programs.nonlinear import NonlinearProgram
from ..definition import Definition, Phase
from .reach import NONE, Motion, carry_to_target, draw_motion, in_own_terms

if TYPE_CHECKING:
    from .layout import Layout

__all__ = ["Dependence", "dependences", "treat_dependent"]

log = logging.getLogger("crosstrack")

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


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
        motion = draw_motion(definition, phase, seed)
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
        there = carry_to_target(definition, phase)
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


def _effects(
    definition: Definition, number: int, finals: list[int], boundaries: list[int], motion: Motion
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
    return in_own_terms(slopes @ motion.effects, np.abs(slopes) @ np.abs(motion.effects))


def _guessed_ends(phase: Phase) -> Floats:
    guess = phase.guess
    ends = [[guess.start, guess.end], guess.states[0], guess.states[-1], np.zeros(phase.integrals)]
    return np.concatenate(ends)


def _preference(phase: Phase, finals: list[int], motion: Motion, total: int) -> Floats:
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
