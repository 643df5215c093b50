"""The peer `cspy <https://github.com/torressa/cspy>`_ on a route with resources.

As for error-correction routes (``error_correction/cspy_peer.py``): forward labelling with a resource
extension function in Python, which is the only way to a reset. The first resource is the length.
"""

from __future__ import annotations

import time
import warnings
from typing import Any

import pytest

from crosstrack.models import ResourceRouting

__all__ = ["run"]


def run(model: ResourceRouting, time_limit: float) -> tuple[Any, float]:
    """Return the plan that cspy finds within `time_limit`, None without one, and the seconds it took."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        cspy = pytest.importorskip("cspy", reason="cspy is not installed")
        from cspy.algorithms.bidirectional import REFCallback
        from networkx import DiGraph

    assert model.arcs is not None
    assert model.lengths is not None
    limits = model.rounded_limits[model.codes].tolist()
    resets = model.resets[model.codes].tolist()
    count = len(model.resources)
    refused = tuple([float("inf")] + [0.0] * count)
    uses = model.lengths[:, None] * model.rates + model.gains[model.codes[model.arcs[:, 1]]]
    if model.uses is not None:
        uses += model.uses

    class Resetting(REFCallback):
        """All resources grow by the arc, and are reset by its head."""

        def REF_fwd(self, used, tail, head, arc, path, cost):
            left = [used[0] + arc[0]]
            for k in range(count):
                level = used[k + 1] + arc[k + 1]
                if level > limits[head][k]:
                    return refused
                left.append(min(level, resets[head][k]))
            return tuple(left)

    begin = time.perf_counter()
    names: list[Any] = list(range(len(model.kinds)))
    names[model.start], names[model.end] = "Source", "Sink"
    graph = DiGraph(directed=True, n_res=count + 1)
    graph.add_nodes_from(names)
    graph.add_edges_from(
        (names[i], names[j], {"weight": length, "res_cost": [length, *use]})
        for (i, j), length, use in zip(
            model.arcs.tolist(), model.lengths.tolist(), uses.tolist(), strict=True
        )
        if i != model.end and j != model.start
    )
    extend = Resetting()  # kept here: cspy does not
    most = [float(model.lengths.sum()), *[2 * max(row) + 1 for row in zip(*limits, strict=True)]]
    algorithm = cspy.BiDirectional(
        graph,
        most,
        [0.0] * (count + 1),
        direction="forward",
        time_limit=time_limit,
        REF_callback=extend,
    )
    algorithm.run()
    seconds = time.perf_counter() - begin
    if not algorithm.path or algorithm.path[-1] != "Sink":
        return None, seconds
    ends = {"Source": model.start, "Sink": model.end}
    return model.as_plan([ends.get(node, node) for node in algorithm.path]), seconds
