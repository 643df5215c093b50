"""The line between a running backend and its caller: stop requests in, incumbents out."""

from __future__ import annotations

import math
import operator
import queue
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import HiddenData
from .enums import Limit
from .stopping import Criterion, Progress

__all__ = ["GRACE", "Control"]

#: Seconds that a run may take beyond its time limit before it is given up.
GRACE = 10.0


class Control:
    """The line between a running backend and the caller: stop requests in, incumbents out.

    A kernel without the interpreter's lock polls :attr:`flag` (one ``int8``, nonzero means stop);
    Python callbacks read :attr:`stopped`. The dispatcher sets it at the deadline, where a criterion
    is reached or on Ctrl-C.

    Parameters
    ----------
    criterion : Criterion, optional
        Stops the run beside the deadline.
    forward : callable, optional
        ``(objective, point)``: told of every incumbent, as the run that this one is a stage of is.
    patience : float, optional
        Seconds after which a run in a process of its own, which can be killed, is given up when it
        does not stop.
    oracle : callable, optional
        What the model's hidden data answers, see :meth:`ask`.
    proven : callable, optional
        ``(bound)``: told of every better lower bound, in the thread that reports it.

    Attributes
    ----------
    bound : float, optional
        The lower bound that the backend has proven so far; what is given up keeps it.
    abandoned : bool
        Whether a backend was given up; its thread may still run.
    """

    def __init__(
        self,
        criterion: Criterion | None = None,
        forward: Callable[[float, Any], None] | None = None,
        patience: float | None = None,
        oracle: Callable[[NDArray[np.float64]], NDArray[np.float64]] | None = None,
        proven: Callable[[float], None] | None = None,
    ) -> None:
        self.flag: NDArray[np.int8] = np.zeros(1, np.int8)
        self.reason: Limit | None = None
        self.events: queue.SimpleQueue[tuple[float, float, Any, int | None] | None] = (
            queue.SimpleQueue()
        )
        self.started = time.perf_counter()
        self.evaluations = 0
        self.stages = 0
        self.criterion = criterion
        self.patience = patience
        self.oracle = oracle
        self.bound: float | None = None
        self.abandoned = False
        self._forward = forward
        self._proven = proven
        self._whole: Control | None = None
        self._best, self._improved = math.inf, self.started
        self._timer: threading.Timer | None = None
        self._deadline: float | None = None
        self._paused = False
        self._stages: list[Control] = []

    @property
    def stopped(self) -> bool:
        """Whether the run has been asked to stop."""
        return bool(self.flag[0])

    @property
    def progress(self) -> Progress:
        """How far the run is."""
        now = time.perf_counter()
        return Progress(now - self.started, self.evaluations, self._best, now - self._improved)

    def prove(self, bound: float | None) -> None:
        """Report a lower bound; of all reported, :attr:`bound` keeps the best."""
        if bound is None or not math.isfinite(bound):
            return
        if self.bound is not None and bound <= self.bound:
            return
        self.bound = bound
        if self._proven is not None:
            self._proven(bound)

    def stop(self, reason: Limit) -> None:
        """Ask the run and its stages to stop; the first reason given is kept."""
        if self.reason is None:
            self.reason = reason
        self.flag[0] = 1
        for stage in self._stages:
            stage.stop(reason)

    def abandon(self) -> None:
        """Note that the run was given up, and with it all that it is a stage of."""
        self.abandoned = True
        if self._whole is not None:
            self._whole.abandon()

    def check(self) -> None:
        """Stop the run where its criterion is reached."""
        if self.criterion is not None and not self.stopped and not self._paused:
            reason = self.criterion.reached(self.progress)
            if reason is not None:
                self.stop(reason)

    def arm(self, seconds: float | None) -> None:
        """Restart the clock and stop the run after `seconds` (never, when None)."""
        self.started = self._improved = time.perf_counter()
        if seconds is not None:
            self._set_timer(self.started + seconds)

    def disarm(self) -> None:
        """Forget the deadline."""
        self._deadline = None
        if self._timer is not None:
            self._timer.cancel()

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Stop the clocks of the whole run and its stages meanwhile; not to be nested."""
        begin = time.perf_counter()
        whole = self
        while whole._whole is not None:
            whole = whole._whole
        parts = whole._parts()
        for part in parts:
            part._paused = True
            if part._timer is not None:
                part._timer.cancel()
        try:
            yield
        finally:
            spent = time.perf_counter() - begin
            for part in parts:
                part._paused = False
                part.started += spent
                part._improved += spent
                if part._deadline is not None:
                    part._set_timer(part._deadline + spent)

    def _parts(self) -> list[Control]:
        return [self, *(one for stage in self._stages for one in stage._parts())]

    def _set_timer(self, deadline: float) -> None:
        self._deadline = deadline
        seconds = min(max(deadline - time.perf_counter(), 0.0), threading.TIMEOUT_MAX)
        self._timer = threading.Timer(seconds, self.stop, (Limit.TIME,))
        self._timer.daemon = True
        self._timer.start()

    def incumbent(self, objective: float, point: Any, evaluations: int | None = None) -> None:
        """Report a better feasible point (a column vector, or a native algorithm's plan).

        Whoever counts evaluations says after how many of them it was found. An objective that is no
        finite number is none, and nothing is reported.
        """
        if not math.isfinite(objective):
            return
        evaluations = None if evaluations is None else operator.index(evaluations)
        now = time.perf_counter()
        if objective < self._best:
            self._best, self._improved = float(objective), now
        self.events.put((now - self.started, float(objective), point, evaluations))
        if self._forward is not None:
            self._forward(float(objective), point)
        self.check()

    def evaluated(self, count: int = 1) -> bool:
        """Count evaluations of the objective; return whether the run may go on."""
        self.evaluations += count
        self.check()
        if self._whole is not None:
            self._whole.evaluated(count)  # which stops this stage where its own budget is used up
        return not self.stopped

    def ask(self, questions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what the model's hidden data answers; it is reached in no other way.

        Parameters
        ----------
        questions : ndarray, shape (m, n)
            Such as points of a black box, one a row.

        Returns
        -------
        ndarray, shape (m, k)

        Raises
        ------
        HiddenData
            The model answers nothing.
        InvalidData
            The answer is refused, as when a budget is used up.
        """
        whole = self
        while whole._whole is not None:
            whole = whole._whole
        if whole.oracle is None:
            raise HiddenData("the model answers no questions during a run")
        return whole.oracle(questions)

    @contextmanager
    def stage(
        self,
        seconds: float | None,
        forward: Callable[[float, Any], None] | None = None,
        proven: Callable[[float], None] | None = None,
    ) -> Iterator[Control]:
        """Yield the control of a part of the run, which stops with it or after `seconds`.

        `forward` is told of its incumbents, `proven` of its better bounds.
        """
        part = Control(forward=forward, patience=self.patience, proven=proven)
        part._whole = self
        self._stages.append(part)
        self.stages += 1
        part.arm(seconds)
        if self.reason is not None:
            part.stop(self.reason)
        try:
            yield part
        finally:
            part.disarm()
            self._stages.remove(part)
