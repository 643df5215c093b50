"""Report on a program: its properties, and the backends that accept it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ...errors import InvalidData
from ...models.programs.base import BlockProgram, Program
from ...models.programs.structure import properties, warnings_of
from ..contract.states import BackendState, backend_states
from ..report.tables import Printable, table

__all__ = ["Description", "describe"]


@dataclass(frozen=True)
class Description(Printable):
    """Report on a program, made by :meth:`.Program.describe`. Printing it shows tables.

    Parameters
    ----------
    instance : str
        Name of the program.
    model : str
        Kind of the program, such as ``"quadratic-program"``.
    outline : str
        Sizes in one line.
    maximise : bool
        Whether its author maximises the objective.
    properties : mapping
        Properties as JSON data.
    backends : tuple of BackendState
        Backends that accept the program (``"installed"``), that would accept it (``"missing"``) and that
        refuse it (``"refused"``), see :func:`crosstrack.backends`.
    """

    instance: str
    model: str
    outline: str
    maximise: bool
    properties: Mapping[str, Any]
    backends: tuple[BackendState, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the scaling of the program."""
        return tuple(warnings_of(dict(self.properties)))

    @property
    def accepting(self) -> tuple[str, ...]:
        """Names of the installed backends that accept the program."""
        return tuple(s.name for s in self.backends if s.state == "installed")

    @property
    def extras(self) -> dict[str, tuple[str, ...]]:
        """Backends that would accept the program, by the extra that installs them."""
        result: dict[str, tuple[str, ...]] = {}
        for state in self.backends:
            if state.state == "missing":
                result[state.extra] = (*result.get(state.extra, ()), state.name)
        return result

    def to_dict(self) -> dict[str, Any]:
        """Return the report as JSON data."""
        names = ("instance", "model", "outline", "maximise")
        return {
            **{name: getattr(self, name) for name in names},
            **self.properties,
            "warnings": list(self.warnings),
            "backends": {
                state.name: {"state": state.state, "cause": state.cause} for state in self.backends
            },
        }

    def parts(self) -> list[Any]:
        """Return the printable parts: tables of properties and ranges, warnings and backends."""
        facts = self.properties
        rows = [("size", self.outline), ("objective", "maximise" if self.maximise else "minimise")]
        rows += [
            (name, ", ".join(f"{count} {kind}" for kind, count in facts[name].items() if count))
            for name in ("columns", "rows")
        ]
        rows += [
            ("nonzeros", f"{facts['nonzeros']} (density {facts['density']:.3g})"),
            ("convexity", facts["convexity"]),
            *((name, str(count)) for name, count in facts["structure"].items()),
        ]
        ranges = [
            (name, f"{small:.3g}", f"{large:.3g}", f"{_ratio(small, large):.1g}")
            for name, (small, large) in facts["ranges"].items()
        ]
        columns = ("coefficients", "smallest", "largest", "ratio")
        lines = [f"warning: {text}" for text in self.warnings]
        lines.append(f"accepted by {', '.join(self.accepting) or 'no installed backend'}")
        for extra, names in self.extras.items():
            head = f"pip install 'crosstrack[{extra}]' adds" if extra else "not installed:"
            lines.append(f"{head} {', '.join(names)}")
        return [
            table(f"{self.instance or 'program'}: {self.model}", ("property", "value"), rows),
            *([table("", columns, ranges, right=columns[1:])] if ranges else []),
            "\n".join(lines),
        ]


def describe(program: Program) -> Description:
    """Return the report on a program; see :meth:`.Program.describe`."""
    if not isinstance(program, BlockProgram):
        raise InvalidData(
            f"describe supports programs with rows and columns, got {type(program).__name__}",
            field="program",
        )
    return Description(
        program.name, program.kind, program.outline(), program.maximise,
        properties(program), backend_states(program),
    )  # fmt: skip


def _ratio(small: float, large: float) -> float:
    return large / small if small > large / 1e300 else float("inf")
