"""The arrows between modules: downward only, and never in a circle."""

import ast
import re

import pytest
from imports import circles, graph, imported, modules

#: What each room may import of the package, itself and the leaves at the root included.
LEAVES = {"errors", "jit", "lazy", "version"}
MAY_IMPORT = {
    "errors": set(),
    "files": {"errors"},
    "jit": set(),
    "lazy": set(),
    "version": set(),
    "models": {*LEAVES, "models"},
    "instances": {*LEAVES, "files", "instances", "models"},
    "solvers": {*LEAVES, "files", "models", "solvers"},
    # Campaigns run what the catalogue holds: they stand above both, and no other module imports them.
    "bench": {*LEAVES, "files", "models", "instances", "solvers", "bench"},
}


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
    """A problem that stands on another uses what the other's folder exports, or shares a kit."""
    from crosstrack.models.problems import PROBLEMS

    allowed = {
        # A slew is an optimal control problem: its plan, checks and pictures are that problem's.
        ("satellite_slew", "optimal_control"),
        # The path of a robot is one of the functions of a black box.
        ("black_box", "grid_path"),
        # A fleet's distances are those of paths on a map, and a mission is both and a trajectory.
        ("fleet", "grid_path"),
        ("fleet_mission", "grid_path"),
        ("fleet_mission", "fleet"),
        ("fleet_mission", "minimum_snap"),
        # Errors that are corrected are resources that are reset: its routes are that problem's.
        ("error_correction", "resource_routing"),
        # Where a vehicle is to find its way, the true map is one that paths are found on.
        ("unknown_grid", "grid_path"),
    }
    wrong = []
    for module, package, tree in modules(checkout):
        parts = module.split(".")
        if len(parts) < 3 or parts[2] not in PROBLEMS:
            continue
        for node in ast.walk(tree):
            for name in imported(node, package):
                other = name.split(".")
                if (
                    len(other) > 2
                    and other[0] == "crosstrack"
                    and other[2] in PROBLEMS
                    and other[2] != parts[2]
                    and (parts[2], other[2]) not in allowed
                ):
                    wrong.append(f"{module} line {node.lineno} imports {name}")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("room", ["instances", "models", "solvers"])
def test_every_problem_has_its_folder(room, checkout):
    from crosstrack.models.problems import PROBLEMS

    assert PROBLEMS
    missing = [one for one in PROBLEMS if not (checkout / room / one / "__init__.py").is_file()]
    assert not missing, missing
