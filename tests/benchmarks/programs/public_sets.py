"""Public sets of programs with every solver, at two accuracies.

- ``public_sets.py run FOLDER [ACCURACY]`` runs the campaigns and appends the answers to records in FOLDER. An
  interrupted run resumes. About an hour on one processor.
- ``public_sets.py references FOLDER`` solves the programs again for which two solvers do not agree yet, with a
  longer limit, and writes ``tests/programs/public_objectives.json``.
- ``public_sets.py tables FOLDER`` writes ``docs/measured/programs.json`` and ``docs/measured/programs.svg``.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import measured

import crosstrack as ct
from crosstrack.solvers.bench import (
    Campaign,
    Set,
    performance_profile,
    read_records,
    shifted_geometric_mean,
)

ROOT = Path(__file__).resolve().parents[3]
DATA = ROOT.parent / "shared" / "data" / "programs"
REFERENCES = ROOT / "tests" / "programs" / "public_objectives.json"
#: Tolerances of the campaigns: violation, and gap between objective and bound.
ACCURACIES = (1e-6, 1e-9)
#: Seconds per run, seconds of a run for a reference, and the largest number of columns for solvers with
#: dense matrices.
LIMIT, LONG, DENSE = 3.0, 60.0, 1000
SPARSE_SOLVERS = ("clarabel", "highs", "osqp", "piqp", "proxqp", "scs")
DENSE_SOLVERS = ("daqp", "quadprog")
#: Programs on which the active-set method of HiGHS does not end in the long limit.
ACTIVE_SET_TOO_SLOW = ("BOYD1", "CONT-201", "CVXQP1_L", "CVXQP3_L")
LONG_SOLVERS = ("clarabel", "highs", "piqp")
LINEAR_SOLVERS = ("gurobi", "highs", "ortools", "scip", "scipy")
PACKAGES = {
    **{name: name for name in ("clarabel", "osqp", "piqp", "scs", "daqp", "quadprog", "ortools")},
    "highs": "highspy",
    "proxqp": "proxsuite",
    "scip": "pyscipopt",
    "gurobi": "gurobipy",
    "scipy": "scipy",
}
#: Names of the campaigns.
RECORDS = ("public", "dense", "mps")
#: Explanations of references on which fewer than two solvers agree, or which differ from the published value.
NOTES = {
    "CONT-201": "Clarabel alone ends within 60 s; the published value, in 8 digits, is equal",
    "CVXQP1_L": "no solver ends within 60 s; the value is the published one, in 8 digits",
    "CVXQP3_L": "no solver ends within 60 s; the value is the published one, in 8 digits",
    "HUES-MOD": "the published value is 3.4824690e7",
    "LISWET8": "the published value is 7.1447006e3",
    "STADAT1": "Clarabel alone ends within 60 s; the published value, in 8 digits, is equal. PIQP calls the program "
    "unbounded, and HiGHS stops at a worse point",
}
#: Published objectives of programs without a solver: Maros and Meszaros, "A repository of convex quadratic
#: programming problems" (Optimization Methods and Software 11, 1999).
WITHOUT_SOLVER = {"CVXQP1_L": 1.0870480e8, "CVXQP3_L": 1.1571110e8}
#: Relative difference up to which objectives are equal.
EQUAL = 1e-6
#: Success rates (%) on all 138 Maros-Meszaros programs at the accuracies 1e-6 and 1e-9: qpbenchmark 2.3.0,
#: 2024-09-07, https://qpsolvers.github.io/qpbenchmark/maros_meszaros_qpbenchmark/.
PUBLISHED = {
    "clarabel": (43.5, 34.8),
    "highs": (19.6, 0.0),
    "osqp": (24.6, 26.1),
    "piqp": (94.2, 73.2),
    "proxqp": (66.7, 52.9),
    "scs": (58.7, 43.5),
}
#: Outcomes of a run, in the order of the columns.
SOLVED, INEXACT, FALSE, UNPROVEN, LATE, REFUSED = (
    *("solved", "inexact", "false claim", "unproven", "time limit"),
    "refused",
)


def campaigns(tolerance: float) -> Iterator[tuple[str, Campaign]]:
    """Yield the jobs of one accuracy by the name of their record."""
    columns = {path: ct.load(path).size for path in sorted((DATA / "qp").glob("*.mat"))}
    small = tuple(f"./qp/{path.name}" for path, size in columns.items() if size <= DENSE)
    options: dict[str, Any] = {"time_limit": LIMIT, "tolerance": tolerance, "gap": tolerance}
    options["memory_limit"] = 4000
    for name, instances, backends in (
        ("public", ("./qp/*.mat",), SPARSE_SOLVERS),
        ("mps", ("./mps/*.mps",), LINEAR_SOLVERS),
        ("dense", small, DENSE_SOLVERS),
    ):
        jobs = (Set(instances, backends, **options),)
        yield name, Campaign(jobs, title=name, folder=str(DATA))


def run(folder: Path, tolerances: Sequence[float]) -> None:
    """Run the campaigns, or the rest of them."""
    for tolerance in tolerances:
        for name, campaign in campaigns(tolerance):
            file = record(folder, name, tolerance)
            ct.bench(campaign, record=file, resume=file.exists())


def record(folder: Path, name: str, tolerance: float) -> Path:
    """Return the file of the records of a campaign."""
    return folder / f"{name}-{tolerance:g}.jsonl"


def answers(folder: Path, name: str, tolerance: float) -> list[Any]:
    """Return the recorded answers of one campaign."""
    file = record(folder, name, tolerance)
    return list(read_records(file).solutions) if file.exists() else []


def equal(first: float, second: float) -> bool:
    """Return True if two objectives differ by rounding or the tolerance of a solver only."""
    return abs(first - second) <= EQUAL * max(1.0, abs(first), abs(second))


def agreement(values: dict[str, float]) -> tuple[float, list[str]]:
    """Return the value on which most solvers agree, and their names."""
    groups = [
        (value, [name for name, other in values.items() if equal(value, other)])
        for value in values.values()
    ]
    return max(groups, key=lambda group: len(group[1]))


def objectives(folder: Path) -> tuple[dict[str, dict[str, float]], dict[str, list[str]]]:
    """Return the objectives by program and solver, and the solvers that call a program infeasible.

    A more accurate answer of a solver replaces the others. In the long runs, verified plans that
    are not proven optimal are accepted, too.
    """
    values: dict[str, dict[str, float]] = {}
    infeasible: dict[str, list[str]] = {}
    for tolerance, names in ((1e-6, RECORDS), (1e-9, RECORDS), (1e-9, ("long",))):
        for name in names:
            for answer in answers(folder, name, tolerance):
                own = values.setdefault(answer.instance, {})
                accepted = ("optimal", "feasible") if name == "long" else ("optimal",)
                if answer.termination in accepted:
                    own[answer.backend] = answer.value
                elif answer.termination == "infeasible":
                    infeasible.setdefault(answer.instance, []).append(answer.backend)
    return values, infeasible


def references(folder: Path) -> None:
    """Write objectives on which two independent solvers agree, after long runs of the other programs."""
    values, infeasible = objectives(folder)
    missing = {
        name for name, own in values.items()
        if name not in infeasible and (not own or len(agreement(own)[1]) < 2)
    }  # fmt: skip
    options: dict[str, Any] = {"time_limit": LONG, "tolerance": 1e-9, "gap": 1e-9}
    sets = []
    quadratic = sorted((DATA / "qp").glob("*.mat"), reverse=True)
    quadratic.append(DATA / "mps" / "primal1.mps")
    linear = [path for path in sorted((DATA / "mps").glob("*.mps")) if path.stem != "primal1"]
    for paths, backends in ((quadratic, LONG_SOLVERS), (linear, ("highs",))):
        files = tuple(f"./{p.parent.name}/{p.name}" for p in paths if p.stem in missing)
        slow = tuple((name, "highs") for name in ACTIVE_SET_TOO_SLOW if name in missing)
        options["exclude"] = slow if paths is quadratic else ()
        sets += [Set(files, backends, **options)] if files else []
    file = record(folder, "long", 1e-9)
    if sets or file.exists():
        jobs = Campaign(tuple(sets), title="long", folder=str(DATA))
        ct.bench(jobs, record=file, resume=file.exists(), workers=2)
    values, infeasible = objectives(folder)
    result: dict[str, Any] = {}
    for path in sorted([*DATA.glob("qp/*.mat"), *DATA.glob("mps/*.mps")]):
        if solvers := sorted(set(infeasible.get(path.stem, ()))):
            result[path.name] = {"infeasible": True, "solvers": solvers}
            continue
        own = values[path.stem]
        value, solvers = agreement(own) if own else (WITHOUT_SOLVER[path.stem], [])
        others = {name: other for name, other in sorted(own.items()) if name not in solvers}
        entry: dict[str, Any] = {"value": value, "solvers": sorted(solvers)}
        result[path.name] = entry | ({"others": others} if others else {})
        if note := NOTES.get(path.stem):
            result[path.name]["note"] = note
    REFERENCES.write_text(json.dumps(result, indent=1) + "\n", "utf-8")


def outcome(answer: Any, reference: dict[str, Any]) -> str:
    """Return the outcome of a run."""
    value = reference.get("value")
    if answer.termination == "infeasible":
        return SOLVED if reference.get("infeasible") else FALSE
    if answer.termination == "optimal":
        if reference.get("infeasible"):
            return FALSE
        return SOLVED if equal(answer.value, value) else INEXACT
    if answer.termination in ("unbounded", "rejected"):
        return FALSE
    if "which nothing proves" in answer.message and answer.limit is None:
        return FALSE
    if answer.limit is not None:
        return LATE
    return REFUSED if answer.message.startswith("Unsupported") else UNPROVEN


def seconds(answer: Any) -> float:
    """Return the seconds to build the solver's data and to solve."""
    return float(answer.seconds.get("solve", 0.0) + answer.seconds.get("build", 0.0))


