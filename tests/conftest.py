"""What every test module may use, and what is not collected unless it is asked for."""

from __future__ import annotations

import gc
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import warnings
import zlib
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

os.environ.setdefault("MPLBACKEND", "Agg")
# Two test processes on two cores: threads of linear algebra in each would only wait for one another.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# The time of an example depends on the load of the machine. CI draws the same examples in every run.
# A busy machine must not fail a test, so slow draws are accepted.
settings.register_profile(
    "crosstrack", deadline=None, derandomize="CI" in os.environ,
    suppress_health_check=[HealthCheck.too_slow],
)  # fmt: skip
settings.load_profile("crosstrack")

# A shell that starts a job in the background has it ignore Ctrl-C, and its children with it; the
# tests of interrupts need what a terminal gives.
signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).resolve().parent.parent

# A failed assertion in a helper shows its values, as in a test module.
_HELPERS = [
    path
    for path in Path(__file__).parent.rglob("*.py")
    if not path.name.startswith(("test_", "conftest"))
]
pytest.register_assert_rewrite(
    *sorted({path.stem for path in _HELPERS} | {path.parent.name for path in _HELPERS})
)

#: Folders of a checkout that hold nothing of the project's own.
_MADE = {
    ".benchmarks",
    ".git",
    ".hypothesis",
    ".mypy_cache",
    ".pytest_cache",
    ".ruff_cache",
    ".venv",
    "__pycache__",
    "_build",
    "build",
    "dist",
    "gallery",
    "generated",
    "node_modules",
}


#: Compile the loops of the native backends, or find them compiled; a process each.
_COMPILE = (
    """
import crosstrack as ct
from crosstrack.jit import compile_always
compile_always()
points = [[0, 0, 0], [1, 0, 0], [1, 0.5, 0], [2.2, 0, 0]]
kinds = ["A", "horizontal", "vertical", "B"]
model = ct.models.ErrorCorrectionRouting(points, kinds, 1.6, 1.6, 1.6, 1.6, 1.75, delta=1.0, revisits=False)
for name in ("label-setting", "two-stage", "pulse", "dynamic-programming"):
    ct.solve(model, name)
""",
    """
import crosstrack as ct
from crosstrack.jit import compile_always
compile_always()
points = [[0.0, 0.0], [1.0, 0.5], [2.0, 2.0]]
for more in ({}, {"weights": [0.0, 0.1, 0.0, 1.0]}, {"velocity_limit": 1.0}):
    model = ct.models.TimeAllocation(points, 1.0, **more)
    ct.solve(model, "time-gradient")
    ct.solve(model.at([0.0, 0.5, 1.0]), "interior-point")
""",
    """
import crosstrack as ct
from crosstrack.jit import compile_always
from crosstrack.solvers.messenger import BACKENDS
compile_always()
model = ct.models.MessengerTour([[60.0, 20.0], [10.0, 70.0], [50.0, 80.0]], [[1.0, 0.0]] * 3)
for name in {*BACKENDS} - {"crew-search", "detour-search"}:  # these call tour-search
    ct.solve(model, name, time_limit=60)
""",
    """
import crosstrack as ct
from crosstrack.jit import compile_always
from crosstrack.models import FleetRouting, GridPath
compile_always()
lines = ["....", ".@@.", "...."]
weights = [[1.0, 2.0, 1.0, 1.0]] * 3
for model, names in (
    (GridPath({"blocked": lines}, (0, 0), (2, 3)), ("a-star", "dijkstra", "jump-point")),
    (GridPath({"blocked": lines}, (0, 0), (2, 3), weights=weights), ("a-star", "dijkstra")),
    (
        GridPath({"blocked": lines}, (0, 0), (2, 3), connectivity="any"),
        ("any-angle", "theta-star", "shortcut-visibility", "shortcut-greedy", "rrt-star"),
    ),
    (
        FleetRouting(2, points=[[0, 0], [9, 1], [2, 8], [5, 5], [7, 3]], map=None),
        ("subset-dp", "fleet-search", "pso-ac", "pso-ac-serial", "tpha", "kmeans-ac"),
    ),
):
    for name in names:
        ct.solve(model, name, time_limit=60)
ct.solve(ct.load("fleet-mission/pocket"))
""",
    """
import crosstrack as ct
from crosstrack.jit import compile_always
from crosstrack.solvers.guided_path import BACKENDS
from crosstrack.solvers.sequential_ordering import BACKENDS as SEQUENCES
compile_always()
for fields in (
    {"chains": [[3, 1], [4, 2]]},
    {"chains": [[3, 1], [4, 2]], "precedence": [[3, 2], [4, 1]]},
):
    model = ct.models.GuidedPathTour([0, 1, 2, 3, 4, 5.5], **fields)
    for name in BACKENDS:
        ct.solve(model, name, time_limit=60)
for name in SEQUENCES:
    ct.solve(ct.load("sequential-ordering/random-10-100-30"), name, time_limit=60)
# Small ones do not reach the shares of the gaps.
ct.solve(ct.load("guided-path/hard-20x20"), "a-star", time_limit=5)
ct.solve(ct.load("black-box/path-open"), "random-search", evaluations=10)
""",
    """
import crosstrack as ct
from crosstrack.jit import compile_always
from crosstrack.solvers.attractor import BACKENDS as ANALYSES
from crosstrack.solvers.sideslip import BACKENDS as ESTIMATORS
compile_always()
for name in ESTIMATORS:
    for road in ("lane-change", "limit"):
        ct.solve(ct.load(f"sideslip/{road}"), name, time_limit=60)
for name in ANALYSES:
    ct.solve(ct.load("attractor/henon"), name, time_limit=60)
for name in ("d-star-lite", "a-star-replanning", "baseline-1", "oracle"):
    ct.solve(ct.load("unknown-grid/u-trap"), name, time_limit=60)
for name in ("errand", "network-5"):
    ct.solve(ct.load(f"resource-routing/{name}"), "resource-labelling", time_limit=60)
""",
)


