"""Measurement of the result tables of the paper on error-correction routes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..paper import Run, Trials
from .listing import setting_model

__all__ = ["table_1", "table_2", "table_3"]


def _seconds(run: Run) -> float | str:
    """Return the time of the search without imports and proofs, s, or the limit that ended it."""
    if run.limit is not None:
        return f"{run.limit} limit"
    seconds: float = run.statistics.get("search_seconds", run.seconds["solve"])
    return seconds


def _length(run: Run) -> float | str:
    """Return the length of the plan of a run, in metres."""
    return "no route" if run.primal_bound is None else run.primal_bound


def _quickest(model: Any, backend: str, trials: Trials) -> Run:
    """Return the run with the shortest search time; these backends are deterministic."""
    runs = [trials.run(model, backend)[0] for _ in range(trials.runs)]
    return min(runs, key=lambda run: run.statistics["search_seconds"])


def _is_optimal(run: Run) -> bool:
    return str(run.termination) == "optimal"


def table_1(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return sizes and parameters of our instance for a row of table 1."""
    model = setting_model(int(row[0]))
    counts = {kind: int((model.kinds == kind).sum()) for kind in ("horizontal", "vertical")}
    names = {"α1": "alpha1", "α2": "alpha2", "β1": "beta1", "β2": "beta2", "θ": "theta"}
    limits = {name: getattr(model, field) for name, field in names.items()}
    return {"points": len(model.points), **counts, **limits, "δ": model.horizontal_rate}


def table_2(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return seconds and lengths of the paper's program and of the two-stage algorithm."""
    model = setting_model(int(row[0]))
    best, stages = (_quickest(model, name, trials) for name in ("label-setting", "two-stage"))
    flow, program = (
        trials.run(model, name, runs=1)[0] for name in ("highs:arc-flow", "highs:paper")
    )
    return {
        "program (s)": _seconds(program),
        "program (m)": _length(program),
        "two-stage (s)": _seconds(stages),
        "two-stage (m)": _length(stages),
        "optimal": "yes" if _is_optimal(stages) else "no",
        "proven optimum (m)": best.primal_bound if _is_optimal(best) else "not proven",
        "arc-flow (s)": _seconds(flow),
        "label-setting (s)": _seconds(best),
        "runs": trials.runs,
    }


def table_3(row: tuple[str, ...], trials: Trials) -> Mapping[str, Any]:
    """Return seconds and numbers of labels of the three algorithms."""
    model = setting_model(int(row[0]))
    names = ("label-setting", "two-stage", "pulse", "dynamic-programming")
    best, stages, pulse, dynamic = (_quickest(model, name, trials) for name in names)
    values: dict[str, Any] = {
        "runs": trials.runs,
        "label-setting": _seconds(best),
        "λ": stages.statistics["threshold factor"],
    }
    for name, run, key in (("T1", stages, "stage1_seconds"), ("T2", stages, "stage2_seconds")):
        ended = run.limit is None or name == "T1"
        values[name] = run.statistics[key] if ended else f"{run.limit} limit"
    values |= {"T": _seconds(stages), "pulse": _seconds(pulse), "DP": _seconds(dynamic)}
    for name, run in (("T2", stages), ("pulse", pulse), ("DP", dynamic)):
        values[f"labels of {name}"] = run.statistics["labels extended"]
    first = stages.statistics["stage1 length"]
    if best.primal_bound is not None and not isinstance(first, str):
        values["stage 1 over optimum"] = first / best.primal_bound
    values["proven optimum (m)"] = best.primal_bound if _is_optimal(best) else "not proven"
    return values
