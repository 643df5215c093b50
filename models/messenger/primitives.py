"""Nonlinear program of a tour with given order and turns; the lengths of its primitives are free."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, UnsupportedFormulation, UnsupportedOption, show
from ..formulation import Formulation
from ..programs.blocks import Block
from ..programs.compiled import require_casadi
from ..programs.nonlinear import NonlinearProgram
from ..verification import ROUNDING
from .checks import integrated
from .model import MessengerTour
from .motion import Layout, equations, guess_tour, match_primitives, tour, words_of
from .plan import SIGNS, TourPlan

__all__ = ["PrimitivesFormulation"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Largest scaled row violation that is corrected after a solve, and the number of Newton steps.
MENDED, ROUNDS = 1e-3, 4
#: Lower bound on the scale of a row, as a share of the leg's length: smaller scales are rounding.
FINEST = 1e-3
#: Scaled slack up to which a row is active, before and after the correction.
SPARE, LEAST = 1e-6, 1e-11
#: Rounding of the tip of a cone, as a share of the typical length of a leg: at a sharp tip, solvers
#: fail to converge to a leg of length 0.
BLUNT = 1e-5


class _Rows(NamedTuple):
    """Block of rows: entries, scales, bounds and labels."""

    name: str
    entries: list[Any]
    scale: Floats
    lower: float
    upper: float
    place: str
    entry: Ints
    unit: str = "m"


@dataclass(frozen=True, eq=False)
class PrimitivesFormulation(Formulation[MessengerTour, TourPlan]):
    """Nonlinear program of primitive lengths and encounter states, for one order and its turns.

    A local optimum holds for this order and these words only, so it provides no lower bound.

    Parameters
    ----------
    model : MessengerTour
        The model.
    order : sequence of int, optional
        Order of the vehicles. Default: the vehicle met soonest on a straight line comes next.
    words : sequence of str, optional
        Turns of each leg, such as ``"LSR"``, of any number of letters. A closed tour has one leg
        more than vehicles. Default: the words of the shortest paths, with each heading halfway
        between the directions of the leg before and the leg after. If the turning radius is 0,
        every word is ``"S"``.

    Raises
    ------
    UnsupportedOption
        `order` is not a permutation of the vehicles, or `words` does not contain one word of the
        letters L, S and R per leg.
    """

    order: Sequence[int] | None = None
    words: Sequence[str] | None = None
    near: TourPlan | None = field(default=None, init=False, repr=False)

    name = "primitives"
    summary = "lengths of the turns and lines of a given order, as a nonlinear program"
    program_type = NonlinearProgram
    relaxes = False
    # The tolerance of a position is relative to the radius, and a row of squares doubles the
    # violation.
    precision = 0.1

    def __post_init__(self) -> None:
        require_casadi(f"formulation {self.name!r}")
        if refusal := self.model.uncovered({"wind", "home_velocity"}):
            raise UnsupportedFormulation(f"formulation {self.name!r} does not cover {refusal}")
        n, legs = self.model.size, self.model.size + self.model.closed
        order, words = self.order, self.words
        if order is not None:
            row = np.asarray(order)
            whole = row.dtype.kind in "iu" and row.ndim == 1
            if not whole or sorted(row.tolist()) != list(range(n)):
                raise UnsupportedOption(
                    f"order must have each of the vehicles 0 … {n - 1} once, got {show(order)}"
                )
            object.__setattr__(self, "order", tuple(row.tolist()))
        if words is None:
            return
        listed = isinstance(words, list | tuple)
        if not listed or not all(
            isinstance(word, str) and set(word) <= set(SIGNS) for word in words
        ):
            raise UnsupportedOption(
                f"words must be a list of strings of the letters {', '.join(SIGNS)}, got {show(words)}"
            )
        if len(words) != legs:
            raise UnsupportedOption(f"words must be {legs}, one per leg, got {len(words)}")
        if self.model.turning_radius == 0 and set(words) != {"S"}:
            raise UnsupportedOption(
                f"words must all be 'S' if the turning radius is 0, got {show(words)}"
            )
        object.__setattr__(self, "words", tuple(words))

    @cached_property
    def guess(self) -> TourPlan:
        """Plan passed to :meth:`fitted`, or an initial guess that may violate constraints."""
        if self.near is not None:
            return self.near
        return guess_tour(self.model, self.order, self.words)

    @cached_property
    def turns(self) -> tuple[str, ...]:
        """Word of each leg."""
        return tuple(self.words) if self.words is not None else words_of(self.model, self.guess)

    @cached_property
    def layout(self) -> Layout:
        """Positions of the blocks of columns."""
        counts = tuple(map(len, self.turns))
        return Layout(counts, self.model.size, self.model.turning_radius > 0)

    @cached_property
    def reach(self) -> float:
        """Typical length of a leg, in m."""
        model = self.model
        mean = self.guess.length / len(self.turns)
        return max(mean, model.extent / model.size, float(model.radius.max())) or 1.0

    @cached_property
    def winding(self) -> int:
        """Number of full circles of a closed tour."""
        if not (self.model.closed and self.layout.turning):
            return 0
        end = integrated(self.guess, self.model.turning_radius)[-1, 2]
        return round(float(end - self.guess.start[2]) / (2.0 * math.pi))

    @cached_property
    def _origin(self) -> Floats:
        return self.guess.start[:2] if self.model.start is None else self.model.start[:2]

    def build(self) -> NonlinearProgram:
        """Return the program with its exact derivatives."""
        import casadi as ca

        model, met = self.model, list(self.guess.order)
        x = ca.SX.sym("x", sum(self.layout.sizes.values()))
        data = {
            "place": model.positions[met] - self._origin,
            "drift": model.drifts[met] / model.speed,
            "home": model.home_drift / model.speed,
            "radius": model.turning_radius,
            "winding": self.winding,
            "blunt": BLUNT * self.reach,
        }
        expressions = equations(x, self.layout, [SIGNS[item] for item in "".join(self.turns)], data)
        rows = self._rows(expressions)
        f = ca.SX(expressions["length"])
        g = ca.vertcat(*(item for row in rows for item in row.entries))
        lam_f, lam_g = ca.SX.sym("lam_f"), ca.SX.sym("lam_g", g.shape[0])
        hess = ca.triu(ca.hessian(lam_f * f + ca.dot(lam_g, g), x)[0])
        first = [ca.gradient(f, x), ca.jacobian(g, x)]
        counts = np.array([len(row.entries) for row in rows])
        lower, upper = self._bounds
        return NonlinearProgram(
            function=ca.Function("tour", [x], [f, g], ["x"], ["f", "g"]),
            derivatives=ca.Function("slopes", [x], first, ["x"], ["grad_f", "jac_g"]),
            hessian=ca.Function(
                "bends", [x, lam_f, lam_g], [hess], ["x", "lam_f", "lam_g"], ["hess"]
            ),
            row_lower=np.repeat([row.lower for row in rows], counts),
            row_upper=np.repeat([row.upper for row in rows], counts),
            column_lower=lower,
            column_upper=upper,
            guess=np.clip(self.encode(self.guess), lower, upper),
            column_scale=self._scale,
            row_scale=np.concatenate([row.scale for row in rows]),
            objective_scale=self.reach * len(self.turns),
            columns=tuple(self._columns()),
            rows=tuple(
                Block(row.name, "", int(start), len(row.entries), row.place, row.entry, row.unit)
                for row, start in zip(rows, np.cumsum(counts) - counts, strict=True)
            ),
            name=f"{model.name or model.kind}, {self.name}",
        )

    def _rows(self, expressions: dict[str, Any]) -> list[_Rows]:
        """Return the non-empty blocks of rows."""
        legs = np.arange(len(self.turns))[:, None]
        met = np.array(self.guess.order)
        radius = self.model.radius[met]
        discs = np.flatnonzero(radius > 0)
        apart = [expressions["apart"][k] / radius[k] ** 2 for k in discs]
        # The scale of a position is the vehicle's radius, bounded from below because of rounding.
        fine = np.maximum(radius, FINEST * self.reach)
        scales = np.append(fine, fine.min())[: len(legs)]
        axes = np.column_stack([np.repeat(legs, 2), [0, 1] * len(legs)])
        inf, ones = math.inf, np.ones(len(legs))
        blocks = [
            _Rows("motion", expressions["motion"], scales.repeat(2), 0.0, 0.0, "on leg {0}, axis {1}", axes),
            _Rows("turn", expressions["turn"], ones, 0.0, 0.0, "on leg {0}", legs, "rad"),
            _Rows("straight", expressions["straight"], scales, -inf, 0.0, "on leg {0}", legs),
            _Rows("flown", expressions["flown"], fine, 0.0, 0.0, "to vehicle {0}", met[:, None]),
            _Rows("within radius", apart, ones[: discs.size], -inf, 1.0, "of vehicle {0}",
                  met[discs][:, None], ""),
        ]  # fmt: skip
        return [row._replace(scale=row.scale[: len(row.entries)]) for row in blocks if row.entries]

    def _columns(self) -> Iterator[Block]:
        """Yield the blocks of columns."""
        met = np.array(self.guess.order)[:, None]
        legs = np.repeat(np.arange(len(self.turns)), self.layout.counts)
        axes = np.column_stack([np.repeat(met, 2), [0, 1] * len(met)])
        places: dict[str, tuple[str, Ints]] = {
            "start": ("entry {0}", np.arange(3)[:, None]),
            "length": (
                "of primitive {1} on leg {0}",
                np.column_stack([legs, np.arange(legs.size)]),
            ),
            "offset": ("from vehicle {0}, axis {1}", axes),
            "heading": ("at vehicle {0}", met),
            "flown": ("at vehicle {0}", met),
        }
        start = 0
        for name, size in self.layout.sizes.items():
            if size:
                unit = {"heading": "rad", "start": ""}.get(name, "m")
                yield Block(name, "", start, size, *places[name], unit)
            start += size

    @cached_property
    def _turning(self) -> NDArray[np.bool_]:
        """Mask of the primitives that are turns."""
        return np.array([letter != "S" for letter in "".join(self.turns)], bool)

    @cached_property
    def _bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper bounds of the columns."""
        model, layout = self.model, self.layout
        size = sum(layout.sizes.values())
        lower, upper = np.full(size, -np.inf), np.full(size, np.inf)
        low, high = layout.split(lower), layout.split(upper)
        low["length"][:] = low["flown"][:] = 0.0
        # A turn of more than a full circle never shortens a tour, and solvers diverge there.
        guess_lengths = layout.split(self.encode(self.guess))["length"][self._turning]
        high["length"][self._turning] = np.maximum(
            2.0 * math.pi * model.turning_radius, guess_lengths
        )
        if model.start is not None:
            low["start"][:2] = high["start"][:2] = 0.0
        if model.heading is not None or not layout.turning:
            # Without turns the heading has no effect.
            low["start"][2] = high["start"][2] = model.heading or 0.0
        limits = np.where(model.radius[list(self.guess.order)] > 0, np.inf, 0.0).repeat(2)
        low["offset"][:], high["offset"][:] = -limits, limits
        return lower, upper

    @cached_property
    def _scale(self) -> Floats:
        """Typical sizes of the columns."""
        scale = np.full(sum(self.layout.sizes.values()), self.reach)
        part = self.layout.split(scale)
        part["start"][2] = 1.0
        part["length"][self._turning] = min(self.model.turning_radius, self.reach)
        radius = self.model.radius[list(self.guess.order)]
        part["offset"][:] = np.where(radius > 0, radius, self.reach).repeat(2)
        part["heading"][:] = 1.0
        return scale

    def fitted(self, plan: TourPlan) -> Self:
        """Return the formulation with the order and the turns of `plan`; its guess is `plan`."""
        return self._changed(order=plan.order, words=words_of(self.model, plan), near=plan)

    def encode(self, plan: TourPlan) -> Floats:
        """Return the columns of `plan`, shape (n,); letters that a leg of the plan lacks have length 0.

        The order must be that of the formulation, and the turns of each leg a subsequence of its word. Otherwise
        :class:`~crosstrack.errors.InvalidData` is raised.
        """
        layout, model = self.layout, self.model
        if plan.order != self.guess.order:
            raise InvalidData(
                f"order must be that of the formulation, {list(self.guess.order)}, got {list(plan.order)}",
                field="order",
            )
        poses = integrated(plan, model.turning_radius)
        lengths = np.array([primitive.length for primitive in plan.primitives])
        columns = legs = [primitive.leg for primitive in plan.primitives]
        ends = np.searchsorted(legs, np.arange(model.size), side="right")
        flown = np.concatenate([[0.0], np.cumsum(lengths)])[ends]
        met = list(plan.order)
        vehicles = model.positions[met] + model.drifts[met] * (flown / model.speed)[:, None]
        x = np.zeros(sum(layout.sizes.values()))
        part = layout.split(x)
        part["start"][:2] = plan.start[:2] - self._origin
        # With a turning radius of 0, all lines of a leg share one column.
        if layout.turning:
            columns = match_primitives(words_of(model, plan), self.turns)
        np.add.at(part["length"], columns, lengths)
        part["offset"][:] = (poses[ends, :2] - vehicles).ravel()
        part["flown"][:] = flown
        part["start"][2] = model.heading or 0.0
        if layout.turning:
            # Align the plan's heading with the model's by full circles.
            circles = (
                0.0 if model.heading is None else (model.heading - plan.start[2]) / (2 * math.pi)
            )
            part["start"][2] = plan.start[2] + 2 * math.pi * round(circles)
            part["heading"][:] = poses[ends, 2] + 2 * math.pi * round(circles)
        return x

    def decode(self, point: Floats) -> TourPlan:
        """Return the tour with the lengths of `point`, flown from the start.

        Residuals of rows add up along the tour. If it is not feasible up to rounding, the nearest columns that satisfy
        the rows are used.
        """
        point = np.asarray(point, float)
        plan = self._tour(point, SPARE)
        if self.model.verify(plan, tolerance=ROUNDING).ok:
            return plan
        return self._tour(self._correct(point), LEAST)

    def _tour(self, point: Floats, least: float) -> TourPlan:
        """Return the tour of `point`; without turns, a leg longer than its line by the share `least` is bent."""
        part, order = self.layout.split(point), self.guess.order
        start = np.append(self._origin + part["start"][:2], part["start"][2])
        lengths = np.maximum(part["length"], 0.0)
        if self.layout.turning:
            return tour(self.model, order, self.turns, start, lengths)
        model, met, times = self.model, list(order), part["flown"][:, None] / self.model.speed
        vehicles = model.positions[met] + model.drifts[met] * times
        home = model.home_drift * (part["length"].sum() / model.speed)
        back = [start[:2] + home] * model.closed
        path = np.vstack([start[:2], vehicles + part["offset"].reshape(-1, 2), *back])
        along = np.diff(path, axis=0)
        chord, towards = np.hypot(*along.T), np.arctan2(along[:, 1], along[:, 0])
        # The surplus over the line is flown out and back, along two sides of a triangle.
        spare = lengths - chord > least * self.reach
        bent = np.arccos(np.where(spare, chord / np.where(spare, lengths, 1.0), 1.0))
        turns = np.where(spare, 2, 1)
        signs = np.concatenate([[1.0, -1.0][:count] for count in turns])
        return tour(
            self.model, order, ["S" * int(count) for count in turns], start,
            np.repeat(lengths / turns, turns), np.repeat(towards, turns) + signs * np.repeat(bent, turns),
        )  # fmt: skip

    def _correct(self, point: Floats) -> Floats:
        """Return the nearest point at which the active rows hold up to rounding, by Newton's method."""
        program, x = self.program, point.copy()
        assert isinstance(program, NonlinearProgram)
        free = np.flatnonzero(program.column_lower < program.column_upper)
        scale = program.column_scale[free]
        for _ in range(ROUNDS):
            off = (program.values(x)[1] - program.row_upper) / program.row_scale
            active = np.flatnonzero((program.row_lower == program.row_upper) | (off > -SPARE))
            off = off[active]
            if not np.abs(off).max(initial=0.0) <= MENDED:
                return point
            slopes = program.jacobian(x).toarray()[np.ix_(active, free)]
            slopes *= scale / program.row_scale[active][:, None]
            x[free] -= scale * np.linalg.lstsq(slopes, off, rcond=None)[0]
            x = np.clip(x, program.column_lower, program.column_upper)
        return x
