"""Processes that hostile backends leave behind, die in or hang in; and the two presses of Ctrl-C."""

import json
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import pytest
from commands import joined
from fakes import Fixed, Hanging, Patient

import crosstrack as ct
from crosstrack.solvers import Feature, Guarantee, Worker
from crosstrack.solvers.contract.job import Job
from crosstrack.solvers.processes import pool

#: An external distribution, whose backends end their process or print to standard output.
STRANGER = """
import ctypes, os, sys, time
from crosstrack.models import ErrorCorrectionRouting, MixedIntegerProgram, Route
from crosstrack.solvers import Answer, Backend, Feature, Guarantee, Termination

class Base(Backend):
    accepts = ErrorCorrectionRouting
    guarantee = Guarantee.HEURISTIC
    features = frozenset({Feature.INTERRUPT, Feature.INCUMBENTS})

    def run(self, problem, request):
        self.do(request.control)
        return Answer(Termination.FEASIBLE, point=Route((0, 1, 2, 4)))

    def do(self, control):
        pass

class Segfault(Base):
    name = "segfault"
    def do(self, control):
        ctypes.CDLL(None).printf(b"last words\\n")
        ctypes.string_at(0)

class Breaks(Segfault):
    name = "breaks"
    accepts = MixedIntegerProgram
    guarantee = Guarantee.EXACT

class Leaves(Base):
    name = "leaves"
    def do(self, control):
        os._exit(0)

class Prints(Base):
    name = "prints"
    def do(self, control):
        print("from Python")
        os.write(1, b"from a descriptor\\n")
        ctypes.CDLL(None).printf(b"from C\\n")
        ctypes.CDLL(None).printf(b"and unfinished")

class Hangs(Base):
    name = "hangs"
    def do(self, control):
        control.incumbent(1.0, Route((0, 1, 2, 4)))
        while True:
            time.sleep(0.05)
"""
NAMES = ("segfault", "breaks", "leaves", "prints", "hangs")


@pytest.fixture(scope="module")
def stranger(tmp_path_factory):
    """A folder for the path that declares the backends of an external distribution."""
    folder = tmp_path_factory.mktemp("stranger")
    (folder / "rough.py").write_text(STRANGER)
    info = folder / "rough-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: rough\nVersion: 1\n")
    lines = [f"{name} = rough:{name.capitalize()}\n" for name in NAMES]
    (info / "entry_points.txt").write_text("[crosstrack.backends]\n" + "".join(lines))
    return folder


