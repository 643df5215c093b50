"""Kernels that take long to compile: the background process compiles them, and the command compile."""

import contextlib
import json
import os
import signal
import sys
import threading
import time

import numpy as np
import pytest
from commands import run

from crosstrack import compilation, interpretation, jit

#: A module with a kernel, and a process that calls it.
MODULE = """
from crosstrack.jit import kernel

@kernel
def total(values):
    result = 0.0
    for value in values:
        result += value
    return result
"""
CALL = """
import sys
import numpy as np
from crosstrack import compilation, jit
import summing
jit._APART = 0.0
jit.compile_always()
if sys.argv[1] == "here":
    compilation.compile_here()
stats = summing.total.dispatcher.stats
print(summing.total(np.arange(4.0)), sum(stats.cache_hits.values()), sum(stats.cache_misses.values()))
"""


@pytest.mark.parametrize(("where", "loaded", "compiled"), [("apart", 1, 0), ("here", 0, 1)])
def test_the_background_process_compiles_long_kernels(
    run_python, tmp_path, where, loaded, compiled
):
    pytest.importorskip("numba", reason="nothing is compiled without Numba")
    (tmp_path / "summing.py").write_text(MODULE)
    folder = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n{CALL}"
    words = run_python("-c", code, where, cwd=tmp_path, **folder).split()
    assert words == ["6.0", str(loaded), str(compiled)]


@pytest.fixture
def never_ready(monkeypatch):
    """Let the background process run, without an end of any request."""
    monkeypatch.setattr(compilation, "request", lambda *arguments, **options: threading.Event())
    monkeypatch.setattr(compilation, "is_running", lambda: True)


def test_a_wait_ends_at_the_limit(never_ready):
    begin = time.perf_counter()
    assert not compilation.wait_for("module", "kernel", (), begin + 0.1)
    assert time.perf_counter() - begin < 2.0


@pytest.mark.parametrize(("limit", "largest"), [(40.0, 10.0), (None, 60.0)])
def test_waits_are_bounded_with_and_without_a_limit(monkeypatch, limit, largest):
    """Another process may take far longer to compile than expected, or be stopped."""
    pytest.importorskip("numba", reason="nothing is compiled without Numba")

    @jit.kernel
    def increased(value):
        return value + 1

    waits = []

    def wait_for(module, name, arguments, end):
        waits.append(end - time.perf_counter())
        return False

    monkeypatch.setattr(jit, "_APART", 0.0)
    monkeypatch.setattr(compilation, "is_cached", lambda *arguments: False)
    monkeypatch.setattr(compilation, "wait_for", wait_for)
    with jit.within(jit.Limit(limit)):
        assert increased(1) == 2  # interpreted with a limit, otherwise compiled here
    assert len(waits) == 1 and 0.9 * largest < waits[0] <= largest + 0.1
    assert increased._ready == (limit is None)


@pytest.fixture
def increased():
    """Kernel that takes far less than `jit._APART` to compile."""
    pytest.importorskip("numba", reason="nothing is compiled without Numba")

    @jit.kernel(interpretable=True)
    def increased(value):
        return value + 1

    return increased


@pytest.mark.parametrize(
    ("limit", "runs", "waits"), [(None, True, 1), (None, False, 0), (1e6, True, 0)]
)
def test_a_running_background_process_compiles_short_kernels_of_unlimited_runs(
    monkeypatch, increased, limit, runs, waits
):
    """Compiling them here took two of the five seconds of CPU of a first tour."""
    names = []
    monkeypatch.setattr(jit, "_left", 0.0)
    monkeypatch.setattr(compilation, "is_cached", lambda *arguments: False)
    monkeypatch.setattr(compilation, "is_running", lambda: runs)
    monkeypatch.setattr(
        compilation, "wait_for", lambda module, name, *_: names.append(name) or True
    )
    with jit.within(jit.Limit(limit)):
        assert increased(1) == 2
    assert len(names) == waits and increased._ready


