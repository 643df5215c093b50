"""The paper's algorithm and its rivals: valid tours on wild cases, and what each of them promises."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import crosstrack as ct
from crosstrack.errors import UnsupportedFormulation, UnsupportedOption
from crosstrack.instances.messenger import generate
from crosstrack.models import MessengerTour
from crosstrack.models.messenger.dubins import RELAXED_WORDS, advance, relaxed
from crosstrack.models.messenger.elongation import elongated
from crosstrack.models.messenger.interception import intercept
from crosstrack.solvers import Limit, Termination
from crosstrack.solvers.backend import Request
from crosstrack.solvers.messenger.decoding import decode, meet
from crosstrack.solvers.messenger.local_search import descend, resample
from crosstrack.solvers.messenger.rivals import Flight
from crosstrack.solvers.messenger.sequences import exchange, move
from crosstrack.solvers.messenger.transformation import entry, transform

RIVALS = (
    "memetic",
    "memetic-untransformed",
    "memetic-relaxed",
    "variable-neighbourhood",
    "greedy-boundary",
    "greedy-centre",
)
#: Options that make a run short.
SHORT: dict[str, dict[str, Any]] = {
    **{name: {"generations": 4, "population": 4} for name in RIVALS if "memetic" in name},
    "variable-neighbourhood": {"iterations": 4},
    "greedy-boundary": {"two_opt": True, "samples": 24},
    "greedy-centre": {"two_opt": True},
}


def wild(seed: int, most: int = 8) -> MessengerTour:
    """Return a tour beyond anything that the paper has: sizes, ratios, ties, speeds."""
    rng = np.random.default_rng([seed, 11])
    n = int(rng.integers(1, most + 1))
    size = 10.0 ** rng.choice([-3, 0, 2, 4, 7])
    places = rng.uniform(-1, 1, (n, 2)) * rng.choice([0.0, 1.0, 1.0, 1.0], 2)
    if rng.random() < 0.3:
        places[n // 2 :] = places[0]
    headings = rng.uniform(0, 2 * math.pi, n)
    if rng.random() < 0.3:  # away from the start, or towards it
        headings = np.arctan2(places[:, 1], places[:, 0]) + math.pi * rng.integers(0, 2)
    speed = size * 10.0 ** rng.uniform(-2, 1)
    fast = speed * rng.choice([0.0, 0.35, 0.9, 0.999]) * rng.choice([1.0, rng.random()])
    radius = size * 10.0 ** rng.choice([-6, -2, -1, 0, 1], n)
    radius *= rng.choice([0.0, 1.0, 1.0], n)
    return MessengerTour(
        places * size,
        fast * np.stack([np.cos(headings), np.sin(headings)], axis=1),
        radius if rng.random() < 0.7 else float(radius[0]),
        speed,
        size * rng.choice([0.0, 1e-6, 1e-2, 0.1, 1.0, 100.0]),
        (*rng.uniform(-1, 1, 2) * size * rng.choice([0, 1]), rng.uniform(-9, 9)),
    )


def paper_like(vehicles: int, seed: int, **changes: Any) -> MessengerTour:
    """Return a tour like the paper's, of sparsity 6 with its radius of 5 m."""
    return replace(generate(vehicles, 6.0, seed), **changes)


def solved(model: MessengerTour, name: str, **more: Any) -> Any:
    """Return the solution of a short run."""
    options = {**SHORT.get(name, {}), **more.pop("options", {})}
    return ct.solve(model, name, backend_options=options, **more)


def flight(model: MessengerTour, seed: int = 0) -> Flight:
    """Return the arrays of `model` that the kernels share."""
    return Flight(model, Request(seed=seed))


def drawn(one: Flight, timed: bool) -> tuple[Any, Any]:
    """Return a random individual whose path is decoded; intervals are up to twice the earliest."""
    n = one.problem.size
    order, genes = one.rng.permutation(n), np.ones((n, 3))
    genes[:, 0] = one.rng.uniform(0, 2 * math.pi, n)
    decode(order, genes, one.fleet, one.craft, 0, False, False, math.inf, one.poses, one.legs)
    if timed:
        genes[:, 1] *= one.rng.uniform(0, 2, n)
        decode(order, genes, one.fleet, one.craft, 0, True, False, math.inf, one.poses, one.legs)
    return order, genes


