"""What the independent check of a plan found: one :class:`Check` a constraint."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

from ..errors import UnsupportedOption
from .fields import Optional, Real, Spec, Text, show
from .records import Sequence, recorded

__all__ = ["ROUNDING", "TOLERANCE", "Check", "Verification", "check_number", "check_tolerance"]

#: Largest violation that rounding explains, relative to the scale of the constraint.
ROUNDING = 1e-9
#: Largest violation that a solver's feasibility tolerance excuses, scaled alike.
TOLERANCE = 1e-6
#: Share of a limit that its tolerance must not exceed without a word.
NEAR = 0.1
#: Checks that a one-line summary names.
SHOWN = 3


#: What stored checks and verifications hold; null stands for infinity.
_CHECK: dict[str, Spec] = {
    "name": Text(),
    "equation": Text(),
    "worst": Optional(Real()),
    "unit": Text(),
    "tolerance": Optional(Real()),
    "where": Text(),
    "rounding": Optional(Real()),
    "scale": Optional(Real()),
    "limit": Optional(Real()),
}
_VERIFICATION: dict[str, Spec] = {
    "objective": Optional(Real()),
    "checks": Sequence(),
    "spread": Real(0.0),
    "scale": Optional(Real()),
}


def check_number(
    name: str, value: Any, *, lower: float = 0.0, strict: bool = True, below: float = math.inf
) -> float:
    """Return the option called `name`, or raise where it is no finite number in its range.

    Parameters
    ----------
    name : str
        The option, for the message.
    value : object
        Its value; booleans and strings are no numbers.
    lower : float
        The least value allowed, itself excluded when `strict`.
    strict : bool
        Whether `lower` is excluded.
    below : float
        The value must be less.

    Raises
    ------
    UnsupportedOption
        Naming option, value and what is allowed.
    """
    try:
        plain = isinstance(value, int | float) and not isinstance(value, bool)
        number = float(value) if plain else math.nan
    except OverflowError:  # a whole number beyond all floats
        number = math.nan
    above = number > lower if strict else number >= lower
    if not (math.isfinite(number) and above and number < below):
        most = "" if below == math.inf else f" and < {below:g}"
        raise UnsupportedOption(
            f"{name} must be a number {'>' if strict else '>='} {lower:g}{most}, got {show(value)}"
        )
    return number


def check_tolerance(value: Any) -> float:
    """Return a tolerance, or raise :class:`UnsupportedOption` where it is no number > 0 and < 1.

    At 1, a violation as large as the limit itself would be accepted.
    """
    return check_number("tolerance", value, below=1.0)


@dataclass(frozen=True)
class Check:
    """One constraint of the model, measured on one plan.

    Parameters
    ----------
    name : str
        What is checked, in the words of the paper.
    equation : str
        The paper's equation, empty where it has none.
    worst : float
        Largest violation, in `unit`; 0 when the constraint holds everywhere.
    unit : str
        Unit of `worst`, `tolerance`, `rounding`, `scale` and `limit`.
    tolerance : float
        Largest violation accepted.
    where : str
        The place of the largest violation, or of the least slack.
    rounding : float
        Largest violation that rounding alone explains.
    scale : float
        Magnitude of the constraint's data, in `unit`, which tolerances are relative to.
    limit : float, optional
        The limit that was checked, or the least where there are several; None where it is 0 or
        where there is none.
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
            As in the class.
        tolerance : float
            Largest violation accepted, relative to `scale`.
        scale : float
            Magnitude of the constraint's data, in `unit`: the limit itself where there is one.
        noise : float
            What the digits of the plan cannot resolve, in `unit`; it is excused besides.
        """
        return cls(
            name, equation, float(worst), unit, float(tolerance * scale + noise), where,
            float(ROUNDING * scale + noise), float(scale),
            float(limit) if limit and math.isfinite(limit) else None,
        )  # fmt: skip

    @property
    def near(self) -> bool:
        """Whether the limit lies near the tolerance: a tenth of it or more may be broken.

        What rounding alone explains is no limit.
        """
        limit = 0.0 if self.limit is None else abs(self.limit)
        return self.rounding < limit <= self.tolerance / NEAR

    @property
    def ok(self) -> bool:
        """Whether the violation is accepted (never, when it is not a number)."""
        return bool(self.worst <= self.tolerance < math.inf)

    @property
    def within_tolerance(self) -> bool:
        """Whether it is accepted although it is more than rounding.

        An objective may depend on such a violation, so the plan contradicts nobody.
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
            # Written where they say something, so that records of earlier versions keep their keys.
            **({"scale": _finite(self.scale)} if self.scale != 1.0 else {}),
            **({"limit": self.limit} if self.limit is not None else {}),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Check:
        """Return the check that :meth:`to_dict` wrote; bad data raises ``InvalidData``."""
        older = {"rounding": ROUNDING, "scale": 1.0, "limit": None}
        found = recorded("a check", data, _CHECK, older)
        for key in ("worst", "tolerance", "rounding", "scale"):
            found[key] = _read(found[key])
        return cls(**found)

    def __str__(self) -> str:
        state = "within tolerance" if self.within_tolerance else "ok" if self.ok else "VIOLATED"
        equation = f" (eq. {self.equation})" if self.equation else ""
        unit = f" {self.unit}" if self.unit else ""
        place = f" at {self.where}" if self.where else ""
        return f"{self.name}{equation}: {state}, worst {self.worst:.3g}{unit}{place}"


