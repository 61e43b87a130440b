"""Folders of another writer give a policy the inputs that it was trained on: as rendered, and as its environment."""

import json
from pathlib import Path

import numpy as np
import pytest
from gymnasium import spaces
from their_folders import write

from vispeg.api.datasets import render_dataset
from vispeg.cli.main import main
from vispeg.core.errors import UserError
from vispeg.datasets.read import Dataset
from vispeg.learn.experience.shown import from_folder
from vispeg.learn.layout import Layout
from vispeg.task.environments.vector import TaskVec
from vispeg.task.interface import interface_in

CAMERAS = ("wrist_wide", "wrist_crop")
SIZE = 48
PICTURES = [f"observation.images.{c}" for c in CAMERAS]


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    out = tmp_path_factory.mktemp("rendered") / "frames"
    render_dataset(out, "S", frames=60, noise=0, size=SIZE, labels=False, seed=1, workers=0, backend="raycast")
    return out


def rewritten(rendered, folder, video=False, version="v3.0", less=(), **more):
    """The same demonstrations as another tool would write them: by names, without what only `vispeg render` writes."""
    data = Dataset(rendered)
    names = {
        "observation.state": [n + ".pos" * n.startswith("joint") for n in data.features["observation.state"]["names"]]
    }
    names |= {"action": ["x", "y", "z"], **dict.fromkeys(PICTURES, [SIZE, SIZE])}
    keep = [i for i, n in enumerate(names["observation.state"]) if n.removesuffix(".pos") not in less]
    names["observation.state"] = [names["observation.state"][i] for i in keep]
    episodes = []
    for e in range(len(data.episodes)):
        frames = data.episode(e)
        episode = {"observation.state": frames["observation.state"][:, keep], "action": frames["action"]}
        episode["next.success"] = frames["next.success"].astype(bool)
        episodes.append(episode | {key: frames[key] if video else data.bytes(e, key) for key in PICTURES})
    return write(folder, episodes, names, video=video, version=version, **more)


def config_of(world="S", **settings):
    env = TaskVec(1, world, "proprio", **settings)
    env.close()
    return env.config


def shown(folder, layout=None, modality="rgb", say=lambda text: None, **settings):
    """Everything that a policy would learn from, in order."""
    layout = layout or Layout(30, {f"rgb_{c}": (3, SIZE, SIZE) for c in CAMERAS}, 3)
    ring = from_folder(folder, modality, layout, 0, config=config_of(**settings), say=say)
    return ring._batch(*np.nonzero(ring.starts))


@pytest.mark.parametrize(("version", "video"), [("v3.0", False), ("v3.0", True), ("v2.1", False), ("v2.1", True)])
def test_a_rendered_folder_without_our_columns_shows_the_same(rendered, tmp_path, version, video):
    """Numbers within float32; pictures bit for bit, and from videos within what their colours lose."""
    folder = rewritten(rendered, tmp_path / "theirs", video, version, fps=6 if video else 6.25)
    features = json.loads((folder / "meta" / "info.json").read_text())["features"]
    assert not [name for name in features if name.startswith(("label.", "executed", "observation.policy"))]
    ours, theirs = shown(rendered), shown(folder)
    np.testing.assert_allclose(theirs.obs["policy"].numpy(), ours.obs["policy"].numpy(), atol=2e-5)
    np.testing.assert_allclose(theirs.next_obs["policy"].numpy(), ours.next_obs["policy"].numpy(), atol=2e-5)
    assert np.array_equal(theirs.action.numpy(), ours.action.numpy())
    assert np.array_equal(theirs.done.numpy(), ours.done.numpy())
    for key in (f"rgb_{c}" for c in CAMERAS):
        a, b = (batch.obs[key].numpy().astype(float) for batch in (theirs, ours))
        assert np.abs(a - b).max() <= (4 if video else 0) and b.std() > 5


def test_a_loggers_folder_gives_what_the_environment_tells(tmp_path):
    """Joints, their speeds and a wrench by name, of an arm that also turns; actions as poses of the tip."""
    dof = ("x", "y", "z", "rx", "ry")
    env = TaskVec(1, "nominal", "proprio", autoreset_mode="Disabled", dof=dof, stack=3, steps=12)
    joints = env.sim.scene.nominal.joints
    rng, episodes, told, meant = np.random.default_rng(1), [], [], []
    for seed in range(2):
        obs, _ = env.reset(seed=[seed])
        rows, acts = [], []
        for _ in range(12):
            o, offset = env.sim.seen, rng.uniform(-1, 1, 5)
            rows.append(np.concatenate([*(part[0] for part in o.measured), o.wrench[0]]))
            motion = np.zeros((1, 6))
            motion[:, :5] = offset
            held, rot = o.offset_by(motion)
            acts.append(np.concatenate([held[0], rot[0]]))
            told.append(obs["policy"][0])
            meant.append(offset)
            obs, *_ = env.step(offset[None])
        episodes.append({"observation.state": np.array(rows), "action": np.array(acts)})
    wrench = [f"{part}_{axis}" for part in ("force", "torque") for axis in "xyz"]
    names = {"observation.state": [*(f"{j}.pos" for j in joints), *(f"{j}.vel" for j in joints), *wrench]}
    folder = write(tmp_path / "logged", episodes, names, version="v2.1")
    layout = Layout(len(told[0]), {}, 5)
    with pytest.raises(UserError, match="the meaning of its actions is not stated"):
        shown(folder, layout, "proprio", world="nominal", dof=dof, stack=3)
    batch = shown(f"{folder}?action=tip_goal", layout, "proprio", world="nominal", dof=dof, stack=3)
    np.testing.assert_allclose(batch.obs["policy"].numpy(), told, atol=2e-5)
    np.testing.assert_allclose(batch.action.numpy(), meant, atol=1e-5)
    said, far = [], np.concatenate([np.full((3, 5), 2.0), np.zeros((9, 5))])
    folder = write(tmp_path / "far", [episode | {"action": far} for episode in episodes], names)
    batch = shown(folder, layout, "proprio", said.append, world="nominal", dof=dof, stack=3)
    assert said == ["6 of 24 actions asked for more than the controller takes"]
    np.testing.assert_array_equal(batch.action.numpy(), np.clip(np.tile(far, (2, 1)), -1, 1))
    env.close()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("column", ["joint3.pos", "joint3.vel", "force_y", "y", "next.reward"])
