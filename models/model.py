"""The base of every model: declared data, exact JSON, a digest, formulations and a verification.

A model says WHAT is asked, and nothing of how it is answered.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import HiddenData, InvalidData, UnknownName, UnsupportedFormulation
from .declaration import Declared
from .fields import TRUSTED, Text, required, show
from .json_text import parse_json
from .problems import model_type, resolve
from .verification import TOLERANCE, Verification

__all__ = ["Model", "as_model", "parse_json"]

PlanT = TypeVar("PlanT")


@dataclass(frozen=True, eq=False)
class Model(Declared, ABC, Generic[PlanT]):
    """A planning problem: its data, and how a plan for it is written and verified.

    Subclasses are frozen dataclasses with ``eq=False`` whose fields are declared with a
    :class:`~crosstrack.models.fields.Spec`; :class:`~crosstrack.models.declaration.Declared` copies,
    coerces, checks and freezes them.

    Parameters
    ----------
    name : str
        A label for people; no part of the content.

    Attributes
    ----------
    kind : str
        The model's name in JSON and on the command line.
    formulations : dict of str to (str or type)
        Formulation classes by name, lazily as ``"module:class"``; ``"paper"`` is the paper's own.
    default_formulation : str
        The one taken when none is named.
    objective_unit : str
        Unit of the objective, which is always minimised.
    agreement : float, optional
        Largest :meth:`distance` at which two plans agree, for models that no backend proves
        anything of, such as estimation; None where plans are judged by bounds alone.
    certified_distance : float
        Largest :meth:`distance` to the certified plan at which a plan is accepted as optimal.
    rivals : bool
        Whether all backends answer one question, so that one plan can be the best of all; where each
        estimates something else, comparisons rank nobody by objectives.
    plan_type : type
        What a plan must be an instance of; anything where a model does not say.
    second_objectives : dict of str to str
        What :func:`crosstrack.front` trades the objective against: names, and the field that limits
        each.
    second_steps : dict of str to float
        The least difference between two values of a second objective, for those of which all values
        are multiples of it, such as 1 for a number of stops.
    """

    # Written out, for type checkers see only through dataclasses.field that it is no position.
    name: str = dataclasses.field(default="", kw_only=True, metadata={"spec": Text(content=False)})

    kind: ClassVar[str] = ""
    formulations: ClassVar[dict[str, Any]] = {}
    default_formulation: ClassVar[str] = ""
    objective_unit: ClassVar[str] = ""
    agreement: ClassVar[float | None] = None
    certified_distance: ClassVar[float] = math.inf
    rivals: ClassVar[bool] = True
    plan_type: ClassVar[type] = object
    second_objectives: ClassVar[dict[str, str]] = {}
    second_steps: ClassVar[dict[str, float]] = {}

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        cls.formulations = dict(cls.formulations)

    def __getstate__(self) -> dict[str, Any]:
        held = (field.name for field in dataclasses.fields(self))
        state = {name: self.__dict__[name] for name in held if name in self.__dict__}
        # A model without its hidden fields cannot compute its digest again.
        return {**state, "digest": self.digest} if self.is_blinded else state

    @property
    def certifier(self) -> str:
        """Name of the exact backend whose plan other backends' optimal plans are compared with.

        For models whose objective hides the shape of the plan; empty without one.
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
        """Whether this is a backend's view, which lacks the hidden fields."""
        return any(name not in self.__dict__ for name in self.hidden_fields())

    def blinded(self) -> Self:
        """Return the model as backends receive it: without its hidden fields, with its digest.

        Reading a hidden field of it raises :class:`~crosstrack.errors.HiddenData`. A model without
        hidden fields is returned as it is.
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
        """Return what backends may ask of the hidden data during one run, None where there is nothing.

        It lives where the hidden data does, and is made anew for each run, so it may count. Questions and
        answers are tables of numbers, such as points and their values; backends ask by
        :meth:`crosstrack.solvers.Control.ask`. What it raises ends the run. Where it has a method
        ``contradiction``, that says of a plan what the run did otherwise, or nothing: such a plan is rejected.
        """
        return None

    if not TYPE_CHECKING:  # else every misspelt attribute would have a type

        def __getattr__(self, name: str) -> Any:
            if name in type(self).hidden_fields():
                raise HiddenData(f"{name} of model {self.kind!r} is hidden from backends")
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    # -- JSON ------------------------------------------------------------------------------------

    def data(self) -> dict[str, Any]:
        """Return the content as JSON data (no NaN, no infinity)."""
        found = super().data()
        del found["name"]
        return found

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
            The model's data.
        trusted : bool
            Whether you know who wrote it: functions in CasADi's own text, which can run code, are
            read then alone, by a process of its own first.
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
        if not isinstance(data["model"], str):
            raise InvalidData(f"model must be a string, got {show(data['model'])}", field="model")
        name = data.get("name", "")
        if not isinstance(name, str):
            raise InvalidData(f"name must be a string, got {show(name)}", field="name")
        token = TRUSTED.set(trusted)
        try:
            found: Model[Any] = model_type(data["model"]).from_data(data["data"], name=name)
        finally:
            TRUSTED.reset(token)
        return found

    @staticmethod
    def from_json(text: str, *, trusted: bool = False) -> Model[Any]:
        """Return the model of any kind that :meth:`to_json` wrote; `trusted` as in :meth:`from_dict`."""
        return Model.from_dict(parse_json(text), trusted=trusted)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the content, in hexadecimal; the name is no part of it."""
        hasher = hashlib.sha256(self.kind.encode())
        fields = dataclasses.fields(self)
        added = {one.name: one.default for one in fields if one.metadata.get("added")}
        for name, spec in sorted(self._specs()):
            value = getattr(self, name)
            default = added.get(name)
            known = name in added and (value is None if default is None else value == default)
            if spec.content and not known:
                hasher.update(f"\0{name}\0".encode())
                for chunk in spec.feed(value):
                    hasher.update(chunk)
        return hasher.hexdigest()

    def __eq__(self, other: object) -> bool:
        """Return whether `other` is a model of the same type and content; names do not count."""
        if not isinstance(other, Model):
            return NotImplemented
        return self is other or (type(self) is type(other) and self.digest == other.digest)

    def __hash__(self) -> int:
        return hash((self.kind, self.digest))

    def renamed(self, name: str) -> Self:
        """Return the same model under another name."""
        return dataclasses.replace(self, name=name)

    def scene_seeds(self, count: int) -> list[int]:
        """Return `count` seeds that follow from the digest, for objectives measured on drawn scenes.

        The same model is judged on the same scenes everywhere, and no backend chooses them.
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
            A plan for this model, from anywhere.
        tolerance : float
            Largest violation accepted, relative to the scale that each check names; > 0 and < 1.

        Raises
        ------
        InvalidData
            `plan` is no plan for this model.
        UnsupportedOption
            `tolerance` is no number > 0 and < 1.
        """

    @abstractmethod
    def plan_to_data(self, plan: PlanT) -> Any:
        """Return `plan` as JSON data."""

    @abstractmethod
    def plan_from_data(self, data: Any) -> PlanT:
        """Return the plan that :meth:`plan_to_data` wrote; bad data raises ``InvalidData``."""

    def details(self, plan: PlanT) -> list[dict[str, Any]]:
        """Return `plan` row by row, such as stop by stop: the same names in each row, JSON data.

        Empty where the model has nothing to show beside the plan itself.
        """
        return []

    @classmethod
    def remark(cls, plan: PlanT) -> str:
        """Return what solutions print of `plan` beside its objective: a few words, or nothing."""
        return ""

    def second_objective(self, name: str, plan: PlanT) -> float:
        """Return the second objective called `name` of a plan, from the raw data."""
        raise UnknownName(f"second objective of model {self.kind!r}", name, self.second_objectives)

    def limited(self, name: str, value: float) -> Self:
        """Return the model with the second objective called `name` limited to `value` at the most.

        Limits that the model has already stay where they are less.
        """
        field = self.second_objectives[name]
        given = getattr(self, field)
        limit = value if given is None else np.minimum(given, value)
        changed: dict[str, Any] = {field: limit}
        return dataclasses.replace(self, **changed)

    def distance(self, plan: PlanT, other: PlanT) -> float:
        """Return how far apart two plans are, in the unit of :attr:`agreement`.

        The default tells equal plans from different ones: 0 or infinity.
        """
        return 0.0 if self.plan_to_data(plan) == self.plan_to_data(other) else math.inf

    def as_plan(self, value: Any) -> PlanT:
        """Return the plan that `value` means.

        Parameters
        ----------
        value : object
            A plan, its JSON data, or whatever has a plan as its ``plan``, such as a solution.

        Raises
        ------
        InvalidData
            There is none.
        """
        plan = getattr(value, "plan", value)
        if plan is None:
            ended = getattr(value, "termination", None)
            raise InvalidData(f"there is no plan{f' ({ended})' if ended else ''}", field="plan")
        if isinstance(plan, Mapping | list | tuple):
            return self.plan_from_data(plan)
        found: PlanT = required("plan", plan, self.plan_type)
        return found

    # -- formulations ----------------------------------------------------------------------------

    def lower(self) -> Model[Any] | None:
        """Return the more general model that this one is a case of, None where there is none.

        A plan of the one is a plan of the other: whoever solves the general model, the plan is
        verified by the model that was asked.
        """
        return None

    @classmethod
    def formulation_type(cls, name: str | None = None) -> Any:
        """Return the :class:`~crosstrack.models.formulation.Formulation` class called `name`.

        None means the default one.
        """
        if not cls.formulations:
            raise UnsupportedFormulation(f"model {cls.kind!r} has no formulation as a program")
        name = cls.default_formulation if name is None else name
        if not isinstance(name, str) or name not in cls.formulations:
            raise UnknownName(f"formulation of model {cls.kind!r}", name, cls.formulations)
        return resolve(cls.formulations[name])

    @property
    def preferred_formulation(self) -> str:
        """The formulation that this very model takes when none is named: one of :attr:`formulations`."""
        return self.default_formulation

    @property
    def preferred_backend(self) -> str:
        """The backend that ``"auto"`` takes for this very model if it can; empty for the usual order."""
        return ""

    @property
    def prefers_native(self) -> bool:
        """Whether solvers of programs would hardly end on this very model, as it is too large.

        The backend ``"auto"`` is then a native algorithm, where there is one.
        """
        return False

    def formulate(self, name: str | None = None, **options: Any) -> Any:
        """Return this model's formulation called `name`, with its typed `options`.

        Returns
        -------
        Formulation
            Of the type :meth:`formulation_type`; not named in the signature, for formulations
            stand above models.

        Raises
        ------
        UnknownName
            No formulation bears the name.
        UnsupportedOption
            The formulation does not know an option.
        UnsupportedFormulation
            The formulation does not cover what this model asks for.
        """
        name = (self.preferred_formulation or None) if name is None else name
        return self.formulation_type(name).of(self, options)

    def __repr__(self) -> str:
        label = f" {self.name!r}" if self.name else ""
        return f"<{type(self).__name__}{label} {self.describe()}>"

    def describe(self) -> str:
        """Return the size of the model in a few words."""
        return f"digest {self.digest[:12]}"


def as_model(value: Any) -> Model[Any]:
    """Return `value` as it is where it is a model, and what its ``build()`` returns where it has one.

    Raises
    ------
    InvalidData
        It is neither.
    """
    found = value
    if not isinstance(value, Model) and callable(getattr(value, "build", None)):
        found = value.build()
    if not isinstance(found, Model):
        hint = "; load it first: crosstrack.load(…)" if isinstance(value, str) else ""
        raise InvalidData(f"model must be a Model, got {show(value)}{hint}", field="model")
    return found
