"""Reads a rendered dataset with LeRobot's own package, trains its ACT on it for a few steps, and plays that policy:
by `vispeg evaluate` and by `lerobot-eval`, which must agree.

LeRobot asks for other versions of packages than this project, so it gets an environment of its own, in a temporary
folder that is removed again (2 GB, minutes to make); `--env` keeps it for the next time.

    vispeg render --frames 40 --out frames
    python scripts/try_lerobot.py frames
    python scripts/try_lerobot.py frames --version 0.4.4 --env ~/.cache/lerobot
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TORCH, TORCHVISION = "torch==2.13.0", "torchvision==0.28.0"  # a pair; an index may offer the former without CUDA
# devices and viewers, which training does not touch, and a decoder of videos, of which a rendered dataset has none
NOT_NEEDED = r"(torch|torchvision|torchcodec|cmake|rerun-sdk|pynput)\b"
# a torchvision built for CUDA declares its operators only where it finds CUDA; ACT needs their names alone
DECLARE = """
try:
    import torch

    try:
        import torchvision
    except RuntimeError:
        import sys

        for name in [name for name in sys.modules if name.startswith("torchvision")]:
            del sys.modules[name]
        _known = torch.library.Library("torchvision", "DEF")
        _known.define("nms(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")
        _known.define("qnms(Tensor dets, Tensor scores, float iou_threshold, float scale, int zero) -> Tensor")
except ImportError:
    pass
"""
REQUIRED = "from importlib.metadata import requires; print(*requires('lerobot'), sep='\\n')"
READ = """
import sys
from lerobot.datasets.lerobot_dataset import LeRobotDataset

data = LeRobotDataset("local/frames", root=sys.argv[1])
for i in (0, len(data) // 2, len(data) - 1):
    frame = data[i]
    assert set(data.meta.features) <= set(frame), set(data.meta.features) - set(frame)
    for name, feature in data.meta.features.items():
        shape = list(feature["shape"])
        shape = shape[-1:] + shape[:-1] if name in data.meta.camera_keys else [] if shape == [1] else shape
        assert list(frame[name].shape) == shape, (name, frame[name].shape, shape)
print(f"LeRobot reads {len(data)} frames of {len(data.meta.camera_keys)} cameras")
"""
SMALL = {"chunk_size": 8, "n_action_steps": 8, "dim_model": 64, "n_heads": 2, "dim_feedforward": 64}


def call(*command: str | Path, **more: str) -> subprocess.CompletedProcess[str]:
    """Run a command without access to the Hugging Face hub; exit if it fails."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | {"HF_HUB_OFFLINE": "1"} | more
    done = subprocess.run([*map(str, command)], env=environment, text=True, capture_output=True)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, command[:3]))} ... failed:\n{(done.stdout + done.stderr)[-3000:]}")
    return done


def make(env: Path, version: str) -> Path:
    """Make an environment with LeRobot in it; return its interpreter."""
    python = env / "bin/python"
    stamp = env / f".lerobot-{version}"
    if stamp.exists():
        return python
    print(f"installing lerobot {version} into {env} (minutes)", flush=True)
    call(sys.executable, "-m", "venv", "--clear", env)
    pip = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    call(*pip, TORCH, TORCHVISION)
    call(*pip, "--no-deps", f"lerobot=={version}")
    needed = [line for line in call(python, "-c", REQUIRED).stdout.splitlines() if "extra ==" not in line]
    call(*pip, *[line for line in needed if not re.match(NOT_NEEDED, line)])
    call(*pip, "-e", ROOT)  # for lerobot-eval, which imports the task
    site = call(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").stdout.strip()
    Path(site, "sitecustomize.py").write_text(DECLARE, encoding="utf-8")
    stamp.touch()
    return python


def train(python: Path, data: Path, out: Path, steps: int) -> list[float]:
    """Train ACT; return its loss at each step."""
    said = call(
        python.with_name("lerobot-train"),
        "--policy.type=act",
        "--policy.device=cpu",
        "--policy.push_to_hub=false",
        "--policy.pretrained_backbone_weights=null",
        *(f"--policy.{key}={value}" for key, value in SMALL.items()),
        "--dataset.repo_id=local/frames",
        f"--dataset.root={data}",
        f"--output_dir={out}",
        f"--steps={steps}",
        "--batch_size=2",
        "--num_workers=0",
        "--log_freq=1",
        "--wandb.enable=false",
    )
    return [float(loss) for loss in re.findall(r" loss:(\S+)", said.stdout + said.stderr)]


def judge(python: Path, out: Path, data: Path, episodes: int) -> list[bool]:
    """Return which episodes succeed; exit if the two ways to judge a policy do not agree."""
    policy = out / "checkpoints" / "last" / "pretrained_model"
    world = json.loads((data / "meta" / "render.json").read_text(encoding="utf-8"))["plan"]["world"]
    how = ("--world", world, "--episodes", str(episodes), "--videos", "0", "--out", out / "ours", "--quiet")
    call(sys.executable, "-m", "vispeg", "evaluate", f"lerobot:{policy}", *how, LEROBOT_PYTHON=str(python))
    lines = (out / "ours" / "episodes.jsonl").read_text(encoding="utf-8").splitlines()
    ours = {e["seed"]: e["success"] for e in map(json.loads, lines) if "seed" in e}
    call(
        python.with_name("lerobot-eval"),
        f"--policy.path={policy}",
        "--policy.device=cpu",
        "--env.discover_packages_path=vispeg.task.lerobot",
        "--env.type=vispeg",
        f"--env.world={world}",
        f"--eval.n_episodes={episodes}",
        f"--eval.batch_size={min(episodes, 5)}",
        f"--seed={min(ours)}",
        f"--output_dir={out / 'theirs'}",
    )
    found = json.loads((out / "theirs" / "eval_info.json").read_text(encoding="utf-8"))
    theirs = found["per_task"][0]["metrics"]["successes"]
    if theirs != [ours[seed] for seed in sorted(ours)]:
        sys.exit(f"lerobot-eval and vispeg evaluate do not agree: {theirs}, {ours}")
    return theirs


def main() -> int:
    """Read, train and judge with LeRobot, and print the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path, help="folder that `vispeg render` made")
    parser.add_argument("--version", default="0.4.4", help="of LeRobot")
    parser.add_argument("--steps", type=int, default=3, help="of training")
    parser.add_argument("--episodes", type=int, default=2, help="of each evaluation")
    parser.add_argument("--env", type=Path, help="folder of the environment, kept; a temporary one where not given")
    args = parser.parse_args()
    data = args.dataset.resolve()
    with tempfile.TemporaryDirectory(prefix="lerobot-") as folder:
        python = make(args.env.expanduser() if args.env else Path(folder, "env"), args.version)
        cache = str(Path(folder, "cache"))
        print(call(python, "-c", READ, data, HF_HOME=cache).stdout.strip())
        losses = train(python, data, Path(folder, "out"), args.steps)
        judged = judge(python, Path(folder, "out"), data, args.episodes)
    if len(losses) != args.steps:
        sys.exit(f"LeRobot trained {len(losses)} steps, not {args.steps}")
    print(f"lerobot-eval and vispeg evaluate agree: {sum(judged)} of {len(judged)} succeed")
    print(f"LeRobot {args.version} trained ACT for {args.steps} steps; losses {', '.join(f'{x:g}' for x in losses)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
