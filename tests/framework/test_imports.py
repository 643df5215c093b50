"""The arrows between modules: downward only, and never in a circle."""

import ast
import importlib
import re
import sys

import pytest
from imports import circles, graph, imported, modules

#: What each room may import of the package, itself and the leaves at the root included.
LEAVES = {"compilation", "errors", "interpretation", "jit", "lazy", "timing", "version"}
MAY_IMPORT = {
    "errors": set(),
    "files": {"errors"},
    "compilation": set(),
    "interpretation": {"compilation", "timing"},
    "jit": {"compilation", "interpretation", "timing"},
    "lazy": set(),
    "timing": set(),
    "version": set(),
    "models": {*LEAVES, "models"},
    "instances": {*LEAVES, "files", "instances", "models"},
    "solvers": {*LEAVES, "files", "models", "solvers"},
    # Campaigns run what the catalogue holds: they stand above both, and no other module imports them.
    "bench": {*LEAVES, "files", "models", "instances", "solvers", "bench"},
}


ROOMS = ("instances", "models", "solvers")


def room_of(module):
    """Return the room of a dotted name of the package, empty for the package itself."""
    if module.startswith("crosstrack.solvers.bench"):
        return "bench"
    return [*module.split("."), ""][1]


def test_no_arrow_runs_against_the_rooms(checkout):
    wrong = []
    for module, package, tree in modules(checkout):
        allowed = MAY_IMPORT.get(room_of(module))
        if allowed is None:
            continue
        for node in ast.walk(tree):
            names = imported(node, package)
            text = getattr(node, "value", None)
            if isinstance(text, str) and re.fullmatch(
                r"\.(models|solvers|instances)[\w.]*:\w+", text
            ):
                names = [f"crosstrack{text}"]  # loaded later, an arrow all the same
            wrong += [
                f"{module} line {node.lineno} imports {name}"
                for name in names
                if name.startswith("crosstrack.") and room_of(name) not in allowed
            ]
    assert not wrong, "\n".join(wrong)


def test_no_circle(checkout):
    found = circles(graph(checkout))
    assert not found, "\n".join(" <-> ".join(part) for part in found)


def test_a_circle_is_found():
    arrows = {"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}, "e": set()}
    assert circles(arrows) == [["a", "b", "c"]]


def test_a_problem_imports_no_other_problem_but_its_public_names(checkout):
    """A name is public if the folder of the other problem exports it, or lists it as SHARED."""
    from crosstrack.models.problems import PROBLEMS

    wrong, used = [], set()
    for module, package, tree in modules(checkout):
        parts = module.split(".")
        if len(parts) < 3 or parts[2] not in PROBLEMS:
            continue
        for node in ast.walk(tree):
            for name in imported(node, package):
                other = name.split(".")
                foreign = other[0] == "crosstrack" and len(other) > 2 and other[2] in PROBLEMS
                if not foreign or other[2] == parts[2]:
                    continue
                folder = importlib.import_module(".".join(other[:3]))
                inner = ".".join(other[3:])
                used.add((folder.__name__, inner))
                exported = other[-1] in getattr(folder, "__all__", ())
                if not exported and inner not in getattr(folder, "SHARED", ()):
                    wrong.append(f"{module} line {node.lineno} imports {name}")
    assert not wrong, "\n".join(wrong)
    rooms = [f"crosstrack.{room}.{one}" for room in ROOMS for one in PROBLEMS]
    offered = {
        (folder, name)
        for folder in rooms
        for name in getattr(importlib.import_module(folder), "SHARED", ())
    }
    assert offered <= used, f"SHARED, but no other problem uses it: {sorted(offered - used)}"


@pytest.mark.parametrize("room", ROOMS)
def test_every_problem_has_its_folder(room, checkout):
    from crosstrack.models.problems import PROBLEMS

    assert PROBLEMS
    missing = [one for one in PROBLEMS if not (checkout / room / one / "__init__.py").is_file()]
    assert not missing, missing


def test_former_modules_of_solvers_are_importable_with_a_warning():
    with pytest.warns(DeprecationWarning, match=r"is now crosstrack.solvers.contract.registry"):
        former = importlib.import_module("crosstrack.solvers.registry")
    from crosstrack.solvers.contract import registry

    assert former.find_backend is registry.find_backend
    with pytest.raises(AttributeError):
        former.missing  # noqa: B018


@pytest.mark.parametrize(
    ("former", "now", "name"),
    [
        ("nlp.curvature", "nlp.quality", "descent_by_curvature"),
        ("nlp.sqpmethod", "nlp.plugins", "SqpMethod"),
    ],
)
def test_former_modules_of_nonlinear_solvers_are_importable_with_a_warning(former, now, name):
    sys.modules.pop(f"crosstrack.solvers.{former}", None)
    with pytest.warns(DeprecationWarning, match=f"is now crosstrack.solvers.{now}"):
        module = importlib.import_module(f"crosstrack.solvers.{former}")
    assert getattr(module, name) is getattr(
        importlib.import_module(f"crosstrack.solvers.{now}"), name
    )


@pytest.mark.parametrize(
    ("former", "name", "now"),
    [
        ("solvers.contract.limits", "Event", "solvers.contract.events"),
        ("solvers.contract.registry", "BackendState", "solvers.contract.states"),
        ("solvers.contract.registry", "recommended", "solvers.contract.selection"),
        ("solvers.contract.registry", "register_backend", "solvers.contract.registration"),
        ("solvers.registry", "backend_states", "solvers.contract.states"),
        ("solvers.run.assembly", "claim_to_data", "solvers.processes.claims"),
        ("solvers.optimal_control.prepared", "prepare", "solvers.run.preparation"),
        ("solvers.run.dispatch", "verify", "solvers.run.verification"),
        ("solvers.run.execution", "multistart", "solvers.run.multistart"),
        ("models.model", "parse_json", "models.json_text"),
        ("models.records", "recorded", "models.stored"),
    ],
)
@pytest.mark.filterwarnings("ignore:crosstrack.solvers.registry is now:DeprecationWarning")
def test_former_places_of_names_are_importable_with_a_warning(former, name, now):
    module = importlib.import_module(f"crosstrack.{former}")
    home = importlib.import_module(f"crosstrack.{now}")
    with pytest.warns(DeprecationWarning, match=f"{name} is now crosstrack.{now}.{name}"):
        assert getattr(module, name) is getattr(home, name)
    with pytest.raises(AttributeError):
        module.missing  # noqa: B018


def test_the_root_of_solvers_has_at_most_twelve_names_besides_the_problems(checkout):
    from crosstrack.models.problems import PROBLEMS

    names = {path.stem for path in (checkout / "solvers").iterdir()}
    assert len(names - {*PROBLEMS, "__init__", "__pycache__"}) <= 12
