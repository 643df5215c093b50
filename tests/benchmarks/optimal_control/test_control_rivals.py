"""Our optimal control beside other people's Python: on the same mesh, and at the same error.

Nothing fails because it is slow; everything fails that is wrong. Each solver has a process of its own
with one thread, and they take turns, so that what else the machine does hits them alike. Run with
``make bench``, or::

    pytest tests/benchmarks/test_control_rivals.py -s

A peer that is not installed is left out, with the reason; ``control_peers.py`` says how to get it.
"""

from __future__ import annotations

import math
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache
from typing import Any

import pytest
from benchmarks.ledger import Ledger, Row, duration
from benchmarks.optimal_control.control_peers import Runner, facts, missing, plan_of

import crosstrack as ct

#: Ipopt options of all packages on every mesh: those of our backend at tolerance 1e-6.
IPOPT = {
    "tol": 1e-9,
    "constr_viol_tol": 1e-10,
    "compl_inf_tol": 1e-8,
    "dual_inf_tol": 1e-5,
    "max_iter": 3000,
    "linear_solver": "mumps",
}
TOLERANCE = 1e-6
#: Number of calls of each solver after the first, and time (s) above which one call suffices.
REPEATS, LONG = 7, 10.0
#: Best known value of the paper's slew, which has no closed form.
SLEW = 8.6529177


@cache
def model(case: str) -> tuple[Any, float]:
    """Return the optimal control problem and its best value."""
    if case.startswith("satellite-slew"):
        return ct.load(case).lower(), SLEW
    from crosstrack.instances.optimal_control.listing import catalogue_entries

    entry = next(one for one in catalogue_entries() if one.name == case)
    return ct.load(case), float(entry.published["objective"])


@dataclass(frozen=True)
class Measured:
    """What our verifier finds on a plan.

    Parameters
    ----------
    objective : float
        The objective of the motion.
    error : float
        Its difference from the best value, relative to ``max(1, |best|)``.
    worst : float
        The worst violation of all checks, re-integration among them, each in its own scale.
    name : str
        Of which check.
    """

    objective: float
    error: float
    worst: float
    name: str

    def __str__(self) -> str:
        return f"objective off by {self.error:.0e}, {self.name} by {self.worst:.0e}"


def measured(case: str, answer: dict[str, Any]) -> Measured | None:
    """Return objective and violation of an answer by our verifier, or None without a plan."""
    problem, best = model(case)
    if answer.get("objective") is None:
        return None
    if "knots" in answer:
        found = problem.verify(plan_of(problem, answer), tolerance=TOLERANCE)
        objective = found.objective
        worst = {one.name: one.worst / one.tolerance * TOLERANCE for one in found.checks}
    else:
        objective, worst = answer["objective"], answer["worst"]
    if objective is None:
        return None
    name = max(worst, key=lambda key: worst[key])
    return Measured(objective, abs(objective - best) / max(1.0, abs(best)), worst[name], name)


def task(case: str, intervals: int, degree: int, **more: Any) -> dict[str, Any]:
    """Return the task of a process."""
    return {
        "case": case,
        **facts(model(case)[0]),
        "intervals": intervals,
        "degree": degree,
        "method": "lg",
        "formulation": "gauss",
        "ipopt": IPOPT,
        "tolerance": TOLERANCE,
        "options": {"refine": False, "intervals": intervals, "degree": degree},
        **more,
    }


def work_of(answer: dict[str, Any]) -> str:
    """Return size and effort in a few words."""
    parts = [f"{answer['nodes']} nodes"] if answer.get("nodes") else []
    if answer.get("meshes", 1) != 1:
        parts.append(f"{answer['meshes']} meshes")
    if answer.get("iterations") is not None:
        parts.append(f"{answer['iterations']} iterations")
    return ", ".join(parts)


