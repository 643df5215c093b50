"""Randomised searches and evaluations: rank tests, data profiles, primal integrals, references."""

import json
import os
from dataclasses import replace

import pytest
from click.testing import CliRunner

import crosstrack as ct
from crosstrack.__main__ import cli
from crosstrack.errors import InvalidData
from crosstrack.models.verification import Verification
from crosstrack.solvers.bench.draws import (
    compare_on_instance,
    compare_with_leader,
    profile_evaluations,
)
from crosstrack.solvers.bench.records import Records, read_records
from crosstrack.solvers.bench.standing import REFERENCE, TOO_LATE, rank
from crosstrack.solvers.contract.enums import Termination
from crosstrack.solvers.contract.solution import Incumbent, Solution
from crosstrack.solvers.contract.verdict import judge


def run(instance, backend, objective, *, seed=0, seconds=1.0, steps=(), size=2, **more):
    """A verified answer; `steps` are seconds, objectives and evaluations of what was better."""
    found = {
        "model": "black-box", "instance": f"black-box/{instance}", "digest": instance, "backend": backend,
        "termination": Termination.NO_SOLUTION if objective is None else Termination.FEASIBLE,
        "primal_bound": objective, "stored_plan": None if objective is None else {"x": [0]},
        "verification": None if objective is None else Verification(objective=objective, checks=()),
        "seconds": {"solve": seconds}, "options": {"time_limit": 10.0}, "seed": seed, "version": "1",
        "incumbents": tuple(Incumbent(s, f, evaluations=n) for s, f, n in steps),
        "statistics": {"variables": size},
    }  # fmt: skip
    return Solution(**{**found, **more})


def judged(*solutions):
    names = dict.fromkeys(s.instance for s in solutions)
    return [judge(name, [s for s in solutions if s.instance == name]) for name in names]


def test_evaluations_until_a_thousandth_of_the_distance_remains():
    # From 10 to 0: solved at 0.01 or less. a after 6 evaluations in 2 variables, b after 12, c never.
    verdicts = judged(
        run("one", "a", 0.0, steps=[(0.1, 10.0, 1), (0.2, 0.01, 6), (0.3, 0.0, 9)]),
        run("one", "b", 0.005, steps=[(0.1, 4.0, 1), (0.2, 0.005, 12)]),
        run("one", "c", 0.02, steps=[(0.1, 4.0, 1), (0.2, 0.02, 3)]),
        run("two", "a", 5.0, steps=[(0.1, 5.0, 3)], size=5),
    )
    found = profile_evaluations(verdicts)
    assert found["a"][0].tolist() == [0, 0.5, 2] and found["a"][1].tolist() == [0, 0.5, 1]
    assert found["b"][0].tolist() == [0, 4] and found["b"][1].tolist() == [0, 0.5]
    assert found["c"][1].tolist() == [0]
    # The median of three seeds: 3, 9 and never.
    seeds = [
        run("one", "a", 0.0, seed=k, steps=[(0.1, 1.0, 1), *([(0.2, 0.0, n)] if n else [])])
        for k, n in enumerate((3, 9, 0))
    ]
    assert profile_evaluations(judged(*seeds))["a"][0].tolist() == [0, 3]
    assert profile_evaluations(judged(run("one", "a", 1.0))) == {}
    # A run without a plan never gets there: four of five make the median infinite.
    runs = [run("one", "a", 0.0, seed=0, steps=[(0.1, 9.0, 1), (0.2, 0.0, 3)])]
    runs += [run("one", "a", None, seed=k) for k in range(1, 5)]
    assert profile_evaluations(judged(*runs))["a"][1].tolist() == [0]


def test_the_leader_is_tested_if_backends_are_randomised():
    # On six instances a is best, b half way and c at the end: every difference has the same sign.
    solutions = [
        run(f"i{i}", name, 10.0**i * value + shift, seed=seed, seconds=seconds)
        for i in range(6)
        for seed in (0, 1, 2)
        for name, value, seconds in (("a", 1.0, 1), ("b", 2.0 + i / 10, 2), ("c", 4.0, 3))
        for shift in (-100.0,)
    ]
    verdicts = judged(*solutions)
    tests = compare_with_leader(verdicts, rank(verdicts))
    assert tests == {}, "only a solved anything"
    near = [run("i9", name, 3.0, seconds=s) for name, s in (("a", 1), ("b", 2), ("c", 3))]
    verdicts = judged(*solutions, *near)
    tests = compare_with_leader(verdicts, rank(verdicts))
    assert list(tests) == ["b", "c"]
    # Two of 2^6 signs, three times by Holm: b and c are a pair as well.
    assert [one.p_value for one in tests.values()] == pytest.approx([3 * 2 / 64] * 2)
    assert tests["b"].effect == 1 and tests["b"].runs == 7
    # Neither a unit nor where zero is changes a thing.
    moved = [replace(s, primal_bound=7.0 * s.primal_bound + 1e6) for s in (*solutions, *near)]
    again = compare_with_leader(judged(*moved), rank(judged(*moved)))
    assert {k: t.p_value for k, t in again.items()} == {k: t.p_value for k, t in tests.items()}
    once = judged(*(s for s in (*solutions, *near) if s.seed == 0))
    assert compare_with_leader(once, rank(once)) == {}, "nothing draws"


