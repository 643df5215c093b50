"""Kernels with ``allocates=False``, for which Numba counts no references."""

import importlib
import pkgutil
import re
from pathlib import Path

import numpy as np
import pytest

import crosstrack as ct
from crosstrack import compilation
from crosstrack.jit import Kernel, kernel

SCALARS = {"None", "bool", "float", "int", "tuple"}


def plain(size):
    return float(size)


def filled(size):
    return np.zeros(size).sum()


def listed(size):
    values = [1.0]
    values.append(size)
    return values[0]


def twice(values):
    return (values + values)[0]


def all_kernels():
    """Return all kernels in modules of the package."""
    kernels = set()
    for folder in ("models", "solvers"):
        package = importlib.import_module(f"{ct.__name__}.{folder}")
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            source = importlib.util.find_spec(module.name)
            if source.origin and "@kernel" in Path(source.origin).read_text("utf-8"):
                values = vars(importlib.import_module(module.name)).values()
                kernels |= {value for value in values if isinstance(value, Kernel)}
    return kernels


def test_kernels_without_allocations_call_only_such_kernels_and_return_numbers():
    """An array that a callee makes would leak, and a returned one would be freed twice."""
    free = {item for item in all_kernels() if not item.allocates}
    assert len(free) >= 20
    for item in free:
        names = {part.py_func.__name__ for part in compilation.callees(item) if part.allocates}
        assert not names, f"{item.py_func.__qualname__} calls {names}"
        result = item.py_func.__annotations__["return"]
        assert set(re.findall(r"\w+", result)) <= SCALARS, (item.py_func.__qualname__, result)


@pytest.mark.parametrize("function", [filled, listed, twice])
def test_a_kernel_that_allocates_in_spite_of_its_flag_does_not_compile(function):
    from numba.core.errors import NumbaError

    arguments = (np.ones(3),) if function is twice else (3,)
    with pytest.raises(NumbaError):
        kernel(allocates=False)(function)._compile(arguments)
    kernel(function)._compile(arguments)


def test_the_flag_is_part_of_the_key_of_the_cache():
    stamps = [compilation.stamp_of(kernel(allocates=flag)(plain)) for flag in (True, False)]
    assert stamps[0] != stamps[1]