@pytest.mark.parametrize(
    ("case", "intervals", "degree"),
    [
        ("optimal-control/brachistochrone", 8, 6),
        ("optimal-control/bryson-denham", 8, 6),
        ("optimal-control/hypersensitive-40", 20, 6),
        ("optimal-control/goddard", 8, 6),
        ("satellite-slew/paper-components", 1, 20),
        ("satellite-slew/paper-components", 8, 6),
        ("satellite-slew/paper-components", 20, 6),
    ],
)
def test_same_mesh(case: str, intervals: int, degree: int, limit: float, ledger: Ledger) -> None:
    """The same transcription on the same mesh to the same tolerance; the same optimum, too."""
    told = task(case, intervals, degree)
    peers = ["ours"] + [name for name in ("yapss",) if not missing(name)]
    if len(peers) == 1:
        pytest.skip(missing("yapss"))
    with ExitStack() as stack:
        runners = {name: stack.enter_context(Runner(name, told)) for name in peers}
        cold = {name: one.run(limit) for name, one in runners.items()}
        warm: dict[str, list[dict[str, Any]]] = {name: [] for name in peers}
        for _ in range(REPEATS):
            for name, one in runners.items():
                warm[name].append(one.run(limit))
    title = f"{case}, Gauss {intervals} x {degree}, tolerance of Ipopt {IPOPT['tol']:g}"
    ledger.titles[title] = title + " (whole: with our verification, which yapss does without)"
    found = {name: measured(case, answers[-1]) for name, answers in warm.items()}
    for name, answers in warm.items():
        assert found[name] is not None, answers[-1]["ended"]
        imports, first = runners[name].started["imports"], cold[name]["seconds"]
        inside = sorted(one["parts"]["solve"] for one in answers)[len(answers) // 2]
        cost = f"in Ipopt {duration(inside)}; first call {duration(first)} after {duration(imports)} of imports"
        ledger.rows.append(
            Row(
                title,
                f"{name} (CasADi {runners[name].started['casadi']})",
                [one.get("own", one["seconds"]) for one in answers],
                [one["seconds"] for one in answers],
                f"{work_of(answers[-1])}; {cost}",
                f"objective {found[name].objective:.9f}",
            )
        )
    mine, theirs = found["ours"], found["yapss"]
    assert mine is not None
    assert theirs is not None
    if not case.startswith("satellite-slew"):  # which has several optima
        assert mine.objective == pytest.approx(theirs.objective, rel=1e-6)


#: Settings of each solver, from coarse to fine: ours by its tolerance, maptor by its own; mpopt by
#: segments, degree and residual, for neither of its numbers ever changes by itself.
LADDERS: dict[str, list[dict[str, Any]]] = {
    "ours": [{"tolerance": t, "options": {}, "formulation": "radau"} for t in (1e-4, 1e-5, 1e-6)],
    "maptor": [
        {"adaptive": {"error_tolerance": t, "max_iterations": 30}} for t in (1e-3, 1e-5, 1e-7, 1e-9)
    ],
    "mpopt": [
        {"intervals": n, "degree": d, "adaptive": {"residual": r, "rounds": 10}}
        for n, d, r in ((8, 5, 1e-4), (16, 6, 1e-5), (24, 10, 1e-6), (40, 10, 1e-7))
    ],
}


@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    "case",
    [
        "optimal-control/brachistochrone",
        "optimal-control/bryson-denham",
        "optimal-control/hypersensitive-40",
        "optimal-control/goddard",
        "satellite-slew/paper-components",
    ],
)
def test_same_error(case: str, limit: float, ledger: Ledger) -> None:
    """The time to a plan whose error, measured by the same means, is below the same threshold."""
    absent = {name: missing(name) for name in ("maptor", "mpopt")}
    if all(absent.values()):
        pytest.skip("; ".join(absent.values()))
    trials: dict[str, list[tuple[dict[str, Any], dict[str, Any], Measured | None]]] = {}
    for name, ladder in LADDERS.items():
        if absent.get(name):
            continue
        trials[name] = []
        for rung in ladder:
            with Runner(name, task(case, **{"intervals": 8, "degree": 5, **rung})) as one:
                first = one.run(limit)
                quick = first["seconds"] is not None and first["seconds"] <= LONG
                again = one.run(limit) if quick else first
            trials[name].append((first, again, measured(case, again)))
            if again["seconds"] is None and "given up" in again["ended"]:
                break
    reached = False
    for goal in (1e-4, 1e-6):
        title = f"{case}, objective and every check within {goal:g}"
        ledger.titles[title] = f"{title} (whole: the first call of a process, imports apart)"
        for name, runs in trials.items():
            good = [
                (first, again, found)
                for first, again, found in runs
                if found is not None and max(found.error, found.worst) <= goal
            ]
            if good:
                first, again, found = min(good, key=lambda one: one[1]["seconds"])
                reached |= name == "ours"
                spent, whole = [again.get("own", again["seconds"])], [first["seconds"]]
                ledger.rows.append(
                    Row(title, name, spent, whole, work_of(again), f"{again['ended']}; {found}")
                )
                continue
            near = [one for one in runs if one[2] is not None]
            if near:
                best = min(near, key=lambda one: max(one[2].error, one[2].worst))
                text = f"not reached; nearest in {duration(best[1]['seconds'])}: {best[2]}"
            else:
                text = f"no plan: {runs[-1][1]['ended'][:80]}"
            ledger.rows.append(Row(title, name, (), (), "", text))
    assert reached
    assert all(math.isfinite(one["seconds"]) for one, _, _ in trials["ours"])
