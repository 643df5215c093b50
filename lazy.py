"""Lazy exports of a package."""

from __future__ import annotations

import importlib
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

__all__ = ["attach", "redirect"]


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


def redirect(package: str, homes: Mapping[str, str]) -> None:
    """Keep the former names of modules importable, with a ``DeprecationWarning``.

    Parameters
    ----------
    package : str
        The package's ``__name__``.
    homes : mapping of str to str
        Present name of each module by its former name, both relative to the package.
    """
    sys.meta_path.append(
        _Redirect({f"{package}.{old}": f"{package}.{new}" for old, new in homes.items()})
    )


class _Redirect(MetaPathFinder, Loader):
    """Finder and loader of modules under their former names."""

    def __init__(self, homes: Mapping[str, str]) -> None:
        self.homes = homes

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        return ModuleSpec(fullname, self) if fullname in self.homes else None

    def exec_module(self, module: ModuleType) -> None:
        home = self.homes[module.__name__]
        message = f"{module.__name__} is now {home}; the former name will be removed"
        warnings.warn(message, DeprecationWarning, stacklevel=2)
        current = importlib.import_module(home)
        module.__doc__ = current.__doc__
        module.__getattr__ = lambda name: getattr(current, name)  # type: ignore[method-assign]
