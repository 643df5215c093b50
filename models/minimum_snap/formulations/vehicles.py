"""Limits of a vehicle as cones at instants, with sequential linearisation of those that are not convex.

Sources: Boyd and Vandenberghe, "Convex Optimization", 2004, section 4.4.2 (second-order cones); Schulman
et al., "Motion planning with sequential convex optimization and convex collision checking", IJRR
2014 (trust region and exact penalty).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..motion import extended, heading_jumps
from ..peaks import Peaks, peaks
from ..trajectory import Trajectory
from ..vehicles import Measure
from .bases import UnitBasisFormulation
from .cones import RADIUS, ConeProgramFormulation, Held

__all__ = ["VehicleFormulation"]

Floats = NDArray[np.float64]

#: Largest violation between the instants, as a share of the tolerance: the limits are as accurate as the
#: solutions of conic programs.
SETTLED = 0.1
#: Programs with further instants, and linearisations.
ROUNDS, STEPS = 30, 40
#: Relative change of the merit, and of the path, at which the linearisation has converged.
_CONVERGED = 1e-9
_SMALL = 1e-6
#: Factors of the trust region after bad and good steps, and its least radius.
_SHRINK, _GROW, _LEAST = 0.25, 4.0, 1e-6
#: Factor of the price of a relative violation, and its largest value.
_DEARER, _DEAREST = 10.0, 1e5


@dataclass(frozen=True, eq=False)
class VehicleFormulation(ConeProgramFormulation):
    """Second-order cones at instants for a vehicle, on a quadratic program of the path.

    Upper limits of thrust, tilt, speed and acceleration are convex: the program with some of their
    instants is a relaxation, to which instants are added until the path keeps the limits at all times.
    If its optimum exceeds a limit that is not convex (lowest thrust, body rate, wheels), the quantity is
    linearised about the last path within a trust region. The results of these programs prove nothing.

    Parameters
    ----------
    model : MinimumDerivative
        Problem at given times with a vehicle.
    samples : int
        Initial instants per segment at which limits are imposed, 2 to 1000.

    Raises
    ------
    UnsupportedFormulation
        The model has no vehicle.
    UnsupportedOption
        `samples` is not an integer in [2, 1000].
    """

    merit: float = field(default=np.inf, init=False, repr=False)
    rounds: int = field(default=0, init=False, repr=False)
    converged: bool = field(default=True, init=False, repr=False)

    name = "cones"
    summary = "second-order cones for the limits of a vehicle, others by linearisation"

    def _next(self, **fields: Any) -> Self:
        """Return a copy of this formulation with other fields."""
        names = ("base", "held", "centre", "merit", "radius", "price", "relaxes")
        state = {name: getattr(self, name) for name in names}
        state["rounds"] = self.rounds + 1
        return self._changed(**{**state, **fields})

    def _excess(
        self, plan: Trajectory, tolerance: float
    ) -> Iterator[tuple[Measure, Peaks, Floats, float]]:
        """Yield for each quantity its peaks, their relative violations, and the largest accepted one."""
        if not self.measures:
            return
        series = extended(plan, self._yaw, self._vehicle.follows_path)
        for measure, held in zip(self.measures, self.held, strict=True):
            accept = measure.level + SETTLED * tolerance * abs(measure.level)
            peak = peaks(series, measure.function, scale=abs(measure.level), accept=accept)
            with np.errstate(all="ignore"):
                known = measure.function(series.on(held.segment, held.s, 4)).terms[0]
            sign = 1.0 if measure.is_upper else -1.0
            share, imposed = (
                sign * (measure.value(value) - measure.limit) / measure.limit
                for value in (peak.value, known)
            )
            # The violation at imposed instants measures the inaccuracy of the solver.
            active = measure.is_convex and imposed.size > 0
            worst = 2.0 * float(np.nan_to_num(imposed).max()) if active else 0.0
            yield measure, peak, share, max(SETTLED * tolerance, worst)

    def refined(self, point: Floats, tolerance: float, duals: Floats | None = None) -> Self | None:
        """Return the formulation with the violated instants of `point`, or about its path; None at the end.

        The parameters are those of the base; `duals` are not used.
        """
        plan = self.decode(point)
        held, excess, new, bent = [], 0.0, False, False
        for (measure, peak, share, accepted), former in zip(
            self._excess(plan, tolerance), self.held, strict=True
        ):
            out = np.flatnonzero(share > accepted)
            s = np.clip((peak.time[out] - plan.times[out]) / plan.durations[out], 0.0, 1.0)
            more = former.joined(out, s) if out.size else former
            held.append(more)
            added = more.s.size > former.s.size
            new |= added and (measure.is_convex or self._is_fixed or self.centre is not None)
            bent |= out.size > 0 and not (measure.is_convex or self._is_fixed)
            excess = max(excess, float(share.max()))
        base = self.base.refined(self._local(point), tolerance)
        new |= base is not None
        base = self.base if base is None else base
        if self.centre is None:
            if self.rounds >= ROUNDS or not (new or bent):
                if self._turns_at_knot(plan, tolerance):
                    self._set(relaxes=False)
                return None
            if new:
                # Instants of other limits are of no use until the linearisation begins.
                return self._next(held=tuple(held), base=base)
            first = self._next(
                held=tuple(held), base=base, centre=plan, relaxes=False, rounds=0, converged=False
            )
            return first._set(merit=first._merit(plan, excess))
        return self._stepped(plan, excess, tuple(held), base, tolerance, new)

    def _merit(self, plan: Trajectory, excess: float) -> float:
        return self.model.objective(plan) + self._penalty * max(excess, 0.0)

    def _stepped(
        self, plan: Trajectory, excess: float, held: tuple[Held, ...], base: UnitBasisFormulation,
        tolerance: float, new: bool,
    ) -> Self | None:  # fmt: skip
        """Return the next linearisation, about `plan` if it is better; None at the end."""
        assert self.centre is not None
        merit = self._merit(plan, excess)
        gain = self.merit - merit
        change = self.base.encode(plan) - self.base.encode(self.centre)
        moved = float((np.abs(change) / self._reach).max(initial=0.0))
        kept = excess <= 0.5 * tolerance and not self._turns_at_knot(plan, tolerance)
        still = abs(gain) <= _CONVERGED * abs(self.merit) or moved <= _SMALL
        settled, stuck = still and kept and not new, still and not (kept or new) and gain >= 0
        if settled or self.rounds >= STEPS or (stuck and self.price >= _DEAREST):
            self._set(converged=settled)
            return None
        if stuck:
            dearer = self._next(held=held, base=base, centre=plan, price=self.price * _DEARER)
            return dearer._set(radius=RADIUS, merit=dearer._merit(plan, excess))
        if gain > 0:
            # A region far beyond the last step would only blur the bound of the program.
            radius = min(max(_GROW * moved, _LEAST), 1.0)
            better = self._next(held=held, base=base, centre=plan, radius=radius)
            return better._set(merit=better._merit(plan, excess))
        if new:  # the program lacked instants: it is not the region that is too large
            return self._next(held=held, base=base)
        radius = _SHRINK * min(self.radius, moved if moved > 0 else self.radius)
        if radius < 1e-12:
            self._set(converged=False)
            return None
        return self._next(held=held, base=base, radius=radius)

    def _turns_at_knot(self, plan: Trajectory, tolerance: float) -> bool:
        """Return True, with the reason in `failure`, if the direction of the path jumps at a knot.

        No program constrains the direction.
        """
        turns = self._follows and bool((heading_jumps(plan) > tolerance).any())
        if turns:
            self._set(failure="the heading of the optimal path jumps at a knot")
        return turns

    @property
    def is_local_optimum(self) -> bool:
        """Whether the last step changed merit or path negligibly, and the path keeps the limits."""
        return self.centre is not None and self.converged

    def statistics(self, plan: Trajectory) -> dict[str, float | int | str]:
        """Return the number of linearisations, if any."""
        return {} if self.centre is None else {"linearisations": self.rounds + 1}