def test_a_number_that_is_none_is_refused_where_it_stands_and_counts_not_as_0(tmp_path, column, bad):
    """At the first frame a wrench counts for nothing, as on a robot."""
    config = config_of("nominal")
    joints = [f"joint{i}" for i in range(1, 8)]
    wrench = [f"{part}_{axis}" for part in ("force", "torque") for axis in "xyz"]
    names = {"observation.state": [*(f"{j}.pos" for j in joints), *(f"{j}.vel" for j in joints), *wrench]}
    names["action"] = ["x", "y", "z"]
    names["label.environment_state"] = [f"t{i}" for i in range(22)]
    home = np.concatenate([interface_in(config, None, "proprio", modality="proprio").arm.home_rad, np.zeros(13)])
    episodes = [
        {
            "observation.state": np.tile(home, (6, 1)),
            "action": np.zeros((6, 3)),
            "label.environment_state": np.zeros((6, 22)),
            "next.reward": np.zeros(6),
        }
        for _ in range(2)
    ]
    episodes[1]["observation.state"][0, names["observation.state"].index("force_y")] = bad
    beside = spaces.Dict({"policy": spaces.Box(-1, 1, (30,)), "privileged": spaces.Box(-1, 1, (22,))})
    how = {"config": config, "beside": beside}
    from_folder(write(tmp_path / "whole", episodes, names), "proprio", Layout(30, {}, 3), 0, **how)
    feature = next((f for f, those in names.items() if column in those), column)
    value = episodes[1][feature].reshape(6, -1)
    value[4, names[feature].index(column) if feature in names else 0] = bad
    episodes[1][feature] = value.reshape(episodes[1][feature].shape)
    said = column.removesuffix(".pos") if feature in ("observation.state", "next.reward") else feature
    with pytest.raises(UserError, match=f"{said}, episode 1, frame 4: is not finite; expected a number; got {bad}"):
        from_folder(write(tmp_path / "gap", episodes, names), "proprio", Layout(30, {}, 3), 0, **how)


def test_what_a_folder_lacks_is_one_line_before_anything_is_played(rendered, tmp_path, capsys, monkeypatch):
    """The column and what there is."""
    monkeypatch.chdir(tmp_path)
    cases = {
        "tip": ({"less": ("joint3", "tip_x")}, "lacks what the policy needs for its tip; expected joint1 joint2"),
        "speed": ({"less": ("velocity_y",)}, "needs for its velocity; expected velocity_x velocity_y velocity_z or"),
        "force": ({"less": ("force_z",)}, "needs for its force; expected force_x force_y force_z"),
        "rate": ({"fps": 30}, "frames at another rate than the policy acts; expected 6.25; got 30"),
    }
    for name, (change, said) in cases.items():
        rewritten(rendered, tmp_path / name, **change)
        refused(capsys, said, f"finetune rgb-S --world S --dataset {name} --out tuned")
        refused(capsys, said, f"train peg-rgb --recipe distill --dataset {name} --out run")
    refused(capsys, "no such kind of action", "finetune rgb-S --world S --dataset rate?action=knees --out tuned")


def refused(capsys, said, command):
    assert main(command.split()) == 2
    err = capsys.readouterr().err.strip()
    assert said in err and "\n" not in err, err
    assert not Path("tuned").exists() and not Path("run").exists()


def test_whole_commands_learn_from_it(rendered, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rewritten(rendered, tmp_path / "theirs", video=True)
    command = "finetune rgb-S --world S --dataset theirs --updates 2 --episodes 1 --known 0 --out tuned"
    assert main(command.split()) == 0
    assert " demonstrations\n" in capsys.readouterr().out
    assert (tmp_path / "tuned" / "policy.safetensors").is_file()
    command = "train peg-rgb --world S --recipe distill --dataset theirs --distill-updates 2 --episodes 1 --films 0"
    assert main([*command.split(), "--target", "0", "--out", "run"]) == 0
    assert (tmp_path / "run" / "checkpoints" / "best" / "policy.safetensors").is_file()
