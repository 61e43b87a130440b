"""One's own bench: a robot's file with what stands about it is a scene, and pictures of it name a camera's error."""

from __future__ import annotations

import pytest
from benches import write_bench, write_motion
from resuming import resumed

from vispeg.api.recording.record import record

HIDDEN = ["camera_offset:eye_in_hand:x=0.006"]


def recorded(folder, name: str, phase: float, fps: float = 1.2):
    motion = write_motion(folder, f"{name}.csv", phase)
    made = record(str(write_bench(folder)), motion, cameras=["eye_in_hand"], effects=HIDDEN, rate_hz=200.0, fps=fps)
    return made.save(folder / name)


@pytest.mark.slow
def test_a_killed_diagnosis_of_joints_and_pictures_goes_on(tmp_path):
    both = recorded(tmp_path, "a", 0.3), recorded(tmp_path, "b", 1.1)
    resumed(tmp_path / "lab.xml", both, tmp_path, "looking for what is left")
