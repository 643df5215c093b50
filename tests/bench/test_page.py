"""The report of a campaign: its content, and its behaviour in a browser."""

import re
import shlex
import shutil
import time
from types import SimpleNamespace

import pytest

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import ErrorCorrectionRouting
from crosstrack.models.verification import Check, Verification
from crosstrack.solvers.bench import write_page
from crosstrack.solvers.bench.chart import Series, draw_steps
from crosstrack.solvers.bench.pictures import draw_plan
from crosstrack.solvers.bench.standing import rank
from crosstrack.solvers.contract.enums import Guarantee, Limit, Termination
from crosstrack.solvers.contract.solution import Incumbent, Solution
from crosstrack.solvers.contract.verdict import judge

EVIL = "<script>window.hit=1</script>\"'><img src=x onerror=window.hit=1>&amp;"
GOOD = Verification(
    objective=1.0, checks=(Check("length", "(1)", 2e-7, "m", 1e-6, "edge 3", rounding=1e-9),)
)  # fmt: skip


def answer(instance, backend, objective, seconds, *, kind="grid-path", **more):
    """An answer whose plan was verified; no plan where `objective` is None."""
    given = {
        "model": kind, "instance": instance, "digest": instance.encode().hex(), "backend": backend,
        "termination": Termination.NO_SOLUTION if objective is None else Termination.FEASIBLE,
        "guarantee": Guarantee.HEURISTIC, "primal_bound": objective, "version": "0.1.0",
        "stored_plan": None if objective is None else [0, 1], "backend_version": "1.2",
        "seconds": {"solve": seconds, "build": seconds / 10, "total": 2 * seconds},
        "options": {"time_limit": 10.0, "gap": 1e-6, "tolerance": 1e-6},
    }  # fmt: skip
    return Solution(**{**given, **more})


def exact(instance, backend, objective, seconds, **more):
    return answer(
        instance, backend, objective, seconds, guarantee=Guarantee.EXACT,
        **{
            "dual_bound": objective, "termination": Termination.OPTIMAL,
            "verification": Verification(objective=objective, checks=()), **more,
        },
    )  # fmt: skip


def campaign():
    """Three problems: one with agreement, one with a contradiction, one that is open."""
    steps = tuple(Incumbent(10.0**-i, 5.0 + i) for i in range(3, 0, -1))
    clean = Verification(objective=9.0, checks=())
    return [
        exact("grid-path/one", "a-star", 10.0, 0.5),
        answer("grid-path/one", "greedy", 12.0, 0.01),
        exact("grid-path/two", "a-star", 9.5, 2.0, message="slow"),
        answer("grid-path/two", "greedy", 9.5, 0.02, incumbents=steps),
        answer("grid-path/two", "broken", None, 0.1, termination=Termination.FAILED, message=EVIL),
        exact("fleet/wrong", "prover", 11.0, 1.0, kind="fleet", formulation="arcs", seed=3),
        answer("fleet/wrong", "finder", 9.0, 3.0, kind="fleet", verification=clean),
        answer("fleet/wrong", "near", 9.5, 3.0, kind="fleet", verification=GOOD),
        *(
            answer(EVIL, f"swarm-{i}", 1.0 + i, 0.1 * (i + 1), kind="black-box", seed=s, limit=Limit.EVALUATIONS)
            for i in range(9)
            for s in range(2)
        ),
    ]  # fmt: skip


def write(folder, solutions, **more):
    return write_page(SimpleNamespace(solutions=tuple(solutions)), folder / "page.html", **more)


@pytest.fixture(scope="module")
def page_file(tmp_path_factory):
    return write(
        tmp_path_factory.mktemp("page"), campaign(), title=f"Campaign {EVIL}",
        command="crosstrack bench campaign.toml --record campaign.jsonl",
    )  # fmt: skip


@pytest.fixture(scope="module")
def browser():
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    program = shutil.which("chromium")
    if program is None:
        pytest.skip("chromium is not installed")
    with sync_api.sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield found
        found.close()


@pytest.fixture(scope="module")
def opened(browser, page_file):
    """Returns a page of a width and a colour scheme, with all that it complained of and asked for."""
    pages = []

    def open_page(width=1280, scheme="light", file=page_file):
        page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
        pages.append(page)
        page.said, page.asked = [], []
        page.on("console", lambda message: page.said.append(message.text))
        page.on("pageerror", lambda error: page.said.append(str(error)))
        page.on("request", lambda request: page.asked.append(request.url))
        page.goto(file.as_uri())
        return page

    yield open_page
    for page in pages:
        page.close()


def column(page, problem, head):
    """The shown cells of a column of a problem's answers."""
    return page.evaluate(
        """([problem, head]) => {
          const table = document.querySelector(`[data-problem="${problem}"] table.answers`);
          const heads = [...table.tHead.rows[0].cells].map((one) => one.innerText.trim());
          const at = heads.findIndex((text) => text.startsWith(head));
          return [...table.tBodies[0].rows].map((row) => row.cells[at].innerText);
        }""",
        [problem, head],
    )


