"""What is said when a gap is not explained: a disturbance outside the library, harmful or harmless, and the prices."""

import json

import pytest
from typed_record import mistakes

from vispeg.cli.main import main
from vispeg.evaluation.bridge import HARMLESS, NOT_SHOWN, UNBRIDGEABLE, bridge, matters
from vispeg.evaluation.bridging import diagnosis_of
from vispeg.evaluation.prices import Prices, ranked, recording_step, steps, training_of
from vispeg.evaluation.schema.explain import ExplainRecord
from vispeg.evaluation.statistics import Estimate, tango
from vispeg.trials.trial import folders

EPISODES = 100


def interval(value, low, high, n=100):
    return {"value": value, "low": low, "high": high, "n": n}


LEFT = {
    "recordings": ["a", "b"],
    "block_s": 0.3,
    "joints": [{"joint": "joint4", "rms": 3.0, "unit": "N m"}],
    "regimes": {"free air": {"share": 0.7, "recordings": 2}, "contact": {"share": 0.3, "recordings": 2}},
    "without": interval(0.9, 0.8, 1.0),
    "with_it": interval(0.7, 0.6, 0.8),
    "cost": interval(0.2, 0.1, 0.3),
    "home": interval(0.2, 0.1, 0.3),
    "home_world": "S",
    "matters": True,
    "words": "",
}
SEARCHED = {"verdict": "unexplained", "candidates": [{"effect": "backlash", "where": "joint1", "heldout_gain": 0.004}]}
LACKS = {
    "one recording in contact": (
        {"regimes": {"free air": {"share": 0.7, "recordings": 2}, "contact": {"share": 0.3, "recordings": 1}}},
        SEARCHED,
        False,
    ),
    "rivals that another recording tells apart": ({}, {**SEARCHED, "verdict": "ambiguous"}, False),
    "no diagnosis": ({}, None, None),
    "a cost that may be under 5 points": ({"cost": interval(0.2, 0.04, 0.3)}, SEARCHED, None),
    "a home where randomizing costs nothing": ({"home": interval(0.0, -0.02, 0.04)}, SEARCHED, False),
    "no home": ({"home": None}, SEARCHED, None),
}


def test_it_is_unbridgeable_where_every_condition_is_met_and_each_shows_its_number():
    found = bridge(LEFT, SEARCHED)
    assert found["verdict"] == UNBRIDGEABLE and [c["met"] for c in found["conditions"]] == [True] * 4
    here = [c["here"] for c in found["conditions"]]
    assert here[0] == "2 in free air, 2 in contact" and "0.4 % of the held-out error (backlash at joint1)" in here[1]
    assert here[2].startswith("20 points (10 to 30)") and "not trained anew" in here[3]


@pytest.mark.parametrize("lack", LACKS)
def test_where_one_condition_is_missing_the_verdict_says_which(lack):
    change, diagnosis, met = LACKS[lack]
    found = bridge({**LEFT, **change}, diagnosis)
    (missing,) = [c for c in found["conditions"] if not c["met"]]
    assert found["verdict"] == NOT_SHOWN and missing["met"] is met and missing["condition"] in found["words"]


def test_what_matters_is_more_than_5_points_beyond_doubt():
    assert matters(Estimate(0.2, 0.06, 0.3, 9)) is True and matters(Estimate(0.2, 0.04, 0.3, 9)) is None
    assert matters(Estimate(0.0, -0.03, 0.049, 9)) is False and matters(None) is None
    assert tango(0, 0, EPISODES)[1] < 0.05, "so many pairs that all end alike"


def priced(training, **gains):
    some = {"gap": 0.4, "left": 0.3, "causes": 0.1, "remainder": 0.2} | gains
    intervals = {k: None if v is None else interval(v, v - 0.1, v + 0.1) for k, v in some.items()}
    motion = {"motion": "triangle", "duration_s": 36.0}
    recording = recording_step(Prices(), intervals.pop("left"), 6.0, motion, "")
    return steps(Prices(), training, recording=recording, trial_s=6.0, commands={}, **intervals)


