"""Training by imitation: of the best actions in single steps, and of A* in whole episodes as in the paper."""

from __future__ import annotations

import pickle
import signal
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidData, show
from ...models.unknown_grid.scenes import TASKS, Task
from ..contract.option import Option
from ..learning.gradient import GradientTrainer, GraphReplay, epoch_generator
from ..learning.trainer import Course
from ..learning.weights import Weights
from .imitation import (
    Lengths,
    Recurrence,
    Scenes,
    best_actions,
    choose_actions,
    draw_scenes,
    first_of,
    shortest_ways,
    walk_through,
)
from .memory import Observation
from .value_iteration import iterate

if TYPE_CHECKING:
    import torch

__all__ = ["EPISODES", "IMITATION", "Episodes", "ImitationTrainer", "lead"]

Ints = NDArray[np.int64]
Truths = NDArray[np.bool_]

#: Options of all trainings by imitation.
IMITATION: Mapping[str, Option] = {
    "law": Option(
        "walls", "the law that scenes are drawn from, or several, separated by commas", str
    ),
    "scenes": Option(192, "scenes of each task that an epoch is drawn from", int, lower=1),
    "batches": Option(40, "steps of Adam in an epoch", int, lower=1),
    "batch": Option(
        256, "decisions of a batch, or episodes of a network with memory", int, lower=1
    ),
    "rate": Option(0.01, "the first learning rate", float, lower=0.0, upper=1.0),
    "judged": Option(128, "scenes of each task that an epoch is judged by", int, lower=1),
    "device": Option("cpu", "device of the network; gpu needs CUDA", str, ("cpu", "gpu")),
}
_PAPER = {"law": "paper", "batches": 200, "batch": 64, "rate": 1e-4, "judged": 64}
#: Options of the trainings of the paper. The defaults are the values of Table II.
EPISODES = {name: replace(IMITATION[name], default=value) for name, value in _PAPER.items()}
EPISODES["device"] = IMITATION["device"]
EPISODES["workers"] = Option(
    0, "processes that draw the batches of later epochs; 0 draws each batch when it is learned", int,
    lower=0, upper=256,
)  # fmt: skip
#: Entries of an array above which it is rounded.
_LARGE = 10_000


class Episodes(NamedTuple):
    """Runs of a policy, one row per step and run, in the order of the steps.

    The fields are the observations before each step, whether each action begins a shortest path, shape (n, 4),
    and the indices of the run and of the step.
    """

    observed: Observation
    best: Truths
    runs: Ints
    steps: Ints

    @property
    def actions(self) -> Ints:
        """Actions of A* on the true map. Ties go to up, down, left, right in this order."""
        return first_of(self.best)

    def mark_expert(self) -> Episodes:
        """Return a copy that marks only the actions of A*."""
        return self._replace(best=np.arange(4) == self.actions[:, None])

    def take(self, rows: Any) -> Episodes:
        """Return the steps at `rows`."""
        observed = Observation._make(array[rows] for array in self.observed)
        return Episodes(observed, self.best[rows], self.runs[rows], self.steps[rows])


def lead(
    scenes: Scenes, task: Task, choose: Callable[[Observation, Ints], Ints] | None = None
) -> Episodes:
    """Return the runs of a policy, or of A* on the true maps if `choose` is None."""
    ways = shortest_ways(scenes.blocked, scenes.targets)
    records: list[tuple[Observation, Truths, Ints, Ints]] = []

    def step(observed: Observation, rows: Ints) -> Ints:
        best = best_actions(ways[rows], observed.positions)
        records.append((observed, best, rows, np.full(len(rows), len(records))))
        return choose(observed, rows) if choose else first_of(best)

    walk_through(scenes, task.view, step)
    looks, *others = zip(*records, strict=True)
    observed = Observation(*map(np.concatenate, zip(*looks, strict=True)))
    return Episodes(observed, *map(np.concatenate, others))


def draw_task(course: Course, task: Task, count: int, generator: np.random.Generator) -> Scenes:
    """Return random scenes of a task."""
    law = course.options["law"]
    return draw_scenes(course.examples, law, task.shape, (2, 5), count, generator)


