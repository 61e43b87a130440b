"""A task of one's own that the package knows nothing of, `docs/examples/snap_fit`; also kept by `test_contract`."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from vispeg.core.errors import UserError
from vispeg.task.environments.vector import TaskVec
from vispeg.task.registry import config_of, digest_of, task, task_of

EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "snap_fit"


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    monkeypatch.syspath_prepend(str(EXAMPLE))


def test_its_code_is_in_the_worlds_hash(tmp_path, monkeypatch):
    """Another latch in the same file is another world."""
    text = (EXAMPLE / "snap_fit.py").read_text()
    hashes = []
    for name, own in (("one_fit", text), ("same_fit", text), ("other_fit", text.replace("LIP = 0.016", "LIP = 0.017"))):
        (tmp_path / f"{name}.py").write_text(own)
    (tmp_path / "other_fit.py").write_text(text.replace("0.016, 0.020, 0.006", "0.016, 0.020, 0.005"))
    monkeypatch.syspath_prepend(str(tmp_path))
    hashes = [digest_of(f"{name}:SnapFit") for name in ("one_fit", "same_fit", "other_fit")]
    assert hashes[0] == hashes[1] != hashes[2] and digest_of("peg") is None


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("pge", "no such task.*MODULE:CLASS.*'pge'.*'peg'"),
        ("no_such_module:Task", "no such task.*no_such_module"),
        ("snap_fit:Nothing", "no such task.*Nothing"),
        (".snap_fit:SnapFit", "no such task.*PYTHONPATH"),
        ("snap_fit:SnapConfig", "not a task.*vispeg.task.contract.Task"),
        (3, "task.name: wrong type"),
    ],
)
def test_a_task_that_is_none_is_refused_in_one_line(name, message, tmp_path):
    with pytest.raises(UserError, match=message) as error:
        config_of({"name": name}, "w.yaml")
    assert "\n" not in str(error.value) and "w.yaml" in str(error.value)


def test_settings_of_another_task_are_refused():
    with pytest.raises(UserError, match="task.peg_mesh: unknown key"):
        config_of({"name": "snap_fit:SnapFit", "peg_mesh": "a.stl"}, "w.yaml")
    config = config_of({"name": "snap_fit:SnapFit", "spring": 1000})
    assert task_of(config) is task("snap_fit:SnapFit") and config.spring == 1000


def test_the_latch_takes_the_force_that_its_spring_says_and_springs_back():
    """Held still, the nose pushed back by d carries spring * d; let go, it is out again."""
    import mujoco

    scene = task("snap_fit:SnapFit").cell(config_of({"name": "snap_fit:SnapFit", "spring": 2000.0}))
    model = scene.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    latch = model.joint("latch")
    data.qpos[latch.qposadr[0]] = -0.001
    mujoco.mj_forward(model, data)
    assert data.qfrc_spring[latch.dofadr[0]] == pytest.approx(2000.0 * 0.001)


def test_nothing_in_the_package_knows_the_example():
    package = EXAMPLE.parents[2] / "vispeg"
    assert not [p for p in package.rglob("*.py") if "snap_fit" in p.read_text() or "snap-fit" in p.read_text()]


@pytest.mark.slow
def test_a_policy_is_trained_in_it_by_the_same_command(tmp_path):
    pytest.importorskip("torch")
    small = ["--steps", "160", "--every", "160", "--envs", "8", "--episodes", "4", "--utd", "0.1"]
    command = [sys.executable, "-m", "vispeg", "train", "snap_fit-privileged", "--world", str(EXAMPLE / "snap.yaml")]
    path = {"PYTHONPATH": f"{EXAMPLE}:{EXAMPLE.parents[2]}"}
    done = subprocess.run(
        [*command, *small, "--out", str(tmp_path / "run")],
        env={**os.environ, **path},
        capture_output=True,
        text=True,
        timeout=240,
    )
    assert done.returncode == 0, done.stderr
    from vispeg.learn.policy import load

    policy = load(tmp_path / "run" / "checkpoints" / "last")
    assert policy.meta["task"]["name"] == "snap_fit:SnapFit"
    env = TaskVec(2, EXAMPLE / "snap.yaml", "state", autoreset_mode="Disabled", privileged=True)
    assert len(policy.layout.reads) == len(env.observed.for_teachers) == 4  # contact force and latch
    policy.reset(2)
    action = policy.act(env.reset(seed=1)[0])
    assert action.shape == (2, 3) and np.isfinite(env.step(action)[1]).all()
