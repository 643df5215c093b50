"""A formulation: a model written as a solver-neutral program, and the way back."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import UnsupportedOption, suggestion

if TYPE_CHECKING:
    from .model import Model
    from .programs.base import Program

__all__ = ["Formulation"]

ModelT = TypeVar("ModelT", bound="Model[Any]")
PlanT = TypeVar("PlanT")


@dataclass(frozen=True, eq=False)
class Formulation(ABC, Generic[ModelT, PlanT]):
    """A model as a program, with plans encoded into its columns and decoded from them.

    Subclasses are frozen dataclasses; their fields after `model` are the typed options, checked
    in ``__post_init__`` with :class:`~crosstrack.errors.UnsupportedOption`, and what of the model
    they do not cover with :class:`~crosstrack.errors.UnsupportedFormulation`.

    Parameters
    ----------
    model : Model
        The model.
    """

    model: ModelT

    name: ClassVar[str]
    program_type: ClassVar[type[Program]]
    summary: ClassVar[str] = ""
    #: Share of the model's tolerance to which the program must be solved, so that what is decoded
    #: verifies: a program's rows are held against their terms, a model's constraints against 1.
    precision: ClassVar[float] = 1.0
    #: Whether every program is a relaxation of the model, so that its bound and its being infeasible
    #: hold for the model. Else it is an approximation, such as one mesh of several.
    relaxes: ClassVar[bool] = True
    #: Whether :meth:`started` draws a start, so that no backend need do it.
    draws: ClassVar[bool] = False

    @classmethod
    def of(cls, model: ModelT, options: Mapping[str, Any]) -> Self:
        """Return the formulation of `model` with `options`; an unknown one raises."""
        known = [f.name for f in dataclasses.fields(cls) if f.init and f.name != "model"]
        for name in options:
            if name not in known:
                raise UnsupportedOption(
                    f"formulation {cls.name!r} has no option {name!r}; "
                    f"{suggestion(name, known)}its options: {', '.join(known) or 'none'}"
                )
        return cls(model, **options)

    @cached_property
    def program(self) -> Program:
        """The program, built at the first use."""
        return self.build()

    @abstractmethod
    def build(self) -> Program:
        """Return the program."""

    @abstractmethod
    def encode(self, plan: PlanT) -> NDArray[np.float64]:
        """Return the program's column vector for `plan`.

        Any plan that satisfies the model satisfies the program's rows once encoded, so encoding
        cross-checks a plan of any backend against the paper's equations; it is also a warm start.
        """

    @abstractmethod
    def decode(self, point: NDArray[np.float64]) -> PlanT:
        """Return the plan that a column vector stands for; ``InvalidData`` where it has none."""

    @property
    def floor(self) -> float:
        """A lower bound on the objective of every plan that no solver need find; -inf without one."""
        return -np.inf

    @property
    def notes(self) -> tuple[str, ...]:
        """What people must know of the program, such as equations left out of it."""
        return ()

    def bounded(self, objective: float) -> Self:
        """Return a formulation that may leave out plans worse than a verified `objective`.

        The dispatcher calls it with the objective of a verified warm start. The default keeps
        the program as it is.
        """
        return self

    def fitted(self, plan: PlanT) -> Self:
        """Return the formulation that resolves `plan` best, for its rows to be held against it."""
        return self

    def refined(
        self, point: NDArray[np.float64], tolerance: float, duals: NDArray[np.float64] | None = None
    ) -> Self | None:
        """Return the formulation with what `point`, a solution of its program, shows to be missing.

        For programs that stand for more than can be written, such as a limit or a motion at every
        instant: the program holds some of it, and the dispatcher solves, refines and solves again
        until None says that `point` is settled, or that nothing more can be done.

        Parameters
        ----------
        point : ndarray
            An optimum of :attr:`program`.
        tolerance : float
            Largest violation that may stay, scaled as the model's verification scales it.
        duals : ndarray, optional
            Row multipliers at `point`, where the solver gave some.
        """
        return None

    @property
    def settled(self) -> bool:
        """Whether :meth:`refined`, once it has said None, did so as nothing is missing."""
        return True

    def counterpart(self, point: NDArray[np.float64]) -> Formulation[ModelT, PlanT] | None:
        """Return another approximation of the model, started at `point`, whose optimum must agree.

        The default is None: an approximation without a counterpart is accepted as it is.
        """
        return None

    def compared(
        self, point: NDArray[np.float64], objective: float, tolerance: float
    ) -> Self | None:
        """Return a finer formulation if the optimum at `point` differs from the counterpart's.

        Parameters
        ----------
        point : ndarray
            An optimum of :attr:`program` for which :meth:`refined` returned None.
        objective : float
            Objective of the counterpart's optimum.
        tolerance : float
            Largest violation that may stay, scaled as the model's verification scales it.

        Returns
        -------
        Formulation, optional
            None if the two agree, or if no finer formulation is allowed; then :attr:`settled` is
            False.
        """
        return None

    @property
    def history(self) -> tuple[Mapping[str, Any], ...]:
        """A row for each program so far, of the same names and JSON values; empty where none is told."""
        return ()

    def started(self, seed: int) -> Self:
        """Return the formulation with its program's guess drawn by `seed`, where :attr:`draws`."""
        return self

    def guessed(self, plan: PlanT) -> Self | None:
        """Return the formulation started at `plan`, which breaks the model; None to refuse such plans."""
        return None

    def explained(
        self, plan: PlanT, point: NDArray[np.float64], duals: NDArray[np.float64]
    ) -> PlanT:
        """Return `plan` with what the row multipliers at `point` tell of it, such as costates."""
        return plan

    def statistics(self, plan: PlanT) -> dict[str, float | int | str]:
        """Return counts of the formulation's own for a solution with `plan`."""
        return {}
