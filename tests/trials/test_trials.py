"""Trials as files: kept by an evaluation, read as recordings and as a robot's outcomes, begun with again, refused."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from lockstep import Lockstep
from test_run import SEED, ran

from vispeg.api.evaluate import evaluate
from vispeg.api.learning.finetune import failed_starts
from vispeg.cli.main import main
from vispeg.core.errors import UserError
from vispeg.evaluation.measured import read_measured
from vispeg.evaluation.replay import Begun, Replays
from vispeg.learn.evaluation import run_episodes
from vispeg.recordings.load import load
from vispeg.task.environments.vector import TaskVec
from vispeg.task.scripted import Scripted
from vispeg.trials.loop import REST
from vispeg.trials.trial import FILE, PolicyPart, folders, read_said, read_trial, write_trial
from vispeg.trials.trial import _example as example


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    place = tmp_path_factory.mktemp("kept")
    argv = ["evaluate", "expert", "--world", "searching", "--episodes", "3", "--videos", "0", "--out", str(place / "e")]
    assert main([*argv, "--keep-trials", str(place / "trials"), "--quiet", "--json"]) == 0
    return place


def test_an_evaluation_keeps_its_episodes_and_they_begin_and_end_the_same_again(kept):
    lines = [json.loads(line) for line in (kept / "e" / "episodes.jsonl").read_text().splitlines()]
    trials = [read_trial(folder) for folder in folders(kept / "trials")]
    assert [t.said.seed for t in trials] == sorted(line["seed"] for line in lines) and len(trials) == 3
    env = TaskVec(1, "searching", autoreset_mode="Disabled")
    for trial, line in zip(trials, sorted(lines, key=lambda line: line["seed"]), strict=True):
        said = trial.said
        assert (said.outcome.success, said.outcome.category) == (line["success"], line["category"])
        assert trial.recording.outcomes[0].category == line["category"]
    obs, _ = env.reset(seed=[7], options={"start": trials[0].said.begin()})
    info = {}
    for k, action in enumerate(trials[0].steps.action):
        np.testing.assert_allclose(obs["policy"][0], trials[0].steps.seen[k], atol=2e-3, err_msg=f"step {k}")
        obs, _, _, _, info = env.step(action[None])
    assert info["record"][0]["category"] == trials[0].said.outcome.category


def test_an_episode_under_a_control_is_no_trial_of_the_policy(tmp_path):
    evaluate("expert", episodes=1, controls="hole_fixed", trials=tmp_path / "t")
    assert len(read_measured(tmp_path / "t").episodes) == 1


def test_pictures_that_a_policy_saw_are_the_frames_of_its_recording(tmp_path):
    pytest.importorskip("torch")
    argv = "evaluate depth-S --world S --episodes 1 --videos 0 --workers 1 --quiet --json".split()
    assert main([*argv, "--out", str(tmp_path / "e"), "--keep-trials", str(tmp_path / "t")]) == 0
    trial = read_trial(folders(tmp_path / "t")[0])
    frames = trial.recording.frames
    assert frames is not None and sorted(frames.names) == ["wrist_crop", "wrist_wide"]
    wide = frames.of("wrist_wide")
    np.testing.assert_allclose(wide.times, trial.steps.time)
    assert wide[0].depth.shape == (48, 48) and 0.05 < np.median(wide[0].depth) < 0.5


def test_a_replay_whose_goal_nobody_measured_has_it_where_its_policy_was_told(tmp_path):
    """A real robot's trials state the belief alone; the goal of another place would be missed by every replay."""
    said, seeds = read_said(example(tmp_path)), range(1_000_000, 1_000_008)
    env = TaskVec(len(seeds), "S", autoreset_mode="Disabled", privileged=True)
    nominal = env.sim.nominal_goal.tolist()
    start = said.start.model_copy(update={"goal_m": None, "believed_m": nominal, "q_rad": env.sim.home[0].tolist()})
    real = said.model_copy(update={"start": start, "policy": PolicyPart(name="a", modality="state")})
    expert = Scripted(env.config)
    begun = Begun(env, Replays({s: real.again() for s in seeds}))
    assert sum(e.success for e in run_episodes(expert, begun, list(seeds))) >= len(seeds) / 2
    unseen = real.model_copy(update={"policy": PolicyPart(name="a", modality="depth")})
    assert unseen.again().goal is None, "of a policy that must find the goal, the world draws it"
    measured = real.model_copy(update={"start": start.model_copy(update={"goal_m": [0.61, 0.0, 0.05]})})
    assert measured.again().goal.tolist() == [0.61, 0.0, 0.05]


