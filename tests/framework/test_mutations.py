"""The script that breaks the checks of plans: how it judges the end of a test run."""

import importlib.util
import subprocess

import pytest


@pytest.fixture(scope="module")
def mutations(checkout):
    spec = importlib.util.spec_from_file_location("mutations", checkout / "tests" / "mutations.py")
    module = importlib.util.module_from_spec(spec)
    with pytest.MonkeyPatch.context() as patch:  # dataclasses look their module up
        patch.setitem(importlib.sys.modules, "mutations", module)
        spec.loader.exec_module(module)
        yield module


@pytest.mark.parametrize(
    ("code", "output", "errors", "result"),
    [
        (0, "3 passed", "", (False, "")),
        (
            1,
            "..F\nFAILED a.py::test_b - assert 1 == 2\n1 failed",
            "",
            (True, "FAILED a.py::test_b"),
        ),
        (2, "ERROR a.py - ImportError\n1 error", "", (True, "ERROR a.py")),
        (
            4,
            "",
            "ImportError while loading conftest",
            (True, "EXIT 4 ImportError while loading conftest"),
        ),
        (3, "INTERNALERROR> x", "", (True, "EXIT 3 INTERNALERROR> x")),
        (-11, "..", "Fatal Python error", (True, "CRASH by signal 11")),
    ],
)
def test_a_run_that_fails_or_crashes_notices_the_fault(
    mutations, monkeypatch, tmp_path, code, output, errors, result
):
    done = subprocess.CompletedProcess([], code, output, errors)
    monkeypatch.setattr(mutations, "_run", lambda command, folder: done)
    assert mutations.run_tests([], tmp_path) == result


def test_a_run_that_takes_too_long_notices_the_fault(mutations, monkeypatch, tmp_path):
    def run(command, folder):
        raise subprocess.TimeoutExpired(command, mutations.PATIENCE)

    monkeypatch.setattr(mutations, "_run", run)
    assert mutations.run_tests([], tmp_path) == (True, "TIMEOUT after 900 s")
