"""The page that shows a plan: its content, and its behaviour in a browser for every problem."""

import io
import json
import re
from functools import cache
from types import SimpleNamespace

import pytest
from browsing import open_page
from PIL import Image
from strange import examples

import crosstrack as ct
from crosstrack.errors import InvalidData
from crosstrack.models import Model, plots, problems
from crosstrack.models.plots import kit
from crosstrack.models.problems import PROBLEMS, problem_of

#: Largest page of a small example, and of the page without its data (bytes).
MOST, MOST_EMPTY = 1_000_000, 100_000
VIEWS = ((1280, "light"), (1280, "dark"), (400, "dark"), (400, "light"))
#: Problems whose controls are tried in the fast tests: curves over time, pictures without time, frames on a map.
QUICK = ("fleet_mission", "grid_path", "minimum_snap")


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """Function that returns the page of one example of a problem."""
    folder = tmp_path_factory.mktemp("view")

    @cache
    def page_of(problem):
        for text, plan in examples():
            if problem_of(json.loads(text)["model"]) == problem:
                path = folder / f"{problem}.html"
                return ct.show(Model.from_json(text), json.loads(plan), path=path, open=False)
        raise AssertionError(problem)

    return page_of


@pytest.fixture(scope="module")
def opened(browser):
    """Open a page and record its messages and requests."""
    sheets = []

    def opening(page, width=1280, scheme="light"):
        sheets.append(open_page(browser, page.path.resolve().as_uri(), width, scheme))
        return sheets[-1]

    yield opening
    for sheet in sheets:
        sheet.close()


@pytest.mark.parametrize("problem", PROBLEMS)
def test_every_problem_is_shown(opened, pages, problem):
    page = pages(problem)
    assert len(page.html.encode()) < MOST
    width, scheme = VIEWS[list(PROBLEMS).index(problem) % len(VIEWS)]
    sheet = opened(page, width, scheme)
    assert sheet.evaluate("document.documentElement.scrollWidth") <= width
    _check_colours(sheet, scheme)
    _check_hover(sheet)
    assert sheet.said == []
    assert [url for url in sheet.asked if not url.startswith("data:")] == [page.path.as_uri()]


@pytest.mark.parametrize(
    "problem",
    [
        pytest.param(problem, marks=[] if problem in QUICK else [pytest.mark.slow])
        for problem in PROBLEMS
    ],
)
def test_every_view_and_control_of_a_page_works(opened, pages, problem):
    sheet = opened(pages(problem))
    for width, scheme in VIEWS:
        sheet.set_viewport_size({"width": width, "height": 900})
        sheet.emulate_media(color_scheme=scheme)
        sheet.wait_for_timeout(60)
        assert sheet.evaluate("document.documentElement.scrollWidth") <= width
        _check_colours(sheet, scheme)
    _check_play(sheet)
    _check_keyboard(sheet)
    assert sheet.said == []


def _check_colours(sheet, scheme):
    """The first picture is drawn, on paper of the colour scheme."""
    with Image.open(io.BytesIO(sheet.locator(".stage").first.screenshot())) as picture:
        colours = sorted(picture.convert("L").getcolors(), reverse=True)
    assert len(colours) > 3
    # Most pixels are paper, except in maps that fill their axes.
    paper = sum(count for count, grey in colours if (grey > 200) == (scheme == "light"))
    assert paper > 0.3 * sum(count for count, _ in colours)


def _check_hover(sheet):
    """Every panel with points shows the values of the point under the pointer."""
    sheet.set_viewport_size({"width": 1280, "height": 900})
    sheet.wait_for_timeout(60)
    spots = sheet.evaluate(
        """() => plots.flatMap((plot, at) => plot.panels.flatMap((panel, index) => {
          const inside = panel.points().find((point) => {
            const [[x, y]] = panel.map.places(point);
            const { left, top, wide, high } = panel.map.box;
            return x >= left && x <= left + wide && y >= top && y <= top + high;
          });
          if (!inside) return [];
          return [[at, index, ...panel.map.places(inside)[0].slice(0, 2)]];
        }))"""
    )
    assert spots
    for at, index, x, y in spots:
        stage = sheet.evaluate_handle(f"plots[{at}].panels[{index}].stage").as_element()
        stage.scroll_into_view_if_needed()
        box = stage.bounding_box()
        sheet.mouse.move(box["x"] + x + 1, box["y"] + y)
        tip = stage.query_selector(".tip")
        assert tip.is_visible(), (at, index)
        assert re.search(r": [−\d]", tip.inner_text()), tip.inner_text()


