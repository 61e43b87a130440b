"""Sentences say what the numbers say."""

import math

import pytest

from vispeg.diagnosis.conclusion.verdict import decide, without_tentative
from vispeg.diagnosis.findings import Rivals
from vispeg.report.text import contact_words, effect_words, joint_errors, unseen, words
from vispeg.report.text.quantities import interval, plain, quantity
from vispeg.report.text.summary import Line
from vispeg.report.text.terminal import comparison_summary, effects_table


def _ladder(*held, floor=1e-4, **more):
    rows = [{"model": str(i), "heldout_error": h, "unit": "rad RMS"} for i, h in enumerate(held)]
    return {"ladder": rows, "noise_floor": {"value": floor, "unit": "rad RMS"}, **more}


@pytest.mark.parametrize(
    ("first", "last", "said"),
    [
        (8.0, 0.2, "falls 40-fold"),
        (8.0, 4.0, "falls 2.0-fold"),
        (1.0, 0.68, "falls by 32 %"),
        (1.0, 0.97, "hardly changes"),
        (1.0, 1.04, "hardly changes"),
        (1.0, 1.5, "rises by 50 %"),
        (1.0, 3.0, "rises 3.0-fold"),
        (1.0, 0.0, "falls to zero"),
        (0.0, 1.0, "rises from zero"),
        (None, 1.0, ""),
        (1.0, math.nan, ""),
    ],
)
def test_change(first, last, said):
    assert words.change(first, last) == said


def test_fall_divides_the_first_by_the_last_and_the_last_by_the_floor():
    text = words.fall(_ladder(6e-3, 1.5e-3, 1.5e-4))
    assert "falls 40-fold, from 6.00 mrad RMS to 0.150 mrad RMS, which is 1.50 × the noise floor." in text


def test_an_error_well_below_the_floor_is_no_share_of_it():
    """A floor of contact allows for cross-talk, which a good sensor has not."""
    text = words.fall(_ladder(6e-3, 1.5e-5))
    assert "which is below the noise floor: 0.100 mrad RMS includes errors that these recordings lack" in text
    assert "×" not in text
    assert "0.90 × the noise floor" in words.fall(_ladder(6e-3, 9e-5))


def test_a_rising_error_is_never_called_a_fall():
    text = words.fall(_ladder(1e-3, 2.5e-3))
    assert "rises 2.5-fold" in text and "fall" not in text


@pytest.mark.parametrize("record", [{}, {"ladder": None}, {"ladder": []}, _ladder(None), _ladder(1e-3, math.nan)])
def test_unknown_errors_are_said_to_be_unknown(record):
    assert words.fall(record) == "The held-out error is not known."


def test_down_to_the_noise_floor_only_where_it_is():
    named = {"verdict": "identified", "effects": [{"effect": "payload", "where": "flange"}]}
    assert "down to the noise floor" in words.verdict(_ladder(1e-2, 1.1e-4, **named))
    assert "down to 1.50 × the noise floor" in words.verdict(_ladder(1e-2, 1.5e-4, **named))
    assert "down to the noise floor" not in words.verdict(_ladder(1e-2, 1.1e-4, floor=None, **named))


def test_an_error_that_began_at_the_floor_did_not_come_down_to_it():
    """Whatever the verdict, and of one effect or of several."""
    rival = {"effect": "link_mass", "where": "link7"}
    for verdict in ("identified", "ambiguous"):
        for others in ([], [rival]):
            found = [{"effect": "payload", "where": "flange", "indistinguishable_from": others}]
            said = words.verdict(_ladder(0.9e-4, 0.5e-4, verdict=verdict, effects=found))
            assert "down to" not in said and "at the noise floor from the start" in said, said


def test_what_cannot_be_told_apart_is_counted_alike_in_the_headline_and_in_the_reason():
    """Ten effects have rivals, seven of them are tentative anyhow."""
    labels = [f"joint_bias(joint{i})" for i in range(10)]
    rivals = [Rivals(label, ("another",), ()) for label in labels]
    unsure = set(labels[3:])
    verdict = without_tentative(decide(1e4, 1.1, 10, rivals, []), rivals, unsure)
    other = [{"effect": "cable_spring", "where": "joint0"}]
    effects = [
        {"effect": "joint_bias", "where": f"joint{i}", "indistinguishable_from": other, "tentative": i >= 3}
        for i in range(10)
    ]
    said = words.verdict(_ladder(1e-2, 1e-4, verdict=verdict.verdict, effects=effects))
    assert "3 that these recordings cannot tell from others" in said
    assert [label in verdict.reason for label in labels] == [True] * 3 + [False] * 7
    named = without_tentative(verdict, rivals, set(labels))
    assert named.reason == verdict.reason, "what was said once stays"


