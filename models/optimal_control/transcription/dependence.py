"""Detection of equations that follow from one another, and their removal from the program.

If the dynamics conserve a quantity, such as the length of a quaternion, conditions at the end follow
from one another, and the program's equations are dependent. The equations of motion are eliminated
along a short random motion: the adjoint equations give the effects of controls, initial values, times
and parameters on the conditions, and a pivoted QR decomposition gives their rank. A reachable change
is reachable within a short time. A rank deficiency counts only if all random motions have it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy.linalg
from numpy.polynomial import legendre
from numpy.typing import NDArray

from ...programs.nonlinear import NonlinearProgram
from ..definition import Definition, Phase
from .assembly import Assembly, Twice, functions_of

__all__ = ["Dependence", "dependences", "drop_dependent"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Order = list[int]

#: Largest effect, relative to its terms or to the other rows, that is treated as 0; rounding is less.
NONE = 1e-10
#: Relative change of a converged motion, and share of the last coefficients of a resolved series.
CONVERGED, RESOLVED = 1e-13, 1e-10
ROUNDING = 1e-14
#: Ratio of the durations of successive random motions.
LONGER = 64.0
#: Number of random motions, of halvings of a duration, of Picard steps, and smallest number of nodes.
MOTIONS, HALVINGS, STEPS, NODES = 3, 40, 40, 24


@dataclass(frozen=True)
class Dependence:
    """Conditions of one phase that follow from others.

    `finals` are states with implied final values, `boundaries` implied entries of boundary constraints, `paths`
    implied path equations, and `begun` those that hold throughout if they hold at the start, which is free.
    """

    phase: int
    finals: tuple[int, ...]
    boundaries: tuple[int, ...]
    paths: tuple[int, ...]
    begun: tuple[int, ...] = ()

    def names(self, definition: Definition) -> list[str]:
        """Return the names of the implied equations for messages."""
        phase = definition.phases[self.phase]
        of = f" of phase {phase.name!r}" if len(definition.phases) > 1 else ""
        result = [f"final value of {phase.state_names[k]!r}{of}" for k in self.finals]
        for what, places, all_of in (
            ("boundary constraint", self.boundaries, definition.boundaries),
            (f"path constraint{of}", self.paths, phase.paths),
        ):
            names = [item.name for item in all_of for _ in range(item.size)]
            result += dict.fromkeys(f"{what} {names[k]!r}" for k in places)
        return result


@lru_cache(maxsize=64)
def dependences(definition: Definition) -> tuple[Dependence, ...]:
    """Return the dependences of all phases that have some; computed once per definition."""
    with np.errstate(all="ignore"):  # after an overflow, a shorter motion is tried
        results = [_examine(definition, k) for k in range(len(definition.phases))]
    return tuple(result for result in results if result is not None)


def _examine(definition: Definition, number: int) -> Dependence | None:
    phase = definition.phases[number]
    finals = np.flatnonzero(np.equal(*phase.bounds("states", "final"))).tolist()
    paths = np.flatnonzero(np.equal(*phase.bounds("paths"))).tolist()
    # Boundary constraints of this phase alone: links between phases depend on both motions.
    begin = sum(item.end_size for item in definition.phases[:number])
    rows, columns = map(np.array, definition.endpoint.jac_sparsity(1, 0).get_triplet())
    inside = (begin <= columns) & (columns < begin + phase.end_size)
    inside &= ~definition.interior[columns.astype(int)]
    equal = np.flatnonzero(np.equal(*definition.bounds("boundaries")))
    boundaries = [int(k) for k in equal if (rows == k).any() and inside[rows == k].all()]
    count, rank, order = len(finals) + len(boundaries), -1, Order()
    implied_paths, implied_later = set(paths), set[int]()
    if not count and not paths:
        return None
    for seed in range(MOTIONS):
        effects = _effects(definition, number, finals, boundaries, paths, seed)
        if effects is None:
            continue
        ranking = _rank(effects[0])
        rank, order = ranking if ranking[0] > rank else (rank, order)
        ranking = _rank(effects[1])
        implied_paths &= {paths[k] for k in ranking[1][ranking[0] :]}
        implied_later |= {paths[k] for k in np.flatnonzero(effects[2])}
        if rank == count and not implied_paths:
            return None
    if rank < 0:
        return None  # no motion could be computed, so nothing is known
    if rank < count:
        # The equations to drop are chosen at the end itself: an extremal entry there, such as the
        # largest entry of a quaternion, follows from the others but does not imply them.
        effects = _effects(definition, number, finals, boundaries, [], 0, arriving=True)
        if effects is not None:
            order = _rank(effects[0], _preference(phase, finals, effects[0]))[1]
    implied = sorted(order[rank:])
    return Dependence(
        number,
        tuple(finals[k] for k in implied if k < len(finals)),
        tuple(boundaries[k - len(finals)] for k in implied if k >= len(finals)),
        tuple(sorted(implied_paths)),
        tuple(sorted(implied_paths & implied_later)),
    )


def _effects(
    definition: Definition, number: int, finals: Order, boundaries: Order, paths: Order,
    seed: int, *, arriving: bool = False,
) -> tuple[Floats, Floats, Bools] | None:  # fmt: skip
    """Return the effects on the end of a random motion; None if no motion can be computed.

    The effects are matrices with one row per final value and boundary constraint, and per path expression. Their
    columns are changes of a control at a node, a free initial value (not for paths), a time or a parameter,
    relative to their sizes. The third result marks path expressions that only initial values change. The motion
    starts at the start of the phase or, if `arriving`, ends at its end.
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
    # If the time is too short for the linearised motion to be informative, a longer one follows.
    shares = LONGER**seed * 0.5 ** np.arange(HALVINGS)
    motion_result = next(filter(None, (motion.fly(item, arriving) for item in shares)), None)
    if motion_result is None:
        return None
    z, slopes, adjoint = motion_result
    # Changes: controls at each node and at the end, initial values, times, parameters.
    control_slopes, common = slopes[:-1, :nz, nx : nx + nu], slopes[:-1, :nz, nx + nu :]
    common_effects = np.tensordot(motion.integral[-1], adjoint[1:] @ common, 1)
    moves = np.hstack(
        [*(adjoint[1:] @ control_slopes), np.zeros((nz, nu)), adjoint[0, :, :nx], common_effects]
    )
    # ... and of the final states and integrals, the final controls, initial values, times, parameters.
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
    # The ends of all phases, of which only those of this one matter, and the parameters.
    ends = np.zeros(definition.endpoint.size1_in(0) + p.size)
    begin = sum(item.end_size for item in definition.phases[:number])
    places = begin + np.flatnonzero(~definition.interior[begin : begin + phase.end_size])
    places = np.append(places, np.arange(ends.size - p.size, ends.size))
    start = z[-1, :nx] if arriving else anchor
    ends[places] = np.concatenate([times, start, z[-1], p])
    twice = functions.endpoint
    jacobian = np.zeros((twice.entries, ends.size))
    jacobian[twice.jacobian.get_triplet()] = np.array(twice.first(ends)).reshape(-1)
    columns = np.concatenate([rest[:2], x0, np.arange(nz), rest[2:]])
    size_z = np.append(size_x, np.ones(nz - nx))
    scale = np.concatenate([sizes[nx + nu : nx + nu + 2], size_x, size_z, size_p])
    conditions[len(finals) :, columns] = jacobian[1:][boundaries][:, places] * scale
    path_slopes = np.zeros((len(paths), len(moves)))
    path_slopes[:, np.concatenate([x, nz + np.arange(nu), rest])] = slopes[-1, nz:][paths]
    if not (np.isfinite(conditions).all() and np.isfinite(path_slopes).all()):
        return None
    later = _clean(path_slopes, moves)
    begun: Bools = np.any(later[:, nu * (nodes + 1) + x], axis=1)
    later[:, nu * (nodes + 1) + x] = 0.0
    begun &= ~np.any(later, axis=1)
    return _clean(conditions, moves), later, begun


