"""Pages can be read by day and by night, on a laptop and on a phone: type, colours, tables, one style sheet."""

import re
import subprocess

import browser
import numpy as np
import pytest
from pages import plain

from vispeg.evaluation.gap import gap
from vispeg.report.build import render as report
from vispeg.report.drawings import palette
from vispeg.report.drawings.figures import NARROW, WIDE
from vispeg.report.gap.build import render as gap_page
from vispeg.report.gap.colours import FURTHER
from vispeg.report.page import source, templates, unbroken
from vispeg.report.record import load_record

from .conftest import example_diagnosis, example_evidence, written
from .test_gap_page import episodes

PHONE = 400 - 2 * 16  # px that a page 400 px wide leaves to a figure
BREAK = 860 - 2 * 24  # px that a wide figure has at least
SHEETS = [  # (name, what is drawn with the palette's colours)
    ("ink", "ground"), ("muted", "ground"), ("before", "ground"), ("after", "ground"), ("rival", "ground"),
    ("ink", "soft"), *((name, "ground") for name in FURTHER),
]  # fmt: skip


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """A diagnosis with everything in it, and a gap of nine policies."""
    folder = written(tmp_path_factory.mktemp("run"), example_diagnosis(), example_evidence(n=400, recordings=1, nj=2))
    found = load_record(folder)
    kinds = ("state", "depth", "rgbd", "rgb", "proprio")
    seen = [e for i, m in enumerate(2 * kinds[:4] + kinds[4:]) for e in episodes(f"{m}{i}", m, n=12)]
    return {"diagnosis": report(found), "gap": gap_page(gap(seen, worlds=["S", "V", "P", "VP"]))}


def drawings(html):
    return re.findall(r'<svg class="(wide|narrow)"[^>]*viewBox="0 0 ([\d.]+) [^>]*>(.*?)</svg>', html, re.S)


def test_type_is_12_px_high_wherever_a_figure_is_shown(pages):
    for html in pages.values():
        found = drawings(html)
        assert {kind for kind, *_ in found} == {"wide", "narrow"}
        for kind, width, body in found:
            scale = (PHONE if kind == "narrow" else BREAK) / float(width)
            sizes = [float(s) * scale for s in re.findall(r"font(?:-size)?: (?:[\w]+ )?([\d.]+)px", body)]
            assert sizes and min(sizes) >= 12, (kind, min(sizes))
    assert WIDE.width > NARROW.width


def test_no_line_ends_between_a_number_and_its_unit(pages):
    """In the text of a page; data, drawings and commands stay as they are."""
    for html in pages.values():
        text = re.sub(r"<(script|style|svg|pre|code)\b.*?</\1>", "", html, flags=re.S)
        assert not re.findall(r">[^<]*\d (?:[mµ]?rad|N|mm|m|s|kg|%|×)(?:\W[^<]*)?<", text)
        assert re.search("\\d\N{NO-BREAK SPACE}(?:[mµ]?rad|%)", text)
    said = "<p>from 30.2 mrad RMS, 7.1 × of 5 N m s/rad; 3 more, 2 metres</p><code>5 m</code><script>'5 m'</script>"
    joined = unbroken(said)
    assert plain(joined) == said and unbroken(joined) == joined
    assert [part for part in re.split("[ >]", joined) if "\N{NO-BREAK SPACE}" in part] == [
        "30.2\N{NO-BREAK SPACE}mrad\N{NO-BREAK SPACE}RMS,",
        "7.1\N{NO-BREAK SPACE}×",
        "5\N{NO-BREAK SPACE}N\N{NO-BREAK SPACE}m\N{NO-BREAK SPACE}s/rad;",
    ]


def test_every_colour_of_a_figure_has_its_colour_of_the_night(pages):
    """White type in bars, black type beside them: no colour is left that one of the two grounds would swallow."""
    for html in pages.values():
        for _, _, body in drawings(html):
            cells = re.sub(r'<g id="[^"]*QuadMesh.*?</g>', "", body, flags=re.S)  # turned as a whole by a filter
            left = set(re.findall(r'(?:fill|stroke)(?:: ?|=")(#[0-9a-f]{6}|black|white)', cells))
            assert left <= {"#fefefe"}, left
        assert "@media screen and (prefers-color-scheme:dark)" in html and 'name="color-scheme"' in html
        names = set(re.findall(r"var\(--([\w-]+)\)", html))
        assert names <= set(palette.COLOURS), names - set(palette.COLOURS)


def luminance(colour):
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize(("name", "on"), SHEETS)
def test_contrast_by_day_and_by_night(name, on):
    """WCAG 2.1: 4.5 for text, 3 for large text and for what is drawn."""
    for first, second in zip(palette.COLOURS[name], palette.COLOURS[on], strict=True):
        a, b = sorted((luminance(first), luminance(second)))
        assert (b + 0.05) / (a + 0.05) >= (4.5 if name in ("ink", "muted") else 3.0)


def test_colours_of_the_day_are_all_different():
    days = [day for day, _ in palette.COLOURS.values()]
    assert len(set(days)) == len(days), "one that is not could not be told from the other at night"


def test_no_table_can_make_the_page_wider(pages):
    for html in pages.values():
        assert html.count("<table") == html.count('<div class="scroll" tabindex="0"><table') > 3
        assert ".scroll { overflow-x: auto" in html and "scroll sideways" in html


def test_every_report_has_the_one_style_sheet():
    for name in templates().list_templates(extensions=["j2"]):
        source = templates().loader.get_source(templates(), name)[0]
        assert name == "report.html.j2" or "<style" not in source, name


