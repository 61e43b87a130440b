"""The scorer on hand-made diagnoses whose marks are known."""

import json

import pytest
from cases import Case, Hide
from runner import _read, refer
from score import coverage, judge, report, wilson


def named(effect, where, rivals=(), **params):
    return {"effect": effect, "where": where, "params": params,
            "indistinguishable_from": [{"effect": e, "where": w} for e, w in rivals]}  # fmt: skip


def record(hidden, effects, verdict="identified", kind="single", errors=(1e-3, 4e-5)):
    ladder = [{"heldout_error": e, "fit_error": e} for e in errors]
    return {"case": "x/y/small", "kind": kind, "mode": "position", "hidden": hidden, "effects": effects,
            "verdict": verdict, "ladder": ladder, "floor": 2e-5, "seconds": 1.0}  # fmt: skip


TRUTH = {"effect": "coulomb_friction", "where": "joint4", "params": {"torque": 1.0}}


@pytest.mark.parametrize(
    ("effects", "exact", "right_class", "place", "extras"),
    [
        ([named("coulomb_friction", "joint4")], True, True, True, 0),
        ([named("stribeck_friction", "joint4")], False, True, True, 0),
        ([named("coulomb_friction", "joint3")], False, False, False, 1),
        ([named("load_friction", "joint4")], False, False, True, 1),
        ([named("load_friction", "joint4", [("coulomb_friction", "joint4")])], False, True, True, 0),
        ([named("coulomb_friction", "joint4"), named("payload", "flange")], False, False, False, 1),
        ([], False, False, False, 0),
    ],
)
def test_one_effect(effects, exact, right_class, place, extras):
    j = judge(record([TRUTH], effects))
    assert (j["exact"], j["right_class"], j["right_place"], j["extras"]) == (exact, right_class, place, extras)
    assert j["error_fall"] == pytest.approx(25.0)


def test_a_pair_needs_a_match_for_each_of_its_members():
    other = {"effect": "stribeck_friction", "where": "joint4", "params": {}}
    one = named("hysteresis", "joint4")
    assert not judge(record([TRUTH, other], [one], kind="pair"))["right_class"]
    assert judge(record([TRUTH, other], [one, named("coulomb_friction", "joint4")], kind="pair"))["right_class"]


def test_neighbouring_bodies_stand_in_for_each_other_but_not_distant_ones():
    truth = {"effect": "payload", "where": "flange", "params": {}}
    assert judge(record([truth], [named("link_mass", "link6")]))["right_class"]
    assert not judge(record([truth], [named("link_mass", "link4")]))["right_class"]


def test_naming_anything_for_an_unknown_is_an_invention():
    truth = {"effect": "vibration", "where": "joint4", "params": {}}
    j = judge(record([truth], [named("cogging", "joint4")], kind="unknown"))
    assert j["extras"] == 1 and j["confident"]


def test_coverage_counts_only_parameters_of_rightly_named_effects():
    inside, outside = {"value": 1.1, "low": 0.9, "high": 1.3}, {"value": 1.5, "low": 1.2, "high": 1.8}
    rows = [record([TRUTH], [named(e, "joint4", torque=t)]) for e, t in
            (("coulomb_friction", inside), ("coulomb_friction", outside), ("hysteresis", inside))]  # fmt: skip
    assert coverage(rows) == [True, False]


def test_wilson_matches_the_textbook_and_stays_inside():
    assert wilson(8, 10) == pytest.approx((0.490, 0.943), abs=1e-3)
    assert wilson(0, 40)[0] == 0.0 and wilson(0, 40)[1] == pytest.approx(0.0876, abs=1e-3)


