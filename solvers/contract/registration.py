"""Registration of backends by the user."""

from __future__ import annotations

import contextlib
import itertools
from typing import Any

from ...errors import BackendBroken, InvalidData
from ...models.fields import show
from ...models.model import Model
from ...models.problems import problem_of
from .backend import Backend
from .registry import installed, session

__all__ = ["register_backend"]


def register_backend(backend: Backend | type[Backend]) -> Backend | type[Backend]:
    """Register a backend by its name for this session. Usable as a class decorator.

    Workers receive the backend with their jobs. Backends that accept different types may share a name.
    Registering a backend again replaces the previous one. A distribution declares its backends in the
    entry-point group ``crosstrack.backends`` instead.

    Parameters
    ----------
    backend : Backend or type of Backend
        The backend, or its class, which is instantiated without arguments.

    Returns
    -------
    Backend or type of Backend
        The argument.

    Raises
    ------
    InvalidData
        Not a backend, or a backend of crosstrack with this name accepts the same models.
    """
    instance = backend() if isinstance(backend, type) else backend
    if not isinstance(instance, Backend):
        raise InvalidData(
            f"a backend must be a subclass of Backend, got {show(backend)}", field="backend"
        )
    for declared in installed():
        if declared.name != instance.name:
            continue
        with contextlib.suppress(BackendBroken):
            other = declared.load()
            if type(other) is type(instance):
                return backend
            shared = _shared(instance, other)
            if shared:
                raise InvalidData(
                    f"backend name {instance.name!r} is taken for {shared} by "
                    f"{type(other).__module__}.{type(other).__name__}: choose another name",
                    field="name",
                )
    instance.problem = _problem(instance)
    backends = session()
    backends[:] = [
        other for other in backends if other.name != instance.name or not _shared(instance, other)
    ]
    backends.append(instance)
    return backend


def _accepted_types(backend: Backend) -> tuple[type[Model[Any]], ...]:
    """Return the types that `backend` accepts as a tuple."""
    types = backend.accepts
    return types if isinstance(types, tuple) else (types,)


def _shared(backend: Backend, other: Backend) -> str:
    """Return the kind of a problem that both backends accept; empty if they share none."""
    for first, second in itertools.product(_accepted_types(backend), _accepted_types(other)):
        if issubclass(first, second) or issubclass(second, first):
            return repr(getattr(first, "kind", first.__name__))
    return ""


def _problem(backend: Backend) -> str:
    """Return the problem whose models `backend` accepts; empty for programs or several problems."""
    owners = {problem_of(getattr(kind, "kind", "")) for kind in _accepted_types(backend)}
    return owners.pop() if len(owners) == 1 else ""