@pytest.mark.parametrize("processes", [1.0, 1e9])
def test_a_run_with_a_limit_compiles_nothing_on_a_busy_machine(monkeypatch, increased, processes):
    """A short route of 0.5 s of CPU took 13 s at a limit of 8 s, because compiling takes longer under load."""
    monkeypatch.setattr(jit, "_left", 0.0)
    monkeypatch.setattr(compilation, "slowdown", lambda: processes)
    monkeypatch.setattr(compilation, "is_cached", lambda *arguments: False)
    monkeypatch.setattr(compilation, "request", lambda *arguments: None)
    with jit.within(jit.Limit(1e6)):
        assert increased(1) == 2
    assert increased._ready == (processes == 1.0)


def test_a_run_with_a_limit_compiles_nothing_after_slow_compiling(monkeypatch, increased):
    monkeypatch.setattr(jit, "_left", 0.0)
    monkeypatch.setattr(jit, "_SLOW", 0.0)
    limit = jit.Limit(1e6)
    with jit.within(limit):
        assert increased(1) == 2
    assert increased._ready and not limit.may_compile


@pytest.mark.parametrize(
    ("load", "processes"), [((0.5, 9, 9), 1.0), ((6, 0, 0), 3.0), (OSError, 1.0)]
)
def test_the_load_of_the_machine_is_per_processor(monkeypatch, load, processes):
    def getloadavg():
        if load is OSError:
            raise OSError
        return load

    monkeypatch.setattr(os, "getloadavg", getloadavg, raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    assert compilation.slowdown() == processes


@pytest.mark.parametrize(("seconds", "compiled"), [(0.1, False), (10.0, True)])
def test_a_loop_that_nothing_ends_early_is_not_begun_if_the_last_one_exceeds_the_budget(
    monkeypatch, increased, seconds, compiled
):
    """The last of five searches of neighbours was interpreted for a second, with its code compiled meanwhile."""
    monkeypatch.setattr(jit, "_left", 0.5)
    monkeypatch.setattr(jit, "_ahead", 0.75)
    monkeypatch.setattr(jit, "start_compiling", lambda *_: threading.Event())
    increased._last = seconds
    assert increased(1) == 2
    assert increased._ready == compiled
    assert increased._last < 0.1


@pytest.mark.parametrize("waits_in_vain", [True, False])
def test_a_kernel_is_interpreted_after_compiling_has_used_the_share(monkeypatch, waits_in_vain):
    """On a busy machine, the first kernels of a small model may take longer to compile than all may be interpreted."""
    pytest.importorskip("numba", reason="nothing is compiled without Numba")

    @jit.kernel
    def increased(value):
        return value + 1

    @jit.kernel
    def doubled(value):
        return 2 * value

    waits = []

    def wait_for(module, name, arguments, end):
        waits.append(name)
        assert limit.interpretation_end > end
        return False

    monkeypatch.setattr(jit, "_APART", 0.0)
    monkeypatch.setattr(compilation, "is_cached", lambda *arguments: False)
    monkeypatch.setattr(compilation, "wait_for", wait_for)
    monkeypatch.setattr(compilation, "request", lambda *arguments: None)
    limit = jit.Limit(1000.0, 0.0)  # the share has passed
    increased._compile_seconds = 0.0 if waits_in_vain else 1e6
    with jit.within(limit):
        assert increased(1) == 2
        assert limit.interpreted and not limit.is_interpreted_too_long
        assert doubled(2) == 4
    assert len(waits) == waits_in_vain  # none for the second kernel
    assert not increased._ready and not doubled._ready


IMPORTS = """
import sys, threading, time
from crosstrack import jit

failed = []

def load():
    try:
        jit._import_numba()
    except AttributeError as error:
        failed.append(error)

threads = [threading.Thread(target=load, daemon=True) for _ in range(20)]
threads[0].start()
while "numba.core" not in sys.modules:
    time.sleep(0.001)
for thread in threads[1:]:
    thread.start()
    time.sleep(0.01)
for thread in threads:
    thread.join(30.0)
print(len(failed), any(thread.is_alive() for thread in threads))
"""


def test_threads_import_numba_one_after_another(run_python, tmp_path):
    """Without a lock, a thread can use a module of events that another one has not imported completely.

    Its exception leaves LLVM's lock held, so that all later imports of Numba wait for ever.
    """
    pytest.importorskip("numba", reason="nothing is compiled without Numba")
    assert run_python("-c", IMPORTS, cwd=tmp_path).split() == ["0", "False"]


def test_a_wait_ends_with_the_process(never_ready, monkeypatch):
    monkeypatch.setattr(compilation, "is_running", lambda: False)
    assert compilation.wait_for("module", "kernel", (), float("inf"))


def test_a_stop_request_ends_a_wait(never_ready, monkeypatch):
    pytest.importorskip("numba", reason="nothing is compiled without Numba")

    @jit.kernel
    def increased(value):
        return value + 1

    monkeypatch.setattr(jit, "_APART", 0.0)
    monkeypatch.setattr(compilation, "is_cached", lambda *arguments: False)
    result = []

    def call():
        try:
            result.append(increased(1))
        except jit.OutOfTime:
            result.append("out of time")

    thread = threading.Thread(target=call, daemon=True)
    thread.start()
    for _ in range(200):
        jit.end_interpretation(thread.ident)  # without effect before the wait
        thread.join(0.05)
    assert result == ["out of time"]


def test_a_run_with_a_limit_does_not_wait_for_the_compiling_of_another_run(
    never_ready, monkeypatch
):
    pytest.importorskip("numba", reason="nothing is compiled without Numba")

    @jit.kernel
    def increased(value):
        return value + 1

    @jit.kernel
    def decreased(value):
        return value - 1

    def wait():
        with contextlib.suppress(jit.OutOfTime):
            increased(1)

    def call():
        with jit.within(jit.Limit(60.0)):
            result.append(decreased(1))

    result = []
    monkeypatch.setattr(jit, "_APART", 0.0)
    monkeypatch.setattr(compilation, "is_cached", lambda item, _: item is decreased.dispatcher)
    threads = [threading.Thread(target=target, daemon=True) for target in (wait, call)]
    threads[0].start()
    while threads[0].ident not in jit._ending:
        time.sleep(0.01)
    threads[1].start()
    threads[1].join(30.0)
    assert result == [0] and threads[0].is_alive()
    while threads[0].is_alive():
        jit.end_interpretation(threads[0].ident)
        threads[0].join(0.05)


@jit.kernel
def remainder(value):
    return (3.0 * value + 1.0) % 7.0


@jit.kernel(interpretable=True, in_place=True)
def iterate(values, steps):
    """Replace each value by a remainder, again and again."""
    for _ in range(steps):
        for i in range(len(values)):
            values[i] = remainder(values[i])


@pytest.mark.parametrize("budget", [1e-3, 60.0])
def test_a_kernel_that_works_in_place_starts_again_from_its_arguments(monkeypatch, budget):
    pytest.importorskip("numba", reason="nothing is compiled without Numba")
    monkeypatch.setattr(jit, "_left", budget)
    monkeypatch.setattr(jit, "_ahead", 0.0)
    monkeypatch.setattr(iterate, "_ready", False)
    monkeypatch.setattr(iterate, "_is_new", True)
    values = np.array([0.1, 1.7, 4.0])
    expected = values.copy()
    iterate.dispatcher(expected, 5000)
    iterate(values, 5000)
    assert np.array_equal(values, expected)
    assert iterate._ready == (budget < 1.0)


def test_a_restart_keeps_the_stop_flag_and_restores_the_rest():
    flag, values, draws = np.zeros(1, np.int8), np.arange(3.0), np.random.default_rng(1)
    former = interpretation.copies_of((flag, (values, 2.0), draws))
    flag[0], values[:], first = 1, 0.0, draws.random()
    interpretation.restore(former)
    assert flag[0] == 1 and values.tolist() == [0.0, 1.0, 2.0] and draws.random() == first


COMMAND = """
import importlib.util, sys
import numpy as np
from crosstrack.__main__ import main
from crosstrack.cli import kernels
from crosstrack.jit import compile_always

def runs(problem):
    spec = importlib.util.spec_from_file_location("crosstrack.summing", "summing.py")
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    compile_always()
    module.total(np.arange(4.0))
    return []

kernels._runs = runs
main(["compile", "grid-path", "--json"])
"""


def test_compile_counts_what_it_compiles_and_what_is_present(run_python, tmp_path):
    pytest.importorskip("numba", reason="nothing is compiled without Numba")
    (tmp_path / "summing.py").write_text(MODULE)
    folder = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    for counts in ({"compiled": 1, "present": 0}, {"compiled": 0, "present": 1}):
        assert json.loads(run_python("-c", COMMAND, cwd=tmp_path, **folder)) == counts


def test_compile_suggests_the_name_of_a_problem():
    done = run("compile", "grid-pat", code=2)
    assert "did you mean 'grid-path'" in done.stderr


#: Two requests of a process that loses its background process after the first.
LOST = """
import os, sys, time
from crosstrack import compilation
module = "crosstrack.models.messenger.dubins"
compilation.request(module, "shortest", (0.0,), nice=0)
if sys.argv[1] == "killed":
    compilation._process.kill()
    compilation._process.wait()
elif worker := os.fork():
    sys.exit(os.waitstatus_to_exitcode(os.waitpid(worker, 0)[1]))
compilation.request(module, "shortest", (0,), nice=0)
print(compilation.wait_for(module, "shortest", (0.0,), time.perf_counter() + 200.0), flush=True)
"""


@pytest.mark.parametrize("loss", ["killed", "forked"])
def test_a_wait_ends_after_another_process_was_started(run_python, tmp_path, loss):
    if not hasattr(os, "fork"):
        pytest.skip("processes cannot be forked here")
    folder = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    assert run_python("-c", LOST, loss, cwd=tmp_path, **folder).split() == ["True"]


@pytest.mark.parametrize(
    ("name", "value"), [("executable", ""), ("executable", None), ("frozen", True)]
)
def test_an_application_without_an_interpreter_starts_no_process(monkeypatch, name, value):
    monkeypatch.setattr(sys, name, value, raising=False)
    assert (
        compilation.request("crosstrack.models.messenger.dubins", "shortest", (-1.0, 0.5)) is None
    )


#: A request that takes seconds, of a process that ends at once.
ENDING = """
import sys
from crosstrack import compilation
compilation.request("lasting", "kernel", (), nice=0)
print(compilation._process.pid)
"""
LASTING = """
import os, time
class kernel:
    def compile_for(arguments):
        for _ in range(200):
            with open("niceness", "w") as file:
                file.write(str(os.getpriority(os.PRIO_PROCESS, 0)))
            time.sleep(0.1)
"""


def test_the_background_process_gives_way_when_its_parent_has_ended(run_python, tmp_path):
    if not hasattr(os, "nice"):
        pytest.skip("processes have no niceness here")
    (tmp_path / "lasting.py").write_text(LASTING)
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n{ENDING}"
    process = int(run_python("-c", code, cwd=tmp_path))
    expected = str(min(19, os.getpriority(os.PRIO_PROCESS, 0) + 10))
    try:
        for _ in range(150):
            time.sleep(0.1)
            if (tmp_path / "niceness").exists() and (tmp_path / "niceness").read_text() == expected:
                break
        else:
            pytest.fail("the niceness did not change")
    finally:
        os.kill(process, signal.SIGKILL)


#: A wait for a kernel, and for another one, that a process with a large niceness never compiles.
STARVED = """
import os, sys, time
from crosstrack import compilation
for name in ("first", "second"):
    compilation.request("starved", name, ())
former = compilation._process
try:
    for name in ("first", "second"):
        end = time.perf_counter() + 100.0
        print(compilation.wait_for("starved", name, (), end))
    print(former.poll() is None and former is not compilation._process)
finally:
    former.kill()
    print(former.wait() < 0)
    while not former.stdout.closed or not former.stdin.closed:
        time.sleep(0.01)
"""
KERNELS = """
import os, time
NICENESS = os.getpriority(os.PRIO_PROCESS, os.getppid())
class first:
    def compile_for(arguments):
        while os.getpriority(os.PRIO_PROCESS, 0) > NICENESS:
            time.sleep(0.1)
second = first
"""


def test_a_wait_does_not_depend_on_a_process_with_a_large_niceness(run_python, tmp_path):
    if not hasattr(os, "nice") or os.getpriority(os.PRIO_PROCESS, 0) > 18:
        pytest.skip("processes have no larger niceness here")
    (tmp_path / "starved.py").write_text(KERNELS)
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n{STARVED}"
    assert run_python("-c", code, cwd=tmp_path).split() == ["True"] * 4
