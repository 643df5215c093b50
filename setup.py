"""Build script, which derives the list of packages: the root is the package and holds other folders."""

from setuptools import find_packages, setup

__all__ = ["packages"]

#: Packages in the root.
ROOMS = ("cli", "instances", "models", "solvers")


def packages() -> list[str]:
    """Return the names of all packages below the current folder, the root of the repository."""
    inner = [f"{room}.{name}" for room in ROOMS for name in find_packages(room)]
    return ["crosstrack", *sorted(f"crosstrack.{name}" for name in (*ROOMS, *inner))]


if __name__ == "__main__":
    # With its name, setuptools keeps this script out of the package, whose folder it is in.
    setup(packages=packages(), script_name="setup.py")