def draw_batch(
    course: Course, part: int, recurrent: bool, batch: int, generator: np.random.Generator
) -> Episodes:
    """Return the steps of A* of a batch, see :class:`ImitationTrainer` for `part` and `recurrent`."""
    size, task = course.options["batch"], TASKS[batch % len(TASKS)]
    while True:
        episodes = lead(draw_task(course, task, 2 * size if part else size, generator), task)
        if part:
            episodes = episodes.take(episodes.observed.seen == (part == 2))
        if len(episodes.best):
            break
    episodes = episodes.take(np.isin(episodes.runs, np.unique(episodes.runs)[:size]))
    if recurrent:
        return episodes
    return episodes.take(generator.permutation(len(episodes.best))[:size])


def draw_epoch(course: Course, part: int, recurrent: bool, number: int) -> list[Episodes]:
    """Return all batches of an epoch."""
    generator, _ = epoch_generator(course.seed, number)
    batches = range(course.options["batches"])
    return [draw_batch(course, part, recurrent, batch, generator) for batch in batches]


class BatchQueue:
    """Batches of later epochs that worker processes draw. They equal those of :func:`draw_epoch`."""

    def __init__(self, course: Course, part: int, recurrent: bool) -> None:
        self.course, self.part, self.recurrent = course, part, recurrent
        self._workers: ProcessPoolExecutor | None = None
        self._epochs: dict[int, Future[list[Episodes]]] = {}

    def take(self, number: int) -> list[Episodes] | None:
        """Return the batches of an epoch, and request later epochs; None without workers."""
        count = self.course.options["workers"]
        if not count:
            return None
        if self._workers is None:
            try:
                pickle.dumps(self.course.examples)
            except (AttributeError, TypeError, pickle.PicklingError) as error:
                raise InvalidData(
                    "examples must be a function of a module, which worker processes can import, got "
                    f"{show(self.course.examples)}: use workers=0",
                    field="examples",
                ) from error
            # Ctrl-C interrupts the training, which then ends the processes.
            ignoring = signal.signal, (signal.SIGINT, signal.SIG_IGN)
            self._workers = ProcessPoolExecutor(count, get_context("spawn"), *ignoring)
        for later in range(number, min(number + count + 1, self.course.epochs)):
            if later not in self._epochs:
                self._epochs[later] = self._workers.submit(
                    draw_epoch, self.course, self.part, self.recurrent, later
                )
        return self._epochs.pop(number).result()

    def close(self) -> None:
        """Cancel the requested epochs and end the processes, also those that draw an epoch."""
        if self._workers is not None:
            processes = [*self._workers._processes.values()]
            self._workers.shutdown(wait=False, cancel_futures=True)
            for process in processes:
                process.terminate()


def _compute_losses(logits: torch.Tensor, correct: torch.Tensor) -> torch.Tensor:
    """Return the negative logarithm of the total probability of the actions marked in `correct`, shape (n,)."""
    import torch

    marked = logits.masked_fill(~correct, -torch.inf)
    return torch.logsumexp(logits, dim=1) - torch.logsumexp(marked, dim=1)


