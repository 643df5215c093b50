"""Base of every model: declared data, exact JSON, a digest, formulations and a verification."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from operator import itemgetter
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import HiddenData, InvalidData, UnknownName, UnsupportedFormulation
from ..lazy import moved
from .declaration import Declared, Plan
from .problems import model_type, resolve
from .specs import TRUSTED, Text, required, show
from .verification import TOLERANCE, Verification

__all__ = ["Model"]

if not TYPE_CHECKING:
    __getattr__ = moved(__name__, {".json_text": "parse_json", ".conversion": "as_model"})

PlanT = TypeVar("PlanT")


@dataclass(frozen=True, eq=False)
class Model(Declared, ABC, Generic[PlanT]):
    """Planning problem: its data, and how plans for it are written and verified.

    Subclasses are frozen dataclasses with ``eq=False`` whose fields are declared with a
    :class:`~crosstrack.models.fields.Spec`; :class:`~crosstrack.models.declaration.Declared` copies,
    coerces, checks and freezes them.

    Parameters
    ----------
    name : str
        Label of the instance, which is not part of the content.

    Attributes
    ----------
    kind : str
        The model's name in JSON and on the command line.
    formulations : dict of str to (str or type)
        Formulation classes by name, lazily as ``"module:class"``; ``"paper"`` is the paper's own.
    default_formulation : str
        Name of the formulation used by default.
    objective_unit : str
        Unit of the objective, which is always minimised.
    agreement : float, optional
        Largest :meth:`distance` at which two plans agree, for models without provable bounds, such
        as estimation; None if plans are compared by bounds alone.
    certified_distance : float
        Largest :meth:`distance` to the certified plan at which a plan is accepted as optimal.
    rivals : bool
        Whether all backends solve the same task, so that objectives can be ranked. False if each
        estimates another quantity; comparisons then rank no backend by its objective.
    plan_type : type
        Required type of plans; ``object`` accepts any.
    has_variables : bool
        Whether a plan is a vector of variables, whose values are printed by name.
    second_objectives : dict of str to str
        Second objectives for :func:`crosstrack.front`: the name, and the field that limits it.
    second_steps : dict of str to float
        Spacing of the values of a second objective if all are multiples of it, such as 1 for a
        number of stops.
    """

    # Written out because type checkers would take declared() for a positional argument.
    name: str = dataclasses.field(default="", kw_only=True, metadata={"spec": Text(content=False)})

    if TYPE_CHECKING:

        @property
        def maximise(self) -> bool:
            """Whether printed results negate the objective; programs declare it as a field."""

    else:
        maximise = False

    kind: ClassVar[str] = ""
    formulations: ClassVar[dict[str, Any]] = {}
    default_formulation: ClassVar[str] = ""
    objective_unit: ClassVar[str] = ""
    agreement: ClassVar[float | None] = None
    certified_distance: ClassVar[float] = math.inf
    rivals: ClassVar[bool] = True
    plan_type: ClassVar[type] = object
    has_variables: ClassVar[bool] = False
    second_objectives: ClassVar[dict[str, str]] = {}
    second_steps: ClassVar[dict[str, float]] = {}

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        cls.formulations = dict(cls.formulations)

    def __getstate__(self) -> dict[str, Any]:
        names = (field.name for field in dataclasses.fields(self))
        state = {name: self.__dict__[name] for name in names if name in self.__dict__}
        # The digest covers the hidden fields, so a blinded model cannot compute it.
        return {**state, "digest": self.digest} if self.is_blinded else state

    @property
    def certifier(self) -> str:
        """Name of the exact backend whose plan is compared with the optimal plans of other backends.

        It is for models whose objective does not determine the shape of the plan; empty for no
        comparison.
        """
        return ""

    # -- what backends must not see --------------------------------------------------------------

    @classmethod
    def hidden_fields(cls) -> tuple[str, ...]:
        """Return the names of the fields that backends do not receive."""
        fields = dataclasses.fields(cls)
        return tuple(field.name for field in fields if field.metadata.get("hidden"))

    @property
    def is_blinded(self) -> bool:
        """Whether this is the view for backends, which lacks the hidden fields."""
        return any(name not in self.__dict__ for name in self.hidden_fields())

    def blinded(self) -> Self:
        """Return the view for backends: the model without its hidden fields, with its digest.

        Reading a hidden field of the view raises :class:`~crosstrack.errors.HiddenData`. A model
        without hidden fields is returned unchanged.
        """
        hidden = self.hidden_fields()
        if not hidden or self.is_blinded:
            return self
        view = object.__new__(type(self))
        for field in dataclasses.fields(self):
            if field.name not in hidden:
                view.__dict__[field.name] = self.__dict__[field.name]
        view.__dict__["digest"] = self.digest
        return view

    def oracle(self) -> Callable[[NDArray[np.float64]], NDArray[np.float64]] | None:
        """Return the function through which backends query the hidden data, or None.

        It runs in the process that holds the hidden data and is created for each run, so it may count
        queries. Queries and answers are tables of numbers, such as points and their values. Backends
        call :meth:`crosstrack.solvers.Control.ask`. An exception of the function ends the run. An
        optional method ``contradiction(plan)`` returns how the plan differs from what the run did, or
        an empty result; a plan that differs is rejected.
        """
        return None

    if not TYPE_CHECKING:  # otherwise type checkers would accept every misspelt attribute

        def __getattr__(self, name: str) -> Any:
            if name in self.__dataclass_fields__ and self.is_blinded:
                raise HiddenData(f"{name} of model {self.kind!r} is hidden from backends")
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    # -- JSON ------------------------------------------------------------------------------------

    def data(self) -> dict[str, Any]:
        """Return the content as JSON data (no NaN, no infinity)."""
        result = super().data()
        del result["name"]
        return result

    @classmethod
    def from_data(cls, data: Any, *, name: str = "") -> Self:
        """Return the model that :meth:`data` wrote; unknown and missing keys raise."""
        return cls._from_data(data, name=name)

    @classmethod
    def _label(cls) -> str:
        return f"model {cls.kind!r}"

    def to_dict(self) -> dict[str, Any]:
        """Return ``{"model": kind, "name": …, "data": {…}}``."""
        return {"model": self.kind, "name": self.name, "data": self.data()}

    def to_json(self, *, indent: int | None = None) -> str:
        """Return the model as exact JSON: reading it gives the same digest."""
        return json.dumps(self.to_dict(), indent=indent, allow_nan=False, ensure_ascii=False)

    @staticmethod
    def from_dict(data: Any, *, trusted: bool = False) -> Model[Any]:
        """Return the model of any kind that :meth:`to_dict` wrote.

        Parameters
        ----------
        data : mapping
            The model's kind, name and data.
        trusted : bool
            Whether you trust the author. Only then are functions in CasADi's text format read, which
            can run code; a separate process reads them first.

        Returns
        -------
        Model
            The model.

        Raises
        ------
        InvalidData
            The data are not a model's.
        UnknownName
            The kind is unknown.
        """
        if not isinstance(data, Mapping):
            raise InvalidData(f"a model must be an object, got {show(data)}", field="model")
        for key in data:
            if key not in ("model", "name", "data"):
                raise InvalidData(
                    f"unknown key {key!r} beside the model's data; allowed: model, name, data",
                    field=str(key),
                )
        for key in ("model", "data"):
            if key not in data:
                raise InvalidData(
                    f"key {key!r} is missing: a model is {{'model', 'data'}}", field=key
                )
        kind = Text().coerce("model", data["model"], {})
        name = Text().coerce("name", data.get("name", ""), {})
        token = TRUSTED.set(trusted)
        try:
            result: Model[Any] = model_type(kind).from_data(data["data"], name=name)
        finally:
            TRUSTED.reset(token)
        return result

    @staticmethod
    def from_json(text: str, *, trusted: bool = False) -> Model[Any]:
        """Return the model of any kind that :meth:`to_json` wrote; see :meth:`from_dict`."""
        from .json_text import parse_json

        return Model.from_dict(parse_json(text), trusted=trusted)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the content in hexadecimal, independent of the name."""
        hasher = hashlib.sha256(self.kind.encode())
        for name, spec, value in sorted(self._content(), key=itemgetter(0)):
            if spec.content:
                hasher.update(f"\0{name}\0".encode())
                for chunk in spec.feed(value):
                    hasher.update(chunk)
        return hasher.hexdigest()

    def __eq__(self, other: object) -> bool:
        """Return whether `other` has the same type and content; names are ignored."""
        if not isinstance(other, Model):
            return NotImplemented
        return self is other or (type(self) is type(other) and self.digest == other.digest)

    def __hash__(self) -> int:
        return hash((self.kind, self.digest))

    def renamed(self, name: str) -> Self:
        """Return the same model under another name."""
        return dataclasses.replace(self, name=name)

    def scene_seeds(self, count: int) -> list[int]:
        """Return `count` seeds derived from the digest, for objectives measured on random scenes.

        The scenes of a model are therefore the same everywhere, and no backend can choose them.
        """
        sequence = np.random.SeedSequence(int(self.digest[:32], 16))
        return [int(seed) for seed in sequence.generate_state(count, np.uint64)]

    # -- plans -----------------------------------------------------------------------------------

    @abstractmethod
    def verify(self, plan: PlanT, *, tolerance: float = TOLERANCE) -> Verification:
        """Return the objective and every constraint, recomputed from the raw data.

        Parameters
        ----------
        plan : PlanT
            Plan for this model, from any source.
        tolerance : float
            Largest accepted violation, relative to the scale that each check names; > 0 and < 1.

        Returns
        -------
        Verification
            One check per constraint, and the objective.

        Raises
        ------
        InvalidData
            `plan` is not a plan for this model.
        UnsupportedOption
            `tolerance` is not a number > 0 and < 1.
        """

    def plan_to_data(self, plan: PlanT) -> Any:
        """Return `plan` as JSON data, by default that of a :class:`~.declaration.Plan`."""
        return required("plan", plan, Plan).data()

    def plan_from_data(self, data: Any) -> PlanT:
        """Return the plan that :meth:`plan_to_data` wrote; invalid data raise ``InvalidData``."""
        if not issubclass(self.plan_type, Plan):
            raise InvalidData(
                f"model {self.kind!r} cannot read a plan: its plan_type must be a Plan, got "
                f"{self.plan_type.__name__}; or define plan_from_data",
                field="plan",
            )
        plan: Any = self.plan_type.from_data(data)
        result: PlanT = plan
        return result

    def details(self, plan: PlanT) -> list[dict[str, Any]]:
        """Return details of `plan` row by row, such as one row per stop, as JSON data.

        All rows have the same names. Empty if the model has no details beyond the plan.
        """
        return []

    @classmethod
    def remark(cls, plan: PlanT) -> str:
        """Return a few words about `plan` to print after its objective, or an empty string."""
        return ""

    def values_of(self, plan: PlanT) -> dict[str, Any]:
        """Return the parts of `plan` by name: for a declared plan its fields."""
        required("plan", plan, Plan)
        return {field.name: getattr(plan, field.name) for field in dataclasses.fields(plan)}  # type: ignore[arg-type]

    def second_objective(self, name: str, plan: PlanT) -> float:
        """Return the second objective called `name` of a plan, computed from the raw data."""
        raise UnknownName(f"second objective of model {self.kind!r}", name, self.second_objectives)

    def limited(self, name: str, value: float) -> Self:
        """Return the model with the second objective called `name` limited to at most `value`.

        Existing limits that are tighter are kept.
        """
        field = self.second_objectives[name]
        current = getattr(self, field)
        limit = value if current is None else np.minimum(current, value)
        changed: dict[str, Any] = {field: limit}
        return dataclasses.replace(self, **changed)

    def distance(self, plan: PlanT, other: PlanT) -> float:
        """Return the distance between two plans, in the unit of :attr:`agreement`.

        By default 0 for equal plans and infinity for different ones.
        """
        return 0.0 if self.plan_to_data(plan) == self.plan_to_data(other) else math.inf

    def as_plan(self, value: Any) -> PlanT:
        """Return `value` as a plan of this model.

        Parameters
        ----------
        value : object
            A plan, its JSON data, or an object with a plan in its attribute ``plan``, such as a
            solution.

        Raises
        ------
        InvalidData
            `value` contains no plan.
        """
        plan = getattr(value, "plan", value)
        if plan is None:
            ended = getattr(value, "termination", None)
            raise InvalidData(f"there is no plan{f' ({ended})' if ended else ''}", field="plan")
        if isinstance(plan, Mapping | list | tuple):
            return self.plan_from_data(plan)
        result: PlanT = required("plan", plan, self.plan_type)
        return result

    # -- formulations ----------------------------------------------------------------------------

    def lower(self) -> Model[Any] | None:
        """Return the more general model that contains this one as a special case, or None.

        Plans of the two are interchangeable. A plan found for the general model is verified by this
        model.
        """
        return None

    @classmethod
    def formulation_type(cls, name: str | None = None) -> Any:
        """Return the :class:`~crosstrack.models.formulation.Formulation` class called `name`.

        Parameters
        ----------
        name : str, optional
            Name of the formulation; None for :attr:`default_formulation`.

        Raises
        ------
        UnknownName
            No formulation has this name.
        UnsupportedFormulation
            The model has no formulations.
        """
        if not cls.formulations:
            raise UnsupportedFormulation(f"model {cls.kind!r} has no formulation as a program")
        name = cls.default_formulation if name is None else name
        if not isinstance(name, str) or name not in cls.formulations:
            raise UnknownName(f"formulation of model {cls.kind!r}", name, cls.formulations)
        return resolve(cls.formulations[name])

    @property
    def preferred_formulation(self) -> str:
        """Default formulation for this instance: one of :attr:`formulations`."""
        return self.default_formulation

    @property
    def preferred_backend(self) -> str:
        """Backend that ``"auto"`` prefers for this instance; empty for the usual order."""
        return ""

    @property
    def has_program(self) -> bool:
        """Whether a formulation covers this instance; otherwise ``"auto"`` selects a native backend."""
        return True

    @property
    def prefers_native(self) -> bool:
        """Whether it is too large for program solvers: ``"auto"`` then prefers a native backend."""
        return False

    def formulate(self, name: str | None = None, **options: Any) -> Any:
        """Return this model's formulation called `name`.

        Parameters
        ----------
        name : str, optional
            Name of the formulation; None for :attr:`preferred_formulation`.
        **options
            Options of the formulation.

        Returns
        -------
        Formulation
            Instance of :meth:`formulation_type`.

        Raises
        ------
        UnknownName
            No formulation has this name.
        UnsupportedOption
            An option is unknown, or its value is not allowed.
        UnsupportedFormulation
            The formulation does not cover a feature of the model.
        """
        name = (self.preferred_formulation or None) if name is None else name
        return self.formulation_type(name).of(self, options)

    def __repr__(self) -> str:
        label = f" {self.name!r}" if self.name else ""
        return f"<{type(self).__name__}{label} {self.outline()}>"

    def outline(self) -> str:
        """Return the size of the model in one line, as ``repr`` prints it."""
        return str(self.describe())

    def describe(self) -> Any:
        """Return the size of the model in a few words; programs return a report."""
        return f"digest {self.digest[:12]}"