@pytest.mark.parametrize("name", RIVALS)
def test_wild_cases_have_valid_plans(name: str) -> None:
    for seed in range(40):
        model = wild(seed)
        interior = {"interior": True} if seed % 2 and name != "greedy-centre" else {}
        found = solved(model, name, seed=seed, options=interior)
        assert found.termination == Termination.FEASIBLE, (seed, found.message)
        assert found.verification is not None
        assert found.verification.ok, (seed, found.summary())
        lengths = [one.objective for one in found.incumbents]
        assert lengths == sorted(lengths, reverse=True), seed
        assert lengths[-1] == pytest.approx(found.primal_bound, rel=1e-12), seed


def test_wild_cases_of_few_vehicles_are_sampled() -> None:
    for seed in range(40):
        model = wild(seed, most=3)
        for interior in (False, True):
            found = solved(model, "direct-sampling", options={"samples": 12, "interior": interior})
            assert found.verification is not None
            assert found.verification.ok, (seed, found.summary())


def test_a_hundred_vehicles_within_a_time_limit() -> None:
    model = paper_like(100, 1)
    for name in RIVALS:
        found = ct.solve(model, name, time_limit=0.3)
        assert found.verification is not None
        assert found.verification.ok, name
        assert found.seconds["solve"] < 2.0, name
        if "greedy" not in name:
            assert found.limit == Limit.TIME, name


def test_restarts_use_the_time_up() -> None:
    for name in ("memetic", "variable-neighbourhood"):
        found = solved(paper_like(2, 1), name, time_limit=0.4, options={"restarts": True})
        assert found.limit == Limit.TIME
        assert found.statistics["runs"] > 1
        assert solved(paper_like(2, 1), name, options={"restarts": True}).statistics["runs"] == 1


@pytest.mark.parametrize("name", RIVALS)
def test_a_seed_gives_one_plan(name: str) -> None:
    model = paper_like(7, 3)
    one, two = (solved(model, name, seed=5).plan for _ in range(2))
    assert one.to_data() == two.to_data()
    if "greedy" not in name:
        others = {solved(model, name, seed=seed).primal_bound for seed in range(4)}
        assert len(others) > 1


@pytest.mark.parametrize("name", RIVALS)
def test_answers_scale(name: str) -> None:
    """A power of two scales every number exactly, so every decision stays."""
    model, by = paper_like(6, 4), 2.0**20
    larger = MessengerTour(
        model.positions * by, model.velocities * by, model.radius * by, model.speed * by,
        model.turning_radius * by,
    )  # fmt: skip
    one, two = solved(model, name, seed=1), solved(larger, name, seed=1)
    assert two.plan.order == one.plan.order
    assert two.primal_bound == pytest.approx(by * one.primal_bound, rel=1e-12)


def test_all_discs_around_the_start() -> None:
    model = MessengerTour([[1, 1], [-2, 0], [0, 1], [1, 1]], [[1, 0], [0, 1], [0, 0], [1, 0]], 50)
    for name in RIVALS:
        if name == "greedy-centre":
            assert solved(model, name).primal_bound == 0.0
        else:
            inside = solved(model, name, options={"interior": True})
            assert inside.primal_bound == 0.0, name
            assert not inside.plan.primitives
            assert inside.verification.ok
            # The paper's encoding meets vehicles on the boundary only.
            assert solved(model, name).primal_bound > 40, name


def test_what_is_not_covered_is_refused() -> None:
    closed = MessengerTour([[30, 0], [0, 30]], closed=True)
    anywhere = MessengerTour([[30, 0], [0, 30]], start=(0, 0))
    for name in (*RIVALS, "direct-sampling"):
        with pytest.raises(UnsupportedFormulation, match="closed"):
            ct.solve(closed, name)
        with pytest.raises(UnsupportedFormulation, match="heading"):
            ct.solve(anywhere, name)
    with pytest.raises(UnsupportedFormulation, match="more than 3 vehicles, got 4"):
        ct.solve(paper_like(4, 1), "direct-sampling")
    # A UAV that turns on the spot needs no heading.
    straight = replace(anywhere, turning_radius=0.0)
    assert solved(straight, "memetic").primal_bound == pytest.approx(58.5, abs=1)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("memetic", {"generations": -1}),
        ("memetic", {"mutation": 1.5}),
        ("memetic", {"transformation": 1}),
        ("memetic-untransformed", {"transformation": True}),
        ("memetic", {"elite": float("nan")}),
        ("greedy-centre", {"horizon": 3}),
        ("greedy-centre", {"interior": True}),
        ("greedy-boundary", {"samples": 0}),
        ("variable-neighbourhood", {"iterations": 1.5}),
        ("direct-sampling", {"samples": "many"}),
    ],
)
def test_bad_options_are_refused(name: str, options: dict[str, Any]) -> None:
    with pytest.raises(UnsupportedOption, match=next(iter(options))):
        ct.solve(paper_like(2, 1), name, backend_options=options)


