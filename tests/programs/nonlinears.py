"""Tools shared by the tests of nonlinear backends: the cases, and direct calls of backends."""

from __future__ import annotations

from typing import Any

from crosstrack.models.programs.nonlinear import NonlinearProgram
from crosstrack.solvers.conformance import all_cases
from crosstrack.solvers.contract.backend import Request
from crosstrack.solvers.contract.registry import find_backend
from crosstrack.solvers.nlp.base import NonlinearBackend

CASES = {name: case for name, case in all_cases().items() if name.startswith("nonlinear")}
#: Rows that depend on one another leave some solvers without a step: they give up, honestly.
TWICE = "nonlinear: an equation twice"


def mine(name: str) -> NonlinearBackend:
    backend = find_backend(name)
    assert not backend.missing(), f"{name} is expected here"
    assert isinstance(backend, NonlinearBackend)
    return backend


def asked(name: str, program: NonlinearProgram, **arguments: Any) -> Any:
    backend = mine(name)
    options = backend.checked_options(arguments.pop("options", {}))
    return backend.run(program, Request(options=options, **arguments))
