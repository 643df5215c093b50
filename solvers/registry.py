"""Which backends there are: a static table, strangers' entry points, and a session's own."""

from __future__ import annotations

import contextlib
import importlib.metadata
import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from ..errors import BackendBroken, InvalidData, UnknownName, UnsupportedFormulation
from ..models.fields import show
from ..models.model import Model
from ..models.problems import PROBLEMS, declared_in, problem_of, resolve
from .backend import PROVING, Backend, Feature, Guarantee

log = logging.getLogger("crosstrack")

__all__ = [
    "BackendState",
    "accepted",
    "backend_names",
    "backend_states",
    "default_formulation",
    "exact",
    "find_backend",
    "fitting",
    "is_ours",
    "is_plain",
    "native_heuristics",
    "recommended",
    "register_backend",
    "rivals",
]

#: Entry-point group in which other distributions announce backends.
GROUP = "crosstrack.backends"

#: Solvers of programs, each kind in order of preference. They stand after the native algorithms of
#: all problems: the first exact one that is installed and accepts a model is what ``"auto"`` takes.
_SOLVERS: Mapping[str, str] = {
    # Before HiGHS, whose quadratic solver is slower and was seen to fail on flat objectives.
    "clarabel": ".solvers.qp.clarabel:Clarabel",
    "highs": ".solvers.mip.highs:Highs",
    "scip": ".solvers.mip.scip:Scip",
    "scipy": ".solvers.mip.scipy_milp:ScipyMilp",
    "ortools": ".solvers.mip.ortools_mathopt:MathOpt",
    "cp-sat": ".solvers.mip.cp_sat:CpSat",
    "cvxpy": ".solvers.mip.cvxpy_mip:CvxpyMip",
    "gurobi": ".solvers.mip.gurobi:Gurobi",
    "piqp": ".solvers.qp.piqp:Piqp",
    "proxqp": ".solvers.qp.proxqp:Proxqp",
    "daqp": ".solvers.qp.daqp:Daqp",
    "quadprog": ".solvers.qp.quadprog:Quadprog",
    "osqp": ".solvers.qp.osqp:Osqp",
    "scs": ".solvers.qp.scs:Scs",
    "qpsolvers": ".solvers.qp.qpsolvers:Qpsolvers",
    "ecos": ".solvers.conic.ecos:Ecos",
    "casadi": ".solvers.qp.casadi:CasadiConic",
    "ipopt": ".solvers.nlp.ipopt:Ipopt",
    "uno": ".solvers.nlp.uno:Uno",
    "fatrop": ".solvers.nlp.fatrop:Fatrop",
    "sqpmethod": ".solvers.nlp.sqpmethod:SqpMethod",
    "sleqp": ".solvers.nlp.sleqp:Sleqp",
    "blocksqp": ".solvers.nlp.blocksqp:BlockSqp",
    "bonmin": ".solvers.nlp.bonmin:Bonmin",
    "slsqp": ".solvers.nlp.slsqp:Slsqp",
    "trust-constr": ".solvers.nlp.trust_constr:TrustConstr",
}

_session: list[Backend] = []


def register_backend(backend: Backend | type[Backend]) -> Backend | type[Backend]:
    """Make a backend known by its name in this session; usable as a class decorator.

    Workers receive it with their jobs, so it needs no installation. A distribution announces its
    backends in the entry-point group ``crosstrack.backends`` instead. A name belongs to the types
    that the backend accepts: backends of different problems may share one. Registering a backend
    again, as when a notebook's cell runs twice, replaces the former one of this session.

    Parameters
    ----------
    backend : Backend or type of Backend
        The backend, or its class, which is called without arguments.

    Returns
    -------
    Backend or type of Backend
        `backend` itself.

    Raises
    ------
    InvalidData
        It is no backend, or a backend of crosstrack with this name accepts the same models.
    """
    instance = backend() if isinstance(backend, type) else backend
    if not isinstance(instance, Backend):
        raise InvalidData(
            f"a backend must be a subclass of Backend, got {show(backend)}", field="backend"
        )
    for declared in _installed():
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
    _session[:] = [
        other for other in _session if other.name != instance.name or not _shared(instance, other)
    ]
    _session.append(instance)
    return backend


def _accepted_types(backend: Backend) -> tuple[type[Model[Any]], ...]:
    """Return the types of problems that `backend` accepts."""
    types = backend.accepts
    return types if isinstance(types, tuple) else (types,)


