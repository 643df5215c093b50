"""Programs from problems of CVXPY, through its own reductions."""

from __future__ import annotations

import itertools
import re
import warnings
from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ....errors import InvalidData, UnsupportedFormulation
from ..base import RowProgram
from ..blocks import Block
from ..cones import ConeBlock, ConeKind
from ..conic import ConicProgram
from ..linear import MixedIntegerProgram, QuadraticProgram
from .link import Source

if TYPE_CHECKING:
    import cvxpy

__all__ = ["program_of_problem"]

Vector = NDArray[np.float64]

#: Kinds of cones by the classes of CVXPY's constraints.
_KINDS = {
    "SOC": ConeKind.SECOND_ORDER,
    "ExpCone": ConeKind.EXPONENTIAL,
    "SvecPSD": ConeKind.SEMIDEFINITE,
}
#: Longest text of a constraint that names its rows.
_LONGEST = 60
#: Texts of CVXPY's classes of atoms, and of the functions that its users call.
_WRITTEN = {
    "PowerApprox(": "power(",
    "GeoMeanApprox(": "geo_mean(",
    "PnormApprox(": "pnorm(",
    ", None, False)": ")",
}


def program_of_problem(problem: cvxpy.Problem) -> RowProgram:
    """Return the linear, quadratic or conic program of a ``cvxpy.Problem``.

    CVXPY reduces the problem to its standard form with cones, with the current values of its parameters. The rows
    of each constraint form a block with its label, or its text if it has none. Rows that CVXPY adds for the
    graphs of functions form the blocks ``"auxiliary 1"`` and so on. A maximisation is negated and marked by
    `maximise`. Raise ``InvalidData`` if a parameter has no value, the data are not finite, or the problem has no
    variable, and ``UnsupportedFormulation`` with the expression or constraint if it is not disciplined convex, or
    contains a cone or a combination of integers and cones without a program here.
    """
    import cvxpy

    cp: Any = cvxpy  # its functions have no types
    if not isinstance(problem, cp.Problem):
        raise InvalidData(
            f"model must be a cvxpy.Problem, got {type(problem).__name__}: build "
            "cvxpy.Problem(objective, constraints)",
            field="model",
        )
    if not problem.variables():
        raise InvalidData("problem must have a variable, but it has none", field="model")
    for parameter in problem.parameters():
        if parameter.value is None:
            raise InvalidData(
                f"parameter {parameter.name()} must have a value, but it has none",
                field="parameters",
            )
    if not problem.is_dcp():
        raise UnsupportedFormulation(
            f"the problem is not disciplined convex: {_first_violation(problem)}{_other_rules(problem)}"
        )
    _require_cones(problem)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            data, chain, inverse = problem.get_problem_data(_form())
    except (cp.SolverError, cp.error.DCPError, cp.error.DPPError, ValueError) as error:
        reason = str(error).strip().partition("\n")[0]
        raise UnsupportedFormulation(f"CVXPY cannot reduce the problem: {reason}") from error
    return _Standard(problem, data, chain, inverse).program()


@cache
def _form() -> Any:
    """Return the description of the standard form for CVXPY: a solver that only defines it."""
    from cvxpy import constraints
    from cvxpy.reductions.solvers.conic_solvers.conic_solver import ConicSolver
    from cvxpy.utilities.psd_utils import TriangleKind

    base: Any = ConicSolver
    kinds: Any = constraints
    linear = base.SUPPORTED_CONSTRAINTS

    class Form(base):  # type: ignore[misc]
        MIP_CAPABLE = True
        BOUNDED_VARIABLES = True
        SUPPORTED_CONSTRAINTS = [*linear, kinds.SOC, kinds.ExpCone, kinds.SvecPSD]
        MI_SUPPORTED_CONSTRAINTS = linear
        PSD_TRIANGLE_KIND = TriangleKind.UPPER
        PSD_SQRT2_SCALING = True
        EXP_CONE_ORDER = [0, 1, 2]

        def name(self) -> str:
            return "CROSSTRACK"

        def import_solver(self) -> None:
            pass

        def supports_quad_obj(self) -> bool:
            return True

        def invert(self, solution: Any, inverse_data: Any) -> Any:
            return solution

        def solve_via_data(self, *arguments: Any, **options: Any) -> Any:
            raise TypeError(
                "this form only describes the data; solve the program by crosstrack.solve"
            )

        def cite(self, data: Any) -> str:
            return ""

    return Form()


