"""The paper's memetic algorithm (Algorithm 3), and its variants without transformation and for rest.

The arguments of the kernels are those of :mod:`.decoding`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...jit import kernel
from ...models.messenger.dubins import relaxed_length
from ..contract.backend import Option, Request
from .decoding import (
    KAPPA,
    Task,
    access,
    assess,
    copy_pairs,
    follow,
    meet,
    shortest_time,
    upper_bound,
)
from .rivals import Flight, RandomRival

__all__ = ["Memetic", "MemeticRelaxed", "MemeticUntransformed"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Rng = np.random.Generator

#: Interval ε_t of Definition 1 (arbitrary in the paper), as a share of the leg's interval.
LATER = 1e-3
#: Change of the angle (rad) in eq. 11 (paper: Δθ, not given).
DELTA = 1e-4


class Rules(NamedTuple):
    """Parameters of the algorithm.

    `timed`: intervals are genes; otherwise each vehicle is met in the shortest time (MAR). `transformed`: apply
    Algorithm 4. `mutation`: probability of a mutation (paper: p_m). `period`: generations between local searches
    (paper: T_lp). `step`: step size of GS (paper: ρ_l). `samples`: angles of SS (paper: N_s); 0 disables SS.
    """

    timed: bool
    transformed: bool
    mutation: float
    period: int
    step: float
    samples: int


@kernel
def _shuffle(order: Ints, rng: Rng) -> None:
    """Fill `order` with a random permutation."""
    for k in range(len(order)):
        m = int(rng.random() * (k + 1))
        order[k] = order[m]
        order[m] = k


@kernel
def _other(k: int, count: int, rng: Rng) -> int:
    """Return a random index below `count` other than `k`; `k` if `count` is 1."""
    m = int(rng.random() * (count - 1))
    return m + 1 if m >= k and count > 1 else m


@kernel
def cross(
    sources: Ints, one: Ints, one_genes: Floats, two: Ints, two_genes: Floats, child: Ints,
    child_genes: Floats,
) -> None:  # fmt: skip
    """Fill in a child (paper: section IV-C): each source, 1 or 2, takes the first gene left of that parent."""
    taken = np.zeros(len(one), np.bool_)
    p = q = 0
    for k in range(len(one)):
        if sources[k] == 1:
            while taken[one[p]]:
                p += 1
            i = one[p]
            child_genes[i, 0], child_genes[i, 1] = one_genes[i, 0], one_genes[i, 1]
        else:
            while taken[two[q]]:
                q += 1
            i = two[q]
            child_genes[i, 0], child_genes[i, 1] = two_genes[i, 0], two_genes[i, 1]
        child[k], taken[i] = i, True


@kernel
def mutate(kind: int, order: Ints, genes: Floats, task: Task, rng: Rng) -> None:
    """Apply mutation operator 1, 2 or 3 of section IV-D.

    They swap two vehicles, draw an angle from (0, 2 π], and draw an interval up to t_max of Lemma 1.
    """
    k = int(rng.random() * len(order))
    i = order[k]
    if kind == 1:
        m = _other(k, len(order), rng)
        order[k], order[m] = order[m], i
    elif kind == 2:
        genes[i, 0] = 2.0 * math.pi * (1.0 - rng.random())
    else:
        assess(order, genes, task, False)
        genes[i, 1] = rng.random() * upper_bound(k, i, genes[i, 0], task)


@kernel
def _catches_up(k: int, i: int, genes: Floats, task: Task) -> bool:
    """Return whether leg `k` ends in the catch-up pattern (paper: Definition 1).

    The shortest path to the access point of `i` is then at most as long as that to the point after ε_t.
    """
    pose = task.poses[k]
    x, y, h, t = pose[0], pose[1], pose[2], pose[3] + genes[i, 1]
    qx, qy = access(i, genes[i, 0], t, task)
    now = relaxed_length(x, y, h, qx, qy, task.r)
    qx, qy = access(i, genes[i, 0], t + LATER * genes[i, 1], task)
    return bool(now <= relaxed_length(x, y, h, qx, qy, task.r))


@kernel
def transform(order: Ints, genes: Floats, task: Task) -> int:
    """Reset the interval before each vehicle that is caught up with (paper: Algorithm 4); return the changes.

    It updates the genes of a decoded individual, and the poses up to the second-to-last vehicle.
    """
    changed = 0
    for k in range(len(order) - 1):
        i = order[k]
        if _catches_up(k + 1, order[k + 1], genes, task):
            genes[i, 1] = shortest_time(k, i, genes[i, 0], task)
            changed += 1
        meet(k, i, genes, task)
    return changed


@kernel
def settle(order: Ints, genes: Floats, task: Task, rules: Rules) -> float:
    """Repair and transform an individual; return its evaluation f (m, paper: eq. 8)."""
    if not rules.timed:
        length: float = task.speed * follow(order, genes, task, 0, math.inf)
        return length
    end, off = assess(order, genes, task, True)
    if rules.transformed and transform(order, genes, task) > 0:
        end, off = assess(order, genes, task, False)
    return task.speed * end + KAPPA * off


@kernel
def descend(i: int, order: Ints, genes: Floats, cost: float, task: Task, rules: Rules) -> float:
    """GS: move the angle of vehicle `i` against the gradient while the tour gets shorter; return f.

    Equation 12 subtracts the negative gradient of eq. 11, so the printed step ascends; this one descends. It takes at
    most 2 π / ρ_l steps (paper: section IV-H).
    """
    trial = genes.copy()
    for _ in range(int(2.0 * math.pi / rules.step)):
        if task.flag[0] != 0:
            break
        copy_pairs(genes, trial)
        trial[i, 0] += DELTA
        slope = (settle(order, trial, task, rules) - cost) / DELTA
        copy_pairs(genes, trial)
        trial[i, 0] -= rules.step * slope
        value = settle(order, trial, task, rules)
        if not value < cost:
            break
        cost = value
        copy_pairs(trial, genes)
    return cost


@kernel
def resample(k: int, order: Ints, genes: Floats, cost: float, task: Task, rules: Rules) -> float:
    """SS: try equally spaced angles for the k-th vehicle, with the interval of Algorithm 1; return f."""
    i = order[k]
    start, trial = genes.copy(), genes.copy()
    for m in range(rules.samples):
        if task.flag[0] != 0:
            break
        copy_pairs(start, trial)
        trial[i, 0] = 2.0 * math.pi * m / rules.samples
        assess(order, trial, task, False)
        trial[i, 1] = shortest_time(k, i, trial[i, 0], task)
        value = settle(order, trial, task, rules)
        if value < cost:
            cost = value
            copy_pairs(trial, genes)
    return cost


@kernel
def _populate(
    orders: Ints, genes: Floats, costs: Floats, task: Task, rules: Rules, rng: Rng
) -> None:
    """Fill a population at random: orders, angles, and intervals up to t_max of Lemma 1."""
    for p in range(len(costs)):
        _shuffle(orders[p], rng)
        for k in range(len(task.fleet)):
            i = orders[p, k]
            genes[p, i, 0] = 2.0 * math.pi * rng.random()
            if rules.timed:
                genes[p, i, 1] = rng.random() * upper_bound(k, i, genes[p, i, 0], task)
                meet(k, i, genes[p], task)
        if rules.timed:
            end, off = assess(orders[p], genes[p], task, False)
            costs[p] = task.speed * end + KAPPA * off
        else:
            costs[p] = settle(orders[p], genes[p], task, rules)


@kernel
def evolve(
    number: int, orders: Ints, genes: Floats, costs: Floats, task: Task, rules: Rules, rng: Rng
) -> int:
    """Create generation `number`, or the first population (0); return the index of the best individual.

    `orders` (p, n), `genes` (p, n, 2) and the evaluations `costs` (p,), f in m, are updated.
    """
    if number == 0:
        _populate(orders, genes, costs, task, rules, rng)
        return int(np.argmin(costs))
    size, n = orders.shape
    child, child_genes, sources = np.empty(n, np.int64), np.empty((n, 2)), np.empty(n, np.int64)
    for p in range(size):
        if task.flag[0] != 0:
            break
        q = _other(p, size, rng)
        for k in range(n):
            sources[k] = 1 + int(2.0 * rng.random())
        cross(sources, orders[p], genes[p], orders[q], genes[q], child, child_genes)
        if rng.random() < rules.mutation:
            kind = 1 + int((3.0 if rules.timed else 2.0) * rng.random())
            mutate(kind, child, child_genes, task, rng)
        value = settle(child, child_genes, task, rules)
        if value < costs[p]:
            costs[p] = value
            copy_pairs(child_genes, genes[p])
            for k in range(n):
                orders[p, k] = child[k]
    if number % rules.period == 0:
        half = np.argsort(costs)[: max(size // 2, 1)]
        for _ in range(number // rules.period):
            p, k = half[int(rng.random() * len(half))], int(rng.random() * n)
            if rules.samples == 0 or rng.random() < 0.5:
                costs[p] = descend(orders[p, k], orders[p], genes[p], costs[p], task, rules)
            else:
                costs[p] = resample(k, orders[p], genes[p], costs[p], task, rules)
    return int(np.argmin(costs))


class Memetic(RandomRival):
    """MA: Algorithm 3 of the paper as printed, with the parameters of its Table II.

    Individuals may violate their constraints, with a penalty (eq. 8). If the best individual
    violates them by more than the margin, the run returns no plan.
    """

    name = "memetic"
    options: ClassVar[Mapping[str, Option]] = {
        **RandomRival.options,
        "generations": Option(20, "Generations (paper: maxGen).", int, lower=0),
        "population": Option(10, "Individuals per vehicle (paper: NP / N).", int, lower=1),
        "mutation": Option(0.1, "Probability of a mutation (paper: p_m).", lower=0, upper=1),
        "period": Option(2, "Generations between local searches (paper: T_lp).", int, lower=1),
        "step": Option(0.01, "Step size of the gradient search GS (paper: rho_l).", lower=1e-6),
        "samples": Option(20, "Angles of the sampling search SS (paper: N_s).", int, lower=1),
        "margin": Option(
            0.01, "Length (m) by which a leg of an individual may be too short (paper: epsilon).", lower=0
        ),
    }  # fmt: skip
    summary = "the paper's memetic algorithm (MA)"

    #: Whether intervals are genes, and whether Algorithm 4 is applied.
    timed: ClassVar[bool] = True
    transformed: ClassVar[bool] = True

    def search_once(self, flight: Flight, request: Request) -> float:
        """Evolve for the given number of generations; return the length of the best plan (m)."""
        options, n = request.options, flight.problem.size
        size = options["population"] * n
        orders, genes = np.zeros((size, n), np.int64), np.zeros((size, n, 2))
        costs, best, value = np.empty(size), np.inf, np.inf
        flight.task = flight.task._replace(margin=options.get("margin", 0.0))
        rules = Rules(
            self.timed, self.transformed, options["mutation"], options["period"], options["step"],
            options.get("samples", 0),
        )  # fmt: skip
        for number in range(options["generations"] + 1):
            if number and request.control.stopped:
                break
            k = evolve(number, orders, genes, costs, flight.task, rules, flight.rng)
            if costs[k] < value:
                value = costs[k]
                # The penalty of an infeasible individual exceeds the margin times κ.
                if value < KAPPA * options.get("margin", np.inf) or not self.timed:
                    best = min(best, flight.offer(orders[k], genes[k]))
        return float(best)


class MemeticUntransformed(Memetic):
    """MA-T: the paper's memetic algorithm without Algorithm 4."""

    name = "memetic-untransformed"
    summary = "the paper's memetic algorithm without its transformation (MA-T)"
    transformed = False


class MemeticRelaxed(Memetic):
    """MAR: memetic algorithm for vehicles at rest, with the shortest encounter paths.

    After X. Zhang, J. Chen, B. Xin and Z. Peng, "A memetic algorithm for path planning of
    curvature-constrained UAVs performing surveillance of multiple ground targets", Chinese Journal of
    Aeronautics 27 (2014) 622-633. Individuals have no intervals, and the local search is GS.
    """

    name = "memetic-relaxed"
    options: ClassVar[Mapping[str, Option]] = {
        name: option
        for name, option in Memetic.options.items()
        if name not in ("samples", "margin")
    }
    summary = "a memetic algorithm with the shortest encounter paths (MAR)"
    timed = False
    transformed = False
