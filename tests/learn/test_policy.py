"""A policy on disk acts as it did in memory, and nothing else is taken for one."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
import torch
from torch import nn
from torch.nn import functional as F

from vispeg.core.errors import UserError
from vispeg.learn.envs import of_policy
from vispeg.learn.interface import interface_of_policy
from vispeg.learn.layout import Layout
from vispeg.learn.modalities import modality, names
from vispeg.learn.networks.actor import Actor
from vispeg.learn.policy import NetPolicy, load, save
from vispeg.learn.record import WEIGHTS
from vispeg.learn.shipped import META
from vispeg.task.world_file import load_world

SHAPES = {"depth": (1, 24, 24), "rgb": (3, 24, 24)}


def made(name="depth", recurrent=0):
    torch.manual_seed(0)
    seen = modality(name)
    images = {f"{kind}_wrist": SHAPES[kind] for kind in seen.kinds}
    return NetPolicy(
        Actor(Layout(5, images, 3, 22 * seen.knows, tuple(range(12, 17)) * seen.knows), seen, (32,), recurrent), name
    )


def observation(policy, n=4, seed=0):
    rng = np.random.default_rng(seed)
    obs = {"policy": rng.standard_normal((n, 5)).astype(np.float32)}
    if policy.layout.truth:
        obs["privileged"] = rng.standard_normal((n, policy.layout.truth)).astype(np.float32)
    for key, shape in policy.actor.layout.images.items():
        image = rng.uniform(0, 0.4, (n, *shape))
        obs[key] = (600 * image).astype(np.uint8) if key.startswith("rgb") else image.astype(np.float32)
    return obs


@pytest.mark.parametrize("name", names())
@pytest.mark.parametrize("recurrent", [0, 8])
def test_saving_and_loading_keeps_every_action(tmp_path, name, recurrent):
    policy = made(name, recurrent)
    save(tmp_path / "p", policy.actor, name, {"seed": 3})
    other = load(tmp_path / "p")
    assert other.modality == name and other.meta == {"seed": 3}
    for p in (policy, other):
        p.reset(4)
    for k in range(3):
        obs = observation(policy, seed=k)
        assert np.array_equal(policy.act(obs), other.act(obs))


KINDS = [("state", 0), ("state", 8), ("depth", 0), ("rgbd", 8)]


def assert_each_row_acts_as_it_would_alone(policy, n=21):
    obs = [observation(policy, n, seed=k) for k in range(3)]

    def played(rows):
        policy.reset(len(rows))
        return np.stack([policy.act({key: value[rows] for key, value in o.items()}) for o in obs])

    together = played(np.arange(n))
    for rows in ([0], [13], [20, 3], list(range(7)), list(range(n))[::-1]):
        assert np.array_equal(played(np.array(rows)), together[:, rows])


@pytest.mark.parametrize(("name", "recurrent"), KINDS)
def test_actions_are_the_same_bit_for_bit_whatever_plays_beside(name, recurrent):
    assert_each_row_acts_as_it_would_alone(made(name, recurrent))


def placed(x, out, axis=0):
    """What a processor may make of a product: by a row's place, the number of rows, and where memory begins."""
    shape = [1] * out.ndim
    shape[axis] = out.shape[axis]
    place = torch.arange(out.shape[axis], dtype=out.dtype).reshape(shape)
    return out + 1e-4 * (place + out.shape[axis] + x.data_ptr() % 64)


@pytest.mark.parametrize(("name", "recurrent"), KINDS)
def test_they_are_on_a_processor_that_rounds_by_place_number_and_alignment(name, recurrent, monkeypatch):
    """Such as those with AVX-512, whose kernels take other ways through the last rows of a block than the first."""
    linear, conv, lstm = F.linear, F.conv2d, torch._VF.lstm

    def remembered(x, *args):
        out, *after = lstm(x, *args)
        return placed(x, out, 1), *after

    policy = made(name, recurrent)
    policy.reset(1)
    obs = observation(policy, 1)
    plain = policy.act(obs)
    monkeypatch.setattr(F, "linear", lambda x, *args: placed(x, linear(x, *args)))
    monkeypatch.setattr(nn.Conv2d, "_conv_forward", lambda self, x, w, b: placed(x, conv(x, w, b, 2, 1)))
    monkeypatch.setattr(torch._VF, "lstm", remembered)
    policy.reset(1)
    assert not np.array_equal(policy.act(obs), plain)  # it does round otherwise
    assert_each_row_acts_as_it_would_alone(policy)


