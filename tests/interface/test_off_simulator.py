"""A policy off the simulator: the same observations, actions and targets from readings alone, in a process without
torch and without MuJoCo."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from vispeg.control.laws import rotation_vector
from vispeg.core.errors import UserError
from vispeg.interface.builder import Builder, Picture
from vispeg.interface.interface import Interface, read
from vispeg.render.cameras.camera import Camera
from vispeg.robots.model import load
from vispeg.sim.compiled import nominal_of
from vispeg.task.environments.vector import TaskVec
from vispeg.task.interface import interface_of
from vispeg.task.kinematics import chain_of

ALONE = """
import sys
import numpy as np
from vispeg.interface.builder import Builder, Picture
from vispeg.interface.exported import Exported

onnx, log, out = sys.argv[1:]
policy, data = Exported(onnx), np.load(log)
builder = Builder(policy.interface)
builder.begin(data["q"][0], data["dq"][0], data["goal"])
actions, targets, measured = [], [], []
for k in range(len(data["q"])):
    for wrench in data["wrench"][k]:
        builder.feel(wrench)
    pictures = {name: Picture(depth=data[name][k]) for name in data if name.startswith("wrist")}
    seen = builder.observe(data["q"][k], data["dq"][k], pictures)
    measured.append(seen["measured"][0])
    action = policy.act(seen)
    actions.append(action[0])
    targets.append(builder.act(action))
heavy = sorted({"torch", "mujoco", "gymnasium", "stable_baselines3"} & set(sys.modules))
assert not heavy, heavy
np.savez(out, actions=actions, targets=targets, measured=measured)
"""


def played(policy, world: str, mode: str, seed: int, steps: int) -> dict[str, np.ndarray]:
    """What the sensors of a simulated robot read, what the policy did, and which flange poses were held."""
    env = TaskVec(1, world, mode, autoreset_mode="Disabled", measured=True)
    ticks: list[np.ndarray] = []
    env.sim.heard = lambda q, dq, wrench: ticks.append(wrench[0].copy())
    obs, _ = env.reset(seed=[seed])
    policy.reset(1)
    keys = ("q", "dq", "wrench", "measured", "actions", "targets", *env.config.cameras)
    seen, out = env.sim.seen, {key: [] for key in keys}
    for _ in range(steps):
        out["measured"].append(obs["measured"][0])
        out["wrench"].append(ticks[-4:] or [np.zeros(6)] * 4)
        for key, values in zip(("q", "dq"), seen.measured, strict=True):
            out[key].append(values[0])
        for key in policy.layout.images:
            out[key.removeprefix("depth_")].append(obs[key][0, 0])
        out["actions"].append(policy.act(obs)[0])
        obs, _, terminated, truncated, _ = env.step(out["actions"][-1][None])
        out["targets"].append(np.concatenate([seen.goal[0], seen.rot[0]]))
        if terminated[0] or truncated[0]:
            break
    env.close()
    return {"goal": seen.believed[0], **{key: np.array(values) for key, values in out.items() if values}}


@pytest.mark.parametrize(
    ("name", "world", "mode", "steps"), [("state-3mm", "P", "state", 50), ("depth-S", "S", "depth", 5)]
)
def test_an_exported_policy_acts_the_same_without_torch_and_without_a_simulator(tmp_path, name, world, mode, steps):
    pytest.importorskip("onnxruntime")
    pytest.importorskip("onnx")
    pytest.importorskip("torch")
    from vispeg.api.export.policy import export_policy
    from vispeg.learn.policy import load as load_policy

    file = export_policy(name, tmp_path / "policy.onnx").file
    log = played(load_policy(name), world, mode, 1_000_003, steps)
    np.savez(tmp_path / "log.npz", **log)
    names = [str(file), str(tmp_path / "log.npz"), str(tmp_path / "out.npz")]
    subprocess.run([sys.executable, "-c", ALONE, *names], check=True, timeout=120)
    alone = np.load(tmp_path / "out.npz")
    assert len(log["actions"]) > 4
    np.testing.assert_allclose(alone["actions"], log["actions"], atol=2e-5)
    np.testing.assert_allclose(alone["measured"], log["measured"], rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(alone["targets"], log["targets"], atol=2e-5 * 0.01 + 1e-12)  # of an offset of 1 cm


def test_kinematics_are_those_of_the_model():
    arm, rng = load("iiwa14", tool="meg50"), np.random.default_rng(0)
    q, dq = rng.uniform(-2, 2, (40, 7)), rng.normal(size=(40, 7))
    _, jac, pos, rot, _ = nominal_of(arm, 40).operational(q)
    chain = chain_of(arm)
    flange, turn, twist, jacobian = type(chain).from_json(chain.to_json()).pose(q, dq)
    np.testing.assert_allclose(flange, pos, atol=1e-12)
    np.testing.assert_allclose(jacobian, jac, atol=1e-12)
    np.testing.assert_allclose(twist, np.einsum("nij,nj->ni", jac, dq), atol=1e-12)
    assert np.abs(rotation_vector(turn, rot)).max() < 1e-7


def interface(mode: str = "depth", **settings) -> Interface:
    env = TaskVec(1, "nominal", mode, **settings)
    keys = [key for key in env.single_observation_space.spaces if key != "policy"]
    env.close()
    return interface_of(env.config, env.sim.scene, mode, env.cameras, keys, modality=mode)


def test_the_meaning_is_read_back_to_the_same_bits():
    meaning = interface(dof=("x", "y", "z", "rx", "ry", "rz"))
    again = read(meaning.text(), Path("p.onnx"))
    assert again.text() == meaning.text()
    assert [t.name for t in again.told][-2:] == ["turn", "spin"] and again.arm.joints == load("iiwa14").joints


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"format": "vispeg-interface/9"}, "format"),
        ({"stack": 0}, "stack"),
        ({"arm": {"joints": []}}, "arm.joints"),
        ({"told": [{"name": "tip"}]}, "told"),
    ],
)
def test_a_meaning_that_cannot_be_is_one_clear_line(change, named):
    import json

    data = json.loads(interface("state").text())
    for key, value in change.items():
        data[key] = {**data[key], **value} if isinstance(value, dict) else value
    with pytest.raises(UserError) as error:
        read(json.dumps(data), Path("p.onnx"))
    assert "p.onnx" in str(error.value) and named in str(error.value) and "\n" not in str(error.value)


def test_a_picture_of_another_camera_is_seen_as_the_policy_knows_it():
    meaning = interface()
    eye = meaning.images["depth_wrist_wide"].eye
    camera = Camera("mine", 640, 480, 500.0, 500.0, 320.0, 240.0, (0.05, 0.0, 0.0, 0.0, 0.0))
    slope = camera.rays() @ [0.2, 0.1, 1.0]  # planar depth of a tilted plane: z (1 - a x - b y) = d
    depth = 0.3 / (2.0 - slope)
    builder = Builder(meaning)
    builder.begin(np.zeros(7), np.zeros(7))
    pictures = {name: Picture(depth=depth, camera=camera) for name in ("wrist_wide", "wrist_crop")}
    image = builder.observe(np.zeros(7), np.zeros(7), pictures)["depth_wrist_wide"][0, 0]
    expected = 0.3 / (2.0 - eye.rays() @ [0.2, 0.1, 1.0])
    inside = image > 0
    assert inside.mean() > 0.5
    np.testing.assert_allclose(image[inside], expected[inside], rtol=2e-3)
    with pytest.raises(UserError, match="wrist_crop"):
        builder.observe(np.zeros(7), np.zeros(7), {"wrist_wide": pictures["wrist_wide"]})
