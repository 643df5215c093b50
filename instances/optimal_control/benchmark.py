"""Decorator for functions that declare a benchmark problem."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, Concatenate, ParamSpec, Protocol

from ...models.fields import Flag, Optional, Real
from ...models.optimal_control.model import OptimalControlProblem

__all__ = ["Benchmark", "benchmark"]

P = ParamSpec("P")

_NAME = "    name : str\n        Name of the problem.\n"
_HEAD = "    Parameters\n    ----------\n"
_RETURNS = (
    "    Returns\n    -------\n    OptimalControlProblem\n"
    "        Declared problem, which accepts further declarations.\n    "
)


class Benchmark(Protocol[P]):
    """Function that returns a named problem; the default name is that of the function."""

    __name__: str

    def __call__(
        self, name: str = ..., *args: P.args, **options: P.kwargs
    ) -> OptimalControlProblem: ...


def benchmark(declare: Callable[Concatenate[OptimalControlProblem, P], None]) -> Benchmark[P]:
    """Return the function ``(name, **options)`` that creates a problem, declares it with `declare`, and returns it.

    `declare` takes the problem and the options. The name is documented as the first parameter.
    """
    default = f"optimal-control/{declare.__name__.replace('_', '-')}"

    value_of = {
        key: parameter.default for key, parameter in inspect.signature(declare).parameters.items()
    }

    @functools.wraps(declare)
    def problem(name: str = default, *args: Any, **options: Any) -> OptimalControlProblem:
        ocp = OptimalControlProblem(name)
        for key, value in options.items():
            real = Optional(Real()) if value_of.get(key) is None else Real()
            rule = Flag() if isinstance(value_of.get(key), bool) else real
            options[key] = rule.coerce(key, value, {})
        declare(ocp, *args, **options)
        return ocp

    text = declare.__doc__ or ""
    where = text.find(_HEAD)
    if where < 0:
        text = f"{text.rstrip()}\n\n{_HEAD}{_NAME}"
    else:
        text = text[: where + len(_HEAD)] + _NAME + text[where + len(_HEAD) :]
    problem.__doc__ = f"{text.rstrip()}\n\n{_RETURNS}"
    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
    first = inspect.Parameter("name", kind, default=default, annotation="str")
    known = inspect.signature(declare)
    problem.__signature__ = known.replace(  # type: ignore[attr-defined]
        parameters=[first, *list(known.parameters.values())[1:]],
        return_annotation="OptimalControlProblem",
    )
    return problem
