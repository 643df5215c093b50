"""A backend that does not carry a field of the model names the field and the backend that does."""

import pytest

import crosstrack as ct
from crosstrack.models import MessengerTour


@pytest.mark.parametrize(
    ("fields", "other"),
    [
        ({"uavs": 2}, "crew-search"),
        ({"no_fly": [[0, 40, 15]]}, "detour-search"),
        ({"windows": [[0, 30], [5, 90]]}, "detour-search"),
    ],
)
def test_names_the_backend_that_carries_a_field(fields, other):
    model = MessengerTour([[0, 90], [-70, 80]], [[0, 0], [1, 0.5]], **fields)
    for backend in ("tour-search", "greedy-centre"):
        with pytest.raises(ct.CrosstrackError, match=f"{next(iter(fields))}.*'{other}' does"):
            ct.solve(model, backend)
    assert ct.solve(model, other, time_limit=0.5).backend == other
