"""The default estimator on a recorded race-track drive, with rough vehicle parameters."""

import numpy as np
import pytest
from sideslip import stanford

from crosstrack.solvers import Request, find_backend

pytestmark = pytest.mark.skipif(
    not stanford.FILE.exists(), reason="the drive lies in ../shared/data/sideslip, which is absent"
)


@pytest.fixture(scope="module")
def drive():
    return stanford.whole()


def measured(model):
    """Return error and coverage of the backend that the model prefers."""
    backend = find_backend(model.preferred_backend)
    plan = backend.run(model.blinded(), Request(options=backend.checked_options({}))).point
    return model.verify(plan).objective, model.coverage(plan)


@pytest.mark.parametrize("vehicle", [stanford.GUESS, stanford.OTHER], ids=["guess", "other car"])
@pytest.mark.parametrize("count", [1, 5])
def test_error_and_coverage_on_the_last_part(drive, vehicle, count):
    end = int(stanford.SHARE * len(drive))
    known = stanford.cut(drive, 0, end)
    training = [known] if count == 1 else [part for part, _ in stanford.folds(known, count)]
    here = stanford.cut(drive, end, len(drive))
    error, coverage = measured(stanford.model(here, training, vehicle))
    assert error <= 0.30
    assert 0.90 <= coverage <= 0.98


def test_error_and_coverage_in_cross_validation(drive):
    known = stanford.cut(drive, 0, int(stanford.SHARE * len(drive)))
    found = [measured(stanford.model(part, others)) for part, others in stanford.folds(known, 6)]
    error, coverage = np.mean(found, axis=0)
    assert error <= 0.30
    assert 0.90 <= coverage <= 0.98
