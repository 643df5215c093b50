"""Evaluations of Python functions: batches, workers, failures and records."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import cloudpickle
import numpy as np
import pytest
from black_box.searches import EVERY, box, search

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models.black_box import PythonFunction
from crosstrack.solvers import Limit

cloudpickle.register_pickle_by_value(sys.modules[__name__])

UNIT = ((0, 1), (0, 1))
POINTS = np.random.default_rng(3).random((9, 2))
VALUES = (POINTS**2).sum(axis=1)


def bowl(x):
    return float((x**2).sum())


def bowls(x):
    return (x**2).sum(axis=1)


def boxed(call, budget=50, **options):
    return box(PythonFunction(call, **options), *UNIT, budget=budget)


@pytest.fixture(scope="module", params=["threads", "processes", 2])
def workers(request):
    if request.param == 2:
        yield 2
        return
    kind = ThreadPoolExecutor if request.param == "threads" else ProcessPoolExecutor
    with kind(2) as executor:
        yield executor


# -- batches -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["differential-evolution", "cma-es", "random-search", "iafsa"])
def test_a_generation_is_one_call_of_a_vectorised_function(name):
    if (name,) not in [tuple(one.values) for one in EVERY if not one.marks]:
        pytest.importorskip("cma", reason="cma-es needs crosstrack[blackbox]")
    sizes = []

    def call(x):
        sizes.append(len(x))
        return bowls(x)

    model = boxed(call, budget=300, vectorized=True)
    answer, _ = search(name, model, seed=1)
    assert sum(sizes) == 300 == answer.statistics["evaluations"]
    assert len(sizes) <= {"random-search": 2, "differential-evolution": 40}.get(name, 60)
    assert sizes[0] > 1


def test_requests_are_answered_in_parts_of_a_tenth_of_a_second():
    model = boxed(lambda x: time.sleep(0.03) or bowl(x))
    oracle = model.oracle()
    first = oracle.part(POINTS)
    assert 1 <= len(first) < len(POINTS) and oracle.left == 50 - len(first)
    rest = oracle(POINTS[len(first) :])
    np.testing.assert_allclose(np.concatenate([first, rest])[:, 0], VALUES)
    assert oracle.left == 41


def test_a_slow_function_is_stopped_within_a_generation():
    begin = time.perf_counter()
    model = boxed(lambda x: time.sleep(0.05) or bowl(x), budget=10**4)
    found = ct.solve(model, "differential-evolution", seed=1, time_limit=0.6)
    assert found.limit is Limit.TIME and found.verification.ok
    assert found.statistics["evaluations"] < 100
    assert time.perf_counter() - begin < 8


def test_a_run_does_not_wait_for_a_call_after_its_limit():
    gate, count = threading.Event(), [0]

    def call(x):
        count[0] += 1
        gate.wait(30 if count[0] == 3 else 0.11)
        return bowl(x)

    begin = time.perf_counter()
    found = ct.solve(boxed(call), "random-search", seed=1, time_limit=0.5)
    seconds = time.perf_counter() - begin
    gate.set()
    assert found.limit is Limit.TIME and found.verification.ok and seconds < 9


# -- workers -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("vectorized", [False, True])
def test_workers_give_the_same_values(workers, vectorized):
    model = boxed(bowls if vectorized else bowl, vectorized=vectorized, workers=workers)
    oracle = model.oracle()
    np.testing.assert_allclose(oracle(POINTS)[:, 0], VALUES)
    assert oracle.left == 41
    # Values that were started arrive in the order of the requests, and count once.
    oracle.start(POINTS[:5])
    assert oracle.left == 36
    np.testing.assert_allclose(oracle(POINTS[[4, 0, 8]])[:, 0], VALUES[[4, 0, 8]])
    assert oracle.left == 35
    assert model.verify(model.as_plan({"x": [0.5, 0.5]})).objective == 0.5


@pytest.mark.parametrize("name", ["random-search", "differential-evolution"])
def test_workers_give_the_plan_of_one_process(workers, name):
    alone = search(name, boxed(bowl, 240), seed=4, evaluations=200)[0]
    several = ct.solve(boxed(bowl, 240, workers=workers), name, seed=4, evaluations=200)
    assert several.statistics["evaluations"] == 200
    if name == "random-search":  # generations of the other have a multiple of the workers
        assert several.plan == alone.point
        return
    again = ct.solve(boxed(bowl, 240, workers=workers), name, seed=4, evaluations=200)
    assert again.plan == several.plan


def test_eight_workers_are_six_times_as_fast():
    """Threads that sleep need no processor, as processes that wait for a simulation."""
    seconds = 0.02

    def slow(x):
        time.sleep(seconds)
        return bowl(x)

    with ThreadPoolExecutor(8) as executor:
        for name in ("random-search", "differential-evolution"):
            begin = time.perf_counter()
            found = ct.solve(boxed(slow, 400, workers=executor), name, seed=1, isolate=False)
            assert found.statistics["evaluations"] == 400
            assert time.perf_counter() - begin < 400 * seconds / 4  # a sixth on an idle machine


def test_a_search_does_not_wait_for_the_slowest_point_of_a_batch(monkeypatch):
    """Look-ahead keeps the other workers busy."""
    from crosstrack.solvers.black_box import random_search

    monkeypatch.setattr(random_search, "_BATCH", 4)
    lock, gate, count = threading.Lock(), threading.Event(), [0]

    def call(x):
        with lock:
            count[0] += 1
            first = count[0] == 1
            if count[0] == 8:  # the second batch, while the first point is still evaluated
                gate.set()
        if first:
            assert gate.wait(20)
        return bowl(x)

    with ThreadPoolExecutor(2) as executor:
        answer, _ = search("random-search", boxed(call, 16, workers=executor), seed=2)
    assert answer.statistics["evaluations"] == 16 and gate.is_set()


def test_an_error_at_a_point_that_was_started_is_not_an_exceeded_budget():
    def fragile(x):
        if x[0] == POINTS[1, 0]:
            raise ArithmeticError("unstable")
        return bowl(x)

    with ThreadPoolExecutor(2) as executor:
        oracle = boxed(fragile, len(POINTS), workers=executor).oracle()
        oracle.start(POINTS)
        while not len(oracle.part(POINTS)):
            pass  # a tenth of a second may be too short on a busy machine
        with pytest.raises(InvalidData, match="ArithmeticError: unstable"):
            oracle.part(POINTS[1:])


@pytest.mark.parametrize("isolate", [False, True])
def test_the_verification_does_not_wait_for_points_that_were_not_requested(isolate):
    count = [0]

    def call(x):
        count[0] += 1
        time.sleep(0.1)
        return bowl(x)

    with ThreadPoolExecutor(2) as executor:
        model = boxed(call, 10**4, workers=executor)
        found = ct.solve(model, "random-search", seed=1, time_limit=1, isolate=isolate)
    assert found.verification.ok and count[0] < 200  # of 512 that were started


@pytest.mark.parametrize(("name", "size"), [("differential-evolution", 16), ("cma-es", 8)])
def test_generations_are_multiples_of_the_workers(name, size):
    if name == "cma-es":
        pytest.importorskip("cma", reason="cma-es needs crosstrack[blackbox]")
    sizes = []

    def call(x):
        sizes.append(len(x))
        return bowls(x)

    for workers, expected in ((1, {"cma-es": 6}.get(name, 15)), (ThreadPoolExecutor(8), size // 8)):
        sizes.clear()
        model = box(PythonFunction(call, vectorized=True, workers=workers), *UNIT, budget=300)
        search(name, model, seed=1)
        assert set(sizes[:8]) == {expected} or (workers == 1 and sizes[0] == expected)


def test_closures_and_lambdas_reach_worker_processes():
    factor = 3.0
    model = boxed(lambda x: factor * bowl(x), workers=2)
    np.testing.assert_allclose(model.oracle()(POINTS)[:, 0], 3 * VALUES)


@pytest.mark.parametrize(
    ("options", "message", "field"),
    [
        ({"workers": 0}, "workers must be a number of processes from 1 to 1024, or an executor", "workers"),
        ({"workers": 2.5}, "workers must be a number .* got 2.5", "workers"),
        ({"workers": True}, "workers must be a number .* got True", "workers"),
        ({"workers": ThreadPoolExecutor}, "workers must be a number", "workers"),
        ({"workers": None}, "workers must be a number .* got None", "workers"),
        ({"on_error": "ignore"}, "on_error must be one of raise, skip, got 'ignore'", "on_error"),
        ({"on_error": None}, "on_error must be one of raise, skip", "on_error"),
        ({"record": 3}, "record must be a string, got 3", "record"),
        ({"record": "a\0b"}, "record must be a path, got ", "record"),
    ],
)  # fmt: skip
def test_rejects_unsuitable_options(options, message, field):
    with pytest.raises(InvalidData, match=message) as caught:
        PythonFunction(bowl, **options)
    assert caught.value.field == field


def test_a_function_that_no_process_can_receive_is_refused():
    lock = threading.Lock()

    def locked(x):
        with lock:
            return bowl(x)

    with pytest.raises(
        InvalidData, match=r"cannot be sent to worker processes .*ThreadPoolExecutor"
    ):
        ct.solve(boxed(locked, workers=2), "random-search")
    executor = ThreadPoolExecutor(1)
    executor.shutdown()
    with pytest.raises(InvalidData, match="executor is broken or shut down"):
        ct.solve(boxed(bowl, workers=executor, on_error="skip"), "random-search")
    with pytest.raises(InvalidData, match="must return a number, got 'a'"):
        ct.solve(boxed(lambda x: "a", workers=2, on_error="skip"), "random-search")


def test_the_digest_does_not_depend_on_how_a_function_is_called():
    function = PythonFunction(bowl)
    models = [
        box(PythonFunction(bowl, token=function.token, **options), *UNIT)
        for options in ({}, {"workers": 2}, {"on_error": "skip"}, {"record": "x.jsonl"})
    ]
    assert len({model.digest for model in models}) == 1
    with ThreadPoolExecutor(1) as executor:
        model = box(PythonFunction(bowl, workers=executor), *UNIT)
        assert cloudpickle.loads(cloudpickle.dumps(model)).function.workers == 1


# -- failures ----------------------------------------------------------------------------------------


def fragile(x):
    if x[0] > 0.5:
        raise ZeroDivisionError("too far right")
    return bowl(x)


def fragiles(x):
    if (x[:, 0] > 0.5).any():
        raise ZeroDivisionError("too far right")
    return bowls(x)


def deadly(x):
    if x[0] > 0.8:
        os._exit(3)
    return bowl(x)


@pytest.mark.parametrize("count", [1, "pool"])
@pytest.mark.parametrize("vectorized", [False, True])
def test_skipped_points_have_no_value(workers, count, vectorized):
    options = {
        "vectorized": vectorized,
        "on_error": "skip",
        "workers": 1 if count == 1 else workers,
    }
    oracle = boxed(fragiles if vectorized else fragile, **options).oracle()
    expected = np.where(POINTS[:, 0] > 0.5, np.nan, VALUES)
    np.testing.assert_allclose(oracle(POINTS)[:, 0], expected)
    counts, text = oracle.remarks()
    first = POINTS[POINTS[:, 0] > 0.5][0]
    assert counts == {"skipped evaluations": int((POINTS[:, 0] > 0.5).sum())}
    assert "function raised ZeroDivisionError: too far right" in text and str(first[0]) in text


@pytest.mark.parametrize("isolate", [False, True])
def test_a_run_continues_after_exceptions(isolate):
    model = boxed(fragile, 40, on_error="skip")
    found = ct.solve(model, "random-search", seed=1, isolate=isolate)
    assert found.statistics["evaluations"] == 40 and found.verification.ok
    skipped = found.statistics["skipped evaluations"]
    assert 5 < skipped < 35 and skipped == found.statistics["points without a value"]
    assert f"{skipped} evaluations skipped, the first: function raised ZeroDiv" in found.message
    nowhere = ct.solve(boxed(lambda x: 1 / 0, 7, on_error="skip"), "random-search")
    assert nowhere.plan is None and nowhere.statistics["skipped evaluations"] == 7


def test_an_exception_is_raised_after_the_values_before_it(workers):
    for options in ({}, {"workers": workers}):
        oracle = boxed(fragile, **options).oracle()
        bad = int((POINTS[:, 0] > 0.5).argmax())
        done = 0
        while done < bad:
            done += len(oracle.part(POINTS[done:]))
        assert done == bad > 0
        with pytest.raises(InvalidData, match="function raised ZeroDivisionError"):
            oracle(POINTS[done:])


def test_a_worker_process_that_ends_is_a_named_error_or_a_skipped_point():
    bad = POINTS[:, 0] > 0.8
    assert bad.any() and not bad.all()
    with pytest.raises(InvalidData, match=r"function ended its worker process \(exit code 3\), at"):
        boxed(deadly, workers=2).oracle()(POINTS)
    oracle = boxed(deadly, workers=2, on_error="skip").oracle()
    np.testing.assert_allclose(oracle(POINTS)[:, 0], np.where(bad, np.nan, VALUES))
    assert oracle.remarks()[0] == {"skipped evaluations": int(bad.sum())}


def test_a_worker_process_that_was_killed_while_idle_is_replaced():
    model = boxed(lambda x: float(os.getpid()), workers=2)
    first = set(model.oracle()(POINTS)[:, 0])
    for number in first:
        os.kill(int(number), signal.SIGKILL)
    time.sleep(0.1)
    second = set(model.oracle()(POINTS)[:, 0])
    assert not first & second


def test_worker_processes_end_with_their_function():
    model = boxed(lambda x: float(os.getpid()), workers=2)
    numbers = set(model.oracle()(POINTS)[:, 0])
    del model
    for number in numbers:
        with pytest.raises(ProcessLookupError):
            os.kill(int(number), 0)


def test_sys_exit_in_a_function_ends_the_run_only():
    with pytest.raises(InvalidData, match="function raised SystemExit: 3"):
        ct.solve(boxed(lambda x: sys.exit(3)), "random-search")


# -- records -----------------------------------------------------------------------------------------


def test_a_record_answers_equal_requests(tmp_path, workers):
    path = tmp_path / "run.jsonl"
    calls = []

    def call(x):
        calls.append(1)
        return np.nan if x[0] > 0.9 else bowl(x)

    def run(**options):
        return ct.solve(boxed(call, 30, record=path, **options), "random-search", seed=5)

    found = run()
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    assert lines[0]["crosstrack"] == "black-box record" and lines[0]["bounds"] == [[0, 1], [0, 1]]
    assert len(lines) == 31 and all(line["seconds"] >= 0 for line in lines[1:])
    assert len(calls) == 31  # with the verification
    assert run().plan == found.plan and len(calls) == 32
    assert run(workers=workers, on_error="skip").plan == found.plan
    assert len(path.read_text().splitlines()) == 31
    # A part of the lines, without the end of the last one, as after a crash.
    path.write_text("\n".join(path.read_text().splitlines()[:12])[:-7])
    again = run()
    assert again.plan == found.plan and len(path.read_text().splitlines()) == 31
    assert again.statistics == found.statistics


def test_a_record_keeps_skipped_points(tmp_path):
    path = tmp_path / "run.jsonl"
    for _ in range(2):
        oracle = boxed(fragile, on_error="skip", record=path).oracle()
        assert np.isnan(oracle(POINTS)[:, 0]).any()
        assert oracle.remarks()[0] == {"skipped evaluations": int((POINTS[:, 0] > 0.5).sum())}
        oracle.close()
    assert len(path.read_text().splitlines()) == 10


def test_a_record_keeps_the_order_of_repeated_evaluations(tmp_path):
    generator = np.random.default_rng(0)

    def noisy(x):
        return float(generator.normal())

    first, second = (
        box(PythonFunction(noisy, record=tmp_path / "run"), *UNIT, repeats=3).oracle()(POINTS)
        for _ in range(2)
    )
    np.testing.assert_array_equal(first, second)
    assert len(np.unique(first)) == 9


HEADER = '{"crosstrack": "black-box record", "version": 1, "function": "bowl", "bounds": [[0.0, 1.0], [0.0, 1.0]]}'
LINE = '{"x": [0.5, 0.25], "values": [1.5]}'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEADER.replace("bowl", "drag"), "line 1: its function is 'drag', and this run has 'bowl'; use another file"),
        (HEADER.replace("[0.0, 1.0]]", "[0.0, 2.0]]"), "line 1: its bounds is"),
        (HEADER.replace("version\": 1", "version\": 2"), "line 1: its version is 2"),
        (HEADER[:-1] + ', "seed": 1}', "line 1: its seed is 1, and this run has None"),
        (LINE, "line 1: its crosstrack is None"),
        ("[1, 2]", "line 1: must be a JSON object"),
        ("\0\0\0", "line 1: must be a JSON object"),
        (f"{HEADER}\n{LINE}\nnonsense\n{LINE}", "line 3: must be a JSON object"),
        (f"{HEADER}\n\n{LINE}", "line 2: must be a JSON object"),
        (f"{HEADER}\n" + LINE.replace("0.25", "1e999"), r"line 2: x must be a list of 2 numbers"),
        (f"{HEADER}\n" + LINE.replace("0.25", "NaN"), r"line 2: x must be a list of 2 numbers"),
        (f"{HEADER}\n" + LINE.replace("0.25", "9" * 400), r"line 2: x must be a list of 2 numbers"),
        (f"{HEADER}\n" + LINE.replace("0.25", "true"), r"line 2: x must be a list of 2 numbers"),
        (f"{HEADER}\n" + LINE.replace(", 0.25", ""), r"line 2: x must be a list of 2 numbers"),
        (f"{HEADER}\n" + LINE.replace("1.5", '"1.5"'), r"line 2: values must be a list of 1 number"),
        (f"{HEADER}\n" + LINE.replace("[1.5]", "1.5"), r"line 2: values must be a list of 1 number"),
        (f"{HEADER}\n" + LINE[:-1] + ', "error": 3}', "line 2: error must be a text, got 3"),
        (f"{HEADER}\n" + "[" * 10**5, "line 2: must be a JSON object"),
    ],
)  # fmt: skip
def test_rejects_damaged_records(tmp_path, text, message):
    path = tmp_path / "run.jsonl"
    path.write_text(text + "\n")
    with pytest.raises(InvalidData, match=message) as caught:
        boxed(bowl, record=path).oracle()
    assert caught.value.field == "record" and str(path) in str(caught.value)
    assert path.read_text() == text + "\n"


@pytest.mark.parametrize("text", ["hello", "{}", f"{LINE}\nhello", "\0\n\1"])
def test_keeps_a_file_that_is_no_record(tmp_path, text):
    path = tmp_path / "notes"
    path.write_text(text)
    with pytest.raises(InvalidData, match="line 1"):
        boxed(bowl, record=path).oracle()
    assert path.read_text() == text


def test_replaces_an_incomplete_header(tmp_path):
    path = tmp_path / "run.jsonl"
    path.write_text(HEADER[:40])
    boxed(bowl, record=path).oracle().close()
    assert path.read_text() == HEADER + "\n"


def test_rejects_a_record_that_cannot_be_opened(tmp_path):
    for path in (tmp_path, tmp_path / "missing" / "run.jsonl"):
        with pytest.raises(InvalidData, match=r"record .*: (Is a directory|No such file)"):
            ct.solve(boxed(bowl, record=path), "random-search")


SCRIPT = """
import os, sys, time
import crosstrack as ct
from crosstrack.models import BlackBoxMinimisation
from crosstrack.models.black_box import PythonFunction

