"""Equations that follow from one another: found by a rank, and left out of the program.

Where the dynamics conserve something, such as the length of a quaternion, conditions at the end follow
from one another, and the program's equations are dependent. Along a short drawn motion the equations
of motion are eliminated: what controls, initial values, times and parameters do to the conditions is
computed by the adjoint equations, and a pivoted QR tells the rank. What can be reached at all can be
reached in a short time; a rank that not all drawn motions lose is no dependence.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np
import scipy.linalg
from numpy.polynomial import legendre
from numpy.typing import NDArray

from ...programs.nonlinear import NonlinearProgram
from ..definition import Definition, Phase
from .assembly import Assembly
from .derivatives import Twice, functions_of

__all__ = ["Dependence", "dependences", "drop_dependent"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Order = list[int]

#: Share of its terms, or of the other rows, below which an effect counts as none; rounding is less.
NONE = 1e-10
#: Relative change at which a motion has converged, and share of the last coefficients of its series.
CONVERGED, RESOLVED = 1e-13, 1e-10
ROUNDING = 1e-14
#: How many times as long each motion is tried as the one before.
LONGER = 64.0
#: Motions that are drawn, halvings of the time of one, Picard steps for each, nodes at least.
MOTIONS, HALVINGS, STEPS, NODES = 3, 40, 40, 24


@dataclass(frozen=True)
class Dependence:
    """Conditions of one phase that follow from others.

    Parameters
    ----------
    phase : int
        The phase's place.
    finals, boundaries, paths : tuple of int
        States whose final values follow, and entries of the boundary constraints and path equations.
    begun : tuple of int
        Those of the path equations that hold throughout if they hold at the start, which is free.
    """

    phase: int
    finals: tuple[int, ...]
    boundaries: tuple[int, ...]
    paths: tuple[int, ...]
    begun: tuple[int, ...] = ()

    def names(self, definition: Definition) -> list[str]:
        """Return them for people."""
        phase = definition.phases[self.phase]
        of = f" of phase {phase.name!r}" if len(definition.phases) > 1 else ""
        found = [f"final value of {phase.state_names[k]!r}{of}" for k in self.finals]
        for what, places, all_of in (
            ("boundary constraint", self.boundaries, definition.boundaries),
            (f"path constraint{of}", self.paths, phase.paths),
        ):
            names = [one.name for one in all_of for _ in range(one.size)]
            found += dict.fromkeys(f"{what} {names[k]!r}" for k in places)
        return found


_known: WeakKeyDictionary[Definition, tuple[Dependence, ...]] = WeakKeyDictionary()


def dependences(definition: Definition) -> tuple[Dependence, ...]:
    """Return what is found of every phase, phases without any left out; computed once."""
    if definition not in _known:
        with np.errstate(all="ignore"):  # what overflows is tried on a shorter motion
            each = [_examine(definition, k) for k in range(len(definition.phases))]
        _known[definition] = tuple(one for one in each if one is not None)
    return _known[definition]


def _examine(definition: Definition, number: int) -> Dependence | None:
    phase = definition.phases[number]
    finals = np.flatnonzero(np.equal(*phase.bounds("states", "final"))).tolist()
    paths = np.flatnonzero(np.equal(*phase.bounds("paths"))).tolist()
    # Boundaries of this phase alone: what links two phases depends on both motions.
    begin = sum(one.end_size for one in definition.phases[:number])
    rows, columns = map(np.array, definition.endpoint.jac_sparsity(1, 0).get_triplet())
    inside = (begin <= columns) & (columns < begin + phase.end_size)
    equal = np.flatnonzero(np.equal(*definition.bounds("boundaries")))
    boundaries = [int(k) for k in equal if (rows == k).any() and inside[rows == k].all()]
    count, rank, kept, begun = len(finals) + len(boundaries), -1, set(paths), set[int]()
    order: Order = []
    if not count and not paths:
        return None
    for seed in range(MOTIONS):
        effects = _effects(definition, number, finals, boundaries, paths, seed)
        if effects is None:
            continue
        found = _rank(effects[0])
        rank, order = found if found[0] > rank else (rank, order)
        found = _rank(effects[1])
        kept &= {paths[k] for k in found[1][found[0] :]}
        begun |= {paths[k] for k in np.flatnonzero(effects[2])}
        if rank == count and not kept:
            return None
    if rank < 0:
        return None  # no motion was found: nothing is known
    if rank < count:
        # Which ones to leave out is decided at the end itself: what is extremal there, such as the
        # largest entry of a quaternion, follows from the others and not they from it.
        effects = _effects(definition, number, finals, boundaries, [], 0, arriving=True)
        if effects is not None:
            order = _rank(effects[0], _preference(phase, finals, effects[0]))[1]
    implied = sorted(order[rank:])
    return Dependence(
        number,
        tuple(finals[k] for k in implied if k < len(finals)),
        tuple(boundaries[k - len(finals)] for k in implied if k >= len(finals)),
        tuple(sorted(kept)),
        tuple(sorted(kept & begun)),
    )


def _effects(
    definition: Definition, number: int, finals: Order, boundaries: Order, paths: Order,
    seed: int, *, arriving: bool = False,
) -> tuple[Floats, Floats, Bools] | None:  # fmt: skip
    """Return what can be done to the end of a drawn motion; None where none is found.

    That is a row for each final value and boundary constraint, and apart for each path expression, with
    a column for each change of a control at a node, a free initial value (not of paths), a time or a
    parameter, all in terms of sizes; and which path expressions initial values alone change. The motion
    leaves the start of the phase or, `arriving`, ends where the phase ends.
    """
    phase, draw = definition.phases[number], np.random.default_rng(seed)
    functions = functions_of(definition)
    guess, nx, nu = phase.guess, len(phase.state_names), len(phase.control_names)
    size_x, size_u = phase.stacked("states", "scale"), phase.stacked("controls", "scale")
    size_p, nz = definition.stacked("parameters", "scale"), nx + phase.integrals
    nodes = max(NODES, 2 * -(-(len(finals) + len(boundaries)) // max(nu, 1)))
    points = np.append(legendre.leggauss(nodes)[0], 1.0)
    side, at = ("final", -1) if arriving else ("initial", 0)
    anchor = guess.states[at] + 0.1 * size_x * draw.normal(size=nx)
    anchor = np.clip(anchor, *phase.bounds("states", side))
    waves = 0.3 * size_u * draw.normal(size=(4, nu)) / np.arange(1.0, 5.0)[:, None]
    u = guess.controls.mean(axis=0) + legendre.legvander(points, 3) @ waves
    p = definition.stacked("parameters", "initial_lower")
    p = np.clip(p + 0.1 * size_p * draw.normal(size=p.size), *definition.bounds("parameters"))
    times = np.array([guess.start, guess.end])
    others = np.hstack([u, np.tile(np.append(times, p), (nodes + 1, 1))])
    sizes = np.concatenate([size_x, size_u, np.repeat(times[1] - times[0], 2), size_p])
    motion = _Motion(functions.nodes[number], points, anchor, others, sizes, nz)
    # Where the time is too short for the linearised motion to tell, a longer one does.
    shares = LONGER**seed * 0.5 ** np.arange(HALVINGS)
    flown = next(filter(None, (motion.fly(one, arriving) for one in shares)), None)
    if flown is None:
        return None
    z, slopes, adjoint = flown
    # Changes: controls at each node and at the end, initial values, times, parameters.
    own, common = slopes[:-1, :nz, nx : nx + nu], slopes[:-1, :nz, nx + nu :]
    after = np.tensordot(motion.integral[-1], adjoint[1:] @ common, 1)
    moves = np.hstack([*(adjoint[1:] @ own), np.zeros((nz, nu)), adjoint[0, :, :nx], after])
    # ... of the final states and integrals, the final controls, initial values, times, parameters.
    moves = np.vstack([moves, np.eye(moves.shape[1])[nodes * nu :]])
    free = (
        np.ones(nu * (nodes + 1), bool),
        np.less(*phase.bounds("states", "initial")),
        np.array([phase.start_lower < phase.start_upper, phase.end_lower < phase.end_upper]),
        np.less(*definition.bounds("parameters")),
    )
    moves *= np.concatenate(free)
    x0, x, rest = nz + nu + np.arange(nx), np.arange(nx), np.arange(nz + nu + nx, len(moves))
    conditions = np.zeros((len(finals) + len(boundaries), len(moves)))
    conditions[np.arange(len(finals)), finals] = 1.0
    # The ends of all phases, of which only this one's matter, and the parameters.
    ends = np.zeros(definition.endpoint.size1_in(0) + p.size)
    begin = sum(one.end_size for one in definition.phases[:number])
    places = begin + np.arange(phase.end_size)
    places = np.append(places, np.arange(ends.size - p.size, ends.size))
    start = z[-1, :nx] if arriving else anchor
    ends[places] = np.concatenate([times, start, z[-1], p])
    twice = functions.endpoint
    jacobian = np.zeros((twice.entries, ends.size))
    jacobian[twice.first_at] = np.array(twice.first(ends)).reshape(-1)
    columns = np.concatenate([rest[:2], x0, np.arange(nz), rest[2:]])
    size_z = np.append(size_x, np.ones(nz - nx))
    scale = np.concatenate([sizes[nx + nu : nx + nu + 2], size_x, size_z, size_p])
    conditions[len(finals) :, columns] = jacobian[1:][boundaries][:, places] * scale
    held = np.zeros((len(paths), len(moves)))
    held[:, np.concatenate([x, nz + np.arange(nu), rest])] = slopes[-1, nz:][paths]
    if not (np.isfinite(conditions).all() and np.isfinite(held).all()):
        return None
    later = _cleaned(held, moves)
    begun: Bools = np.any(later[:, nu * (nodes + 1) + x], axis=1)
    later[:, nu * (nodes + 1) + x] = 0.0
    begun &= ~np.any(later, axis=1)
    return _cleaned(conditions, moves), later, begun


class _Motion:
    """The equations of motion of one phase, on Gauss points and the end."""

    def __init__(
        self, twice: Twice, points: Floats, anchor: Floats, others: Floats, sizes: Floats, nz: int
    ) -> None:
        self.value, self.first = (one.map(points.size) for one in (twice.value, twice.first))
        self.shape = points.size, twice.entries, sizes.size
        self.at, self.points = twice.first_at, points
        self.anchor, self.others, self.sizes, self.nz = anchor, others, sizes, nz
        count = points.size - 1
        self.series = np.linalg.inv(legendre.legvander(points[:-1], count - 1))
        #: Half the integrals from -1 up to the points, of values at the Gauss points.
        self.integral = (
            0.5 * legendre.legvander(points, count) @ legendre.legint(self.series, lbnd=-1)
        )

    def fly(self, share: float, arriving: bool) -> tuple[Floats, Floats, Floats] | None:
        """Return the motion over a share of the time; None where no series of that order resolves it.

        That is states and integrals, slopes of all node functions in terms of sizes, and, for the start
        and each Gauss point, what a change there does to the end.
        """
        nx, nz, whole = self.anchor.size, self.nz, self.integral[-1]
        size = self.sizes[:nx]
        sigma = 0.5 * share * (self.points + 1.0) + (1.0 - share) * arriving
        place = np.vstack([sigma, np.full(self.points.size, 2.0 * share)])
        z = np.zeros((self.points.size, nz))
        z[:, :nx] = self.anchor
        for _ in range(STEPS):
            given = np.hstack([z[:, :nx], self.others]).T
            flow = np.array(self.value(given, place)).T[:-1, :nz]
            last, z = z, (self.integral - arriving * whole) @ flow
            z[:, :nx] += self.anchor
            change = np.abs((z - last)[:, :nx] / size).max()
            if not change > CONVERGED * max(1.0, np.abs(z[:, :nx] / size).max()):
                break
        else:
            return None
        slopes = np.zeros(self.shape)
        rows, columns = self.at
        slopes[:, rows, columns] = np.array(self.first(given, place)).reshape(rows.size, -1).T
        slopes *= self.sizes
        slopes[:, :nx] /= size[:, None]
        rates = slopes[:-1, :nz, :nx]
        ahead = whole - np.vstack([np.zeros_like(whole), self.integral[:-1]])
        adjoint = np.tile(np.eye(nz), (ahead.shape[0], 1, 1))
        for k in range(STEPS + nz):  # small effects over a chain of states need as many steps
            last, adjoint = adjoint, np.tile(np.eye(nz), (ahead.shape[0], 1, 1))
            adjoint[:, :, :nx] += np.tensordot(ahead, last[1:] @ rates, 1)
            if k >= nz and not np.abs(adjoint - last).max() > CONVERGED * np.abs(adjoint).max():
                break
        courses = np.hstack([z[:-1, :nx] / size, adjoint[1:].reshape(len(rates), -1)])
        tail = np.abs(self.series @ courses)
        # What is not finite is less than nothing.
        resolved = tail[-2:] <= np.maximum(RESOLVED * tail.max(axis=0), ROUNDING * tail.max())
        return (z, slopes, adjoint) if resolved.all() else None


def _cleaned(slopes: Floats, moves: Floats) -> Floats:
    """Return the effects of `moves`, 0 where all terms of one cancel."""
    effects, terms = slopes @ moves, np.abs(slopes) @ np.abs(moves)
    return np.where(np.abs(effects) > NONE * terms, effects, 0.0)


def _preference(phase: Phase, finals: Order, effects: Floats) -> Floats:
    """Return factors near 1 that decide between conditions that follow from one another alike.

    Among the entries of a vector the one that moves more is imposed, of several states the one that
    was declared later; without them rounding would decide.
    """
    moved = np.linalg.norm(effects[: len(finals)], axis=1)
    moved *= phase.stacked("states", "scale")[finals]
    whose = [phase.state_names[k].partition("[")[0] for k in finals]
    largest = [max(m for m, own in zip(moved, whose, strict=True) if own == one) for one in whose]
    factors: Floats = 1.0 + 1e-6 * np.arange(float(len(effects)))
    share = np.divide(moved, largest, out=np.ones(len(finals)), where=np.array(largest) > 0.0)
    factors[: len(finals)] *= share**0.01
    return factors


def _rank(effects: Floats, factors: Floats | float = 1.0) -> tuple[int, Order]:
    """Return the rank of the rows, each in terms of its own size, and their order: independent first."""
    table = effects.copy()
    if not table.size:
        return 0, list(range(len(table)))
    for _ in range(3):
        for axis in (0, 1):
            size = np.abs(table).max(axis=axis, keepdims=True, initial=0.0)
            table /= np.where(size > 0.0, size, 1.0)
    size = np.linalg.norm(table, axis=1, keepdims=True)
    table /= np.where(size > 0.0, size, 1.0)
    _, triangle, order = scipy.linalg.qr((table.T * factors), mode="economic", pivoting=True)
    return int((np.abs(np.diag(triangle)) > NONE).sum()), order.tolist()


def drop_dependent(
    assembly: Assembly, program: NonlinearProgram, found: tuple[Dependence, ...]
) -> NonlinearProgram:
    """Return `program` without the equations that follow from others: free where they were imposed."""
    lower, upper = program.column_lower.copy(), program.column_upper.copy()
    row_lower, row_upper = program.row_lower.copy(), program.row_upper.copy()
    for one in found:
        places = assembly.layout.phases[one.phase]
        states = np.array(one.finals, np.int64)
        columns = places.state_columns[states, -1]
        lower[columns] = places.phase.stacked("states", "lower")[states]
        upper[columns] = places.phase.stacked("states", "upper")[states]
        first = assembly.row_starts[one.phase] + places.nx * places.defects
        paths = np.array(one.paths, np.int64)[:, None] * places.collocated
        rows = (first + paths + np.arange(places.collocated)).reshape(-1)
        begun = first + np.array(one.begun, np.int64) * places.collocated
        rows = np.setdiff1d(rows, begun)
        rows = np.append(rows, assembly.row_starts[-1] + np.array(one.boundaries, np.int64))
        row_lower[rows], row_upper[rows] = -np.inf, np.inf
    return replace(
        program, column_lower=lower, column_upper=upper, row_lower=row_lower, row_upper=row_upper
    )
