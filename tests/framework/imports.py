"""The import graph of the package, read from its files: every import counts, deferred and for types."""

import ast
import gc
from functools import cache

TOP = ("cli", "instances", "models", "solvers")


@cache
def modules(checkout):
    """Return the dotted name, the package and the syntax tree of every module of the package."""
    files = [path for path in checkout.glob("*.py") if path.name != "setup.py"]
    for room in TOP:
        files += sorted((checkout / room).rglob("*.py"))
    found = []
    gc.collect()
    gc.disable()  # it would visit the growing trees again and again, two thirds of the time
    for path in files:
        parts = ["crosstrack", *path.relative_to(checkout).with_suffix("").parts]
        package = parts[:-1]
        name = package if parts[-1] == "__init__" else parts
        found.append((".".join(name), package, ast.parse(path.read_text("utf-8"), str(path))))
    gc.freeze()
    gc.enable()
    return found


def imported(node, package):
    """Return the absolute names that an import statement asks for."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if not isinstance(node, ast.ImportFrom):
        return []
    base = node.module or ""
    if node.level:
        base = ".".join([*package[: len(package) - node.level + 1], *([base] if base else [])])
    return [f"{base}.{alias.name}" for alias in node.names]


def graph(checkout):
    """Return the modules that each module imports, as a dictionary of sets."""
    found = {name: (package, tree) for name, package, tree in modules(checkout)}
    arrows = {name: set() for name in found}
    for name, (package, tree) in found.items():
        for node in ast.walk(tree):
            for target in imported(node, package):
                # A name in a module, or a module in a package.
                owner = target if target in found else target.rpartition(".")[0]
                if owner in found and owner != name:
                    arrows[name].add(owner)
    return arrows


def circles(arrows):
    """Return the strongly connected components with more than one module (Tarjan 1972)."""
    index, low, stack, found = {}, {}, [], []

    def visit(node):
        index[node] = low[node] = len(index)
        stack.append(node)
        for target in sorted(arrows[node]):
            if target not in index:
                visit(target)
                low[node] = min(low[node], low[target])
            elif target in stack:
                low[node] = min(low[node], index[target])
        if low[node] == index[node]:
            part = []
            while not part or part[-1] != node:
                part.append(stack.pop())
            if len(part) > 1:
                found.append(sorted(part))

    for node in sorted(arrows):
        if node not in index:
            visit(node)
    return found
