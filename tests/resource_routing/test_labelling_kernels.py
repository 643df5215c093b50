"""The kernels of resource labelling: what their numbers mean, and that compiling changes nothing."""

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from resource_draws import neighbours, random_branches, random_model, rng_of

from crosstrack.solvers.resource_routing.arc_kernels import all_pairs, count_pairs
from crosstrack.solvers.resource_routing.multipliers import plain_bounds
from crosstrack.solvers.resource_routing.network import distances, network

RUNS = np.zeros(1, np.int8)
STOPPED = np.ones(1, np.int8)

SAME = """
import json, sys
sys.path.insert(0, sys.argv[2])
from crosstrack import jit
jit._left = float(sys.argv[1])
from resource_draws import random_branches, random_model, rng_of
from crosstrack.solvers import Request
from crosstrack.solvers.resource_routing.labelling import ResourceLabelling
answers = []
for seed in range(10):
    for draw in (random_model, random_branches):
        model = draw(rng_of(seed), revisits=seed % 2 == 0)
        answer = ResourceLabelling().run(model, Request())
        route = answer.point and answer.point.route
        answers.append([answer.termination, route, answer.primal_bound, dict(answer.statistics)])
assert ("numba" in sys.modules) == (jit._left <= 0)
json.dump(answers, sys.stdout)
"""


def test_compiled_and_interpreted_are_the_same():
    """Every label, every route and every length is the same, bit for bit."""
    outputs = [
        subprocess.run(
            [sys.executable, "-c", SAME, budget, str(Path(__file__).parent)],
            capture_output=True, text=True, timeout=240, check=True,
        ).stdout
        for budget in ("0", "inf")
    ]  # fmt: skip
    compiled, interpreted = map(json.loads, outputs)
    assert compiled == interpreted
    assert len({json.dumps(answer) for answer in compiled}) > 10


def leads_of(model):
    """Return the successors of each point, without pairs that exceed a limit from levels of 0."""
    if model.arcs is not None:
        return neighbours(model)
    tables = [(r.rate, dict(r.limits), dict(r.gains)) for r in model.resources]

    def fits(there, leg):
        word = model.kinds[there]
        return all(
            rate * leg + gains.get(word, 0.0) <= limits.get(word, math.inf)
            for rate, limits, gains in tables
        )

    return {
        point: [(there, leg, uses) for there, leg, uses in heads if fits(there, leg)]
        for point, heads in neighbours(model).items()
    }


def ways(model, leads, column, point, level):
    """Every point and level that can be left with `level` at `point`, of one resource alone."""
    resource = model.resources[column]
    limits, gains, resets = map(dict, (resource.limits, resource.gains, resource.resets))
    most = max(limits.values(), default=0.0) + 1.0
    found, todo = set(), [(point, min(level, most))]
    while todo:
        state = todo.pop()
        if state in found:
            continue
        found.add(state)
        if state[0] == model.end:
            continue
        for there, leg, uses in leads[state[0]]:
            word = model.kinds[there]
            arrival = state[1] + resource.rate * leg + uses[column] + gains.get(word, 0.0)
            if there != model.start and arrival <= limits.get(word, math.inf):
                todo.append((there, min(arrival, resets.get(word, math.inf), most)))
    return found


@pytest.mark.parametrize("draw", [random_model, random_branches])
def test_levels_are_bounds_of_each_resource(draw):
    seen = 0
    for seed in range(15):
        model = draw(rng_of(seed), revisits=True)
        rows, leads = np.arange(len(model.kinds)), leads_of(model)
        net = network(model, rows, RUNS)
        for column, resource in enumerate(model.resources):
            reached = ways(model, leads, column, model.start, resource.initial)
            for point in rows.tolist():
                if point == model.end:
                    continue
                most = net.most[point, column]
                levels = [level for there, level in reached if there == point]
                top = max(dict(resource.limits).values(), default=0.0) + 1.0
                for level in np.arange(0.0, top + 1.0):
                    arrives = any(
                        there == model.end for there, _ in ways(model, leads, column, point, level)
                    )
                    assert arrives == (level <= most), (seed, column, point, level)
                    seen += arrives
                # An arc remains only where the least level of its tail allows it.
                begin, stop = net.first[point], net.first[point + 1]
                if levels and begin < stop:
                    arrival = min(levels) + net.use[begin:stop, column]
                    assert (arrival <= net.limit[net.head[begin:stop], column]).all()
    assert seen > 100


def test_arcs_of_all_pairs_are_those_within_the_limits():
    draw = np.random.default_rng(1)
    for dimensions, resources in ((1, 0), (2, 1), (3, 2)):
        points = draw.uniform(0, 1, (30, dimensions))
        rates, gain = draw.uniform(0, 1, resources), draw.uniform(0, 0.1, (30, resources))
        limit = draw.uniform(0.1, 0.6, (30, resources))
        rates.flags.writeable = False  # as a model's are, for which the kernels are compiled
        stock = (points, 1.0, rates, gain, limit, 3, 7)
        first = count_pairs(*stock, 10_000, RUNS)
        head, length, use = all_pairs(*stock, first)
        tail = np.repeat(np.arange(30), np.diff(first))
        lengths = np.linalg.norm(points[:, None] - points, axis=2)
        uses = lengths[:, :, None] * rates + gain
        wanted = (uses <= limit).all(axis=2) & ~np.eye(30, dtype=bool)
        wanted[:, 3] = wanted[7] = False
        np.testing.assert_array_equal(np.argwhere(wanted), np.column_stack([tail, head]))
        np.testing.assert_allclose(length, lengths[wanted], rtol=1e-15)
        np.testing.assert_allclose(use, uses[wanted], rtol=1e-15)
        assert count_pairs(*stock, 10, RUNS)[-1] >= 10


def test_a_stop_keeps_all_arcs():
    model = random_model(rng_of(2), revisits=True)
    rows = np.arange(len(model.kinds))
    whole, stopped = network(model, rows, RUNS), network(model, rows, STOPPED)
    assert np.isinf(stopped.most).all()
    if model.arcs is not None:
        assert len(stopped.head) >= len(whole.head)


def test_plain_bounds_include_arcs_of_length_zero():
    model = random_branches(rng_of(3), revisits=True)
    net = network(model, np.arange(len(model.kinds)), RUNS)
    assert (net.length == 0).any()
    wanted = np.full((len(model.kinds),) * 2, np.inf)
    np.fill_diagonal(wanted, 0.0)
    for point in range(len(model.kinds)):
        for arc in range(net.first[point], net.first[point + 1]):
            wanted[point, net.head[arc]] = net.length[arc]
    for via in range(len(model.kinds)):
        wanted = np.minimum(wanted, wanted[:, [via]] + wanted[[via]])
    np.testing.assert_array_equal(plain_bounds(net).ahead, wanted[:, net.end])


def test_distances_are_scaled():
    points = np.array([[0.0, 0.0], [3.0, 4.0]])
    for scale in (1e-320, 1e-200, 1.0, 1e200):
        assert distances(points * scale, 0)[1] == pytest.approx(5 * scale)