def test_prices_are_hours_of_what_was_measured_and_what_was_stated(tmp_path):
    stated = training_of(None, Prices(training_hours=2.0))
    by = {s["step"]: s for s in priced(stated)}
    assert by["record triangle, diagnose"]["hours"] == pytest.approx(2 * (17 / 60 + 0.01))
    assert by["50 demonstrations on the robot, fine-tune"]["hours"] == pytest.approx(50 / 60 + 2.0)
    assert [s["an_hour"] for s in priced(stated)] == pytest.approx(
        [0.3 / (2 * (17 / 60 + 0.01)), 0.4 / (50 / 60 + 2), 0.1, 0.05]
    )
    run = tmp_path / "run" / "checkpoints" / "best"
    run.mkdir(parents=True)
    assert training_of(run, Prices()).hours is None
    unknown = priced(training_of(run, Prices()))
    assert [s["hours"] is None for s in unknown] == [False, False, True, True] and unknown[2]["step"].startswith(
        "train with"
    )
    (tmp_path / "run" / "progress.csv").write_text("steps,seconds\n10,900\n20,5400\n")
    assert training_of(run, Prices()).hours == 1.5
    (tmp_path / "run" / "progress.csv").write_text("steps,seconds\n10,450000\n")
    assert training_of(run, Prices()).source.startswith("125 h")
    for begun in ("0", "nan", "inf", "-1"):  # not measured, which is not the same as free
        (tmp_path / "run" / "progress.csv").write_text(f"steps,seconds\n10,{begun}\n")
        assert training_of(run, Prices()).hours is None
    assert len(priced(stated, causes=None, remainder=None)) == 2 and ranked([]) == []
    assert priced(stated, gap=-0.2)[-1]["an_hour"] == 0.0, "nothing is won back where nothing is lost"


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Cells with a random torque in two joints, which the library does not search: of 5 N m and of 0.2."""
    place = tmp_path_factory.mktemp("bridge")
    for name, rms in (("hurts", 5.0), ("harmless", 0.2)):
        world = place / f"{name}.yaml"
        noise = [
            f"  - {{effect: torque_noise, where: {j}, params: {{rms: {rms}, time: 0.15}}}}"
            for j in ("joint2", "joint4")
        ]
        world.write_text("\n".join(["format: vispeg-world/1", "base: nominal", "effects:", *noise, ""]))
        argv = ["evaluate", "expert", "--world", str(world), "--episodes", "20", "--videos", "0", "--quiet", "--json"]
        assert main([*argv, "--out", str(place / f"{name}-e"), "--keep-trials", str(place / name)]) == 0
    return place


def explained(place, name, out, *argv):
    how = [
        "explain",
        str(place / name),
        "--policy",
        "expert",
        "--replays",
        "1",
        "--remainder",
        str(EPISODES),
        "--quiet",
    ]
    assert main([*how, "--json", *argv, "--out", str(out)]) == 0
    return json.loads((out / "explain.json").read_text()), (out / "explain.html").read_text()


def test_a_remainder_that_is_harmless_is_said_not_to_matter(place, tmp_path, capsys):
    found, page = explained(place, "harmless", tmp_path / "why")
    left, b = found["remainder"], found["bridge"]
    assert not mistakes(ExplainRecord, {k: v for k, v in found.items() if k not in ("world", "replays", "provenance")})
    assert b["verdict"] == HARMLESS and left["matters"] is False and left["cost"]["high"] < 0.05
    assert {left["joints"][0]["joint"], left["joints"][1]["joint"]} == {"joint2", "joint4"}
    assert 0.1 < left["joints"][1]["rms"] < left["joints"][0]["rms"] < 0.3 and left["block_s"] < 1.0
    assert HARMLESS in page and b["conditions"][1]["here"] in page and "50 demonstrations on the robot" in page


@pytest.mark.slow
def test_a_disturbance_outside_the_library_that_hurts_is_unbridgeable_here(place, tmp_path):
    """A diagnosis of motions in free air finds nothing that is wrong; the trials are disturbed all the same."""
    for seed in ("1", "2"):
        argv = ["record", "peg-cell", "--motion", "fourier", "--seed", seed, "--out", str(tmp_path / seed), "--quiet"]
        assert main(argv) == 0
    argv = ["diagnose", "peg-cell", "--recording", str(tmp_path / "1"), "--validate", str(tmp_path / "2")]
    assert main([*argv, "--channels", "joints", "--out", str(tmp_path / "diagnosis"), "--quiet"]) == 0
    model = tmp_path / "diagnosis" / "model.yaml"
    assert (diagnosis_of(model) or {})["verdict"] == "adequate"
    found, page = explained(place, "hurts", tmp_path / "why", "--model", str(model))
    assert [c["met"] for c in found["bridge"]["conditions"]] == [True] * 4, found["bridge"]["conditions"]
    assert found["bridge"]["verdict"] == UNBRIDGEABLE and UNBRIDGEABLE in page
    assert found["remainder"]["cost"]["low"] > 0.05 and len(found["steps"]) == 3
    alone, _ = explained(place, "hurts", tmp_path / "alone")
    assert alone["bridge"]["verdict"] == NOT_SHOWN and "not known" in alone["bridge"]["words"]
    assert alone["remainder"]["cost"] == found["remainder"]["cost"], "the same tapes from the same trials"


def test_without_the_remainder_conditions_are_not_known_and_bad_numbers_are_one_line(place, tmp_path, capsys):
    how = ["explain", str(place / "harmless"), "--policy", "expert", "--replays", "1", "--quiet", "--json"]
    assert main([*how, "--out", str(tmp_path / "why")]) == 0
    found = json.loads((tmp_path / "why" / "explain.json").read_text())
    assert found["remainder"] is None and not any(c["met"] for c in found["bridge"]["conditions"])
    assert "--remainder 200" in found["bridge"]["words"]
    capsys.readouterr()
    bad = [["--remainder", "-1"], ["--minutes-per-demonstration", "0"], ["--demonstrations", "0"]]
    for argv in (*bad, ["--training-hours", "-2"], ["--held-out", str(tmp_path / "nowhere")]):
        assert main([*how, *argv, "--out", str(tmp_path / "bad")]) == 2, argv
        assert "\n" not in capsys.readouterr().err.strip() and not (tmp_path / "bad").exists()


@pytest.mark.slow
def test_the_remainder_may_be_of_other_recordings(place, tmp_path):
    other = folders(place / "hurts")[0]
    found, _ = explained(place, "harmless", tmp_path / "why", "--held-out", str(other))
    assert found["remainder"]["recordings"] == [other.name] and found["remainder"]["joints"][0]["rms"] > 2.0
