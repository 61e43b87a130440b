"""A diagnosis in words that a newcomer reads: what was found and how large, where it fails, what to do next."""

import re
import shlex
from typing import Any

import numpy as np
import pytest
from pages import plain

from vispeg.cli.usage import parsed
from vispeg.core.effect import REGISTRY, Effect
from vispeg.core.params import Param
from vispeg.report.build import render
from vispeg.report.record import ROBOT, load_record
from vispeg.report.sections import COMPARE, DIAGNOSIS
from vispeg.report.sections.candidates import context as candidates
from vispeg.report.sections.candidates import powers
from vispeg.report.text import effect_words, words
from vispeg.report.text.quantities import scaled

FRICTION = {"effect": "coulomb_friction", "where": "joint4", "params": {"torque": {"value": 1.2, "unit": "N m"}}}
SCALARS = re.compile(r"<pre>(.*?)</pre>", re.S)


@pytest.mark.parametrize(
    ("row", "said"),
    [
        (FRICTION, "Coulomb friction in joint 4 (1.20 N m)"),
        ({"effect": "payload", "where": "flange", "params": {"mass": {"value": 0.6, "unit": "kg"},
          "x": {"value": 0.01}}}, "Payload at the flange (0.600 kg)"),
        ({"effect": "link_com", "where": "link7", "params": {"x": {"value": 0.002, "unit": "m"},
          "y": {"value": 0.0, "unit": "m"}}}, "Link centre of mass of link 7 (x 2.00 mm)"),
        ({"effect": "torque_gain", "where": "all", "params": {"gain": {"value": 0.93, "unit": "1"}}},
         "Torque gain everywhere (gain 0.930)"),
        ({"effect": "viscous_friction", "where": "shoulder_pan_joint"}, "Viscous friction at shoulder_pan_joint"),
        ({"effect": "of_another_installation", "where": "joint1"}, "Of another installation in joint 1"),
    ],
)  # fmt: skip
def test_an_effect_in_words(row, said):
    assert effect_words.sized(row) == said


@pytest.mark.parametrize(
    ("where", "said"),
    [
        ("joint4", "in joint 4"),
        ("link_7", "of link 7"),
        ("lwr_4_joint", "at lwr_4_joint"),
        ("l1", "at l1"),
        ("q2", "at q2"),
    ],
)
def test_a_place_keeps_a_name_that_is_no_word_and_number(where, said):
    assert effect_words.site(where) == said


def test_every_effect_has_a_title_and_a_sentence_from_its_own_file():
    for name in REGISTRY:
        assert effect_words.title(name)[0].isupper() and "_" not in effect_words.title(name)
        assert effect_words.what(name).endswith("."), name


def test_an_effect_that_is_added_brings_its_words():
    try:

        class CableDrag(Effect):
            """Constant drag of the dress pack against motion."""

            name = "cable_drag"
            family = "joint"
            params = {"torque": Param(0.0, 0.0, 5.0, "N m", start=0.5)}

        row = {"effect": "cable_drag", "where": "joint2", "params": {"torque": {"value": 0.25, "unit": "N m"}}}
        assert effect_words.sized(row) == "Cable drag in joint 2 (0.250 N m)"
        assert effect_words.what("cable_drag") == "Constant drag of the dress pack against motion."
    finally:
        del REGISTRY["cable_drag"]


def test_values_have_the_prefix_that_suits_them():
    assert scaled(0.010006, 0.009922, 0.010089, "m") == ("10.006", "9.922 to 10.089", "mm")
    assert scaled(-7.2e-7, -2.8e-6, 1.4e-6, "m") == ("−0.7", "−2.8 to 1.4", "µm")
    assert scaled(4e-5, 0.0, 2.7e-4, "m/N") == ("40", "0 to 270", "µm/N")
    assert scaled(0.0193, 0.0028, 0.02, "rad/(N m)") == ("19.3", "2.8 to 20.0", "mrad/(N m)")
    assert scaled(1.2, None, None, "N m") == ("1.200", "", "N m")
    assert scaled(None, None, None, "m")[0] == "–"


def test_the_page_says_what_where_and_how_large_before_anything_else(run, diagnosis):
    html = plain(render(load_record(run(diagnosis()))))
    order = re.findall(r'<section id="(\w+)"', html)
    assert order[:3] == ["headline", "found", "where_it_fails"]
    for sections in (DIAGNOSIS, COMPARE):
        assert sections.index("where_it_fails") < sections.index("measured_vs_model")
    (title,) = re.findall("<h1>(.*?)</h1>", html)
    assert "Payload at the flange (0.843 kg) and Coulomb friction in joint 4 (1.31 N m) explain" in title
    assert "Constant friction torque against the direction of motion." in html
    assert html.count("0.812 to 0.874") == 1, "an interval stands in one table"