def _require_cones(problem: Any) -> None:
    """Raise if the objective or a constraint needs a cone without a program here."""
    import cvxpy
    from cvxpy.problems.problem_form import ProblemForm
    from cvxpy.reductions.solvers.solver import expand_cones

    cp: Any = cvxpy
    form = _form()
    if form.can_solve(ProblemForm(problem)):
        return
    mixed = problem.is_mixed_integer()
    supported = frozenset(form.MI_SUPPORTED_CONSTRAINTS if mixed else form.SUPPORTED_CONSTRAINTS)
    for part in (problem.objective, *problem.constraints):
        alone = (part, []) if part is problem.objective else (cp.Minimize(0), [part])
        cones = ProblemForm(cp.Problem(*alone)).cones(quad_obj=True).copy()
        expand_cones(cones, supported)
        missing = ", ".join(sorted(cone.__name__ for cone in cones - supported))
        if missing:
            raise UnsupportedFormulation(
                f"{_shortened(part)!r} needs cones of the class {missing}, which no program here contains"
                f"{' together with integers' if mixed else ''}"
            )
    raise UnsupportedFormulation("the problem has a combination of cones without a program here")


def _first_violation(problem: Any) -> str:
    """Return the innermost expression that violates the rules, or the part that contains it."""
    for part in (problem.objective, *problem.constraints):
        if part.is_dcp():
            continue
        expressions = list(part.args)
        while expressions:
            entry = expressions.pop()
            if not entry.is_dcp():
                inner = [argument for argument in entry.args if not argument.is_dcp()]
                if not inner:
                    return f"{_shortened(entry)!r} in {_shortened(part)!r}"
                expressions = inner
        curvatures = [entry.curvature.lower() for entry in part.args if not entry.is_constant()]
        return f"{_shortened(part)!r}, whose expression is {' and '.join(curvatures)}"
    return "its expressions"


def _other_rules(problem: Any) -> str:
    """Return a hint if the problem follows other rules of CVXPY."""
    rules = ("quasiconvex", "qcp") if problem.is_dqcp() else ("geometric", "gp")
    if not (problem.is_dqcp() or problem.is_dgp()):
        return ""
    return f"; it is disciplined {rules[0]}: solve it with problem.solve({rules[1]}=True)"


def _shortened(part: Any) -> str:
    with np.printoptions(threshold=_LONGEST, edgeitems=2):  # longer arrays take time and are cut
        words = str(part).split()
    text = re.sub(r"Promote\(([^(),]*), \([^()]*\)\)", r"\1", " ".join(words))
    for name, written in _WRITTEN.items():
        text = text.replace(name, written)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…"


