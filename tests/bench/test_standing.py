"""Standings, charts and pictures of a report."""

import re
from dataclasses import replace
from types import SimpleNamespace

import pytest
from bench.answers import answer, campaign, exact, write

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import ErrorCorrectionRouting
from crosstrack.models.verification import Verification
from crosstrack.solvers.bench import write_page
from crosstrack.solvers.bench.chart import Series, draw_steps
from crosstrack.solvers.bench.pictures import draw_plan
from crosstrack.solvers.bench.standing import rank
from crosstrack.solvers.contract.enums import Termination
from crosstrack.solvers.contract.solution import Incumbent
from crosstrack.solvers.contract.verdict import judge


def test_rank_counts_what_is_solved_and_how_fast():
    # one: a-star 10 (exact), greedy 12 is no solution. two: both have 9.5; greedy in 0.02 s of 2 s.
    own = [s for s in campaign() if s.model == "grid-path"]
    names = sorted({s.instance for s in own})
    found = {
        one.label: one
        for one in rank([judge(n, [s for s in own if s.instance == n]) for n in names])
    }
    assert list(found) == ["a-star", "greedy", "broken"]
    assert [(one.solved, one.instances, one.best) for one in found.values()] == [
        (2, 2, 2), (1, 2, 1), (0, 1, 0),
    ]  # fmt: skip
    # Ratios to the fastest: a-star 1 and 100, greedy infinite and 1.
    profiles = {
        label: [pytest.approx(point) for point in one.profile] for label, one in found.items()
    }
    assert profiles["a-star"] == [(1.0, 0.5), (100.0, 1.0), (100.0, 1.0)]
    assert profiles["greedy"] == [(1.0, 0.5), (100.0, 0.5)]
    assert found["broken"].profile == []
    # Building takes a tenth more: (1.55 · 3.2)^(1/2) - 1, and (11 · 1.022)^(1/2) - 1, 10 s for the failure.
    assert found["a-star"].typical == pytest.approx((1.55 * 3.2) ** 0.5 - 1)
    assert found["greedy"].typical == pytest.approx((11 * 1.022) ** 0.5 - 1)


def reasons(*solutions):
    return {s.backend: why for one in rank([judge("one", solutions)]) for s, why in one.answers}


def test_reasons_name_what_is_wrong_before_what_is_missing():
    none = {"termination": Termination.INFEASIBLE, "verification": None}
    good = exact("one", "good", 10.0, 1.0)
    empty = exact("one", "empty", None, 0.1, **none, dual_bound=None)
    bound = exact("one", "bound", None, 0.1, termination=Termination.NO_SOLUTION, dual_bound=11.0)
    assert reasons(good, empty) == {"good": "", "empty": "wrong: infeasible"}
    assert reasons(good, bound) == {"good": "", "bound": "wrong bound"}
    assert reasons(empty, answer("one", "lost", None, 5.0)) == {"empty": "", "lost": "no plan"}
    local = answer("one", "local", None, 0.1, termination=Termination.LOCALLY_INFEASIBLE)
    assert reasons(good, local)["local"] == "no plan"


def test_a_hair_above_an_optimum_of_zero_or_within_noise_is_solved():
    zero = exact("one", "zero", 0.0, 1.0)
    assert reasons(zero, answer("one", "hair", 1e-9, 1.0))["hair"] == ""
    assert reasons(zero, answer("one", "more", 0.5, 1.0))["more"] == "50 % above best"
    assert reasons(zero, answer("one", "far", 1e6, 1.0))["far"] == "far above best"
    noisy = Verification(objective=1.0, checks=(), spread=0.2)
    sampled = answer("one", "sampled", 1.0, 1.0, verification=noisy)
    assert reasons(sampled, answer("one", "near", 1.1, 1.0))["near"] == ""
    assert reasons(sampled, answer("one", "off", 1.3, 1.0))["off"] == "30 % above best"