def test_the_robots_picture_marks_what_was_found(run, diagnosis):
    out = run({**diagnosis(), "picture": {"file": ROBOT, "places": {"joint4": [0.4, 0.3], "flange": [0.6, 0.5]}}})
    (out / ROBOT).write_bytes(b"png")
    html = render(load_record(out))
    assert html.index('class="robot"') < html.index('<dl class="figures">')
    assert 'style="left:60.0%;top:50.0%">1<' in html and 'style="left:40.0%;top:30.0%">2<' in html


def test_marks_of_one_joint_stay_within_the_robots_picture(run, diagnosis):
    record = diagnosis()
    effects = [{**record["effects"][0], "where": "joint4"} for _ in range(30)]
    out = run({**record, "effects": effects, "picture": {"file": ROBOT, "places": {"joint4": [0.8, 0.9]}}})
    (out / ROBOT).write_bytes(b"png")
    places = re.findall(r'style="left:([\d.]+)%;top:([\d.]+)%">', render(load_record(out)))
    assert len(set(places)) == len(places) == 30
    assert all(0 <= float(x) <= 100 for place in places for x in place)


def test_screening_scores_are_on_a_logarithmic_axis(run, diagnosis):
    scores = (2.6e10, 1.3e10, 1.8e8, 4.3e5, 0.0)
    rows = [{"effect": "coulomb_friction", "where": f"joint{i}", "score": s} for i, s in enumerate(scores)]
    again = [{**rows[0], "score": 1.1e4}, {"effect": "payload", "where": "flange", "score": -60.4}]
    record = {**diagnosis(), "screening": [*again, *rows]}
    shown: Any = candidates(load_record(run(record)))
    assert shown["ends"] == ("100000", "10¹¹") and shown["screened"][0]["score"] == "2.60 × 10¹⁰"
    assert [row["effect"] for row in shown["screened"]] == [f"coulomb_friction(joint{i})" for i in range(4)], (
        "each once at its best score, and none that does not fit"
    )
    ends = [float(re.findall(r"H([\d.]+)", row["bar"])[1]) - 5.0 for row in shown["screened"]]
    share = (np.log10(scores[:4]) - 5) / 6
    assert ends == pytest.approx(list(180 * share), abs=0.1)
    assert powers(3e-7) == "3.00 × 10⁻⁷" and powers(12.5) == "12.5"


@pytest.mark.parametrize("verdict", ["adequate", "identified", "ambiguous", "unexplained"])
@pytest.mark.parametrize("command", ["demo --out x", "diagnose iiwa14 --recording a --validate c --out x"])
def test_every_command_that_a_report_proposes_is_one(run, diagnosis, verdict, command):
    """Parsed by the real parsers: `vispeg demo --recording` was none."""
    record = diagnosis(verdict)
    record["provenance"]["command"] = f"vispeg {command}"
    if verdict in ("adequate", "identified"):
        record["next_experiment"] = None
    html = render(load_record(run(record)))
    section = html[html.index('id="next_experiment"') :].partition("</section>")[0]
    lines = [shlex.split(line) for block in SCALARS.findall(section) for line in block.strip().splitlines()]
    assert len(lines) >= 2
    for _, name, *arguments in lines:
        parsed(name, arguments)


def test_what_comes_next_in_one_sentence(diagnosis):
    assert words.onward({"next_experiment": None}).startswith("No rivals are left to distinguish.")
    untold = words.onward({"next_experiment": None, "verdict": "ambiguous"})
    assert untold.startswith("These recordings cannot tell which") and "No rivals" not in untold
    assert words.onward({"next_experiment": None, "verdict": "unexplained"}).startswith("No known effect explains")
    said = words.onward(diagnosis("ambiguous"))
    assert said.startswith("Record slow triangle on joint4") and said.endswith("by an expected 9.4 sigma.")
    undecided = {
        "motion": "",
        "why": "no motion of the menu separates A from B by 3 sigma",
        "expected_separation_sigma": 0.1,
    }
    sure = {"motion": "chirp", "why": "separates A from B", "expected_separation_sigma": 795.04}
    assert words.onward({"next_experiment": sure}) == "Record chirp: it separates A from B, by an expected 795 sigma."
    assert words.onward({"next_experiment": undecided}) == "No motion of the menu separates A from B by 3 sigma."