def test_page_requests_nothing_and_logs_no_error(opened, page_file):
    page = opened()
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true })")
    assert page.said == []
    assert [url for url in page.asked if not url.startswith("data:")] == [page_file.as_uri()]


def test_text_from_outside_stays_text(opened):
    page = opened()
    assert page.evaluate("window.hit") is None
    assert EVIL in page.title()
    assert EVIL in page.inner_text("h1")
    assert EVIL in column(page, "black-box", "Instance")
    assert page.locator("main img").count() == 0  # none was drawn, and none got in as text


def test_the_verdict_is_the_first_sentence(opened):
    lead = opened().inner_text(".lead")
    assert lead.startswith("26 answers of 15 backends on 4 instances of 3 problems.")
    assert "On 2 the answers agree, on 1 they contradict one another, and 1 is open" in lead


def test_columns_sort_by_number_or_text_with_empty_cells_last(opened):
    page = opened()
    section = page.locator('[data-problem="grid-path"]')
    head = section.locator("table.answers th", has_text="Objective")
    head.locator("button").click()
    assert head.get_attribute("aria-sort") == "ascending"
    assert column(page, "grid-path", "Objective") == [
        "9.50000",
        "9.50000",
        "10.0000",
        "12.0000",
        "",
    ]
    head.locator("button").press("Enter")  # the keyboard does what the mouse does
    assert head.get_attribute("aria-sort") == "descending"
    assert column(page, "grid-path", "Objective") == [
        "12.0000",
        "10.0000",
        "9.50000",
        "9.50000",
        "",
    ]
    # 10 ms, 20 ms and 0.1 s are numbers, whatever unit they are shown in.
    section.locator("table.answers th", has_text="Solving").locator("button").click()
    assert head.get_attribute("aria-sort") == "none"
    assert column(page, "grid-path", "Backend") == [
        "greedy",
        "greedy",
        "broken",
        "a-star",
        "a-star",
    ]
    section.locator("table.answers th", has_text="Backend").locator("button").click()
    assert column(page, "grid-path", "Backend") == [
        "a-star",
        "a-star",
        "broken",
        "greedy",
        "greedy",
    ]


def test_filters_narrow_the_rows_and_count_them(opened):
    page = opened()
    count = page.locator("[data-count]")
    assert count.inner_text() == "26 of 26 answers match"
    page.fill("[name=text]", "SLOW")
    assert count.inner_text() == "1 of 26 answers match"
    assert column(page, "grid-path", "Instance") == ["grid-path/two"]
    instances = page.locator('[data-problem="grid-path"] details[data-instance]:visible')
    assert instances.evaluate_all("all => all.map(one => one.dataset.instance)") == [
        "grid-path/two"
    ]
    page.fill("[name=text]", "")
    page.select_option("[name=backend]", "greedy")
    assert column(page, "grid-path", "Backend") == ["greedy", "greedy"]
    assert page.inner_text('[data-problem="grid-path"] [data-shown]') == "2 of 5 rows shown"
    page.select_option("[name=problem]", "black-box")
    assert count.inner_text() == "0 of 26 answers match"
    assert not page.is_visible('[data-problem="grid-path"]')
    page.click(".filters button")
    # The page's policy forbids evaluated strings, so the text is polled from outside.
    until = time.monotonic() + 30
    while not count.inner_text().startswith("26 of") and time.monotonic() < until:
        page.wait_for_timeout(50)
    assert count.inner_text() == "26 of 26 answers match"
    page.select_option("[name=ended]", "feasible, evaluations limit")
    assert count.inner_text() == "18 of 26 answers match"


def test_ten_thousand_rows_filter_and_more_come_on_demand(opened, tmp_path):
    many = [answer("grid-path/one", f"b{i % 7}", 1.0 + i, 0.1) for i in range(10_000)]
    page = opened(file=write(tmp_path, many))
    shown = '[data-problem="grid-path"] [data-shown]'
    assert page.inner_text(shown) == "200 of 10,000 rows shown"
    page.fill("[name=text]", "b3")
    assert page.inner_text("[data-count]") == "1,429 of 10,000 answers match"
    page.click("[data-more]")
    assert page.inner_text(shown) == "1,429 of 10,000 rows shown"
    assert set(column(page, "grid-path", "Backend")) == {"b3"}


@pytest.mark.parametrize("width", [1280, 400])
def test_page_itself_never_scrolls_sideways(opened, width):
    page = opened(width)
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true })")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    table = "document.querySelector('table.answers').parentElement"
    if width == 400:  # wider content scrolls inside its own box, which the keyboard reaches
        assert page.evaluate(f"{table}.scrollWidth > {table}.clientWidth")
        assert page.evaluate(f"{table}.tabIndex") == 0