def tables(folder: Path) -> None:
    """Write the tables and the picture of the profiles."""
    known = {Path(name).stem: e for name, e in json.loads(REFERENCES.read_text("utf-8")).items()}
    wrong: list[list[Any]] = []
    profiles = {}
    for table, records in (("qp", ("public", "dense")), ("mps", ("mps",))):
        rows: list[list[Any]] = []
        for tolerance in ACCURACIES:
            runs = [s for name in records for s in answers(folder, name, tolerance)]
            measures: dict[str, dict[str, float]] = {}
            for solver in dict.fromkeys(s.backend for s in runs):
                own = [s for s in runs if s.backend == solver]
                ends = [outcome(s, known[s.instance]) for s in own]
                spent = [
                    min(seconds(s), LIMIT) if end == SOLVED else LIMIT
                    for s, end in zip(own, ends, strict=True)
                ]
                rate = None
                if solver in PUBLISHED:
                    rate = PUBLISHED[solver][ACCURACIES.index(tolerance)]
                counts = [
                    ends.count(end) for end in (SOLVED, INEXACT, FALSE, UNPROVEN, LATE, REFUSED)
                ]
                shares = [100 * counts[0] / len(own), *([rate] if table == "qp" else [])]
                typical = shifted_geometric_mean(spent, 1.0)
                rows.append(
                    [f"{tolerance:.0e}", f"`{solver}`", len(own), *counts, *shares, typical]
                )
                if solver not in DENSE_SOLVERS:
                    measures[solver] = {
                        s.instance: max(seconds(s), 1e-6) if end == SOLVED else math.inf
                        for s, end in zip(own, ends, strict=True)
                    }
                wrong += [
                    _finding(s, end, known[s.instance])
                    for s, end in zip(own, ends, strict=True)
                    if end in (INEXACT, FALSE)
                ]
            names = sorted({name for times in measures.values() for name in times})
            profiles[table, tolerance] = performance_profile(
                {
                    solver: [times.get(name, math.inf) for name in names]
                    for solver, times in measures.items()
                }
            )
        columns = {"accuracy": "", "solver": "", "programs": "d"}
        columns |= dict.fromkeys((SOLVED, INEXACT, FALSE, UNPROVEN, LATE, REFUSED), "d")
        columns |= {"solved, %": ".0f"} | ({"published, %": ".1f"} if table == "qp" else {})
        used = sorted({PACKAGES[row[1].strip("`")] for row in rows})
        measured.write(
            "programs", table, __file__, {**columns, "typical seconds": ".3f"}, rows, used,
            f"Limit {LIMIT:g} s per run.",
        )  # fmt: skip
    columns = {"program": "", "solver": "", "accuracy": "", "claim": "", "value": ".8g"}
    columns |= {"reference": ".8g", "difference": ".1e"}
    wrong.sort(key=lambda row: (row[1], row[0], row[2]))
    measured.write("programs", "wrong", __file__, columns, wrong)
    draw(profiles)