def test_report_counts_false_alarms_and_failures():
    none = [record([], [], "adequate", "none"), record([], [named("cogging", "joint1")], "identified", "none")]
    broken = {"case": "a/b/small", "kind": "single", "hidden": [TRUTH], "effects": [], "verdict": "failed"}
    text = report([record([TRUTH], [named("coulomb_friction", "joint4")]), *none, broken])
    assert "| no effect: false alarms (an effect named) | 50 % [9, 91] of 2 |" in text
    assert "1 runs failed" in text and "| one effect: exact name and place | 100 %" in text


def test_many_effects_are_matched_one_to_one_and_partial_ones_count():
    places = [(e, f"joint{j}") for e in ("coulomb_friction", "viscous_friction") for j in range(1, 6)]
    truth = [{"effect": e, "where": w, "params": {}} for e, w in places]
    found = [named(e, w) | {"partial": True} for e, w in places[1:]] + [named("payload", "flange")]
    r = record(truth, found, "unexplained", "many")
    j = judge(r)
    assert (j["hits"], j["extras"]) == (9, 1)
    text = report([r])
    assert "90 % [60, 98] of 10" in text and "| names beyond those hidden, a case | 1.00 |" in text
    assert "| names (`one of` is one) of what was not hidden | 10 % [2, 40] of 10 |" in text
    left = r["ladder"][-1]["heldout_error"]
    text = report([r | {"oracle": {"heldout_error": left / 3.0, "floor": r["floor"]}}, r])
    assert "| ... at most twice the oracle's | 0 % [0, 79] of 1 |" in text
    assert f"| {left / 3.0 / r['floor']:.3g} | 0 of 0 |" in text, "beside what the search leaves, what the truth does"


def test_what_is_tentative_is_no_name_and_a_class_is_right_where_it_holds_the_truth():
    truth = [{"effect": "gravity_tilt", "where": "base", "params": {}}, TRUTH]
    mass = named("link_mass", "link7") | {"partial": True}
    bias = named("joint_bias", "joint1") | {"partial": True}
    wrong = judge(record(truth, [mass, bias | {"tentative": True}], "unexplained", "many"))
    assert (wrong["sure"], wrong["sure_hits"], wrong["false_names"]) == (1, 0, 1)
    mass["indistinguishable_from"] = [{"effect": "gravity_tilt", "where": "base"}]
    right = judge(record(truth, [mass, bias | {"tentative": True}], "unexplained", "many"))
    assert (right["sure"], right["classes"], right["sure_hits"], right["false_names"]) == (1, 1, 1, 0)


def test_errors_of_the_truth_are_kept_and_only_of_what_the_library_has(tmp_path):
    """One is known, one has no recordings and fails, and of one the truth is no effect of the library."""
    hidden, file = Hide("coulomb_friction", "joint4", {"torque": 1.0}), tmp_path / "r.jsonl"
    chosen = [Case(kind, (hidden,), kind, "position", 1) for kind in ("single", "many", "unknown")]
    answer = {"oracle": {"heldout_error": 3e-5, "floor": 2e-5, "params": {}}}
    file.write_text(json.dumps({"case": "single", "seed": 1} | answer) + "\n")
    first = refer(tmp_path, chosen, file, 1)
    known = [json.loads(line) for line in file.read_text().splitlines()]
    assert [k["case"] for k in known] == ["single", "many"] and "recording" in known[1]["reference_failed"]
    assert "| single | 1.5 |" in first and "| many | failed |" in first and "unknown" not in first
    assert refer(tmp_path, chosen, file, 1) == first
    assert len(file.read_text().splitlines()) == 2, "what failed is not run again"


def test_records_of_another_seed_are_not_these(tmp_path):
    lines = [{"case": "a", "verdict": "adequate", "seed": 901}, {"case": "b", "verdict": "adequate"}]
    (tmp_path / "results.jsonl").write_text("\n".join(map(json.dumps, lines)) + '\n{"case": "c", "verd')
    assert set(_read(tmp_path / "results.jsonl", {901})) == {"a", "b"}
    assert set(_read(tmp_path / "results.jsonl", {902})) == {"b"}, "what says no seed is of before it was recorded"