def test_effects_that_are_each_others_rivals_are_read_once_and_in_words():
    """Two of a combination, one with a rival of its own, and one by itself."""
    mass, gain = {"effect": "tool_mass", "where": "tool"}, {"effect": "wrench_gain", "where": "flange"}
    friction = {"effect": "contact_friction", "where": "peg"}
    found = [
        {**mass, "indistinguishable_from": [gain]},
        {**gain, "indistinguishable_from": [mass]},
        {**friction, "indistinguishable_from": [{"effect": "contact_stiffness", "where": "peg"}]},
    ]
    reason = "these recordings determine only a combination of tool_mass(tool) and wrench_gain(flange)"
    record = _ladder(1e-2, 1e-4, verdict="ambiguous", effects=found, reason=reason)
    names = [words.named_effect(e) for e in found]
    said = words.verdict(record)
    assert [said.lower().count(name.lower()) for name in names] == [1, 1, 1], said
    assert words.combinations(record) == [names[:2]] and len(words.rivals(record)) == 1
    assert "(" not in words.reason(record) and all(name in words.reason(record) for name in names[:2])
    tentative = [found[0], {**found[1], "tentative": True}]
    assert words.combinations({**record, "effects": tentative}) == []


def test_the_reason_has_the_error_of_the_ladder():
    """One scale, multiples of the noise floor, and one figure of it."""
    record = _ladder(1.2e-2, 1.07e-4)
    for n, first in ((1, 120.0), (0, 1.07)):
        verdict = decide(first**2, 1.3, n, [], [], errors=(first, 1.07))
        assert "1.07 × the noise floor" in verdict.reason and "variance" not in verdict.reason
    assert "1.07 × the noise floor" in words.fall(record)


def _joint(name, after, floor, channel="needed", **more):
    return {"channel": channel, "joint": name, "floor": floor, "before": 1.0, "after": after, "unit": "N m RMS", **more}


def test_a_joint_far_above_its_own_floor_is_named_where_all_together_stand_at_theirs():
    """A shoulder's wide noise makes the floor of all; a wrist that is left at 30 floors of its own is not explained."""
    named = {"verdict": "identified", "effects": [{"effect": "payload", "where": "flange"}]}
    joints = [_joint("shoulder", 0.2, 0.4), _joint("elbow", 0.02, 0.01), _joint("wrist", 0.15, 0.005)]
    said = words.verdict(_ladder(1e-2, 1.1e-4, channels=joints, **named))
    assert "noise floor of all joints together (wrist is left at 30 × its own)" in said
    assert "all joints together" not in words.verdict(_ladder(1e-2, 1.1e-4, channels=joints[:2], **named))
    beside = [*joints[:2], _joint("wrist", 50.0, 1.0, channel="load")]
    assert "all joints together" not in words.verdict(_ladder(1e-2, 1.1e-4, channels=beside, **named)), (
        "a log is no joint"
    )


def test_a_row_a_joint_has_its_error_over_its_own_floor():
    rows = joint_errors.table({"channels": [_joint("wrist", 0.15, 0.005, least_squares=0.3), _joint("x", 1.0, 0.0)]})
    assert rows[0] == {
        "joint": "wrist",
        "reading": "torque",
        "before": "1.00 N m RMS",
        "after": "0.150 N m RMS",
        "floor": "5.00 mN m RMS",
        "times": "30",
        "least": "0.300 N m RMS",
    }
    assert rows[1]["times"] == "–"
    assert joint_errors.table({"channels": [_joint("hole", 1.0, 1.0, channel="depth")]}) == []


def test_ambiguous_names_every_member_of_the_class():
    effect = {"effect": "coulomb_friction", "where": "joint4"}
    effect["indistinguishable_from"] = [{"effect": e, "where": "joint4"} for e in ("stribeck_friction", "hysteresis")]
    text = words.verdict(_ladder(1e-2, 1e-4, verdict="ambiguous", effects=[effect]))
    names = "Coulomb friction in joint 4, Stribeck friction in joint 4 or Elasto-plastic hysteresis in joint 4"
    assert text.startswith(f"One of {names} explains")
    assert "cannot tell" in text