class _Motion:
    """Equations of motion of one phase, on Gauss points and the end."""

    def __init__(
        self, twice: Twice, points: Floats, anchor: Floats, others: Floats, sizes: Floats, nz: int
    ) -> None:
        self.value, self.first = (
            function.map(points.size) for function in (twice.value, twice.first)
        )
        self.shape = points.size, twice.entries, sizes.size
        self.at, self.points = twice.jacobian.get_triplet(), points
        self.anchor, self.others, self.sizes, self.nz = anchor, others, sizes, nz
        count = points.size - 1
        self.series = np.linalg.inv(legendre.legvander(points[:-1], count - 1))
        #: Half the integrals from -1 to the points, of values at the Gauss points.
        self.integral = (
            0.5 * legendre.legvander(points, count) @ legendre.legint(self.series, lbnd=-1)
        )

    def fly(self, share: float, arriving: bool) -> tuple[Floats, Floats, Floats] | None:
        """Return the motion over a share of the time; None if no series of this order resolves it.

        The results are states and integrals, scaled derivatives of all node functions, and the effect on
        the end of a change at the start and at each Gauss point.
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
        slopes[:, rows, columns] = np.array(self.first(given, place)).reshape(len(rows), -1).T
        slopes *= self.sizes
        slopes[:, :nx] /= size[:, None]
        rates = slopes[:-1, :nz, :nx]
        ahead = whole - np.vstack([np.zeros_like(whole), self.integral[:-1]])
        adjoint = np.tile(np.eye(nz), (ahead.shape[0], 1, 1))
        for k in range(STEPS + nz):  # small effects along a chain of states need as many steps
            last, adjoint = adjoint, np.tile(np.eye(nz), (ahead.shape[0], 1, 1))
            adjoint[:, :, :nx] += np.tensordot(ahead, last[1:] @ rates, 1)
            if k >= nz and not np.abs(adjoint - last).max() > CONVERGED * np.abs(adjoint).max():
                break
        courses = np.hstack([z[:-1, :nx] / size, adjoint[1:].reshape(len(rates), -1)])
        tail = np.abs(self.series @ courses)
        # A comparison with NaN is False, so non-finite series are unresolved.
        resolved = tail[-2:] <= np.maximum(RESOLVED * tail.max(axis=0), ROUNDING * tail.max())
        return (z, slopes, adjoint) if resolved.all() else None


def _clean(slopes: Floats, moves: Floats) -> Floats:
    """Return the effects of `moves`, with 0 if all terms of an effect cancel."""
    effects, terms = slopes @ moves, np.abs(slopes) @ np.abs(moves)
    return np.where(np.abs(effects) > NONE * terms, effects, 0.0)


def _preference(phase: Phase, finals: Order, effects: Floats) -> Floats:
    """Return factors near 1 that order conditions which imply one another.

    Among the entries of a vector, the entry that moves most is imposed. Among several states, the
    one declared last is imposed. Without the factors, rounding would decide.
    """
    moved = np.linalg.norm(effects[: len(finals)], axis=1)
    moved *= phase.stacked("states", "scale")[finals]
    whose = [phase.state_names[k].partition("[")[0] for k in finals]
    largest = [
        max(m for m, move in zip(moved, whose, strict=True) if move == name) for name in whose
    ]
    factors: Floats = 1.0 + 1e-6 * np.arange(float(len(effects)))
    share = np.divide(moved, largest, out=np.ones(len(finals)), where=np.array(largest) > 0.0)
    factors[: len(finals)] *= share**0.01
    return factors


def _rank(effects: Floats, factors: Floats | float = 1.0) -> tuple[int, Order]:
    """Return the rank of the scaled rows, and their order with independent ones first."""
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
    assembly: Assembly, program: NonlinearProgram, implied: tuple[Dependence, ...]
) -> NonlinearProgram:
    """Return `program` without the implied equations, whose bounds become infinite."""
    lower, upper = program.column_lower.copy(), program.column_upper.copy()
    row_lower, row_upper = program.row_lower.copy(), program.row_upper.copy()
    for dependence in implied:
        layout = assembly.layout.phases[dependence.phase]
        states = np.array(dependence.finals, np.int64)
        columns = layout.state_columns[states, -1]
        lower[columns] = layout.phase.stacked("states", "lower")[states]
        upper[columns] = layout.phase.stacked("states", "upper")[states]
        first = assembly.row_starts[dependence.phase] + layout.nx * layout.defects
        paths = np.array(dependence.paths, np.int64)[:, None] * layout.collocated
        rows = (first + paths + np.arange(layout.collocated)).reshape(-1)
        begun = first + np.array(dependence.begun, np.int64) * layout.collocated
        rows = np.setdiff1d(rows, begun)
        rows = np.append(rows, assembly.row_starts[-1] + np.array(dependence.boundaries, np.int64))
        row_lower[rows], row_upper[rows] = -np.inf, np.inf
    return replace(
        program, column_lower=lower, column_upper=upper, row_lower=row_lower, row_upper=row_upper
    )
