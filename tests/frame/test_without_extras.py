"""Every command in an environment without the extras: it works, or names the one that it needs in one line.

What works without all of them works without each, and what needs one names that one.
"""

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from vispeg.cli.overview import installed
from vispeg.core.extras import EXTRAS

ROOT = Path(__file__).parents[2]
MODULES = {
    "stable_baselines3": "stable-baselines3",
    "mujoco_menagerie": "mujoco-menagerie",
    "mujoco_warp": "mujoco-warp",
}  # whose packages have other names

WORKS = """
record iiwa14 --motion fourier --duration 0.5 --seed 1 --out rig-a
check rig-a
add iiwa14 payload flange --set mass=0.5 --out model.yaml
effects
worlds
robots
policies
plan nominal
motions
completion bash
measure plan joint4 --out plan
camera show --help
render --world nominal --frames 2 --workers 0 --size 32 --out frames
dataset check frames
evaluate expert --world nominal --episodes 1 --videos 1 --out judged
gap expert --worlds nominal searching --episodes 1 --videos 0 --controls --out gap
"""
LONGER = """
record iiwa14 --motion fourier --duration 2 --seed 1 --out rig-a
record iiwa14 --motion fourier --duration 2 --seed 2 --out rig-b
compare iiwa14 --recording rig-b --out compared
report compared --overwrite
fit iiwa14 --recording rig-a --validate rig-b --effects viscous_friction:joint4 --out fitted
diagnose iiwa14 --recording rig-a --validate rig-b --out found
sensitivity expert --world nominal --sweep friction --episodes 1 --out swept
perturb expert --world nominal --episodes 1 --out pushed
exploit expert --world nominal --episodes 1 --out exploited
evaluate expert --world nominal --episodes 2 --videos 0 --out judged-3 --keep-trials kept
explain kept --policy expert --replays 1 --out explained
suite run expert --train nominal --target searching --episodes 1 --out suite
doctor
"""
NEEDS = {
    "learn": """
train peg-state --out run
play state-3mm --out films
run depth-S --robot sim:S --out trials
finetune depth-S --world dev --out tuned
combine depth-S state-3mm --out both
export state-3mm --out policy.onnx
evaluate depth-S --out judged-2
gap depth-S --out gap-2
suite run depth-S --target P --out suite-2
sensitivity depth-S --sweep friction --out swept-2
exploit depth-S --out exploited-2
perturb depth-S --out pushed-2
""",
    "logs": "convert log.mcap --robot iiwa14 --out converted",
    "video": "convert set/data.parquet --robot iiwa14 --images wrist --cameras set/wrist.yaml --insist --out filmed",
    "cluster": "render --world nominal --frames 2 --engine ray --out cluster",
    "view": "view",
    "wandb": "train peg-state --wandb peg --out run-2",
    "menagerie": "compare panda --recording rig-a --out compared-2",
    "warp": "train peg-state --recipe distill --teacher expert --engine warp --out run-3",
    "meshes": "evaluate expert --world own.yaml --episodes 1 --videos 0 --out meshes",
}


def lines(text):
    return [line.split() for line in text.split("\n") if line]


def run(commands, folder):
    """Exit status and stderr of each, in one process that has no extra."""
    here = Path(__file__).with_name("without_extras.py")
    env = {**os.environ, "XDG_CACHE_HOME": str(folder / "cache"), "PYTHONPATH": str(ROOT)}
    given = json.dumps(commands)
    done = subprocess.run([sys.executable, here], input=given, cwd=folder, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def assert_all_work(text, folder):
    commands = lines(text)
    for command, (code, err) in zip(commands, run(commands, folder), strict=True):
        assert code == 0, (command, err)


def test_the_modules_are_those_of_pyproject():
    given = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    packages = {extra: {MODULES.get(module, module) for module in modules} for extra, modules in EXTRAS.items()}
    named = {extra: {re.split(r"[\[<>=!~ ]", text)[0] for text in texts} for extra, texts in given.items()}
    assert packages == {extra: names for extra, names in named.items() if extra not in ("all", "dev")}
    assert set(re.findall(r"\w+", given["all"][0])) - {"vispeg"} == set(EXTRAS)


def test_every_extra_is_asked_for():
    assert set(NEEDS) == set(EXTRAS)


def test_every_command_is_run_or_shown():
    known = {command[0] for text in (WORKS, LONGER, *NEEDS.values()) for command in lines(text)}
    assert set(installed()) - known == {"demo"}  # which takes minutes; `scripts/demo` runs it in such an environment


def test_help_needs_none(tmp_path):
    assert_all_work("\n".join(f"{name} --help" for name in installed()), tmp_path)


def test_commands_that_need_none_work(tmp_path):
    assert_all_work(WORKS, tmp_path)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_commands_that_need_none_and_take_longer_work(tmp_path):
    assert_all_work(LONGER, tmp_path)


@pytest.mark.slow
def test_the_others_name_their_extra_in_one_line_and_leave_nothing(tmp_path):
    (tmp_path / "log.mcap").write_bytes(b"\x89MCAP0\r\n")
    tube(tmp_path / "hole.stl")
    data_set(tmp_path / "set")
    own = "{hole_mesh: hole.stl, mesh_scale: 0.001, clearance_mm: 3.0}"
    (tmp_path / "own.yaml").write_text(f"format: vispeg-world/1\ntask: {own}\n")
    before = sorted(tmp_path.iterdir())
    commands = [(extra, command) for extra, text in NEEDS.items() for command in lines(text)]
    found = run([command for _, command in commands], tmp_path)
    for (extra, command), (code, err) in zip(commands, found, strict=True):
        assert code == 2 and len(err.strip().splitlines()) == 1, (command, code, err)
        assert f"of the extra '{extra}'" in err and f"[{extra}]'" in err and "pip install" in err, (command, err)
    assert sorted(p for p in tmp_path.iterdir() if p.name != "cache") == before


def tube(path):
    """A block that is not convex, mm: its hole is 19 wide, its top at z = 0."""
    import trimesh

    block = trimesh.creation.annulus(r_min=9.5, r_max=30.0, height=40.0)
    block.apply_translation((0, 0, -20))
    block.export(path)


def data_set(root):
    """A LeRobot folder of one episode with a film, which nobody gets so far as to open."""
    import numpy as np
    import pyarrow as pa
    import pyarrow.parquet as pq

    film = "videos/chunk-000/observation.images.wrist/episode_000000.mp4"
    (root / film).parent.mkdir(parents=True)
    (root / film).write_bytes(b"")
    (root / "meta").mkdir()
    features = {"observation.images.wrist": {"dtype": "video"}}
    info = {"codebase_version": "v2.1", "fps": 20, "video_path": film, "chunks_size": 1000, "features": features}
    (root / "meta" / "info.json").write_text(json.dumps(info))
    time = np.arange(40) / 20
    angles = {f"q.joint{j}": 0.3 * np.sin(time + j) for j in range(1, 8)}
    pq.write_table(pa.table({"time": time} | angles), root / "data.parquet")
    eye = {"name": "wrist", "width": 64, "height": 48, "fx": 60.0, "fy": 60.0, "cx": 31.5, "cy": 23.5}
    (root / "wrist.yaml").write_text(json.dumps({"format": "vispeg-camera/1", "parent": "flange", **eye}))
