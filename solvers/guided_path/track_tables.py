"""Tables of a guided tour with optional fields: places, distances, chains and what they require."""

from __future__ import annotations

import itertools
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.guided_path.model import GuidedPathTour
from ...models.guided_path.schedule import time_scales
from ...models.guided_path.track import Track

__all__ = ["ROUNDING", "TrackTables", "chains_of"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Violation that rounding explains, relative to the largest load or to the scale of a time.
ROUNDING = 1e-9


def chains_of(model: GuidedPathTour) -> tuple[tuple[int, ...], ...]:
    """Return chains that contain every customer once; with several vehicles one vehicle serves each."""
    if model.vehicles is None:
        return model.cover
    given = [tuple(c for c in chain if c) for chain in model.chains]
    alone = set(range(1, model.size)).difference(itertools.chain.from_iterable(given))
    return (*(chain for chain in given if chain), *((c,) for c in sorted(alone)))


class TrackTables:
    """Arrays that the search reads, for chains that contain every customer once.

    Row ``start[c] + i`` of a table by rows belongs to chain c with i customers served.

    Attributes
    ----------
    chains : tuple of tuples of int
        Chains of the relation; with several vehicles those of the model, and single customers.
    fleet : int
        Number of vehicles.
    homes : ndarray, shape (m,)
        Start of each vehicle as a place.
    goal : int
        Place of the end; -1 if it is free, or with several vehicles.
    ways : ndarray, shape (places, places)
        Distances in m.
    same : ndarray, shape (places,)
        First place at the same position.
    following : ndarray, shape (rows,)
        Next customer of the chain, -1 after the last.
    """

    def __init__(self, model: GuidedPathTour) -> None:
        self.model = model
        starts = model.vehicles
        self.fleet = 1 if starts is None else len(starts)
        self.free = model.end == "free"
        extra = [] if starts is None else starts.tolist()
        extra += [model.end] if isinstance(model.end, float) else []
        self.homes = np.zeros(self.fleet, np.int64)
        self.goal = -1 if self.free or self.fleet > 1 else model.size * bool(extra)
        self.chains = chains_of(model)
        if starts is not None:
            self.homes = model.size + np.arange(self.fleet)
        self.places = np.concatenate([model.coordinates, extra])
        self.start = np.cumsum([0, *(len(chain) + 1 for chain in self.chains)])
        self.following = np.array([c for chain in self.chains for c in (*chain, -1)])
        members = [c for chain in self.chains for c in chain]
        heads = np.cumsum([0, *map(len, self.chains)])[:-1]
        precede = model.closure[np.ix_(members, members)].T
        self.need = np.zeros((model.size, len(self.chains)), np.int64)
        self.need[members] = np.add.reduceat(precede, heads, axis=1, dtype=np.int64)
        for c, chain in enumerate(self.chains):  # the order within the chain needs no test
            self.need[list(chain), c] = 0
        #: Chains with customers that require other chains, and these chains.
        self.requiring = [
            (c, needed)
            for c, chain in enumerate(self.chains)
            if len(needed := np.flatnonzero(self.need[list(chain)].any(axis=0)))
        ]
        self.same = np.argmin(self.ways, axis=1)
        #: Position of each stop, and of the home of each vehicle in the last column, shape (m, n + 2).
        self.goals = np.column_stack(
            [np.tile(model.coordinates, (self.fleet, 1)), self.places[self.homes]]
        )

    @cached_property
    def sides(self) -> tuple[NDArray[np.bool_], Floats] | None:
        """Side of each place for each piece of the track that separates it, and the lengths; None on a loop."""
        track, x = self.model.track, self.places
        if not isinstance(track, Track):
            marks = np.unique(x)
            return x[:, None] >= marks[1:], np.diff(marks)
        if track.loop:
            return None
        sides, lengths = [], []
        at = np.array(track.at)
        ends = np.array([edge[:2] for edge in track.edges])[at]
        for k, (a, b, length) in enumerate(track.edges):
            # Nodes nearer to b than to a are behind the edge.
            behind = track.nodes[b] < track.nodes[a]
            behind[[a, b]] = False, True
            marks = np.unique([0.0, length, *x[at == k]])
            inside = np.where(at[:, None] == k, x[:, None] >= marks[1:], behind[ends[:, :1]])
            sides.append(inside)
            lengths.append(np.diff(marks))
        return np.concatenate(sides, axis=1), np.concatenate(lengths)

    @cached_property
    def ways(self) -> Floats:
        """Distances between all places in m."""
        track, x, sides = self.model.track, self.places, self.sides
        shift: Floats = np.abs(x[:, None] - x)
        if not isinstance(track, Track):
            return shift
        if sides is None:
            return np.minimum(shift, track.loop - shift)
        across = sides[0].astype(float)
        ways: Floats = (across * sides[1]) @ (1.0 - across).T
        return ways + ways.T

    @cached_property
    def rest(self) -> tuple[Ints, Any]:
        """First place of the rest of each chain, -1 if it is empty; crossings of each piece on the rest.

        On a loop the second array contains lengths. With one vehicle the rest includes the way to the end.
        """
        firsts, rows = [], []
        sides = self.sides
        for chain in self.chains:
            stops = self._stops(chain)
            if sides is None:
                steps: Any = self.ways[stops[:-1], stops[1:]]
            else:
                steps = sides[0][stops[:-1]] != sides[0][stops[1:]]
            rows.append(_sums(steps, len(chain) + 1).astype(float if sides is None else np.int16))
            firsts += [*stops, *[-1] * (len(chain) + 1 - len(stops))]
        return np.array(firsts), np.concatenate(rows)

    def _stops(self, chain: tuple[int, ...]) -> list[int]:
        return [*chain, self.goal] if self.goal >= 0 else [*chain]

    @cached_property
    def carried(self) -> tuple[Floats, tuple[Floats, Floats], float] | None:
        """Load per row, load that the rest of each chain carries over each piece to both sides, and its limit.

        The load of a chain is what its served customers contribute, if positive. At each crossing, the loads
        of all chains sum to at most the capacity minus the load at the start, plus all negative
        contributions. None without a capacity, and on loops.
        """
        model, sides = self.model, self.sides
        if model.loads is None or model.capacity is None or sides is None:
            return None
        loads, forth, back, limit = [], [], [], model.capacity - float(model.loads[0])
        limit += ROUNDING * float(np.abs(model.loads).max())
        for chain in self.chains:
            sums = np.cumsum([0.0, *model.loads[list(chain)]])
            limit += max(-float(sums.min()), 0.0)
            loads.append(np.maximum(sums, 0.0))
            ahead = sides[0][self._stops(chain)]
            weights = loads[-1][1 : len(ahead), None]
            forth.append(_sums(weights * (~ahead[:-1] & ahead[1:]), len(sums)))
            back.append(_sums(weights * (ahead[:-1] & ~ahead[1:]), len(sums)))
        tables = np.concatenate(forth), np.concatenate(back)
        return (np.concatenate(loads), tables, limit) if limit > 0 else None

    @cached_property
    def limits(self) -> Floats:
        """Latest begin at each customer, and of the end in entry 0, with a margin for rounding, in s."""
        assert self.model.windows is not None
        scales, noise = time_scales(self.model.windows)
        return self.model.windows[:, 1] + (ROUNDING * scales + noise)

    @cached_property
    def latest(self) -> Floats:
        """Latest begin at each customer so that its chain and the end can follow in time, in s."""
        service, speed, latest = self.model.service, self.model.speed, self.limits.copy()
        assert speed is not None
        takes = np.zeros(len(latest)) if service is None else service
        for chain in self.chains:
            after = self.limits[0] - (
                self.ways[chain[-1], self.goal] / speed if self.goal >= 0 else 0
            )
            for c, follower in zip(chain[::-1], (None, *chain[:0:-1]), strict=True):
                if follower is not None:
                    after = latest[follower] - self.ways[c, follower] / speed
                latest[c] = min(latest[c], after - takes[c])
        return latest


def _sums(steps: Any, rows: int) -> Any:
    """Return the sum of each step and all later ones, with zeros up to the number of rows."""
    sums = np.cumsum(steps[::-1], axis=0)[::-1]
    return np.concatenate([sums, np.zeros((rows - len(sums), *sums.shape[1:]), sums.dtype)])
