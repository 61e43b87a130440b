"""`vispeg camera calibrate`: a camera file from images of a board and, for its place, the flange's poses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True)
class Calibrate:
    """Calibrates a camera from images of a chessboard, a ChArUco board or a tag.

    With --poses also its pose on the flange (board at rest) or on the base (board on the flange).
    Writes OUT/camera.yaml, OUT/results.json and a picture of each image's corners. Intervals are 95 %.

    Example:
        vispeg camera calibrate images --pattern 9x6 --square 0.0236 --poses poses.csv --out wrist
    """

    images: tyro.conf.Positional[Path]
    """Folder of images of one size, or a recording with frames, whose joints say where the flange was."""
    square: float
    """Side of a square, or of a tag's black frame, m."""
    out: Path
    """Folder for the results."""
    pattern: str = ""
    """COLUMNSxROWS: inner corners of a chessboard (9x6), squares of a ChArUco board; none for a tag."""
    board: Literal["chessboard", "charuco", "tag"] = "chessboard"
    """What the images show; tag: one AprilTag or ArUco marker."""
    marker: float = 0.0
    """ChArUco: side of a marker, m."""
    dictionary: str | None = None
    """OpenCV's name of the markers' dictionary; default: DICT_4X4_50, of a tag DICT_APRILTAG_36h11."""
    tag: int | None = None
    """Tag: its number; default: the only one in the images."""
    legacy: bool = False
    """ChArUco: a board of OpenCV before 4.6 (begins with a marker if the number of rows is even)."""
    poses: Path | None = None
    """The flange on the base in each image: CSV (file, x, y, z in m, qw, qx, qy, qz), or a folder of ViSP's YAML."""
    mount: Literal["flange", "base"] = "flange"
    """What the camera is fixed to."""
    intrinsics: Path | None = None
    """Known intrinsics instead of fitted ones: a camera file, OpenCV's, ROS's or ViSP's."""
    distortion: Literal["none", "radial", "brown4", "brown5"] = "brown4"
    """Lens terms to fit: none; radial: k1 k2; brown4: k1 k2 p1 p2; brown5: k1 k2 p1 p2 k3."""
    name: str = "camera"
    """The camera's name in camera.yaml; of a recording with several cameras, the one to take."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Find the board, fit, write the folder, print the tables."""
        from vispeg.api.calibrate import calibrate
        from vispeg.core.files import reserved
        from vispeg.report.text.summary import Line

        with reserved(self.out, self.overwrite, holds="calibration", inputs=(self.images, self.poses, self.intrinsics)):
            result = calibrate(
                self.images,
                self.pattern,
                self.square,
                board=self.board,
                marker=self.marker,
                dictionary=self.dictionary,
                legacy=self.legacy,
                tag=self.tag,
                poses=self.poses,
                mount=self.mount,
                intrinsics=self.intrinsics,
                distortion=self.distortion,
                name=self.name,
            )
            result.save(self.out, overwrite=self.overwrite)
        wrote = Line(f"wrote {self.out}: camera.yaml, results.json, corners/", path=True)
        self.output.give(result.record, [*result.summary, wrote])
        return 0
