"""Why trials fail: a hidden effect is ranked first, the trials' own world plays them again, and few tell nothing."""

import json
import shutil
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
import yaml

from vispeg.api.explain import UNTRIED, explain
from vispeg.api.learning.finetune import failed_starts
from vispeg.cli.main import main
from vispeg.core.errors import UserError
from vispeg.evaluation.bridging import LEFT
from vispeg.evaluation.explain import _followed
from vispeg.evaluation.senses import HELD, TOUCH, before_contact
from vispeg.evaluation.statistics import CANNOT_TELL
from vispeg.robots.scene import build
from vispeg.task.world_file import load_world
from vispeg.trials.trial import FILE, folders, read_said, read_trial

HIDDEN = """format: vispeg-world/1
base: nominal
effects:
  - {effect: coulomb_friction, where: joint4, params: {torque: 6.0}}
"""
MODEL = """format: vispeg-model/1
robot: iiwa14
effects:
  - {effect: coulomb_friction, where: joint1, params: {torque: 0.5}}
  - {effect: coulomb_friction, where: joint4, params: {torque: {value: 6.0, low: 5.5, high: 6.5}}}
  - {effect: viscous_friction, where: joint7, params: {damping: 0.5}}
"""
TRIALS = 20


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    """A cell whose fourth joint sticks, and what the scripted policy did in it."""
    place = tmp_path_factory.mktemp("cell")
    (place / "hidden.yaml").write_text(HIDDEN)
    (place / "model.yaml").write_text(MODEL)
    argv = ["evaluate", "expert", "--world", str(place / "hidden.yaml"), "--episodes", str(TRIALS), "--videos", "0"]
    assert main([*argv, "--out", str(place / "e"), "--keep-trials", str(place / "trials"), "--quiet", "--json"]) == 0
    return place


def explained(cell, out, *argv, trials="trials"):
    """One replay each: nominal draws nothing but the start."""
    how = ["explain", str(cell / trials), "--policy", "expert", "--quiet", "--json", "--replays", "1"]
    assert main([*how, *argv, "--out", str(out)]) == 0
    return json.loads((out / "explain.json").read_text())


def test_a_hidden_effect_is_ranked_before_others_and_explains_what_is_lost(cell, tmp_path):
    found = explained(cell, tmp_path / "why", "--model", str(cell / "model.yaml"))
    said = [read_said(folder) for folder in folders(cell / "trials")]
    lost = sum(not s.outcome.success for s in said)
    assert lost >= 6 and found["robot"]["n"] == TRIALS
    assert found["verdict"] == "gap" and found["closed"]["value"] == 1.0
    first, *others, together = found["causes"]
    assert first["effect"] == "coulomb_friction(joint4)" and first["verdict"] == "different"
    assert first["cost"]["value"] == pytest.approx(lost / TRIALS) and first["share"]["value"] == pytest.approx(1.0)
    assert {c["verdict"] for c in others} == {CANNOT_TELL} and together["effect"] == "all together"
    assert found["words"].endswith("first cause: coulomb_friction(joint4)")
    kinds = {k["category"]: k["verdict"] for k in found["categories"]["kinds"]}
    assert "more" in kinds.values(), "failures are told although simulation has none"
    speaks = [rule["points_to"] for rule in found["rules"] if rule["speaks"]]
    assert "actuator" in speaks
    page = (tmp_path / "why" / "explain.html").read_text()
    assert "coulomb_friction(joint4): torque 6" in page and all(f.name in page for f in folders(cell / "trials"))


@pytest.mark.slow
def test_apply_writes_the_world_that_the_causes_correct_and_it_draws_within_their_intervals(cell, tmp_path):
    found = explained(cell, tmp_path / "why", "--model", str(cell / "model.yaml"), "--apply", "--clearance", "2.9")
    world = tmp_path / "why" / "world.yaml"
    assert found["next"]["command"].split()[:2] == ["vispeg", "finetune"] and str(world) in found["next"]["command"]
    assert found["next"]["command"] in (tmp_path / "why" / "explain.html").read_text()
    drawn = [{e.label: e.params for e in load_world(world).world.sample(s, build()).effects} for s in range(50)]
    torque = np.array([d["coulomb_friction(joint4)"]["torque"].value for d in drawn])
    assert torque.std() == pytest.approx(0.5 / 1.96, rel=0.35) and abs(torque.mean() - 6.0) < 0.2
    assert {d["viscous_friction(joint7)"]["damping"].value for d in drawn} == {0.5}
    assert load_world(world).task["clearance_mm"] == 2.9, "as in the replays"


