"""Output of solvers goes to the log, and never to the answers."""

import json
import logging
import os
import subprocess
import sys
import threading
import time

import pytest
from commands import run
from fakes import ROUTE, Fixed, Patient

import crosstrack as ct
from crosstrack.models import Route
from crosstrack.solvers import Answer, Feature, Termination
from crosstrack.solvers.conformance import all_cases
from crosstrack.solvers.contract.registry import find_backend, is_plain
from crosstrack.solvers.contract.states import backend_states
from crosstrack.solvers.processes.output import captured

LOG = "crosstrack.output"


@pytest.fixture
def model():
    return ct.load("error-correction/example-1")


def told(caplog):
    """Return what has been logged for people, and forget it."""
    lines = [
        record.getMessage()
        for record in caplog.records
        if record.name == LOG and record.levelno >= logging.INFO
    ]
    caplog.clear()
    return lines


def program_for(backend):
    """Return a small program that `backend` takes."""
    wanted = ("integer: knapsack", "nonlinear: HS071", "quadratic: ", "conic: ")
    for words in wanted:
        for name, case in all_cases().items():
            fits = name.startswith(words) and isinstance(case.program, backend.accepts)
            if fits and case.program.row_count and not backend.refuses(case.program):
                return case.program
    raise AssertionError(f"no case for {backend.name}")


FAST = ("highs", "clarabel", "ipopt")
LOGGING = [one.name for one in backend_states() if str(Feature.LOG) in one.features]


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[] if n in FAST else [pytest.mark.slow]) for n in LOGGING]
)
@pytest.mark.parametrize("isolate", [False, True])
def test_backends_log_if_and_only_if_they_declare_it(name, isolate, caplog, capfd):
    """In a worker and here; here the clashing libraries of others would be in the way."""
    backend = find_backend(name)
    if backend.missing():
        pytest.skip(f"{name} is not installed")
    if not isolate and name not in FAST:
        pytest.skip("one process cannot hold all libraries")
    program = program_for(backend)
    caplog.set_level(logging.DEBUG, LOG)
    quiet = ct.solve(program, name, isolate=isolate, time_limit=30)
    assert told(caplog) == []
    loud = ct.solve(program, name, isolate=isolate, time_limit=30, verbose=True)
    assert len(told(caplog)) > 3
    assert loud.termination == quiet.termination
    assert capfd.readouterr().out == ""


def test_the_log_goes_to_standard_error_without_a_handler(tmp_path):
    """Unless handlers are set up: then theirs alone is the output."""
    script = (
        "import sys, logging, crosstrack as ct\n"
        "if 'mine' in sys.argv:\n"
        "    logging.basicConfig(stream=sys.stdout, format='mine: %(message)s')\n"
        "model = ct.load('error-correction/1')\n"
        "print('before')\n"
        "for isolate in (False, True):\n"
        "    ct.solve(model, 'highs', verbose=True, isolate=isolate,\n"
        "             on_event=lambda e: e.incumbent and print('heard'))\n"
        "print('after')\n"
    )
    for mine in ([], ["mine"]):
        done = subprocess.run(
            [sys.executable, "-c", script, *mine],
            capture_output=True, text=True, timeout=120, check=True, cwd=tmp_path,
        )  # fmt: skip
        read, other = (done.stdout, done.stderr) if mine else (done.stderr, done.stdout)
        assert read.count("Running HiGHS") == 2
        assert "incumbent 1" in read
        assert "HiGHS" not in other
        out = [line for line in done.stdout.splitlines() if not line.startswith("mine:")]
        assert (out[0], out[-1], set(out[1:-1])) == ("before", "after", {"heard"})


def test_native_algorithms_log_their_incumbents(model, caplog):
    ct.solve(model, Patient(), time_limit=0.2, verbose=True)
    assert "incumbent 1 after" in told(caplog)[0]
    ct.solve(model, "label-setting")
    assert told(caplog) == []


class Prints(Fixed):
    """Prints in each way there is, while another thread prints for the user."""

    def run(self, problem, request):
        print(f"{self.name} prints")
        os.write(1, f"{self.name} writes\n".encode())
        other = threading.Thread(target=print, args=("the user's",))
        other.start()
        other.join()
        return Answer(Termination.FEASIBLE, point=Route(ROUTE))


