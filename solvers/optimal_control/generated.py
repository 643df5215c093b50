"""Step of a prepared solver as self-contained C code."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from ...errors import InvalidData, UnsupportedFormulation
from ...files import writable, write_text
from ..programs.casadi_plugins import last_line
from .parametric import Parametric

__all__ = ["step_function", "write_step"]

#: Names of the results of a step and of its start.
IO = ("u", "objective", "violation", "z", "lam_x", "lam_g")


def step_function(posed: Parametric, solver: Any, name: str = "step") -> Any:
    """Return a step as a function that CasADi can evaluate, map and write as C.

    The arguments are the data by their names, then the start ``z`` in the solver's units and the
    multipliers ``lam_x`` and ``lam_g`` (0 if unknown). The results are ``u``, the controls at the start
    of the first phase, ``objective``, ``violation`` (the largest of a scaled row, infinite if a value is
    not finite), and ``z``, ``lam_x``, ``lam_g`` for the next step, whose names end in ``_out``.
    """
    import casadi

    data = {key: casadi.MX.sym(key, quantity.size) for key, quantity in posed.data.items()}
    state = {
        key: casadi.MX.sym(key, size)
        for key, size in (
            ("z", posed.free.size),
            ("lam_x", posed.free.size),
            ("lam_g", posed.rows.size),
        )
    }
    bounds = {key: casadi.DM(value) for key, value in posed.bounds.items()}
    p = casadi.vertcat(*data.values())
    solution = solver(x0=state["z"], lam_x0=state["lam_x"], lam_g0=state["lam_g"], p=p, **bounds)
    columns_at, weights, lower, upper = posed.at_begin
    # The solver's own values are not those of its point if a function is not a number.
    f, g = posed.value(solution["x"], p)
    g = casadi.vertcat(g, posed.data_values(p))
    least, largest = posed.all_bounds
    violations = casadi.fmax(least - g, g - largest)
    # Comparisons with NaN are false in C.
    is_finite = casadi.fabs(casadi.sum1(solution["x"]) + casadi.sum1(g) + f) < casadi.inf
    columns = posed.stacked(solution["x"], p) * casadi.DM(posed.program.column_scale)
    first = [
        casadi.fmin(casadi.fmax(casadi.dot(columns[row], weights), low), high)
        for row, low, high in zip(columns_at.tolist(), lower, upper, strict=True)
    ]
    results = {
        "u": casadi.vertcat(*first, casadi.MX(0, 1)),
        "objective": f * posed.program.objective_scale,
        "violation": casadi.if_else(
            is_finite, casadi.mmax(casadi.fmax(violations, 0.0)), casadi.inf
        ),
        "z_out": solution["x"],
        "lam_x_out": solution["lam_x"],
        "lam_g_out": solution["lam_g"],
    }
    return casadi.Function(
        name, [*data.values(), *state.values()], [*results.values()], [*data, *state], [*results]
    )


def write_step(posed: Parametric, solver: Any, path: str | os.PathLike[str]) -> Path:
    """Write the C code of :func:`step_function`, named after the file, with CasADi's C interface.

    A function without C code, such as a callback, raises ``UnsupportedFormulation``, and a file that cannot be
    written, or whose name is not a valid name of a C function, ``InvalidData``.
    """
    import casadi

    target = writable(path, [".c"])
    name = target.stem
    if not casadi.Function.check_name(name):
        raise InvalidData(
            f"the file's stem names the function in C, which cannot be {name!r}: take letters and "
            "digits, such as 'step.c'",
            field="path",
        )
    taken = posed.data.keys() & {*IO, *(f"{key}_out" for key in IO[3:])}
    if taken:
        raise UnsupportedFormulation(
            f"no C code can be written: data {', '.join(map(repr, sorted(taken)))} have names of inputs or "
            "outputs of the step: rename them"
        )
    try:
        code = casadi.CodeGenerator(name)
        code.add(step_function(posed, solver, name))
        code.add(casadi.Function(f"{name}_start", [], [casadi.DM(posed.guess)], [], ["z"]))
        text = code.dump()
    except RuntimeError as error:
        raise UnsupportedFormulation(f"no C code can be written: {last_line(error)}") from error
    return write_text(target, text)