def _finding(answer: Any, end: str, reference: dict[str, Any]) -> list[Any]:
    """Return the row of an answer that is inexact or a false claim."""
    value = answer.value if end == INEXACT else None
    known = reference.get("value")
    claim = "optimal" if end == INEXACT else str(answer.termination)
    if end == FALSE and "calls it" in answer.message:
        claim = answer.message.partition("calls it ")[2].partition(",")[0]
    difference = None if value is None else abs(value - known) / max(1.0, abs(known))
    accuracy = f"{answer.options['tolerance']:.0e}"
    return [answer.instance, f"`{answer.backend}`", accuracy, claim, value, known, difference]


def draw(profiles: dict[tuple[str, float], Any]) -> None:
    """Draw the performance profiles."""
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams.update({"svg.hashsalt": "programs", "svg.fonttype": "none", "font.size": 9})
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 2, figsize=(9, 6.4), layout="constrained", sharey=True)
    titles = {"qp": "quadratic programs", "mps": "linear and mixed-integer programs"}
    for axis, ((table, tolerance), profile) in zip(axes.flat, profiles.items(), strict=True):
        for solver, (ratios, shares) in profile.items():
            axis.step([*ratios, 1e4], [*shares, shares[-1]], where="post", label=solver)
        axis.set(xscale="log", xlim=(1, 1e3), ylim=(0, 1))
        axis.set_title(f"{titles[table]}, accuracy {tolerance:.0e}")
        axis.legend(loc="lower right")
    for axis in axes[1]:
        axis.set_xlabel("time relative to the fastest solver of the program")
    for axis in axes[:, 0]:
        axis.set_ylabel("share of the programs solved")
    figure.savefig(ROOT / "docs" / "measured" / "programs.svg", metadata={"Date": None})


if __name__ == "__main__":
    verb, place = sys.argv[1], Path(sys.argv[2])
    if verb == "run":
        run(place, [float(text) for text in sys.argv[3:]] or ACCURACIES)
    elif verb == "references":
        references(place)
    else:
        tables(place)
