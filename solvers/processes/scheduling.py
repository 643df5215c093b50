"""Scheduling of the jobs of a comparison: threads or an executor, each job in a worker process."""

from __future__ import annotations

import atexit
import contextlib
import logging
import os
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, Executor, Future
from dataclasses import dataclass, replace
from typing import Any

import cloudpickle

from ...errors import CrosstrackError
from ..contract.backend import processors
from ..contract.enums import Termination
from ..contract.job import Job
from ..contract.registry import find_backend
from ..contract.solution import Solution
from ..run.assembly import Claim, assemble
from ..run.running import GRACE, PATIENCE
from .environment import environment
from .interrupts import on_interrupt
from .isolation import Worker

__all__ = ["Task", "close_kept", "failed", "run_by_pool", "run_by_threads", "run_together"]

log = logging.getLogger("crosstrack")

#: Seconds of a run that warms up a process.
WARM = 2.0
#: Largest number of idle workers in a process of an executor.
KEPT = 4
#: Seconds between two reads of the number of jobs that an executor runs in parallel.
LOOK = 1.0
#: Message of a worker that was killed from outside, for example for lack of memory.
KILLED = "worker died: signal 9"


@dataclass
class Task:
    """One job of a comparison, with the position of its answer.

    Parameters
    ----------
    row, column, turn : int
        Numbers of the model, the backend and the repetition.
    job : Job
        The job.
    refusal : CrosstrackError, optional
        Reason why the backend cannot run the job.
    warm_up : bool
        Whether a new process runs the job once without a record before the recorded run.
    lost : bool
        Whether the executor lost the job.
    """

    row: int
    column: int
    turn: int
    job: Job
    refusal: CrosstrackError | None = None
    warm_up: bool = False
    lost: bool = False


def _refused(task: Task) -> Solution[Any]:
    """Return the failed solution of a job that the backend cannot run."""
    return failed(task.job, f"{type(task.refusal).__name__}: {task.refusal}")


def failed(job: Job, message: str, seconds: float = 0.0) -> Solution[Any]:
    """Return a failed solution for a job that did not run.

    Parameters
    ----------
    job : Job
        The job.
    message : str
        Reason of the failure.
    seconds : float
        Seconds until the failure.
    """
    formulation = job.formulation
    with contextlib.suppress(CrosstrackError):  # the message reports it
        written = job.find_target().formulation
        formulation = written.name if written is not None else formulation
    broken = Claim(
        Termination.FAILED,
        formulation=formulation,
        seconds={"total": seconds},
        messages=(message,),
    )
    return assemble(job, broken)


def _run(worker: Worker, job: Job, grace: float, warm_up: bool = False) -> Solution[Any]:
    begin = time.monotonic()
    try:
        for may_repeat in (True, False):
            if warm_up:
                _warm(worker, job, grace)
            warm = worker.warm[0] is not None and worker.warm[0] == worker.pid
            machine = environment(job, warm=warm)
            begin = time.monotonic()
            solution = worker.solve(job, grace=grace)
            if not (may_repeat and KILLED in solution.message):
                break  # a process killed from outside gets a second attempt
        return replace(solution, environment=machine)
    except Exception as error:  # a failure of one row must not affect the others
        if not isinstance(error, CrosstrackError):
            log.error("%s could not be run", job.backend, exc_info=error)
        return failed(job, f"{type(error).__name__}: {error}", time.monotonic() - begin)


def _warm(worker: Worker, job: Job, grace: float) -> None:
    """Run `job` briefly in the worker's process unless it has run a job of that kind."""
    kind = (job.model.kind, job.formulation)
    if worker.warm != (worker.pid, kind):
        limit = WARM if job.time_limit is None else min(WARM, job.time_limit)
        worker.solve(replace(job, time_limit=limit), grace=grace)
        worker.warm = (worker.pid, kind)


Finished = Callable[[Task, Solution[Any]], None]


