"""Programs of guided path tours: sweeps and arcs contain every plan, and their optimum is correct."""

import itertools

import numpy as np
import pytest
from guided_path.enumerated import best, chains_tour, extensions, lengths, random_tour, tours
from hypothesis import given, settings

import crosstrack as ct
from crosstrack.errors import InvalidData, UnsupportedFormulation, UnsupportedOption
from crosstrack.models import GuidedPathTour
from crosstrack.models.guided_path import GuidedPathPlan, sweeps
from crosstrack.models.guided_path.gaps import Gaps
from crosstrack.models.guided_path.turns import enough_sweeps, some_length, turning
from crosstrack.models.guided_path.walks import reduced

EXAMPLE = GuidedPathTour([0, 1, 2, 3, 4], chains=[[3, 1], [4, 2]])
MIXED = GuidedPathTour([0, 5, 2, 8, 4, 9, 1], chains=[[1, 2, 3, 6], [5, 4]], precedence=[(2, 5)])
NAMES = ("sweeps", "arcs")
#: Kinds of coordinates that are integers.
PLAIN = ("integers", "ties", "signed", "far", "nowhere")


def some(few, count):
    """Return `count` seeds, and mark all after the first `few` as slow."""
    return [*range(few), *(pytest.param(k, marks=pytest.mark.slow) for k in range(few, count))]


def walk(model, order):
    """Return the ends of the alternating sweeps along an order."""
    x = model.coordinates.tolist()
    ends, side = [x[0]], 1
    for here, there in itertools.pairwise((0, *order, 0)):
        if (x[there] - x[here]) * side < 0:
            ends.append(x[here])
            side = -side
    return [*ends, x[0]]


def settled(answer, value):
    """Assert that a solution has the enumerated optimum."""
    scale = max(value, 1e-3)
    assert answer.termination == "optimal", answer
    assert answer.verification.ok
    assert abs(answer.primal_bound - value) <= 1e-6 * scale
    assert value - 2e-6 * scale <= answer.dual_bound <= value + 1e-6 * scale


# -- what is known of all tours ------------------------------------------------------------------


@pytest.mark.sample(2)
@pytest.mark.parametrize("seed", some(30, 120))
def test_crossings_and_turns_hold_for_all_shortest_tours(seed):
    model = reduced(random_tour(seed, most=7))[0]
    gaps, orders = Gaps(model), extensions(model)
    stops = gaps.at[np.pad(orders, ((0, 0), (1, 1)))]
    for gap, least in enumerate(gaps.crossings.tolist()):
        right = stops > gap
        crossed = (~right[:, :-1] & right[:, 1:]).sum(axis=1)
        assert least == crossed.min()
        forcing = gaps.forcing(gap)
        sides = [bool(gaps.at[c] > gap) for c in (0, *forcing)]
        assert all(a != b for a, b in itertools.pairwise(sides))
        assert all(model.closure[a, b] for a, b in itertools.pairwise(forcing))
        assert (len(forcing) + 1) // 2 == least
    value = best(model)
    assert gaps.bound <= value * (1 + 1e-12)
    found = some_length(gaps)
    ways = lengths(model.coordinates, orders)
    near = 1e-9 * max(value, 1.0)
    # The value is the length of some tour.
    assert np.abs(ways - found).min() <= near
    enough = enough_sweeps(gaps, found)
    places = {side: {float(model.coordinates[c]) for c in turning(gaps, side)} for side in (1, -1)}
    for order in orders[ways <= value].tolist():
        ends = walk(model, order)
        assert len(ends) - 1 <= enough_sweeps(gaps, value) <= enough
        for k, end in enumerate(ends[1:-1]):
            assert end in places[1 - 2 * (k % 2)] or (k == 0 and end == model.coordinates[0])


def test_sweeps_are_few():
    """The cost of turns leaves few of the sweeps that the relation alone would allow."""
    counts = []
    for seed in range(4):
        gaps = Gaps(reduced(chains_tour(10, 5, seed))[0])
        counts.append((enough_sweeps(gaps, some_length(gaps)), enough_sweeps(gaps, 1e9)))
    assert all(few <= 16 and most >= 20 for few, most in counts), counts


def test_lengths_are_decimal_numbers():
    gaps = Gaps(GuidedPathTour([0.1, 0.3, -0.7, 1e9 + 0.1]))
    assert gaps.lengths.tolist() == [0.8, 0.2, 999999999.8]
    assert 0.3 - 0.1 != 0.2


