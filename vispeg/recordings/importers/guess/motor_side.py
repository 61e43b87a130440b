"""Detect joint angles beyond their ranges that are motor angles; propose gear ratios from torques, or ask for them."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.checks.quality import Limits
from vispeg.recordings.importers.fits import TORQUE, Needs
from vispeg.recordings.importers.guess import words
from vispeg.recordings.importers.guess.propose import Line, Proposal, seconds
from vispeg.recordings.importers.mapping import FACTORS, Source, map_from
from vispeg.recordings.importers.ratios import Ratio, ratios
from vispeg.recordings.importers.slopes import TOGETHER, slope
from vispeg.recordings.importers.table import from_table
from vispeg.recordings.importers.turns import straightened
from vispeg.recordings.recording import Recording
from vispeg.recordings.tables.table import Table

SLACK, FEW = 0.1, 0.02  # an angle is not the joint's if more than FEW of its readings are SLACK rad beyond the range
LITTLE = math.radians(25)  # if no joint moves farther than this, angles read as degrees may be motor angles in radians
TINY = 1e-9  # factor on motor angles while the rest of a log is checked, so that none is beyond a joint's range
SHOWN = 3  # joints that a question lists individually


def of_motors(
    out: Proposal,
    table: Table,
    joints: Sequence[str],
    limits: Limits,
    needs_of: Callable[[Recording], Needs | None],
) -> None:
    """Propose gear ratios for joints whose columns hold motor angles, or ask for them.

    Args:
        out: the proposal, modified in place.
        table: the columns of the file.
        joints, limits: the robot's joints and their limits.
        needs_of: returns the model's inverse dynamics for a recording's joints.
    """
    lines = {line.target: line for line in out.lines}
    units = {lines[f"q.{joint}"].unit for joint in out.joints}
    if len(units) != 1 or not units <= {"rad", "deg"}:
        return
    stated = any(lines[f"q.{joint}"].named for joint in out.joints)
    degrees = units == {"deg"}
    raw = np.stack([table.columns[lines[f"q.{joint}"].column] for joint in out.joints], axis=1)
    unit = FACTORS["deg"] if stated and degrees else 1.0
    raw = raw * unit
    bounds = limits.range[[list(joints).index(joint) for joint in out.joints]]
    beyond = _beyond(raw, bounds)
    if not beyond.any():
        return
    places = [int(j) for j in np.flatnonzero(beyond)]
    found = _by_torques(out, table, joints, unit, places, needs_of)
    if not stated and all(FACTORS["deg"] in ratio for ratio in found.values()):
        small = float(np.nanmax(np.nanmax(raw, axis=0) - np.nanmin(raw, axis=0))) * FACTORS["deg"] < LITTLE
        if found or not small or not degrees:
            return  # degrees, as proposed
    known = {j: ratio for j, ratio in found.items() if ratio.text is not None}
    if known and not stated:
        _radians(out)
    for j, ratio in known.items():
        _apply(out, table, out.joints[j], ratio)
    if asked := [j for j in places if j not in known]:
        out.doubts.append(_question(out.joints, raw, bounds, asked, found, degrees and not stated and not known))


def _beyond(raw: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Test per joint whether its angles (n, nj) rad lie beyond its range under every shift by whole turns."""
    straight, _ = straightened(raw, bounds)
    low, high = bounds.T
    return np.mean((straight < low - SLACK) | (straight > high + SLACK), axis=0) > FEW


def _by_torques(
    out: Proposal,
    table: Table,
    joints: Sequence[str],
    unit: float,
    places: list[int],
    needs_of: Callable[[Recording], Needs | None],
) -> dict[int, Ratio]:
    """Estimate gear ratios of the joints at `places` from measured torques; empty without torques."""
    if "tau" not in out.signals():
        return {}
    # only time, angles and torques are used below: the map names angles, so what it leaves out is not read
    chosen = {
        key: value for key, value in words.data(out).items() if key.partition(".")[0] not in ("dq", "q_cmd", "dq_cmd")
    }
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            mapping = map_from(chosen, table.file, joints)
            angles = {f"q.{joint}": Source(mapping.columns[f"q.{joint}"].name, TINY) for joint in out.joints}
            rec = from_table(
                table, table.file, "robot", joints, replace(mapping, columns={**mapping.columns, **angles})
            )
            needs = needs_of(rec)
    except UserError:
        return {}  # the proposal itself reports it
    if needs is None or rec.tau is None:
        return {}
    q, _ = straightened(rec.q / TINY * unit, episode=rec.episode)
    return ratios(replace(rec, q=q), needs, places)


