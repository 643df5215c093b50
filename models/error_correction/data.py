"""Data of error-correction routing: points, thresholds, rates and suspect corrections."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import InitVar, dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData
from ..fields import Array, Flag, Optional, Real, Whole, declared, frozen, show
from ..grid_path.polygons import Polygon, Polygons
from ..inputs import Field, FloatArray, Names, Numbers
from ..labels import Ids
from ..model import Model
from ..resource_routing.route import Route
from ..verification import ROUNDING
from .no_fly import free_legs
from .points import END, KIND_WORDS, START, Kinds

__all__ = ["RoutingData"]


@dataclass(frozen=True, eq=False, repr=False)
class RoutingData(Model[Route]):
    """Fields of :class:`~crosstrack.models.ErrorCorrectionRouting`, documented there."""

    points: FloatArray = declared(Array(("n", 3), unit="m"))
    kinds: Field[Sequence[str] | NDArray[Any], NDArray[np.str_]] = declared(Kinds())
    alpha1: float = declared(Real(lower=0))
    alpha2: float = declared(Real(lower=0))
    beta1: float = declared(Real(lower=0))
    beta2: float = declared(Real(lower=0))
    theta: float = declared(Real(lower=0))
    horizontal_rate: float = declared(Real(lower=0), default=None)
    vertical_rate: float = declared(Real(lower=0), default=None)
    revisits: bool = declared(Flag(), default=False)
    ids: Names = declared(Optional(Ids()), default=None)
    suspect: Field[Numbers | None, NDArray[np.bool_] | None] = declared(
        Optional(Array(("n",), bool)), added=True, default=None
    )
    residual: float | None = declared(Optional(Real(lower=0)), added=True, default=None)
    success: float = declared(Real(lower=0, upper=1), added=True, default=0.0)
    corrections_limit: int | None = declared(Optional(Whole(0)), added=True, default=None)
    no_fly: Field[Iterable[Any] | None, tuple[Polygon, ...] | None] = declared(
        Optional(Polygons()), added=True, default=None
    )
    delta: InitVar[float | None] = None

    def __post_init__(self, delta: float | None) -> None:
        rates = {"horizontal_rate": self.horizontal_rate, "vertical_rate": self.vertical_rate}
        present = [name for name, value in rates.items() if value is not None]
        if delta is not None:
            if present:
                raise InvalidData(
                    f"delta sets both rates: give it or {present[0]}, not both", field="delta"
                )
            delta = Real(lower=0).coerce("delta", delta, {})
            for name in rates:
                object.__setattr__(self, name, delta)
        elif len(present) < 2:
            absent = next(name for name in rates if name not in present)
            raise InvalidData(
                f"{absent} is missing: give delta, or horizontal_rate and vertical_rate",
                field=absent,
            )
        super().__post_init__()

    def check(self) -> None:
        """Raise unless there is exactly one A and one B, and only correction points are suspect."""
        for code, word in ((START, "A"), (END, "B")):
            rows = np.flatnonzero(self.codes == code).tolist()
            if len(rows) != 1:
                text = f"rows {show(rows)}" if rows else "none"
                raise InvalidData(
                    f"kinds must hold {word!r} exactly once, got {text}", field="kinds"
                )
        if self.suspect is None:
            return
        for row in (self.start, self.end):
            if self.suspect[row]:
                raise InvalidData(
                    f"suspect[{row}] must be false: point {row} ({self.kinds[row]}) corrects nothing",
                    field="suspect",
                )
        if self.suspect.any() and self.residual is None:
            raise InvalidData(
                "residual is missing: give what a failed correction leaves of an error",
                field="residual",
            )

    @property
    def is_plain(self) -> bool:
        """Whether this is the paper's problem, without the fields that :attr:`additions` names."""
        return not self.additions

    @property
    def additions(self) -> str:
        """Name of the first addition to the paper's problem in this model; "" without one."""
        if self.suspect is not None and self.suspect.any() and self.residual != 0:
            return "suspect points"
        if self.corrections_limit is not None:
            return "a limit on corrections"
        return "no-fly polygons" if self.no_fly else ""

    @cached_property
    def free_legs(self) -> NDArray[np.bool_] | None:
        """Whether the leg between two points crosses no polygon, shape (n, n); None without polygons."""
        return frozen(free_legs(self.points, self.no_fly)) if self.no_fly else None

    @cached_property
    def codes(self) -> NDArray[np.int8]:
        """Kinds as codes ``START``, ``HORIZONTAL``, ``VERTICAL``, ``END``, shape (n,)."""
        codes = np.zeros(len(self.kinds), np.int8)
        for code, word in enumerate(KIND_WORDS):
            codes[self.kinds == word] = code
        return frozen(codes)

    @cached_property
    def start(self) -> int:
        """Index of A."""
        return int(np.flatnonzero(self.codes == START)[0])

    @cached_property
    def end(self) -> int:
        """Index of B."""
        return int(np.flatnonzero(self.codes == END)[0])

    @cached_property
    def limits(self) -> NDArray[np.float64]:
        """Largest (horizontal, vertical) error on arrival, by kind code; shape (4, 2)."""
        return frozen(
            np.array(
                [
                    [0.0, 0.0],
                    [self.beta2, self.beta1],
                    [self.alpha2, self.alpha1],
                    [self.theta, self.theta],
                ]
            )
        )

    @cached_property
    def rounded_limits(self) -> NDArray[np.float64]:
        """:attr:`limits` plus the rounding tolerance, as used by searches, shape (4, 2)."""
        return frozen(self.limits + ROUNDING * self.limits)

    def label(self, point: int) -> str:
        """Return the name of `point` in its file."""
        return str(point if self.ids is None else self.ids[point])
