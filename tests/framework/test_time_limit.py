"""Wall-clock limits: compiling counts, and a run that has no time for it interprets its kernels."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

import crosstrack as ct
from crosstrack import compilation, jit
from crosstrack.solvers.contract.job import Job
from crosstrack.solvers.run import dispatch

COLD = """
import sys, time
import crosstrack as ct
from crosstrack import compilation
model = eval(sys.argv[1])
begin, cpu = time.perf_counter(), time.process_time()
answer = ct.solve(model, time_limit=float(sys.argv[2]))
print(time.perf_counter() - begin, time.process_time() - cpu)
print(answer.plan is not None)
print(answer.statistics.get("backends tried", ""), answer.message)
if compilation.is_running():
    compilation._process.kill()  # it would compile for a minute beside the next tests
"""
#: Seconds beyond the limit: imports, verification and the last loop, on a machine with other work.
SLACK = 2.0


@pytest.mark.parametrize(
    "model",
    [
        "ct.models.MinimumSnap([[0, 0], [1, 2], [3, 1]], [0, 1, 2], velocity_limit=4.0)",
        pytest.param("ct.load('minimum-snap/gate-2d')", marks=pytest.mark.slow),
        "ct.load('messenger/B-03-04')",
        pytest.param("ct.load('fleet-mission/pocket')", marks=pytest.mark.slow),
    ],
)
def test_an_empty_cache_does_not_stretch_the_time_limit(model, run_python, tmp_path):
    """The first model took 9.8 s of CPU at a limit of 1 s."""
    limit = 2.0
    said = run_python(
        "-c", COLD, model, str(limit), cwd=tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache")
    ).splitlines()
    wall, cpu = map(float, said[0].split())
    assert cpu < limit + SLACK
    assert wall < 3 * (limit + SLACK), "generous, as the machine may be loaded"
    assert said[1] == "True"
    assert "compil" in said[2] or "interior-point: no_solution" in said[2]


MODULE = """
import numpy as np
from crosstrack.jit import kernel

@kernel
def count(values, pair, out):
    found = 0
    for i in range(len(values)):
        found += values[i] > pair[0]
    out[0] = found
    return found
"""
LATER = """
import sys, time
sys.path.insert(0, sys.argv[1])
import numpy as np
from counted import count
from crosstrack import compilation, jit
jit.compile_always()
values, out = np.arange(5.0)[::2], np.zeros(1, int)
values.flags.writeable = False
limit = jit.Limit(float(sys.argv[2]))
with jit.within(limit):
    print(count(values, (1.5, 2), out), sorted(limit.interpreted))
if compilation._process is not None:
    compilation._process.stdin.close()
    compilation._process.wait(120)
