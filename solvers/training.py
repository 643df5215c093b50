"""Training of what learns: a command of its own, with checkpoints, and files of weights as its result.

A backend never trains: its option ``weights`` names a file, and by default the one that is shipped.
A problem declares what can be trained in the table ``TRAININGS`` of its folder.
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

from ..errors import InvalidData, UnknownName, show
from ..files import as_path, writable
from ..models.problems import loadable, resolve, table
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
    """How far a training is.

    Parameters
    ----------
    number, epochs : int
        Epochs done, and planned.
    figures : mapping of str to float
        Of the latest epoch.
    seconds : float
        Since the training began or was resumed.
    best : bool
        Whether its weights are the best so far.
    """

    number: int
    epochs: int
    figures: Mapping[str, float]
    seconds: float
    best: bool


@dataclass(frozen=True)
class Trained:
    """What a training came to.

    Parameters
    ----------
    name : str
        What was trained.
    path : Path, optional
        The file of weights; None where no epoch was finished.
    epochs : int
        Epochs done, those before it was resumed included.
    score : float
        Of the best of them, NaN where there is none.
    seconds : float
        Of this call.
    ended : str
        ``"finished"``, ``"time"`` or ``"interrupted"``.
    figures : tuple of mapping
        Of the epochs of this call.
    """

    name: str
    path: Path | None
    epochs: int
    score: float
    seconds: float
    ended: str
    figures: tuple[Mapping[str, float], ...]

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON data; what is no finite number is None."""

        def finite(value: float) -> float | None:
            return float(value) if np.isfinite(value) else None

        return {
            "name": self.name,
            "weights": None if self.path is None else str(self.path),
            "epochs": self.epochs,
            "score": finite(self.score),
            "seconds": self.seconds,
            "ended": self.ended,
            "figures": [{k: finite(v) for k, v in one.items()} for one in self.figures],
        }


class _TimeUsedUp(Exception):
    """The time limit is reached in the middle of an epoch, which is dropped."""


def trainings() -> dict[str, Training]:
    """Return what can be trained by name; what cannot be loaded is logged."""
    return dict(loadable(__package__, "TRAININGS"))


def find_training(name: str | Training) -> Training:
    """Return the training called `name`; ``UnknownName`` where there is none."""
    if isinstance(name, Training):
        return name
    known = table(__package__, "TRAININGS")
    if name not in known:
        raise UnknownName("training", name, known)
    found: Training = resolve(known[name])
    return found


def checkpoint_path(path: Path) -> Path:
    """Return where the checkpoint of a file of weights lies."""
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

    A checkpoint beside the file, ``<file>.checkpoint.npz``, is written after each epoch: with `resume`
    the training goes on from there, and ends with the same weights as one that was never interrupted.
    Ctrl-C and the time limit drop the epoch that runs, and keep checkpoint and weights.

    Parameters
    ----------
    name : str or Training
        What to train.
    path : path-like
        The file of weights; its name ends in ``.npz``.
    examples : callable, optional
        What draws the examples to learn from. A problem declares its own in the table ``EXAMPLES`` of
        its folder in ``instances``, from where the command line takes it.
    seed : int
        Of all that is drawn, >= 0.
    epochs : int, optional
        How many; by default the training's own number.
    time_limit : float, optional
        Seconds.
    resume : bool
        Whether to go on from the checkpoint; where there is none, the training begins.
    on_progress : callable, optional
        Told an :class:`Epoch` after each one.
    options : mapping, optional
        The training's own.

    Raises
    ------
    BackendMissing
        A package is not installed.
    InvalidData
        The file cannot be written, or the checkpoint is one of another course, which is named.
    UnsupportedOption
        An option is unknown, or its value not allowed.
    """
    training = find_training(name)
    file = writable(as_path(path), (".npz",))
    course = Course(
        _whole("seed", seed, 0),
        _whole("epochs", training.epochs if epochs is None else epochs, 1),
        training.checked_options(options or {}),
        examples,
    )
    if time_limit is not None and not (isinstance(time_limit, int | float) and time_limit > 0):
        raise InvalidData(
            f"time_limit must be a number of seconds > 0, got {show(time_limit)}",
            field="time_limit",
        )
    training.require()
    with one_thread() if "torch" in training.requires else contextlib.nullcontext():
        work = _Work(training, course, file, resume)
        ended = work.run(time_limit, on_progress)
    return Trained(
        training.name, file if work.best is not None else None, work.done, work.score,
        time.perf_counter() - work.began, ended, tuple(work.figures),
    )  # fmt: skip


def _whole(name: str, value: Any, least: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise InvalidData(
            f"{name} must be a whole number >= {least}, got {show(value)}", field=name
        )
    return int(value)


class _Work:
    """A training as it goes on."""

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
        """Train until the end, the time limit or Ctrl-C, and return which it was."""

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
        """Note an epoch: what is better is written, and so is the checkpoint."""
        self.done += 1
        self.figures.append(figures)
        # Of equal scores the later: it has learned for longer.
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
        """Write the best weights, and in the file how they were made."""
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
        state = {f"state.{name}": one for name, one in self.trainer.state().items()}
        best = {f"best.{name}": one for name, one in self.best.arrays.items()}
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
        for name in sorted({*saved, *self.settings}):
            if saved.get(name) != self.settings.get(name):
                raise InvalidData(
                    f"{self.checkpoint}: {name} must be {show(self.settings.get(name))} as asked, got "
                    f"{show(saved.get(name))}: resume with the checkpoint's own, or begin anew without",
                    field=name,
                )
        parts: dict[str, dict[str, NDArray[Any]]] = {"state": {}, "best": {}}
        for key, one in arrays.items():
            part, _, name = key.partition(".")
            parts.setdefault(part, {})[name] = one
        fresh = self.trainer.weights()
        self.best = Weights(fresh.kind, parts["best"], fresh.architecture)
        self.best.fit({name: one.shape for name, one in fresh.arrays.items()})
        self.trainer.restore(parts["state"])
        self.done, self.best_epoch, self.score = done, best, score
        self._write()


def _title(examples: Any) -> str | None:
    """Return a name for what draws examples, so that a checkpoint of another one is refused."""
    if examples is None:
        return None
    return str(getattr(examples, "__qualname__", type(examples).__qualname__))
