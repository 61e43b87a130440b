"""`vispeg camera calibrate`: a camera file from images of a board and, for its place, the flange's poses."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import tyro

from vispeg.core.errors import UserError


@dataclass(frozen=True)
class Calibrate:
    """Calibrates a camera from images of a chessboard or a ChArUco board.

    With --poses also where it sits: on the flange (the board lies still), or on the base (the board on the flange).
    Writes OUT/camera.yaml, OUT/results.json and a picture of each image's corners. Intervals are of 95 %.

    Example: vispeg camera calibrate images --pattern 9x6 --square 0.0236 --poses poses.csv --out wrist
    """

    images: tyro.conf.Positional[Path]
    """Folder of images of one size."""
    pattern: str
    """COLUMNSxROWS: inner corners of a chessboard (9x6), squares of a ChArUco board."""
    square: float
    """Side of a square, m."""
    out: Path
    """Folder for the results."""
    board: Literal["chessboard", "charuco"] = "chessboard"
    """What the images show."""
    marker: float = 0.0
    """ChArUco: side of a marker, m."""
    dictionary: str = "DICT_4X4_50"
    """ChArUco: OpenCV's name of the dictionary."""
    legacy: bool = False
    """ChArUco: printed by OpenCV before 4.6, beginning with a marker though the rows are even."""
    poses: Path | None = None
    """The flange on the base in each image: CSV (file, x, y, z in m, qw, qx, qy, qz), or a folder of ViSP's YAML."""
    mount: Literal["flange", "base"] = "flange"
    """What the camera is fixed to."""
    intrinsics: Path | None = None
    """Known intrinsics instead of fitted ones: a camera file, OpenCV's, ROS's or ViSP's."""
    distortion: Literal["none", "radial", "brown4", "brown5"] = "brown4"
    """Lens terms to fit: none; k1 k2; and p1 p2; and k3."""
    name: str = "camera"
    """The camera's name in camera.yaml."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    json: bool = False
    """Print JSON instead of tables."""

    def run(self) -> int:
        """Finds the board, fits, writes the folder, prints the tables."""
        from vispeg.core.files import new_folder
        from vispeg.core.provenance import provenance
        from vispeg.render.calibration import Board, calibrate, detect, read_poses
        from vispeg.render.calibration.board import parse_pattern
        from vispeg.render.calibration.known import read_intrinsics
        from vispeg.render.calibration.picture import overlay
        from vispeg.render.calibration.results import record
        from vispeg.render.camera_files import save_cameras

        if self.intrinsics is not None and self.poses is None:
            raise UserError("nothing is left to find", expected="--poses, or no --intrinsics")
        charuco = self.board == "charuco"
        marks = (self.marker, self.dictionary, self.legacy) if charuco else (0.0, "", False)
        board = Board(self.board, *parse_pattern(self.pattern), self.square, *marks)
        known = None if self.intrinsics is None else read_intrinsics(self.intrinsics)
        inputs = [path for path in (self.images, self.poses, self.intrinsics) if path is not None and path.exists()]
        origin = provenance(sys.argv, None, inputs)
        with new_folder(self.out, self.overwrite, holds="calibration", inputs=inputs) as folder:
            views, missed = detect(self.images, board)
            flange = None if self.poses is None else read_poses(self.poses, [view.name for view in views])
            found = calibrate(views, board, distortion=self.distortion, camera=known, flange=flange, mount=self.mount)
            save_cameras(folder / "camera.yaml", found.to_camera(self.name))
            results = {**record(found, board, missed), "provenance": origin}
            text = json.dumps(results, indent=2, allow_nan=False) + "\n"
            (folder / "results.json").write_text(text, encoding="utf-8")
            (folder / "corners").mkdir()
            for number, view in enumerate(found.views):
                pose = None if flange is None else flange[number]
                picture = overlay(self.images / view.name, found, board, number, pose)
                (folder / "corners" / f"{view.name}.png").write_bytes(picture)
        if self.json:
            print(text, end="")
        else:
            show(results, self.out)
        return 0


def show(results: dict[str, Any], out: Path) -> None:
    """Tables for a person: the numbers with their intervals, a row a view, the notes."""
    from rich.markup import escape

    from vispeg.report.tables import Column, Sheet, terminal

    console, inner, eye = terminal(), results["intrinsics"], results["hand_eye"]
    rows: list[list[str]] = []
    half = inner.get("half_width_95", {})
    for key, value in inner["values"].items():
        free = half.get(key, 0.0) > 0
        if value != 0 or free:
            width = f"+- {half[key]:.2g}" if free else "given" if not inner["fitted"] else "held"
            rows.append([key, f"{value:.5g}", width, "px" if key in ("fx", "fy", "cx", "cy") else ""])
    if eye is not None:
        for axis, value, width in zip("xyz", eye["pos_m"], eye["half_width_95"]["pos_m"], strict=True):
            rows.append([f"{axis} on {eye['parent']}", f"{1e3 * value:.2f}", f"+- {1e3 * width:.2g}", "mm"])
        for axis, width in zip("xyz", eye["half_width_95"]["turn_rad"], strict=True):
            rows.append([f"turn about its {axis}", "", f"+- {57.29578 * width:.2g}", "deg"])
        rows.append(["quaternion wxyz", " ".join(f"{value:.4f}" for value in eye["quat_wxyz"]), "", ""])
    console.print(Sheet([Column(head) for head in ("what", "value", "95 %", "unit")], rows))
    keys = [key for key in ("reprojection_px", "through_robot_px", "misfit") if key in results["views"][0]]
    heads = {"reprojection_px": "reprojection px", "through_robot_px": "through robot px", "misfit": "misfit sigma"}
    columns = [Column("image"), *(Column(head, right=True) for head in ("corners", *map(heads.__getitem__, keys)))]
    views = [[row["file"], str(row["corners"]), *(f"{row[key]:.2f}" for key in keys)] for row in results["views"]]
    console.print(Sheet(columns, views))
    line = f"{results['images']['used']} images, reprojection {inner['reprojection_px']:.2f} px RMS"
    if eye is not None:
        robot = eye["robot_error"]
        line += f", board origin scatter {eye['board_scatter_mm']:.1f} mm RMS"
        line += f"; robot's own error about {robot['mm']:.2g} mm, {robot['deg']:.2g} deg"
    console.print(line, soft_wrap=True)
    for note in results["notes"]:
        console.print(f"  [yellow]![/yellow] {escape(note)}", soft_wrap=True)
    console.print(f"wrote {escape(str(out))}: camera.yaml, results.json, corners/", soft_wrap=True)