@pytest.mark.slow
def test_apply_of_a_policy_that_fails_anywhere_sends_for_demonstrations_from_there(cell, tmp_path):
    found = explained(cell, tmp_path / "why", "--world", str(cell / "hidden.yaml"), "--apply")
    assert found["verdict"] == "policy" and not (tmp_path / "why" / "world.yaml").exists()
    verb, *options = found["next"]["command"].split()[1:]
    assert verb == "finetune" and options[options.index("--starts") + 1] == str(cell / "trials")
    starts = failed_starts(cell / "trials")
    assert len(starts) == sum(not read_said(f).outcome.success for f in folders(cell / "trials"))


@pytest.mark.slow
def test_demonstrations_are_asked_for_in_the_task_that_was_replayed(cell, tmp_path):
    asked = ["--world", str(cell / "hidden.yaml"), "--apply", "--clearance", "2.9"]
    command = explained(cell, tmp_path / "why", *asked)["next"]["command"].split()
    assert "--starts" in command and load_world(command[command.index("--world") + 1]).task["clearance_mm"] == 2.9


@pytest.mark.slow
def test_a_remainder_is_played_at_the_pace_of_the_task(cell, tmp_path):
    """Two ways that must agree: the control period as an option, and in the world's file."""
    shutil.copytree(folders(cell / "trials")[0], tmp_path / "one" / "trial-0001")
    paced = {"control_period": 0.01}
    (tmp_path / "paced.yaml").write_text(f"format: vispeg-world/1\nbase: nominal\ntask: {json.dumps(paced)}\n")
    how = {"replays": 1, "remainder": 2}
    stated = explain(tmp_path / "one", "expert", tmp_path / "paced.yaml", **how)
    asked = explain(tmp_path / "one", "expert", task=paced, **how)
    # the name of a configuration holds the digest of the torques that are played, their pace included
    left = [[e.configuration for e in r.episodes if e.configuration.startswith(LEFT)] for r in (stated, asked)]
    assert len(left[0]) == 2 and left[0] == left[1]


@pytest.mark.parametrize("task", [{"dof": ["x", "y"]}, {"policy_period": 0.08}])
def test_actions_of_another_policy_are_refused_before_they_are_replayed(cell, tmp_path, task):
    with pytest.raises(UserError, match="than the policy's"):
        explain(cell / "trials", "expert", replays=1, task=task, out=tmp_path / "why")
    assert not (tmp_path / "why").exists()


@pytest.mark.slow
def test_in_their_own_world_trials_end_as_they_did_by_policy_and_by_actions(cell, tmp_path):
    found = explained(cell, tmp_path / "why", "--world", str(cell / "hidden.yaml"), "--model", "iiwa14")
    for row in found["trials"]:
        assert row["closed"]["value"] == row["open"]["value"] == float(row["success"]), row["trial"]
    assert found["verdict"] == "policy" and found["causes"] == [] and found["gap"]["value"] == 0
    assert not any(rule["speaks"] for rule in found["rules"])
    assert found["rules"][0]["value"] < 0.01, "deg"


@pytest.mark.slow
def test_an_effect_with_which_more_succeed_is_no_cause(cell, tmp_path):
    (tmp_path / "model.yaml").write_text(
        "format: vispeg-model/1\neffects: [{effect: coulomb_friction, where: joint4, params: {torque: 0.0}}]\n"
    )
    found = explained(
        cell, tmp_path / "why", "--world", str(cell / "hidden.yaml"), "--model", str(tmp_path / "model.yaml")
    )
    (cause,) = found["causes"]
    assert cause["verdict"] == "different" and cause["cost"]["value"] < 0 and cause["words"].startswith("gains ")
    assert "first cause" not in found["words"]


@pytest.mark.slow
def test_few_trials_cannot_tell_and_without_a_model_no_cause_is_tried(cell, tmp_path):
    argv = ["evaluate", "expert", "--world", "nominal", "--episodes", "2", "--videos", "0", "--quiet", "--json"]
    assert main([*argv, "--out", str(tmp_path / "e"), "--keep-trials", str(tmp_path / "few")]) == 0
    for folder in folders(cell / "trials")[:3]:
        shutil.copytree(folder, tmp_path / "cell" / "few" / folder.name)
    few = explained(tmp_path / "cell", tmp_path / "why", "--model", str(cell / "model.yaml"), trials="few")
    assert few["verdict"] == CANNOT_TELL and "3, at least 10 are needed" in few["words"]
    assert {c["verdict"] for c in few["causes"]} == {CANNOT_TELL} and {c["share"] for c in few["causes"]} == {None}
    untried = explained(tmp_path, tmp_path / "untried", trials="few")
    assert untried["causes"] == [] and UNTRIED in untried["notes"]