class ImitationTrainer(GradientTrainer):
    """Trainer of all policies, by imitation of A* on the true map. The batches alternate between the paper's tasks.

    Parameters
    ----------
    course, kind, network, architecture
        See :class:`~..learning.gradient.GradientTrainer`.
    part : {0, 1, 2}
        Steps that are learned and judged: 1 those before the target was in the view, on O_g, 2 those after it, on
        O_p, and 0 all, on O_g. The expert decides the other steps of a validation run.
    recurrent : bool
        Whether the network has a memory. An example is then an episode, and the gradient passes through its steps.
        Otherwise it is a decision.
    mixed : bool
        Whether the examples are drawn once per epoch, and the expert decides in half of the scenes and the current
        network in the other half, so that the examples cover the states that the network's errors lead to (S. Ross,
        G. Gordon, D. Bagnell, "DAgger", AISTATS 2011). Every action that begins a shortest path is then correct.
        Otherwise each batch has new runs of A*, and its action is the only correct one.
    """

    free_options = frozenset({"workers"})
    _groups: list[Episodes]

    def __init__(
        self, course: Course, kind: str, network: torch.nn.Module, architecture: Mapping[str, int],
        *, part: int = 0, recurrent: bool = False, mixed: bool = False,
    ) -> None:  # fmt: skip
        super().__init__(course, kind, network, architecture)
        self.part, self.recurrent, self.mixed = part, recurrent, mixed
        self._queue = BatchQueue(course, part, recurrent)
        self._batches: list[Episodes] | None = None
        self._replay = GraphReplay(self._backward, self.device)
        self._decide: Any = getattr(network, "decide", None)
        self._iterate: Any = iterate
        if self.device.type == "cuda":
            self.compile()

    def close(self) -> None:
        self._queue.close()

    def compile(self, backend: str = "inductor") -> None:
        """Compile the steps of the computer and of value iteration, whose short operations dominate the time."""
        import torch

        self._iterate = torch.compile(iterate, dynamic=True, backend=backend)
        if self.recurrent:
            self._decide = torch.compile(self.network.decide, backend=backend)

    def prepare(self, number: int, generator: np.random.Generator) -> None:
        if not self.mixed:
            self._batches = self._queue.take(number)
            return
        import torch

        self._groups = []
        for task in TASKS:
            scenes = draw_task(self.course, task, self.course.options["scenes"], generator)
            ways = shortest_ways(scenes.blocked, scenes.targets)
            by_expert = generator.random(len(ways)) < 0.5
            with torch.inference_mode():
                episodes = lead(scenes, task, self._policy(ways, by_expert))
            self._groups.append(episodes.take(episodes.best.any(axis=1)))

    def draw(self, batch: int, generator: np.random.Generator) -> Episodes:
        """Return the steps of a batch. Each episode of a network with memory has at least one step."""
        if self.mixed:
            group = self._groups[batch % len(TASKS)]
            return group.take(generator.integers(0, len(group.best), self.course.options["batch"]))
        if self._batches is not None:
            return self._batches[batch]
        return draw_batch(self.course, self.part, self.recurrent, batch, generator)

    def gradient(self, batch: int, generator: np.random.Generator) -> torch.Tensor:
        if self.mixed or self.device.type == "cpu":
            return super().gradient(batch, generator)
        planner, arrays = self.network.planner, self.pad(self.draw(batch, generator))
        planner.iterate = self._iterate
        try:
            return self._replay(*arrays)
        finally:
            planner.iterate = iterate

    def pad(self, episodes: Episodes) -> tuple[NDArray[Any], ...]:
        """Return arrays of a batch whose shapes take few values, as a CUDA graph of each shape is captured.

        They are the maps, positions and targets, one row per step and run of a network with memory (the runs of
        the first step first) or per decision, the correct actions, and the number of true rows. In padding rows all
        actions are correct, which gives a loss and a gradient of 0. The number of steps is a multiple of four.
        """
        size, episodes = self.course.options["batch"], episodes.mark_expert()
        observed = episodes.observed.in_view() if self.part == 2 else episodes.observed
        rows, count = np.arange(len(episodes.best)), size
        if self.recurrent:
            count *= 4 * (int(episodes.steps.max()) // 4 + 1)
            rows = episodes.steps * size + np.unique(episodes.runs, return_inverse=True)[1]
        arrays = (observed.current, observed.positions, observed.targets, episodes.best)
        wide = [np.zeros((count, *array.shape[1:]), array.dtype) for array in arrays]
        wide[-1][:] = True
        for array, values in zip(wide, arrays, strict=True):
            array[rows] = values
        # The count has an axis, because a graph copies arrays.
        return *wide, np.array([len(rows)], np.float32)

    def _backward(
        self, maps: torch.Tensor, positions: torch.Tensor, targets: torch.Tensor,
        correct: torch.Tensor, count: torch.Tensor,
    ) -> torch.Tensor:  # fmt: skip
        """Replace the gradients by those of a padded batch, and return its loss."""
        import torch

        self.optimiser.zero_grad(set_to_none=False)
        fields = dict.fromkeys(Observation._fields) | {"current": maps.float()}
        observed = Observation(**fields | {"positions": positions, "targets": targets})
        if self.recurrent:
            size, logits = self.course.options["batch"], []
            # The state of the first step needs a gradient as those of later steps: one case is compiled, not two.
            state = tuple(field.requires_grad_() for field in self.network.computer.start(size))
            for inputs in self.network.read(observed).split(size):
                decided, state = self._decide(inputs, state)
                logits.append(decided)
        else:
            logits = [self.network(observed, None)[0]]
        loss = _compute_losses(torch.cat(logits), correct).sum() / count[0]
        loss.backward()
        return loss.detach()

    def loss(self, batch: int, generator: np.random.Generator) -> torch.Tensor:
        """Return the mean negative logarithm of the total probability of the correct actions."""
        import torch

        episodes = self.draw(batch, generator)
        observed = self._inputs(episodes.observed)
        if not self.mixed:
            episodes = episodes.mark_expert()
        if self.recurrent:
            inputs, decide = self.network.read(observed), Recurrence(self.network.decide)
            steps = (np.flatnonzero(episodes.steps == step) for step in np.unique(episodes.steps))
            logits = torch.cat(
                [decide(inputs[torch.from_numpy(rows)], episodes.runs[rows]) for rows in steps]
            )
        else:
            logits, _ = self.network(observed, None)
        return _compute_losses(logits, torch.from_numpy(episodes.best).to(self.device)).mean()

    def _inputs(self, observed: Observation) -> Observation:
        tensors = (observed.in_view() if self.part == 2 else observed).tensors()
        if self.device.type == "cpu":
            return tensors
        return Observation._make(tensor.to(self.device) for tensor in tensors)

    def _policy(
        self, ways: Lengths, by_expert: Truths | None = None
    ) -> Callable[[Observation, Ints], Ints]:
        """Return the policy of the network and, in the scenes `by_expert` or outside its part, of the expert."""
        network = Recurrence(self.network)

        def choose(observed: Observation, rows: Ints) -> Ints:
            logits = network(self._inputs(observed), rows)
            expert = first_of(best_actions(ways[rows], observed.positions))
            if by_expert is None:
                led = (self.part > 0) & (observed.seen != (self.part == 2))
            else:
                led = by_expert[rows]
            return np.where(led, expert, choose_actions(logits.numpy(force=True))[0])

        return choose

    def judge(self) -> Mapping[str, float]:
        """Return the performance in the validation scenes.

        ``score`` is the share of targets reached, percent, ``collisions`` the mean number of collisions per scene,
        and ``ratio`` the mean ratio of steps to fewest steps. The scenes depend only on the seed of the course, and
        are disjoint from the training scenes.
        """
        reached, collisions, ratios = [], [], []
        for number, task in enumerate(TASKS):
            generator = np.random.default_rng([self.course.seed, 2**32 - 1, number])
            scenes = draw_task(self.course, task, self.course.options["judged"], generator)
            ways = shortest_ways(scenes.blocked, scenes.targets)
            world = walk_through(scenes, task.view, self._policy(ways))
            fewest = ways[np.arange(len(ways)), *scenes.starts.T]
            reached.append((world.positions == scenes.targets).all(axis=1))
            collisions.append(world.collisions)
            ratios.append((world.taken / fewest)[reached[-1]])
        ratio = np.concatenate(ratios)
        return {
            "score": 100.0 * float(np.mean(reached)),
            "collisions": float(np.mean(collisions)),
            "ratio": float(ratio.mean()) if len(ratio) else float("nan"),
        }

    def weights(self) -> Weights:
        """Return the weights. Large arrays are rounded to about 25 values, which keeps the file small."""
        exact = super().weights()
        arrays = {name: _rounded(array) for name, array in exact.arrays.items()}
        return Weights(exact.kind, arrays, exact.architecture)


def _rounded(weights: Any) -> Any:
    """Return an array rounded to multiples of at most a quarter of its standard deviation."""
    if weights.size < _LARGE or not 0.0 < weights.std() < np.inf:
        return weights
    step = 2.0 ** (np.floor(np.log2(weights.std())) - 2.0)
    return (np.round(weights / step) * step).astype(weights.dtype)