def test_unexplained_says_what_the_record_says_of_it():
    moved = "the fixture stands 5.0 mm elsewhere: what stands in the cell was moved in between"
    record = {"verdict": "unexplained", "unexplained": {"depends_on": [], "text": moved}}
    assert words.verdict(record) == f"What is left: {moved}."
    friction = {"effect": "contact_friction", "where": "peg"}
    assert words.verdict({**record, "effects": [friction]}).endswith(f"not all is explained: {moved}.")
    assert "Nothing is left" not in words.onward(record)


def test_unexplained_says_what_it_depends_on():
    rest = {"depends_on": [{"input": "position", "share": 0.6}, {"input": "time", "share": 0.2}], "text": ""}
    assert "It depends on position and time." in words.verdict({"verdict": "unexplained", "unexplained": rest})


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.00821, "rad RMS", "8.21 mrad RMS"),
        (2.0e-5, "rad", "20.0 µrad"),
        (1.31, "N m", "1.31 N m"),
        (0.02, "kg", "0.0200 kg"),
        (0.0, "rad RMS", "0 rad RMS"),
        (None, "rad", "–"),
        (math.inf, "rad", "–"),
        (9.999e-3, "rad", "10.0 mrad"),
    ],
)
def test_quantities(value, unit, text):
    assert quantity(value, unit) == text


@pytest.mark.parametrize("value", [1.234e-9, 0.00123, 0.5, 9.996, 1234.5, -3.3e7])
def test_three_digits_are_within_half_a_percent(value):
    assert float(plain(value).replace("−", "-")) == pytest.approx(value, rel=5e-3)


def test_an_interval_sets_the_decimals_of_its_value():
    assert interval(1.3123, 1.224, 1.401) == ("1.312", "1.224 to 1.401")
    assert interval(1312.3, 1224.0, 1401.0) == ("1312", "1224 to 1401")
    assert interval(0.5, None, None) == ("0.5000", "")
    assert interval(2.94e-5, 1.9e-5, 4.3e-5) == ("2.9e−5", "1.9e−5 to 4.3e−5")
    assert interval(0.0, 0.0, 4.3e-5) == ("0", "0 to 4.3e−5")


@pytest.mark.parametrize("count", [2, 5, 6, 16])
def test_a_verdict_names_few_effects_and_counts_many(count):
    effects = [{"effect": "joint_bias", "where": f"joint{i}"} for i in range(count)]
    rival = {"indistinguishable_from": [{"effect": "cable_spring", "where": "joint0"}]}
    for kind, found in (("identified", effects), ("ambiguous", [effects[0] | rival, *effects[1:]])):
        said = words.verdict({"verdict": kind, "effects": found})
        assert ("Joint bias in joint 1" in said) == (count <= words.MOST_NAMED), said
        assert (f"{count} effects" in said) == (count > words.MOST_NAMED) and len(said) < 300
    if count > words.MOST_NAMED:
        assert said.endswith(f"{count - 1} named and 1 that these recordings cannot tell from others.")
        found[1] |= {"tentative": True}
        said = words.verdict({"verdict": "ambiguous", "effects": found})
        assert said.endswith(f"{count - 2} named, 1 that these recordings cannot tell from others and 1 tentative.")


def test_what_is_tentative_is_counted_and_a_class_is_named_as_one_of():
    friction = {"effect": "coulomb_friction", "where": "joint4", "partial": True}
    mass = {"effect": "link_mass", "where": "link7", "partial": True}
    alone = words.verdict({"verdict": "unexplained", "effects": [friction]})
    assert alone.startswith("Coulomb friction in joint 4 helps, but a structured residual")
    mass["indistinguishable_from"] = [{"effect": "payload", "where": "flange"}]
    unsure = {"effect": "joint_bias", "where": "joint1", "partial": True, "tentative": True}
    text = words.verdict({"verdict": "unexplained", "effects": [friction, mass, unsure]})
    assert "and one of Link mass of link 7 or Payload at the flange and 1 tentative effect help, but a" in text
    assert "bias" not in text.lower(), "a tentative effect is not named in the verdict"
    assert words.one_of(mass) == "One of: Link mass of link 7, Payload at the flange"
    payload = {"effect": "payload", "where": "flange", "partial": True, "indistinguishable_from": [mass]}
    both = words.verdict({"verdict": "unexplained", "effects": [mass, payload]})
    assert both.startswith("One of Link mass of link 7 or Payload at the flange helps, but"), both
    assert words.tentative({"effects": [friction, unsure]}).endswith("Joint bias in joint 1")
    assert words.tentative({"effects": [friction]}) == ""
    only = words.verdict({"verdict": "unexplained", "effects": [unsure]})
    assert only.startswith("1 tentative effect helps, but a structured residual")


