"""Channel between a running backend and its caller: stop requests in, incumbents out."""

from __future__ import annotations

import math
import operator
import queue
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import HiddenData
from .enums import Limit

if TYPE_CHECKING:
    from .stopping import Criterion, Progress

__all__ = ["GRACE", "Control"]

#: Seconds that a run may exceed its time limit before it is abandoned.
GRACE = 10.0


class Control:
    """Channel between a running backend and its caller: stop requests in, incumbents out.

    A kernel that releases the interpreter's lock polls ``flag`` (one ``int8``, nonzero means
    stop). Python callbacks read :attr:`stopped`. The dispatcher sets the flag at the deadline, when
    a criterion is reached, or on Ctrl-C.

    Parameters
    ----------
    criterion : Criterion, optional
        Criterion that stops the run in addition to the deadline.
    forward : callable, optional
        Function ``(objective, point)`` called with every incumbent. A stage reports to the run it
        belongs to.
    patience : float, optional
        Seconds after which a run in a worker process is abandoned if it does not stop.
    oracle : callable, optional
        Function that answers questions about the model's hidden data, see :meth:`ask`.
    proven : callable, optional
        Function ``(bound)`` called with every improved lower bound, in the thread that reports it.

    Attributes
    ----------
    bound : float, optional
        Best lower bound that the backend has proven so far. An abandoned run keeps it.
    abandoned : bool
        Whether the backend was abandoned. Its thread may still run.
    flag : ndarray of int8, shape (1,)
        Stop flag polled by the kernels.
    reason : Limit, optional
        First reason for a stop request.
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
        #: Incumbents, lower bounds as numbers, and None at the end of the run.
        self.events: queue.SimpleQueue[tuple[float, float, Any, int | None] | float | None]
        self.events = queue.SimpleQueue()
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
        #: Number of blocks that pause the run, the start of the first one, and the paused controls.
        self._blocks, self._begin = 0, 0.0
        self._pausing: list[Control] = []
        self._stages: list[Control] = []

    @property
    def stopped(self) -> bool:
        """Whether a stop was requested."""
        return bool(self.flag[0])

    @property
    def limit(self) -> Limit | None:
        """Limit that ended the run, or None if no stop was requested."""
        return (self.reason or Limit.INTERRUPTED) if self.stopped else None

    @property
    def progress(self) -> Progress:
        """Seconds, evaluations and best objective of the run so far."""
        from .stopping import Progress

        now = time.perf_counter()
        return Progress(now - self.started, self.evaluations, self._best, now - self._improved)

    def prove(self, bound: float | None) -> None:
        """Report a lower bound on the objective; ``bound`` is the largest."""
        if bound is None or not math.isfinite(bound):
            return
        if self.bound is not None and bound <= self.bound:
            return
        self.bound = bound
        self.events.put(float(bound))
        if self._proven is not None:
            self._proven(bound)

    def stop(self, reason: Limit) -> None:
        """Stop the run and its stages. The first reason is kept."""
        if self.reason is None:
            self.reason = reason
        self.flag[0] = 1
        for stage in self._stages:
            stage.stop(reason)

    def abandon(self) -> None:
        """Mark the run as abandoned, together with the runs it is a stage of."""
        self.abandoned = True
        if self._whole is not None:
            self._whole.abandon()

    def check(self) -> None:
        """Stop the run if its criterion is reached."""
        if self.criterion is not None and not self.stopped and not self._paused:
            reason = self.criterion.reached(self.progress)
            if reason is not None:
                self.stop(reason)

    def arm(self, seconds: float | None) -> None:
        """Restart the clock and stop the run after `seconds`; None for no deadline."""
        self.started = self._improved = time.perf_counter()
        if seconds is not None:
            self._set_timer(self.started + seconds)

    def disarm(self) -> None:
        """Cancel the deadline."""
        self._deadline = None
        if self._timer is not None:
            self._timer.cancel()

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Pause the clocks of the whole run and its stages within the block; blocks may overlap."""
        whole = self
        while whole._whole is not None:
            whole = whole._whole
        whole._blocks += 1
        if whole._blocks == 1:
            whole._begin, whole._pausing = time.perf_counter(), whole._parts()
            for part in whole._pausing:
                part._paused = True
                if part._timer is not None:
                    part._timer.cancel()
        try:
            yield
        finally:
            whole._blocks -= 1
            if not whole._blocks:
                spent = time.perf_counter() - whole._begin
                for part in whole._pausing:
                    part._paused = False
                    part.started += spent
                    part._improved += spent
                    if part._deadline is not None:
                        part._set_timer(part._deadline + spent)

    def _parts(self) -> list[Control]:
        return [self, *(part for stage in self._stages for part in stage._parts())]

    def _set_timer(self, deadline: float) -> None:
        self._deadline = deadline
        seconds = min(max(deadline - time.perf_counter(), 0.0), threading.TIMEOUT_MAX)
        if self._timer is not None:
            self._timer.cancel()
        self._timer = threading.Timer(seconds, self.stop, (Limit.TIME,))
        self._timer.daemon = True
        self._timer.start()

    def incumbent(self, objective: float, point: Any, evaluations: int | None = None) -> None:
        """Report a better feasible point.

        Parameters
        ----------
        objective : float
            Objective of the point. A value that is not finite is ignored.
        point : object
            Column vector, or plan of a native algorithm.
        evaluations : int, optional
            Number of evaluations after which the point was found, if the backend counts them.
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
        """Add `count` evaluations of the objective and return True if the run may continue."""
        self.evaluations += count
        self.check()
        if self._whole is not None:
            self._whole.evaluated(
                count
            )  # stops this stage if the evaluations of the run are used up
        return not self.stopped

    def ask(self, questions: NDArray[np.float64], *, partial: bool = False) -> NDArray[np.float64]:
        """Return the answers of the model's hidden data, which backends reach only this way.

        Parameters
        ----------
        questions : ndarray, shape (m, n)
            One question per row, such as points of a black box.
        partial : bool
            Whether the oracle may answer only the first rows, or none, so that the caller can stop
            between slow answers.

        Returns
        -------
        ndarray, shape (m, k)
            One answer per row.

        Raises
        ------
        HiddenData
            The model does not answer questions.
        InvalidData
            The question is rejected, for example because a budget is used up.
        """
        oracle = self.oracle or self._find_oracle()
        return getattr(oracle, "part", oracle)(questions) if partial else oracle(questions)

    def start(self, questions: NDArray[np.float64]) -> int:
        """Let the oracle work on questions that will be asked later, and return how many it can do at once.

        Parameters
        ----------
        questions : ndarray, shape (m, n)
            Questions, possibly none. An oracle that does one at a time ignores them.
        """
        start = getattr(self._find_oracle(), "start", None)
        return 1 if start is None else int(start(questions)[0, 0])

    def _find_oracle(self) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
        whole = self
        while whole.oracle is None and whole._whole is not None:
            whole = whole._whole
        if whole.oracle is None:
            raise HiddenData("the model answers no questions during a run")
        return whole.oracle

    @contextmanager
    def stage(
        self,
        seconds: float | None,
        forward: Callable[[float, Any], None] | None = None,
        proven: Callable[[float], None] | None = None,
    ) -> Iterator[Control]:
        """Yield the control of a stage, which stops with the run or after `seconds`.

        Parameters
        ----------
        seconds : float, optional
            Time limit of the stage; None for no limit.
        forward : callable, optional
            Function ``(objective, point)`` called with every incumbent of the stage.
        proven : callable, optional
            Function ``(bound)`` called with every improved lower bound of the stage.
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