def _check_play(sheet):
    """The button moves the slider and the clock, and the slider returns to the start."""
    for k in range(sheet.locator(".time").count()):
        time = sheet.locator(".time").nth(k)
        clock = time.locator(".clock").inner_text()
        time.locator(".play").click()
        slider = time.locator("input")
        sheet.wait_for_function(
            "(slider) => Number(slider.value) >= 2", arg=slider.element_handle()
        )
        assert time.locator(".clock").inner_text() != clock
        time.locator(".play").click()
        slider.fill("0")
        assert time.locator(".clock").inner_text() == clock
    if sheet.locator(".time").count():
        sheet.locator(".stage").first.focus()
        sheet.keyboard.press(" ")
        slider = sheet.locator(".time input").first
        sheet.wait_for_function("(slider) => slider.value >= 1", arg=slider.element_handle())
        sheet.keyboard.press(" ")


def _check_keyboard(sheet):
    """Tab reaches every control, whose focus is visible; keys move the picture and read values."""
    controls = "button, input, [tabindex='0']"
    total = sheet.evaluate(
        f"[...document.querySelectorAll(`{controls}`)].filter((one) => one.offsetParent).length"
    )
    reached = set()
    for _ in range(total + 2):
        sheet.keyboard.press("Tab")
        place, outline = sheet.evaluate(
            f"[[...document.querySelectorAll(`{controls}`)].indexOf(document.activeElement), "
            "getComputedStyle(document.activeElement).outlineStyle]"
        )
        if place >= 0:
            reached.add(place)
            assert outline == "solid"
    assert len(reached) == total
    sheet.locator(".stage").first.focus()
    panel = "plots.flatMap((plot) => plot.panels).find((panel) => panel.stage === document.activeElement)"
    state = f"(() => {{ const p = {panel}; return JSON.stringify([p.xlim, p.azim, p.scale]); }})()"
    first = sheet.evaluate(state)
    sheet.keyboard.press("+")
    closer = sheet.evaluate(state)
    sheet.keyboard.press("ArrowLeft")
    assert len({first, closer, sheet.evaluate(state)}) == 3
    sheet.keyboard.press("0")
    sheet.keyboard.press(".")
    assert sheet.evaluate(f"{panel}.points().length === 0 || !{panel}.tip.hidden")


def test_page_without_data_is_small(pages):
    page = pages("error_correction")
    data = re.search(r'id="scenes">(.*?)</script>', page.html, re.DOTALL)[1]
    assert len(page.html) - len(data) < MOST_EMPTY


# -- checks and legends -------------------------------------------------------------------------------


class Shown(ct.models.ErrorCorrectionRouting):
    """Model whose picture has a pin and a legend."""

    kind = "shown"


def _draw(model, plan=None):
    figure = kit.sheet(None, (5.0, 4.0))
    axes = figure.add_axes((0.1, 0.1, 0.8, 0.8))
    axes.set(xlim=(0, 4), ylim=(0, 4), xlabel="time (s)", ylabel="speed (m/s)")
    axes.plot([0, 1, 2], [0, 1, 3], gid="curve v")
    kit.legend_row(axes, [kit.key("v", color="#1f77b4")], "lower left", (0, 0))
    figure.crosstrack_pins = [SimpleNamespace(axes=axes, check="starts at A", x=2.0, y=3.0, z=None)]
    return figure


@pytest.fixture(scope="module")
def routed():
    points = [[0, 0, 0], [1.0, 0, 0], [1.5, 0, 0], [3.5, 0, 0]]
    kinds = ["A", "horizontal", "vertical", "B"]
    with pytest.MonkeyPatch.context() as patch:  # other tests list all kinds of models
        patch.setitem(problems._SESSION, "shown", Shown)
        patch.setitem(plots._REGISTERED, "shown", _draw)
        yield Shown(points, kinds, 0.3, 0.3, 0.3, 0.3, 0.3, delta=0.1, name="<b>&'\" </script>")


