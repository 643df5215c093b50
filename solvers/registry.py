"""Which backends there are: a static table, strangers' entry points, and a session's own."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from ..errors import BackendBroken, InvalidData, UnknownName, UnsupportedFormulation
from ..models.model import Model, resolve
from .backend import Backend, Guarantee

__all__ = [
    "BackendState",
    "accepted",
    "backend_names",
    "backend_states",
    "default_formulation",
    "find_backend",
    "fitting",
    "recommended",
    "register_backend",
    "rivals",
]

#: Entry-point group in which other distributions announce backends.
GROUP = "crosstrack.backends"

#: Our own backends, native algorithms first and each kind in order of preference: the first
#: exact one that is installed and accepts a problem is what ``"auto"`` takes.
_TABLE: Mapping[str, str] = {
    "label-setting": ".solvers.error_correction.label_setting:LabelSetting",
    "two-stage": ".solvers.error_correction.two_stage:TwoStage",
    "pulse": ".solvers.error_correction.pulse:Pulse",
    "dynamic-programming": ".solvers.error_correction.dynamic_programming:DynamicProgramming",
    "labelling": ".solvers.error_correction.labelling:Labelling",
    "banded": ".solvers.minimum_snap.direct:Banded",
    "interior-point": ".solvers.minimum_snap.interior_point:InteriorPoint",
    "time-gradient": ".solvers.minimum_snap.time_gradient:TimeGradient",
    "time-trapezoid": ".solvers.minimum_snap.time_heuristics:TimeTrapezoid",
    "time-distance": ".solvers.minimum_snap.time_heuristics:TimeDistance",
    "time-simplex": ".solvers.minimum_snap.time_simplex:TimeSimplex",
    "slew-pseudo-inverse": ".solvers.satellite_slew.eigenaxis:PseudoInverseSteering",
    "slew-singularity-robust": ".solvers.satellite_slew.eigenaxis:SingularityRobust",
    "slew-generalised": ".solvers.satellite_slew.eigenaxis:Generalised",
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

_session: dict[str, Backend] = {}


def register_backend(backend: Backend | type[Backend]) -> Backend | type[Backend]:
    """Make a backend known by its name in this session; usable as a class decorator.

    Workers receive it with their jobs, so it needs no installation. A distribution announces its
    backends in the entry-point group ``crosstrack.backends`` instead.
    """
    instance = backend() if isinstance(backend, type) else backend
    if not isinstance(instance, Backend):
        raise InvalidData(
            f"a backend must be a subclass of Backend, got {backend!r}", field="backend"
        )
    _session[instance.name] = instance
    return backend


@cache
def _entry_points() -> dict[str, importlib.metadata.EntryPoint]:
    """Read once: looking through all installed distributions takes milliseconds."""
    return {point.name: point for point in importlib.metadata.entry_points(group=GROUP)}


def backend_names() -> tuple[str, ...]:
    """Return the names of all backends, ours first."""
    return tuple(dict.fromkeys([*_TABLE, *_entry_points(), *_session]))


def find_backend(backend: str | Backend) -> Backend:
    """Return the backend called `backend`; a backend object is returned as it is.

    Raises
    ------
    UnknownName
        No backend bears the name.
    BackendBroken
        Its own code cannot be loaded; the cause is named.
    """
    if isinstance(backend, Backend):
        return backend
    if not isinstance(backend, str):
        raise InvalidData(f"backend must be a name or a Backend, got {backend!r}", field="backend")
    if backend in _session:
        return _session[backend]
    point = None if backend in _TABLE else _entry_points().get(backend)
    if point is None and backend not in _TABLE:
        raise UnknownName("backend", backend, backend_names())
    try:
        loaded = resolve(_TABLE[backend]) if point is None else point.load()
    except Exception as error:
        where = _TABLE[backend] if point is None else point.value
        raise BackendBroken(
            f"backend {backend!r} ({where}) cannot be loaded: {type(error).__name__}: {error}"
        ) from error
    instance = loaded() if isinstance(loaded, type) else loaded
    if not isinstance(instance, Backend):
        raise BackendBroken(f"backend {backend!r} is no Backend but {type(instance).__name__}")
    return instance


@dataclass(frozen=True)
class BackendState:
    """What is known of a backend without importing its solver.

    ``state`` is ``"installed"``, ``"missing"`` or ``"broken"``; ``cause`` says why it is not the
    first. Whether an installed one really loads is found in a worker
    (:func:`crosstrack.solvers.worker.probe`).
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

    def to_dict(self) -> dict[str, Any]:
        """Return the state as JSON data."""
        return {
            "name": self.name,
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
    return tuple(_state(name) for name in backend_names())


def _state(name: str) -> BackendState:
    try:
        backend = find_backend(name)
        missing = backend.missing()
        backend_version = backend.version()
    except (BackendBroken, ImportError) as error:
        return BackendState(name, "broken", str(error))
    cause = ""
    if missing:
        how = f"crosstrack[{backend.extra}]" if backend.extra else " ".join(missing)
        cause = f"pip install '{how}'"
    return BackendState(
        name=name,
        state="missing" if missing else "installed",
        cause=cause,
        version=backend_version,
        accepts=backend.accepts.kind or backend.accepts.__name__,
        guarantee=str(backend.guarantee),
        features=tuple(sorted(str(feature) for feature in backend.features)),
        options={key: option.help for key, option in backend.options.items()},
        summary=backend.summary,
    )


def rivals(backend: Backend) -> frozenset[str]:
    """Return the native modules that break `backend` when they are loaded in its process."""
    found: set[str] = set()
    if backend.conflict_group:
        for name in backend_names():
            try:
                other = find_backend(name)
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
    return model.default_formulation if model.default_formulation in names else names[0]


def fitting(model: Model[Any]) -> tuple[str, ...]:
    """Return the names of the installed backends that can take `model` by default."""
    names = []
    for state in backend_states():
        if state.state != "installed":
            continue
        backend = find_backend(state.name)
        step = accepted(model, backend, None)
        if step is None:
            continue
        problem: Any = step
        if not isinstance(step, backend.accepts):
            try:
                problem = step.formulate(default_formulation(step, backend)).program
            except UnsupportedFormulation:
                continue
        if not backend.refuses(problem):
            names.append(state.name)
    return tuple(names)


def recommended(model: Model[Any], formulation: str | None = None) -> Backend:
    """Return the backend that ``"auto"`` means for `model`: the first exact one that is installed.

    Raises
    ------
    UnsupportedFormulation
        No installed backend accepts the model.
    """
    best: Backend | None = None
    order = [Guarantee.EXACT, Guarantee.LOCAL, Guarantee.HEURISTIC, Guarantee.RELAXATION]
    for name in backend_names():
        try:
            backend = find_backend(name)
        except BackendBroken:
            continue  # a stranger's broken backend must not stop the others; lists show it
        step = accepted(model, backend, formulation)
        if backend.missing() or step is None:
            continue
        if formulation is None and isinstance(step, backend.accepts) and backend.refuses(step):
            continue
        if backend.guarantee is Guarantee.EXACT:
            return backend
        if best is None or order.index(backend.guarantee) < order.index(best.guarantee):
            best = backend
    if best is None:
        what = f"formulation {formulation!r} of " if formulation else ""
        raise UnsupportedFormulation(f"no installed backend accepts {what}model {model.kind!r}")
    return best