record, size = sys.argv[1], float(os.environ.get("SIZE", "inf"))

def slow(x):
    time.sleep(0.004)
    if os.path.exists(record) and os.path.getsize(record) > size:
        time.sleep(20.0)  # until it is killed, even if the machine is busy
    return float(((x - 0.3) ** 2).sum())

function = PythonFunction(slow, record=sys.argv[1], workers=int(sys.argv[2]))
model = BlackBoxMinimisation(function, [[0, 1], [0, 1]], budget=150)
print(ct.solve(model, sys.argv[3], seed=3).plan.x)
"""


@pytest.mark.parametrize(
    ("name", "count"),
    [("differential-evolution", 2), pytest.param("random-search", 1, marks=pytest.mark.slow)],
)
def test_a_run_that_was_killed_resumes_with_the_same_plan(tmp_path, name, count):
    def command(path):
        return [sys.executable, "-c", SCRIPT, str(path), str(count), name]

    plan = subprocess.run(command(tmp_path / "whole"), capture_output=True, text=True, check=True)
    path = tmp_path / "killed"
    kills = 0
    for share in (0, 0.6):
        size = share * (tmp_path / "whole").stat().st_size
        environment = {**os.environ, "SIZE": str(size)}
        with subprocess.Popen(command(path), stdout=subprocess.DEVNULL, env=environment) as process:
            while process.poll() is None:
                time.sleep(0.002)
                if path.exists() and path.stat().st_size > size:
                    process.kill()
                    kills += 1
                    break
    assert kills == 2
    end = subprocess.run(command(path), capture_output=True, text=True, check=True)
    assert end.stdout == plan.stdout and "(0." in plan.stdout
    count_lines = [len(one.read_text().splitlines()) for one in (path, tmp_path / "whole")]
    assert count_lines[1] == 151 and 151 <= count_lines[0] <= 151 + 4 * 2


SHORTCUTS = """
import sys
from crosstrack.solvers import find_backend
find_backend("cma-es").prepare()
import cma
print("matplotlib" in sys.modules, callable(cma.s.better_limits), hasattr(cma.s, "nothing"))
"""


def test_the_evolution_strategy_does_not_import_matplotlib(run_python, tmp_path):
    """The aliases of ``cma`` for pictures are imported when they are used."""
    pytest.importorskip("cma", reason="cma-es needs crosstrack[blackbox]")
    assert run_python("-c", SHORTCUTS, cwd=tmp_path).split() == ["False", "True", "False"]
