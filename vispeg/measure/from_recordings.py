"""Extract readings from recordings with a wrench: poses at rest, strokes of a slide, ramps of a press.

A slide or a press begins with a second in free air, whose mean wrench is the sensor's bias.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.core.errors import UserError
from vispeg.measure.readings import Readings
from vispeg.recordings.cell import WrenchSensor, canonical, reaction
from vispeg.recordings.checks.quality import runs
from vispeg.recordings.differentiate import bridged, episodes, usual_rate
from vispeg.recordings.load import load
from vispeg.recordings.recording import Recording
from vispeg.robots.model import load as load_robot
from vispeg.robots.model import tilted
from vispeg.sim.compiled import flange_pose
from vispeg.sim.recorded import with_robot
from vispeg.sim.touch import tool_of
from vispeg.sim.units import check_units

DOWN = np.array([0.0, 0.0, -1.0])

REST, STILL = 0.5, 2e-3  # at rest: all joints within STILL rad for REST s
FREE, TOUCH = 1.0, 1.0  # s of free air at the start, N above which there is contact
SPEED, STROKE = 2e-3, 0.3  # a stroke is faster than SPEED m/s across the flange's axis for STROKE s
SMOOTH = 0.05  # s, averaging window of the speed


def at_rest(paths: Sequence[Path]) -> Readings:
    """Return the mean wrench (N, N m) and the direction of gravity, both in the flange frame, of every stretch at rest.

    The wrench is that of the tool on the flange.

    Raises:
        UserError: a recording that cannot be read, has no `ft` or one without the tool's weight, or never rests.
    """
    wrench, down = [], []
    for path in paths:
        rec, read, _, turn = _opened(path)
        if rec.wrench is not None and rec.wrench.tared == "weight":
            what, expected = "the robot has subtracted the tool's weight", "readings that contain it: false or true"
            raise UserError(what, file=path / "recording.yaml", key="wrench.tared", expected=expected, got="weight")
        length = max(2, round(REST * _rate(rec)))
        rests = _rests(bridged(rec.time, rec.q, rec.episode), length)
        if not rests:
            raise UserError(f"never rests for {REST:g} s", file=path, expected="an attitude that is held")
        for rows in rests:
            wrench.append(reaction(np.nanmean(read[rows], axis=0)))
            down.append(turn[(rows.start + rows.stop) // 2].inv().apply(tilted(DOWN, *rec.base_tilt)))
    names = ("fx", "fy", "fz", "tx", "ty", "tz", "gx", "gy", "gz")
    return Readings(paths[0], dict(zip(names, np.hstack([wrench, down]).T, strict=True)))


def declared_tool(paths: Sequence[Path]) -> tuple[float, np.ndarray]:
    """Return mass, kg, and centre of mass (3,), m, flange frame, of the tool that the recordings declare.

    Both are 0 without a tool.

    Raises:
        UserError: a recording that cannot be read, an unknown tool, or recordings of different tools.
    """
    declared = [(rec.robot, rec.tool) for rec in (load(path, lambda header: ()) for path in paths)]
    tools = [(0.0, np.zeros(3)) if tool is None else tool_of(load_robot(robot, tool))[:2] for robot, tool in declared]
    first = np.hstack(tools[0])
    for path, tool in zip(paths, tools, strict=True):
        if not np.allclose(np.hstack(tool), first):
            expected, got = f"{first[0]:g} kg, as the first one's", f"{tool[0]:g} kg"
            raise UserError("a recording of another tool", file=path, key="tool", expected=expected, got=got)
    return tools[0]


def slides(paths: Sequence[Path]) -> Readings:
    """Return the normal force (along the flange's z) and the tangential force of every stroke, N.

    With several recordings, the column `place` holds the recording's number.

    Raises:
        UserError: a recording that cannot be read, has no `ft`, or in which nothing slides.
    """
    rows: list[tuple[float, float, float]] = []
    for at, path in enumerate(paths):
        rec, read, position, turn = _opened(path)
        force, moved = _unbiased(rec.time, read, path), np.gradient(position, rec.time, axis=0)
        across = turn.inv().apply(moved)[:, :2]  # velocity along z is pressing, not sliding
        width = max(1, round(SMOOTH * _rate(rec)))
        smooth = np.stack([np.convolve(v, np.ones(width) / width, "same") for v in across.T], axis=1)
        sliding = (np.linalg.norm(smooth, axis=1) > SPEED) & (np.abs(force[:, 2]) > TOUCH)
        strokes = [s for s in (slice(*run) for run in runs(sliding)) if rec.time[s][-1] - rec.time[s][0] >= STROKE]
        if not strokes:
            what = f"nothing slides: no {STROKE:g} s above {SPEED:g} m/s and {TOUCH:g} N"
            raise UserError(what, file=path)
        for s in strokes:
            normal, tangential = np.abs(force[s, 2]), np.hypot(force[s, 0], force[s, 1])
            load = float(np.median(normal))  # a median, as the ratio dips at reversals
            rows.append((load, load * float(np.median(tangential / normal)), float(at)))
    table = np.array(rows)
    columns = {"normal": table[:, 0], "tangential": table[:, 1]}
    if len(paths) > 1:
        columns["place"] = table[:, 2]
    return Readings(paths[0], columns, {"normal": 0.0, "tangential": 0.0})


def presses(stop: Sequence[Path], fixture: Sequence[Path]) -> Readings:
    """Return force (N) and depth (m) along the flange's z of every press; loading and unloading are separate ramps.

    Args:
        stop: recordings of presses on a rigid stop, one per arm pose.
        fixture: recordings of presses on the fixture, in the same order of arm poses.

    Raises:
        UserError: different numbers of recordings; one that cannot be read, has no `ft` or never touches.
    """
    if len(stop) != len(fixture) or not stop:
        expected = "as many of --stop as of --fixture, in the same order of arm poses"
        raise UserError("presses without their counterpart", expected=expected, got=f"{len(stop)} and {len(fixture)}")
    parts = []
    for on, paths in enumerate((stop, fixture)):
        for pose, path in enumerate(paths):
            rec, read, position, turn = _opened(path)
            force = np.abs(_unbiased(rec.time, read, path)[:, 2])
            depth = np.abs(turn[0].inv().apply(position - position[0])[:, 2])
            touching = np.flatnonzero(force > TOUCH)
            if not len(touching):
                raise UserError(f"never touches with more than {TOUCH:g} N", file=path)
            top = int(np.argmax(force))
            for ramp, rows in enumerate((touching[touching <= top], touching[touching > top])):
                if len(rows) > 2:
                    same = np.ones(len(rows))
                    parts.append(np.column_stack([force[rows], depth[rows], on * same, pose * same, ramp * same]))
    table = np.concatenate(parts)
    names = ("force", "depth", "on", "pose", "ramp")
    return Readings(stop[0], dict(zip(names, table.T, strict=True)), {"force": 0.0, "depth": 0.0})


def _opened(path: Path) -> tuple[Recording, np.ndarray, np.ndarray, Rotation]:
    """Load a recording; also return its wrench (n, 6), and the flange's positions (n, 3) m and n rotations in the base.

    The wrench is that of the flange on the tool, about the flange's origin, flange axes. The pose is measured, rows
    without it are left out. If `ee` was not recorded, it is from the robot's kinematics and angles without gaps.
    """
    rec = load(path)
    check_units(rec)
    if rec.ft is None:
        raise UserError("has no wrench", file=path, expected="columns ft.fx ... ft.tz")
    ft = rec.ft
    if rec.ee is not None and (known := np.isfinite(rec.ee).all(axis=1)).any():
        rec, ft, pose = rec.some(known), ft[known], rec.ee[known]
    else:
        rec, robot = with_robot(rec)
        pose = flange_pose(robot, bridged(rec.time, rec.q, rec.episode))
    turn = Rotation.from_quat(pose[:, 3:], scalar_first=True)
    return rec, canonical(ft, rec.wrench or WrenchSensor(), turn.as_matrix()), pose[:, :3], turn


def _rate(rec: Recording) -> float:
    """Return the usual number of samples per second."""
    return usual_rate(rec.time, episodes(rec.time, rec.episode))


def _unbiased(time: np.ndarray, wrench: np.ndarray, path: Path) -> np.ndarray:
    """Return the force (n, 3) N minus its mean in the first second, which must be in free air."""
    free = time - time[0] < FREE
    force = wrench[:, :3]
    if np.nanstd(force[free], axis=0).max() > TOUCH:
        raise UserError(f"does not begin with {FREE:g} s in free air", file=path)
    return np.nan_to_num(bridged(time, force - np.nanmean(force[free], axis=0)))


def _rests(q: np.ndarray, length: int) -> list[slice]:
    """Return disjoint stretches of at least `length` rows in which every joint stays within `STILL` rad."""
    out, start = [], 0
    while start + length <= len(q):
        end = start + length
        if not np.ptp(q[start:end], axis=0).max() <= STILL:
            start += max(1, length // 10)
            continue
        while end < len(q) and np.abs(q[end] - q[start]).max() <= STILL:
            end += 1
        out.append(slice(start, end))
        start = end
    return out
