"""Formulations: models written as solver-neutral programs, with the mapping of plans."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
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
    """Program of a model, with the encoding of plans into its columns and their decoding.

    Subclasses are frozen dataclasses. The fields after `model` are the typed options, which
    ``__post_init__`` checks with :class:`~crosstrack.errors.UnsupportedOption`. Features of the
    model that the formulation does not cover raise
    :class:`~crosstrack.errors.UnsupportedFormulation`.

    Parameters
    ----------
    model : Model
        Model to formulate.

    Attributes
    ----------
    name : str
        Name of the formulation in options and on the command line.
    program_type : type
        Class of the program, which decides the backends that accept it.
    summary : str
        Description in one line.
    """

    model: ModelT

    name: ClassVar[str]
    program_type: ClassVar[type[Program]]
    summary: ClassVar[str] = ""
    #: Share of the model's tolerance to which the program must be solved, so that the decoded plan
    #: verifies: tolerances of rows are relative to their terms, those of constraints to 1.
    precision: ClassVar[float] = 1.0
    #: Whether every program is a relaxation of the model, so that its bound and its infeasibility
    #: carry over to the model. Otherwise it is an approximation, such as one mesh of several.
    relaxes: ClassVar[bool] = True
    #: Reason, if the programs that follow a relaxation end without a plan of the model.
    failure: ClassVar[str] = "the linearisation converged to no plan within the limits"
    #: Whether :meth:`started` draws a random start, so that backends do not have to.
    draws: ClassVar[bool] = False
    #: Whether the search starts at the optimum of the :meth:`coarse` program, not at the guess.
    begins_coarse: ClassVar[bool] = False

    @classmethod
    def of(cls, model: ModelT, options: Mapping[str, Any]) -> Self:
        """Return the formulation of `model` with `options`.

        Parameters
        ----------
        model : Model
            Model to formulate.
        options : mapping of str to object
            Values of the formulation's fields by name.

        Raises
        ------
        UnsupportedOption
            An option is unknown.
        """
        known = [f.name for f in dataclasses.fields(cls) if f.init and f.name != "model"]
        for name in options:
            if name not in known:
                raise UnsupportedOption(
                    f"formulation {cls.name!r} has no option {name!r}; "
                    f"{suggestion(name, known)}its options: {', '.join(known) or 'none'}"
                )
        return cls(model, **options)

    def _changed(self, **fields: Any) -> Self:
        """Return a copy with these values. Its other fields that are no options have their defaults."""
        options = [f.name for f in dataclasses.fields(self) if f.init and f.name in fields]
        result = dataclasses.replace(self, **{name: fields.pop(name) for name in options})
        for name, value in fields.items():
            object.__setattr__(result, name, value)
        return result

    @cached_property
    def program(self) -> Program:
        """The program, built at first use."""
        return self.build()

    @abstractmethod
    def build(self) -> Program:
        """Return the program."""

    @abstractmethod
    def encode(self, plan: PlanT) -> NDArray[np.float64]:
        """Return the program's column vector for `plan`.

        A plan that satisfies the model satisfies the rows of the program once encoded. Encoding
        therefore checks a plan of any backend against the paper's equations. It is also a warm start.
        """

    @abstractmethod
    def decode(self, point: NDArray[np.float64]) -> PlanT:
        """Return the plan for a column vector, or raise ``InvalidData`` if it encodes no plan."""

    @property
    def floor(self) -> float:
        """Lower bound on the objective of all plans, known without a solver; -inf by default."""
        return -np.inf

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks about the program for users, such as equations that it omits."""
        return ()

    def bounded(self, objective: float) -> Self:
        """Return a formulation that may exclude plans worse than a verified `objective`.

        The dispatcher calls it with the objective of a verified warm start. By default, the
        formulation stays as it is.
        """
        return self

    def fitted(self, plan: PlanT) -> Self:
        """Return the formulation that represents `plan` best, for checking its rows on the plan."""
        return self

    def refined(
        self, point: NDArray[np.float64], tolerance: float, duals: NDArray[np.float64] | None = None
    ) -> Self | None:
        """Return the formulation extended by the violations of `point`, a solution of its program.

        It serves programs with infinitely many constraints, such as a limit that holds at every
        instant. The program contains some of them. The dispatcher solves and refines until the
        result is None: `point` has converged, or no further refinement is possible.

        Parameters
        ----------
        point : ndarray
            Optimum of :attr:`program`.
        tolerance : float
            Largest accepted violation, scaled as in the model's verification.
        duals : ndarray, optional
            Row multipliers at `point`; None if the solver returned none.

        Returns
        -------
        Formulation, optional
            None to stop; :attr:`settled` then distinguishes convergence from failure.
        """
        return None

    @property
    def settled(self) -> bool:
        """Whether the last :meth:`refined` that returned None did so because `point` had converged."""
        return True

    @property
    def is_local_optimum(self) -> bool:
        """Whether the linearisation had converged to a plan when :meth:`refined` last returned None.

        Only sequences that begin with relaxations and continue with linearisations define it. The answer is
        then ``locally_optimal``, otherwise at most ``feasible``.
        """
        return False

    def counterpart(self, point: NDArray[np.float64]) -> Formulation[ModelT, PlanT] | None:
        """Return another approximation, started at `point`, whose optimum must agree with this one.

        By default None: the optimum is accepted without a comparison.
        """
        return None

    def compared(
        self,
        point: NDArray[np.float64],
        objective: float,
        tolerance: float,
        better: PlanT | None = None,
    ) -> Self | None:
        """Return a finer formulation if the optimum at `point` differs from the counterpart's.

        Parameters
        ----------
        point : ndarray
            Optimum of :attr:`program` for which :meth:`refined` returned None.
        objective : float
            Objective of the counterpart's optimum.
        tolerance : float
            Largest accepted violation, scaled as in the model's verification.
        better : Plan, optional
            Plan of the counterpart if its objective is better; the finer formulation starts there.

        Returns
        -------
        Formulation, optional
            None if the two agree, or if no finer formulation is allowed. In the second case
            :attr:`settled` is False.
        """
        return None

    def alternatives(self) -> Iterator[tuple[str, Formulation[ModelT, PlanT]]]:
        """Yield labels and other approximations of the model, tried in turn if this one does not settle.

        They start from the same guess. A restricted one (:attr:`is_restricted`) may be repeated: the repetition
        starts at the best plan, if no plan verifies by then. By default the iterator is empty.
        """
        return iter(())

    def with_fixed_times(self) -> Program | None:
        """Return the program with all free times fixed at those of the guess; None without free times."""
        return None

    @property
    def is_restricted(self) -> bool:
        """Whether plans are restricted, such as to linear controls, so that they verify more easily."""
        return False

    @property
    def history(self) -> tuple[Mapping[str, Any], ...]:
        """One row per program so far, with equal names and JSON values; empty by default."""
        return ()

    def started(self, seed: int) -> Self:
        """Return the formulation with the program's guess drawn by `seed`; used if :attr:`draws`."""
        return self

    @property
    def is_convex(self) -> bool:
        """Whether every local optimum of the model is proven to be global, so that one start suffices."""
        return False

    def coarse(self) -> Self | None:
        """Return a smaller formulation for a comparison of many starts; None if it is not required."""
        return None

    def draw(self, seed: int) -> NDArray[np.float64]:
        """Return a start of the program drawn by `seed`, for example that of :meth:`started`."""
        guess = self.started(seed).program.guess
        assert guess is not None
        return guess

    def guessed(self, plan: PlanT) -> Self | None:
        """Return the formulation started at the infeasible `plan`, or None if it accepts no such plan."""
        return None

    def explained(
        self, plan: PlanT, point: NDArray[np.float64], duals: NDArray[np.float64]
    ) -> PlanT:
        """Return `plan` with the results of the row multipliers at `point`, such as costates."""
        return plan

    def statistics(self, plan: PlanT) -> dict[str, float | int | str]:
        """Return additional statistics of a solution with `plan`."""
        return {}