@pytest.mark.slow
def test_a_killed_run_that_goes_on_with_more_replays_finds_what_a_fresh_one_finds(cell, tmp_path):
    @contextmanager
    def killed(jobs, folder):
        def watch(new, done, total):
            if done == total:
                raise KeyboardInterrupt

        yield watch

    for folder in folders(cell / "trials")[:3]:
        shutil.copytree(folder, tmp_path / "few" / folder.name)
    asked = {"world": cell / "hidden.yaml", "model": cell / "model.yaml"}
    with pytest.raises(KeyboardInterrupt):
        explain(tmp_path / "few", "expert", **asked, replays=1, out=tmp_path / "why", playing=killed)
    found = [explain(tmp_path / "few", "expert", **asked, replays=2, out=tmp_path / to) for to in ("why", "fresh")]
    again, fresh = ({k: v for k, v in f.record.items() if k != "provenance"} for f in found)
    assert again == fresh and all(row["closed"]["n"] == 2 for row in fresh["trials"])


def test_trials_that_tell_nothing_are_refused_in_one_line(cell, tmp_path, capsys):
    shutil.copytree(folders(cell / "trials")[0], tmp_path / "shadows" / "trial-0001")
    file = tmp_path / "shadows" / "trial-0001" / FILE
    file.write_text(file.read_text().replace("shadow: false", "shadow: true"))
    for place, policy in (("shadows", "expert"), ("none", "expert"), ("shadows", "nobody")):
        argv = ["explain", str(tmp_path / place), "--policy", policy, "--out", str(tmp_path / "why")]
        assert main(argv) == 2
        assert "\n" not in capsys.readouterr().err.strip() and not (tmp_path / "why").exists()


@pytest.mark.parametrize("change", [{"q_rad": [0.0] * 6}, {"q_rad": [9.0] * 7}, {"goal_m": [0.6, 0.0, 5.0]}])
def test_a_start_that_the_simulated_cell_cannot_take_is_named_with_its_file(cell, tmp_path, capsys, change):
    for folder in folders(cell / "trials")[:2]:
        shutil.copytree(folder, tmp_path / "few" / folder.name)
    file = tmp_path / "few" / folder.name / FILE
    data = yaml.safe_load(file.read_text())
    file.write_text(yaml.safe_dump(data | {"start": data["start"] | change}))
    argv = ["explain", str(tmp_path / "few"), "--policy", "expert", "--replays", "1", "--quiet"]
    assert main([*argv, "--out", str(tmp_path / "why")]) == 2
    said = capsys.readouterr().err.strip()
    assert f"{folder.name}/{FILE}: " in said and "array" not in said and "\n" not in said
    assert not (tmp_path / "why").exists()


def test_what_is_compared_ends_where_the_force_stays_off_that_of_the_start(cell):
    recording = read_trial(folders(cell / "trials")[0]).recording
    n, first = len(recording.time), recording.ft
    assert first is not None
    ft = np.tile(first[0], (n, 1))
    ft[100, 0] += 2 * TOUCH  # one sample is no contact
    assert before_contact(replace(recording, ft=ft)) == n
    ft[200:, 2] += 1.01 * TOUCH
    touched = replace(recording, ft=ft)
    assert before_contact(touched) == 200 and HELD > 1
    assert before_contact(replace(recording, ft=None)) == n


@pytest.mark.parametrize("late", [0.0, 0.05])
def test_the_same_motion_is_followed_whatever_the_rate_and_the_gaps_of_the_readings(cell, late):
    """A robot's stale readings are dropped, and a slow driver reads less often than the simulation."""
    trial = read_trial(folders(cell / "trials")[0])

    def moved(time, late=0.0):
        q = 0.3 * np.sin(2 * (time - late))[:, None] * np.ones(7)
        rec = replace(trial.recording, time=time, q=q, ft=None, rate_hz=200.0)
        return replace(trial, recording=rec, steps=replace(trial.steps, time=np.array([0.4, 0.5])))

    full = np.arange(1600) / 200
    gaps = full[np.sort(np.random.default_rng(0).permutation(1600)[:1520])]
    off = 0.3 * (np.sin(2 * (full[80:] - late)) - np.sin(2 * full[80:]))  # rad, from the first step on
    expected = np.rad2deg(np.sqrt(np.mean(off**2))) * np.ones(7)
    for time in (full, gaps, np.arange(240) / 30):
        degrees, behind = _followed(moved(time, late), moved(full))
        np.testing.assert_allclose(degrees, expected, atol=0.02)
        assert behind == pytest.approx(late, abs=0.0051)


def test_replays_are_needed(cell, tmp_path):
    with pytest.raises(UserError, match="no replays"):
        explain(cell / "trials", "expert", replays=0, out=tmp_path / "why")


def test_trials_without_the_pictures_of_the_policy_are_explained_without_its_senses(cell, tmp_path):
    """They are of another policy; the replays are not lost."""
    first = min((cell / "trials").iterdir())
    shutil.copytree(first, tmp_path / "blind" / first.name)
    found = explain(tmp_path / "blind", "depth-S", replays=2, out=tmp_path / "why")
    (note,) = (n for n in found.record["notes"] if "senses" in n)
    assert f"{first.name} has no pictures of wrist_crop" in note and (tmp_path / "why" / "explain.html").is_file()
