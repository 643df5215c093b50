"""The recommended backend is not clearly worse than any other native backend of the problem."""

import pytest

import crosstrack as ct
from crosstrack.instances.catalogue import entries
from crosstrack.models.verification import TOLERANCE
from crosstrack.solvers.contract.registry import find_backend, fitting, recommended

#: Largest accepted excess of the default at the same time limit, relative.
MARGIN = 0.01
SECONDS = 3.0
#: Estimates are compared by their distance to the truth, and drawn scenes by their spread.
PROBLEMS = (
    "error-correction", "resource-routing", "fleet", "grid-path", "guided-path", "messenger",
    "minimum-snap", "time-allocation",
)  # fmt: skip
NAMES = [one.name for one in entries() if one.name.partition("/")[0] in PROBLEMS]


def compare_with_natives(name, seconds):
    """Assert that the default has a plan if another has one, and that it is within the margin."""
    model = ct.load(name)
    default = ct.solve(model, time_limit=seconds, seed=None)
    for other in fitting(model):
        backend = find_backend(other, model)
        if not isinstance(model, backend.accepts) or other == recommended(model).name:
            continue
        if backend.requires:
            continue  # a library of others
        answer = ct.solve(model, other, time_limit=seconds)
        if answer.plan is None or answer.verification.within_tolerance:
            continue
        assert default.plan is not None, f"{name}: {other} has a plan of {answer.primal_bound}"
        size = max(abs(answer.primal_bound), answer.verification.scale)
        assert default.primal_bound <= answer.primal_bound + (MARGIN + TOLERANCE) * size, (
            f"{name}: {default.backend} has {default.primal_bound}, {other} {answer.primal_bound}"
        )


@pytest.mark.parametrize("name", NAMES[::16])
def test_the_default_is_no_worse_on_some_of_the_catalogue(name):
    compare_with_natives(name, SECONDS)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_the_default_is_no_worse_on_the_catalogue(name):
    compare_with_natives(name, SECONDS)
