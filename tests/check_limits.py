"""Assertions about what the checks of a plan accept, shared by every ``test_check_limits.py``."""

from __future__ import annotations

import ast
import inspect
import re

import pytest

#: Factors of the data, such as of all lengths.
SCALES = (1e-3, 1.0, 1e3)


def pairs(cases):
    """Return (name, case) for each case of a table of lists by check name, as parameters."""
    return [
        pytest.param(name, case, id=f"{name}-{k}")
        for name, listed in cases.items()
        for k, case in enumerate(listed)
    ]


def assert_only(check_name, verification):
    """Assert that the check called `check_name` is violated, and no other."""
    assert [check.name for check in verification.violated] == [check_name], str(verification)


def assert_limit(check_name, verify):
    """Assert that ``verify(share)`` accepts 0.9 of the accepted violation and refuses 1.1 of it."""
    for share in (0.0, 0.9):
        found = verify(share)
        assert found.ok, str(found)
    refused = verify(1.1)
    assert_only(check_name, refused)
    (check,) = refused.violated
    assert check.worst == pytest.approx(1.1 * check.tolerance, rel=0.02)


def assert_allowed(name, allowed, verify, *, rel=1e-3, beside=()):
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


def assert_complete(tested, verifications, *modules):
    """Assert that `tested` holds every name in `verifications` and in the source of `modules`."""
    assert {check.name for one in verifications for check in one.checks} == set(tested)
    patterns = {one for module in modules for one in _written(ast.parse(inspect.getsource(module)))}
    for pattern in patterns:
        assert any(re.fullmatch(pattern, name) for name in tested), pattern
    for name in tested:
        assert any(re.fullmatch(pattern, name) for pattern in patterns), name


def _written(tree):
    """Yield patterns of the texts that a module passes as ``name`` to what makes a check."""
    makers = ("Check", "scaled", "count", "largest", "within")
    places = dict.fromkeys(makers, 0)
    assigned, tabled = {}, {}
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            functions = [one for one in node.body if getattr(one, "name", "") == "__init__"]
            function = functions[0] if functions else node
            given = [one.arg for one in function.args.args] if hasattr(function, "args") else []
            if any(getattr(base, "id", "") == "NamedTuple" for base in getattr(node, "bases", ())):
                given = [one.target.id for one in node.body if isinstance(one, ast.AnnAssign)]
            given = [one for one in given if one != "self"]
            if "name" in given:
                places[node.name] = given.index("name")
        elif isinstance(node, ast.Assign):
            for target in node.targets:
                several = isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple)
                targets, values = (
                    (target.elts, node.value.elts) if several else ([target], [node.value])
                )
                for to, value in zip(targets, values, strict=True):
                    assigned.setdefault(getattr(to, "id", ""), []).append(value)
        elif isinstance(node, ast.For | ast.comprehension) and isinstance(node.target, ast.Tuple):
            for row in getattr(node.iter, "elts", ()):  # a table of rows with a name in each
                for to, value in zip(node.target.elts, getattr(row, "elts", ()), strict=False):
                    tabled.setdefault(getattr(to, "id", ""), []).append(value)

    def texts(node):
        if isinstance(node, ast.Constant):
            yield re.escape(str(node.value))
        elif isinstance(node, ast.JoinedStr):
            parts = (
                re.escape(v.value) if isinstance(v, ast.Constant) else ".+" for v in node.values
            )
            yield "".join(parts)
        elif isinstance(node, ast.IfExp):
            yield from (*texts(node.body), *texts(node.orelse))
        elif isinstance(node, ast.Name):
            for value in assigned.get(node.id, ()):
                yield from texts(value)

    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            maker = getattr(node.func, "id", getattr(node.func, "attr", ""))
            place = places.get(maker, 99)
            if place < len(node.args):
                yield from texts(node.args[place])
                # A name in a table belongs to a check only if a check is made of it at once.
                for value in tabled.get(getattr(node.args[place], "id", ""), ()):
                    yield from texts(value) if maker in makers else ()