def test_seeds_of_one_instance_are_tested_against_the_best():
    solutions = [run("one", "good", float(k), seed=k) for k in range(5)]
    solutions += [run("one", "bad", 9.0 + k, seed=k) for k in range(4)]
    solutions += [run("one", "bad", None, seed=4), run("one", "fixed", 3.0)]
    best, tests = compare_on_instance(judged(*solutions)[0])
    assert best == "good" and list(tests) == ["bad"]
    assert tests["bad"].p_value == pytest.approx(2 / 252) and tests["bad"].effect == 1
    assert compare_on_instance(judged(*solutions[:5])[0]) == ("", {})


def test_no_plan_is_worse_than_the_worst_and_rounding_is_no_difference():
    solutions = [
        run(f"i{i}", name, value, seed=seed, seconds=seconds)
        for i in range(8)
        for seed in (0, 1)
        for name, value, seconds in (("a", 1.0, 1), ("b", 1.0 + 1e-13, 2), ("worst", 5.0, 3), ("none", None, 4))
    ]  # fmt: skip
    easy = [run("easy", name, 3.0, seconds=s) for name, s in (("a", 1), ("worst", 3), ("none", 4))]
    verdicts = judged(*solutions, *easy)
    tests = compare_with_leader(verdicts, rank(verdicts))
    assert tests["b"].effect == 0.0 and tests["b"].p_value == 1.0
    assert tests["worst"].effect == tests["none"].effect == 1.0
    from crosstrack.solvers.bench.draws import _shares

    assert _shares(verdicts[0]) == {"a": [0, 0], "b": [0, 0], "worst": [1, 1], "none": [2, 2]}


def test_a_rejected_run_and_a_reference_are_on_no_data_profile():
    liar = run("one", "liar", None, steps=[(0.1, -1e9, 1)], termination=Termination.REJECTED)
    honest = [run("one", "a", 0.0, steps=[(0.1, 4.0, 1), (0.2, 0.0, 9)])]
    found = profile_evaluations(judged(liar, *honest))
    assert found["a"][0].tolist() == [0, 3] and "liar" not in found


def test_a_late_run_is_not_solved_and_proofs_are_counted():
    proof = {"termination": Termination.OPTIMAL}
    found = {
        one.label: (one.solved, one.proven, one.answers[0][1])
        for one in rank(
            judged(
                run("one", "late", 1.0, seconds=11.1),
                run("one", "exact", 1.0, seconds=10.9, **proof),
                run("one", "wrong", 2.0, **proof),
            )
        )
    }
    assert found == {
        "exact": (1, 1, ""), "late": (0, 0, TOO_LATE), "wrong": (0, 0, "1e+02 % above best"),
    }  # fmt: skip
    # Building is included, because native algorithms do their preparation while solving.
    built = run("one", "built", 1.0, seconds=6.0)
    object.__setattr__(built, "seconds", {"solve": 6.0, "build": 5.5, "verify": 9.0})
    assert rank(judged(built))[0].solved == 0


def test_backends_that_estimate_different_things_have_no_best():
    one = run("one", "exponent", 0.1, model="attractor", seconds=2.0)
    two = run("one", "dimension", 0.9, model="attractor", seconds=1.0)
    none = run("one", "nothing", None, model="attractor")
    found = {s.label: (s.solved, s.best, s.answers[0][1]) for s in rank(judged(one, two, none))}
    assert found == {"dimension": (1, 0, ""), "exponent": (1, 0, ""), "nothing": (0, 0, "no plan")}
    assert list(found) == ["dimension", "exponent", "nothing"]