class _Standard:
    """Standard form of a problem: minimise ``x P x / 2 + c x + offset`` with ``b - A x`` in the cones.

    `data`, `chain` and `inverse` are the result of ``problem.get_problem_data``.
    """

    def __init__(self, problem: Any, data: Any, chain: Any, inverse: Any) -> None:
        self.problem, self.data, self.chain, self.inverse = problem, data, chain, inverse
        dims = data["dims"]
        self.zero, self.linear = dims.zero, dims.zero + dims.nonneg
        last = inverse[-1]
        self.constraints = [*last["eq_constr"], *last["other_constr"]]
        self.names = self._names()
        self.maximises = problem.objective.NAME == "maximize"

    def program(self) -> RowProgram:
        """Return the program."""
        rows = sp.csr_array(self.data["A"])
        offset = np.asarray(self.data["b"], float)
        cost = np.asarray(self.data["c"], float).reshape(-1)
        hessian = self.data.get("P")
        lower, upper = offset[: self.linear].copy(), offset[: self.linear]
        lower[self.zero :] = -np.inf
        integral = np.zeros(cost.size, bool)
        integral[[*self._indices("boolean_idx"), *self._indices("integer_idx")]] = True
        low, high = self._bounds(cost.size)
        rows_of, cones = self._blocks()
        shared: dict[str, Any] = {
            "cost": cost,
            "matrix": rows[: self.linear],
            "row_lower": lower,
            "row_upper": upper,
            "column_lower": low,
            "column_upper": high,
            "offset": float(self.inverse[-1]["offset"]),
            "rows": rows_of,
            "columns": self._columns(cost.size),
            "maximise": self.maximises,
        }
        result: RowProgram
        is_quadratic = hessian is not None and hessian.nnz > 0
        if cones:
            result = ConicProgram(
                **shared, hessian=hessian if is_quadratic else None, cones=cones,
                cone_matrix=-rows[self.linear :], cone_offset=offset[self.linear :],
            )  # fmt: skip
        elif is_quadratic:
            result = QuadraticProgram(**shared, hessian=hessian, integral=integral)
        else:
            result = MixedIntegerProgram(**shared, integral=integral)
        return result.with_source(Source(self.problem, self.values, self.assign, ends=True))

    def _indices(self, name: str) -> list[int]:
        return [int(entry[0]) for entry in getattr(self.data["param_prob"].x, name)]

    def _bounds(self, size: int) -> tuple[Vector, Vector]:
        """Return the column bounds: the attributes of variables, and 0 and 1 for Boolean ones."""
        given = self.data.get("lower_bounds"), self.data.get("upper_bounds")
        low, high = (
            np.full(size, other if bound is None else bound, float)
            for bound, other in zip(given, (-np.inf, np.inf), strict=True)
        )
        binary = self._indices("boolean_idx")
        low[binary] = np.maximum(low[binary], 0.0)
        high[binary] = np.minimum(high[binary], 1.0)
        return low, high

    def _names(self) -> dict[int, str]:
        """Return the names of the user's constraints by the number of the reduced constraint."""
        names: dict[int, str] = {}
        for number, constraint in enumerate(self.problem.constraints):
            reduced = constraint.id
            for entry in self.inverse:
                reduced = (getattr(entry, "cons_id_map", None) or {}).get(reduced, reduced)
            name = getattr(constraint, "label", None) or _shortened(constraint)
            names[reduced] = f"{name} (constraint {number})" if name in names.values() else name
        return names

    def _blocks(self) -> tuple[tuple[Block, ...], tuple[ConeBlock, ...]]:
        """Return the blocks of the rows and of the cones, named by the user's constraints."""
        rows: list[Block] = []
        cones: list[ConeBlock] = []
        place = added = 0
        for constraint in self.constraints:
            added += constraint.id not in self.names
            name = self.names.get(constraint.id, f"auxiliary {added}")
            kind = type(constraint).__name__
            if kind in ("Zero", "NonNeg"):
                if constraint.size:
                    rows.append(Block(name, "", place, constraint.size))
                place += constraint.size
                continue
            for part, (dimension, count) in enumerate(_runs(constraint.cone_sizes(), kind)):
                cones.append(
                    ConeBlock(
                        f"{name} (part {part + 1})" if part else name, "", place - self.linear,
                        dimension * count, kind=_KINDS[kind], dimension=dimension,
                    )
                )  # fmt: skip
                place += dimension * count
        return tuple(rows), tuple(cones)

    def _columns(self, size: int) -> tuple[Block, ...]:
        """Return the blocks of the columns, named by variables; those that CVXPY added are auxiliary."""
        standard = self.inverse[-2]
        known = {variable.id: variable for variable in self.problem.variables()}
        blocks: dict[str, Block] = {}
        for number, (start, count) in sorted(standard.id_map.items(), key=lambda item: item[1]):
            variable = known.get(number)
            name = f"auxiliary column {start}" if variable is None else variable.name()
            name = f"{name} ({number})" if name in blocks else name
            if count:
                blocks[name] = Block(name, "", start, count, *_places(variable, name, count))
        return tuple(blocks.values())

    def _inverted(self, plan: Vector, duals: Vector | None) -> Any:
        """Return the solution of the user's problem in CVXPY's form."""
        from cvxpy.reductions.solution import Solution
        from cvxpy.reductions.solvers import utilities

        values: dict[int, Any] = {}
        if duals is not None and duals.size == len(self.data["b"]):
            signed = np.concatenate([-duals[: self.linear], duals[self.linear :]])
            values = utilities.get_dual_values(
                signed, utilities.extract_dual_value, self.constraints
            )
        variable = self.inverse[-1]["var_id"]
        # CVXPY computes the value of the problem from its variables.
        solution = Solution("optimal", 0.0, {variable: np.array(plan)}, values, {})
        steps = list(zip(self.chain.reductions[:-1], self.inverse[:-1], strict=True))
        for reduction, entry in reversed(steps):
            solution = reduction.invert(solution, entry)
        return solution

    def values(self, plan: Vector) -> dict[str, Any]:
        """Return the values of the variables by name."""
        parts = self._inverted(plan, None).primal_vars
        dense = {k: part.toarray() if sp.issparse(part) else part for k, part in parts.items()}
        return {variable.name(): dense[variable.id] for variable in self.problem.variables()}

    def assign(
        self, plan: Vector | None, duals: Vector | None, objective: float | None, termination: str
    ) -> None:
        """Set the variables, the dual values of the constraints, the value and the status of the problem.

        Without a plan, the variables are None, and the value is infinite as CVXPY's own.
        """
        from cvxpy.reductions.solution import failure_solution

        if plan is not None and objective is not None:
            solution = self._inverted(plan, duals)
            solution.status = "optimal" if termination == "optimal" else "user_limit"
        else:
            solution = failure_solution(termination)
            solution.opt_val *= -1.0 if self.maximises else 1.0
        self.problem.unpack(solution)


def _runs(sizes: Sequence[int], kind: str) -> list[tuple[int, int]]:
    """Return the dimensions of consecutive cones with their counts."""
    rows = (int(size * (size + 1) // 2 if kind == "SvecPSD" else size) for size in sizes)
    return [(dimension, len(list(group))) for dimension, group in itertools.groupby(rows)]


def _places(variable: Any, name: str, count: int) -> tuple[Any, ...]:
    """Return the template and index of the entries of a variable, such as ``x[1, 2]``."""
    shape = () if variable is None else variable.shape
    if not shape or int(np.prod(shape)) != count:  # reduced, such as a symmetric matrix
        return ()
    index = np.column_stack(np.unravel_index(np.arange(count), shape, order="F"))
    fields = ", ".join(f"{{{axis}}}" for axis in range(len(shape)))
    return name.replace("{", "{{").replace("}", "}}") + f"[{fields}]", index
