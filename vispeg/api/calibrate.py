"""`vispeg.calibrate`: calibrate a camera from images of a board and, for its pose, poses of the flange."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from vispeg.api.photographs import photographs
from vispeg.api.result import Result
from vispeg.core.errors import UserError
from vispeg.core.provenance import digest, here
from vispeg.render import calibration as boards
from vispeg.render.calibration.board import parse_pattern
from vispeg.render.calibration.detect import the_tag
from vispeg.render.calibration.hand_eye import Mount
from vispeg.render.calibration.intrinsics import Distortion
from vispeg.render.calibration.known import read_intrinsics
from vispeg.render.calibration.picture import overlay
from vispeg.render.calibration.results import record
from vispeg.render.cameras.camera import Camera
from vispeg.render.cameras.camera_files import save_cameras
from vispeg.report.text.camera_tables import calibration_summary
from vispeg.report.text.summary import Block
from vispeg.report.write import write_json


@dataclass(frozen=True, repr=False)
class CalibrationResult(Result):
    """A calibrated camera with 95 % intervals.

    Attributes:
        record: content of results.json, see docs/cameras.md.
        camera: intrinsics, distortion and, with poses, the camera's pose.
        board: the board in the images.
        images: folder of the images.
        calibration: the fit behind the record.
        flange: (n, 4, 4) poses of the flange on the base, one per used image; None without poses.
        sources: files and folders that were read.
    """

    record: Mapping[str, Any]
    camera: Camera
    board: boards.Board
    images: Path
    calibration: boards.Calibration = field(repr=False)
    flange: np.ndarray | None = field(default=None, repr=False)
    sources: tuple[str | Path, ...] = ()
    holds = "calibration"  # class attribute, see `Result`

    @property
    def summary(self) -> list[Block]:
        """The numbers with their intervals, one row per image, and notes."""
        return calibration_summary(self.record)

    def _write(self, folder: Path) -> None:
        save_cameras(folder / "camera.yaml", self.camera, posed=self.flange is not None)
        write_json(folder / "results.json", dict(self.record))
        (folder / "corners").mkdir()
        for number, view in enumerate(self.calibration.views):
            pose = None if self.flange is None else self.flange[number]
            picture = overlay(self.images / view.name, self.calibration, self.board, number, pose)
            (folder / "corners" / f"{view.name}.png").write_bytes(picture)


def calibrate(
    images: str | Path,
    pattern: str = "",
    square: float = 0.0,
    *,
    board: Literal["chessboard", "charuco", "tag"] = "chessboard",
    marker: float = 0.0,
    dictionary: str | None = None,
    legacy: bool = False,
    tag: int | None = None,
    poses: str | Path | None = None,
    mount: Mount = "flange",
    intrinsics: str | Path | None = None,
    distortion: Distortion | None = None,
    name: str = "camera",
) -> CalibrationResult:
    """Calibrate a camera; with `poses` also its pose on the flange, or on the base with the board on the flange.

    Args:
        images: folder of images of one size, or a recording with frames, whose joint angles give the flange's poses.
        pattern: COLUMNSxROWS: inner corners of a chessboard (9x6), or squares of a ChArUco board; omit it for a tag.
        square: side of a square, or of a tag's black frame, m.
        board: what the images show; tag is one AprilTag or ArUco marker.
        marker: ChArUco: side of a marker, m.
        dictionary: OpenCV's name of the markers' dictionary; default: DICT_4X4_50, for a tag DICT_APRILTAG_36h11.
        legacy: ChArUco: a board of OpenCV before 4.6 (begins with a marker if the number of rows is even).
        tag: number of the tag; default: the only one in the images.
        poses: the flange on the base in each image: CSV (file, x, y, z in m, qw, qx, qy, qz), or a folder of ViSP's
            YAML.
        mount: what the camera is fixed to.
        intrinsics: known intrinsics instead of fitted ones: a camera file, OpenCV's, ROS's or ViSP's.
        distortion: lens terms to fit: none; radial: k1 k2; brown4 (default): k1 k2 p1 p2; brown5: k1 k2 p1 p2 k3.
        name: the camera's name in camera.yaml; for a recording with several cameras, the one to calibrate.

    Raises:
        UserError: images without the board, too few views, motion that does not determine the camera's pose.
    """
    taken = photographs(images, poses, name)
    if intrinsics is not None and taken.flange is None:
        raise UserError(
            "with known intrinsics and no poses there is nothing to find", expected="--poses, or no --intrinsics"
        )
    if intrinsics is not None and distortion is not None:
        expected = "--distortion without --intrinsics"
        raise UserError(
            "known intrinsics bring their lens terms", key="--distortion", expected=expected, got=distortion
        )
    of_markers = (("--marker", marker), ("--legacy", legacy), ("--dictionary", dictionary if board != "tag" else None))
    if board != "charuco" and (given := [key for key, value in of_markers if value]):
        raise UserError("applies only to a ChArUco board", key=given[0], expected="--board charuco", got=board)
    if board == "tag":
        if pattern:
            expected = "--square, the side of its black frame, m"
            raise UserError("does not apply to a tag", key="--pattern", expected=expected)
        printed = boards.Board("tag", 1, 1, square, 0.0, dictionary or "DICT_APRILTAG_36h11", tag=tag)
        printed = the_tag(taken.files, printed)
    else:
        if tag is not None:
            raise UserError("applies only to --board tag", key="--tag", got=tag)
        marks = (marker, dictionary or "DICT_4X4_50", legacy) if board == "charuco" else (0.0, "", False)
        printed = boards.Board(board, *parse_pattern(pattern), square, *marks)
    lens = None if intrinsics is None else read_intrinsics(Path(intrinsics))
    sources = [Path(p) for p in (images, poses, intrinsics) if p is not None and Path(p).exists()]
    stamp = here(None, {str(path): f"sha256:{digest(path)}" for path in sources})
    views, missed = boards.detect(taken.files, printed)
    flange = None if taken.flange is None else taken.flange([view.name for view in views])
    terms = distortion or "brown4"
    calibration = boards.calibrate(views, printed, distortion=terms, camera=lens, flange=flange, mount=mount)
    results = {**record(calibration, printed, missed), "provenance": stamp}
    return CalibrationResult(
        results, calibration.to_camera(name), printed, taken.files[0].parent, calibration, flange, tuple(sources)
    )