def run_by_threads(
    tasks: deque[Task],
    count: int,
    grace: float,
    finished: Finished,
    started: Callable[[Task], None] | None = None,
) -> bool:
    """Run tasks in threads that drive worker processes.

    A worker serves one backend only, and lives as long as that backend has jobs left.

    Parameters
    ----------
    tasks : deque of Task
        The tasks; emptied.
    count : int
        Number of threads.
    grace : float
        Seconds after the time limit before a worker is killed.
    finished : callable
        Function called with each task and its solution, in this thread.
    started : callable, optional
        Function called with each task before it starts.

    Returns
    -------
    bool
        True if Ctrl-C ended the run.
    """
    # None marks the end of a thread.
    results: queue.SimpleQueue[tuple[Task, Solution[Any] | BaseException] | None]
    results = queue.SimpleQueue()
    lock = threading.Lock()
    idle: dict[int, list[Worker]] = {}
    busy: set[Worker] = set()
    left: dict[int, int] = {}
    stop = threading.Event()
    for task in tasks:
        left[task.column] = left.get(task.column, 0) + 1

    def work() -> None:
        try:
            drive()
        finally:
            results.put(None)

    def drive() -> None:
        while True:
            with lock:
                if stop.is_set() or not tasks:
                    return
                task = tasks.popleft()
                if task.refusal is None:
                    worker = (idle.get(task.column) or [Worker()]).pop()
                    busy.add(worker)
            outcome: Solution[Any] | BaseException
            if task.refusal is not None:
                outcome = _refused(task)
            else:
                try:
                    if started is not None:
                        started(task)
                    outcome = _run(worker, task.job, grace, task.warm_up)
                except BaseException as error:  # raised again in the waiting thread
                    outcome = error
            with lock:
                left[task.column] -= 1
                if task.refusal is None:
                    busy.discard(worker)
                    if left[task.column] and not stop.is_set():
                        idle.setdefault(task.column, []).append(worker)
                    else:
                        worker.close()
                        for other in idle.pop(task.column, []):
                            other.close()
            results.put((task, outcome))

    def interrupt() -> None:
        interrupted.append(True)
        stop.set()
        with lock:
            for worker in busy:
                worker.interrupt()

    interrupted: list[bool] = []
    threads = [
        threading.Thread(target=work, name="crosstrack-compare", daemon=True) for _ in range(count)
    ]
    running = count
    try:
        for thread in threads:
            thread.start()
        with on_interrupt(interrupt):
            while running:
                received = results.get()
                if received is None:
                    running -= 1
                    continue
                task, outcome = received
                if isinstance(outcome, BaseException):
                    raise outcome
                finished(task, outcome)
    finally:
        stop.set()
        with lock:
            tasks.clear()
            for worker in [*busy, *(w for group in idle.values() for w in group)]:
                worker.close()
    return bool(interrupted)


