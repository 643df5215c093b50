"""Choice of backends for a model: those that fit, and the one that ``"auto"`` selects."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ...errors import BackendBroken, BackendMissing, UnsupportedFormulation
from ...models.model import Model
from ...models.problems import PROBLEMS, problem_of
from .backend import PROVING, Backend, Feature, Guarantee
from .registry import (
    Declaration,
    accepted,
    declarations,
    default_formulation,
    fits_integrality,
    integral_solvers,
)

__all__ = ["fitting", "guaranteed", "recommended", "refusals"]


#: Reason if a backend would ignore integral columns, or solves programs only with some.
_MISMATCH = "does not solve programs of this kind with these integral or continuous columns"


def _problems(model: Model[Any]) -> set[str]:
    """Return the problems whose native algorithms may accept `model` itself."""
    return {problem_of(getattr(base, "kind", "")) for base in type(model).__mro__} - {""}


def _candidates(model: Model[Any]) -> Iterator[Declaration]:
    """Yield the backends that may accept `model` or a lowered model, those of its problem first.

    The model is lowered only if more are needed, because building the general model can be slow.
    """
    own = _problems(model)
    yield from (entry for entry in declarations() if entry.problem in own)
    general, step = set(own), model.lower()
    has_program = bool(model.formulations) or own.isdisjoint(PROBLEMS)
    while step is not None:
        general |= _problems(step)
        has_program |= bool(step.formulations)
        step = step.lower()
    # Backends of other problems are not loaded, because they may import further libraries.
    others = set(PROBLEMS) - general | own
    for entry in declarations():
        is_solver = not entry.problem and isinstance(entry.target, str)  # of programs
        if entry.problem not in others and (has_program or not is_solver):
            yield entry


def refusals(model: Model[Any]) -> Iterator[tuple[Declaration, str]]:
    """Yield the backends that may accept `model`, each with the reason why it cannot solve it.

    The reason is empty if the backend can solve the model by default, or cannot be loaded. Missing backends
    are tested like installed ones.

    Parameters
    ----------
    model : Model
        The model.
    """
    programs: dict[tuple[str, str], Any] = {}
    for declared in _candidates(model):
        try:
            backend = declared.load()
        except BackendBroken:
            yield declared, ""
            continue
        yield declared, _refusal(model, backend, programs)


def _refusal(model: Model[Any], backend: Backend, programs: dict[tuple[str, str], Any]) -> str:
    """Return why `backend` cannot solve `model` by default; `programs` contains those built before."""
    step = accepted(model, backend, None)
    if step is None:
        if isinstance(model, backend.accepts):
            return _MISMATCH
        return f"accepts {backend.accepted_kinds()}, not {model.kind}"
    problem: Any = step
    if not isinstance(step, backend.accepts):
        key = step.kind, default_formulation(step, backend)
        if key not in programs:
            try:
                programs[key] = step.formulate(key[1]).program
            except UnsupportedFormulation as error:
                programs[key] = str(error)
        problem = programs[key]
    if isinstance(problem, str):
        return problem
    return backend.refuses(problem) if fits_integrality(problem, backend) else _MISMATCH


def _loadable(model: Model[Any]) -> Iterator[Backend]:
    """Yield the installed and loadable backends that may accept `model`."""
    for declared in _candidates(model):
        try:
            backend = declared.load()
        except BackendBroken:
            continue  # a broken external backend must not stop the others; lists show it
        if not backend.missing():
            yield backend


def fitting(model: Model[Any]) -> tuple[str, ...]:
    """Return the names of the installed backends that can solve `model` by default."""
    programs: dict[tuple[str, str], Any] = {}
    return tuple(
        backend.name for backend in _loadable(model) if not _refusal(model, backend, programs)
    )


def _takers(model: Model[Any], formulation: str | None) -> Iterator[tuple[Backend, Model[Any]]]:
    """Yield the backends that ``"auto"`` may select, in order, with the model each one solves."""
    for backend in _loadable(model):
        step = accepted(model, backend, formulation)
        if step is None or backend.sees_hidden:
            continue
        is_native = isinstance(step, backend.accepts)
        if formulation is None and (backend.refuses(step) if is_native else not step.has_program):
            continue
        yield backend, step


def guaranteed(
    model: Model[Any], guarantee: Guarantee, formulation: str | None = None
) -> Iterator[Backend]:
    """Yield the installed backends of a guarantee that can solve `model`, the recommended one first."""
    for backend, _ in _takers(model, formulation):
        if backend.guarantee is guarantee:
            yield backend


def recommended(model: Model[Any], formulation: str | None = None) -> Backend:
    """Return the backend that ``"auto"`` selects for `model`.

    That is the model's preferred backend, else the first installed exact backend, else one that finds
    plans and proves bounds, else the one with the best guarantee. A backend that is not automatic comes
    last. It raises :class:`UnsupportedFormulation` if no installed backend accepts the model; the message
    names backends that can be installed, or the reasons of those of the problem.
    """
    best: Backend | None = None
    last: Backend | None = None
    order = [Guarantee.LOCAL, Guarantee.HEURISTIC, Guarantee.RELAXATION]

    def rank(candidate: Backend) -> int:
        finds = Feature.INCUMBENTS in candidate.features
        return -1 if finds and candidate.guarantee in PROVING else order.index(candidate.guarantee)

    if formulation is None and model.preferred_backend:
        for backend, step in _takers(model, None):
            native = isinstance(step, backend.accepts)
            if native and step is model and backend.name == model.preferred_backend:
                return backend
    for backend, step in _takers(model, formulation):
        program = formulation is None and not isinstance(step, backend.accepts)
        if program and best is not None and step.prefers_native:
            continue
        if not backend.is_automatic:
            last = last or backend
            continue
        if backend.guarantee is Guarantee.EXACT:
            return backend
        if best is None or rank(backend) < rank(best):
            best = backend
    best = best or last
    if best is None:
        what = f"formulation {formulation!r} of " if formulation else ""
        text = f"no installed backend accepts {what}model {model.kind!r}"
        more = integral_solvers(model) or ("" if formulation else _alternatives(model))
        raise UnsupportedFormulation(": ".join(part for part in (text, more) if part))
    return best


def _alternatives(model: Model[Any]) -> str:
    """Return how to install backends that can solve `model`; without any, why those of its problem cannot."""
    reasons = []
    for declared, reason in refusals(model):
        if not reason:
            try:
                declared.load().require()
            except BackendMissing as error:
                return str(error)
            except BackendBroken:
                continue
        elif declared.problem:
            reasons.append(f"{declared.name!r} does not cover {reason}")
    return "; ".join(reasons)
