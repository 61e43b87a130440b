"""Switching effects on and off in the page, in a browser where there is one."""

import html
import json
import re
import subprocess

import browser
import numpy as np
import pytest

from vispeg.report.build import write_report

CHROMIUM = browser.chromium()


def choices(k=2, m=4, nj=7, points=40):
    """Errors that halve with each effect; the residual of choice i and joint j is always (10 + i) (1 + j) 1e-4 rad."""
    on = np.array([[(i >> b) & 1 for b in range(k)] for i in range(m)], bool)
    size = 1e-4 * (10 + np.arange(m))[:, None, None] * (1 + np.arange(nj)) * np.ones((m, points, nj))
    return {
        "choice/on": on,
        "choice/effect": np.array(["coulomb_friction", "payload"][:k]),
        "choice/where": np.array(["joint4", "flange"][:k]),
        "choice/rival": np.array([""] * m),
        "choice/error": 8e-3 / 2.0 ** on.sum(axis=1),
        "choice/joints": size[:, 0],
        "choice/0/time": np.arange(points) / 10.0,
        "choice/0/residual": size,
    }


def dom(page, script, tmp_path):
    """What `script` (an expression) gives in the page, by a headless browser."""
    answer = f"document.body.setAttribute('data-answer', JSON.stringify(await {script}))"
    inside = f"<script>addEventListener('load', async () => {{ {answer} }})</script>"
    path = tmp_path / "page.html"
    path.write_text(page.replace("</body>", inside + "</body>"), encoding="utf-8")
    command = [
        CHROMIUM,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--virtual-time-budget=4000",
        "--dump-dom",
        path.as_uri(),
    ]
    out = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
    return json.loads(html.unescape(re.search(r'data-answer="([^"]*)"', out)[1]))


@pytest.fixture
def page(run, diagnosis, evidence):
    """The report of an identified model with two effects that can be switched."""
    return write_report(run(diagnosis("identified"), evidence(n=600, recordings=1) | choices())).read_text("utf-8")


def test_the_page_holds_every_choice_and_needs_nothing_from_outside(page):
    data = json.loads(re.search(r"data-choices>(.*?)</script>", page, re.S)[1])
    assert len(data["rows"]) == 4 and data["start"] == 3 and [r["error"] for r in data["rows"]][0] == "8.00 mrad"
    assert "connect-src" not in page and "default-src 'none'" in page
    assert not re.search(r"<script[^>]*\ssrc|<link|@import", page)
    assert 'role="switch"' in page and "coulomb_friction(joint4)" in page


def test_a_report_without_evidence_has_no_script(run, diagnosis):
    text = write_report(run(diagnosis("identified"))).read_text("utf-8")
    assert "<script" not in text and 'id="explore"' not in text


@pytest.mark.skipif(CHROMIUM is None, reason="no browser on this machine")
def test_a_click_on_an_effect_moves_error_bar_and_residuals(page, tmp_path):
    shown = """(async () => {
      const text = (s) => document.querySelector(s).textContent, seen = [];
      const note = () => seen.push([text("[data-error]"), document.querySelector("[data-bar]").style.width,
        [...document.querySelectorAll("[data-effect]")].map((b) => b.getAttribute("aria-checked")).join(),
        document.querySelector("#explore .plots h4 .note:last-child").textContent]);
      note();
      for (const k of [0, 1, 0]) { document.querySelectorAll("[data-effect]")[k].click(); note(); }
      await new Promise((done) => setTimeout(done, 300));
      seen.push([...document.querySelectorAll("#explore .plots canvas")].map((c) =>
        c.getContext("2d").getImageData(60, 5, c.width - 60, c.height - 30).data.some((v) => v > 0)));
      for (const s of ["#explore .plots canvas", "[data-joint]:checked"])
        seen.push(document.querySelectorAll(s).length);
      return seen;
    })()"""
    all_on, one, none, other, drawn, canvases, joints = dom(page, shown, tmp_path)
    assert all_on[0] == "2.00 mrad" and all_on[2] == "true,true" and all_on[3] == "· 1.30 mrad RMS"
    assert one[0] == "4.00 mrad" and one[2] == "false,true" and none[0] == "8.00 mrad" and none[2] == "false,false"
    assert other[0] == "4.00 mrad" and other[2] == "true,false" and other[3] == "· 1.10 mrad RMS"
    widths = [float(s[1].rstrip("%")) for s in (all_on, one, none)]
    assert widths[0] < widths[1] < widths[2] == 100.0
    assert canvases == joints == 7 and drawn == [True] * 7
