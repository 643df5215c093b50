"""Model of the covering problem and its formulation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crosstrack.errors import InvalidData
from crosstrack.models import (
    Check,
    Formulation,
    MixedIntegerProgram,
    Model,
    ProgramBuilder,
    Verification,
)
from crosstrack.models.fields import Array, Whole, declared
from crosstrack.models.verification import TOLERANCE


@dataclass(frozen=True)
class Choice:
    """Plan: indices of the selected items."""

    items: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Covering(Model[Choice]):
    """Selection of the cheapest items whose weights reach a demand."""

    costs: np.ndarray = declared(Array(("n",), lower=0))
    weights: np.ndarray = declared(Array(("n",), lower=0))
    demand: int = declared(Whole(lower=0))

    kind = "covering"
    objective_unit = "coins"
    formulations = {"paper": "covering.model:Paper"}
    default_formulation = "paper"

    def verify(self, plan, *, tolerance=TOLERANCE):
        missing = self.demand - sum(self.weights[k] for k in plan.items)
        check = Check(
            "demand",
            "2",
            max(0.0, float(missing)),
            "kg",
            tolerance * max(1, self.demand),
            "the sum",
        )
        return Verification(float(sum(self.costs[k] for k in plan.items)), (check,))

    def plan_to_data(self, plan):
        return {"items": list(plan.items)}

    def plan_from_data(self, data):
        items = data["items"] if isinstance(data, dict) and set(data) == {"items"} else None
        if not isinstance(items, list) or not set(items) <= set(range(len(self.costs))):
            raise InvalidData(f"a plan is {{'items': [places]}}, got {data!r}", field="items")
        return Choice(tuple(sorted(set(items))))


@dataclass(frozen=True, eq=False)
class Paper(Formulation[Covering, Choice]):
    """Formulation with one column per item and one row for the demand."""

    name = "paper"
    program_type = MixedIntegerProgram
    summary = "one column per item"

    def build(self):
        model, builder = self.model, ProgramBuilder()
        take = builder.columns(
            "item chosen", len(model.costs), upper=1, cost=model.costs, integral=True, equation="1"
        )
        builder.rows("demand", 1, (0, take, model.weights), lower=model.demand, equation="2")
        return builder.build(name=model.name)

    def encode(self, plan):
        point = np.zeros(len(self.model.costs))
        point[list(plan.items)] = 1.0
        return point

    def decode(self, point):
        return Choice(tuple(np.flatnonzero(point > 0.5).tolist()))
