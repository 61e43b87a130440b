"""LeRobot's own package reads what `vispeg render` writes by default, and trains its ACT on it as it is."""

import subprocess
import sys
from pathlib import Path

import pytest

from vispeg.cli.main import main

SCRIPT = Path(__file__).parents[2] / "scripts/try_lerobot.py"


@pytest.mark.slow
@pytest.mark.timeout(1800)  # installs PyTorch and LeRobot into an environment of its own
def test_lerobot_reads_a_rendered_dataset_and_trains_act_on_it(tmp_path):
    assert main(["render", "--frames", "20", "--workers", "0", "--out", str(tmp_path / "frames")]) == 0
    command = [sys.executable, SCRIPT, tmp_path / "frames", "--steps", "2"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "reads 20 frames" in done.stdout and "trained ACT for 2 steps" in done.stdout
    assert "agree: " in done.stdout, "its policy is judged by both"


def test_only_colour_is_a_camera_to_lerobot(tmp_path):
    """What LeRobot's policies take by themselves: every `dtype: image`, and what is called an observation."""
    import json

    assert main(["render", "--world", "nominal", "--frames", "2", "--workers", "0", "--out", str(tmp_path / "d")]) == 0
    features = json.loads((tmp_path / "d/meta/info.json").read_text())["features"]
    images = {name: f["shape"][2] for name, f in features.items() if f["dtype"] == "image"}
    assert images == {"observation.images.wrist_wide": 3, "observation.images.wrist_crop": 3}
    assert "observation.environment_state" not in features and "label.parts.wrist_wide" in features
