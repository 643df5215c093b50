"""Run every command on every problem with nothing but the package's own dependencies.

`make bare` installs the wheel into an environment of its own and runs this with its Python.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

#: Instance of a catalogue prefix that is solved by its default backend, if not the first one.
FAST = {
    "attractor": "attractor.json",  # written here: interpreted, the catalogue's take 15 s
    "black-box": "black-box/booth",
    "fleet": "fleet/example",
    "fleet-mission": "fleet-mission/pocket",
    "flight": "flight/wall",  # interpreted, the first one takes over 160 s
    "grid-path": "grid-path/pocket",
    "guided-path": "guided-path/example-5",
    "messenger": "messenger/met-at-start",
    "minimum-derivative": "minimum-derivative/reach",
    "optimal-control": "optimal-control/double-integrator-energy",
    "resource-routing": "resource-routing/errand",
    "sideslip": "sideslip/lane-change",
    "time-allocation": "time-allocation.json",  # written here, for the catalogue's take a minute
    "unknown-grid": "unknown-grid/u-trap",
}
#: Model kinds whose default proves no bound, so that a comparison of it alone decides nothing.
LOCAL = {
    *("attractor", "black-box", "fleet-mission", "flight", "optimal-control", "sideslip"),
    *("time-allocation", "unknown-grid"),
}
#: Model kinds whose default takes long: it is run by `solve`, and not again by `compare`.
LONG = {"fleet-mission", "flight", "satellite-slew"}
#: Instances, and the formulation whose program is solved as a model of its own.
PROGRAMS = {
    "mixed-integer-program": ("error-correction/example-1", "paper"),
    "quadratic-program": ("minimum-snap/paper", "paper"),
    "nonlinear-program": ("optimal-control/double-integrator-energy", None),
}
COMMAND = Path(sys.executable).with_name("crosstrack")


def run(*arguments: object, code: int | tuple[int, ...] = 0) -> subprocess.CompletedProcess[str]:
    """Run a command line, whose exit code must be `code` and whose words are no traceback."""
    begin = time.perf_counter()
    done = subprocess.run(
        [COMMAND, *map(str, arguments)], capture_output=True, text=True, timeout=300, check=False,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
    )  # fmt: skip
    print(
        f"{time.perf_counter() - begin:6.1f} s  {done.returncode}  {' '.join(map(str, arguments))}"
    )
    allowed = code if isinstance(code, tuple) else (code,)
    if done.returncode not in allowed or "Traceback" in done.stderr:
        sys.exit(f"expected exit code {code}:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done


def write_models() -> None:
    """Write a file for each kind of program, most of which a problem is lowered to, and an instance."""
    import crosstrack as ct
    from crosstrack.instances import write_model
    from crosstrack.instances.attractor.listing import generate
    from crosstrack.models import ConeBlock, ConicProgram, TimeAllocation

    for kind, (instance, formulation) in PROGRAMS.items():
        model = ct.load(instance)
        program = model.formulate(formulation or model.default_formulation).program
        assert program.kind == kind, (program.kind, kind)
        write_model(program, f"{kind}.json")
    disc = ConicProgram(
        cost=[1.0, 1.0], cone_matrix=[[0, 0], [1, 0], [0, 1]], cone_offset=[1.0, 0.0, 0.0],
        cones=[ConeBlock("disc", "", 0, 3, kind="second-order")],
    )  # fmt: skip
    write_model(disc, "conic-program.json")
    small = TimeAllocation(waypoints=[[0, 0], [1, 2], [3, 2]], total_time=3)
    write_model(small, FAST["time-allocation"])
    write_model(generate("henon", 300), FAST["attractor"])


def export_format(kind: str) -> str | None:
    """Return a format of the plans of a model kind; None if nothing else reads its plans."""
    from crosstrack.models.problems import declared_in, problem_of

    formats = [
        name
        for problem, name, _ in declared_in("crosstrack.instances", "EXPORTS")
        if problem == problem_of(kind)
    ]
    return "samples" if "samples" in formats else formats[0] if formats else None


def main() -> None:
    """Run all commands."""
    for extra in ("matplotlib", "pyscipopt", "ortools", "openpyxl", "pandas", "dask"):
        assert importlib.util.find_spec(extra) is None, f"{extra} is no dependency"
    catalogue = [entry["name"] for entry in json.loads(run("instances", "--json").stdout)]
    chosen = {name.partition("/")[0]: name for name in reversed(catalogue)} | FAST
    run("models")
    for state in json.loads(run("backends", "--probe", "--json").stdout):
        assert state["state"] == "installed" or "pip install" in state["cause"], state
    write_models()
    import crosstrack as ct

    instances = {ct.load(name).kind: name for name in chosen.values()}
    assert set(PROGRAMS) | {"conic-program"} | set(instances) == {
        entry["model"] for entry in json.loads(run("models", "--json").stdout)
    }
    for name in (*PROGRAMS, "conic-program"):
        run("solve", f"{name}.json", "--output", "plan.json")
        run("check", f"{name}.json", "plan.json")
    for kind, instance in instances.items():
        run("models", kind)
        run("models", kind, "--template", "json", "--output", "template.json")
        run("solve", instance, "--output", "plan.json")
        run("check", instance, "plan.json")
        form = export_format(kind)
        if form:
            run("export", instance, "plan.json", "--output", "plan.csv", "--format", form)
        if kind not in LONG:
            run("compare", instance, "--backends", "auto", code=4 if kind in LOCAL else 0)
        if kind != "time-allocation":  # whose program has no linear rows
            # A second settles what a small problem has, and leaves the slew's open.
            run("diagnose", instance, "--time-limit", 1, code=(0, 4))
    run("reproduce", "error-correction", "--rows", "1", "--time-limit", 5, code=(0, 4))
    demo = run("demo", "--time-limit", 10)
    assert "nothing is drawn" in demo.stderr
    assert "crosstrack[plot]" in demo.stderr
    run("show", "error-correction/example-1", "--no-open", code=5)
    lacking = {
        "plot": ("solve", "error-correction/example-1", "--plot", "a.png"),
        "scip": ("solve", "error-correction/example-1", "--backend", "scip"),
        "qp": ("solve", "quadratic-program.json", "--backend", "quadprog"),
    }
    for extra, arguments in lacking.items():
        assert f"pip install 'crosstrack[{extra}]'" in run(*arguments, code=5).stderr


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        main()