def _radians(out: Proposal) -> None:
    """Change angles and speeds to radians where degrees were assumed only because no gear was considered."""
    other = {"deg": "rad", "deg/s": "rad/s"}
    out.lines = [
        replace(
            line, unit=other[line.unit], why=f"{line.why}; but read as motor angles in radians, they fit the torques"
        )
        if line.unit in other and line.target.partition(".")[0] in ("q", "dq", "q_cmd", "dq_cmd")
        else line
        for line in out.lines
    ]


def _apply(out: Proposal, table: Table, joint: str, ratio: Ratio) -> None:
    """Enter one joint's ratio in the proposal: for all its columns, or only for those on the motor side."""
    text = str(ratio.text)
    value = 1 / float(text[2:]) if text.startswith("1/") else float(text)
    columns = {line.target.partition(".")[0]: line for line in out.lines if line.target.endswith(f".{joint}")}
    angle = columns["q"]
    motor = {"q"}
    for signal in {"dq", "q_cmd", "dq_cmd"} & set(columns):
        if _of_motor(table, out, angle, columns[signal], value):
            motor.add(signal)
    size = abs(ratio.torque)
    motor_torque = not out.current and 1 / TORQUE < size / value < TORQUE
    joint_torque = not out.current and 1 / TORQUE < size < TORQUE and abs(math.log(size)) < abs(math.log(size / value))
    angles = {"q", "dq", "q_cmd", "dq_cmd"} & set(columns)
    if motor_torque and not joint_torque and motor == angles:
        out.motors[joint] = text
        return
    said = f"its motor's side: {text} ({1 / ratio.high:.4g} to {1 / ratio.low:.4g})"
    for place, line in enumerate(out.lines):
        signal, _, name = line.target.partition(".")
        if name != joint or (signal not in motor and not (signal == "tau" and motor_torque and not joint_torque)):
            continue
        factor = value if signal in motor else 1 / value
        out.lines[place] = replace(
            line, scale=float(f"{line.scale * factor:.6g}"), why=f"{line.why}; {said}", sure="measured"
        )


def _of_motor(table: Table, out: Proposal, angle: Line, other: Line, value: float) -> bool:
    """Test whether a joint's speed or commanded angle, of the line `other`, is on the motor side, as its angle is."""
    measured, values = (table.columns[line.column] * FACTORS[line.unit] for line in (angle, other))
    signal = other.target.partition(".")[0]
    if signal == "dq":
        step = np.diff(seconds(table, next(line for line in out.lines if line.target == "time")))
        good = step > 0
        ratio = slope(np.diff(measured)[good] / step[good], values[1:][good], TOGETHER)
    elif signal == "q_cmd":
        ratio = slope(measured, values, TOGETHER)
    else:
        return True  # commanded speeds are taken to be on the angle's side
    return ratio is None or abs(math.log(ratio)) < abs(math.log(ratio / value))


def _question(
    names: Sequence[str],
    raw: np.ndarray,
    bounds: np.ndarray,
    asked: list[int],
    found: dict[int, Ratio],
    degrees: bool,
) -> str:
    """Word one line that asks for the ratios which the torques do not determine."""
    parts = []
    for j in asked[:SHOWN]:
        low, high = float(np.nanmin(raw[:, j])), float(np.nanmax(raw[:, j]))
        near = (
            f", by the torques 1/{1 / found[j].value:.3g} (1/{1 / found[j].low:.3g} to 1/{1 / found[j].high:.3g})"
            if j in found
            else ""
        )
        parts.append(
            f"{names[j]} {low:.3g} to {high:.3g} rad for a range of {bounds[j][0]:.3g} to {bounds[j][1]:.3g}{near}"
        )
    more = f" and {len(asked) - SHOWN} more" if len(asked) > SHOWN else ""
    what = "small angles in degrees, or the motors' in radians" if degrees else "another unit, or the motors'"
    return f"{what}: {'; '.join(parts)}{more}; for motors state `motors: {{{names[asked[0]]}: 1/GEAR, ..}}` in the map"
