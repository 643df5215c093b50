"""Registry of backends: a static table, entry points of other packages, and the session's own."""

from __future__ import annotations

import contextlib
import importlib.metadata
import itertools
import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from ...errors import BackendBroken, InvalidData, UnknownName, UnsupportedFormulation
from ...models.fields import show
from ...models.model import Model
from ...models.problems import PROBLEMS, declared_in, problem_of, resolve
from .backend import PROVING, Backend, Feature, Guarantee

log = logging.getLogger("crosstrack")

__all__ = [
    "BackendState",
    "accepted",
    "backend_names",
    "backend_states",
    "default_formulation",
    "find_backend",
    "fitting",
    "guaranteed",
    "is_ours",
    "is_plain",
    "recommended",
    "register_backend",
    "rivals",
]

#: Entry-point group in which other distributions announce backends.
GROUP = "crosstrack.backends"

#: Solvers of programs, each kind in order of preference, after the native algorithms of all
#: problems. ``"auto"`` selects the first installed exact backend that accepts the model.
_SOLVERS: Mapping[str, str] = {
    # Before HiGHS, whose quadratic solver is slower and failed on flat objectives.
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
    "uno": ".solvers.nlp.plugins:Uno",
    "fatrop": ".solvers.nlp.plugins:Fatrop",
    "sqpmethod": ".solvers.nlp.sqpmethod:SqpMethod",
    "sleqp": ".solvers.nlp.plugins:Sleqp",
    "blocksqp": ".solvers.nlp.plugins:BlockSqp",
    "bonmin": ".solvers.nlp.plugins:Bonmin",
    "slsqp": ".solvers.nlp.scipy_nlp:Slsqp",
    "trust-constr": ".solvers.nlp.scipy_nlp:TrustConstr",
}

_session: list[Backend] = []


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
    """Return the types that `backend` accepts as a tuple."""
    types = backend.accepts
    return types if isinstance(types, tuple) else (types,)


def _shared(backend: Backend, other: Backend) -> str:
    """Return the kind of a problem that both backends accept; empty if they share none."""
    for entry, two in itertools.product(_accepted_types(backend), _accepted_types(other)):
        if issubclass(entry, two) or issubclass(two, entry):
            return repr(getattr(entry, "kind", entry.__name__))
    return ""


def _problem(backend: Backend) -> str:
    """Return the problem whose models `backend` accepts; empty for programs or several problems."""
    owners = {problem_of(getattr(kind, "kind", "")) for kind in _accepted_types(backend)}
    return owners.pop() if len(owners) == 1 else ""


@dataclass(frozen=True)
class _Declared:
    """Declaration of a backend: its name, the problem of a native algorithm, and its target."""

    name: str
    problem: str
    target: Any

    def load(self) -> Backend:
        """Return the backend; raise ``BackendBroken`` with the cause if it cannot be loaded."""
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
                f"backend {self.name!r} must be a Backend, got {type(instance).__name__}"
            )
        instance.problem = self.problem
        return instance


@cache
def _installed() -> tuple[_Declared, ...]:
    """Return the declared backends. Cached: reading all installed distributions takes milliseconds."""
    native = [
        _Declared(name, problem, target)
        for problem, name, target in declared_in(__package__.rpartition(".")[0], "BACKENDS")
    ]
    ours = [_Declared(name, "", target) for name, target in _SOLVERS.items()]
    taken = {entry.name for entry in ours}
    points = importlib.metadata.entry_points(group=GROUP)
    external = {point.name: _Declared(point.name, "", point) for point in points}
    for name in taken & set(external):
        log.warning("backend %r of %s is ignored: the name is taken", name, external[name].target)
    return (*native, *ours, *(entry for name, entry in external.items() if name not in taken))


def _declared(name: str | None = None) -> Sequence[_Declared]:
    """Return all backends, or those called `name`, with those of the session last."""
    known = (*_installed(), *(_Declared(entry.name, entry.problem, entry) for entry in _session))
    return known if name is None else [entry for entry in known if entry.name == name]


def backend_names() -> tuple[str, ...]:
    """Return the names of all backends, native algorithms first."""
    return tuple(dict.fromkeys(entry.name for entry in _declared()))


def find_backend(
    backend: str | Backend, model: Model[Any] | None = None, *, problem: str | None = None
) -> Backend:
    """Return a backend by name; a backend object is returned unchanged.

    Parameters
    ----------
    backend : str or Backend
        Name of the backend. Native algorithms of several problems may share a name.
    model : Model, optional
        Model to solve. Selects the backend that accepts it if several share the name.
    problem : str, optional
        Name of a problem, instead of a model. Selects its native algorithm, or the first backend
        of that name if the problem has none.

    Raises
    ------
    UnknownName
        No backend has the name.
    InvalidData
        Several problems have a backend of that name, and no model is given.
    BackendBroken
        The code of the backend cannot be loaded; the message gives the cause.
    """
    if isinstance(backend, Backend):
        return backend
    if not isinstance(backend, str):
        raise InvalidData(
            f"backend must be a name or a Backend, got {show(backend)}", field="backend"
        )
    matches = _declared(backend)
    if not matches:
        raise UnknownName("backend", backend, backend_names())
    if problem is not None:
        matches = [entry for entry in matches if entry.problem == problem] or matches[:1]
    if len(matches) == 1:
        return matches[0].load()
    if model is None:
        raise InvalidData(
            f"backend {backend!r} belongs to each of the problems "
            f"{', '.join(entry.problem or 'programs' for entry in matches)}: name it together with a model",
            field="backend",
        )
    loaded: list[Backend] = []
    for entry in matches:
        try:
            loaded.append(entry.load())
        except BackendBroken as error:  # it may be the backend of another problem
            log.warning("%s", error)
    if not loaded:
        raise BackendBroken(f"no backend {backend!r} can be loaded")
    suitable = [candidate for candidate in loaded if accepted(model, candidate, None) is not None]
    for other in suitable[1:]:
        if not is_ours(other):
            log.warning("backend name %r: %s is used, not %s", backend, suitable[0], other)
    return suitable[0] if suitable else loaded[0]