#: The least contrast (WCAG 2.1, relative luminance) of what `selector` matches, on its ground.
CONTRAST = """([selector, property]) => {
  const parts = (text) => text.match(/[0-9.]+/g).map(Number);
  const light = (rgb) => rgb.slice(0, 3).map((v) => v / 255)
    .map((v) => (v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const ground = (one) => {
    for (let at = one; at; at = at.parentElement) {
      const found = parts(getComputedStyle(at).backgroundColor);
      if (found.length < 4 || found[3] > 0) return found;
    }
    return [255, 255, 255];
  };
  const found = [...document.querySelectorAll(selector)].filter((one) => one.getClientRects().length)
    .filter((one) => property !== "color" || [...one.childNodes].some((n) => n.nodeType === 3 && n.data.trim()))
    .map((one) => {
      const pair = [light(parts(getComputedStyle(one)[property])), light(ground(one))].sort((a, b) => b - a);
      return (pair[0] + 0.05) / (pair[1] + 0.05);
    });
  return [found.length, Math.min(...found)];
}"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_and_lines_have_contrast_in_light_and_dark(opened, scheme):
    page = opened(scheme=scheme)
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true })")
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (ground == "rgb(255, 255, 255)") == (scheme == "light")
    texts, least = page.evaluate(CONTRAST, ["main *", "color"])
    assert texts > 300
    assert least >= 4.5
    lines, least = page.evaluate(CONTRAST, [".chart .line, .chart .mark", "stroke"])
    assert lines > 50
    assert least >= 3.0
    _, least = page.evaluate(CONTRAST, [".chart text", "fill"])
    assert least >= 4.5


def test_curves_are_distinguishable_without_colour(opened):
    page = opened()
    charts = page.evaluate(
        """[...document.querySelectorAll("svg.chart")].map((chart) => [
          [...chart.querySelectorAll("g[data-dash]:not(.bound)")].map((g) => g.dataset.dash + "|" + g.dataset.marker),
          [...chart.querySelectorAll("text")].map((text) => text.textContent)])"""
    )
    assert max(len(looks) for looks, _ in charts) == 9
    for looks, texts in charts:
        assert len(set(looks)) == len(looks)
        assert len(texts) > len(looks)  # each has a label beside its end
    assert any({f"swarm-{i}" for i in range(9)} <= set(texts) for _, texts in charts)


def test_printing_omits_interactive_elements(opened):
    page = opened()
    page.emulate_media(media="print")
    assert not page.is_visible(".filters")
    assert (
        page.evaluate("getComputedStyle(document.querySelector('.scroll')).overflowX") == "visible"
    )


def test_contradictions_come_with_evidence_and_a_command_that_repeats_them(opened):
    from crosstrack.cli.runs import compare

    page = opened()
    text = page.inner_text("#contradictions")
    assert (
        "prover:arcs claims that no plan is below 11, but finder has a verified plan of 9" in text
    )
    rows = page.locator("#contradictions tbody tr").all_inner_texts()
    assert [row.split("\t")[0] for row in rows] == ["prover:arcs", "finder"]
    line = shlex.split(page.inner_text("#contradictions pre"))
    assert line[:3] == ["crosstrack", "compare", "fleet/wrong"]
    asked = compare.make_context("compare", line[2:]).params
    assert asked["names"] == "prover:arcs,finder"
    assert (asked["time_limit"], asked["gap"], asked["seed"]) == (10.0, 1e-6, 3)


def test_repeats_show_quartiles(opened):
    page = opened()
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true })")
    row = page.locator(
        '[data-problem="black-box"] details tbody tr', has_text="swarm-0"
    ).inner_text()
    assert row.split("\t")[:5] == ["swarm-0", "2 of 2 runs", *["1.00000"] * 3]


def test_conditions_show_the_machine_of_the_comparison(opened):
    text = opened().inner_text("#measured")
    for word in ("Time limit (s)\t10", "Requested relative gap\t1e-06", "a-star 1.2", "1 to 2"):
        assert word in text
    assert "Machine\tnot recorded" in text


def test_conditions_name_the_machine_and_the_range_of_its_load(tmp_path):
    own = campaign()
    for i, one in enumerate(own):
        facts = {"system": "Linux <6>", "load": i / 10, "backends": {"highs": "1.2"}}
        object.__setattr__(one, "environment", facts)
    text = write(tmp_path, own).read_text("utf-8")
    assert "System</th><td class='long'>Linux &lt;6&gt;</td>" in text
    assert "Load</th><td class='long'>0 to 2.5</td>" in text
    assert "not recorded" not in text


def test_instances_of_one_name_with_other_data_stay_apart(tmp_path):
    twins = [exact("grid-path/one", "a", 1.0 + i, 0.1, digest=f"{i:064}") for i in range(2)]
    text = write(tmp_path, twins).read_text("utf-8")
    assert "2 answers of 1 backend on 2 instances of 1 problem" in text
    assert "contradict</span>:" not in text  # the optimum of one says nothing of the other's


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


def test_nothing_to_show_and_no_place_to_write_raise(tmp_path):
    with pytest.raises(InvalidData, match="records must hold an answer"):
        write(tmp_path, [])
    with pytest.raises(InvalidData):
        write_page(SimpleNamespace(solutions=campaign()), tmp_path / "page.txt")
