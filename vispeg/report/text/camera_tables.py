"""A camera calibration as tables: numbers with intervals, one row per image, and notes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vispeg.report.text.summary import Block, Line
from vispeg.report.text.tables import Column, Sheet

DEGREES = 57.29578  # per radian
# key of a view -> column; `render.calibration.results.ViewRow` defines the three
HEADS = {"reprojection_px": "reprojection px", "through_robot_px": "through robot px", "misfit": "misfit sigma"}


def calibration_summary(results: Mapping[str, Any]) -> list[Block]:
    """Summarise the content of results.json."""
    keys = [key for key in HEADS if key in results["views"][0]]
    columns = [Column("image"), *(Column(head, right=True) for head in ("corners", *(HEADS[k] for k in keys)))]
    views = [[row["file"], str(row["corners"]), *(f"{row[key]:.2f}" for key in keys)] for row in results["views"]]
    numbers = [Column(head) for head in ("what", "value", "95 %", "unit")]
    # `path` also keeps a line of numbers from being wrapped
    blocks: list[Block] = [Sheet(numbers, _numbers(results)), Sheet(columns, views), Line(_line(results), path=True)]
    blocks += [Line(_effect(e)) for e in results.get("effects", [])]
    return blocks + [Line(f"  ! {note}", path=True) for note in results["notes"]]


def _numbers(results: Mapping[str, Any]) -> list[list[str]]:
    intrinsics, hand_eye = results["intrinsics"], results["hand_eye"]
    rows: list[list[str]] = []
    half_widths = intrinsics.get("half_width_95", {})
    for key, value in intrinsics["values"].items():
        free = half_widths.get(key, 0.0) > 0
        if value != 0 or free:
            width = f"+- {half_widths[key]:.2g}" if free else "held" if intrinsics["fitted"] else "given"
            rows.append([key, f"{value:.5g}", width, "px" if key in ("fx", "fy", "cx", "cy") else ""])
    if hand_eye is not None:
        for axis, value, width in zip("xyz", hand_eye["pos_m"], hand_eye["half_width_95"]["pos_m"], strict=True):
            rows.append([f"{axis} on {hand_eye['parent']}", f"{1e3 * value:.2f}", f"+- {1e3 * width:.2g}", "mm"])
        for axis, width in zip("xyz", hand_eye["half_width_95"]["turn_rad"], strict=True):
            rows.append([f"turn about its {axis}", "", f"+- {DEGREES * width:.2g}", "deg"])
        rows.append(["quaternion wxyz", " ".join(f"{value:.4f}" for value in hand_eye["quat_wxyz"]), "", ""])
    return rows


def _effect(effect: Mapping[str, Any]) -> str:
    """Return an effect's value, and the scatter of the board's origin with the corrected and with the given square."""
    ((name, v),) = effect["params"].items()
    before, after = effect["board_scatter_mm"]
    value = f"{effect['effect']}({effect['where']}): {name} {v['value']:.3f} [{v['low']:.3f}, {v['high']:.3f}]"
    return (
        f"{value}; with --square {effect['square_m']:.4g} the board's origin scatters {after:.1f} mm, not {before:.1f}"
    )


def _line(results: Mapping[str, Any]) -> str:
    intrinsics, hand_eye = results["intrinsics"], results["hand_eye"]
    line = f"{results['images']['used']} images, reprojection {intrinsics['reprojection_px']:.2f} px RMS"
    if hand_eye is not None:
        robot = hand_eye["robot_error"]
        line += f", board origin scatter {hand_eye['board_scatter_mm']:.1f} mm RMS"
        line += f"; robot's own error about {robot['mm']:.2g} mm, {robot['deg']:.2g} deg"
    return line
