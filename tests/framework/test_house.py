"""The rules of the house that no linter knows: layers, names, docstrings, doctests, clean files."""

import ast
import doctest
import importlib
import inspect
import pkgutil
import re
import sys
from pathlib import Path

import pytest
from imports import imported, modules

import crosstrack

#: Packages that the modules of a room may import at import time, in addition to the standard library.
#: Anything else is imported by the function that needs it.
MAY_LOAD = {
    "cli": {"click"},
    "errors": set(),
    "compilation": {"numba"},
    "interpretation": set(),
    "jit": {"numba"},
    "lazy": set(),
    "timing": set(),
    "version": set(),
    "models": {"casadi", "numpy", "scipy"},
    "instances": {"numpy", "scipy"},
    "solvers": {"cloudpickle", "numba", "numpy", "scipy"},
}

ROOMS = sorted(MAY_LOAD)


def module_names():
    """Every module of the package by its dotted name, found without importing."""
    names = ["crosstrack"]
    for found in pkgutil.walk_packages(crosstrack.__path__, "crosstrack."):
        names.append(found.name)
    return sorted(name for name in names if not name.endswith("__main__"))


def sources(checkout, room):
    """The modules of a room: dotted name, package and syntax tree."""
    return [one for one in modules(checkout) if one[0].split(".")[1:2] == [room]]


def loading(tree):
    """The import statements that run when the module is imported."""
    stack = list(tree.body)
    while stack:
        node = stack.pop()
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            stack.extend(node.orelse)
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            stack.extend(
                child for child in ast.iter_child_nodes(node) if isinstance(child, ast.stmt)
            )


