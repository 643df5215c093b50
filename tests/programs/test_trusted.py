"""Functions in CasADi's own text: read with consent alone, and by another process first."""

import json
import random
import shutil
import subprocess
import sys

import casadi
import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import Model, NonlinearProgram
from crosstrack.models.programs import trusted as reading


def program(function):
    return NonlinearProgram(function, [0.0], [1.0], [-1.0], [1.0], [0.5], name="mine")


def square():
    x = casadi.SX.sym("x")
    return casadi.Function("square", [x], [x**2, casadi.sin(x)], ["x"], ["f", "g"])


def solver():
    """Return a function that the format does not know: it solves linear equations."""
    x = casadi.MX.sym("x")
    matrix = casadi.vertcat(casadi.horzcat(x, 1), casadi.horzcat(1, 3))
    found = casadi.solve(matrix, casadi.MX([1, 2]))
    return casadi.Function("f", [x], [x**2, found[0]], ["x"], ["f", "g"])


def old(function):
    """Return the JSON of a program as version 0.1 wrote it."""
    content = program(function).to_dict()
    content["data"]["function"] = function.serialize()
    return json.dumps(content)


def test_own_text_is_read_with_consent_alone(tmp_path):
    (tmp_path / "old.json").write_text(old(square()))
    for attempt in (
        lambda: Model.from_json(old(square())),
        lambda: Model.from_dict(json.loads(old(square()))),
        lambda: ct.load(tmp_path / "old.json"),
        lambda: program(square().serialize()),
    ):
        with pytest.raises(InvalidData, match=r"function.*can run code.*trusted=True") as caught:
            attempt()
        assert caught.value.field == "function"
    want = program(square())
    for found in (
        Model.from_json(old(square()), trusted=True),
        Model.from_dict(json.loads(old(square())), trusted=True),
        ct.load(tmp_path / "old.json", trusted=True),
    ):
        assert found.digest == want.digest
        assert Model.from_json(found.to_json()).digest == want.digest
    with pytest.raises(InvalidData, match="trusted=True"):  # consent ends with the call
        Model.from_json(old(square()))


def test_functions_without_a_graph_are_stored_as_text():
    model = program(solver())
    assert isinstance(model.to_dict()["data"]["function"], str)
    with pytest.raises(InvalidData, match="trusted=True"):
        Model.from_json(model.to_json())
    found = Model.from_json(model.to_json(), trusted=True)
    assert found.digest == model.digest
    assert found.values(np.array([0.5]))[1] == pytest.approx([2.0])


LIBRARY = """
#include <stdio.h>
__attribute__((constructor)) static void run(void) {
  FILE *file = fopen("MARK", "w");
  if (file) { fputs("run", file); fclose(file); }
}
int f(const double **arg, double **res, long long *iw, double *w, int mem) {
  if (res[0]) res[0][0] = arg[0] ? arg[0][0] : 0;
  if (res[1]) res[1][0] = 1;
  return 0;
}
long long f_n_in(void) { return 1; }
long long f_n_out(void) { return 2; }
const char *f_name_in(long long i) { return "x"; }
const char *f_name_out(long long i) { return i ? "g" : "f"; }
"""


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
def test_a_file_runs_no_library(tmp_path):
    mark, library = tmp_path / "mark", tmp_path / "library.so"
    (tmp_path / "library.c").write_text(LIBRARY.replace("MARK", str(mark)))
    subprocess.run(
        ["cc", "-shared", "-fPIC", "-o", library, tmp_path / "library.c"], check=True, timeout=60
    )
    function = casadi.external("f", str(library))
    text = old(function)
    assert mark.exists()  # the library is one that runs
    del function
    mark.unlink()
    (tmp_path / "model.json").write_text(text)
    # CasADi keeps a library open: processes of their own tell.
    script = (
        "import crosstrack as ct\nfrom crosstrack.errors import InvalidData\n"
        "try:\n    ct.load('model.json', trusted={})\n"
        "except InvalidData as error:\n    print(error)\nelse:\n    print('read')"
    )
    for consent, word, there in ((False, "trusted=True", False), (True, "read", True)):
        done = subprocess.run(
            [sys.executable, "-c", script.format(consent)],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert word in done.stdout, done.stderr
        assert mark.exists() is there


def damaged(text, draw):
    """Return `text` with a few of its characters changed, cut, doubled or moved."""
    found = list(text)
    for _ in range(draw.randint(1, 4)):
        place = draw.randrange(len(found))
        how = draw.randrange(3)
        if how == 0:
            found[place] = draw.choice("abcdefghijklmnop")
        elif how == 1:
            del found[place : place + draw.randint(1, 40)]
        else:
            found[place:place] = found[place : place + draw.randint(1, 40)]
    return "".join(found)


def survive(count, seed):
    """Read damaged texts; return how many were refused."""
    draw = random.Random(seed)
    refused = 0
    for k in range(count):
        function = (square, solver)[k % 2]()
        content = json.loads(old(function))
        content["data"]["function"] = damaged(function.serialize(), draw)
        try:
            model = Model.from_dict(content, trusted=True)
            assert len(model.digest) == 64
        except InvalidData:
            refused += 1
    return refused


def test_damaged_text_is_refused(monkeypatch):
    monkeypatch.setattr(reading, "SECONDS", 3.0)
    assert survive(4, 3) > 1
    with pytest.raises(InvalidData, match="half a character"):
        Model.from_json(old(square()).replace("jhpnn", "\\ud800"), trusted=True)
    with pytest.raises(InvalidData, match="no serialised"):
        Model.from_json(old(square()).replace("jhpnn", "aaaaa"), trusted=True)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_300_damaged_texts_crash_and_hang_nothing(monkeypatch):
    monkeypatch.setattr(reading, "SECONDS", 5.0)
    assert survive(300, 2) > 150


def test_a_text_on_which_the_process_hangs_or_ends_is_refused(monkeypatch):
    monkeypatch.setattr(reading, "SECONDS", 0.01)
    with pytest.raises(InvalidData, match=r"took more than 0\.01 s"):
        Model.from_json(old(square()), trusted=True)
    monkeypatch.setattr(reading, "SECONDS", 60.0)
    monkeypatch.setattr(reading, "__name__", "crosstrack.no_such_module")
    with pytest.raises(InvalidData, match="the process that read it ended with 1"):
        Model.from_json(old(square()), trusted=True)
