"""The report of a campaign: its content, and its behaviour in a browser."""

import re
import shlex
import time
from pathlib import Path

import pytest
from bench.answers import EVIL, answer, campaign, exact, write
from browsing import open_page

from crosstrack.solvers.bench import read_records, write_page

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def page_file(tmp_path_factory):
    return write(
        tmp_path_factory.mktemp("page"), campaign(), title=f"Campaign {EVIL}",
        command="crosstrack bench campaign.toml --record campaign.jsonl",
    )  # fmt: skip


@pytest.fixture(scope="module")
def opened(browser, page_file):
    """Returns a page of a width and a colour scheme, with all that it complained of and asked for."""
    pages = []

    def opening(width=1280, scheme="light", file=page_file):
        pages.append(open_page(browser, file.as_uri(), width, scheme))
        return pages[-1]

    yield opening
    for page in pages:
        page.close()


def open_details(page):
    """Open all details, and wait for the content that is drawn when they open."""
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true })")
    for details in page.locator("details[data-instance]").all():
        details.locator("p").first.wait_for(state="attached")


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
    open_details(page)
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
    assert re.fullmatch(r"(8|58) of 10,000 rows shown", page.inner_text(shown))
    assert page.evaluate("document.querySelectorAll('*').length") < 1500
    page.fill("[name=text]", "b3")
    assert page.inner_text("[data-count]") == "1,429 of 10,000 answers match"
    box = page.locator('[data-problem="grid-path"] .tall')
    for row in (50, 100):  # the end of the list in view draws 50 more rows
        box.press("End")
        box.locator("tbody tr").nth(row).wait_for()
    box.locator(".more").click()
    assert page.inner_text(shown) == "1,429 of 10,000 rows shown"
    assert set(column(page, "grid-path", "Backend")) == {"b3"}


@pytest.mark.parametrize("width", [1280, 400])
def test_page_itself_never_scrolls_sideways(opened, width):
    page = opened(width)
    open_details(page)
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
    open_details(page)
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
    open_details(page)
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


def test_an_instance_opens_by_keyboard_and_is_drawn_once(opened):
    page = opened()
    details = page.locator('[data-problem="fleet"] details')
    assert details.locator("svg").count() == 0
    for _ in range(3):
        details.locator("summary").press("Enter")
    details.locator("svg").wait_for()
    assert details.locator("svg").count() == 1


def test_summary_is_readable_without_scripts(browser, page_file):
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(page_file.as_uri())
    assert "draws single answers" in page.inner_text("noscript")
    assert not page.is_visible(".filters")
    rows = page.locator('[data-problem="grid-path"] table.plain tbody tr')
    assert rows.first.locator("td").first.inner_text() == "a-star"
    assert page.is_visible("#contradictions pre")
    context.close()


def test_page_of_a_large_campaign_takes_few_seconds_and_nodes(opened, tmp_path):
    """The campaign of the site, with all problems and 6194 answers. Measured: 2.7 s and 8,000 nodes."""
    begin = time.process_time()
    records = read_records(DOCS / "campaign" / "records.jsonl")
    file = write_page(records, tmp_path / "page.html")
    assert time.process_time() - begin < 10
    page = opened(file=file)
    answers = len(records.solutions)
    assert answers > 6000
    assert page.inner_text("[data-count]") == f"{answers:,} of {answers:,} answers match"
    assert page.evaluate("document.querySelectorAll('*').length") < 10_000
    assert page.said == []


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
    open_details(page)
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