@pytest.mark.skipif(browser.chromium() is None, reason="needs Chromium")
def test_paper_has_what_is_folded_away_on_the_screen(tmp_path):
    """As many sheets with a closed table as with an open one, and more than without it."""
    sheets = {}
    for name, body in {
        "closed": '<details><summary>Table</summary><div style="height: 3000px">rows</div></details>',
        "open": '<details open><summary>Table</summary><div style="height: 3000px">rows</div></details>',
        "none": "<p>no table</p>",
    }.items():
        page, paper = tmp_path / f"{name}.html", tmp_path / f"{name}.pdf"
        page.write_text(f"<!doctype html><style>{source('report.css')}</style><main>{body}</main>", encoding="utf-8")
        command = [browser.chromium(), "--headless", "--no-sandbox", "--disable-gpu", f"--print-to-pdf={paper}"]
        subprocess.run([*command, page.as_uri()], capture_output=True, timeout=240, check=True)
        sheets[name] = len(re.findall(rb"/Type\s*/Page\b", paper.read_bytes()))
    assert sheets["closed"] == sheets["open"] > sheets["none"] == 1, sheets


@pytest.mark.skipif(browser.chromium() is None, reason="needs Chromium")
def test_a_column_of_a_heat_map_has_its_name_above_it(tmp_path):
    page = tmp_path / "heat.html"
    page.write_text(
        f"<!doctype html><style>{source('report.css')}</style><table class='heat' style='width: 700px'><thead><tr><th>"
        "</th><th scope='col'>S</th></tr></thead><tr><th scope='row'>mine</th><td>-54 to 54</td></tr></table><script>"
        "const middle = (tag) => { const range = document.createRange();"
        "range.selectNodeContents(document.querySelector(tag)); const box = range.getBoundingClientRect();"
        "return box.left + box.width / 2 }; document.title = middle('th[scope=col]') - middle('td')</script>",
        encoding="utf-8",
    )
    command = [browser.chromium(), "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom", page.as_uri()]
    shown = subprocess.run(command, capture_output=True, text=True, timeout=240, check=True).stdout
    assert abs(float(re.findall("<title>(.*)</title>", shown)[0])) < 2


PAPER = 688  # px between the margins of A4


@pytest.mark.skipif(browser.chromium() is None, reason="needs Chromium")
def test_no_table_is_wider_than_paper(tmp_path):
    """A browser shrinks every page to the widest table, and cuts off what is wider still."""
    library = pytest.importorskip("playwright.sync_api", reason="the browser's driver is not installed")
    names = [f"manipulator_joint{i + 1}" for i in range(7)]
    record, arrays = example_diagnosis("unexplained"), example_evidence(n=400, recordings=1)
    torque = {"value": -0.159, "low": -20.0, "high": 0.108, "unit": "N m"}
    rivals = [{"effect": "cable_spring", "where": name} for name in names[:2]]
    both = {"effect": "hysteresis", "params": {"torque": torque, "stiffness": {**torque, "unit": "N m/rad"}}}
    both |= {"indistinguishable_from": rivals, "explains": 0.113, "without": 4.4, "share": 0.3, "equals": rivals}
    record["effects"] = [{**both, "where": names[i % 7]} for i in range(12)]
    matrix = [[float(i == j) for j in range(24)] for i in range(24)]
    record["correlations"] = {"labels": [f"hysteresis({names[0]}).p{i}" for i in range(24)], "matrix": matrix}
    record["proposal"] = {"torque": "measured", "unit": "N m RMS", "before": 1.0, "after": 0.1}
    record["proposal"] |= {"effects": record["effects"], "joints": []}
    page = written(tmp_path, record, {**arrays, "joints": np.array(names)}) / "report.html"
    page.write_text(report(load_record(page.parent)), encoding="utf-8")
    path = browser.chromium()
    with library.sync_playwright() as driver:
        window = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        sheet = window.new_page(viewport={"width": PAPER, "height": 970})
        sheet.emulate_media(media="print")
        sheet.goto(page.as_uri())
        assert sheet.get_by_text("RMS residual of every held-out recording").is_visible()
        assert sheet.evaluate("document.documentElement.scrollWidth") <= PAPER
        window.close()


@pytest.mark.skipif(browser.chromium() is None, reason="needs Chromium")
def test_ticks_of_a_zoomed_chart_differ(tmp_path):
    """Three digits were too few: 12.5 s, 12.5 s, 12.5 s."""
    library = pytest.importorskip("playwright.sync_api", reason="the browser's driver is not installed")
    evidence = example_evidence(n=6000, recordings=1, nj=1)
    page = written(tmp_path, example_diagnosis(), evidence) / "report.html"
    page.write_text(report(load_record(page.parent)), encoding="utf-8")
    path = browser.chromium()
    with library.sync_playwright() as driver:
        window = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        sheet = window.new_page()
        sheet.add_init_script("""window.texts = [];
            const canvas = CanvasRenderingContext2D.prototype, draw = canvas.fillText;
            canvas.fillText = function (text, ...at) { texts.push(text); return draw.call(this, text, ...at); };""")
        sheet.goto(page.as_uri())
        sheet.locator("[data-traces] .plots").focus()
        sheet.keyboard.press("End")
        for _ in range(6):
            sheet.keyboard.press("+")
        sheet.wait_for_timeout(300)
        sheet.evaluate("texts.length = 0")
        sheet.keyboard.press("+")
        sheet.wait_for_function("() => texts.some((text) => text.endsWith(' s'))")
        ticks = {text for text in sheet.evaluate("texts") if text.endswith(" s")}
        window.close()
    assert len(ticks) >= 4, ticks  # of a chart half as wide as the window; 11.9 and 12 before
