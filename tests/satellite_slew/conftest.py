"""Answers that several test modules share."""

import pytest

import crosstrack as ct
from crosstrack.models import SatelliteSlew


@pytest.fixture(scope="session")
def steered():
    """The paper's slew by the pseudo-inverse."""
    return ct.solve(SatelliteSlew(), "slew-pseudo-inverse")


@pytest.fixture(scope="session")
def reserved():
    """A slew with a tenth in reserve."""
    model = SatelliteSlew(margin=0.1)
    return model, ct.solve(model, "slew-pseudo-inverse").plan
