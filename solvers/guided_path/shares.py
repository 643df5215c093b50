"""Stronger bound on tours along a path: groups of chains, each with a share of every gap's length.

A tour of all chains serves each group. If the length of every gap is shared among the groups, the
sum of the shortest tours of the groups, each with its own lengths, is at most the length of the
shortest tour. The shares increase for a group whose tour crosses a gap more often than those of the
others: the Lagrangian decomposition of M. Guignard and S. Kim, "Lagrangean decomposition: a model
yielding stronger Lagrangean bounds", Mathematical Programming 39, 1987, with the step length of B.
T. Polyak, "Minimization of unsmooth functionals", USSR Computational Mathematics and Mathematical
Physics 9, 1969. The final tables bound every state, see :func:`.share_kernels.rest_of_shares`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .bound import Tables
from .share_kernels import Shares, fill_rests, walk_alone

__all__ = ["no_shares", "shares_of"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Between = Callable[[int, float], bool]

#: Upper limit on lengths in tables, so that their sums are below 2^31.
LONG = 1 << 29
#: Maximum number of chains of a group, of entries of its table, and of entries of all tables.
MOST, ENTRIES, ALL_ENTRIES = 6, 25_000_000, 45_000_000
#: The same limits of entries for wide groups, which bound only the start and share one table.
WIDE_ENTRIES, ALL_WIDE_ENTRIES = 110_000_000, 330_000_000
#: Maximum number of ascent steps; minimum number with the final groups; work limit of these steps.
FIRST, LEAST, WORK = 400, 2, 3e8
#: Maximum number of shares times steps, with the small groups: sorting them takes about 10 s.
SORTED = 1e8
#: Maximum number of shares.
MOST_SHARES = 4_000_000
#: Initial target for the relative increase of the bound, and number of steps without progress before it is
#: reduced, for small and for final groups.
AIM, PATIENCE = (0.1, 0.02), (12, 3)
#: Relative target at which the ascent ends. Stages before the last one of large models end earlier, with less patience.
END, EARLY_END, HASTY = 1e-4, 2e-3, 5


def no_shares(tables: Tables) -> Shares:
    """Return empty shares, whose bound is 0."""
    return Shares(
        np.zeros((1, 2), np.int64), np.zeros((0, 2), np.int64),
        np.zeros((0, tables.at.size), np.int64), np.zeros(0, np.int32), 1, 1,
    )  # fmt: skip


def shares_of(
    tables: Tables, best: int, samples: Ints, flag: NDArray[np.int8], between: Between | None = None,
) -> Shares | None:  # fmt: skip
    """Return the groups with the greatest bound found; None if it was stopped before, or for too many shares.

    `tables`, `best`: tables of the model, and length of a tour, in units. `samples`, shape (m, chains + 1):
    states whose mean bound is maximised: counts and place of each. `between`: function ``(bound, work)`` called
    after each step with the mean bound so far, in units, and the number of table entries compared. The ascent
    ends if it returns True.
    """
    rows = [tables.at[tables.place[a:b]] for a, b in pairwise(tables.first)]
    alone = np.array([np.abs(np.diff(row)).sum() for row in rows])
    groups = _group_chains(np.diff(tables.first), alone, ENTRIES, ALL_ENTRIES)
    parts = [part for group in groups for part in np.array_split(group, max(len(group) // 2, 1))]
    if len(parts) * tables.length.size > MOST_SHARES:
        return None
    stages, large = [parts, groups], between is not None
    if large:
        stages.append(_group_chains(np.diff(tables.first), alone, WIDE_ENTRIES, ALL_WIDE_ENTRIES))
    wide = len(stages[-1]) < len(groups)
    lengths = np.tile(tables.length / len(parts), (len(parts), 1))
    shares, bound, former = None, 0.0, parts
    for stage, members in enumerate(stages):
        if stage > 0 and len(members) == len(former):
            continue
        lengths, former = _regroup(lengths, former, members), members
        ascent = _Ascent(tables, members, best, samples, flag, between, wide=stage == 2)
        kind = min(stage, 1)
        # After a few steps A* raises the bound faster; it does not use the wide groups.
        steps = WORK / ascent.work if stage == 1 else SORTED / max(lengths.size, 1)
        hasty = wide and stage < 2
        lengths = ascent.climb(
            lengths, int(np.clip(steps, LEAST, FIRST)), AIM[kind],
            min(PATIENCE[kind], HASTY) if hasty else PATIENCE[kind], EARLY_END if hasty else END,
        )  # fmt: skip
        if ascent.best >= bound and stage < 2:
            shares, bound = ascent.shares(), ascent.best
        if ascent.over:
            break
    return shares


def _regroup(lengths: Floats, parts: list[Ints], groups: list[Ints]) -> Floats:
    """Return the shares of `groups`; each part divides its shares equally among its chains."""
    owner = np.empty(sum(map(len, parts)), np.int64)
    for i, part in enumerate(parts):
        owner[part] = i
    sizes = np.array(list(map(len, parts)))
    return np.array([(lengths / sizes[:, None])[owner[group]].sum(axis=0) for group in groups])


def _group_chains(sizes: Ints, lengths: Ints, most: float, total: float) -> list[Ints]:
    """Return groups of chains as large as the table limits allow, the longest tours together.

    The longest chains in one group raise the bound by 1 to 3 % over mixed groups, for 10 chains of 100 and 20 of 50.
    """
    order = np.argsort(-lengths, kind="stable").tolist()
    limit = float(most)
    while True:
        groups: list[list[int]] = [[]]
        entries = [0.0]
        for k in order:
            grown = float(np.prod(sizes[[*groups[-1], k]] + 1.0)) * (len(groups[-1]) + 1)
            if groups[-1] and (grown > limit or len(groups[-1]) == MOST):
                groups.append([])
                entries.append(0.0)
                grown = 1.0 + sizes[k]
            groups[-1].append(k)
            entries[-1] = grown
        if sum(entries) <= total or len(groups) == sizes.size:
            return [np.array(group) for group in groups]
        limit /= 2


class _Ascent:
    """Subgradient ascent of the bound of some groups."""

    def __init__(
        self, tables: Tables, groups: list[Ints], best: int, samples: Ints, flag: NDArray[np.int8],
        between: Between | None, wide: bool,
    ) -> None:  # fmt: skip
        self.wide = wide
        self.tables, self.groups, self.flag, self.samples = tables, groups, flag, samples
        self.between, self.over = between, False
        self.sizes = [np.diff(tables.first)[group] for group in groups]
        self.ends = np.cumsum([0, *(int(np.prod(size + 1)) * size.size for size in self.sizes)])
        self.work = float(sum(np.diff(self.ends) * list(map(len, groups))))
        longest = int(np.diff(tables.first).max())
        self.places = []
        for group in groups:
            places = np.full((group.size + 1, longest + 1), tables.place[-1])
            for i, k in enumerate(group.tolist()):
                row = tables.place[tables.first[k] : tables.first[k + 1]]
                places[i, : row.size] = row
            self.places.append(places)
        self.times, self.part = max(best // LONG, 1), max(LONG // max(best, 1), 1)
        room = int(np.diff(self.ends).max()) if wide else int(self.ends[-1])
        self.rests = np.empty(room, np.int32)
        self.kept = self.rests if wide else self.rests.copy()
        self.best, self.weighted = -1.0, np.zeros((len(groups), tables.at.size), np.int64)

    def value(self, lengths: Floats) -> tuple[float, Floats]:
        """Return the mean bound of these shares, and the crossings of each gap by each group."""
        whole = np.floor(lengths * (self.part / self.times)).astype(np.int64)
        weighted = np.pad(np.cumsum(whole, axis=1), ((0, 0), (1, 0)))
        crossed = np.zeros(lengths.shape, np.int64)
        total, starts = 0, np.ascontiguousarray(self.samples[:, -1])
        for g, places in enumerate(self.places):
            begin = 0 if self.wide else self.ends[g]
            heads = weighted[g][places]
            rests = self.rests[begin : begin + self.ends[g + 1] - self.ends[g]]
            if not fill_rests(heads, self.sizes[g], rests, self.flag):
                return -1.0, lengths
            begun = np.ascontiguousarray(self.samples[:, self.groups[g]])
            total += walk_alone(
                heads, self.sizes[g], rests, places, begun, starts, weighted[g], crossed[g]
            )
        if total > self.best * len(starts):
            self.best, self.weighted = total / len(starts), weighted
            self.rests, self.kept = self.kept, self.rests
        return total / len(starts), crossed / len(starts)

    def climb(self, lengths: Floats, steps: int, hope: float, patience: int, end: float) -> Floats:
        """Return the shares with the greatest bound found in `steps` steps from `lengths`."""
        best_lengths, aim, stale = lengths, 0.0, 0
        before = np.zeros(lengths.shape)
        for step in range(steps):
            former = self.best
            value, crossed = self.value(lengths)
            if value < 0:
                self.over = True
                break
            if self.between is not None:
                bound = math.ceil(self.best * self.times / self.part)
                self.over = self.between(bound, self.work)
                if self.over:
                    break
            aim = aim or hope * value
            if value > former:
                best_lengths = lengths
            stale = 0 if value > former + 0.1 * aim else stale + 1
            if stale > patience:
                lengths, aim, stale = best_lengths, aim * 0.6, 0
            slope = crossed - crossed.mean(axis=0)
            before = slope if step == 0 else 0.5 * slope + 0.5 * before
            steep = float((before**2).sum())
            if steep == 0.0 or aim < end * self.best:
                break
            way = (self.best + aim - value) / steep * (self.times / self.part)
            lengths = _project(lengths + way * before, self.tables.length)
        return best_lengths

    def shares(self) -> Shares:
        """Return the shares with the greatest bound."""
        members = np.concatenate(self.groups)
        radix = np.concatenate([np.cumprod([1, *(size[:-1] + 1)]) for size in self.sizes])
        begins = np.cumsum([0, *map(len, self.groups)])
        return Shares(
            np.column_stack((begins, self.ends)), np.column_stack((members, radix)), self.weighted,
            self.kept, self.times, self.part,
        )  # fmt: skip


def _project(lengths: Floats, whole: Ints) -> Floats:
    """Return the nearest non-negative shares whose sum is the length of each gap.

    Source: M. Held, P. Wolfe and H. P. Crowder, "Validation of subgradient optimization",
    Mathematical Programming 6, 1974.
    """
    count = len(lengths)
    down = -np.sort(-lengths, axis=0)
    cut = (np.cumsum(down, axis=0) - whole) / np.arange(1, count + 1)[:, None]
    last = (down > cut).sum(axis=0).clip(1) - 1
    result: Floats = np.maximum(lengths - cut[last, np.arange(whole.size)], 0.0)
    return result