def test_page_of_a_thousand_answers_is_small(tmp_path):
    steps = tuple(Incumbent(1.001**i, 1e3 - i) for i in range(400))
    many = [
        answer(f"grid-path/{i % 125}", f"backend-{i // 125}", 500.0 + i, 1.6, incumbents=steps, message="m" * 200)
        for i in range(1000)
    ]  # fmt: skip
    assert write(tmp_path, many).stat().st_size < 3e6


@pytest.mark.parametrize(
    "points",
    [
        [(1.0, 0.0)],
        [(1e-9, 5.0), (1e9, 5.0)],
        [(1.0, 1e300), (2.0, -1e300)],
        [(1.0, 1e-320)],
        [(1.0, 123456789.25), (1.5, 123456789.0)],
        [(1.0 + i, -float(i)) for i in range(10_000)],
    ],
)
def test_charts_handle_degenerate_data(points):
    drawn = draw_steps([Series("a", points)] * 43, title="t", across="x", up="y")
    assert not re.search(r"\b(nan|inf)\b", drawn)
    assert len(drawn) < 150_000
    ticks = re.findall(r'text-anchor="end">([^<]+)<', drawn)
    assert len(set(ticks)) == len(ticks) >= 2
    assert draw_steps([Series("empty", [])], title="t", across="x", up="y") == ""


@pytest.fixture
def small():
    return ErrorCorrectionRouting(
        points=[[0, 0, 0], [1.2, 1.6, 0], [1.5, 2, 0], [2.7, 3.6, 0]],
        kinds=["A", "horizontal", "vertical", "B"], alpha1=0.3, alpha2=0.3, beta1=0.3, beta2=0.3,
        theta=0.3, delta=0.1, name="small",
    )  # fmt: skip


def test_plan_is_drawn_on_the_instance_of_the_same_digest_only(small, caplog):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    route = small.plan_to_data(small.as_plan([0, 1, 2, 3]))
    held = answer("small", "two-stage", 4.5, 0.1, digest=small.digest, stored_plan=route)
    image, what = draw_plan(held, lambda name: small)
    assert image.startswith("data:image/webp;base64,")
    assert what == "The best plan of small, by two-stage"
    assert draw_plan(held, None)[1].endswith("without loading instances.")
    assert "no backend found a plan" in draw_plan(None, None)[1]
    assert "cannot be loaded by its name" in draw_plan(held, ct.load)[1]
    other = answer("small", "two-stage", 4.5, 0.1, digest="f" * 64, stored_plan=route)
    image, what = draw_plan(other, lambda name: small)
    assert image == ""
    assert f"digest {small.digest[:12]}, in the record ffffffffffff" in what
    torn = answer("small", "two-stage", 4.5, 0.1, digest=small.digest, stored_plan=["?"])
    assert draw_plan(torn, lambda name: small)[1].startswith("No picture: ")
    assert "picture of 'small'" in caplog.text


def test_pictures_are_limited_and_spread_over_the_problems(small, tmp_path):
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    models = {f"i{i}": replace(small, alpha1=0.3 + i / 100, name=f"i{i}") for i in range(3)}
    route = small.plan_to_data(small.as_plan([0, 1, 2, 3]))
    solutions = [
        answer(name, "two-stage", 4.5, 0.1, kind=kind, digest=model.digest, stored_plan=route)
        for (name, model), kind in zip(models.items(), ("a", "a", "b"), strict=True)
    ]
    text = write(tmp_path, solutions, load=models.__getitem__, pictures=2).read_text("utf-8")
    assert text.count("data:image") == 2
    assert [f"The best plan of {name}" in text for name in models] == [True, False, True]
    assert "the page has at most 2; --pictures sets it" in text


def test_nothing_to_show_and_no_place_to_write_raise(tmp_path):
    with pytest.raises(InvalidData, match="records must hold an answer"):
        write(tmp_path, [])
    with pytest.raises(InvalidData):
        write_page(SimpleNamespace(solutions=campaign()), tmp_path / "page.txt")