def test_the_price_of_a_remainder_is_asked_of_the_joints_where_it_weighs_most():
    left = [{"joint": f"joint{j}", "rms": r, "needed": n} for j, r, n in ((1, 0.0, 9.0), (2, 4.0, 80.0), (3, 0.2, 0.5))]
    command = words.price({"remainder": left})
    assert command.index("torque_noise@joint3.rms=0,0.2") < command.index("torque_noise@joint2.rms=0,4")
    assert "joint1" not in command and words.price({}) == ""


def test_a_direction_in_which_nothing_was_fitted_goes_unsaid():
    row = {"effect": "fixture_compliance", "where": "fixture"}
    values = {"x": 0.0, "y": 0.0, "z": 3e-5, "roll": 0.0, "pitch": 0.0}
    row["params"] = {name: {"value": value, "unit": "m/N"} for name, value in values.items()}
    assert "z" in effect_words.size(row) and "roll" not in effect_words.size(row)
    row["params"]["z"]["value"] = 0.0
    assert "roll" in effect_words.size(row)


def test_a_direction_that_may_be_null_goes_unsaid_beside_one_that_may_not():
    row = {"effect": "camera_offset", "where": "wrist_wide", "params": {}}
    for name, (low, high) in {"x": (3.9e-3, 4.1e-3), "y": (-1e-4, 1.1e-4), "rx": (-3e-4, 4e-4)}.items():
        row["params"][name] = {"value": 0.5 * (low + high), "low": low, "high": high, "unit": "m"}
    assert effect_words.size(row) == "x 4.00 mm"
    row["params"]["x"]["low"] = -1e-3
    assert all(name in effect_words.size(row) for name in ("x", "y", "rx"))


def test_a_parameter_that_was_not_looked_for_has_no_row_beside_those_that_were():
    z = {"value": 2.98e-5, "low": 1.79e-5, "high": 4.48e-5, "unit": "m/N"}
    bare = {"value": 0.0, "unit": "m/N"}
    placed = {"effect": "fixture_compliance", "where": "fixture", "params": {"x": bare, "z": z}}
    (row,) = effects_table({"effects": [placed]}).rows
    assert row[1:] == ["z", "30", "18 to 45", "µm/N"]
    assert len(effects_table({"effects": [{**placed, "params": {"x": bare}}]}).rows) == 1
    assert len(effects_table({"effects": [{**placed, "params": {"x": {**bare, "value": 1e-5}, "z": z}}]}).rows) == 2


def test_the_phase_in_which_the_error_falls_most_is_told_and_none_where_none_falls():
    """By squared error times time: two seconds from 1.4 N count more than half a second from 2 N."""
    rows = [("free", 5.0, 0.1, 0.1), ("press", 2.0, 1.4, 0.5), ("slide", 0.5, 2.0, 0.4)]
    phases = [{"phase": n, "seconds": s, "before": b, "after": a, "floor": 0.1} for n, s, b, a in rows]
    said = "In presses the force error falls 2.8-fold, from 1.40 N RMS to 0.500 N RMS."
    assert contact_words.phases({"phases": phases}) == said
    assert contact_words.phases({"phases": phases[:1]}) == contact_words.phases({}) == ""
    lone = [{"phase": "press", "seconds": 2.0, "before": 1.4, "floor": 0.1}]
    assert contact_words.phases({"phases": lone}) == "", "a comparison has one model alone"