@pytest.fixture
def command(stranger, tmp_path):
    """A function that starts the command line in a process of its own."""

    def start(*arguments):
        return subprocess.Popen(
            [sys.executable, "-m", "crosstrack", *map(str, arguments)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": joined(stranger)},
        )

    return start


def ended(process, timeout=60):
    """Return the exit code of a process and what it wrote."""
    with process:
        try:
            out, err = process.communicate(timeout=timeout)
        finally:
            process.kill()
    return process.returncode, out, err


def running(pid):
    """Return True if a process runs and is not a zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.fixture
def model():
    return ct.load("error-correction/example-1")


class Strays(Fixed):
    """Starts processes that leave its session, writes their identifiers, and acts as configured."""

    def __init__(self, path, then):
        super().__init__("strays")
        self.path, self.then = str(path), then

    def run(self, problem, request):
        for _ in range(2):
            if not os.fork():
                os.setsid()
                if not os.fork():
                    with Path(self.path).open("a") as file:
                        file.write(f"{os.getpid()}\n")
                    time.sleep(300)
                os._exit(0)
        while len(Path(self.path).read_text().split() if Path(self.path).exists() else ()) < 2:
            time.sleep(0.01)
        if self.then == "hang":
            time.sleep(300)
        elif self.then == "die":
            os.kill(os.getpid(), signal.SIGSEGV)
        return super().run(problem, request)


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the process group is killed")
@pytest.mark.parametrize(
    ("then", "ending"), [("hang", "killed"), ("die", "SIGSEGV"), ("answer", "")]
)
def test_no_process_outlives_its_worker(tmp_path, model, then, ending):
    """Not even one of a session of its own whose parent has ended."""
    path = tmp_path / "pids"
    with Worker() as worker:
        worker.solve(Job(model, Fixed()))  # the time limit counts its start
        answer = worker.solve(Job(model, Strays(path, then), time_limit=1.5), grace=0.5)
    assert ending in answer.message
    pids = [int(line) for line in path.read_text().split()]
    assert len(pids) == 2
    assert not any(map(running, pids))


def test_a_backend_that_ends_its_process_costs_one_line(command):
    """A segmentation fault and a silent exit: code 1, and the solution says what happened."""
    instance = "error-correction/example-1"
    begun = [
        command("solve", instance, "--backend", "segfault", "--json"),
        command("solve", instance, "--backend", "leaves", "--json"),
        command("solve", instance, "--backend", "segfault", "--verbose"),
        command("diagnose", instance, "--backend", "breaks", "--json"),
        command("solve", instance, "--backend", "leaves", "--json", "--in-process"),
    ]
    *two, talking, diagnosed, here = map(ended, begun)
    for (code, out, err), words in zip(two, ("SIGSEGV", "exit code 0"), strict=True):
        assert (code, err) == (1, "")
        data = json.loads(out)
        assert data["termination"] == "failed"
        assert words in data["message"]
    code, out, err = talking
    assert (code, err) == (1, "last words\n")
    assert "message: worker died: signal 11 (SIGSEGV)" in out
    code, out, err = diagnosed
    assert (code, err.count("\n")) == (1, 1)
    assert json.loads(out)["error"]["type"] == "WorkerFailure"
    assert here[:2] == (0, "")  # as asked: the process is the backend's


@pytest.mark.parametrize("apart", [(), ("--in-process",)])
def test_output_of_a_backend_is_not_an_answer(command, apart):
    """The output is in the log."""
    arguments = ("solve", "error-correction/example-1", "--backend", "prints", "--json", *apart)
    code, out, err = ended(command(*arguments))
    assert code == 0, err
    assert json.loads(out)["plan"]["route"] == [0, 1, 2, 4]
    assert "descriptor" not in err
    code, out, err = ended(command(*arguments, "--verbose"))
    assert code == 0
    json.loads(out)
    for words in ("from Python", "from a descriptor", "from C", "and unfinished"):
        assert words in err


def interrupted(process, after, presses, wait):
    """Return the exit code, output and seconds of a command after presses of Ctrl-C."""
    time.sleep(after)
    for _ in range(presses):
        process.send_signal(signal.SIGINT)
        last = time.perf_counter()
        time.sleep(wait)
    code, out, err = ended(process)
    return code, out, err, time.perf_counter() - last


@pytest.mark.parametrize("presses", [1, 2])
def test_ctrl_c_ends_a_comparison_at_once(command, tmp_path, presses):
    """The first keeps the incumbent of what never listens, the second waits for nothing."""
    record = tmp_path / "record.jsonl"
    process = command(
        "compare", "error-correction/example-1", "--backends", "prints,hangs", "--jsonl", record,
        "--json",
    )  # fmt: skip
    while not (record.exists() and record.read_text()):
        time.sleep(0.05)
    code, out, err, seconds = interrupted(process, 1.5, presses, 0.3)
    assert code == 130, err
    assert "Traceback" not in err
    assert seconds < (8 if presses == 1 else 2)
    data = json.loads(out)
    if presses == 1:
        assert data["interrupted"] is True
        assert len(data["instances"][0]["solutions"]) == 2
    else:
        assert data["error"]["type"] == "KeyboardInterrupt"
    assert len(record.read_text().splitlines()) == 1


def test_ctrl_c_while_a_worker_starts(model, monkeypatch):
    """The run is stopped as it begins."""
    fresh = []
    monkeypatch.setattr(pool, "_idle", fresh)
    threading.Timer(0.4, os.kill, (os.getpid(), signal.SIGINT)).start()
    begin = time.perf_counter()
    answer = ct.solve(model, Patient(), time_limit=60, isolate=True)
    assert answer.limit == "interrupted"
    assert time.perf_counter() - begin < 10
    fresh.pop().close()


def test_ctrl_c_reaches_the_jobs_of_an_executor(tmp_path):
    """The threads of a pool are interrupted; the call returns the incumbent without waiting."""
    script = textwrap.dedent(
        f"""
        import os, signal, sys, threading
        from concurrent.futures import ThreadPoolExecutor
        sys.path.insert(0, {str(Path(__file__).parent)!r})
        import crosstrack as ct
        from fakes import Fixed, Patient
        from listening import solutions
        model = ct.load("error-correction/example-1")

        def ended(solution):
            if solution.backend == "fixed":
                threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()

        with ThreadPoolExecutor(2) as pool:
            found = ct.compare(
                model, [Fixed(), Patient("patient")], pool=pool, time_limit=100, on_event=solutions(ended)
            )
        print(found.interrupted, [str(s.limit) for s in found.solutions])
        """
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.split(maxsplit=1) == ["True", "['None', 'interrupted']\n"]


def test_ctrl_c_while_a_plan_is_verified_keeps_it(model, monkeypatch):
    verify = type(model).verify

    def slow(self, plan, **options):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.1)
        return verify(self, plan, **options)

    monkeypatch.setattr(type(model), "verify", slow)
    assert ct.solve(model, Fixed()).plan.route == (0, 1, 2, 4)


def test_a_run_that_does_not_stop_is_abandoned_soon(model):
    """A worker gives up what has a plan and does not stop; no other job shares its process."""
    with Worker() as worker:
        begin = time.perf_counter()
        answer = worker.solve(Job(model, Hanging(), time_limit=0.5))
        assert time.perf_counter() - begin < 6
        assert (answer.termination, answer.limit) == ("feasible", "time")
        assert "given up" in answer.message
        assert worker.pid is None
        assert worker.solve(Job(model, Fixed())).termination == "optimal"


def test_ctrl_c_between_two_starts_keeps_the_first(model):
    """Wherever it comes: here while the second is being built."""

    class Drawing(Fixed):
        features = Fixed.features | {Feature.SEED}
        guarantee = Guarantee.HEURISTIC
        prepared = 0

        def prepare(self):
            self.prepared += 1
            if self.prepared == 2:
                os.kill(os.getpid(), signal.SIGINT)
                time.sleep(0.05)

    drawing = Drawing("drawing", guarantee=Guarantee.HEURISTIC, claims="feasible")
    answer = ct.solve(model, drawing, starts=5, isolate=False)
    assert answer.limit == "interrupted"
    assert 1 <= len(answer.starts) <= 2
    assert answer.plan.route == (0, 1, 2, 4)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_a_forked_process_leaves_its_parents_worker_alone(run_python, tmp_path):
    """A child that used it wrote into the parent's pipes; closing it could fail or kill the parent's."""
    script = (
        "import os, crosstrack as ct\n"
        "from multiprocessing import get_context\n"
        "from crosstrack.solvers.processes import pool as workers\n"
        "model = ct.load('error-correction/example-1')\n"
        "def solve(_):\n"
        "    return ct.solve(model, 'highs', isolate=True).primal_bound\n"
        "first = solve(0)\n"
        "[worker] = workers._idle\n"
        "with get_context('fork').Pool(2) as pool:\n"
        "    assert pool.map(solve, range(4)) == [first] * 4\n"
        "assert workers._idle == [worker] and worker._process.poll() is None\n"
        "before = worker.pid\n"
        "assert solve(0) == first and workers._idle[0].pid == before\n"
        "print('alone')\n"
    )
    assert run_python("-W", "ignore", "-c", script, cwd=tmp_path).strip() == "alone"