# -- the parts -------------------------------------------------------------------------------------


def test_an_interval_is_kept_where_it_can_be_flown_and_repaired_where_not() -> None:
    kept = repaired = 0
    for seed in range(60):
        one = flight(MessengerTour([[8 + 0.3 * seed, 5 + 0.2 * seed]], [[3, -1]]), seed)
        _, genes = drawn(one, timed=False)
        speed, first = one.craft[3], genes[0, 1]
        for factor in (0.5, 1.0, 1.1, 1.5, 3.0):
            taken = meet(
                one.poses, one.legs, 0, one.fleet, one.craft, 0, genes[0, 0], factor * first, 1.0
            )
            assert speed * taken == pytest.approx(abs(one.legs[0, :3]).sum(), rel=1e-12)
            x, y, px, py = *one.poses[1, :2], *one.problem.where(0, taken)
            assert math.hypot(x - px, y - py) == pytest.approx(5.0, rel=1e-8)
            if taken == pytest.approx(factor * first, rel=1e-9):
                kept += factor > 1
            else:  # too short, or in the gap
                assert taken == pytest.approx(first, rel=1e-12)
                repaired += 1
    assert kept > 120
    assert repaired > 60


@pytest.mark.parametrize("timed", [False, True])
def test_a_transformation_never_lengthens(timed: bool) -> None:
    moved = shorter = same = 0
    for seed in range(60):
        model = paper_like(6, seed, radius=2.0 + seed % 20)
        one = flight(model, seed)
        order, genes = drawn(one, timed)
        before = one.poses[-1, 3]
        args = (order, genes, one.fleet, one.craft, timed, False, one.flag)
        moved += transform(*args, one.poses, one.legs)
        after = one.poses[-1, 3]
        assert sorted(order) == list(range(6))
        assert after <= before * (1 + 1e-12), seed
        shorter += after < before * 0.9
        # What it leaves is the path of its genes, but where a point lies on a turning circle.
        again = decode(
            order, genes, one.fleet, one.craft, 0, True, False, math.inf, one.poses, one.legs
        )
        same += again == pytest.approx(after, rel=1e-6)
    assert same >= 55
    assert moved > 60
    assert shorter > 20


def test_an_entry_is_the_first_crossing() -> None:
    found = 0
    for seed in range(40):
        one = flight(paper_like(2, seed, radius=20.0), seed)
        order, _ = drawn(one, timed=seed % 2 == 0)
        other = int(order[1])
        passed, _, rho = entry(one.poses, one.legs, 0, one.fleet, one.craft, other, False)
        assert rho == 1.0
        times = np.linspace(0, one.poses[1, 3], 2001)
        gaps = [gap(one, other, time) for time in times]
        crossed = np.flatnonzero(np.sign(gaps[1:]) != np.sign(gaps[:-1]))
        if not crossed.size:
            continue
        found += 1
        assert times[crossed[0]] - 1e-9 <= passed <= times[crossed[0] + 1] + 1e-9, seed
        assert gap(one, other, passed) == pytest.approx(0, abs=1e-7)
    assert found >= 8


def gap(one: Flight, vehicle: int, time: float) -> float:
    """Return how far the UAV is beyond the vehicle's disc on the first leg."""
    x, y, h = one.poses[0, :3]
    left, r = time * one.craft[3], one.craft[4]
    for length, sign in zip(one.legs[0, :3], one.legs[0, 3:], strict=True):
        step = min(length, left)
        left -= step
        if sign:
            turned = h + sign * step / r
            x += r * sign * (math.sin(turned) - math.sin(h))
            y -= r * sign * (math.cos(turned) - math.cos(h))
            h = turned
        else:
            x, y = x + step * math.cos(h), y + step * math.sin(h)
    px, py = one.problem.where(vehicle, time)
    return math.hypot(x - px, y - py) - float(one.fleet[vehicle, 4])


