"""Training of learned backends: a separate command with checkpoints that writes files of weights.

A backend never trains. Its option ``weights`` names a file, by default the one of the extra ``learn``. A
problem declares its trainings in the table ``TRAININGS`` of its folder.
"""

from __future__ import annotations

import contextlib
import shlex
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, UnknownName, show
from ...files import as_path, writable
from ...models.fields import Optional, Real, Whole
from ...models.problems import loadable, resolve, table
from .trainer import Course, Trainer, Training, one_thread
from .weights import Weights, read_arrays, write_arrays, write_weights

__all__ = [
    "Course",
    "Epoch",
    "Trained",
    "Trainer",
    "Training",
    "checkpoint_path",
    "find_training",
    "one_thread",
    "train",
    "trainings",
]


@dataclass(frozen=True)
class Epoch:
    """Progress of a training after an epoch.

    Parameters
    ----------
    number, epochs : int
        Number of finished and of planned epochs.
    figures : mapping of str to float
        Measures of the last epoch.
    seconds : float
        Seconds since the training was started or resumed.
    best : bool
        Whether the weights of this epoch are the best so far.
    """

    number: int
    epochs: int
    figures: Mapping[str, float]
    seconds: float
    best: bool


@dataclass(frozen=True)
class Trained:
    """Result of a training.

    Parameters
    ----------
    name : str
        Name of the training.
    path : Path, optional
        File of weights; None if no epoch was finished.
    epochs : int
        Number of finished epochs, including those before it was resumed.
    score : float
        Score of the best epoch; NaN if no epoch was finished.
    seconds : float
        Seconds of this call.
    ended : str
        ``"finished"``, ``"time"`` or ``"interrupted"``.
    figures : tuple of mapping
        Measures of the epochs of this call.
    """

    name: str
    path: Path | None
    epochs: int
    score: float
    seconds: float
    ended: str
    figures: tuple[Mapping[str, float], ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the result as JSON data, with None for values that are not finite."""

        def finite(value: float) -> float | None:
            return float(value) if np.isfinite(value) else None

        return {
            "name": self.name,
            "weights": None if self.path is None else str(self.path),
            "epochs": self.epochs,
            "score": finite(self.score),
            "seconds": self.seconds,
            "ended": self.ended,
            "figures": [{k: finite(v) for k, v in epoch.items()} for epoch in self.figures],
        }


class _TimeUsedUp(Exception):
    """The time limit was reached during an epoch, which is discarded."""


def trainings() -> dict[str, Training]:
    """Return the trainings by name; a training that cannot be loaded is logged."""
    return dict(loadable(__package__.rpartition(".")[0], "TRAININGS"))


def find_training(name: str | Training) -> Training:
    """Return the training called `name`.

    Parameters
    ----------
    name : str or Training
        Name; a :class:`Training` is returned unchanged.

    Raises
    ------
    UnknownName
        No training has the name.
    """
    if isinstance(name, Training):
        return name
    known = table(__package__.rpartition(".")[0], "TRAININGS")
    if name not in known:
        raise UnknownName("training", name, known)
    training: Training = resolve(known[name])
    return training


def checkpoint_path(path: Path) -> Path:
    """Return the path of the checkpoint that belongs to a file of weights.

    Parameters
    ----------
    path : Path
        Path of the file of weights.
    """
    return path.with_name(f"{path.name}.checkpoint.npz")


def train(
    name: str | Training,
    path: Any,
    *,
    examples: Any = None,
    seed: int = 0,
    epochs: int | None = None,
    time_limit: float | None = None,
    resume: bool = False,
    on_progress: Callable[[Epoch], None] | None = None,
    options: Mapping[str, Any] | None = None,
) -> Trained:
    """Train, and write the weights of the best epoch to a file.

    A checkpoint, ``<file>.checkpoint.npz``, is written after each epoch. With `resume`, training
    continues from it and gives the same weights as an uninterrupted training. Ctrl-C and the time
    limit discard the current epoch and keep checkpoint and weights.

    Parameters
    ----------
    name : str or Training
        Name of the training.
    path : path-like
        Name of the file of weights, ending in ``.npz``.
    examples : callable, optional
        Source of training examples. A problem declares it in the table ``EXAMPLES`` of its folder
        in ``instances``, from which the command line takes it.
    seed : int
        Random seed, >= 0.
    epochs : int, optional
        Number of epochs. Default: that of the training.
    time_limit : float, optional
        Time limit in seconds.
    resume : bool
        Whether to continue from the checkpoint. Without a checkpoint, training starts from the
        beginning.
    on_progress : callable, optional
        Function called with an :class:`Epoch` after each epoch.
    options : mapping, optional
        Options of the training.

    Returns
    -------
    Trained
        The file, the score and the measures of the epochs.

    Raises
    ------
    BackendMissing
        A package is not installed.
    InvalidData
        The file cannot be written, or the checkpoint belongs to other settings.
    UnsupportedOption
        An option is unknown, or its value is not allowed.
    """
    training = find_training(name)
    file = writable(as_path(path), (".npz",))
    course = Course(
        Whole(0).coerce("seed", seed, {}),
        Whole(1).coerce("epochs", training.epochs if epochs is None else epochs, {}),
        training.checked_options(options or {}),
        examples,
    )
    time_limit = Optional(Real(lower=0, strict=True)).coerce("time_limit", time_limit, {})
    training.require()
    with one_thread() if "torch" in training.requires else contextlib.nullcontext():
        work = _Work(training, course, file, resume)
        try:
            ended = work.run(time_limit, on_progress)
        finally:
            work.trainer.close()
    return Trained(
        training.name, file if work.best is not None else None, work.done, work.score,
        time.perf_counter() - work.began, ended, tuple(work.figures),
    )  # fmt: skip


class _Work:
    """State of a running training."""

    def __init__(self, training: Training, course: Course, file: Path, resume: bool) -> None:
        self.began = time.perf_counter()
        self.training, self.course, self.file = training, course, file
        self.checkpoint = checkpoint_path(file)
        self.settings = {
            "training": training.name, "seed": course.seed, "epochs": course.epochs,
            "examples": _title(course.examples), **course.options,
        }  # fmt: skip
        self.done, self.best_epoch, self.score = 0, 0, float("nan")
        self.best: Weights | None = None
        self.figures: list[Mapping[str, float]] = []
        build = resolve(training.run)
        self.trainer: Trainer = build(course)
        if resume and self.checkpoint.exists():
            self._restore()

    def run(self, time_limit: float | None, on_progress: Callable[[Epoch], None] | None) -> str:
        """Train until the end, the time limit or Ctrl-C; return the reason for the end."""

        def tick() -> None:
            if time_limit is not None and time.perf_counter() - self.began > time_limit:
                raise _TimeUsedUp

        try:
            while self.done < self.course.epochs:
                tick()
                figures = dict(self.trainer.run_epoch(self.done, tick))
                self._finish(figures, on_progress)
        except _TimeUsedUp:
            return "time"
        except KeyboardInterrupt:
            return "interrupted"
        return "finished"

    def _finish(
        self, figures: Mapping[str, float], on_progress: Callable[[Epoch], None] | None
    ) -> None:
        """Record an epoch: write improved weights and the checkpoint."""
        self.done += 1
        self.figures.append(figures)
        # Of equal scores the later epoch is kept, because it has trained for longer.
        better = self.best is None or not figures["score"] < self.score
        if better:
            self.best, self.score = self.trainer.weights(), float(figures["score"])
            self.best_epoch = self.done
            self._write()
        self._save()
        if on_progress is not None:
            seconds = time.perf_counter() - self.began
            on_progress(Epoch(self.done, self.course.epochs, figures, seconds, better))

    def _write(self) -> None:
        """Write the best weights to the file, with their origin."""
        assert self.best is not None
        known = self.training.options
        chosen = [
            f"--option {shlex.quote(f'{key}={value}')}"
            for key, value in self.course.options.items()
            if value != known[key].default
        ]
        words = [
            f"crosstrack train {shlex.quote(self.training.name)} --output FILE.npz",
            f"--seed {self.course.seed} --epochs {self.course.epochs}", *chosen,
        ]  # fmt: skip
        made = {
            **self.settings, "best_epoch": self.best_epoch, "score": self.score,
            "command": " ".join(words),
        }  # fmt: skip
        weights = Weights(self.best.kind, self.best.arrays, self.best.architecture, made)
        write_weights(self.file, weights, dtype=self.training.dtype)

    def _save(self) -> None:
        assert self.best is not None
        state = {f"state.{name}": array for name, array in self.trainer.state().items()}
        best = {f"best.{name}": array for name, array in self.best.arrays.items()}
        about = {
            "checkpoint": self.settings, "done": self.done, "best_epoch": self.best_epoch,
            "score": self.score,
        }  # fmt: skip
        write_arrays(self.checkpoint, {**state, **best}, about)

    def _restore(self) -> None:
        arrays, about = read_arrays(self.checkpoint)
        saved = about.get("checkpoint")
        done, best, score = (about.get(key) for key in ("done", "best_epoch", "score"))
        if (
            not isinstance(saved, dict)
            or not (isinstance(done, int) and isinstance(best, int) and isinstance(score, float))
            or not 0 < best <= done
        ):
            raise InvalidData(f"{self.checkpoint}: is no checkpoint of a training")
        # A checkpoint of an earlier version lacks newer options, which had their defaults.
        saved = {**{key: option.default for key, option in self.training.options.items()}, **saved}
        for name in sorted({*saved, *self.settings} - self.trainer.free_options):
            if saved.get(name) != self.settings.get(name):
                raise InvalidData(
                    f"{self.checkpoint}: {name} must be {show(self.settings.get(name))}, got "
                    f"{show(saved.get(name))}: resume with the checkpoint's value, or do not resume",
                    field=name,
                )
        parts: dict[str, dict[str, NDArray[Any]]] = {"state": {}, "best": {}}
        for key, array in arrays.items():
            part, _, name = key.partition(".")
            parts.setdefault(part, {})[name] = array
        fresh = self.trainer.weights()
        self.best = Weights(fresh.kind, parts["best"], fresh.architecture)
        self.best.fit({name: array.shape for name, array in fresh.arrays.items()})
        self.trainer.restore(parts["state"])
        self.done, self.best_epoch, self.score = done, best, score
        self._write()


def _title(examples: Any) -> str | None:
    """Return a name for the source of examples, by which a checkpoint of another one is detected."""
    if examples is None:
        return None
    return str(getattr(examples, "__qualname__", type(examples).__qualname__))
