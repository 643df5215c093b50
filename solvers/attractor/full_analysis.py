"""``full-analysis``: embedding, exponent, correlation dimension and judgement in one plan."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict
from typing import Any, ClassVar

from ...errors import InvalidData
from ...models.attractor.model import AttractorAnalysis
from ..contract.backend import Answer, Backend, Feature, Request
from ..contract.option import Option
from .correlation import CorrelationDimension
from .delays import (
    Autocorrelation,
    CorrelationIntegral,
    ImprovedCorrelationIntegral,
    MutualInformation,
)
from .dimensions import Cao, FalseNeighbours
from .exponents import Kantz, Rosenstein
from .native import EMBEDDING, AttractorBackend, Embedding, Finding, RunStopped, embed, poll_of
from .prediction import choose_embeddings
from .surrogates import RANKING, ranks, statistics
from .verdict import gather, judge

__all__ = ["FullAnalysis"]


def _by_name(*backends: type[Backend]) -> dict[str, type[Backend]]:
    return {backend.name: backend for backend in backends}


_DELAYS = _by_name(
    MutualInformation, Autocorrelation, CorrelationIntegral, ImprovedCorrelationIntegral
)
_DIMENSIONS = _by_name(Cao, FalseNeighbours, CorrelationIntegral, ImprovedCorrelationIntegral)
_EXPONENTS: dict[str, type[Rosenstein]] = {one.name: one for one in (Rosenstein, Kantz)}


class FullAnalysis(AttractorBackend):
    """Backend that computes all parts of an estimate. A missing part is None with a reason in the message.

    At a time limit the later parts are omitted.
    """

    name = "full-analysis"
    summary = "embedding, exponent, correlation dimension and a judgement against surrogates"
    features = frozenset({Feature.INTERRUPT, Feature.SEED})
    deterministic = False
    options: ClassVar[dict[str, Option]] = {
        **EMBEDDING,
        "delay_method": Option(MutualInformation.name, "method for the delay", str, tuple(_DELAYS)),
        "dimension_method": Option(Cao.name, "method for the dimension", str, tuple(_DIMENSIONS)),
        "exponent_method": Option(
            Rosenstein.name, "method for the exponent", str, tuple(_EXPONENTS)
        ),
        **RANKING,
    }

    def find(self, problem: AttractorAnalysis, request: Request) -> Finding:
        """Compute the parts in order."""
        options, figures, remarks = request.options, dict[str, Any](), list[str]()

        def part(backend: Backend, what: str, given: dict[str, Any]) -> Any:
            """Return the plan of a stage; None with a remark if it is missing."""
            try:
                answer: Answer = request.within(backend, problem, options=given)
            except InvalidData as error:
                remarks.append(f"no {what}: {error}")
                return None
            figures.update({f"{what}, {name}": value for name, value in answer.statistics.items()})
            if answer.point is None:
                remarks.append(f"no {what}: the run was stopped before")
            elif answer.message:
                remarks.append(answer.message)
            return answer.point

        chosen = {name: options[name] for name in EMBEDDING}
        # `choose_embeddings` compares delays and dimensions by default.
        if chosen["delay"] is None and options["delay_method"] != MutualInformation.name:
            plan = part(_DELAYS[options["delay_method"]](), "delay", {})
            chosen["delay"] = None if plan is None else plan.delay
        if chosen["dimension"] is None and options["dimension_method"] != Cao.name:
            backend = _DIMENSIONS[options["dimension_method"]]()
            given = {"delay": chosen["delay"]} if "delay" in backend.options else {}
            plan = part(backend, "dimension", given)
            chosen["dimension"] = None if plan is None else plan.dimension
        seed, poll = 0 if request.seed is None else request.seed, poll_of(request)
        first = embed(problem, chosen)
        embeddings, ahead = [first], first.delay
        with suppress(RunStopped):
            embeddings, ahead = choose_embeddings(problem, chosen, poll, first)
        embedding, duration = embeddings[0], len(problem.series) * problem.period
        test = ranking = None
        with suppress(RunStopped):
            poll()
            ranking = ranks(problem.series, embedding, options, seed, poll, ahead)
            figures.update(statistics(ranking))
        wide = ranking is not None and ranking.rejected
        result = part(_EXPONENTS[options["exponent_method"]](wide, embeddings), "exponent", chosen)
        exponent = None if result is None else result.exponent
        if exponent is not None:
            embedding = Embedding(result.delay, result.dimension, result.theiler)
        result = part(CorrelationDimension(), "correlation dimension", asdict(embedding))
        correlation = None if result is None else result.correlation
        with suppress(RunStopped):
            if ranking is not None:
                evidence = gather(problem, embedding, ahead, poll)
                test, why = judge(ranking, evidence, exponent, duration)
                remarks.append(why)
        if test is None:
            remarks.append("no judgement: the run was stopped before")
        plan = embedding.plan(exponent=exponent, correlation=correlation, surrogates=test)
        return Finding(plan, figures, "; ".join(filter(None, remarks)))
