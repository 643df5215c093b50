"""Mixed-integer program of a tour as alternating sweeps to the right and to the left.

The tour is a sequence of sweeps 1 … R, odd ones to the right and even ones to the left. The first
sweep may be empty, and so may all sweeps after the last one needed. P_gr = 1 if the turning point
after sweep r is right of gap g, so a sweep crosses the gaps for which P changes. Z_cr = 1 if
customer c is served by the end of sweep r. The sweep must have passed its place, and its
predecessors must be served before; in the same sweep only if they come earlier on its way. The
length is the sum of the gaps crossed, and each gap is crossed at least as often as a chain of the
relation requires.

Customers that every tour passes in time are omitted (:mod:`.walks`), as they do not affect the
length.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, UnsupportedFormulation, UnsupportedOption
from ..fields import Array, show
from ..programs.builder import ProgramBuilder
from ..programs.linear import MixedIntegerProgram
from .data import GuidedPathData
from .kept import KeptFormulation
from .plan import GuidedPathPlan
from .turns import enough_sweeps, some_length
from .walks import served

__all__ = ["SweepsFormulation"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Maximum number of columns.
_MOST = 500_000
#: Number of sweeps that is enough for each model, which all formulations of a run share.
_ENOUGH: WeakKeyDictionary[GuidedPathData, int] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class SweepsFormulation(KeptFormulation):
    """Mixed-integer program of sweeps, with turning points and served customers as 0-1 columns.

    Parameters
    ----------
    model : GuidedPathTour
        The model.
    sweeps : int, optional
        Maximum number of sweeps of a tour, including an empty first sweep to the right. Default: a
        number that a shortest tour does not exceed (:attr:`enough`). With fewer sweeps, the optimum
        holds for tours with this many sweeps only, and provides no bound for others.

    Raises
    ------
    UnsupportedFormulation
        The program would be too large.
    UnsupportedOption
        `sweeps` is not a positive integer.
    """

    sweeps: int | None = None

    name: ClassVar[str] = "sweeps"
    summary: ClassVar[str] = "turning points of sweeps, and who is served by each; 0-1 columns only"

    def __post_init__(self) -> None:
        given = self.sweeps
        if given is not None:
            if not isinstance(given, int) or isinstance(given, bool) or given < 1:
                raise UnsupportedOption(
                    f"formulation {self.name!r}: sweeps must be a whole number >= 1, got {show(given)}"
                )
            if given < self.enough:
                object.__setattr__(self, "relaxes", False)
        size = (self.count + 1) * (self._kept.size + self._gaps.lengths.size)
        if size > _MOST:
            raise UnsupportedFormulation(
                f"formulation {self.name!r} has at most {_MOST} columns, {self.count} sweeps "
                f"along {self._gaps.lengths.size} gaps take {size}"
            )

    @cached_property
    def enough(self) -> int:
        """Number of sweeps that a shortest tour does not exceed."""
        if self._kept not in _ENOUGH:
            _ENOUGH[self._kept] = enough_sweeps(self._gaps, some_length(self._gaps))
        return _ENOUGH[self._kept]

    @property
    def count(self) -> int:
        """Number of sweeps of the program."""
        return self.enough if self.sweeps is None else self.sweeps

    def build(self) -> MixedIntegerProgram:
        """Return the program described in the docstring of this module."""
        b, gaps = ProgramBuilder(), self._gaps
        last, size = self.count, gaps.lengths.size
        sides = np.where(np.arange(1, last + 1) % 2, 1, -1)
        home = (gaps.at[0] > np.arange(size)).astype(float)
        # The cost of P is signed by the side of the sweep. A turning point ends one sweep and
        # begins the next.
        counts = np.zeros(last + 1)
        counts[1:] += sides
        counts[:-1] -= sides
        fixed = np.isin(np.arange(last + 1), (0, last))[:, None]
        p = b.columns(
            "turning point right of the gap", (last + 1) * size, integral=True,
            lower=np.where(fixed, home, 0.0).ravel(), upper=np.where(fixed, home, 1.0).ravel(),
            cost=np.outer(counts, gaps.lengths).ravel(), template="sweep {0}, gap {1}",
            index=_index(range(last + 1), range(size)),
        ).reshape(last + 1, size)  # fmt: skip
        inner = p[1:-1]
        b.rows(
            "one turning point a sweep", inner[:, 1:].size,
            (_count(inner[:, 1:]), inner[:, 1:], 1.0), (_count(inner[:, 1:]), inner[:, :-1], -1.0),
            upper=0, template="sweep {0}, gap {1}", index=_index(range(1, last), range(1, size)),
        )  # fmt: skip
        b.rows(
            "each sweep to its side", p[1:].size, (_count(p[1:]), p[1:], sides[:, None]),
            (_count(p[1:]), p[:-1], -sides[:, None]), lower=0, template="sweep {0}, gap {1}",
            index=_index(range(1, last + 1), range(size)),
        )  # fmt: skip
        each = np.arange(size)[None, :]
        b.rows(
            "gap crossed as often as a chain asks", size, (each, p[1::2], 1.0),
            (each, p[:-1:2], -1.0), lower=gaps.crossings, template="gap {0}", index=each.ravel(),
        )  # fmt: skip
        self._service_rows(b, p, sides)
        return b.build(name=f"{self.model.name}:{self.name}" if self.model.name else self.name)

    def _service_rows(self, b: ProgramBuilder, p: Indices, sides: Indices) -> None:
        """Add the columns and rows that assign customers to sweeps."""
        kept, numbers = self._reduced
        at, size, last = self._gaps.at, p.shape[1], self.count
        customers = np.arange(1, kept.size)
        labels = np.array(numbers)[customers]
        index = _index(range(1, last + 1), labels)
        z = b.columns(
            "served", len(index), lower=(index[:, 0] == last).astype(float), upper=1, integral=True,
            template="sweep {0}, customer {1}", index=index,
        ).reshape(last, -1)  # fmt: skip
        b.rows(
            "served for good", z[1:].size, (_count(z[1:]), z[1:], 1.0),
            (_count(z[1:]), z[:-1], -1.0), lower=0, template="sweep {0}, customer {1}",
            index=index[customers.size :],
        )  # fmt: skip
        # Gap that a sweep crosses to reach a place. Customers at the start need no gap in the first
        # sweep.
        gap = np.where(sides[:, None] > 0, at[customers] - 1, at[customers])
        reached = (gap >= 0) & (gap < size)
        sweep, rows = np.nonzero(reached)[0], _count(z)
        free = np.zeros(z.shape)
        free[0] = at[customers] == at[0]
        row, crossed = rows[reached], gap[reached]
        b.rows(
            "served where the sweep passes", z.size, (rows, z, 1.0), (rows[1:], z[:-1], -1.0),
            (row, p[sweep + 1, crossed], -sides[sweep]), (row, p[sweep, crossed], sides[sweep]),
            upper=free.ravel(), template="sweep {0}, customer {1}", index=index,
        )  # fmt: skip
        pairs = kept.links
        entry, other = pairs.T
        # True if the predecessor also comes first on the way of the sweep.
        same = sides[:, None] * (at[other] - at[entry]) >= 0
        rows = _count(same)
        earlier = np.broadcast_to(np.arange(last)[:, None], same.shape) - ~same
        known = earlier >= 0
        b.rows(
            "precedence", same.size, (rows, z[:, other - 1], 1.0),
            (rows[known], z[earlier, entry - 1][known], -1.0), upper=0,
            template="sweep {0}, customer {1} before {2}",
            index=np.column_stack(
                [np.repeat(np.arange(1, last + 1), len(pairs)),
                 np.tile(np.array(numbers)[pairs], (last, 1))]
            ),
        )  # fmt: skip

    # -- plans -----------------------------------------------------------------------------------

    def _walk(self, plan: GuidedPathPlan) -> tuple[list[int], list[int]]:
        """Return the ends of the sweeps of `plan`, the start first, and the sweep of each customer.

        The walk visits only the relevant customers.
        """
        order = self._order(plan)
        at = self._gaps.at.tolist()
        ends, sweep = [at[0], at[0]], [0] * len(at)
        for c in (*order, 0):
            there = at[c]
            side = 1 if len(ends) % 2 == 0 else -1
            if side * (there - ends[-1]) < 0:
                ends.append(there)
            ends[-1] = there
            sweep[c] = len(ends) - 1
        return ends, sweep[1:]

    def bounded(self, objective: float) -> SweepsFormulation:
        """Return the formulation with the fewest sweeps sufficient for a shortest tour.

        Parameters
        ----------
        objective : float
            Length of a known tour, in m.

        Returns
        -------
        SweepsFormulation
            The formulation, or this one if it has no more sweeps.
        """
        enough = enough_sweeps(self._gaps, objective)
        if self.sweeps is not None or enough >= self.enough:
            return self
        formulation = copy(self)
        formulation.__dict__.pop("program", None)
        formulation.__dict__["enough"] = enough
        return formulation

    def fitted(self, plan: GuidedPathPlan) -> SweepsFormulation:
        """Return the formulation with at least as many sweeps as `plan` has."""
        ends, _ = self._walk(plan)
        return self if len(ends) <= self.count + 1 else replace(self, sweeps=len(ends) - 1)

    def encode(self, plan: GuidedPathPlan) -> Floats:
        """Return the columns of the walk through the relevant customers, in the order of `plan`.

        Parameters
        ----------
        plan : GuidedPathPlan
            The plan.

        Returns
        -------
        ndarray, shape (columns,)
            The columns.

        Raises
        ------
        InvalidData
            The walk has more sweeps than the program; use :meth:`fitted` first.
        """
        ends, sweep = self._walk(plan)
        limit = self.count + 1
        if len(ends) > limit:
            raise InvalidData(
                f"order must make at most {self.count} sweeps, got {len(ends) - 1}",
                field="order",
            )
        ends += [ends[-1]] * (limit - len(ends))
        right = np.array(ends)[:, None] > np.arange(self._gaps.lengths.size)
        done = np.arange(1, limit)[:, None] >= np.array(sweep)
        return np.concatenate([right.ravel(), done.ravel()]).astype(float)

    def decode(self, point: Floats) -> GuidedPathPlan:
        """Return the service order along the sweeps; available customers are served on the way."""
        values = Array((self.program.size,)).coerce("point", point, {})
        numbers, at = self._numbers, self._gaps.at
        size = self._gaps.lengths.size
        right = values[: (self.count + 1) * size].reshape(self.count + 1, size)
        ends = np.rint(right).sum(axis=1)
        # Any customer at a place represents it.
        whose = dict(zip(at.tolist(), numbers, strict=True))
        try:
            stops = [whose[int(end)] for end in ends]
        except KeyError:
            raise InvalidData("point: a sweep ends beyond all places", field="point") from None
        return GuidedPathPlan(served(self.model, stops))

    def statistics(self, plan: GuidedPathPlan) -> dict[str, float | int | str]:
        """Return the number of sweeps of the program."""
        return {"sweeps": self.count}


def _count(like: NDArray[Any]) -> Indices:
    """Return the numbers 0, 1, … in the shape of `like`."""
    return np.arange(like.size).reshape(like.shape)


def _index(first: Any, second: Any) -> Indices:
    """Return all pairs of two ranges, the second one changing fastest, shape (pairs, 2)."""
    return np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)
