"""The shares in docs/results.md are those of the records that lie beside it."""

import json
import re
from pathlib import Path

import contact_score
import pytest
import score

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "results.md").read_text(encoding="utf-8")


def records(name: str) -> list[dict]:
    return [json.loads(line) for line in (DOCS / "results" / name).read_text(encoding="utf-8").splitlines()]


def stated(section: str) -> list[list[str]]:
    """(measure, result, goal) of the first table with goals in a section."""
    text = re.split(r"^#+ ", PAGE.split(f"# {section}\n")[1], maxsplit=1, flags=re.MULTILINE)[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("|")]
    return [row for row in rows if len(row) == 3]


def scored(report: str) -> dict[str, str]:
    return dict(re.findall(r"^\| (.+?) \| (.+?) +\|$", report, re.MULTILINE))


@pytest.mark.parametrize(
    ("section", "file", "report", "least"),
    [
        ("Hidden effects", "hidden_effects.jsonl", score.report, 3),
        ("Hidden contact", "hidden_contact.jsonl", contact_score.report, 10),
    ],
)
def test_a_row_of_the_page_is_what_its_records_score(section, file, report, least):
    of_records, same = scored(report(records(file))), 0
    for measure, result, _ in stated(section):
        if measure in of_records and "%" in result:
            assert result == of_records[measure], measure
            same += 1
    assert same >= least


def test_many_effects_are_counted_as_stated():
    rows = records("many_effects.jsonl")
    known = [r for r in rows if not r["of_no_library"]]
    stating = dict(row[:2] for row in stated("Many effects at once"))
    named = [i < r["named"] for r in known for i in range(r["hidden"])]
    assert stating["effects whose class and place are named"] == f"{score.share(named)}, in {len(known)} cases"
    assert stating["false names"] == f"none in {len(rows)} cases" and not sum(r["false"] for r in rows)
    strange = [r["verdict"] for r in rows if r["of_no_library"]]
    assert (
        stating["something of no library beside the others"]
        == f"{strange.count('unexplained')} of {len(strange)} `unexplained`"
    )
    cost = sorted(r["cpu_s"] for r in rows)
    assert stating["processor time"].startswith(f"median {cost[len(cost) // 2]} s, greatest {cost[-1]} s")