def test_trials_are_a_robots_outcomes_for_gap(kept, tmp_path):
    found = read_measured(kept / "trials", "robot", {"expert": {0}})
    assert [(e.policy, e.world, e.seed) for e in found.episodes] == [
        ("expert", "robot", 1_000_000 + k) for k in range(3)
    ]
    renamed = read_measured(kept / "trials", "robot", {"mine": {4}}, {"expert": ("mine", 4)})  # told by its digest
    assert {(e.policy, e.train_seed) for e in renamed.episodes} == {("mine", 4)}
    with pytest.raises(UserError, match="unknown policy"):
        read_measured(kept / "trials", "robot", {"other": {0}})
    argv = ["gap", "--records", str(kept / "e" / "episodes.jsonl"), "--worlds", "searching", "--controls", "none"]
    argv += ["--measured", str(kept / "trials"), "--robot", "arm", "--out", str(tmp_path / "gap"), "--quiet", "--json"]
    assert main(argv) == 0
    record = json.loads((tmp_path / "gap" / "gap.json").read_text())
    assert {row["world"] for row in record["success"]} == {"searching", "arm"}


def changed(folder, out, **how):
    """A copy of a trial, run as `how` says, that failed."""
    shutil.copytree(folder, out)
    said = yaml.safe_load((out / FILE).read_text())
    said["outcome"] |= {"success": False, "category": "jam"}
    (out / FILE).write_text(yaml.safe_dump({**said, "how": how}))
    return out


@pytest.mark.parametrize("how", [{"shadow": True}, {"slow": 0.25}])
def test_only_trials_at_full_speed_say_how_well_a_policy_does(kept, tmp_path, how):
    first, second, _ = folders(kept / "trials")
    changed(first, tmp_path / "some" / "a", **how)
    with pytest.raises(UserError, match="moved at full speed"):
        read_measured(tmp_path / "some")
    with pytest.raises(UserError, match="no trial failed"):
        failed_starts(tmp_path / "some")
    changed(second, tmp_path / "some" / "b")
    found = read_measured(tmp_path / "some")
    assert [e.seed for e in found.episodes] == [read_said(second).seed] and len(found.notes) == 1
    assert len(failed_starts(tmp_path / "some")) == 1


def test_trials_of_another_policy_of_that_name_are_noted(kept):
    given, other = ({digest: ("expert", 0)} for digest in ("expert", "f" * 64))
    assert not read_measured(kept / "trials", "robot", {"expert": {0}}, given).notes
    (note,) = read_measured(kept / "trials", "robot", {"expert": {0}}, other).notes
    assert "another policy than the expert" in note


@pytest.mark.slow
def test_a_trial_is_a_recording_that_compare_reads(tmp_path):
    """It begins at rest in free air, so that contact is compared too: of its own cell nothing is left to explain."""
    trial = ran(Lockstep("nominal"), rest=REST)
    folder = write_trial(trial, tmp_path / "trial-0001")
    assert trial.steps.time[0] == pytest.approx(REST) and trial.said.outcome.time_s < 3
    assert load(folder).cell is not None and trial.said.seed == SEED
    for model in ("iiwa14", "peg-cell"):
        out = tmp_path / model
        assert main(["compare", model, "--recording", str(folder), "--out", str(out), "--quiet"]) == 0
        assert json.loads((out / "compare.json").read_text())["chi2"] < 1


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"outcome": None}, "outcome"),
        ({"outcome": {"success": True, "category": "jam", "by": "robot", "time_s": 1.0}}, "contradict"),
        ({"outcome": {"success": False, "category": "jam", "by": "rumour", "time_s": 1.0}}, "outcome.by"),
        ({"start": {"q_rad": []}}, "start.q_rad"),
        ({"policy": {"name": "a", "colour": "red"}}, "colour"),
        ({"mood": "fine"}, "mood"),
        ({"format": "vispeg-trial/9"}, "format"),
    ],
)
def test_a_trial_that_cannot_be_is_one_line_with_its_file(tmp_path, change, named):
    folder = example(tmp_path)
    data = yaml.safe_load((folder / FILE).read_text()) | change
    (folder / FILE).write_text(yaml.safe_dump({k: v for k, v in data.items() if v is not None}))
    with pytest.raises(UserError) as error:
        read_said(folder)
    said = str(error.value)
    assert FILE in said and named in said and "\n" not in said


def test_a_table_of_steps_that_was_cut_between_two_rows_is_refused(kept, tmp_path):
    """As a full disk or a stopped copy leaves it: what is there reads well."""
    shutil.copytree(folders(kept / "trials")[0], folder := tmp_path / "trial-0001")
    whole = (folder / "steps.csv").read_text().splitlines(keepends=True)
    (folder / "steps.csv").write_text("".join(whole[:4]))
    with pytest.raises(UserError, match=rf"steps.csv: has the wrong number of rows.*expected {len(whole) - 1} .*got 3"):
        read_trial(folder)


def test_bad_folders_are_refused_and_left_as_they_are(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("mine").mkdir()
    Path("mine/thesis.txt").write_text("words")
    plain = "evaluate expert --world nominal --episodes 1 --videos 0 --out e"
    for argv in (f"{plain} --keep-trials mine", "gap expert --worlds nominal --measured mine --out g"):
        assert main(argv.split()) == 2
        said = capsys.readouterr().err.strip()
        assert "mine" in said and "\n" not in said
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["mine", "thesis.txt"]