@pytest.mark.parametrize("room", ROOMS)
def test_inside_the_package_imports_are_relative(room, checkout):
    wrong = [
        f"{module} line {node.lineno}"
        for module, _, tree in sources(checkout, room)
        for node in ast.walk(tree)
        if isinstance(node, ast.Import | ast.ImportFrom)
        and not getattr(node, "level", 0)
        and any(name.split(".")[0] == "crosstrack" for name in imported(node, []))
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("room", ROOMS)
def test_modules_load_only_what_their_room_may(room, checkout):
    allowed = MAY_LOAD[room] | set(sys.stdlib_module_names) | {"crosstrack"}
    wrong = []
    for module, package, tree in sources(checkout, room):
        for node in loading(tree):
            for name in imported(node, package):
                if name.partition(".")[0] not in allowed:
                    wrong.append(f"{module} line {node.lineno} loads {name}")
    assert not wrong, "\n".join(wrong)


def test_no_module_bears_the_name_of_an_exported_function():
    wrong = []
    for name in module_names():
        package = importlib.import_module(name)
        if not hasattr(package, "__path__"):
            continue
        below = {found.name for found in pkgutil.iter_modules(package.__path__)}
        # A package may export another one, as crosstrack does with its rooms.
        wrong += [
            f"{name}.{export}"
            for export in getattr(package, "__all__", ())
            if export in below and not inspect.ismodule(getattr(package, export))
        ]
    assert not wrong, wrong


@pytest.mark.parametrize("name", module_names())
def test_docstrings_exist_and_their_examples_hold(name):
    """Everything public exists and has a docstring, and its examples give what they say."""
    module = importlib.import_module(name)
    assert (module.__doc__ or "").strip(), f"{name} has no docstring"
    for export in getattr(module, "__all__", ()):
        value = getattr(module, export)
        if inspect.isclass(value) or inspect.isroutine(value):
            text = (inspect.getdoc(value) or "").strip()
            assert text, f"{name}.{export} has no docstring"
            # A dataclass without one is given its signature.
            assert not text.startswith(f"{export}("), f"{name}.{export} has no docstring"
    if ">>>" in Path(module.__file__).read_text("utf-8"):
        flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
        failed, attempted = doctest.testmod(module, optionflags=flags)
        assert attempted and not failed


def test_no_module_is_far_above_400_lines(checkout):
    long = {}
    for room in ROOMS:
        top = checkout / room
        for path in sorted(top.rglob("*.py")) if top.is_dir() else [checkout / f"{room}.py"]:
            count = len(path.read_text("utf-8").splitlines())
            if count > 500:
                long[str(path.relative_to(checkout))] = count
    assert not long


#: Written so that they do not match themselves.
STRANGE = {
    "a machine's path": re.compile(r"(?<![\w.])/(?:home|opt|root|work|Users)/[\w.]"),
    "a registry's address": re.compile(
        r"--(?:extra-)?index[-]url|find[-]links|pythonhosted[.]|/sim[p]le/"
    ),
    "a file's address": re.compile(r"\bfile[:]/"),
}


def test_files_contain_no_machine_path_and_no_registry(own_files, checkout):
    wrong = []
    for path in own_files:
        try:
            text = path.read_text("utf-8")
        except UnicodeDecodeError:
            continue
        for what, pattern in STRANGE.items():
            for number, line in enumerate(text.splitlines(), 1):
                if pattern.search(line):
                    wrong.append(
                        f"{path.relative_to(checkout)} line {number}: {what}: {line.strip()}"
                    )
    assert not wrong, "\n".join(wrong)


#: Largest number of lines of a problem in `models`, `solvers` and `instances` together.
CEILING = 5000
#: Goals of the largest problems.
GOALS = {
    "minimum_snap": 9000,
    "optimal_control": 10_000,
    "messenger": 7000,
    "unknown_grid": 5500,
}
#: Problems above their ceiling: the limit in force, and what the lines above the goal are. Docstrings and
#: blank lines are 36 % of the package; a search for unused names finds none.
EXCEPTIONS = {
    "attractor": (
        6985,
        (
            "15 estimators with uncertainties, calibrated systems and hunts; verdicts, spectra and measures with their own "
            "recomputation have about 1,400"
        ),
    ),
    "black_box": (
        6400,
        (
            "kinds of variables, constraints and fronts have about 1,150 lines, workers, records, ask and tell 1,450, the "
            "surrogate search and the portfolio 480"
        ),
    ),
    "fleet": (
        12_053,
        (
            "fleet-search, bounds, subset-dp and four algorithms of the paper; rich fleets with their schedule, checks, "
            "readers and two adapters have about 2,900, column generation 1,930, tours and parts 1,000, exact routes of "
            "small rich fleets 330, repair of plans beyond limits 90"
        ),
    ),
    "grid_path": (
        6070,
        (
            "the bucket queue is 3.3 to 5.2 times as fast as the heap, so both stay; readers of ROS and GeoJSON; prepared "
            "maps have 880"
        ),
    ),
    "guided_path": (
        7570,
        "loads, windows, tracks and vehicles with their search have about 1,500 lines, 20,000 customers and merges 800",
    ),
    "messenger": (
        10_490,
        (
            "Newton's polish is 3 to 34 times as fast as Ipopt, so it stays; wind, several UAVs and no-fly zones have "
            "about 1,250, orders of many vehicles 310, the bound over poses of few vehicles 425 and their short search 20"
        ),
    ),
    "minimum_snap": (
        14_990,
        (
            "own kernels for waypoints are 10 to 150 times as fast as general ones; vehicles with proven limits, "
            "yaw, laps, gates and minimum time have 4,150"
        ),
    ),
    "optimal_control": (
        14_896,
        (
            "the own Jacobian of programs is 2.9 to 270 times as fast as CasADi's, the Hessian 1.8 to 2.5; "
            "scenarios, flights, arcs, algebraic equations, estimation, convexity and prepared steps were added; "
            "the epigraph form of costs with kinks has 420"
        ),
    ),
    "sideslip": (
        6449,
        "the filter of spins has 400 lines, estimation in the loop 480, identification 300, tyre laws and the tyre curve 250",
    ),
    "unknown_grid": (
        7480,
        (
            "six trained networks with training on a GPU have 1,830 lines, the camera 500; neighbours, occlusion, noise, "
            "moving obstacles and exploration 950, vector environments and batches 450"
        ),
    ),
}


def test_problems_keep_their_ceilings(checkout):
    """A problem that grows above its ceiling, or an exception that is no longer needed, fails."""
    from crosstrack.models.problems import PROBLEMS

    above, unneeded = {}, []
    for problem in PROBLEMS:
        files = [
            p
            for r in ("models", "solvers", "instances")
            for p in (checkout / r / problem).rglob("*.py")
        ]
        count = sum(len(path.read_text("utf-8").splitlines()) for path in files)
        goal = GOALS.get(problem, CEILING)
        limit, _ = EXCEPTIONS.get(problem, (goal, ""))
        if count > limit:
            above[problem] = (count, limit)
        if problem in EXCEPTIONS and count <= goal:
            unneeded.append(problem)
    assert not above, f"lines, ceiling: {above}"
    assert not unneeded


def test_the_package_keeps_its_ceiling(checkout):
    """The goal is 98,000 lines; each reduction lowers the ceiling. Programs of users have about 7,000, and files of
    users, pages of plans and animations about 5,500, flights 4,500, vehicles, gates and
    shared space 5,600, and rich fleets, column generation, constrained routes and prepared maps 7,000, and verdicts, filters,
    identification and unknown grids with their aspects 4,200; black boxes with constraints and workers, loads, windows and
    tracks, sequential ordering, wind and no-fly zones 9,000."""
    rooms = ("models", "solvers", "instances", "cli")
    files = [path for room in rooms for path in (checkout / room).rglob("*.py")]
    files += checkout.glob("*.py")
    assert sum(len(path.read_text("utf-8").splitlines()) for path in files) <= 166_220