def pytest_configure(config: pytest.Config) -> None:
    """Compile the native loops once before several processes would each do so."""
    if not getattr(config.option, "numprocesses", None) or hasattr(config, "workerinput"):
        return
    processes = [subprocess.Popen([sys.executable, "-c", script]) for script in _COMPILE]
    for process in processes:
        # Only a preparation: on a slow machine, or after an error, the tests compile by themselves.
        try:
            if process.wait(1800):
                warnings.warn("the loops could not be compiled before the tests", stacklevel=2)
        except subprocess.TimeoutExpired:
            process.kill()


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Suspend the garbage collector during the collection, of whose time it takes 30 %.

    Later garbage collections do not visit the modules and collected tests.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(10_000, 20, 50)  # collections take 2 % of the time of the tests otherwise
        gc.enable()


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave the benchmarks out unless they are named on the command line."""
    if collection_path.name == "benchmarks" and collection_path.parent == ROOT / "tests":
        return not any("benchmarks" in argument for argument in config.args)
    return None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark the cases of sweeps slow, except for samples drawn by their names.

    ``@pytest.mark.sample(n)`` leaves one case in `n`, rounded up. The sample of a product of parameters has each of
    their values at least once. Cases named by their node ids on the command line always run.
    """
    if any("[" in argument for argument in config.args):
        return
    sweeps: dict[str, list[Any]] = {}
    for item in items:
        if item.get_closest_marker("sample") and not item.get_closest_marker("slow"):
            sweeps.setdefault(item.nodeid.partition("[")[0], []).append(item)
    for cases in sweeps.values():
        cases.sort(key=lambda case: zlib.crc32(case.name.encode()))
        sample: list[Any] = []
        indices = {case: case.callspec.indices for case in cases}
        is_product = all(
            len({others[name] for others in indices.values()}) < len(cases)
            for name in indices[cases[0]]
        )
        if is_product:
            values: set[tuple[str, int]] = set()
            # Cases whose values are all new come first, so that few cases have each value.
            for least in (len(indices[cases[0]]), 1):
                for case in cases:
                    others = set(indices[case].items())
                    if case not in sample and len(others - values) >= least:
                        values |= others
                        sample.append(case)
        rest = [case for case in cases if case not in sample]
        size = math.ceil(len(cases) / cases[0].get_closest_marker("sample").args[0])
        for case in rest[max(0, size - len(sample)) :]:
            case.add_marker(pytest.mark.slow)


@pytest.fixture(autouse=True)
def _restore_session_backends() -> Iterator[None]:
    """Forget the backends that a test registers: `auto` would choose them in later tests."""
    registry = sys.modules.get("crosstrack.solvers.contract.registry")
    before = [] if registry is None else list(registry._session)
    yield
    registry = sys.modules.get("crosstrack.solvers.contract.registry")
    if registry is not None:
        registry._session[:] = before


@pytest.fixture(scope="session")
def checkout() -> Path:
    """The root of the repository."""
    return ROOT


@pytest.fixture(scope="session")
def own_files() -> list[Path]:
    """Every file of the project, in order, without what was built or installed."""

    def walk(folder: Path) -> Iterator[Path]:
        for path in sorted(folder.iterdir()):
            if path.name in _MADE or path.name.endswith(".egg-info") or path.is_symlink():
                continue
            if path.is_dir():
                yield from walk(path)
            else:
                yield path

    return list(walk(ROOT))


@pytest.fixture(scope="session")
def page_code() -> Callable[[Path], str]:
    """Return a function that gives the Python blocks of a Markdown page as one script.

    Blocks that begin with ``>>>`` are sessions to read, and left out.
    """

    def code(page: Path) -> str:
        blocks = re.findall(r"^```python\n(.*?)^```", page.read_text("utf-8"), re.S | re.M)
        return "\n".join(block for block in blocks if not block.startswith(">>>"))

    return code


@pytest.fixture(scope="session")
def run_python() -> Callable[..., str]:
    """Return a function that runs Python in a process of its own and gives what it printed."""

    def run(*arguments: str, cwd: Path, timeout: float = 240, **environment: str) -> str:
        done = subprocess.run(
            [sys.executable, *arguments],
            cwd=cwd,
            env={**os.environ, "MPLBACKEND": "Agg", **environment},
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
        )
        assert done.returncode == 0, f"exit code {done.returncode}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    return run


@pytest.fixture(scope="module")
def interpreted_workers() -> Iterator[None]:
    """Interpret the loops in the worker processes of a module, which then load no compiled code.

    Results are the same. On small instances, importing Numba takes most of the time of a worker.
    """
    import numba  # noqa: F401  # it reads the variable when it is imported: this process compiles

    from crosstrack.solvers.processes import pool

    idle: list[Any] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NUMBA_DISABLE_JIT", "1")
        patch.setattr(pool, "_idle", idle)
        yield
        for worker in idle:
            worker.close()


@pytest.fixture(scope="module")
def browser():
    """Headless Chromium; the tests that need it are skipped without it."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    program = shutil.which("chromium")
    if program is None:
        pytest.skip("chromium is not installed")
    with sync_api.sync_playwright() as playwright:
        result = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield result
        result.close()