def test_other_options_are_another_row_and_other_limits_are_reported():
    plain = run("one", "a", 1.0)
    tuned = run(
        "one", "a", 2.0, options={"time_limit": 10.0, "backend_options": {"presolve": "off"}}
    )
    assert [one.label for one in rank(judged(plain, tuned))] == ["a", "a presolve=off"]
    assert Records((plain, tuned)).uneven == ()
    longer = run("one", "b", 1.0, options={"time_limit": 20.0})
    records = Records((plain, longer, run("two", "b", 1.0)))
    assert records.uneven == ("black-box/one",)
    assert "unequal options" in records.parts()[-1] and "3 answers on 2" in records.parts()[-1]
    # Who stays away has not solved: both are ranked on both instances.
    found = {
        one.label: (one.solved, one.instances, one.of) for one in records.standings["black-box"]
    }
    assert found == {"b": (2, 2, 2), "a": (1, 1, 2)}


def test_the_gap_over_time_counts_from_the_first_plan_on():
    # Best is 8 throughout. a: no plan until 1 s, gap 1/2 until 3 s, then none: (1 + 1) / 10.
    # b: nothing until 5 s, then a gap of 1/5: (5 + 1) / 10.
    [verdict] = judged(
        run("one", "a", 8.0, seconds=3.0, steps=[(1.0, 16.0, None), (3.0, 8.0, None)]),
        run("one", "b", 10.0, seconds=5.0),
        run("one", "c", None, seconds=1.0),
    )
    shares = {one.label: one.integral for one in rank([verdict])}
    assert shares == pytest.approx({"a": 0.2, "b": 0.6, "c": 1.0})
    # What claims more on the way than was verified in the end gains nothing by it.
    [verdict] = judged(
        run("one", "a", 8.0), run("one", "liar", 16.0, seconds=2.0, steps=[(0.0, -5.0, None)])
    )
    assert {one.label: one.integral for one in rank([verdict])}["liar"] == pytest.approx(0.5)
    nothing = judged(run("one", "c", None))
    assert [one.integral for one in rank(nothing)] == [None]


def test_a_backend_that_sees_hidden_data_is_a_reference(tmp_path):
    more = {"model": "unknown-grid", "problem": "unknown_grid"}
    records = Records(
        (
            run("one", "oracle", 1.0, **more), run("one", "a-star-replanning", 2.0, **more),
            run("two", "oracle", 1.0, **more),
        )
    )  # fmt: skip
    [standing] = records.standings["unknown-grid"]
    assert standing.label == "a-star-replanning" and standing.solved == standing.instances == 1
    from crosstrack.solvers.bench import write_page

    text = write_page(records, tmp_path / "page.html").read_text("utf-8")
    assert text.count(REFERENCE) == 2 and "a-star-replanning: solved 1 of 1 instance" in text


def test_records_as_data_and_as_text():
    records = Records(
        (
            run("one", "a", 1.0, seed=0), run("one", "b", 2.0, seed=0),
            run("two", "b", 2.0, seed=0, seconds=2.0),
        )
    )  # fmt: skip
    data = json.loads(json.dumps(records.to_dict(), allow_nan=False))
    [problem] = data["problems"]
    assert problem["problem"] == "black-box"
    first, second = problem["backends"]
    # Typically a takes (2 · 11)^(1/2) - 1 s, b (11 · 3)^(1/2) - 1: a failure has the time limit.
    assert (first["backend"], first["solved"], first["instances"]) == ("a", 1, 1)
    assert (second["backend"], second["solved"], second["instances"]) == ("b", 1, 2)
    assert first["typical"] == pytest.approx(22**0.5 - 1)
    assert {
        "typical",
        "median",
        "gap_over_time",
        "rate",
        "profile",
        "best",
        "fastest",
    } < second.keys()
    assert Records(()).to_dict()["problems"] == []


def test_plans_have_their_number_of_evaluations(tmp_path):
    model = ct.load("black-box/booth")
    found = ct.solve(model, "cma-es", seed=1, evaluations=300)
    counts = [one.evaluations for one in found.incumbents]
    assert counts == sorted(set(counts)) and counts[0] >= 1 and counts[-1] <= 300
    assert found.statistics["variables"] == 2
    back = Solution.from_dict(found.to_dict())
    assert [one.evaluations for one in back.incumbents] == counts
    # The value after so many evaluations equals that of a run limited to them.
    place = found.incumbents[-1]
    short = ct.solve(model, "cma-es", seed=1, evaluations=place.evaluations)
    assert short.primal_bound == place.objective
    # Records of before have no such key.
    data = found.to_dict()
    for one in data["incumbents"]:
        one.pop("evaluations")
    assert Solution.from_dict(data).incumbents[0].evaluations is None
    record = tmp_path / "record.jsonl"
    ct.compare([model], ["cma-es", "direct"], seed=1, evaluations=300, record=record)
    assert set(profile_evaluations(read_records(record).verdicts)) == {"cma-es", "direct"}


