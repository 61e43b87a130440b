"""Measure joint zeros and frames from poses at rest, as `vispeg measure zeros` does."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.api.measure.result import MeasurementResult, MeasureSettings, check_out, write
from vispeg.api.recording.convert import placed as placed_robot
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.core.params import Value
from vispeg.core.paths import expanded
from vispeg.core.rotation import quaternion
from vispeg.measure.becomes import placed
from vispeg.measure.pose_table import Readings, best, readings
from vispeg.measure.screws import Screws
from vispeg.measure.zeros import Confounded, Poses, Zeros, half_width, roughly, solve
from vispeg.recordings.tables.read import read_table
from vispeg.recordings.tables.table import Table
from vispeg.robots.model import load
from vispeg.sim.compiled import flange_pose
from vispeg.worlds.measurement_file import Measurement, Quantity

WEAK = 0.02  # rad; a zero with a larger half width of its interval is reported as weakly determined
Known = Literal["known", "unknown"]


def measure_zeros(
    table: str | Path,
    out: str | Path,
    robot: str,
    *,
    base: Known = "unknown",
    tool: Known = "unknown",
    orientation: Literal["rotation_vector", "fixed_xyz", "moving_xyz"] | None = None,
    settings: MeasureSettings | None = None,
) -> MeasurementResult:
    """Measure the offset of each joint's encoder, and the frames of base and tip, from poses at rest.

    Args:
        table: table with one pose per row (.csv, .csv.gz, .parquet): joint angles as read, the tip's measured position
            and, if available, orientation.
        out: the measurement file to write (.yaml).
        robot: a robot's name, or a path to its MJCF or URDF.
        base: known if the poses are in the robot's base frame; otherwise the base frame is found.
        tool: known if the poses are those of the flange; otherwise the tip's frame on the flange is found.
        orientation: meaning of three angles: a rotation vector, or turns about fixed (URDF's rpy) or moving axes;
            default: the interpretation that fits the data.
        settings: only `conditions` and `overwrite` are used.

    Raises:
        UserError: no such table or robot, a table without poses or without the robot's joints, too few poses or ones
            that do not determine the frames, units that neither header nor data determine, or `out` exists.
    """
    settings = settings or MeasureSettings()
    path, robot = Path(table), placed_robot(robot)
    check_out(expanded(out), settings.overwrite)
    model = load(robot)
    arm = Screws(lambda q: flange_pose(model, q), len(model.joints))
    fixed = {"base_known": base == "known", "tool_known": tool == "known"}

    def misfit(way: Readings) -> tuple[float, float]:
        return roughly(_poses(way), arm, **fixed)

    rows = read_table(path)
    way = best(readings(rows, model.joints, orientation), misfit, path)
    try:
        found = solve(_poses(way), arm, **fixed)
    except UserError as error:
        raise UserError(f"zeros and frames cannot be determined: {error}", file=path) from error
    results, effects = _numbers(found, model.joints, len(way.position), **fixed)
    measurement = Measurement(
        "zeros",
        model.name,
        tuple(results),
        tuple(effects),
        robot,
        dict(settings.conditions or {}),
        notes=tuple(_notes(found, way, model.joints, rows)),
        details=_details(found, **fixed),
    )
    return write(measurement, expanded(out), [path], settings)


def _poses(way: Readings) -> Poses:
    assert way.angles is not None  # asked for with the robot's joints
    return Poses(way.angles, way.position, way.turn)


def _numbers(
    found: Zeros, joints: Sequence[str], count: int, base_known: bool, tool_known: bool
) -> tuple[list[Quantity], list[EffectInstance]]:
    """Return the offsets and the positions of the frames as quantities, and the offsets as effects.

    Offsets that are not identified are left out; ones beyond the effect's bounds are no effects. `count` is the number
    of poses.
    """
    confounded = {c.joint for c in found.confounded}
    results, effects = [], []
    for j, joint in enumerate(joints):
        if j in confounded:
            continue
        quantity = _quantity(f"offset_{joint}", found.offset[j], "rad", found.u["offset"][j], found.dof, count)
        results.append(quantity)
        value = Value(quantity.value, quantity.low, quantity.high)
        if abs(quantity.value) <= effect("encoder_offset").params["offset"].high:
            effects.append(placed("encoder_offset", joint, {"offset": value}, quantity))
    for name, pose, known in (("base", found.base, base_known), ("tool", found.tool, tool_known)):
        if known:
            continue
        for axis, value, u in zip("xyz", pose[:3, 3], found.u[name][:3], strict=True):
            results.append(_quantity(f"{name}_{axis}", float(value), "m", float(u), found.dof, count))
    return results, effects


def _quantity(name: str, value: float, unit: str, u: float, dof: int, count: int) -> Quantity:
    """Return a quantity with its 95 % interval; `u` is its standard uncertainty with `dof` degrees of freedom."""
    half = float(half_width(np.array(u), dof))
    k = half / u if u > 0 else 0.0
    return Quantity(name, float(value), unit, float(u), dof, k, value - half, value + half, "gum", (), count)


def _details(found: Zeros, base_known: bool, tool_known: bool) -> dict[str, Any]:
    """Return the frames that were not known with 95 % half widths, m and rad, and the RMS residuals.

    From positions alone the tool's orientation is not determined, so it is left out.
    """
    out: dict[str, Any] = {"error_mm": 1e3 * found.error_m}
    out |= {} if found.error_rad is None else {"error_deg": float(np.degrees(found.error_rad))}
    for name, key, pose, known in (
        ("base", "world_T_base", found.base, base_known),
        ("tool", "flange_T_tip", found.tool, tool_known),
    ):
        if known:
            continue
        half = half_width(found.u[name], found.dof)
        frame: dict[str, Any] = {"pos_m": pose[:3, 3].tolist()}
        turned = name == "base" or found.error_rad is not None
        if turned:
            frame["quat_wxyz"] = quaternion(pose[:3, :3]).tolist()
        frame["half_width_95"] = {"pos_m": half[:3].tolist()} | ({"turn_rad": half[3:].tolist()} if turned else {})
        out[key] = frame
    return out


def _notes(found: Zeros, way: Readings, joints: Sequence[str], rows: Table) -> list[str]:
    """Return lines on the choices made, the residuals, and on joints and rows that deserve a look."""
    out = [f"taken as {', '.join(way.said)}: the header leaves it open, and no other reading fits"] if way.said else []
    left = f"left are {1e3 * found.error_m:.3g} mm an axis"
    left += "" if found.error_rad is None else f" and {np.degrees(found.error_rad):.2g} degrees"
    turn = Rotation.from_matrix(found.base[:3, :3]).magnitude()
    at = ", ".join(f"{x:.4f}" for x in found.base[:3, 3])
    out.append(f"{left}; the base stands at ({at}) m in the measured frame, turned by {np.degrees(turn):.2f} degrees")
    out += [_confounded(c, joints) for c in found.confounded]
    half = half_width(found.u["offset"], found.dof)
    weak = [joint for joint, h in zip(joints, half, strict=True) if h > WEAK]
    if weak:
        out.append(f"weakly determined by these poses: {', '.join(weak)}; add poses in which they turn farther")
    most = effect("encoder_offset").params["offset"].high
    large = [f"{joint} {o:.3g} rad" for joint, o in zip(joints, found.offset, strict=True) if abs(o) > most]
    if large:
        out.append(f"beyond the limit of the effect encoder_offset ({most:g} rad): {', '.join(large)}; another zero?")
    for row, size in found.odd.items():
        out.append(
            f"{rows.row(row)} of {rows.file.name} is {size:.1f} standard deviations off: moved, or another pose?"
        )
    return out


def _confounded(c: Confounded, joints: Sequence[str]) -> str:
    """Return a line on a zero that is not identifiable."""
    name = joints[c.joint]
    others = [*(["the base's frame"] if c.base else []), *(["the tool's frame"] if c.tool else [])]
    others += [f"the zero of {joints[j]}" for j in c.others]
    if not others:
        return f"{name}: its zero moves no measured tip, so it is not determined"
    return f"{name}: its zero cannot be distinguished from {' and '.join(others)}: it is left at 0, and they absorb it"
