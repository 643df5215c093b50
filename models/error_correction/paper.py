"""The paper's mixed-integer program of an error-correction route, equation for equation.

The bilinear (12) and (15) are linearised exactly: ``T_j = 0`` at a used vertical point. No arc leaves an
unused point, so its ``T_j`` appears in no other row. ``y_1`` and ``y_n`` are 1 by (2) to (5) and have no
columns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, UnsupportedFormulation
from ..formulation import Formulation
from ..programs.builder import ProgramBuilder
from ..programs.linear import MixedIntegerProgram
from ..resource_routing.arcs import UsedArcs, require_few
from ..resource_routing.routes import follow, refuse_revisits, require_positive, require_route
from .arc_flow import ArcFlowFormulation
from .model import END, HORIZONTAL, VERTICAL, ErrorCorrectionRouting, Route

__all__ = ["PaperFormulation"]


@dataclass(frozen=True, eq=False)
class PaperFormulation(Formulation[ErrorCorrectionRouting, Route]):
    """Program of eq. 1-24 of the paper, for any number of points.

    Columns: x_ij (arc used), y_j (point used), l_j (distance on arrival), g_j, h_j (horizontal
    and vertical error on arrival), S_j, T_j (the same on leaving). A lower bound on l_n, the straight line from A
    to B, is added: with big M alone the bound of the relaxation is 0.

    Parameters
    ----------
    model : ErrorCorrectionRouting
        The model; ``revisits`` must be off, as the program forbids them.
    big_m : float, optional
        A single M for all rows, as printed. By default each row has the smallest valid M: the
        largest value of the tail's column in a route.
    length_bound : float, optional
        Length of a verified route, m, which bounds l_j and therefore M in (6).

    Raises
    ------
    UnsupportedFormulation
        The model allows revisits.
    UnsupportedOption
        An option is not a positive number.
    """

    big_m: float | None = None
    length_bound: float | None = None

    name: ClassVar[str] = "paper"
    program_type: ClassVar[type[MixedIntegerProgram]] = MixedIntegerProgram
    summary: ClassVar[str] = "the paper's big-M program, eq. 1-24"

    def __post_init__(self) -> None:
        refuse_revisits(self.model, self.name)
        if self.model.suspect is not None and self.model.suspect.any():
            raise UnsupportedFormulation(
                "formulation 'paper' knows no corrections that may fail; take 'arc-flow'"
            )
        require_positive(self.name, big_m=self.big_m, length_bound=self.length_bound)

    def bounded(self, objective: float) -> PaperFormulation:
        """Return the formulation with the length of a verified route as bound, m."""
        return replace(self, length_bound=objective)

    def _arcs(self) -> UsedArcs:
        """Return all arcs except those into A, out of B, and from a point to itself."""
        model, n = self.model, len(self.model.points)
        require_few((n - 1) ** 2, n)
        free = ~np.eye(n, dtype=bool) if model.free_legs is None else model.free_legs.copy()
        free[model.end] = free[:, model.start] = False
        tail, head = np.nonzero(free)
        length = np.linalg.norm(model.points[head] - model.points[tail], axis=1)
        return UsedArcs(tail, head, length, np.empty((tail.size, 0)))

    @cached_property
    def floor(self) -> float:
        """Length of the shortest path from A to B over the possible arcs, m."""
        return ArcFlowFormulation(self.model, self.length_bound).floor

    def _longest(self) -> float:
        """Return an upper bound on the length of feasible simple routes, m."""
        if self.length_bound is not None:
            return self.length_bound * (1 + 1e-9)
        arcs = ArcFlowFormulation(self.model).arcs
        farthest = np.zeros(len(self.model.points))
        np.maximum.at(farthest, arcs.tail, arcs.length)
        return float(farthest.sum()) or 1.0

    def build(self) -> MixedIntegerProgram:
        """Return the program of eq. 1-24."""
        model, arcs = self.model, self._arcs()
        n = len(model.points)
        points = np.arange(n)
        horizontal = np.flatnonzero(model.codes == HORIZONTAL)
        vertical = np.flatnonzero(model.codes == VERTICAL)
        corrections = np.flatnonzero((model.codes == HORIZONTAL) | (model.codes == VERTICAL))
        leaving = np.flatnonzero(model.codes != END)
        limit = model.limits[model.codes]
        to_end = np.linalg.norm(model.points - model.points[model.end], axis=1)
        longest = self._longest()
        # Upper bounds of the columns: l_i plus the distance to B is at most the longest route. S_i and
        # T_i are within the thresholds, and 0 if the point corrects them.
        reach = np.maximum(longest - to_end, 0.0)
        reach[model.end] = longest
        kept_g = np.where(model.codes == VERTICAL, limit[:, 0], 0.0)
        kept_h = np.where(model.codes == HORIZONTAL, limit[:, 1], 0.0)

        b = ProgramBuilder()
        along: dict[str, Any] = {
            "template": "along arc {0}-{1}",
            "index": np.column_stack([arcs.tail, arcs.head]),
        }
        x = b.columns(
            "arc used", len(arcs), upper=1, integral=True, equation="23",
            template="arc {0}-{1}", index=along["index"],
        )  # fmt: skip
        at: dict[str, Any] = {"template": "at point {0}"}
        y = b.columns(
            "point used", len(corrections), upper=1, integral=True, equation="24",
            index=corrections, **at,
        )  # fmt: skip
        least = np.where(points == model.end, to_end[model.start], 0.0)
        l = b.columns(  # noqa: E741
            "distance on arrival", n, lower=least, cost=np.where(points == model.end, 1.0, 0.0),
            unit="m", index=points, equation="22", **at,
        )  # fmt: skip
        # The errors on arrival at A appear in no row.
        most = np.where(points == model.start, 0.0, np.inf)
        errors: dict[str, Any] = {"unit": "error", "equation": "22", **at}
        g = b.columns("horizontal error on arrival", n, upper=most, index=points, **errors)
        h = b.columns("vertical error on arrival", n, upper=most, index=points, **errors)
        s, t, use, place = np.full((4, n), -1)
        s[leaving] = b.columns("horizontal error on leaving", n - 1, index=leaving, **errors)
        t[leaving] = b.columns("vertical error on leaving", n - 1, index=leaving, **errors)
        use[corrections] = y
        place[corrections] = np.arange(len(corrections))

        item: dict[str, Any] = {"lower": 1, "upper": 1}
        zero: dict[str, Any] = {"lower": 0, "upper": 0}
        out, into = arcs.tail == model.start, arcs.head == model.end
        b.rows("one arc out of A", 1, (0, x[out], 1.0), **item, equation="2")
        b.rows("one arc into B", 1, (0, x[into], 1.0), **item, equation="3")
        if model.corrections_limit is not None:
            arcs_most = model.corrections_limit + 1.0
            b.rows("corrections at most", 1, (0, x, 1.0), upper=arcs_most, unit="arcs")
        every = np.arange(len(corrections))
        for name, equation, ends in (("arcs in", "4", arcs.head), ("arcs out", "5", arcs.tail)):
            inner = place[ends] >= 0
            b.rows(
                name, len(corrections), (place[ends[inner]], x[inner], 1.0), (every, y, -1.0),
                equation=equation, index=corrections, **zero, **at,
            )  # fmt: skip
        rows = np.arange(len(arcs))
        for name, equation, there, here, gain, most, unit in (
            ("distance", "6", l, l, 1.0, reach, "m"),
            ("horizontal error", "7", g, s, model.horizontal_rate, kept_g, "error"),
            ("vertical error", "8", h, t, model.vertical_rate, kept_h, "error"),
        ):
            m = most[arcs.tail] if self.big_m is None else np.full(len(arcs), float(self.big_m))
            b.rows(
                name, len(arcs), (rows, there[arcs.head], 1.0), (rows, here[arcs.tail], -1.0),
                (rows, x, -(gain * arcs.length + m)), lower=-m, equation=equation, unit=unit, **along,
            )  # fmt: skip
        m = 0.0 if self.big_m is None else float(self.big_m)
        for name, equation, group, column, axis in (
            ("horizontal error at vertical", "9", vertical, g, 0),
            ("vertical error at vertical", "10", vertical, h, 1),
            ("horizontal error at horizontal", "13", horizontal, g, 0),
            ("vertical error at horizontal", "14", horizontal, h, 1),
        ):
            entry = np.arange(len(group))
            b.rows(
                name, len(group), (entry, column[group], 1.0), (entry, use[group], m),
                upper=limit[group, axis] + m, equation=equation, template="point {0}", index=group,
                unit="error",
            )  # fmt: skip
        for name, equation, group, after, before in (
            ("horizontal error kept", "11", vertical, s, g),
            ("vertical error corrected", "12", vertical, t, None),
            ("horizontal error corrected", "15", horizontal, s, None),
            ("vertical error kept", "16", horizontal, t, h),
        ):
            entry = np.arange(len(group))
            terms = [(entry, after[group], 1.0)]
            if before is not None:
                terms.append((entry, before[group], -1.0))
            b.rows(
                name, len(group), *terms, equation=equation, index=group, unit="error", **zero, **at
            )
        for kind, equation, column in (("horizontal", "17", g), ("vertical", "18", h)):
            term = (0, column[model.end], 1.0)
            b.rows(
                f"{kind} error at B", 1, term, upper=model.theta, equation=equation, unit="error"
            )
        for name, equation, column in (
            ("no horizontal error on leaving A", "19", s),
            ("no vertical error on leaving A", "20", t),
            ("no distance at A", "21", l),
        ):
            b.rows(name, 1, (0, column[model.start], 1.0), **zero, equation=equation)
        return b.build(name=f"{model.name}:paper" if model.name else "paper")

    def encode(self, plan: Route) -> NDArray[np.float64]:
        """Return the columns of a simple route; columns of unused points are 0."""
        route = require_route(self.model, plan)
        program, model, arcs = self.program, self.model, self._arcs()
        n = len(model.points)
        assert isinstance(program, MixedIntegerProgram)
        point = np.zeros(program.size)
        key = arcs.tail * n + arcs.head
        legs = np.array([i * n + j for i, j in pairwise(route)], np.int64)
        absent = legs[~np.isin(legs, key)]
        if absent.size:
            raise InvalidData(
                f"leg {absent[0] // n}-{absent[0] % n} of the route crosses a no-fly polygon",
                field="route",
            )
        point[np.searchsorted(key, legs)] = 1.0
        corrections = np.flatnonzero((model.codes == HORIZONTAL) | (model.codes == VERTICAL))
        point[
            program.column_block("point used").start + np.searchsorted(corrections, route[1:-1])
        ] = 1.0
        leaving = np.cumsum(model.codes != END) - 1
        for stop in model.walk(plan):
            for name, value in (
                ("distance on arrival", stop.distance),
                ("horizontal error on arrival", stop.horizontal),
                ("vertical error on arrival", stop.vertical),
            ):
                point[program.column_block(name).start + stop.point] = value
            if stop.kind != "B":
                for name, value in (
                    ("horizontal error on leaving", stop.horizontal_after),
                    ("vertical error on leaving", stop.vertical_after),
                ):
                    point[program.column_block(name).start + leaving[stop.point]] = value
        return point

    def decode(self, point: NDArray[np.float64]) -> Route:
        """Return the route formed by the used arcs; separate cycles are dropped."""
        arcs = self._arcs()
        if point.size < len(arcs):
            raise InvalidData(
                f"point must have at least {len(arcs)} entries, got {point.size}", field="point"
            )
        used = point[: len(arcs)] > 0.5
        return follow(self.model, arcs.tail[used], arcs.head[used])