def test_the_phase_and_the_place_of_what_is_left_of_a_contact_are_told():
    phases = [
        {"phase": "press", "seconds": 3.0, "floor": 0.17, "before": 0.20, "after": 0.19},
        {"phase": "slide", "seconds": 2.0, "floor": 0.083, "before": 0.80, "after": 0.71},
    ]
    worst = {"recording": "slide-2", "time_s": 12.34, "force": 2.1, "phase": "slide", "tip_m": [0.0031, -2e-4, 4e-4]}
    said = contact_words.left({"phases": phases, "worst_left": worst})
    assert said.startswith("What is left shows most in slides: 0.710 N RMS there, 8.6 × the noise floor")
    assert "2.10 N, at 12.3 s of slide-2 with the tip x 3.1, y −0.20, z 0.40 mm from the goal" in said
    assert contact_words.left({"phases": phases[:1]}) == "", "a phase at its floor is none"


def test_what_could_not_have_been_seen_is_listed_the_least_certain_first():
    found = [{"effect": "contact_friction", "where": "peg"}]
    rows = [
        {"effect": "contact_friction", "where": "peg", "between": {"scale": [0.9, 1.1]}},
        {"effect": "wrench_bias", "where": "flange", "between": {"fx": [-0.5, 0.5], "fy": [-0.5, 0.5]}},
        {"effect": "fixture_compliance", "where": "fixture", "between": {"x": None, "z": [0.0, 2e-5]}},
        {"effect": "gripper_slip", "where": "peg", "between": {"grip": None}},
        {"effect": "contact_stiffness", "where": "peg", "between": {"scale": [0.5, 2.0]}},
    ]
    said = unseen.sentence({"effects": found, "shows_from": rows})
    first = "Fixture compliance at fixture (x at any size; z up to 20 µm/N)"
    assert said.startswith(f"not detectable up to these sizes: {first}; ")
    assert "(fx, fy ±0.50 N)" in said and "(scale 0.50 to 2.0)" in said and "friction" not in said
    assert said.endswith("(grip at any size)"), "what has no size stands last"
    assert unseen.sentence({"effects": found}, "contact") == unseen.sentence({"effects": found}) == ""
    assert unseen.sentence({"effects": found, "shows_from": rows}, "contact") == f"channel contact: {said}"


def test_the_terminals_table_says_of_each_effect_how_sure_its_name_is():
    value = {"params": {"mass": {"value": 0.6, "low": 0.5, "high": 0.7, "unit": "kg"}}}
    effects = [
        {"effect": "payload", "where": "flange", **value},
        {"effect": "link_mass", "where": "link6", "tentative": True, **value},
        {
            "effect": "link_mass",
            "where": "link7",
            **value,
            "indistinguishable_from": [{"effect": "a"}, {"effect": "b"}],
        },
    ]
    sheet = effects_table({"verdict": "ambiguous", "effects": effects})
    column = [c.head for c in sheet.columns].index("Certainty")
    assert [row[column] for row in sheet.rows] == ["named", "tentative", "1 of 3"]
    assert "Certainty" not in [c.head for c in effects_table({"effects": effects}).columns], "a fit names nothing"


def test_a_comparison_claims_the_noise_floor_only_of_what_was_read():
    """A joint that was never read has no error, and errors that overflowed are null in the file."""
    joints = [{"joint": "joint1", "error": 1.0, "floor": 1.0, "times_floor": 1.0, "unit": "rad RMS"}]
    unread = {"joint": "joint2", "error": None, "floor": 0.0, "times_floor": None, "unit": "rad RMS"}
    null = [{"joint": "joint1", "regime": "steady", "share": None}]

    def said(**record):
        return [block.text for block in comparison_summary(record) if isinstance(block, Line)]

    assert "the model is at the noise floor everywhere" in said(joints=joints, chi2=1.0)
    assert "the model is at the noise floor in what was read" in said(joints=[*joints, unread], chi2=1.0)
    for record in ({"joints": [unread], "chi2": 1.0}, {"joints": joints, "chi2": None, "where_it_fails": null}):
        assert not any("everywhere" in line or "where it fails" in line for line in said(**record))


def test_a_value_that_rounds_to_nothing_has_no_sign():
    assert interval(-1e-9, -0.5, 0.5) == ("0.00", "−0.50 to 0.50")


def test_a_ratio_that_has_drifted_has_no_unit():
    now = {"value": 0.95, "low": 0.93, "high": 0.97}
    row = {"effect": "torque_gain", "where": "joint2", "parameter": "gain", "unit": "1", "since": "tuesday"}
    (said,) = words.drifted([{**row, "then": {"value": 1.0, "low": 0.99, "high": 1.01}, "now": [now]}])
    assert "gain 0.950 (0.930 to 0.970) now" in said