def run_together(jobs: Sequence[Job]) -> list[Solution[Any]]:
    """Run jobs of one backend in parallel, in as many processes as there are processors.

    Parameters
    ----------
    jobs : sequence of Job
        The jobs. Their time limit, if any, is shared by all of them.

    Returns
    -------
    list of Solution
        In the order of the jobs; after Ctrl-C, without the jobs that had not started.
    """
    count = min(processors(), len(jobs))
    rounds = -(-len(jobs) // count)
    solutions: dict[int, Solution[Any]] = {}
    tasks: deque[Task] = deque()
    for turn, job in enumerate(jobs):
        limit = None if job.time_limit is None else job.time_limit / rounds
        tasks.append(Task(0, 0, turn, replace(job, time_limit=limit)))

    def finished(task: Task, solution: Solution[Any]) -> None:
        solutions[task.turn] = solution

    run_by_threads(tasks, count, GRACE, finished)
    return [solutions[turn] for turn in sorted(solutions)]


def run_by_pool(
    tasks: deque[Task],
    pool: Executor,
    grace: float,
    finished: Finished,
    started: Callable[[Task], None] | None = None,
    room: Callable[[], int | None] | None = None,
) -> bool:
    """Run tasks in an executor whose own tasks only launch worker processes.

    Parameters
    ----------
    tasks : deque of Task
        The tasks; emptied.
    pool : concurrent.futures.Executor
        The executor.
    grace : float
        Seconds after the time limit before a worker is killed.
    finished : callable
        Function called with each task and its solution.
    started : callable, optional
        Function called with each task when it is submitted.
    room : callable, optional
        Function that returns how many tasks the executor runs in parallel; None if unknown. No
        more tasks are submitted, so that waiting tasks survive a broken executor. If it is
        unknown, all tasks are submitted at once.

    Returns
    -------
    bool
        True if Ctrl-C ended the run.
    """
    room = room or (lambda: getattr(pool, "_max_workers", None))
    futures: dict[Future[bytes], Task] = {}
    interrupted: list[float] = []

    def interrupt() -> None:
        interrupted.append(time.monotonic())
        for worker in _launched.copy():
            worker.interrupt()

    def lose(task: Task, error: BaseException) -> None:
        """Finish a lost task with a failed solution, which is not recorded."""
        log.error("the executor lost a task: %s: %s", type(error).__name__, error)
        log.debug("traceback", exc_info=error)
        task.lost = True
        finished(task, failed(task.job, f"executor: {type(error).__name__}: {error}"))

    def submit(task: Task) -> None:
        if task.refusal is not None:
            finished(task, _refused(task))
            return
        try:
            future = pool.submit(_launch, cloudpickle.dumps((task.job, grace, task.warm_up)))
        except Exception as error:  # broken or shut down; exceptions differ between libraries
            lose(task, error)
            return
        futures[future] = task
        if started is not None:
            started(task)

    with on_interrupt(interrupt), contextlib.ExitStack() as stack:
        stack.callback(close_kept)
        read_time, limit = 0.0, room()
        while (tasks and not interrupted) or futures:
            if limit is not None and time.monotonic() > read_time + LOOK:
                read_time, limit = time.monotonic(), room()
            while tasks and not interrupted and (limit is None or len(futures) < max(limit, 1)):
                submit(tasks.popleft())
            if interrupted:
                futures = {f: task for f, task in futures.items() if not f.cancel()}
                if time.monotonic() - interrupted[0] > 3 * PATIENCE:
                    break  # the workers run on other machines, which the interrupt does not reach
            # Polled, because futures of other libraries do not work with concurrent.futures.wait.
            done = [future for future in futures if future.done()]
            if not done:
                time.sleep(0.02)
            for future in done:
                task = futures.pop(future)
                try:
                    data = cloudpickle.loads(future.result())
                except KeyboardInterrupt:  # Ctrl-C reached the executor's processes as well
                    interrupted.append(time.monotonic())
                except (Exception, CancelledError) as error:
                    lose(task, error)
                else:
                    finished(task, Solution.from_dict(data, task.job.model))
    return bool(interrupted)


def _launch(request: bytes) -> bytes:
    """Run one job in a worker and return its pickled solution; called in an executor's process."""
    job, grace, warm_up = cloudpickle.loads(request)
    backend = find_backend(job.backend)
    name = backend.problem, backend.name
    with _keeping:
        worker = _kept.pop(name, None) or Worker()
        _launched.add(worker)
    try:
        message = cloudpickle.dumps(_run(worker, job, grace, warm_up).to_dict())
    except BaseException:
        worker.close()
        raise
    finally:
        with _keeping:
            _launched.discard(worker)
    with _keeping:
        _kept.setdefault(name, worker)
        spare = [] if _kept[name] is worker else [worker]
        spare += [_kept.pop(next(iter(_kept))) for _ in range(len(_kept) - KEPT)]
    for other in spare:
        other.close()
    return bytes(message)


def close_kept() -> None:
    """Close the idle workers of this process that wait for jobs of an executor."""
    with _keeping:
        waiting = [_kept.pop(name) for name in list(_kept)]
    for worker in waiting:
        worker.close()


#: Workers that executor threads of this process have launched, and idle workers by backend.
_launched: set[Worker] = set()
_kept: dict[tuple[str, str], Worker] = {}
_keeping = threading.Lock()
atexit.register(close_kept)
#: Workers of the process that this one was forked from.
_parents: list[Worker] = []


def _leave_kept() -> None:
    """Detach the parent's workers after a fork; references are kept so that their pipes stay open."""
    global _keeping
    _keeping = threading.Lock()  # a thread of the parent may hold the old lock
    _parents.extend([*_kept.values(), *_launched])
    _kept.clear()
    _launched.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_leave_kept)
