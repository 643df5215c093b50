"""Independent derivations of the values of catalogue entries."""

import pytest
from control_values import DERIVED, ENTRIES

#: Derivations that take more than a second.
LONG = {
    "cart-pole", "catalyst-mixing", "orbit-raising", "rayleigh", "rayleigh-free", "shuttle-reentry",
    "van-der-pol-limited",
}  # fmt: skip


@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=[pytest.mark.slow] * (one in LONG)) for one in sorted(DERIVED)]
)
def test_value_agrees_with_its_derivation(name):
    wanted = ENTRIES[name].published["objective"]
    assert DERIVED[name]() == pytest.approx(wanted, rel=2e-9, abs=1e-12)
