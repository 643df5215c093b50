"""Train networks with the settings of Table II on one GPU in a given time, and write their learning curves.

``python tests/benchmarks/unknown_grid/gpu_training.py FOLDER SECONDS NETWORK …`` trains the networks at once, each in a
thread with a CUDA stream of its own, and writes weights, checkpoints and ``curves.jsonl`` to the folder. Validation and
checkpoints take longer than an epoch on a GPU, so they follow every sixth epoch. ``learning.py`` reads the curves.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from pathlib import Path
from typing import Any

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from crosstrack.instances.unknown_grid import draw_scene_arrays  # noqa: E402
from crosstrack.solvers.learning import gradient, training  # noqa: E402
from crosstrack.solvers.unknown_grid.episodes import ImitationTrainer  # noqa: E402

#: Epochs between two validations, and length of the last part, s, with a validation per epoch.
INTERVAL, LAST = 6, 25.0
DEVICE = os.environ.get("DEVICE", "gpu")
#: Processes that draw scenes for a network.
WORKERS = {"macn": 2, "vin": 2}
START, LOCK = time.monotonic(), threading.RLock()


def patch(seconds: float) -> None:
    """Validate and save only some epochs, and let captures follow one another, as each synchronizes the device."""
    run, judge, capture = (
        ImitationTrainer.run_epoch,
        ImitationTrainer.judge,
        gradient.GraphReplay._capture,
    )
    save = training._Work._save

    def run_epoch(self: Any, number: int, tick: Any) -> Any:
        late = time.monotonic() - START > seconds - LAST
        ends = number % INTERVAL == INTERVAL - 1 or number + 1 == self.course.epochs
        self.validated = ends or late or number in (0, 2)
        return run(self, number, tick)

    def capture_alone(self: Any, tensors: Any) -> Any:
        with LOCK:
            return capture(self, tensors)

    ImitationTrainer.run_epoch = run_epoch
    # The score of other epochs is below all others, so none of them is the best.
    ImitationTrainer.judge = lambda self: judge(self) if self.validated else {"score": -1.0}
    gradient.GraphReplay._capture = capture_alone
    training._Work._save = lambda work: save(work) if work.trainer.validated else None


def learn(name: str, folder: Path, seconds: float) -> None:
    """Train a network, and append a line per validated epoch to the curves."""
    import torch

    plan = training.find_training(name)
    options = {"device": DEVICE, "workers": WORKERS.get(name, 4)}
    settings = plan.checked_options(options)

    def store(epoch: Any) -> None:
        if epoch.figures["score"] >= 0.0:
            row = {"network": name, **settings, "epoch": epoch.number, **epoch.figures}
            with LOCK, (folder / "curves.jsonl").open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(row) + "\n")
            print(
                name, epoch.number, f"{time.monotonic() - START:.0f} s", epoch.figures, flush=True
            )

    def run() -> None:
        limit = START + seconds - time.monotonic()
        training.train(
            plan, folder / f"{name}.npz", examples=draw_scene_arrays, time_limit=limit,
            on_progress=store, options=options,
        )  # fmt: skip

    if DEVICE == "cpu":
        run()
    else:
        with torch.cuda.stream(torch.cuda.Stream()):
            run()


def main() -> None:
    """Train the networks on the command line."""
    import torch

    folder, seconds = Path(sys.argv[1]), float(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    patch(seconds)
    threads = [
        threading.Thread(target=learn, args=(name, folder, seconds)) for name in sys.argv[3:]
    ]
    for thread in threads:
        thread.start()
        time.sleep(2.0)  # the seed of the first weights is global
    for thread in threads:
        thread.join()


if __name__ == "__main__":
    main()
