"""Runs behind a paper's result tables, recorded for the verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ...models.model import Model
from ..contract.events import Listener
from ..contract.solution import Solution
from ..contract.verdict import Verdict, judge
from ..run.crosscheck import compare

__all__ = ["RecordedTrials"]


@dataclass
class RecordedTrials:
    """Runner of backends for the cells of result tables, which records their answers.

    Runs use one worker process at a time, so that their seconds are comparable.

    Parameters
    ----------
    runs : int
        Number of runs per cell, from different seeds.
    time_limit : float, optional
        Seconds per run.
    seed : int
        First seed.
    on_event : callable, optional
        Function called with the event of every answer.
    """

    runs: int = 1
    time_limit: float | None = 60.0
    seed: int = 0
    on_event: Listener | None = None
    _answers: dict[str, tuple[Model[Any], list[Solution[Any]]]] = field(default_factory=dict)

    def run(
        self,
        model: Model[Any] | Sequence[Model[Any]],
        backend: str,
        *,
        runs: int | None = None,
        time_limit: float | None = None,
        options: Mapping[str, Any] | None = None,
        **limits: Any,
    ) -> list[Solution[Any]]:
        """Run a backend and return one answer per model and seed.

        Parameters
        ----------
        model : Model or sequence of Model
            The models to solve. Several models in one call share the start of the worker process.
        backend : str
            Name of the backend, or ``"name:formulation"``.
        runs : int, optional
            Number of runs instead of `self.runs`. A deterministic backend runs once.
        time_limit : float, optional
            Seconds instead of `self.time_limit`.
        options : mapping, optional
            Options of the backend.
        **limits
            Further limits of :func:`~crosstrack.compare`.

        Returns
        -------
        list of Solution
            The answers.

        Raises
        ------
        KeyboardInterrupt
            The user interrupted the runs.
        """
        models = [model] if isinstance(model, Model) else list(model)
        part = compare(
            models,
            [backend],
            time_limit=self.time_limit if time_limit is None else time_limit,
            seed=self.seed,
            repeats=self.runs if runs is None else runs,
            backend_options={backend.partition(":")[0]: options or {}},
            compiled=True,
            on_event=self.on_event,
            **limits,
        )
        answers = list(part.solutions)
        for single, verdict in zip(models, part.verdicts, strict=False):  # fewer if interrupted
            self._answers.setdefault(single.digest, (single, []))[1].extend(verdict.solutions)
        if part.interrupted:
            raise KeyboardInterrupt
        return answers

    def verdicts(self) -> tuple[Verdict, ...]:
        """Return the verdict on the answers to each model since the last call."""
        answers, self._answers = self._answers, {}
        return tuple(
            judge(model.name or digest[:12], solutions, model)
            for digest, (model, solutions) in answers.items()
        )
