"""What torques call for, in the terminal and on the page."""

from pages import plain

from vispeg.report.build import write_report
from vispeg.report.text.proposal import likely


def proposed(*effects):
    joints = [{"joint": "joint4", "before": 1.2, "after": 0.02, "noise": 0.005}]
    head = {"torque": "measured", "before": 1.2, "after": 0.02, "unit": "N m RMS"}
    return {**head, "effects": list(effects), "joints": joints}


FRICTION = {
    "effect": "coulomb_friction",
    "where": "joint4",
    "params": {"torque": {"value": 1.31, "unit": "N m"}},
    "share": 0.93,
    "equals": [{"effect": "hysteresis", "where": "joint4"}],
}


def test_a_proposal_says_that_nothing_has_confirmed_it():
    said = likely(proposed(FRICTION))
    assert said.startswith("likely: Coulomb friction in joint 4 (1.31 N m) (93 %)")
    assert "1.20 N m RMS to 20.0 mN m RMS" in said and "confirms or corrects" in said
    assert likely(proposed()) == "likely: no effect; the torques measured need none"


def test_the_page_tells_what_of_it_was_confirmed(run, diagnosis):
    other = {**FRICTION, "where": "joint7", "equals": []}
    record = diagnosis() | {"proposal": proposed(FRICTION, other)}
    folder = run(record)
    text = plain(write_report(folder, overwrite=True).read_text())
    part = text[text.rindex("First proposal") :]
    part = part[part.index("<table") :]
    first, second = part.split("<tr>")[2:4]
    assert "Coulomb friction in joint 4" in first and "93 %" in first and "hysteresis" in first
    assert "<td>1.31 N m</td>" in first, "in a column of its own without brackets"
    assert "<td>no</td>" in second
    many = diagnosis() | {"proposal": proposed(*({**FRICTION, "where": f"joint{i}"} for i in range(9)))}
    assert "<details><summary>Table of 9 likely effects" in write_report(run(many), overwrite=True).read_text()
    assert "First proposal" not in write_report(run(diagnosis() | {"proposal": None}), overwrite=True).read_text()