def test_several_runs_at_the_same_time_share_one_capture(model, caplog, capfd):
    """And leave everything as it was; others' threads keep printing."""
    before = sys.stdout
    caplog.set_level(logging.DEBUG, LOG)
    assert not is_plain(Prints())
    with captured(verbose=False, quiet=False):
        threads = [
            threading.Thread(target=ct.solve, args=(model, Prints(f"p{k}"))) for k in range(4)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert sys.stdout is before
    lines = {record.getMessage() for record in caplog.records if record.name == LOG}
    assert {f"p{k} {does}" for k in range(4) for does in ("prints", "writes")} <= lines
    os.write(1, b"mine again\n")
    # Lines of threads may run into one another; nothing of them is lost.
    assert capfd.readouterr().out.replace("\n", "") == "the user's" * 4 + "mine again"


def test_threads_are_bounded_by_the_machine(caplog):
    """With a word, and the same for every backend."""
    model = ct.load("error-correction/1")
    found = ct.solve(model, "highs", threads=1_000_000, isolate=False)
    assert found.termination == "optimal"
    assert "threads=1000000" in found.message
    assert "threads=1000000" in caplog.text
    assert ct.solve(model, "highs", threads=1, isolate=False).message == ""


def test_total_is_the_time_of_the_call(model):
    """A worker's start counts, and what several starts took is not counted twice."""
    for backend, options in ((Fixed(), {"isolate": True}), ("label-setting", {})):
        begin = time.perf_counter()
        found = ct.solve(model, backend, **options)
        waited = time.perf_counter() - begin
        parts = sum(seconds for part, seconds in found.seconds.items() if part != "total")
        assert parts <= found.seconds["total"] <= waited
        assert found.seconds["total"] > 0.8 * waited - 0.01


#: Command lines that end well, and in every other way, with their exit codes.
COMMANDS = [
    (0, "backends"),
    (0, "models"),
    (0, "instances"),
    (0, "solve", "I"),
    (0, "solve", "I", "--backend", "highs"),
    (3, "solve", "IMPOSSIBLE"),
    (2, "solve", "no/such"),
    (2, "solve"),
    (2, "solve", "I", "--backend", "no-such"),
    (2, "solve", "I", "--time-limit", "none"),
    (5, "solve", "I", "--backend", "scip"),
    (4, "solve", "error-correction/7", "--backend", "highs", "--formulation", "paper",
     "--time-limit", "0.01"),
    (0, "compare", "I", "--backends", "label-setting"),
    (2, "compare", "I", "--backends", "no-such"),
    (2, "compare", "I", "--resume"),
    (0, "check", "I", "PLAN"),
    (6, "check", "I", "WRONG"),
    (2, "check", "I", "missing.json"),
    (2, "export", "I", "PLAN"),
    (2, "export", "I", "PLAN", "--output", "route.csv"),
    (0, "diagnose", "I"),
    (3, "diagnose", "IMPOSSIBLE", "--in-process"),
    (2, "reproduce", "error-correction", "--rows", "99"),
    (2, "reproduce", "nothing"),
    (2, "demo", "nothing"),
    (2, "no-such-command"),
]  # fmt: skip


@pytest.mark.parametrize("case", COMMANDS, ids=lambda case: " ".join(map(str, case)))
def test_json_is_one_document_in_every_case(case, tmp_path, monkeypatch):
    code, *words = case
    if code == 5:
        monkeypatch.setattr(type(find_backend("scip")), "missing", lambda self: ("pyscipopt",))
    data = {
        "points": [[0, 0, 0], [1.0, 0, 0], [1.5, 0, 0], [9, 9, 9], [3.5, 0, 0]],
        "kinds": ["A", "horizontal", "vertical", "horizontal", "B"],
        "alpha1": 0.3, "alpha2": 0.3, "beta1": 0.3, "beta2": 0.3, "theta": 0.3, "delta": 0.1,
    }  # fmt: skip
    files = {
        "I": {"model": "error-correction", "data": data},
        "IMPOSSIBLE": {"model": "error-correction", "data": {**data, "theta": 0.01}},
        "PLAN": {"route": [0, 1, 2, 4]},
        "WRONG": {"route": [0, 4]},
    }
    for name, content in files.items():
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    arguments = [f"{word}.json" if word in files else word for word in words]
    done = run(*arguments, "--json", code=code, cwd=tmp_path)
    found = json.loads(done.stdout)
    assert ("error" in found) is (code in (2, 5))
