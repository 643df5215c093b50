"""Our values for the rows of the result tables, see :mod:`.paper`."""

from __future__ import annotations

from collections.abc import Mapping
from statistics import fmean, stdev
from typing import Any

from ..paper import Trials
from .generator import generate
from .paper import INSTANCES

__all__ = ["table_1a", "table_1b"]


def _measure(chains: int, backend: str, trials: Trials) -> tuple[list[float], float]:
    """Return the lengths (m) on the instances of one group, and the mean run time (s)."""
    models = [generate(chains, 5, 100 * chains + k) for k in range(INSTANCES)]
    answers = trials.run(models, backend, runs=1)
    lengths = [float(answer.primal_bound or 0.0) for answer in answers]
    return lengths, fmean(answer.seconds["solve"] for answer in answers)


def _pair(chains: int, backend: str, trials: Trials) -> tuple[dict[str, Any], float, float]:
    """Return the printed columns with greedy insertion and `backend`, and both mean lengths."""
    (greedy, first), (merged, second) = (
        _measure(chains, name, trials) for name in ("greedy", backend)
    )
    longer, shorter = fmean(greedy), fmean(merged)
    cells = {
        "Obj GRE": longer,
        "Time GRE (s)": first,
        "Obj HEU": shorter,
        "Time HEU (s)": second,
        "Improvement (%)": 100 * (longer / shorter - 1),
        "deviation GRE": stdev(greedy),
        "deviation HEU": stdev(merged),
    }
    return cells, longer, shorter


def table_1a(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return our values of one group: greedy insertion, Algorithm 6 and the proven optimum."""
    chains = int(row[0])
    cells, longer, shorter = _pair(chains, "insert-nearest", trials)
    lengths, seconds = _measure(chains, "a-star", trials)
    least = fmean(lengths)
    return {
        **cells,
        "proven optimum": least,
        "GRE above (%)": 100 * (longer / least - 1),
        "HEU above (%)": 100 * (shorter / least - 1),
        "time of the proof (s)": seconds,
    }


def table_1b(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return our values of one group: greedy insertion and Algorithm 6 with chains by index."""
    cells, _, _ = _pair(int(row[0]), "insert-index", trials)
    del cells["deviation GRE"]
    return cells
