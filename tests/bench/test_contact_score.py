"""The score of contact diagnoses: twins count as the class, inventions and silence do not."""

import json

import pytest
from contact_cases import Case
from contact_plant import Truth
from contact_runner import finished, run
from contact_score import judge, plain_fall, references, report, values

FRICTION = {"effect": "contact_friction", "where": "peg", "params": {"scale": 1.7}}
LADDER = [{"heldout_error": 5.0}, {"heldout_error": 1.0}]


def named(effect, where, **params):
    found = {k: {"value": v, "low": v - 0.1, "high": v + 0.1} for k, v in params.items()}
    return {"effect": effect, "where": where, "params": found, "indistinguishable_from": []}


def record(hidden, effects, verdict="identified", kind="single"):
    return {"case": "x", "kind": kind, "hidden": hidden, "effects": effects, "verdict": verdict, "ladder": LADDER}


def test_a_right_name_alone_is_right():
    right = judge(record([FRICTION], [named("contact_friction", "peg", scale=1.65)]))
    assert right["right"] and right["exact"] and right["fall"] == 5.0
    more = judge(record([FRICTION], [named("contact_friction", "peg", scale=1.65), named("tool_mass", "gripper")]))
    assert not more["right"] and more["extras"] == 1 and more["confident"]
    assert not judge(record([FRICTION], [], "adequate"))["right"]
    assert not judge(record([FRICTION], [named("contact_friction", "peg", scale=1.6)], "unexplained"))["right"]


def test_a_twin_is_the_class_and_not_the_name():
    hole = {"effect": "hole_offset", "where": "fixture", "params": {"x": 1e-3}}
    twin = judge(record([hole], [named("grip_pose", "peg", x=-1e-3)]))
    assert twin["right"] and not twin["exact"]
    assert not judge(record([hole], [named("contact_friction", "peg", scale=2.0)]))["right"]


def test_intervals_are_of_exact_names_only():
    good, other = record([FRICTION], [named("contact_friction", "peg", scale=1.65)]), record([FRICTION], [])
    ((effect, name, true, found, low, high),) = values([good, other])
    assert (effect, name, true, found) == ("contact_friction", "scale", 1.7, 1.65) and low <= true <= high
    text = report([good, other, record([], [], "adequate", "none"), {**other, "verdict": "failed"}])
    assert "| no effect: given a name | 0 % [0, 79] of 1 |" in text and "1 runs failed" in text
    assert (
        "| x | identified | yes | `contact_friction` scale 1.65 [1.55, 1.75] | scale 1.70 | 5.000 to 1.000 | 0 |"
        in text
    )


def test_what_the_record_says_does_not_show_is_counted_among_all_and_apart():
    """A hit below that size is no more among those that show than a miss is."""
    shows = {"shows_from": [{"effect": "contact_friction", "where": "peg", "between": {"scale": [0.5, 2.0]}}]}
    hit = record([FRICTION], [named("contact_friction", "peg", scale=1.65)])
    text = report([hit | shows, record([FRICTION], [], "adequate") | shows, hit])
    assert "nothing invented | 67 % [21, 94] of 3 |" in text
    assert "| one effect: the same of those that show, by the record itself | 100 % [21, 100] of 1 |" in text
    assert "nothing named falsely | 100 % [34, 100] of 2 |" in text and "| x | adequate | does not show |" in text


def test_the_plain_fall_is_of_squared_errors_weighed_by_time():
    phases = [{"seconds": 1.0, "before": 4.0, "after": 2.0}, {"seconds": 3.0, "before": 2.0, "after": 1.0}]
    r = record([FRICTION], [named("contact_friction", "peg", scale=1.65)]) | {"phases": phases}
    assert plain_fall(r) == pytest.approx(2.0)
    uneven = [{"seconds": 1.0, "before": 3.0, "after": 1.0}, {"seconds": 4.0, "before": 1.0, "after": 1.0}]
    assert plain_fall(r | {"phases": uneven}) == pytest.approx((13 / 5) ** 0.5)
    assert plain_fall(r | {"effects": []}) is None and plain_fall(record([FRICTION], [])) is None


def test_what_is_finished_is_neither_made_nor_run_again(tmp_path):
    """A line that a kill cut short, a run that failed and one of another seed are no results."""
    results = tmp_path / "results.jsonl"
    whole, failed = record([], [], "adequate", "none"), record([], [], "failed") | {"case": "y"}
    lines = [json.dumps(r) for r in (whole, failed)]
    lines.append(json.dumps(whole | {"case": "z", "seed": 1}))
    results.write_text("\n".join([*lines, lines[0][: len(lines[0]) // 2]]))
    assert finished(results, 2) == {"x": whole} and finished(tmp_path / "none", 2) == {}
    assert set(finished(results, 1)) == {"x", "z"}
    case = Case("x", "none", [], Truth(), 2)
    assert run(tmp_path / "no recordings", [case], results) == [whole]


def test_what_the_truth_leaves_bounds_the_fall():
    """Medians over the cases that were fitted, the ladder's and the plain one; a failed fit is said."""
    fitted = {"before": 3.0, "after": 1.0, "plain_before": 4.0, "plain_after": 2.0}

    def record_of(k):
        return {"case": f"c{k}", "verdict": "fitted", **fitted, "before": 3.0 * k}

    text = references([record_of(1), record_of(2), record_of(3), {"case": "x", "verdict": "failed"}])
    assert "Of 3 cases" in text and "(1 failed)" in text
    assert "held-out error 6-fold, of the plain force error 2-fold" in text
    assert "| c2 | 6.000 to 1.000 | 4.00 to 2.00 |" in text
