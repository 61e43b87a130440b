"""Calibration of a real camera from images of a board: its intrinsics, and its pose on the flange or on the base."""

from vispeg.render.calibration.board import Board
from vispeg.render.calibration.calibrate import Calibration, calibrate
from vispeg.render.calibration.detect import View, detect
from vispeg.render.calibration.intrinsics import Intrinsics
from vispeg.render.calibration.poses import read_poses

__all__ = ["Board", "Calibration", "Intrinsics", "View", "calibrate", "detect", "read_poses"]
