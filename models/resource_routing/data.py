"""Data of a route with resources: points, arcs, and the limits, gains and resets by kind."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..declaration import Listed
from ..fields import Array, Flag, Optional, Spec, Whole, declared, frozen, show, unwritable
from ..inputs import Field, FloatsOrNone, Names, Numbers
from ..labels import Ids
from ..model import Model
from ..specs import count_rows
from ..verification import ROUNDING
from .resource import Resource
from .route import Route

__all__ = ["RoutingData"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Words(Spec):
    """Field with one word per point, stored as a tuple."""

    def coerce(self, name: str, value: Any, sizes: dict[str, tuple[int, str]]) -> tuple[str, ...]:
        if isinstance(value, str) or not isinstance(value, Iterable):
            raise InvalidData(f"{name} must be a list of words, got {show(value)}", field=name)
        words = tuple(str(entry) if isinstance(entry, np.str_) else entry for entry in value)
        for row, word in enumerate(words):
            if not isinstance(word, str) or unwritable(word):
                raise InvalidData(f"{name}[{row}] must be a word, got {show(word)}", field=name)
        count_rows(name, len(words), "n", sizes)
        return words

    def encode(self, value: tuple[str, ...]) -> Any:
        return list(value)


@dataclass(frozen=True, eq=False, repr=False)
class RoutingData(Model[Route]):
    """Fields of :class:`~crosstrack.models.ResourceRouting`, documented there."""

    kinds: Field[Sequence[str], tuple[str, ...]] = declared(Words())
    resources: Field[Sequence[Resource | Mapping[str, Any]], tuple[Resource, ...]] = declared(
        Listed(Resource)
    )
    start: int = declared(Whole(0))
    end: int = declared(Whole(0))
    points: FloatsOrNone = declared(Optional(Array(("n", "axes"))), default=None)
    arcs: Field[Numbers | None, NDArray[np.int64] | None] = declared(
        Optional(Array(("m", 2), int, 0)), default=None
    )
    lengths: FloatsOrNone = declared(Optional(Array(("m",))), default=None)
    uses: FloatsOrNone = declared(Optional(Array(("m", "r"), lower=0)), default=None)
    revisits: bool = declared(Flag(), default=False)
    ids: Names = declared(Optional(Ids()), default=None)
    prizes: FloatsOrNone = declared(Optional(Array(("n",))), default=None, added=True)
    routes: int = declared(Whole(1, 1000), default=1, added=True)

    def check(self) -> None:
        """Raise for references to missing points or kinds, and for inconsistent fields."""
        n = len(self.kinds)
        for name in ("start", "end"):
            if getattr(self, name) >= n:
                raise InvalidData(
                    f"{name} must be < {n} (points), got {getattr(self, name)}", field=name
                )
        if self.start == self.end:
            raise InvalidData(f"end must differ from start = {self.start}", field="end")
        if self.arcs is None:
            for name in ("lengths", "uses"):
                if getattr(self, name) is not None:
                    raise InvalidData(f"{name} goes with arcs, which is missing", field=name)
            if self.points is None:
                raise InvalidData(
                    "points is missing: give points, or arcs and lengths", field="points"
                )
        else:
            self._check_arcs(self.arcs)
        if self.uses is not None and self.uses.shape[1] != len(self.resources):
            raise InvalidData(
                f"uses has {self.uses.shape[1]} columns, but there are {len(self.resources)} resources",
                field="uses",
            )
        names: dict[str, int] = {}
        present = set(self.kinds)
        for k, resource in enumerate(self.resources):
            if resource.name in names:
                raise InvalidData(
                    f"resources[{k}].name is {resource.name!r}, as is resources[{names[resource.name]}].name",
                    field="resources",
                )
            names[resource.name] = k
            for table in ("limits", "gains", "resets", "floors", "lower_limits"):
                for word, _ in getattr(resource, table):
                    if word not in present:
                        raise InvalidData(
                            f"resources[{k}].{table}: no point is of kind {word!r}; kinds: "
                            f"{', '.join(self.words)}",
                            field="resources",
                        )

        self._check_signs()

    def _check_signs(self) -> None:
        """Raise if levels could decrease along an arc, or a cycle could be repeated at a profit."""
        least = 0.0 if self.lengths is None else float(self.lengths.min(initial=0.0))
        rated = next((entry.name for entry in self.resources if entry.rate > 0), None)
        if least < 0 and rated is not None:
            assert self.lengths is not None
            raise InvalidData(
                f"lengths[{int(self.lengths.argmin())}] must be >= 0, as resource {rated!r} has a rate, got "
                f"{least:g}; give uses, or prizes of points",
                field="lengths",
            )
        if self.revisits and (
            least < 0 or (self.prizes is not None and self.prizes.max(initial=0) > 0)
        ):
            raise InvalidData(
                "revisits must be False with prizes or negative lengths, which a walk could collect again",
                field="revisits",
            )

    @cached_property
    def has_prizes(self) -> bool:
        """Whether an arc less the prize of its head may have a negative length."""
        least = 0.0 if self.lengths is None else float(self.lengths.min(initial=0.0))
        return least < 0 or (self.prizes is not None and bool((self.prizes > 0).any()))

    @cached_property
    def waits(self) -> bool:
        """Whether a resource has floors or lower limits."""
        return any(entry.floors or entry.lower_limits for entry in self.resources)

    def _check_arcs(self, arcs: NDArray[np.int64]) -> None:
        n = len(self.kinds)
        if self.lengths is None and self.points is None:
            raise InvalidData(
                "lengths is missing: give points, or arcs and lengths", field="lengths"
            )
        bad = np.argwhere(arcs >= n)
        if bad.size:
            row, column = bad[0].tolist()
            raise InvalidData(
                f"arcs[{row}, {column}] must be < {n} (points), got {arcs[row, column]}",
                field="arcs",
            )
        loops = np.flatnonzero(arcs[:, 0] == arcs[:, 1])
        if loops.size:
            raise InvalidData(
                f"arcs[{loops[0]}] joins point {arcs[loops[0], 0]} to itself", field="arcs"
            )
        keys, first = np.unique(arcs[:, 0] * n + arcs[:, 1], return_index=True)
        if keys.size < len(arcs):
            duplicate = np.setdiff1d(np.arange(len(arcs)), first)[0]
            raise InvalidData(
                f"arcs[{duplicate}] = {arcs[duplicate].tolist()} is there twice", field="arcs"
            )

    @cached_property
    def words(self) -> tuple[str, ...]:
        """Distinct kinds, in the order of their first points."""
        return tuple(dict.fromkeys(self.kinds))

    @cached_property
    def codes(self) -> NDArray[np.int64]:
        """Kind of each point as an index into :attr:`words`, shape (n,)."""
        place = {word: k for k, word in enumerate(self.words)}
        return frozen(np.array([place[word] for word in self.kinds], np.int64))

    @cached_property
    def arc_index(self) -> dict[tuple[int, int], int]:
        """Row of each listed arc in :attr:`arcs`, by its tail and head."""
        arcs = [] if self.arcs is None else self.arcs.tolist()
        return {(i, j): k for k, (i, j) in enumerate(arcs)}

    def table(self, name: str, default: float) -> Floats:
        """Return ``"limits"``, ``"gains"`` or ``"resets"`` as an array, shape (kinds, resources).

        Missing entries have the value `default`.
        """
        values = np.full((len(self.words), len(self.resources)), default)
        place = {word: k for k, word in enumerate(self.words)}
        for column, resource in enumerate(self.resources):
            for word, value in getattr(resource, name):
                values[place[word], column] = value
        return frozen(values)

    @cached_property
    def limits(self) -> Floats:
        """Limit of each resource on arrival, shape (kinds, resources); inf without a limit."""
        return self.table("limits", np.inf)

    @cached_property
    def rounded_limits(self) -> Floats:
        """:attr:`limits` plus the rounding tolerance, as used by searches."""
        return frozen(self.limits + ROUNDING * self.limits)

    @cached_property
    def gains(self) -> Floats:
        """Gain of each resource on arrival, shape (kinds, resources)."""
        return self.table("gains", 0.0)

    @cached_property
    def resets(self) -> Floats:
        """Largest level of each resource after the reset, shape (kinds, resources); inf without one."""
        return self.table("resets", np.inf)

    @cached_property
    def floors(self) -> Floats:
        """Level to which waiting raises each resource, shape (kinds, resources); 0 without one."""
        return self.table("floors", 0.0)

    @cached_property
    def lower_limits(self) -> Floats:
        """Least level of each resource on arrival, shape (kinds, resources); 0 without one."""
        return self.table("lower_limits", 0.0)

    @cached_property
    def rates(self) -> Floats:
        """Use of each resource per unit of length, shape (r,)."""
        return frozen(np.array([resource.rate for resource in self.resources]))

    @cached_property
    def initial(self) -> Floats:
        """Level of each resource at the start, shape (r,)."""
        return frozen(np.array([resource.initial for resource in self.resources]))

    def label(self, point: int) -> str:
        """Return the name of `point`."""
        return str(point if self.ids is None else self.ids[point])
