"""The values of the catalogue's entries, derived anew."""

import pytest
from control_values import DERIVED, ENTRIES

#: Shootings of more than a second.
LONG = {"cart-pole", "catalyst-mixing", "rayleigh", "shuttle-reentry"}


@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=[pytest.mark.slow] * (one in LONG)) for one in sorted(DERIVED)]
)
def test_value_derived_anew(name):
    wanted = ENTRIES[name].published["objective"]
    assert DERIVED[name]() == pytest.approx(wanted, rel=2e-9, abs=1e-12)