def _shared(backend: Backend, other: Backend) -> str:
    """Return the kind of a problem that both backends accept; empty if they accept none."""
    for one in _accepted_types(backend):
        for two in _accepted_types(other):
            if issubclass(one, two) or issubclass(two, one):
                return repr(getattr(one, "kind", one.__name__))
    return ""


def _problem(backend: Backend) -> str:
    """Return the problem whose models `backend` accepts itself; empty for programs or several."""
    owners = {problem_of(getattr(kind, "kind", "")) for kind in _accepted_types(backend)}
    return owners.pop() if len(owners) == 1 else ""


@dataclass(frozen=True)
class _Declared:
    """Where a backend is found: the problem whose native algorithm it is, if any, and its target."""

    name: str
    problem: str
    target: Any

    @property
    def solves_programs(self) -> bool:
        """Whether it is one of :data:`_SOLVERS`."""
        return not self.problem and isinstance(self.target, str)

    def load(self) -> Backend:
        """Return the backend; ``BackendBroken`` with the cause where its code cannot be loaded."""
        target = self.target
        where = target if isinstance(target, str) else getattr(target, "value", repr(target))
        try:
            loaded = resolve(target) if isinstance(target, str | Backend) else target.load()
            instance = loaded() if isinstance(loaded, type) else loaded
        except Exception as error:
            raise BackendBroken(
                f"backend {self.name!r} ({where}) cannot be loaded: {type(error).__name__}: {error}"
            ) from error
        if not isinstance(instance, Backend):
            raise BackendBroken(
                f"backend {self.name!r} is no Backend but {type(instance).__name__}"
            )
        instance.problem = self.problem
        return instance


@cache
def _installed() -> tuple[_Declared, ...]:
    """Read once: looking through all installed distributions takes milliseconds."""
    native = [
        _Declared(name, problem, to) for problem, name, to in declared_in(__package__, "BACKENDS")
    ]
    ours = [_Declared(name, "", to) for name, to in _SOLVERS.items()]
    taken = {one.name for one in ours}
    points = importlib.metadata.entry_points(group=GROUP)
    theirs = {point.name: _Declared(point.name, "", point) for point in points}
    for name in taken & set(theirs):
        log.warning("backend %r of %s is left out: the name is taken", name, theirs[name].target)
    return (*native, *ours, *(one for name, one in theirs.items() if name not in taken))


def _declared(name: str | None = None) -> Sequence[_Declared]:
    """Return all backends, or those called `name`, those of the session last."""
    known = (*_installed(), *(_Declared(one.name, one.problem, one) for one in _session))
    return known if name is None else [one for one in known if one.name == name]


def backend_names() -> tuple[str, ...]:
    """Return the names of all backends, native algorithms first."""
    return tuple(dict.fromkeys(one.name for one in _declared()))


def find_backend(
    backend: str | Backend, model: Model[Any] | None = None, *, problem: str | None = None
) -> Backend:
    """Return the backend called `backend`; a backend object is returned as it is.

    Parameters
    ----------
    backend : str or Backend
        A name. Native algorithms of several problems may share one.
    model : Model, optional
        What it is to solve: among backends of one name, the one that accepts it is taken.
    problem : str, optional
        Instead of a model, the problem (the name of its folders) whose native algorithm is meant;
        the first backend of that name where it has none.

    Raises
    ------
    UnknownName
        No backend bears the name.
    InvalidData
        Several problems have a backend of that name, and no model says which is meant.
    BackendBroken
        Its own code cannot be loaded; the cause is named.
    """
    if isinstance(backend, Backend):
        return backend
    if not isinstance(backend, str):
        raise InvalidData(
            f"backend must be a name or a Backend, got {show(backend)}", field="backend"
        )
    found = _declared(backend)
    if not found:
        raise UnknownName("backend", backend, backend_names())
    if problem is not None:
        found = [one for one in found if one.problem == problem] or found[:1]
    if len(found) == 1:
        return found[0].load()
    if model is None:
        raise InvalidData(
            f"backend {backend!r} belongs to each of the problems "
            f"{', '.join(one.problem or 'programs' for one in found)}: name it together with a model",
            field="backend",
        )
    loaded: list[Backend] = []
    for one in found:
        try:
            loaded.append(one.load())
        except BackendBroken as error:  # another problem's fault must not stop this one
            log.warning("%s", error)
    if not loaded:
        raise BackendBroken(f"no backend {backend!r} can be loaded")
    fits = [one for one in loaded if accepted(model, one, None) is not None]
    for hidden in fits[1:]:
        if not is_ours(hidden):
            log.warning("backend name %r: %s is used, not %s", backend, fits[0], hidden)
    return fits[0] if fits else loaded[0]


