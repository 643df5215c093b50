"""Equations that follow from one another: found, named, and left out where asked.

Where the dynamics conserve something, such as the length of a quaternion or a momentum, the values at
the end depend on one another: a state that starts as given can only be moved within the surface on
which what is conserved stays the same. Conditions on the end beyond the dimension of that surface
follow from the others, or contradict them; either way the program's equations are dependent, and
solvers fail. The dimension is measured: the program is built on one interval, its equations of motion
are solved along a drawn control, and a pivoted QR counts the rank of what the control, the free
initial values, the parameters and the free times can do to the conditions in the linearised equations.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import casadi
import numpy as np
import scipy.linalg
from numpy.polynomial import legendre
from numpy.typing import NDArray

from ....errors import InvalidData
from ...programs.nonlinear import NonlinearProgram
from ..definition import Definition, Phase
from .assembly import Assembly
from .layout import Layout
from .mesh import even
from .schemes import radau

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
    finals = np.flatnonzero(np.equal(*phase.bounds("states", "final"))).tolist()
    equal = np.flatnonzero(np.equal(*definition.bounds("boundaries")))
    # Only those of this phase alone: what links two phases hangs on both motions.
    begin = sum(one.end_size for one in definition.phases[:number])
    rows, columns = (
        np.array(part) for part in definition.endpoint.jac_sparsity(1, 0).get_triplet()
    )
    inside = (begin <= columns) & (columns < begin + phase.end_size)
    kept = [int(k) for k in equal if (rows == k).any() and inside[rows == k].all()]
    return finals, kept


def _examine(definition: Definition, number: int) -> Dependence | None:
    phase = definition.phases[number]
    finals, boundaries = _conditions(definition, number)
    kept = set(np.flatnonzero(np.equal(*phase.bounds("paths"))).tolist())
    total = len(finals) + len(boundaries)
    if not total and not kept:
        return None
    probe = _Probe(definition, number, finals, boundaries)
    rank, order = -1, np.empty(0, np.int64)
    for seed in (1, 2):  # the second motion is to confirm what the first one finds
        effects = probe.effects(seed)
        if effects is None:
            log.debug("dependence of phase %r cannot be measured", phase.name)
            return None
        kept &= effects[2]
        found = _rank(effects[0])
        if found[0] > rank:
            rank, order = found
        if not kept and rank == total:
            return None
    if rank < total:
        # Which ones to leave out is decided at the end itself: what is extremal there, such as the
        # largest entry of a quaternion, follows from the others and not they from it.
        there = probe.effects(1, arriving=True)
        if there is not None:
            preference = _preference(phase, finals, there[1], total)
            order = _rank(there[0] * preference[:, None])[1]
    implied = sorted(int(k) for k in order[rank:])
    return Dependence(
        number,
        tuple(finals[k] for k in implied if k < len(finals)),
        tuple(boundaries[k - len(finals)] for k in implied if k >= len(finals)),
        tuple(sorted(kept)),
        total,
    )


class _Probe:
    """The equations of one phase on one interval, and the conditions on its end."""

    def __init__(
        self, definition: Definition, number: int, finals: list[int], boundaries: list[int]
    ) -> None:
        phase = self.phase = definition.phases[number]
        nx, nu = len(phase.state_names), len(phase.control_names)
        # Polynomials of the control for every state, and nodes that resolve what they do.
        basis = max(4, -(-2 * nx // nu)) if nu else 0
        scheme, count = radau(2 * basis + 12), len(definition.phases)
        nodes = scheme.collocated.size
        layout = Layout.of(definition, [even(1, nodes)] * count, [(scheme,)] * count)
        assembly, symbol = Assembly(layout), casadi.MX.sym("x", layout.size)
        rows = [assembly.values(symbol)[1], assembly.first(symbol)[1]]
        self.function = casadi.Function("rows", [symbol], rows)
        self.points, self.places = scheme.points, layout.phases[number]
        self.scale, self.columns = assembly.column_bounds()[2], np.zeros(layout.size)
        self.columns[layout.parameter_columns] = definition.stacked("parameters", "initial_lower")
        for one in layout.phases:
            self.columns[one.state_columns[:, 0]] = one.phase.guess.states[0]
            self.columns[one.state_columns[:, -1]] = one.phase.guess.states[-1]
            self.columns[one.time_columns] = one.phase.guess.start, one.phase.guess.end
        # Rows of the program: motion, then paths node by node, then integrals.
        first = assembly.row_starts[number]
        defects, paths = nx * nodes, self.places.paths
        self.equations = first + np.delete(
            np.arange(defects + nodes * paths + phase.integrals),
            defects + np.arange(nodes * paths),
        )
        self.last_paths = first + defects + nodes * np.arange(1, paths + 1) - 1
        self.boundaries = assembly.row_starts[-1] + np.array(boundaries, np.int64)

        # The changes: free initial values, the control's polynomials, parameters, both times.
        def unit(places: Indices) -> Floats:
            found = np.zeros((places.size, layout.size))
            found[np.arange(places.size), places] = 1.0
            return found

        x = self.places.state_columns
        self.finals = unit(x[finals, -1])
        free = np.flatnonzero(np.less(*phase.bounds("states", "initial")))
        self.free_starts = free.size
        shapes = legendre.legvander(scheme.control_points, basis)[:, :basis]
        control = [shapes.T @ unit(own) for own in self.places.control_columns]
        others = np.concatenate([layout.parameter_columns, self.places.time_columns])
        self.changes = np.vstack([unit(x[free, 0]), *control, unit(others)]).T

    def effects(
        self, seed: int, *, arriving: bool = False
    ) -> tuple[Floats, Floats, set[int]] | None:
        """Return what can be done to the end of a drawn motion; None where it cannot be computed.

        That is a row for each final value and boundary constraint, with a column for each change of
        a free initial value, the control, a parameter, a time; how far each final state moves at
        all; and the path expressions that control, parameters and times leave alone.

        The motion leaves the start of the phase or, `arriving`, ends where it is wanted to. It lasts
        as long as one polynomial resolves it, at most as long as guessed: directions that can be
        reached at all can be reached in a part of the time.
        """
        phase, guess, columns, scale = self.phase, self.phase.guess, self.columns, self.scale
        x, u = self.places.state_columns, self.places.control_columns
        times, integrals = self.places.time_columns, self.places.integral_columns
        draw = np.random.default_rng(seed)
        stray = 0.1 * scale[x[:, 0]] * draw.normal(size=len(x))
        known = np.clip(
            guess.states[-1 if arriving else 0] + stray,
            *phase.bounds("states", "final" if arriving else "initial"),
        )
        waves = draw.normal(size=(4, len(u))) / np.arange(1, 5)[:, None]
        drawn = 0.3 * legendre.legvander(self.points[1:], 3) @ waves
        columns[u] = guess.controls.mean(axis=0)[:, None] + scale[u] * drawn.T
        onward = np.append(x[:, 1:], integrals)
        fixed = [phase.start_lower == phase.start_upper, phase.end_lower == phase.end_upper]
        with np.errstate(all="ignore"):  # what overflows is tried on half the time
            for halving in range(HALVINGS):
                span = (guess.end - guess.start) * 0.5**halving
                start = guess.end - span if arriving else guess.start
                columns[times], scale[times] = (start, start + span), span
                columns[x], columns[integrals] = known[:, None], 0.0
                try:
                    self._solve(np.append(x[:, :-1], integrals) if arriving else onward)
                    table = self._evaluate()[1]
                    moves = self.changes.copy()
                    moves[onward] = np.linalg.solve(
                        table[np.ix_(self.equations, onward)], -table[self.equations] @ moves
                    )
                except np.linalg.LinAlgError:  # a span on which the motion is not unique
                    continue
                motion = np.concatenate([(columns / scale)[x][..., None], moves[x]], axis=2)
                if not (self._resolved(motion[..., :1]) and self._resolved(motion[..., 1:])):
                    continue
                paths = _in_own_terms(table[self.last_paths], moves[:, self.free_starts :])
                moves[:, -2:][:, fixed] = 0.0
                conditions = np.vstack([self.finals, table[self.boundaries]])
                return (
                    _in_own_terms(conditions, moves),
                    scale[x[:, -1]] * np.linalg.norm(moves[x[:, -1]], axis=1),
                    set(np.flatnonzero(~paths.any(axis=1)).tolist()),
                )
        return None

    def _evaluate(self) -> tuple[Floats, Floats]:
        """Return the rows and their Jacobian in terms of the columns' scales."""
        rows, table = (np.array(part, float) for part in self.function(self.columns))
        table *= self.scale
        return rows[:, 0], table

    def _solve(self, unknown: Indices) -> None:
        """Solve the equations of motion by Newton's method, from a state that stays.

        ``LinAlgError`` where it does not converge.
        """
        x, scale = self.places.state_columns, self.scale
        size = DIVERGED * max(1.0, float(np.abs(self.columns[x] / scale[x]).max()))
        for _ in range(STEPS):
            rows, table = self._evaluate()
            square = table[np.ix_(self.equations, unknown)]
            most = np.abs(self.columns[x] / scale[x]).max()
            if not np.isfinite(square).all() or most > size:
                break
            step = np.linalg.solve(square, rows[self.equations])
            self.columns[unknown] -= scale[unknown] * step
            if not np.abs(step[: x[:, 1:].size]).max() > CONVERGED * max(1.0, float(most)):
                return
        raise np.linalg.LinAlgError

    def _resolved(self, table: Floats) -> bool:
        """Return whether polynomials through `table`, (states, points, …), have no tail to speak of."""
        matrix = legendre.legvander(self.points, self.points.size - 1)
        waves = np.linalg.solve(matrix, table)
        size = np.abs(waves).max(axis=2, initial=0.0)
        return bool((size[:, -2:] <= RESOLVED * size.max(axis=1, keepdims=True)).all())


