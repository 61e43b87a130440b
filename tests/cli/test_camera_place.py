"""`vispeg camera place`: from joint angles and a tag's poses to a camera file."""

from __future__ import annotations

import json

import numpy as np
from board_views import X
from test_place_from_poses import joints_table, seen

from vispeg.core.seeds import stream


def test_the_command_takes_joint_angles_and_writes_a_camera(vispeg, tmp_path):
    from vispeg.render.cameras.camera import Camera
    from vispeg.render.cameras.camera_files import load_camera, save_cameras

    q, _, tags = seen(stream(6, "joints"), 12, "base", (1e-4, 1e-3))
    joints_table(tmp_path, np.degrees(q), tags)
    save_cameras(tmp_path / "lens.yaml", Camera("k", 640, 480, 600.0, 600.0, 320.0, 240.0))
    args = ["--robot", "iiwa14", "--mount", "base", "--intrinsics", "lens.yaml", "--name", "eye", "--out", "found"]
    code, out, err = vispeg("camera", "place", "tags.csv", *args)
    assert code == 0, err
    assert "x on base" in out and "taken as joint angles in deg" in out
    camera = load_camera(tmp_path / "found" / "camera.yaml")
    assert (camera.name, camera.parent) == ("eye", "base")
    results = json.loads((tmp_path / "found" / "results.json").read_text())
    half = results["hand_eye"]["half_width_95"]["pos_m"]
    assert np.all(np.abs(np.array(camera.pos) - X[:3, 3]) < np.maximum(2 * np.array(half), 1e-4))