def test_local_searches_never_lengthen() -> None:
    gains = {"GS": 0, "SS": 0}
    for seed in range(20):
        for name in gains:
            one = flight(paper_like(5, seed), seed)
            order, genes = drawn(one, timed=True)
            before = one.poses[-1, 3]
            args = (order, genes, one.fleet, one.craft, False)
            if name == "GS":
                descend(*args, 0.01, 0.01, one.flag, one.poses, one.legs)
            else:
                resample(*args, 20, 0.01, one.rng, one.flag, one.poses, one.legs)
            assert one.poses[-1, 3] <= before
            gains[name] += one.poses[-1, 3] < 0.99 * before
            end = decode(
                order, genes, one.fleet, one.craft, 0, True, False, math.inf, one.poses, one.legs
            )
            assert end == pytest.approx(one.poses[-1, 3], rel=1e-9)
            assert end <= before * (1 + 1e-9)
    assert min(gains.values()) > 10


def test_moves_and_exchanges_of_stretches() -> None:
    for begin, count, place in itertools.product(range(6), range(1, 7), range(6)):
        if begin + count <= 6 and place + count <= 6:
            order = np.arange(6)
            move(order, begin, count, place)
            rest = [k for k in range(6) if not begin <= k < begin + count]
            rest[place:place] = range(begin, begin + count)
            assert order.tolist() == rest
    for a, b, c, d in itertools.combinations_with_replacement(range(7), 4):
        order = np.arange(6)
        exchange(order, a, b, c, d)
        every = list(range(6))
        wanted = every[:a] + every[c:d] + every[b:c] + every[a:b] + every[d:]
        assert order.tolist() == wanted


# -- who beats whom --------------------------------------------------------------------------------


def test_direct_sampling_against_finer_samples() -> None:
    """Samples five times as fine hold the coarse ones, so they are never worse, and hardly better."""
    for seed in range(3):
        model = paper_like(2, seed)
        coarse = ct.solve(model, "direct-sampling", backend_options={"samples": 36}).primal_bound
        fine = math.inf
        for order in itertools.permutations(range(2)):
            for first in np.linspace(0, 2 * math.pi, 180, endpoint=False):
                pose, time = leg(model, (*model.start, 0.0), order[0], first)
                for second in np.linspace(0, 2 * math.pi, 180, endpoint=False):
                    if time < fine:
                        fine = min(fine, leg(model, (*pose, time), order[1], second)[1])
        assert fine * model.speed <= coarse * (1 + 1e-9)
        assert coarse <= fine * model.speed * 1.02


def leg(model: MessengerTour, pose: Any, vehicle: int, psi: float) -> tuple[Any, float]:
    """Return where and when the UAV meets a point of the vehicle's boundary first."""
    x, y, h, t = (float(one) for one in pose)
    radius = float(model.radius[vehicle])
    px, py = model.positions[vehicle] + radius * np.array([math.cos(psi), math.sin(psi)])
    vx, vy = (float(one) for one in model.velocities[vehicle])
    end = intercept(x, y, h, t, px, py, vx, vy, model.speed, model.turning_radius)
    *lengths, code = relaxed(x, y, h, px + vx * end, py + vy * end, model.turning_radius)
    if sum(lengths) < model.speed * (end - t) * (1 - 1e-9):  # it jumped: wait
        *lengths, s1, s2, s3, _ = elongated(
            x, y, h, px + vx * end, py + vy * end, model.turning_radius, model.speed * (end - t)
        )
        signs = [s1, s2, s3]
    else:
        signs = RELAXED_WORDS[code].tolist()
    for length, sign in zip(lengths, signs, strict=True):
        x, y, h = advance(x, y, h, length, sign, model.turning_radius)
    return (x, y, h), end


def test_the_memetic_algorithm_is_about_as_good_as_direct_sampling() -> None:
    for vehicles, seed in itertools.product((2, 3), range(3)):
        model = paper_like(vehicles, seed)
        sampled = ct.solve(model, "direct-sampling", backend_options={"samples": 36}).primal_bound
        assert ct.solve(model, "memetic", seed=seed).primal_bound <= 1.02 * sampled


def test_the_transformation_pays() -> None:
    lengths = {
        name: sum(ct.solve(paper_like(10, seed), name, seed=seed).primal_bound for seed in range(3))
        for name in ("memetic", "memetic-untransformed")
    }
    assert lengths["memetic"] < 0.9 * lengths["memetic-untransformed"]


def test_two_opt_improves_orders() -> None:
    for name in ("greedy-boundary", "greedy-centre"):
        pairs = [
            [
                ct.solve(paper_like(12, seed), name, backend_options={"two_opt": two}).primal_bound
                for two in (False, True)
            ]
            for seed in range(6)
        ]
        assert all(after <= before for before, after in pairs)
        assert sum(after for _, after in pairs) < 0.9 * sum(before for before, _ in pairs)
