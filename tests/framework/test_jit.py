"""Kernels: interpreted while that is quick, compiled beyond, the same result either way."""

import math
import queue
import sys
import threading
import time
from collections import deque
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from fakes import Fixed
from hypothesis import given, settings, strategies as st

import crosstrack as ct
from crosstrack import compilation, jit
from crosstrack.instances.error_correction.generator import random_small, uniform_slab
from crosstrack.jit import kernel
from crosstrack.solvers import Request, find_backend
from crosstrack.solvers.attractor import neighbour_kernels
from crosstrack.solvers.contract.control import Control
from crosstrack.solvers.contract.enums import Limit
from crosstrack.solvers.contract.stopping import Seconds


@kernel
def halved(x: float) -> float:
    return 0.5 * x


@kernel(interpretable=True)
def total(values: np.ndarray, out: np.ndarray) -> float:
    """Fill `out` with halves and return their sum."""
    found = 0.0
    for i in range(len(values)):
        out[i] = halved(values[i])
        found += out[i]
    return found


@pytest.fixture
def budget(monkeypatch):
    """Set the seconds of interpretation that are left, and forget what is compiled."""

    def left(seconds):
        monkeypatch.setattr(jit, "_left", seconds)
        for one in (halved, total):
            monkeypatch.setattr(one, "_ready", False)

    return left


@pytest.mark.parametrize(
    ("ahead", "renewals", "loaded", "left"),
    [
        (0.75, 2, False, jit.BUDGET),
        (0.75, 0, False, 0.1),
        (0.0, 2, False, 0.1),
        (0.75, 2, True, 0.1),
    ],
)
def test_a_few_jobs_begin_with_the_whole_budget(monkeypatch, ahead, renewals, loaded, left):
    for name, value in (("_left", 0.1), ("_ahead", ahead), ("_renewals", renewals)):
        monkeypatch.setattr(jit, name, value)
    if loaded:
        monkeypatch.setitem(sys.modules, "numba", sys)
    else:
        monkeypatch.delitem(sys.modules, "numba", raising=False)
    jit.renew_budget()
    assert jit._left == left


def interpreted(backend, model):
    """Return the answer of `backend` with interpreted kernels, even if they are compiled."""
    jit._here.deadline = math.inf
    try:
        with np.errstate(all="ignore"):
            return backend.run(model, Request(options=backend.checked_options({})))
    finally:
        jit._here.deadline = 0.0


def compiled(backend, model, monkeypatch):
    monkeypatch.setattr(jit, "_left", 0.0)
    return backend.run(model, Request(options=backend.checked_options({})))


def counts(answer):
    return {key: value for key, value in answer.statistics.items() if not key.endswith("_seconds")}


# -- the mechanism --------------------------------------------------------------------------------


def test_a_kernel_starts_again_where_its_budget_ends(budget):
    values, out = np.arange(30_000.0), np.zeros(30_000)
    budget(math.inf)
    expected = total(values, out)
    assert not total._ready
    budget(1e-3)
    assert total(values, out) == expected
    assert total._ready
    assert jit._left == 0.0
    assert np.array_equal(out, values / 2)
    assert len(total.dispatcher.signatures) == 1
    assert len(halved.dispatcher.signatures) <= 1  # none where `total` was loaded from the disk


@pytest.mark.parametrize(
    ("kernel", "further"),
    [
        (neighbour_kernels.nearest_states, (5, True)),
        (neighbour_kernels.count_pairs, (np.ones(2),)),
        (neighbour_kernels.mean_partings, (1.0, 5)),
    ],
)
def test_a_search_of_neighbours_ends_at_its_budget(monkeypatch, kernel, further):
    """The time of one call grows with the square of the states if many of them are equal."""
    states, *order = neighbour_kernels.order_states(np.zeros((50, 2)))
    first = (states, states) if kernel is neighbour_kernels.mean_partings else (states,)
    assert kernel.py_func(*first, *order, 0, *further)[-1] >= 0
    monkeypatch.setattr(jit._here, "deadline", 1e-9)  # the CPU time of the thread is beyond it
    monkeypatch.setattr(jit._here, "look", 0.0)  # another test can have set a later time
    with pytest.raises(jit._BudgetUsedUp):
        kernel.py_func(*first, *order, 0, *further)


