"""Published optimal control problems outside the catalogue, half of them frozen.

Every problem has a source and, if the source prints one, a value with its relative accuracy. Data
and guesses are those of the source: a problem whose source gives no guess has none.

The set was frozen on 2026-11-27. `is_frozen` draws a half of all problems of `published` and `unseen`
by the SHA-256 of the name. Earlier development had run those of `unseen`, and a regression test
contained `path_tracking_robot`. Since then, problems of the frozen half are not used for decisions about
the solver: no option, constant, rule or fallback may be chosen because of a result on them. They are run to report, not to tune. A declaration that turns
out to differ from its source may be corrected in both halves; the name, and therefore the half,
stays.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable

from declared_problem import DeclaredProblem

from . import aerospace, aircraft, biology, cars, chemical, linear, mechanics, robots, singular
from .table import PUBLISHED

__all__ = ["MODULES", "PUBLISHED", "development", "frozen", "is_frozen", "problems"]

#: Modules of the problems; importing them fills the table.
MODULES = (aerospace, aircraft, biology, cars, chemical, linear, mechanics, robots, singular)


def is_frozen(name: str) -> bool:
    """Return True if the problem belongs to the frozen half."""
    return hashlib.sha256(name.encode()).digest()[0] % 2 == 1


def problems() -> dict[str, DeclaredProblem]:
    """Return all problems of `published` and `unseen` by name.

    Raises
    ------
    ValueError
        A name occurs in both sets.
    """
    from unseen import UNSEEN

    both = sorted(set(UNSEEN) & set(PUBLISHED))
    if both:
        raise ValueError(f"names {both} are in `unseen` and `published`; choose others")
    return {**UNSEEN, **PUBLISHED}


def _half(belongs: Callable[[str], bool]) -> dict[str, DeclaredProblem]:
    return {name: problem for name, problem in problems().items() if belongs(name)}


def development() -> dict[str, DeclaredProblem]:
    """Return the problems on which the solver may be developed."""
    return _half(lambda name: not is_frozen(name))


def frozen() -> dict[str, DeclaredProblem]:
    """Return the problems that are only measured."""
    return _half(is_frozen)