def test_the_page_shows_data_profiles_and_tests(tmp_path):
    from crosstrack.solvers.bench import write_page

    solutions = [
        run(
            f"i{i}", name, value if i else 1.0, seed=seed, seconds=value,
            steps=[(0.1, 9.0, 2), (0.2, value if i else 1.0, int(6 * value))],
        )
        for i in range(7)
        for name, value in (("a", 1.0), ("b", 2.0))
        for seed in range(5)
    ]  # fmt: skip
    text = write_page(Records(tuple(solutions)), tmp_path / "page.html").read_text("utf-8")
    assert 'aria-label="Data profile of black-box"' in text
    assert "Are the plans of a better, or is it chance?" in text and "Worse than a" in text
    # Six signs of one kind, and one tie.
    assert '<td>b</td><td>yes</td><td class="n" data-v="0.03125">0.031</td>' in text


def test_some_backends_on_what_all_of_them_ran(tmp_path):
    solutions = (
        run("one", "a", 1.0), run("one", "b", 2.0), run("two", "a", 1.0), run("one", "c", 1.0),
        run("one", "a", 3.0, formulation="other"),
    )  # fmt: skip
    records = Records(solutions)
    pair = records.among("a", "b")
    assert [(s.instance[-3:], s.backend) for s in pair.solutions] == [
        ("one", "a"), ("one", "b"), ("one", "a"),
    ]  # fmt: skip
    assert [s.formulation for s in records.among("a:other", "b").solutions] == [None, "other"]
    for names, words in ((["d"], "no answer of 'd'; they have a, a:other, b, c"), ([], "none")):
        with pytest.raises(InvalidData, match=words):
            records.among(*names)
    with pytest.raises(InvalidData, match="no instance was run by all of b, e"):
        Records((*solutions, run("two", "e", 1.0))).among("b", "e")
    record = tmp_path / "r.jsonl"
    record.write_text("".join(json.dumps(s.to_dict()) + "\n" for s in solutions))
    done = CliRunner().invoke(
        cli,
        [
            "report",
            str(record),
            "--output",
            str(tmp_path / "p.html"),
            "--backends",
            "a,b",
            "--json",
        ],
    )
    assert json.loads(done.stdout)["answers"] == 3


def test_plans_that_differ_by_rounding_are_both_the_best():
    [verdict] = judged(
        run("one", "a", 100.0), run("one", "b", 100.0 + 1e-13), run("one", "c", 100.01)
    )
    assert {one.label: one.best for one in rank([verdict])} == {"a": 1, "b": 1, "c": 0}


def test_a_page_does_not_replace_its_record(tmp_path):
    record = tmp_path / "r.html"
    record.write_text(json.dumps(run("one", "a", 1.0).to_dict()) + "\n")
    text = record.read_text()
    for arguments in (
        ["report", str(record), "--output", str(record)],
        ["bench", str(record), "--record", str(tmp_path / "x"), "--report", str(record)],
        ["bench", str(tmp_path / "c.toml"), "--record", str(record), "--report", str(record)],
    ):
        done = CliRunner().invoke(cli, arguments)
        assert done.exit_code != 0 and record.read_text() == text, arguments


def test_a_record_that_names_a_file_opens_none(tmp_path):
    secret = tmp_path / "secret.json"
    os.mkfifo(secret)  # opening it would block forever
    record = tmp_path / "r.jsonl"
    names = [str(secret), "a" * 5000, "nul\0here", "two  spaces"]
    rows = [{**run("x", "a", 1.0, digest=n).to_dict(), "instance": n} for n in names]
    record.write_text("".join(json.dumps(row) + "\n" for row in rows))
    page = tmp_path / "p.html"
    done = CliRunner().invoke(cli, ["report", str(record), "--output", str(page)])
    assert done.exit_code == 0, done.output
    text = page.read_text("utf-8")
    assert text.count("cannot be loaded by its name") == 4 and "\0" not in text


def test_extreme_values_and_a_model_with_two_names(tmp_path):
    from crosstrack.solvers.bench import write_page

    far = [
        run("one", "a", 1.7e308), run("one", "b", -1.7e308),
        replace(run("one", "c", 0.0), instance="black-box/renamed", dual_bound=-1.7e308),
    ]  # fmt: skip
    text = write_page(Records(tuple(far)), tmp_path / "p.html").read_text("utf-8")
    assert "3 answers of 3 backends on 1 instance of 1 problem" in text