def test_kernels_that_must_not_be_interpreted_are_compiled_at_once(budget):
    budget(math.inf)
    assert halved(3.0) == 1.5
    assert halved._ready
    assert not total._ready


def test_a_large_array_is_never_interpreted(budget):
    budget(math.inf)
    total(np.zeros(30_001), np.zeros(30_001))
    assert total._ready


def test_threads_interpret_side_by_side(budget):
    budget(math.inf)
    values = np.arange(20_000.0)
    found = []

    def work():
        found.append(total(values, np.zeros(values.size)))

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [values.sum() / 2] * 4


SLOW = """
import sys
import numpy as np
from crosstrack import jit
jit._SILENCE = 0.2
jit.compile_always()
sys.stderr = sys.stdout

@jit.kernel
def smallest(x):
    return np.sort(x)[0]

print(smallest(np.ones(2, int)))
"""


def test_compilation_is_announced_in_a_pipe_too(run_python, tmp_path):
    """The first time only: compiled code is loaded."""
    script = tmp_path / "kernel.py"
    script.write_text(SLOW)
    first, second = (
        run_python(str(script), cwd=tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache")).splitlines()
        for _ in range(2)
    )
    assert first == ["compiling once, about 1 s (smallest)", "1"]
    assert second == ["1"]


def test_clocks_stand_still_while_a_run_compiles():
    control = Control(Seconds(0.3))
    control.arm(0.3)
    with control.stage(0.3) as stage:
        with stage.paused():
            time.sleep(0.5)
            control.check()
            assert not control.stopped
            assert not stage.stopped
        assert control.progress.seconds < 0.3
        time.sleep(0.5)
        assert stage.reason is Limit.TIME
    assert control.reason is Limit.TIME


def test_a_run_that_ended_while_it_compiled_gets_no_new_deadline():
    control = Control()
    control.arm(0.1)
    with control.paused():
        control.disarm()
    time.sleep(0.2)
    assert not control.stopped


def test_a_run_is_paused_until_the_last_of_overlapping_blocks_ends():
    control = Control()
    control.arm(0.3)
    first, second = control.paused(), control.paused()
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    time.sleep(0.5)
    assert not control.stopped
    second.__exit__(None, None, None)
    assert control.progress.seconds < 0.3
    time.sleep(0.5)
    assert control.reason is Limit.TIME


def test_compiling_is_timed_apart_and_no_part_of_the_time_limit(monkeypatch):
    """The clock of a limit is paused, and the run continues with the rest."""
    from crosstrack.solvers.error_correction.ceiling_kernels import climb

    monkeypatch.setattr(jit, "_left", 0.01)
    monkeypatch.setattr(climb, "_ready", False)
    dispatcher = climb.dispatcher

    class Slow:
        """Compiles a second longer."""

        __call__ = staticmethod(dispatcher)

        def compile(self, types):
            time.sleep(1.0)
            dispatcher.compile(types)

    monkeypatch.setattr(climb, "dispatcher", Slow())
    told = []
    from crosstrack.solvers.contract.job import Job
    from crosstrack.solvers.run.execution import execute

    model = uniform_slab(20_000, (10, 10, 10, 10, 10), seed=3)
    job = Job(model=model, backend="label-setting", time_limit=0.9).resolved()
    answer = execute(job, on_prepare=told.append)
    assert answer.termination == "optimal", answer
    assert answer.seconds["compile"] > 1.0
    assert answer.seconds["solve"] < 0.9
    # Once for the preparation and once for each kernel that this process has not called before.
    assert told == [True, False] * (len(told) // 2) and len(told) >= 4


def test_compilation_for_a_proof_is_not_part_of_solving(monkeypatch):
    """The seconds of solving lost all compiling of a run, and ended at zero."""

    @kernel
    def first(x):
        return x + 1

    @kernel
    def second(x):
        return x - 1

    class Parted(Fixed):
        def run(self, problem, request):
            begin = jit.clock()
            first(1)
            time.sleep(0.05)
            middle = jit.clock()
            second(1)
            parts = {"solve": middle - begin, "certify": jit.clock() - middle}
            return replace(super().run(problem, request), seconds=parts)

    for one in (first, second):
        monkeypatch.setattr(one, "dispatcher", _Lazy(one.py_func))
    monkeypatch.setattr(jit, "_left", 0.0)
    from crosstrack.solvers.contract.job import Job
    from crosstrack.solvers.run.execution import execute

    answer = execute(Job(ct.load("error-correction/example-1"), Parted()))
    assert answer.seconds["compile"] >= 1.0
    assert 0.05 <= answer.seconds["solve"] < 0.45 and answer.seconds["certify"] < 0.4


class _Lazy:
    """Compiles for half a second, for any arguments."""

    def __init__(self, function):
        self.function = function

    def __call__(self, *arguments):
        return self.function(*arguments)

    def compile(self, types):
        time.sleep(0.5)


def test_compilation_for_other_types_is_timed_too(monkeypatch):
    """Numba compiles implicitly for a read-only array."""

    @kernel
    def total(values):
        found = 0.0
        for one in values:
            found += one
        return found

    monkeypatch.setattr(jit, "_left", 0.0)
    told = []

    @contextmanager
    def watcher():
        told.append(None)
        yield

    free, fixed = np.ones(3), np.ones(3)
    fixed.flags.writeable = False
    with jit.watched(watcher):
        begin, clock = time.perf_counter(), jit.clock()
        for array, most in ((free, 1), (free, 1), (fixed, 2), (fixed, 2), (free, 2)):
            assert total(array) == 3.0
            assert len(told) == most
        assert jit.clock() - clock < 0.2 * (time.perf_counter() - begin)


def test_a_small_problem_loads_neither_numba_nor_scipy(run_python, tmp_path):
    script = (
        "import sys, crosstrack as ct\n"
        "print(ct.solve(ct.load(sys.argv[1])).verified)\n"
        "print([one for one in ('numba', 'scipy', 'casadi', 'pandas') if one in sys.modules])\n"
    )
    for name in ("error-correction/7", "minimum-snap/helix"):
        said = run_python("-c", script, name, cwd=tmp_path)
        assert said.splitlines() == ["True", "[]"], name


# -- the same results -----------------------------------------------------------------------------


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(["label-setting", "two-stage", "pulse", "dynamic-programming", "labelling"]),
    st.integers(2, 9), st.integers(0, 10_000), st.booleans(),
)  # fmt: skip
def test_routes_are_the_same_interpreted_and_compiled(name, points, seed, revisits):
    model = random_small(points, seed, revisits=revisits and name in ("label-setting", "labelling"))
    backend = find_backend(name, model)
    with pytest.MonkeyPatch.context() as patch:
        first, second = interpreted(backend, model), compiled(backend, model, patch)
    assert first.termination is second.termination
    assert first.point == second.point
    assert (first.primal_bound, first.dual_bound) == (second.primal_bound, second.dual_bound)
    assert counts(first) == counts(second)


@settings(max_examples=40, deadline=None)
@given(
    st.integers(2, 4), st.integers(1, 12), st.integers(1, 3), st.integers(0, 10_000),
    st.booleans(),
)  # fmt: skip
def test_trajectories_are_the_same_interpreted_and_compiled(order, segments, axes, seed, free):
    """Kernels for waypoints alone, and those that a free waypoint takes."""
    random = np.random.default_rng(seed)
    waypoints = random.normal(size=(segments + 1, axes))
    if free and segments > 1:
        waypoints[1] = np.inf
    times = np.concatenate([[0.0], np.exp(random.normal(size=segments)).cumsum()])
    model = ct.models.MinimumDerivative(waypoints, times, order=order)
    backend = find_backend("banded", model)
    with pytest.MonkeyPatch.context() as patch:
        second = compiled(backend, model, patch)
        factorise = sys.modules["crosstrack.solvers.minimum_snap.banded"].factorise
        solve = sys.modules["crosstrack.solvers.minimum_snap.banded"].solve_factors
        for one in (factorise, solve):  # never interpreted: they work in place
            patch.setattr(one, "_interpreted", one.dispatcher)
        first = interpreted(backend, model)
    assert first.termination is second.termination
    assert (first.primal_bound, first.dual_bound) == (second.primal_bound, second.dual_bound)
    assert counts(first) == counts(second)
    if second.point is not None:
        assert np.array_equal(first.point.coefficients, second.point.coefficients)


def test_no_kernel_that_may_start_again_updates_what_it_is_given():
    """A search that stops half-way leaves its arguments as they were."""
    from crosstrack.solvers.error_correction.airspace import airspace
    from crosstrack.solvers.error_correction.ceiling_kernels import climb

    space = airspace(ct.load("error-correction/7"))
    before = [np.array(part, copy=True) for part in space]
    jit._here.deadline, jit._here.look = time.thread_time() + 2e-3, 0.0
    try:
        with pytest.raises(jit._BudgetUsedUp):
            climb.py_func(space, math.inf, np.zeros(1, np.int8))
    finally:
        jit._here.deadline = 0.0
    assert all(np.array_equal(*pair) for pair in zip(before, space, strict=True))


def test_the_disk_cache_depends_on_the_called_kernels(tmp_path, run_python):
    """Numba stamps what it keeps with the caller's file alone."""
    package = tmp_path / "kept"
    package.mkdir()
    (package / "__init__.py").write_text("")
    inner = "from crosstrack.jit import kernel\n@kernel\ndef inner(x):\n    return {} * x\n"
    (package / "below.py").write_text(inner.format("2.0"))
    (package / "above.py").write_text(
        "from crosstrack.jit import compile_always, kernel\nfrom kept.below import inner\n"
        "@kernel\ndef outer(x):\n    return inner(x) + 1.0\n"
        "compile_always()\nprint(outer(3.0), inner(3.0))\n"
        "print(*(sum(it.dispatcher.stats.cache_hits.values()) for it in (outer, inner)))\n"
        "import sys\nprint('numba.np.linalg' in sys.modules)"  # imported to compile, not to load
    )

    def printed():
        return run_python("-c", "import kept.above", cwd=tmp_path).split()

    # The code of `inner` that `outer` calls has no wrapper, so a call from Python needs its own.
    assert printed() == ["7.0", "6.0", "0", "0", "True"]
    assert printed() == ["7.0", "6.0", "1", "1", "False"]
    (package / "below.py").write_text(inner.format("20.0"))
    assert printed() == ["61.0", "60.0", "0", "0", "True"]


@pytest.mark.parametrize(("shared", "compiled"), [("True", 1), ("False", 2)])
def test_a_shared_kernel_is_compiled_once_for_kernels_and_python(
    tmp_path, run_python, shared, compiled
):
    pytest.importorskip("numba", reason="nothing is compiled without Numba")
    (tmp_path / "parts.py").write_text(
        "from crosstrack import compilation\n"
        "from crosstrack.jit import compile_always, kernel\n"
        f"@kernel(shared={shared})\ndef inner(x):\n    return 2.0 * x\n"
        "@kernel\ndef outer(x):\n    return inner(x) + 1.0\n"
        "compile_always()\ncompilation.compile_here()\n"
        "print(outer(3.0), inner(3.0))\n"
    )
    folder = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    words = run_python(
        "-c", "import sys; sys.path.insert(0, '.'); import parts", cwd=tmp_path, **folder
    )
    assert words.split() == ["7.0", "6.0"]
    assert len(list((tmp_path / "cache").rglob("parts.inner-*.nbc"))) == compiled


def test_two_processes_that_compile_one_kernel_do_not_swap_its_code(tmp_path):
    """Both read an empty index, and the first writes its code after the second."""
    from numba.core.caching import IndexDataCacheFile

    def numba_file():
        return IndexDataCacheFile(str(tmp_path), "numba", "stamp")

    def our_file():
        file = IndexDataCacheFile(str(tmp_path), "ours", "")
        compilation.name_by_key(file, "stamp")
        return file

    def race(make):
        first, second = make(), make()
        second._load_index = dict
        delayed = []
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(first, "_save_data", lambda *arguments: delayed.append(arguments))
            first.save("whole numbers", "code for whole numbers")
        second.save("reals", "code for reals")
        first._save_data(*delayed[0])
        return make().load("reals")

    assert race(numba_file) == "code for whole numbers"  # the fault that our file does not have
    assert race(our_file) == "code for reals"
    assert our_file().load("whole numbers") is None  # compiled again


def test_calls_with_other_values_are_compiled_in_the_background_once(monkeypatch):
    bodies = queue.SimpleQueue()
    process = SimpleNamespace(poll=lambda: None, stdin=None)
    monkeypatch.setattr(compilation, "_process", process)
    monkeypatch.setattr(compilation, "_bodies", bodies)
    monkeypatch.setattr(compilation, "_requested", {})
    monkeypatch.setattr(compilation, "_events", deque())  # later tests wait for the others
    for number in range(100):
        arguments = (number, number / 7, [(0.5 * number, number)], np.full(3, number), number > 3)
        compilation.request("module", "kernel", arguments)
    assert bodies.qsize() == 1
    compilation.request("module", "kernel", (1.5, 0.5, [(0.5, 1)], np.zeros(3), True))
    assert bodies.qsize() == 2


#: A compiler that never reads its pipe, which holds about 64 KiB.
DEAF = """
import subprocess, sys, time
from crosstrack import compilation

start = subprocess.Popen
compilation.subprocess.Popen = lambda *command, **options: start(
    [sys.executable, "-c", "import time; time.sleep(20)"],
    stdin=subprocess.PIPE,
    stdout=subprocess.PIPE,
)
begin = time.perf_counter()
for count in range(300):  # tuples of different lengths are different types
    compilation.request("module", "kernel", tuple(range(count)))
print(time.perf_counter() - begin)
compilation._process.kill()
"""


def test_a_compiler_that_reads_nothing_does_not_block_a_run(run_python, tmp_path):
    assert float(run_python("-c", DEAF, cwd=tmp_path)) < 5.0


@pytest.mark.parametrize(
    "value", [3, 2.5, True, np.int32(7), [4, 5], [(1.5, 2)], (1, [2.0]), 2**63, np.inf]
)
def test_the_sample_of_a_request_has_the_compiled_type(value):
    numba = pytest.importorskip("numba", reason="types of compiled code need Numba")
    sample = compilation._sample(compilation._describe(value))
    assert numba.typeof(sample) == numba.typeof(value)


@kernel
def raised(value):
    return halved(value) + 1.0


@kernel
def added(values, counts):
    result = 0.0
    for value in values:
        counts[0] += 1
        result += raised(value)
    return result


@kernel(interpretable=True)
def summed(values, counts):
    result = 0.0
    for k in range(len(values)):
        result += added(values[k : k + 1], counts)
    return result


def test_interpreted_kernels_call_kernels_without_loops_as_functions(budget, monkeypatch):
    called = []
    original = jit.Kernel.__call__

    def call(self, *arguments):
        called.append(self.py_func.__name__)
        return original(self, *arguments)

    budget(math.inf)
    monkeypatch.setattr(jit.Kernel, "__call__", call)
    values = np.arange(4.0)
    assert summed(values, np.zeros(1)) == (values / 2 + 1.0).sum()
    assert called == ["summed", *4 * ["added"]]


class Columns(NamedTuple):
    visited: list[bool]


@kernel
def visited(columns, row):
    return columns.visited[row]


@kernel
def factorial(n):
    return n * factorial(n - 1) if n else 1


@kernel
def visited_or_factorial(columns, row):
    return factorial(row) if visited(columns, row) else 0


@kernel(interpretable=True)
def sum_of_visited(columns):
    result = 0
    for row in range(len(columns.visited)):
        result += visited_or_factorial(columns, row)
    return result


def test_an_attribute_with_the_name_of_a_kernel_is_no_call(budget):
    assert compilation.callees(visited) == {visited}
    assert compilation.callees(visited_or_factorial) == {visited_or_factorial, visited, factorial}
    budget(math.inf)
    assert sum_of_visited(Columns([True, False, True, True])) == 1 + 2 + 6
    assert visited_or_factorial._interpreted.__globals__["visited"] is visited.py_func
    assert visited_or_factorial._interpreted.__globals__["factorial"] is factorial


def test_a_search_of_simple_routes_is_interpreted(budget):
    """Its labels have a column with the name of a kernel; the search for that kernel's callees did not end."""
    budget(math.inf)
    model = random_small(8, 348)
    backend = find_backend("label-setting", model)
    answer = backend.run(model, Request(options=backend.checked_options({})))
    assert answer.termination.value == "optimal"


def test_a_kernel_in_no_cache_is_requested_after_half_of_its_further_budget(budget, monkeypatch):
    requests = []

    def start(*arguments):
        requests.append(jit._here.stage)
        return threading.Event()

    budget(1e-3)
    monkeypatch.setattr(jit, "AHEAD", 2e-3)
    monkeypatch.setattr(jit, "_ahead", 2e-3)
    monkeypatch.setattr(compilation, "may_be_cached", lambda function: False)
    monkeypatch.setattr(summed, "_ready", False)
    monkeypatch.setattr(jit, "start_compiling", start)
    counts = np.zeros(1)
    summed(np.arange(30_000.0), counts)
    assert requests == [1]
    assert summed._ready
    assert counts[0] > 30_000  # it started again


@pytest.mark.parametrize("is_cached", [False, True])
def test_a_kernel_that_is_cached_meanwhile_is_not_interpreted_further(
    budget, monkeypatch, is_cached
):
    """A kernel that another process had compiled after the first call was interpreted for up to 1.2 s more."""
    cached = [False]
    monkeypatch.setattr(compilation, "may_be_cached", lambda function: cached[0])
    monkeypatch.setattr(jit, "start_compiling", lambda *arguments: threading.Event())
    budget(0.0)
    monkeypatch.setattr(jit, "_ahead", 1000.0)
    monkeypatch.setattr(summed, "_ready", False)
    summed(np.arange(3.0), np.zeros(1))
    assert not summed._ready
    cached[0] = is_cached
    summed(np.arange(3.0), np.zeros(1))
    assert summed._ready == is_cached


@pytest.mark.parametrize("suffix", ["nbc", "nbi"])
def test_truncated_files_of_the_cache_are_compiled_again(tmp_path, run_python, suffix):
    pytest.importorskip("numba", reason="nothing is compiled without Numba")
    (tmp_path / "doubling.py").write_text(
        "from crosstrack.jit import compile_always, kernel\n"
        "@kernel\ndef doubled(x):\n    return 2.0 * x\n"
        "compile_always()\nprint(doubled(3.0), *doubled.dispatcher.stats.cache_hits.values())\n"
    )

    def printed():
        command = "import sys; sys.path.insert(0, '.'); import doubling"
        folder = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        return run_python("-c", command, cwd=tmp_path, **folder).split()

    assert printed() == ["6.0"]
    for path in (tmp_path / "cache").rglob(f"*.{suffix}"):
        path.write_bytes(path.read_bytes()[:40])
    assert printed() == ["6.0"]
    assert printed() == ["6.0", "1"]
