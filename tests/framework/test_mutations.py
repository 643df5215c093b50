"""The scripts and hooks of the tests: checks of plans that are broken on purpose, samples of sweeps."""

import importlib.util
import subprocess
from types import SimpleNamespace

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


class Case:
    """Case of a test, as pytest collects it; `params` contains the positions of its values."""

    def __init__(self, **params):
        self.nodeid, self.callspec = f"a.py::test_a[{params}]", SimpleNamespace(indices=params)
        self.name, self.is_slow = self.nodeid[6:], False

    def get_closest_marker(self, name):
        return pytest.mark.sample(3).mark if name == "sample" else None

    def add_marker(self, mark):
        self.is_slow = True


@pytest.fixture
def fast(checkout, request):
    """Function that returns the cases that a command line leaves in the fast tests."""
    conftest = request.config.pluginmanager.get_plugin(str(checkout / "tests" / "conftest.py"))

    def draw(cases, *arguments):
        conftest.pytest_collection_modifyitems(SimpleNamespace(args=arguments), list(cases))
        return [case.callspec.indices for case in cases if not case.is_slow]

    return draw


def test_a_sample_of_a_list_has_its_share_in_any_order(fast):
    sample = fast([Case(x=x, y=x) for x in range(7)])
    assert len(sample) == 3
    assert fast([Case(x=x, y=x) for x in reversed(range(7))], "tests")[::-1] == sample


def test_a_sample_of_a_product_has_each_value(fast):
    sample = fast([Case(x=x, y=y, z=y) for x in range(7) for y in range(2)])
    assert len(sample) == 7
    assert {case["x"] for case in sample} == {*range(7)} and {case["y"] for case in sample} == {
        0,
        1,
    }


def test_cases_that_the_command_line_names_run(fast):
    cases = [Case(x=x) for x in range(7)]
    assert len(fast(cases, "tests/a.py::test_a[3]", "tests/b.py")) == 7
