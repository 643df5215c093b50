"""``false-neighbours`` and ``cao``: the smallest dimension that unfolds an attractor."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...models.attractor.model import AttractorAnalysis
from ..contract.backend import Request
from ..contract.option import Option
from .delays import halves
from .embedding import LARGEST, cao_curves, false_shares, largest_dimension, saturated
from .native import EMBEDDING, AttractorBackend, Finding, embed, poll_of

__all__ = ["Cao", "FalseNeighbours"]

Floats = NDArray[np.float64]

#: Largest deviation of E₂ from 1 for noise (Cao 1997).
_RANDOM = 0.1


class DimensionBackend(AttractorBackend):
    """Base of the backends that choose a dimension; the delay is the first minimum of the mutual information."""

    options: ClassVar[Mapping[str, Option]] = {
        "delay": EMBEDDING["delay"],
        "largest": Option(LARGEST, "largest dimension tried", int, lower=2, upper=30),
        "theiler": EMBEDDING["theiler"],
    }

    @abstractmethod
    def dimension(
        self, series: Floats, delay: int, most: int, options: Mapping[str, Any]
    ) -> tuple[int, dict[str, Any], str]:
        """Return the dimension, its statistics, and a remark for the user."""

    def find(self, problem: AttractorAnalysis, request: Request) -> Finding:
        """Return the embedding with the dimension of this method."""
        options, poll = request.options, poll_of(request)
        # The delay is chosen here, the dimension below.
        delay = embed(problem, {**options, "dimension": 1}).delay
        most = largest_dimension(len(problem.series), delay, options["largest"])
        dimension, figures, message = self.dimension(problem.series, delay, most, options)
        for half, x in halves(problem.series).items():
            poll()
            most = largest_dimension(len(x), delay, options["largest"])
            figures[f"dimension of the {half}"] = self.dimension(x, delay, most, options)[0]
        embedding = embed(problem, {**options, "delay": delay, "dimension": dimension})
        return Finding(embedding.plan(), {"dimension": dimension, **figures}, message)


class Cao(DimensionBackend):
    """Backend for the dimension from which nearest neighbours keep their distance on average (Cao 1997)."""

    name = "cao"
    summary = "smallest dimension by Cao's averaged false neighbours"

    def dimension(
        self, series: Floats, delay: int, most: int, options: Mapping[str, Any]
    ) -> tuple[int, dict[str, Any], str]:
        """Return the dimension at which E₁ saturates."""
        grows, moves = cao_curves(series, delay, most, options["theiler"])
        dimension = saturated(grows)
        finite = np.abs(moves[np.isfinite(moves)] - 1)
        apart = float(finite.max()) if finite.size else 0.0
        figures = {"E1": float(np.nan_to_num(grows[dimension - 1])), "most of |E2 - 1|": apart}
        remarks = []
        if not grows[dimension - 1] >= 0.9:
            remarks.append(f"E₁ does not saturate up to {most} dimensions, the largest is taken")
        if apart < _RANDOM:
            remarks.append("E₂ is that of noise")
        return dimension, figures, "; ".join(remarks)


class FalseNeighbours(DimensionBackend):
    """Backend for the smallest dimension with few false neighbours (Kennel, Brown and Abarbanel 1992)."""

    name = "false-neighbours"
    summary = "smallest dimension with few false nearest neighbours"
    options: ClassVar[Mapping[str, Option]] = {
        **DimensionBackend.options,
        "share": Option(0.01, "share of false neighbours allowed", lower=0, upper=1),
    }

    def dimension(
        self, series: Floats, delay: int, most: int, options: Mapping[str, Any]
    ) -> tuple[int, dict[str, Any], str]:
        """Return the first dimension with few enough false neighbours."""
        theiler = options["theiler"]
        shares = false_shares(series, delay, most, delay if theiler is None else theiler)
        acceptable, known = shares <= options["share"], np.nan_to_num(shares, nan=1.0)
        place, remark = int(acceptable.argmax()), ""
        if not acceptable.any():
            place = int(known.argmin())
            remark = "no dimension has so few false neighbours, the least is taken"
        return place + 1, {"false neighbours": float(known[place])}, remark