def test_click_on_a_check_points_at_its_place(opened, routed, tmp_path):
    sheet = opened(ct.show(routed, {"route": [0, 1, 2, 3]}, path=tmp_path / "p.html", open=False))
    button = sheet.get_by_role("button", name="starts at A")
    assert sheet.locator("button[data-pin]").count() == 1
    button.click()
    assert button.get_attribute("aria-pressed") == "true"
    assert sheet.evaluate("[plots[0].panels[0].pin.x, plots[0].panels[0].pin.y]") == [2, 3]
    assert sheet.inner_text("h1") == routed.name
    assert sheet.said == []


def test_legend_hides_and_shows_a_curve(opened, routed, tmp_path):
    sheet = opened(ct.show(routed, path=tmp_path / "p.html", open=False))
    assert sheet.locator("table").count() == 1  # checks need a plan
    button = sheet.locator(".legend button")
    points = "plots[0].panels[0].points().length"
    assert sheet.evaluate(points) == 3
    button.click()
    assert (sheet.evaluate(points), button.get_attribute("aria-pressed")) == (0, "false")
    button.click()
    assert sheet.evaluate(points) == 3


def test_drag_and_wheel_move_the_picture(opened, routed, tmp_path):
    sheet = opened(ct.show(routed, path=tmp_path / "p.html", open=False))
    limits = "plots[0].panels[0].xlim"
    first = sheet.evaluate(limits)
    box = sheet.locator(".stage").bounding_box()
    sheet.mouse.move(box["x"] + 300, box["y"] + 100)
    sheet.mouse.wheel(0, -100)
    assert sheet.evaluate(limits) == first  # the page scrolls, as the picture has no focus
    sheet.mouse.down()
    sheet.mouse.move(box["x"] + 200, box["y"] + 100)
    sheet.mouse.up()
    moved = sheet.evaluate(limits)
    assert moved[0] > first[0]
    assert moved[1] - moved[0] == pytest.approx(first[1] - first[0])
    sheet.mouse.wheel(0, -100)
    sheet.wait_for_function(f"{limits}[1] - {limits}[0] < {0.95 * (moved[1] - moved[0])}")


def test_comparison_is_side_by_side_with_equal_limits(opened, tmp_path):
    model = ct.load("error-correction/example-1")
    comparison = ct.compare([model], ["label-setting", "pulse"])
    sheet = opened(ct.show(comparison, path=tmp_path / "c.html", open=False))
    first, second = (sheet.locator(".view").nth(k).bounding_box() for k in range(2))
    assert first["y"] == second["y"]
    assert sheet.locator(".view h2").all_inner_texts() == ["label-setting", "pulse"]
    assert "AGREED" in sheet.inner_text("main")
    axes = sheet.evaluate("plots.map((plot) => plot.scene.axes.map((one) => one.ylim))")
    assert axes[0] == axes[1]
    sheet.evaluate("plots[0].panels[0].zoom(2)")
    assert sheet.evaluate("plots[0].panels[0].xlim") == sheet.evaluate("plots[1].panels[0].xlim")
    assert sheet.said == []


# -- the call -----------------------------------------------------------------------------------------


def test_solution_is_shown_in_a_notebook_with_its_picture():
    solution = ct.solve(ct.load("error-correction/example-1"), "label-setting")
    text = solution._repr_html_()
    assert text.startswith("<table>")
    assert text.count("<iframe srcdoc=") == 1
    record = ct.Solution.from_dict(solution.to_dict())
    assert "<iframe" not in record._repr_html_()
    with pytest.raises(InvalidData, match="loaded without its model"):
        ct.show(record, open=False)
    with pytest.raises(InvalidData, match="plan must be None"):
        ct.show(solution, solution.plan, open=False)


def test_solution_is_shown_on_its_own_model_only(tmp_path):
    model, other = ct.load("error-correction/example-1"), ct.load("error-correction/1")
    solution = ct.solve(model, "label-setting")
    record = ct.Solution.from_dict(solution.to_dict())
    page = ct.show(model, record, path=tmp_path / "p.html", open=False)
    assert ">label-setting</td>" in page.html
    for content in (solution, record):
        with pytest.raises(InvalidData, match=r"solution .*for digest"):
            ct.show(other, content, path=tmp_path / "q.html", open=False)