@dataclass(frozen=True)
class BackendState:
    """Description of a backend, available without importing its solver.

    Parameters
    ----------
    name : str
        Name of the backend.
    state : str
        ``"installed"``, ``"missing"`` or ``"broken"``. Whether an installed backend really loads
        is tested by :func:`crosstrack.solvers.run.probing.probe`.
    cause : str
        Reason if it is not installed, such as the command that installs it.
    version : str, optional
        Version of the solver.
    accepts, guarantee, features, summary, problem, requires
        As in :class:`Backend`.
    options : mapping of str to str, optional
        Help text of each option.
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
    """Return the state of every backend. Missing and broken backends are included."""
    return tuple(map(_state, _declared()))


def _state(declared: _Declared) -> BackendState:
    name = declared.name
    try:
        backend = declared.load()
        missing = backend.missing()
        backend_version = backend.version()
    except (BackendBroken, ImportError) as error:
        return BackendState(name, "broken", str(error), problem=declared.problem)
    how = f"crosstrack[{backend.extra}]" if backend.extra else " ".join(missing)
    return BackendState(
        name=name,
        state="missing" if missing else "installed",
        cause=f"pip install '{how}'" if missing else "",
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
    """Return True if `backend` belongs to crosstrack and loads no solver: it cannot print or crash."""
    return is_ours(backend) and not backend.requires and not backend.natives


def is_ours(backend: Backend) -> bool:
    """Return True if `backend` belongs to crosstrack. Others may change the models they receive."""
    return type(backend).__module__.partition(".")[0] == __name__.partition(".")[0]


def rivals(backend: Backend) -> frozenset[str]:
    """Return the native modules that conflict with `backend` in one process."""
    modules: set[str] = set()
    if backend.conflict_group:
        for declared in _declared():
            with contextlib.suppress(BackendBroken):  # one that cannot be loaded cannot conflict
                other = declared.load()
                if other.conflict_group == backend.conflict_group:
                    modules.update(other.natives)
    return frozenset(modules - set(backend.natives))


def accepted(model: Model[Any], backend: Backend, formulation: str | None) -> Model[Any] | None:
    """Return the first model in the chain of ``lower()`` that `backend` accepts; None if there is none.

    A backend accepts a model of its type, or one that has `formulation` (None: any formulation) of
    its program type.
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
    """Return the formulation of `model` that `backend` solves, preferably the model's default."""
    names = _formulations(model, backend, None)
    return model.preferred_formulation if model.preferred_formulation in names else names[0]


def _problems(model: Model[Any]) -> set[str]:
    """Return the problems whose native algorithms may accept `model` itself."""
    return {problem_of(getattr(base, "kind", "")) for base in type(model).__mro__} - {""}


def _candidates(model: Model[Any]) -> Iterator[_Declared]:
    """Yield the backends that may accept `model` or a lowered model, those of its problem first.

    The model is lowered only if more are needed, because building the general model can be slow.
    """
    own = _problems(model)
    yield from (entry for entry in _declared() if entry.problem in own)
    general, step = set(own), model.lower()
    has_program = bool(model.formulations) or own.isdisjoint(PROBLEMS)
    while step is not None:
        general |= _problems(step)
        has_program |= bool(step.formulations)
        step = step.lower()
    # Backends of other problems are not loaded, because they may import further libraries.
    others = set(PROBLEMS) - general | own
    for entry in _declared():
        is_solver = not entry.problem and isinstance(entry.target, str)  # of programs
        if entry.problem not in others and (has_program or not is_solver):
            yield entry


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
    """Yield the backends that ``"auto"`` may select, in order, with the model each one solves."""
    for backend in _loadable(model):
        step = accepted(model, backend, formulation)
        if step is None or backend.sees_hidden:
            continue
        if formulation is None and isinstance(step, backend.accepts) and backend.refuses(step):
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
    plans and proves bounds, else the one with the best guarantee. It raises
    :class:`UnsupportedFormulation` if no installed backend accepts the model.
    """
    best: Backend | None = None
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
        if backend.guarantee is Guarantee.EXACT:
            return backend
        if best is None or rank(backend) < rank(best):
            best = backend
    if best is None:
        what = f"formulation {formulation!r} of " if formulation else ""
        raise UnsupportedFormulation(f"no installed backend accepts {what}model {model.kind!r}")
    return best