"""


def test_the_background_process_compiles_for_later_runs(run_python, tmp_path):
    (tmp_path / "counted.py").write_text(MODULE)
    script = tmp_path / "later.py"
    script.write_text(LATER)

    def run(seconds):
        where = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        return run_python(str(script), str(tmp_path), str(seconds), cwd=tmp_path, **where).strip()

    assert run(1e-3) == "2 ['count']"
    assert run(30.0) == "2 []"


def test_a_kernel_that_fits_is_compiled(monkeypatch):
    monkeypatch.setattr(jit, "_left", 0.0)

    @jit.kernel
    def increase(x):
        return x + 1

    limit = jit.Limit(60.0)
    with jit.within(limit):
        assert increase(1) == 2
    assert not limit.interpreted
    assert increase._ready


def test_an_interpreted_loop_ends_at_the_limit(monkeypatch):
    """The inner kernel raises; helper threads of a run have its limit too."""
    monkeypatch.setattr(jit, "_left", 0.0)
    monkeypatch.setattr(jit, "_GRACE", 0.05)
    monkeypatch.setattr(compilation, "request", lambda *arguments: None)

    @jit.kernel
    def step(x):
        return x + 1

    @jit.kernel
    def forever(flag):
        x = 0
        while flag[0] == 0:
            x = step(x)
        return x

    limit = jit.Limit(0.1)
    begin = time.perf_counter()
    with jit.within(limit), pytest.raises(jit.OutOfTime):
        forever(np.zeros(1, np.int8))
    assert time.perf_counter() - begin < 5.0
    assert limit.interpreted == {"forever"}


@pytest.mark.parametrize(
    ("seconds", "least", "most"), [(0.0, 10.0, 20.0), (3.0, 10.0, 17.0), (30.0, 10.0, 10.0)]
)
def test_the_limit_counts_the_imports_of_backends(monkeypatch, seconds, least, most):
    """Half of it is left for the run, however long they take."""
    limits, waited = [], [0.0]
    resolved, run, clock = Job.resolved, dispatch.run_job, time.perf_counter

    def resolve(job):
        waited[0] = seconds
        return resolved(job)

    def run_job(job, *arguments):
        limits.append(job.time_limit)
        return run(job, *arguments)

    monkeypatch.setattr(Job, "resolved", resolve)
    monkeypatch.setattr(dispatch, "run_job", run_job)
    fake = SimpleNamespace(perf_counter=lambda: clock() + waited[0])
    monkeypatch.setattr(dispatch, "time", fake)
    solution = ct.solve(ct.load("fleet/example"), time_limit=20.0)
    assert least <= limits[0] <= most
    assert solution.options["time_limit"] == 20


def test_models_without_programs_load_no_solver_of_programs(run_python, tmp_path):
    said = run_python(
        "-c",
        "import sys, crosstrack as ct\n"
        "from crosstrack.solvers.contract.selection import recommended\n"
        "for name in ('black-box/easom', 'messenger/B-03-04', 'attractor/ar1'):\n"
        "    print(recommended(ct.load(name)).name)\n"
        "print([name for name in sys.modules if 'solvers.nlp' in name or 'solvers.mip' in name])\n",
        cwd=tmp_path,
    )
    assert said.splitlines() == ["portfolio", "tour-search", "full-analysis", "[]"]


def test_a_solver_of_programs_loads_no_native_algorithm(run_python, tmp_path):
    """Importing those of all problems, to find rival libraries, took 70 % of a first run."""
    pytest.importorskip("highspy", reason="highspy is not installed")
    code = (
        "import sys, crosstrack as ct\n"
        "from crosstrack.models.problems import PROBLEMS\n"
        "ct.solve(ct.load('error-correction/example-1').formulate('paper').program, 'highs')\n"
        "rooms = tuple(f'crosstrack.solvers.{name}.' for name in PROBLEMS)\n"
        "print([name for name in sys.modules if name.startswith(rooms)])\n"
    )
    assert run_python("-c", code, cwd=tmp_path).strip() == "[]"


def test_libraries_of_native_algorithms_are_rivals_before_they_are_imported(run_python, tmp_path):
    code = (
        "from crosstrack.solvers.contract.registry import find_backend, rivals\n"
        "rivals_of_highs = rivals(find_backend('highs'))\n"
        "from crosstrack.solvers.fleet.ortools_routing import OrToolsRouting\n"
        "natives = set(OrToolsRouting.natives)\n"
        "print(natives <= rivals_of_highs, natives.isdisjoint(rivals(find_backend('ortools'))))\n"
    )
    assert run_python("-c", code, cwd=tmp_path).split() == ["True", "True"]


CACHED = """
import sys
from counted import count
from crosstrack import compilation, jit
print(compilation.may_be_cached(count.py_func), "numba" in sys.modules)
if sys.argv[1:] == ["compile"]:
    import numpy as np
    count.compile_for((np.zeros(3), (1.5, 2), np.zeros(1, int)))
"""


@pytest.mark.parametrize("own", [True, False])
def test_the_cache_is_looked_up_without_importing_numba(run_python, tmp_path, own):
    (tmp_path / "counted.py").write_text(MODULE)
    (tmp_path / "__pycache__").mkdir()
    where = {"NUMBA_CACHE_DIR": str(tmp_path / "cache") if own else ""}
    said = [
        run_python("-c", CACHED, *given, cwd=tmp_path, **where).split()
        for given in (["compile"], [])
    ]
    assert said == [["False", "False"], ["True", "False"]]


@pytest.mark.parametrize("cached", [True, False])
def test_compiled_code_is_loaded_at_a_short_limit_however_many_kernels_it_calls(
    monkeypatch, cached
):
    import numba  # noqa: F401  # the time of its import is not tested here

    from crosstrack import compilation, jit
    from crosstrack.solvers.messenger.annealing import anneal

    monkeypatch.setattr(compilation, "is_cached", lambda *_: cached)
    assert len(compilation.callees(anneal)) > 20
    with jit.within(jit.Limit(0.5)):
        if cached:
            anneal._require_time(())
        else:
            with pytest.raises(jit._DoesNotFit):
                anneal._require_time(())


def test_a_warm_tour_within_a_short_limit_has_a_bound(run_python, tmp_path):
    code = (
        "import sys, crosstrack as ct\n"
        "limit = float(sys.argv[1]) or None\n"
        "tour = ct.models.MessengerTour([[60, 20], [10, 70], [80, 65]], [[1, 0], [0, -2], [-1.5, 1]])\n"
        "found = ct.solve(tour, time_limit=limit, seed=1)\n"
        "print(found.dual_bound, 'interpreted' in found.message)\n"
    )
    # If the code is not compiled yet, which takes more than the limit, a run without a limit fills the cache.
    for limit in ("5", "0", "5"):
        bound, interpreted = run_python("-c", code, limit, cwd=tmp_path).split()
        if interpreted == "False" and limit == "5":
            break
    assert float(bound) > 100.0
    assert interpreted == "False"
