"""Instances, plot, table of a paper, export format and demonstration."""

from __future__ import annotations

from crosstrack.instances import CatalogueEntry, ExportFormat, write_text
from crosstrack.instances.demos import Demo, DemoOption
from crosstrack.instances.paper import Paper, ResultTable, printed

from .model import Covering


def small():
    return Covering([4.0, 3.0, 5.0, 7.0], [5, 4, 7, 9], 12)


def heavy():
    return Covering([4.0, 3.0], [5, 4], 12)


def catalogue_entries():
    def entry(name, build, **published):
        return CatalogueEntry(
            f"covering/{name}", "covering", name, "A. Nobody, 2020", "ours", build, published
        )

    return (
        entry("small", small, optimum=9.0, seconds={"theirs": 1.5}),
        entry("heavy", heavy),
    )


def draw(model, plan=None, *, title="items"):
    from matplotlib.figure import Figure

    figure = Figure()
    axes = figure.add_subplot(title=title)
    axes.bar(range(len(model.costs)), model.weights)
    if plan is not None:
        axes.bar(plan.items, model.weights[list(plan.items)])
    return figure


def write_list(plan, path, *, first=0):
    return write_text(path, "".join(f"{first + item}\n" for item in plan.items))


LIST = ExportFormat("one item per line", ".txt", write_list)
PAPER = Paper(
    "covering",
    "A. Nobody, 2020",
    items=(printed("eq. 2", "demand", "models.model:Model.verify"),),
    tables=(
        ResultTable(
            "table-1",
            "Table 1: seconds of the dynamic programme",
            keys=("instance",),
            columns={"optimum": "g", "seconds": ".1f"},
            rows={("small",): (9.0, 1.5)},
            note="The paper used another machine.",
        ),
    ),
)


def measure(row, trials):
    (answer,) = trials.run(small(), "dynamic-programming")
    trials.run(small(), "highs:paper")
    return {"optimum": answer.primal_bound, "seconds": answer.seconds["solve"]}


DEMO = Demo(
    "covering/small",
    {"demand": DemoOption("Demand to reach.", default=12, type=int)},
    lambda demand: Covering([4.0, 3.0, 5.0, 7.0], [5, 4, 7, 9], demand, name="mine"),
)