@dataclass(frozen=True)
class Verification:
    """The objective and every constraint of a model, recomputed from its raw data for one plan.

    Parameters
    ----------
    objective : float, optional
        The recomputed objective; None where the plan is too broken to have one.
    checks : tuple of Check
        One a constraint.
    spread : float
        Half the width of the interval in which the objective lies, where it is measured on drawn
        scenes; 0 where it is computed. A plan contradicts nobody inside it.
    scale : float
        Magnitude of the objective's data: where the objective is less, its differences are held
        against this.
    """

    objective: float | None
    checks: tuple[Check, ...]
    spread: float = 0.0
    scale: float = 1.0

    def __post_init__(self) -> None:
        if self.objective is not None and not math.isfinite(self.objective):
            object.__setattr__(self, "objective", None)

    @property
    def ok(self) -> bool:
        """Whether the plan has an objective and every check is accepted."""
        return self.objective is not None and all(check.ok for check in self.checks)

    @property
    def within_tolerance(self) -> tuple[Check, ...]:
        """The checks that are accepted although they are off by more than rounding."""
        return tuple(check for check in self.checks if check.within_tolerance)

    @property
    def near(self) -> tuple[Check, ...]:
        """The checks whose limit lies near the tolerance, so that they say little."""
        return tuple(check for check in self.checks if check.near)

    @property
    def violated(self) -> tuple[Check, ...]:
        """The checks that are not accepted."""
        return tuple(check for check in self.checks if not check.ok)

    @property
    def excess(self) -> float:
        """The largest violation as a share of what is accepted; infinite without an objective."""
        if self.objective is None:
            return math.inf
        asked = [c for c in self.checks if not c.ok or c.tolerance > 0.0]
        shares = (c.worst / c.tolerance if c.tolerance > 0.0 else math.inf for c in asked)
        return max((math.inf if one != one else one for one in shares), default=0.0)

    def to_dict(self) -> dict[str, Any]:
        """Return the verification as JSON data."""
        return {
            "ok": self.ok,
            "objective": self.objective,
            "checks": [check.to_dict() for check in self.checks],
            **({"spread": self.spread} if self.spread else {}),
            **({"scale": _finite(self.scale)} if self.scale != 1.0 else {}),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Verification:
        """Return the verification that :meth:`to_dict` wrote; bad data raises ``InvalidData``."""
        found = recorded("a verification", data, _VERIFICATION, {"spread": 0.0, "scale": 1.0})
        scale = _read(found["scale"])
        checks = tuple(map(Check.from_dict, found["checks"]))
        return cls(**{**found, "checks": checks, "scale": scale})

    def summary(self) -> str:
        """Return one word and, where it is not plain ok, the checks that say why."""
        if not self.ok:
            return "violated: " + (_listed(self.violated) or "no objective")
        over, near = self.within_tolerance, self.near
        found = "ok" if not over else "within tolerance: " + _listed(over)
        return found + (f"; limits near the tolerance: {_listed(near)}" if near else "")

    def __str__(self) -> str:
        head = "verified" if self.ok else "NOT verified"
        objective = "" if self.objective is None else f", objective {self.objective:.10g}"
        return "\n".join([head + objective, *(f"  {check}" for check in self.checks)])


def _finite(value: float) -> float | None:
    """Return what JSON holds for a number: null for what is infinite, or is none."""
    return value if math.isfinite(value) else None


def _read(value: float | None) -> float:
    return math.inf if value is None else value


def _listed(checks: tuple[Check, ...]) -> str:
    """Return the names of checks, of many only those that are nearest to their tolerance or over it."""
    if len(checks) <= SHOWN + 1:
        return "; ".join(check.name for check in checks)

    def used(check: Check) -> float:
        return -check.worst / check.tolerance if check.tolerance > 0 else -float("inf")

    shown = sorted(checks, key=used)[:SHOWN]
    return "; ".join(check.name for check in shown) + f" and {len(checks) - SHOWN} more"
