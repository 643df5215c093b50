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
    """Case of a test, as pytest collects it."""

    path, originalname = "a.py", "test_a"

    def __init__(self, decorators, **params):
        self.name, self.callspec = str(params), SimpleNamespace(params=params)
        self.decorators, self.slow = decorators, False

    def get_closest_marker(self, name):
        return pytest.mark.sample(3).mark if name == "sample" else None

    def iter_markers(self, name):
        return iter(self.decorators)

    def add_marker(self, mark):
        self.slow = True


def test_a_sample_has_its_share_of_the_cases_and_each_value_of_a_product(checkout, request):
    plugins = request.config.pluginmanager
    mark_slow = plugins.get_plugin(
        str(checkout / "tests" / "conftest.py")
    ).pytest_collection_modifyitems
    single = [Case(["x"], x=x) for x in range(7)]
    mark_slow(single[::-1])
    assert [case.slow for case in single].count(False) == 3
    product = [Case(["x", "y"], x=x, y=y) for x in range(7) for y in "ab"]
    mark_slow(list(product))
    rest = [case.callspec.params for case in product if not case.slow]
    assert len(rest) == 7
    assert {case["x"] for case in rest} == {*range(7)} and {case["y"] for case in rest} == {*"ab"}
