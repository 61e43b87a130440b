"""A log that is played again is the trial that it was: the policy sees and asks for the same, and it ends as it did."""

import json
from dataclasses import replace

import numpy as np
import pytest
from lockstep import Lockstep
from reaching import meaning

from vispeg.api.run import opened, run
from vispeg.cli.main import main
from vispeg.core.errors import UserError
from vispeg.core.notes import Note
from vispeg.datasets.read import Dataset
from vispeg.recordings.cell import Outcome, reaction
from vispeg.recordings.frames.camera import RecordedCamera
from vispeg.recordings.frames.frames import Frames, RecordedFrame
from vispeg.recordings.load import load
from vispeg.recordings.recording import Control, Recording
from vispeg.recordings.write import write
from vispeg.trials.limits import Limits
from vispeg.trials.logged import FORCE, LoggedRobot
from vispeg.trials.loop import How, run_episode
from vispeg.trials.tape import recorded
from vispeg.trials.trial import PolicyPart, folders, read_trial, write_trial

SEED, FEW = 3, 4  # FEW: steps of the policy that sees


def logged(place, name, world, steps=None):
    """A policy's run on a robot, as a trial, and a recording of it in which nothing speaks of a policy."""
    policy, interface, who = opened(name, None, None)
    short = interface if steps is None else interface.model_copy(update={"steps": steps})
    robot = Lockstep(world, interface.modality)
    ran = run_episode(policy, short, robot, who, SEED, How(rest=0.0), clock=robot, watch=False)
    write_trial(ran, place / "trial")
    write(ran.recording, place / "log")
    return place


@pytest.fixture(scope="module")
def state(tmp_path_factory):
    return logged(tmp_path_factory.mktemp("state"), "state-3mm", "nominal")


@pytest.fixture(scope="module")
def depth(tmp_path_factory):
    return logged(tmp_path_factory.mktemp("depth"), "depth-S", "S", FEW)


# what a log keeps is rounded: depth to .1 mm, which a network may turn into a little more of an action
@pytest.mark.parametrize(("name", "seen", "place"), [("state-3mm", 1e-5, 1e-6), ("depth-S", 2e-3, 5e-5)])
def test_the_policy_sees_and_does_the_same(name, seen, place, request, tmp_path):
    log = request.getfixturevalue(name.partition("-")[0])
    once = read_trial(log / "trial")
    result = run(name, f"log:{log / 'log'}", tmp_path / "again")
    (again,) = (read_trial(folder) for folder in folders(result.folder))
    n = len(once.steps.time)
    assert n >= FEW and len(again.steps.time) >= n
    np.testing.assert_allclose(again.steps.time[:n], once.steps.time, atol=1e-9)
    np.testing.assert_allclose(again.steps.seen[:n], once.steps.seen, atol=seen)
    np.testing.assert_allclose(again.steps.target[:n, :3], once.steps.target[:, :3], atol=place)
    assert again.said.start.q_rad == pytest.approx(once.said.start.q_rad, abs=1e-6)
    assert again.said.outcome.success == once.said.outcome.success and not again.said.how.shadow
    assert (again.recording.frames is None) == (name == "state-3mm")


def test_it_ends_as_the_log_says_and_has_as_many_episodes(depth, tmp_path):
    rec, both = load(depth / "log"), tmp_path / "both"
    for name, category in (("a", "jam"), ("b", "dropped")):
        write(replace(rec, outcomes=(Outcome(False, 0, category, 12.5),)), both / name)
    assert main(["run", "depth-S", "--robot", f"log:{both}", "--out", str(tmp_path / "t"), "--quiet"]) == 0
    found = [read_trial(p).said.outcome for p in folders(tmp_path / "t")]
    assert [(o.category, o.by, o.peak_force_n) for o in found] == [("jam", "robot", 12.5), ("dropped", "robot", 12.5)]
    with pytest.raises(UserError, match="no more episodes"):
        run("depth-S", f"log:{both}", tmp_path / "more", episodes=3)
    assert not (tmp_path / "more").exists(), "and that is known before the first"


def test_another_policy_s_log_is_said_to_be_one(state, tmp_path):
    with pytest.warns(Note, match="commands differ from the policy's by .* mm .median."):
        run("state-0.5mm", f"log:{state / 'log'}", tmp_path / "other")


def test_a_limit_is_said_to_stop_no_log(state):
    robot, limits = LoggedRobot(state / "log"), Limits(force=1.0)
    with pytest.warns(Note, match="limits of force, speed and reach do not stop it"):
        robot.how(How(limits))
    robot.how(How())


def test_what_is_no_log_of_this_arm_is_refused(depth, tmp_path, capsys):
    rec = load(depth / "log")
    write(replace(rec, joints=tuple("abcdefg")), tmp_path / "renamed")
    write(replace(rec, frames=None), tmp_path / "blind")
    wrong = {"nothing": "nothing", "renamed": "joints of another arm", "blind": "no picture of a camera"}
    for name, words in wrong.items():
        assert main(["run", "depth-S", "--robot", f"log:{tmp_path / name}", "--out", str(tmp_path / "x")]) == 2
        assert words in capsys.readouterr().err and not (tmp_path / "x").exists()


