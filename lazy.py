"""Lazy exports of a package."""

from __future__ import annotations

import ast
import importlib
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

__all__ = ["attach", "moved", "redirect"]


def attach(
    package: str, file: str
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package that exports lazily.

    The exports are the names that the package imports in its block ``if TYPE_CHECKING:``, which
    type checkers read. They are taken from its source, as by the package ``lazy_loader``,
    so that they are listed once.

    Parameters
    ----------
    package, file : str
        The package's ``__name__`` and ``__file__``.

    Returns
    -------
    get : callable
        ``__getattr__``, which imports the module of a name at first use.
    names_of : callable
        ``__dir__``.
    names : list of str
        ``__all__``, sorted.
    """
    homes = {
        # ``from . import name`` exports a sub-package.
        alias.asname or alias.name: (f".{node.module or alias.name}", node.module and alias.name)
        for block in ast.parse(Path(file).read_bytes()).body
        if isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING"
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    names = sorted(homes)

    def get(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        home, original = homes[name]
        module = importlib.import_module(home, package)
        return getattr(module, original) if original else module

    return get, lambda: names, names


def moved(module: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """Return ``__getattr__`` of a module that keeps names importable, with a ``DeprecationWarning``.

    Parameters
    ----------
    module : str
        The module's ``__name__``.
    homes : mapping of str to str
        Names separated by spaces, by the module that now defines them, relative to the package of
        `module`, such as ``".states"``.
    """
    package = module.rpartition(".")[0]
    home_of = {name: home for home, names in homes.items() for name in names.split()}

    def get(name: str) -> Any:
        if name not in home_of:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        home = importlib.import_module(home_of[name], package)
        message = f"{module}.{name} is now {home.__name__}.{name}; the former name will be removed"
        warnings.warn(message, DeprecationWarning, stacklevel=2)
        return getattr(home, name)

    return get


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
