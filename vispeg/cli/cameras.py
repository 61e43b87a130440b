"""Calibrate a camera, find its pose, or show camera files.

Example:
    vispeg camera calibrate images --pattern 9x6 --square 0.0236 --poses images/poses.csv --out wrist
    vispeg camera place tags.csv --robot iiwa14 --out wrist
    vispeg camera show wrist/camera.yaml
"""

from __future__ import annotations

from pathlib import Path

from vispeg.cli.command import REQUIRED, Call, Option, command


@command("vispeg.api.calibrate:calibrate", "images", square=Option(default=REQUIRED))
def calibrate(call: Call, out: Path, overwrite: bool = False) -> None:
    """Calibrate a camera from images of a chessboard, a ChArUco board or a tag.

    With --poses, also find its pose on the flange (board at rest) or on the base (board on the flange).
    Writes OUT/camera.yaml, OUT/results.json and a picture of each image's corners. Intervals are 95 %.

    Example:
        vispeg camera calibrate images --pattern 9x6 --square 0.0236 --poses poses.csv --out wrist

    Args:
        out: folder for the results.
        overwrite: replace `out` if it exists.
    """
    result = call.saved(out, overwrite, "calibration", (call.images, call.poses, call.intrinsics))
    call.give(result, f"wrote {out}: camera.yaml, results.json, corners/")


@command("vispeg.api.camera_place:place_camera", "table")
def place(call: Call, out: Path, overwrite: bool = False) -> None:
    """Find a camera's pose from robot poses and a tag's poses in the camera (hand-eye calibration).

    TABLE has one row per picture: the flange's pose on the base (flange_x .. flange_qz) or the joint angles (with
    --robot), and the tag's pose in the camera (tag_x .. tag_qz). Orientations may be qw qx qy qz, rx ry rz, or roll
    pitch yaw. Units are given in the header, or inferred from the data. Writes OUT/results.json and, with --intrinsics,
    OUT/camera.yaml. Intervals are 95 %.

    Example:
        vispeg camera place tags.csv --robot iiwa14 --out wrist

    Args:
        out: folder for the results.
        overwrite: replace `out` if it exists.
    """
    result = call.saved(out, overwrite, "calibration", (call.table, call.intrinsics))
    what = "results.json" if call.intrinsics is None else "camera.yaml, results.json"
    call.give(result, f"wrote {out}: {what}")


@command("vispeg.api.cameras:show_cameras", "file")
def show(call: Call) -> None:
    """Show the cameras of a file: the project's YAML, OpenCV's, or ROS's camera_info.

    Example:
        vispeg camera show wrist/camera.yaml
    """
    call.give(call())