def test_failed_answer_states_no_evidence(tmp_path):
    comparison = ct.compare([ct.load("fleet/example")], ["highs", "cp-sat"], time_limit=60)
    page = ct.show(comparison, path=tmp_path / "c.html", open=False)
    failed = page.html.partition('aria-label="cp-sat')[2].partition("</section>")[0]
    assert ">failed</td>" in failed
    assert "Evidence" not in failed


def test_rewound_animation_has_the_limits_of_its_first_frame(opened, tmp_path):
    model = ct.load("unknown-grid/large")
    page = ct.show(ct.solve(model, "oracle"), path=tmp_path / "p.html", open=False)
    sheet = opened(page)
    limits = "plots[1].panels[0].xlim.map(Math.round)"
    first = sheet.evaluate(limits)
    sheet.evaluate("plots[1].seek(plots[1].scene.frames.length - 1)")
    assert sheet.evaluate(limits) != first
    sheet.evaluate("plots[1].seek(0)")
    assert sheet.evaluate(limits) == first


def test_axes_have_two_ticks_at_least(opened, pages):
    sheet = opened(pages("fleet"))
    for low, high in ((-1.3, 1.3), (-150, 150), (3, 4.4), (0.9, 19.9), (5, -5)):
        for count in (1, 2, 3):
            ticks = sheet.evaluate(f"ticksOf({low}, {high}, 0, {count})")
            assert len(ticks) >= 2, (low, high, count)


def test_infeasible_instance_is_shown_without_a_plan(tmp_path):
    model = ct.models.ErrorCorrectionRouting(
        [[0, 0, 0], [9.0, 0, 0]], ["A", "B"], 0.3, 0.3, 0.3, 0.3, 0.3, delta=0.1
    )
    solution = ct.solve(model, "label-setting")
    page = ct.show(solution, path=tmp_path / "p.html", open=False)
    assert "infeasible" in page.html
    assert "data-scene" in page.html
    assert "Checks" not in page.html.partition("<main>")[2].partition("</main>")[0]


def test_program_without_a_picture_has_its_checks(tmp_path):
    text, plan = next(
        pair for pair in examples() if "mixed-integer" in json.loads(pair[0])["model"]
    )
    page = ct.show(Model.from_json(text), json.loads(plan), path=tmp_path / "m.html", open=False)
    assert "have no picture" in page.html
    assert "Checks" in page.html
    assert str(page) == str(tmp_path / "m.html")


def test_command_writes_a_page(tmp_path):
    from click.testing import CliRunner

    from crosstrack.__main__ import cli

    solution = ct.solve(ct.load("error-correction/example-1"), "label-setting")
    record, page = solution.save(tmp_path / "s.json"), tmp_path / "page.html"
    run = CliRunner().invoke(
        cli, ["show", "error-correction/example-1", str(record), "--output", str(page), "--no-open"]
    )
    assert (run.exit_code, run.output.strip()) == (0, str(page))
    text = page.read_text()
    assert "label-setting" in text
    assert '<span class="good">verified</span>' in text
    both = CliRunner().invoke(
        cli, ["show", "error-correction/example-1", str(record), "--backend", "pulse"]
    )
    assert both.exit_code == 2
    unused = CliRunner().invoke(cli, ["show", "error-correction/example-1", "--seed", "0"])
    assert unused.exit_code == 2
    assert "need --backend" in unused.output


def test_command_rejects_its_output_before_it_solves(monkeypatch, tmp_path):
    from click.testing import CliRunner

    from crosstrack.__main__ import cli
    from crosstrack.solvers.run import dispatch

    monkeypatch.setattr(dispatch, "solve", lambda *_, **__: pytest.fail("solved"))
    words = ["show", "error-correction/example-1", "--backend", "pulse", "--output"]
    run = CliRunner().invoke(cli, [*words, str(tmp_path / "page.txt")])
    assert isinstance(run.exception, InvalidData)
    assert "must end in .html" in str(run.exception)
