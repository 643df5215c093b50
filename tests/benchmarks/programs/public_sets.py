"""Public sets of programs with every solver, at two accuracies: the tables of the page "Comparison".

``public_sets.py run FOLDER`` runs the campaigns and appends the answers to records in FOLDER, from which an
interrupted run resumes; ``public_sets.py tables FOLDER`` writes ``docs/measured/programs.json``, the profiles
in ``docs/measured``, and the reference values in ``tests/programs/public_objectives.json``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import crosstrack as ct
from crosstrack.solvers.bench import Campaign, Set

ROOT = Path(__file__).resolve().parents[3]
DATA = ROOT.parent / "shared" / "data" / "programs"
#: Tolerances of the two campaigns.
ACCURACIES = (1e-6, 1e-9)
#: Seconds per run, and the largest number of columns for solvers with dense matrices.
LIMIT, DENSE = 3.0, 1000
SPARSE_SOLVERS = ("clarabel", "highs", "osqp", "piqp", "proxqp", "scs")
DENSE_SOLVERS = ("daqp", "quadprog")
LINEAR_SOLVERS = ("highs", "scip", "scipy", "ortools", "gurobi")


def campaign(tolerance: float) -> Campaign:
    """Return the jobs of one accuracy."""
    columns = {path: ct.load(path).size for path in sorted((DATA / "qp").glob("*.mat"))}
    small = tuple(f"./qp/{path.name}" for path, size in columns.items() if size <= DENSE)
    options = {"time_limit": LIMIT, "tolerance": tolerance, "gap": tolerance, "memory_limit": 4000}
    return Campaign(
        (
            Set(("./qp/*.mat",), SPARSE_SOLVERS, **options),
            Set(("./mps/*.mps",), LINEAR_SOLVERS, **options),
            Set(small, DENSE_SOLVERS, **options),
        ),
        title=f"public programs, tolerance {tolerance:g}",
        folder=str(DATA),
    )


def record(folder: Path, tolerance: float) -> Path:
    """Return the file of the records of one accuracy."""
    return folder / f"public-{tolerance:g}.jsonl"


def run(folder: Path, tolerance: float) -> None:
    """Run one campaign, or the rest of it."""
    file = record(folder, tolerance)
    ct.bench(campaign(tolerance), record=file, resume=file.exists())


if __name__ == "__main__":
    run(Path(sys.argv[2]), float(sys.argv[3]))