# -- every plan ----------------------------------------------------------------------------------


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", range(100, 118))
def test_every_plan_fits(seed, name):
    model = random_tour(seed, most=5)
    written = model.formulate(name)
    orders = extensions(model)
    kept = np.array(reduced(model)[1])
    least = np.inf
    for order in orders[:: max(len(orders) // 15, 1)]:
        plan = GuidedPathPlan(order)
        fitted = written.fitted(plan)
        point = fitted.encode(plan)
        found = fitted.program.verify(point)
        assert found.ok, found
        # The objective omits customers that any tour passes, and detours to them.
        way = lengths(model.coordinates, order[np.isin(order, kept)][None])[0]
        given = model.verify(plan)
        near = 1e-9 * (1 + np.abs(model.coordinates).max())
        assert found.objective == pytest.approx(way, abs=near)
        assert found.objective <= given.objective + near
        again = model.verify(fitted.decode(point))
        assert again.ok
        assert again.objective <= found.objective + near
        least = min(least, found.objective)
    assert least >= best(model) - 1e-9 * (1 + np.abs(model.coordinates).max())


@pytest.mark.parametrize("name", NAMES)
def test_orders_against_the_relation_break_a_row(name):
    broken = 0
    for seed in range(25):
        model = random_tour(seed, most=6, kind="signed", relation="dense")
        written = model.formulate(name)
        allowed = set(map(tuple, extensions(model).tolist()))
        rng = np.random.default_rng(seed)
        for _ in range(5):
            plan = GuidedPathPlan(rng.permutation(model.size - 1) + 1)
            if plan.order in allowed:
                continue
            fitted = written.fitted(plan)
            point = fitted.encode(plan)
            if fitted.program.verify(point).ok:
                # The wrong order affected only omitted customers or customers at one place.
                again = model.verify(fitted.decode(point))
                assert again.ok
                assert again.objective <= fitted.program.objective(point) + 1e-6
            else:
                broken += 1
    assert broken > 20


def test_a_plan_that_turns_more_often():
    model = GuidedPathTour([0, 5, 2, 8, 4, 9, 1, 7], chains=[[1, 2, 3], [4, 5, 6, 7]])
    written = model.formulate()
    plan = GuidedPathPlan(
        max(extensions(model).tolist(), key=lambda order: len(walk(model, order)))
    )
    fitted = written.fitted(plan)
    assert fitted.count > written.count == written.enough
    assert fitted.relaxes
    assert fitted.program.verify(fitted.encode(plan)).ok
    with pytest.raises(InvalidData, match=f"order must make at most {written.count} sweeps"):
        written.encode(plan)
    assert ct.verify(model, plan, formulation="sweeps").ok
    answer = ct.solve(model, "highs", warm_start=plan)
    settled(answer, best(model))


# -- against enumeration -------------------------------------------------------------------------


@pytest.mark.sample(2)
@pytest.mark.parametrize("seed", some(12, 40))
@pytest.mark.parametrize("name", NAMES)
def test_highs_equals_enumeration(seed, name):
    model = random_tour(seed)
    settled(ct.solve(model, "highs", formulation=name), best(model))


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("solver", ["highs", "scip", "cp-sat"])
def test_solvers_equal_enumeration_often(solver, name):
    for seed in range(1000, 1200):
        # Real coordinates need more digits than 64-bit integers have.
        kind = PLAIN[seed % len(PLAIN)] if solver == "cp-sat" else None
        model = random_tour(seed, most=7, kind=kind)
        settled(ct.solve(model, solver, formulation=name), best(model))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("solver", ["scip", "cp-sat"])
def test_solvers_equal_enumeration(solver, name):
    for kind in PLAIN:
        model = random_tour(7, kind=kind, relation="both")
        settled(ct.solve(model, solver, formulation=name), best(model))
    settled(ct.solve(EXAMPLE, solver, formulation=name), 8.0)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_units_do_not_matter(unit, name):
    model = random_tour(3, kind="integers", relation="chains", most=7)
    other = GuidedPathTour(model.coordinates * unit, chains=model.chains)
    answer = ct.solve(other, "highs", formulation=name)
    assert answer.termination == "optimal"
    assert answer.primal_bound == pytest.approx(best(model) * unit, rel=1e-9)


def test_cp_sat_takes_decimal_numbers():
    x = [0.1, 1.7, 0.3, -2.9, 1.1, 0.2, 2.6]
    model = GuidedPathTour(x, chains=[[1, 2, 4], [3, 6, 5]])
    settled(ct.solve(model, "cp-sat"), best(model))


@pytest.mark.slow
def test_ten_chains_of_five():
    settled(ct.solve(chains_tour(10, 5, 0), "cp-sat", time_limit=120), 802.0)


# -- options, sizes and points -------------------------------------------------------------------


def test_fewer_sweeps_prove_nothing():
    model = chains_tour(3, 5, 0)
    few = model.formulate("sweeps", sweeps=4)
    assert few.enough > 4
    assert not few.relaxes
    answer = ct.solve(model, "highs", formulation_options={"sweeps": 4})
    assert answer.verification.ok
    assert answer.termination == "feasible"
    assert answer.dual_bound is None
    assert answer.statistics["sweeps"] == 4
    none = ct.solve(model, "highs", formulation_options={"sweeps": 1})
    assert none.plan is None
    assert none.termination == "no_solution"
    many = model.formulate("sweeps", sweeps=40)
    assert many.relaxes
    assert many.bounded(1e9) is many


def test_a_known_length_leaves_fewer_sweeps():
    written = chains_tour(10, 5, 1).formulate()
    assert written.bounded(1e6) is written
    assert written.program is written.program
    tight = written.bounded(800.0)
    assert tight.count < written.count
    assert tight.relaxes
    assert tight.program.size < written.program.size


def test_a_run_computes_the_number_of_sweeps_once(monkeypatch):
    calls = []
    monkeypatch.setattr(sweeps, "some_length", lambda gaps: calls.append(gaps) or np.inf)
    solution = ct.solve(chains_tour(2, 2, 7), "highs", formulation="sweeps", time_limit=10.0)
    assert solution.termination == "optimal"
    assert len(calls) == 1


@pytest.mark.parametrize("sweeps", [0, -1, 2.0, True, "many"])
def test_rejects_invalid_sweeps(sweeps):
    with pytest.raises(UnsupportedOption, match="sweeps must be a whole number >= 1, got"):
        EXAMPLE.formulate("sweeps", sweeps=sweeps)


def test_rejects_programs_that_are_too_large():
    with pytest.raises(UnsupportedFormulation, match="'arcs' takes at most 60 customers"):
        chains_tour(50, 5, 1).formulate("arcs")
    with pytest.raises(UnsupportedFormulation, match="'sweeps' has at most 500000 columns"):
        chains_tour(200, 10, 1, most=10**6).formulate("sweeps")


@pytest.mark.parametrize("name", NAMES)
def test_rejects_bad_points_and_plans(name):
    written = EXAMPLE.formulate(name)
    point = written.encode(GuidedPathPlan([3, 4, 2, 1]))
    with pytest.raises(InvalidData, match="point must"):
        written.decode(point[:-1])
    with pytest.raises(InvalidData, match="once it may be served"):
        written.decode(np.zeros_like(point))
    for order in ([3, 4, 2], [3, 4, 2, 2], [3, 4, 2, 9]):
        with pytest.raises(InvalidData, match="order must contain each customer once"):
            written.encode(GuidedPathPlan(order))
    with pytest.raises(InvalidData, match="plan must be a GuidedPathPlan"):
        written.encode([3, 4, 2, 1])


def test_rows_have_names():
    program = MIXED.formulate("sweeps").program
    rows = [program.row_name(row) for row in range(program.row_count)]
    assert "precedence sweep 1, customer 1 before 2" in rows
    assert "gap crossed as often as a chain asks gap 0" in rows
    program = MIXED.formulate("arcs").program
    columns = [program.column_name(column) for column in range(program.size)]
    assert "served next 5 after 2" in columns
    assert "served next 5 after 1" not in columns
    for names in (rows, columns):
        assert len(set(names)) == len(names)


@pytest.mark.parametrize("name", NAMES)
def test_models_without_relevant_customers_have_a_program(name):
    for places, chains in (([5, 5, 5], [[2, 1]]), ([0, 0], []), ([0, 2, -3, 1], [])):
        model = GuidedPathTour(places, chains=chains)
        settled(ct.solve(model, "highs", formulation=name), best(model))


@given(model=tours(most=5))
@settings(max_examples=15, deadline=None)
def test_any_tour_has_a_program(model):
    """Ratios of 1e15, thirds and places far away: the best order is a point of both programs."""
    orders = extensions(model)
    ways = lengths(model.coordinates, orders)
    plan = GuidedPathPlan(orders[ways.argmin()])
    near = 1e-9 * (1 + np.ptp(model.coordinates)) + 1e-15 * np.abs(model.coordinates).max()
    for name in NAMES:
        written = model.formulate(name).fitted(plan)
        point = written.encode(plan)
        found = written.program.verify(point)
        assert found.ok, found
        assert found.objective == pytest.approx(ways.min(), abs=10 * near)
        assert model.verify(written.decode(point)).ok
