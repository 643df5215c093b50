"""Peer `cspy <https://github.com/torressa/cspy>`_ on an error-correction route.

Features and limits of version 1.0.3:

* Resources are additive by default, and cannot be reset. Its ``BiDirectional`` labelling calls a
  user-defined resource extension function, a Python method, once for every arc that it tries. With
  ``direction="forward"`` that suffices for our two errors. The function adds the arc to both
  errors, returns a distance above its bound if the head's thresholds refuse the arrival,
  and sets the corrected error to 0.
* That is exact for walks: a label dominates another by cost and by every resource at once, and our
  function never falls when a resource grows. The first ("critical") resource must grow along a
  path and orders the labels, so it is the distance flown. A walk that visits no point twice is
  then the shortest route too, since routes are walks; :func:`run` reports any other as no answer.
* ``elementary=True`` would keep routes simple by itself, at the price of a weaker dominance, whose
  exactness its repository doubts where costs are negative (issue 94). It is not needed here.
* Both directions at once would need the inverse of a reset, which has none: which error a point
  may be left with depends on the whole way behind it.
* Its other algorithms (Tabu, GreedyElim, GRASP, PSOLGENT) stop at a feasible path; none proves an
  optimum.
* Two points of one kind at the same place make it circle for ever, since equal labels do not
  dominate one another; its time limit ends that.
* There is no A* bound, and a dominated label that already waits is still extended, so it visits
  nearly everything that can be reached. Every arc is a networkx edge, copied twice and passed on
  one by one.
* It keeps no reference to the function's object, and the process crashes once that is collected.
"""

from __future__ import annotations

import math
import time
import warnings
from dataclasses import dataclass
from typing import Any

import pytest

from crosstrack.models import ErrorCorrectionRouting

__all__ = ["PeerRun", "run"]


@dataclass(frozen=True)
class PeerRun:
    """Result of one run.

    Parameters
    ----------
    plan : Route, optional
        The route.
    build, search : float
        Time to build the graph, and time of the search, s.
    extensions : int
        Number of arc extensions.
    arcs : int
        Number of arcs in the graph.
    simple : bool
        True if the walk visits no point twice, and therefore is the optimum.
    """

    plan: Any
    build: float
    search: float
    extensions: int
    arcs: int
    simple: bool


def run(
    model: ErrorCorrectionRouting, *, bound: float | None = None, time_limit: float = 60.0
) -> PeerRun:
    """Solve `model` with cspy's forward labelling.

    It is given the arcs that the ``arc-flow`` program gets: those that the thresholds leave
    possible and, with `bound`, through which some way is no longer than that.
    """
    # Some releases warn about their own escape sequences, and SWIG about its types.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        cspy = pytest.importorskip("cspy", reason="cspy is not installed")
        from cspy.algorithms.bidirectional import REFCallback
        from networkx import DiGraph

    limits = model.rounded_limits[model.codes].tolist()
    kinds = model.kinds.tolist()
    rates = (model.horizontal_rate, model.vertical_rate)
    refused = (math.inf, 0.0, 0.0)
    extensions = 0

    class Correcting(REFCallback):
        """Both errors grow by the arc, and the one that the head corrects becomes 0."""

        def REF_fwd(self, flown, tail, head, arc, path, cost):
            nonlocal extensions
            extensions += 1
            length = arc[0]
            horizontal = flown[1] + rates[0] * length
            vertical = flown[2] + rates[1] * length
            most = limits[head]
            if horizontal > most[0] or vertical > most[1]:
                return refused
            kind = kinds[head]
            if kind == "horizontal":
                horizontal = 0.0
            elif kind == "vertical":
                vertical = 0.0
            return (flown[0] + length, horizontal, vertical)

    begin = time.perf_counter()
    options = {} if bound is None else {"length_bound": bound}
    arcs = model.formulate("arc-flow", **options).arcs
    # cspy numbers the nodes in order of insertion, so its order equals ours.
    names: list[Any] = list(range(len(model.points)))
    names[model.start], names[model.end] = "Source", "Sink"
    graph = DiGraph(directed=True, n_res=3)
    graph.add_nodes_from(names)
    graph.add_edges_from(
        (names[i], names[j], {"weight": d, "res_cost": [d, 0.0, 0.0]})
        for i, j, d in zip(
            arcs.tail.tolist(), arcs.head.tolist(), arcs.length.tolist(), strict=True
        )
    )
    farthest = 1e12 if bound is None else bound * (1 + 1e-9)
    most_error = 2 * float(model.rounded_limits.max()) + 1.0
    extend = Correcting()  # kept here: cspy does not
    algorithm = cspy.BiDirectional(
        graph,
        [farthest, most_error, most_error],
        [0.0, 0.0, 0.0],
        direction="forward",
        time_limit=time_limit,
        REF_callback=extend,
    )
    loaded = time.perf_counter()
    algorithm.run()
    done = time.perf_counter()

    found = algorithm.path
    if found is None or found[-1] != "Sink":
        plan, simple = None, False
    else:
        ends = {"Source": model.start, "Sink": model.end}
        plan = model.plan_from_data([ends.get(node, node) for node in found])
        simple = len(set(found)) == len(found)
    return PeerRun(plan, loaded - begin, done - loaded, extensions, len(arcs), simple)