def test_a_folder_in_lerobot_s_layout_is_a_log_too(tmp_path):
    """What the policy is told is what the folder says that it was told: poses and forces by their names."""
    folder = tmp_path / "frames"
    argv = ["render", "--world", "nominal", "--frames", "40", "--size", "64", "--looks", "1", "--workers", "0"]
    assert main([*argv, "--no-labels", "--out", str(folder), "--quiet", "--json"]) == 0
    data = Dataset(folder)
    with pytest.warns(Note, match="interpolated"):
        result = run("depth-S", f"log:{folder}", tmp_path / "trials")
    trials = [read_trial(p) for p in folders(result.folder)]
    numbers = [k for k, row in enumerate(data.episodes) if row["length"] > 1]
    assert data.successes is not None and len(trials) == len(numbers)
    for k, trial in zip(numbers, trials, strict=True):
        told = data.episode(k)["observation.policy"][: len(trial.steps.time)]
        assert trial.steps.time == pytest.approx(np.arange(len(told)) / data.info["fps"])
        np.testing.assert_allclose(trial.steps.seen[: len(told), :3], told[:, :3], atol=1e-3)  # place of the tip
        # forces are those of the sample but for the part of a mean that reaches back towards the one before
        np.testing.assert_allclose(trial.steps.seen[1 : len(told), 6:12], told[1:, 6:12], atol=0.1)
        assert trial.said.outcome.success == data.successes[k] or trial.said.outcome.by == "measured"


class Still:
    """A policy that never moves."""

    def reset(self, n, rows=None):
        pass

    def act(self, obs):
        return np.zeros(3)


def test_forces_without_weight_and_torques_with_it_come_back_from_lerobot_s_layout(tmp_path):
    """A tilted hand at rest: the folder holds what an observer reads of the weight, the trial the weight."""
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    interface, n = meaning("state"), 3
    names, seen = [*interface.arm.joints, *FORCE], interface.observer()
    q = np.array(interface.arm.home_rad) + [0, 0, 0, 0, 0, 0.3, 0]
    seen.see(q[None], 0 * q[None])
    turn = interface.chain.rotation(q[None])[0]
    weight = interface.tool.weight_at(turn)
    seen.feel(weight[None, None])
    assert np.abs(seen.readings()[0, -6:-3]).max() < 1e-9 < np.abs(seen.readings()[0, -3:]).max()
    state = np.concatenate([q, seen.readings()[0, -6:]])
    counted = {k: {"dtype": "int64", "shape": [1], "names": None} for k in ("frame_index", "episode_index", "index")}
    counted |= {"timestamp": {"dtype": "float32", "shape": [1], "names": None}, "task_index": counted["index"]}
    features = counted | {"observation.state": {"dtype": "float64", "shape": [len(names)], "names": names}}
    info = {"codebase_version": "v2.1", "fps": 10, "total_frames": n, "chunks_size": 1000, "features": features}
    info["data_path"] = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
    for part in ("meta", "data/chunk-000"):
        (tmp_path / "set" / part).mkdir(parents=True)
    (tmp_path / "set/meta/info.json").write_text(json.dumps(info))
    (tmp_path / "set/meta/episodes.jsonl").write_text(json.dumps({"episode_index": 0, "length": n}) + "\n")
    rows = {"frame_index": np.arange(n), "index": np.arange(n), "timestamp": np.float32(np.arange(n) / 10)}
    rows |= {"episode_index": np.zeros(n, int), "task_index": np.zeros(n, int), "observation.state": [state] * n}
    pq.write_table(pa.table(rows), tmp_path / "set/data/chunk-000/episode_000000.parquet")
    robot, who = LoggedRobot(tmp_path / "set"), PolicyPart(name="still", digest="", modality="state")
    with pytest.warns(Note, match="interpolated"):
        ran = run_episode(Still(), interface, robot, who, 0, robot.how(How()), clock=robot, watch=False)
    np.testing.assert_allclose(reaction(ran.recording.ft), np.tile(weight, (len(ran.recording.ft), 1)), atol=1e-6)


def test_a_log_s_camera_keeps_its_lens_and_its_place_and_colour_may_come_twice_as_often_as_depth(tmp_path):
    interface = meaning("rgbd")
    name = next(iter(interface.images)).partition("_")[2]
    eye, at = recorded({k.partition("_")[2]: v.eye for k, v in interface.images.items()}[name], name), np.arange(5) / 20
    lens = RecordedCamera(name, 8, 6, 9.0, 9.5, 3.4, 2.6)
    colour = [np.full((6, 8, 3), k, np.uint8) for k in range(5)]
    deep = [None if k % 2 == 0 else np.full((6, 8), 0.1 * k, np.float32) for k in range(5)]
    other = replace(lens, name="unknown")
    frames = [RecordedFrame(*row) for row in zip(at, [lens] * 5, colour, deep, strict=True)]
    frames += [RecordedFrame(t, other, c) for t, c in zip(at, colour, strict=True)]
    q = np.tile(interface.arm.home_rad, (5, 1))
    control = Control("position", 20.0, "model", np.full(7, 40.0), np.full(7, 0.1))
    rec = Recording(tmp_path, "iiwa14", interface.arm.joints, 20.0, control, at, q=q, q_cmd=q)
    write(replace(rec, frames=Frames({name: lens, "unknown": other}, tuple(frames))), tmp_path / "log")
    robot = LoggedRobot(tmp_path / "log")
    robot.connect(interface, 0)
    for k, depth in enumerate((0.1, 0.1, 0.1, 0.3, 0.3)):  # before the first of depth: that one, as of colour
        robot.wait(at[k])
        told = robot.read((name, "unknown")).pictures
        assert list(told) == [name] and (told[name].rgb == k).all()
        np.testing.assert_allclose(told[name].depth, depth, atol=1e-3)
        kept = recorded(told[name].camera, name)
        assert (kept.mount, kept.width, kept.fy, kept.cx) == (eye.mount, 8, 9.5, 3.4) and kept.mount is not None
        np.testing.assert_array_equal(kept.pose, eye.pose)