def _in_own_terms(slopes: Floats, moves: Floats) -> Floats:
    """Return the effects of `moves`, each row in terms of its own size; 0 where its terms cancel."""
    effects, terms = slopes @ moves, np.abs(slopes) @ np.abs(moves)
    size, most = (np.linalg.norm(part, axis=1, keepdims=True) for part in (effects, terms))
    return np.where(size > NONE * most, effects / np.where(size > 0.0, size, 1.0), 0.0)


def _preference(phase: Phase, finals: list[int], moves: Floats, total: int) -> Floats:
    """Return factors near 1 that decide between conditions that follow from one another alike.

    Among the entries of a vector the one that moves more is imposed, of several states the one that
    was declared later; without them rounding would decide.
    """
    whose = np.array([name.partition("[")[0] for name in phase.state_names])
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


def treat_dependent(
    assembly: Assembly, program: NonlinearProgram, dependent: str
) -> NonlinearProgram:
    """Return `program` with what is to be done about dependent equations done.

    Parameters
    ----------
    assembly : Assembly
        What built the program.
    program : NonlinearProgram
        The program.
    dependent : str
        ``"raise"``, ``"drop"`` or ``"keep"``.

    Raises
    ------
    InvalidData
        Equations are dependent, and ``"raise"`` is asked for.
    """
    found = () if dependent == "keep" else dependences(assembly.definition)
    if not found:
        return program
    if dependent == "raise":
        raise InvalidData(_refusal(assembly.definition, found), field="final")
    lower, upper = program.column_lower.copy(), program.column_upper.copy()
    row_lower, row_upper = program.row_lower.copy(), program.row_upper.copy()
    for one in found:
        places = assembly.layout.phases[one.phase]
        states = np.array(one.finals, np.int64)
        columns = places.state_columns[states, -1]
        lower[columns] = places.phase.stacked("states", "lower")[states]
        upper[columns] = places.phase.stacked("states", "upper")[states]
        first = assembly.row_starts[one.phase] + places.nx * places.defects
        paths = np.add.outer(
            np.array(one.paths, np.int64) * places.collocated, np.arange(places.collocated)
        )
        rows = np.append(
            first + paths, assembly.row_starts[-1] + np.array(one.boundaries, np.int64)
        )
        row_lower[rows], row_upper[rows] = -np.inf, np.inf
    return replace(
        program, column_lower=lower, column_upper=upper, row_lower=row_lower, row_upper=row_upper
    )


def _refusal(definition: Definition, found: tuple[Dependence, ...]) -> str:
    several = len(definition.phases) > 1
    parts = []
    for one in found:
        phase = definition.phases[one.phase]
        of = f" of phase {phase.name!r}" if several else ""
        names = [b.name for b in definition.boundaries for _ in range(b.size)]
        words = [f"the final value of {phase.state_names[k]!r}" for k in one.finals]
        words += [f"boundary constraint {names[k]!r}" for k in one.boundaries]
        if words:
            parts.append(
                f"{len(words)} of the {one.conditions} conditions at the end{of} follow from the "
                "others or contradict them, for the dynamics conserve something: for instance "
                f"{', '.join(dict.fromkeys(words))}"
            )
        names = [b.name for b in phase.paths for _ in range(b.size)]
        kept = dict.fromkeys(f"path constraint {names[k]!r}" for k in one.paths)
        if kept:
            parts.append(f"the dynamics{of} keep {', '.join(kept)} by themselves")
    return (
        f"dependent equations: {'; '.join(parts)}. Leave them out, or let the program do so: "
        "formulation_options={'dependent': 'drop'}; verification checks them all the same"
    )