@pytest.mark.slow
@pytest.mark.parametrize("path", [{"ATEN_CPU_CAPABILITY": "default", "DNNL_MAX_CPU_ISA": "SSE41"}])
def test_they_are_on_other_paths_through_this_processor(path):
    this = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", __file__, "-k", "whatever_plays_beside"]
    done = subprocess.run(this, env={**os.environ, **path}, capture_output=True, text=True, timeout=200)
    assert done.returncode == 0 and f"{len(KINDS)} passed" in done.stdout, done.stdout


def test_threads_change_no_action_and_are_left_as_they_were():
    policy, before = made("rgbd"), torch.get_num_threads()
    obs, found = observation(policy), []
    try:
        for threads in (1, 2):
            torch.set_num_threads(threads)
            found.append(policy.act(obs))
            assert torch.get_num_threads() == threads
    finally:
        torch.set_num_threads(before)
    assert np.array_equal(*found)


def test_a_row_that_begins_anew_forgets_and_others_do_not():
    policy, fresh = made("state", 8), made("state", 8)
    policy.reset(4)
    for k in range(3):
        policy.act(observation(policy, seed=k))
    policy.reset(4, np.array([True, False, False, False]))
    fresh.reset(4)
    obs = observation(policy, seed=9)
    same = (policy.act(obs) == fresh.act(obs)).all(axis=1)
    assert same.tolist() == [True, False, False, False]


@pytest.mark.parametrize(("name", "recurrent"), [("depth", 0), ("rgbd", 0), ("state", 8)])
def test_onnx_agrees(tmp_path, name, recurrent):
    runtime = pytest.importorskip("onnxruntime")
    pytest.importorskip("onnx")
    from vispeg.learn.onnx import export

    policy = made(name, recurrent)
    session = runtime.InferenceSession(export(policy, tmp_path / "p.onnx").read_bytes())
    policy.reset(6)
    state = {"hidden": np.zeros((1, 6, 8), np.float32), "cell": np.zeros((1, 6, 8), np.float32)} if recurrent else {}
    for k in range(3):
        obs = observation(policy, 6, seed=k)
        action, *after = session.run(None, obs | state)
        state = dict(zip(state, after, strict=True))
        assert np.allclose(action, policy.act(obs), atol=1e-5)


def test_an_observation_of_another_layout_is_refused():
    policy = made("depth")
    obs = observation(policy)
    with pytest.raises(UserError, match="depth_wrist.*another observation"):
        policy.act(obs | {"depth_wrist": obs["depth_wrist"][..., :20]})
    with pytest.raises(UserError, match="lacks a part"):
        policy.act({"policy": obs["policy"]})


def spoil_meta(folder, **changes):
    record = json.loads((folder / META).read_text())
    (folder / META).write_text(json.dumps(record | changes))


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda f: (f / META).unlink(), "not a policy's folder"),
        (lambda f: (f / META).write_text("{"), "not JSON"),
        (lambda f: (f / META).write_text("[]"), "not a policy"),
        (lambda f: spoil_meta(f, format="other/1"), "unknown format"),
        (lambda f: spoil_meta(f, modality="smell"), "no such modality"),
        (lambda f: spoil_meta(f, layout={"vector": "x"}), "not a policy's layout"),
        (lambda f: spoil_meta(f, net={"hidden": [8]}), "not the weights"),
        (lambda f: (f / WEIGHTS).write_bytes(b"\x80\x04pickle"), "not the weights"),
        (lambda f: (f / WEIGHTS).unlink(), "is missing"),
    ],
)
def test_what_is_not_a_policy_is_one_line(tmp_path, spoil, said):
    save(tmp_path, made().actor, "depth", {})
    spoil(tmp_path)
    with pytest.raises(UserError, match=said) as caught:
        load(tmp_path)
    assert "\n" not in str(caught.value)


def test_a_world_file_that_is_another_one_by_now_is_not_the_training_world(tmp_path):
    """What the robot would be given comes from it: force limit, gains, cameras."""
    world = tmp_path / "w.yaml"
    world.write_text("format: vispeg-world/1\n")
    shipped = load("state-3mm")
    meta = {**shipped.meta, "world_file": str(world), "world_hash": load_world(world).hash}
    policy = NetPolicy(shipped.actor, "state", meta)
    assert interface_of_policy(policy).controller.force_limit_n == 25
    world.write_text("format: vispeg-world/1\ntask: {force_limit: 5, stiffness: [30, 400]}\n")
    for ask in (interface_of_policy, of_policy):
        with pytest.raises(UserError, match="not the world that the policy was trained in any more"):
            ask(policy)
    assert interface_of_policy(policy, str(world)).controller.force_limit_n == 5
