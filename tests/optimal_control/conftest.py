"""Solutions for several test modules."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from control_declared import rest_to_rest, solve
from control_motions import COARSE, ENERGY, round_a_disc, run

import crosstrack as ct
from crosstrack.models import ControlPlan, OptimalControlProblem


@pytest.fixture(scope="session")
def disc() -> OptimalControlProblem:
    return round_a_disc()


@pytest.fixture(scope="session")
def ways(disc) -> ct.Solution[ControlPlan]:
    return ct.solve(disc, tolerance=1e-3, formulation_options=COARSE, starts=3, seed=5)


@pytest.fixture(scope="session")
def solved(tmp_path_factory) -> Path:
    path: Path = tmp_path_factory.mktemp("energy") / "solution.json"
    done = run("solve", ENERGY, "--json", "--output", path, "--plot", path.with_suffix(".png"))
    data = json.loads(done.stdout)
    assert json.loads(path.read_text()) == data
    return path


@pytest.fixture(scope="session")
def answer() -> ct.Solution[ControlPlan]:
    return solve(rest_to_rest().ocp)
