"""Result of the independent verification of a plan: one :class:`Check` per constraint."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence as SequenceOf
from dataclasses import dataclass, field
from typing import Any, Self, overload

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InvalidData, UnsupportedOption
from .specs import show

__all__ = [
    "ROUNDING",
    "TOLERANCE",
    "Check",
    "Verification",
    "check_entries",
    "check_number",
    "check_tolerance",
    "stated",
]

#: Largest violation that is attributed to rounding, relative to the scale of the constraint.
ROUNDING = 1e-9
#: Default tolerance: largest violation that a solver's feasibility tolerance explains, same scale.
TOLERANCE = 1e-6
#: Share of a limit above which its tolerance is reported as large.
NEAR = 0.1
#: Number of checks that a one-line summary names.
SHOWN = 3


@overload
def stated(value: float, maximise: bool) -> float: ...
@overload
def stated(value: float | None, maximise: bool) -> float | None: ...
def stated(value: float | None, maximise: bool) -> float | None:
    """Return a minimised objective or bound as the author of the model states it.

    Everything that a person reads uses this function. JSON records contain the minimised numbers.

    Parameters
    ----------
    value : float, optional
        The minimised number.
    maximise : bool
        Whether the author maximises the negated number: `maximise` of a model or a solution.

    Returns
    -------
    float or None
        The number in the author's sense; None without one.
    """
    return -value + 0.0 if maximise and value is not None else value


def check_number(
    name: str, value: Any, *, lower: float = 0.0, strict: bool = True, below: float = math.inf
) -> float:
    """Return the value of a numeric option after a check of its range.

    Parameters
    ----------
    name : str
        Name of the option, for the message.
    value : object
        Value of the option; Booleans and strings are rejected.
    lower : float
        Smallest allowed value, or its exclusive bound if `strict`.
    strict : bool
        Whether `lower` is excluded.
    below : float
        Exclusive upper bound.

    Returns
    -------
    float
        The value.

    Raises
    ------
    UnsupportedOption
        `value` is not a finite number in the range; the message names option, value and range.
    """
    try:
        plain = isinstance(value, int | float) and not isinstance(value, bool)
        number = float(value) if plain else math.nan
    except OverflowError:  # an integer beyond the range of floats
        number = math.nan
    above = number > lower if strict else number >= lower
    if not (math.isfinite(number) and above and number < below):
        upper = "" if below == math.inf else f" and < {below:g}"
        raise UnsupportedOption(
            f"{name} must be a number {'>' if strict else '>='} {lower:g}{upper}, got {show(value)}"
        )
    return number


def check_tolerance(value: Any) -> float:
    """Return a tolerance, or raise :class:`UnsupportedOption` if it is not a number > 0 and < 1.

    A tolerance of 1 would accept a violation as large as the limit itself.
    """
    return check_number("tolerance", value, below=1.0)


def check_entries(name: str, entries: Iterable[int], lower: int, upper: int, field: str) -> None:
    """Raise :class:`InvalidData` if an entry of a plan is outside `lower` … `upper`."""
    for k, entry in enumerate(entries):
        if not lower <= entry <= upper:
            raise InvalidData(f"{name}[{k}] must be in {lower} … {upper}, got {entry}", field=field)


@dataclass(frozen=True)
class Check:
    """One constraint of the model, evaluated on one plan.

    Parameters
    ----------
    name : str
        Constraint, in the terms of the paper.
    equation : str
        Equation number in the paper; empty if it has none.
    worst : float
        Largest violation, in `unit`; 0 if the constraint holds everywhere.
    unit : str
        Unit of `worst`, `tolerance`, `rounding`, `scale` and `limit`.
    tolerance : float
        Largest accepted violation, in `unit`.
    where : str
        Place of the largest violation, or of the smallest slack.
    rounding : float
        Largest violation that rounding alone explains, in `unit`.
    scale : float
        Magnitude of the constraint's data, in `unit`, which tolerances are relative to.
    limit : float, optional
        Limit of the constraint, or the smallest of several limits, in `unit`; None if it is 0 or
        the constraint has no limit.
    """

    name: str
    equation: str
    worst: float
    unit: str
    tolerance: float
    where: str
    rounding: float = ROUNDING
    scale: float = 1.0
    limit: float | None = None

    @classmethod
    def scaled(
        cls,
        name: str,
        equation: str,
        worst: float,
        unit: str,
        where: str,
        tolerance: float,
        scale: float,
        *,
        noise: float = 0.0,
        limit: float | None = None,
    ) -> Self:
        """Return the check of a constraint whose data have the magnitude `scale`.

        Parameters
        ----------
        name, equation, worst, unit, where, limit
            See :class:`Check`.
        tolerance : float
            Largest accepted violation, relative to `scale`.
        scale : float
            Magnitude of the constraint's data, in `unit`: the limit itself if there is one.
        noise : float
            Resolution of the plan's digits, in `unit`, which is added to the accepted violation.
        """
        accepted = tolerance * scale + noise
        return cls._of(name, equation, worst, unit, where, accepted, scale, noise, limit)

    @classmethod
    def _of(
        cls, name: str, equation: str, worst: float, unit: str, where: str,
        accepted: float, scale: float, noise: float, limit: float | None,
    ) -> Self:  # fmt: skip
        """Return the check with numbers of Python, the violation of rounding, and a finite limit."""
        return cls(
            name, equation, float(worst) + 0.0, unit, float(accepted), where,  # -0.0 becomes 0.0
            float(ROUNDING * scale + noise), float(scale),
            float(limit) if limit and math.isfinite(limit) else None,
        )  # fmt: skip

    @classmethod
    def count(
        cls, name: str, bad: float | SequenceOf[str], *, unit: str = "", equation: str = ""
    ) -> Self:
        """Return the check that a violation never happens.

        Parameters
        ----------
        name, unit, equation
            See :class:`Check`.
        bad : float or sequence of str
            Number of violations, or their places.
        """
        places = bad if isinstance(bad, SequenceOf) else ()
        number = len(bad) if isinstance(bad, SequenceOf) else bad
        where = places[0] if places else ""
        return cls(name, equation, float(number), unit, 0.0, where, 0.0)

    @classmethod
    @np.errstate(all="ignore")  # overflow gives inf or NaN, which is a violation
    def largest(
        cls,
        name: str,
        values: ArrayLike,
        scale: ArrayLike,
        unit: str | Callable[..., str],
        where: str | Callable[..., str],
        tolerance: float,
        *,
        equation: str = "",
        noise: ArrayLike = 0.0,
        limit: ArrayLike | None = None,
    ) -> Self:
        """Return the check of many violations: the largest relative to its accepted violation.

        NaN is the largest violation. If all constraints hold, the place is that of the smallest slack.

        Parameters
        ----------
        name, equation
            See :class:`Check`.
        values : array_like
            Violations, in `unit`; negative for slack.
        scale, noise, limit : array_like
            See :meth:`scaled`; broadcast to the shape of `values`.
        unit, where : str or callable
            Unit and place, or functions of the indices of an entry that return them.
        tolerance : float
            Largest accepted violation, relative to `scale`.
        """
        parts = (values, scale, noise, 0.0 if limit is None else limit)
        excess, scales, noises, limits = np.broadcast_arrays(*map(np.atleast_1d, parts))
        if not excess.size:
            unit, place = (text if isinstance(text, str) else "" for text in (unit, where))
            size, digits, bound = (float(np.max(part, initial=0.0)) for part in parts[1:])
            accepted = tolerance * size + digits
            return cls._of(name, equation, 0.0, unit, place, accepted, size, digits, bound)
        accepted = tolerance * scales + noises
        share = excess / np.maximum(accepted, 1e-300)
        share = np.where(np.isnan(share), np.where(excess < 0, -np.inf, np.inf), share)
        # An infinite scale would accept every violation, so it is treated as an infinite violation.
        share = np.where((excess > 0) & np.isinf(accepted), np.inf, share)
        at = np.unravel_index(int(share.argmax()), share.shape)
        worst = np.inf if np.isnan(excess[at]) else max(0.0, float(excess[at]))
        unit, place = (
            text if isinstance(text, str) else text(*map(int, at)) for text in (unit, where)
        )
        return cls._of(
            name, equation, worst, unit, place, accepted[at], scales[at], noises[at], limits[at]
        )

    @classmethod
    def within(
        cls,
        name: str,
        values: ArrayLike,
        limits: ArrayLike,
        unit: str,
        where: str | Callable[..., str],
        tolerance: float,
        *,
        scale: ArrayLike | None = None,
        equation: str = "",
        noise: ArrayLike = 0.0,
    ) -> Self:
        """Return the check of values against upper limits, which are the scales by default.

        Parameters
        ----------
        name, values, unit, where, tolerance, scale, equation, noise
            See :meth:`largest`; `values` are those that the limits bound.
        limits : array_like
            Upper limits, in `unit`; broadcast to the shape of `values`.
        """
        with np.errstate(all="ignore"):
            excess = np.subtract(values, limits)
        size = limits if scale is None else scale
        return cls.largest(
            name, excess, size, unit, where, tolerance, equation=equation, noise=noise, limit=limits
        )

    @staticmethod
    def worst_of(checks: Iterable[Check], default: Check) -> Check:
        """Return the check with the largest share of its tolerance; `default` without checks."""
        return max(checks, key=lambda check: check.share, default=default)

    @property
    def share(self) -> float:
        """Violation as a share of the accepted one; infinite if either is NaN or infinite."""
        if not (self.worst < math.inf and self.tolerance < math.inf):
            return math.inf
        if self.tolerance > 0.0:
            return self.worst / self.tolerance
        return math.inf if self.worst > 0.0 else 0.0

    @property
    def near(self) -> bool:
        """Whether the tolerance is at least a tenth of the limit, so that the check is weak.

        A limit within rounding is treated as no limit.
        """
        limit = 0.0 if self.limit is None else abs(self.limit)
        return self.rounding < limit <= self.tolerance / NEAR

    @property
    def ok(self) -> bool:
        """Whether the violation is accepted; False if it is NaN."""
        return bool(self.worst <= self.tolerance < math.inf)

    @property
    def within_tolerance(self) -> bool:
        """Whether the violation is accepted but larger than rounding.

        The objective may depend on such a violation, so the plan contradicts no bound.
        """
        return self.ok and self.worst > self.rounding

    def to_dict(self) -> dict[str, Any]:
        """Return the check as JSON data."""
        return {
            "name": self.name,
            "equation": self.equation,
            "worst": _finite(self.worst),
            "unit": self.unit,
            "tolerance": _finite(self.tolerance),
            "where": self.where,
            "ok": self.ok,
            "within_tolerance": self.within_tolerance,
            "rounding": _finite(self.rounding),
            # Omitted at their defaults, so that records of earlier versions keep their keys.
            **({"scale": _finite(self.scale)} if self.scale != 1.0 else {}),
            **({"limit": self.limit} if self.limit is not None else {}),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Check:
        """Return the check that :meth:`to_dict` wrote; invalid data raise ``InvalidData``."""
        from .stored import check_fields

        return cls(**check_fields(data, {"rounding": ROUNDING, "scale": 1.0, "limit": None}))

    def __str__(self) -> str:
        state = "within tolerance" if self.within_tolerance else "ok" if self.ok else "VIOLATED"
        equation = f" (eq. {self.equation})" if self.equation else ""
        unit = f" {self.unit}" if self.unit else ""
        place = f" at {self.where}" if self.where else ""
        return f"{self.name}{equation}: {state}, worst {self.worst:.3g}{unit}{place}"


@dataclass(frozen=True)
class Verification:
    """Objective and constraints of a model for one plan, recomputed from its raw data.

    Parameters
    ----------
    objective : float, optional
        Recomputed objective; None if the plan is too defective to have one, or if it is not finite.
    checks : tuple of Check
        One check per constraint.
    spread : float
        Half the width of the interval of an objective that is measured on random scenes; 0 for a
        computed objective. A plan contradicts no bound within the interval.
    scale : float
        Magnitude of the objective's data. Differences of smaller objectives are relative to it.
    maximise : bool
        Whether the printed objective is the negated one; not part of records.
    bound : float, optional
        Lower bound on the objective of all plans that :func:`crosstrack.verify` proved with
        ``exact=True`` from the multipliers of a solution; None without one.
    proof : str
        Kind of evidence for `bound`: a value of
        :class:`~crosstrack.models.programs.certificates.Proof`; empty without a bound.
    """

    objective: float | None
    checks: tuple[Check, ...]
    spread: float = 0.0
    scale: float = 1.0
    bound: float | None = None
    proof: str = ""
    maximise: bool = field(default=False, compare=False, kw_only=True)

    def __post_init__(self) -> None:
        if self.objective is not None and not math.isfinite(self.objective):
            object.__setattr__(self, "objective", None)

    @property
    def negligible(self) -> float:
        """Difference between objective and bound that is due to rounding; a scale of 0 is unknown."""
        return ROUNDING * min(self.scale or 1.0, 1.0)

    @property
    def ok(self) -> bool:
        """Whether the plan has an objective and every check is accepted."""
        return self.objective is not None and all(check.ok for check in self.checks)

    @property
    def within_tolerance(self) -> tuple[Check, ...]:
        """Checks that are accepted although the violation is larger than rounding."""
        return tuple(check for check in self.checks if check.within_tolerance)

    @property
    def near(self) -> tuple[Check, ...]:
        """Checks whose tolerance is at least a tenth of their limit, so that they are weak."""
        return tuple(check for check in self.checks if check.near)

    @property
    def violated(self) -> tuple[Check, ...]:
        """Checks that are not accepted."""
        return tuple(check for check in self.checks if not check.ok)

    @property
    def excess(self) -> float:
        """Largest violation as a share of the accepted one; infinite without an objective."""
        if self.objective is None:
            return math.inf
        return max((check.share for check in self.checks), default=0.0)

    def to_dict(self) -> dict[str, Any]:
        """Return the verification as JSON data."""
        return {
            "ok": self.ok,
            "objective": self.objective,
            "checks": [check.to_dict() for check in self.checks],
            **({"spread": self.spread} if self.spread else {}),
            **({"scale": _finite(self.scale)} if self.scale != 1.0 else {}),
            **({"bound": self.bound, "proof": self.proof} if self.bound is not None else {}),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Verification:
        """Return the verification that :meth:`to_dict` wrote; invalid data raise ``InvalidData``."""
        from .stored import verification_fields

        defaults = {"spread": 0.0, "scale": 1.0, "bound": None, "proof": ""}
        entries = verification_fields(data, defaults)
        return cls(**{**entries, "checks": tuple(map(Check.from_dict, entries["checks"]))})

    def summary(self) -> str:
        """Return the state in one line, with the checks that are violated or weak."""
        if not self.ok:
            return "violated: " + (_join_names(self.violated) or "no objective")
        accepted, near = self.within_tolerance, self.near
        text = "ok" if not accepted else "within tolerance: " + _join_names(accepted)
        return text + (f"; limits near the tolerance: {_join_names(near)}" if near else "")

    def __str__(self) -> str:
        head = "verified" if self.ok else "NOT verified"
        value = stated(self.objective, self.maximise)
        objective = "" if value is None else f", objective {value:.10g}"
        proven = stated(self.bound, self.maximise)
        bound = "" if proven is None else f", bound {proven:.10g} ({self.proof})"
        return "\n".join([head + objective + bound, *(f"  {check}" for check in self.checks)])


def _finite(value: float) -> float | None:
    """Return `value`, or None if it is infinite or NaN."""
    return value if math.isfinite(value) else None


def _join_names(checks: tuple[Check, ...]) -> str:
    """Return the names of the checks, of many only those with the largest share of their tolerance."""
    if len(checks) <= SHOWN + 1:
        return "; ".join(check.name for check in checks)

    selected = sorted(checks, key=lambda check: -check.share)[:SHOWN]
    return "; ".join(check.name for check in selected) + f" and {len(checks) - SHOWN} more"
