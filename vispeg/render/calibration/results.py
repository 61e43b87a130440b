"""A calibration as records: the numbers with their intervals, and warnings for the user."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NotRequired, TypedDict

import numpy as np

from vispeg.core.rotation import quaternion
from vispeg.render.calibration.board import Board
from vispeg.render.calibration.board_scale import BoardEffect, as_effect
from vispeg.render.calibration.calibrate import Calibration
from vispeg.render.calibration.intrinsics import NAMES

FORMAT = "vispeg-calibration/1"
ODD = 3.0  # misfit, in standard deviations, above which a note names a view
FAR_OFF = 3.0  # multiple of the median reprojection error above which a note names a view
DISAGREE = np.array([8.0, 1.5])  # mm, deg: larger than the errors of an arm
COVER = 0.5  # least share of the image's width and height that the corners should cover
PER_UNIT = np.array([1e3] * 3 + [180 / np.pi] * 3)  # m to mm, rad to deg


class ViewRow(TypedDict):
    """The record of one view: number of corners, reprojection errors and misfit.

    `reprojection_px` is with the view's own best board pose, `through_robot_px` with the one by the robot's pose.
    `misfit` is that of the flange's pose, in standard deviations.
    """

    file: str
    corners: int
    reprojection_px: float
    through_robot_px: NotRequired[float]
    misfit: NotRequired[float]


class CalibrationRecord(TypedDict):
    """The content of results.json without provenance."""

    format: str
    board: Mapping[str, object]
    images: Mapping[str, object]
    intrinsics: Mapping[str, object]
    hand_eye: Mapping[str, object] | None
    effects: list[BoardEffect]
    views: list[ViewRow]
    notes: list[str]


def record(calibration: Calibration, board: Board, missed: dict[str, str]) -> CalibrationRecord:
    """Return the content of results.json without provenance. Units are in the keys; intervals are half widths.

    Args:
        calibration: the calibration.
        board: the board.
        missed: by name of each image that was not used, the reason.
    """
    described: dict[str, object] = {"kind": board.kind, "pattern": board.pattern, "square_m": board.square}
    if board.kind == "charuco":
        described |= {"marker_m": board.marker, "dictionary": board.dictionary, "legacy": board.legacy}
    if board.kind == "tag":
        described = {"kind": "tag", "square_m": board.square, "dictionary": board.dictionary, "tag": board.tag}
    return {
        "format": FORMAT,
        "board": described,
        "images": {"used": len(calibration.views), "left_out": missed},
        "intrinsics": _intrinsics(calibration),
        "hand_eye": _hand_eye(calibration),
        "effects": _effects(calibration, board),
        "views": views(calibration),
        "notes": notes(calibration, missed),
    }


def _effects(calibration: Calibration, board: Board) -> list[BoardEffect]:
    scale, stated = calibration.board_scale, calibration.hand_eye
    return [] if scale is None or stated is None or not scale.named else [as_effect(scale, board, stated)]


def views(calibration: Calibration) -> list[ViewRow]:
    """Return one record per view."""
    out: list[ViewRow] = []
    for number, (view, error) in enumerate(zip(calibration.views, calibration.fit_pixels, strict=True)):
        row: ViewRow = {"file": view.name, "corners": len(view.ids), "reprojection_px": float(error)}
        if calibration.hand_eye is not None:
            row["through_robot_px"] = float(calibration.hand_eye.pixels[number])
            row["misfit"] = float(calibration.hand_eye.misfit[number])
        out.append(row)
    return out


def notes(calibration: Calibration, missed: dict[str, str]) -> list[str]:
    """Return warnings for the user, one line each; `missed` is as for `record`."""
    out = []
    if missed:
        out.append("left out: " + "; ".join(f"{name} {why}" for name, why in missed.items()))
    middle = float(np.median(calibration.fit_pixels))
    for view, error in zip(calibration.views, calibration.fit_pixels, strict=True):
        if error > FAR_OFF * middle:
            out.append(f"{view.name}: reprojection {error:.2f} px against {middle:.2f} px elsewhere; blurred?")
    if calibration.hand_eye is not None:
        for view, misfit in zip(calibration.views, calibration.hand_eye.misfit, strict=True):
            if misfit > ODD:
                out.append(f"{view.name}: the flange pose is {misfit:.1f} standard deviations off; moving, or swapped?")
        robot = calibration.hand_eye.robot * PER_UNIT[[0, 3]]
        if (robot > DISAGREE).any():
            disagreement = f"poses and images disagree by {robot[0]:.1f} mm and {robot[1]:.1f} deg"
            out.append(f"{disagreement}: poses of other images, or taken while moving?")
        scale = calibration.board_scale
        if scale is not None and scale.named:
            within = f"[{scale.value - scale.half:.3f}, {scale.value + scale.half:.3f}]"
            out.append(f"by the robot's motion the board is {scale.value:.3f} {within} times as large: --square?")
        spread = np.ptp(np.stack([x[:3, 3] for x in calibration.hand_eye.methods.values()]), axis=0).max()
        if calibration.hand_eye_half is not None and spread > 3 * calibration.hand_eye_half[:3].max():
            out.append(f"closed-form methods differ by {1e3 * spread:.1f} mm: turn the flange farther")
    if calibration.intrinsics is not None:
        pixels = np.concatenate([view.pixels for view in calibration.views])
        cover = np.ptp(pixels, axis=0) / np.array(calibration.camera.size)
        if cover.min() < COVER:
            width, height = (f"{100 * part:.0f} %" for part in cover)
            out.append(f"corners cover {width} of the width and {height} of the height: distortion is a guess outside")
    return out


def _intrinsics(calibration: Calibration) -> Mapping[str, object]:
    half, fit = calibration.intrinsics_half, calibration.intrinsics
    out: dict[str, object] = {
        "width": calibration.camera.size[0],
        "height": calibration.camera.size[1],
        "fitted": fit is not None,
    }
    out["values"] = dict(zip(NAMES, calibration.camera.values.tolist(), strict=True))
    if half is not None and fit is not None:
        out["half_width_95"] = dict(zip(NAMES, half.tolist(), strict=True))
        out["half_width_95_pixel_noise"] = dict(zip(NAMES, (1.96 * fit.std).tolist(), strict=True))
    out["reprojection_px"] = float(np.sqrt(np.mean(calibration.fit_pixels**2)))
    return out


def _hand_eye(calibration: Calibration) -> Mapping[str, object] | None:
    eye, half = calibration.hand_eye, calibration.hand_eye_half
    if eye is None or half is None:
        return None
    return {
        "parent": calibration.mount,
        "pos_m": eye.camera[:3, 3].tolist(),
        "quat_wxyz": quaternion(eye.camera[:3, :3]).tolist(),
        "half_width_95": {"pos_m": half[:3].tolist(), "turn_rad": half[3:].tolist()},
        "half_width_95_one_fit": {"pos_m": (1.96 * eye.std[:3]).tolist(), "turn_rad": (1.96 * eye.std[3:]).tolist()},
        "board": {
            "parent": "base" if calibration.mount == "flange" else "flange",
            "pos_m": eye.board[:3, 3].tolist(),
            "quat_wxyz": quaternion(eye.board[:3, :3]).tolist(),
        },
        "board_scale_by_robot": None
        if calibration.board_scale is None
        else {"value": calibration.board_scale.value, "half_width_95": calibration.board_scale.half},
        "board_scatter_mm": 1e3 * eye.scatter,
        "robot_error": {"mm": 1e3 * float(eye.robot[0]), "deg": float(np.degrees(eye.robot[1]))},
        "through_robot_px": float(np.sqrt(np.mean(eye.pixels**2))),
        "methods": {
            name: {"pos_m": x[:3, 3].tolist(), "quat_wxyz": quaternion(x[:3, :3]).tolist()}
            for name, x in eye.methods.items()
        },
    }
