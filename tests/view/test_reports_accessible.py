"""Reports in a real browser: no serious finding of axe-core, in the light and in the dark, on a laptop and on a phone.

axe-core 4.14.1 (Deque Systems, MPL-2.0) stands in vendored/, as it is published on npm.
"""

from pathlib import Path

import pytest

AXE = Path(__file__).parent / "vendored" / "axe.min.js"
GRAVE = ("serious", "critical")
RUN = """async () => (await axe.run()).violations.map(v =>
    ({id: v.id, impact: v.impact, nodes: v.nodes.map(n => n.html.slice(0, 160))}))"""


@pytest.mark.parametrize("name", ["comparison", "diagnosis", "fit", "gap", "check"])
@pytest.mark.parametrize(("scheme", "width"), [("light", 1440), ("dark", 400)])
def test_axe_has_no_serious_finding(chromium, reports, name, scheme, width):
    page = chromium.new_page(viewport={"width": width, "height": 800}, color_scheme=scheme)
    requests = []
    page.on("request", lambda request: requests.append(request.url))
    page.goto(reports[name].as_uri())
    page.wait_for_timeout(300)
    assert all(url.startswith(("file:", "data:")) for url in requests)
    page.add_script_tag(path=AXE)
    found = [v for v in page.evaluate(RUN) if v["impact"] in GRAVE]
    page.close()
    assert not found, found