@dataclass(frozen=True)
class BackendState:
    """What is known of a backend without importing its solver.

    ``problem`` is the problem whose native algorithm it is, empty for a solver of programs. ``state`` is ``"installed"``, ``"missing"`` or ``"broken"``; ``cause`` says why it is not the
    first. Whether an installed one really loads, with all that it ``requires``, is found in a worker
    (:func:`crosstrack.solvers.probing.probe`).
    """

    name: str
    state: str
    cause: str = ""
    version: str | None = None
    accepts: str = ""
    guarantee: str = ""
    features: tuple[str, ...] = ()
    options: Mapping[str, str] | None = None
    summary: str = ""
    problem: str = ""
    requires: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the state as JSON data."""
        return {
            "name": self.name,
            "problem": self.problem,
            "state": self.state,
            "installed": self.state == "installed",
            "cause": self.cause,
            "version": self.version,
            "accepts": self.accepts,
            "guarantee": self.guarantee,
            "features": list(self.features),
            "options": dict(self.options or {}),
            "summary": self.summary,
        }


def backend_states() -> tuple[BackendState, ...]:
    """Return the state of every backend; one that is missing or broken is a row, no exception."""
    return tuple(map(_state, _declared()))


def _state(declared: _Declared) -> BackendState:
    name = declared.name
    try:
        backend = declared.load()
        missing = backend.missing()
        backend_version = backend.version()
    except (BackendBroken, ImportError) as error:
        return BackendState(name, "broken", str(error), problem=declared.problem)
    cause = ""
    if missing:
        how = f"crosstrack[{backend.extra}]" if backend.extra else " ".join(missing)
        cause = f"pip install '{how}'"
    return BackendState(
        name=name,
        state="missing" if missing else "installed",
        cause=cause,
        version=backend_version,
        accepts=backend.accepted_kinds(),
        guarantee=str(backend.guarantee),
        features=tuple(sorted(str(feature) for feature in backend.features)),
        options={key: option.help for key, option in backend.options.items()},
        summary=backend.summary,
        problem=declared.problem,
        requires=tuple(backend.requires),
    )


def is_plain(backend: Backend) -> bool:
    """Return whether `backend` is ours and loads no solver: it prints nothing, and does not crash."""
    return is_ours(backend) and not backend.requires and not backend.natives


def is_ours(backend: Backend) -> bool:
    """Return whether `backend` is part of crosstrack; what others wrote is not trusted with models."""
    return type(backend).__module__.partition(".")[0] == __name__.partition(".")[0]


def rivals(backend: Backend) -> frozenset[str]:
    """Return the native modules that break `backend` when they are loaded in its process."""
    found: set[str] = set()
    if backend.conflict_group:
        for declared in _declared():
            try:
                other = declared.load()
            except BackendBroken:
                continue  # what cannot be loaded cannot be in the way
            if other.conflict_group == backend.conflict_group:
                found.update(other.natives)
    return frozenset(found - set(backend.natives))


def accepted(model: Model[Any], backend: Backend, formulation: str | None) -> Model[Any] | None:
    """Return the model along the chain of ``lower()`` that `backend` takes, None where there is none.

    It takes a model of its own type, or one with a formulation of its program type.
    """
    step: Model[Any] | None = model
    while step is not None:
        if isinstance(step, backend.accepts) and formulation is None:
            return step
        if _formulations(step, backend, formulation):
            return step
        step = step.lower()
    return None


def _formulations(model: Model[Any], backend: Backend, formulation: str | None) -> list[str]:
    names = [formulation] if formulation is not None else [*model.formulations]
    return [
        name
        for name in names
        if name in model.formulations
        and issubclass(type(model).formulation_type(name).program_type, backend.accepts)
    ]


def default_formulation(model: Model[Any], backend: Backend) -> str:
    """Return the formulation that `backend` takes when none is named: the model's own default first."""
    names = _formulations(model, backend, None)
    return model.preferred_formulation if model.preferred_formulation in names else names[0]


