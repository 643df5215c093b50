"""Lazy exports of a package."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any

__all__ = ["attach"]


def attach(
    package: str, homes: Mapping[str, tuple[str, ...]]
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package that exports lazily.

    Parameters
    ----------
    package : str
        The package's ``__name__``.
    homes : mapping of str to tuple of str
        Exported names by the module that defines them, relative to the package.

    Returns
    -------
    get : callable
        ``__getattr__``, which imports the module of a name at first use.
    names_of : callable
        ``__dir__``.
    names : list of str
        ``__all__``, sorted.
    """
    modules = {name: module for module, names in homes.items() for name in names}
    names = sorted(modules)

    def get(name: str) -> Any:
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(importlib.import_module(f".{modules[name]}", package), name)

    return get, lambda: names, names
