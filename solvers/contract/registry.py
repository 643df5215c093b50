"""Registry of backends: a static table, entry points of other packages, and the session's own."""

from __future__ import annotations

import contextlib
import importlib.metadata
import logging
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from ...errors import BackendBroken, InvalidData, UnknownName
from ...lazy import moved
from ...models.fields import show
from ...models.model import Model
from ...models.problems import declared_in, resolve
from .backend import Backend

log = logging.getLogger("crosstrack")

__all__ = [
    "Declaration",
    "accepted",
    "backend_names",
    "declarations",
    "default_formulation",
    "find_backend",
    "fits_integrality",
    "installed",
    "integral_solvers",
    "integrality_refusal",
    "is_ours",
    "is_plain",
    "rivals",
    "session",
    "shares_process",
]

if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt name
    __getattr__ = moved(
        __name__,
        {
            ".registration": "register_backend",
            ".selection": "fitting guaranteed recommended",
            ".states": "BackendState backend_states",
        },
    )

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
    "sqpmethod": ".solvers.nlp.plugins:SqpMethod",
    "sleqp": ".solvers.nlp.plugins:Sleqp",
    "blocksqp": ".solvers.nlp.plugins:BlockSqp",
    "bonmin": ".solvers.nlp.plugins:Bonmin",
    "slsqp": ".solvers.nlp.scipy_nlp:Slsqp",
    "trust-constr": ".solvers.nlp.scipy_nlp:TrustConstr",
}

#: Kinds of programs whose field ``integral`` is optional.
_OPTIONAL = ("quadratic-program", "nonlinear-program")

_session: list[Backend] = []


def session() -> list[Backend]:
    """Return the backends registered in this session."""
    return _session


@dataclass(frozen=True)
class Declaration:
    """Declaration of a backend: its name, the problem of a native algorithm, and its target."""

    name: str
    problem: str
    target: Any

    @property
    def is_imported(self) -> bool:
        """Whether the module of the backend is imported, or the backend is an object."""
        target = self.target
        return not isinstance(target, str) or target.partition(":")[0] in sys.modules

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
def installed() -> tuple[Declaration, ...]:
    """Return the declared backends. Cached: reading all installed distributions takes milliseconds."""
    native = [
        Declaration(name, problem, target)
        for problem, name, target in declared_in(__package__.rpartition(".")[0], "BACKENDS")
    ]
    ours = [Declaration(name, "", target) for name, target in _SOLVERS.items()]
    taken = {entry.name for entry in ours}
    points = importlib.metadata.entry_points(group=GROUP)
    external = {point.name: Declaration(point.name, "", point) for point in points}
    for name in taken & set(external):
        log.warning("backend %r of %s is ignored: the name is taken", name, external[name].target)
    return (*native, *ours, *(entry for name, entry in external.items() if name not in taken))


def declarations(name: str | None = None) -> Sequence[Declaration]:
    """Return all backends, or those called `name`, with those of the session last."""
    known = (*installed(), *(Declaration(entry.name, entry.problem, entry) for entry in _session))
    return known if name is None else [entry for entry in known if entry.name == name]


def backend_names() -> tuple[str, ...]:
    """Return the names of all backends, native algorithms first."""
    return tuple(dict.fromkeys(entry.name for entry in declarations()))


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
    matches = declarations(backend)
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


def is_plain(backend: Backend) -> bool:
    """Return True if `backend` belongs to crosstrack and loads no solver: it cannot print or crash."""
    return is_ours(backend) and not backend.requires and not backend.natives


def is_ours(backend: Backend) -> bool:
    """Return True if `backend` belongs to crosstrack. Others may change the models they receive."""
    return type(backend).__module__.partition(".")[0] == __name__.partition(".")[0]


def shares_process(backend: Backend) -> bool:
    """Return True if a run of `backend` may use the process that has the hidden data of its model.

    The class must declare it and be listed in a table of crosstrack. A class of another package, a subclass, a
    class with the module and name of another one, and an instance with attributes of its own run in a process
    without the hidden data.
    """
    kind = type(backend)
    path = f"{kind.__module__}:{kind.__qualname__}"
    is_declared = is_ours(backend) and path in [
        one.target for one in installed() if isinstance(one.target, str)
    ]
    # The methods of the dictionary and of the name may be those of a user's class.
    has_own = dict.keys(vars(backend)) - {"problem"} or type(backend.problem) is not str
    return kind.shares_process and is_declared and not has_own and resolve(path) is kind


def rivals(backend: Backend) -> frozenset[str]:
    """Return the native modules that conflict with `backend` in one process.

    Native algorithms that are not imported are skipped: they have loaded no library, and importing those
    of all problems takes most of the time of a first run.
    """
    modules: set[str] = set()
    if backend.conflict_group:
        for declared in declarations():
            if declared.problem and not declared.is_imported:
                continue
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
        native = isinstance(step, backend.accepts) and formulation is None
        if native and fits_integrality(step, backend):
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
        and issubclass(kind := type(model).formulation_type(name).program_type, backend.accepts)
        and kind.kind not in backend.integral_only
    ]


def default_formulation(model: Model[Any], backend: Backend) -> str:
    """Return the formulation of `model` that `backend` solves, preferably the model's default."""
    names = _formulations(model, backend, None)
    return model.preferred_formulation if model.preferred_formulation in names else names[0]


def _optional_kind(problem: Any) -> str:
    """Return the kind of a program whose field ``integral`` is optional; ``""`` for other models."""
    kinds = (getattr(base, "kind", "") for base in type(problem).__mro__)
    return next((kind for kind in kinds if kind in _OPTIONAL), "")


def fits_integrality(problem: Any, backend: Backend) -> bool:
    """Return False if `backend` would ignore integral columns of `problem`, or requires some.

    Parameters
    ----------
    problem : Model
        Any model; only programs with an optional field ``integral`` can fail.
    backend : Backend
        The backend, with its :attr:`~.Backend.integral_kinds` and :attr:`~.Backend.integral_only`.
    """
    kind = _optional_kind(problem)
    if not kind:
        return True
    return (
        kind not in backend.integral_only if problem.continuous else kind in backend.integral_kinds
    )


def integral_solvers(problem: Any) -> str:
    """Return the backends for a program with integral columns as text, with commands to install them.

    The text is empty for other models.
    """
    kind = _optional_kind(problem)
    if not kind or problem.continuous:
        return ""
    names = []
    for declared in declarations():
        with contextlib.suppress(BackendBroken):
            solver = declared.load()
            if kind in solver.integral_kinds and not solver.refuses(problem):
                hint = f" (pip install 'crosstrack[{solver.extra}]')" if solver.missing() else ""
                names.append(f"{solver.name!r}{hint}")
    count = int(problem.integral.sum())
    return f"{count} of its {problem.size} columns must be integers, which these backends respect: {', '.join(names)}"


def integrality_refusal(problem: Any, backend: Backend) -> str:
    """Return why the integral columns of `problem` exclude `backend`; ``""`` if they do not."""
    if fits_integrality(problem, backend):
        return ""
    if problem.continuous:
        return f"backend {backend.name!r} solves a {problem.kind!r} only if a column is integral"
    return (
        f"backend {backend.name!r} cannot solve this {problem.kind!r}: {integral_solvers(problem)}"
    )