def _problems(model: Model[Any]) -> set[str]:
    """Return the problems whose native algorithms may know `model` itself."""
    return {problem_of(getattr(base, "kind", "")) for base in type(model).__mro__} - {""}


def _candidates(model: Model[Any]) -> Iterator[_Declared]:
    """Yield the backends that may know `model` or what it lowers to, those of its own problem first.

    It is lowered when these are not enough: a general model may take longer to make than to solve.
    """
    own = _problems(model)
    yield from (one for one in _declared() if one.problem in own)
    general, step = set(own), model.lower()
    writes_programs = bool(model.formulations) or not own
    while step is not None:
        general |= _problems(step)
        writes_programs |= bool(step.formulations)
        step = step.lower()
    # Others' are not even loaded: they may bring libraries that this model does without.
    others = set(PROBLEMS) - general | own
    for one in _declared():
        if one.problem not in others and (writes_programs or not one.solves_programs):
            yield one


def _loadable(model: Model[Any]) -> Iterator[Backend]:
    """Yield the backends that are installed, can be loaded and may know `model`."""
    for declared in _candidates(model):
        try:
            backend = declared.load()
        except BackendBroken:
            continue  # a stranger's broken backend must not stop the others; lists show it
        if not backend.missing():
            yield backend


def fitting(model: Model[Any]) -> tuple[str, ...]:
    """Return the names of the installed backends that can take `model` by default."""
    names = []
    programs: dict[tuple[str, str], Any] = {}
    for backend in _loadable(model):
        step = accepted(model, backend, None)
        if step is None:
            continue
        problem: Any = step
        if not isinstance(step, backend.accepts):
            key = step.kind, default_formulation(step, backend)
            if key not in programs:
                try:
                    programs[key] = step.formulate(key[1]).program
                except UnsupportedFormulation:
                    programs[key] = None
            problem = programs[key]
        if problem is not None and not backend.refuses(problem):
            names.append(backend.name)
    return tuple(names)


def _takers(model: Model[Any], formulation: str | None) -> Iterator[tuple[Backend, Model[Any]]]:
    """Yield the backends that ``"auto"`` may mean, in order, each with the model that it takes."""
    for backend in _loadable(model):
        step = accepted(model, backend, formulation)
        if step is None or backend.sees_hidden:
            continue
        if formulation is None and isinstance(step, backend.accepts) and backend.refuses(step):
            continue
        yield backend, step


def exact(model: Model[Any], formulation: str | None = None) -> Iterator[Backend]:
    """Yield the exact backends that are installed and take `model`, the recommended one first."""
    for backend, _ in _takers(model, formulation):
        if backend.guarantee is Guarantee.EXACT:
            yield backend


def native_heuristics(model: Model[Any]) -> Iterator[Backend]:
    """Yield the installed heuristics that take `model` itself."""
    for backend, step in _takers(model, None):
        native = step is model and isinstance(model, backend.accepts)
        if native and backend.guarantee is Guarantee.HEURISTIC:
            yield backend


def recommended(model: Model[Any], formulation: str | None = None) -> Backend:
    """Return the backend that ``"auto"`` means for `model`.

    That is the model's preferred backend, or the first exact one that is installed, or one that
    finds plans and proves bounds, or the one with the best guarantee. It raises
    :class:`UnsupportedFormulation` if no installed backend accepts the model.
    """
    best: Backend | None = None
    order = [Guarantee.LOCAL, Guarantee.HEURISTIC, Guarantee.RELAXATION]

    def rank(one: Backend) -> int:
        finds = Feature.INCUMBENTS in one.features
        return -1 if finds and one.guarantee in PROVING else order.index(one.guarantee)

    if formulation is None and model.preferred_backend:
        for backend, step in _takers(model, None):
            native = isinstance(step, backend.accepts)
            if native and step is model and backend.name == model.preferred_backend:
                return backend
    for backend, step in _takers(model, formulation):
        program = formulation is None and not isinstance(step, backend.accepts)
        if program and best is not None and step.prefers_native:
            continue
        if backend.guarantee is Guarantee.EXACT:
            return backend
        if best is None or rank(backend) < rank(best):
            best = backend
    if best is None:
        what = f"formulation {formulation!r} of " if formulation else ""
        raise UnsupportedFormulation(f"no installed backend accepts {what}model {model.kind!r}")
    return best
