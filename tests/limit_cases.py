"""Assertions for plans that break one check by a little more, or less, than is accepted."""

import pytest

#: Units of length of the data.
SCALES = (1e-3, 1.0, 1e3)


def assert_limit(name, allowed, verify, *, rel=1e-3, beside=()):
    """Assert that the check `name` refuses 1.1 times `allowed`, alone, and accepts 0.9 times.

    Parameters
    ----------
    name : str
        The check.
    allowed : float
        Largest violation that should be accepted, computed by the test.
    verify : callable
        Returns the verification of a plan whose violation is a given share of `allowed`.
    rel : float
        Relative accuracy of `allowed` and of the violation.
    beside : sequence of str
        Checks that each of these plans breaks too.
    """
    for share in (1.1, 0.9):
        found = verify(share)
        broken = {check.name for check in found.violated}
        assert broken == {*beside, *([name] if share > 1.0 else [])}, f"{share} of {name}: {found}"
        check = next(check for check in found.checks if check.name == name)
        assert check.worst == pytest.approx(share * allowed, rel=rel, abs=0.0), str(check)
        assert check.tolerance == pytest.approx(allowed, rel=rel, abs=0.0), str(check)


def assert_count(name, verify):
    """Assert that an exact check refuses its smallest violation, alone, and accepts a clean plan."""
    found = verify(True)
    assert [(check.name, check.worst) for check in found.violated] == [(name, 1.0)], str(found)
    clean = verify(False)
    assert clean.ok, str(clean)
    assert name in names_of(clean)


def names_of(*found):
    """Return the names of the checks of some verifications."""
    return {check.name for one in found for check in one.checks}
